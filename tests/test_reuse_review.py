"""Attacks on proving with an older certificate: what it takes over, what it remembers, and what it is told."""

from __future__ import annotations

import copy
import json
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest

from certify import accepted
from certify.certificate import prove, to_canonical_json
from certify.comparison import compare
from certify.inputs import decode_all
from certify.reuse import prove_again
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
