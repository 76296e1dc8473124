"""Small microgrids that between them exercise every term of the model: controllers, loops, loads, limits, tolerances.

Nothing is symmetric in d and q, nor equal at two places, as far as it need not be: so that no two signs make up for
each other.
"""

from __future__ import annotations

from typing import Any

from tests.simulation_cases import CONTROLLERS

Table = dict[str, Any]

# States to compare at: what is taken off the state at rest, as a share of it, and how far random states are from there,
# in their natural sizes. The first is below the cut-offs of loads, at the second a motion begins.
OFFSETS = ((0.38, 0.05), (0.0, 0.01))
MOTION_SECOND = 0.01
# The numbers that R-L loads have among those of a whole scenario, by spec and node.
NUMBERS: dict[str, dict[str, list[str]]] = {"open": {"b": ["7"]}}

OWN: Table = CONTROLLERS["own"]
COMMON: Table = {
    "format": "certify/microgrid@1",
    "frequency": "50 Hz",
    "base_voltage": "400 V",
    "voltage_band": ["0.5 pu", "1.5 pu"],
    "filter": {
        "lc": {"R": "0.1 ohm", "L": "1.8 mH", "C": "25 uF"},
        "big": {"R": "0.08 ohm", "L": "2.5 mH", "C": "30 uF"},
    },
    "controller": {
        "phs": {"kind": "ida-pbc", "alpha": [-4, -6], "nu": [1, "1.5"], "ki": [80, 150]},
        "off": {
            "kind": "ida-pbc",
            "alpha": [-5, -3],
            "nu": ["1.2", "0.9"],
            "ki": [60, 90],
            "design": {"R": "0.13 ohm", "L": "2.05 mH", "C": "22 uF", "frequency": "49.5 Hz"},
        },
        "full": {
            "kind": "state-feedback",
            "K11": [["-0.18", "-0.236"], ["-0.336", "-0.07"]],
            "K12": [["-4.9", "0.4345"], ["-0.9345", "-3.9"]],
            "K13": [[480, -50], [230, 630]],
        },
        "plain": {  # without an integrator
            "kind": "state-feedback",
            "K11": [["0.9", "0.05"], ["-0.02", "0.8"]],
            "K12": [["-1.5", "0.2"], ["-0.1", -2]],
        },
        "held": {"kind": "constant"},
        "own": OWN,
        "short": {**OWN, "B": [["1/c", "0.001/c"], [0, "1/c"], [0, 0], [0, 0], [0, 0], [0, 0]]},
        "skew": {
            **OWN,
            "B": [["1.1/c", "0.1/c"], ["-0.2/c", "0.9/c"], [2, 1], [0, 3], [0, 0], [1, 0]],
            "C": [[1, "0.1", 0, 0, "0.01", 0], ["-0.2", "0.9", 0, "0.02", 0, 0]],
        },
    },
}
RL: Table = {"kind": "rl", "R": "50 ohm", "L": "90 mH"}
RL2: Table = {"kind": "rl", "R": "80 ohm", "L": "20 mH"}
ZIP: Table = {"kind": "zip", "Y": ["8 mS", "3 mS"], "I": ["1.2 A", "0.4 A"], "P": ["60 W", "35 var"]}
ZIP2: Table = {"kind": "zip", "Y": ["3 mS", "-1 mS"], "I": ["2 A", "0.1 A"], "P": ["20 W", "15 var"]}
SOURCE: Table = {"kind": "zip", "Y": ["9 mS", "-2 mS"], "I": ["1.1 A", "-0.4 A"], "P": ["-20 W", "15 var"]}
EXP: Table = {"kind": "exp", "P0": "700 W", "np": "1.6", "Q0": "310 var", "nq": "2.3"}
CURRENT: Table = {
    "kind": "current",
    "I": ["Vd/40 + Vd^3/(2e7) + 3", "Vq/60 - 5"],
    "centre": ["0.97 pu", "0.21 pu"],
    "radius": "0.15 pu",
}
RATIONAL = [
    "Vd/40 + Vq/200 + Vd*Vq/(4e5) + 3",
    "Vq/60/(1 + Vd^2/640000 + Vd/5000 + Vq/4000) - Vd/300 - 5",
]


def cut(load: Table, low: str, **more: Any) -> Table:
    """A load that is an impedance below a voltage."""
    return {**load, "band": [low, "1.3 pu"], "below": "constant-impedance", **more}


def dgu(controller: str, filter_: str | None, d: str = "0.97", q: str = "0.21", **more: Any) -> Table:
    own = {"controller": controller, "reference": [f"{d} pu", f"{q} pu"], **more}
    return {"dgu": own | ({"filter": filter_} if filter_ else {})}


