"""Attacks on equilibria, regions and modes at limits, by models of their own: nothing of the kernel's is used in these.

The networks below are written down from Kirchhoff's laws in floats. What the kernel says of random ones is compared with
roots of their equations, with the least storage at which a bound is reached, and with the derivative of the storage.
"""

from __future__ import annotations

import cmath
import copy
import json
import math
import random
import time
from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import mpmath
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import root

from certify.certificate import Certificate, prove, to_canonical_json
from certify.kernel import balls, loads
from certify.kernel.check import check, proof_key
from certify.kernel.claims import Claim, Context, statements
from certify.kernel.data import Data
from certify.kernel.errors import Rejected, RuleFailure, SpecError
from certify.kernel.model import LoadLaw, PowerTerm
from certify.kernel.proofs import RULES
from certify.kernel.spec import decode
from tests.conftest import ROOT

W0 = 2 * math.pi * 50
J = np.array([[0.0, -1.0], [1.0, 0.0]])
I2 = np.eye(2)
Net = dict[str, Any]
HEAD = {"format": "certify/microgrid@1", "frequency": "50 Hz", "voltage_band": ["320 V", "480 V"]}
FILTER = {"lc": {"R": "0.1 ohm", "L": "1.8 mH", "C": "25 uF"}}
PHS = {"phs": {"kind": "ida-pbc", "alpha": -5, "nu": 1, "ki": 100}}
HOUSE = {"kind": "zip", "Y": ["20 mS", "5 mS"]}


def as_spec(**parts: Any) -> bytes:
    return json.dumps({**HEAD, "filter": FILTER, "controller": PHS, **parts}).encode()


def inverter(reference: list[str], limits: list[str] | None = None) -> dict[str, Any]:
    dgu: dict[str, Any] = {"filter": "lc", "controller": "phs", "reference": reference}
    return {"dgu": dgu | ({"limits": limits} if limits else {}), "load": [HOUSE]}


def claims_of(certificate: Certificate) -> dict[str, Claim]:
    return {claim.id: claim for claim in certificate.verdict.claims}


def numbers(claim: Claim) -> dict[str, float]:
    return {name: float(value) for name, value, _ in claim.facts}


def with_proof(certificate: Certificate, name: str, status: str, rule: str, data: Any) -> bytes:
    """The certificate with another proof of one claim, under its right key."""
    document = json.loads(certificate.data)
    document["proofs"][proof_key(data)] = data
    for claim in document["claims"]:
        if claim["id"] == name:
            claim.update(status=status, rule=rule, proof=proof_key(data))
    used = {claim["proof"] for claim in document["claims"]}
    document["proofs"] = {key: value for key, value in document["proofs"].items() if key in used}
    return to_canonical_json(document)


def proof_of(certificate: Certificate, name: str) -> Any:
    document = json.loads(certificate.data)
    return document["proofs"][next(c["proof"] for c in document["claims"] if c["id"] == name)]


# --- defects that were found --------------------------------------------------------------------------------------


def test_a_fixed_node_out_of_its_band_makes_limits_exceeded_fail_and_not_crash() -> None:
    spec = as_spec(node={"a": inverter(["800 V", "0 V"], ["600 V", "600 V"])})
    data = {"factor": "1 0", "radius": "1", "voltages": [], "weights": []}
    with pytest.raises(Rejected, match="K201"):
        check(spec, with_proof(prove(spec), "equilibrium/a", "refuted", "limits-exceeded", data))


def test_a_linear_loop_with_limits_is_not_at_them_because_it_rests_at_its_reference() -> None:
    """The claim is about all inverters with limits, and this one would have been taken at its reference instead."""
    port = Context(decode(as_spec(node={"a": inverter(["400 V", "0 V"])}))).port("a")
    F, B, C = ([[f"({x.numerator})/({x.denominator})" for x in row] for row in m] for m in (port.F, port.B, port.C))
    dgu = {"controller": "own", "reference": ["400 V", "0 V"], "limits": ["450 V", "450 V"]}
    loop = {"own": {"kind": "linear", "F": F, "B": B, "C": C}}
    spec = as_spec(controller=loop, node={"a": {"dgu": dgu, "load": [HOUSE]}})
    assert "saturated/a" not in claims_of(prove(spec))


def star(count: int, load: bool = True) -> bytes:
    """An inverter and so many nodes around it."""
    nodes: dict[str, Any] = {"s": inverter(["400 V", "0 V"])}
    lines = []
    for k in range(count):
        nodes[f"n{k}"] = {"load": [HOUSE]} if load else {}
        lines.append({"name": f"l{k}", "from": "s", "to": f"n{k}", "R": "0.1 ohm", "L": "0.1 mH", "C": "1 nF"})
    return as_spec(node=nodes, line=lines)


@pytest.mark.parametrize("where", ["voltages", "radius"])
def test_absurd_numbers_are_refused_because_no_report_could_print_them(where: str) -> None:
    spec, huge = star(1, load=False), "1" + "0" * 400
    data = {"factor": "1 0", "radius": huge + "0", "voltages": ["400 0"], "weights": ["1 1"]}
    data |= {"voltages": [f"{huge} 0"]} if where == "voltages" else {}
    with pytest.raises(Rejected, match="absurd"):
        check(spec, with_proof(prove(spec), "equilibrium/s", "proved", "strong-monotonicity", data))


