"""What all figures share: colours, text, and how they are written to files."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from certify.certificate import write_atomically
from certify.kernel.reader import Pair

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Okabe and Ito's colours, told apart in all common kinds of colour blindness; the fills are light tints of them.
COLOURS = {"proved": "#0072B2", "refuted": "#D55E00", "unknown": "#595959"}
FILLS = {"proved": "#B9D7EA", "refuted": "#F7D3BC", "unknown": "#D9D9D9"}
DASHES = {"proved": "-", "refuted": (0, (5, 1.6)), "unknown": (0, (1, 1.2))}
WORDS = {"proved": "monotone", "refuted": "not monotone", "unknown": "undecided"}
STYLE: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.size": 10,
    "axes.titlesize": 11,
    "axes.labelsize": 10,
    "axes.edgecolor": "#595959",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "grid.color": "#E3E3E3",
    "legend.frameon": False,
    "savefig.dpi": 150,
    "svg.fonttype": "none",  # text stays text: it can be searched and read aloud
    "svg.hashsalt": "certify",  # the same figure gives the same file
}
LENGTH = 28  # characters of a name in a picture


def save(figure: Figure, path: str | Path) -> None:
    """Write a figure as .svg or .png, by its suffix, whole or not at all; the same figure gives the same bytes.

    Raises: ValueError for another suffix; OSError.
    """
    path = Path(path)
    kind = path.suffix.lower().lstrip(".")
    if kind not in ("svg", "png"):
        raise ValueError(f"cannot write a picture as {path.name}: its name must end in .svg or .png")
    write_atomically(path, to_bytes(figure, kind))


def to_bytes(figure: Figure, kind: str) -> bytes:
    """A figure as "svg" or "png"; the same figure gives the same bytes."""
    nothing = {"svg": ("Date", "Creator"), "png": ("Software",)}[kind]  # else the file changes with time and version
    buffer = io.BytesIO()
    with style(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing")  # a name may hold any character
        figure.savefig(buffer, format=kind, metadata=dict.fromkeys(nothing), facecolor="white")
    return buffer.getvalue()


@contextmanager
def style() -> Iterator[None]:
    import matplotlib

    with matplotlib.rc_context(STYLE):
        yield


def shorten_name(name: str) -> str:
    """One line of at most 28 printable characters.

    >>> shorten_name("a  very long name of a load, with a\\nline break")
    'a very long name of a load…'
    """
    line = "".join(c if c.isprintable() else " " for c in name)
    line = " ".join(line.split())
    return line if len(line) <= LENGTH else line[: LENGTH - 1].rstrip(" ,") + "…"


def range_text(band: Pair) -> str:
    return f"{float(band[0]):.6g} to {float(band[1]):.6g}"
