"""Benchmarks, as ratios within one run: start-up against a named peer, and growth with the size of the network.

python tests/bench/run.py [--sizes 100 1000 10000] [--report reports/benchmark.md]
"""

from __future__ import annotations

import argparse
import math
import platform
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent.parent))  # so that it runs as a script

from tests.bench.networks import microgrid

ROOT = Path(__file__).resolve().parent.parent.parent
MEASURE = (
    "import resource, sys\n"
    "from certify.cli import main\n"
    "code = main(sys.argv[1:])\n"
    "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024, file=sys.stderr)\n"
    "sys.exit(code)"
)


def best_wall(command: list[str], repeats: int = 7) -> float:
    """The shortest wall time of a command, process start included, in seconds."""
    times = []
    for _ in range(repeats):
        started = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True, cwd=ROOT)
        times.append(time.perf_counter() - started)
    return min(times)


def measured(*arguments: str) -> tuple[float, int]:
    """Wall time in seconds and peak memory in MiB of one `certify` command."""
    started = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", MEASURE, *arguments], check=True, capture_output=True, text=True)
    return time.perf_counter() - started, int(done.stderr.split()[-1])


def start_up(folder: Path) -> list[str]:
    certificate = str(folder / "cigre.json")
    python, spec = sys.executable, "specs/cigre-mv.toml"
    peer = best_wall([python, "-c", "import cvxpy"])
    rows = [("python -c 'import cvxpy' (the peer)", peer)]
    rows.append(
        (
            "certify prove specs/cigre-mv.toml -o CERT",
            best_wall([python, "-m", "certify", "prove", spec, "-o", certificate]),
        )
    )
    rows.append(
        ("certify check specs/cigre-mv.toml CERT", best_wall([python, "-m", "certify", "check", spec, certificate]))
    )
    rows.append(("python -m certify.kernel SPEC CERT", best_wall([python, "-m", "certify.kernel", spec, certificate])))
    rows.append(("python -c pass", best_wall([python, "-c", "pass"])))
    lines = ["| command | wall time, ms | ratio to the peer |", "| --- | ---: | ---: |"]
    return lines + [f"| `{name}` | {1000 * value:.0f} | {value / peer:.2f} |" for name, value in rows]


def growth(folder: Path, sizes: list[int]) -> list[str]:
    lines = [
        "| network | nodes | lines | prove, s | check, s | certificate, kB | peak memory, MiB |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for mesh in (False, True):
        points = []
        for size in sizes:
            spec, certificate = folder / "spec.json", folder / "certificate.json"
            spec.write_bytes(microgrid(size, mesh))
            prove, memory = measured("prove", str(spec), "-o", str(certificate))
            check, _ = measured("check", str(spec), str(certificate))
            kilobytes = certificate.stat().st_size / 1000
            points.append((size, prove, check, kilobytes))
            count = size - 1 + (size // 2 if mesh else 0)
            kind = "mesh" if mesh else "tree"
            lines.append(f"| {kind} | {size} | {count} | {prove:.2f} | {check:.2f} | {kilobytes:.0f} | {memory} |")
        (n0, *first), (n1, *last) = points[-2], points[-1]
        exponents = [math.log(b / a) / math.log(n1 / n0) for a, b in zip(first, last, strict=True)]
        lines.append(
            f"| {kind}, exponent from {n0} to {n1} | | | {exponents[0]:.2f} | {exponents[1]:.2f} | {exponents[2]:.2f} | |"
        )
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sizes", type=int, nargs="+", default=[100, 1000, 10000])
    parser.add_argument("--report", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        text = [
            "# Benchmark",
            "",
            f"`python tests/bench/run.py --sizes {' '.join(map(str, options.sizes))}`, Python {platform.python_version()}, "
            f"{platform.machine()}. Times are of whole processes; compare within this run only.",
            "",
            "## Start-up: the best of seven runs",
            "",
            *start_up(Path(name)),
            "",
            "## Growth: all parameters of all nodes and lines different",
            "",
            *growth(Path(name), options.sizes),
            "",
        ]
    if options.report:
        options.report.write_text("\n".join(text))
    print("\n".join(text))


if __name__ == "__main__":
    main()
