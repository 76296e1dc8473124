"""The command `certify simulate`: reading its options, running it, and telling what came of it as text and as JSON."""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

from certify import __version__
from certify.crosscheck.run import Checked, CrossCheck
from certify.inputs import read
from certify.kernel.errors import Fault, SpecError
from certify.kernel.quantity import QuantityError, parse_decimal, parse_quantity, shorten
from certify.kernel.reader import read_document
from certify.report.crosscheck import (
    CONTRADICTED,
    Bar,
    keep,
    read_certificates,
    render,
    storage_curve,
    to_dict,
)
from certify.report.events import event_in_words
from certify.report.files import check_folder, write_folder
from certify.report.layout import table
from certify.report.machine import finite
from certify.report.text import paint
from certify.samples import SUFFIXES, read_state, write_samples
from certify.settling import DguCourse, PhaseCourse, Watch
from certify.simulation import MAX_SECONDS, TOLERANCES, Course, Simulation, Stage, simulate_course
from certify.simulator.motion import Piece
from certify.simulator.plant import Array
from certify.simulator.scenario import STARTS

SIMULATED, DIVERGED = 0, 3  # exit codes: no float refutes anything
BAND = "0.01 %"
MAX_SAMPLES = 10**8
MAX_ATTEMPTS = 10_000
BLURRED = 100  # times what a step may add to the error: a narrower band says little
SHOWN_DGUS = 12
SHOWN_PHASES = 24
SHOWN_EVENTS = 8
KINDS = ("svg", "png")
PICTURES = ("voltages", "errors", "zoom", "terminals", "storage")
EVIDENCE = "computed in floats, with the values of the spec: what happens, but no proof"


@dataclass(frozen=True)
class Wish:
    """The options of the command, read. `bands`: what counts as settled, in V, of a DGU by its node and reference."""

    end_second: Fraction | None
    tolerance: float
    samples: int
    band: str
    bands: Callable[[str, complex], float]


@dataclass(frozen=True)
class Outcome:
    """What came of a simulation and of its cross-check. `files`: those that were written; `kept`: a contradiction."""

    course: Course
    wish: Wish
    simulation: Simulation
    phases: tuple[PhaseCourse, ...]
    checked: tuple[Checked, ...] = ()
    kept: str | None = None
    files: tuple[str, ...] = ()

    @property
    def code(self) -> int:
        if any(entry.contradictions for entry in self.checked):
            return CONTRADICTED
        return SIMULATED if self.simulation.diverged is None else DIVERGED

    @property
    def word(self) -> str:
        return "simulated" if self.simulation.diverged is None else "diverged"


def run(options: argparse.Namespace, bar: Bar) -> int:
    """The command `certify simulate`. Returns the exit code: 0, 3 if the motion left all bounds, 4 for a contradiction.

    `bar` opens a progress bar. Raises: SpecError for bad input, all that can be told before the work, or for files that
    cannot be written; Rejected for a certificate that the kernel does not accept.
    """
    faults: list[Fault] = []

    def attempt(action: Callable[[], Any]) -> Any:
        try:
            return action()
        except SpecError as error:
            faults.extend(error.faults)

    attempt(lambda: _check_targets(options))
    spec: bytes | None = attempt(lambda: read(options.spec))
    wish: Wish | None = attempt(lambda: read_wish(options, spec))
    course: Course | None = None
    if spec is not None:
        end = wish.end_second if wish else None
        course = attempt(lambda: Course(spec, options.scenario, end))
    start: str | Array | None = None
    certificates: dict[int, bytes] | None = None
    if course is not None:
        start = attempt(lambda: _read_start(options.start, course))
        if options.check is not None:
            certificates = attempt(lambda: read_certificates(options.check, course, options.scenario))
    if faults or spec is None or wish is None or course is None:
        raise SpecError(tuple(dict.fromkeys(faults)))
    watch = Watch(wish.bands)
    check = CrossCheck(course.phases, certificates, wish.tolerance, options.attempts) if certificates else None

    def observe(stage: Stage, piece: Piece) -> None:
        watch(stage, piece)
        if check:
            check.see(stage, piece)

    with bar(f"simulating {options.spec}", "s") as progress:
        simulation = simulate_course(
            course,
            start=start,
            samples=wish.samples,
            tolerance=wish.tolerance,
            method=options.method,
            progress=progress,
            observe=observe,
        )
    if options.start is not None and start is not options.start:
        simulation = replace(simulation, start=options.start)
    outcome = Outcome(course, wish, simulation, watch.result(simulation))
    if check:
        with bar("trying to break the certificate") as progress:
            outcome = replace(outcome, checked=tuple(check.finish(progress)))
        outcome = replace(outcome, kept=keep(options.spec, course, simulation, outcome.checked, {"spec": options.spec}))
    outcome = replace(outcome, files=_write(options, spec, outcome))
    if options.json:
        print(json.dumps(finite(outcome_to_dict(outcome, options)), indent=1, ensure_ascii=False))
    else:
        print(render_outcome(outcome, options, sys.stdout.isatty()))
    return outcome.code


