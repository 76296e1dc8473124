"""With numba, where it is installed, inner loops are compiled: the same code has to come to the same numbers."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import numpy
import pytest

from tests.conftest import ROOT

RUN = (
    "import sys, numpy\n"
    "from fractions import Fraction\n"
    "from certify.simulator.compiled import COMPILED\n"
    "from certify.simulation import simulate\n"
    "spec = open(sys.argv[1], 'rb').read()\n"
    "found = simulate(spec, end=Fraction(1, 100), samples=20, method=sys.argv[2])\n"
    "numpy.savez(sys.argv[3], states=found.states, compiled=COMPILED)\n"
)


def states(spec: str, method: str, file: Path, compiled: bool) -> numpy.ndarray:
    environment = {**os.environ, "CERTIFY_NUMBA": "1" if compiled else "0"}
    command = [sys.executable, "-c", RUN, str(ROOT / "specs" / spec), method, str(file)]
    subprocess.run(command, check=True, cwd=ROOT, env=environment)
    with numpy.load(file) as found:
        assert bool(found["compiled"]) == compiled
        return found["states"]


@pytest.mark.skipif(importlib.util.find_spec("numba") is None, reason="numba is an extra: pip install '.[fast]'")
@pytest.mark.parametrize(
    ("spec", "method"),
    [("cigre-mv.toml", "exponential"), ("other-loads.toml", "exponential"), ("cigre-mv.toml", "collocation")],
)
def test_compiled_code_comes_to_the_same_numbers(spec: str, method: str, tmp_path: Path) -> None:
    plain, compiled = (states(spec, method, tmp_path / f"{c}.npz", c) for c in (False, True))
    scale = numpy.abs(plain).max(axis=0)
    assert (numpy.abs(plain - compiled) <= 1e-8 * numpy.maximum(scale, 1e-6 * scale.max())).all()
