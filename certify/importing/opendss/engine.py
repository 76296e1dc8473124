"""The OpenDSS engine on one script, in a process of its own: `python -m certify.importing.opendss.engine FILE`.

The whole language, with its defaults, units, line codes and geometries, is understood by the engine that
DSS-Extensions publish (`dss-python`). What it holds after the script goes to the standard output as JSON: the
elements with all their properties and their primitive admittance matrices. Nothing is solved and nothing is written.
A process of its own begins with a fresh engine, and ends with it if a script brings it down.
"""

from __future__ import annotations

import contextlib
import json
import re
import sys
from functools import lru_cache
from pathlib import Path
from typing import Any

from certify.importing.opendss.commands import (
    LEFT_OUT,
    OPTIONS_REFUSED,
    OPTIONS_RUN,
    READ,
    RUN,
    Parameter,
    files_named,
    find_danger,
    resolve,
)
from certify.importing.opendss.script import MAX_FILE_BYTES, ScriptLine, find_file, read_lines
from certify.kernel.errors import Fault, SpecError

MAX_DEPTH = 20  # of scripts that call for others
MAX_LINES = 500_000
MAX_FAULTS = 50
VARIABLE = re.compile(r"(?:^|[\s,=|\[({\"'])@")
PLAIN = re.compile(r"[\w.+*/^% -]*", re.ASCII)
NO_NUMBER = re.compile(r"(?<=\n)\s*[-+]?(?:nan|inf)(?=,?\s*\n)", re.IGNORECASE)  # alone in its line, so in no text
FULL, NO_TIME, NO_BUSES = 1, 512, 1024  # what the engine's JSON holds


def new_engine() -> Any:
    """An engine that knows of no other."""
    from dss import dss

    return dss.NewContext()


