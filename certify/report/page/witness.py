"""What is refuted, explained for people who know control theory, and what is open, with its reason."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

from markupsafe import Markup

from certify.diagnostics import DIAGNOSTICS
from certify.kernel.claims import BESIDE, Claim, Mode
from certify.kernel.errors import RuleFailure
from certify.kernel.model import LinearPort, dgu_port, to_state_feedback
from certify.kernel.spec import IdaPbc, StateFeedback
from certify.report.page.charts import Axis, Chart, tick_text
from certify.report.page.entries import FactRow, fact_row
from certify.report.page.margins import Margins
from certify.report.page.subject import Subject
from certify.report.page.words import PARTS, decimal, name_of
from certify.report.text import approximate
from certify.search.nearest import NAMES, Suggestion

SHOWN = 8  # refuted or open claims told in full
POINTS = 360  # of a frequency response
SHOWN_FACTS = 12
FEW = 4  # of them in a sentence
_NOT_NETWORK = (
    "This refutes the claim about this part, not the stability of the network: other parts may make up for it."
)


@dataclass(frozen=True)
class Gain:
    """One gain matrix as it is and as the nearest passive gains have it, in decimals, and the change in per cent."""

    name: str
    old: tuple[tuple[str, ...], ...]
    new: tuple[tuple[str, ...], ...]
    change: str


@dataclass(frozen=True)
class Advice:
    largest: str
    where: str
    fragment: str
    gains: tuple[Gain, ...]


@dataclass(frozen=True)
class Story:
    """One refuted or open claim: the key formula and its number, what it means, a picture, and what to change."""

    claim: Claim
    anchor: str
    name: str
    headline: str
    formula: str
    value: str
    paragraphs: tuple[str, ...]
    facts: tuple[FactRow, ...]
    relation: str = "="
    picture: Markup | None = None
    caption: str = ""
    advice: Advice | None = None
    code: str = ""
    remedy: str = ""


@dataclass(frozen=True)
class Stories:
    """Those told in full, how many more there are, and the claims that are open only because of them."""

    told: tuple[Story, ...]
    more: int
    following: tuple[str, ...]


def tell_failures(subject: Subject, margins: Margins, advice: Mapping[str, Suggestion]) -> Stories:
    """Each claim that is not proved, causes first."""
    open_claims = [c for c in subject.verdict.claims if c.status != "proved" and c.kind not in BESIDE]
    refuted = [c for c in open_claims if c.status == "refuted"]
    parts = [c for c in open_claims if c.kind in PARTS and c.status != "refuted"]
    others = [c for c in open_claims if c not in refuted and c not in parts]
    causes = refuted + parts
    follow = (
        {"invariant-set", "microgrid", "region"} if causes or any(c.kind == "equilibrium" for c in others) else set()
    )
    alone = causes + [c for c in others if c.kind not in follow or _has_own_reason(subject, c)]
    following = tuple(c.id for c in others if c not in alone)
    told = tuple(_story(subject, claim, margins, advice.get(claim.id)) for claim in alone[:SHOWN])
    return Stories(told, max(0, len(alone) - SHOWN), following)


def _has_own_reason(subject: Subject, claim: Claim) -> bool:
    """Whether the note of a claim that rests on others names a reason of its own."""
    return subject.notes.get(claim.id, "") not in ("", "P203", "P204", "P216", "P205")


def _story(subject: Subject, claim: Claim, margins: Margins, suggestion: Suggestion | None) -> Story:
    facts = tuple(fact_row(*fact) for fact in claim.facts[:SHOWN_FACTS])
    name = name_of(claim.id)
    capital = name[:1].upper() + name[1:]
    plain = Story(claim, subject.anchors[claim.id], name, f"{capital} is {claim.status}", "", "", (), facts)
    if claim.status != "refuted":
        note = DIAGNOSTICS.get(subject.notes.get(claim.id, "sampled" if claim.rule == "sampled" else "P205"))
        if note is None:
            return plain
        head = f"{capital}: {note.title}"
        found = replace(plain, headline=head, paragraphs=(f"{note.why}",), code=note.code, remedy=note.remedy)
        return _with_margin(found, margins)
    if claim.rule == "frequency-witness":
        return _frequency(subject, plain, capital, suggestion)
    if claim.rule in ("voltage-pair", "current-pair"):
        return _with_margin(_pair(plain, capital), margins)
    rule = DIAGNOSTICS[claim.rule or "P205"]
    paragraphs = [rule.why]
    if claim.kind == "equilibrium":
        told = "; ".join(f"{what}: {_minus(value)} {unit}" for what, value, unit in claim.facts[:FEW])
        paragraphs.append(f"In numbers, {told}.")
    if claim.kind == "dgu":
        paragraphs += [_NOT_NETWORK]
    heads = {
        "storage-contradiction": f"{capital} is not passive",
        "limits-exceeded": "An inverter would need more than its limits",
        "reference-outside-band": "A reference lies outside of the band of the load at its node",
    }
    return replace(
        plain,
        headline=heads.get(claim.rule or "", plain.headline),
        paragraphs=tuple(paragraphs),
        code=rule.code,
        remedy=rule.remedy,
        advice=_advice(subject, claim, suggestion),
    )


def _with_margin(story: Story, margins: Margins) -> Story:
    node = story.claim.id.partition("/")[2]
    panel = next((p for p in margins.panels if node == p.node or node in p.alike), None)
    if panel is None or story.claim.kind != "load":
        return story
    caption = "Margin of monotonicity in floats; the band of the claim is shaded. Below zero the load is active."
    return replace(story, picture=panel.picture, caption=caption)


# --- loads ------------------------------------------------------------------------------------------------------------


def _pair(plain: Story, capital: str) -> Story:
    values = {name: value for name, value, _ in plain.claim.facts}
    product = values.get("violating product, at most", values.get("violating product", Fraction(0)))
    where = ""
    if "linearisation not passive at" in values:
        where = f"At |V| = {approximate(values['linearisation not passive at'])} V the linearised load is active. "
    paragraphs = (
        f"{where}For two voltages of the band, V and U, the load currents satisfy ⟨V − U, I(V) − I(U)⟩ < 0: when the "
        "voltage rises the load draws less, and a disturbance gains power from it. A negative incremental resistance "
        "does this, such as that of constant power.",
        _NOT_NETWORK,
    )
    rule = DIAGNOSTICS[plain.claim.rule or ""]
    return replace(
        plain,
        headline=f"{capital} is not monotone in its band",
        formula="⟨V − U, I(V) − I(U)⟩",
        value=f"{_minus(product)} W",
        relation="≤" if "violating product, at most" in values else "=",
        paragraphs=paragraphs,
        code=rule.code,
        remedy=rule.remedy,
    )


# --- inverters --------------------------------------------------------------------------------------------------------


def _frequency(subject: Subject, plain: Story, capital: str, suggestion: Suggestion | None) -> Story:
    values = {name: value for name, value, _ in plain.claim.facts}
    sigma, omega, least = values["Re s0"], values["Im s0"], values["Re(u* Z(s0) u)"]
    u = [complex(float(values[f"Re u[{k}]"]), float(values[f"Im u[{k}]"])) for k in (0, 1)]
    direction = "along d" if not u[1] else "along q" if not u[0] else f"along u = ({_phasor(u[0])}, {_phasor(u[1])})"
    s0 = f"{_plain(sigma)} {'+' if omega >= 0 else '−'} j {_plain(abs(omega))}"
    doubling = math.log(2) / float(sigma) if sigma > 0 else math.inf
    paragraphs = (
        f"Feed a current {direction} into the DGU that grows as exp(s₀ t) with s₀ = {s0} 1/s: "
        f"{_hertz(abs(float(omega)))}, doubling every {_seconds(doubling)}. A passive part has to take in power from "
        "every such current, because it begins at rest with nothing stored: Re u*Z(s₀)u ≥ 0 wherever Re s₀ > 0. Here "
        f"it is {_minus(least)} Ω, computed exactly from the gains and the plant data of the spec: the DGU gives power "
        "away. So there is no storage function of any kind for it.",
        *_corner(plain.claim),
        _NOT_NETWORK,
    )
    image, caption = _response(subject, plain.claim, (float(sigma), abs(float(omega))), u, float(least), suggestion)
    rule = DIAGNOSTICS["frequency-witness"]
    return replace(
        plain,
        headline=f"{capital} is not passive",
        formula=f"Re u*Z(s₀)u at s₀ = {s0} 1/s",
        value=f"{_minus(least)} Ω",
        paragraphs=paragraphs,
        picture=image,
        caption=caption,
        advice=_advice(subject, plain.claim, suggestion),
        code=rule.code,
        remedy="a smaller tolerance, or more damping" if _corner(plain.claim) else rule.remedy,
    )


def _plain(x: Fraction) -> str:
    """Six digits of a number, all of them if it has no more."""
    text = decimal(x, 6)
    return tick_text(float(x)) if "e" in text and not text.startswith("≈") else text


def _minus(x: Fraction) -> str:
    return approximate(x).replace("-", "−")


def _phasor(z: complex) -> str:
    return f"{z.real:.4g}" if not z.imag else f"{z.real:.4g} {'+' if z.imag > 0 else '−'} j {abs(z.imag):.4g}"


def _corner(claim: Claim) -> tuple[str, ...]:
    """At which corner of a box of tolerances a counterexample is, if there is one."""
    ends = []
    for name, value, unit in claim.facts:
        what, _, end = name.partition(" at the ")
        if end.endswith(" end of its tolerance"):
            ends.append(f"{what} = {approximate(value)} {unit}, the {end.split()[0]} end")
    if not ends:
        return ()
    return (f"That is at a corner of the tolerances that the spec states: {'; '.join(ends)}. Smaller ones may hold.",)


def _hertz(omega: float) -> str:
    if not omega:
        return "no oscillation"
    return f"an oscillation of {omega / math.tau:.4g} Hz in the dq frame"


def _seconds(t: float) -> str:
    if t >= 7200:
        return f"{t / 3600:,.3g} h"
    return f"{t:.3g} s" if t >= 1 else f"{1e3 * t:.3g} ms" if t >= 1e-3 else f"{1e6 * t:.3g} µs"


def _mode(claim: Claim) -> Mode:
    kind, _, name = claim.id.partition("/")
    if kind == "mode":
        node, _, held = name.rpartition("/")
        return node, held
    return name


def _least_eigenvalues(port: LinearPort, sigma: float, omegas: Any) -> Any:
    """The smallest eigenvalue of (Z + Z*)/2 on the line Re s = sigma, in floats; NaN at a pole."""
    import numpy

    F, B, C = (numpy.array([[float(x) for x in row] for row in m]) for m in (port.F, port.B, port.C))
    found = numpy.full(len(omegas), numpy.nan)
    for k, omega in enumerate(omegas):
        try:
            Z = C @ numpy.linalg.solve(complex(sigma, omega) * numpy.eye(len(F)) - F, B)
        except numpy.linalg.LinAlgError:
            continue
        found[k] = numpy.linalg.eigvalsh((Z + Z.conj().T) / 2)[0]
    return found


def _response(
    subject: Subject,
    claim: Claim,
    point: tuple[float, float],
    u: Sequence[complex],
    least: float,
    suggestion: Suggestion | None,
) -> tuple[Markup | None, str]:
    """Least eigenvalue of the Hermitian part of Z over frequency, as it is and with the nearest passive gains."""
    import numpy

    if any(name.endswith("end of its tolerance") for name, _, _ in claim.facts):
        return None, ""  # the witness is at a corner of the box, not at the values of the spec
    mode = _mode(claim)
    try:
        port = subject.context.port(mode)
        sigma, omega = point
        middle = omega or max(float(numpy.abs(numpy.linalg.eigvals(_floats(port.F))).min()), 1.0)
        omegas = numpy.union1d(numpy.geomspace(middle / 1e3, middle * 1e3, POINTS), [middle])
        curves = [("as in the spec", "c1", _least_eigenvalues(port, sigma, omegas))]
        dgu = subject.context.nodes[mode].dgu if isinstance(mode, str) else None
        if suggestion is not None and dgu is not None and isinstance(mode, str):
            changed = replace(dgu, controller=suggestion.gains)
            other = dgu_port(changed, subject.context.capacitances["0"][mode], subject.grid.w0)
            curves.append(("nearest passive", "c0", _least_eigenvalues(other, sigma, omegas)))
    except (RuleFailure, ArithmeticError, ValueError):
        return None, ""
    size = sum(abs(x) ** 2 for x in u) or 1.0
    values = numpy.concatenate([y[numpy.isfinite(y)] for _, _, y in curves] + [[least / size, 0.0]])
    low, high = float(values.min()), float(values.max())
    linear = 10.0 ** math.floor(math.log10(max(min(abs(low), max(high, abs(low) / 1e3)) / 100, 1e-9)))
    chart = Chart(
        Axis("ω (rad/s)", float(omegas[0]), float(omegas[-1]), log=True),
        Axis("λmin of Re Z (Ω)", low * 1.6, max(high * 1.6, linear * 2), symlog=max(linear, 1e-6)),
        width=500,
        height=280,
        right=118,
        left=70,
    )
    chart.below(0.0)
    for label, class_, y in reversed(curves):
        chart.curve(list(zip(map(float, omegas), map(float, y), strict=True)), class_, label)
    chart.dot(omega or middle, least / size, "spot refuted", f"s₀: {_minus(Fraction(least / size))} Ω")
    title = "Smallest eigenvalue of the Hermitian part of Z along the line through the counterexample"
    caption = (
        f"Smallest eigenvalue of the Hermitian part of Z(s) on the line Re s = {sigma:.4g} 1/s. Curves are in floats, "
        "for the eye; the marked point is exact, per unit of |u|². A passive part stays out of the shaded half."
    )
    return chart.render(title), caption


def _floats(m: Sequence[Sequence[Fraction]]) -> Any:
    import numpy

    return numpy.array([[float(x) for x in row] for row in m])


def _advice(subject: Subject, claim: Claim, suggestion: Suggestion | None) -> Advice | None:
    if suggestion is None:
        return None
    name = claim.id.partition("/")[2]
    dgu = subject.context.nodes[name].dgu
    if dgu is None or not isinstance(dgu.controller, IdaPbc | StateFeedback):
        return None
    old = to_state_feedback(dgu.controller)
    gains = []
    for key, change in zip(NAMES, suggestion.changes, strict=False):
        before, after = getattr(old, key), getattr(suggestion.gains, key)
        if before is not None and after is not None:
            gains.append(Gain(key, _decimals(before), _decimals(after), f"{100 * change:.3g} %"))
    largest = max(suggestion.changes)
    where = NAMES[suggestion.changes.index(largest)]
    return Advice(f"{100 * largest:.3g} %", where, suggestion.fragment, tuple(gains))


def _decimals(m: Sequence[Sequence[Fraction]]) -> tuple[tuple[str, ...], ...]:
    return tuple(tuple(f"{float(x):.6g}".replace("-", "−") for x in row) for row in m)
