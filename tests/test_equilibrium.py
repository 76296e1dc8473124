"""Equilibria, regions and modes under saturation, against calculations of other kinds."""

from __future__ import annotations

import json
import math
import random
import tomllib
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy
import pytest
from scipy.optimize import fsolve

from certify.certificate import Certificate, prove
from certify.cli import main
from certify.inputs import decode_all
from certify.kernel.claims import Claim
from certify.kernel.errors import SpecError
from certify.phases import read_phases
from certify.rests import read_region, read_rest
from tests import campaign_equilibria as campaign
from tests.conftest import ROOT
from tests.equilibrium_oracle import find_equilibria, read_network
from tests.network_cases import network_case

CIGRE = (ROOT / "specs" / "cigre-mv.toml").read_bytes()
FILTER = {"R": "0.1 ohm", "L": "1.8 mH", "C": "25 uF"}
BASE = {
    "format": "certify/microgrid@1",
    "frequency": "50 Hz",
    "base_voltage": "20 kV",
    "voltage_band": ["0.6 pu", "1.2 pu"],
    "filter": {"lc": FILTER},
    "controller": {"phs": {"kind": "ida-pbc", "alpha": -5, "nu": 1, "ki": 100}, "held": {"kind": "constant"}},
}
LINE = {"R": "0.4 ohm", "L": "1 mH", "C": "150 nF"}
W0 = 2 * math.pi * 50


def dgu(d: str = "1 pu", q: str = "0 pu", controller: str = "phs", **more: Any) -> dict[str, Any]:
    return {"dgu": {"filter": "lc", "controller": controller, "reference": [d, q], **more}}


def zip_load(Y: str = "70 uS", I: str = "0.3 A", P: str = "5 k", **more: Any) -> dict[str, Any]:  # noqa: E741
    return {"kind": "zip", "Y": [Y, Y], "I": [I, I], "P": [f"{P}W", f"{P}var"], **more}


def network(nodes: dict[str, Any], *pairs: str, **more: Any) -> bytes:
    lines = [{"name": pair, "from": pair[0], "to": pair[1], **LINE} for pair in pairs]
    return json.dumps({**BASE, "node": nodes, "line": lines, **more}).encode()


def claim(certificate: Certificate, name: str) -> Claim:
    return next(c for c in certificate.verdict.claims if c.id == name)


# --- CIGRE ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def phases() -> list[tuple[bytes, Certificate]]:
    return [(phase.spec, prove(phase.spec)) for phase in read_phases(CIGRE, "plug-in")]


def complex_network(spec: bytes) -> dict[str, Any]:
    """The numbers of a phase of CIGRE as floats, read by hand."""
    text = spec.decode()
    return json.loads(text) if text.startswith("{") else tomllib.loads(text)


def number(text: object) -> float:
    """Quantities as this spec writes them."""
    units = {"uS": 1e-6, "A": 1, "kW": 1e3, "kvar": 1e3, "pu": 20_000, "km": 1}
    value, unit = str(text).split(" ") if " " in str(text) else (text, "km")
    return float(value) * units[unit]


def solve_cigre(document: dict[str, Any]) -> dict[str, complex]:
    """All node voltages by scipy's fsolve on Kirchhoff's current law."""
    nodes = document["node"]
    fixed = {n: complex(*map(number, x["dgu"]["reference"])) for n, x in nodes.items() if "dgu" in x}
    free = [n for n in nodes if n not in fixed]
    lines = [
        (x["from"], x["to"], number(x["length"]) * complex(0.343, W0 * 0.875e-3), number(x["length"]) * 151.7e-9)
        for x in document["line"]
    ]

    def power(load: dict[str, Any], v: float) -> complex:
        if load["kind"] == "exp":
            return complex(
                number(load["P0"]) * (v / 20_000) ** float(load["np"]),
                number(load["Q0"]) * (v / 20_000) ** float(load["nq"]),
            )
        parts = [[number(x) for x in load[key]] for key in ("Y", "I", "P")]
        return sum(complex(*part) * v**e for part, e in zip(parts, (2, 1, 0), strict=True))

    def residual(x: numpy.ndarray) -> numpy.ndarray:
        V = fixed | {n: complex(x[2 * k], x[2 * k + 1]) for k, n in enumerate(free)}
        out = []
        for n in free:
            current = sum((power(load, abs(V[n])) / V[n]).conjugate() for load in nodes[n].get("load", ()))
            for a, b, z, c in lines:
                if n in (a, b):
                    current += (V[n] - V[b if n == a else a]) / z + 1j * W0 * c / 2 * V[n]
            out += [current.real, current.imag]
        return numpy.array(out)

    start = numpy.array([part for _ in free for part in (15_000.0, 14_000.0)])
    x = fsolve(residual, start, xtol=1e-12)
    return fixed | {n: complex(x[2 * k], x[2 * k + 1]) for k, n in enumerate(free)}


