"""Cross-checks for `certify simulate --check` and `certify prove --simulate`: certificates in, findings out."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy

from certify.crosscheck.findings import Finding, worst
from certify.crosscheck.run import Checked, CrossCheck
from certify.inputs import read
from certify.kernel.errors import Fault, SpecError
from certify.report.layout import table
from certify.report.machine import finite
from certify.report.text import paint
from certify.samples import write_samples
from certify.simulation import TOLERANCE, Course, Progress, Simulation, simulate_course

Bar = Callable[..., AbstractContextManager[Progress | None]]
CONTRADICTED = 4  # exit code
KINDS = {
    "model": "Jacobian, by differences",
    "equilibrium": "equilibrium",
    "dissipation": "dissipation of each part",
    "storage": "H does not grow",
    "energy balance": "energy balance",
    "midpoint balance": "the same, by midpoints",
    "region": "region is not left",
    "return": "motion returns",
}
WORDS = "compared in floats with the simulator, whose equations are its own: agreement is evidence, and no proof"
SHOWN = 6  # contradictions and islands
KEPT_SAMPLES = 2000


def read_certificates(path: str, course: Course, scenario: str | None) -> dict[int, bytes]:
    """The certificates of all phases: a file, or of a scenario the folder that `prove --scenario -o` makes.

    Raises: SpecError U008 with everything that is missing.
    """
    files = {1: Path(path)}
    if scenario is not None:
        if not Path(path).is_dir():
            message = f"{path} is no folder; the phases of a scenario have a certificate each"
            raise SpecError((Fault("U008", "--check", message),))
        files = {phase.number: Path(path) / f"{scenario}-{phase.number}.cert.json" for phase in course.phases}
    found, faults = {}, []
    for number, file in files.items():
        try:
            found[number] = read(file)
        except SpecError as error:
            faults.append(Fault("U008", "--check", f"{file}: {error.faults[0].message}"))
    if faults:
        raise SpecError(tuple(faults))
    return found


def render(checked: Sequence[Checked], kept: str | None, colour: bool = False) -> list[str]:
    """What was compared, phase by phase, and every contradiction."""
    bad = [(entry, found) for entry in checked for found in entry.contradictions]
    if bad:
        count = f"{len(bad)} contradiction{'' if len(bad) == 1 else 's'}"
        lines = [paint("refuted", colour, f"CONTRADICTED: {count} between certificate and simulation")]
        lines += [f"  {_render_contradiction(entry, found, len(checked))}" for entry, found in bad[:SHOWN]]
        lines += [f"  and {len(bad) - SHOWN} more"] if len(bad) > SHOWN else []
        lines.append("  One of them is wrong: this is a defect of certify, or the file is not what it seems.")
        lines += [f"  the motion is kept in {kept}"] if kept else []
    else:
        lines = ["CROSS-CHECKED: no contradiction between certificate and simulation"]
    for entry in checked:
        lines += ["", *_render_phase(entry, len(checked))]
    return [*lines, "", WORDS]


def _render_contradiction(entry: Checked, found: Finding, phases: int) -> str:
    where = f"phase {entry.number}: " if phases > 1 else ""
    when = "" if found.at_second is None else f" at t = {found.at_second:.9g} s"
    origin = " of an attempt" if found.start is not None else ""
    unit = f" {found.unit}" if found.unit else ""
    return f"{where}{KINDS[found.kind]}: {found.where}{when}{origin}: {found.value:.3g}{unit}, limit {found.limit:.3g}"


def _render_phase(entry: Checked, phases: int) -> list[str]:
    lines = [f"phase {entry.number}, certificate: {entry.outcome}" if phases > 1 else f"certificate: {entry.outcome}"]
    rows = [("compared", "of", "largest difference", "limit", "where")]
    for kind, title in KINDS.items():
        own = [found for found in entry.findings if found.kind == kind]
        if own and (most := worst(own)) is not None:
            unit = f" {most.unit}" if most.unit else ""
            value = "never grows" if kind == "storage" and most.value <= 0 else f"{max(most.value, 0.0):.2g}{unit}"
            rows.append((title, str(len(own)), value, f"{most.limit:.2g}{unit}", most.where))
    lines.append(table(rows))
    for k, first in list(enumerate(entry.islands))[:SHOWN]:
        H = entry.storages[:, k]
        told = f"H from {H[0]:.6g} J to {H[-1]:.6g} J" if len(H) else "H was not looked at"
        spoken = entry.covered[k] if k < len(entry.covered) else 0.0
        lines.append(f"  island of node {first}: {told}; the claims speak of {100 * spoken:.4g} % of the time")
    best = entry.attempts.best
    if best is not None:
        inside = [attempt for attempt in entry.attempts.tried if attempt.inside]
        lines.append(
            f"  {len(inside)} attempts to break the region, none did: the best, a {best.kind} from H = "
            f"{best.share:.3g} c, came to {100 * best.edge:.3g} % of what the region allows"
            if not entry.attempts.findings
            else f"  {len(inside)} attempts to break the region"
        )
        beyond = [attempt for attempt in entry.attempts.tried if not attempt.inside]
        back = [f"{attempt.share:g} c" for attempt in beyond if attempt.returned]
        lines.append(f"  beyond the region, where nothing is claimed: returned from {', '.join(back) or 'none'}")
    lines += [f"  {entry.reason}"] if entry.reason else []
    return lines


def to_dict(checked: Iterable[Checked], kept: str | None) -> dict[str, Any]:
    """The same for machines; numbers that are none are null."""

    def finding(found: Finding) -> dict[str, Any]:
        entry = {"kind": found.kind, "where": found.where, "value": found.value, "limit": found.limit}
        return {**entry, "unit": found.unit, "at": found.at_second, "agrees": found.agrees}

    phases = [
        {
            "number": entry.number,
            "certificate": entry.outcome,
            "findings": [finding(found) for found in entry.findings],
            "contradictions": [finding(found) for found in entry.contradictions],
            "islands": [
                {
                    "first": first,
                    "covered": entry.covered[k] if k < len(entry.covered) else None,
                    "storage": [float(entry.storages[0, k]), float(entry.storages[-1, k])]
                    if len(entry.times)
                    else None,
                }
                for k, first in enumerate(entry.islands)
            ],
            "attempts": [
                {
                    key: getattr(attempt, key)
                    for key in ("island", "kind", "share", "rise", "edge", "left", "seconds", "returned")
                }
                for attempt in entry.attempts.tried
            ],
            "reason": entry.reason or None,
        }
        for entry in checked
    ]
    contradicted = any(entry["contradictions"] for entry in phases)
    return {"contradicted": contradicted, "kept": kept, "phases": finite(phases)}


def after_proof(
    options: argparse.Namespace, spec: bytes, certificates: Mapping[int, bytes], bar: Bar
) -> tuple[list[Checked], str | None]:
    """Simulate what has just been proved, from its usual start, and compare. For `certify prove --simulate`.

    Returns what was found, and where a contradiction is kept. Raises: SpecError, Rejected.
    """
    course = Course(spec, options.scenario)
    cross_check = CrossCheck(course.phases, certificates, TOLERANCE)
    with bar(f"simulating {options.spec}", "s") as progress:
        simulation = simulate_course(course, progress=progress, observe=cross_check.see)
    with bar("trying to break the certificate") as progress:
        checked = cross_check.finish(progress)
    return checked, keep(options.spec, course, simulation, checked, {"spec": options.spec})


def storage_curve(checked: Sequence[Checked]) -> tuple[Any, Any, str] | None:
    """H over time for a picture, all islands together: times, joule, label; None if there is none."""
    parts = [(entry.times, entry.storages.sum(axis=1)) for entry in checked if entry.storages.size]
    if not parts:
        return None
    return numpy.concatenate([t for t, _ in parts]), numpy.concatenate([H for _, H in parts]), "H of the certificates"


def keep(
    spec_path: str, course: Course, simulation: Simulation, checked: Sequence[Checked], about: Mapping[str, Any]
) -> str | None:
    """Write the motion that contradicts a certificate beside the working folder; None if none does.

    It is that of the first contradiction: of an attempt from its start, else that of the simulation. Raises: SpecError.
    """
    bad = [(entry, found) for entry in checked for found in entry.contradictions]
    if not bad:
        return None
    entry, found = bad[0]
    motion = simulation
    if found.start is not None:
        phase = next(phase for phase in course.phases if phase.number == entry.number)
        own = Course(phase.spec, end_second=Fraction(found.at_second or 1.0).limit_denominator(10**12))
        state = own.spread(own.plant(own.phases[0]), found.start[None, :])[0]
        motion = simulate_course(own, start=state, samples=KEPT_SAMPLES)
    path = Path(f"{Path(spec_path).stem}.contradiction.npz")
    try:
        write_samples(path, motion, {"contradiction": to_dict(checked, None), "phase": entry.number, **about})
    except OSError as error:
        raise SpecError((Fault("U001", "--check", f"cannot write {path}: {error.strerror}"),)) from None
    return str(path)
