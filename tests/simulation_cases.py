"""Courses of events for judging a simulator: documents of specs with a scenario `course`, and the same as changes.

Benchmark cases are the CIGRE network, its events at a hundredth of their times, and the inverter that oscillates once it
saturates with its two twins that recover. Random cases are seeded: each style asks for what it must contain, the seed
chooses the rest. All stay bounded.
"""

from __future__ import annotations

import copy
import json
import math
import random
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

from tests.conftest import ROOT
from tests.equilibrium_oracle import quantity
from tests.simulation_oracle import Change, Part, Vector, load_document, run, scenario_table

SEED = 1
SCENARIO = "course"


@dataclass(frozen=True)
class Case:
    """`timed`: changes with their times as text; `document` holds the same as the scenario `course`."""

    name: str
    document: dict[str, Any]
    timed: tuple[tuple[str, tuple[Change, ...]], ...]
    start: str
    end: str
    off: tuple[Change, ...] = ()
    intervals: int = 80

    @property
    def changes(self) -> list[tuple[float, tuple[Change, ...]]]:
        return [(float(quantity(at)), changes) for at, changes in self.timed]

    @property
    def end_second(self) -> float:
        return float(quantity(self.end))

    @property
    def samples(self) -> Vector:
        """Evenly spread, and the times of all events, at which the state after them counts."""
        return np.unique([*np.linspace(0, self.end_second, self.intervals + 1), *(t for t, _ in self.changes)])

    @property
    def data(self) -> bytes:
        """The spec as JSON."""
        return json.dumps(self.document, indent=0).encode()

    def reference(self, **options: Any) -> dict[Part, Vector]:
        """What the oracle says; `options` as those of `run`."""
        return run(self.document, self.changes, self.start, self.end_second, self.samples, self.off, **options)


def make_case(
    name: str,
    document: dict[str, Any],
    timed: Sequence[tuple[str, Sequence[Change]]],
    start: str,
    end: str,
    off: Sequence[Change] = (),
    intervals: int = 80,
) -> Case:
    times = [at for at, _ in timed]
    table = scenario_table([(0.0, changes) for _, changes in timed], start, end, off, times)
    whole = {**document, "scenario": {SCENARIO: table}}
    return Case(name, whole, tuple((at, tuple(c)) for at, c in timed), start, end, tuple(off), intervals)


# --- benchmarks ---------------------------------------------------------------------------------------------------


def cigre(start: str, slower: int = 1) -> Case:
    """The plug-in scenario of the CIGRE network, `slower` times slower than in a hundredth of its time."""
    document = load_document(ROOT / "specs" / "cigre-mv.toml")
    timed: list[tuple[str, list[Change]]] = []
    for event in document["scenario"]["plug-in"]["event"]:
        at = f"{float(quantity(event['at'])) * 10 * slower:g} ms"
        if "connect" in event:
            timed.append((at, [("connect-dgu", event["connect"])]))
        else:
            timed.append((at, [("load-set", event["load"], 0, event["set"])]))
    name = f"CIGRE from {start}" + (f", {slower} times slower" if slower > 1 else "")
    return make_case(name, document, timed, start, f"{80 * slower} ms", [("dgu", "5")], 400 if slower > 1 else 80)


def oscillator(ki: int, static: bool) -> Case:
    """An inverter that saturates from zero: it oscillates for ki = 1000 with an R-L load, and else recovers."""
    document = load_document(ROOT / "specs" / "saturating-inverter.toml")
    document["controller"]["phs"]["ki"] = ki
    if static:
        w0 = 2 * math.pi * 50
        y = 1 / (50 + 1j * w0 * 0.1)
        document["node"]["a"]["load"] = [{"kind": "zip", "Y": [f"{y.real:.12f} S", f"{-y.imag:.12f} S"]}]
        document["voltage_band"] = ["0.5 pu", "3 pu"]
    name = f"saturating inverter, ki = {ki}" + (", static load" if static else "")
    return make_case(name, document, [], "zero", "200 ms")


def benchmark_cases() -> list[Case]:
    """The full length of the CIGRE case, which takes the oracle some 20 s, is `cigre("flat", 100)`."""
    inverters = [oscillator(1000, False), oscillator(100, False), oscillator(1000, True)]
    return [cigre("flat"), cigre("equilibrium"), *inverters]


# --- random microgrids ------------------------------------------------------------------------------------------

