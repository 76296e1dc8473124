"""Certificates against the simulator: they agree, and what is wrong with either is found, told and kept."""

from __future__ import annotations

import json
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy
import pytest

from certify.certificate import Certificate, prove
from certify.cli import main
from certify.crosscheck import run as crosscheck_run
from certify.crosscheck.claimed import Claimed
from certify.crosscheck.energy import Storage, Watch
from certify.crosscheck.falsify import Falsifier
from certify.crosscheck.findings import Finding, worst
from certify.crosscheck.model import DENSE_STATES, compare_model, compare_rest, find_reference
from certify.crosscheck.run import Checked, CrossCheck
from certify.inputs import decode_all
from certify.phases import read_phases
from certify.report.crosscheck import to_dict
from certify.report.scenario import prove_phases
from certify.simulation import Course, simulate
from certify.simulator.motion import Follower, natural_sizes
from certify.simulator.plant import Array, Plant
from certify.simulator.starts import start_state
from tests.bench.networks import microgrid
from tests.conftest import ROOT, SPECS

CIGRE = ROOT / "specs/cigre-mv.toml"
TWO = ROOT / "specs/two-inverters.toml"


def claimed_of(path: Path) -> tuple[Claimed, Array]:
    """A certificate, proved now, beside the plant; and the simulator's rest state."""
    data = path.read_bytes()
    certificate = prove(data)
    claimed = Claimed(Plant(decode_all(data)), certificate.data, certificate.verdict)
    rest = find_reference(claimed)
    assert rest is not None
    return claimed, rest


def watched(storage: Storage, start: str, end: float, tolerance: float = 1e-9) -> Watch:
    x = start_state(storage.plant, start)
    assert x is not None
    follower = Follower(storage.plant, x, tolerance)
    watch = Watch(storage, tolerance, natural_sizes(storage.plant, storage.rest))
    for piece in follower.pieces(x, 0.0, end):
        watch.see(piece)
    return watch


def contradictions(findings: list[Finding]) -> set[str]:
    return {found.kind for found in findings if not found.agrees}


@pytest.mark.parametrize("path", SPECS, ids=lambda p: p.stem)
def test_every_spec_agrees_with_its_certificate(path: Path) -> None:
    claimed, rest = claimed_of(path)
    findings = [*compare_model(claimed, rest), *compare_rest(claimed, rest)]
    # not only at rest: the model has to agree wherever a load has a slope
    rng = numpy.random.default_rng(2)
    findings += compare_model(claimed, rest * (1 + 0.02 * rng.normal(size=len(rest))))
    findings += watched(Storage(claimed, rest), "flat", 0.02).findings
    assert {found.kind for found in findings} >= {"model", "dissipation"}
    assert not contradictions(findings), [found for found in findings if not found.agrees]


def test_the_energy_balance_closes_to_rounding() -> None:
    """H + int psi, psi from the certificate's matrices: 1e-10 of 1.7 MJ is asked for."""
    claimed, rest = claimed_of(CIGRE)
    watch = watched(Storage(claimed, rest), "flat", 0.02, 1e-12)
    (balance,) = (found for found in watch.findings if found.kind == "energy balance")
    assert balance.value < 1e-12
    _, H = watch.storages()
    assert H[0, 0] == pytest.approx(1.713e6, rel=1e-3)
    assert (numpy.diff(H[:, 0]) <= 1e-12 * H[0, 0]).all()
    assert watch.covered_seconds[0] / watch.seconds == pytest.approx(1)


def test_a_scenario_agrees_phase_by_phase() -> None:
    spec = CIGRE.read_bytes()
    phases = read_phases(spec, "plug-in")
    proved = prove_phases(spec, phases)
    check = CrossCheck(phases, {p.phase.number: p.certificate.data for p in proved}, 1e-8, attempts=0)
    simulate(spec, "plug-in", end=Fraction(41, 10), samples=1, observe=check.see)
    first, second = check.finish()
    assert not first.contradictions + second.contradictions
    # the certificates say beforehand how far the event throws the network
    (jump,) = proved[1].jumps
    assert jump.storage_joule is not None
    assert second.storages[0, 0] == pytest.approx(float(jump.storage_joule), rel=1e-6)


