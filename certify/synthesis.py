"""From wishes to a certified spec: design the gains of one DGU, edit the spec, prove the whole network.

The text of a TOML spec keeps its comments and its order (tomlkit); whatever the editing has done, the new text is
parsed again and compared with what it should say, and only the kernel says that it is certified.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any

from certify.certificate import Certificate, prove
from certify.editing import edit_spec, insert, parse_toml, toml_key, toml_value
from certify.inputs import SpecSource, decode_all, to_bytes
from certify.kernel.claims import Context
from certify.kernel.errors import Fault, RuleFailure, SpecError
from certify.kernel.model import node_capacitances, to_state_feedback
from certify.kernel.quantity import NumberText, QuantityError, parse_quantity, shorten
from certify.kernel.reader import read_document
from certify.kernel.spec import IdaPbc, Microgrid, StateFeedback
from certify.provenance import settle_epoch
from certify.search.prove import Progress
from certify.search.synthesis import (
    KINDS,
    Design,
    Found,
    Plant,
    decay_bracket,
    decays_at,
    find_design,
    largest_gain,
    to_decimal,
    to_percent,
)
from certify.values import to_plain

SETTLED = 4  # time constants until a mode has decayed to 2 %: exp(-4) = 1.8 %
RAISES = (4, 16, 64, 256)  # by how much gains may grow, in steps, for a tolerance, if no bound is given
PARTS = 20  # the largest tolerance is sought in steps of such a part of the one asked for
MOST = Fraction(10) ** 9  # of a rate in 1/s, and of one over it; and of a gain, squared
Bracket = tuple[Fraction, Fraction]


@dataclass(frozen=True)
class Wish:
    """What a design should do. `rate` in 1/s; `max_gain` bounds entries of K11, K12 (ohm), K13 (V/(V s)); None: any.

    `tolerance` is the text for the spec, such as "5 %", and `tolerance_share` the same as a number.
    """

    kind: str
    rate: Fraction | None
    max_gain: Fraction | None
    tolerance: str | None
    tolerance_share: Fraction


@dataclass(frozen=True)
class Synthesis:
    """The outcome of `synthesize`.

    `met`: every wish is met and the whole network is certified with the new gains; then `spec` is the new spec and
    `certificate` its certificate. Else `limits` says what stands in the way and what is possible. Decay rates are
    brackets (proved, refuted) of the slowest mode of the DGU alone, in 1/s. `design`, `fragment` and what is said of
    the design are None if there is no design for the wishes on rate and gain. `plain` is the design without rotation,
    where one with a rotation is clearly better.
    """

    node: str
    wish: Wish
    met: bool
    limits: tuple[str, ...]
    controller: str | None = None
    fragment: str | None = None
    design: Design | None = None
    plain: Design | None = None
    rate_before: Bracket | None = None
    rate: Bracket | None = None
    rate_plain: Bracket | None = None
    gain_before: Fraction | None = None
    gain: Fraction | None = None
    gain_plain: Fraction | None = None
    spec: bytes | None = field(default=None, repr=False)
    certificate: Certificate | None = None


# --- wishes -----------------------------------------------------------------------------------------------------


def read_wish(
    settle: object = None,
    decay: object = None,
    max_gain: object = None,
    tolerance: object = None,
    kind: str = "pi",
) -> Wish:
    """The wish that some numbers or texts express. Raises: SpecError with every fault, at the name of the option."""
    faults: list[Fault] = []

    def number(raw: object, option: str, unit: str) -> Fraction | None:
        if raw is None:
            return None
        try:
            value = raw if isinstance(raw, Fraction) else parse_quantity(to_plain(raw, option), unit, {})
        except QuantityError as error:
            faults.append(Fault(error.code, option, error.message))
            return None
        except SpecError as error:
            faults.extend(error.faults)
            return None
        if value <= 0:
            faults.append(Fault("S208", option, f"must be positive, got {shorten(str(raw))}"))
            return None
        return value

    def bounded(value: Fraction | None, option: str, low: Fraction, high: Fraction, said: str) -> None:
        if value is not None and not low <= value <= high:
            faults.append(Fault("S202", option, f"absurd: {said}"))

    time = number(settle, "--settle", "s")
    rate = number(_without_rate_unit(decay), "--decay", "")
    gain = number(max_gain, "--max-gain", "")
    share = number(tolerance, "--tolerance", "")
    bounded(time, "--settle", SETTLED / MOST, SETTLED * MOST, "from 4e-9 s to 4e9 s make sense")
    bounded(rate, "--decay", 1 / MOST, MOST, "from 1e-9 to 1e9 per second make sense")
    bounded(gain, "--max-gain", 1 / MOST, MOST**2, "from 1e-9 to 1e18 make sense")
    bounded(share, "--tolerance", 1 / MOST, Fraction(99, 100), "from 1e-7 % to 99 % make sense")
    if settle is not None and decay is not None:
        faults.append(Fault("U001", "--decay", "--settle and --decay say the same thing; give one of them"))
    if settle is None and decay is None and max_gain is None:
        faults.append(Fault("U001", "--settle", "nothing is wished for: give --settle, --decay or --max-gain"))
    if kind not in KINDS:
        faults.append(Fault("U001", "--kind", f"{shorten(kind)} is none of: {', '.join(KINDS)}"))
    if faults:
        raise SpecError(tuple(faults))
    text = None if share is None else to_percent(share)
    return Wish(kind, SETTLED / time if time else rate, gain, text, share or Fraction(0))


def _without_rate_unit(raw: object) -> object:
    """ "80 1/s" and "80/s" as "80": a rate has no other unit."""
    if isinstance(raw, str):
        match = re.fullmatch(r"(.*?\S)(?:\s+1/s|\s*/\s*s)\s*", raw, re.DOTALL)
        return match[1] if match else raw
    return raw


# --- the spec as text ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Edit:
    """The new controller as TOML, the node that gets it, and a tolerance for its filter, or a copy of that if named."""

    node: str
    controller: str
    fragment: str
    filter: str
    copied: str | None = None
    tolerance: str | None = None


def controller_fragment(name: str, design: Design, kind: str) -> str:
    """The TOML of a controller: gains as formulas of the plant data, so that they are exactly passive (THEORY 4)."""
    x, b, h, g = (to_decimal(v) for v in (design.x, design.b, design.h, design.g))
    head = f"[controller.{toml_key(name)}]\n"
    if kind == "ida-pbc":
        return f'{head}kind = "ida-pbc"\nalpha = {to_decimal(-design.h * design.b)}\nnu = {b}\nki = {x}\n'
    if not design.g:
        return (
            f'{head}kind = "state-feedback"\n'
            f"let = {{ x = {x}, b = {b}, h = {h} }}\n"
            'K11 = "1 - b - L*x"\n'
            'K12 = [["R - h", "-w0*L"], ["w0*L", "R - h"]]\n'
            'K13 = "h*x"\n'
        )
    return (
        f'{head}kind = "state-feedback"\n'
        f"let = {{ x = {x}, b = {b}, h = {h}, g = {g} }}\n"
        'K11 = "1 - b - L*x"\n'
        'K12 = [["R - h", "-(w0*L + g)"], ["w0*L + g", "R - h"]]\n'
        'K13 = [["h*x", "g*x"], ["-g*x", "h*x"]]\n'
    )


def with_tolerance(document: Any, filter_name: str, text: str) -> Any:
    """The document, in which R, L and C of one filter are known to within `text` ("5 %") only; more stays more."""
    filter_, common = document["filter"][filter_name], document.get("tolerance", "0 %")
    before = filter_.get("tolerance", common.get("filter", "0 %") if isinstance(common, dict) else common)
    shares = before if isinstance(before, dict) else dict.fromkeys("RLC", before)
    wider = {key: max(shares.get(key, "0 %"), text, key=_share) for key in "RLC"}
    if len(set(map(str, wider.values()))) == 1:
        filter_["tolerance"] = wider["R"]
    elif type(document) is dict:
        filter_["tolerance"] = wider
    else:
        from tomlkit import inline_table

        filter_["tolerance"] = inline_table()
        filter_["tolerance"].update(wider)
    return document


def _share(raw: Any) -> Fraction:
    return parse_quantity(NumberText(raw) if isinstance(raw, float) else raw, "", {})


def edited(spec: bytes, edit: Edit) -> bytes:
    """The text of a spec with the new controller in place; comments and order stay.

    Raises: SpecError U001 if the file is laid out such that the editor cannot do it.
    """

    def apply(document: Any) -> Any:
        plain = type(document) is dict  # else a document of tomlkit, and the fragment is one too
        return _apply(document, read_document(edit.fragment.encode()) if plain else parse_toml(edit.fragment), edit)

    return edit_spec(spec, apply)


def _apply(document: Any, fragment: Any, edit: Edit) -> Any:
    """The edit on a document of any of the parsers used here."""
    insert(document["controller"], edit.controller, fragment["controller"][edit.controller])
    if edit.copied:
        insert(document["filter"], edit.copied, copy.deepcopy(document["filter"][edit.filter]))
        document["node"][edit.node]["dgu"]["filter"] = edit.copied
    document["node"][edit.node]["dgu"]["controller"] = edit.controller
    if edit.tolerance:
        document = with_tolerance(document, edit.copied or edit.filter, edit.tolerance)
    return document


def _free_name(wanted: str, taken: Any) -> str:
    """A name that is not taken yet, of letters that need no quotes."""
    stem = re.sub(r"[^A-Za-z0-9_-]", "-", wanted)[:48].rstrip("-")
    names = (stem if k == 1 else f"{stem}-{k}" for k in range(1, len(taken) + 3))
    return next(name for name in names if name not in taken)


# --- synthesis ----------------------------------------------------------------------------------------------------


def synthesize(
    spec: SpecSource,
    node: str | int,
    *,
    settle: object = None,
    decay: object = None,
    max_gain: object = None,
    tolerance: object = None,
    kind: str = "pi",
    progress: Progress | None = None,
) -> Synthesis:
    """Gains for the DGU at `node` that meet the wishes, and a proof of the whole network with them.

    `settle` is the time in seconds in which every closed-loop mode of that DGU alone - with the capacitance of its
    node, without load - falls to 2 %: a decay rate of 4/settle. `decay` is that rate itself, in 1/s. `max_gain`
    bounds the absolute value of every entry of K11 (no unit), K12 (ohm) and K13 (V/(V s)). `tolerance` asks that the
    network be certified with such an error of the filter's R, L and C. Each may be a number or text with a unit.
    Without `settle` and `decay` the result is the fastest design within `max_gain`; otherwise the one with the
    smallest largest entry - and where all gains can be below one, the fastest of those.

    For `spec` see `certify.inputs.to_bytes`.
    Raises: SpecError for a bad spec, node or wish; Rejected if the kernel turns a proof down (a defect).

    >>> import certify
    >>> certify.synthesize("specs/single-inverter.toml", "bus", settle=0.02, kind="ida-pbc").met
    True
    """
    settle_epoch()
    given, node = to_bytes(spec), str(node)
    grid = decode_all(given)
    wish = read_wish(settle, decay, max_gain, tolerance, kind)
    context = Context(grid)
    plant = _plant(context, node)
    found = find_design(plant, wish.kind, wish.rate, wish.max_gain)
    before = _before(context, node)
    result = Synthesis(node, wish, False, (), rate_before=before[0], gain_before=before[1])
    if found.design is None:
        return replace(result, limits=_limits(found, plant, wish))
    document = read_document(given)
    for design, plain in _candidates(found, plant, wish):
        edit = _edit(document, grid, node, design, wish)
        text = edited(given, edit)
        certificate = prove(text, progress)
        result = replace(
            result,
            met=certificate.verdict.outcome == "certified",
            controller=edit.controller,
            fragment=_shown(edit, read_document(text)),
            design=design,
            plain=plain,
            rate=decay_bracket(design.port(plant).F),
            gain=design.largest_gain(plant),
            rate_plain=decay_bracket(plain.port(plant).F) if plain else None,
            gain_plain=plain.largest_gain(plant) if plain else None,
            spec=text,
            certificate=certificate,
        )
        if result.met:
            return result
    return replace(result, limits=tuple(_why_not_certified(given, edit, wish, certificate, progress)))


def _plant(context: Context, node: str) -> Plant:
    """Raises: SpecError if there is no DGU with a filter at the node."""

    def refuse(message: str) -> SpecError:
        return SpecError((Fault("U001", "--node", message),))

    if node not in context.nodes:
        names = list(context.nodes)
        listed = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
        raise refuse(f"there is no node {shorten(node)}; nodes: {listed}")
    dgu = context.nodes[node].dgu
    if dgu is None:
        raise refuse(f"there is no DGU at node {node}; nodes with one: {_with_dgu(context)}")
    if dgu.filter is None:
        raise refuse(f"the DGU at node {node} has no filter, so there is no plant to design gains for")
    capacitance = node_capacitances(context.grid)[node]
    return Plant(dgu.filter.resistance_ohm, dgu.filter.inductance_henry, capacitance, context.grid.w0)


def _with_dgu(context: Context) -> str:
    names = [name for name, node in context.nodes.items() if node.dgu and node.dgu.filter]
    return ", ".join(names[:12]) + (", ..." if len(names) > 12 else "") if names else "none"


def _before(context: Context, node: str) -> tuple[Bracket | None, Fraction | None]:
    """Decay rate and largest gain of the controller that the spec has now."""
    try:
        rate = decay_bracket(context.port(node).F)
    except RuleFailure:
        rate = None
    dgu = context.nodes[node].dgu
    law = dgu.controller if dgu else None
    law = to_state_feedback(law) if isinstance(law, IdaPbc) else law
    return rate, largest_gain(law) if isinstance(law, StateFeedback) else None


def _candidates(found: Found, plant: Plant, wish: Wish) -> Iterator[tuple[Design, Design | None]]:
    """The design, and if a tolerance is asked for, faster ones with larger gains: their damping makes up for more."""
    if found.design is None:
        return
    yield found.design, found.plain
    if wish.tolerance is None:
        return
    least = max(found.design.largest_gain(plant), Fraction(1))
    caps = [least * factor for factor in RAISES]
    if wish.max_gain is not None:
        caps = [cap for cap in caps if cap < wish.max_gain] + [wish.max_gain]
    for cap in caps:
        faster = find_design(plant, wish.kind, None, Fraction(f"{float(cap):.1e}") if cap != wish.max_gain else cap)
        if faster.design is not None and (wish.rate is None or decays_at(faster.design.port(plant).F, wish.rate)):
            yield faster.design, faster.plain


def _edit(document: Any, grid: Microgrid, node: str, design: Design, wish: Wish) -> Edit:
    """What to change in the spec. A filter with a tolerance must be this node's own."""
    controller = _free_name(f"synth-{node}", document["controller"])
    filter_ = document["node"][node]["dgu"]["filter"]
    others = (n.name for n in grid.nodes if n.name != node and n.dgu and n.dgu.filter)
    shared = any(document["node"][other]["dgu"].get("filter") == filter_ for other in others)
    copied = _free_name(f"{filter_}-{node}", document["filter"]) if shared and wish.tolerance else None
    fragment = controller_fragment(controller, design, wish.kind)
    return Edit(node, controller, fragment, filter_, copied, wish.tolerance)


