"""The largest tolerance with which a microgrid is still certified: bracketed, and proved at the lower end."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from certify.certificate import Certificate, prove
from certify.editing import edit_spec, to_json, toml_value
from certify.inputs import SpecSource, decode_all, to_bytes
from certify.kernel.errors import Fault, SpecError
from certify.kernel.reader import read_document
from certify.search.synthesis import to_percent

PARTS = ("filter", "line", "load")
STEP = Fraction(1, 1000)  # the width of the bracket


@dataclass(frozen=True)
class LargestTolerance:
    """What `largest_tolerance` returns: a bracket, of shares of the values, 0 <= low < high <= 1.

    `low` is proved: `certificate` is that of `spec`, which has it. `high` is not: `failing` is its certificate; at 1 a
    box would contain zero. `low` is None if the spec is not certified with no such tolerance at all. `kept` names the
    parts with a tolerance of their own, which they keep, and `replaced` is the common tolerance that the spec had.
    """

    of: tuple[str, ...]
    kept: tuple[str, ...]
    replaced: str | None
    low: Fraction | None
    high: Fraction
    spec: bytes = field(repr=False)
    certificate: Certificate
    failing: Certificate | None


def largest_tolerance(
    spec: SpecSource, of: tuple[str, ...] = PARTS, progress: Callable[[int, int], None] | None = None
) -> LargestTolerance:
    """Bisect the share by which all R, L, C of filters and lines and all coefficients of loads may be off at once.

    What is proved of the spec without a tolerance has to be proved with it: where that rests on an assumption of the
    ledger, such as that an equilibrium exists, it still may.
    For `spec` see `certify.inputs.to_bytes`. `of` names the kinds of parts that it is asked of; parts with a tolerance
    of their own keep that. Bisection needs about ten proofs.
    Raises: SpecError if the spec is not well formed, or no part takes a tolerance from it.

    >>> import certify
    >>> found = certify.largest_tolerance("specs/single-inverter.toml", ("load",))
    >>> found.low is not None and found.low > 0
    True
    """
    given = to_bytes(spec)
    decode_all(given)
    document = read_document(given)
    kept = _require_parts(document, of)
    before = document.get("tolerance")
    replaced = None if before is None else toml_value(before)

    proofs = 0

    def trial(share: Fraction, refute: bool = False) -> Certificate:
        """Of the spec with this share; a JSON document of the same meaning does."""
        nonlocal proofs
        proofs += 1
        if progress:
            progress(min(proofs, 12), 12)
        text = to_json(with_tolerance(copy.deepcopy(document), of, share), "{").encode()
        return prove(text, refute=refute)

    steps = int(1 / STEP)
    low, high = 0, steps
    found = trial(Fraction(0), refute=True)
    enough = {"certified", found.verdict.outcome}  # as good as without a tolerance
    if found.verdict.outcome not in ("certified", "conditional"):
        return LargestTolerance(of, kept, replaced, None, STEP, given, found, found)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if trial(middle * STEP).verdict.outcome in enough else (low, middle)
    failing = trial(high * STEP, refute=True) if high < steps else None
    text = edit_spec(given, lambda document: with_tolerance(document, of, low * STEP))
    return LargestTolerance(of, kept, replaced, low * STEP, high * STEP, text, prove(text), failing)


def with_tolerance(document: Any, of: tuple[str, ...], share: Fraction) -> Any:
    """The document with a common tolerance for these kinds of parts; for other kinds it stays as it is."""
    before = document.get("tolerance", {})
    common = dict(before) if isinstance(before, dict) else dict.fromkeys(PARTS, before)
    common |= dict.fromkeys(of, to_percent(share))
    if type(document) is dict:
        document["tolerance"] = common
        return document
    from tomlkit import inline_table

    table = inline_table()
    table.update(common)
    if "tolerance" in document:
        document["tolerance"] = table
    else:  # before the first table, where it belongs
        document.update({"tolerance": table})
    return document


def _require_parts(document: Any, of: tuple[str, ...]) -> tuple[str, ...]:
    """The parts that keep a tolerance of their own. Raises: SpecError if there is nothing left to vary."""

    def refuse(message: str) -> SpecError:
        return SpecError((Fault("U001", "--of", message),))

    unknown = [kind for kind in of if kind not in PARTS]
    if unknown or not of:
        raise refuse(f"expected some of {', '.join(PARTS)}, got {', '.join(unknown) or 'nothing'}")
    kept, varied = [], 0
    for kind, path, part in _parts(document):
        if kind in of:
            own = part.get("tolerance")
            whole = not isinstance(own, dict) and own is not None
            kept += [path] if own is not None else []
            varied += not whole
    if not varied:
        parts = " or ".join(of)
        raise refuse(f"every {parts} has a tolerance of its own" if kept else f"the spec has no {parts} to vary")
    return tuple(kept)


def _parts(document: Any) -> Iterator[tuple[str, str, Any]]:
    """(kind, path, table) of everything that takes a tolerance from the top of the spec."""
    for name, part in document.get("filter", {}).items():
        yield "filter", f"filter.{name}", part
    for name, part in document.get("line_type", {}).items():
        yield "line", f"line_type.{name}", part
    for part in document.get("line", []):
        if "type" not in part or "tolerance" in part:
            yield "line", f"line.{part['name']}", part
    for name, node in document.get("node", {}).items():
        for k, part in enumerate(node.get("load", [])):
            yield "load", f"node.{name}.load[{k}]", part
