"""Writes reports/page/: screenshots of the reports of CIGRE, as corrected and as printed, and their Markdown summaries.

    python tests/campaign_pages.py

Needs Chromium, the extra `test`, and Pillow. The certificates are made for SOURCE_DATE_EPOCH, so that everything but
what another browser or font draws differently is the same each time.
"""

from __future__ import annotations

import io
import os
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))
TARGET = ROOT / "reports" / "page"
SPECS = {"cigre-mv": "cigre-mv", "as-printed": "cigre-mv-as-printed"}
# name of the picture: (report, theme, width, from which section, height)
SHOTS = {
    "cigre-mv-light": ("cigre-mv", "light", 1240, None, 1720),
    "cigre-mv-dark": ("cigre-mv", "dark", 1240, "rest", 2300),
    "cigre-mv-simulation-light": ("cigre-mv", "light", 1240, "motion", 1700),
    "cigre-mv-narrow": ("cigre-mv", "light", 390, None, 1700),
    "as-printed-light": ("as-printed", "light", 1240, None, 2150),
    "as-printed-dark": ("as-printed", "dark", 1240, None, 1500),
    "as-printed-claims-light": ("as-printed", "light", 1240, "claims", 1500),
}
COLOURS = 256  # of a screenshot: enough for flat pages, and a third of the bytes


def take(browser: Any, page: Path, theme: str, width: int, section: str | None, height: int) -> bytes:
    """A picture of a page from its top or from a section on; claims are shown with the first one open."""
    context = browser.new_context(color_scheme=theme, viewport={"width": width, "height": 900})
    view = context.new_page()
    view.goto(page.as_uri() + ("#claim-dgu-1" if section == "claims" else ""))
    view.evaluate("document.activeElement.blur()")
    top = view.evaluate(f"document.getElementById({section!r})?.offsetTop ?? 0") if section else 0
    whole = view.evaluate("document.documentElement.scrollHeight")
    clip = {"x": 0, "y": top, "width": width, "height": min(height, whole - top)}
    png: bytes = view.screenshot(full_page=True, clip=clip)
    context.close()
    return png


def compress(png: bytes) -> bytes:
    from PIL import Image

    picture = Image.open(io.BytesIO(png)).convert("RGB")
    few = picture.quantize(COLOURS, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    buffer = io.BytesIO()
    few.save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def print_first_sheet(page: Path, browser: Any, folder: Path) -> bytes | None:
    """The first sheet of paper as a picture, if poppler's pdftoppm is there."""
    import subprocess

    if shutil.which("pdftoppm") is None:
        return None
    context = browser.new_context()
    view = context.new_page()
    view.goto(page.as_uri())
    (folder / "p.pdf").write_bytes(
        view.pdf(format="A4", margin=dict.fromkeys(("top", "bottom", "left", "right"), "15mm"))
    )
    context.close()
    command = ["pdftoppm", "-png", "-r", "80", "-f", "1", "-l", "1", "-singlefile", "p.pdf", "sheet"]
    subprocess.run(command, cwd=folder, check=True)
    return (folder / "sheet.png").read_bytes()


def main() -> None:
    from playwright.sync_api import sync_playwright

    from certify.cli import main as certify
    from tests.test_report_page import ARGUMENTS, CHROMIUM

    os.environ.setdefault("SOURCE_DATE_EPOCH", "1767225600")
    os.chdir(ROOT)
    TARGET.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name, sync_playwright() as playwright:
        folder = Path(name)
        browser = playwright.chromium.launch(executable_path=str(CHROMIUM), args=ARGUMENTS)
        for report, spec in SPECS.items():
            code = certify(["report", f"specs/{spec}.toml", "-o", str(folder / report)])
            assert code == {"cigre-mv": 0, "as-printed": 1}[report]
            shutil.copy(folder / report / "report.md", TARGET / f"{report}.md")
        for picture, (report, *how) in SHOTS.items():
            png = take(browser, folder / report / "index.html", *how)
            (TARGET / f"{picture}.png").write_bytes(compress(png))
        if sheet := print_first_sheet(folder / "as-printed" / "index.html", browser, folder):
            (TARGET / "as-printed-paper.png").write_bytes(compress(sheet))
        browser.close()
    for file in sorted(TARGET.iterdir()):
        print(f"{file.stat().st_size:>9,}  {file.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
