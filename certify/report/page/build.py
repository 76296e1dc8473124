"""From a spec and its certificate to the files of a report."""

from __future__ import annotations

import base64
import hashlib
import shlex
from collections.abc import Sequence
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from markupsafe import Markup, escape

from certify import __version__
from certify.diagnostics import DIAGNOSTICS
from certify.kernel.claims import BESIDE, Verdict
from certify.report.page.diagram import SHAPES, draw_network, mark
from certify.report.page.entries import list_kinds
from certify.report.page.margins import draw_margins
from certify.report.page.markdown import write_markdown
from certify.report.page.region import draw_regions
from certify.report.page.rest import draw_rests
from certify.report.page.subject import Subject
from certify.report.page.witness import tell_failures
from certify.report.page.words import (
    PARTS,
    STATUSES,
    caveat,
    headline,
    meaning,
    not_proved_in_words,
    proved_in_words,
)

if TYPE_CHECKING:  # the simulator is only loaded for a simulation
    from certify.report.page.motion import Motion

PAGE, SUMMARY, CERTIFICATE = "index.html", "report.md", "certificate.json"
MAX_LEDGER = 200
SHOWN_PROVENANCE = 300  # characters of an entry


def build_report(subject: Subject, motion: Motion | None = None) -> dict[str, bytes]:
    """The page and the summary, by the names of their files; the same arguments give the same bytes.

    Nearest passive gains are sought for inverters that are not passive.
    """
    advice = {}
    if any(c.kind == "dgu" and c.status == "refuted" for c in subject.verdict.claims):
        from certify.report.nearest import suggest

        advice = suggest(subject.grid, subject.verdict)
    margins = draw_margins(subject)
    stories = tell_failures(subject, margins, advice)
    rests, rests_left_out = draw_rests(subject)
    regions, regions_left_out = draw_regions(subject)
    verdict = subject.verdict
    sections = [("failures", "What is not proved")] if stories.told else []
    sections += [("network", "Network"), ("rest", "Equilibrium"), ("region", "Region")]
    sections += [("loads", "Load margins")] if margins.panels else []
    sections += [("motion", "Simulation")] if motion else []
    sections += [("claims", "Claims"), ("ledger", "Assumptions"), ("provenance", "Provenance")]
    ledger = [(name, text, *meaning(name)) for name, text in verdict.assumptions]
    page = _render(
        title=subject.title,
        verdict=verdict,
        stamp=STAMPS[verdict.outcome],
        headline=headline(verdict),
        caveat=caveat(verdict),
        proved=proved_in_words(subject),
        not_proved=not_proved_in_words(subject),
        tiles=_tiles(subject, motion),
        sections=sections,
        stories=stories,
        diagram=draw_network(subject),
        has_branches=any(node.branches for node in subject.grid.nodes),
        rests=rests,
        rests_left_out=rests_left_out,
        rest_why=_rest_why(subject),
        regions=regions,
        regions_left_out=regions_left_out,
        margins=margins,
        motion=motion,
        kinds=list_kinds(subject),
        totals=status_counts(verdict),
        anchors=subject.anchors,
        ledger=ledger[:MAX_LEDGER],
        ledger_left_out=max(0, len(ledger) - MAX_LEDGER),
        provenance=provenance(subject),
        commands=commands(subject),
    )
    return {PAGE: page.encode(), SUMMARY: write_markdown(subject, stories, motion).encode()}


STAMPS = {"certified": "proved", "refuted": "refuted", "conditional": "conditional", "unknown": "unknown"}