def _shown(edit: Edit, document: Any) -> str:
    """The fragment with what else has to change, for those who put it in by hand. `document` is the edited one."""
    text = edit.fragment
    changes = f'controller = "{edit.controller}"'
    if edit.copied:
        changes += f', filter = "{edit.copied}"'
        values = document["filter"][edit.copied].items()
        rows = [f"{toml_key(key)} = {toml_value(value)}" for key, value in values]
        text += f"\n[filter.{toml_key(edit.copied)}]\n" + "\n".join(rows) + "\n"
    text += f"# and in the dgu of node {edit.node}: {changes}\n"
    if edit.tolerance and not edit.copied:
        tolerance = toml_value(document["filter"][edit.filter]["tolerance"])
        text += f"# and in filter {edit.filter}, in place of a tolerance that it may have: tolerance = {tolerance}\n"
    return text


def _limits(found: Found, plant: Plant, wish: Wish) -> tuple[str, ...]:
    """Why there is no design for the wishes on rate and gain, and what there is. Bests are those of the search."""
    told = []
    if found.fastest is not None:
        rate = decay_bracket(found.fastest.port(plant).F)[0]
        told.append(
            f"within --max-gain {_said(wish.max_gain)} the fastest design found decays at {_said(rate)} 1/s "
            f"(proved), that is --settle {float(SETTLED / rate):.4g}s"
        )
    elif wish.max_gain is not None:
        told.append(f"no passive and stable design was found with gains up to {_said(wish.max_gain)}")
    if found.smallest is not None and wish.rate is not None:
        gain = found.smallest.largest_gain(plant)
        told.append(
            f"a decay rate of {_said(wish.rate)} 1/s takes --max-gain {_rounded_up(gain)} at least, as far as found"
        )
    return tuple(told) or ("the numbers of this plant or wish are out of the range of the search",)


