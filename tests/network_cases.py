"""Seeded random networks as spec documents, for judging what is said about their equilibria.

The loads of a random network are scaled so that they are a chosen share of the largest level at which its equilibrium of
high voltage exists, as far as the oracle can follow it; beyond that level there should be none. The planted networks have
answers that are known exactly: with w0 = 320 rad/s (the frequency has so many digits that 2 pi f rounds to it) and
impedances whose squares of moduli are products of 2 and 5, all that matters is a decimal of few digits.
"""

from __future__ import annotations

import json
import math
import random
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from mpmath import mp

from tests.equilibrium_oracle import Rational, largest_level, read_network

RANDOM, TWO, NONE, NOSE, EXACT = "random", "planted: two", "planted: none", "planted: nose", "planted: voltages"
SHARES = (0.1, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 0.999)
BEYOND = (1.01, 1.05, 1.2, 2.0)
CONTROLLERS = {
    "phs": {"kind": "ida-pbc", "alpha": -5, "nu": 1, "ki": 100},
    "held": {"kind": "constant"},
}
FILTERS = {"lc": {"R": "0.1 ohm", "L": "1.8 mH", "C": "25 uF"}}
ROUND_W0 = 320  # rad/s, of the planted networks
# R, X of which R^2 + X^2 is a product of 2 and 5, so that 1 / (R + jX) is a decimal.
PLAIN = ((3, 4), (4, 3), (1, 2), (2, 1), (1, 3), (3, 1), (1, 7), (7, 1), (6, 8), (2, 4), (1, 1), (24, 7), (7, 24))
# Directions g with |g| = 1, and 2 (1 + Re g) with a finite decimal for its inverse.
DIRECTIONS = ("1 0", "0.6 0.8", "0.6 -0.8", "-0.6 0.8", "-0.6 -0.8", "0 1", "0 -1", "0.28 0.96", "-0.96 0.28")


@dataclass(frozen=True)
class Case:
    """`share` of the largest level, if it was chosen; `closed`: whether the closed form of the oracle applies.

    `solutions`: how many equilibria there are, if known; `voltages`: one of them, exactly, in volt, by node. `ends`: what
    ends the growth of the loads: "nose", or "voltage" if they only leave 0.2 to 2.5 units.
    """

    number: int
    kind: str
    document: dict[str, Any]
    share: float | None = None
    ends: str = "nose"
    solutions: int | None = None
    voltages: dict[str, Rational] | None = None

    @property
    def data(self) -> bytes:
        return json.dumps(self.document, indent=0).encode()

    @property
    def closed(self) -> bool:
        return self.kind in (TWO, NONE, NOSE)


def network_case(number: int, seed: int) -> Case:
    """The same case for the same numbers, whatever came before."""
    rng = random.Random(f"{seed}/{number}")
    kind = rng.choices((RANDOM, TWO, NONE, NOSE, EXACT), (72, 9, 5, 3, 11))[0]
    makers: dict[str, Callable[[int, random.Random], Case]] = {RANDOM: random_case, EXACT: exact_case}
    if kind in makers:
        return makers[kind](number, rng)
    return two_node_case(number, rng, kind)


# --- random networks ------------------------------------------------------------------------------------------


def pick_size(rng: random.Random) -> int:
    low, high = rng.choices(((2, 6), (7, 30), (31, 120), (121, 500)), (45, 35, 14, 6))[0]
    return round(math.exp(rng.uniform(math.log(low), math.log(high))))


def pick_pairs(rng: random.Random, nodes: int) -> list[tuple[int, int]]:
    """Lines of a tree, a mesh, or two or three of them; the shape from a path to a star."""
    islands = rng.choices((1, 2, 3), (80, 13, 7))[0] if nodes >= 8 else 1
    firsts = sorted({0, *rng.sample(range(3, nodes - 2), islands - 1)}) if islands > 1 else [0]
    reach = rng.choice((1, 3, 10, nodes))
    pairs = []
    for first, end in zip(firsts, [*firsts[1:], nodes], strict=True):
        pairs += [(rng.randrange(max(first, k - reach), k), k) for k in range(first + 1, end)]
        if rng.random() < 0.45 and end - first > 2:
            more = max(1, round(rng.uniform(0.05, 0.6) * (end - first)))
            pairs += [tuple(sorted(rng.sample(range(first, end), 2))) for _ in range(more)]  # type: ignore[misc]
    return pairs


def power_factor(rng: random.Random) -> float:
    """Q over P."""
    return rng.choice((0.0, rng.uniform(-0.4, 0), rng.uniform(0, 0.5), rng.uniform(0.3, 1)))