FILTERS = {
    "lc": {"R": "0.1 ohm", "L": "1.8 mH", "C": "25 uF"},
    "big": {"R": "0.08 ohm", "L": "2.5 mH", "C": "30 uF"},
}
CONTROLLERS: dict[str, dict[str, Any]] = {
    "phs": {"kind": "ida-pbc", "alpha": -5, "nu": 1, "ki": 100},
    "phs-dq": {"kind": "ida-pbc", "alpha": [-4, -6], "nu": [1, "1.5"], "ki": [80, 150]},
    "phs-off": {
        "kind": "ida-pbc",
        "alpha": -5,
        "nu": "1.2",
        "ki": 60,
        "design": {"R": "0.13 ohm", "L": "2.05 mH", "C": "22 uF", "frequency": "49.5 Hz"},
    },
    "pi": {
        "kind": "state-feedback",
        "let": {"kp": 1000, "ki": 1000},
        "K11": "1 - kp*L",
        "K12": [["R - ki*(1/kp + 1)", "-w0*L"], ["w0*L", "R - ki*(1/kp + 1)"]],
        "K13": "ki",
    },
    "full": {
        "kind": "state-feedback",
        "K11": [["-0.18", "-0.236"], ["-0.236", "-0.07"]],
        "K12": [["-4.9", "0.4345"], ["-0.9345", "-3.9"]],
        "K13": [[480, -50], [230, 630]],
    },
    "full-off": {
        "kind": "state-feedback",
        "design": {"L": "1.6 mH", "R": "0.15 ohm"},
        "K11": [["-100*L", "-0.1"], ["-0.15", "0.1 - 100*L"]],
        "K12": [["R - 5", "-w0*L"], ["w0*L", "R - 4"]],
        "K13": [[500, 40], [-30, 400]],
    },
    "shunt": {"kind": "state-feedback", "K11": "0.97", "K12": [["-1.5", "0.2"], ["-0.1", -2]]},  # no integrator
    "held": {"kind": "constant"},
    "own": {
        "kind": "linear",
        "let": {"c": "5e-5", "l": "2e-3", "r": "0.5", "tau": "1e-3", "k": "1.5"},
        "F": [
            [0, "w0", "1/c", 0, 0, 0],
            ["-w0", 0, 0, "1/c", 0, 0],
            ["-1/l", 0, "-r/l", "w0", "-k/l", 0],
            [0, "-1/l", "-w0", "-r/l", 0, "-k/l"],
            [0, 0, "1/tau", 0, "-1/tau", 0],
            [0, 0, 0, "1/tau", 0, "-1/tau"],
        ],
        "B": [["1/c", 0], [0, "1/c"], [0, 0], [0, 0], [0, 0], [0, 0]],
        "C": [[1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0]],
    },
}


@dataclass(frozen=True)
class Style:
    """What a random microgrid must contain. Nodes are "n0", "n1", ..; the DGUs and their controllers are listed."""

    nodes: int
    volts: int
    dgus: dict[int, str]
    loads: tuple[str, ...]  # kinds to choose from, the first ones at least once
    kinds: tuple[str, ...]  # of events, in order of time
    end_ms: int
    start: str = "flat"
    extra_lines: int = 0
    limits: dict[int, tuple[float, float]] = field(default_factory=dict)  # in units of each component of the reference
    windup_ms: dict[int, int] = field(default_factory=dict)
    size: float = 0.02  # of a load, in units of volts^2 / ohm
    shunt_nf: int = 0  # of nodes without DGU
    line_ohm: float = 0.3
    line_nf: float = 20
    neglected: bool = False
    together: bool = False  # the second and the third event


