"""Which commands of a script the engine gets to see: those that describe a circuit.

An OpenDSS script can write files, open an editor, start programs, load libraries and simulate for hours. Here it
describes a circuit and no more: commands that only show or solve are left out and told about; those that would change
the circuit in a way that is not followed, or reach beyond it, are refused.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

# Names as the engine spells them, in lower case.
RUN = frozenset(
    {"new", "edit", "more", "m", "~", "enable", "disable", "open", "close", "batchedit", "clear", "clearall"}
)
READ = frozenset({"redirect", "compile"})
# They show, write, solve, or speak of a drawing: the circuit as it is described stays the same.
LEFT_OUT = frozenset(
    """// ? get help comhelp about select show export plot save dump fileedit formedit panel quit next summary
    voltages currents powers seqvoltages seqcurrents seqpowers losses phaselosses cktlosses totals totalpowers
    capacity classes userclasses zsc zsc10 zsc012 zscrefresh ysc puvoltages varvalues varnames variable buscoords
    latlongcoords giscoords setbusxy makebuslist addbusmarker clearbusmarkers alignfile top vdiff nodediff
    nodelist di_plot comparecases yearlycurves visualize closedi uuids exportoverloads exportvviolations
    allpceatbus allpdeatbus calcincmatrix calcincmatrix_o refine_buslevels calclaplacian relcalc pstcalc cleanup
    finishtimestep updatestorage reprocessbuses solve solveall _initsnap _solvenocontrol _samplecontrols
    _docontrolactions _showcontrolqueue _solvedirect _solvepflow calcvoltagebases setkvbase buildy init sample
    reset wait abort
    """.split()  # noqa: SIM905 - a list of words is easier to read so
)

# Options of `Set` that say something about the circuit.
OPTIONS_RUN = frozenset(
    """year frequency loadmult genmult allocationfactors cfactors basefrequency defaultbasefrequency
    earthmodel linetypes longlinecorrection %growth
    """.split()  # noqa: SIM905 - a list of words is easier to read so
)
# They choose what the next line speaks of, or let two elements have one name.
OPTIONS_REFUSED = frozenset({"type", "element", "class", "object", "circuit", "activeactor", "allowduplicates"})

# Properties that name a library to load into the process.
LIBRARIES = ("usermodel", "userdata", "shaftmodel", "shaftdata", "dynadll", "dynadata")
# Properties that name a file with numbers.
FILES = ("csvfile", "sngfile", "dblfile", "pqcsvfile")
# Actions of these classes write files, or change loads and the circuit.
ACTING = frozenset({"loadshape", "tshape", "priceshape", "monitor", "energymeter"})
# Classes without any such property. In all others properties are named, so that it is seen which they are; only the
# first two values may stand without names.
HARMLESS = frozenset(
    """circuit vsource isource line load transformer autotrans capacitor reactor linecode wiredata cndata tsdata
    linespacing linegeometry xfmrcode fault swtcontrol recloser fuse tcc_curve sensor gicline gictransformer gicsource
    """.split()  # noqa: SIM905 - a list of words is easier to read so
)
POSITIONAL = 2

_FILE = re.compile(r"\b\w*file\s*=\s*(\"[^\"]*\"|'[^']*'|[^\s,\)\]\}]+)", re.IGNORECASE)

Parameter = tuple[str, str]  # the name, empty if there is none, and the value


def resolve(word: str, names: Sequence[str]) -> str | None:
    """The name that a word or its beginning stands for, as the engine takes it: an exact one, or the first that fits.

    >>> resolve("redir", ("New", "Edit", "Redirect")), resolve("nonsense", ("New",))
    ('Redirect', None)
    """
    lower = word.lower()
    exact = [name for name in names if name.lower() == lower]
    beginning = [name for name in names if lower and name.lower().startswith(lower)]
    return next(iter(exact + beginning), None)


def files_named(text: str) -> list[str]:
    """The files that a line asks the engine to read numbers from.

    >>> files_named("new loadshape.day npts=24 mult=(file=my day.csv)")
    ['my']
    >>> files_named('new loadshape.day npts=24 csvfile="my day.csv"')
    ['my day.csv']
    """
    return [match[1].strip("\"'") for match in _FILE.finditer(text)]


def find_danger(class_name: str, parameters: Iterable[Parameter], after_name: bool) -> str | None:
    """What a line does to an element of a class that no description of a circuit needs, or None.

    `parameters` are those behind the name of the element; `after_name` if that stands in the same line.

    >>> find_danger("generator", [("kW", "5"), ("UserModel", "evil.so")], True)
    'UserModel loads a library'
    """
    if class_name in HARMLESS:
        return None
    allowed = POSITIONAL if after_name else 0
    for position, (name, value) in enumerate(parameters):
        lower = name.rpartition(".")[2].lower()
        if not lower:
            if position >= allowed:
                return f"a value without a name; in the class {class_name} all but the first two are named"
            continue
        allowed = 0  # a value behind a name is that of the property after it
        danger = _find_danger(class_name, lower, value)
        if danger:
            return f"{name} {danger}"
    return None


def _find_danger(class_name: str, name: str, value: str) -> str | None:
    """As above, for one property; its name may be cut short."""

    def means(full: str) -> bool:
        return full.startswith(name) and name not in ("d", "s")  # these are properties, or mean others

    if name in LIBRARIES:
        return "loads a library"
    if class_name in ACTING and means("action"):
        return "is an action, which may write files"
    if means("debugtrace") and value.lower()[:1] not in ("n", "f", "0"):
        return "writes a file"
    if name not in FILES and any(map(means, (*LIBRARIES, *FILES))):
        return "may be short for a property that loads a library or reads a file; write it in full"
    return None
