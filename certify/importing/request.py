"""What a command line says about an import, as settings: each fault at once, with its option."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from certify.importing.settings import KINDS, Placement, Settings
from certify.inputs import decode_all, read
from certify.kernel.errors import Fault, SpecError
from certify.kernel.quantity import QuantityError, parse_quantity, shorten
from certify.kernel.reader import read_document

ONE_PU = {"V": Fraction(1)}


def to_settings(options: argparse.Namespace) -> tuple[Settings, Placement]:
    """Raises: SpecError U001 for each option that cannot be read, or what is wrong with the spec of --filter-from."""
    request = _Request()
    low, high = (request.per_unit("--band", text) for text in options.band or ("0.9 pu", "1.1 pu"))
    if low >= high:
        request.fault("--band", f"{float(low):g} pu is not below {float(high):g} pu")
    filters, controllers = request.tables_of(options.filter_from)
    if options.filter is not None and options.filter_from is None:
        request.fault("--filter", "needs --filter-from, the spec that has it")
    references: dict[str, Fraction] = {}
    for text in options.reference or ():
        bus, _, value = text.rpartition("=")
        if bus in references:
            request.fault("--reference", f"twice for {shorten(bus) if bus else 'all DGUs'}")
        references[bus] = request.per_unit("--reference", value)
    settings = Settings(
        (low, high),
        request.quantity("--line-capacitance", options.line_capacitance, "F/m"),
        request.quantity("--bus-capacitance", options.bus_capacitance, "F"),
        filters,
        controllers,
        options.filter,
        options.controller,
        options.filter_from or "",
        references,
        request.quantity("--frequency", options.frequency, "Hz"),
    )
    kinds = _split(options.dgus_at)
    for kind in kinds:
        if kind not in KINDS:
            request.fault("--dgus-at", f"{shorten(kind)} is none of {', '.join(KINDS)}")
    placement = Placement(_split(options.dgu), kinds, _split(options.leave_out))
    if request.faults:
        raise SpecError(tuple(request.faults))
    return settings, placement


def _split(texts: Sequence[str] | None) -> tuple[str, ...]:
    return tuple(dict.fromkeys(part.strip() for text in texts or () for part in text.split(",") if part.strip()))


class _Request:
    def __init__(self) -> None:
        self.faults: list[Fault] = []

    def fault(self, option: str, message: str) -> None:
        self.faults.append(Fault("U001", option, message))

    def quantity(self, option: str, text: str | None, unit: str) -> Fraction | None:
        if text is None:
            return None
        try:
            value = parse_quantity(text, unit, {})
        except QuantityError as error:
            self.fault(option, error.message)
            return None
        if value <= 0:
            self.fault(option, f"must be positive, got {shorten(text)}")
        return value

    def per_unit(self, option: str, text: str) -> Fraction:
        """A share of the nominal voltage; a bare number is in pu too."""
        try:
            value = parse_quantity(text, "V", ONE_PU)
        except QuantityError as error:
            self.fault(option, error.message)
            return Fraction(1)
        if not 0 < value < 10:
            self.fault(option, f'{shorten(text)} is no voltage in pu such as "1.02 pu"')
            return Fraction(1)
        return value

    def tables_of(self, path: str | None) -> tuple[dict[str, Any], dict[str, Any]]:
        """Raw filters and controllers of another spec, which has to have some."""
        if path is None:
            return {}, {}
        try:
            data = read(path)
            decode_all(data)  # faults of that spec are told as such, not as those of what is made of it
            document = read_document(data)
        except SpecError as error:
            self.faults += [Fault(f.code, f"--filter-from {path}: {f.path}", f.message) for f in error.faults]
            return {}, {}
        tables = [document.get(kind) if isinstance(document, dict) else None for kind in ("filter", "controller")]
        for kind, table in zip(("filter", "controller"), tables, strict=True):
            if not isinstance(table, dict) or not table or any(not isinstance(x, dict) for x in table.values()):
                self.fault("--filter-from", f"{path} has no {kind}")
        filters, controllers = (table if isinstance(table, dict) else {} for table in tables)
        return filters, controllers
