"""The report of a certificate: what its files say, what is escaped, and what bad input does."""

from __future__ import annotations

import json
import re
from functools import cache
from html.parser import HTMLParser
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from certify.certificate import Certificate, prove
from certify.cli import main
from certify.diagnostics import DIAGNOSTICS
from certify.inputs import decode_all
from certify.report.page import diagram, entries
from certify.report.page.build import build_report
from certify.report.page.charts import Axis, Chart, decade_ticks, round_ticks, tick_text
from certify.report.page.diagram import draw_network
from certify.report.page.margins import law_margins
from certify.report.page.places import lines_over_cards, place
from certify.report.page.subject import Subject
from tests.bench.networks import microgrid
from tests.conftest import ROOT

SPECS = ["cigre-mv", "cigre-mv-as-printed", "other-loads"]
NEGATIVE = ["constant-power-load", "current-coupled-between-axes", "lossless", "fails-between-cut-offs"]


def subject_of(spec: bytes, name: str = "grid.toml", certificate: Certificate | None = None) -> Subject:
    found = prove(spec) if certificate is None else certificate
    return Subject(decode_all(spec), spec, found.data, found.verdict, found.notes, name, "grid.cert.json")


class Page(HTMLParser):
    """The text of a page, and the elements with their attributes."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.text = ""
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        while self.open.pop() != tag:
            pass

    def handle_data(self, data: str) -> None:
        if not {"script", "style"} & set(self.open):
            self.text += data

    def of(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name == tag]


@cache
def page_of(spec: Path) -> tuple[Page, str, Subject]:
    subject = subject_of(spec.read_bytes(), str(spec))
    files = build_report(subject)
    return Page(files["index.html"].decode()), files["report.md"].decode(), subject


@pytest.mark.parametrize(
    "spec",
    [*(f"{name}.toml" for name in SPECS), "custom-loop.json", *(f"negative/{name}.toml" for name in NEGATIVE)],
)
def test_every_claim_stands_on_the_page_with_its_status(spec: str) -> None:
    page, markdown, subject = page_of(ROOT / "specs" / spec)
    rows = {str(row["data-text"]).split(" ")[0]: row["class"] for row in page.of("details") if row.get("data-text")}
    for claim in subject.verdict.claims:
        first = claim.id.lower().split(" ")[0]
        assert rows[first] == f"claim {claim.status}", claim.id
        assert claim.id in page.text
        assert claim.statement[1:] in page.text
        if claim.status != "proved":
            assert f"{claim.status} | `{claim.id}`" in markdown
    assert len(rows) == len(subject.verdict.claims)
    assert subject.verdict.outcome.upper() in markdown.splitlines()[0]
    anchors = [a["id"] for _, a in page.elements if a.get("id")]
    assert len(anchors) == len(set(anchors)), "an id stands twice"
    for link in page.of("a"):
        assert str(link["href"])[0] == "#"
        assert str(link["href"])[1:] in anchors
    for name, text in subject.verdict.assumptions:
        assert name in page.text
        assert text[1:] in page.text


def test_what_failed_is_told_first_and_in_words() -> None:
    page, markdown, _ = page_of(ROOT / "specs" / "cigre-mv-as-printed.toml")
    head = page.text[: page.text.index("The network")]
    for text in ("DGU 1 is not passive", "not the stability of the network", "s₀ = 9.6 + j 96", "−954.329 Ω < 0"):
        assert text in head, text
    for text in ("Nearest passive gains", "0.9882", "2.8", "frequency-witness", "invariant-set/1"):
        assert text in head, text
    assert "❌ REFUTED" in markdown.splitlines()[0]
    assert markdown.index("DGU 1 is not passive") < 400


def test_the_witness_is_told_at_its_corner_and_modes_beside_the_verdict() -> None:
    page, _, _ = page_of(ROOT / "specs" / "negative" / "tolerance-too-large.toml")
    assert "L = 0.00288 H, the upper end" in page.text
    page, _, _ = page_of(ROOT / "specs" / "saturating-inverter.toml")
    assert "mode/a/dq" in page.text
    assert "switching between modes" in page.text


def test_what_is_conditional_is_not_called_proved() -> None:
    spec = (ROOT / "specs" / "two-inverters.toml").read_bytes()
    subject = subject_of(spec, certificate=prove(spec, method="sampled"))
    assert subject.verdict.outcome == "conditional"
    page = Page(build_report(subject)["index.html"].decode())
    told = page.text[page.text.index("Proved") : page.text.index("The network")]
    assert told.count("Only if what the ledger assumes holds: ") == 2
    assert "0 of" not in told
    assert "Conditional: load at node a, load at node b" in told
    assert "That proves nothing" in told


LIMITED = (
    DIAGNOSTICS["S002"].example
    + """