def test_cigre_rests_where_another_calculation_says(phases: list[tuple[bytes, Certificate]]) -> None:
    """In each phase of the paper's scenario to 1e-6 V, by fsolve in floats and by Newton in 60 digits."""
    assert len(phases) == 4
    for spec, certificate in phases:
        found = claim(certificate, "equilibrium/1")
        assert (found.status, found.rule) == ("proved", "strong-monotonicity")
        rest = read_rest(found)
        assert rest.radius < 1e-6
        for name, V in solve_cigre(complex_network(spec)).items():
            assert abs(rest.voltages[name] - V) < 1e-6
        document = json.loads(spec, parse_float=Fraction)
        (near,) = [s for s in find_equilibria(read_network(document)).solutions() if abs(s.voltages["7"]) > 12_000]
        stated = {name: value for name, value, _ in found.facts}
        for name, exact in near.voltages.items():
            for axis, part in (("d", exact.real), ("q", exact.imag)):
                assert abs(Fraction(str(part)) - stated[f"voltage at node {name}, {axis}"]) < Fraction(1, 10**9)
        for name, u in near.terminal_voltages.items():
            assert abs(complex(u) - rest.terminals[name]) < 1e-6
        for name, current in near.line_currents.items():
            assert abs(complex(current) - rest.lines[name]) < 1e-6


def test_cigre_returns_from_as_far_as_its_bands_let_it(phases: list[tuple[bytes, Certificate]]) -> None:
    """c = min C/2 (distance to the end of the band)^2 over nodes with load; node 8 sets it in every phase."""
    for spec, certificate in phases:
        document = complex_network(spec)
        V = solve_cigre(document)
        capacitance = {
            n: sum(number(x["length"]) * 151.7e-9 / 2 for x in document["line"] if n in (x["from"], x["to"]))
            + (25e-6 if "dgu" in node else 0)
            for n, node in document["node"].items()
        }
        levels = {
            n: capacitance[n] / 2 * min(abs(V[n]) - 12_000, 24_000 - abs(V[n])) ** 2
            for n, node in document["node"].items()
            if "load" in node
        }
        # upwards no load of this network is a limit: nonnegative ZIP and these exponents stay monotone
        lower = {n: capacitance[n] / 2 * (abs(V[n]) - 12_000) ** 2 for n in levels}
        lower = {n: x for n, x in lower.items() if document["node"][n]["load"][0]["kind"] == "zip"}
        region = read_region(claim(certificate, "region/1"))
        assert region.limit == f"node {min(lower, key=lower.__getitem__)}"
        assert region.level == pytest.approx(min(lower.values()), rel=1e-6)
        assert region.level >= min(levels.values())
        for n, volts in region.nodes.items():
            assert volts == pytest.approx(math.sqrt(2 * region.level / capacitance[n]), rel=1e-6)
        for line in document["line"]:
            henry = number(line["length"]) * 0.875e-3
            assert region.lines[line["name"]] == pytest.approx(math.sqrt(2 * region.level / henry), rel=1e-6)


def test_cut_offs_make_cigre_global() -> None:
    text = CIGRE.decode().replace('kind = "zip",', 'kind = "zip", below = "constant-impedance",')
    assert read_region(claim(prove(text.encode()), "region/1")).level is None


# --- other networks -----------------------------------------------------------------------------------------------


