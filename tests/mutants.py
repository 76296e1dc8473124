"""Wrong signs, planted one at a time in the kernel's model or in the simulator, and what the cross-check says of each.

Mutants are made from the syntax of the functions that define either model: `a + b` and `a - b` are exchanged, a minus is
dropped, and every other term gets one: factors, entries of matrices, arguments, exponents. They are applied in this
process, to the code of a function, so that all that refers to it sees it.
"""

from __future__ import annotations

import ast
import copy
import importlib
import inspect
import json
import types
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cache, partial
from typing import Any

import numpy
from scipy.sparse import issparse

from certify.certificate import prove
from certify.crosscheck import model as comparisons
from certify.crosscheck.claimed import Claimed
from certify.crosscheck.energy import Storage, Watch
from certify.crosscheck.findings import Finding
from certify.kernel.balls import Ball
from certify.kernel.check import check
from certify.kernel.claims import Verdict
from certify.kernel.errors import Rejected, RuleFailure
from certify.kernel.spec import Microgrid, decode
from certify.simulator.motion import Diverged, Follower, Piece, natural_sizes
from certify.simulator.plant import Array, Plant
from tests.mutation_cases import EXEMPT, MOTION_SECOND, NUMBERS, OFFSETS, SPECS

Proved = tuple[bytes, Verdict]
KERNEL, SIMULATOR = "kernel", "simulator"
REJECTED, STOPPED = "rejected", "error"  # the kernel turns its own certificate down; the cross-check ends in an error
# What defines either model, by module. Guards, proofs and arithmetic are not in it.
FUNCTIONS: dict[str, tuple[str, ...]] = {
    "kernel.model": (
        "J",
        "I2",
        "node_capacitances",
        "at_corner",
        "to_state_feedback",
        "feedback",
        "dgu_port",
        "load_pieces",
        "load_current",
        "load_law",
        "_terms",
        "_as_admittance",
        "incidence",
    ),
    "kernel.currents": ("plus_isotropic",),
    "kernel.loads": ("admittances", "total"),
    "kernel.equilibrium": (
        "_rest_impedance",
        "describe",
        "_impedance",
        "admittance",
        "susceptance",
        "_laws",
        "load_current",
        "strong_monotonicity",
        "_shunts",
        "flow",
    ),
    "kernel.claims": ("held_at_limits",),
    "kernel.rules": ("dissipation", "storage_at"),
    "kernel.proofs": ("full_storage",),
    # what brings both together: a wrong sign there is a false alarm
    "crosscheck.claimed": (
        "Claimed._dgu",
        "Claimed.places",
        "Claimed._lone",
        "Claimed._branch",
        "Claimed.couplings",
        "Claimed.network",
        "Claimed.load_current",
        "Claimed.load_slope",
        "floats",
        "_complex",
        "_real",
    ),
    "simulator.plant": (
        "J",
        "I2",
        "Plant.__init__",
        "Plant._add_branch",
        "Plant._stamp",
        "Plant.read_voltage",
        "Plant._enters",
        "Plant.voltage",
        "Plant.voltages",
        "Plant.asked",
        "Plant.loaded_voltages",
        "Plant.drawn",
        "Plant.rates",
        "Plant.load_slopes",
        "Plant.at_rest",
        "Loop.__init__",
        "to_phasors",
        "to_pairs",
        "_pair",
        "_matrix",
        "settled",
        "_apply",
        "_capacitances",
        "inverter_of",
        "_law",
        "_state_feedback",
        "_ida_pbc",
    ),
    "simulator.loads": (
        "StaticLoads.__init__",
        "StaticLoads.currents",
        "StaticLoads.slopes",
        "add_zips",
        "add_exps",
        "_clipped",
        "_layers",
        "_zip_table",
        "_exp_table",
        "draw",
        "add_formula",
        "_terms",
        "_formula_slope",
    ),
    "simulator.flow": (
        "Flow.A",
        "Flow.b",
        "Flow.rates",
        "Flow.jacobian",
        "flow_at",
        "find_rest",
    ),
}
# Where only what is assigned to these is part of the model.
ONLY = {
    ("kernel.equilibrium", "strong_monotonicity"): ("current", "(own, current)"),
    ("simulator.flow", "find_rest"): ("step", "trial"),
}
TARGETS = tuple((module, name) for module, names in FUNCTIONS.items() for name in names)


