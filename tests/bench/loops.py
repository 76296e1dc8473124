"""How long one DGU takes to decide, once everything is imported, beside python-control on the same case.

python tests/bench/loops.py [--report reports/benchmark-loops.md]

The peer needs the optional dependencies `compare`; without it its column stays empty.
"""

from __future__ import annotations

import argparse
import random
import statistics
import sys
import time
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent.parent))  # so that it runs as a script

from certify.inputs import load
from certify.kernel.claims import Context
from certify.kernel.model import LinearPort
from certify.search.dgu import propose_dgu
from certify.search.shortage import propose_box, propose_index
from tests.accept import accepted_facts
from tests.campaign_loops import PEERS, control_ispassive, installed_peers
from tests.loops import damped, hidden

REPEATS = 5


def decide(port: LinearPort) -> str:
    return next((p.rule for p in propose_dgu(port) if accepted_facts(port, p) is not None), "unknown")


def spoiled(port: LinearPort) -> LinearPort:
    """With an entry of F that feeds energy in."""
    F = [list(row) for row in port.F]
    F[-1][-1] += 2 * abs(F[-1][-1]) + 5
    return LinearPort(tuple(map(tuple, F)), port.B, port.C, port.capacitance_farad)


def cases() -> list[tuple[str, LinearPort]]:
    rng = random.Random(2)
    grid = {
        name: Context(load(f"specs/{name}"))
        for name in ("cigre-mv.toml", "cigre-mv-as-printed.toml", "custom-loop.json")
    }
    found = [
        ("PI of the CIGRE microgrid, passive", grid["cigre-mv.toml"].port("1")),
        ("IDA-PBC of the CIGRE microgrid, passive", grid["cigre-mv.toml"].port("2")),
        ("PI as printed, not passive", grid["cigre-mv-as-printed.toml"].port("1")),
        ("a loop of one's own, specs/custom-loop.json", grid["custom-loop.json"].port("inverter")),
    ]
    for n in (6, 12, 20):
        port = hidden(rng, damped(rng, n, 2))
        found += [(f"random port-Hamiltonian loop of {n} states", port), ("the same, spoiled", spoiled(port))]
    return found


def clock(work: Callable[[], object]) -> tuple[float, object]:
    """The median time in seconds, and the result."""
    times, result = [], None
    for _ in range(REPEATS):
        start = time.perf_counter()
        result = work()
        times.append(time.perf_counter() - start)
    return statistics.median(times), result


def peer_says(port: LinearPort) -> str:
    try:
        return control_ispassive(port)[0] or ""
    except Exception as error:  # whatever it raises is its answer
        return type(error).__name__


def rows() -> list[str]:
    with_peer = installed_peers() == PEERS
    lines = [
        "| case | states | certify | ms | ispassive | ms | ratio |",
        "| --- | ---: | --- | ---: | --- | ---: | ---: |",
    ]
    decide(cases()[-2][1])  # imports
    for name, port in cases():
        ours, rule = clock(lambda port=port: decide(port))  # type: ignore[misc]
        theirs, says = clock(lambda port=port: peer_says(port)) if with_peer else (0.0, "")  # type: ignore[misc]
        ratio = f"{ours / theirs:.2f}" if with_peer else ""
        shown = f"{1e3 * theirs:.1f}" if with_peer else ""
        lines.append(f"| {name} | {len(port.F)} | {rule} | {1e3 * ours:.1f} | {says} | {shown} | {ratio} |")
    return lines


def beyond() -> list[str]:
    """What has no peer: an index, and a box of tolerances."""
    cross = Context(load("specs/cigre-mv-cross-2w0.toml")).port("1")
    tolerant = Context(load("specs/cigre-mv-tolerances.toml"))
    ports = [tolerant.port("2", signs) for signs in tolerant.corners("2")]
    index, _ = clock(lambda: next(propose_index(cross)))
    box, _ = clock(lambda: next(propose_box(ports, Fraction(1, 10**4))))
    return [
        f"The index of the PI controller with `2 w0 L` (6 states) is found and proved in {1e3 * index:.0f} ms, the box of 10 % "
        f"on R, L, C of an IDA-PBC inverter (8 corners) in {1e3 * box:.0f} ms."
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--report", type=Path)
    options = parser.parse_args()
    text = [
        "# One DGU: time to decide",
        "",
        "`python tests/bench/loops.py`: medians of five, imports done, checked by the kernel's rule; compare within this run only.",
        "`ispassive` is that of python-control.",
        "",
        *rows(),
        "",
        *beyond(),
        "",
    ]
    if options.report:
        options.report.write_text("\n".join(text))
    print("\n".join(text))


if __name__ == "__main__":
    main()
