"""Tables of random ZIP loads: time, memory and size of `certify loads` and `certify check`, beside sampling in floats.

python tests/bench/loads.py [--rows 100000] [--report reports/benchmark-loads.md]

The sampling, G > 0 and D > 0 at 1,000 voltages a row with numpy, is the usual way to ask; it proves nothing.
"""

from __future__ import annotations

import argparse
import csv
import math
import os
import platform
import random
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import numpy

sys.path.insert(0, str(Path(__file__).resolve().parent.parent.parent))  # so that it runs as a script

ROOT = Path(__file__).resolve().parent.parent.parent
COLUMNS = ("name", "P0", "Q0", "V0", "Zp", "Ip", "Pp", "Zq", "Iq", "Pq")
SAMPLES = 1000  # voltages of a row
CHUNK = 1000  # rows sampled at once
BAND = (Fraction("0.9"), Fraction("1.1"))  # that of the command, in per unit
BESIDE = Fraction(1, 10**12)
Numbers = tuple[Fraction, ...]  # those of COLUMNS after the name
MEASURE = (
    "import resource, sys\n"
    "from certify.cli import main\n"
    "code = main(sys.argv[1:])\n"
    "own = next(line.split()[1] for line in open('/proc/self/status') if line.startswith('VmHWM'))\n"  # without what was before exec
    "print(int(own) // 1024, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss // 1024, file=sys.stderr)\n"
    "sys.exit(code)"
)


# --- rows ---------------------------------------------------------------------------------------------------


def decimal(rng: random.Random, low: float, high: float, places: int = 3) -> Fraction:
    return Fraction(f"{rng.uniform(low, high):.{places}f}")


def nominal(rng: random.Random) -> tuple[Fraction, Fraction, Fraction]:
    """P0, Q0 at a power factor from 0.75 to 1, mostly lagging, and V0."""
    P0 = decimal(rng, 10, 5000, 2)
    tangent = math.tan(math.acos(rng.uniform(0.75, 1))) * (1 if rng.random() < 0.9 else -1)
    return P0, Fraction(f"{float(P0) * tangent:.2f}"), Fraction(rng.choice(("120", "208", "230", "400", "20000")))


def shares(rng: random.Random) -> Numbers:
    """Three fractions, none negative."""
    a, b = sorted((decimal(rng, 0, 1), decimal(rng, 0, 1)))
    return a, b - a, 1 - b


def defaults(rng: random.Random) -> Numbers:
    """Nonnegative fractions, as simulators have them."""
    return (*nominal(rng), *shares(rng), *shares(rng))


def measured(rng: random.Random) -> Numbers:
    """Fractions as fits to measurements have them: large, of mixed signs, that cancel at V0."""
    Zp, Zq = decimal(rng, -0.5, 2.5, 2), decimal(rng, -2, 16, 2)
    Ip, Iq = (Fraction(f"{float(z) * rng.uniform(-1.9, -0.7) + rng.gauss(0, 0.5):.2f}") for z in (Zp, Zq))
    return (*nominal(rng), Zp, Ip, 1 - Zp - Ip, Zq, Iq, 1 - Zq - Iq)


def at_an_end(rng: random.Random) -> Numbers:
    """D = 0 exactly at the lower end w of the band, or off by 1e-12 of Q0.

    With A = Zp w^2 - Pp and P = Zp w^2 + Ip w + Pp = r^2 A, D w^4 = A P - (t (Iq w/2 + Pq))^2 is zero for
    t (Iq w/2 + Pq) = r A. The sum of the fractions is 1 but for the rounding of Ip.
    """
    w, r, c = BAND[0], rng.choice((Fraction(3, 4), Fraction(1), Fraction(2))), Fraction(rng.choice((1, 2, 4)), 4)
    Zp, k = decimal(rng, 0.6, 1.6), 1 + r**2
    Ip = Fraction(f"{float((1 - Zp * (1 + w**2 - 2 * w**2 / k)) / (1 - w / k)):.3f}")
    A = (2 * Zp * w**2 + Ip * w) / k
    P0, Iq = decimal(rng, 10, 5000, 2), decimal(rng, -1, 2, 2)
    Pq = c - Iq * w / 2
    Q0 = P0 * r * A / c * (1 + rng.choice((0, 1, -1)) * BESIDE)
    return P0, Q0, Fraction(230), Zp, Ip, Zp * w**2 - A, 1 - Iq - Pq, Iq, Pq