# --- signs in the syntax of a function ----------------------------------------------------------------------------------

# A minus in front of an argument of these is one in front of the whole.
LINEAR = {
    "float", "Fraction", "scale", "multiply", "solve", "transpose", "apply", "array", "real", "sum", "total", "tuple", "list",
    "view", "csr_matrix", "ascontiguousarray", "conj", "_pair", "_matrix", "ball", "_apply", "map", "to_phasors", "to_pairs",
    "inv", "reshape", "scaled", "outer", "to_matrix", "identity", "inverse", "csc_matrix",
}  # fmt: skip
COUNTS = {
    "ones",
    "full",
    "_place",
    "reshape",
    "zeros",
    "eye",
    "identity",
    "empty",
    "range",
    "slice",
    "len",
    "arange",
    "repeat",
    "tile",
    "zeros_like",
    "empty_like",
}
# What has no sign, or none that matters: zeros, texts, orders, and how far something may be off.
ZEROS = {"nothing", "NO_TOLERANCE[:2]", "(ZERO,) * 6", "csr_matrix(self.shape)", "ZERO", "NOTHING", "Fraction(0)", "0j"}
WIDTHS = {"spread", "blur", "tolerance", "off", "share", "half", "r", "capacitance_tolerance"}
NO_NUMBERS = {
    "abs",
    "sorted",
    "items",
    "values",
    "lipschitz",
    "zeros",
    "empty",
    "zeros_like",
    "empty_like",
    "isinstance",
    "range",
    "slice",
    "len",
    "repeat",
    "tile",
    "isfinite",
}
MINUS, SEEN = "_mutant_minus", "_mutant_seen"


@dataclass(frozen=True)
class Mutant:
    """One wrong sign: the n-th sign of a function. `was` and `becomes` are what one would read there."""

    module: str
    function: str
    index: int
    kind: str
    line: int
    was: str
    becomes: str
    count: int = 1

    @property
    def side(self) -> str:
        return SIMULATOR if self.module.startswith("simulator") else KERNEL

    @property
    def key(self) -> str:
        again = f" [{self.count}]" if self.count > 1 else ""
        return f"{self.module}.{self.function}: {self.was} -> {self.becomes}{again}"


