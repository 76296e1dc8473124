"""The simulator against the kernel: its Jacobian, the currents of its loads, and where it rests."""

from __future__ import annotations

import cmath
from fractions import Fraction

import numpy
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from certify.crosscheck.claimed import Claimed, floats
from certify.crosscheck.findings import Finding
from certify.kernel.model import to_state_feedback
from certify.kernel.spec import ConstantVoltage, IdaPbc, LinearLoop
from certify.rests import Rest
from certify.simulator.flow import Flow, find_rest, flow_at, free_flow
from certify.simulator.motion import natural_sizes
from certify.simulator.plant import Array, Plant
from certify.simulator.starts import flat_state

DENSE_STATES = 500  # up to which every entry of the Jacobian is compared on its own
PROBES = 3  # random directions for each kind of state beyond that
STEP = 1e-4  # of the size of a state
SAME = 1e-5  # of an entry: what the curvature of loads leaves of a difference
ROUNDING = 1e-13  # of the sum of all terms of a rate: what subtraction leaves
SAME_RATE = 1e-12  # of the sum of all terms of a rate
AT_REST = 1e-8  # of the size of a state
HELD_STEPS = 8
MODES = ("d", "q", "dq")
SHOWN_MODES = 40  # DGUs the modes and limits of which are compared
SAME_CURRENT = 1e-9  # of the largest current of a load at any of the voltages that are tried
IN_BAND = (0.2, 0.8)  # where in each piece of a band loads are compared
TURN = 2.4  # rad from one of these voltages to the next, so that they point everywhere
BEYOND = ((1.5, -1.5), (-1.5, 0.5), (0.5, 1.5), (-0.5, -1.5))  # of the limits of an inverter, d and q


def find_reference(claimed: Claimed) -> Array | None:
    """The simulator's own equilibrium, without limits: from a flat start, or if that fails from the proved voltages."""
    plant = claimed.plant
    x = flat_state(plant)
    found = find_rest(free_flow(plant), x)
    if found is None:
        for rest in claimed.rests.values():
            for name, V in rest.voltages.items():
                if ("voltage", name) in plant.slices:
                    x[plant.slices["voltage", name]] = V.real, V.imag
        found = find_rest(free_flow(plant), x)
    return found


def differences(flow: Flow, x: Array, directions: Array) -> Array:
    """Central differences of the rates along directions, (n, k) to the same."""
    return numpy.stack([(flow.rates(x + e) - flow.rates(x - e)) / 2 for e in directions.T], axis=1)


def compare_model(claimed: Claimed, x: Array, seed: int = 1) -> list[Finding]:
    """Every subsystem's rows of the Jacobian at a state, as far as they may differ; the network's are all of them.

    Figures are shares: of an entry, or of the sum of a row's in a random direction.
    """
    plant = claimed.plant
    flow, sizes = free_flow(plant), natural_sizes(plant, x)
    network = claimed.network({name: plant.voltage(x, name) for name in plant.loaded})
    rounding = ROUNDING * (abs(flow.A) @ numpy.abs(x) + numpy.abs(flow.b) + abs(plant.D) @ numpy.abs(plant.drawn(x)))
    if plant.size <= DENSE_STATES:
        directions = numpy.diag(STEP * sizes)
    else:
        directions = _probes(plant, STEP * sizes, seed)
    expected = network @ directions
    scale = abs(network) @ numpy.abs(directions)
    # by differences of the rates, and as the simulator itself writes it down for its steps
    both = (differences(flow, x, directions), flow.jacobian(x) @ directions)
    rows = numpy.max([_shares(found - expected, scale, rounding[:, None]).max(axis=1) for found in both], axis=0)
    silent = {
        claimed.at_node(name).name for name in plant.loaded if not claimed.speaks_of(name, plant.voltage(x, name))
    }
    parts = [part for part in claimed.parts.values() if part.name not in silent]
    findings = [Finding("model", part.name, float(rows[part.at].max()), SAME) for part in parts]
    findings += _compare_modes(claimed, x, sizes) + _compare_limits(plant, x, sizes)
    return findings + _compare_settings(claimed)


