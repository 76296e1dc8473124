"""The phases of a scenario, proved one by one: as text for a terminal, as JSON for machines, and as files."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from certify.certificate import Certificate, prove
from certify.exits import EXIT_CODES, worst_of
from certify.inputs import read
from certify.jumps import Jump, find_jumps
from certify.kernel.spec import decode
from certify.phases import Phase, read_phases
from certify.report.events import event_in_words
from certify.report.files import check_folder, write_folder
from certify.report.layout import table
from certify.report.machine import verdict_to_dict
from certify.report.network import summary
from certify.report.text import approximate, open_claims, paint, stability
from certify.search.prove import Progress
from certify.simulator.scenario import Event

SHOWN_ISLANDS = 12
SHOWN_PHASES = 12
SHARES = 1000  # of a phase, for progress
CAVEAT = (
    "H is the storage of the new phase right after its events, and c the level up to which the new phase is proved to "
    "attract.\nThat is computed from the two certificates and not a proof. It rests on the phase before having come to "
    "rest, and on ideal\nswitching: lines connect discharged, DGUs synchronised and without load unless their event "
    "says discharged, and a new\ncontroller takes over the voltage that is applied."
)


@dataclass(frozen=True)
class ProvedPhase:
    """A phase, its certificate, and how far its events throw it; no `jumps` for the first, nothing is before it."""

    phase: Phase
    certificate: Certificate
    jumps: tuple[Jump, ...]


def run(options: argparse.Namespace, bar: Any) -> int:
    """The command `certify prove --scenario`. Returns the exit code: the worst of all phases.

    With `--simulate` the scenario is then simulated and compared. `bar` opens a progress bar.

    Raises: SpecError for bad input, in the spec or in a phase, or for files that cannot be written; Rejected.
    """
    spec, name = read(options.spec), options.scenario
    phases = read_phases(spec, name)
    names = [(f"{name}-{phase.number}.json", f"{name}-{phase.number}.cert.json") for phase in phases]
    if options.output is not None:
        check_folder(options.output, [file for pair in names for file in pair], options.spec)
    with bar(f"proving {options.spec}") as progress:
        proved = prove_phases(spec, phases, progress, options.method, options.stamp)
    if options.output is not None:
        files: dict[str, bytes] = {}
        for pair, entry in zip(names, proved, strict=True):
            files |= dict(zip(pair, (entry.phase.spec, entry.certificate.data), strict=True))
        write_folder(options.output, files)
    code = worst_of(EXIT_CODES[entry.certificate.verdict.outcome] for entry in proved)
    found, told = None, list[str]()
    if options.simulate:
        from certify.report.crosscheck import CONTRADICTED, after_proof, render, to_dict  # numpy, only for this

        certificates = {entry.phase.number: entry.certificate.data for entry in proved}
        checked, kept = after_proof(options, spec, certificates, bar)
        found, told = to_dict(checked, kept), ["", *render(checked, kept, sys.stdout.isatty())]
        code = CONTRADICTED if found["contradicted"] else code
    if options.json:
        result = scenario_to_dict(proved, names, options, code) | ({"cross_check": found} if found else {})
        print(json.dumps(result, indent=1, ensure_ascii=False))
    else:
        print("\n".join([render_scenario(proved, names, options, sys.stdout.isatty()), *told]))
    return code


def prove_phases(
    spec: bytes,
    phases: Sequence[Phase],
    progress: Progress | None = None,
    method: str | None = None,
    stamp: bool = False,
) -> tuple[ProvedPhase, ...]:
    """Prove each phase of a spec, in order; phases that are the same are proved once. Raises: SpecError, Rejected."""
    whole, known, proved = decode(spec), dict[bytes, Certificate](), list[ProvedPhase]()
    for phase in phases:
        if phase.spec not in known:
            part = _part_of(progress, len(proved), len(phases))
            known[phase.spec] = prove(phase.spec, part, method=method, stamp=stamp)
        certificate = known[phase.spec]
        before = proved[-1] if proved else None
        jumps = find_jumps(whole, (before.phase, before.certificate), (phase, certificate)) if before else ()
        proved.append(ProvedPhase(phase, certificate, jumps))
    return tuple(proved)


def _part_of(progress: Progress | None, done: int, total: int) -> Progress | None:
    """The progress of one phase as a part of that of all."""
    if progress is None:
        return None
    return lambda claims, of: progress(SHARES * done + SHARES * claims // max(of, 1), SHARES * total)


def _worst_outcome(proved: Sequence[ProvedPhase]) -> str:
    outcomes = {entry.certificate.verdict.outcome for entry in proved}
    return next(word for word in ("refuted", "unknown", "conditional", "certified") if word in outcomes)


def render_scenario(
    proved: Sequence[ProvedPhase],
    names: Sequence[tuple[str, str]],
    options: argparse.Namespace,
    colour: bool = False,
) -> str:
    """For each phase its time, its events, how far they throw it, the outcome and the claims that are open."""
    outcome = _worst_outcome(proved)
    head = paint(outcome, colour, outcome.upper())
    lines = [f"{head}: scenario {options.scenario} of {options.spec}, phases: {len(proved)}"]
    for entry in proved:
        lines += ["", *_render_phase(entry, options.all, colour)]
    lines.append("")
    verdicts = [entry.certificate.verdict for entry in proved]
    lines += _proved_within(proved)
    ledger = dict.fromkeys(name for verdict in verdicts for name, _ in verdict.assumptions)
    lines.append(f"assumed, not proved: {', '.join(ledger)} (`certify explain CERT SPEC` says how, for each phase)")
    if len(proved) > 1:
        lines += ["", CAVEAT]
    if options.output is not None:
        last = "" if len(names) == 1 else f" to {names[-1][1]}"
        lines += ["", f"specs and certificates: {names[0][0]}, {names[0][1]}{last} in {options.output}"]
    return "\n".join(lines)


def _proved_within(proved: Sequence[ProvedPhase]) -> list[str]:
    """What is said about stability, with the phases of which it is said unless that is all of them."""
    said: dict[str, list[str]] = {}
    for entry in proved:
        for text in stability(entry.certificate.verdict):
            said.setdefault(text, []).append(str(entry.phase.number))
    lines = []
    for text, numbers in said.items():
        some = f"phase{'s' if len(numbers) > 1 else ''} {', '.join(numbers[:SHOWN_PHASES])}"
        some += f" and {len(numbers) - SHOWN_PHASES} more" if len(numbers) > SHOWN_PHASES else ""
        lines.append(f"within {'a phase' if len(numbers) == len(proved) else some}, {text}")
    return lines


def _render_phase(entry: ProvedPhase, every_claim: bool, colour: bool) -> list[str]:
    phase, verdict = entry.phase, entry.certificate.verdict
    settled = sum(claim.status == "proved" for claim in verdict.claims)
    word = paint(verdict.outcome, colour, verdict.outcome.upper())
    lines = [f"phase {phase.number}, {phase.span}: {word}, {settled} of {len(verdict.claims)} claims proved"]
    lines += [f"  {event_in_words(event)}" for event in phase.events]
    if phase.off:
        lines.append(f"  off: {', '.join(phase.off)}")
    lines += [f"  {_render_jump(jump)}" for jump in entry.jumps[:SHOWN_ISLANDS]]
    if len(entry.jumps) > SHOWN_ISLANDS:
        lines.append(f"  and {len(entry.jumps) - SHOWN_ISLANDS} more islands (--json has them all)")
    lines += [f"  {line}" for line in summary(verdict, entry.certificate.notes)]
    if every_claim:
        lines.append(table(((c.status, c.id, c.rule or "-", c.statement) for c in verdict.claims), "    "))
    found = open_claims(verdict, entry.certificate.notes, colour)
    return [*lines, *(f"    {line}".rstrip() for line in found)]


def _event_to_dict(event: Event) -> dict[str, Any]:
    """An event for machines: what it sets as the spec has it, but of the coefficients of a load only the names."""
    entry: dict[str, Any] = {"at": str(event.at_second), "action": event.action, "part": event.part}
    entry["target"] = event.target
    if event.index is not None:
        entry["index"] = event.index
    if event.part == "DGU" and event.action == "connect":
        entry["filter"] = "discharged" if event.discharged else "synchronised"
    if event.action == "load":
        entry["set"] = sorted(key for key, _ in event.coefficients)
    elif event.reference_volt is not None:
        entry["set"] = [str(x) for x in event.reference_volt]
    elif event.controller is not None:
        entry["set"] = event.controller
    return entry


def _render_jump(jump: Jump) -> str:
    where = f"island of node {jump.island}"
    if jump.storage_joule is None:
        return f"H: unknown on the {where}, because {jump.reason}"
    text = f"H = {approximate(jump.storage_joule)} J on the {where}, "
    if jump.everything:
        text += "inside: everything is attracted"
    elif jump.level_joule is None:
        text += f"unknown whether inside, because {jump.reason}"
    else:
        share = ""
        if jump.share is not None:
            small = jump.share < 1
            share = (
                f" ({approximate(100 * jump.share)} % of it)" if small else f" ({approximate(jump.share)} times that)"
            )
        text += f"{jump.status} of c = {approximate(jump.level_joule)} J{share}"
    part, value = jump.parts[0]
    return f"{text}; most of it: {part}, {approximate(value)} J" if value else text


def scenario_to_dict(
    proved: Sequence[ProvedPhase], names: Sequence[tuple[str, str]], options: argparse.Namespace, code: int
) -> dict[str, Any]:
    """Each phase with its verdict; exact numbers as text, times in seconds, H and c in joule."""
    phases = []
    for entry, (spec, certificate) in zip(proved, names, strict=True):
        phase = entry.phase
        phases.append(
            {
                "number": phase.number,
                "start": str(phase.start_second),
                "end": str(phase.end_second),
                "events": [_event_to_dict(event) for event in phase.events],
                "off": list(phase.off),
                "spec": None if options.output is None else spec,
                "certificate": None if options.output is None else certificate,
                **verdict_to_dict(entry.certificate.verdict, entry.certificate.notes),
                "jumps": [_jump_to_dict(jump) for jump in entry.jumps],
            }
        )
    return {
        "spec": options.spec,
        "scenario": options.scenario,
        "folder": options.output,
        "outcome": _worst_outcome(proved),
        "phases": phases,
        "about_jumps": " ".join(CAVEAT.split()),
        "exit_code": code,
    }


def _jump_to_dict(jump: Jump) -> dict[str, Any]:
    def text(value: object) -> str | None:
        return None if value is None else str(value)

    return {
        "island": jump.island,
        "status": jump.status,
        "storage": text(jump.storage_joule),
        "level": text(jump.level_joule),
        "share": text(jump.share),
        "global": jump.everything,
        "largest": {"part": jump.parts[0][0], "storage": str(jump.parts[0][1])} if jump.parts else None,
        "reason": jump.reason or None,
    }
