"""Loads given by their current, inside a spec: what they add up to, what may stand beside them, what is rejected."""

from __future__ import annotations

import json
from fractions import Fraction

import pytest

from certify.certificate import prove, to_canonical_json
from certify.kernel.check import check, proof_key
from certify.kernel.claims import Context
from certify.kernel.errors import Rejected, SpecError
from certify.kernel.spec import decode
from tests.conftest import ROOT

TEXT = (ROOT / "specs" / "other-loads.toml").read_text()
HEAD = TEXT[: TEXT.index("[node.a]")]
LINE = TEXT[TEXT.index("[[line]]") :]
DGU = 'dgu = { filter = "lc", controller = "pi", reference = ["1 pu", "0 pu"] }'


def spec(*loads: str) -> bytes:
    """Two nodes; these are the loads of node a, in TOML."""
    return f"{HEAD}[node.a]\n{DGU}\nload = [{', '.join(loads)}]\n[node.b]\n{DGU}\n{LINE}".encode()


def current(d: str, q: str, centre: str = '"1 pu", "0 pu"', radius: str = "0.1 pu") -> str:
    return f'{{ kind = "current", I = ["{d}", "{q}"], centre = [{centre}], radius = "{radius}" }}'


def status(data: bytes) -> tuple[str, str | None]:
    claim = next(c for c in prove(data).verdict.claims if c.id == "load/a")
    return claim.status, claim.rule


def test_the_sum_is_that_of_all_loads_at_the_node() -> None:
    """Evaluated against the currents of the parts, from their definitions."""
    loads = [
        current("Vd/40 + Vd^3/(2e7)", "Vq/60 - 5"),
        '{ kind = "zip", Y = ["1 mS", "2 mS"], P = ["600 W", "200 var"] }',
        '{ kind = "exp", P0 = "1 kW", np = 2, Q0 = "300 var", nq = 0 }',
    ]
    law, centre, radius = Context(decode(spec(*loads))).disk("a")
    assert (centre, radius) == ((400, 0), 40)
    for Vd, Vq in ((390, 7), (410, -20), (400, 0)):
        V, size = complex(Vd, Vq), Vd * Vd + Vq * Vq
        power = complex(600 + 1e3 * size / 400**2, -(200 + 300))  # P - jQ of what depends on |V| only
        admittance = complex(1e-3, -2e-3)
        wanted = complex(Vd / 40 + Vd**3 / 2e7, Vq / 60 - 5) + admittance * V + power / size * V
        found = law.current((Fraction(Vd), Fraction(Vq)))
        assert complex(*map(float, found)) == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize(
    ("loads", "expected"),
    [
        ([current("Vd/40", "Vq/40")], ("proved", "monotone-disk")),
        ([current("-Vq/40", "Vd/40")], ("proved", "monotone-disk")),  # a reactance: monotone, not strictly
        ([current("Vd/40 - Vq/10", "Vq/40")], ("refuted", "current-pair")),
        ([current("Vd*Vq/4000", "Vq/40")], ("refuted", "current-pair")),
        ([current("1000*Vd/(Vd^2 + Vq^2)", "1000*Vq/(Vd^2 + Vq^2)")], ("refuted", "current-pair")),  # constant power
        ([current("Vd/40", "Vq/40"), '{ kind = "zip", P = ["1 kW", "0 var"] }'], ("proved", "monotone-disk")),
        ([current("Vd/40", "Vq/40"), '{ kind = "zip", P = ["5 kW", "0 var"] }'], ("refuted", "current-pair")),
        ([current("-1/(Vd - 400)", "0")], ("unknown", None)),  # a pole in the disk, and rising on both sides of it
    ],
)
def test_decided(loads: list[str], expected: tuple[str, str | None]) -> None:
    found = status(spec(*loads))
    if expected[0] == "unknown":
        assert found[0] in ("unknown", "refuted")  # across the pole the current falls: a pair may show it
    else:
        assert found == expected