class _Signs:
    """Finds the signs of a function: ("flip" | "drop" | "negate", node) in the order of the source."""

    def __init__(self, body: Sequence[ast.stmt], widths: set[str], only: Sequence[str] | None = None) -> None:
        self.widths, self.only = widths, only
        self.found: list[tuple[str, ast.AST]] = []
        for statement in body:
            self.statement(statement)

    def statement(self, node: ast.stmt) -> None:
        match node:
            case ast.Raise() | ast.Assert():
                return
            case ast.AugAssign() if self.only is None:
                if isinstance(node.op, ast.Add | ast.Sub):
                    self.found.append(("flip", node))
                self.value(node.value, False)
            case ast.If() | ast.While():
                self.explicit(node.test)
            case ast.For():
                self.value(node.iter)
            case ast.Assign() | ast.Return() | ast.AnnAssign() | ast.Expr():
                names = " ".join(map(ast.unparse, getattr(node, "targets", ())))
                if node.value is not None and names != "key" and (self.only is None or names in self.only):
                    self.value(node.value)
        for part in ("body", "orelse", "handlers", "finalbody"):
            for inner in getattr(node, part, ()):
                self.statement(inner)

    def value(self, node: ast.expr, whole: bool = True) -> None:
        """An expression; `whole`: a minus in front of it is not one that has been counted."""
        match node:
            case ast.BinOp(op=ast.Add() | ast.Sub()):
                self.found.append(("flip", node))
                self.value(node.left)
                self.value(node.right, False)
                return
            case ast.UnaryOp(op=ast.USub()):
                self.found.append(("drop", node))
                self.value(node.operand, False)
                return
            case ast.IfExp():
                self.explicit(node.test)
                self.value(node.body, whole)
                self.value(node.orelse, whole)
                return
            case ast.Starred():
                self.value(node.value, whole)
                return
            case ast.Compare() | ast.BoolOp() | ast.UnaryOp():
                self.explicit(node)
                return
            case ast.JoinedStr():
                return
            case ast.Constant():
                if not isinstance(node.value, int | float | complex) or isinstance(node.value, bool) or not node.value:
                    return
        if ast.unparse(node) in ZEROS or _root(node) in self.widths:
            return
        counted = isinstance(node, ast.BinOp | ast.Name | ast.Attribute | ast.Subscript | ast.Call | ast.Constant)
        if whole and counted and not (isinstance(node, ast.Call) and _called(node) in NO_NUMBERS):
            self.found.append(("negate", node))
        match node:
            case ast.BinOp(op=ast.Pow()):
                self.value(node.left, False)
                self.value(node.right, not isinstance(node.right, ast.Constant))
            case ast.BinOp():
                self.value(node.left, False)
                self.value(node.right, False)
            case ast.Subscript():
                if not isinstance(node.value, ast.Name | ast.Attribute):
                    self.value(node.value)
            case ast.Call():
                self.call(node)
            case ast.Tuple() | ast.List():
                for part in node.elts:
                    self.value(part)
            case ast.Dict():
                for part in node.values:
                    self.value(part)
            case ast.ListComp() | ast.GeneratorExp() | ast.SetComp():
                self.loops(node.generators)
                self.value(node.elt)
            case ast.DictComp():
                self.loops(node.generators)
                self.value(node.value)
            case ast.Lambda():
                self.value(node.body)
            case ast.Yield() if node.value:
                self.value(node.value)

    def call(self, node: ast.Call) -> None:
        name = _called(node)
        if isinstance(node.func, ast.Attribute) and not isinstance(node.func.value, ast.Name | ast.Attribute):
            self.value(node.func.value, name not in LINEAR)
        if name in COUNTS or name == "abs":
            return
        for argument in (*node.args, *(keyword.value for keyword in node.keywords)):
            if name == "require":
                self.explicit(argument)
            else:
                self.value(argument, name not in LINEAR)

    def loops(self, generators: Sequence[ast.comprehension]) -> None:
        for part in generators:
            axes = isinstance(part.iter, ast.Tuple) and all(
                isinstance(x, ast.Constant) and x.value in (0, 1) for x in part.iter.elts
            )
            if not axes:  # (0, 1) are indices
                self.value(part.iter)
            for condition in part.ifs:
                self.explicit(condition)

    def explicit(self, node: ast.expr) -> None:
        """Within a condition only signs that are written down."""
        if isinstance(node, ast.Subscript):
            return self.explicit(node.value)
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
            self.found.append(("flip", node))
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            self.found.append(("drop", node))
        for inner in ast.iter_child_nodes(node):
            if isinstance(inner, ast.expr):
                self.explicit(inner)
        return None


def _root(node: ast.expr) -> str:
    """The name of a quantity: c of `a.c[0] * d`."""
    match node:
        case ast.BinOp(op=ast.Mult() | ast.Div()):
            return _root(node.left)
        case ast.Subscript():
            return _root(node.value)
    return node.attr if isinstance(node, ast.Attribute) else getattr(node, "id", "")


def _called(node: ast.Call) -> str:
    return node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")


class _Rewrite(ast.NodeTransformer):
    """Replaces marked nodes: by the mutated expression, or by one that notes what they come to."""

    def __init__(self, index: int | None, seen: str = "", shown: bool = False) -> None:
        self.index, self.seen, self.shown = index, seen, shown  # None: note all; shown: as one would write it

    def generic_visit(self, node: ast.AST) -> ast.AST:
        super().generic_visit(node)
        for k, kind in getattr(node, "marks", ()):
            if self.index is None:
                node = _noted(node, k, self.seen)
            elif k == self.index:
                node = _mutated(node, kind, self.shown)
        return node


def _noted(node: ast.AST, k: int, seen: str) -> ast.AST:
    if isinstance(node, ast.AugAssign):
        node.value = ast.Call(ast.Name(seen, ast.Load()), [ast.Constant(k), node.value], [])
        return node
    assert isinstance(node, ast.expr)
    return ast.Call(ast.Name(seen, ast.Load()), [ast.Constant(k), node], [])


