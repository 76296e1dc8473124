"""Reading spec files: the kernel's decoder for the microgrid, the simulator's for the scenarios, faults together."""

from __future__ import annotations

import os
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

from certify.kernel.errors import Fault, SpecError
from certify.kernel.reader import MAX_BYTES, read_document
from certify.kernel.spec import FORMAT, LinearLoop, Microgrid, decode_document


def read(path: str | os.PathLike[str], limit: int = MAX_BYTES) -> bytes:
    """The bytes of a file, not more than `limit` + 1 of them, so that an endless one is refused quickly.

    Raises: SpecError S000 if it cannot be read.
    """
    try:
        with Path(path).open("rb") as file:
            return file.read(limit + 1)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise SpecError((Fault("S000", "", f"cannot read the file: {reason}"),)) from None


def load(path: str | os.PathLike[str]) -> Microgrid:
    """The microgrid that a spec file describes, its scenarios checked too.

    Raises: SpecError with every fault found.
    """
    return decode_all(read(path))


@lru_cache(maxsize=4)  # a phase of a scenario is read when it is checked, and again when it is used
def decode_all(data: bytes) -> Microgrid:
    """The microgrid of a spec; faults of its scenarios are reported together with its own. Raises: SpecError."""
    document = read_document(data)
    faults: list[Fault] = []
    given = document.get("format") if isinstance(document, dict) else None
    if isinstance(given, str) and given.startswith("certify/certificate@"):
        # One fault instead of one for each of its keys.
        raise SpecError((Fault("S107", "format", f"a certificate, where a spec of {FORMAT} is expected"),))
    grid = None
    try:
        grid = decode_document(document)
    except SpecError as error:
        faults += error.faults
    raw: Any = document.get("scenario")
    if raw is not None:
        from certify.simulator.scenario import find_faults

        faults += find_faults(document)
    if grid is not None:
        faults += _cancellations(grid, document)
    if grid is None or faults:
        raise SpecError(tuple(faults))
    return grid


def _cancellations(grid: Microgrid, document: Any) -> Iterator[Fault]:
    """Faults of linear loops with growing modes that their port does not see: no proof could ever speak of those."""
    done = set()
    for node in grid.nodes:
        if node.dgu and isinstance(node.dgu.controller, LinearLoop) and node.dgu.controller not in done:
            from certify.search.cancellation import unstable_cancellation

            done.add(node.dgu.controller)
            found = unstable_cancellation(node.dgu.controller)
            if found:
                yield Fault("S211", f"controller.{document['node'][node.name]['dgu']['controller']}", found)
