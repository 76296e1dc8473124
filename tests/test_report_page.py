"""The page of a report in a real browser: by keyboard, in both themes, narrow, printed, without script.

Needs Chromium (Debian: apt-get install chromium). Where CI is set its absence is a failure, elsewhere a skip.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from certify.certificate import prove
from certify.inputs import decode_all
from certify.report.page.build import build_report
from certify.report.page.subject import Subject
from tests.conftest import ROOT

CHROMIUM = Path("/usr/bin/chromium")
ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"]
ARGUMENTS += ["--disable-component-update", "--disable-sync", "--disable-dev-shm-usage"]
FILE = f"{'long' * 75}.toml"
MISSING = "Chromium is missing: install Debian's package chromium (tests/install_browser.sh)"
HOSTILE = (
    "<script>document.title='broken'</script><img src=http://203.0.113.1/x.png onerror=\"document.title='broken'\">"
)


def write(folder: Path, spec: bytes, simulate: bool = False) -> Path:
    certificate = prove(spec)
    subject = Subject(
        decode_all(spec), spec, certificate.data, certificate.verdict, certificate.notes, FILE, "cert.json"
    )
    motion = None
    if simulate:
        from certify.report.page.motion import show_motion

        motion = show_motion(subject)
    folder.mkdir()
    for name, data in build_report(subject, motion).items():
        (folder / name).write_bytes(data)
    return folder / "index.html"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    if not CHROMIUM.exists():
        if os.environ.get("CI"):
            pytest.fail(MISSING)
        pytest.skip(MISSING)
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        found = playwright.chromium.launch(executable_path=str(CHROMIUM), args=ARGUMENTS)
        yield found
        found.close()


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("pages")
    found = {"refuted": write(folder / "refuted", (ROOT / "specs" / "cigre-mv-as-printed.toml").read_bytes())}
    found["simulated"] = write(folder / "simulated", (ROOT / "specs" / "two-inverters.toml").read_bytes(), True)
    text = (ROOT / "specs" / "single-inverter.toml").read_text()
    text = re.sub(
        r"^name = .*$", f'name = """{HOSTILE} {"x" * (199 - len(HOSTILE))}"""', text, count=1, flags=re.MULTILINE
    )
    long = f"{'n' * 31} {'w' * 32}"
    text = re.sub(r"^\[node\.[^\]]*\]", f'[node."{long}"]', text, flags=re.MULTILINE)
    found["hostile"] = write(folder / "hostile", text.encode())
    return found


@pytest.fixture
def open_page(browser: Any) -> Iterator[Any]:
    """Opens a page in a context of its own. At the end: nothing was loaded, no error, no message of the console."""
    contexts, said, asked = [], list[str](), list[str]()

    def open_in(path: Path, **options: Any) -> Any:
        context = browser.new_context(**{"viewport": {"width": 1280, "height": 900}, **options})
        contexts.append(context)
        page = context.new_page()
        page.on("console", lambda message: said.append(message.text))
        page.on("pageerror", lambda error: said.append(str(error)))
        page.on("request", lambda request: asked.append(request.url))
        page.goto(path.as_uri())
        return page

    yield open_in
    for context in contexts:
        context.close()
    assert not said
    assert all(
        url.startswith("file:///") and url.split("#")[0].endswith("/index.html") for url in asked if url != "data:,"
    )


RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "best-practice"]


def faults_of(page: Any, rules: list[str]) -> list[str]:
    """What axe finds, with the elements."""
    from axe_playwright_python.sync_playwright import Axe

    result = Axe().run(page, options={"runOnly": rules})
    return [
        f"{entry['id']}: {node['html'][:120]} {node.get('failureSummary', '')[:200]}"
        for entry in result.response["violations"]
        for node in entry["nodes"][:3]
    ]


@pytest.mark.parametrize(("name", "theme"), [("refuted", "dark"), ("simulated", "light")])
def test_contrast_and_accessibility(pages: dict[str, Path], open_page: Any, name: str, theme: str) -> None:
    page = open_page(pages[name], color_scheme=theme)
    dark = page.evaluate("getComputedStyle(document.body).backgroundColor") != "rgb(255, 255, 255)"
    assert dark == (theme == "dark")
    if name == "simulated":
        page.evaluate("document.querySelectorAll('details').forEach(d => { d.open = true; })")
    assert faults_of(page, RULES if name == "simulated" else ["color-contrast"]) == []


def test_the_theme_can_be_chosen(pages: dict[str, Path], open_page: Any) -> None:
    page = open_page(pages["refuted"], color_scheme="light")
    page.get_by_role("button", name="Dark theme").click()
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(14, 20, 27)"
    assert page.get_by_role("button", name="Light theme").is_visible()


def test_every_part_is_reached_by_keyboard_with_visible_focus(pages: dict[str, Path], open_page: Any) -> None:
    page = open_page(pages["refuted"])
    parts = page.locator("a.part").count()
    reached, seen = set(), set()
    for _ in range(400):
        page.keyboard.press("Tab")
        found = page.evaluate(
            """() => { const e = document.activeElement; const s = getComputedStyle(e); const r = e.getBoundingClientRect();
            return [e.tagName, e.getAttribute('href') || '', e.getAttribute('class') || '',
                    s.outlineStyle !== 'none' && parseFloat(s.outlineWidth) >= 2, r.width > 0 && r.height > 0,
                    [...document.querySelectorAll('*')].indexOf(e)]; }"""
        )
        if found[0] == "BODY" or found[5] in seen:
            break
        seen.add(found[5])
        assert found[3], f"no focus to be seen at {found}"
        assert found[4], f"nothing to be seen at {found}"
        if found[2].startswith("part"):
            reached.add((found[1], found[5]))
    assert len(reached) == parts == 27
    assert (
        len(seen)
        >= page.evaluate(
            "[...document.querySelectorAll('a[href],button,input,summary,[tabindex=\"0\"]')]"
            ".filter(e => e.checkVisibility({contentVisibilityAuto: true})).length"
        )
        - 1
    )


def test_a_part_opens_its_claim(pages: dict[str, Path], open_page: Any) -> None:
    page = open_page(pages["refuted"])
    page.locator("a.part.refuted").first.focus()
    page.keyboard.press("Enter")
    claim = page.locator("details.claim.refuted")
    assert claim.get_attribute("open") is not None
    assert page.evaluate("location.hash") == "#claim-dgu-1"
    box = claim.bounding_box()
    assert box is not None
    assert -1 <= box["y"] < 900
    assert claim.get_by_role("rowheader", name="Re(u* Z(s0) u)").is_visible()


def test_claims_are_filtered_by_status_and_text(pages: dict[str, Path], open_page: Any) -> None:
    page = open_page(pages["refuted"])
    shown = page.locator("details.claim:visible")
    assert shown.count() == 33 - 1
    page.get_by_role("button", name="refuted 1").click()
    assert shown.count() == 1
    assert page.locator("#count").inner_text() == "1 of 32 shown"
    page.get_by_role("button", name="all", exact=True).click()
    page.get_by_label("Search claims").fill("node 7 monotone")
    assert shown.count() == 1
    page.locator("a.part.refuted").first.click()
    assert page.locator("details.claim.refuted").is_visible(), "a link shows what the filter hides"


def test_paper_has_everything_open(pages: dict[str, Path], open_page: Any) -> None:
    """With the page's script and, by the style sheet alone, without."""
    for script in (True, False):
        page = open_page(pages["refuted"], java_script_enabled=script)
        page.emulate_media(media="print")
        text = page.locator("details.claim .inside").first
        if script:
            page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
            assert page.evaluate("document.querySelectorAll('details:not([open])').length") == 0
        box = text.bounding_box()
        assert box is not None
        assert box["height"] > 50
        assert not page.locator(".filter").is_visible()
    page = open_page(pages["refuted"], color_scheme="dark")
    page.emulate_media(media="print")
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert len(page.pdf()) > 20_000


