"""Benchmark of `prove --reuse`: one DGU of a network changes, no two parts of which are alike.

python tests/bench/reuse.py [--sizes 100 1000 10000] [--report reports/benchmark-reuse.md]
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent.parent))  # so that it runs as a script

from tests.bench.networks import microgrid
from tests.bench.run import measured

REPEATS = 5  # of what takes less than a second or two


def changed(spec: bytes, turn: int) -> bytes:
    """The spec with another gain at one DGU, each time at another one."""
    document = json.loads(spec)
    names = [name for name, law in document["controller"].items() if law["kind"] == "state-feedback"]
    document["controller"][names[turn * (len(names) // REPEATS)]]["let"]["kp"] = 1234 + turn
    return json.dumps(document, indent=0).encode()


def row(folder: Path, size: int) -> str:
    """One size: each command a process of its own, so its time has the start, the reading and the writing."""
    spec, certificate, new_spec, new = (
        folder / name for name in ("spec.json", "cert.json", "new.json", "new-cert.json")
    )
    spec.write_bytes(microgrid(size))
    prove, memory = measured("prove", str(spec), "-o", str(certificate))
    check, _ = measured("check", str(spec), str(certificate))
    times, most = [], 0
    for turn in range(REPEATS):
        new_spec.write_bytes(changed(spec.read_bytes(), turn))
        again, own = measured("prove", str(new_spec), "--reuse", str(certificate), "-o", str(new))
        times.append(again)
        most = max(most, own)
    measured("check", str(new_spec), str(new))  # fails unless the certificate is accepted in full
    median = statistics.median(times)
    how = "taken_over" in new.read_text()
    return (
        f"| {size} | {spec.stat().st_size / 1e6:.2f} | {prove:.2f} | {check:.2f} | {median:.2f} | {prove / median:.0f} | "
        f"{'what changed' if how else 'all'} | {memory} | {most} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sizes", type=int, nargs="+", default=[100, 1000, 10000])
    parser.add_argument("--report", type=Path)
    options = parser.parse_args()
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # an installed package is compiled once, not at each start
    with tempfile.TemporaryDirectory() as name:
        os.environ["CERTIFY_CACHE"] = str(Path(name) / "accepted")
        subprocess.run(
            [sys.executable, "-m", "certify", "prove", "specs/cigre-mv.toml"], check=True, capture_output=True
        )
        text = [
            "# Benchmark of `prove --reuse`",
            "",
            f"`python tests/bench/reuse.py --sizes {' '.join(map(str, options.sizes))}`, Python {platform.python_version()}, "
            f"{platform.machine()}. Times are of whole processes, start included; compare within this run only.",
            "",
            "A tree of so many nodes, all parameters of all nodes and lines different. It is proved from nothing "
            "(`prove SPEC -o CERT`) and checked (`check SPEC CERT`). Then one gain of one DGU is changed: `prove NEW_SPEC "
            f"--reuse CERT -o NEW_CERT`, the median of {REPEATS} changes at different DGUs. `certify check` has accepted "
            "the last new certificate in full. Specs of less than 100 kB are decided and checked as a whole.",
            "",
            "| nodes | spec, MB | prove, s | check, s | prove again, s | ratio to prove | decided and checked | peak memory, "
            "MiB: prove | prove again |",
            "| ---: | ---: | ---: | ---: | ---: | ---: | --- | ---: | ---: |",
            *(row(Path(name), size) for size in options.sizes),
            "",
        ]
    if options.report:
        options.report.write_text("\n".join(text))
    print("\n".join(text))


if __name__ == "__main__":
    main()