def test_constant_power_near_its_limit() -> None:
    """V = (1 + sqrt(1 - 4 P R))/2 in units of V0: proved up to close to the nose, never at or beyond it."""
    R = 100
    most = 20_000**2 / (4 * R)
    found = {}
    for share in (0.5, 0.9, 0.99, 1.001, 1.2):
        line = {"name": "ab", "from": "a", "to": "b", "R": R, "L": "1 nH", "C": "1 fF"}
        load = {"kind": "zip", "P": [f"{most * share:.6f} W", "0 var"], "band": ["0.01 pu", "2 pu"]}
        certificate = prove(json.dumps({**BASE, "node": {"a": dgu(), "b": {"load": [load]}}, "line": [line]}).encode())
        result = claim(certificate, "equilibrium/a")
        found[share] = (result.status, result.rule)
        if result.status == "proved":
            V = read_rest(result).voltages["b"]
            assert abs(V - 20_000 * (1 + math.sqrt(1 - share)) / 2) < 20
    assert found[0.5] == found[0.9] == ("proved", "local-monotonicity")  # the other one is in the band, too
    assert found[1.001] == found[1.2] == ("unknown", None)


def test_limits_that_are_too_narrow_refute() -> None:
    free = prove(network({"a": dgu(), "b": {"load": [zip_load()]}}, "ab"))
    u = read_rest(claim(free, "equilibrium/a")).terminals["a"]
    wide, narrow = (f"{abs(u.real) * 1.001:.3f} V", f"{abs(u.real) * 0.999:.3f} V")
    for limit, status in ((wide, "proved"), (narrow, "refuted")):
        certificate = prove(network({"a": dgu(limits=[limit, "20 kV"]), "b": {"load": [zip_load()]}}, "ab"))
        assert claim(certificate, "equilibrium/a").status == status
        assert (certificate.verdict.outcome == "refuted") == (status == "refuted")
    facts = {name: float(value) for name, value, _ in claim(certificate, "equilibrium/a").facts}
    assert facts["terminal voltage of the DGU at node a, d"] == pytest.approx(u.real)
    assert facts["its limit, d"] == pytest.approx(abs(u.real) * 0.999, rel=1e-6)


def test_a_reference_outside_the_band_refutes() -> None:
    spec = network({"a": {**dgu("1.3 pu"), "load": [zip_load()]}})
    certificate = prove(spec)
    found = claim(certificate, "equilibrium/a")
    assert (found.status, found.rule) == ("refuted", "reference-outside-band")
    assert float(found.facts[0][1]) == pytest.approx(26_000)
    at_the_end = prove(network({"a": {**dgu("1.2 pu"), "load": [zip_load()]}}))
    assert claim(at_the_end, "equilibrium/a").status == "refuted"  # strictly inside is what is claimed


def test_limits_are_part_of_the_region() -> None:
    nodes = {"a": dgu(limits=["20.5 kV", "1 kV"]), "b": {"load": [zip_load(below="constant-impedance")]}}
    region = read_region(claim(prove(network(nodes, "ab")), "region/a"))
    assert region.level is not None
    assert region.limit.startswith("the terminal voltage of the DGU at node a")
    free = {"a": dgu(), "b": {"load": [zip_load(below="constant-impedance")]}}
    assert read_region(claim(prove(network(free, "ab")), "region/a")).level is None


def test_an_inverter_held_at_a_constant_voltage_is_a_source() -> None:
    certificate = prove(network({"a": dgu(controller="held"), "b": {"load": [zip_load("2 mS", "0 A", "0 ")]}}, "ab"))
    assert certificate.verdict.outcome == "certified"
    rest = read_rest(claim(certificate, "equilibrium/a"))
    z, y, C = complex(0.1, W0 * 1.8e-3), 1 / complex(0.4, W0 * 1e-3), 150e-9
    load = complex(2e-3, -2e-3)
    A = numpy.array([[1 / z + 1j * W0 * (25e-6 + C / 2) + y, -y], [-y, y + load + 1j * W0 * C / 2]])
    V = numpy.linalg.solve(A, numpy.array([20_000 / z, 0]))
    assert abs(rest.voltages["a"] - V[0]) < 1e-6
    assert abs(rest.voltages["b"] - V[1]) < 1e-6
    assert rest.terminals["a"] == 20_000


