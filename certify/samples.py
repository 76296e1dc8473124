"""Samples of a simulation as files, .npz or .csv, and states to start from: out of such a file, or written by hand."""

from __future__ import annotations

import csv
import io
import json
import math
import os
import stat
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import IO, Any

import numpy

from certify.certificate import open_atomically
from certify.inputs import read
from certify.kernel.errors import Fault, SpecError
from certify.kernel.quantity import shorten
from certify.kernel.reader import MAX_BYTES, unique
from certify.simulation import MAX_NUMBERS, Course, Simulation, column_names
from certify.simulator.motion import BOUND, natural_sizes
from certify.simulator.plant import Array
from certify.simulator.scenario import STARTS

SUFFIXES = (".npz", ".csv")
FORMAT = "certify/simulation@1"
MAX_LINE = 1 << 26  # bytes of a line of CSV
AGREEMENT = 1e-6  # of the reference: how well the voltage at a linear loop has to agree with the states of the loop
UNITS = {"voltage": "V", "current": "A", "integrator": "V s", "line": "A", "branch": "A"}
Values = dict[str, float | None]
SHOWN = 6  # names that are no columns; all faults of a number are told
UNREADABLE = (ValueError, KeyError, EOFError, RecursionError, zipfile.BadZipFile, zlib.error, csv.Error, RuntimeError)


def column_units(simulation: Simulation) -> tuple[str, ...]:
    """The unit of each column; those of a linear loop are its own, and not known."""
    return tuple(UNITS.get(part[0], "") for part, at in simulation.parts.items() for _ in range(at.start, at.stop))


def write_samples(path: Path, simulation: Simulation, about: Mapping[str, Any]) -> None:
    """Write all samples, whole or not at all, as the suffix says: .csv, or .npz with `about` as JSON beside them.

    CSV: a line for each time, "t" and then the columns with their units, empty where a part is off; all digits, so that
    numbers are read back exactly. NPZ: `times` in s, `states` in SI, `columns`, `units`, `metadata`. Raises: OSError.
    """
    with open_atomically(path) as file:
        if path.suffix.lower() == ".csv":
            _write_csv(file, simulation)
            return
        numpy.savez(
            file,
            times=simulation.times,
            states=simulation.states,
            columns=numpy.array(simulation.columns),
            units=numpy.array(column_units(simulation)),
            metadata=numpy.array(json.dumps({"format": FORMAT, **about}, ensure_ascii=False)),
        )


def _write_csv(file: IO[bytes], simulation: Simulation) -> None:
    pairs = zip(simulation.columns, column_units(simulation), strict=True)
    head = io.StringIO()
    titles = [f"{name} [{unit}]" if unit else name for name, unit in pairs]
    csv.writer(head, lineterminator="\n").writerow(["t", *titles])
    file.write(head.getvalue().encode())
    for time, row in zip(simulation.times.tolist(), simulation.states, strict=True):
        cells = ("" if math.isnan(x) else repr(x) for x in row.tolist())
        file.write(f"{time!r},{','.join(cells)}\n".encode())


