"""A changed certificate is rejected, or says provably the same; a certificate of one spec does not pass for another."""

from __future__ import annotations

import copy
import json
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from certify.certificate import prove, to_canonical_json
from certify.cli import main
from certify.kernel.check import check, proof_key
from certify.kernel.errors import Rejected
from tests.conftest import ROOT

NAMES = [
    "specs/cigre-mv.toml",
    "specs/cigre-mv-as-printed.toml",
    "specs/two-inverters.toml",
    "specs/single-inverter.toml",
    "specs/negative/hidden-mode.toml",
    "specs/negative/reactive-exponent.toml",
    "specs/negative/lossless.toml",
    "specs/wrong-inductance.toml",
    "specs/negative/tolerance-too-large.toml",
]
SPECS = {name: (ROOT / name).read_bytes() for name in NAMES}
CERTIFICATES = {name: prove(spec) for name, spec in SPECS.items()}


def leaves(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Paths to every leaf and every container of a document."""
    if path:
        yield path
    if isinstance(value, dict):
        for key in value:
            yield from leaves(value[key], (*path, key))
    elif isinstance(value, list):
        for k, entry in enumerate(value):
            yield from leaves(entry, (*path, k))


def at(document: Any, path: tuple[Any, ...]) -> Any:
    for key in path:
        document = document[key]
    return document


def changed(document: Any, path: tuple[Any, ...], value: Any) -> bytes:
    document = copy.deepcopy(document)
    at(document, path[:-1])[path[-1]] = value
    return to_canonical_json(document)


REPLACEMENTS: tuple[Any, ...] = (None, "", "x", "0", "1", "-1", "1/0", "1/3", "01", "1e3", [], {}, ["1"], True, 0, 1)


@pytest.mark.parametrize("name", NAMES)
def test_any_replaced_value_is_rejected(name: str) -> None:
    spec, document = SPECS[name], json.loads(CERTIFICATES[name].data)
    tried = 0
    rng = random.Random(name)
    paths = [path for path in leaves(document) if path[0] != "provenance"]
    for path in rng.sample(paths, min(len(paths), 110)):
        for value in rng.sample(REPLACEMENTS, 4):
            if value == at(document, path) and type(value) is type(at(document, path)):
                continue
            tried += 1
            with pytest.raises(Rejected):
                check(spec, changed(document, path, value))
    assert tried > 100


@pytest.mark.parametrize("name", NAMES)
def test_provenance_says_nothing(name: str) -> None:
    document = json.loads(CERTIFICATES[name].data)
    for value in (None, {}, "anything", ["1"]):
        assert check(SPECS[name], changed(document, ("provenance",), value)) == CERTIFICATES[name].verdict


@pytest.mark.parametrize("name", NAMES)
def test_structure(name: str) -> None:
    """Claims left out, doubled, swapped, added; proofs exchanged; statuses raised."""
    spec, document = SPECS[name], json.loads(CERTIFICATES[name].data)
    claims = document["claims"]
    variants = [claims[1:], claims[:-1], [*claims, claims[0]], [claims[1], claims[0], *claims[2:]], []]
    for variant in variants:
        with pytest.raises(Rejected):
            check(spec, changed(document, ("claims",), variant))
    rng = random.Random(name)
    for k, claim in rng.sample(list(enumerate(claims)), min(len(claims), 7)):
        for other in rng.sample(claims, min(len(claims), 7)):
            for key in ("rule", "proof", "status", "statement", "id"):
                if other[key] != claim[key]:
                    with pytest.raises(Rejected):
                        check(spec, changed(document, ("claims", k, key), other[key]))
    with pytest.raises(Rejected):
        check(spec, changed(document, ("more",), 1))


@pytest.mark.parametrize("name", NAMES)
def test_consistently_renamed_proof_with_another_content_is_rejected(name: str) -> None:
    """A forger who also recomputes the key of the changed proof does not get past the rule."""
    spec, document = SPECS[name], json.loads(CERTIFICATES[name].data)
    rng, tried = random.Random(3), 0
    for key, data in document["proofs"].items():
        for path in leaves(data):
            old = at(data, path)
            if not isinstance(old, str) or old.isalpha():
                continue
            numbers = old.split(" ")
            position = rng.randrange(len(numbers))
            numbers[position] = rng.choice(["0", "1", "-7/3", "999999999999", f"{numbers[position]}1"])
            if numbers == old.split(" "):
                continue
            forged = copy.deepcopy(document)
            at(forged["proofs"][key], path[:-1])[path[-1]] = " ".join(numbers)
            new_key = proof_key(forged["proofs"][key])
            forged["proofs"][new_key] = forged["proofs"].pop(key)
            for claim in forged["claims"]:
                claim["proof"] = new_key if claim["proof"] == key else claim["proof"]
            tried += 1
            try:
                verdict = check(spec, to_canonical_json(forged))
            except Rejected:
                continue
            same = [(c.id, c.statement, c.status, c.rule) for c in verdict.claims]
            assert same == [(c.id, c.statement, c.status, c.rule) for c in CERTIFICATES[name].verdict.claims]
    assert tried > 0


@pytest.mark.parametrize("name", NAMES)
def test_lowering_a_claim_to_unknown_lowers_the_verdict(name: str) -> None:
    spec, document = SPECS[name], json.loads(CERTIFICATES[name].data)
    nothing = {"status": "unknown", "rule": None, "proof": None}
    document["claims"] = [
        {**c, **nothing, "statement": c["statement"].split(" - but for ")[0]} for c in document["claims"]
    ]
    document["proofs"], document["verdict"] = {}, "unknown"
    known = [entry for entry in document["assumptions"] if "/" not in entry["name"]]
    where = [(c["id"], c["statement"].split(" exactly")[0]) for c in document["claims"] if c["id"].startswith("equil")]
    text = " an equilibrium exists, as it is claimed: neither proved nor refuted"
    document["assumptions"] = [*known, *({"name": name, "statement": place + text} for name, place in where)]
    assert check(spec, to_canonical_json(document)).outcome == "unknown"
    document["verdict"] = "certified"
    with pytest.raises(Rejected, match="K111"):
        check(spec, to_canonical_json(document))


@pytest.mark.parametrize("name", NAMES)
def test_no_certificate_passes_for_another_spec(name: str) -> None:
    for other, spec in SPECS.items():
        if other != name:
            with pytest.raises(Rejected, match="K103"):
                check(spec, CERTIFICATES[name].data)


@settings(max_examples=75, deadline=None)
@given(st.sampled_from(NAMES), st.integers(0, 10**9), st.integers(0, 255))
def test_any_changed_byte_of_the_spec_is_rejected(name: str, position: int, byte: int) -> None:
    spec = bytearray(SPECS[name])
    position %= len(spec)
    if spec[position] == byte:
        return
    spec[position] = byte
    from certify.kernel.errors import SpecError

    with pytest.raises((Rejected, SpecError)):
        check(bytes(spec), CERTIFICATES[name].data)


@settings(max_examples=100, deadline=None)
@given(st.sampled_from(NAMES), st.integers(0, 10**9), st.integers(0, 255))
def test_any_changed_byte_of_the_certificate_is_rejected_or_says_the_same(name: str, position: int, byte: int) -> None:
    data = bytearray(CERTIFICATES[name].data)
    position %= len(data)
    data[position] = byte
    try:
        verdict = check(SPECS[name], bytes(data))
    except Rejected:
        return
    assert verdict == CERTIFICATES[name].verdict


@pytest.mark.parametrize(
    "text",
    [
        b"",
        b"{",
        b"[]",
        b"null",
        b"1",
        b'{"a": 1.5}',
        b'{"a": NaN}',
        b'{"a": 1, "a": 1}',
        b"\xff",
        b"[" * 100_000,
        b"9" * 10**6,
    ],
)
def test_garbage_is_rejected_with_exit_code_4(text: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "bad.json"
    file.write_bytes(text)
    assert main(["check", NAMES[0], str(file)]) == 4
    assert "rejected[K101]" in capsys.readouterr().err


def test_a_proof_for_the_corrected_gains_does_not_prove_the_printed_ones() -> None:
    """The forger takes the proof of the good spec over to the bad one, hash and all."""
    good, bad = (json.loads(CERTIFICATES[name].data) for name in NAMES[:2])
    good["spec_sha256"] = bad["spec_sha256"]
    with pytest.raises(Rejected, match=r"K201.*dgu/1"):
        check(SPECS[NAMES[1]], to_canonical_json(good))