def test_a_large_network_is_compared_by_random_directions() -> None:
    data = microgrid(200, mesh=True)
    certificate = prove(data)
    claimed = Claimed(Plant(decode_all(data)), certificate.data, certificate.verdict)
    assert claimed.plant.size > DENSE_STATES
    rest = find_reference(claimed)
    assert rest is not None
    findings = [*compare_model(claimed, rest), *compare_rest(claimed, rest)]
    assert not contradictions(findings)
    at = claimed.plant.slices["line", "l7"].start
    claimed.plant.A[at, at] *= 1 + 1e-3
    found = worst(compare_model(claimed, rest))
    assert found is not None
    assert not found.agrees


# --- what is wrong is found ------------------------------------------------------------------------------------


def test_a_storage_matrix_that_is_no_proof_is_noticed() -> None:
    claimed, rest = claimed_of(CIGRE)
    part = claimed.parts["dgu/2"]
    assert part.P is not None
    for i in (4, 0):
        P = part.P.copy()
        P[i, i] *= 1.05
        claimed.parts["dgu/2"] = replace(part, P=P)
        findings = watched(Storage(claimed, rest), "flat", 0.02).findings
        assert contradictions(findings) & {"dissipation", "energy balance"}
        assert all(found.state is not None and found.at_second is not None for found in findings)


def test_a_dissipation_that_is_too_small_opens_the_balance() -> None:
    claimed, rest = claimed_of(CIGRE)
    part = claimed.parts["line/16"]
    assert part.M is not None
    claimed.parts["line/16"] = replace(part, M=0.999 * part.M)
    assert contradictions(watched(Storage(claimed, rest), "flat", 0.02).findings) == {"energy balance"}


@pytest.mark.parametrize("path", [TWO, ROOT / "specs/custom-loop.json", ROOT / "specs/saturating-inverter.toml"])
def test_attempts_come_to_the_edge_and_not_beyond(path: Path) -> None:
    """What a region allows is sharp: a worst case comes to 99.9 % of it from 0.999 c, and none passes it."""
    claimed, rest = claimed_of(path)
    found = Falsifier(Storage(claimed, rest), 1e-8).run(8)
    assert not found.findings
    assert found.best is not None
    assert 0.99 < found.best.edge <= 1
    assert {attempt.kind for attempt in found.tried} == {"worst case", "random", "improved"}
    assert all(attempt.returned for attempt in found.tried if attempt.inside)
    assert [attempt for attempt in found.tried if not attempt.inside]


def test_a_region_that_is_too_large_is_left() -> None:
    claimed, rest = claimed_of(TWO)
    region = claimed.regions["a"]
    assert region.level is not None
    claimed.regions["a"] = replace(region, level=2 * region.level)
    found = Falsifier(Storage(claimed, rest), 1e-8).run(4)
    assert "region" in contradictions(found.findings)
    assert all(entry.start is not None for entry in found.findings)


def test_another_equilibrium_is_noticed() -> None:
    claimed, rest = claimed_of(TWO)
    claimed.rests["a"].voltages["b"] += 1e-3
    found = {entry.where: entry for entry in compare_rest(claimed, rest)}
    assert not found["a"].agrees
    (missing,) = compare_rest(claimed, None)
    assert not missing.agrees  # no number agrees with nothing


def test_no_number_never_agrees() -> None:
    found = Finding("model", "x", float("nan"), 1.0)
    assert not found.agrees
    assert worst([Finding("model", "y", 2.0, 1.0), found]) is found


def test_what_is_no_number_is_null_for_machines() -> None:
    checked = Checked(1, "certified", findings=[Finding("equilibrium", "a", float("nan"), 1e-8)])
    told = to_dict([checked], None)
    assert told["contradicted"]
    assert json.loads(json.dumps(told, allow_nan=False))["phases"][0]["contradictions"][0]["value"] is None


# --- as users meet it ----------------------------------------------------------------------------------------------


@pytest.fixture
def proved(tmp_path: Path) -> tuple[Path, Certificate]:
    certificate = prove(TWO.read_bytes())
    path = tmp_path / "two.cert.json"
    path.write_bytes(certificate.data)
    return path, certificate


def simulated(*arguments: str) -> int:
    return main(["simulate", str(TWO), "--end", "0.02", *arguments])


