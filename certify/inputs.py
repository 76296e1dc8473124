"""Reading specs: files and what Python has for them; the kernel's decoder and the simulator's, faults together."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from certify.kernel.errors import Fault, SpecError
from certify.kernel.quantity import shorten
from certify.kernel.reader import MAX_BYTES, read_document
from certify.kernel.spec import FORMAT, LinearLoop, Microgrid, decode_document


@runtime_checkable
class SupportsToBytes(Protocol):
    """What can say its own text, such as a spec that is built in Python."""

    def to_bytes(self) -> bytes: ...


# What functions of the library take for a spec: its text in bytes, the path of a file, the document as JSON has it, or
# what is built with `certify.Spec`.
SpecSource = bytes | str | os.PathLike[str] | Mapping[str, Any] | SupportsToBytes


def to_bytes(spec: SpecSource) -> bytes:
    """The text of a spec, which is what certificates are about: as it stands in a file, to the byte.

    `spec`: that text itself in bytes; a path, as str or PathLike; the document as JSON has it, in a mapping (numbers as
    `certify.values` takes them); or an object that has `to_bytes()`, such as `certify.Spec`. Equal mappings in equal
    order give equal bytes. Nothing is checked here but what no spec can hold.
    Raises: SpecError S000 if a file cannot be read, U030 or S201 for a value that no spec can hold, U031 for text in
    place of a path; TypeError for anything else.

    >>> to_bytes(b"[node.a]"), to_bytes({"name": "x", "frequency": 50.0})
    (b'[node.a]', b'{"name": "x", "frequency": 50}\\n')
    """
    if isinstance(spec, bytes | bytearray | memoryview):
        return bytes(spec)
    if isinstance(spec, str | os.PathLike):
        return read_named(spec, "spec")
    if isinstance(spec, Mapping):
        from certify.editing import to_json
        from certify.values import to_plain

        return to_json(to_plain(spec), "").encode()
    if isinstance(spec, SupportsToBytes) and not isinstance(spec, int | type):
        return spec.to_bytes()
    if isinstance(spec, Microgrid):
        raise TypeError("a certificate is about the text of a spec: give what was loaded, not what `load` returned")
    kinds = "its text in bytes, a path, a mapping, or an object with to_bytes()"
    raise TypeError(f"a spec is {kinds}, not a value of type {type(spec).__name__}")


def read_named(path: str | os.PathLike[str], what: str) -> bytes:
    """The bytes of a file, named in the message if it cannot be read. Raises: SpecError S000, U031."""
    name = os.fspath(path)
    if isinstance(name, bytes):
        name = os.fsdecode(name)
    if "\n" in name or name.lstrip().startswith("{"):
        message = (
            f"a text of {len(name)} characters, where the path of a {what} is expected; its text is given as bytes"
        )
        raise SpecError((Fault("U031", "", message),))
    try:
        return read(name)
    except SpecError as error:
        reason = error.faults[0].message.removeprefix("cannot read the file: ")
        raise SpecError((Fault("S000", "", f"cannot read {shorten(name, 200)}: {reason}"),)) from None


def read(path: str | os.PathLike[str], limit: int = MAX_BYTES) -> bytes:
    """The bytes of a file, not more than `limit` + 1 of them, so that an endless one is refused quickly.

    Raises: SpecError S000 if it cannot be read.

    >>> read("specs/two-inverters.toml")[:15]
    b'# Two inverters'
    """
    try:
        with Path(path).open("rb") as file:
            return file.read(limit + 1)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise SpecError((Fault("S000", "", f"cannot read the file: {reason}"),)) from None


def load(spec: SpecSource) -> Microgrid:
    """The microgrid that a spec describes, in SI and exact, its scenarios checked too. For `spec` see `to_bytes`.

    Raises: SpecError with every fault found.

    >>> load("specs/single-inverter.toml").nodes[0].name
    'bus'
    """
    return decode_all(to_bytes(spec))


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
