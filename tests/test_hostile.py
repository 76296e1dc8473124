"""Input made to hurt: what once crashed, hung, or slipped through, each in its smallest form."""

from __future__ import annotations

import itertools
import json
import os
import subprocess
import sys
import time
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest

from certify.certificate import prove, to_canonical_json
from certify.inputs import load
from certify.kernel.check import check, proof_key
from certify.kernel.claims import Context
from certify.kernel.data import Data
from certify.kernel.errors import Rejected, RuleFailure, SpecError
from certify.kernel.model import LoadLaw, PowerTerm
from certify.kernel.proofs import RULES
from certify.kernel.spec import decode
from tests.accept import OnePart
from tests.conftest import ROOT

HEAD: dict[str, Any] = {"format": "certify/microgrid@1", "frequency": 50}
LOOP = {"kind": "linear", "F": [[-1, 0], [0, -1]], "B": [[1, 0], [0, 1]], "C": [[1, 0], [0, 1]]}


def refused(data: bytes | dict[str, Any], seconds: float = 3) -> set[str]:
    """The codes of the faults; the time is generous, what once hung took tens of seconds."""
    started = time.perf_counter()
    with pytest.raises(SpecError) as caught:
        decode(data if isinstance(data, bytes) else json.dumps(data).encode())
    assert time.perf_counter() - started < seconds
    return {fault.code for fault in caught.value.faults}


def test_null_is_no_value() -> None:
    """A spec whose nodes are null was certified: a microgrid of nothing."""
    assert refused({**HEAD, "node": None}) == {"S103"}
    assert "S103" in refused({**HEAD, "node": {"a": None}})
    assert "S103" in refused({**HEAD, "voltage_band": None, "node": {"a": {"dgu": None}}})
    for key in ("line", "filter", "controller", "name", "line_legs"):
        assert "S103" in refused({**HEAD, "node": {}, key: None})


def test_huge_integers_in_messages() -> None:
    """Python refuses to print an integer of more than 4300 digits, and a message tried to."""
    digits = "F" * 15_000
    for text in (f"format = 0x{digits}", f"[controller.a]\nkind = 'linear'\nlet = {{ a = 0x{digits} }}"):
        assert refused(f"{text}\n".encode())
    assert refused(f"[node.a]\nload = 0x{digits}\n[[line]]\nname = 'x'\nfrom = 0x{digits}\n".encode())


def test_deep_containers_in_messages() -> None:
    deep: Any = "x"
    for _ in range(900):
        deep = [deep]
    assert refused({**HEAD, "node": {}, "controller": {"a": {**LOOP, "let": {"a": deep}}}})
    assert refused({**HEAD, "node": deep, "name": deep, "line": [deep]})
    assert refused(f"name{'.a' * 1500} = 1\n".encode()) == {"S003"}
    assert refused(f"format{'.a' * 45} = 1\n".encode())


def test_many_deep_keys_are_refused_before_they_are_parsed() -> None:
    lines = itertools.chain.from_iterable((f"[{'a.' * 1990}x{k}]", f"{'a.' * 1990}a = 1") for k in range(20))
    assert refused("\n".join(lines).encode(), 1) == {"S003"}
    inline = f"x = {{ {'a.' * 300}a = 1 }}\n"
    assert refused(inline.encode(), 1) == {"S003"}


def test_suggestions_are_cheap() -> None:
    """260 unknown names that are anagrams of 300 known ones took 20 s to compare."""
    names = ["".join(p) * 9 for p in itertools.islice(itertools.permutations("abcdef"), 300)]
    nodes = {name: {"capacitance": 1} for name in names}
    lines = [
        {"name": f"l{k}", "from": n[::-1][1:] + n[0], "to": n, "R": 1, "L": 1, "C": 1}
        for k, n in enumerate(names[:260])
    ]
    assert "S301" in refused({**HEAD, "node": nodes, "line": lines})


def test_underscores_are_not_sprinkled() -> None:
    spec = {**HEAD, "node": {"a": {"capacitance": "1_0__._5 F"}}}
    assert "S201" in refused(spec)
    assert decode(
        json.dumps(
            {
                **HEAD,
                "controller": {"x": LOOP},
                "node": {"a": {"capacitance": "1_000 F", "dgu": {"controller": "x", "reference": [1, 0]}}},
            }
        ).encode()
    )


def test_large_files_are_refused() -> None:
    assert refused(b'{"a":[' + b"0," * (1 << 24) + b"0]}") == {"S003"}
    assert refused(b"# comment\n" * 500_000) == {"S003"}


def test_gains_of_absurd_length_are_refused() -> None:
    loop = {**LOOP, "F": [["(3^700 + 7)/(5^600 + 3)", 0], [0, -1]]}
    spec = {**HEAD, "controller": {"x": loop}, "node": {"a": {"dgu": {"controller": "x", "reference": [1, 0]}}}}
    assert refused(spec) <= {"S202", "S205"}


