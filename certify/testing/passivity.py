"""Whether one inverter with its controller is passive exactly: with no shortage that lines or loads could make up for.

`certify prove` is content if a network holds; then a DGU may be passive but for a shortage. A design is asked more.
"""

from __future__ import annotations

from certify.certificate import Certificate, write_certificate
from certify.inputs import decode_all
from certify.kernel.check import check
from certify.search.prove import Search


class ExactSearch(Search):
    """The search, but for shortages: a DGU is passive, or refuted, or open."""

    def decide(self, name: str) -> None:
        (kind, what), _ = self.expected[name]
        if kind == "dgu":
            self._settle(name, self.passivity(what))
        else:
            super().decide(name)


def prove_passivity(spec: bytes) -> Certificate:
    """A certificate of the spec in which each DGU is proved to be passive, refuted, or unknown.

    Raises: SpecError; Rejected if the kernel turns the result down, which is a defect of the search.
    """
    search = ExactSearch(decode_all(spec))
    for name in search.expected:
        search.decide(name)
    found = search.result()
    notes = found.pop("notes")
    data = write_certificate(spec, found, notes)
    return Certificate(data, check(spec, data), notes, spec)