def read_wish(options: argparse.Namespace, spec: bytes | None) -> Wish:
    """The numbers among the options. Raises: SpecError U005 with all that are of no use."""
    faults: list[Fault] = []

    def number(
        option: str, text: str, parse: Callable[[str], Fraction], good: Callable[[Fraction], bool], expected: str
    ) -> Any:
        try:
            value = parse(text)
        except QuantityError as error:
            faults.append(Fault("U005", option, error.message))
            return None
        if not good(value):
            faults.append(Fault("U005", option, f"expected {expected}, got {shorten(text)}"))
            return None
        return value

    base = _base_volt(spec)
    pu = {"V": base} if base else {}
    end = None
    if options.end is not None:
        expected = f"a time after 0 s, up to {MAX_SECONDS:.0e} s"
        end = number(
            "--end", options.end, lambda x: parse_quantity(x, "s", {}), lambda x: 0 < x <= MAX_SECONDS, expected
        )
    low, high = TOLERANCES
    tolerance = number("--tolerance", options.tolerance, parse_decimal, lambda x: low <= x <= high, "1e-13 to 1e-2")
    if not 1 <= options.samples <= MAX_SAMPLES:
        faults.append(Fault("U005", "--samples", f"expected a number from 1 to {MAX_SAMPLES}, got {options.samples}"))
    if not 0 <= options.attempts <= MAX_ATTEMPTS:
        given = f"expected a number from 0 to {MAX_ATTEMPTS}, got {options.attempts}"
        faults.append(Fault("U005", "--attempts", given))
    text = BAND if options.band is None else options.band
    share = text.strip().endswith("%")
    band = number("--band", text, lambda x: parse_quantity(x, "" if share else "V", pu), lambda x: x > 0, "more than 0")
    if faults:
        raise SpecError(tuple(faults))

    def bands(_: str, reference_volt: complex) -> float:
        if not share:
            return float(band)
        return float(band) * (float(base) if base else abs(reference_volt))

    return Wish(end, float(tolerance), options.samples, text, bands)


def _base_volt(spec: bytes | None) -> Fraction | None:
    """The base voltage of a spec, None if it has none or is not one: that is told elsewhere."""
    try:
        document = read_document(spec) if spec is not None else {}
        raw = document.get("base_voltage") if isinstance(document, dict) else None
        return None if raw is None else parse_quantity(raw, "V", {})
    except (SpecError, QuantityError):
        return None


def _read_start(start: str | None, course: Course) -> str | Array | None:
    return start if start is None or start in STARTS else read_state(start, course)


def _check_targets(options: argparse.Namespace) -> None:
    """Faults of -o and --plot that can be told before the work. Raises: SpecError."""
    faults: list[Fault] = []
    if options.output is not None:
        target, reason = Path(options.output), ""
        if target.exists() and Path(options.spec).exists() and target.samefile(options.spec):
            reason = "it is the spec itself"
        elif target.is_dir() or not target.parent.is_dir():
            reason = "there is no such folder, or it is a folder itself"
        elif options.plot is not None and target.resolve() == Path(options.plot).resolve():
            reason = "--plot makes a folder there"
        elif target.suffix.lower() not in SUFFIXES:
            reason = f"its name must end in {' or '.join(SUFFIXES)}"
        if reason:
            faults.append(Fault("U001", "-o", f"cannot write {options.output}: {reason}"))
    if options.plot is not None:
        try:
            names = [f"{name}.{kind}" for name in PICTURES for kind in KINDS]
            check_folder(options.plot, names, options.spec, "--plot")
        except SpecError as error:
            faults += error.faults
    if faults:
        raise SpecError(tuple(faults))


def _write(options: argparse.Namespace, spec: bytes, outcome: Outcome) -> tuple[str, ...]:
    """Write the files that were asked for: also of a motion that diverged, up to there. Raises: SpecError."""
    files: list[str] = []
    if options.output is not None:
        about = {
            "certify": __version__,
            "spec": options.spec,
            "spec_sha256": hashlib.sha256(spec).hexdigest(),
            **finite(_summary(outcome, options)),
            "phases": outcome.simulation.phases,
        }
        try:
            write_samples(Path(options.output), outcome.simulation, about)
        except OSError as error:
            raise SpecError((Fault("U001", "-o", f"cannot write {options.output}: {error.strerror}"),)) from None
        files.append(options.output)
    if options.plot is not None and len(outcome.simulation.times) > 1:
        from certify.report.figures import to_bytes
        from certify.report.simulation_plots import draw_figures

        title = f"{Path(options.spec).name}{f', scenario {options.scenario}' if options.scenario else ''}"
        storage = storage_curve(outcome.checked)
        figures = draw_figures(outcome.course, outcome.simulation, outcome.phases, title, storage)
        pictures = {f"{name}.{kind}": to_bytes(x, kind) for name, x in figures.items() for kind in KINDS}
        write_folder(options.plot, pictures, "--plot")
        files += [str(Path(options.plot) / name) for name in pictures]
    return tuple(files)


