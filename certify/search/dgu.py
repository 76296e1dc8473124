"""Proofs and refutations of the passivity of one controlled DGU, cheapest first."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from certify.kernel.errors import RuleFailure
from certify.kernel.linalg import Matrix
from certify.kernel.model import LinearPort
from certify.kernel.rules import quadratic_storage
from certify.search.proposal import Proposal, to_rows, to_text
from certify.search.storage import find_state_feedback_storage

if TYPE_CHECKING:
    from certify.search.facial import Family
    from certify.search.frequency import Witness


def propose_dgu(port: LinearPort) -> Iterator[Proposal]:
    """Closed form, then facial reduction with the LMI, then witnesses against every storage function.

    A closed form is the only candidate of its design, so if the kernel turns it down there is only refuting left.
    """
    part = find_state_feedback_storage(port)
    if part is not None:
        yield Proposal("proved", "quadratic-storage", {"storage": to_rows(part)})

    from certify.search.frequency import Response, find_coarse_witness, find_witness

    response = Response.of(port)
    witness = find_coarse_witness(response)
    if witness:
        yield refutation(witness)
    if part is None:
        P = find_storage(port, reduce_port(port))
        if P is not None:
            below = P if port.capacitance_farad is None else tuple(row[2:] for row in P[2:])
            yield Proposal("proved", "quadratic-storage", {"storage": to_rows(below)})
    from certify.search.contradiction import find_contradiction, find_unreached_mode

    data = find_unreached_mode(port)
    if data:
        yield Proposal("refuted", "storage-contradiction", data)
    witness = find_witness(response)
    if witness:
        yield refutation(witness)
    data = find_contradiction(port)
    if data:
        yield Proposal("refuted", "storage-contradiction", data)


def refutation(witness: Witness, corner: str = "") -> Proposal:
    data: dict[str, Any] = witness_data(witness)
    return Proposal("refuted", "frequency-witness", data | ({"corner": corner} if corner else {}))


def witness_data(witness: Witness) -> dict[str, Any]:
    return {"s0": to_text(witness.s0), "u": [to_text(x) for x in witness.u]}


def reduce_port(port: LinearPort) -> Family:
    """The family of storage matrices after all facial reduction: known images, then frequencies without dissipation.

    If its `obstacle` is set, a u with u'M u < 0 (or u'P u < 0) all over the family, there is no storage matrix.
    """
    from certify.search.facial import Family
    from certify.search.spectral import axis_factors, axis_pairs, reduce_to_riccati

    family = Family(port)
    while family.reduce_known() and family.is_free():
        reduced = reduce_to_riccati(family)
        if not reduced.R.ncols():
            break
        H = reduced.riccati.hamiltonian()
        factors = axis_factors(H)
        if any(factor.multiplicity % 2 and factor.f[0] for factor in factors):
            family.crosses = True  # an eigenvalue of Z + Z* changes its sign there
            break
        faces = [reduced.lift(axis_pairs(H, factor.f)) for factor in factors if factor.entirely]
        grown = [family.impose_face(U) for U in faces]
        if not any(grown):
            break
    return family


def grows(port: LinearPort) -> bool:
    """Whether F has an eigenvalue in the open right half-plane: then P > 0 and M >= 0 cannot be."""
    from certify.search.exact import to_flint

    return any(root.real > 0 for root, _ in to_flint(port.F).charpoly().numer().complex_roots())


def find_storage(port: LinearPort, family: Family) -> Matrix | None:
    """A storage matrix that the kernel's rule accepts, or None."""
    from certify.search.lmi import solve_family, solve_free
    from certify.search.spectral import hidden_undamped_modes, reduce_to_riccati

    def accept(P: Matrix) -> bool:
        try:
            quadratic_storage(port, P)
        except RuleFailure:
            return False
        return True

    if family.point is None or family.obstacle is not None or family.crosses or grows(port):
        return None
    for V, image in () if family.is_free() else hidden_undamped_modes(family):
        family.choose(V, image)
    found = solve_free(reduce_to_riccati(family), accept) if family.is_free() else None
    return found or solve_family(family, accept)