def _render(**values: Any) -> str:
    """The page. Everything is escaped but pictures, which are made of escaped parts, and the own style and script."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    folder = files("certify.report.page") / "templates"
    style, script = ((folder / name).read_text(encoding="utf-8") for name in ("style.css", "script.js"))
    environment = Environment(
        loader=PackageLoader("certify.report.page", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["coded"] = coded
    return environment.get_template("page.html").render(
        style=Markup(style),
        script=Markup(script),
        style_hash=_source(style),
        script_hash=_source(script),
        version=__version__,
        mark=mark,
        shapes=SHAPES,
        **values,
    )


def coded(text: str) -> Markup:
    """A text with its `code` set as such, everything else escaped.

    >>> coded("`certify explain` & <b>")
    Markup('<code>certify explain</code> &amp; &lt;b&gt;')
    """
    parts = text.split("`")
    if len(parts) % 2 == 0:
        return escape(text)
    return Markup("").join(Markup("<code>{}</code>").format(x) if k % 2 else escape(x) for k, x in enumerate(parts))


def _source(text: str) -> str:
    """What the policy of the page allows by its content, and nothing else."""
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"


def status_counts(verdict: Verdict) -> list[tuple[str, int]]:
    return [(s, n) for s in STATUSES if (n := sum(c.status == s for c in verdict.claims))]


def _rest_why(subject: Subject) -> str:
    for claim in subject.verdict.claims:
        if claim.kind == "equilibrium" and claim.status != "proved":
            code = claim.rule or subject.notes.get(claim.id, "")
            return DIAGNOSTICS[code].why if code in DIAGNOSTICS else ""
    return ""


def _tiles(subject: Subject, motion: Motion | None) -> list[tuple[str, str]]:
    """The few numbers that say most."""
    claims = [c for c in subject.verdict.claims if c.kind not in BESIDE]
    parts = [c for c in claims if c.kind in PARTS]
    good = sum(c.status == "proved" for c in parts)
    tiles = [(f"{good:,} of {len(parts):,}", "parts proved (DGUs, loads, lines)")]
    grid = subject.grid
    islands = len(subject.context.islands)
    inside = f", {islands:,} islands" if islands > 1 else ""
    tiles.append((f"{len(grid.nodes):,} / {len(grid.lines):,}", f"nodes / lines{inside}"))
    sizes = [abs(V) for rest in subject.rests.values() for V in rest.voltages.values()]
    if sizes:
        low, high = _kilo(min(sizes), "V"), _kilo(max(sizes), "V")
        tiles.append((low if low == high else f"{low.split(' ')[0]} – {high}", "|V| at the proved equilibrium"))
    amps = [(abs(x), name) for rest in subject.rests.values() for name, x in rest.lines.items()]
    if amps:
        most = max(amps)
        tiles.append((_kilo(most[0], "A"), f"largest line current (line {most[1]})"))
    regions = list(subject.regions.values())
    if regions:
        levels = [r.level for r in regions if r.level is not None]
        told = f"{min(levels):.4g} J" if levels else "everywhere"
        tiles.append((told, "proved region of attraction" + (", the smallest" if len(regions) > 1 else "")))
    if motion and motion.phases:
        count = sum(a.count for phase in motion.phases for a in phase.agreements)
        bad = len(motion.contradictions)
        tiles.append((f"{count - bad:,} of {count:,}", "comparisons with the simulator agree (floats)"))
    return tiles


def _kilo(x: float, unit: str) -> str:
    return f"{x / 1e3:.4g} k{unit}" if x >= 1e3 else f"{x:.4g} {unit}"


def provenance(subject: Subject) -> list[tuple[str, str]]:
    """Names, hashes and versions. What the certificate says of its own making is not checked by anyone."""
    own = subject.document["provenance"]
    stated = own if isinstance(own, dict) else {}
    found = [
        ("spec", subject.spec_name),
        ("sha256 of the spec", subject.spec_sha256),
        ("certificate", subject.certificate_name or f"{CERTIFICATE}, proved for this report and beside it"),
        ("sha256 of the certificate", subject.certificate_sha256),
        ("format of the certificate", str(subject.document["format"])),
    ]
    for key, text in (("created", "created"), ("certify", "certify"), ("python", "Python")):
        if isinstance(stated.get(key), str):
            found.append((f"{text}, as the certificate says", stated[key][:SHOWN_PROVENANCE]))
    return [*found, ("checked and reported by", f"certify {__version__}")]


def commands(subject: Subject) -> str:
    """How to check all of it again."""
    spec, certificate = (shlex.quote(_line(n)) for n in (subject.spec_name, subject.certificate_name or CERTIFICATE))
    return f"python -m certify.kernel {spec} {certificate}\ncertify prove {spec} -o again.json"


def _line(name: str) -> str:
    """The name of a file on one line."""
    return "".join(c if c.isprintable() else "?" for c in name)


def names_of_files(proved_here: bool) -> Sequence[str]:
    return (PAGE, SUMMARY, *((CERTIFICATE,) if proved_here else ()))