def test_an_integrator_that_acts_on_held_axes_only_is_left_out_of_a_mode() -> None:
    """FORMAT.md: it winds up without an effect; here that of q acts on d alone, or on nothing."""
    for K13, axes in (([[0, 100], [100, 0]], (0,)), ([[100, 50], [0, 0]], ()), ([[100, 50], [70, 90]], (0, 1))):
        law = {"kind": "state-feedback", "K11": -1, "K12": -5, "K13": K13}
        dgu = {"filter": "lc", "controller": "c", "reference": ["400 V", "0 V"], "limits": ["600 V", "600 V"]}
        context = Context(decode(as_spec(controller={"c": law}, node={"a": {"dgu": dgu}})))
        assert len(context.port(("a", "d")).F) == 4 + len(axes)


def test_no_region_is_assumed_around_an_equilibrium_that_is_refuted() -> None:
    certificate = prove(as_spec(node={"a": inverter(["800 V", "0 V"])}))
    assert claims_of(certificate)["equilibrium/a"].status == "refuted"
    assert not [name for name, _ in certificate.verdict.assumptions if name.startswith("region/")]


def test_the_radius_takes_in_that_voltages_are_rounded_to_units() -> None:
    spec = as_spec(node={"a": inverter(["400.1 V", "0.1 V"])})
    facts = {name: value for name, value, _ in claims_of(prove(spec))["equilibrium/a"].facts}
    off = [facts["voltage at node a, d"] - Fraction("400.1"), facts["voltage at node a, q"] - Fraction("0.1")]
    assert 0 < sum(x * x for x in off) <= facts["radius of the proof"] ** 2


def test_the_reach_is_a_bound_from_above() -> None:
    spec = (ROOT / "specs" / "two-inverters.toml").read_bytes()
    facts = {name: value for name, value, _ in claims_of(prove(spec))["region/a"].facts}
    level = facts["level c of the storage"]
    assert facts["reach in line a-b"] ** 2 * Fraction("0.4e-3") >= 2 * level


def test_many_different_exponents_do_not_slow_the_region_down() -> None:
    base = {"kind": "exp", "P0": "10 W", "Q0": "0 var", "nq": 2, "V0": "400 V"}
    many = [base | {"np": round(2.001 + k / 1000, 3)} for k in range(300)]
    node = inverter(["400 V", "0 V"]) | {"load": many}
    spec = as_spec(node={"a": node})
    certificate = prove(spec)
    begin = time.perf_counter()
    check(spec, certificate.data)
    assert time.perf_counter() - begin < 4


def test_facts_of_long_storage_matrices_can_be_printed() -> None:
    spec = (ROOT / "specs" / "wrong-inductance.toml").read_bytes()
    certificate = prove(spec)
    data, rng = copy.deepcopy(proof_of(certificate, "dgu/a")), random.Random(1)
    rows = [[Fraction(x) for x in row.split(" ")] for row in data["storage"]]
    for i in range(len(rows)):
        for j in range(i + 1):
            below = 10**150 + rng.randrange(10**150)
            rows[i][j] = rows[j][i] = rows[i][j] * Fraction(below + rng.randrange(10**120), below)
    data["storage"] = [" ".join(map(str, row)) for row in rows]
    verdict = check(spec, with_proof(certificate, "dgu/a", "proved", "index-storage", data))
    assert verdict.outcome == "certified"
    assert max(x.numerator.bit_length() for claim in verdict.claims for _, x, _ in claim.facts) < 5_000


# --- balls ----------------------------------------------------------------------------------------------------------

Exact = tuple[Fraction, Fraction]


def random_number(rng: random.Random) -> Fraction:
    if rng.random() < 0.2:
        return Fraction(rng.randint(-3, 3))
    return Fraction(rng.randint(-(10 ** rng.randint(1, 50)), 10 ** rng.randint(1, 50)), 10 ** rng.randint(0, 50) + 7)


def holds(z: balls.Ball, p: Exact) -> bool:
    unit = Fraction(1, 1 << balls.BITS)
    return (p[0] - z.x * unit) ** 2 + (p[1] - z.y * unit) ** 2 <= (z.r * unit) ** 2


def random_ball(rng: random.Random) -> tuple[Exact, balls.Ball]:
    """A ball and a point of it, mostly on its rim; or a box and a point of that, mostly a corner."""
    centre = (random_number(rng), random_number(rng))
    if rng.random() < 0.3:
        wide = [abs(random_number(rng)) / 10 ** rng.randint(0, 30) for _ in "dq"]
        ends = [(x, x + w) for x, w in zip(centre, wide, strict=True)]
        return (rng.choice(ends[0]), rng.choice(ends[1])), balls.box(*ends)
    radius = abs(random_number(rng)) * rng.choice([Fraction(0), Fraction(1, 10 ** rng.randint(0, 45))])
    t = Fraction(rng.randint(-50, 50), rng.randint(1, 50))
    rim = (centre[0] + radius * (1 - t * t) / (1 + t * t), centre[1] + radius * 2 * t / (1 + t * t))
    return rim, balls.ball(centre, radius)


