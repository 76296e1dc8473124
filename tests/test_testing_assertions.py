"""Assertions about specs: what they let pass, what they never take for something else, and what they say."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from certify import Spec
from certify.certificate import prove
from certify.inputs import read
from certify.kernel.errors import SpecError
from certify.testing import (
    Filter,
    assert_certified,
    assert_not_certified,
    assert_not_passive,
    assert_passive,
    assert_refuted,
    dgu_spec,
    w0,
)
from certify.testing.records import listening
from tests.conftest import ROOT

LC = Filter(R="0.1 ohm", L="1.8 mH", C="25 uF")
PHS = {"kind": "ida-pbc", "alpha": -5, "nu": 1, "ki": 100}
NEGATIVE = "specs/negative"
UNKNOWN = f"{NEGATIVE}/lossless.toml"
CONDITIONAL = dgu_spec(
    LC, {"kind": "constant"}, load={"kind": "zip", "Y": ["1 mS", "0 S"]}, voltage_band=["0.999 pu", "1.001 pu"]
)


def said(assertion: Any, *arguments: Any, **options: Any) -> str:
    with pytest.raises(AssertionError) as caught:
        assertion(*arguments, **options)
    return str(caught.value)


# --- the four verdicts --------------------------------------------------------------------------------------------


def test_certified() -> None:
    spec = "specs/two-inverters.toml"
    assert assert_certified(spec).verdict.outcome == "certified"
    assert said(assert_refuted, spec) == "certified, and not refuted: specs/two-inverters.toml"
    assert "not refuted: load/a of" in said(assert_refuted, spec, "load/a")
    assert said(assert_not_certified, spec).startswith("certified, and should not be")


def test_refuted() -> None:
    spec = "specs/cigre-mv-as-printed.toml"
    for claim in (None, "dgu", "dgu/1"):
        assert assert_refuted(spec, claim).verdict.outcome == "refuted"
    assert_not_certified(spec)
    message = said(assert_certified, spec)
    for words in (
        f"refuted, and not certified: {spec}",
        "refuted[frequency-witness] dgu/1",
        "Re(u* Z(s0) u): -954.329",
    ):
        assert words in message
    assert "[filter.lc]" not in message, "the file is named, so it is not printed"
    message = said(assert_refuted, spec, "dgu/2")
    assert "proved[quadratic-storage] dgu/2" in message


def test_unknown_is_neither_certified_nor_refuted() -> None:
    assert assert_not_certified(UNKNOWN).verdict.outcome == "unknown"
    assert "unknown, and not certified" in said(assert_certified, UNKNOWN)
    assert "unknown, and not refuted" in said(assert_refuted, UNKNOWN)
    assert "unknown[P203] invariant-set" in said(assert_refuted, UNKNOWN, "invariant-set")
    assert "= help:" in said(assert_certified, UNKNOWN)


def test_conditional_passes_only_by_name() -> None:
    message = said(assert_certified, CONDITIONAL)
    assert "conditional, and not certified" in message
    assert "to pass, it needs allow equilibrium/a" in message
    assert assert_certified(CONDITIONAL, allow=["equilibrium/a"]).verdict.outcome == "conditional"
    assert_certified(CONDITIONAL, allow="equilibrium/a")
    assert_certified(CONDITIONAL, allow="equilibrium/*")  # patterns, as in the gate
    assert "conditional" in said(assert_certified, CONDITIONAL, allow="region/*")
    assert "conditional" in said(assert_certified, CONDITIONAL, allow=["equilibrium/b", "balanced"])
    assert "should not be" in said(assert_not_certified, CONDITIONAL, allow=["equilibrium/a"])
    assert_not_certified(CONDITIONAL)
    assert "conditional, and not refuted" in said(assert_refuted, CONDITIONAL)


def test_a_claim_that_there_is_not() -> None:
    message = said(assert_refuted, "specs/two-inverters.toml", "dgu/z")
    assert "there is no claim 'dgu/z'" in message
    assert "dgu/a" in message


# --- what a spec may be -------------------------------------------------------------------------------------------


def test_every_kind_of_spec() -> None:
    path = Path("specs/two-inverters.toml")
    document = {
        "format": "certify/microgrid@1",
        "frequency": 50.0,
        "filter": {"lc": {"R": 0.1, "L": 1.8e-3, "C": 25e-6}},
    }
    document |= {
        "controller": {"c": PHS},
        "node": {"a": {"dgu": {"filter": "lc", "controller": "c", "reference": [1e4, 0]}}},
    }
    for spec in (path, str(path), path.read_bytes(), document, dgu_spec(LC, PHS), Spec.read(path)):
        assert_certified(spec)
    with pytest.raises(TypeError, match="a spec is"):
        assert_certified(3)


def test_bad_input_is_no_failed_assertion() -> None:
    for assertion in (assert_certified, assert_refuted, assert_not_certified):
        with pytest.raises(SpecError) as caught:
            assertion(dgu_spec({"R": 0.1, "L": "-1.8 mH", "C": 1}, {**PHS, "alpha": "kp"}))
        (note,) = caught.value.__notes__
        for words in (
            "error[S208]",
            "filter.lc.L",
            "error[S206]",
            "controller.law.alpha",
            "= help",
            "[filter.lc]\nR = 0.1",
        ):
            assert words in note
    with pytest.raises(SpecError) as caught:
        assert_passive(LC, {"kind": "ida-pbc"})
    assert "controller.law.alpha" in caught.value.__notes__[0]
    with pytest.raises(SpecError) as caught:
        assert_certified("specs/not-there.toml")
    assert "specs/not-there.toml" in str(caught.value.__notes__)


def test_a_certificate_that_is_there_is_checked() -> None:
    path = "specs/two-inverters.toml"
    proved = prove(read(path))
    with listening() as records:
        assert assert_certified(path, certificate=proved.data).data == proved.data
    assert [record.how for record in records] == ["checked"]
    assert "K103" in said(assert_certified, "specs/single-inverter.toml", certificate=proved.data)
    document = json.loads(proved.data)
    document["claims"][3]["status"] = "refuted"
    for broken in (proved.data[:-200], b"", json.dumps(document).encode()):
        for assertion in (assert_certified, assert_refuted, assert_not_certified):
            assert "does not prove what it says" in said(assertion, path, certificate=broken)


# --- one design ---------------------------------------------------------------------------------------------------


def feedback(cross: Any, L: Any = "L", sign: int = 1) -> dict[str, Any]:
    return {"K11": f"1 - 1 - {L}*1000", "K12": [["R - 5", f"-{cross}"], [cross, "R - 5"]], "K13": sign * 5000}


def test_passive_to_the_last_digit() -> None:
    assert_passive(LC, feedback("w0*L"))
    message = said(assert_passive, LC, feedback("w0*L*(1 + 1e-20)"))
    assert message.startswith("not passive\nrefuted[frequency-witness] dgu/a")
    assert len(message.splitlines()) < 40
    assert_not_passive(LC, feedback("w0*L*(1 + 1e-20)"))
    assert "not refuted\nproved[quadratic-storage]" in said(assert_not_passive, LC, feedback("w0*L"))
    # The network does not mind, because there is nothing that its shortage could harm.
    assert_certified(dgu_spec(LC, feedback("w0*L*(1 + 1e-20)")))


def test_floats_lose_it_and_are_told_how_not_to() -> None:
    gains = {"K11": 1 - 1 - float(LC.L) * 1000, "K13": 5000.0}
    turn = float(w0() * LC.L)
    for K12 in ([[-4.9, -turn], [turn, -4.9]], np.array([[-4.9, -turn], [turn, -4.9]])):
        assert "= help: gains are given as floats" in said(assert_passive, LC, gains | {"K12": K12})
    assert "given as floats" not in said(assert_passive, LC, feedback("2*w0*L"))


def test_a_frequency_of_its_own() -> None:
    law = feedback(w0("60 Hz") * LC.L)
    assert_passive(LC, law, frequency="60 Hz")
    assert_not_passive(LC, law)


def test_passive_in_a_box_is_not_to_be_had() -> None:
    assert "refuted[frequency-witness]" in said(assert_passive, LC.replaced(tolerance="5 %"), feedback("w0*L"))


# --- records and imports ------------------------------------------------------------------------------------------


def test_records_are_kept_for_listeners_only() -> None:
    assert_certified("specs/two-inverters.toml")
    with listening() as outer:
        assert_certified("specs/two-inverters.toml")
        with listening() as inner:
            assert_passive(LC, PHS)
    assert [(record.source, record.verdict.outcome) for record in outer] == [
        ("specs/two-inverters.toml", "certified"),
        ("", "certified"),
    ]
    assert outer[1:] == inner
    assert inner[0].how == "proved, without shortage"


def test_assertions_need_neither_hypothesis_nor_numpy() -> None:
    code = """
import sys
from certify.testing import assert_certified, assert_passive
assert_passive({"R": 0.1, "L": 1, "C": 1}, {"kind": "ida-pbc", "alpha": -5, "nu": 1, "ki": 100})
print(*({"hypothesis", "numpy", "pytest", "scipy"} & set(sys.modules)))
sys.modules["hypothesis"] = None
try:
    from certify.testing import filters
except ImportError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout == "\nstrategies need hypothesis: pip install 'certify-eip[testing]'\n"


def test_a_spec_that_no_file_can_hold_is_told_all_the_same() -> None:
    spec = b'{"format": "certify/microgrid@1", "name": "a\\ud800", "node": {}}'
    with pytest.raises(SpecError) as refused:
        assert_certified(spec)
    assert "\\ud800" in refused.value.__notes__[0]
