"""Models of a spec as arrays: F, B, C of each DGU and line as the kernel has them, exact and in floats.

What is exact is what proofs are about. The network as a whole, linearised, is in floats by the simulator's equations:
evidence, and no proof.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy
from numpy.typing import NDArray

from certify.crosscheck.claimed import Claimed
from certify.inputs import SpecSource, decode_all, to_bytes
from certify.kernel.claims import Context
from certify.kernel.errors import Fault, RuleFailure, SpecError
from certify.kernel.linalg import Matrix, add, identity, scale
from certify.kernel.model import J, LinearPort, feedback
from certify.kernel.quantity import shorten
from certify.kernel.rules import dissipation
from certify.kernel.spec import LinearLoop
from certify.simulation import column_names
from certify.simulator.flow import find_rest, free_flow
from certify.simulator.plant import Array, Plant
from certify.simulator.starts import flat_state
from certify.verdicts import NotProved

if TYPE_CHECKING:
    from certify.certificate import Certificate

MODES = ("", "d", "q", "dq")
I2 = identity(2)


@dataclass(frozen=True)
class PortModel:
    """x' = F x + B d, z = C x of one part, in deviations from an equilibrium, in the dq frame at w0; all in SI.

    `exact` has F, B and C in Fractions, shapes (n, n), (n, 2), (2, n), as the kernel has them; the properties are the
    same in floats. `states`, `inputs` and `outputs` name the rows and columns, `units` are those of the states.
    `capacitance`: all that is at the node of a DGU, in farad: of its filter and of half of each line; None of a line.
    """

    name: str
    exact: LinearPort
    states: tuple[str, ...]
    units: tuple[str, ...]
    inputs: tuple[str, str]
    outputs: tuple[str, str]
    capacitance: Fraction | None = None

    @property
    def F(self) -> Array:
        return to_array(self.exact.F)

    @property
    def B(self) -> Array:
        return to_array(self.exact.B)

    @property
    def C(self) -> Array:
        return to_array(self.exact.C)

    def impedance(self, s: complex) -> NDArray[numpy.complex128]:
        """Z(s) = C (s - F)^-1 B at a complex frequency in 1/s, shape (2, 2): of a DGU in ohm, of a line in siemens.

        Raises: numpy.linalg.LinAlgError at a pole.

        >>> Z = dgu_model("specs/single-inverter.toml", "bus").impedance(0)  # zero, by the integral action
        >>> Z.shape, bool(abs(Z).max() < 1e-9)
        ((2, 2), True)
        """
        shifted = s * numpy.eye(len(self.exact.F)) - self.F
        return numpy.asarray(self.C @ numpy.linalg.solve(shifted, self.B.astype(complex)))

    def dissipation(self, P: Matrix) -> Matrix:
        """M = -(F'P + PF)/2 in Fractions: without input the storage function x'Px/2 loses x'Mx watt along the motion.

        `P`: that of `Certificate.storage(node, exact=True)`.
        """
        return scale(Fraction(1, 2), dissipation(self.exact.F, P))

    def to_state_space(self) -> Any:
        """A `control.StateSpace` of python-control with these names, in floats.

        Raises: ImportError if python-control is not installed.
        """
        try:
            import control
        except ImportError:
            raise ImportError(
                "a StateSpace is one of python-control, which is not installed: pip install control"
            ) from None
        names = {"states": list(self.states), "inputs": list(self.inputs), "outputs": list(self.outputs)}
        return control.ss(self.F, self.B, self.C, numpy.zeros((2, 2)), name=self.name, **names)

    def __repr__(self) -> str:
        return f"<PortModel of {self.name}: {len(self.states)} states {', '.join(self.states)}>"


@dataclass(frozen=True, eq=False)
class NetworkModel:
    """x' = A x of the whole network around its proved equilibrium `x0`, in floats: evidence, and no proof.

    What `network_model` returns.

    By the simulator's equations, which share no model with the kernel. Shapes: A (n, n), x0 (n,). `states` names them
    and their unit is SI: volt, ampere; of integrators volt second.
    """

    A: Array
    x0: Array
    states: tuple[str, ...]

    @property
    def eigenvalues(self) -> NDArray[numpy.complex128]:
        """Of A in 1/s, the slowest first."""
        found = numpy.asarray(numpy.linalg.eigvals(self.A), dtype=complex)
        return found[numpy.argsort(-found.real)]

    def __repr__(self) -> str:
        return f"<NetworkModel in floats: {len(self.states)} states>"


def dgu_model(spec: SpecSource, node: str | int, held: str = "") -> PortModel:
    """The controlled DGU at a node as the kernel has it: its loop with all the capacitance at the node, without loads.

    States: node voltage V, current I of the filter, integrator v (v' = V* - V; of an IDA-PBC controller its xi with the
    other sign), each d and q; of a linear loop its own. The input is the current d that lines and loads feed into the
    node, the output z its voltage. `held`: "d", "q" or "dq" for the axes of the inverter that are at their limits.
    Raises: SpecError for a bad spec, U033 if there is no such DGU.

    >>> model = dgu_model("specs/two-inverters.toml", "a")
    >>> model.states, model.units, float(model.capacitance)
    (('V_d', 'V_q', 'I_d', 'I_q', 'v_d', 'v_q'), ('V', 'V', 'A', 'A', 'V s', 'V s'), 2.50005e-05)
    >>> model.F.shape, model.exact.C[0][0]
    ((6, 6), Fraction(1, 1))
    """
    context = Context(decode_all(to_bytes(spec)))
    name = str(node)
    dgu = context.nodes[name].dgu if name in context.nodes else None
    if dgu is None or held not in MODES:
        there = [node.name for node in context.grid.nodes if node.dgu]
        message = f"no DGU at node {shorten(name)}; there is one at: {', '.join(there[:20])}"
        raise _refuse(message if dgu is None else f"held at {shorten(held)}; expected d, q or dq")
    if held and (isinstance(dgu.controller, LinearLoop) or dgu.limits_volt is None):
        raise _refuse(f"the DGU at node {shorten(name)} has no limits at which it could be held")
    try:
        port = context.port((name, held) if held else name)
    except RuleFailure as failure:
        raise _refuse(str(failure)) from None
    ends = ("d", "q")
    inputs, outputs = ("d_d", "d_q"), ("z_d", "z_q")
    total = context.capacitances["0"][name]
    if isinstance(dgu.controller, LinearLoop):
        own = tuple(f"x_{k}" for k in range(len(port.F)))
        return PortModel(f"dgu/{name}", port, own, ("",) * len(own), inputs, outputs, total)
    _, axes = feedback(dgu.controller, held)
    states = (*(f"V_{e}" for e in ends), *(f"I_{e}" for e in ends), *(f"v_{ends[k]}" for k in axes))
    units = ("V", "V", "A", "A", *("V s" for _ in axes))
    return PortModel(f"dgu/{name}", port, states, units, inputs, outputs, total)


def line_model(spec: SpecSource, line: str | int) -> PortModel:
    """The series branch of a line: its input is the voltage from start to end, its output the current that way.

    Its storage function is L |I|^2 / 2. Raises: SpecError for a bad spec, U033 if there is no such line.

    >>> line_model("specs/two-inverters.toml", "a-b").F.round(6).tolist()
    [[-500.0, 314.159265], [-314.159265, -500.0]]
    """
    grid = decode_all(to_bytes(spec))
    found = next((x for x in grid.lines if x.name == str(line)), None)
    if found is None:
        names = ", ".join(x.name for x in grid.lines[:20]) or "none"
        raise _refuse(f"no line {shorten(str(line))}; there are: {names}")
    R, L = found.branch.resistance_ohm, found.branch.inductance_henry
    port = LinearPort(add(scale(-R / L, I2), scale(-grid.w0, J)), scale(1 / L, I2), I2)
    return PortModel(f"line/{found.name}", port, ("I_d", "I_q"), ("A", "A"), ("V_d", "V_q"), ("I_d", "I_q"))


def network_model(certificate: Certificate) -> NetworkModel:
    """The whole network, linearised in floats around the equilibria that the certificate proves.

    Raises: NotProved if not every island has a proved equilibrium.

    >>> import certify
    >>> model = network_model(certify.prove("specs/two-inverters.toml"))
    >>> model.A.shape, bool((model.eigenvalues.real < 0).all())
    ((14, 14), True)
    """
    plant = Plant(decode_all(certificate.spec))
    claimed = Claimed(plant, certificate.data, certificate.verdict)
    rests = claimed.rests.values()
    voltages = {name: V for rest in rests for name, V in rest.voltages.items()}
    if voltages.keys() != plant.nodes.keys():
        missing = [name for name in plant.nodes if name not in voltages]
        raise NotProved(f"no equilibrium is proved at node {', '.join(missing[:8])}{', ..' * (len(missing) > 8)}")
    lines = {name: current for rest in rests for name, current in rest.lines.items()}
    inverters = {name: current for rest in rests for name, current in rest.inverters.items()}
    flow = free_flow(plant)
    try:
        guess = plant.at_rest(voltages, lines, inverters)
    except numpy.linalg.LinAlgError:  # the gain of an integrator has no inverse
        guess = flat_state(plant)
    x0 = find_rest(flow, guess)  # the proof gives phasors; Newton's method finds the states that go with them
    if x0 is None:
        raise NotProved("the simulator does not come to rest at the equilibrium that is proved")
    return NetworkModel(flow.jacobian(x0).toarray(), x0, column_names(plant.slices))


def to_array(exact: Matrix) -> Array:
    """A matrix of Fractions in floats, each rounded once."""
    return numpy.array([[float(x) for x in row] for row in exact])


def _refuse(message: str) -> SpecError:
    return SpecError((Fault("U033", "", message),))