def test_balls_hold_the_exact_result() -> None:
    rng, tried = random.Random(7), 0
    for _ in range(400):
        stock = [random_ball(rng) for _ in range(4)]
        assert all(holds(z, p) for p, z in stock)
        for _ in range(6):
            (p, a), (q, b) = rng.choice(stock), rng.choice(stock)
            kind = rng.choice("+-**i")
            try:
                c = {"+": a + b, "-": a - b, "*": a * b}[kind] if kind != "i" else a.inverse()
            except RuleFailure:
                continue
            if kind == "*":
                s = (p[0] * q[0] - p[1] * q[1], p[0] * q[1] + p[1] * q[0])
            elif kind == "i":
                s = (p[0] / (p[0] ** 2 + p[1] ** 2), -p[1] / (p[0] ** 2 + p[1] ** 2))
            else:
                sign = 1 if kind == "+" else -1
                s = (p[0] + sign * q[0], p[1] + sign * q[1])
            if max(abs(part) for part in c).bit_length() < 4_000:
                tried += 1
                assert holds(c, s)
                assert s[0] ** 2 + s[1] ** 2 <= Fraction(c.largest(), 1 << balls.BITS) ** 2
                stock.append((s, c))
    assert tried > 1_500


# --- loads beyond their band ------------------------------------------------------------------------------------------


def random_law(rng: random.Random) -> LoadLaw:
    sides: list[tuple[PowerTerm, ...]] = []
    for count in (rng.randint(0, 3), rng.choice([0, 1, 1, 2])):
        terms: dict[Fraction, Fraction] = {}
        for _ in range(count):
            e = Fraction(rng.choice([10 * rng.randint(-2, 8), rng.randint(-20, 80), 20, 10, 0]), 10)
            terms[e] = terms.get(e, Fraction(0)) + Fraction(rng.choice([1, 1, 1, -1]) * rng.randint(1, 200), 50)
        sides.append(tuple(PowerTerm(c, Fraction(1), e) for e, c in sorted(terms.items()) if c))
    return LoadLaw(sides[0], sides[1])


def least_product(law: LoadLaw, a: Any, b: Any) -> tuple[Any, Any]:
    """min of <V - U, I(V) - I(U)> over the angle between voltages of size a and b; and the size of its terms."""
    P, Q = (
        [
            sum(
                (t.coefficient.numerator / mpmath.mpf(t.coefficient.denominator)) * v ** mpmath.mpf(float(t.exponent))
                for t in side
            )
            for v in (a, b)
        ]
        for side in (law.active, law.reactive)
    )
    y = [mpmath.mpc(p, -q) / v**2 for p, q, v in zip(P, Q, (a, b), strict=True)]
    return P[0] + P[1] - a * b * abs(y[0] + mpmath.conj(y[1])), sum(map(abs, (*P, *Q)))


def test_loads_that_go_on_beyond_their_band_are_monotone_there() -> None:
    rng, found = random.Random(3), 0
    with mpmath.workdps(30):
        for _ in range(1_200):
            law, v, upward = random_law(rng), Fraction(rng.choice([9, 10, 12]), 10), rng.random() < 0.5
            if not loads.is_monotone_beyond(law, v, upward):
                continue
            found += 1
            for _ in range(5):
                far = [1 + rng.random() * 10 ** rng.uniform(-3, 3) for _ in "ab"]
                a, b = (mpmath.mpf(float(v) * x if upward else float(v) / x) for x in far)
                product, size = least_product(law, a, b)
                assert product >= -size * mpmath.mpf(10) ** -12, (law, v, upward, a, b)
    assert found > 250


# --- random networks, from Kirchhoff's laws -----------------------------------------------------------------------------


