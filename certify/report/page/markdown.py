"""The report as a Markdown summary that reads well in a pull request."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import TYPE_CHECKING

from certify.report.page.subject import Subject
from certify.report.page.witness import Stories
from certify.report.page.words import (
    KINDS,
    STATUSES,
    caveat,
    headline,
    listed,
    not_proved_in_words,
    proved_in_words,
    short,
)

if TYPE_CHECKING:
    from certify.report.page.motion import Motion

SIGNS = {"certified": "✅", "proved": "✅", "refuted": "❌", "unknown": "❔", "conditional": "⚠️"}
SHOWN_OPEN = 40
SHOWN_NODES = 30


def plain(text: str) -> str:
    r"""A text as Markdown shows it, whatever it holds: on one line, without markup, links or mentions.

    >>> print(plain("<b> a|b [x](y) `z` *w* @me\nnext"))
    &lt;b&gt; a\|b \[x\](y) \`z\` \*w\* &#64;me next
    """
    line = re.sub(r"\s+", " ", text).replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    line = re.sub(r"([\\`*_\[\]|~])", r"\\\1", line)
    return line.replace("@", "&#64;").replace("://", ":&#47;&#47;")


def _code(text: str) -> str:
    """A name as code; ticks and bars cannot stand in it."""
    return "`" + " ".join(text.split()).replace("`", "'").replace("|", "¦") + "`"


def _told(text: str) -> str:
    """A text of this program, whose `code` stays code."""
    parts = text.split("`")
    return "".join(_code(x) if k % 2 else plain(x) for k, x in enumerate(parts)) if len(parts) % 2 else plain(text)


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> list[str]:
    return [f"| {' | '.join(head)} |", f"|{' --- |' * len(head)}", *(f"| {' | '.join(row)} |" for row in rows)]


def write_markdown(subject: Subject, stories: Stories, motion: Motion | None) -> str:
    verdict = subject.verdict
    lines = [f"# {SIGNS[verdict.outcome]} {verdict.outcome.upper()}: {plain(subject.title)}", ""]
    lines += [f"**{plain(headline(verdict))}** {plain(caveat(verdict))}", ""]
    lines += ["Proved:", "", *(f"- {plain(text)}" for text in proved_in_words(subject)), ""]
    lines += ["Not proved:", "", *(f"- {plain(text)}" for text in not_proved_in_words(subject)), ""]
    if stories.told:
        lines += ["## What is not proved, and why", ""]
        for story in stories.told:
            rule = (
                f", {_code(story.claim.rule)}" if story.claim.rule else f", {_code(story.code)}" if story.code else ""
            )
            lines += [f"### {plain(story.headline)} ({_code(story.claim.id)}: {story.claim.status}{rule})", ""]
            if story.formula:
                lines += [f"> {plain(story.formula)} {story.relation} **{plain(f'{story.value} < 0')}**", ""]
            for text in story.paragraphs:
                lines += [_told(text), ""]
            if story.advice:
                told = (
                    f"Nearest passive gains (largest relative change {story.advice.largest}, in {story.advice.where}):"
                )
                lines += [told, "", "```toml", *story.advice.fragment.splitlines(), "```", ""]
            elif story.remedy:
                lines += [f"What to try: {_told(story.remedy)}.", ""]
        if stories.more:
            lines += [f"And {stories.more:,} more.", ""]
        if stories.following:
            lines += [f"Not decided because of the above: {listed([_code(c) for c in stories.following], 8)}.", ""]
    lines += ["## Claims", "", *_claims(subject), ""]
    lines += _rest(subject)
    lines += _motion(motion)
    lines += ["## Assumed, and not proved", ""]
    lines += [f"- {_code(name)}: {plain(text)}." for name, text in verdict.assumptions[:SHOWN_OPEN]]
    if len(verdict.assumptions) > SHOWN_OPEN:
        lines.append(f"- and {len(verdict.assumptions) - SHOWN_OPEN:,} more")
    lines += ["", "## Where this comes from", "", *_provenance(subject)]
    return "\n".join(lines) + "\n"