STYLES = (
    Style(
        3,
        400,
        {0: "phs", 2: "pi"},
        ("current", "exp", "zip"),
        ("load-set", "reference", "controller"),
        120,
        shunt_nf=1000,
    ),
    Style(
        4,
        400,
        {0: "own", 1: "phs-dq"},
        ("cut", "rl", "zip"),
        ("connect-line", "load-off", "load-on"),
        150,
        extra_lines=1,
        shunt_nf=400,
    ),
    Style(
        5,
        20_000,
        {0: "phs", 1: "held", 4: "full"},
        ("zip", "exp", "rl"),
        ("connect-dgu", "disconnect-line", "load-set"),
        60,
        "equilibrium",
        extra_lines=1,
        size=2e-4,
    ),
    Style(
        6,
        400,
        {0: "phs", 2: "phs-off", 5: "full-off"},
        ("cut", "cut", "rl"),
        ("connect-dgu-discharged", "load-set", "disconnect-dgu"),
        120,
        "zero",
        limits={0: (1.01, 1.02), 5: (1.05, 1.2)},
        shunt_nf=600,
    ),
    Style(
        7,
        20_000,
        {0: "phs", 3: "phs-dq", 6: "pi"},
        ("zip", "rl", "exp"),
        ("load-on", "reference", "disconnect-line"),
        40,
        "flat",
        extra_lines=2,
        limits={3: (1.005, 1.05), 0: (1.02, 1.1)},
        windup_ms={3: 15},
        size=2.5e-4,
        shunt_nf=60,
    ),
    Style(
        8,
        400,
        {0: "full", 3: "shunt", 4: "phs-off", 7: "held"},
        ("current", "cut", "rl", "exp"),
        ("disconnect-dgu", "connect-dgu", "controller"),
        100,
        "equilibrium",
        limits={4: (0.985, 1.05)},
        windup_ms={4: 40},
        shunt_nf=150,
    ),
    Style(
        9,
        20_000,
        {0: "pi", 2: "phs", 5: "phs-off", 8: "own"},
        ("exp", "zip", "cut", "rl"),
        ("connect-line", "disconnect-dgu", "load-set", "connect-dgu-discharged"),
        50,
        extra_lines=2,
        size=2e-4,
        shunt_nf=150,
        neglected=True,
        together=True,
    ),
    Style(
        12,
        20_000,
        {0: "phs", 3: "phs-dq", 6: "full", 11: "phs-off"},
        ("heavy", "heavy", "heavy-exp", "heavy"),
        ("load-set", "connect-dgu", "load-off", "reference"),
        50,
        size=0.0088,
        line_ohm=0.12,
        line_nf=40,
    ),
    Style(
        10,
        400,
        {0: "phs", 4: "full-off", 9: "full"},
        ("zip", "exp", "cut"),
        ("controller", "disconnect-line", "connect-line", "load-set"),
        1000,
        "equilibrium",
        extra_lines=3,
        limits={0: (1.001, 1.5), 4: (1.001, 1.2)},
        windup_ms={0: 25, 4: 60},
        shunt_nf=20_000,
    ),
    Style(
        11,
        20_000,
        {0: "phs-dq", 2: "held", 5: "full-off", 8: "own", 10: "pi"},
        ("rl", "exp", "cut", "zip"),
        ("connect-dgu", "load-on", "connect-line", "load-set"),
        40,
        extra_lines=4,
        size=3e-4,
        shunt_nf=80,
        together=True,
    ),
    Style(  # an inverter hands over while it is held at its limits
        3,
        400,
        {0: "phs-dq", 2: "full"},
        ("exp", "rl"),
        ("controller", "reference", "connect-dgu-discharged"),
        150,
        limits={0: (0.98, 1.02), 2: (1.02, 1.2)},
        windup_ms={0: 20},
        shunt_nf=2000,
    ),
)


def network_load(rng: random.Random, kind: str, style: Style, reference: complex | None) -> dict[str, Any]:
    """A load of about style.size volts^2 per ohm."""
    power = style.size * style.volts**2 * rng.uniform(0.6, 1.4)
    q = power * rng.uniform(-0.1, 0.6)
    v = style.volts

    def shares(a: float, b: float, c: float) -> dict[str, Any]:
        keys = zip("YIP", (("S", "S"), ("A", "A"), ("W", "var")), (2, 1, 0), (a, b, c), strict=True)
        return {key: [f"{power * s / v**k:.6g} {p}", f"{q * s / v**k:.6g} {r}"] for key, (p, r), k, s in keys}

    if kind == "rl":
        impedance = v**2 / power
        return {"kind": "rl", "R": f"{impedance:.5g} ohm", "L": f"{impedance * rng.uniform(0.1, 0.8) / 314:.5g} H"}
    if kind == "current" and reference is not None:
        g, b = power / v**2, q / v**2
        law = [
            f"{g:.6g}*Vd + {b:.6g}*Vq + {g / v**2 / 2:.6g}*Vd^3",
            f"{1.4 * g:.6g}*Vq/(1 + Vd^2/{4 * v**2}) - {b:.6g}*Vd",
        ]
        centre = [f"{reference.real:.6g} V", f"{reference.imag:.6g} V"]
        return {"kind": "current", "I": law, "centre": centre, "radius": f"{0.4 * v} V"}
    if kind == "exp" or kind == "heavy-exp" or (kind == "cut" and rng.random() < 0.5):
        np_, nq = rng.choice(("1.2", "1.5", "1.7")), rng.choice(("0.8", "2.2", "3"))
        load = {"kind": "exp", "P0": f"{power:.6g} W", "np": np_, "Q0": f"{q:.6g} var", "nq": nq}
    else:
        load = {"kind": "zip", **shares(0.5, 0.35, 0.15)}
    if kind in ("cut", "heavy", "heavy-exp"):
        load |= {"band": [f"{rng.uniform(0.8, 0.93):.3g} pu", "1.5 pu"], "below": "constant-impedance"}
    return load