def touching(rng: random.Random) -> Numbers:
    """D touches zero at V0, inside the band, or misses it by 1e-12: D = D' = 0 < D'' at w = 1, solved for Pp, Iq, Pq."""
    while True:
        c, t = (rng.choice((Fraction(1, 5), Fraction(1, 4), Fraction(1, 2), Fraction(4, 5))) for _ in range(2))
        Zp = decimal(rng, 0.05, 1.5)
        current = ((1 + c**2) * c**2 + 2 * Zp) / c  # t Iq
        if 2 * Zp * (3 + 3 * c**2) > current**2 / 2:
            break
    Pp = Zp - c**2 + rng.choice((0, 1, -1)) * BESIDE
    P0, Iq, Pq = decimal(rng, 10, 5000, 2), current / t, (c - current / 2) / t
    return P0, P0 * t, Fraction(230), Zp, 1 - 2 * Zp + c**2, Pp, 1 - Iq - Pq, Iq, Pq


KINDS: dict[str, tuple[float, Callable[[random.Random], Numbers]]] = {
    "fractions as simulators have them": (0.5, defaults),
    "fractions as measurements have them": (0.49, measured),
    "D = 0 at an end of the band, or 1e-12 beside it": (0.005, at_an_end),
    "D = 0 inside the band, or 1e-12 beside it": (0.005, touching),
}


def random_rows(count: int, seed: int = 1) -> Iterator[tuple[str, Numbers]]:
    """So many loads, each with the name of its kind; all are different."""
    rng = random.Random(seed)
    names, weights = list(KINDS), [weight for weight, _ in KINDS.values()]
    seen: set[Numbers] = set()
    while len(seen) < count:
        name = rng.choices(names, weights)[0]
        numbers = KINDS[name][1](rng)
        if numbers not in seen:
            seen.add(numbers)
            yield name, numbers


def to_decimal(x: Fraction) -> str:
    """An exact decimal. Raises: ValueError if there is none."""
    for places in range(60):
        if 10**places % x.denominator == 0:
            digits = f"{abs(x.numerator) * (10**places // x.denominator):0{places + 1}d}"
            whole, rest = digits[: len(digits) - places], digits[len(digits) - places :]
            return f"{'-' if x < 0 else ''}{whole}" + (f".{rest}" if rest else "")
    raise ValueError(f"{x} has no short decimal")


def write_table(path: Path, rows: list[tuple[str, Numbers]]) -> None:
    with path.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows((f"load {k}", *map(to_decimal, numbers)) for k, (_, numbers) in enumerate(rows, 1))


# --- the usual way ------------------------------------------------------------------------------------------


def sample(path: Path) -> numpy.ndarray:
    """Whether G > 0 and D > 0 in floats at SAMPLES voltages of the band, the ends among them, for each row of a table."""
    with path.open(newline="") as file:
        cells = numpy.array([row[1:] for row in csv.reader(file)][1:], dtype=float)
    w = numpy.linspace(float(BAND[0]), float(BAND[1]), SAMPLES)
    powers = numpy.stack((w**2, w, numpy.ones_like(w)))
    passed = []
    for start in range(0, len(cells), CHUNK):
        P0, Q0, _, *fractions = cells[start : start + CHUNK].T
        active, reactive = P0[:, None] * numpy.array(fractions[:3]).T, Q0[:, None] * numpy.array(fractions[3:]).T
        P = active @ powers  # G v^2
        radial = (active * (1, 0, -1)) @ powers  # (G + v G') v^2
        cross = (reactive * (0, -1, -2)) @ powers  # v B' times -v^2
        passed.append(((P > 0) & (P * radial - cross**2 / 4 > 0)).all(axis=1))
    return numpy.concatenate(passed)