def test_a_loop_of_ones_own_is_a_source_behind_what_a_current_changes() -> None:
    """specs/custom-loop.json by its own states: all derivatives zero, in one linear system of floats."""
    spec = (ROOT / "specs" / "custom-loop.json").read_bytes()
    rest = read_rest(claim(prove(spec), "equilibrium/inverter"))
    c, el, r, k = 5e-5, 2e-3, 2.0, 3.0
    y = 1 / complex(0.3, W0 * 0.6e-3)

    def out(house: complex) -> tuple[complex, complex]:
        """The voltage of the inverter and the mismatch at the house, for a voltage there."""
        z1 = -1 / (r + k + 1j * W0 * el)  # x1 = z1 x0
        leg = 1j * W0 * 10e-9
        # 0 = -j w0 c x0 + z1 x0 + d, V = 400 + x0
        a = -1j * W0 * c + z1
        x0 = ((y + leg) * 400 - y * house) / (a - y - leg)
        V = 400 + x0
        load = complex(10e-3, -2e-3) * house + complex(1, -0.5) * house / abs(house)
        return V, y * (V - house) - leg * house - load

    def residual(x: numpy.ndarray) -> tuple[float, float]:
        E = out(complex(*x))[1]
        return E.real, E.imag

    house = complex(*fsolve(residual, [390.0, 0.0], xtol=1e-13))
    assert abs(rest.voltages["house"] - house) < 1e-6
    assert abs(rest.voltages["inverter"] - out(house)[0]) < 1e-6


def test_islands_are_told_apart() -> None:
    nodes = {"a": dgu(), "b": {"load": [zip_load()]}, "c": dgu("1.05 pu"), "d": {"load": [zip_load()]}, "e": {}}
    certificate = prove(network(nodes, "ab", "cd", "ce", "de"))
    assert certificate.verdict.outcome == "certified"
    assert set(read_rest(claim(certificate, "equilibrium/a")).voltages) == {"a", "b"}
    assert set(read_rest(claim(certificate, "equilibrium/c")).voltages) == {"c", "d", "e"}


# --- saturation -----------------------------------------------------------------------------------------------------


def oscillator(ki: int, load: str) -> bytes:
    """THEORY's counterexample: both extreme modes are passive, and the network oscillates for ki = 1000 with R-L load."""
    controller = {"phs": {"kind": "ida-pbc", "alpha": -5, "nu": 1, "ki": ki}}
    loads = {
        "rl": [{"kind": "rl", "R": "50 ohm", "L": "100 mH"}],
        "static": [
            {
                "kind": "zip",
                "Y": [f"{50 / (2500 + (W0 * 0.1) ** 2):.12f} S", f"{W0 * 0.1 / (2500 + (W0 * 0.1) ** 2):.12f} S"],
            }
        ],
    }
    node = {**dgu("0.65 pu", "0.8 pu", limits=["14189 V", "17751 V"]), "load": loads[load]}
    return json.dumps({**BASE, "controller": controller, "node": {"a": node}}).encode()


@pytest.mark.parametrize(("ki", "load"), [(1000, "rl"), (100, "rl"), (1000, "static")])
def test_modes_are_decided_one_by_one_and_switching_is_not_covered(ki: int, load: str) -> None:
    certificate = prove(oscillator(ki, load))
    found = {name: claim(certificate, name) for name in ("dgu/a", "mode/a/d", "mode/a/q", "mode/a/dq")}
    assert (found["dgu/a"].rule, found["mode/a/dq"].rule) == ("quadratic-storage", "quadratic-storage")
    for axis in "dq":  # about -0.24 ohm near 0.01 rad/s
        mode = found[f"mode/a/{axis}"]
        facts = {name: float(value) for name, value, _ in mode.facts}
        assert mode.rule == "index-storage"
        assert facts["no shortage is enough below"] > 0.2
        assert facts["shortage eps"] == pytest.approx(facts["no shortage is enough below"], rel=0.06)
    ledger = dict(certificate.verdict.assumptions)
    assert "not covered" in ledger["unsaturated"]
    assert "switching" in ledger["unsaturated"]
    u = read_rest(claim(certificate, "equilibrium/a")).terminals["a"]
    assert (abs(u.real) * 1.1, abs(u.imag) * 1.1) == pytest.approx((14189, 17751), rel=1e-3)
    for c in certificate.verdict.claims:
        assert "saturat" not in c.statement or c.id.startswith("saturated/")
    region = read_region(claim(certificate, "region/a"))
    assert region.level is not None  # what is proved ends where an inverter may reach its limits
    assert region.limit.startswith("the terminal voltage")