def random_net(rng: random.Random) -> Net:
    """Up to four nodes, meshed; the first has an inverter that holds its voltage, another may have any."""

    def size(low: float, high: float) -> float:
        return float(f"{math.exp(rng.uniform(math.log(low), math.log(high))):.3g}")

    share = rng.choice([0.0, 0.0, 0.02])
    nodes: list[Net] = []
    for k in range(rng.randint(1, 4)):
        node: Net = {"c": size(1e-6, 3e-5), "loads": [], "rl": [], "dgu": None}
        if k == 0 or rng.random() < 0.3:
            kind = rng.choice(["phs", "phs", "open", "skew"])
            limits = (round(400 * rng.uniform(1.15, 1.5), 1), round(400 * rng.uniform(0.2, 0.8), 1))
            reference = (round(400 * rng.uniform(0.93, 1.08), 2), round(400 * rng.uniform(-0.05, 0.05), 2))
            node["dgu"] = {"kind": kind, "R": size(0.02, 0.5), "L": size(1e-3, 4e-3), "C": size(5e-6, 5e-5)}
            node["dgu"] |= {"reference": reference, "limits": limits if kind != "open" and rng.random() < 0.6 else None}
        for _ in range(rng.choice([0, 1, 1, 2])):
            S, part = size(100, 4_000), rng.uniform(-0.4, 0.4)
            if rng.random() < 0.5:
                load: Net = {
                    "kind": "zip",
                    "Y": (S / 2e5, part * S / 2e5),
                    "I": (S / 1e3, 0.0),
                    "P": (rng.uniform(-0.1, 0.1) * S, 0.0),
                }
                load = {key: x if key == "kind" else tuple(float(f"{y:.4g}") for y in x) for key, x in load.items()}
            else:
                load = {
                    "kind": "exp",
                    "P0": S,
                    "np": round(rng.uniform(1.2, 2.6), 2),
                    "Q0": float(f"{part * S / 3:.3g}"),
                }
                load["nq"] = round(rng.uniform(1.3, 3), 2)
            node["loads"].append(load | {"cut": rng.random() < 0.2})
        if rng.random() < 0.2:
            node["rl"].append((size(10, 100), size(1e-3, 0.3)))
        nodes.append(node)
    pairs = [(k, rng.randrange(k)) for k in range(1, len(nodes))]
    if len(nodes) > 1:  # meshes and parallel lines
        pairs += [(a, b) for _ in range(rng.randint(0, 2)) for a, b in [rng.sample(range(len(nodes)), 2)]]
    lines = [
        (a, b, R, float(f"{R / W0 * size(0.1, 5):.3g}"), size(1e-7, 1e-6)) for a, b in pairs for R in [size(0.05, 1)]
    ]
    return {"nodes": nodes, "lines": lines, "share": share}


GAINS = {
    **PHS,
    "open": {"kind": "constant"},
    "skew": {
        "kind": "state-feedback",
        "K11": "1 - 100*L",
        "K12": [["R - 20", "-1.02*w0*L"], ["1.02*w0*L", "R - 20"]],
        "K13": 1000,
    },
}


def net_spec(net: Net) -> bytes:
    document: Net = {**HEAD, "tolerance": net["share"], "filter": {}, "controller": GAINS, "node": {}, "line": []}
    for k, node in enumerate(net["nodes"]):
        entry: Net = {"capacitance": node["c"], "load": []}
        if dgu := node["dgu"]:
            document["filter"][f"f{k}"] = {key: dgu[key] for key in "RLC"}
            entry["dgu"] = {"filter": f"f{k}", "controller": dgu["kind"], "reference": list(dgu["reference"])}
            entry["dgu"] |= {"limits": list(dgu["limits"])} if dgu["limits"] else {}
        for load in node["loads"]:
            own = {key: list(x) if isinstance(x, tuple) else x for key, x in load.items() if key != "cut"}
            own |= {"V0": 400} if load["kind"] == "exp" else {}
            entry["load"].append(own | ({"below": "constant-impedance"} if load["cut"] else {}))
        entry["load"] += [{"kind": "rl", "R": R, "L": L} for R, L in node["rl"]]
        document["node"][f"n{k}"] = entry
    for k, (a, b, R, L, C) in enumerate(net["lines"]):
        document["line"].append({"name": f"l{k}", "from": f"n{a}", "to": f"n{b}", "R": R, "L": L, "C": C})
    return json.dumps(document).encode()