@pytest.mark.parametrize("name", ["refuted", "simulated", "hostile"])
def test_a_narrow_screen_needs_no_scrolling_to_the_side(pages: dict[str, Path], open_page: Any, name: str) -> None:
    page = open_page(pages[name], viewport={"width": 390, "height": 800})
    page.evaluate("document.querySelectorAll('details').forEach(d => { d.open = true; })")
    assert page.evaluate("document.documentElement.scrollWidth") <= 390


def test_what_stands_in_a_spec_is_text(pages: dict[str, Path], open_page: Any) -> None:
    page = open_page(pages["hostile"])
    assert page.title().startswith("CERTIFIED: <script>")
    assert page.locator("img").count() == 0
    assert page.locator("h1").inner_text().startswith("<script>")


def test_the_page_works_without_script(pages: dict[str, Path], open_page: Any) -> None:
    page = open_page(pages["refuted"], java_script_enabled=False)
    assert not page.locator(".filter").is_visible()
    assert not page.locator("#theme").is_visible()
    claim = page.locator("details.claim.refuted")
    page.locator("a.part.refuted").first.click()
    assert claim.get_by_role("rowheader", name="Re(u* Z(s0) u)").is_visible(), (
        "a link opens the claim that it leads into"
    )
    summary = page.locator("details.claim.proved summary").first
    summary.click()
    assert page.locator("details.claim.proved .inside").first.is_visible()


def test_texts_of_the_drawing_do_not_touch(pages: dict[str, Path], open_page: Any) -> None:
    page = open_page(pages["refuted"])
    boxes = page.evaluate(
        "[...document.querySelectorAll('.network text')].map(e => { const r = e.getBoundingClientRect();"
        " return [e.textContent, r.left, r.top, r.right, r.bottom]; })"
    )
    assert len(boxes) > 20
    for k, (a, left, top, right, bottom) in enumerate(boxes):
        for b, l2, t2, r2, b2 in boxes[:k]:
            assert right <= l2 + 1 or r2 <= left + 1 or bottom <= t2 + 1 or b2 <= top + 1, f"{a} and {b} touch"