def forged(name: str, claim: str, data: dict[str, Any], **changes: Any) -> tuple[bytes, bytes]:
    """A spec and its certificate with the proof of one claim exchanged, keys and all."""
    spec = (ROOT / "specs" / name).read_bytes()
    document = json.loads(prove(spec).data)
    entry = next(c for c in document["claims"] if c["id"] == claim)
    entry |= {"proof": proof_key(data), **changes}
    document["proofs"][proof_key(data)] = data
    used = {c["proof"] for c in document["claims"]}
    document["proofs"] = {key: value for key, value in document["proofs"].items() if key in used}
    return spec, to_canonical_json(document)


def rejected(pair: tuple[bytes, bytes], reason: str, seconds: float = 20) -> None:
    started = time.perf_counter()
    with pytest.raises(Rejected, match=reason):
        check(*pair)
    assert time.perf_counter() - started < seconds


def test_certificates_with_endless_numbers_are_rejected_quickly() -> None:
    long = f"{'7' * 4000}/{'3' * 3999}1"
    witness = {"s0": f"{long} {long}", "u": ["1 0", "0 0"]}
    rejected(forged("cigre-mv-as-printed.toml", "dgu/1", witness), "too many digits")
    # 1,000 digits are let through, and take a while but no more
    short = f"{'7' * 400}/{'3' * 399}1"
    rejected(forged("cigre-mv.toml", "dgu/1", {"storage": [f"{short} 0 0 0"] * 4}), "symmetric")


def test_enclosures_with_endless_precision_are_rejected_quickly() -> None:
    points = " ".join(str(320 + k) for k in range(161))
    for bits in ("2500", "1", "-5", "129/2", "999999999"):
        rejected(forged("two-inverters.toml", "load/b", {"points": points, "bits": bits}), "absurd|too many points")
    many = "320 " + " ".join(f"{32000 + k}/100" for k in range(1, 16000) if k % 2 and k % 5) + " 480"
    rejected(forged("two-inverters.toml", "load/b", {"points": many, "bits": "400"}), "too many points")


@pytest.mark.parametrize("junk", [[], "junk", None, True, 7, [{"a": ["x"]}], {"modulus": "0"}, {"modulus": "-1"}])
def test_a_proof_without_data_is_an_empty_table(junk: object) -> None:
    """Anything but a table was once read as an empty one."""
    pair = forged("wrong-inductance.toml", "load/a", junk, rule="monotone-sturm")  # type: ignore[arg-type]
    rejected(pair, "a proof is a table|the modulus is not positive|the proof needs|expected text")


def test_boxes_do_not_multiply_the_cost_without_bound() -> None:
    """Corners times long numbers once kept the checker busy for minutes, from a spec of one kilobyte."""
    long = Fraction(10**100 + 1, 3 * 10**99)
    terms = tuple(PowerTerm(-long, Fraction(1), Fraction(e), Fraction(1, 7)) for e in range(12, 6, -1))
    law = (LoadLaw((PowerTerm(long, Fraction(1), Fraction(2)),), terms), (Fraction(1), Fraction(2)))
    handler = RULES["load", "proved", "monotone-sturm"]
    with pytest.raises(RuleFailure, match="too many corners"):
        handler(OnePart(law), "x", Data({}))  # type: ignore[arg-type]
    points = " ".join(str(Fraction(100 + k, 100)) for k in range(101))
    with pytest.raises(RuleFailure, match="too many points, bits or corners"):
        RULES["load", "proved", "monotone-enclosure"](OnePart(law), "x", Data({"points": points, "bits": "64"}))  # type: ignore[arg-type]
    port = Context(load("specs/cigre-mv.toml")).port("1")
    rows = [" ".join(["1" + "0" * 990] * 6)] * 6
    rows = [row.replace(" ", " " + "3" * 300 + "/7 ") for row in rows] * 2
    with pytest.raises(RuleFailure, match="too many digits"):
        RULES["dgu", "proved", "index-storage"](OnePart(port), "x", Data({"shortage": "1", "storage": rows}))  # type: ignore[arg-type]


def test_precision_is_checked_for_each_of_equal_loads() -> None:
    """The second of two equal loads was accepted with any precision, because the first had been checked."""
    text = (ROOT / "specs" / "two-inverters.toml").read_text()
    load_b = text[text.index("load = [\n") : text.index("[[line]]")]
    spec = text.replace('load = [{ kind = "zip", Y = ["20 mS", "5 mS"], I = ["2 A", "0 A"] }]', load_b).encode()
    document = json.loads(prove(spec).data)
    loads = [c for c in document["claims"] if c["id"].startswith("load/")]
    assert loads[0]["rule"] == loads[1]["rule"] == "monotone-enclosure"
    assert loads[0]["proof"] == loads[1]["proof"]
    data = {**document["proofs"][loads[0]["proof"]], "bits": "1"}
    loads[1]["proof"] = proof_key(data)
    document["proofs"][proof_key(data)] = data
    with pytest.raises(Rejected, match="absurd"):
        check(spec, to_canonical_json(document))


