"""Which figures `certify loads --plot` draws, and where it writes them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

from certify.kernel.errors import Fault, SpecError
from certify.kernel.quantity import QuantityError, parse_decimal, parse_quantity, shorten
from certify.kernel.reader import Pair
from certify.kernel.spec import ExpLoad, ZipLoad
from certify.load_tables import Result
from certify.report.figures import range_text
from certify.report.load_maps import Point
from certify.search.maps import exponents_hold, fractions_hold

POWER_FACTORS = ("0.8", "0.95", "1")
CELLS, MAX_CELLS = 61, 1000  # of a map, in each direction


def find_faults(options: Any) -> list[Fault]:
    """What is wrong with the options of the figures."""
    faults, folder = [], Path(options.plot)
    if (folder.exists() and not folder.is_dir()) or not folder.absolute().parent.is_dir():
        faults.append(
            Fault("U001", "--plot", f"cannot write to {folder}: no such folder to make it in, or it is a file")
        )
    for text in options.power_factor or ():
        try:
            good = 0 < parse_decimal(text) <= 1
        except QuantityError:
            good = False
        if not good:
            faults.append(
                Fault("U001", "--power-factor", f"expected a number above 0 and at most 1, got {shorten(text)}")
            )
    if options.cells is not None and not 2 <= options.cells <= MAX_CELLS:
        faults.append(Fault("U001", "--cells", f"expected a number from 2 to {MAX_CELLS}, got {options.cells}"))
    return faults


def draw_figures(options: Any, results: Sequence[Result]) -> list[str]:
    """Margins over voltage, and the maps of the kinds of loads that there are; the files. Raises: SpecError."""
    from certify.report.load_plots import exponent_map, fraction_map, margin_figure, save

    band = _per_unit(options.band)
    known = [r for r in results if r.law is not None and r.base]
    folder, cells = Path(options.plot), options.cells or CELLS
    factors = [Fraction(text) for text in options.power_factor or POWER_FACTORS]
    figures: dict[str, Any] = {}
    if known:
        laws = [(r.name or f"row {r.number}", r.law, r.base) for r in known if r.law is not None and r.base is not None]
        statuses = [_status(r) for r in known]
        bands = {(r.band[0] / r.base, r.band[1] / r.base) for r in known if r.base}
        hull = (min(low for low, _ in bands), max(high for _, high in bands))
        title = f"{statuses.count('proved'):,} of {len(known):,} loads are monotone"
        title += f" over {range_text(hull)} pu" if len(bands) == 1 else ", each over its own band"
        title += f", {statuses.count('unknown'):,} undecided" if "unknown" in statuses else ""
        left_out = sum(r.verdict != "bad input" for r in results) - len(known)
        title += f" ({left_out:,} with a cut-off or given by their current not drawn)" if left_out else ""
        figures["margins"] = margin_figure(laws, hull, statuses, title=title)
    kinds = {type(r.load) for r in known} or {ExpLoad, ZipLoad}
    maps: tuple[tuple[str, type, Any, Any], ...] = (
        ("exponents", ExpLoad, exponent_map, exponents_hold),
        ("fractions", ZipLoad, fraction_map, fractions_hold),
    )
    for name, kind, draw, holds in maps:
        if kind in kinds or kinds == {type(None)}:

            def decide(x: Fraction, y: Fraction, square: Fraction, holds: Any = holds) -> str:
                return _word(holds(x, y, square, band))

            points = [point for r in known if isinstance(r.load, kind) for point in _point(r)]
            figures[name] = draw(factors, band, decide, points, cells=cells)
    written = []
    try:
        folder.mkdir(exist_ok=True)
        for name, figure in figures.items():
            for suffix in ("svg", "png"):
                path = folder / f"{name}.{suffix}"
                save(figure, path)
                written.append(str(path))
    except OSError as error:
        raise SpecError((Fault("U001", "--plot", f"cannot write to {folder}: {error.strerror}"),)) from None
    return written


def _point(result: Result) -> Iterator[Point]:
    """Where a load stands on the map of its kind, with its own verdict; nowhere if it draws no active power at V0."""
    load, base = result.load, result.base
    if load is None or base is None:
        return
    if isinstance(load, ExpLoad):
        P, Q, place = load.P0_watt, load.Q0_var, (load.np, load.nq)
    else:
        P, Q = (load.Y[k] * base**2 + load.I[k] * base + load.P[k] for k in (0, 1))
        place = (load.Y[0] * base**2 / P, load.P[0] / P) if P else (P, P)
    if P > 0:
        yield Point(*place, Fraction(math.cos(math.atan2(Q, P))), _status(result))


def _status(result: Result) -> str:
    """How a load is coloured: what is only sampled is undecided."""
    return result.verdict if result.verdict in ("proved", "refuted") else "unknown"


def _per_unit(band: Sequence[str]) -> Pair:
    low, high = (parse_quantity(text, "V", {"V": Fraction(1)}) for text in band)
    return low, high


def _word(holds: bool | None) -> str:
    return "unknown" if holds is None else "proved" if holds else "refuted"