class Plant:
    """One network within the tolerances, and its equations; deviations are from the equilibrium near some voltages."""

    def __init__(self, net: Net, rng: random.Random, corner: bool) -> None:
        def off(x: float) -> float:
            return x * (1 + net["share"] * rng.choice([-1, 1])) if corner else x

        self.nodes: list[Net] = []
        for node in net["nodes"]:
            dgu = node["dgu"] and {
                **node["dgu"],
                **{key: off(node["dgu"][key]) for key in "RLC"},
                "design": node["dgu"],
            }
            powers = []
            for load in node["loads"]:
                if load["kind"] == "zip":
                    shares = [off(1.0) for _ in "YIP"]
                    terms = [
                        (e, [s * x for x in load[key]]) for s, key, e in zip(shares, "YIP", (2, 1, 0), strict=True)
                    ]
                    P, Q = ([(pair[k], e, 1.0) for e, pair in terms] for k in (0, 1))
                else:
                    P, Q = [(off(load["P0"]), load["np"], 400.0)], [(off(load["Q0"]), load["nq"], 400.0)]
                powers.append((P, Q, load["cut"]))
            rl = [(off(R), off(L)) for R, L in node["rl"]]
            self.nodes.append({"c": node["c"] + (dgu["C"] if dgu else 0), "dgu": dgu, "loads": powers, "rl": rl})
        self.lines = [(a, b, off(R), off(L)) for a, b, R, L, _ in net["lines"]]
        for a, b, _, _, C in net["lines"]:
            for k in (a, b):
                self.nodes[k]["c"] += off(C) / 2
        self.fixed = {
            k: complex(*n["dgu"]["reference"])
            for k, n in enumerate(self.nodes)
            if n["dgu"] and n["dgu"]["kind"] != "open"
        }

    def low(self, k: int) -> float:
        return 0.0 if all(cut for _, _, cut in self.nodes[k]["loads"]) else 320.0

    def load(self, k: int, V: complex) -> complex:
        current = 0j
        for P, Q, cut in self.nodes[k]["loads"]:
            v = max(abs(V), 320.0) if cut else abs(V)
            S = sum(c * (v / base) ** e for c, e, base in P) - 1j * sum(c * (v / base) ** e for c, e, base in Q)
            current += S / v**2 * V
        return current

    def needed(self, V: list[complex]) -> list[complex]:
        """What an inverter at each node has to supply."""
        result = []
        for k, node in enumerate(self.nodes):
            x = 1j * W0 * node["c"] * V[k] + self.load(k, V[k]) + sum(V[k] / complex(R, W0 * L) for R, L in node["rl"])
            x += sum((V[k] - V[b if a == k else a]) / complex(R, W0 * L) for a, b, R, L in self.lines if k in (a, b))
            result.append(x)
        return result

    def rest(self, start: list[complex]) -> list[complex] | None:
        free = [k for k in range(len(self.nodes)) if k not in self.fixed]

        def voltages(x: Any) -> list[complex]:
            V = [self.fixed.get(k, 0j) for k in range(len(self.nodes))]
            for i, k in enumerate(free):
                V[k] = complex(x[2 * i], x[2 * i + 1])
            return V

        def excess(x: Any) -> list[float]:
            V = voltages(x)
            E = self.needed(V)
            for k in free:
                if dgu := self.nodes[k]["dgu"]:
                    E[k] -= (complex(*dgu["reference"]) - V[k]) / complex(dgu["R"], W0 * dgu["L"])
            return [part for k in free for part in (E[k].real, E[k].imag)]

        x = np.array([part for k in free for part in (start[k].real, start[k].imag)])
        if free:
            x = root(excess, x, options={"xtol": 1e-13}).x
        return voltages(x) if not free or np.linalg.norm(excess(x)) < 1e-7 else None

    def terminals(self, V: list[complex]) -> dict[int, complex]:
        E, result = self.needed(V), {}
        for k, node in enumerate(self.nodes):
            if dgu := node["dgu"]:
                free = complex(*dgu["reference"])
                result[k] = V[k] + complex(dgu["R"], W0 * dgu["L"]) * E[k] if k in self.fixed else free
        return result

    def in_bands(self, V: list[complex]) -> bool:
        return all(self.low(k) < abs(V[k]) < 480 for k, node in enumerate(self.nodes) if node["loads"])


def stated(claim: Claim, count: int) -> list[complex]:
    facts = numbers(claim)
    return [complex(facts[f"voltage at node n{k}, d"], facts[f"voltage at node n{k}, q"]) for k in range(count)]


def test_equilibria_of_random_networks_are_where_it_is_said() -> None:
    seen: dict[str, int] = {}
    for seed in range(16):
        rng = random.Random(seed)
        net = random_net(rng)
        claim = claims_of(prove(net_spec(net), refute=False))["equilibrium/n0"]
        seen[claim.status] = seen.get(claim.status, 0) + 1
        count = len(net["nodes"])
        for corner in (False, True, True):
            plant = Plant(net, rng, corner)
            limits = {k: n["dgu"]["limits"] for k, n in enumerate(plant.nodes) if n["dgu"] and n["dgu"]["limits"]}
            starts = [
                [cmath.rect(rng.uniform(280, 500), rng.uniform(-0.8, 0.8)) for _ in range(count)] for _ in range(4)
            ]
            others = [V for V in map(plant.rest, starts) if V is not None and plant.in_bands(V)]
            if claim.status == "refuted":
                for V in others:
                    u = plant.terminals(V)
                    assert any(abs(u[k].real) > d or abs(u[k].imag) > q for k, (d, q) in limits.items()), seed
            if claim.status != "proved":
                continue
            facts, centre = numbers(claim), stated(claim, count)
            found = plant.rest(centre)
            assert found is not None, seed
            off = max(abs(a - b) for a, b in zip(found, centre, strict=True))
            assert off <= facts["radius of the proof"] * (1 + 1e-9) + 1e-8, seed
            assert plant.in_bands(found), seed
            wide = facts["radius of the currents and terminal voltages, in A and V"]
            for k, z in plant.terminals(found).items():
                said = [facts[f"terminal voltage of the DGU at node n{k}, {axis}"] for axis in "dq"]
                assert abs(z - complex(*said)) <= wide * (1 + 1e-9) + 1e-6, seed
                assert k not in limits or (abs(z.real) < limits[k][0] and abs(z.imag) < limits[k][1]), seed
            if claim.rule == "strong-monotonicity":
                assert all(max(abs(a - b) for a, b in zip(V, found, strict=True)) < 1e-5 for V in others), seed
    assert seen["proved"] > 7