def _claims(subject: Subject) -> list[str]:
    rows = []
    claims = subject.verdict.claims
    for kind in [*(k for k in KINDS), *dict.fromkeys(c.kind for c in claims if c.kind not in KINDS)]:
        own = [c for c in claims if c.kind == kind]
        if own:
            counts = ", ".join(f"{SIGNS[s]} {n:,} {s}" for s in STATUSES if (n := sum(c.status == s for c in own)))
            rules = listed([_code(r) for r in dict.fromkeys(c.rule for c in own if c.rule)])
            rows.append((KINDS.get(kind, (kind,))[0], counts, rules or "–"))
    lines = _table(("claims", "status", "by rule"), rows)
    open_claims = [c for c in claims if c.status != "proved"]
    if open_claims:
        told = [(f"{SIGNS[c.status]} {c.status}", _code(c.id), plain(c.statement)) for c in open_claims[:SHOWN_OPEN]]
        lines += ["", *_table(("status", "claim", "it says"), told)]
        if len(open_claims) > SHOWN_OPEN:
            lines += ["", f"And {len(open_claims) - SHOWN_OPEN:,} more claims that are not proved."]
    return lines


def _rest(subject: Subject) -> list[str]:
    lines: list[str] = []
    for name, rest in list(subject.rests.items())[:4]:
        region = subject.regions.get(name)
        where = f" of the island of node {plain(name)}" if len(subject.context.islands) > 1 else ""
        near = "exactly" if rest.radius <= 1e-40 else f"to {short(rest.radius)} V"
        lines += [f"## Equilibrium{where}", "", f"Proved {near}.", ""]
        if region is not None and region.level is not None:
            text = f"Motion from H ≤ {region.level:.6g} J returns; {plain(region.limit)} sets this level."
            lines += [text, ""]
        elif region is not None:
            lines += ["All motion returns to it, from everywhere.", ""]
        rows = []
        for node, V in list(rest.voltages.items())[:SHOWN_NODES]:
            off = f"{region.nodes[node]:,.4g} V" if region and node in region.nodes else "–"
            rows.append((plain(node), f"{abs(V):,.2f} V", f"{_degrees(V):.3f}°", off))
        lines += ["<details><summary>Node voltages</summary>", ""]
        lines += [*_table(("node", "modulus", "angle", "may be off by, alone"), rows), ""]
        if len(rest.voltages) > SHOWN_NODES:
            lines += [f"And {len(rest.voltages) - SHOWN_NODES:,} more nodes.", ""]
        lines += ["</details>", ""]
    return lines


def _degrees(V: complex) -> float:
    import cmath
    import math

    return math.degrees(cmath.phase(V))


def _motion(motion: Motion | None) -> list[str]:
    if motion is None:
        return []
    lines = ["## Simulated cross-check", "", "*Evidence in floats, no proof.*", ""]
    if motion.left_out:
        return [*lines, plain(motion.left_out), ""]
    lines += [f"Start: {plain(motion.start)}", ""]
    if motion.contradictions:
        lines += ["**The simulation contradicts the certificate:**", ""]
        lines += [*(f"- {plain(text)}" for text in motion.contradictions[:8]), ""]
    for phase in motion.phases:
        if phase.title:
            lines += [f"{plain(phase.title)}: {phase.outcome}", ""]
        rows = [
            (plain(a.title), str(a.count), a.value, a.limit, "agrees" if a.agrees else "**contradicts**")
            for a in phase.agreements
        ]
        lines += [*_table(("compared", "of", "largest difference", "limit", "result"), rows), ""]
        lines += [*(plain(text) for text in phase.remarks), ""] if phase.remarks else []
    return lines


def _provenance(subject: Subject) -> list[str]:
    from certify.report.page.build import commands, provenance

    rows = [(name, _code(text)) for name, text in provenance(subject)]
    return [*_table(("", ""), rows), "", "Check it again:", "", "```sh", *commands(subject).splitlines(), "```"]