def _compare_limits(plant: Plant, x: Array, sizes: Array) -> list[Finding]:
    """The flow that the limits select against the rates with clipped voltages, where inverters are beyond them."""
    limited = [j for j in range(0, len(plant.limits), 2) if numpy.isfinite(plant.limits[j])][:SHOWN_MODES]
    if not limited:
        return []
    asked, moves = plant.asked(x), []
    for j in limited:
        rows = plant.K[j : j + 2].tocsc()
        at = numpy.flatnonzero(numpy.diff(rows.indptr))
        moves.append((j, at, sizes[at, None] * numpy.linalg.pinv(rows[:, at].toarray() * sizes[at])))
    found = []
    for shares in BEYOND:
        y = x.copy()
        for j, at, move in moves:
            y[at] += move @ (shares * plant.limits[j : j + 2] - asked[j : j + 2])
        off = flow_at(plant, y).rates(y) - plant.rates(y)
        terms = abs(plant.A) @ numpy.abs(y) + numpy.abs(plant.b) + abs(plant.D) @ numpy.abs(plant.drawn(y))
        terms += abs(plant.G) @ (abs(plant.K) @ numpy.abs(y) + numpy.abs(plant.k))
        found.append(_shares(off, terms, numpy.zeros_like(terms)))
    return [Finding("model", "limits", float(numpy.max(found)), SAME_RATE)]


def _compare_settings(claimed: Claimed) -> list[Finding]:
    """Limits, and what an anti-windup adds for each volt that they take off, against the spec and the kernel's K13."""
    findings = []
    for j, (name, inverter) in enumerate(claimed.plant.inverters.items()):
        dgu = claimed.context.nodes[name].dgu
        if dgu is None or dgu.limits_volt is None or isinstance(dgu.controller, LinearLoop):
            continue
        given = numpy.array([float(v) for v in dgu.limits_volt])
        off = float(numpy.max(numpy.abs(claimed.plant.limits[2 * j : 2 * j + 2] / given - 1)))
        if dgu.anti_windup_second is not None:
            K13 = floats(to_state_feedback(dgu.controller).K13 or ())
            turned = -1.0 if isinstance(dgu.controller, IdaPbc) else 1.0
            expected = turned * numpy.linalg.inv(K13) / float(dgu.anti_windup_second)
            found = numpy.zeros((2, 2)) if inverter.tracking is None else inverter.tracking
            off = max(off, float(numpy.max(numpy.abs(found - expected)) / numpy.max(numpy.abs(expected))))
        findings.append(Finding("model", f"limits/{name}", off, SAME_RATE))
    return findings


def compare_loads(claimed: Claimed) -> list[Finding]:
    """The currents of static loads where the kernel speaks of them: on each piece of a band, and all over a disk.

    Figures are shares of the largest current of a node.
    """
    plant = claimed.plant
    if not plant.loaded:
        return []
    tried = [_voltages(claimed, name) for name in plant.loaded]
    count = max(map(len, tried))
    volts = numpy.array([[own[k % len(own)] for own in tried] for k in range(count)])
    drawn = plant.loads.currents(volts)
    findings = []
    for j, name in enumerate(plant.loaded):
        exact = [claimed.load_current(name, (Fraction(V.real), Fraction(V.imag))) for V in tried[j]]
        expected = numpy.array([complex(float(d), float(q)) for d, q in exact])
        size = float(numpy.abs(expected).max())
        off = float(numpy.abs(drawn[: len(expected), j] - expected).max())
        findings.append(Finding("model", f"load/{name}", off / size if size else off, SAME_CURRENT))
    return findings


def _voltages(claimed: Claimed, name: str) -> list[complex]:
    """Where the loads of a node are compared."""
    node = claimed.context.nodes[name]
    if node.current is not None:
        centre, radius = complex(*map(float, node.current.centre_volt)), float(node.current.radius_volt)
        return [centre + radius * share * cmath.rect(1.0, TURN * k) for k, share in enumerate((*IN_BAND, *IN_BAND))]
    bands = [(float(low), float(high)) for (low, high), _ in claimed.context.pieces(name)]
    sizes = [low + share * (high - low) for low, high in bands for share in IN_BAND]
    return [cmath.rect(size, TURN * k) for k, size in enumerate(sizes)]