class Session:
    """One script and what it calls for, given to an engine line by line. `faults` has what is wrong with them."""

    def __init__(self) -> None:
        self.engine = new_engine()
        self.engine.AllowForms = self.engine.AllowEditor = self.engine.AllowChangeDir = False
        with contextlib.suppress(Exception):  # on systems where the engine could not start programs anyway
            self.engine.AllowDOScmd = False
        self.commands, self.options, self.classes = _vocabulary()
        self.faults: list[Fault] = []
        self.left_out: dict[str, list[str]] = {}
        self.own_folder = self.engine.DataPath
        self.made: set[str] = set()
        self.lines = 0
        self.stopped = False
        self.active_class = ""
        self.scaled = ""  # a `Set` that rewrites the powers of loads
        self.failed = False  # the last element could not be made, and lines that go on about it mean nothing

    def fault(self, code: str, place: str, message: str) -> None:
        self.faults.append(Fault(code, place, " ".join(message.split())))

    def run_file(self, path: Path, place: str, root: Path, before: tuple[Path, ...] = ()) -> Path:
        """Run a script; returns the folder that it leaves behind as the current one."""
        folder = path.parent
        try:
            lines = read_lines(path, place)
        except SpecError as error:
            self.faults += error.faults
            return folder
        for line in lines:
            self.lines += 1
            if self.stopped:
                return folder
            if self.lines > MAX_LINES or len(self.faults) >= MAX_FAULTS:
                self.stopped = True
                many = (
                    f"more than {MAX_LINES:,} lines in all"
                    if self.lines > MAX_LINES
                    else "more faults are not looked for"
                )
                self.fault("I041", place, many)
                return folder
            where = f"{_shown(path, root)}:{line.number}"
            try:
                folder = self.run_line(line, where, folder, root, (*before, path.resolve()))
            except SpecError as error:
                self.faults += error.faults
        return folder

    def parameters(self, text: str) -> list[Parameter]:
        """The words of a line as the engine takes them apart, empty ones in quotes too."""
        parser = self.engine.Parser
        parser.CmdString = text
        found: list[Parameter] = []
        # Nothing says that the line is at its end but that no more than these can be empty words.
        empty, most = 0, 2 + sum(map(text.count, "\"'([{,="))
        while empty < most:
            name, value = parser.NextParam, parser.StrValue
            empty = 0 if name or value else empty + 1
            found.append((name, value))
        return found[: len(found) - empty]

    def run_line(self, line: ScriptLine, where: str, folder: Path, root: Path, running: tuple[Path, ...]) -> Path:
        if VARIABLE.search(line.text.partition("!")[0]):
            self.failed = True
            self.fault("I043", where, "a variable, a word that begins with @")
            return folder
        words = self.parameters(line.text)
        if not words:
            return folder
        name, word = words[0]
        if name:  # Class.Element.Property=value
            self.run_element("", line.text, words, where, folder)
            return folder
        verb = resolve(word, self.commands)
        if verb is None or word not in line.text:
            self.fault("I044", where, f"{word[:60]!r} is no command of OpenDSS")
            return folder
        lower = verb.lower()
        rest = line.text[line.text.index(word) + len(word) :].lstrip("\"')]}")
        if lower in READ:
            return self.include(lower, words[1:], where, folder, root, running)
        if lower == "set":
            self.run_set(words[1:], where)
        elif lower in LEFT_OUT:
            self.left_out.setdefault(verb, []).append(where)
        elif lower in ("clear", "clearall"):
            self.made.clear()
            self.execute(f"{verb} {rest}", where)
        elif lower in RUN:
            self.run_element(lower, f"{verb} {rest}", words[1:], where, folder)
        else:
            self.fault("I043", where, f"the command {verb!r} is not run by an import")
        return folder

    def include(
        self, verb: str, words: list[Parameter], where: str, folder: Path, root: Path, running: tuple[Path, ...]
    ) -> Path:
        """Another script, in the place of this line. After `compile` its folder stays the current one."""
        wanted = words[0][1] if words else ""
        path = find_file(wanted, folder)
        if path is None:
            self.fault("I042", where, f"there is no file {wanted!r} to {verb}")
        elif path.resolve() in running:
            self.fault("I042", where, f"{wanted!r} is being run already: it calls for itself")
        elif len(running) >= MAX_DEPTH:
            self.fault("I042", where, f"scripts that call for others are nested more than {MAX_DEPTH} deep")
        else:
            left = self.run_file(path, _shown(path, root), root, running)
            return left if verb == "compile" else folder
        return folder

    def run_set(self, words: list[Parameter], where: str) -> None:
        for name, value in words:
            option = resolve(name, self.options) if name else None
            lower = option.lower() if option else ""
            if option is None:
                self.fault("I044", where, f"{(name or value)[:60]!r} is no option that `Set` knows")
            elif lower in OPTIONS_RUN and not PLAIN.fullmatch(value):
                self.fault("I043", where, f"`Set {option}` with {value[:40]!r}, which is no plain value")
            elif lower in OPTIONS_REFUSED or (lower == "cktmodel" and not value.lower().startswith("m")):
                self.fault("I043", where, f"`Set {option}={value[:40]}` is not run by an import")
            elif lower in OPTIONS_RUN:
                self.execute(f"Set {option}=({value})", where)
                if lower in ("allocationfactors", "cfactors"):
                    self.scaled = f"`Set {option}`"
            else:
                self.left_out.setdefault(f"Set {option}={value[:40]}", []).append(where)

    def run_element(self, verb: str, text: str, words: list[Parameter], where: str, folder: Path) -> None:
        """A line that makes an element or changes one, once it is seen that it does no more than that."""
        behind, element, named = words, "", verb in ("new", "edit", "batchedit")
        if named or verb in ("open", "close", "enable", "disable"):
            self.failed = False
            target = words[0][1] if words else ""
            self.active_class, dot, element = target.strip().lower().partition(".")
            if not dot or self.active_class not in self.classes or not element:
                what = "does not name a class of OpenDSS and an element of it, such as Line.a"
                self.failed = True
                self.fault("I044", where, f"{target[:60]!r} {what}")
                return
            behind = words[1:]
        elif not verb:
            self.failed = False
            self.active_class = words[0][0].lower().partition(".")[0] if words[0][0].count(".") == 2 else ""
            if not self.active_class:
                self.fault("I043", where, "a property alone; write Class.Element.Property=value, or `~ property=value`")
                return
        if self.failed:  # goes on about an element with a fault of its own
            return
        danger = find_danger(self.active_class, behind, named)
        if danger:
            self.failed = True
            self.fault("I043", where, danger)
            return
        if not self.files_allowed(text, where, folder):
            return
        if (verb and named and verb != "new") or verb in ("open", "close", "enable", "disable", ""):
            self.exists(verb, words, where)
        if not self.failed:
            self.execute(text, where)
        self.engine.DataPath = self.own_folder
        if verb == "new" and not self.failed:
            self.made |= {f"{self.active_class}.{element}", "vsource.source"}

    def files_allowed(self, text: str, where: str, folder: Path) -> bool:
        """Whether the files of numbers that a line names are there, plain files, and not too large."""
        for name in files_named(text):
            path = find_file(name, folder)
            if path is None or not path.is_file() or path.stat().st_size > MAX_FILE_BYTES:
                self.failed = True
                self.fault("I042", where, f"no plain file {name!r} of at most {MAX_FILE_BYTES // 2**20} MiB")
                return False
            self.engine.DataPath = str(folder)
        return True

    def exists(self, verb: str, words: list[Parameter], where: str) -> None:
        """The engine takes some lines about elements that are not there without a word."""
        target = (words[0][0].rpartition(".")[0] if not verb else words[0][1]).lower()
        # Some shapes and spectra are there from the start.
        if verb == "batchedit" or self.active_class in ("circuit", "loadshape", "growthshape", "spectrum", "tcc_curve"):
            return
        if target not in self.made:
            self.failed = True
            self.fault("I044", where, f"there is no element {target[:60]!r}")

    def execute(self, text: str, where: str) -> None:
        from dss import DSSException

        try:
            self.engine.Text.Command = text
        except DSSException as error:
            self.failed = True
            self.fault("I044", where, _reason(error))

    def circuit(self) -> dict[str, Any]:
        """All that the engine holds now. Raises: SpecError I046, I044."""
        from dss import DSSException

        if not self.engine.NumCircuits:
            raise SpecError((Fault("I046", "", "no circuit: the script has no `New Circuit.NAME`"),))
        circuit = self.engine.ActiveCircuit
        try:
            circuit.Solution.BuildYMatrix(0, False)  # only then all elements have worked out what they are
            everything = _parse(circuit.ToJSON(FULL | NO_TIME | NO_BUSES))
            given = _parse(circuit.ToJSON(NO_TIME | NO_BUSES))
            self.engine.Text.Command = "Get Basefrequency"
            base = float(self.engine.Text.Result)
        except (DSSException, ValueError) as error:
            raise SpecError((Fault("I044", "", f"the circuit as a whole: {_reason(error)}"),)) from None
        stated = {(kind, e["Name"]): e for kind, es in given.items() if isinstance(es, list) for e in es if "Name" in e}
        elements = []
        names = {name.lower() for name in circuit.AllElementNames}
        for kind, listed in everything.items():
            for properties in listed if isinstance(listed, list) else ():
                full = f"{kind}.{properties['Name']}".lower() if isinstance(properties, dict) else ""
                if full in names:
                    elements.append(self.element(kind, properties, stated.get((kind, properties["Name"]), {})))
        known = {element["name"] for element in elements}
        missing = sorted(names - known)
        if missing:
            raise SpecError((Fault("I044", missing[0], "the engine does not tell the properties of this element"),))
        return {
            "name": everything["Name"],
            "version": str(self.engine.Version).splitlines()[0],
            "base_frequency": base,
            "frequency": circuit.Solution.Frequency,
            "load_multiplier": circuit.Solution.LoadMult,
            "generator_multiplier": circuit.Solution.GenMult,
            "year": circuit.Solution.Year,
            "scaled": self.scaled,
            "left_out": self.left_out,
            "elements": elements,
        }

    def element(self, kind: str, properties: dict[str, Any], stated: dict[str, Any]) -> dict[str, Any]:
        circuit = self.engine.ActiveCircuit
        circuit.SetActiveElement(f"{kind}.{properties['Name']}")
        active = circuit.ActiveCktElement
        phases, terminals = active.NumPhases, active.NumTerminals
        admittance: list[float] = []
        with contextlib.suppress(Exception):  # controls and meters have none
            admittance = [float(x) for x in active.Yprim] if active.Enabled and active.NumConductors <= 8 else []
        return {
            "name": f"{kind}.{properties['Name']}".lower(),
            "kind": kind.lower(),
            "enabled": bool(active.Enabled),
            "buses": [name.partition(".")[0].lower() for name in active.BusNames],
            "nodes": [int(node) for node in active.NodeOrder] if active.Enabled else [],
            "phases": phases,
            "conductors": active.NumConductors,
            "open": [[bool(active.IsOpen(t, p)) for p in range(1, phases + 1)] for t in range(1, terminals + 1)],
            "properties": properties,
            "stated": sorted(stated),
            "admittance": admittance,
        }