class Motion:
    """The motion of a plant around its equilibrium, its storage by the matrices of a certificate, and its bounds."""

    def __init__(self, plant: Plant, V: list[complex], certificate: Certificate) -> None:
        document = json.loads(certificate.data)
        self.plant, self.V, self.u = plant, V, plant.terminals(V)
        blocks, self.start, self.K = [], [], {}
        rules = {c["id"]: (c["rule"], document["proofs"].get(c["proof"])) for c in document["claims"]}
        size = 0
        for k, node in enumerate(plant.nodes):
            c, P = node["c"], node["c"] * I2
            if dgu := node["dgu"]:
                rule, data = rules[f"dgu/n{k}"]
                S = np.array([[float(Fraction(x)) for x in row.split(" ")] for row in data["storage"]])
                if rule == "quadratic-storage":
                    P = np.block([[P, np.zeros((2, len(S)))], [np.zeros((len(S), 2)), S]])
                else:
                    D = np.diag([c, c] + [1.0] * (len(S) - 2))
                    P = D @ S @ D + np.diag([c, c] + [0.0] * (len(S) - 2))
                self.K[k] = self.gains(dgu["kind"], dgu["design"]["R"], dgu["design"]["L"])[:, : len(P)]
            self.start.append(size)
            size += len(P)
            blocks.append(P)
        branches = [(a, b, R, L) for a, b, R, L in plant.lines]
        branches += [(k, -1, R, L) for k, node in enumerate(plant.nodes) for R, L in node["rl"]]
        self.P, self.A = np.zeros((size + 2 * len(branches),) * 2), np.zeros((size + 2 * len(branches),) * 2)
        for at, block in zip(self.start, blocks, strict=True):
            self.P[at : at + len(block), at : at + len(block)] = block
        for k, node in enumerate(plant.nodes):
            at, c = self.start[k], node["c"]
            self.A[at : at + 2, at : at + 2] -= W0 * J
            if dgu := node["dgu"]:
                n = len(blocks[k])
                self.A[at : at + 2, at + 2 : at + 4] += I2 / c
                row = self.K[k] - np.hstack([I2, dgu["R"] * I2 + W0 * dgu["L"] * J, np.zeros((2, n - 4))])
                self.A[at + 2 : at + 4, at : at + n] += row / dgu["L"]
                if n == 6:
                    self.A[at + 4 : at + 6, at : at + 2] -= I2
        for i, (a, b, R, L) in enumerate(branches):
            at = size + 2 * i
            self.P[at : at + 2, at : at + 2] = L * I2
            self.A[at : at + 2, at : at + 2] -= R / L * I2 + W0 * J
            for k, sign in ((a, 1), (b, -1)):
                if k >= 0:
                    n = self.start[k]
                    self.A[at : at + 2, n : n + 2] += sign * I2 / L
                    self.A[n : n + 2, at : at + 2] -= sign * I2 / plant.nodes[k]["c"]
        self.inverse = np.linalg.inv(self.P)
        self.root = np.linalg.inv(np.linalg.cholesky(self.P)).T
        self.loads = [plant.load(k, v) for k, v in enumerate(V)]

    @staticmethod
    def gains(kind: str, R: float, L: float) -> Any:
        """(K11, K12, K13) of the controllers above."""
        if kind == "open":
            return np.zeros((2, 6))
        if kind == "phs":
            return np.hstack([-100 * L * I2, (R - 5) * I2 + W0 * L * J, 500 * I2])
        return np.hstack([(1 - 100 * L) * I2, (R - 20) * I2 + 1.02 * W0 * L * J, 1000 * I2])

    def slope(self, _: float, x: Any) -> Any:
        y = self.A @ x
        for k, node in enumerate(self.plant.nodes):
            at = self.start[k]
            w = self.plant.load(k, self.V[k] + complex(x[at], x[at + 1])) - self.loads[k]
            y[at] -= w.real / node["c"]
            y[at + 1] -= w.imag / node["c"]
        return y

    def storage(self, x: Any) -> float:
        return float(x @ self.P @ x) / 2

    def bounds(self) -> Iterator[tuple[float, Any, tuple[int, float] | None]]:
        """The least storage at which each bound is reached, the direction there, and node and end if a load sets it."""
        for k, node in enumerate(self.plant.nodes):
            at, V = self.start[k], self.V[k]
            below = self.inverse[:, at : at + 2]
            for end in (self.plant.low(k), 480.0) if node["loads"] else ():
                W = below[at : at + 2]
                angles = cmath.phase(V) + np.linspace(0, 2 * np.pi, 721)
                away = end * np.exp(1j * angles) - V
                Z = np.stack([away.real, away.imag])
                levels = np.einsum("ia,ij,ja->a", Z, np.linalg.inv(W), Z) / 2
                best = int(np.argmin(levels))
                if end:
                    yield float(levels[best]), below @ np.linalg.solve(W, Z[:, best]), (k, end)
            if node["dgu"] and node["dgu"]["limits"]:
                parts = zip(self.K[k], (self.u[k].real, self.u[k].imag), node["dgu"]["limits"], strict=True)
                for row, u, limit in parts:
                    x = self.inverse[:, at : at + len(row)] @ row
                    yield (
                        (limit - abs(u)) ** 2 / (2 * float(row @ x[at : at + len(row)])),
                        math.copysign(1, u) * x,
                        None,
                    )