def _shares(off: Array, scale: Array, rounding: Array) -> Array:
    """Differences as shares of an entry, and of what rounding alone may be worth of one."""
    size = scale + rounding / SAME
    return numpy.abs(off) / numpy.where(size > 0, size, 1.0)


def _probes(plant: Plant, steps: Array, seed: int) -> Array:
    """Random directions, each in one kind of state only."""
    rng = numpy.random.default_rng(seed)
    kinds: dict[str, Array] = {}
    for part, at in plant.slices.items():
        kinds.setdefault(part[0], numpy.zeros(plant.size))[at] = 1.0
    signs = [rng.choice((-1.0, 1.0), plant.size) * rng.uniform(0.5, 1.5, plant.size) for _ in range(PROBES)]
    return numpy.stack([mask * sign * steps for mask in kinds.values() for sign in signs], axis=1)


def _compare_modes(claimed: Claimed, x: Array, sizes: Array) -> list[Finding]:
    """F of each DGU with some axes held at their limits, against the flow in which they are."""
    plant, findings = claimed.plant, []
    names = list(plant.inverters)
    limited = [name for name in names if numpy.isfinite(plant.limits[2 * names.index(name)])][:SHOWN_MODES]
    for axes in MODES if limited else ():
        held = numpy.zeros(len(plant.limits))
        for name in limited:
            for axis in axes:
                held[2 * names.index(name) + "dq".index(axis)] = 1.0
        flow = Flow(plant, held)
        for name in limited:
            if name in plant.loaded and not claimed.speaks_of(name, plant.voltage(x, name)):
                continue
            at, sign = claimed.places((name, axes))
            directions = numpy.zeros((plant.size, len(at)))
            directions[at, numpy.arange(len(at))] = STEP * sizes[at]
            port = claimed.context.port((name, axes))
            F = floats(port.F)
            if name in plant.loaded:  # what the load at the node adds is not part of the port
                slope = claimed.load_slope(name, plant.voltage(x, name))
                F = F - floats(port.B) @ slope @ floats(port.C)
            expected = sign[:, None] * F * sign[None, :] * (STEP * sizes[at])
            found = differences(flow, x, directions)[at]
            rounding = ROUNDING * (abs(flow.A[at]) @ numpy.abs(x) + numpy.abs(flow.b[at]))[:, None]
            share = _shares(found - expected, numpy.abs(expected), rounding)
            findings.append(Finding("model", f"mode/{name}/{axes}", float(share.max()), SAME))
    return findings


def compare_rest(claimed: Claimed, x: Array | None) -> list[Finding]:
    """Each proved equilibrium against the simulator's own, `x`: voltages, currents, and what inverters are asked for.

    Figures are shares of the size of a state; one is no number where the simulator has found no equilibrium.
    """
    plant, findings = claimed.plant, []
    if x is None:
        return [Finding("equilibrium", first, float("nan"), AT_REST) for first in claimed.rests]
    for first, rest in claimed.rests.items():
        findings.append(_compare_rest(plant, first, rest, x, plant.asked(x)))
    for first, rest in claimed.saturated.items():
        flow = Flow(plant, _held(claimed, first))
        held = _find_held(flow, x, rest)
        applied = numpy.where(flow.held == 0, plant.asked(held), flow.held * numpy.where(flow.held, plant.limits, 0.0))
        findings.append(_compare_rest(plant, f"{first}, at limits", rest, held, applied))
    return [*findings, *_compare_state(claimed, x)]


