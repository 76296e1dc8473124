"""Models as arrays: what proofs are about, to the fraction; floats and python-control beside it."""

from __future__ import annotations

import builtins
from fractions import Fraction
from typing import Any

import numpy
import pytest

import certify
from certify.arrays import PortModel
from certify.crosscheck.model import differences
from certify.inputs import decode_all
from certify.kernel.linalg import multiply, transpose
from certify.simulator.flow import free_flow
from certify.simulator.plant import Plant

PROVED = [
    ("specs/cigre-mv.toml", "1"),
    ("specs/cigre-mv.toml", "5"),
    ("specs/two-inverters.toml", "a"),
    ("specs/two-inverters.toml", "b"),
    ("specs/single-inverter.toml", "bus"),
    ("specs/custom-loop.json", None),
]


@pytest.fixture(scope="module")
def certificates() -> dict[str, certify.Certificate]:
    from tests.conftest import ROOT

    return {name: certify.prove(ROOT / name) for name in {name for name, _ in PROVED}}


def node_of(certificate: certify.Certificate, node: str | None) -> str:
    grid = certify.load(certificate.spec)
    return node or next(x.name for x in grid.nodes if x.dgu)


@pytest.mark.parametrize(("spec", "node"), PROVED)
def test_the_storage_function_of_a_proof_fits_its_model(
    spec: str, node: str | None, certificates: dict[str, certify.Certificate]
) -> None:
    """P B = C' exactly, P > 0 and -(F'P + PF)/2 >= 0: in Fractions by the model's own, and in floats by numpy's."""
    certificate = certificates[spec]
    name = node_of(certificate, node)
    model = certify.dgu_model(certificate.spec, name)
    exact = certificate.storage(name, exact=True)
    assert multiply(exact, model.exact.B) == transpose(model.exact.C)
    assert certificate.shortage(name) == 0
    P, F = certificate.storage(name), model.F
    size = abs(P).max()
    assert (numpy.linalg.eigvalsh(P) > -1e-12 * size).all()
    assert abs(P @ model.B - model.C.T).max() <= 1e-12 * abs(P).max() * abs(model.B).max()
    lost = -(F.T @ P + P @ F) / 2
    assert numpy.linalg.eigvalsh(lost).min() >= -1e-12 * (abs(F.T) @ abs(P)).max()
    M = model.dissipation(exact)
    terms = (abs(F.T) @ abs(P)).max()
    assert abs(certify.arrays.to_array(M) - lost).max() <= 1e-13 * terms
    assert transpose(M) == M
    # exactly positive semidefinite: every leading part of LDL' without rounding
    assert all(pivot >= 0 for pivot in pivots(M))


def pivots(M: Any) -> list[Fraction]:
    """Of a symmetric matrix by Gauss, each row without a pivot being zero as it must be in a semidefinite one."""
    rows, found = [list(row) for row in M], []
    for k in range(len(rows)):
        d = rows[k][k]
        found.append(d)
        if d == 0:
            assert not any(rows[k][k:])
            continue
        for i in range(k + 1, len(rows)):
            factor = rows[i][k] / d
            rows[i] = [a - factor * b for a, b in zip(rows[i], rows[k], strict=True)]
    return found


def test_the_shape_of_a_dgu_and_its_capacitance() -> None:
    model = certify.dgu_model("specs/two-inverters.toml", "a")
    assert model.exact.B[0] == (1 / model.capacitance, 0)
    assert model.capacitance == Fraction("25e-6") + Fraction("1e-9") / 2  # of the filter, and half of the line's
    assert (model.F.shape, model.B.shape, model.C.shape) == ((6, 6), (6, 2), (2, 6))
    assert model.F.flags.owndata
    constant = certify.Spec.read("specs/two-inverters.toml").controller("c").replace({"node.b.dgu.controller": "c"})
    assert certify.dgu_model(constant, "b").states == ("V_d", "V_q", "I_d", "I_q")
    held = certify.dgu_model("specs/two-inverters.toml", "a", held="d")
    assert held.states == ("V_d", "V_q", "I_d", "I_q", "v_q")
    assert held.F.shape == (5, 5)


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda: certify.dgu_model("specs/cigre-mv.toml", 99), "there is one at: 1"),
        (lambda: certify.dgu_model("specs/two-inverters.toml", "a", held="x"), "expected d, q or dq"),
        (lambda: certify.dgu_model("specs/two-inverters.toml", "b", held="d"), "no limits"),
        (lambda: certify.line_model("specs/two-inverters.toml", "b-a"), "there are: a-b"),
    ],
)
def test_what_there_is_no_model_of(call: Any, told: str) -> None:
    with pytest.raises(certify.SpecError, match="U033") as refused:
        call()
    assert told in str(refused.value)


def test_nothing_that_is_not_proved_has_a_storage_function() -> None:
    certificate = certify.prove("specs/cigre-mv-as-printed.toml")
    with pytest.raises(certify.NotProved, match="the claim about it is refuted"):
        certificate.storage("1")
    with pytest.raises(certify.NotProved, match="there is no DGU at that node"):
        certificate.shortage("nowhere")
    good = next(name for name in certificate.claims if name.startswith("dgu/") and name != "dgu/1")
    assert certificate.storage(good.removeprefix("dgu/")).shape == (6, 6)
    with pytest.raises(certify.NotProved, match="no equilibrium is proved"):
        certify.network_model(certify.prove(b'format = "certify/microgrid@1"\n' + UNKNOWN))


