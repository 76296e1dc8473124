"""Deciding many specs, in several processes: which ones are meant, each once, in the order given."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from certify.exits import USAGE
from certify.gating.committed import ENDINGS, SUFFIX
from certify.gating.decide import decide
from certify.gating.policy import Policy
from certify.gating.results import Committed, Decision, Problem
from certify.kernel.errors import Fault

FEW = 4  # specs for each process, if nothing is said: fewer are not worth its start


def select(paths: Sequence[str], certificates: str | None = None) -> tuple[list[str], list[Decision], list[str]]:
    """The specs that are meant, each once; decisions about what is none; and what there is to say about it.

    A certificate stands for the spec beside it, so that a hook that is given changed files notices a changed
    certificate too. `certificates`: the folder in which they may be by the paths of their specs.
    """
    specs: dict[str, str] = {}
    given: set[str] = set()
    stray: list[Decision] = []
    told: list[str] = []
    for path in paths:
        meant = _specs_of(path, certificates) if _is_certificate(path) else [path]
        if not meant:
            fault = Fault(
                "U015", "", f"a certificate, and there is no spec beside it: {path.removesuffix(SUFFIX)}.toml"
            )
            problem = Problem("bad input", path, fault, USAGE)
            stray.append(Decision(path, None, Committed("none", path), None, {}, (problem,), None, 0.0))
        for spec in meant:
            real = os.path.realpath(spec)
            specs.setdefault(real, spec)
            if spec == path:
                if real in given:
                    told.append(f"{spec} is given twice, and judged once")
                given.add(real)
    return list(specs.values()), stray, told


def _is_certificate(path: str) -> bool:
    if not path.endswith(SUFFIX):
        return False
    try:
        with Path(path).open("rb") as file:
            return b'"certify/microgrid@' not in file.read(1 << 20)
    except OSError:
        return False


def _specs_of(certificate: str, folder: str | None) -> list[str]:
    names = [certificate.removesuffix(SUFFIX)]
    if folder is not None:
        names.append(os.path.relpath(names[0], folder))
    return [name + ending for name in names for ending in ENDINGS if os.path.isfile(name + ending)]


def decide_specs(specs: Sequence[str], policy: Policy, bar: Any, jobs: int | None = None) -> Iterator[Decision]:
    """A decision for each spec, in order. `jobs`: processes, by default as many as there are cores, for many specs.

    `bar(title)`: opens a progress bar.
    """
    processes = min(jobs or min(os.cpu_count() or 1, len(specs) // FEW), len(specs))
    if processes <= 1:
        for spec in specs:
            with bar(f"proving {spec}") as progress:
                decision = decide(spec, policy, progress)
            yield decision
        return
    from concurrent.futures import ProcessPoolExecutor

    with ProcessPoolExecutor(processes) as pool, bar(f"judging {len(specs)} specs") as progress:
        for done, decision in enumerate(pool.map(partial(decide, policy=policy), specs), 1):
            if progress:
                progress(done, len(specs))
            yield decision