def read_state(path: str, course: Course) -> Array:
    """A state to start from, in the columns of `Course.parts`: of a .npz or .csv as `write_samples` makes it the last.

    Any other file is JSON: a table of all columns of the first phase by name, or a list of all columns in their order.
    Numbers are SI. Columns of what is off in the first phase may be left out, empty or null, and are of no account.
    Raises: SpecError U006 with everything that is wrong.
    """
    columns = column_names(course.parts)
    try:
        values = _read_values(path, columns)
    except (OSError, MemoryError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else "it does not fit into memory"
        raise _refused(f"cannot read {path}: {reason}{_perhaps(path)}") from None
    faults = [Fault("U006", "--start", text) for text in _find_faults(values, columns, course)]
    if faults:
        raise SpecError(tuple(faults))
    return numpy.array([numpy.nan if (x := values.get(name)) is None else x for name in columns])


def _refused(message: str) -> SpecError:
    return SpecError((Fault("U006", "--start", message),))


def _perhaps(path: str) -> str:
    import difflib

    near = difflib.get_close_matches(path, STARTS, 1)
    return f"; did you mean {near[0]}?" if near else f"; the words are {', '.join(STARTS)}"


def _read_values(path: str, columns: tuple[str, ...]) -> Values:
    """What a file says, by column. Raises: SpecError, OSError, MemoryError."""
    kind = Path(path).suffix.lower()
    try:
        if kind in SUFFIXES:
            if not stat.S_ISREG(os.stat(path).st_mode):
                raise _refused(f"{path} is no file")
            return _last_of_npz(path) if kind == ".npz" else _last_of_csv(path)
        return _from_json(path, columns)
    except UNREADABLE as error:
        what = f"samples written by `certify simulate -o FILE{kind}`" if kind in SUFFIXES else "a state as JSON"
        reason = shorten(str(error) or type(error).__name__, 100).strip("'\"")
        raise _refused(f"{path} is not {what}: {reason}") from None


def _from_json(path: str, columns: tuple[str, ...]) -> Values:
    try:
        data = read(path)
    except SpecError as error:
        raise _refused(f"{path}: {error.faults[0].message}{_perhaps(path)}") from None
    if len(data) > MAX_BYTES:
        raise ValueError(f"more than {MAX_BYTES} bytes")
    document = json.loads(data.decode("utf-8-sig"), object_pairs_hook=unique)
    if isinstance(document, list):
        if len(document) != len(columns):
            message = f"a state of {len(document)} numbers, where {len(columns)} are expected: those of everything"
            raise _refused(f"{path}: {message} that is ever on, first {columns[0]!r}, last {columns[-1]!r}")
        return {name: _number(x) for name, x in zip(columns, document, strict=True)}
    if not isinstance(document, dict):
        raise ValueError("expected a table of numbers by column, or a list of them")
    return {_plain(name): _number(x) for name, x in document.items()}


def _number(x: object) -> float | None:
    """A number, null as None, and what is no number as infinity: that is told with its column."""
    if x is None:
        return None
    try:
        return float(x) if isinstance(x, int | float) and not isinstance(x, bool) else math.inf
    except OverflowError:
        return math.inf


def _plain(title: str) -> str:
    """The name of a column without its unit."""
    name, _, unit = title.rpartition(" [")
    return name if unit.rstrip("]") in UNITS.values() and unit.endswith("]") and name else title


def _last_of_npz(path: str) -> Values:
    """The last of the states of a file, without trust in what it says of sizes. Raises: ValueError and others."""
    with zipfile.ZipFile(path) as archive:

        def member(name: str) -> tuple[IO[bytes], tuple[int, ...], Any]:
            if f"{name}.npy" not in archive.namelist():
                raise ValueError(f"it has no array {name!r}")
            file = archive.open(f"{name}.npy")
            version = numpy.lib.format.read_magic(file)
            reader: Callable[..., Any] = (
                numpy.lib.format.read_array_header_1_0 if version == (1, 0) else numpy.lib.format.read_array_header_2_0
            )
            shape, fortran, dtype = reader(file)
            if fortran and len(shape) > 1:
                raise ValueError(f"the array {name!r} is not stored row by row")
            if dtype.hasobject or math.prod(shape) * dtype.itemsize > 8 * MAX_NUMBERS:
                raise ValueError(f"the array {name!r} has objects or is absurdly large")
            return file, shape, dtype

        def content(file: IO[bytes], count: int, dtype: Any) -> Any:
            data = file.read(count * dtype.itemsize)
            if len(data) < count * dtype.itemsize:
                raise ValueError("it ends too early")
            return numpy.frombuffer(data, dtype=dtype, count=count)

        file, shape, dtype = member("columns")
        if len(shape) != 1 or dtype.kind != "U" or shape[0] * dtype.itemsize > MAX_LINE:
            raise ValueError("the array 'columns' is no list of names")
        names = [str(name) for name in content(file, shape[0], dtype)]
        file, shape, dtype = member("states")
        if len(shape) != 2 or shape[1] != len(names) or not shape[0] or dtype.kind != "f":
            raise ValueError(f"the array 'states' is not one row or more of {len(names)} numbers")
        left = (shape[0] - 1) * shape[1] * dtype.itemsize
        while left:
            chunk = file.read(min(left, 1 << 24))
            if not chunk:
                raise ValueError("it ends too early")
            left -= len(chunk)
        return _by_name(names, map(float, content(file, shape[1], dtype)))


def _last_of_csv(path: str) -> Values:
    """The last line of a file by the names in its first. Raises: ValueError."""
    with open(path, "rb") as file:
        head = file.readline(MAX_LINE)
        body = file.tell()
        size = file.seek(0, os.SEEK_END)
        file.seek(max(body, size - MAX_LINE))
        last = file.read().rstrip().rpartition(b"\n")[2]
    names, cells = (next(csv.reader([line.decode("utf-8-sig")], strict=True), []) for line in (head, last))
    if names[:1] != ["t"]:
        raise ValueError("its first line does not begin with the column t")
    if len(cells) != len(names):
        raise ValueError(f"its last line has {len(cells)} cells, and its first has {len(names)}")
    return _by_name([_plain(name) for name in names[1:]], map(_cell, cells[1:]))


def _cell(text: str) -> float:
    try:
        return float(text) if text.strip() else math.nan
    except ValueError:
        return math.inf


def _by_name(names: list[str], numbers: Iterator[float]) -> Values:
    if len(set(names)) < len(names):
        raise ValueError("it has two columns of one name")
    return {name: None if math.isnan(x) else x for name, x in zip(names, numbers, strict=True)}


def _find_faults(values: Values, columns: tuple[str, ...], course: Course) -> Iterator[str]:
    """What is wrong with a state, all of it."""
    import difflib

    known = set(columns)
    strange = [name for name in values if name not in known]
    for name in strange[:SHOWN]:
        near = difflib.get_close_matches(name[:80], columns[:2000], 1)
        yield f"{shorten(name, 80)} is no column here" + (f"; did you mean {near[0]!r}?" if near else "")
    if len(strange) > SHOWN:
        yield f"and {len(strange) - SHOWN} more names that are no columns here: is it a state of another network?"
    plant = course.plant(course.phases[0])
    sizes, natural = numpy.full(course.size, numpy.nan), natural_sizes(plant, None)
    for part, at in plant.slices.items():
        sizes[course.parts[part]] = natural[at]
    good = True
    for name, size in zip(columns, sizes, strict=True):
        x = values.get(name)
        if x is not None and not math.isfinite(x):
            yield f"{name}: not a finite number"
        elif not math.isnan(size) and (x is None or math.isnan(x)):
            yield f"{name}: {'empty or no number' if name in values else 'missing'}, and on in the first phase"
        elif x is not None and abs(x) > BOUND * size:
            yield f"{name}: {x:.3g} is absurd, more than {BOUND:.0e} times what is natural there"
        else:
            continue
        good = False
    if good:
        yield from _contradictions(values, columns, course)


def _contradictions(values: Values, columns: tuple[str, ...], course: Course) -> Iterator[str]:
    """The voltage at a linear loop is an output of its states: if it is given, it has to agree with them."""
    plant = course.plant(course.phases[0])
    for name, loop in plant.loops.items():
        x, V = (
            numpy.array([numpy.nan if (v := values.get(c)) is None else v for c in columns[course.parts[part]]])
            for part in (("loop", name), ("voltage", name))
        )
        off = float(numpy.abs(loop.C @ x + loop.reference - V).max())
        if off > AGREEMENT * max(float(numpy.abs(loop.reference).max()), float(numpy.abs(V).max())):
            yield (
                f"voltage at node {name}: {off:.3g} V away from what the states of the loop there make; mend it, or "
                "leave it out"
            )