def _mutated(node: Any, kind: str, shown: bool) -> ast.AST:
    if kind == "flip":
        node.op = ast.Sub() if isinstance(node.op, ast.Add) else ast.Add()
        return node
    if kind == "drop":
        return node.operand
    if shown:
        return ast.UnaryOp(ast.USub(), node)
    return ast.Call(ast.Name(MINUS, ast.Load()), [node], [])


# --- numbers -------------------------------------------------------------------------------------------------------


def minus(x: Any) -> Any:
    """The negative of a number, a ball, a matrix or a tuple of them; what is none of these stays."""
    if isinstance(x, Ball):
        return Ball(-x.x, -x.y, x.r)
    if isinstance(x, tuple | list):
        return type(x)(minus(part) for part in x)
    return -x if is_number(x) or isinstance(x, int) else x


def is_number(x: Any) -> bool:
    """Whether it has a sign that means something: counts and indices have none."""
    if isinstance(x, bool | numpy.bool_):
        return False
    if isinstance(x, int | numpy.integer):
        return abs(int(x)) > 1 << 20
    if isinstance(x, tuple | list):
        parts = [part for part in x if not (isinstance(part, int) and part == 0)]
        return bool(parts) and all(is_number(part) and not isinstance(part, numpy.ndarray) for part in parts)
    if isinstance(x, numpy.ndarray):
        return x.dtype.kind in "fc" and x.size > 0
    return isinstance(x, Fraction | float | complex | numpy.number) or issparse(x)


# --- functions and their code --------------------------------------------------------------------------------------


class Target:
    """A function, or a constant of a module, that can be swapped for a mutant of it."""

    def __init__(self, module: str, name: str) -> None:
        self.module, self.name = module, name
        self.seen = f"{SEEN}_{name.replace('.', '_')}"
        self.home = importlib.import_module(f"certify.{module}")
        tree = ast.parse(inspect.getsource(self.home))
        node: Any = tree
        for part in name.split("."):
            node = next(x for x in node.body if _names(x) == part)
        self.constant = not isinstance(node, ast.FunctionDef)
        self.node = node
        if not self.constant:
            node.decorator_list = []
        widths = WIDTHS if module.startswith("kernel") else set[str]()
        signs = _Signs([node] if self.constant else node.body, widths, ONLY.get((module, name)))
        self.signs = signs.found
        for k, (kind, place) in enumerate(self.signs):
            place.marks = (*getattr(place, "marks", ()), (k, kind))  # type: ignore[attr-defined]

    def code(self, index: int | None) -> Any:
        """The code with one sign changed, or with all of them noted; of a constant, of what computes it."""
        node = _Rewrite(index, self.seen).visit(copy.deepcopy(self.node))
        tree = ast.Module([ast.ImportFrom("__future__", [ast.alias("annotations")], 0), node], [])
        code = compile(ast.fix_missing_locations(tree), f"<mutant of {self.name}>", "exec")
        if self.constant:
            return code
        return next(c for c in code.co_consts if isinstance(c, types.CodeType) and c.co_name == node.name)

    @property
    def function(self) -> Any:
        owner: Any = self.home
        for part in self.name.split("."):
            owner = inspect.getattr_static(owner, part)
        for attribute in ("fget", "func", "py_func", "__func__"):
            owner = getattr(owner, attribute, owner)
        return owner

    @contextmanager
    def swapped(self, index: int | None, seen: Callable[[int, Any], Any] | None = None) -> Iterator[None]:
        names = vars(self.home)
        names[MINUS], names[self.seen] = minus, seen
        if self.constant:
            before = names[self.name]
            exec(self.code(index), names)
            try:
                yield
            finally:
                names[self.name] = before
        else:
            function = self.function
            own = function.__code__
            function.__code__ = self.code(index)
            try:
                yield
            finally:
                function.__code__ = own


def _names(node: ast.stmt) -> str:
    if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
        return node.targets[0].id
    return getattr(node, "name", "")


@cache
def target(module: str, name: str) -> Target:
    return Target(module, name)