def test_agreement_is_told(proved: tuple[Path, Certificate], capsys: pytest.CaptureFixture[str]) -> None:
    assert simulated("--check", str(proved[0]), "--attempts", "2") == 0
    out = capsys.readouterr().out
    assert "CROSS-CHECKED: no contradiction" in out
    assert "2 attempts to break the region, none did" in out
    assert simulated("--check", str(proved[0]), "--attempts", "2", "--json") == 0
    told = json.loads(capsys.readouterr().out)["cross_check"]
    assert not told["contradicted"]
    assert {finding["kind"] for finding in told["phases"][0]["findings"]} >= {"model", "equilibrium", "energy balance"}
    assert len(told["phases"][0]["attempts"]) == 5


def test_a_contradiction_is_told_loudly_and_kept(
    proved: tuple[Path, Certificate], tmp_path: Path, monkeypatch: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    """A wrong sign in the simulator: exit code 4, and the motion that shows it in a file that can be read again."""
    monkeypatch.chdir(tmp_path)
    stamp = Plant._stamp

    def wrong(plant: Plant) -> None:
        stamp(plant)
        at = plant.slices["line", "a-b"].start
        plant.A[at, at] *= -1

    monkeypatch.setattr(Plant, "_stamp", wrong)
    assert simulated("--check", str(proved[0]), "--attempts", "0") == 4
    out = capsys.readouterr().out
    assert "CONTRADICTED: " in out
    assert "Jacobian, by differences: line/a-b" in out
    with numpy.load(tmp_path / "two-inverters.contradiction.npz", allow_pickle=False) as kept:
        about = json.loads(str(kept["metadata"]))
        assert about["contradiction"]["contradicted"]
        assert len(kept["times"]) == len(kept["states"]) > 100


def test_a_contradiction_of_an_attempt_is_kept_from_its_start(
    proved: tuple[Path, Certificate], tmp_path: Path, monkeypatch: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)

    class Doubled(Claimed):
        def __init__(self, *arguments: Any) -> None:
            super().__init__(*arguments)
            self.regions = {k: replace(r, level=2 * r.level) for k, r in self.regions.items() if r.level}

    monkeypatch.setattr(crosscheck_run, "Claimed", Doubled)
    assert simulated("--check", str(proved[0]), "--attempts", "3", "--start", "equilibrium") == 4
    assert "region is not left: a" in capsys.readouterr().out
    course = Course(TWO.read_bytes())
    with numpy.load(tmp_path / "two-inverters.contradiction.npz", allow_pickle=False) as kept:
        off = course.gather(course.plant(course.phases[0]), kept["states"][0])
    claimed, rest = claimed_of(TWO)
    level = claimed.regions["a"].level
    assert level is not None
    assert 1.5 * level < Storage(claimed, rest).of(off[None])[0, 0] < 2 * level


def test_prove_simulates_on_request(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["prove", str(ROOT / "specs/saturating-inverter.toml"), "--simulate"]) == 0
    out = capsys.readouterr().out
    assert out.index("CERTIFIED") < out.index("CROSS-CHECKED")
    assert main(["prove", str(ROOT / "specs/cigre-mv-as-printed.toml"), "--simulate", "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["exit_code"] == 1
    assert not told["cross_check"]["contradicted"]
    assert "no island" in told["cross_check"]["phases"][0]["reason"]


def test_bad_certificates_are_refused(
    proved: tuple[Path, Certificate], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other.cert.json"
    other.write_bytes(prove((ROOT / "specs/single-inverter.toml").read_bytes()).data)
    assert simulated("--check", str(other)) == 4
    assert "K103" in capsys.readouterr().err
    assert simulated("--check", str(tmp_path / "none.json")) == 2
    assert "U008" in capsys.readouterr().err
    # of a scenario every phase has its own, and all that are missing are told at once
    command = ["simulate", str(CIGRE), "--scenario", "plug-in", "--check"]
    assert main([*command, str(proved[0])]) == 2
    assert "is no folder" in capsys.readouterr().err
    assert main([*command, str(tmp_path)]) == 2
    assert capsys.readouterr().err.count("U008") == 4
    assert not list(tmp_path.glob("*.npz"))
