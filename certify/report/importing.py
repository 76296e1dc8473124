"""What an import made of a network, told: what is in the spec, what is not and why, and what to do next."""

from __future__ import annotations

import argparse
import json
import re
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from certify.kernel.errors import Fault, SpecError


def _pandapower(path: str, placement: Any, _settings: Any) -> Any:
    from certify.importing.pandapower import from_net
    from certify.importing.pandapower.file import file_name, load_net

    return from_net(load_net(path), f"{file_name(path)}, a file of pandapower", placement)


def _simbench(code: str, placement: Any, _settings: Any) -> Any:
    from certify.importing.pandapower.simbench import from_code

    return from_code(code, placement)


def _opendss(path: str, placement: Any, settings: Any) -> Any:
    from certify.importing.opendss import read_network

    return read_network(Path(path), settings, placement)


@dataclass(frozen=True)
class Format:
    """`read(file, placement, settings)` gives a Network; heavy imports are inside."""

    what: str
    read: Callable[[str, Any, Any], Any]


FORMATS = {
    "pandapower": Format("a JSON file of pandapower", _pandapower),
    "simbench": Format("the code of a SimBench grid, or a file of one", _simbench),
    "opendss": Format("the master script of a circuit of OpenDSS", _opendss),
}


def run(options: argparse.Namespace) -> int:
    """Read, convert, write, report. Raises: SpecError; nothing is written then."""
    from certify.importing.draft import to_spec
    from certify.importing.request import to_settings

    options.spec = options.file  # faults are told under the name of what is read
    _check_target(options)
    settings, placement = to_settings(options)
    draft = to_spec(FORMATS[options.format].read(options.file, placement, settings), settings)
    if options.output is not None:
        from certify.certificate import write_atomically

        try:
            write_atomically(Path(options.output), draft.spec)
        except OSError as error:
            raise SpecError((Fault("U001", "-o", f"cannot write {options.output}: {error.strerror}"),)) from None
    if options.json:
        print(json.dumps(to_dict(draft, options), indent=1, ensure_ascii=False))
    else:
        print("\n".join(render(draft, options)))
    return 0


def _check_target(options: argparse.Namespace) -> None:
    if options.output is None:
        return
    target, reason = Path(options.output), ""
    if target.is_dir() or not target.parent.is_dir():
        reason = "there is no such folder, or it is a folder itself"
    for option, path in (("the network", options.file), ("the spec of --filter-from", options.filter_from)):
        if path is not None and target.exists() and Path(path).exists() and target.samefile(path):
            reason = f"it is {option} itself"
    if reason:
        raise SpecError((Fault("U001", "-o", f"cannot write {options.output}: {reason}"),))


def to_dict(draft: Any, options: argparse.Namespace) -> dict[str, Any]:
    """As JSON: every element that was left out, one by one."""
    from certify.importing.referring import describe

    return {
        "source": options.file,
        "format": options.format,
        "spec": options.output,
        "counts": draft.counts,
        "mapped": list(draft.mapped),
        "left_out": [{"element": u.element, "reason": u.reason} for u in draft.unmapped],
        "notes": [{"element": n.element, "text": n.text} for n in draft.notes],
        "referred": describe(draft.levels),
        "constant_power_rows": draft.constant_power,
        "exit_code": 0,
    }


def tables(elements: Iterable[str]) -> str:
    """How many elements of each table or class: "2 trafo, 18 load".

    >>> tables(["load 1", "load 2 (a)", "trafo 0"]), tables(["line.a", "line.b"])
    ('2 load, 1 trafo', '2 line')
    """
    counts = Counter(re.split("[ .]", element, maxsplit=1)[0] for element in elements)
    return ", ".join(f"{count} {table}" for table, count in counts.items())


def render(draft: Any, options: argparse.Namespace) -> list[str]:
    """As text for a terminal."""
    from certify.importing.referring import describe
    from certify.importing.text import grouped, listed

    counts = ", ".join(f"{kind}: {count}" for kind, count in draft.counts.items())
    lines = [f"IMPORTED: {options.file}", "", f"  {counts}", f"  mapped: {tables(draft.mapped)}"]
    lines += [f"  referred: {line}" for line in describe(draft.levels)]
    for head, pairs in (
        ("left out", [(u.element, u.reason) for u in draft.unmapped]),
        ("note", [(n.element, n.text) for n in draft.notes]),
    ):
        for text, elements in grouped(pairs).items():
            which = listed([element for element in elements if element])
            lines.append(f"  {head}: {which}: {text}" if which else f"  {head}: {text}")
    lines.append("")
    if draft.constant_power:
        lines += [
            f"{draft.constant_power} of {draft.counts['load rows']} load rows have a part of constant power, which is "
            "not monotone by itself: their claims",
            "may be refuted. `certify loads SPEC` tells from which voltage on each bus passes.",
        ]
    if not options.filter_from:
        lines.append("Filters and controllers are placeholders: --filter-from SPEC takes your own.")
    if options.output is None:
        lines.append("nothing written: -o SPEC writes it")
    else:
        lines.append(f"written: {options.output}; next: certify prove {options.output}")
    return lines
