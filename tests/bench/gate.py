"""How long the gate takes for many unchanged specs with committed certificates, process start included.

`python tests/bench/gate.py [COUNT]` makes COUNT (50) variants of the CIGRE network with other lengths, loads and
references, all different, has the gate prove them once and write their certificates, and then times it as CI runs it.
"""

from __future__ import annotations

import os
import random
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent
LIMIT_SECONDS = 3
RUNS = 5


def variant(text: str, seed: int) -> str:
    """The CIGRE network with each length, load and reference a little different."""
    rng = random.Random(seed)

    def other(match: re.Match[str]) -> str:
        return f"{match[1]}{float(match[2]) * rng.uniform(0.97, 1.03):.6g}{match[3]}"

    text, _, _ = text.partition("# The paper's experiment")
    text = re.sub(r'(length = ")([\d.]+)( km")', other, text)
    return re.sub(r'(")([\d.]+)( (?:uS|A|kW|kvar)")', other, text)


def make(folder: Path, count: int) -> list[str]:
    """The specs, written into a folder."""
    text = (ROOT / "specs" / "cigre-mv.toml").read_text()
    for seed in range(count):
        (folder / f"grid-{seed:02}.toml").write_text(variant(text, seed))
    return [f"grid-{seed:02}.toml" for seed in range(count)]


def gate(folder: Path, *arguments: str) -> tuple[float, str]:
    """The seconds that a command takes from start to end, and what it printed last."""
    started = time.perf_counter()
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "certify", "gate", *arguments]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=True)
    return time.perf_counter() - started, done.stdout.splitlines()[-1]


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 50
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        specs = make(folder, count)
        seconds, told = gate(folder, "--write", *specs)
        print(f"proving {count} specs and writing their certificates: {seconds:.2f} s ({told})")
        for jobs in ((), ("--jobs", "1"), ("--junit", "j.xml", "--sarif", "s.sarif", "--statement", "t.json")):
            times = sorted(gate(folder, *jobs, "--require-certificate", *specs)[0] for _ in range(RUNS))
            print(
                f"gate {' '.join(jobs)}: {times[RUNS // 2]:.2f} s, from {times[0]:.2f} to {times[-1]:.2f} s of {RUNS} runs; "
                f"limit {LIMIT_SECONDS} s"
            )


if __name__ == "__main__":
    main()
