"""Parts of a spec as tables that print as they would be written: for the arguments of tests and their messages.

They are dictionaries of the spec's JSON shape, so that they go wherever a part of a document does. Numbers are taken
exactly: a float is the shortest decimal that names it, a Fraction is itself.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from fractions import Fraction
from typing import Any, Self

from certify.building.toml import to_toml
from certify.kernel.errors import Fault, SpecError
from certify.kernel.model import to_state_feedback
from certify.kernel.quantity import QuantityError, parse_quantity
from certify.kernel.spec import LinearLoop, StateFeedback
from certify.values import to_plain

SECTIONS = (
    "filter",
    "controller",
    "line_type",
    "node",
    "scenario",
)  # tables of tables, each under a heading of its own


class Part(dict[str, Any]):
    """A table of a spec; its `repr` can be pasted into a test, as an argument of `@example`.

    >>> Line(R="0.1 ohm", L="1 mH")
    Line(R='0.1 ohm', L='1 mH')
    """

    def __init__(self, table: Mapping[str, Any] | None = None, /, **entries: Any) -> None:
        super().__init__(to_plain({**(table or {}), **entries}))

    def __repr__(self) -> str:
        if all(key.isidentifier() for key in self):
            return f"{type(self).__name__}({', '.join(f'{key}={_shown(value)}' for key, value in self.items())})"
        return f"{type(self).__name__}({_shown(self)})"

    def replaced(self, **entries: Any) -> Self:
        """The same but for these entries."""
        return type(self)({**self, **entries})


def _shown(value: Any) -> str:
    """As Python source, tables inside as plain dictionaries and text as plain text."""
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key!r}: {_shown(part)}' for key, part in value.items())}}}"
    if isinstance(value, list):
        return f"[{', '.join(_shown(part) for part in value)}]"
    return repr(str(value)) if isinstance(value, str) else repr(value)


class Filter(Part):
    """The filter of an inverter; R, L and C are its exact values in ohm, henry and farad, for designs in Python.

    Raises: SpecError where a value is no such quantity; values in pu are left to the spec that has the base.

    >>> lc = Filter(R="0.1 ohm", L="1.8 mH", C="25 uF")
    >>> lc.L
    Fraction(9, 5000)
    """

    @property
    def R(self) -> Fraction:
        return self._exactly("R", "ohm")

    @property
    def L(self) -> Fraction:
        return self._exactly("L", "H")

    @property
    def C(self) -> Fraction:
        return self._exactly("C", "F")

    def _exactly(self, key: str, unit: str) -> Fraction:
        try:
            return parse_quantity(self[key], unit, {})
        except QuantityError as error:
            raise SpecError((Fault(error.code, f"filter.{key}", error.message),)) from None


class Controller(Part):
    """A control law; gains are formulas in R, L, C, w0 and the names of `let`, or numbers."""

    def gains(self, filter: Mapping[str, Any], frequency: Any = "50 Hz") -> StateFeedback:
        """K11, K12, K13 with this filter, exactly, as 2x2 tuples of Fractions; K13 is None without integrator.

        An IDA-PBC law is given as state feedback too. Raises: SpecError; ValueError for a linear loop.

        >>> law = Controller(kind="state-feedback", let={"b": 1}, K11="1 - b - L", K12="R - 2")
        >>> law.gains(Filter(R=1, L="500 mH", C="1 uF")).K11[0]
        (Fraction(-1, 2), Fraction(0, 1))
        """
        from certify.inputs import decode_all
        from certify.testing.assembly import dgu_spec

        dgu = decode_all(dgu_spec(filter, self, frequency=frequency).to_bytes()).nodes[0].dgu
        if dgu is None or isinstance(dgu.controller, LinearLoop):
            raise ValueError("a linear loop has no gains of its own: its F holds them")
        return to_state_feedback(dgu.controller)

    def with_let(self, **values: Any) -> Controller:
        """The same law with other values for some names of its `let`. Raises: KeyError for a name that it has not.

        >>> Controller(kind="state-feedback", let={"b": 1}, K11="1 - b", K12="R - 1").with_let(b="0.5")["let"]
        {'b': '0.5'}
        """
        let = self.get("let", {})
        for name in values.keys() - let.keys():
            raise KeyError(f"no {name!r} among {', '.join(let) or 'nothing'} of let")
        return self.replaced(let={**let, **values})

    def perturbed(self, gain: str, by: Any, at: tuple[int, int] | None = None) -> Controller:
        """The same law with `by` added to a gain: to one entry of its 2x2 matrix, or to its whole diagonal.

        Raises: KeyError if it has no such gain; ValueError for a corner of an IDA-PBC law, which has none.

        >>> Controller(kind="state-feedback", K11="1 - L", K12=0).perturbed("K11", "1e-9", at=(0, 1))["K11"]
        [['1 - L', '1e-9'], [0, '1 - L']]
        """
        old, more = self[gain], to_plain(by)
        if at is None and not isinstance(old, list):
            return self.replaced(**{gain: _sum(old, more)})
        if self.get("kind") == "ida-pbc" or "alpha" in self:
            if at is not None and at not in ((0, 0), (1, 1)):
                raise ValueError(f"the gains of an IDA-PBC law are diagonal: there is no entry {at} of {gain}")
            pair = old if isinstance(old, list) else [old, old]
            return self.replaced(**{gain: [_sum(x, more) if at in (None, (i, i)) else x for i, x in enumerate(pair)]})
        rows = old if isinstance(old, list) else [[old, 0], [0, old]]
        places = {(0, 0), (1, 1)} if at is None else {at}
        changed = [[_sum(x, more) if (i, j) in places else x for j, x in enumerate(row)] for i, row in enumerate(rows)]
        return self.replaced(**{gain: changed})


def _sum(old: Any, more: Any) -> Any:
    if old in (0, "0"):
        return more
    return f"{old} + {more}" if re.fullmatch(r"[\w.]+(e-\d+)?", str(more)) else f"{old} + ({more})"


class Load(Part):
    """A load at a node: its `kind` is zip, exp, rl or current."""


class Line(Part):
    """R, L and C of a line, or its `type` and `length`; in a network also `name`, `from` and `to`."""


class Document(dict[str, Any]):
    """A whole spec, of its JSON shape. It prints as TOML.

    >>> print(Document({"format": "certify/microgrid@1", "filter": {"lc": {"R": 0.1}}}))
    format = "certify/microgrid@1"
    <BLANKLINE>
    [filter.lc]
    R = 0.1
    """

    def __init__(self, document: Mapping[str, Any]) -> None:
        super().__init__(to_plain(document))

    def to_toml(self) -> str:
        return to_toml(self)

    def to_bytes(self) -> bytes:
        """The bytes that are proved: the TOML that it prints as."""
        return to_toml(self).encode()

    def to_document(self) -> dict[str, Any]:
        """The plain dictionary."""
        return to_plain(dict(self))  # type: ignore[no-any-return]

    def __str__(self) -> str:
        return to_toml(self).rstrip("\n")

    def __repr__(self) -> str:
        return f"\n{self}\n"
