"""Proving with an older certificate: never another answer than without, and the short way only where it is sound."""

from __future__ import annotations

import copy
import json
import random
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from certify import accepted
from certify.certificate import Certificate, prove, to_canonical_json
from certify.cli import main
from certify.inputs import decode_all
from certify.kernel.check import check
from certify.kernel.errors import SpecError
from certify.reuse import prove_again
from certify.search.earlier import Earlier
from certify.search.proposal import Proposal
from certify.search.prove import Search
from tests.bench.networks import microgrid

Spec = dict[str, Any]


@pytest.fixture(autouse=True)
def _any_size(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Specs of any size are remembered, in a folder of each test."""
    monkeypatch.setattr(accepted, "MIN_BYTES", 0)
    monkeypatch.setenv("CERTIFY_CACHE", str(tmp_path / "cache"))


def base(nodes: int = 20, seed: int = 1) -> Spec:
    """A generated network: a DGU at every second node, PI and IDA-PBC in turn."""
    found: Spec = json.loads(microgrid(nodes, seed=seed))
    return found


def text(spec: Spec) -> bytes:
    return json.dumps(spec).encode()


BASE = base()
CERTIFICATE = prove(text(BASE))


def statuses(certificate: Certificate) -> list[tuple[str, str]]:
    return [(claim.id, claim.status) for claim in certificate.verdict.claims]


def again(spec: bytes | Spec, old: bytes = CERTIFICATE.data, of: bytes | None = None, known: bool = True) -> Any:
    """The spec proved with an older certificate, compared with a proof from nothing and with the checker."""
    if known:
        accepted.remember(of or text(BASE), old)
    data = spec if isinstance(spec, bytes) else text(spec)
    result = prove_again(data, old)
    fresh = prove(data)
    assert statuses(result.certificate) == statuses(fresh)
    verdict = check(data, result.certificate.data)
    assert verdict.outcome == result.certificate.verdict.outcome == fresh.verdict.outcome
    assert verdict.assumptions == result.certificate.verdict.assumptions
    assert [c.statement for c in verdict.claims] == [c.statement for c in result.certificate.verdict.claims]
    assert to_canonical_json(json.loads(result.certificate.data)) == result.certificate.data
    checked = {c.id: c.facts for c in verdict.claims}
    for claim in result.certificate.verdict.claims:
        assert result.whole is None or claim.facts == checked[claim.id]
        assert claim.id not in result.again or claim.facts == checked[claim.id]
    return result


def edited(change: Callable[[Spec], object], spec: Spec = BASE) -> Spec:
    spec = copy.deepcopy(spec)
    change(spec)
    return spec


def set_gain(spec: Spec, kp: object = 777, name: str = "c4") -> None:
    spec["controller"][name]["let"]["kp"] = kp


def choose(spec: Spec, node: str, **choice: str) -> None:
    spec["node"][node]["dgu"].update(choice)


def fresh_controller(spec: Spec) -> None:
    """As `certify synth` does it: a controller and a filter of its own for one node."""
    spec["controller"]["mine"] = {**spec["controller"]["c4"], "let": {"kp": 900, "ki": 800}}
    spec["filter"]["own"] = {"R": "0.2 ohm", "L": "2 mH", "C": "20 uF"}
    choose(spec, "n8", controller="mine", filter="own")


SHORT: dict[str, tuple[Callable[[Spec], object], set[str]]] = {
    "one gain": (set_gain, {"dgu/n4"}),
    "a gain of another kind": (lambda s: s["controller"]["c6"].update(nu="1.5"), {"dgu/n6"}),
    "two gains": (lambda s: (set_gain(s), s["controller"]["c6"].update(ki=90)), {"dgu/n4", "dgu/n6"}),
    "a filter": (lambda s: s["filter"]["f4"].update(C="31 uF", L="1.7 mH"), {"dgu/n4"}),
    "another filter": (lambda s: choose(s, "n4", filter="f8"), {"dgu/n4"}),
    "another controller": (lambda s: choose(s, "n4", controller="c6"), {"dgu/n4"}),
    "a controller and a filter of its own": (fresh_controller, {"dgu/n8"}),
    "its old filter and controller removed": (
        lambda s: (fresh_controller(s), s["filter"].pop("f8"), s["controller"].pop("c8")), {"dgu/n8"}),
    "a controller replaced by one of another kind": (
        lambda s: s["controller"].update(c4=s["controller"]["c6"]), {"dgu/n4"}),
    "a controller that nobody has": (lambda s: s["controller"].update(idle=s["controller"]["c4"]), {"dgu/n0"}),
    "the order of let": (
        lambda s: s["controller"]["c4"].update(let=dict(reversed(s["controller"]["c4"]["let"].items()))), {"dgu/n4"}),
    "a number as text": (lambda s: set_gain(s, "777"), {"dgu/n4"}),
    "nothing": (lambda _: None, {"dgu/n0"}),
}  # fmt: skip


@pytest.mark.parametrize("case", SHORT, ids=str)
def test_short_way(case: str) -> None:
    change, expected = SHORT[case]
    result = again(edited(change))
    assert result.whole is None
    assert set(result.again) == expected
    assert result.taken_over == len(CERTIFICATE.verdict.claims) - len(expected)


def linear(spec: Spec) -> None:
    spec["controller"]["c4"] = {
        "kind": "linear",
        "F": [["-1", "0"], ["0", "-1"]],
        "B": [["1", "0"], ["0", "1"]],
        "C": [["1", "0"], ["0", "1"]],
    }


WHOLE: dict[str, Callable[[Spec], object]] = {
    "a line": lambda s: s["line"][3].update(R="0.41 ohm"),
    "a line rewired": lambda s: s["line"][3].update({"from": "n1", "to": "n9"}),
    "a line less": lambda s: s["line"].pop(17),
    "lines in another order": lambda s: s["line"].reverse(),
    "a reference": lambda s: s["node"]["n4"]["dgu"].update(reference=["1 pu", "0.01 pu"]),
    "anti-windup": lambda s: s["node"]["n4"]["dgu"].update(limits=["60 kV", "60 kV"], anti_windup="20 ms"),
    "limits": lambda s: s["node"]["n4"]["dgu"].update(limits=["14 kV", "30 kV"]),
    "a load at a lone node": lambda s: s["node"]["n3"].update(load=[{"kind": "zip", "Y": ["1 mS", "1 mS"]}]),
    "a load that is not monotone": lambda s: s["node"]["n3"].update(load=[{"kind": "zip", "P": ["9 MW", "0 var"]}]),
    "a load at a DGU": lambda s: s["node"]["n4"].update(load=[]),
    "a capacitance": lambda s: s["node"]["n4"].update(capacitance="1 uF"),
    "a new node": lambda s: s["node"].update(x={"dgu": s["node"]["n4"]["dgu"]}),
    "a node without its DGU": lambda s: s["node"]["n4"].pop("dgu"),
    "nodes in another order": lambda s: s.update(node=dict(reversed(s["node"].items()))),
    "the name": lambda s: s.update(name="another"),
    "the frequency": lambda s: s.update(frequency="60 Hz"),
    "a tolerance of all lines": lambda s: s.update(tolerance={"line": "0.01 %"}),
    "a tolerance of one filter": lambda s: s["filter"]["f4"].update(tolerance="1 %"),
    "a linear loop": linear,
    "an unstable gain": lambda s: s["controller"]["c6"].update(alpha=5),
    "a gain that leaves a shortage": lambda s: s["controller"]["c4"].update(
        K12=[["R - ki*(1/kp + 1)", "-2*w0*L"], ["2*w0*L", "R - ki*(1/kp + 1)"]]
    ),
    "the legs of lines": lambda s: s.update(line_legs="neglected at DGUs"),
    "the base voltage": lambda s: s.update(base_voltage="21 kV"),
    "a scenario": lambda s: s.update(scenario={"one": {"end": "1 s"}}),
}


@pytest.mark.parametrize("case", WHOLE, ids=str)
def test_whole_way(case: str) -> None:
    result = again(edited(WHOLE[case]))
    assert result.whole
    assert result.taken_over == 0


def test_an_unstable_gain_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = [tmp_path / name for name in ("old.json", "old.cert", "new.json", "new.cert")]
    files[0].write_bytes(text(BASE))
    files[2].write_bytes(text(edited(WHOLE["an unstable gain"])))
    spec, certificate, changed, new = map(str, files)
    assert main(["prove", spec, "-o", certificate]) == 0
    capsys.readouterr()
    assert main(["prove", changed, "--reuse", certificate, "-o", new]) == 1
    output = capsys.readouterr().out
    assert "refuted[frequency-witness] dgu/n6" in output
    assert "claims were checked" in output
    assert main(["check", changed, new]) == 1
    files[2].write_bytes(text(edited(set_gain)))
    assert main(["prove", changed, "--reuse", certificate, "-o", new]) == 0
    output = capsys.readouterr().out
    assert "decided again: 1 (dgu/n4), and checked" in output
    assert f"taken over: {len(CERTIFICATE.verdict.claims) - 1}" in output
    assert "certify check" in output
    assert main(["check", changed, new]) == 0
    capsys.readouterr()
    files[2].write_bytes(text(edited(lambda s: (set_gain(s), s["controller"]["c6"].update(ki=90)))))
    assert main(["prove", changed, "--reuse", new, "-o", new, "--json"]) == 0
    reuse = json.loads(capsys.readouterr().out)["reuse"]
    assert (reuse["decided_again"], reuse["why_all"]) == (["dgu/n6"], None)
    assert reuse["checked"] + reuse["taken_over"] == len(CERTIFICATE.verdict.claims)
    assert check(files[2].read_bytes(), files[3].read_bytes()).outcome == "certified"


def test_two_edits_that_cancel() -> None:
    first = again(edited(set_gain))
    back = again(BASE, first.certificate.data, text(edited(set_gain)))
    assert back.whole is None
    before, after = (json.loads(data) for data in (CERTIFICATE.data, back.certificate.data))
    for document in (before, after):
        document.pop("provenance")
    assert before == after


def test_two_edits_that_cancel_within_one_spec() -> None:
    """Content moves from one name to another: both DGUs are looked at, and nothing is mixed up."""

    def swap(spec: Spec) -> None:
        table = spec["controller"]
        table["c4"], table["c8"] = table["c8"], table["c4"]

    assert set(again(edited(swap)).again) == {"dgu/n4", "dgu/n8"}
    swapped = edited(lambda s: (swap(s), choose(s, "n4", controller="c8"), choose(s, "n8", controller="c4")))
    assert again(swapped).whole is None


def test_shared_controller() -> None:
    spec = edited(lambda s: [choose(s, f"n{k}", controller="c4", filter="f4") for k in range(0, 20, 2)])
    certificate = prove(text(spec))
    result = again(edited(set_gain, spec), certificate.data, text(spec))
    assert result.whole is None
    assert len(result.again) == 10


def test_a_pin_that_is_affected_is_checked() -> None:
    """Without loads a DGU pins the voltages of its island."""
    spec = base(6)
    for node in spec["node"].values():
        node.pop("load", None)
    certificate = prove(text(spec))
    pin = next(iter(p for p in json.loads(certificate.data)["proofs"].values() if "at" in p))
    assert pin["by"] == "dgu"
    name = pin["at"].replace("n", "c")
    assert again(edited(lambda s: set_gain(s, 600, name), spec), certificate.data, text(spec)).whole is None
    loose = edited(lambda s: s["controller"].update({name: {"kind": "state-feedback", "K11": 0, "K12": "R"}}), spec)
    assert again(loose, certificate.data, text(spec)).whole


def test_shortages_elsewhere_stay() -> None:
    cross = [["R - ki*(1/kp + 1)", "-1.0001*w0*L"], ["1.0001*w0*L", "R - ki*(1/kp + 1)"]]
    spec = edited(lambda s: s["controller"]["c4"].update(K12=cross), base(6))
    certificate = prove(text(spec))
    short = {c.id: c.rule for c in certificate.verdict.claims}
    assert (certificate.verdict.outcome, short["dgu/n4"]) == ("certified", "index-storage")
    result = again(edited(lambda s: set_gain(s, 700, "c0"), spec), certificate.data, text(spec))
    assert result.whole is None
    facts = {c.id: c.facts for c in result.certificate.verdict.claims}
    assert facts["dgu/n4"][0][0] == "shortage eps"
    # The DGU with the shortage itself goes the whole way: with it, and when it becomes passive again.
    assert again(edited(lambda s: set_gain(s, 700), spec), certificate.data, text(spec)).whole
    mended = again(edited(lambda s: s["controller"].update(c4=base(6)["controller"]["c4"]), spec), certificate.data)
    assert {c.id: c.rule for c in mended.certificate.verdict.claims}["dgu/n4"] == "quadratic-storage"


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.text(),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
        max_leaves=30,
    ),
    st.integers(0, 20),
)
def test_certificates_are_written_as_json_would(value: Any, depth: int) -> None:
    for _ in range(depth):
        value = [value, "x"]
    written = json.dumps({"a": value}, sort_keys=True, indent=1, ensure_ascii=False) + "\n"
    assert to_canonical_json({"a": value}) == written.encode()


# --- what is not believed -------------------------------------------------------------------------------------------


def tampered(change: Callable[[Spec], object]) -> bytes:
    return to_canonical_json(edited(change, json.loads(CERTIFICATE.data)))


def one_number(document: Spec) -> None:
    key = next(c["proof"] for c in document["claims"] if c["id"] == "dgu/n8")
    rows = document["proofs"][key]["storage"]
    rows[0] = rows[0].replace("1", "2", 1)


@pytest.mark.parametrize(
    "change",
    [
        one_number,
        lambda d: d["claims"][-2].update(proof=None),
        lambda d: d["claims"].reverse(),
        lambda d: d.update(claims=[None, 1, "x", {}, {"id": []}, {"id": "dgu/n4", "status": "proved"}]),
        lambda d: [c.update(status="proved", rule="series-branch") for c in d["claims"]],
        lambda d: [c.update(rule="no-such-rule") for c in d["claims"]],
        lambda d: d.update(proofs={key: {"storage": [[]], "shortage": {}, "witness": 1} for key in d["proofs"]}),
        lambda d: d.update(proofs=[]),
        lambda d: d.update(provenance={"anything": None}),
    ],
)
def test_tampered_certificate_goes_the_whole_way(change: Callable[[Spec], object]) -> None:
    accepted.remember(text(BASE), CERTIFICATE.data)
    old = tampered(change)
    assert old != CERTIFICATE.data
    result = again(edited(set_gain), old, known=False)
    assert result.whole
    assert result.certificate.verdict.outcome == "certified"


def test_a_wrong_larger_shortage_does_no_harm() -> None:
    """An older proof with so large a shortage that no line makes up for it is dropped for a new search."""
    cross = [["R - ki*(1/kp + 1)", "-1.0001*w0*L"], ["1.0001*w0*L", "R - ki*(1/kp + 1)"]]
    spec = edited(lambda s: s["controller"]["c4"].update(K12=cross), base(6))
    certificate = prove(text(spec))
    document = json.loads(certificate.data)
    key = next(c["proof"] for c in document["claims"] if c["id"] == "dgu/n4")
    document["proofs"][key]["shortage"] = "1000"
    result = again(spec, to_canonical_json(document), known=False)
    assert result.certificate.verdict.outcome == "certified"


def test_a_proof_that_fails_half_way_leaves_nothing_behind() -> None:
    """A true storage with a witness that refutes nothing: no search may take the DGU for proved, nor for short."""
    cross = [["R - ki*(1/kp + 1)", "-1.0001*w0*L"], ["1.0001*w0*L", "R - ki*(1/kp + 1)"]]
    spec = edited(lambda s: s["controller"]["c4"].update(K12=cross), base(6))
    document = json.loads(prove(text(spec)).data)
    data = document["proofs"][next(c["proof"] for c in document["claims"] if c["id"] == "dgu/n4")]
    data["witness"] = {"s0": "1 0", "u": ["0 0", "0 0"]}
    result = again(spec, to_canonical_json(document), known=False)
    rules = {c.id: (c.rule, len(c.facts)) for c in result.certificate.verdict.claims}
    assert rules["dgu/n4"] == ("index-storage", 2)  # without the witness, so without the fact that it adds
    search = Search(decode_all(text(spec)))
    assert not search._accepts("dgu", "n4", Proposal("proved", "index-storage", data))
    assert "n4" not in search.context.shortages.keys() | search.context.storages.keys()


@pytest.mark.parametrize(
    "old",
    [
        b"",
        b"\xff",
        b"[]",
        b"{}",
        CERTIFICATE.data[:5000],
        text(BASE),
        b'{"format":"certify/loads@1"}\n',
        CERTIFICATE.data.replace(b"certificate@1", b"certificate@9"),
        CERTIFICATE.data.replace(b'"claims"', b'"claim"'),
        b"[" * 100_000,
        b'{"spec_sha256": 1}',
    ],
)
def test_not_a_certificate(old: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SpecError) as caught:
        prove_again(text(BASE), old)
    assert [fault.code for fault in caught.value.faults] == ["U003"]
    file, out = tmp_path / "old", tmp_path / "new"
    file.write_bytes(old)
    assert main(["prove", "specs/two-inverters.toml", "--reuse", str(file), "-o", str(out)]) == 2
    assert "error[U003]" in capsys.readouterr().err
    assert not out.exists()


def test_no_such_file(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["prove", "specs/two-inverters.toml", "--reuse", "missing.json", "--json"]) == 2
    assert json.loads(capsys.readouterr().out)["faults"][0]["code"] == "U003"


def test_certificate_of_another_spec_and_toml(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "c.json"
    main(["prove", "specs/two-inverters.toml", "-o", str(file)])
    assert main(["prove", "specs/cigre-mv.toml", "--reuse", str(file)]) == 0
    assert main(["prove", "specs/cigre-mv-as-printed.toml", "--reuse", str(file)]) == 1
    main(["prove", "specs/cigre-mv-as-printed.toml", "-o", str(file)])
    assert main(["prove", "specs/cigre-mv.toml", "--reuse", str(file)]) == 0
    capsys.readouterr()


@pytest.mark.parametrize("name", ["cigre-mv-as-printed", "cigre-mv-cross-2w0", "wrong-inductance", "other-loads"])
def test_refutations_and_shortages_are_tried_again(name: str, specs: Path) -> None:
    spec = (specs / f"{name}.toml").read_bytes()
    certificate = prove(spec)
    result = again(spec, certificate.data, spec)
    before, after = (json.loads(data)["claims"] for data in (certificate.data, result.certificate.data))
    assert before == after


def test_proofs_of_others_serve_a_new_name(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = edited(lambda s: [choose(s, f"n{k}", controller="c4", filter="f4") for k in range(0, 20, 2)])
    document = json.loads(prove(text(spec)).data)
    monkeypatch.setattr("certify.search.prove.propose_dgu", lambda _: iter(()))
    renamed = text(spec).replace(b'"n4"', b'"m4"')
    proved = prove(renamed, earlier=Earlier(document))
    assert {c.id: c.rule for c in proved.verdict.claims}["dgu/m4"] == "quadratic-storage"


def test_a_method_that_is_asked_for_is_used() -> None:
    accepted.remember(text(BASE), CERTIFICATE.data)
    result = prove_again(text(edited(set_gain)), CERTIFICATE.data, method="enclosure")
    assert result.whole
    rules = {c.rule for c in result.certificate.verdict.claims if c.id.startswith("load/")}
    assert rules == {"monotone-enclosure"}


# --- the memory of this machine ---------------------------------------------------------------------------------------


def test_another_kernel_remembers_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    accepted.remember(text(BASE), CERTIFICATE.data)
    sha = json.loads(CERTIFICATE.data)["spec_sha256"]
    assert accepted.recall(sha, CERTIFICATE.data) == text(BASE)
    monkeypatch.setattr(accepted, "_checker", lambda: "0" * 64)
    assert accepted.recall(sha, CERTIFICATE.data) is None
    assert again(edited(set_gain), known=False).whole


def test_the_checker_is_its_sources(monkeypatch: pytest.MonkeyPatch) -> None:
    before = accepted._checker()
    read = Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda p: read(p) + (b" " if p.name == "rules.py" else b""))
    accepted._checker.cache_clear()
    assert accepted._checker() != before
    accepted._checker.cache_clear()


def test_entries_that_are_not_believed(tmp_path: Path) -> None:
    sha, folder = json.loads(CERTIFICATE.data)["spec_sha256"], tmp_path / "cache"
    accepted.remember(text(BASE), CERTIFICATE.data)
    assert folder.stat().st_mode & 0o777 == 0o700
    (entry,) = folder.iterdir()
    good = entry.read_bytes()
    for bad in (b"", good[:-1], good + b" ", text(edited(set_gain))):
        entry.write_bytes(bad)
        assert accepted.recall(sha, CERTIFICATE.data) is None
    entry.write_bytes(good)
    assert accepted.recall(sha, CERTIFICATE.data + b"\n") is None
    assert accepted.recall("../../x", CERTIFICATE.data) is None
    folder.chmod(0o777)  # anybody may have put it there
    assert accepted.recall(sha, CERTIFICATE.data) is None
    folder.chmod(0o700)
    assert accepted.recall(sha, CERTIFICATE.data) == good


def test_a_folder_that_cannot_be_written_is_no_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    for place in (blocked, blocked / "below", Path("/dev/null"), Path("")):
        monkeypatch.setenv("CERTIFY_CACHE", "" if place == Path("") else str(place))
        out = str(tmp_path / "c.json")
        assert main(["prove", "specs/two-inverters.toml", "-o", out]) == 0
        assert main(["check", "specs/two-inverters.toml", out]) == 0
        assert main(["prove", "specs/two-inverters.toml", "--reuse", out]) == 0
    capsys.readouterr()
    assert blocked.read_text() == "not a folder"


def test_check_remembers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec, old = tmp_path / "s.json", tmp_path / "c.json"
    spec.write_bytes(text(BASE))
    old.write_bytes(CERTIFICATE.data)
    assert prove_again(text(edited(set_gain)), CERTIFICATE.data).whole
    assert main(["check", str(spec), str(old)]) == 0
    assert prove_again(text(edited(set_gain)), CERTIFICATE.data).whole is None
    old.write_bytes(tampered(one_number))
    assert main(["check", str(spec), str(old)]) == 4
    assert prove_again(text(edited(set_gain)), old.read_bytes()).whole
    capsys.readouterr()


def test_the_memory_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "cache"
    folder.mkdir(mode=0o700)
    (folder / "letter.txt").write_text("not ours")
    for k in range(40):
        accepted.remember(b"%d" % k, b"certificate")
    assert len(list(folder.glob("*.spec"))) == accepted.MAX_ENTRIES
    monkeypatch.setattr(accepted, "MAX_BYTES", 10)
    accepted.remember(b"12345678", b"certificate")
    assert sum(p.stat().st_size for p in folder.glob("*.spec")) <= 10
    assert (folder / "letter.txt").exists()
    monkeypatch.setattr(accepted, "MIN_BYTES", 100)
    accepted.remember(b"short", b"certificate")
    assert accepted.recall("x", b"certificate") is None


# --- random edits -----------------------------------------------------------------------------------------------------


def faulty(change: Callable[[Spec], object]) -> bytes:
    return text(edited(change))


FAULTS = {
    "a gain": faulty(lambda s: set_gain(s, "1e99999")),
    "an unknown name": faulty(lambda s: s["controller"]["c6"].update(alpha="x")),
    "the order of let": faulty(lambda s: s["controller"]["c4"].update(let={"kp": "2*ki", "ki": 5})),
    "a division by zero": faulty(lambda s: set_gain(s, 0)),
    "a filter": faulty(lambda s: s["filter"]["f4"].update(L="-1 mH")),
    "a filter that nobody has": faulty(lambda s: s["filter"].update(idle={"R": 1})),
    "no such controller": faulty(lambda s: choose(s, "n4", controller="c5")),
    "a controller that is still in use": faulty(lambda s: s["controller"].pop("c4")),
    "no controller": faulty(lambda s: s["node"]["n4"]["dgu"].pop("controller")),
    "a key of a node": faulty(lambda s: s["node"]["n4"].update(lod=[])),
    "no table": faulty(lambda s: s["controller"].update(c4=[])),
    "nothing": faulty(lambda s: s["controller"].update(c4=None)),
    "a number as a name": faulty(lambda s: choose(s, "n4", controller=5)),  # type: ignore[arg-type]
    "a key twice": text(BASE).replace(b'"kp": ', b'"kp": 7, "kp": ', 1),
    "a controller twice": text(BASE).replace(b'"controller": {', b'"controller": {"c4": {}, ', 1),
    "a section twice": text(BASE)[:-1] + b', "filter": {}}',
    "not JSON": text(BASE)[:-1],
    "not a number": text(BASE).replace(b'"kp": ', b'"kp": NaN, "x": ', 1),
    "deep": text(BASE).replace(b'"kp": ', b'"x": ' + b"[" * 3000 + b"]" * 3000 + b', "kp": ', 1),
}


@pytest.mark.parametrize("case", FAULTS, ids=str)
def test_faults_are_those_of_the_whole_spec(case: str) -> None:
    accepted.remember(text(BASE), CERTIFICATE.data)
    expected = faults_of(lambda: prove(FAULTS[case]))
    assert expected
    assert faults_of(lambda: prove_again(FAULTS[case], CERTIFICATE.data)) == expected


def faults_of(action: Callable[[], object]) -> tuple[Any, ...]:
    try:
        action()
    except SpecError as error:
        return error.faults
    return ()


def random_edit(rng: random.Random, spec: Spec) -> None:
    """One change of any kind, most of them to filters and controllers, sound or not."""
    node = f"n{2 * rng.randrange(10)}"
    dgu, other = spec["node"][node]["dgu"], f"n{rng.randrange(20)}"
    law = spec["controller"][dgu["controller"]]
    kind = rng.randrange(9)
    if kind <= 2 and law["kind"] == "ida-pbc":
        law[rng.choice(["alpha", "nu", "ki"])] = f"{rng.choice([-4, 0.5, 1, 60, rng.uniform(-9, 200)]):.4f}"
    elif kind <= 2:
        law["let"][rng.choice(["kp", "ki"])] = rng.choice([500, "900", -3, 1, rng.randrange(1, 3000)])
    elif kind == 3:
        spec["filter"][dgu["filter"]][rng.choice("RLC")] = rng.choice(["0.1", "0.003", "1e-5"])
    elif kind == 4:
        choose(spec, node, **{rng.choice(["filter", "controller"]): rng.choice(["f2", "f4", "c4", "c6"])})
    elif kind == 5:
        law["design"] = {"L": rng.choice(["1.8 mH", "1.9 mH"])}
    elif kind == 6:
        spec["node"][other].setdefault("load", []).append({"kind": "zip", "I": [f"{rng.randrange(-2, 9)} A", "0 A"]})
    elif kind == 7:
        spec["line"][rng.randrange(19)]["R"] = f"{rng.choice(['0.001', '0.5', '2'])} ohm"
    else:
        spec["node"][other]["capacitance"] = "1 nF"


@settings(max_examples=6, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 10**6))
def test_random_edits(seed: int) -> None:
    """A course of edits, each proved with the certificate of the state before: never another answer than without."""
    rng = random.Random(seed)
    spec, data, old = copy.deepcopy(BASE), text(BASE), CERTIFICATE.data
    for _ in range(2):
        for _ in range(rng.choice([1, 1, 2])):
            random_edit(rng, spec)
        faults = faults_of(lambda: decode_all(text(spec)))
        if faults:
            assert faults_of(partial(prove_again, text(spec), old)) == faults
            return
        result = again(spec, old, data, known=rng.random() < 0.8)
        data, old = text(spec), result.certificate.data
