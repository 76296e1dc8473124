"""Strategies for lines, connected networks, and whole specs that are certified or refuted by construction."""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st

from certify.testing.assembly import network_spec
from certify.testing.dgus import filters, non_passive_controllers, passive_controllers, references
from certify.testing.load_kinds import loads
from certify.testing.parts import Document, Line, Part
from certify.testing.short_numbers import in_range

OVERHEAD = {"R": "0.3 ohm/km", "L": "0.9 mH/km", "C": "10 nF/km"}
LENGTH = ("0.1 km", "5 km")
MOST_NODES = 6
MOST_LOOPS = 3
MOST_CERTIFIED = 10


class Network(Part):
    """Nodes, as yet without anything at them, and the lines between: `node` and `line` as in a spec."""


def lines(
    R: Any = ("0.1 ohm", "10 ohm"),
    L: Any = ("0.1 mH", "10 mH"),
    C: Any = ("1 nF", "1 uF"),
) -> st.SearchStrategy[Line]:
    """Lines, without their ends. Each value is a range (low, high), one value, or a strategy. All are strictly passive.

    Shrinks to 1 ohm, 1 mH, 10 nF.
    """
    return _line({"R": in_range("ohm", R), "L": in_range("H", L), "C": in_range("F", C)})


@st.composite
def _line(draw: st.DrawFn, values: dict[str, st.SearchStrategy[Any]]) -> Line:
    return Line({key: draw(value) for key, value in values.items()})


def networks(
    max_nodes: int = MOST_NODES,
    *,
    min_nodes: int = 1,
    meshed: bool | None = None,
    line: st.SearchStrategy[Any] | None = None,
    node: st.SearchStrategy[Any] | None = None,
) -> st.SearchStrategy[Network]:
    """Connected networks: trees (`meshed` False), networks with a loop at least (True), or both.

    `line` makes the lines, `lines()` if left out; `node` what is at each node, nothing if left out. Nodes are called
    1, 2, ... Each after the first has a line from an earlier one, so they are connected; each more line closes a loop.
    Shrinks to one node, or to a triangle. Raises: ValueError if there cannot be such networks.
    """
    least = max(min_nodes, 3) if meshed else min_nodes
    if not 1 <= least <= max_nodes:
        raise ValueError(f"networks of {least} to {max_nodes} nodes")
    here = st.builds(dict) if node is None else node
    return _networks(here, here, lines() if line is None else line, (least, max_nodes), meshed)


@st.composite
def _networks(
    draw: st.DrawFn,
    first: st.SearchStrategy[Any],
    node: st.SearchStrategy[Any],
    line: st.SearchStrategy[Any],
    size: tuple[int, int],
    meshed: bool | None,
) -> Network:
    """Each node is drawn with the line to it, and each loop with its line, so that they are left out whole."""
    choice = st.integers(0, size[1] ** 2)
    nodes = {"1": draw(first)}
    ends: list[tuple[int, int]] = []
    made = []
    for k, (earlier, way, here) in enumerate(
        draw(st.lists(st.tuples(choice, line, node), min_size=size[0] - 1, max_size=size[1] - 1)), 2
    ):
        nodes[str(k)] = here
        ends.append((min(earlier, k - 2) + 1, k))
        made.append(way)
    others = [(a, b) for b in range(2, len(nodes) + 1) for a in range(1, b) if (a, b) not in ends]
    if meshed is not False:
        for which, way in draw(st.lists(st.tuples(choice, line), min_size=1 if meshed else 0, max_size=MOST_LOOPS)):
            if others:
                ends.append(others.pop(which % len(others)))
                made.append(way)
    listed = [{"from": str(a), "to": str(b), **way} for (a, b), way in zip(ends, made, strict=True)]
    return Network(node=nodes, line=listed)


def specs(
    outcome: str = "certified", max_nodes: int = MOST_NODES, *, meshed: bool | None = None
) -> st.SearchStrategy[Document]:
    """Whole specs whose verdict is known: `outcome` is "certified" or "refuted".

    Certified: node 1 and some of the others have inverters with passive laws and integral action, the rest
    loads that are monotone on the band, or nothing; all lines are of one type. It is proved too that the equilibrium
    exists, is the only one, and attracts. Why it exists: at an inverter the voltage is the reference, from
    0.95 to 1.05 pu. With lines of one ratio R : X the voltages elsewhere are, without load, convex combinations of
    references, and a load of current I lowers them by |Z I| at most, Z the impedance of a path to an inverter. With
    ten nodes that is 45 km and 19 ohm at most; loads draw up to 14 A each, and all lines charge with 4 A: together less
    than 0.125 pu, and the band ends 0.15 pu away from the references.

    Refuted: the same with one mistake: an inverter that is unstable by itself, or a load that is not monotone. Then a
    claim about that part is refuted, whatever the rest.

    Shrinks to one inverter without lines or load, of round numbers. Raises: ValueError for another outcome, or for
    more nodes than that reasoning covers.
    """
    if outcome not in ("certified", "refuted"):
        raise ValueError(f'an outcome by construction is "certified" or "refuted", not {outcome!r}')
    line = _line({"type": st.just("overhead"), "length": in_range("m", LENGTH)})
    networks(max_nodes, meshed=meshed)  # says what cannot be
    if max_nodes > MOST_CERTIFIED:
        raise ValueError(f"whole specs of up to {max_nodes} nodes; what is promised holds up to {MOST_CERTIFIED}")
    size = (3 if meshed else 1, max_nodes)
    return _specs(_networks(_SOURCES, st.one_of(_BESIDE, _SOURCES), line, size, meshed), outcome)


_LOADS, _BAD_LOADS = loads(monotone=True), loads(monotone=False)
_BAD_LAWS = non_passive_controllers(integral=True, unstable=True)
_INVERTERS = st.fixed_dictionaries(
    {"filter": filters(), "controller": passive_controllers(integral=True), "reference": references()}
)
_SOURCES = st.fixed_dictionaries({"dgu": _INVERTERS}, optional={"load": _LOADS})
_BESIDE = st.fixed_dictionaries({}, optional={"load": _LOADS})


@st.composite
def _specs(draw: st.DrawFn, network: st.SearchStrategy[Network], outcome: str) -> Document:
    drawn = draw(network)
    nodes = drawn["node"]
    if outcome == "refuted" and draw(st.booleans()):
        nodes["1"]["load"] = draw(_BAD_LOADS)
    elif outcome == "refuted":
        nodes["1"]["dgu"]["controller"] = draw(_BAD_LAWS)
    return network_spec(nodes, drawn["line"], line_type={"overhead": OVERHEAD} if drawn["line"] else None)
