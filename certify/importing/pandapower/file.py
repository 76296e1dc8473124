"""Files of pandapower, read by pandapower, but only what is known to be data.

Its format may name any Python class, which pandapower imports and calls, and a table may be the path of another file.
So the document is taken apart first, and what pandapower gets to see is made anew: the tables, with plain cells.
"""

from __future__ import annotations

import json
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from certify.inputs import read
from certify.kernel.errors import Fault, SpecError
from certify.kernel.quantity import shorten

MAX_BYTES = 512 << 20
NETWORK = ("pandapower.auxiliary", "pandapowerNet")
TABLES = (("pandas.core.frame", "DataFrame"), ("pandas", "DataFrame"))
# What pandapower writes by itself; it may be there, and only tables of it are read.
_MODULES = re.compile(r"(pandapower|pandas|numpy|networkx|shapely|geopandas)(\.[\w.]+)?", re.ASCII)
_BUILTINS = {"tuple", "set", "frozenset", "complex"}
_DTYPE = re.compile(r"object|str|string|bool|boolean|[uU]?[iI]nt\d{1,2}|[fF]loat\d{2}", re.ASCII)
NOT_PLAIN = "(neither a number nor text)"
_PLAIN = ("name", "f_hz", "sn_mva", "version", "format_version")
INSTALL = "pip install 'certify-eip[pandapower]'"


def load_net(path: str) -> Any:
    """The pandapowerNet of a file, in the format of the pandapower that is installed.

    Raises: SpecError S000, I001, I002, I008, I009.
    """
    data = read(path, MAX_BYTES)
    if len(data) > MAX_BYTES:
        raise SpecError((Fault("I001", "", f"larger than {MAX_BYTES >> 20} MiB"),))
    return to_net(clean_document(parse(data)))


def parse(data: bytes) -> Any:
    """JSON, with the numbers NaN and Infinity that pandapower writes. Raises: SpecError I001."""
    try:
        return json.loads(data.decode("utf-8-sig"))
    except UnicodeDecodeError:
        reason = "not UTF-8 text"
    except RecursionError:
        reason = "nested too deeply"
    except ValueError as error:
        reason = f"not JSON: {error}" if str(error).isprintable() else "not JSON"
    raise SpecError((Fault("I001", "", reason[:200]),))


def clean_document(document: Any) -> dict[str, Any]:
    """The tables of a pandapower document and its few plain values, as a new document. Raises: SpecError I001, I002."""
    if not isinstance(document, dict) or (document.get("_module"), document.get("_class")) != NETWORK:
        raise SpecError((Fault("I001", "", "no pandapower network: it has not the class pandapowerNet"),))
    content = document.get("_object")
    if not isinstance(content, dict):
        raise SpecError((Fault("I001", "_object", "no pandapower network: its tables are missing"),))
    faults = [Fault("I002", path, f"names {shorten(what)}") for path, what in _foreign(content)]
    result = {key: content[key] for key in _PLAIN if isinstance(content.get(key), str | int | float)}
    for key, value in content.items():
        if key.startswith(("_", "res_")) or "|" in key or not isinstance(value, dict):
            continue
        if any(value.get("_module") == module and value.get("_class") == name for module, name in TABLES):
            try:
                result[key] = _table(value)
            except (ValueError, RecursionError) as error:
                faults.append(Fault("I001", shorten(key), f"no table: {error}"[:200]))
    if "bus" not in result and not faults:
        faults.append(Fault("I001", "bus", "no table of buses"))
    if faults:
        raise SpecError(tuple(faults[:50]))
    return {"_module": NETWORK[0], "_class": NETWORK[1], "_object": result}


def _foreign(content: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Classes that pandapower does not write by itself, with their places."""
    waiting: list[tuple[str, Any]] = list(content.items())
    while waiting:
        path, value = waiting.pop()
        if isinstance(value, dict):
            if "_module" in value or "_class" in value:
                module, name = value.get("_module"), value.get("_class")
                if not (isinstance(module, str) and isinstance(name, str)) or not (
                    _MODULES.fullmatch(module) or (module == "builtins" and name in _BUILTINS)
                ):
                    yield path[:80], f"{module}.{name}"
            waiting += [(f"{path}.{key}", x) for key, x in value.items() if isinstance(x, dict | list)]
        elif isinstance(value, list):
            waiting += [(f"{path}[{k}]", x) for k, x in enumerate(value) if isinstance(x, dict | list)]


def _table(value: dict[str, Any]) -> dict[str, Any]:
    """A table of numbers, text, truth values and nulls; whatever else a cell holds is now a text. Raises: ValueError.

    So a cell that is read and holds a list is a fault of that cell, and one that is not read does no harm.
    """
    raw = value.get("_object")
    frame = json.loads(raw) if isinstance(raw, str) else raw
    if not isinstance(frame, dict) or value.get("orient") != "split" or set(frame) != {"columns", "index", "data"}:
        raise ValueError("it is not written with its columns, its index and its data")
    columns, index, data = frame["columns"], frame["index"], frame["data"]
    if not all(isinstance(part, list) for part in (columns, index, data)) or len(index) != len(data):
        raise ValueError("its index and its data are not equally long lists")
    if any(not isinstance(row, list) or len(row) != len(columns) for row in data):
        raise ValueError("a row is not as long as its columns")
    if any(not isinstance(x, str | int | float) for x in (*columns, *index)):
        raise ValueError("an index that is neither numbers nor text")
    for kind, names in (("columns", columns), ("rows", index)):
        if len(set(map(str, names))) != len(names):
            raise ValueError(f"two {kind} have the same name")
    plain = [all(map(_is_plain, cells)) for cells in zip(*data, strict=True)] or [True] * len(columns)
    dtypes = value.get("dtype")
    types = dtypes if isinstance(dtypes, dict) else {}
    return {
        "_module": "pandas.core.frame",
        "_class": "DataFrame",
        "_object": json.dumps(
            {
                "columns": columns,
                "index": index,
                "data": [[x if _is_plain(x) else NOT_PLAIN for x in row] for row in data],
            }
        ),
        "orient": "split",
        "dtype": {
            column: types[column]
            for column, known in zip(columns, plain, strict=True)
            if known and isinstance(types.get(column), str) and _DTYPE.fullmatch(types[column])
        },
        "is_multiindex": False,
        "is_multicolumn": False,
    }


def _is_plain(cell: Any) -> bool:
    return cell is None or isinstance(cell, str | int | float)


def to_net(document: dict[str, Any]) -> Any:
    """What pandapower makes of a clean document. Raises: SpecError I008 without pandapower, I009 if it refuses."""
    pandapower = import_pandapower()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of pandapower about its own code and older formats: nothing a user can mend
        try:
            return pandapower.from_json_string(json.dumps(document), convert=True)
        except Exception as error:  # whatever it meets in a damaged file; there is no class for it
            reason = f"{type(error).__name__}: {error}".splitlines()[0]
    raise SpecError((Fault("I009", "", reason[:300]),))


def import_pandapower() -> Any:
    """The package. Raises: SpecError I008 with the command that installs it."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of its dependencies about each other
            import pandapower
    except ImportError as error:
        raise SpecError((Fault("I008", "", f"pandapower is not there ({error}): {INSTALL}"),)) from None
    return pandapower


def file_name(path: str) -> str:
    return Path(path).name