def _said(x: Fraction | None) -> str:
    return f"{float(x or 0):.6g}"


def _rounded_up(x: Fraction) -> str:
    """Four significant digits, not below x."""
    text = f"{float(x):.3e}"
    if Fraction(text) < x:
        text = f"{float(Fraction(text) + Fraction(10) ** (int(text.split('e')[1]) - 3)):.3e}"
    return f"{float(text):g}"


def _why_not_certified(
    spec: bytes, edit: Edit, wish: Wish, certificate: Certificate, progress: Progress | None
) -> Iterator[str]:
    """What of the network is open with the last design; and with a tolerance, the largest that can be certified."""
    open_ids = [claim.id for claim in certificate.verdict.claims if claim.status != "proved"]
    listed = ", ".join(open_ids[:6]) + (", ..." if len(open_ids) > 6 else "")
    if edit.tolerance is None:
        yield f"the DGU has gains that meet the wishes, but the network is not certified with them; open: {listed}"
        return
    yield f"the network is not certified with a tolerance of {edit.tolerance}; open: {listed}"

    def certified(part: int) -> bool:
        share = wish.tolerance_share * part / PARTS
        trial = replace(edit, tolerance=to_percent(share) if part else None)
        return prove(edited(spec, trial), progress).verdict.outcome == "certified"

    low, high = 0, PARTS
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if certified(middle) else (low, middle)
    step = to_percent(wish.tolerance_share / PARTS)
    if low:
        most = to_decimal(100 * wish.tolerance_share * low / PARTS)
        yield f"the largest tolerance that could be certified is {most} % (in steps of {step}), with the gains above"
    elif certified(0):
        yield f"even {step} cannot be certified; without a tolerance the network is certified with these gains"
    else:
        yield "without any tolerance the network is not certified either"