@pytest.mark.parametrize(
    ("loads", "code"),
    [
        ([current("Vd/40", "Vq/40"), current("Vd/40", "Vq/40")], "S310"),
        ([current("Vd/40", "Vq/40"), '{ kind = "zip", I = ["1 A", "0 A"] }'], "S310"),
        ([current("Vd/40", "Vq/40"), '{ kind = "exp", P0 = "1 kW", np = 1.5 }'], "S310"),
        ([current("Vd/40", "Vq/40"), '{ kind = "zip", P = ["1 kW", "0 var"], tolerance = "1 %" }'], "S310"),
        ([current("Vd/40", "Vq/40"), '{ kind = "zip", P = ["1 kW", "0 var"], below = "constant-impedance" }'], "S310"),
        ([current("Vd/40", "Vq/40", radius="0.3 pu"), '{ kind = "zip", P = ["1 kW", "0 var"] }'], "S310"),
        ([current("Vd/40", "Vq/40", radius="0 pu")], "S208"),
        ([current("Vd/40", "Vx/40")], "S206"),
        ([current("(Vd + Vq)^13", "Vq")], "S205"),
        ([current("((Vd + Vq)^9)^9", "Vq")], "S205"),
        ([current("1/(Vd - Vd)", "Vq")], "S207"),
        ([current("Vd^1e9", "Vq")], "S205"),
        ([current("Vd/40", "Vq/40").replace("centre", "center")], "S101"),
    ],
)
def test_what_does_not_fit_is_said(loads: list[str], code: str) -> None:
    with pytest.raises(SpecError) as caught:
        decode(spec(*loads))
    assert code in {fault.code for fault in caught.value.faults}
    assert all(fault.path.startswith("node.a") for fault in caught.value.faults)


def test_changed_proofs_are_rejected() -> None:
    data = TEXT.encode()
    document = json.loads(prove(data).data)
    claim = next(c for c in document["claims"] if c["id"] == "load/a")
    proof = document["proofs"].pop(claim["proof"])

    def with_proof(changed: dict[str, object], **of_claim: object) -> bytes:
        claims = [
            c if c["id"] != "load/a" else c | {"proof": proof_key(changed)} | of_claim for c in document["claims"]
        ]
        proofs = document["proofs"] | {proof_key(changed): changed}
        return to_canonical_json({**document, "claims": claims, "proofs": proofs})

    assert check(data, with_proof(proof)).outcome == "certified"
    gram = proof["gram"]
    first = gram[0].split(" ")
    first[0] = str(Fraction(first[0]) + Fraction(1, 10**9))
    for changed in (
        {**proof, "gram": [" ".join(first), *gram[1:]]},
        {**proof, "degree": "1/2"},
        {**proof, "degree": str(int(proof["degree"]) + 1)},
        {**proof, "disk": []},
        {**proof, "modulus": "1"},
        {**proof, "modulus": "0"},
        {key: value for key, value in proof.items() if key != "denominator"},
        {**proof, "denominator": {**proof["denominator"], "margin": "0"}},
        {**proof, "extra": "1"},
    ):
        with pytest.raises(Rejected, match="K201"):
            check(data, with_proof(changed))
    with pytest.raises(Rejected, match="K107"):
        check(data, with_proof(proof, rule="monotone-sos"))
    with pytest.raises(Rejected, match="K107"):
        check(data, with_proof({"points": "10"}, rule="sampled"))  # as a proof
    with pytest.raises(Rejected, match="K201"):  # what rests on a sample cannot be proved
        check(data, with_proof({"points": "10"}, rule="sampled", status="conditional"))


def test_a_shortage_beside_a_load_given_by_its_current() -> None:
    """A decoupling that is off by one percent leaves a shortage; the load's modulus and Lipschitz constant make up for it."""
    data = spec(current("Vd/40 + Vd^3/(2e7)", "Vq/30")).replace(b"w0*L", b"1.01*w0*L")
    certificate = prove(data)
    rules = {claim.id: claim.rule for claim in certificate.verdict.claims}
    assert rules["dgu/a"] == "index-storage"
    assert certificate.verdict.outcome == "certified"
    facts = {what for claim in certificate.verdict.claims if claim.id == "load/a" for what, _, _ in claim.facts}
    assert "strongly monotone with modulus" in facts


@pytest.mark.parametrize(
    "load",
    [current("Vd/40 + Vd^3/(2e7)", "Vq/30"), "{ kind = 'zip', Y = ['20 mS', '0 S'], band = ['1 V', '1 kV'] }"],
)
def test_a_shortage_beside_a_load_that_is_only_sampled(load: str) -> None:
    """No modulus is known of such a load: the rule about islands says so, to the search and in a certificate."""
    data = spec(load).replace(b"w0*L", b"1.01*w0*L")
    document = json.loads(prove(data).data)
    assert document["verdict"] == "certified"
    assert prove(data, method="sampled").verdict.outcome == "refuted"
    sample: dict[str, object] = {"points": "10"}
    for claim in document["claims"]:
        if claim["id"] == "load/a":
            claim |= {"status": "conditional", "rule": "sampled", "proof": proof_key(sample)}
        elif claim["id"] in ("invariant-set/a", "microgrid"):
            claim["status"] = "conditional"
    document["proofs"][proof_key(sample)] = sample
    with pytest.raises(Rejected, match=r"K201 at invariant-set/a.*not monotone enough"):
        check(data, to_canonical_json(document))