@contextmanager
def uncompiled() -> Iterator[None]:
    """The simulator's inner loops as Python, so that they can be changed."""
    modules = [importlib.import_module(f"certify.simulator.{name}") for name in ("loads", "exponential")]
    before = [(vars(home), name, f) for home in modules for name, f in vars(home).items() if hasattr(f, "py_func")]
    for names, name, function in before:
        names[name] = function.py_func
    try:
        yield
    finally:
        for names, name, function in before:
            names[name] = function


# --- microgrids and what is compared on them -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Case:
    """A microgrid with the certificate that the kernel as it is has accepted.

    `states`: to compare both models at; `away`: from rest, where a motion begins.
    """

    name: str
    data: bytes
    grid: Microgrid
    certificate: bytes
    verdict: Verdict
    plant: Plant
    states: tuple[Array, ...]
    away: Array

    def claimed(self, side: str) -> Claimed:
        """Both models anew, one of which may be mutated; the verdict is that of the kernel as it is."""
        plant = self.plant if side == KERNEL else Plant(self.grid, NUMBERS.get(self.name))
        return Claimed(plant, self.certificate, self.verdict)

    def still(self, claimed: Claimed, again: Callable[[Case], Proved] | None = None) -> Iterator[Finding]:
        """What is compared without a motion, the quickest first; with what the kernel says when it is asked again."""
        yield from comparisons.compare_loads(claimed)
        for x in self.states:
            yield from comparisons.compare_model(claimed, x)
        rest = comparisons.find_reference(claimed)
        yield from comparisons.compare_rest(claimed, rest)
        if again:
            yield from comparisons.compare_rest(Claimed(claimed.plant, *again(self)), rest)

    def moving(self, claimed: Claimed) -> Iterator[Finding]:
        """What is compared along a short motion."""
        plant, rest = claimed.plant, comparisons.find_reference(claimed)
        storage = None if rest is None else Storage(claimed, rest)
        if storage is None or not storage.first:
            return
        pieces: list[Piece] = []
        with suppress(Diverged):
            x = rest + self.away
            pieces.extend(Follower(plant, x, TOLERANCE).pieces(x, 0.0, MOTION_SECOND))
        for balance in (False, True):  # which takes long where H makes no sense
            watch = Watch(storage, TOLERANCE, natural_sizes(plant, rest), balance)
            for piece in pieces:
                watch.see(piece)
            yield from (found for found in watch.findings if balance == (found.kind == "energy balance"))

    def findings(self, side: str = KERNEL, again: Callable[[Case], Proved] | None = None) -> Iterator[Finding]:
        """All that the cross-check compares."""
        claimed = self.claimed(side)
        yield from self.still(claimed, again)
        yield from self.moving(claimed)


def checked_again(case: Case) -> Proved:
    return case.certificate, check(case.data, case.certificate)


def proved_again(case: Case) -> Proved:
    found = prove(case.data)
    return found.data, found.verdict


# Of what is seen in the facts of a verdict only, the kernel is asked again; what signs the search takes from the kernel
# as well, it has to prove anew.
AGAIN = {"kernel.equilibrium": checked_again, "kernel.loads": checked_again, "kernel.claims": proved_again}
TOLERANCE = 1e-8


@cache
def case(name: str) -> Case:
    data = json.dumps(SPECS[name]).encode()
    proved = prove(data)
    grid = decode(data)
    plant = Plant(grid, NUMBERS.get(name))
    with uncompiled():
        rest = comparisons.find_reference(Claimed(plant, proved.data, proved.verdict))
    assert rest is not None, f"the simulator finds no equilibrium of {name}"
    sizes = natural_sizes(plant, rest)
    rng = numpy.random.default_rng(3)
    states = tuple(rest * (1 - share) + off * sizes * rng.uniform(-1, 1, plant.size) for share, off in OFFSETS)
    return Case(name, data, grid, proved.data, proved.verdict, plant, states, states[-1] - rest)


def cases() -> tuple[Case, ...]:
    return tuple(case(name) for name in SPECS)


# --- mutants and their fate ----------------------------------------------------------------------------------------------


@dataclass
class Coverage:
    """Which specs run a sign, and whether numbers that are not zero were seen there."""

    specs: dict[int, set[str]] = field(default_factory=dict)
    numbers: set[int] = field(default_factory=set)


@contextmanager
def quiet() -> Iterator[None]:
    with warnings.catch_warnings(), numpy.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        yield