def looks_monotone_beyond(plant: Plant, k: int, end: float, rng: random.Random) -> bool:
    """No pair of voltages, one in the band and one beyond this end of it, shows that the load is not monotone."""
    for _ in range(80):
        inside = cmath.rect(rng.uniform(max(plant.low(k), 1), 480), rng.uniform(-3.2, 3.2))
        far = end * 10 ** (rng.uniform(0, 2) if end == 480 else rng.uniform(-3, 0))
        outside = cmath.rect(far, rng.uniform(-3.2, 3.2))
        currents = plant.load(k, inside), plant.load(k, outside)
        product = ((outside - inside).conjugate() * (currents[1] - currents[0])).real
        if product < -1e-9 * abs(outside - inside) * sum(map(abs, currents)):
            return False
    return True


def test_regions_of_random_networks_are_invariant() -> None:
    """No bound is reached below the level, the storage falls everywhere in it, and motion stays and decays."""
    levels = followed = 0
    for seed in range(14):
        rng, numpy_rng = random.Random(seed), np.random.default_rng(seed)
        net = random_net(rng)
        certificate = prove(net_spec(net), refute=False)
        claims = claims_of(certificate)
        if claims["region/n0"].status != "proved":
            continue
        facts = numbers(claims["region/n0"])
        level = facts.get("level c of the storage", 1e3)
        levels += "global" not in facts
        for corner in (False, True):
            plant = Plant(net, rng, corner)
            V = plant.rest(stated(claims["equilibrium/n0"], len(net["nodes"])))
            assert V is not None
            motion = Motion(plant, V, certificate)
            bounds = list(motion.bounds())
            for least, _, end in bounds:
                below = "global" not in facts and level <= least * (1 + 1e-6)
                assert below or (end is not None and looks_monotone_beyond(plant, *end, rng)), seed
            for i in range(60):
                x = motion.root @ numpy_rng.standard_normal(len(motion.P))
                if bounds and i % 2:
                    worst = bounds[i // 2 % len(bounds)][1]
                    x = worst / math.sqrt(motion.storage(worst)) + x * 0.3 * numpy_rng.random() / math.sqrt(
                        motion.storage(x)
                    )
                x *= math.sqrt(level * numpy_rng.uniform(0.3, 0.999) / motion.storage(x))
                y = motion.slope(0, x)
                assert x @ motion.P @ y <= 1e-10 * (abs(x @ motion.P) @ abs(y)), seed
            if not corner and seed % 4 == 0:
                x = bounds[0][1] if bounds else motion.root @ numpy_rng.standard_normal(len(motion.P))
                x = x * math.sqrt(0.999 * level / motion.storage(x))
                done = solve_ivp(motion.slope, (0, 0.03), x, method="LSODA", rtol=1e-7, atol=1e-9 * np.abs(x).max())
                energies = [motion.storage(state) for state in done.y.T]
                assert max(np.diff(energies)) < 1e-5 * level, seed
                assert energies[-1] < 0.95 * level, seed
                followed += 1
    assert levels > 4
    assert followed > 1


# --- modes -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("T", "enough"), [(None, 12), ("20 ms", 4), ("0.1 ms", 4)])
def test_modes_are_the_loops_with_axes_held(T: str | None, enough: int) -> None:
    rng, passive, coupled = random.Random(11), 0, 0
    for _ in range(12 if T is None else 24):
        K11, K12 = (
            [[round(rng.uniform(-3, 0.5) if i == j else rng.uniform(-0.3, 0.3), 2) for j in (0, 1)] for i in (0, 1)]
            for _ in "VI"
        )
        K12[0][0], K12[1][1] = (round(-rng.uniform(2, 8), 1) for _ in "dq")
        K13 = [
            [rng.choice([0, 100]) if i == j else rng.choice([0, 0, 40] if T is None else [0, 40]) for j in (0, 1)]
            for i in (0, 1)
        ]
        law = {"kind": "state-feedback", "K11": K11, "K12": K12, "K13": K13}
        dgu = {"filter": "lc", "controller": "c", "reference": ["400 V", "0 V"], "limits": ["600 V", "600 V"]}
        if T is not None:
            dgu["anti_windup"] = T
            if not np.linalg.det(K13):
                with pytest.raises(SpecError, match="S212"):
                    decode(as_spec(controller={"c": law}, node={"a": {"dgu": dgu}}))
                continue
        spec = as_spec(controller={"c": law}, node={"a": {"dgu": dgu}})
        context, claims = Context(decode(spec)), claims_of(prove(spec))
        for held in ("d", "q", "dq"):
            gains = [
                np.array([[0.0, 0.0] if "dq"[i] in held else row for i, row in enumerate(K)]) for K in (K11, K12, K13)
            ]
            axes = [k for k in (0, 1) if np.any(gains[2][:, k])]
            n, R, L, C = 4 + len(axes), 0.1, 1.8e-3, 25e-6
            F, B = np.zeros((n, n)), np.vstack([I2 / C, np.zeros((n - 2, 2))])
            F[:2, :4] = np.hstack([-W0 * J, I2 / C])
            F[2:4, :4] = np.hstack([gains[0] - I2, gains[1] - R * I2 - W0 * L * J]) / L
            for i, k in enumerate(axes):
                F[2:4, 4 + i], F[4 + i, k] = gains[2][:, k] / L, -1
            if T is not None and n == 6:
                row = "dq".index(held)
                asked = np.concatenate([K11[row], K12[row], K13[row]])
                back = np.linalg.inv(np.array(K13, dtype=float))[:, row]
                F[4:] -= np.outer(back, asked) / (float(T.split()[0]) / 1000)
                coupled += 1
            port = context.port(("a", held))
            assert np.allclose(np.array(port.F, dtype=float), F, rtol=1e-9, atol=1e-6)
            claim = claims[f"mode/a/{held}"]
            facts = numbers(claim)
            if claim.status == "proved":
                passive += 1
                assert max(np.linalg.eigvals(F).real) < 1e-6 * np.abs(F).max()
                for s in 1e-2 + 1j * np.logspace(-2, 6, 120):
                    Z = np.linalg.solve(s * np.eye(n) - F, B)[:2]
                    least = float(np.linalg.eigvalsh((Z + Z.conj().T) / 2)[0]) + facts.get("shortage eps", 0.0)
                    assert least > -1e-7 * np.abs(Z).max(), (K11, K12, K13, held)
    assert passive > enough
    assert T is None or coupled > 3


# --- tampering ---------------------------------------------------------------------------------------------------------

JUNK: list[Any] = [None, "", [], {}, 1, {"at": 1}, {"at": "nope"}, {"by": "dgu", "at": ["x"]}]
PROOF = {"factor": "1 0", "radius": "1", "voltages": ["400 0"], "weights": ["1 1"]}
WRONG: tuple[dict[str, Any], ...] = (
    {"factor": "0 0"},
    {"factor": "1"},
    {"factor": ["1"]},
    {"radius": "0"},
    {"voltages": {}},
    {"weights": []},
)
JUNK += [PROOF | wrong for wrong in WRONG]
for weight in ("0 1", "1 0", "-1 1", "1 -1", "1", "1 1 1", "1/" + "1" + "0" * 200 + " 1", "nan 1"):
    JUNK.append(PROOF | {"weights": [weight]})


@pytest.mark.parametrize("name", ["two-inverters.toml", "other-loads.toml", "custom-loop.json"])
def test_no_claim_takes_the_proof_of_another_for_a_different_status(name: str) -> None:
    spec = (ROOT / "specs" / name).read_bytes()
    document = json.loads(prove(spec).data)
    context = Context(decode(spec))
    for (claim, (subject, _)), entry in zip(statements(context).items(), document["claims"], strict=True):
        for (kind, status, rule), handler in RULES.items():
            if kind != subject[0]:
                continue
            for data in (*document["proofs"].values(), *JUNK):
                trial = copy.copy(context)
                trial.__dict__.update({k: copy.copy(x) for k, x in vars(context).items() if isinstance(x, dict | set)})
                try:
                    handler(trial, subject[1], Data(data))
                except RuleFailure:
                    continue
                assert status == entry["status"], (claim, rule, data)
        if entry["rule"]:
            RULES[subject[0], entry["status"], entry["rule"]](
                context, subject[1], Data(document["proofs"][entry["proof"]])
            )
        context.status[claim] = entry["status"]


def test_changed_proofs_of_an_equilibrium_are_rejected_or_true() -> None:
    rng, accepted = random.Random(5), 0
    for seed in (4, 9, 13, 21, 22, 28):
        net = random_net(random.Random(seed))
        spec = net_spec(net)
        certificate = prove(spec)
        if claims_of(certificate)["equilibrium/n0"].status != "proved":
            continue
        plant = Plant(net, rng, False)
        for _ in range(12):
            data = copy.deepcopy(proof_of(certificate, "equilibrium/n0"))
            step = 10 ** rng.uniform(-6, -1)
            for key, far in (("voltages", step), ("weights", 0.2)):
                data[key] = [
                    " ".join(
                        str(Fraction(x) * (1 + Fraction(f"{rng.uniform(-far, far):.8f}"))) for x in text.split(" ")
                    )
                    for text in data[key]
                ]
            data["radius"] = str(Fraction(f"{400 * step * rng.choice([0.1, 1, 3, 10]):.6g}"))
            try:
                verdict = check(spec, with_proof(certificate, "equilibrium/n0", "proved", "strong-monotonicity", data))
            except Rejected:
                continue
            accepted += 1
            claim = next(c for c in verdict.claims if c.id == "equilibrium/n0")
            centre = stated(claim, len(net["nodes"]))
            found = plant.rest(centre)
            assert found is not None
            off = max(abs(a - b) for a, b in zip(found, centre, strict=True))
            assert off <= numbers(claim)["radius of the proof"] * (1 + 1e-9) + 1e-8
    assert accepted > 8
