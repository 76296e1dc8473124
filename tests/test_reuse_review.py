"""Attacks on proving with an older certificate: what it takes over, what it remembers, and what it is told."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest

from certify import accepted
from certify.certificate import prove, to_canonical_json
from certify.comparison import compare, contents
from certify.inputs import decode_all
from certify.kernel.check import check
from certify.kernel.claims import Context
from certify.kernel.errors import Rejected
from certify.reuse import _prove_changes, _WholeError, prove_again
from certify.search.proposal import Proposal
from certify.search.prove import Search
from tests.test_reuse import BASE, CERTIFICATE, again, base, edited, faults_of, statuses, text

Spec = dict[str, Any]


@pytest.fixture(autouse=True)
def _any_size(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(accepted, "MIN_BYTES", 0)
    monkeypatch.setenv("CERTIFY_CACHE", str(tmp_path / "cache"))


@pytest.mark.parametrize("value", [None, {}, 5, {"R": 1, "L": 1, "C": 1}], ids=str)
@pytest.mark.parametrize("name", ["idle", "", "\ud800", "x\n", "a" * 65])
@pytest.mark.parametrize("section", ["filter", "controller"])
def test_a_new_part_that_nobody_has_is_read_all_the_same(section: str, name: str, value: object) -> None:
    """Null is a fault, and not the same as nothing; a name need not be one that can be encoded."""
    spec = text(edited(lambda s: s[section].update({name: value})))
    accepted.remember(text(BASE), CERTIFICATE.data)
    expected = faults_of(lambda: prove(spec))
    assert bool(expected) is not (section == "filter" and name == "idle" and isinstance(value, dict) and bool(value))
    assert faults_of(lambda: prove_again(spec, CERTIFICATE.data)) == expected


# --- what is taken over -----------------------------------------------------------------------------------------------


def mixed(legs: str = "included") -> Spec:
    """Two islands: inverters without feedback, a linear loop, a shortage, and loads of all kinds beside the edits."""
    spec = base(12, seed=4)
    spec["line_legs"] = legs
    spec["line"] = [x for x in spec["line"] if (int(x["from"][1:]) < 7) == (int(x["to"][1:]) < 7)]
    joined = {(x["from"], x["to"]) for x in spec["line"]}
    for ends in (("n7", "n8"), ("n8", "n9"), ("n9", "n10"), ("n10", "n11")):
        if ends not in joined:
            spec["line"].append({**spec["line"][0], "name": "-".join(ends), "from": ends[0], "to": ends[1]})
    spec["tolerance"] = {"load": "1 %"}
    spec["controller"] |= {
        "open": {"kind": "constant"},
        "loop": {
            "kind": "linear",
            "F": [[-100, 0, -1, 0], [0, -100, 0, -1], [1, 0, 0, 0], [0, 1, 0, 0]],
            "B": [[1, 0], [0, 1], [0, 0], [0, 0]],
            "C": [[1, 0, 0, 0], [0, 1, 0, 0]],
        },
    }
    spec["controller"]["c0"]["K12"] = [["R - ki*(1/kp + 1)", "-1.0001*w0*L"], ["1.0001*w0*L", "R - ki*(1/kp + 1)"]]
    nodes = spec["node"]
    for node in nodes.values():
        node["capacitance"] = "0.3 uF"
    nodes["n2"]["dgu"]["controller"] = "open"
    nodes["n6"]["dgu"] = {"controller": "loop", "reference": nodes["n6"]["dgu"]["reference"]}
    current = ["Vd*0.0001 + Vq*0.00003 + 0.1", "Vq*0.0001 - Vd*0.00003"]
    nodes["n1"]["load"] = [{"kind": "current", "I": current, "centre": ["1 pu", "0 V"], "radius": "0.2 pu"}]
    nodes["n4"].setdefault("load", []).append({"kind": "rl", "R": "2 kohm", "L": "1 H"})
    nodes["n8"]["load"] = [{"kind": "zip", "I": ["1 A", "0 A"], "below": "constant-impedance"}]
    return spec


SHORT: dict[str, Callable[[Spec], object]] = {
    "a filter without resistance": lambda s: s["filter"]["f8"].update(R=0),
    "a huge capacitor": lambda s: s["filter"]["f8"].update(C="1e30 F"),
    "a tiny capacitor": lambda s: s["filter"]["f4"].update(C="1e-30 F"),
    "all of two filters": lambda s: [s["filter"][name].update(R=1, L="9 mH", C="1 uF") for name in ("f4", "f8")],
    "filters swapped": lambda s: s["filter"].update(f4=s["filter"]["f8"], f10=s["filter"]["f4"]),
    "filters and a name": lambda s: (
        s["filter"].update({"7": s["filter"].pop("f8")}), s["node"]["n8"]["dgu"].update(filter=7)),
    "a gain near zero": lambda s: s["controller"]["c10"].update(ki="1e-30"),
    "controllers of another island": lambda s: s["node"]["n8"]["dgu"].update(controller="c10"),
    "another plant of the design": lambda s: s["controller"]["c8"].update(design={"R": 0}),
    "one for many": lambda s: [s["node"][f"n{k}"]["dgu"].update(controller="c10") for k in (4, 8, 10)],
}  # fmt: skip
WHOLE: dict[str, Callable[[Spec], object]] = {
    "no integral action": lambda s: s["controller"]["c8"].pop("K13"),
    "integral action of one axis": lambda s: s["controller"]["c8"].update(K13=[["ki", 0], [0, 0]]),
    "a ki of zero on one axis": lambda s: s["controller"]["c10"].update(ki=[100, 0]),
    "alpha is zero": lambda s: s["controller"]["c10"].update(alpha=0),
    "no feedback": lambda s: s["controller"].update(c8={"kind": "constant"}),
    "feedback where there was none": lambda s: s["node"]["n2"]["dgu"].update(controller="c10"),
    "the filter of an inverter without feedback": lambda s: s["filter"]["f2"].update(R="0.2 ohm"),
    "the filter of a shortage": lambda s: s["filter"]["f0"].update(C="26 uF"),
    "the loop": lambda s: s["controller"]["loop"].update(F=[[-90, 0, -1, 0], [0, -90, 0, -1], [1, 0, 0, 0], [0, 1, 0, 0]]),
    "a loop in place of gains": lambda s: s["node"]["n8"]["dgu"].update(controller="loop"),
    "a tolerance": lambda s: s["filter"]["f8"].update(tolerance={"C": "0.1 %"}),
    "limits": lambda s: s["node"]["n8"]["dgu"].update(limits=["60 kV", "60 kV"]),
}  # fmt: skip


@pytest.mark.parametrize(("legs", "part"), [("included", 0), ("neglected at DGUs", 1)])
def test_what_is_taken_over_would_be_accepted(legs: str, part: int) -> None:
    """Never another answer than without, also where equilibria and regions are kept."""
    spec = mixed(legs)
    certificate = prove(text(spec))
    rules = {c.id: c.rule for c in certificate.verdict.claims}
    assert (certificate.verdict.outcome, rules["dgu/n0"]) == ("certified", "index-storage")
    for name, change in list(SHORT.items())[part::2]:
        assert (name, again(edited(change, spec), certificate.data, text(spec)).whole) == (name, None)
    for name, change in list(WHOLE.items())[part::2]:
        with pytest.raises(_WholeError):
            pytest.fail(f"{name}: {_prove_changes(text(edited(change, spec)), certificate.data, None, None, False)}")


# --- the memory of this machine ---------------------------------------------------------------------------------------


def test_a_folder_is_private_wherever_it_is_reached_from(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sha, real, link = json.loads(CERTIFICATE.data)["spec_sha256"], tmp_path / "real", tmp_path / "link"
    real.mkdir(mode=0o700)
    link.symlink_to(real)
    monkeypatch.setenv("CERTIFY_CACHE", str(link))
    accepted.remember(text(BASE), CERTIFICATE.data)
    assert accepted.recall(sha, CERTIFICATE.data) == text(BASE)
    for mode in (0o770, 0o702, 0o1777):
        real.chmod(mode)
        assert accepted.recall(sha, CERTIFICATE.data) is None
        accepted.remember(text(BASE), CERTIFICATE.data + b" ")
        assert len(list(real.iterdir())) == 1
    real.chmod(0o700)
    assert accepted.recall(sha, CERTIFICATE.data + b" ") is None
    (entry,) = real.iterdir()
    other = tmp_path / "other"
    other.write_bytes(text(edited(lambda s: s.update(name="x"))))
    entry.unlink()
    entry.symlink_to(other)
    assert accepted.recall(sha, CERTIFICATE.data) is None
    entry.unlink()
    entry.symlink_to(entry)  # a loop
    assert accepted.recall(sha, CERTIFICATE.data) is None
    entry.unlink()
    entry.mkdir()
    assert accepted.recall(sha, CERTIFICATE.data) is None
    assert again(edited(lambda _: None)).whole  # it cannot be noted there either, which is no error


@pytest.mark.parametrize("sha", [None, 5, [], {}, "", "\ud800", "x" * 64])
def test_a_hash_of_another_kind_is_unknown(sha: object) -> None:
    accepted.remember(text(BASE), CERTIFICATE.data)
    document = json.loads(CERTIFICATE.data) | {"spec_sha256": sha}
    assert prove_again(text(BASE), json.dumps(document).encode()).whole


# --- older certificates that say less than they could --------------------------------------------------------------


def with_current(radius: str = "90 V") -> Spec:
    """A lone node with a load given by its current; the disk comes near to the pole at 0 V."""
    load = {"kind": "current", "centre": ["100 V", "0 V"], "radius": radius}
    load["I"] = [f"0.01*{V} + {V}/(Vd^2 + Vq^2)" for V in ("Vd", "Vq")]
    controller, reference = {"kind": "ida-pbc", "alpha": -5, "nu": 1, "ki": 100}, ["100 V", "0 V"]
    return {
        "format": "certify/microgrid@1",
        "frequency": "50 Hz",
        "filter": {"f": {"R": "0.1 ohm", "L": "1.8 mH", "C": "25 uF"}},
        "controller": {"c": controller},
        "node": {
            "a": {"dgu": {"filter": "f", "controller": "c", "reference": reference}},
            "b": {"capacitance": "1 uF", "load": [load]},
        },
        "line": [{"name": "l", "from": "a", "to": "b", "R": "0.4 ohm", "L": "1 mH", "C": "150 nF"}],
    }


def test_a_true_margin_of_next_to_nothing_hides_no_equilibrium() -> None:
    """The Lipschitz constant of a load, which encloses its current, may rest on the margin of the denominator."""
    spec = text(with_current())
    document = json.loads(prove(spec).data)
    claim = next(c for c in document["claims"] if c["id"] == "load/b")
    data = copy.deepcopy(document["proofs"][claim["proof"]])
    below, least = data["denominator"], Fraction(1, 10**90)
    first, _, others = below["gram"][0].partition(" ")
    below["gram"][0] = f"{Fraction(first) + Fraction(below['margin']) - least} {others}"
    below["margin"] = str(least)
    assert Search(decode_all(spec))._accepts("current", "b", Proposal("proved", "monotone-disk", data))
    document["proofs"][claim["proof"]] = data
    result = again(spec, to_canonical_json(document), known=False)
    assert result.certificate.verdict.outcome == "certified"


def test_the_proof_of_a_mode_with_a_shortage_is_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = text(edited(lambda s: s["node"]["n4"]["dgu"].update(limits=["60 kV", "60 kV"]), base(6)))
    certificate = prove(spec)
    assert {c.id: c.rule for c in certificate.verdict.claims}["mode/n4/d"] == "index-storage"
    monkeypatch.setattr("certify.search.shortage.propose_index", lambda *_: iter(()))
    result = prove_again(spec, certificate.data)
    assert statuses(result.certificate) == statuses(certificate)
    assert not result.again or {name.split("/")[0] for name in result.again} == {"saturated"}


COUPLED = {
    "kind": "state-feedback",
    "K11": "1 - 1000*L",
    "K12": [["R - 1001", "-w0*L"], ["w0*L", "R - 1001"]],
    "K13": [["1000", "100"], ["-100", "1000"]],
}


def with_anti_windup(T: str | None) -> Spec:
    """A node whose modes depend on how its integrators are led back, because K13 couples the axes."""

    def change(spec: Spec) -> None:
        spec["controller"]["c4"] = COUPLED
        spec["node"]["n4"]["dgu"].update(limits=["60 kV", "60 kV"], **({} if T is None else {"anti_windup": T}))

    return edited(change, base(6))


@pytest.mark.parametrize(("old", "new"), [(None, "20 ms"), ("20 ms", "1 ms"), ("20 ms", None)])
def test_another_anti_windup_is_never_overlooked(old: str | None, new: str | None) -> None:
    """The proofs of its modes are about other matrices: the short way is not taken, and the kernel refuses old ones."""
    before, after = with_anti_windup(old), with_anti_windup(new)
    ports = [Context(decode_all(text(spec))).port(("n4", "d")).F for spec in (before, after)]
    assert ports[0] != ports[1]
    assert ports[0][:4] == ports[1][:4]
    certificate, fresh = prove(text(before)), prove(text(after))
    accepted.remember(text(before), certificate.data)
    result = prove_again(text(after), certificate.data)
    assert result.whole
    assert result.taken_over == 0
    assert statuses(result.certificate) == statuses(fresh)
    assert {"mode/n4/d", "mode/n4/q"} <= set(result.again)
    document = json.loads(certificate.data) | {"spec_sha256": json.loads(fresh.data)["spec_sha256"]}
    if old is not None:  # without, the modes were refuted, by witnesses that refute them with it too
        with pytest.raises(Rejected):
            check(text(after), to_canonical_json(document))
    grids = decode_all(text(before)), decode_all(text(after))
    was, now = map(contents, grids)
    assert {name for name in was if was[name] != now[name]} == {f"mode/n4/{held}" for held in ("d", "q", "dq")}


# --- what is called kept -------------------------------------------------------------------------------------------


def kept(before: Spec, after: Spec) -> set[str]:
    proved = [prove(text(spec)).verdict for spec in (before, after)]
    grids = [decode_all(text(spec)) for spec in (before, after)]
    found = compare((grids[0], grids[1]), (proved[0], proved[1]))
    return {change.id for change in found.changes if change.what == "kept"}


def test_other_limits_mean_other_equilibria() -> None:
    """That every equilibrium inside the limits is stable says more with wider ones, as it does with wider bands."""
    narrow, wide = (
        edited(lambda s, v=volts: s["node"]["n4"]["dgu"].update(limits=[v, v]), base(6)) for volts in ("50 kV", "60 kV")
    )
    assert not kept(narrow, wide) & {"microgrid", "equilibrium/n0", "region/n0"}
    assert kept(narrow, wide) >= {"dgu/n4", "mode/n4/d", "invariant-set/n0"}


def test_a_claim_that_says_something_else_is_not_kept() -> None:
    """A larger shortage, other equilibria that are no more excluded, tolerances that are now covered."""
    spec = base(6)
    off = edited(lambda s: s["filter"]["f4"].update(tolerance="0.01 %"), spec)
    assert "equilibrium/n0" not in kept(spec, off)
    assert "equilibrium/n0" in kept(spec, spec)
    grid, verdict = decode_all(text(spec)), prove(text(spec)).verdict
    less = replace(verdict, claims=tuple(replace(c, statement=f"{c.statement} - but") for c in verdict.claims))
    assert {change.what for change in compare((grid, grid), (verdict, less)).changes} == {"proved again"}
