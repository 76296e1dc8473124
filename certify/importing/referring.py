"""Transformers taken out: all voltages, currents and impedances referred to one side, exactly.

With a factor n and an angle phi for each bus, `V' = n e^(j phi) V` and `I' = e^(j phi) I / n` make every ideal ratio
one: powers stay what they are, impedances become `n^2 Z`, capacitances `C / n^2`. That is possible iff the ratios
multiply to one and the shifts add up to zero around every loop. A network for which they do not, such as one with a
phase shifter in a mesh, is refused.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass, replace
from fractions import Fraction

from certify.importing.names import comment
from certify.importing.network import Branch, Network
from certify.importing.numbers import quantity
from certify.kernel.errors import Fault, SpecError

ONE = Fraction(1)


@dataclass(frozen=True)
class Level:
    """Buses between which there is no transformer: how they are referred. `factor` is n, `angle_degree` phi."""

    nominal_volt: Fraction
    factor: Fraction
    angle_degree: Fraction
    buses: tuple[str, ...]

    @property
    def referred_volt(self) -> Fraction:
        return self.nominal_volt * self.factor


def refer(network: Network) -> tuple[Network, tuple[Level, ...], Fraction]:
    """The network without ideal ratios, the levels that there were, and the base voltage.

    The side that the others are referred to is that of the DGUs, if they are all on one, else that of the most buses.
    Raises: SpecError I023 if ratios or shifts around a loop contradict each other.
    """
    levels = _levels(network)
    level_of = {name: k for k, names in enumerate(levels) for name in names}
    nominal = {bus.name: bus.nominal_volt for bus in network.buses}
    own = [Counter(nominal[name] for name in names).most_common(1)[0][0] for names in levels]
    with_dgu = Counter(level_of[source.bus] for source in network.sources)
    ranks = sorted(range(len(levels)), key=lambda k: (-(len(with_dgu) == 1 and k in with_dgu), -len(levels[k]), k))
    base = own[ranks[0]]
    # Another island has a side of its own; one of the same voltage, if there is one.
    first = ranks[0]
    ranks.sort(key=lambda k: (k != first, own[k] != base))
    factor: dict[int, tuple[Fraction, Fraction]] = {}
    edges: dict[int, list[tuple[int, Fraction, Fraction, Branch]]] = defaultdict(list)
    for branch in network.branches:
        a, b = level_of[branch.start], level_of[branch.end]
        edges[a].append((b, branch.ratio, branch.shift_degree, branch))
        edges[b].append((a, 1 / branch.ratio, -branch.shift_degree, branch))
    faults: dict[str, Fault] = {}
    for start in ranks:
        if start in factor:
            continue
        factor[start] = (ONE, Fraction(0))
        waiting = [start]
        while waiting:
            here = waiting.pop(0)
            n, angle = factor[here]
            for there, ratio, shift, branch in edges[here]:
                expected = (n * ratio, (angle + shift) % 360)
                if there not in factor:
                    factor[there] = expected
                    waiting.append(there)
                elif factor[there] != expected:
                    where = branch.origins[0] if branch.origins else branch.name
                    faults.setdefault(where, Fault("I023", where, _contradiction(expected, factor[there])))
    if faults:
        raise SpecError(tuple(faults.values()))
    referred = _referred(network, {name: factor[k] for name, k in level_of.items()})
    listed = [Level(own[k], *factor[k], names) for k, names in enumerate(levels)]
    return referred, tuple(listed), base


def _contradiction(one: tuple[Fraction, Fraction], other: tuple[Fraction, Fraction]) -> str:
    ratio, shift = float(one[0] / other[0]), float((one[1] - other[1] + 180) % 360 - 180)
    return f"around a loop through it the ratios multiply to {ratio:.9g} and the shifts add up to {shift:.9g} degrees"


def _levels(network: Network) -> list[tuple[str, ...]]:
    """Groups of buses joined by branches without a ratio or shift, in the order of the buses."""
    parent = {bus.name: bus.name for bus in network.buses}

    def root(name: str) -> str:
        while parent[name] != name:
            parent[name] = parent[parent[name]]
            name = parent[name]
        return name

    for branch in network.branches:
        if branch.ratio == 1 and not branch.shift_degree % 360:
            parent[root(branch.end)] = root(branch.start)
    groups: dict[str, list[str]] = {}
    for bus in network.buses:
        groups.setdefault(root(bus.name), []).append(bus.name)
    return [tuple(names) for names in groups.values()]


def _referred(network: Network, factor: dict[str, tuple[Fraction, Fraction]]) -> Network:
    def branch_of(branch: Branch) -> Branch:
        square = factor[branch.end][0] ** 2  # its values are those of its end's side
        g, b = branch.shunt_siemens
        return replace(
            branch,
            resistance_ohm=branch.resistance_ohm * square,
            inductance_henry=branch.inductance_henry * square,
            capacitance_farad=branch.capacitance_farad / square,
            shunt_siemens=(g / square, b / square),
            ratio=ONE,
            shift_degree=Fraction(0),
        )

    angles = [s.angle_degree + factor[s.bus][1] for s in network.sources if s.angle_degree is not None]
    return replace(
        network,
        buses=tuple(
            replace(
                bus,
                nominal_volt=bus.nominal_volt * factor[bus.name][0],
                capacitance_farad=bus.capacitance_farad / factor[bus.name][0] ** 2,
            )
            for bus in network.buses
        ),
        branches=tuple(map(branch_of, network.branches)),
        loads=tuple(replace(load, nominal_volt=load.nominal_volt * factor[load.bus][0]) for load in network.loads),
        # Only differences of angles mean anything: the first one that is stated becomes zero.
        sources=tuple(
            replace(s, angle_degree=None)
            if s.angle_degree is None
            else replace(s, angle_degree=(s.angle_degree + factor[s.bus][1] - angles[0]) % 360)
            for s in network.sources
        ),
    )


def describe(levels: tuple[Level, ...]) -> list[str]:
    """One line for each level that was referred: from which voltage, by which factor."""
    lines = []
    for level in levels:
        if level.factor != 1 or level.angle_degree:
            names = ", ".join(level.buses[:4]) + (f" and {len(level.buses) - 4} more" if level.buses[4:] else "")
            lines.append(
                comment(
                    f"{quantity(level.nominal_volt, 'V')} level ({names}): V' = n V, n = {float(level.factor):.12g}, "
                    f"turned by {float(level.angle_degree):g} degrees; nominal there is now "
                    f"{float(level.referred_volt / 1000):.12g} kV"
                )
            )
    return lines
