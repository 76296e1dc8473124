"""What a change of a spec does, told by `certify diff`."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest

from certify.certificate import prove
from certify.cli import main
from certify.comparison import CHANGES, compare, contents
from certify.inputs import decode_all
from certify.kernel.claims import Claim, Verdict
from certify.report.diff import render_diff
from tests.bench.networks import microgrid

CIGRE, PRINTED = "specs/cigre-mv.toml", "specs/cigre-mv-as-printed.toml"
Spec = dict[str, Any]
BASE: Spec = json.loads(microgrid(8))


def text(spec: Spec) -> bytes:
    return json.dumps(spec).encode()


def changes(change: Callable[[Spec], object]) -> dict[str, str]:
    """What becomes of each claim of the generated network."""
    spec = copy.deepcopy(BASE)
    change(spec)
    specs = (text(BASE), text(spec))
    verdicts = [prove(data).verdict for data in specs]
    grids = [decode_all(data) for data in specs]
    found = compare((grids[0], grids[1]), (verdicts[0], verdicts[1]))
    assert {change.what for change in found.changes} <= CHANGES.keys()
    return {change.id: change.what for change in found.changes}


def touched(found: dict[str, str]) -> dict[str, str]:
    return {name: what for name, what in found.items() if what != "kept"}


ISLAND = dict.fromkeys(("invariant-set/n0", "microgrid", "region/n0"), "proved again")
REST = {"equilibrium/n0": "proved again", "region/n0": "proved again"}


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda _: None, {}),
        (lambda s: s["node"]["n4"]["dgu"].update(reference=["0.9 pu", "0 V"]), REST),
        (lambda s: s["controller"]["c4"]["let"].update(kp="700"), {"dgu/n4": "proved again", **ISLAND}),
        (lambda s: s["filter"]["f4"].update(C="26 uF"), {"dgu/n4": "proved again", **ISLAND}),
        (lambda s: s["filter"]["f4"].update(R="100 mohm", L="1.8e-3"), {"dgu/n4": "proved again", **ISLAND}),
        (lambda s: s["node"]["n1"].update(load=[]), {"load/n1": "gone", **ISLAND, **REST}),
        (lambda s: s["node"]["n0"].update(load=BASE["node"]["n1"]["load"]), {"load/n0": "new", **ISLAND, **REST}),
        (  # "every equilibrium" is then about fewer of them
            lambda s: s["node"]["n4"]["dgu"].update(limits=["30 kV", "30 kV"]),
            {f"mode/n4/{held}": "new" for held in ("d", "q", "dq")}
            | {"saturated/n0": "new", "microgrid": "proved again", **REST},
        ),
        (lambda s: s["line"][0].update(R="2 ohm"), {"line/l0": "proved again", **ISLAND, **REST}),
        (
            lambda s: s["controller"]["c6"].update(alpha=5),
            {"dgu/n6": "lost", "invariant-set/n0": "lost", "microgrid": "lost", "region/n0": "lost"},
        ),
    ],
)
def test_what_a_change_touches(change: Callable[[Spec], object], expected: dict[str, str]) -> None:
    assert touched(changes(change)) == expected


def test_the_capacitance_of_a_line_is_that_of_the_dgus_at_its_ends() -> None:
    line = BASE["line"][0]
    found = touched(changes(lambda s: s["line"][0].update(C="100 nF")))
    ends = {f"dgu/{line[end]}" for end in ("from", "to") if "dgu" in BASE["node"][line[end]]}
    assert found == {**dict.fromkeys(ends, "proved again"), **ISLAND, **REST}


def test_the_frequency_touches_every_dgu_and_no_load() -> None:
    found = touched(changes(lambda s: s.update(frequency="60 Hz")))
    assert {name.split("/")[0] for name in found} == {"dgu", "invariant-set", "microgrid", "equilibrium", "region"}


def test_the_same_in_other_units_is_the_same() -> None:
    spec = copy.deepcopy(BASE)
    spec["filter"]["f4"]["R"] = f"{float(spec['filter']['f4']['R'].split()[0]) * 1000:.6f} mohm"
    assert contents(decode_all(text(spec))) == contents(decode_all(text(BASE)))


def test_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["diff", CIGRE, PRINTED]) == 1
    output = capsys.readouterr().out
    assert "lost (held before, and does no more):\n  dgu/1, invariant-set/1, microgrid, region/1" in output
    assert "refuted[frequency-witness] dgu/1" in output
    assert "Re(u* Z(s0) u): -954.329 ohm" in output
    assert output.endswith(f"before: CERTIFIED: {CIGRE}\nafter:  REFUTED: {PRINTED}\n")
    assert main(["diff", PRINTED, CIGRE]) == 0
    assert "gained (did not hold before, and does now)" in capsys.readouterr().out
    assert main(["diff", PRINTED, PRINTED, "--json"]) == 1
    result = json.loads(capsys.readouterr().out)
    assert (result["outcome_before"], result["outcome"], result["exit_code"]) == ("refuted", "refuted", 1)
    assert result["counts"]["open"] == 4
    assert {"id": "dgu/1", "change": "open", "before": "refuted", "after": "refuted"} in result["changes"]
    assert result["verdict"]["outcome"] == "refuted"


def test_bad_input_names_its_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bad = "specs/negative/misspelt-key.toml"
    for arguments in ([CIGRE, bad], [bad, CIGRE]):
        assert main(["diff", *arguments]) == 2
        assert f" --> {bad}:22: node.a.dgu.limts" in capsys.readouterr().err
    assert main(["diff", CIGRE, str(tmp_path / "missing"), "--json"]) == 2
    assert json.loads(capsys.readouterr().out)["faults"][0]["code"] == "S000"


def with_equilibrium(verdict: Verdict, facts: dict[str, str]) -> Verdict:
    listed = tuple((name, Fraction(value), name[0].upper()) for name, value in facts.items())
    claim = Claim("equilibrium/n0", "an equilibrium exists", "proved", "some-rule", listed)
    return replace(verdict, claims=(*verdict.claims, claim))


def test_what_moves_most(monkeypatch: pytest.MonkeyPatch) -> None:
    """The facts of claims about equilibria, by the farthest in the plane; names may hold anything."""
    data = text(BASE)
    certificate, grid = prove(data), decode_all(data)
    old = {
        f"{what} {k}, {axis}": "3" for what in ("voltage at node", "current in line") for k in range(9) for axis in "dq"
    }
    new = {**old, "voltage at node 4, q": "4", "voltage at node 7, d": "-3", "current in line 2, d": "7/2"}
    new |= {
        "voltage at node a, d, d": "1",
        "voltage at node a, d, q": "1",
        "voltage at node half, d": "1",
        "losses": "2",
    }
    verdicts = [with_equilibrium(certificate.verdict, facts) for facts in (old, new)]

    # The spec does not call for such a claim; its content is of no account here.
    monkeypatch.setattr("certify.comparison.contents", lambda _: {claim.id: 0 for claim in verdicts[0].claims})
    found = compare((grid, grid), (verdicts[0], verdicts[1]))
    assert [x.name for x in found.voltages] == ["7", "4"]
    assert [x.name for x in found.currents] == ["2"]
    assert found.voltages[0].degrees == pytest.approx(90)
    assert found.voltages[1].change == pytest.approx(5 - 18**0.5)
    options = type("Options", (), {"old": "a", "new": "b"})()
    shown = render_diff(options, found, certificate, certificate)
    assert "nodes whose voltage moves most:\n  7  4.24264 V  ->  4.24264 V" in shown
    assert "lines whose current changes most:\n  2 " in shown


def test_what_is_left_of_rounding_has_not_moved(monkeypatch: pytest.MonkeyPatch) -> None:
    data = text(BASE)
    certificate, grid = prove(data), decode_all(data)
    old = {f"voltage at node {k}, {axis}": "400" for k in "abc" for axis in "dq"}
    new = {**old, "voltage at node a, d": "400.0000000000001", "voltage at node b, d": "399"}
    new |= {"voltage at node c, d": "410", "voltage at node c, q": "410.0000000000001"}
    verdicts = [with_equilibrium(certificate.verdict, facts) for facts in (old, new)]
    monkeypatch.setattr("certify.comparison.contents", lambda _: {claim.id: 0 for claim in verdicts[0].claims})
    found = compare((grid, grid), (verdicts[0], verdicts[1]))
    assert [x.name for x in found.voltages] == ["c", "b"]
    shown = render_diff(type("Options", (), {"old": "a", "new": "b"})(), found, certificate, certificate)
    assert "+14.14 V" in shown
    assert "+0 deg" in shown
    assert "e-1" not in shown.split("moves most")[1].split("before")[0]


def test_a_certificate_in_place_of_a_spec_is_one_fault(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "cert.json"
    path.write_bytes(prove(text(BASE)).data)
    assert main(["diff", CIGRE, str(path), "--json"]) == 2
    (fault,) = json.loads(capsys.readouterr().out)["faults"]
    assert (fault["code"], fault["path"]) == ("S107", "format")
    assert "a certificate" in fault["message"]