[node.b]
dgu = { filter = "lc", controller = "phs", reference = ["20 kV", "1 kV"], limits = ["20.1 kV", "1 kV"] }
load = [{ kind = "rl", R = "5 ohm", L = "0.01 H" }]
"""
)


def test_islands_are_told_one_by_one() -> None:
    subject = subject_of(LIMITED.encode())
    files = build_report(subject)
    page = Page(files["index.html"].decode())
    assert subject.title == "grid.toml", "a spec without a name goes by its file"
    for text in (
        "Equilibrium of the island of node b: refuted, because an inverter would need more than its limits.",
        "There is exactly one equilibrium of the island of node a",
        "All motion on the island of node a tends to it, from everywhere.",
        "its limit, d: 20100 V",
        "Not decided because of the above: region/b",
    ):
        assert text in page.text, text
    assert "Island of node a, 1 node" in page.text
    assert "the network is not certified" not in page.text


def test_numbers_are_those_of_the_kernel_exactly() -> None:
    spec = (ROOT / "specs" / "two-inverters.toml").read_bytes()
    subject = subject_of(spec)
    page = Page(build_report(subject)["index.html"].decode())
    claim = subject.claims[next(c for c in subject.claims if c.startswith("equilibrium/"))]
    told = 0
    for name, value, _ in claim.facts:
        assert name in page.text
        if len(str(value)) <= 1000 and value.denominator > 10**6:
            assert f"= {value}" in page.text
            told += 1
    assert told > 1
    assert subject.spec_sha256 in page.text
    assert subject.certificate_sha256 in page.text


def test_a_page_loads_nothing_and_allows_only_its_own_script() -> None:
    page, _, _ = page_of(ROOT / "specs" / "other-loads.toml")
    policy = next(meta for meta in page.of("meta") if meta.get("http-equiv") == "Content-Security-Policy")["content"]
    assert policy is not None
    assert policy.startswith("default-src 'none'; style-src 'sha256-")
    assert "unsafe" not in policy
    for tag, attributes in page.elements:
        assert not any(name.startswith("on") for name in attributes), "an inline handler"
        assert "style" not in attributes, "an inline style"
        assert attributes.get("src") is None
        assert tag not in {"img", "iframe", "object", "embed", "form", "base"}
        if tag == "link":
            assert attributes["href"] == "data:,"


HOSTILE = "<script>alert(1)</script>\"'><img src=x onerror=alert(2)> {{ 7*7 }} `|x| [a](javascript:b)"


def test_names_from_spec_and_certificate_are_escaped() -> None:
    text = (ROOT / "specs" / "two-inverters.toml").read_text()
    spec = re.sub(r"^name = .*$", f"name = {json.dumps(HOSTILE)}", text, count=1, flags=re.MULTILINE).encode()
    certificate = prove(spec)
    document = json.loads(certificate.data)
    document["provenance"] |= {"created": HOSTILE, "certify": "</style><script>alert(3)</script>", "more": HOSTILE}
    forged = json.dumps(document).encode()
    subject = Subject(
        decode_all(spec), spec, forged, certificate.verdict, certificate.notes, f"{HOSTILE}.toml", HOSTILE
    )
    files = build_report(subject)
    page = Page(files["index.html"].decode())
    assert HOSTILE in page.text
    assert len(page.of("script")) == 1
    assert not page.of("img")
    markdown = files["report.md"].decode()
    fenced = re.sub(r"^```.*?^```", "", markdown, flags=re.DOTALL | re.MULTILINE)
    coded = re.sub(r"`[^`\n]*`", "", fenced)
    assert "<script" not in coded
    assert "](javascript" not in coded.replace(r"\]", "")


@pytest.mark.parametrize("name", ["n" * 64, "n" * 30 + " " + "m" * 33, "a:b+c.d"])
def test_long_names_stay_whole_in_the_claims_and_short_in_pictures(name: str) -> None:
    text = (ROOT / "specs" / "single-inverter.toml").read_text()
    spec = re.sub(r"^\[node\.[^\]]*\]", f'[node."{name}"]', text, flags=re.MULTILINE).encode()
    subject = subject_of(spec)
    page = Page(build_report(subject)["index.html"].decode())
    assert f"dgu/{name}" in page.text
    assert f"claim-dgu-{re.sub('[^A-Za-z0-9_.-]', '-', name)}" in [a.get("id") for _, a in page.elements]


def test_the_same_input_gives_the_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    found = []
    for k in "12":
        assert main(["report", "specs/two-inverters.toml", "-o", str(tmp_path / k), "--no-simulate"]) == 0
        found.append({file.name: file.read_bytes() for file in (tmp_path / k).iterdir()})
    assert found[0] == found[1]
    assert set(found[0]) == {"index.html", "report.md", "certificate.json"}
    assert b"2023-11-14T22:13:20Z" in found[0]["index.html"]


def test_a_simulated_report_draws_the_edge_of_the_region(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "r"
    assert main(["report", "specs/two-inverters.toml", "-o", str(folder), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["simulated"] is True
    assert told["contradictions"] == []
    assert set(told["files"]) == {"index.html", "report.md", "certificate.json"}
    page = Page((folder / "index.html").read_text())
    for text in ("the edge of the proved region, H = 0.999 c", "Evidence in floats, no proof", "agrees", "level c = "):
        assert text in page.text, text
    assert "CONTRADICTS" not in page.text
    assert "Simulated cross-check" in (folder / "report.md").read_text()


def test_without_a_region_a_small_disturbance_is_simulated() -> None:
    from certify.report.page.motion import show_motion

    spec = (ROOT / "specs" / "negative" / "positive-damping-sign.toml").read_bytes()
    subject = subject_of(spec)
    assert not subject.regions
    motion = show_motion(subject)
    assert "1 % above where the simulator rests, because no region is proved" in motion.start
    assert not motion.contradictions


def test_a_scenario_is_proved_and_drawn_phase_by_phase(monkeypatch: pytest.MonkeyPatch) -> None:
    from certify.report.page import motion as module

    monkeypatch.setattr(module, "ATTEMPTS", 0)
    text = (ROOT / "specs" / "two-inverters.toml").read_text()
    text += '\n[scenario.off]\nend = "20 ms"\nstart = "equilibrium"\nevent = [{ at = "10 ms", disconnect = "%s" }]\n'
    names = [node.name for node in decode_all(text.split("\n[scenario.off]")[0].encode()).nodes if node.dgu]
    subject = subject_of((text % names[-1]).encode())
    motion = module.show_motion(subject, "off")
    assert [phase.title.split(",")[0] for phase in motion.phases] == ["Phase 1", "Phase 2"]
    assert "as asked for" in motion.start
    assert "phase 2" in str(motion.pictures[0][0])
    assert not motion.contradictions


def test_a_contradiction_is_told_loudly_and_is_the_exit_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from certify.report.page import motion as module

    def contradicted(*_: object) -> module.Motion:
        found = module.Agreement("H does not grow", 1, "2 J", "1 J", "1", False)
        return module.Motion("flat.", (), (module.Phase("", "certified", (found,), ()),), ("H does not grow: 1",))

    monkeypatch.setattr(module, "show_motion", contradicted)
    assert main(["report", "specs/two-inverters.toml", "-o", str(tmp_path / "r")]) == 4
    assert "CONTRADICTED by the simulation" in capsys.readouterr().out
    page = Page((tmp_path / "r" / "index.html").read_text())
    assert "The simulation contradicts the certificate." in page.text
    assert "**contradicts**" in (tmp_path / "r" / "report.md").read_text()


def themes() -> dict[str, dict[str, str]]:
    """The colours of the style sheet in both themes."""
    style = (ROOT / "certify" / "report" / "page" / "templates" / "style.css").read_text()
    light, dark, *_ = (
        dict(re.findall(r"--([\w-]+): (#\w{6})", block)) for block in re.findall(r"\{([^{}]*--bg[^{}]*)\}", style)
    )
    return {"light": light, "dark": dark}


def contrast(a: str, b: str) -> float:
    """Of two colours, by WCAG 2."""

    def luminance(colour: str) -> float:
        parts = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
        linear = [x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4 for x in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    low, high = sorted((luminance(a), luminance(b)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_text_in_pictures_has_contrast(theme: str) -> None:
    """A browser's tools cannot tell what is behind the text of a picture: so every pair that may meet is tried."""
    colours = themes()[theme]
    for behind in ("bg", "panel", "card", "band", "bad", "refuted-tint"):
        for text in ("ink", "muted"):
            assert contrast(colours[text], colours[behind]) >= 4.5, (text, behind)
    for status in ("proved", "refuted", "unknown", "conditional"):
        for behind in ("bg", "panel", f"{status}-tint"):
            assert contrast(colours[status], colours[behind]) >= 4.5, (status, behind)
        assert contrast(colours["on-mark"], colours[status]) >= 4.5
    for curve in ("c0", "c1", "c2", "c3", "c4", "c5"):
        for behind in ("bg", "band", "bad"):
            assert contrast(colours[curve], colours[behind]) >= 3, (curve, behind)