def render_outcome(outcome: Outcome, options: argparse.Namespace, colour: bool = False) -> str:
    """What was simulated and how, each phase with its events and how the DGUs settle, and the files."""
    simulation, course = outcome.simulation, outcome.course
    what = f"scenario {options.scenario} of {options.spec}" if options.scenario else options.spec
    word = paint("unknown", colour, "DIVERGED") if simulation.diverged else "SIMULATED"
    lines = [f"{word}: {what}, 0 s to {course.end:g} s, start: {simulation.start}", _render_network(outcome)]
    for entry in outcome.phases[:SHOWN_PHASES]:
        lines += ["", *_render_phase(entry, outcome)]
    if len(outcome.phases) > SHOWN_PHASES:
        lines += ["", f"and {len(outcome.phases) - SHOWN_PHASES} more phases (--json has them all)"]
    lines.append("")
    if simulation.diverged:
        lines += [str(simulation.diverged), "  No network goes that far: something breaks, or is switched off, before."]
    elif outcome.phases:
        lines += _render_band(outcome)
    lines.append(EVIDENCE)
    if outcome.checked:
        lines += ["", *render(outcome.checked, outcome.kept, colour)]
    if options.output is not None:
        until = f", up to {simulation.times[-1]:.9g} s" if simulation.diverged and len(simulation.times) else ""
        count = f"{len(simulation.times)} of {len(simulation.columns)} columns"
        lines.append(f"samples: {count} in {options.output}{until}")
    if options.plot is not None:
        drawn = [Path(file).stem for file in outcome.files if file.endswith(".svg")]
        lines.append(f"pictures: {', '.join(drawn)} in {options.plot}" if drawn else "pictures: none, nothing to see")
    return "\n".join(lines)


def _render_network(outcome: Outcome) -> str:
    grid, branches = outcome.course.whole, sum(len(node.branches) for node in outcome.course.whole.nodes)
    counts = [(len(grid.nodes), "node"), (sum(n.dgu is not None for n in grid.nodes), "DGU"), (len(grid.lines), "line")]
    counts += [(branches, "R-L load")] if branches else []
    told = ", ".join(f"{count} {word}{'' if count == 1 else 's'}" for count, word in counts)
    methods = Counter(entry["method"] for entry in outcome.simulation.phases)
    return f"{told}; {' and '.join(methods) or 'no'} method, tolerance {outcome.wish.tolerance:g} a step"


def _render_band(outcome: Outcome) -> list[str]:
    dgus = [dgu for entry in outcome.phases for dgu in entry.dgus]
    low, high = (f(dgu.band_volt for dgu in dgus) for f in (min, max))
    within = f"{low:g} V" if low == high else f"{low:g} V to {high:g} V"
    lines = [f"settled: from then on both axes of V - V* stay within {within} up to the end of the phase"]
    if any(dgu.band_volt < BLURRED * outcome.wish.tolerance * abs(dgu.reference_volt) for dgu in dgus):
        lines.append("  That is near the accuracy of the simulation: take a smaller --tolerance, or a wider --band.")
    return lines