def disagreements(rows: list[tuple[str, Numbers]], results: Path, passed: numpy.ndarray) -> list[str]:
    """How often sampling says another thing than the proof, for each kind of row."""
    with results.open(newline="") as file:
        verdicts = [row["verdict"] for row in csv.DictReader(file)]
    counts: Counter[tuple[str, str, bool]] = Counter(
        (kind, verdict, bool(ok)) for (kind, _), verdict, ok in zip(rows, verdicts, passed, strict=True)
    )
    lines = [
        "| rows | number | monotone | not monotone | undecided | not monotone, but all samples pass | monotone, but a sample fails |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for name in (*KINDS, None):
        own = {key[1:]: n for key, n in counts.items() if key[0] == name} if name else Counter[tuple[str, bool]]()
        for (_, verdict, ok), n in () if name else counts.items():
            own[verdict, ok] += n
        of = {verdict: sum(n for (v, _), n in own.items() if v == verdict) for verdict in ("proved", "refuted")}
        total = sum(own.values())
        cells = (total, of["proved"], of["refuted"], total - of["proved"] - of["refuted"])
        wrong = (own.get(("refuted", True), 0), own.get(("proved", False), 0))
        lines.append(f"| {name or 'all'} | " + " | ".join(f"{n:,}" for n in (*cells, *wrong)) + " |")
    return lines


# --- measurements ---------------------------------------------------------------------------------------------


def cpu_seconds() -> float:
    """Of all processes that this one has started and seen end, and of those that they have."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def measured(*arguments: str) -> tuple[float, float, int, int]:
    """Wall and CPU time in seconds of a `certify` command, and the peak memory in MiB of it and of its largest helper."""
    started, used = time.perf_counter(), cpu_seconds()
    command = [sys.executable, "-c", MEASURE, *arguments]
    done = subprocess.run(command, check=False, capture_output=True, text=True, cwd=ROOT)
    seconds = time.perf_counter() - started
    if done.returncode not in (0, 1):  # all monotone, or some not
        raise SystemExit(done.stdout + done.stderr)
    own, helper = done.stderr.split()[-2:]
    return seconds, cpu_seconds() - used, int(own), int(helper)


def growth(folder: Path, sizes: list[int]) -> list[str]:
    """The table of sizes, and what sampling says about the largest."""
    lines = [
        "| rows | table, kB | loads, s | of CPU, s | rows per s | memory, MiB | in each helper, MiB | results, kB | certificate, kB "
        "| check, s | of CPU, s | memory, MiB | sampling, s | rows per s |",
        "| ---: |" + " ---: |" * 13,
    ]
    points = []
    for size in sizes:
        table, results, certificate = (folder / name for name in ("loads.csv", "results.csv", "loads.cert.jsonl"))
        rows = list(random_rows(size))
        write_table(table, rows)
        decide, cpu, memory, helper = measured("loads", str(table), "-o", str(results), "--cert", str(certificate))
        check, cpu_of_check, of_check, _ = measured("check", str(table), str(certificate))
        started = time.perf_counter()
        passed = sample(table)
        sampling = time.perf_counter() - started
        kilobytes = [path.stat().st_size / 1000 for path in (table, results, certificate)]
        points.append((size, decide, cpu, kilobytes[2], cpu_of_check, sampling))
        lines.append(
            f"| {size:,} | {kilobytes[0]:,.0f} | {decide:.1f} | {cpu:.1f} | {size / decide:,.0f} | {memory} | {helper} "
            f"| {kilobytes[1]:,.0f} | {kilobytes[2]:,.0f} | {check:.1f} | {cpu_of_check:.1f} | {of_check} | {sampling:.2f} "
            f"| {size / sampling:,.0f} |"
        )
    for (n0, *first), (n1, *last) in pairwise(points):
        e = [f"{math.log(b / a) / math.log(n1 / n0):.2f}" for a, b in zip(first, last, strict=True)]
        lines.append(f"| exponent, {n0:,} to {n1:,} | | {e[0]} | {e[1]} | | | | | {e[2]} | | {e[3]} | | {e[4]} | |")
    size, decide, cpu, *_, sampling = points[-1]
    return [
        *lines,
        "",
        f"Sampling is {decide / sampling:.0f} times as fast as deciding {size:,} rows ({cpu / sampling:.0f} times in CPU time), and writes "
        "nothing. What it says of them:",
        "",
        *disagreements(rows, results, passed),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=100_000, help="of the largest table (default: 100000)")
    parser.add_argument("--report", type=Path)
    options = parser.parse_args()
    sizes = sorted({min(1000, options.rows), min(10_000, options.rows), options.rows})
    with tempfile.TemporaryDirectory() as name:
        text = [
            "# Tables of loads: time, memory and size",
            "",
            f"`python tests/bench/loads.py --rows {options.rows}`, Python {platform.python_version()}, {platform.machine()}, "
            f"{os.cpu_count()} cores, seed 1. Times are of",
            "whole processes: `certify loads TABLE -o results.csv --cert loads.cert.jsonl`, on all cores from 4,000 rows on, `certify check",
            "TABLE loads.cert.jsonl`, on one, and sampling with numpy within a process that runs: G > 0 and D > 0 in floats at 1,000 voltages",
            "of the band, its ends among them. All rows are different. Compare within this run only, and by CPU time: the cores were shared.",
            "",
            *growth(Path(name), sizes),
            "",
            "Where D = 0 exactly, the load is monotone if D is negative nowhere else; sampling asks for D > 0 and may fail there by rounding.",
            "",
        ]
    if options.report:
        options.report.write_text("\n".join(text))
    print("\n".join(text))


if __name__ == "__main__":
    main()
