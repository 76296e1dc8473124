"""What the oracle says of the cases for simulations, kept, because it takes minutes to say it.

python tests/simulation_references.py [--jobs N]    computes all of it anew

Each reference carries a hash of the spec, the events and the times that it is about; a test computes some of them
again, and no other is used unless its hash is right.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))  # so that it runs as a script

from tests.simulation_cases import Case, benchmark_cases, random_cases

FOLDER = Path(__file__).resolve().parent / "data" / "simulations"
Reference = dict[tuple[str, ...], Any]


def all_cases() -> list[Case]:
    return [*benchmark_cases(), *random_cases()]


def file_of(case: Case) -> Path:
    return FOLDER / f"{case.name.replace(',', '').replace(' = ', '-').replace(' ', '-')}.npz"


def fingerprint(case: Case) -> str:
    told = json.dumps(
        [case.document, case.timed, case.start, case.end, case.off, case.samples.tolist()], sort_keys=True
    )
    return hashlib.sha256(told.encode()).hexdigest()


def write(case: Case) -> str:
    """Ask the oracle, and keep what it says."""
    reference = case.reference()
    parts = {json.dumps(part): values for part, values in reference.items()}
    FOLDER.mkdir(parents=True, exist_ok=True)
    numpy.savez_compressed(file_of(case), fingerprint=numpy.array(fingerprint(case)), **parts)
    return case.name


def read(case: Case) -> Reference:
    """What is kept of a case. Raises: ValueError if it is about another one."""
    with numpy.load(file_of(case), allow_pickle=False) as kept:
        if str(kept["fingerprint"]) != fingerprint(case):
            raise ValueError(f"{case.name} has changed: python tests/simulation_references.py")
        return {tuple(json.loads(name)): kept[name] for name in kept.files if name != "fingerprint"}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    with ProcessPoolExecutor(options.jobs) as pool:
        for name in pool.map(write, all_cases()):
            print(name)


if __name__ == "__main__":
    main()