def _render_phase(entry: PhaseCourse, outcome: Outcome) -> list[str]:
    phase, told = entry.phase, _followed(outcome.simulation, entry)
    counts = [f"{told['windows']} window{'' if told['windows'] == 1 else 's'}"]
    limited = any(node.dgu and node.dgu.limits_volt for node in outcome.course.whole.nodes)
    if limited:
        counts.append(f"{told['switches']} times in or out of limits")
    span = phase.span if entry.complete else f"{float(phase.start_second):g} s to {entry.until_second:.9g} s"
    lines = [f"phase {phase.number}, {span}: {', '.join(counts)}"]
    lines += [f"  {event_in_words(event)}" for event in phase.events[:SHOWN_EVENTS]]
    if len(phase.events) > SHOWN_EVENTS:
        lines.append(f"  and {len(phase.events) - SHOWN_EVENTS} more events")
    if phase.off:
        lines.append(f"  off: {', '.join(phase.off[:SHOWN_EVENTS])}{', ...' if len(phase.off) > SHOWN_EVENTS else ''}")
    slowest = sorted(entry.dgus, key=lambda dgu: _slowness(entry, dgu), reverse=True)[:SHOWN_DGUS]
    shown = [dgu for dgu in entry.dgus if dgu in slowest]
    rows: list[tuple[str, ...]] = [("DGU", "largest |error|: d, q", "error at the end: d, q", "settled")]
    for dgu in shown:
        (d, q), (last_d, last_q) = dgu.largest_volt, dgu.final_volt
        rows.append((dgu.node, f"{d:.5g}, {q:.5g} V", f"{last_d:.3g}, {last_q:.3g} V", _render_settling(entry, dgu)))
    lines.append(table(rows))
    if len(entry.dgus) > len(shown):
        rest = [dgu for dgu in entry.dgus if dgu not in slowest]
        last = max(entry.settling_second(dgu) or 0.0 for dgu in rest)
        settled = f", all settled after {last:.6g} s" if all(dgu.settled for dgu in rest) else ""
        lines.append(f"  and {len(rest)} more DGUs{settled} (--json has them all)")
    if entry.lowest and entry.highest:
        (low, low_node), (high, high_node) = entry.lowest, entry.highest
        span = f"from {low:.6g} V (node {low_node}) to {high:.6g} V (node {high_node})"
        lines.append(f"  nodes without a DGU: |V| {span}")
    if entry.off_rest and entry.complete:
        what = "the equilibrium without limits" if limited else "an equilibrium"
        lines.append(f"  at the end {entry.off_rest[0]:.3g} V away from {what} (node {entry.off_rest[1]})")
    return lines


def _slowness(entry: PhaseCourse, dgu: DguCourse) -> tuple[bool, float]:
    """By which DGUs are ranked if there are many: those that do not settle, then the slowest."""
    return not dgu.settled, entry.settling_second(dgu) or max(map(abs, dgu.final_volt)) * (not dgu.settled)


def _render_settling(entry: PhaseCourse, dgu: DguCourse) -> str:
    if not entry.complete:
        return "-"
    after = entry.settling_second(dgu)
    if after is not None:
        return f"after {after:.5g} s" if after else "all along"
    if dgu.later is None:
        return "not by the end"
    at, number = dgu.later
    return f"not by the end; after {at - float(entry.phase.start_second):.5g} s, in phase {number}"


def _followed(simulation: Simulation, entry: PhaseCourse) -> dict[str, Any]:
    return next(told for told in simulation.phases if told["number"] == entry.phase.number)


def _summary(outcome: Outcome, options: argparse.Namespace) -> dict[str, Any]:
    simulation = outcome.simulation
    off = simulation.diverged
    return {
        "scenario": options.scenario,
        "outcome": outcome.word,
        "start": simulation.start,
        "end": outcome.course.end,
        "tolerance": outcome.wish.tolerance,
        "diverged": None if off is None else {"at": off.at_second, "reason": off.reason},
    }


def outcome_to_dict(outcome: Outcome, options: argparse.Namespace) -> dict[str, Any]:
    """The same for machines: times in s, voltages in V, pairs are d and q; no samples."""
    return {
        "spec": options.spec,
        **_summary(outcome, options),
        "samples": len(outcome.simulation.times),
        "states": outcome.course.size,
        "phases": [{**_followed(outcome.simulation, entry), **_phase_to_dict(entry)} for entry in outcome.phases],
        "cross_check": to_dict(outcome.checked, outcome.kept) if outcome.checked else None,
        "files": list(outcome.files),
        "about": EVIDENCE,
        "exit_code": outcome.code,
    }


def _phase_to_dict(entry: PhaseCourse) -> dict[str, Any]:
    phase, start = entry.phase, float(entry.phase.start_second)
    events = [
        {"at": float(e.at_second), "action": e.action, "part": e.part, "target": e.target, "text": event_in_words(e)}
        for e in phase.events
    ]
    dgus = [
        {
            "node": dgu.node,
            "reference": [dgu.reference_volt.real, dgu.reference_volt.imag],
            "band": dgu.band_volt,
            "largest_error": list(dgu.largest_volt),
            "final_error": list(dgu.final_volt),
            "last_outside": dgu.outside_second,
            "settled": dgu.settled,
            "settling_time": entry.settling_second(dgu),
            "finally": None
            if dgu.later is None
            else {"at": dgu.later[0], "after": dgu.later[0] - start, "phase": dgu.later[1]},
        }
        for dgu in entry.dgus
    ]
    return {
        "until": entry.until_second,
        "complete": entry.complete,
        "events": events,
        "off": list(phase.off),
        "dgus": dgus,
        "nodes_without_dgu": {"lowest": _at_node(entry.lowest), "highest": _at_node(entry.highest)},
        "from_equilibrium": _at_node(entry.off_rest),
    }


def _at_node(found: tuple[float, str] | None) -> dict[str, Any] | None:
    return None if found is None else {"volt": found[0], "node": found[1]}