@cache
def coverage() -> dict[tuple[str, str], Coverage]:
    """What runs of each function, and on what, in the comparisons of all microgrids without a motion."""
    result = {(module, name): Coverage() for module, name in TARGETS}
    for each in cases():
        for side in (KERNEL, SIMULATOR):
            chosen = [key for key in TARGETS if (key[0].startswith("simulator")) == (side == SIMULATOR)]
            with quiet(), uncompiled(), ExitStack() as stack:
                for key in chosen:
                    stack.enter_context(target(*key).swapped(None, partial(_note, result[key], each.name)))
                for _ in each.still(each.claimed(side), checked_again if side == KERNEL else None):
                    pass
    return result


def _note(found: Coverage, spec: str, k: int, value: Any) -> Any:
    found.specs.setdefault(k, set()).add(spec)
    if is_number(value):
        found.numbers.add(k)
    return value


def mutants(module: str, name: str) -> list[Mutant]:
    """All wrong signs of a function, but for those of what is no number."""
    own, texts, found, covered = target(module, name), Counter[str](), [], coverage()[module, name]
    for k, (kind, node) in enumerate(own.signs):
        literal = isinstance(node, ast.Constant) or kind == "drop"
        if k in covered.specs and k not in covered.numbers and not literal:
            continue
        was = ast.unparse(node)
        becomes = ast.unparse(_Rewrite(k, shown=True).visit(copy.deepcopy(node)))
        texts[was + becomes] += 1
        line = getattr(node, "lineno", 0)
        found.append(Mutant(module, name, k, kind, line, was, becomes, texts[was + becomes]))
    return found


@dataclass(frozen=True)
class Fate:
    """How a mutant was found out: by a kind of finding that does not agree, REJECTED or STOPPED; None if it was not.

    `seen`: by which kinds on that microgrid, if all were asked for; along a motion only if nothing was seen before.
    """

    mutant: Mutant
    caught: str | None
    spec: str = ""
    what: str = ""
    seen: tuple[str, ...] = ()


def judge(mutant: Mutant, first: Sequence[str] = (), thorough: bool = False) -> Fate:
    """Let the cross-check look at the microgrids that run the mutated place, some of them first, until one shows it."""
    own = target(mutant.module, mutant.function)
    names = coverage()[mutant.module, mutant.function].specs.get(mutant.index, set())
    order = [*(n for n in first if n in names), *(n for n in SPECS if n in names and n not in first)]
    with quiet(), uncompiled(), own.swapped(mutant.index):
        for name in order:
            if seen := _look(case(name), mutant, thorough):
                caught = next(iter(seen))
                return Fate(mutant, caught, name, seen[caught], tuple(seen))
    return Fate(mutant, None)


def _look(each: Case, mutant: Mutant, thorough: bool) -> dict[str, str]:
    """The kinds of comparison that disagree on a microgrid; a motion is only looked at if none does without."""
    seen: dict[str, str] = {}
    try:
        claimed = each.claimed(mutant.side)
        for look in (partial(each.still, again=AGAIN.get(mutant.module)), each.moving):
            for finding in look(claimed):
                if not finding.agrees:
                    seen.setdefault(finding.kind, f"{finding.where}: {finding.value:.3g}")
                    if not thorough:
                        return seen
            if seen:
                break
    except (Rejected, RuleFailure) as error:
        seen.setdefault(REJECTED, str(error))
    except Exception as error:
        seen.setdefault(STOPPED, repr(error))
    return seen


def judge_all(module: str, name: str, thorough: bool = False, every: int = 1) -> list[Fate]:
    """The fates of all mutants of a function, or of `every` so many of them, and always of those that are exempt."""
    fates: list[Fate] = []
    recent: list[str] = []
    reasons = exempt()
    for k, mutant in enumerate(mutants(module, name)):
        if k % every and mutant.key not in reasons:
            continue
        fate = judge(mutant, recent, thorough)
        if fate.caught:
            recent = [fate.spec, *(n for n in recent if n != fate.spec)]
        fates.append(fate)
    return fates


def exempt() -> dict[str, str]:
    """Why a mutant that is listed cannot be caught, by its key."""
    return {key: reason for reason, keys in EXEMPT.items() for key in keys}
