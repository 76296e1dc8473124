"""The equilibrium of an island: that it exists, where, and that no other one has its loads in their bands (THEORY 8).

Nodes that an integral action holds at the reference are given; the others solve E(V) = Y V + j w0 C V + I_load(V) +
sources = 0. Everything is enclosed in balls, so tolerances are covered too: then the statement holds for all values.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from math import isqrt

from certify.kernel import currents, load_proofs, loads
from certify.kernel import linalg as la
from certify.kernel.balls import BITS, NOTHING, Ball, ball, box, centre, lower, total, upper, value
from certify.kernel.claims import Context, Fact, Rest, held_at_limits
from certify.kernel.data import Data
from certify.kernel.errors import require
from certify.kernel.linalg import ZERO
from certify.kernel.model import Pieces, PowerTerm
from certify.kernel.powers import PRECISIONS, Interval
from certify.kernel.reader import Pair
from certify.kernel.spec import ConstantVoltage, Filter, LinearLoop, SeriesBranch, integrates

MAX_SIZE = Fraction(10) ** 60  # of any number of a proof
MAX_VOLTAGE_DIGITS = 80  # of the numbers of a proof, so that enclosures stay quick


@dataclass(frozen=True)
class Island:
    """What holds an island: voltages that are given, and sources behind an admittance in siemens (THEORY 8)."""

    names: tuple[str, ...]
    fixed: dict[str, Pair]
    sources: dict[str, tuple[Pair, Ball]]
    free: tuple[str, ...]


def regulates(context: Context, name: str) -> bool:
    """Whether the DGU at a node is at rest only where its voltage is the reference: with integral action, or alike."""
    dgu = context.nodes[name].dgu
    if dgu and isinstance(dgu.controller, LinearLoop):
        return _rest_impedance(context, dgu.controller) == (ZERO, ZERO)
    return dgu is not None and integrates(dgu.controller)


def _rest_impedance(context: Context, loop: LinearLoop) -> Pair | None:
    """-C F^-1 B, what a current into a linear loop at rest changes of its voltage, if that is a complex impedance."""

    def solved() -> Pair | None:
        try:
            (a, b), (c, d) = la.scale(-1, la.multiply(loop.C, la.solve(loop.F, loop.B)))
        except ZeroDivisionError:
            return None
        return (a, c) if (a, b) == (d, -c) else None

    impedance: Pair | None = context.once(("rest", loop), solved)
    return impedance


def describe(context: Context, names: tuple[str, ...], saturated: bool = False) -> Island:
    """What is given on an island; `saturated`: with all inverters that have limits held at them."""
    fixed: dict[str, Pair] = {}
    sources: dict[str, tuple[Pair, Ball]] = {}
    held = held_at_limits(context, names) if saturated else {}
    for name in names:
        dgu = context.nodes[name].dgu
        if dgu is None:
            continue
        if dgu.filter and (name in held or isinstance(dgu.controller, ConstantVoltage)):
            sources[name] = held.get(name, dgu.reference_volt), admittance(context, dgu.filter)
        elif regulates(context, name):
            fixed[name] = dgu.reference_volt
        else:
            loop = dgu.controller
            impedance = _rest_impedance(context, loop) if isinstance(loop, LinearLoop) else None
            require(impedance is not None, f"nothing says where the voltage of node {name} comes to rest")
            sources[name] = dgu.reference_volt, ball(impedance or (ZERO, ZERO)).inverse()
    return Island(names, fixed, sources, tuple(name for name in names if name not in fixed))


# --- parts of the network, each in a ball ----------------------------------------------------------------------


def _impedance(context: Context, branch: SeriesBranch | Filter) -> Ball:
    """R + j w0 L in ohm, for all values within the tolerances."""
    parts = (branch.resistance_ohm, context.grid.w0 * branch.inductance_henry)
    R, X = ((x * (1 - share), x * (1 + share)) for x, share in zip(parts, branch.tolerance, strict=False))
    return box(R, X)


def admittance(context: Context, branch: SeriesBranch | Filter) -> Ball:
    """1 / (R + j w0 L) in siemens."""
    key = ("admittance", branch.resistance_ohm, branch.inductance_henry, branch.tolerance[:2])
    result: Ball = context.once(key, lambda: _impedance(context, branch).inverse())
    return result


def susceptance(context: Context, name: str) -> Ball:
    """j w0 C of the capacitance at a node, without what is inside a linear loop."""
    dgu = context.nodes[name].dgu
    inner = dgu.filter.capacitance_farad if dgu and dgu.filter and isinstance(dgu.controller, LinearLoop) else ZERO
    low, high = (context.grid.w0 * (context.capacitances[sign][name] - inner) for sign in "-+")
    return box((ZERO, ZERO), (low, high))


def moduli_between(V: Ball) -> Interval:
    """Bounds of |V| over a ball."""
    size = isqrt(V.x * V.x + V.y * V.y)
    return value(max(size - V.r, 0)), value(size + 1 + V.r)


Parts = loads.Parts


def _laws(pieces: Pieces, volts: Interval) -> Iterator[tuple[Parts, Parts]]:
    """For each piece of a band that the voltages meet: the admittances of its active and reactive terms there."""
    for (low, high), law in pieces:
        a, b = max(low, volts[0]), min(high, volts[1])
        if a > b:
            continue
        sides = []
        for terms in (law.active, law.reactive):
            wide = [PowerTerm(t.coefficient, t.base_volt, t.exponent, ZERO, t.spread + t.blur) for t in terms]
            ends = (loads.admittances(wide, v, PRECISIONS[0]) for v in (a, b))
            sides.append([(e, (min(x[0], y[0]), max(x[1], y[1]))) for (e, x), (_, y) in zip(*ends, strict=True)])
        yield sides[0], sides[1]


def load_current(context: Context, name: str, V: Ball) -> Ball:
    """The current of all static loads at a node, for all voltages of a ball, which has to lie in the band."""
    node = context.nodes[name]
    if not node.has_static_load:
        return NOTHING
    if node.current is not None:
        law, _, _ = context.disk(name)
        at = centre(V)
        q = currents.evaluate(law.denominator, at)
        require(q != 0, "the current of a load has a pole at the voltage")
        d, q_ = (currents.evaluate(p, at) / q for p in law.numerators)
        return ball((d, q_)).widened((V.r * upper(load_proofs.lipschitz(context, name)) >> BITS) + 1)
    laws = list(_laws(context.pieces(name), moduli_between(V)))
    G, X = ([loads.total(law[part]) for law in laws] for part in (0, 1))
    Y = box(*((min(x[0] for x in side), max(x[1] for x in side)) for side in (G, X)))
    return V * Ball(Y.x, -Y.y, Y.r)  # Y = G - j X, X = Q / v^2


def load_modulus(context: Context, name: str, factor: Pair, V: Ball) -> int:
    """A lower bound of Re <e, factor I'(V) e> / |e|^2 over all voltages of a ball and all e, in units of siemens.

    With y the admittance and p the exponent of each term, I' e = a e + b u^2 conj(e), |u| = 1, a = sum (p/2) y,
    b = sum (p/2 - 1) y; so it is at least Re(factor a) - |factor| |b|.
    """
    node = context.nodes[name]
    if not node.has_static_load:
        return 0
    if node.current is not None:
        # convex: what is proved about the disk holds between any two voltages of it
        require(factor == (la.ONE, ZERO), "a load given by its current takes no other factor than 1")
        require(context.status.get(f"load/{name}") == "proved", f"the load at node {name} is not proved")
        return lower(context.moduli.get(name, ZERO))
    c, s = factor
    length = ball(factor).largest()
    result = []
    for active, reactive in _laws(context.pieces(name), moduli_between(V)):
        factors = [x * e / 2 for x, part in ((c, active), (s, reactive)) for e, _ in part]
        straight = loads.total([*active, *reactive], factors)
        turned = [loads.total(part, [e / 2 - 1 for e, _ in part]) for part in (active, reactive)]
        result.append(lower(straight[0]) - (length * box(turned[0], turned[1]).largest() >> BITS) - 1)
    return min(result)


# --- the rule -----------------------------------------------------------------------------------------------------


def strong_monotonicity(context: Context, island: Island, data: Data) -> tuple[dict[str, Ball], Fraction]:
    """Rule `strong-monotonicity`: the voltages of all nodes in balls, and the radius of the largest of these.

    With a factor f, a size d_i in volt for each free node, and rho: where every free node is within rho d_i of the
    voltages given, f d_i E_i is strongly monotone in V_i / d_i with modulus mu, and |f d_i E_i| <= mu rho; so E has
    exactly one zero there, and it is nearer than rho = |f d_i E_i| / mu. mu comes from positive weights p:
    d_i^2 (A p)_i >= mu p_i, A having the Re(f y) of the lines off its diagonal.
    """
    factor, rho, volts, weights, sizes = _read(island, data)
    length = ball(factor).largest()
    V = {name: ball(x) for name, x in (island.fixed | volts).items()}
    for name in island.fixed:
        _require_inside(context, name, V[name])
    near = {name: V[name].widened(upper(rho * sizes[name])) for name in island.free}
    residual, mu = 0, None  # |f d E|^2 in units squared
    for name in island.free:
        _require_inside(context, name, near[name])
        own, current = _shunts(context, island, name, V[name])
        diagonal = _real(factor, own)[0] + load_modulus(context, name, factor, near[name])
        row = diagonal * weights[name]  # of A p, in units squared
        for line in context.lines_at[name]:
            other = line.end if line.start == name else line.start
            y = admittance(context, line.branch)
            current = current + y * (V[name] - V[other])
            low, high = _real(factor, y)
            require(low >= 0 or other in island.fixed, f"the factor makes line {line.name} an active one")
            step = weights[name] - weights.get(other, 0)
            row += min(low * step, high * step)
        residual += (sizes[name] * ((current.largest() * length >> BITS) + 1)).__ceil__() ** 2
        least = sizes[name] ** 2 * (row // weights[name])
        mu = least if mu is None else min(mu, least)
    if mu is None:
        return V, value(max(z.r for z in V.values()))
    require(mu > 0, "the equations are not shown to be strongly monotone around these voltages")
    radius = value(upper((isqrt(residual) + 1) / mu))
    require(radius <= rho, "the voltages are too far from an equilibrium for what is shown")
    exact = {name: V[name].widened(upper(radius * sizes[name])) for name in island.free}
    return V | exact, value(max(z.r for z in exact.values()))


def _read(island: Island, data: Data) -> tuple[Pair, Fraction, dict[str, Pair], dict[str, int], dict[str, Fraction]]:
    """Factor, rho, and for each free node its voltage, its weight in units and its size."""
    parts = data.fields("factor", "radius", "voltages", "weights")
    require(data.size() <= MAX_VOLTAGE_DIGITS * (4 * len(island.free) + 10), "the numbers have too many digits")
    factor, rho = parts[0].vector(), parts[1].scalar()
    volts, weights = ([x.vector() for x in part.items()] for part in parts[2:])
    sane = all(abs(x) <= MAX_SIZE for part in ((rho,), factor, *volts, *weights) for x in part)
    require(sane, "a number of the proof is absurdly large")
    require(len(factor) == 2 and any(factor) and rho > 0, "the factor or the radius is zero")
    require(len(volts) == len(weights) == len(island.free), "not one voltage and one weight for each free node")
    require(all(len(x) == 2 for x in (*volts, *weights)), "a voltage has two components, a weight has a size")
    require(all(lower(x[0]) > 0 and x[1] > 0 for x in weights), "a weight or a size is not positive")
    return (
        (factor[0], factor[1]),
        rho,
        {name: (x[0], x[1]) for name, x in zip(island.free, volts, strict=True)},
        {name: lower(x[0]) for name, x in zip(island.free, weights, strict=True)},
        {name: x[1] for name, x in zip(island.free, weights, strict=True)},
    )


def _real(factor: Pair, z: Ball) -> tuple[int, int]:
    """Bounds of Re(factor z), in units."""
    product = ball(factor) * z
    return product.x - product.r, product.x + product.r


def _shunts(context: Context, island: Island, name: str, V: Ball) -> tuple[Ball, Ball]:
    """What is at a free node besides lines: its linear admittance, and the current of all of it at V."""
    node = context.nodes[name]
    linear = [susceptance(context, name), *(admittance(context, branch) for branch in node.branches)]
    current = load_current(context, name, V)
    if name in island.sources:
        u, y = island.sources[name]
        linear.append(y)
        current = current - y * ball(u)
    own = total(linear)
    return own, current + own * V


def margin(context: Context, name: str, V: Ball) -> tuple[int | None, int | None] | None:
    """How far the voltages of a ball stay from the lower and the upper end of the claim on the loads of a node.

    In units of volt; None for an end that is no bound, and for a node without static load.
    """
    node = context.nodes[name]
    if node.current is not None:
        away = (V - ball(node.current.centre_volt)).largest()
        return None, lower(node.current.radius_volt) - away
    if node.band_volt is None:
        return None
    low, high = node.band_volt
    between = moduli_between(V)
    return lower(between[0] - low) if low else None, lower(high - between[1])


def _require_inside(context: Context, name: str, V: Ball) -> None:
    ends = margin(context, name, V) or ()
    inside = all(x is None or x > 0 for x in ends)
    require(inside, f"the load at node {name} is not shown to be strictly inside its band")


@dataclass(frozen=True)
class Flow:
    """Voltages in volt and currents in ampere, each in a ball; by node, by line, or by the node of an inverter."""

    voltages: dict[str, Ball]
    lines: dict[str, Ball]
    inverters: dict[str, Ball]
    terminals: dict[str, Ball]


def flow(context: Context, island: Island, V: dict[str, Ball]) -> Flow:
    """What flows at an equilibrium of which the voltages are known."""
    lines: dict[str, Ball] = {}
    inverters, terminals = {}, {}
    for name in island.names:
        for line in context.lines_at[name]:
            if line.name not in lines:
                lines[line.name] = admittance(context, line.branch) * (V[line.start] - V[line.end])
    for name in island.names:
        dgu = context.nodes[name].dgu
        if dgu is None or dgu.filter is None or isinstance(dgu.controller, LinearLoop):
            continue
        if name in island.sources:
            u, y = island.sources[name]
            terminals[name], inverters[name] = ball(u), y * (ball(u) - V[name])
        else:
            shunts = (susceptance(context, name), *(admittance(context, b) for b in context.nodes[name].branches))
            out = [lines[x.name] if x.start == name else NOTHING - lines[x.name] for x in context.lines_at[name]]
            inverters[name] = total([load_current(context, name, V[name]), total(shunts) * V[name], *out])
            terminals[name] = V[name] + _impedance(context, dgu.filter) * inverters[name]
    return Flow(V, lines, inverters, terminals)


def beyond_limits(context: Context, island: Island, flow: Flow) -> dict[str, bool | None]:
    """For each inverter with limits: whether its terminal voltage is beyond one; None if that is not known."""
    result: dict[str, bool | None] = {}
    for name in island.names:
        dgu = context.nodes[name].dgu
        if dgu is None or dgu.limits_volt is None:
            continue
        if name not in flow.terminals:
            result[name] = None
            continue
        u = flow.terminals[name]
        ends = [(abs(x) - u.r, abs(x) + u.r, limit) for x, limit in zip(u[:2], dgu.limits_volt, strict=True)]
        if any(low > upper(limit) for low, _, limit in ends):
            result[name] = True
        else:
            result[name] = False if all(high < lower(limit) for _, high, limit in ends) else None
    return result


def is_only_one(context: Context, island: Island) -> bool:
    """Whether no other equilibrium has all load voltages in their bands (given the claims on the loads).

    The difference of two is V~ with 0 = sum Re <V~, y V~> + <V~, I_load~>, of terms that are not negative; lines have
    R > 0, so V~ is the same at all nodes, and it is zero where it is given or a source has Re y > 0.
    """
    sources = [island.sources[name][1] for name in island.sources]
    held = bool(island.fixed) or any(y.x > y.r for y in sources)
    loaded = (name for name in island.free if context.nodes[name].has_static_load)
    passive = all(y.x > y.r or _is_lossless(context, name) for name, (_, y) in island.sources.items())
    return held and passive and all(context.status.get(f"load/{name}") == "proved" for name in loaded)


def _is_lossless(context: Context, name: str) -> bool:
    """Whether a source is a filter without resistance: Re y = 0, which enclosures do not tell."""
    dgu = context.nodes[name].dgu
    return dgu is not None and not isinstance(dgu.controller, LinearLoop) and dgu.filter is not None


# --- handlers -----------------------------------------------------------------------------------------------------


def equilibrium(
    only_one: bool, saturated: bool, context: Context, names: tuple[str, ...], data: Data
) -> tuple[Fact, ...]:
    """The handler of `strong-monotonicity` and `local-monotonicity`.

    `only_one`: no other equilibrium has its loads in their bands; `saturated`: all inverters with limits are at them.
    """
    island = describe(context, names, saturated)
    require(not only_one or is_only_one(context, island), "other equilibria are not excluded")
    V, radius = strong_monotonicity(context, island, data)
    found = flow(context, island, V)
    if not saturated:
        near = [name for name, beyond in beyond_limits(context, island, found).items() if beyond is not False]
        require(not near, f"the inverter at node {', '.join(near[:3])} is not shown to stay inside its limits")
        context.equilibria[names[0]] = Rest(found.voltages, found.terminals)
    return _facts(island, V, radius, found)


def limits_exceeded(context: Context, names: tuple[str, ...], data: Data) -> tuple[Fact, ...]:
    """Rule `limits-exceeded`: the only equilibrium with all loads in their bands needs more than inverters can give."""
    island = describe(context, names)
    require(is_only_one(context, island), "another equilibrium is not excluded")
    V, _ = strong_monotonicity(context, island, data)
    found = flow(context, island, V)
    facts: list[Fact] = []
    for name, beyond in beyond_limits(context, island, found).items():
        dgu = context.nodes[name].dgu
        if beyond and dgu and dgu.limits_volt:
            error = value(found.terminals[name].r)
            for axis, u, limit in zip("dq", centre(found.terminals[name]), dgu.limits_volt, strict=True):
                if abs(u) - error > limit:
                    facts.append((f"terminal voltage of the DGU at node {name}, {axis}", u, "V"))
                    facts.append((f"its limit, {axis}", limit, "V"))
    require(bool(facts), "no inverter is shown to need more than its limits")
    return tuple(facts)


def reference_outside(context: Context, names: tuple[str, ...], data: Data) -> tuple[Fact, ...]:
    """Rule `reference-outside-band`: a DGU keeps the voltage of its own load out of the band of the load's claim."""
    at = data.fields("at")[0].text()
    require(at in names and regulates(context, at), "nothing makes the voltage of that node its reference at rest")
    node = context.nodes[at]
    V = describe(context, (at,)).fixed[at]
    size = sum(x * x for x in V)
    if node.current is not None:
        radius = node.current.radius_volt
        away = sum((x - y) ** 2 for x, y in zip(V, node.current.centre_volt, strict=True))
        require(away >= radius**2, "the reference is inside the disk of the load")
        ends: tuple[Fact, ...] = (("radius of the disk of its load", radius, "V"),)
    else:
        require(node.band_volt is not None, "there is no static load at that node")
        low, high = node.band_volt or (ZERO, ZERO)
        require(size >= high**2 or bool(low and size <= low**2), "the reference is inside the band of the load")
        ends = (("lower end of the band of its load", low, "V"), ("upper end", high, "V"))
    modulus = value(isqrt(lower(Fraction(size)) << BITS))
    return ((f"modulus of the reference at node {at}", modulus, "V"), *ends)


def _facts(island: Island, V: dict[str, Ball], radius: Fraction, found: Flow) -> tuple[Fact, ...]:
    def parts(what: str, z: Ball, unit: str) -> Iterator[Fact]:
        return ((f"{what}, {axis}", x, unit) for axis, x in zip("dq", centre(z), strict=True))

    facts: list[Fact] = [("radius of the proof", radius, "V")]
    errors = [z.r for part in (found.lines, found.inverters, found.terminals) for z in part.values()]
    facts.append(("radius of the currents and terminal voltages, in A and V", value(max(errors, default=0)), ""))
    for name in island.names:
        facts += parts(f"voltage at node {name}", V[name], "V")
    for name, z in found.lines.items():
        facts += parts(f"current in line {name}", z, "A")
    for name in found.inverters:
        facts += parts(f"current of the DGU at node {name}", found.inverters[name], "A")
        facts += parts(f"terminal voltage of the DGU at node {name}", found.terminals[name], "V")
    return tuple(facts)