def random_load(rng: random.Random, style: str, size: float, volts: float) -> Callable[[float], dict[str, Any]]:
    """A static load of about `size` watt, as a function of the level."""
    style = rng.choice(("constant power", "zip", "exp")) if style == "mixed" else style
    size *= rng.uniform(0.3, 1.7)
    q = power_factor(rng)
    if style == "with generators":
        size *= rng.choice((1, 1, 1, -0.7))
        style = rng.choice(("constant power", "zip"))
    band = (
        {"band": [f"{rng.uniform(0.3, 0.85):.3g} pu", f"{rng.uniform(1.1, 1.6):.3g} pu"]} if rng.random() < 0.1 else {}
    )
    extra: dict[str, Any] = {**band, **({"below": "constant-impedance"} if rng.random() < 0.25 else {})}
    if style == "constant power":
        return lambda level: {"kind": "zip", "P": [f"{level * size:.9g} W", f"{level * size * q:.9g} var"], **extra}
    if style == "zip":
        active, reactive = ([rng.uniform(-0.3, 1) for _ in range(3)] for _ in range(2))

        def zip_load(level: float) -> dict[str, Any]:
            pairs = zip("YIP", (("S", "S"), ("A", "A"), ("W", "var")), (2, 1, 0), active, reactive, strict=True)
            parts = {
                key: [f"{level * size * a / volts**k:.9g} {p}", f"{level * size * q * b / volts**k:.9g} {r}"]
                for key, (p, r), k, a, b in pairs
            }
            return {"kind": "zip", **parts, **extra}

        return zip_load
    np, nq = rng.choice((rng.uniform(0, 3), rng.choice((0.5, 1.5, 2.0)))), rng.uniform(0, 4)
    exponents = {"np": f"{np:.3g}", "nq": f"{nq:.3g}"}
    return lambda level: {
        "kind": "exp",
        "P0": f"{level * size / 1000:.9g} kW",
        "Q0": f"{level * size * q / 1000:.9g} kvar",
        **exponents,
        **extra,
    }


def random_case(number: int, rng: random.Random) -> Case:
    nodes = pick_size(rng)
    volts, low, high = rng.choice(((20_000, 0.05, 2.0), (400, 0.005, 0.3)))
    frequency = rng.choice((50, 60))
    ratio, mixed = 10 ** rng.uniform(-1, 1), rng.random() < 0.3
    lines: list[dict[str, Any]] = []
    sizes = []
    pairs = pick_pairs(rng, nodes)
    for k, (a, b) in enumerate(pairs):
        size = math.exp(rng.uniform(math.log(low), math.log(high)))
        here = 10 ** rng.uniform(-1, 1) if mixed else ratio * rng.uniform(0.9, 1.1)
        X = size / math.hypot(here, 1)
        sizes.append(size)
        ends = {"from": f"n{a}", "to": f"n{b}"} if rng.random() < 0.5 else {"from": f"n{b}", "to": f"n{a}"}
        values = {"R": f"{X * here:.6g} ohm", "L": f"{1000 * X / (2 * math.pi * frequency):.6g} mH"}
        lines.append({"name": f"l{k}", **ends, **values, "C": f"{10 ** rng.uniform(0.5, 2.5):.4g} nF"})
    held = rng.choices((0.0, 0.4, 1.0), (60, 30, 10))[0]
    density = rng.choice((0.02, 0.1, 0.25, 0.5))
    style = rng.choice(("constant power", "zip", "exp", "mixed", "mixed", "with generators"))
    load_size = volts**2 / (sum(sizes) / len(sizes)) / nodes / 20
    empty = rng.uniform(0, 0.4)
    roots = find_roots(nodes, pairs)
    sources = {rng.choice([k for k in range(nodes) if roots[k] == root]) for root in set(roots)}
    lone_density = density if nodes > 2 else 0.1
    table: dict[str, Any] = {}
    loads: dict[str, list[Callable[[float], dict[str, Any]]]] = {}
    for k in range(nodes):
        node: dict[str, Any] = {}
        if k in sources or rng.random() < lone_density:
            angle, size = rng.uniform(-0.03, 0.03), rng.uniform(0.95, 1.05)
            reference = [f"{size * math.cos(angle):.5g} pu", f"{size * math.sin(angle):.5g} pu"]
            controller = "held" if rng.random() < held else "phs"
            node["dgu"] = {"filter": "lc", "controller": controller, "reference": reference}
            if rng.random() < 0.15:
                node["dgu"]["limits"] = [f"{rng.uniform(0.95, 1.5):.3g} pu", f"{rng.uniform(0.05, 1):.3g} pu"]
        if rng.random() > (0.6 if "dgu" in node else empty) or nodes == 2:
            many = 2 if rng.random() < 0.15 else 1
            loads[f"n{k}"] = [random_load(rng, style, load_size, volts) for _ in range(many)]
        if rng.random() < 0.1:
            size = volts**2 / load_size * rng.uniform(3, 30)
            node["load"] = [{"kind": "rl", "R": f"{size:.5g} ohm", "L": f"{size * rng.uniform(0.05, 1) / 300:.5g} H"}]
        if rng.random() < 0.05:
            node["capacitance"] = f"{rng.uniform(0.1, 3):.3g} uF"
        table[f"n{k}"] = node
    band = rng.choice((("0.3 pu", "1.5 pu"), ("0.5 pu", "1.3 pu"), ("0.7 pu", "1.2 pu"), ("0.9 pu", "1.1 pu")))

    def document(level: float) -> dict[str, Any]:
        full = {}
        for name, node in table.items():
            listed = node.get("load", []) + [load(level) for load in loads.get(name, ())]
            full[name] = {**node, **({"load": listed} if listed else {})}
        return {
            "format": "certify/microgrid@1",
            "name": f"random network {number}",
            "frequency": f"{frequency} Hz",
            "base_voltage": f"{volts} V",
            "voltage_band": list(band),
            **({"line_legs": "neglected at DGUs"} if legs else {}),
            "filter": FILTERS,
            "controller": {name: CONTROLLERS[name] for name in CONTROLLERS if name in used},
            "node": full,
            "line": lines,
        }

    used = {node["dgu"]["controller"] for node in table.values() if "dgu" in node}
    legs = rng.random() < 0.1
    share = rng.choice(SHARES) if rng.random() < 0.88 else rng.choice(BEYOND)
    level, nose = largest_level(read_network(document(1.0)))
    if not 0 < level < math.inf:
        return Case(number, RANDOM, document(1.0), None, "nothing")
    return Case(number, RANDOM, document(share * level), share, "nose" if nose else "voltage")