def test_mode_of_one_axis_against_a_frequency_sweep() -> None:
    """The port with the d axis held, assembled here: L I_d' = -R I_d + w0 L I_q - V_d, no integrator of d."""
    R, L, C, alpha, nu, ki = 0.1, 1.8e-3, 25e-6, -5.0, 1.0, 1000.0
    h, x = alpha / nu, ki
    K11, K12, K13 = 1 - nu - L * x, h + R, -h * x
    F = numpy.zeros((5, 5))  # V_d, V_q, I_d, I_q, v_q
    F[0, 1], F[1, 0] = W0, -W0
    F[0, 2] = F[1, 3] = 1 / C
    F[2, 0], F[2, 2], F[2, 3] = -1 / L, -R / L, W0
    F[3, 1], F[3, 2], F[3, 3], F[3, 4] = (K11 - 1) / L, -W0 + W0, (K12 - R) / L, K13 / L
    F[4, 1] = -1
    B = numpy.zeros((5, 2))
    B[0, 0] = B[1, 1] = 1 / C
    least = 0.0
    for omega in numpy.logspace(-4, 4, 4000):
        Z = B.T @ numpy.linalg.solve(1j * omega * numpy.eye(5) - F, B) * C
        least = min(least, numpy.linalg.eigvalsh((Z + Z.conj().T) / 2)[0])
    facts = {name: float(value) for name, value, _ in claim(prove(oscillator(1000, "rl")), "mode/a/d").facts}
    assert facts["shortage eps"] >= -least
    assert facts["no shortage is enough below"] == pytest.approx(-least, rel=0.02)


# --- what goes wrong ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("limits", [["0 V", "20 kV"], ["20 kV", "-1 V"], [0, 0]])
def test_limits_of_zero_are_refused(limits: list[Any]) -> None:
    with pytest.raises(SpecError) as caught:
        decode_all(network({"a": dgu(limits=limits)}))
    assert all(fault.path.startswith("node.a.dgu.limits") for fault in caught.value.faults)
    assert "must be positive" in str(caught.value)


