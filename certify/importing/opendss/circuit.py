"""A script as the engine has understood it: the engine runs in a process of its own, and its answer is read here."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

from certify.importing.opendss.elements import Element, exact, refuse, to_element
from certify.kernel.errors import Fault, SpecError

TIME_LIMIT = 600  # seconds for the engine


@dataclass(frozen=True)
class Circuit:
    """What the engine holds after a script."""

    name: str
    version: str
    frequency_hertz: Fraction
    load_multiplier: Fraction
    generator_multiplier: Fraction
    elements: tuple[Element, ...]
    left_out: dict[str, list[str]]


def run_engine(path: Path) -> Circuit:
    """The circuit of a script, by an engine of its own. Raises: SpecError."""
    if importlib.util.find_spec("dss") is None:
        text = "the package dss-python is not there: pip install 'certify-eip[opendss]'"
        raise SpecError((Fault("I040", "", text),))
    if not path.is_file():
        reason = "it is not a file" if path.exists() else "there is no such file"
        raise SpecError((Fault("I041", "", reason),))
    # -P: nothing that lies in the current folder is taken for a module.
    command = [sys.executable, "-P", "-m", "certify.importing.opendss.engine", str(path.resolve())]
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(map(os.path.abspath, sys.path)),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    try:
        with tempfile.TemporaryDirectory() as folder:  # where the engine would write, if anything made it
            done = subprocess.run(
                command, capture_output=True, env=environment, cwd=folder, timeout=TIME_LIMIT, check=False
            )
    except subprocess.TimeoutExpired:
        text = f"the OpenDSS engine has not read the script within {TIME_LIMIT} s"
        raise SpecError((Fault("I045", "", text),)) from None
    try:
        answer = json.loads(done.stdout)
    except ValueError:
        ended = f"signal {-done.returncode}" if done.returncode < 0 else f"exit code {done.returncode}"
        said = done.stderr.decode(errors="replace").strip().splitlines()
        text = f"the OpenDSS engine broke down over this script ({ended})" + (f": {said[-1][:200]}" if said else "")
        raise SpecError((Fault("I045", "", text),)) from None
    return to_circuit(answer)


def to_circuit(answer: dict[str, Any]) -> Circuit:
    """What the engine's process has written. Raises: SpecError."""
    if "faults" in answer:
        raise SpecError(tuple(Fault(*fault) for fault in answer["faults"]))
    raw = answer["circuit"]
    faults = []
    if raw["year"]:
        text = f"`Set year={raw['year']}`: loads that have grown are not followed; leave the year at 0"
        faults.append(Fault("I053", "", text))
    if raw["frequency"] != raw["base_frequency"]:
        text = f"`Set frequency={raw['frequency']:g}` beside a base frequency of {raw['base_frequency']:g} Hz"
        faults.append(Fault("I053", "", text))
    elements = tuple(map(to_element, raw["elements"]))
    for element in elements if raw["scaled"] else ():
        # The engine scales the reactive power that it tells of them, and keeps to the one before.
        if element.kind == "load" and element.enabled and element.properties["Model"] in (6, 7):
            text = f"{raw['scaled']} beside a load of model {element.properties['Model']}, of which OpenDSS then tells"
            faults.append(
                Fault("I053", element.name, f"{text} another kvar than it takes; state the factor at each load")
            )
    refuse(faults)
    return Circuit(
        raw["name"],
        raw["version"].partition(" revision")[0],
        exact(raw["frequency"], "frequency"),
        exact(raw["load_multiplier"], "loadmult"),
        exact(raw["generator_multiplier"], "genmult"),
        elements,
        raw["left_out"],
    )
