"""Parts of a spec checked as soon as they are given, by the kernel's own readers: faults appear where they are made."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from certify.kernel.errors import Fault, SpecError
from certify.kernel.quantity import shorten
from certify.kernel.reader import REQUIRED
from certify.kernel.spec import Decoder
from certify.values import to_plain

TOP = ("frequency", "base_voltage", "base_power", "voltage_band", "tolerance", "line_legs", "name")


class Parts(Decoder):
    """The readers of the kernel for one part at a time, in the units of a document."""

    def __init__(self, document: dict[str, Any]) -> None:
        super().__init__(document)
        self.w0 = self.frequency(document.get("frequency"), "frequency")
        volt, power = (
            self.unit(unit, "> 0")(document[key], key) if key in document else None
            for key, unit in (("base_voltage", "V"), ("base_power", "VA"))
        )
        self.w0 = self.w0 or 1
        self.bases(volt, power)
        self.base_voltage = volt
        self.common_tolerance = self.common(document["tolerance"], "tolerance") if "tolerance" in document else {}
        band = document.get("voltage_band")
        self.common_band = REQUIRED if band is None else self.band(band, "voltage_band")
        if "name" in document:
            self.text(document["name"], "name")
        if "line_legs" in document:
            self.one_of(["included", "neglected at DGUs"])(document["line_legs"], "line_legs")


def check_top(document: dict[str, Any]) -> None:
    """What stands before all tables. Raises: SpecError."""
    _raise(Parts(document).faults)


def check_part(document: dict[str, Any], kind: str, part: Any, path: str) -> None:
    """A "filter", "controller", "line_type" or "load", in the units of a document. Raises: SpecError."""
    reader = Parts(document)
    reader.faults.clear()  # of what stands at the top another check tells
    getattr(reader, kind)(part, path)
    _raise(reader.faults)


def check_name(name: str, path: str, taken: Any) -> None:
    """A name that is usable, and not taken yet. Raises: SpecError S105, U036."""
    reader = Decoder({})
    reader.path_of(path, name)
    if not isinstance(taken, Collection):
        reader.fault("S103", path, f"expected a table of tables, got {shorten(taken)}")
    elif name in taken:
        message = f"{shorten(name)} is defined already; `replace` changes values, `without` takes a part out"
        reader.fault("U036", f"{path}.{name}", message)
    _raise(reader.faults)


def given(path: str, **values: Any) -> dict[str, Any]:
    """The values that are not None, as a spec holds them. Raises: SpecError U030, S201."""
    table: dict[str, Any] = to_plain({key: value for key, value in values.items() if value is not None}, path)
    return table


def require_kind(found: str | None, values: dict[str, Any], path: str, keys: str) -> None:
    """A kind that is given, or that follows from the values. Raises: SpecError S107."""
    if found is None:
        named = ", ".join(map(shorten, values)) or "nothing"
        _raise([Fault("S107", f"{path}.kind", f"no kind follows from {named}; give {keys}, or kind=..")])


def _raise(faults: list[Fault]) -> None:
    if faults:
        raise SpecError(tuple(faults))
