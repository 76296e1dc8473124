"""Attacks on proving with an older certificate: what it takes over, what it remembers, and what it is told."""

from __future__ import annotations

import copy
import json
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest

from certify import accepted
from certify.certificate import prove, to_canonical_json
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