# --- bad input --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def certified(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("certificates") / "two.cert.json"
    path.write_bytes(prove((ROOT / "specs" / "two-inverters.toml").read_bytes()).data)
    return path


@pytest.mark.parametrize(
    ("spoil", "spec", "code", "says"),
    [
        (lambda data: data[: len(data) // 2], "two-inverters", 4, "K101"),
        (lambda data: data.replace(b"certify/certificate@1", b"certify/certificate@9"), "two-inverters", 4, "K102"),
        (lambda data: data, "single-inverter", 4, "K103"),
        (lambda data: data.replace(b'"certified"', b'"refuted"'), "two-inverters", 4, "K111"),
        (lambda _: b"", "two-inverters", 4, "K101"),
        (lambda _: b"\xff\xfe", "two-inverters", 4, "K101"),
        (lambda data: data, "no-such-spec", 2, "S000"),
        (lambda data: data, "negative/many-faults", 2, "S203"),
    ],
    ids=["truncated", "format", "another-spec", "verdict", "empty", "binary", "no-spec", "faults"],
)
def test_nothing_is_written_for_bad_input(  # type: ignore[no-untyped-def]
    spoil, spec: str, code: int, says: str, certified: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "c.json"
    file.write_bytes(spoil(certified.read_bytes()))
    folder = tmp_path / "out"
    assert main(["report", f"specs/{spec}.toml", str(file), "-o", str(folder)]) == code
    error = capsys.readouterr().err
    assert says in error
    assert "= help:" in error
    assert not folder.exists()
    assert [path.name for path in tmp_path.iterdir()] == ["c.json"]


def test_a_missing_certificate_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", "specs/two-inverters.toml", str(tmp_path / "no.json"), "-o", str(tmp_path / "r")]) == 2
    assert "no.json" in capsys.readouterr().err
    assert not (tmp_path / "r").exists()


def test_where_the_report_goes_is_checked_before_the_work(
    certified: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("mine")
    spec = "specs/two-inverters.toml"
    for target, says in ((tmp_path / "file", "no folder"), (tmp_path / "a" / "b", "no folder to make it in")):
        assert main(["report", spec, str(certified), "-o", str(target)]) == 2
        assert says in capsys.readouterr().err
    assert (tmp_path / "file").read_text() == "mine"
    (tmp_path / "has" / "index.html").mkdir(parents=True)
    assert main(["report", spec, str(certified), "-o", str(tmp_path / "has")]) == 2
    assert "index.html is a folder there" in capsys.readouterr().err


def test_the_certificate_is_not_written_over_itself(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "r"
    folder.mkdir()
    spec = folder / "certificate.json"
    spec.write_bytes((ROOT / "specs" / "custom-loop.json").read_bytes())
    assert main(["report", str(spec), "-o", str(folder), "--no-simulate"]) == 2
    assert "certificate.json is the spec itself" in capsys.readouterr().err
    assert spec.read_bytes() == (ROOT / "specs" / "custom-loop.json").read_bytes()


def test_an_unwritable_folder(certified: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """In /proc nobody may make a folder, root neither."""
    assert main(["report", "specs/two-inverters.toml", str(certified), "-o", "/proc/report", "--no-simulate"]) == 2
    error = capsys.readouterr().err
    assert "cannot write to the folder /proc/report" in error
    assert "Traceback" not in error


def test_a_folder_that_fails_while_written_is_told_and_left_empty(
    certified: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What an unwritable folder does to anyone, root as well: there is no room for the second file."""
    real = Path.write_bytes

    def full(self: Path, data: bytes) -> int:
        if self.name == "report.md":
            raise OSError(28, "No space left on device")
        return real(self, data)

    monkeypatch.setattr(Path, "write_bytes", full)
    folder = tmp_path / "r"
    assert main(["report", "specs/two-inverters.toml", str(certified), "-o", str(folder), "--no-simulate"]) == 2
    assert "No space left on device" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_method_goes_with_proving(certified: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec = "specs/two-inverters.toml"
    assert main(["report", spec, str(certified), "-o", str(tmp_path / "r"), "--method", "sampled"]) == 2
    assert "nothing is proved if a certificate is given" in capsys.readouterr().err


def test_a_scenario_that_is_not_there(certified: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec = "specs/two-inverters.toml"
    assert main(["report", spec, str(certified), "-o", str(tmp_path / "r"), "--scenario", "x"]) == 2
    assert "U002" in capsys.readouterr().err
    assert not (tmp_path / "r").exists()


# --- pictures ---------------------------------------------------------------------------------------------------------


def test_no_line_runs_over_a_node_of_the_paper_s_network() -> None:
    grid = decode_all((ROOT / "specs" / "cigre-mv.toml").read_bytes())
    sizes = {node.name: (78.0, 56.0) for node in grid.nodes}
    edges = [(line.start, line.end) for line in grid.lines]
    placed = place(sizes, edges)
    assert not lines_over_cards(placed, sizes, edges)
    assert set(placed.at) == set(sizes)
    for a, (x, y) in placed.at.items():
        assert 0 < x < placed.width
        assert 0 < y < placed.height
        for b, (u, v) in placed.at.items():
            assert a == b or abs(x - u) > 78 or abs(y - v) > 56


@settings(max_examples=6, deadline=None)
@given(st.integers(1, 14), st.randoms(use_true_random=False))
def test_radial_networks_are_placed_without_touching(count: int, rng: object) -> None:
    names = [f"n{k}" for k in range(count)]
    edges = [(f"n{rng.randrange(k)}", f"n{k}") for k in range(1, count)]  # type: ignore[attr-defined]
    placed = place(dict.fromkeys(names, (60.0, 50.0)), edges)
    assert placed == place(dict.fromkeys(names, (60.0, 50.0)), edges)
    for a, (x, y) in placed.at.items():
        for b, (u, v) in placed.at.items():
            assert a == b or abs(x - u) > 60 or abs(y - v) > 50


def test_large_networks_are_drawn_in_part_and_say_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(diagram, "CARDS", 15)
    monkeypatch.setattr(entries, "ALONE", 15)
    text = microgrid(50).decode().replace('"np": "1.', '"np": "0.1', 1)
    subject = subject_of(text.encode())
    assert subject.verdict.outcome == "refuted"
    found = draw_network(subject)
    assert "50 nodes are drawn as dots" in found.left_out
    assert str(found.picture).count('class="part') == 1, "only what is not proved is a link"
    monkeypatch.setattr(diagram, "DOTS", 40)
    found = draw_network(subject)
    assert "Of 50 nodes only" in found.left_out
    assert 1 < str(found.picture).count('class="part') < 40
    page = Page(build_report(subject)["index.html"].decode())
    bad = [c.id for c in subject.verdict.claims if c.status == "refuted"]
    assert bad
    assert all(claim in page.text for claim in bad)
    assert re.search(r"Left out: \d+ more that are proved", page.text)
    certified = subject_of(microgrid(50))
    assert draw_network(certified).picture is None
    assert "too many to draw" in draw_network(certified).left_out


def test_margins_in_siemens_agree_with_differences_of_the_current() -> None:
    grid = decode_all((ROOT / "specs" / "cigre-mv.toml").read_bytes())
    subject = subject_of((ROOT / "specs" / "cigre-mv.toml").read_bytes())
    for node in grid.nodes:
        if not node.has_static_load:
            continue
        ((_, law),) = subject.context.pieces(node.name)
        (found,) = law_margins(law, [18000.0])

        def current(V: complex, law=law) -> complex:  # type: ignore[no-untyped-def]
            v = abs(V)
            P, Q = (
                sum(float(t.coefficient) * (v / float(t.base_volt)) ** float(t.exponent) for t in part)
                for part in (law.active, law.reactive)
            )
            return complex(P, -Q) * V / v**2

        h = 0.5
        columns = [(current(18000 + e) - current(18000 - e)) / (2 * h) for e in (h, 1j * h)]
        a, c, b, d = columns[0].real, columns[0].imag, columns[1].real, columns[1].imag
        assert found == pytest.approx((a + d) / 2 - (((a - d) / 2) ** 2 + ((b + c) / 2) ** 2) ** 0.5, rel=1e-6)


@given(st.floats(-1e9, 1e9), st.floats(1e-9, 1e9))
def test_ticks_are_round_and_inside(low: float, span: float) -> None:
    high = low + span
    ticks = round_ticks(low, high)
    assert len(ticks) <= 12
    assert all(low - span * 1e-6 <= tick <= high + span * 1e-6 for tick in ticks) or not high > low
    assert all(tick_text(tick) for tick in ticks)


def test_curves_are_broken_where_there_is_no_number() -> None:
    chart = Chart(Axis("x", 0, 1), Axis("y", 0, 1))
    chart.curve([(0, 0), (0.5, float("nan")), (1, float("inf")), (1, 1)], "c0", "<a>")
    drawn = str(chart.render("t"))
    assert "nan" not in drawn
    assert "inf" not in drawn
    assert "&lt;a&gt;" in drawn
    assert decade_ticks(1e-3, 1e3)[0] == 1e-3


def test_a_motion_that_rings_for_ever_is_followed_only_so_far(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Networks of short cables and constant power ring at megahertz: ten milliseconds took minutes."""
    from certify.report.page import motion

    monkeypatch.setattr(motion, "MAX_PIECES", 3)
    assert main(["report", str(ROOT / "specs/two-inverters.toml"), "-o", str(tmp_path / "page")]) == 0
    text = (tmp_path / "page" / "index.html").read_text()
    assert "it rings too fast to be followed further for a page (pieces: 3)" in text


def test_a_page_of_something_else_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "index.html"
    page.write_text("<p>mine")
    command = ["report", str(ROOT / "specs/two-inverters.toml"), "-o", str(tmp_path), "--no-simulate"]
    assert main(command) == 2
    assert "index.html is there, and no page of certify" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["index.html"]
    page.unlink()
    assert main(command) == main(command) == 0