def find_roots(nodes: int, pairs: list[tuple[int, int]]) -> list[int]:
    """For each node the least node of its island."""
    root = list(range(nodes))
    for _ in range(nodes):
        before = list(root)
        for a, b in pairs:
            root[a] = root[b] = min(root[a], root[b])
        if root == before:
            break
    return root


# --- planted networks -----------------------------------------------------------------------------------------


def round_frequency() -> str:
    """The frequency at which w0 is ROUND_W0, in 60 digits."""
    with mp.workdps(70):
        return str(mp.nstr(ROUND_W0 / (2 * mp.pi), 60))


def decimal_text(x: Fraction) -> str:
    """The finite decimal of a rational. Raises: ValueError if it has none of less than 100 places.

    >>> decimal_text(Fraction(-3, 8)), decimal_text(Fraction(7))
    ('-0.375', '7')
    """
    for places in range(100):
        if (10**places) % x.denominator == 0:
            whole, rest = divmod(abs(x.numerator) * (10**places // x.denominator), 10**places)
            return f"{'-' if x < 0 else ''}{whole}" + (f".{rest:0{places}d}" if places else "")
    raise ValueError(f"no finite decimal: {x}")


def times(a: Rational, b: Rational) -> Rational:
    return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]


def planted_document(
    number: int, nodes: dict[str, Any], lines: list[dict[str, Any]], band: list[str]
) -> dict[str, Any]:
    return {
        "format": "certify/microgrid@1",
        "name": f"planted network {number}",
        "frequency": f"{round_frequency()} Hz",
        "base_voltage": "20 kV",
        "voltage_band": band,
        "filter": FILTERS,
        "controller": {"phs": CONTROLLERS["phs"]},
        "node": nodes,
        "line": lines,
    }


def two_node_case(number: int, rng: random.Random, kind: str) -> Case:
    """A DGU, a line and a constant power, at a share t of the largest one in its direction: 2, 1 or 0 equilibria.

    With Z of the line, y = 1 / Z, Y = y + j w0 c of the lone node and p = P - jQ, the discriminant of the quadratic for v^2
    vanishes at p = t Y g |y V|^2 / (2 |Y|^2 (1 + Re g)), |g| = 1, t = 1, is positive for smaller t and negative for larger.
    V = k Z conj(1 + j w0 c Z) makes that the decimal t g k^2 conj(D) / (2 (1 + Re g)), D = Z conj(1 + j w0 c Z).
    """
    R, X = (Fraction(x) / 10 for x in rng.choice(PLAIN))
    shrink = Fraction(rng.choice(("1", "0.5", "0.1", "2")))
    Z = R * shrink, X * shrink
    of_line = Fraction(rng.randrange(1, 800), 10**9)  # farad, as `own` and `leg`
    own = Fraction(rng.choice((0, 0, 1, 5)), 10**6)
    leg = of_line / 2 + own
    wc = ROUND_W0 * leg
    shunt = 1 - wc * Z[1], -wc * Z[0]  # conj(1 + j wc Z)
    D = times(Z, shunt)
    k = Fraction(f"{rng.uniform(19_000, 21_000) / math.hypot(*map(float, D)):.5g}")
    g = tuple(Fraction(x) for x in rng.choice(DIRECTIONS).split())
    shares = {
        TWO: ("0.05", "0.2", "0.5", "0.8", "0.9", "0.99", "0.9999", "0.99999999"),
        NONE: ("1.00000001", "1.0001", "1.01", "1.5", "10"),
        NOSE: ("1",),
    }
    t = Fraction(rng.choice(shares[kind]))
    factor = t * k**2 / (2 * (1 + g[0]))
    p = tuple(factor * x for x in times((g[0], g[1]), (D[0], -D[1])))
    V = times((k, Fraction(0)), D)
    reference = [f"{decimal_text(x)} V" for x in V]
    power = [f"{decimal_text(p[0])} W", f"{decimal_text(-p[1])} var"]
    load: dict[str, Any] = {"kind": "zip", "P": power}
    lone = {"load": [load], **({"capacitance": f"{decimal_text(own)} F"} if own else {})}
    source = {"dgu": {"filter": "lc", "controller": "phs", "reference": reference}}
    line = {"R": f"{decimal_text(Z[0])} ohm", "L": f"{decimal_text(Z[1] / ROUND_W0)} H"}
    line |= {"name": "l0", "from": "n0", "to": "n1", "C": f"{decimal_text(of_line)} F"}
    # Wide bands that hold both equilibria whenever the load is not too light, and ordinary ones.
    band = list(rng.choice((("0.1 pu", "1.6 pu"), ("0.01 pu", "3 pu"), ("0.6 pu", "1.4 pu"))))
    document = planted_document(number, {"n0": source, "n1": lone}, [line], band)
    count = {TWO: 2, NONE: 0, NOSE: 1}[kind]
    return Case(number, kind, document, float(t), "nose", count)


def exact_case(number: int, rng: random.Random) -> Case:
    """A network with decimals for voltages: the constant powers that make them an equilibrium follow, exactly."""
    count = rng.choice((2, 3, 4, 5, 8, 13, 30))
    volts = 20_000
    pairs = [(rng.randrange(max(0, k - 5), k), k) for k in range(1, count)]
    pairs += [(0, count - 1)] if count > 3 and rng.random() < 0.4 else []
    spread = rng.choice((1, 5, 20, 60))  # thousandths of the voltage, up and down
    V: list[Rational] = []
    for _ in range(count):
        d, q = (Fraction(rng.randint(-spread, spread), 1000) for _ in range(2))
        V.append((volts * (1 + d), volts * q))
    into: list[Rational] = [(Fraction(0), Fraction(0))] * count  # what the lines bring, minus the capacitors' current
    legs = [Fraction(0)] * count
    lines = []
    for k, (a, b) in enumerate(pairs):
        scale = Fraction(rng.choice(("0.1", "0.02", "0.5")))
        R, X = (x * scale for x in rng.choice(PLAIN))
        C = Fraction(rng.randrange(1, 300), 10**9)
        y = R / (R**2 + X**2), -X / (R**2 + X**2)
        current = times(y, (V[a][0] - V[b][0], V[a][1] - V[b][1]))
        into[a] = into[a][0] - current[0], into[a][1] - current[1]
        into[b] = into[b][0] + current[0], into[b][1] + current[1]
        legs[a], legs[b] = legs[a] + C / 2, legs[b] + C / 2
        lines.append((f"l{k}", a, b, R, X / ROUND_W0, C))
    sources = {0, *(k for k in range(1, count) if rng.random() < 0.15)}
    nodes: dict[str, Any] = {}
    for k in range(count):
        if k in sources:
            reference = [f"{decimal_text(x)} V" for x in V[k]]
            nodes[f"n{k}"] = {"dgu": {"filter": "lc", "controller": "phs", "reference": reference}}
            continue
        charging = times((Fraction(0), ROUND_W0 * legs[k]), V[k])
        current = into[k][0] - charging[0], into[k][1] - charging[1]
        power = times(current, (V[k][0], -V[k][1]))  # P - jQ
        nodes[f"n{k}"] = {"load": [{"kind": "zip", "P": [decimal_text(power[0]), decimal_text(-power[1])]}]}
    listed = [
        {"name": n, "from": f"n{a}", "to": f"n{b}", "R": decimal_text(R), "L": decimal_text(L), "C": decimal_text(C)}
        for n, a, b, R, L, C in lines
    ]
    band = list(rng.choice((("0.1 pu", "1.6 pu"), ("0.6 pu", "1.4 pu"), ("0.8 pu", "1.2 pu"))))
    document = planted_document(number, nodes, listed, band)
    return Case(number, EXACT, document, voltages={f"n{k}": V[k] for k in range(count)})