# No current flows without a node to draw it, and a constant power beyond what the line carries has no equilibrium.
UNKNOWN = b"""frequency = "50 Hz"
voltage_band = ["100 V", "500 V"]
[filter.lc]
R = 0.1
L = 1.8e-3
C = 25e-6
[controller.p]
kind = "ida-pbc"
alpha = -5
nu = 1
ki = 100
[node.a]
dgu = { filter = "lc", controller = "p", reference = [400, 0] }
[node.b]
capacitance = 1e-6
load = [{ kind = "zip", P = [9e5, 0] }]
[[line]]
name = "l"
from = "a"
to = "b"
R = 1
L = 1e-3
C = 0
"""


def test_the_impedance_by_hand() -> None:
    """An inverter in open loop: Z(s) in positive sequence is 1 / (C s + j w0 C + 1 / (R + L (s + j w0)))."""
    spec = (
        certify.Spec(frequency=50)
        .filter("lc", R=0.1, L=1.8e-3, C=25e-6)
        .controller("open")
        .node("a", filter="lc", controller="open", reference=400)
    )
    w0, s = 2 * numpy.pi * 50, 30 + 400j
    Z = certify.dgu_model(spec, "a").impedance(s)
    for turn in (1j, -1j):  # z = Zpos d for d turning with w0, Zneg against it
        vector = numpy.array([1, -turn])
        expected = 1 / (25e-6 * (s + turn * w0) + 1 / (0.1 + 1.8e-3 * (s + turn * w0)))
        assert Z @ vector == pytest.approx(expected * vector, rel=1e-12)


def test_the_model_of_a_line_by_hand() -> None:
    line = certify.line_model("specs/two-inverters.toml", "a-b")
    w0 = 2 * numpy.pi * 50
    assert pytest.approx(numpy.array([[-500, w0], [-w0, -500]]), rel=1e-14) == line.F
    assert numpy.array_equal(line.B, numpy.eye(2) / 0.4e-3)
    admittance = line.impedance(0) @ [1, -1j]
    assert admittance == pytest.approx(numpy.array([1, -1j]) / (0.2 + 1j * w0 * 0.4e-3), rel=1e-12)


@pytest.mark.parametrize("spec", ["specs/two-inverters.toml", "specs/single-inverter.toml", "specs/custom-loop.json"])
def test_the_network_is_linearised_where_it_rests(spec: str, certificates: dict[str, certify.Certificate]) -> None:
    model = certify.network_model(certificates[spec])
    flow = free_flow(Plant(grid_of(spec)))
    size = numpy.abs(model.x0).max()
    assert numpy.abs(flow.rates(model.x0)).max() <= 1e-8 * size * abs(model.A).max()
    steps = numpy.eye(len(model.x0)) * 1e-4 * size
    found = differences(flow, model.x0, steps) / (1e-4 * size)
    assert abs(found - model.A).max() <= 1e-6 * abs(model.A).max()
    assert (model.eigenvalues.real < 0).all()
    assert (numpy.diff(model.eigenvalues.real) <= 1e-9).all()
    assert len(model.states) == len(model.x0)


def grid_of(spec: str) -> Any:
    from tests.conftest import ROOT

    return decode_all((ROOT / spec).read_bytes())


@pytest.mark.parametrize(("spec", "node"), [PROVED[0], PROVED[2], PROVED[5]])
def test_python_control_sees_the_same_model(spec: str, node: str | None) -> None:
    control = pytest.importorskip("control", reason="python-control is not installed")
    grid = certify.load(spec)
    model = certify.dgu_model(spec, node or next(x.name for x in grid.nodes if x.dgu))
    system = model.to_state_space()
    assert isinstance(system, control.StateSpace)
    assert system.state_labels == list(model.states)
    assert (system.input_labels, system.output_labels) == (["d_d", "d_q"], ["z_d", "z_q"])
    expected = numpy.linalg.eigvals(model.F)
    gaps = numpy.abs(system.poles()[:, None] - expected[None, :]).min(axis=1)
    assert gaps.max() <= 1e-6 * numpy.abs(expected).max()
    for s in (0.0, 100j, 5 - 300j):
        assert system(s) == pytest.approx(model.impedance(s), rel=1e-6, abs=1e-9)
    assert abs(system.dcgain()).max() <= 1e-6 * abs(system(100j)).max() or spec.endswith("json")  # integral action


def test_without_python_control_the_message_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def none(name: str, *rest: Any, **more: Any) -> Any:
        if name == "control":
            raise ModuleNotFoundError("No module named 'control'")
        return real(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", none)
    with pytest.raises(ImportError, match="pip install control"):
        certify.line_model("specs/two-inverters.toml", "a-b").to_state_space()


def test_models_are_frozen_and_short_to_look_at() -> None:
    model = certify.dgu_model("specs/two-inverters.toml", "a")
    assert isinstance(model, PortModel)
    with pytest.raises(AttributeError):
        model.name = "x"  # type: ignore[misc]
    before = model.exact.F
    model.F[0, 0] = 5.0  # an array of the caller's own
    assert before == model.exact.F
    assert model.F[0, 0] == 0.0
    assert len(repr(model)) < 100