def limited(controller: str, filter_: str, d: str, q: str, *limits: str) -> Table:
    return dgu(controller, filter_, d, q, limits=list(limits), anti_windup="15 ms")


def line(start: str, end: str, resistance: str, henry: str, farad: str = "20 nF") -> Table:
    return {"name": f"{start}{end}", "from": start, "to": end, "R": resistance, "L": henry, "C": farad}


def spec(nodes: Table, *lines: Table, **more: Any) -> Table:
    """Only the filters and controllers that are used."""
    own = [node["dgu"] for node in nodes.values() if "dgu" in node]
    parts = {
        kind: {name: COMMON[kind][name] for name in {x[kind]: None for x in own if kind in x}}
        for kind in ("filter", "controller")
    }
    return {**COMMON, **parts, "node": nodes, "line": list(lines), **more}


SPECS: dict[str, Table] = {
    "open": spec(
        {
            "a": {**dgu("held", "lc"), "load": [SOURCE], "capacitance": "1 uF"},
            "b": {"load": [RL], "capacitance": "2 uF"},
        },
        line("b", "a", "0.3 ohm", "0.7 mH"),
    ),
    "plain": spec({"a": dgu("plain", "lc")}),
    "loop": spec(
        {
            "a": {**dgu("own", "big"), "load": [ZIP], "capacitance": "1 uF"},
            "b": {"load": [RL, ZIP], "capacitance": "2 uF"},
        },
        line("b", "a", "0.3 ohm", "0.7 mH"),
    ),
    "loops": spec(
        {
            "a": {**dgu("own", "big"), "load": [ZIP], "capacitance": "1 uF"},
            "c": {**dgu("skew", None), "load": [RL, EXP], "capacitance": "30 uF"},
        },
        line("a", "c", "0.3 ohm", "0.7 mH"),
    ),
    "short": spec(
        {"a": {**dgu("short", None), "load": [ZIP]}, "b": {"load": [RL2], "capacitance": "2 uF"}},
        line("a", "b", "0.3 ohm", "0.7 mH"),
    ),
    "current": spec(
        {
            "a": {**dgu("phs", "lc"), "load": [CURRENT, {**ZIP, "I": ["0 A", "0 A"]}]},
            "b": {"load": [RL], "capacitance": "2 uF"},
        },
        line("b", "a", "0.3 ohm", "0.7 mH", "1 uF"),
        line_legs="neglected at DGUs",
    ),
    "rational": spec({"a": {**dgu("phs", "lc"), "load": [{**CURRENT, "I": RATIONAL}, {"kind": "zip", "Y": ZIP["Y"]}]}}),
    "limits": spec(
        {
            "a": {**limited("phs", "lc", "-0.6", "0.71", "250 V", "300 V"), "load": [RL2]},
            "b": {**limited("full", "big", "-0.62", "0.7", "260 V", "310 V"), "load": [RL]},
            "c": limited("phs", "lc", "0.6", "-0.71", "250 V", "300 V"),
            "h": dgu("held", "lc", "0.6", "-0.71", limits=["250 V", "300 V"]),
        },
        line("b", "a", "0.3 ohm", "0.7 mH"),
        line("h", "c", "0.3 ohm", "0.7 mH"),
    ),
    "box": spec(
        {"a": {**dgu("phs", "lc"), "load": [ZIP, EXP]}, "b": {"load": [RL], "capacitance": "2 uF"}},
        line("b", "a", "0.3 ohm", "0.7 mH", "1 uF"),
        tolerance="1 %",
    ),
    "inverters": spec(
        {
            "a": {**dgu("off", "lc"), "load": [EXP], "capacitance": "1 uF"},
            "b": {
                "load": [
                    *(ZIP, RL, cut(EXP, "0.7 pu", np="1.4", nq="0.8"), RL2, cut(ZIP2, "0.8 pu")),
                    {**EXP, "np": 1, "nq": 3},
                ],
                "capacitance": "2 uF",
            },
            "c": {**limited("full", "big", "0.95", "0.25", "600 V", "400 V"), "load": [RL]},
            "e": dgu("phs", "big"),
            "f": {"capacitance": "3 uF"},
        },
        line("a", "b", "0.3 ohm", "0.7 mH"),
        line("c", "b", "0.4 ohm", "0.6 mH"),
        line("b", "e", "0.2 ohm", "0.6 mH"),
        line("e", "a", "0.5 ohm", "0.9 mH"),
        line("f", "b", "0.7 ohm", "0.8 mH"),
    ),
}