def random_case(number: int, seed: int = SEED) -> Case:
    """The same case for the same numbers."""
    rng, style = random.Random(f"{seed}/{number}"), STYLES[number]
    names = [f"n{k}" for k in range(style.nodes)]
    nodes: dict[str, Any] = {name: {} for name in names}
    references = {}
    for k, controller in style.dgus.items():
        size, angle = rng.uniform(0.99, 1.02), rng.uniform(0.25, 0.29)
        reference = [round(size * math.cos(angle), 4), round(size * math.sin(angle), 4)]
        references[k] = style.volts * complex(*reference)
        dgu: dict[str, Any] = {"controller": controller, "reference": [f"{x} pu" for x in reference]}
        if controller != "own":
            dgu["filter"] = rng.choice(sorted(FILTERS)) if controller in ("phs", "phs-dq", "pi", "held") else "lc"
        if k in style.limits:
            dgu["limits"] = [f"{abs(x) * share:.5g} pu" for x, share in zip(reference, style.limits[k], strict=True)]
        if k in style.windup_ms:
            dgu["anti_windup"] = f"{style.windup_ms[k]} ms"
        nodes[names[k]]["dgu"] = dgu
    for name in names:
        if style.shunt_nf:
            nodes[name]["capacitance"] = f"{style.shunt_nf * rng.uniform(0.7, 1.4):.4g} nF"
    lines = pick_lines(rng, style, names)
    place_loads(rng, style, nodes, names, references)
    document = {
        "format": "certify/microgrid@1",
        "name": f"random course {number}",
        "frequency": rng.choice(("50 Hz", "60 Hz")),
        "base_voltage": f"{style.volts} V",
        "voltage_band": ["0.5 pu", "1.5 pu"],
        **({"line_legs": "neglected at DGUs"} if style.neglected else {}),
        "filter": FILTERS,
        "controller": CONTROLLERS,
        "node": nodes,
        "line": lines,
    }
    timed, off = pick_events(rng, style, document)
    return make_case(f"random {number}", document, timed, style.start, f"{style.end_ms} ms", off)


def pick_lines(rng: random.Random, style: Style, names: list[str]) -> list[dict[str, Any]]:
    """A tree, and some more lines, whose names start with x."""
    pairs = [(rng.randrange(max(0, k - 3), k), k, "l") for k in range(1, style.nodes)]
    taken = {(a, b) for a, b, _ in pairs}
    free = [(a, b, "x") for b in range(style.nodes) for a in range(b) if (a, b) not in taken]
    pairs += rng.sample(free, min(style.extra_lines, len(free)))
    lines = []
    for number, (a, b, letter) in enumerate(pairs):
        R = style.line_ohm * rng.uniform(0.5, 1.6)
        ends = (a, b) if rng.random() < 0.5 else (b, a)
        line = {"name": f"{letter}{number}", "from": names[ends[0]], "to": names[ends[1]], "R": f"{R:.4g} ohm"}
        line |= {"L": f"{R * rng.uniform(1.5, 3.5):.4g} mH", "C": f"{style.line_nf * rng.uniform(0.4, 1.6):.4g} nF"}
        lines.append(line)
    return lines


def place_loads(
    rng: random.Random, style: Style, nodes: dict[str, Any], names: list[str], references: dict[int, complex]
) -> None:
    """Loads at most nodes: the kinds of the style in turn, first at those without DGU."""
    order = [k for k in range(style.nodes) if k not in style.dgus] + [k for k in style.dgus if rng.random() < 0.5]
    junction = rng.choice(order[1:]) if style.nodes > 4 else None
    middle = sum(references.values()) / len(references)
    wanted = [k for k in order if k != junction]
    kinds = [*style.loads, *(rng.choice(style.loads) for _ in wanted[len(style.loads) :])]
    for position, kind in enumerate(kinds):
        k = wanted[position % len(wanted)]
        listed = nodes[names[k]].setdefault("load", [])
        if {x["kind"] for x in listed} & {"current"} and kind != "rl":
            kind = "rl"
        listed.append(network_load(rng, kind, style, references.get(k, middle)))
        if rng.random() < 0.25 and kind != "current":
            listed.insert(rng.randrange(2), network_load(rng, "rl", style, None))


