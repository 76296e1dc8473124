"""The events of a scenario in words."""

from __future__ import annotations

from certify.report.text import approximate
from certify.simulator.scenario import Event


def event_in_words(event: Event) -> str:
    """What happens, in words.

    >>> from fractions import Fraction
    >>> event_in_words(Event(Fraction(1), "connect", "load", "8", index=2))
    'load 2 at node 8 connects'
    """
    what = f"{event.part} {event.target}" if event.index is None else str(event.switched)
    if event.action == "load":
        return f"{what} changes: {', '.join(key for key, _ in event.coefficients)}"
    if event.reference_volt is not None:
        d, q = (approximate(x) for x in event.reference_volt)
        return f"{what} gets another reference: {d} V, {q} V"
    if event.controller is not None:
        return f"{what} gets another controller: {event.controller}"
    return f"{what} {event.action}s{', its filter discharged' if event.discharged else ''}"
