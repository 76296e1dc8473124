"""Each rule of the kernel as a table: what it accepts, and one rejected case for each side condition."""

from __future__ import annotations

import dataclasses
from fractions import Fraction
from typing import Any

import pytest

from certify.kernel import rules
from certify.kernel.data import Data
from certify.kernel.errors import RuleFailure
from certify.kernel.linalg import Matrix, identity, to_matrix
from certify.kernel.model import LinearPort

F_ = Fraction
DAMPED = LinearPort(to_matrix([[-1]]), to_matrix([[1]]), to_matrix([[1]]))
ACTIVE = LinearPort(to_matrix([[1]]), to_matrix([[1]]), to_matrix([[1]]))
# V' = I + d, I' = -V - I
FILTER = LinearPort(to_matrix([[0, 1], [-1, -1]]), to_matrix([[1], [0]]), to_matrix([[1, 0]]))
# V' = w + d with w' = -w: a mode that the port does not excite drives the lossless capacitor
DRIVEN = LinearPort(to_matrix([[0, 1], [0, -1]]), to_matrix([[1], [0]]), to_matrix([[1, 0]]))


def fails(reason: str, rule: Any, *arguments: Any) -> None:
    with pytest.raises(RuleFailure, match=reason):
        rule(*arguments)


def test_series_branch() -> None:
    rules.series_branch(F_(1), F_(1))
    for resistance, inductance in ((0, 1), (-1, 1)):
        fails("resistance", rules.series_branch, F_(resistance), F_(inductance))
    for inductance in (0, -1):
        fails("inductance", rules.series_branch, F_(1), F_(inductance))


def test_quadratic_storage_accepts() -> None:
    found = rules.quadratic_storage(FILTER, identity(2))
    assert to_matrix([[0, 0], [0, 2]]) == found.M
    assert rules.quadratic_storage(DAMPED, identity(1)).dissipation_pivots == (2,)


@pytest.mark.parametrize(
    ("reason", "P"),
    [
        ("not a symmetric matrix", [[1, 1], [0, 1]]),
        ("not a symmetric matrix", [[1]]),
        ("not a symmetric matrix", [[1, 0, 0], [0, 1, 0], [0, 0, 1]]),
        ("not a symmetric matrix", [[1, 0], [0]]),
        ("P B = C'", [[2, 0], [0, 1]]),
        ("P B = C'", [[1, "1/1000000000000000000000000000000"], ["1/1000000000000000000000000000000", 1]]),
        ("not positive definite", [[1, 0], [0, 0]]),
        ("not positive definite", [[1, 0], [0, -1]]),
        ("not positive semidefinite", [[1, 0], [0, "1.000000000000000000000000000001"]]),
    ],
)
def test_quadratic_storage_rejects(reason: str, P: list[list[Any]]) -> None:
    fails(reason, rules.quadratic_storage, FILTER, to_matrix(P))


def test_frequency_witness() -> None:
    one = ((F_(1), F_(0)),)
    assert rules.frequency_witness(ACTIVE, (F_(1, 2), F_(0)), one) == -2
    fails("not negative", rules.frequency_witness, DAMPED, (F_(1), F_(1)), one)
    fails("not positive", rules.frequency_witness, ACTIVE, (F_(0), F_(0)), one)
    fails("not positive", rules.frequency_witness, DAMPED, (F_(-3), F_(0)), one)
    fails("eigenvalue", rules.frequency_witness, ACTIVE, (F_(1), F_(0)), one)
    fails("entries", rules.frequency_witness, ACTIVE, (F_(1, 2), F_(0)), (*one, *one))
    fails("not negative", rules.frequency_witness, ACTIVE, (F_(1, 2), F_(0)), ((F_(0), F_(0)),))