def test_messages_about_equilibria_that_are_not(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    heavy = zip_load("0 S", "0 A", "500 M")
    cases = {
        "outside its band": (network({"a": {**dgu("1.3 pu"), "load": [zip_load()]}}), 1, "modulus of the reference"),
        "beyond its limits": (
            network({"a": dgu("1 pu", limits=["1 pu", "1 pu"]), "b": dgu("0.9 pu")}, "ab"),
            1,
            "refuted[limits-exceeded] equilibrium/a",
        ),
        "too heavy": (network({"a": dgu(), "b": {"load": [heavy]}}, "ab"), 1, "unknown[P213] equilibrium/a"),
        "not regulated": (
            network(
                {"a": {"dgu": {**dgu()["dgu"], "controller": "p"}}},
                controller={"p": {"kind": "state-feedback", "K11": 0, "K12": -1}},
            ),
            3,
            "unknown[P212] equilibrium/a",
        ),
    }
    for name, (spec, code, message) in cases.items():
        path = tmp_path / "s.json"
        path.write_bytes(spec)
        assert main(["prove", str(path)]) == code, name
        told = capsys.readouterr().out
        assert message in told, name
        assert "= help:" in told or code == 1
    assert main(["gate", str(path), "--allow", "equilibrium/a"]) == 0
    assert main(["gate", str(path)]) == 3
    assert "--allow equilibrium/a" in capsys.readouterr().out


def test_the_story_of_cigre(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "c.json"
    path.write_bytes(prove(CIGRE).data)
    assert main(["explain", str(path), str(ROOT / "specs" / "cigre-mv.toml")]) == 0
    told = capsys.readouterr().out
    assert "A network with 6 DGUs, 9 nodes with static loads, 12 lines, 1 island; all parts are proved." in told
    assert "the only equilibrium with all loads in their bands" in told
    assert "What limits this is node 8: 8628.86 V are left there." in told
    assert "The largest currents flow in line 16 (7425 A)" in told


def test_a_node_called_terminal_is_no_terminal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The level is set by the band of the load there, and by a limit only where an inverter's terminals set it."""
    path = tmp_path / "s.json"
    nodes = {"a": dgu(), "terminal": {"load": [zip_load()]}}
    lines = [{"name": "a-t", "from": "a", "to": "terminal", **LINE}]
    path.write_bytes(json.dumps({**BASE, "node": nodes, "line": lines}).encode())
    assert main(["prove", str(path)]) == 0
    (line,) = (row for row in capsys.readouterr().out.splitlines() if row.startswith("region: "))
    assert "node terminal sets this level" in line
    assert line.endswith("away from the end of its band")


def test_a_region_that_rests_on_samples_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, certificate = tmp_path / "s.json", tmp_path / "c.json"
    path.write_bytes(network({"a": dgu(), "b": {"load": [zip_load()]}}, "ab"))
    assert main(["prove", str(path), "--method", "sampled", "-o", str(certificate)]) == 3
    assert "\nregion, if what the ledger says holds: motion from H <= " in capsys.readouterr().out
    assert main(["explain", str(certificate), str(path)]) == 3
    assert "\nIf what is assumed below holds: It returns from every state" in capsys.readouterr().out


@pytest.mark.parametrize("number", range(12))
def test_random_networks_against_the_oracle(number: int) -> None:
    """A part of `campaign_equilibria.py`: small networks, planted and random, near and beyond the nose."""
    case = network_case(number, 7)
    if len(case.document["node"]) <= 30:
        for result in campaign.compare(case, 7):
            assert result.mark not in (campaign.WRONG, campaign.FAILED, campaign.ABSENT), result


@pytest.mark.parametrize("seed", range(6))
def test_a_filter_without_feedback_is_the_same_as_a_loop_given_by_its_matrices(seed: int) -> None:
    """The equilibrium of a network with a `constant` inverter, and with the same inverter as a `linear` loop."""
    rng = random.Random(seed)
    own = {
        "R": f"{rng.uniform(0.01, 2):.4f}",
        "L": f"{rng.uniform(0.5, 5):.3f} mH",
        "C": f"{rng.uniform(5, 50):.2f} uF",
    }
    loop = {
        "kind": "linear",
        "F": [[0, "w0", "1/C", 0], ["-w0", 0, 0, "1/C"], ["-1/L", 0, "-R/L", "w0"], [0, "-1/L", "-w0", "-R/L"]],
        "B": [["1/C", 0], [0, "1/C"], [0, 0], [0, 0]],
        "C": [[1, 0, 0, 0], [0, 1, 0, 0]],
    }
    # without current the voltage of the filter is u less what its own capacitor draws
    z, y = complex(float(own["R"]), W0 * float(own["L"][:-3]) * 1e-3), 1j * W0 * float(own["C"][:-3]) * 1e-6
    u = complex(20_000, 2_000)
    found = []
    for name, controller, V in (("held", {"kind": "constant"}, u), ("own", loop, u / (1 + z * y))):
        dgu_ = {"filter": "lc", "controller": name, "reference": [f"{V.real:.10f} V", f"{V.imag:.10f} V"]}
        shunt = f"{2 + seed} uF"
        nodes = {
            "a": {"dgu": dgu_, "capacitance": shunt},
            "b": {"load": [zip_load("1 mS", "1 A")]},
            "c": {"load": [zip_load()]},
        }
        spec = network(nodes, "ab", "bc", "ca", filter={"lc": own}, controller={name: controller})
        found.append(read_rest(claim(prove(spec), "equilibrium/a")))
    for name, V in found[0].voltages.items():
        assert abs(V - found[1].voltages[name]) < 1e-7
    for name, current in found[0].lines.items():
        assert abs(current - found[1].lines[name]) < 1e-6