def pick_events(
    rng: random.Random, style: Style, document: dict[str, Any]
) -> tuple[list[tuple[str, list[Change]]], list[Change]]:
    """Events of the kinds of the style, in order of time, and what must be off at first."""
    nodes = document["node"]
    plain = [n for n, node in nodes.items() if node.get("dgu", {}).get("controller") not in (None, "own", "shunt")]
    switchable = plain[1:]
    extra = [line["name"] for line in document["line"] if line["name"].startswith("x")]
    loads = [(n, i) for n, node in nodes.items() for i in range(len(node.get("load", ())))]
    rng.shuffle(switchable), rng.shuffle(extra), rng.shuffle(loads)
    off: list[Change] = []
    gone: dict[str, list[Any]] = {"dgu": [], "line": [], "load": []}
    changes: list[Change] = []
    for kind in style.kinds:
        change: Change
        if kind.startswith("connect-dgu"):
            name = gone["dgu"].pop() if gone["dgu"] else switchable.pop()
            if not any(("disconnect-dgu", name) == c for c in changes):
                off.append(("dgu", name))
            change = (kind, name)
        elif kind == "disconnect-dgu":
            name = switchable.pop()
            gone["dgu"].append(name)
            change = (kind, name)
        elif kind == "connect-line":
            name = gone["line"].pop() if gone["line"] else extra.pop()
            if not any(("disconnect-line", name) == c for c in changes):
                off.append(("line", name))
            change = (kind, name)
        elif kind == "disconnect-line":
            name = extra.pop()
            gone["line"].append(name)
            change = (kind, name)
        elif kind == "load-on":
            where = gone["load"].pop() if gone["load"] else loads.pop()
            if not any(("load-off", *where) == c for c in changes):
                off.append(("load", *where))
            change = (kind, *where)
        elif kind == "load-off":
            where = loads.pop()
            gone["load"].append(where)
            change = (kind, *where)
        elif kind == "load-set":
            where = next(x for x in loads if nodes[x[0]]["load"][x[1]]["kind"] != "current")
            loads.remove(where)
            change = (kind, *where, scaled(rng, nodes[where[0]]["load"][where[1]]))
        elif kind == "reference":
            name = next(n for n in plain if n in switchable or n == plain[0])
            pair = [float(str(x).split()[0]) for x in nodes[name]["dgu"]["reference"]]
            change = (kind, name, [f"{x * rng.uniform(0.985, 1.01):.4f} pu" for x in pair])
        else:
            name = plain[0]
            other = "full" if nodes[name]["dgu"]["controller"] != "full" else "phs"
            change = (kind, name, other)
        changes.append(change)
    at = sorted(rng.sample(range(1, 10), len(changes)))
    digits = [round(style.end_ms * (k + rng.uniform(0, 0.7)) / 10.5, 2) for k in at]
    if style.together:
        digits[2] = digits[1]
    timed: dict[str, list[Change]] = {}
    for ms, change in zip(digits, changes, strict=True):
        timed.setdefault(f"{ms} ms", []).append(change)
    return list(timed.items()), off


def scaled(rng: random.Random, load: dict[str, Any]) -> dict[str, Any]:
    """New coefficients for some keys of a load."""
    factor = rng.uniform(1.2, 1.6)

    def times(raw: str) -> str:
        value, unit = raw.split()
        return f"{float(value) * factor:.6g} {unit}"

    if load["kind"] == "rl":
        return {"R": times(load["R"])} | ({"L": times(load["L"])} if rng.random() < 0.5 else {})
    if load["kind"] == "exp":
        return {"P0": times(load["P0"]), "Q0": times(load["Q0"])}
    return {key: [times(x) for x in load[key]] for key in "YIP" if rng.random() < 0.7 or key == "Y"}


@cache
def _random_cases() -> tuple[Case, ...]:
    return tuple(random_case(number) for number in range(len(STYLES)))


def random_cases() -> list[Case]:
    return copy.deepcopy(list(_random_cases()))