def test_storage_contradiction() -> None:
    """DRIVEN: V' B-direction is a face; then M e1 = 0 demands P12 both 1 and 0."""
    from certify.search.contradiction import find_contradiction

    data = find_contradiction(DRIVEN)
    assert data
    chain, W, Y, y = Data(data).fields("faces", "W", "Y", "y")
    faces = [
        rules.Face(kind.text() == "storage", weights.vector(), U.matrix(), face_Y.matrix(), face_y.matrix())
        for kind, weights, U, face_Y, face_y in (face.fields("of", "weights", "U", "Y", "y") for face in chain.items())
    ]
    again = (W.matrix(), Y.matrix(), y.matrix())
    rules.storage_contradiction(DRIVEN, faces, *again)
    first, zero = faces[0], to_matrix([[0], [0]])

    def with_face(**changes: Any) -> list[rules.Face]:
        return [dataclasses.replace(first, **changes)]

    for reason, changed in (
        ("face is not forced", with_face(U=((F_(0), F_(1)),))),
        ("face is not forced", with_face(of_storage=True)),
        ("y is not of shape", with_face(y=first.U)),
        ("face does not have", with_face(U=((F_(1),),))),
        ("weight of a face", with_face(weights=(F_(0),))),
        ("weight of a face", with_face(weights=(F_(-1),))),
        ("weight of a face", with_face(weights=(F_(1), F_(1)))),
        ("not of shape", with_face(Y=first.Y[:1])),
        ("more faces", [first] * 5),
        ("y is not of shape", []),
    ):
        fails(reason, rules.storage_contradiction, DRIVEN, changed, *again)
    fails("y is not of shape", rules.storage_contradiction, DRIVEN, faces, *again[:2], ((F_(1),),))
    fails("not negative", rules.storage_contradiction, DRIVEN, faces, again[0], zero, ((F_(0), F_(0)),))
    fails("W is not", rules.storage_contradiction, DRIVEN, faces, to_matrix([[-1, 0], [0, 0]]), *again[1:])
    fails("W is not", rules.storage_contradiction, DRIVEN, faces, to_matrix([[0, 1], [0, 0]]), *again[1:])
    # what is passive cannot be contradicted by the data of something else
    fails("face is not forced", rules.storage_contradiction, FILTER, faces, *again)
    # without faces: W on the unstable mode of ACTIVE makes the left side 2, and tr(C Y) < 0 needs Y = -1
    one, minus = identity(1), to_matrix([[-1]])
    rules.storage_contradiction(ACTIVE, [], one, minus, ())
    fails("left side", rules.storage_contradiction, DAMPED, [], one, minus, ())
    fails("not negative", rules.storage_contradiction, ACTIVE, [], one, to_matrix([[0]]), ())


def test_skew_incidence() -> None:
    rules.skew_incidence({("a", "l"): -1}, {("a", "l"): 1})
    fails("skew", rules.skew_incidence, {("a", "l"): -1}, {("a", "l"): -1})
    fails("skew", rules.skew_incidence, {("a", "l"): -1}, {})


def matrix(*rows: list[Any]) -> Matrix:
    return to_matrix(rows)


def test_rest_and_pin() -> None:
    """V' = I + d, I' = -V - I: at rest for good. Without damping the voltage may swing for ever."""
    damped, none = to_matrix([[0, 0], [0, 2]]), to_matrix([[0, 0], [0, 0]])
    rules.rests(FILTER, damped)
    rules.pins(FILTER, damped, with_load=False)
    lossless = LinearPort(to_matrix([[0, 1], [-1, 0]]), FILTER.B, FILTER.C)
    rules.rests(lossless, none)  # once V = 0 is known, the current rests too
    fails("z other than 0", rules.pins, lossless, none, False)
    # V' = d + w (w from a load without dissipation), nothing else: V may move as w likes
    capacitor = LinearPort(to_matrix([[0]]), to_matrix([[1]]), to_matrix([[1]]))
    rules.rests(capacitor, to_matrix([[0]]))
    fails("z other than 0", rules.pins, capacitor, to_matrix([[0]]), True)
    # an integrator that acts on nothing stays where it is
    idle = LinearPort(to_matrix([[-1, 0], [0, 0]]), to_matrix([[1], [0]]), to_matrix([[1, 0]]))
    fails("motion", rules.rests, idle, to_matrix([[2, 0], [0, 0]]))


def test_pin_needs_more_with_a_load() -> None:
    """I' = V (undamped), V' = d + w, and the current is observed by dissipation only through its derivative."""
    # x = (V, I): I' = -I + V, M sees I only. Without load: I = 0 forces V = 0. With a load the same, as V enters I'.
    port = LinearPort(to_matrix([[0, 0], [1, -1]]), to_matrix([[1], [0]]), to_matrix([[1, 0]]))
    sees_current = to_matrix([[0, 0], [0, 1]])
    rules.pins(port, sees_current, with_load=False)
    rules.pins(port, sees_current, with_load=True)
    # x = (V, I), V' = I + d, M sees nothing but a combination that a load current can cancel
    chain = LinearPort(to_matrix([[0, 1], [0, 0]]), to_matrix([[1], [0]]), to_matrix([[1, 0]]))
    sees_voltage_rate = to_matrix([[0, 0], [0, 1]])  # I = V' when there is no load
    fails("z other than 0", rules.pins, chain, sees_voltage_rate, True)
    fails("z other than 0", rules.pins, chain, sees_voltage_rate, False)