def test_deeply_nested_certificates_are_rejected() -> None:
    spec = (ROOT / "specs" / "single-inverter.toml").read_bytes()
    document = json.loads(prove(spec).data)
    deep: Any = "x"
    for _ in range(900):
        deep = [deep]
    for path in ("claims", "proofs", "assumptions", "verdict", "spec_sha256", "format"):
        with pytest.raises(Rejected):
            check(spec, to_canonical_json({**document, path: deep}))
    for key in ("id", "statement", "status", "rule", "proof"):
        claims = [{**document["claims"][0], key: deep}, *document["claims"][1:]]
        with pytest.raises(Rejected):
            check(spec, to_canonical_json({**document, "claims": claims}))
    with pytest.raises(Rejected):
        check(spec, to_canonical_json({**document, "proofs": {**document["proofs"], "x": deep}}))


@pytest.mark.parametrize("entry", ["3^200", "-(3^200)", "1/3^200"])
def test_numbers_out_of_the_range_of_floats_leave_a_claim_open(entry: str) -> None:
    loop = {**LOOP, "F": [[f"-({entry})*({entry})*({entry})", "w0"], ["-w0", 0]]}
    spec = {**HEAD, "controller": {"x": loop}, "node": {"a": {"dgu": {"controller": "x", "reference": [1, 0]}}}}
    assert prove(json.dumps(spec).encode()).verdict.outcome in {"certified", "conditional", "unknown", "refuted"}


@pytest.mark.parametrize(("arguments", "code"), [(["check", "--all"], 1), (["explain"], 1)])
def test_a_closed_pipe_does_not_change_the_exit_code(arguments: list[str], code: int, tmp_path: Path) -> None:
    """`certify check ... | true` exited with 0 for a refuted microgrid."""
    spec = ROOT / "specs" / "cigre-mv-as-printed.toml"
    file = tmp_path / "c.json"
    file.write_bytes(prove(spec.read_bytes()).data)
    files = [str(file), str(spec)] if arguments == ["explain"] else [str(spec), str(file)]
    read_end, write_end = os.pipe()
    os.close(read_end)
    command = [sys.executable, "-m", "certify", *arguments, *files]
    done = subprocess.run(command, stdout=write_end, stderr=subprocess.PIPE, text=True, check=False)
    os.close(write_end)
    assert done.returncode == code
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("module", ["certify", "certify.kernel"])
@pytest.mark.parametrize(
    "redirect", [">/dev/full 2>&1", ">&- 2>&-", "2>/dev/full", "2>&1 | true; exit ${PIPESTATUS[0]}"]
)
def test_streams_that_fail_never_make_a_verdict_of_bad_input(module: str, redirect: str) -> None:
    """With standard error closed, bad input exited with 1, which means refuted."""
    spec = "specs/negative/many-faults.toml"
    arguments = f"prove {spec}" if module == "certify" else f"{spec} {spec}"
    command = f"{sys.executable} -m {module} {arguments} {redirect}"
    done = subprocess.run(["bash", "-c", command], cwd=ROOT, capture_output=True, check=False)
    assert done.returncode in ({2} if module == "certify" else {2, 70, 120}), done.stderr


def test_faults_name_the_file_that_has_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from certify.cli import main

    good, missing = "specs/cigre-mv.toml", str(tmp_path / "missing.json")
    for arguments in (["check", good, missing], ["explain", str(tmp_path), good]):
        assert main(arguments) == 2
        assert good not in capsys.readouterr().err
    assert main(["check", good, missing, "--json"]) == 2
    assert json.loads(capsys.readouterr().out)["file"] == missing


def test_the_library_refuses_what_the_command_refuses() -> None:
    spec = (ROOT / "specs" / "two-inverters.toml").read_text()
    bad = f'{spec}\n[scenario.x]\nend = 1\nevent = [{{ at = 0.5, connect = "nosuch" }}]\n'
    with pytest.raises(SpecError, match="S306"):
        prove(bad.encode())


def test_output_that_cannot_show_a_name(tmp_path: Path) -> None:
    spec = {**HEAD, "controller": {"x": LOOP}, "node": {"\u03a9": {"dgu": {"controller": "x", "reference": [1, 0]}}}}
    data = json.dumps(spec).encode()
    (tmp_path / "s.json").write_bytes(data)
    (tmp_path / "c.json").write_bytes(prove(data).data)
    for module in ("certify.kernel", "certify"):
        arguments = ["check"] * (module == "certify") + [str(tmp_path / "s.json"), str(tmp_path / "c.json")]
        done = subprocess.run(
            [sys.executable, "-m", module, *arguments],
            env={**os.environ, "PYTHONIOENCODING": "ascii"},
            capture_output=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
