"""Verdicts, claims and assumptions in plain words, for people who know control theory and not this tool."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

from certify.kernel.claims import BESIDE, Claim, Verdict
from certify.report.network import mode_status
from certify.report.page.charts import tick_text
from certify.report.page.subject import HOLDS, Subject
from certify.report.text import approximate

STATUSES = ("refuted", "unknown", "conditional", "proved")
MEANS = {
    "proved": "proved exactly; the kernel has checked the proof against the spec",
    "refuted": "refuted by an exact counterexample, which the kernel has checked",
    "unknown": "neither proved nor refuted",
    "conditional": "rests on an assumption that is only sampled, or not discharged",
}
PARTS = ("dgu", "load", "branch", "line")
SHOWN = 4

# Kind: (in the plural, what a claim of this kind says, in one line).
KINDS = {
    "dgu": ("DGUs", "each inverter with its filter and controller stores energy and gives back no more than it took"),
    "load": ("Static loads", "each draws more current when the voltage rises, at any angle, everywhere in its band"),
    "branch": ("Series R-L loads", "each stores energy and dissipates some of it"),
    "line": ("Lines", "each stores energy and dissipates some of it"),
    "interconnection": ("Interconnection", "joining nodes and lines creates no energy"),
    "invariant-set": ("LaSalle, by island", "where nothing dissipates, nothing moves"),
    "microgrid": ("Microgrid", "stability of the whole, from the claims above"),
    "equilibrium": ("Equilibrium, by island", "where the network rests"),
    "region": ("Region of attraction, by island", "from which states it returns there"),
    "saturated": ("Aside: equilibrium at the limits", "where it would rest with all inverters held at their limits"),
    "mode": ("Aside: DGUs at their limits", "the loop with an axis held at its limit; the verdict does not need these"),
}

_LEDGER = {
    "balanced": (
        "The model has one dq pair for each voltage and current.",
        "Unbalanced loads or faults put negative and zero sequence into the network, of which nothing is said.",
    ),
    "synchronous-frame": (
        "All inverters turn their dq frames with one common clock at exactly w0.",
        "Droop, drifting clocks or a PLL add dynamics that are not in the model.",
    ),
    "parameters": (
        "R, L, C, gains and loads have the values of the spec, or constant values within stated tolerances.",
        "Give a tolerance in the spec, or prove again with the changed values (`certify tolerance` finds the largest).",
    ),
    "averaged-inverter": (
        "The inverter is a voltage source without delay, dead time or ripple.",
        "Sampling and PWM delay turn the phase at high frequency; margins against them are not part of the proof.",
    ),
    "line-legs": (
        "Half of each line's capacitance at a DGU is left out, as the spec asks.",
        "Leave `line_legs` out of the spec and the capacitance counts.",
    ),
    "linear-loop": (
        "A loop given as matrices F, B, C is taken at its word.",
        "Whether the matrices are those of the real inverter is not checked.",
    ),
    "cut-off": (
        "Below its cut-off voltage a load is a constant impedance.",
        "A load that behaves otherwise there may break the claim about it.",
    ),
    "unsaturated": (
        "Inverters stay inside their limits.",
        "Nothing is said of switching between modes, and of integrators that wind up.",
    ),
}
_LEDGER_BY_START = {
    "sampled/": (
        "The load was tried at many voltages, and no violation was found.",
        "That is evidence and no proof: everything that rests on it is conditional.",
    ),
    "equilibrium/": (
        "That there is an equilibrium as claimed was neither proved nor refuted.",
        "If there is none, the statement about every equilibrium says nothing.",
    ),
    "region/": (
        "Stability is local: the motion has to start near enough, and how near is not proved.",
        "A wider band, or a cut-off of loads, may let a level be proved.",
    ),
}


def meaning(assumption: str) -> tuple[str, str]:
    """What an assumption of the ledger means, and what if it does not hold."""
    if assumption in _LEDGER:
        return _LEDGER[assumption]
    return next((text for start, text in _LEDGER_BY_START.items() if assumption.startswith(start)), ("", ""))


def listed(names: Sequence[str], shown: int = SHOWN) -> str:
    """
    >>> listed(["a"]), listed(["a", "b"]), listed(["a", "b", "c", "d", "e", "f"])
    ('a', 'a and b', 'a, b, c, d and 2 more')
    """
    if len(names) > shown + 1:
        return f"{', '.join(names[:shown])} and {len(names) - shown:,} more"
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1]))) if names else ""


def name_of(claim: str) -> str:
    """What a claim is about.

    >>> name_of("dgu/1"), name_of("branch/a/0"), name_of("microgrid"), name_of("mode/a/dq")
    ('DGU 1', 'series R-L load 0 at node a', 'the microgrid', 'DGU a with both axes at the limit')
    """
    kind, _, name = claim.partition("/")
    if kind == "branch":
        node, _, k = name.rpartition("/")
        return f"series R-L load {k} at node {node}"
    if kind == "mode":
        node, _, axes = name.rpartition("/")
        return f"DGU {node} with {'both axes' if axes == 'dq' else f'its {axes} axis'} at the limit"
    texts = {
        "dgu": f"DGU {name}",
        "load": f"load at node {name}",
        "line": f"line {name}",
        "interconnection": "the interconnection",
        "invariant-set": f"convergence on the island of node {name}",
        "microgrid": "the microgrid",
        "equilibrium": f"equilibrium of the island of node {name}",
        "region": f"region of the island of node {name}",
        "saturated": f"equilibrium at the limits, island of node {name}",
    }
    return texts.get(kind, claim)


def headline(verdict: Verdict) -> str:
    """The verdict in one sentence."""
    refuted = [c for c in verdict.claims if c.status == "refuted" and c.kind not in BESIDE]
    if verdict.outcome == "certified":
        text = next(c.statement for c in verdict.claims if c.id == "microgrid")
        return f"Proved: {text}."
    if verdict.outcome == "conditional":
        named = [name for name, _ in verdict.assumptions if "/" in name]
        return f"Proved only if what is assumed of {listed(named)} holds; everything else is proved."
    if verdict.outcome == "refuted":
        parts = [c for c in refuted if c.kind in PARTS]
        if parts:
            kinds = {"dgu": "not passive", "load": "not monotone in its band"}
            what = {kinds.get(c.kind, "not passive") for c in parts}
            are = "are" if len(parts) > 1 else "is"
            return (
                f"{_capital(listed([name_of(c.id) for c in parts]))} {are} {' or '.join(sorted(what))}: "
                "there is an exact counterexample, so the network is not certified."
            )
        reasons = {
            "limits-exceeded": "an inverter would need more than its limits",
            "reference-outside-band": "a reference lies outside of the band of the load at its node",
        }
        why = listed(sorted({reasons[c.rule] for c in refuted if c.rule in reasons}))
        return f"{_capital(listed([name_of(c.id) for c in refuted]))}: refuted{f', because {why}' if why else ''}."
    undecided = [c for c in verdict.claims if c.status not in HOLDS and c.kind not in BESIDE]
    causes = [c for c in undecided if c.kind in PARTS] or [c for c in undecided if c.kind == "equilibrium"] or undecided
    rests = ", and so is what rests on that" if len(causes) < len(undecided) else ""
    are = "are" if len(causes) > 1 else "is"
    return f"{_capital(listed([name_of(c.id) for c in causes]))} {are} not decided{rests}."


def caveat(verdict: Verdict) -> str:
    """What the verdict does not say, in one sentence."""
    if verdict.outcome == "refuted":
        if any(c.status == "refuted" and c.kind in PARTS for c in verdict.claims):
            return (
                "This refutes the claim about the part, not the stability of the network: other parts may make up for "
                "it. Whether the network is stable is neither proved nor refuted here."
            )
        return "Where the network goes instead is not said."
    if verdict.outcome == "unknown":
        return "An undecided claim is no statement about the network: neither that it is stable, nor that it is not."
    limits = " and inverters saturate" if any(n == "unsaturated" for n, _ in verdict.assumptions) else ""
    return f"Not claimed: what happens where load voltages leave their bands{limits}, and what the ledger assumes."


def proved_in_words(subject: Subject) -> list[str]:
    """What is proved, a line each."""
    verdict, lines = subject.verdict, list[str]()
    main = subject.claims["microgrid"]
    if main.status in HOLDS and verdict.outcome != "refuted":
        lines.append(_if_assumed(main, f"{main.statement}."))
    else:
        parts = [c for c in verdict.claims if c.kind in PARTS]
        good = sum(c.status == "proved" for c in parts)
        lines.append(f"{good:,} of {len(parts):,} parts (DGUs, loads, lines) satisfy their claims.")
    for name, rest in list(subject.rests.items())[:SHOWN]:
        where = f" of the island of node {name}" if len(subject.context.islands) > 1 else ""
        only = "There is exactly one equilibrium" if rest.only_one else "There is an equilibrium"
        near = f"known to {short(rest.radius)} V" if rest.radius > 1e-40 else "known exactly"
        lines.append(f"{only}{where} with all load voltages in their bands, {near}.")
    for name, region in list(subject.regions.items())[:SHOWN]:
        where = f" on the island of node {name}" if len(subject.context.islands) > 1 else ""
        text = f"Motion{where} from H ≤ {region.level or 0:.6g} J returns to it."
        if region.level is None:
            text = f"All motion{where} tends to it, from everywhere."
        lines.append(_if_assumed(subject.claims[f"region/{name}"], text))
    more = len(subject.rests) - SHOWN
    return [*lines, f"And the same of {more:,} more islands."] if more > 0 else lines


def _if_assumed(claim: Claim, text: str) -> str:
    """What a claim says, if it is conditional with that condition."""
    if claim.status == "conditional":
        return f"Only if what the ledger assumes holds: {text[:1].lower()}{text[1:]}"
    return _capital(text)


def not_proved_in_words(subject: Subject) -> list[str]:
    """What is refuted, open or assumed, a line each."""
    verdict, lines = subject.verdict, list[str]()
    asides = [c for c in verdict.claims if c.kind in BESIDE and c.status not in HOLDS]
    for status, text in (("refuted", "Refuted"), ("unknown", "Not decided"), ("conditional", "Conditional")):
        found = [name_of(c.id) for c in verdict.claims if c.status == status and c.kind not in BESIDE]
        if found:
            lines.append(f"{text}: {listed(found)}.")
    if asides:
        lines.append(f"Aside, without effect on the verdict: {listed([name_of(c.id) for c in asides])}.")
    lines.append(f"Assumed: {', '.join(name for name, _ in verdict.assumptions)}.")
    lines.append("Nothing is said of voltages outside the bands.")
    return lines


def margin_of(claim: Claim) -> str:
    """The number of a claim that tells how far it is from failing, with what it is."""
    facts = {name: (value, unit) for name, value, unit in claim.facts}

    def told(name: str, said: str) -> str:
        value, unit = facts[name]
        return f"{said} {approximate(value)} {unit}".rstrip()

    if claim.rule == "series-branch":
        return told("dissipation per squared current", "R =")
    if "shortage eps" in facts:
        return told("shortage eps", "short by")
    if claim.rule == "quadratic-storage":
        ranks = [name for name in facts if name.startswith("dissipation matrix of rank ")]
        return "P > 0" + "".join(
            f", M ≥ 0 of {name.split(',')[0].removeprefix('dissipation matrix of ')}" for name in ranks
        )
    if "strictly monotone" in facts:
        return "strictly monotone" if facts["strictly monotone"][0] else "monotone, not strictly"
    for name, said in (
        ("Re(u* Z(s0) u)", "Re u*Z(s₀)u ="),
        ("violating product, at most", "gains at least"),
        ("violating product", "gains"),
        ("radius of the proof", "within"),
        ("level c of the storage", "c ="),
    ):
        if name in facts:
            value, unit = facts[name]
            shown = -value if said.startswith("gains") else value
            return f"{said} {approximate(shown) if name != 'radius of the proof' else short(float(value))} {unit}"
    if "global" in facts:
        return "everywhere"
    if claim.kind == "mode":
        return mode_status(claim)
    return ""


def decimal(value: Fraction, digits: int = 12) -> str:
    """A rational to twelve significant digits, marked if that is not all of it.

    >>> decimal(Fraction(1, 3)), decimal(Fraction(5, 2)), decimal(Fraction(0))
    ('≈ 0.333333333333', '2.5', '0')
    """
    try:
        text = f"{float(value):.{digits}g}"
        near = Fraction(text) != value
    except (OverflowError, ValueError):
        return f"≈ {approximate(value)}"
    if value and not float(value):
        return f"≈ {approximate(value)}"
    return f"≈ {text}" if near else text


def short(x: float) -> str:
    """Two digits, for a radius or a difference.

    >>> short(3.07e-11), short(0.25), short(0.0)
    ('3.1·10⁻¹¹', '0.25', '0')
    """
    return tick_text(float(f"{x:.2g}"))


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
