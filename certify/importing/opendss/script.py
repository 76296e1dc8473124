"""OpenDSS scripts as files: their lines, where each stands, and the files that they call for.

Only files are read here. What a line means is the engine's business, and which lines it gets to see that of `commands`.
"""

from __future__ import annotations

import stat
from dataclasses import dataclass
from pathlib import Path

from certify.kernel.errors import Fault, SpecError

MAX_FILE_BYTES = 16 * 2**20
MAX_LINE = 100_000  # characters; matrices and load shapes stand in one line


@dataclass(frozen=True)
class ScriptLine:
    """One line of a script without the white space around it; `number` counts from 1."""

    text: str
    number: int


def read_lines(path: Path, place: str) -> tuple[ScriptLine, ...]:
    """The lines of a script that say something; what stands between /* and */ does not.

    `place` is what faults are told about. Raises: SpecError I041 for what is no text file of a sensible size.
    """
    try:
        # Not a device or a pipe, which may never end.
        if not stat.S_ISREG(path.stat().st_mode):
            raise SpecError((Fault("I041", place, f"{path.name} is not a file"),))
        with path.open("rb") as file:
            data = file.read(MAX_FILE_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise SpecError((Fault("I041", place, f"cannot read {path.name}: {reason}"),)) from None
    if len(data) > MAX_FILE_BYTES:
        raise SpecError((Fault("I041", place, f"{path.name} has more than {MAX_FILE_BYTES // 2**20} MiB"),))
    if b"\0" in data:
        raise SpecError((Fault("I041", place, f"{path.name} is not a text: it has bytes that are zero"),))
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")  # older scripts; names of elements are ASCII in either
    lines, inside = [], False
    for number, line in enumerate(text.replace("\r\n", "\n").replace("\r", "\n").split("\n"), 1):
        stripped = line.strip()
        if len(stripped) > MAX_LINE:
            raise SpecError((Fault("I041", place, f"line {number} of {path.name} has {len(stripped):,} characters"),))
        # As the engine has it: a comment opens at the start of a line only, and what follows its end is lost.
        opens = not inside and stripped.startswith("/*")
        if (inside or opens) and "*/" in stripped:
            inside = False
        elif inside or opens:
            inside = True
        elif stripped and not stripped.startswith(("!", "//")):
            lines.append(ScriptLine(stripped, number))
    return tuple(lines)


def find_file(name: str, folder: Path) -> Path | None:
    """The file that a script in `folder` means by `name`: \\ counts as /, and letters may differ in case.

    >>> find_file("no/such.dss", Path(".")) is None
    True
    """
    name = name.strip().replace("\\", "/")
    target = folder / name
    if not name or "\0" in name:
        return None
    try:
        if target.is_file():
            return target
        here = Path(Path(name).anchor) if Path(name).is_absolute() else folder
        for part in Path(name).parts:
            if part in ("..", ".", here.anchor):
                here = here / part
                continue
            near = [here / part] if (here / part).exists() else _alike(part, here)
            if len(near) != 1:
                return None
            here = near[0]
        return here if here.is_file() else None
    except OSError:
        return None


def _alike(part: str, folder: Path) -> list[Path]:
    """What a folder holds under this name but for the case of letters."""
    return [entry for entry in folder.iterdir() if entry.name.lower() == part.lower()] if folder.is_dir() else []