def _compare_rest(plant: Plant, where: str, rest: Rest, x: Array, applied: Array) -> Finding:
    """A proved equilibrium against a state, and what inverters apply there."""
    sizes = natural_sizes(plant, x)
    radius = rest.radius / float(sizes[: 2 * len(plant.nodes)].max(initial=1.0))
    volts, constant = plant.voltages
    own = dict(zip(plant.nodes, (volts @ x + constant).reshape(-1, 2), strict=True))
    pairs = [(complex(*own[name]), V, _size(plant, sizes, name)) for name, V in rest.voltages.items()]
    for kind, values in (("line", rest.lines), ("current", rest.inverters)):
        at = {name: plant.slices[kind, name] for name in values}
        pairs += [(complex(*x[at[name]]), value, float(sizes[at[name]].max())) for name, value in values.items()]
    asked = dict(zip(plant.inverters, applied.reshape(-1, 2), strict=True))
    pairs += [
        (complex(*asked[name]), u, max(abs(u), _size(plant, sizes, name)))
        for name, u in rest.terminals.items()
        if name in asked
    ]
    off = numpy.array([abs(a - b) / size for a, b, size in pairs])
    return Finding("equilibrium", where, float(off.max()), AT_REST + radius)  # numpy's max keeps what is no number


def _held(claimed: Claimed, first: str) -> Array:
    """All inverters of an island that have limits at them, as their references point; without feedback none is."""
    plant, held = claimed.plant, numpy.zeros(len(claimed.plant.limits))
    for j, name in enumerate(plant.inverters):
        dgu = claimed.context.nodes[name].dgu
        if (
            name in claimed.island(first)
            and dgu
            and dgu.limits_volt
            and not isinstance(dgu.controller, ConstantVoltage)
        ):
            held[2 * j : 2 * j + 2] = numpy.sign([float(v) for v in dgu.reference_volt])
    return held


def _find_held(flow: Flow, x: Array, rest: Rest) -> Array:
    """Where everything but integrators rests, by Newton's method from a proved equilibrium and else from a state."""
    plant, y = flow.plant, x.copy()
    for kind, values in (("voltage", rest.voltages), ("line", rest.lines), ("current", rest.inverters)):
        for name, value in values.items():
            if (kind, name) in plant.slices:
                y[plant.slices[kind, name]] = value.real, value.imag
    kept = numpy.ones(plant.size, dtype=bool)
    for j, name in enumerate(plant.inverters):
        if ("integrator", name) in plant.slices and flow.held[2 * j]:
            kept[plant.slices["integrator", name]] = False
    for _ in range(HELD_STEPS):
        try:
            step = splu(csc_matrix(flow.jacobian(y)[kept][:, kept])).solve(flow.rates(y)[kept])
        except (RuntimeError, ValueError):  # singular, or not finite
            return numpy.full(plant.size, numpy.nan)
        y[kept] -= step
    return y


def _compare_state(claimed: Claimed, x: Array) -> list[Finding]:
    """How far what the simulator takes for the proved equilibrium is from rest, if all of it is proved."""
    plant, rests = claimed.plant, claimed.rests.values()
    voltages = {name: V for rest in rests for name, V in rest.voltages.items()}
    if voltages.keys() != plant.nodes.keys():
        return []
    lines = {name: current for rest in rests for name, current in rest.lines.items()}
    inverters = {name: current for rest in rests for name, current in rest.inverters.items()}
    flow, sizes = free_flow(plant), natural_sizes(plant, x)
    try:
        put = plant.at_rest(voltages, lines, inverters)
        step = splu(csc_matrix(flow.jacobian(put))).solve(flow.rates(put))
    except (numpy.linalg.LinAlgError, RuntimeError):  # an integral gain, or the whole, is singular
        return []
    radius = max(rest.radius for rest in rests) / float(sizes[: 2 * len(plant.nodes)].max(initial=1.0))
    return [Finding("equilibrium", "all states", float(numpy.abs(step / sizes).max()), AT_REST + 1e2 * radius)]


def _size(plant: Plant, sizes: Array, name: str) -> float:
    """The size of a node's voltage, in volt."""
    if name in plant.loops:
        return float(numpy.linalg.norm(plant.loops[name].reference))
    return float(sizes[plant.slices["voltage", name]].max())
