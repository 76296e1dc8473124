"""Proofs and refutations of the passivity of one controlled DGU, cheapest first."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from certify.kernel.model import LinearPort
from certify.kernel.rules import Face
from certify.search.proposal import Proposal, to_rows, to_text
from certify.search.storage import find_state_feedback_storage

MAX_CONTRADICTION_STATES = 10  # identities among the entries of P take minutes beyond it


def propose_dgu(port: LinearPort) -> Iterator[Proposal]:
    """Closed form, then facial reduction with the LMI, then witnesses against every storage function.

    A closed form is the only candidate of its design, so if the kernel turns it down there is only refuting left.
    """
    part = find_state_feedback_storage(port)
    if part is not None:
        yield Proposal("proved", "quadratic-storage", {"storage": to_rows(part)})

    from certify.search.facial import Family
    from certify.search.frequency import find_frequency_witness

    family = None
    if part is None:
        from certify.search.lmi import solve_family

        family = Family(port)
        family.reduce()
        P = solve_family(family)
        if P is not None:
            below = P if port.capacitance_farad is None else tuple(row[2:] for row in P[2:])
            yield Proposal("proved", "quadratic-storage", {"storage": to_rows(below)})
    witness = find_frequency_witness(port)
    if witness:
        s0, u = witness
        yield Proposal("refuted", "frequency-witness", {"s0": to_text(s0), "u": [to_text(x) for x in u]})
    if len(port.F) > MAX_CONTRADICTION_STATES:
        return
    family = family or Family(port)
    family.reduce(with_storage=True)
    found = family.contradiction()
    if found:
        data = {
            "faces": [_face(face) for face in found.faces],
            "W": to_rows(found.W),
            "Y": to_rows(found.Y),
            "y": [to_text(v) for v in found.y],
        }
        yield Proposal("refuted", "storage-contradiction", data)


def _face(face: Face) -> dict[str, Any]:
    kind = "storage" if face.of_storage else "dissipation"
    return {"of": kind, "u": to_text(face.u), "Y": to_rows(face.Y), "y": [to_text(v) for v in face.y]}