@lru_cache
def _vocabulary() -> tuple[tuple[str, ...], tuple[str, ...], frozenset[str]]:
    """Commands and options in the engine's order, and classes in lower case."""
    from dss import dss

    executive = dss.Executive
    commands = tuple(executive.Command(k) for k in range(1, executive.NumCommands + 1))
    options = tuple(executive.Option(k) for k in range(1, executive.NumOptions + 1))
    return commands, options, frozenset(name.lower() for name in dss.Classes) | {"circuit"}


def _parse(text: str) -> Any:
    """The engine's JSON. Entries of matrices that nothing has set are whatever memory held, at times no number."""
    return json.loads(NO_NUMBER.sub("null", text))


def _reason(error: Exception) -> str:
    """What the engine says, without what it says about itself."""
    text = str(error.args[1] if len(error.args) > 1 else error)
    described = re.search(r"Error Description:\s*(.*?)\s*(?:Probable Cause:|$)", text, re.DOTALL)
    return (described[1] if described else text).strip()[:300]


def _shown(path: Path, root: Path) -> str:
    try:
        return str(path.resolve().relative_to(root.resolve()))
    except ValueError:
        return str(path)


def read_circuit(path: Path) -> dict[str, Any]:
    """What a script describes, as plain data. Raises: SpecError with every fault."""
    session = Session()
    session.run_file(path, "", path.parent)
    if session.faults:
        raise SpecError(tuple(session.faults))
    return session.circuit()


def _limit() -> None:
    """No file of any size can be written, and neither time nor memory without end be used."""
    try:
        import resource
    except ImportError:  # not on this system
        return
    for kind, amount in ((resource.RLIMIT_FSIZE, 0), (resource.RLIMIT_CPU, 300), (resource.RLIMIT_CORE, 0)):
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(kind, (amount, amount))


def main(arguments: list[str]) -> int:
    """Print the circuit of a script, or its faults, as JSON."""
    _limit()
    try:
        answer: dict[str, Any] = {"circuit": read_circuit(Path(arguments[0]))}
    except SpecError as error:
        answer = {"faults": [[fault.code, fault.path, fault.message] for fault in error.faults]}
    sys.stdout.write(json.dumps(answer))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