# Wrong signs that no comparison can see, by the reason.
EXEMPT: dict[str, tuple[str, ...]] = {
    "an end of a tolerance: both models are compared at the values of the spec": (
        "kernel.model.node_capacitances: 1 + SIGNS[sign] * line.capacitance_tolerance -> 1 - SIGNS[sign] * line.capacitance_tolerance",
        "kernel.model.node_capacitances: 1 + SIGNS[sign] * own.tolerance[2] -> 1 - SIGNS[sign] * own.tolerance[2]",
        "kernel.model.at_corner: 1 + r * own[0] -> 1 - r * own[0]",
        "kernel.model.at_corner: 1 + x * own[1] -> 1 - x * own[1]",
    ),
    "how far a coefficient may be off: the middle, which is compared, stays": (
        "kernel.model.load_law: before[1] + own[1] -> before[1] - own[1]",
        "kernel.model.load_law: before[1] -> -before[1]",
        "kernel.model.load_law: before[2] + own[2] -> before[2] - own[2]",
        "kernel.model.load_law: before[2] -> -before[2]",
        "kernel.model.load_law: c[1:] -> -c[1:]",
        "kernel.model._terms: abs(c) * share -> -(abs(c) * share)",
        "kernel.model._terms: abs(load.P0_watt) * off[0] -> -(abs(load.P0_watt) * off[0])",
        "kernel.model._terms: abs(load.Q0_var) * off[1] -> -(abs(load.Q0_var) * off[1])",
        "kernel.model._as_admittance: (high - low) / 2 / v ** 2 -> -((high - low) / 2 / v ** 2)",
        "kernel.model._as_admittance: high - low -> high + low",
        "kernel.model._as_admittance: high -> -high",
        "kernel.model._as_admittance: (abs(c) + spread) * half -> -((abs(c) + spread) * half)",
        "kernel.model._as_admittance: abs(c) + spread -> abs(c) - spread",
        "kernel.equilibrium._laws: t.spread + t.blur -> t.spread - t.blur",
    ),
    "only what proofs bound, not what flows": (
        "kernel.loads.total: f * b -> -(f * b) [2]",
        "kernel.equilibrium._laws: e -> -e",
        "kernel.model.load_pieces: low -> -low",
    ),
    "the same: an even power, the other index of two, both sides of a quotient or of an equation": (
        "kernel.model._as_admittance: Fraction(1) -> -Fraction(1)",
        "kernel.model._terms: 1 -> -1",
        "simulator.loads._terms: float(c) -> -float(c)",
        "simulator.loads.add_formula: sums[int(terms[n, 0])] += terms[n, 3] * x ** terms[n, 1] * y ** terms[n, 2] -> sums[int(terms[n, 0])] -= terms[n, 3] * x ** terms[n, 1] * y ** terms[n, 2]",
        "simulator.plant.Plant.at_rest: loop.F -> -loop.F",
        "simulator.plant.Plant.at_rest: loop.raw -> -loop.raw",
    ),
    "a number of layers, of which there may be none": (
        "simulator.loads._layers: 1 -> -1",
        "simulator.loads._layers: 1 -> -1 [2]",
    ),
    "nothing reads it, or nothing comes there: a capacitance beside that of the node, an inverter without a current": (
        "kernel.model.at_corner: filter_.capacitance_farad -> -filter_.capacitance_farad",
        "kernel.proofs.full_storage: scale(c, identity(2)) -> -scale(c, identity(2)) [2]",
        "simulator.plant.inverter_of: dgu.filter.capacitance_farad -> -dgu.filter.capacitance_farad",
        "simulator.plant.inverter_of: C -> -C",
    ),
    "a constant of a control law, for which its integrator makes up: the kernel's model, in deviations, has none": (
        "simulator.plant._law: reference -> -reference [3]",
        "simulator.plant._ida_pbc: law.design.capacitance_farad -> -law.design.capacitance_farad",
        "simulator.plant._ida_pbc: V - reference -> V + reference",
        "simulator.plant._ida_pbc: current - 1j * w0 * C * reference -> current + 1j * w0 * C * reference",
    ),
    "a load at no voltage, or far below every band, where the kernel says nothing": (
        "simulator.loads.StaticLoads.__init__: FLOOR * _top(node) -> -(FLOOR * _top(node))",
        "simulator.loads.StaticLoads.__init__: lows -> -lows",
        "simulator.loads.StaticLoads.__init__: lows -> -lows [2]",
        "simulator.loads.StaticLoads.slopes: V0 -> -V0",
        "simulator.loads.StaticLoads.slopes: 1 -> -1",
        "simulator.loads.add_zips: numpy.inf -> -numpy.inf",
        "simulator.loads.add_exps: numbers[:, 0] -> -numbers[:, 0]",
        "simulator.loads._clipped: numpy.inf -> -numpy.inf",
    ),
    "makes an inequality stricter, which still holds along these motions": (
        "crosscheck.claimed.Claimed._dgu: float(shortage) -> -float(shortage)",
    ),
}
