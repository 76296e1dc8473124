"""Scenarios, proved phase by phase: what each phase is, what is refused, what is written, how far events throw it."""

from __future__ import annotations

import contextlib
import json
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from certify.certificate import Certificate, prove
from certify.cli import main
from certify.inputs import read
from certify.jumps import Jump, find_jumps
from certify.kernel.claims import Claim
from certify.kernel.errors import Rejected, SpecError
from certify.kernel.model import node_capacitances
from certify.kernel.spec import ExpLoad, IdaPbc, LinearLoop, Microgrid, Node, StateFeedback, ZipLoad, components, decode
from certify.phases import Phase, read_phases, series_loads
from certify.report.files import write_folder
from certify.simulator.scenario import Target
from tests.conftest import SPECS
from tests.test_bad_input import GOOD

CIGRE, PRINTED = "specs/cigre-mv.toml", "specs/cigre-mv-as-printed.toml"

# Two DGUs, a load between them, a line that may be off; all numbers are easy.
SMALL = """format = "certify/microgrid@1"
frequency = "50 Hz"
base_voltage = "400 V"
voltage_band = ["0.5 pu", "1.5 pu"]
[filter.lc]
R = "0.1 ohm"
L = "2 mH"
C = "20 uF"
[controller.phs]
kind = "ida-pbc"
alpha = -5
nu = 1
ki = 100
[controller.pi]
kind = "state-feedback"
let = { kp = 1000, ki = 1000 }
K11 = "1 - kp*L"
K12 = [["R - ki*(1/kp + 1)", "-w0*L"], ["w0*L", "R - ki*(1/kp + 1)"]]
K13 = "ki"
[node.a]
dgu = { filter = "lc", controller = "phs", reference = [400, 0] }
[node.b]
load = [{ kind = "zip", Y = ["10 mS", 0] }, { kind = "rl", R = 30, L = "50 mH" }]
[node.c]
dgu = { filter = "lc", controller = "pi", reference = [390, -10] }
load = [{ kind = "exp", P0 = "1 kW", np = 1.5 }]
[[line]]
name = "ab"
from = "a"
to = "b"
R = 0.5
L = "1 mH"
C = "4 uF"
[[line]]
name = "bc"
from = "b"
to = "c"
R = 0.25
L = "0.5 mH"
C = "2 uF"
"""


LOADS = 'load = [{ kind = "zip", Y = ["75 uS", "75 uS"] }, { kind = "exp", P0 = "5 kW", np = 1.5 }]'
CURRENT = '{ kind = "current", I = ["Vd/50", "Vq/50"], centre = ["1 pu", 0], radius = "0.2 pu" }'
LOOP = GOOD.replace(
    "[line_type.overhead]",
    """[controller.loop]
kind = "linear"
F = [[-100, 0], [0, -100]]
B = [["1/C", 0], [0, "1/C"]]
C = [[1, 0], [0, 1]]
[controller.more]
kind = "linear"
F = [[-100, 0, 0], [0, -100, 0], [0, 0, -1]]
B = [["1/C", 0], [0, "1/C"], [0, 0]]
C = [[1, 0, 0], [0, 1, 0]]
[line_type.overhead]""",
).replace('controller = "phs"', 'controller = "loop"')


def with_scenario(text: str, base: str = SMALL) -> bytes:
    return f'{base}\n[scenario.x]\nend = "8 s"\n{text}\n'.encode()


def phases_of(text: str, base: str = SMALL) -> tuple[Phase, ...]:
    return read_phases(with_scenario(text, base), "x")


# What a phase is


def test_cigre_has_four_phases() -> None:
    spec = read(CIGRE)
    whole = decode(spec)
    phases = read_phases(spec, "plug-in")
    assert [(p.number, p.start_second, p.end_second, p.off) for p in phases] == [
        (1, 0, 4, ("5",)),
        (2, 4, 5, ()),
        (3, 5, 6, ()),
        (4, 6, 8, ()),
    ]
    assert [[(e.action, e.part, e.target) for e in p.events] for p in phases] == [
        [],
        [("connect", "DGU", "5")],
        [("load", "load", "5")],
        [("load", "load", "8")],
    ]
    grids = [decode(phase.spec) for phase in phases]
    without = tuple(replace(node, dgu=None) if node.name == "5" else node for node in whole.nodes)
    assert grids[0] == replace(whole, nodes=without)
    assert grids[1] == whole
    changed = ZipLoad(*((Fraction(x), Fraction(x)) for x in ("121.2e-6", "0.485", "9696")))
    assert next(node for node in grids[2].nodes if node.name == "5").loads == (changed,)
    assert next(node for node in grids[3].nodes if node.name == "5").loads == (changed,)  # it stays
    assert grids[2].lines == whole.lines


@pytest.mark.parametrize("file", SPECS, ids=lambda p: p.name)
def test_a_phase_without_changes_is_the_microgrid(file: Path) -> None:
    text = file.read_text().split("\n[scenario.")[0]
    if file.suffix == ".json":
        spec = json.dumps({**json.loads(text), "scenario": {"x": {"end": 1}}}).encode()
    else:
        spec = f"{text}\n[scenario.x]\nend = 1\n".encode()
    (phase,) = read_phases(spec, "x")
    assert decode(phase.spec) == decode(spec)
    assert "scenario" not in json.loads(phase.spec)


def test_numbers_stay_exact() -> None:
    """Digits beyond floats, and spellings that TOML has and JSON has not."""
    base = SMALL.replace("R = 0.25", "R = +0.250_000_000_000_000_000_000_000_001").replace("R = 30", "R = 3_0")
    (phase,) = phases_of("", base)
    assert decode(phase.spec) == decode(base.encode())
    assert decode(phase.spec).lines[1].branch.resistance_ohm == Fraction("0.250000000000000000000000001")


def test_a_line_that_is_off_is_left_out_with_its_capacitance() -> None:
    phases = phases_of('disconnected = ["bc"]\nevent = [{ at = 1, connect = "bc" }, { at = 2, disconnect = "ab" }]')
    grids = [decode(phase.spec) for phase in phases]
    assert [[line.name for line in grid.lines] for grid in grids] == [["ab"], ["ab", "bc"], ["bc"]]
    legs = [node_capacitances(grid)["b"] for grid in grids]
    assert legs == [Fraction(2, 10**6), Fraction(3, 10**6), Fraction(1, 10**6)]


def test_events_at_one_time_are_one_step_and_no_phase_is_empty() -> None:
    text = """disconnected = ["a"]
event = [
  { at = 3, load = "b", set = { Y = [0.03, 0] } },
  { at = 0, disconnect = "ab" },
  { at = 3, load = "b", set = { Y = [0.02, 0], I = [1, 0] } },
  { at = 0, connect = "a" },
  { at = 3, connect = "ab" },
]"""
    phases = phases_of(text)
    assert [(p.span, p.off, [e.position for e in p.events]) for p in phases] == [
        ("0 s to 3 s", ("ab",), [1, 3]),
        ("3 s to 8 s", (), [0, 2, 4]),
    ]
    load = decode(phases[1].spec).nodes[1].loads[0]
    assert isinstance(load, ZipLoad)
    assert (load.Y[0], load.I[0]) == (Fraction(1, 50), 1)  # the last one counts; P stays as it is


def test_the_order_of_the_spec_need_not_be_that_of_time() -> None:
    phases = phases_of('event = [{ at = 2, connect = "a" }, { at = "1.5 s", disconnect = "a" }]')
    assert [p.off for p in phases] == [(), ("a",), ()]


# Loads that are switched one by one; other references and controllers

MANY = SMALL.replace(
    '{ kind = "rl", R = 30, L = "50 mH" }',
    '{ kind = "rl", R = 30, L = "50 mH" }, { kind = "exp", P0 = "100 W", np = 2 }, { kind = "rl", R = 40, L = "80 mH" }',
)


def test_loads_are_named_as_the_spec_counts_them_whatever_is_off() -> None:
    phases = phases_of(
        """disconnected = [{ load = "b", index = 1 }, "ab"]
event = [
  { at = 1, disconnect = { load = "b" } },
  { at = 1, load = "b", index = 3, set = { R = "55 ohm" } },
  { at = 2, connect = { load = "b", index = 1 } },
  { at = 2, load = "b", set = { Y = ["7 mS", 0] } },
  { at = 2, load = "b", index = 2, set = { P0 = 250 } },
  { at = 3, connect = { load = "b", index = 0 } },
  { at = 4, disconnect = { load = "c" } },
]""",
        MANY,
    )
    assert [phase.off for phase in phases] == [
        ("load 1 at node b", "ab"),
        ("load 1 at node b", "ab", "load 0 at node b"),
        ("ab", "load 0 at node b"),
        ("ab",),
        ("ab", "load 0 at node c"),
    ]
    whole = decode(MANY.encode()).nodes[1]
    grids = [decode(phase.spec) for phase in phases]
    nodes = [grid.nodes[1] for grid in grids]
    shape = [(len(node.loads), [branch.resistance_ohm for branch in node.branches]) for node in nodes]
    assert shape == [(2, [40]), (1, [55]), (1, [30, 55]), (2, [30, 55]), (2, [30, 55])]
    assert nodes[0].loads == whole.loads
    assert nodes[3].branches[1] == replace(whole.branches[1], resistance_ohm=Fraction(55))
    zips, exps = ([load for load in nodes[3].loads if isinstance(load, kind)] for kind in (ZipLoad, ExpLoad))
    assert (zips[0].Y, exps[0].P0_watt) == ((Fraction(7, 1000), 0), 250)  # that of index 0 was set while it was off
    assert [node.loads[0] for node in nodes[1:3]] == [whole.loads[1], exps[0]]
    assert (len(grids[3].nodes[2].loads), len(grids[4].nodes[2].loads)) == (1, 0)
    assert "load" in json.loads(phases[4].spec)["node"]["c"]
    places = [series_loads(json.loads(phase.spec), phase.gone)["b"] for phase in phases]
    assert places == [[3], [3], [1, 3], [1, 3], [1, 3]]
    # the given document is left as it is
    assert phases_of("", MANY)[0].spec == phases_of('event = [{ at = 1, disconnect = { load = "b" } }]', MANY)[0].spec


def test_an_index_may_be_a_number_of_json() -> None:
    spec = json.loads(phases_of("", MANY)[0].spec)
    spec["scenario"] = {"x": {"end": 2, "event": [{"at": 1, "disconnect": {"load": "b", "index": 3}}]}}
    assert read_phases(json.dumps(spec).encode(), "x")[1].gone == (Target("load", "b", 3),)


def test_a_linear_loop_may_connect_too_and_nothing_is_known_of_its_states() -> None:
    for how in ("discharged", "synchronised"):
        spec = with_scenario(f'disconnected = ["a"]\nevent = [{{ at = 1, connect = "a", filter = "{how}" }}]', LOOP)
        phases = read_phases(spec, "x")
        assert phases[1].events[0].discharged == (how == "discharged")
        grid = decode(spec)
        names = [f"voltage at node {node.name}" for node in grid.nodes] + [
            f"current in line {x.name}" for x in grid.lines
        ]
        rest = dict.fromkeys(names, 18_000 + 0j)
        pair = [with_claims(phase, rest, Fraction(1)) for phase in phases]
        (jump,) = find_jumps(grid, pair[0], pair[1])
        assert jump.status == "unknown"


def test_faults_of_loads_are_told_at_their_place_in_the_spec() -> None:
    base = MANY.replace(
        'load = [{ kind = "exp", P0 = "1 kW"', 'load = [{ kind = "zip", P = [1, 1] }, { kind = "exp", P0 = "1 kW"'
    )
    with pytest.raises(SpecError, match=r"S102 at node.c.load\[1\]: Q0 and nq go together \(in phase 1 of"):
        phases_of(
            'disconnected = [{ load = "c" }]\nevent = [{ at = 0, load = "c", index = 1, set = { Q0 = 100 } }]', base
        )
    with pytest.raises(
        SpecError, match=r"S102 at node.c.load\[1\]: Q0 and nq go together \(in phase 2 of .* and in 1 more"
    ):
        phases_of(
            'event = [{ at = 1, load = "c", index = 1, set = { Q0 = 100 } }, { at = 2, disconnect = { load = "c" } }]',
            base,
        )


def test_references_and_controllers_of_phases() -> None:
    text = """disconnected = ["c"]
event = [
  { at = 1, reference = "a", set = ["1.02 pu", "-3 V"] },
  { at = 1, reference = "c", set = [380, 2] },
  { at = 2, controller = "a", set = "pi" },
  { at = 2, controller = "c", set = "phs" },
  { at = 3, connect = "c", filter = "discharged" },
  { at = 4, controller = "c", set = "pi" },
]"""
    phases = phases_of(text)
    dgus = [[node.dgu for node in decode(phase.spec).nodes] for phase in phases]
    a, _, c = (node.dgu for node in decode(SMALL.encode()).nodes)
    assert a
    assert c
    turned = replace(a, reference_volt=(Fraction(408), Fraction(-3)))
    late = replace(c, reference_volt=(Fraction(380), Fraction(2)))
    assert dgus[0] == [a, None, None]
    assert dgus[1] == [turned, None, None]
    assert dgus[2] == [replace(turned, controller=c.controller), None, None]
    assert dgus[3] == [dgus[2][0], None, replace(late, controller=a.controller)]
    assert dgus[4] == [dgus[2][0], None, late]
    assert [len(phase.settings) for phase in phases] == [0, 2, 4, 4, 4]
    assert [event.controller for event in phases[4].settings] == [None, None, "pi", "pi"]
    assert [event.discharged for phase in phases for event in phase.events] == [False] * 4 + [True, False]


def test_a_controller_that_anti_windup_does_not_go_with_is_found_in_its_phase() -> None:
    base = SMALL.replace("reference = [400, 0]", 'reference = [400, 0], limits = [900, 900], anti_windup = "5 ms"')
    base = base.replace("[controller.pi]", '[controller.open]\nkind = "constant"\n[controller.pi]')
    phases_of('event = [{ at = 1, controller = "a", set = "pi" }]', base)
    with pytest.raises(
        SpecError, match=r"S212 at node.a.dgu.anti_windup: the integral gain .* \(in phase 2 of scenario x"
    ):
        phases_of('event = [{ at = 1, controller = "a", set = "open" }]', base)


def test_linear_loops_of_one_size_may_be_exchanged() -> None:
    same = LOOP.replace(
        "[controller.more]",
        """[controller.same]
kind = "linear"
F = [[-200, 0], [0, -200]]
B = [["1/C", 0], [0, "1/C"]]
C = [[1, 0], [0, 1]]
[controller.more]""",
    )
    first, second = phases_of('event = [{ at = 1, controller = "a", set = "same" }]', same)
    laws = [node.dgu and node.dgu.controller for phase in (first, second) for node in decode(phase.spec).nodes[:1]]
    assert [law.F[0][0] for law in laws if isinstance(law, LinearLoop)] == [-100, -200]


@given(
    st.recursive(
        st.none()
        | st.booleans()
        | st.integers()
        | st.floats(allow_nan=False, allow_infinity=False)
        | st.sampled_from(["a", "b", "d", "1", "2", "pi", "phs", "", "discharged", "\x1b[31m"]),
        lambda inner: (
            st.lists(inner, max_size=3)
            | st.dictionaries(
                st.sampled_from(
                    [
                        "at",
                        "connect",
                        "disconnect",
                        "load",
                        "index",
                        "filter",
                        "reference",
                        "controller",
                        "set",
                        "R",
                        "Y",
                    ]
                ),
                inner,
                max_size=5,
            )
        ),
        max_leaves=12,
    )
)
@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_whatever_stands_in_a_scenario_is_read_or_refused(junk: object) -> None:
    document = json.loads(phases_of("", GOOD)[0].spec)
    for scenario in (
        {"end": 2, "event": [junk]},
        {"end": 2, "event": [{"at": 1, "connect": junk}]},
        {"end": 2, "disconnected": [junk]},
        {"end": 2, "event": [{"at": 1, "controller": "a", "set": junk}]},
        {"end": 2, "event": [{"at": 1, "load": "b", "index": junk, "set": junk}]},
    ):
        with contextlib.suppress(SpecError):
            read_phases(json.dumps({**document, "scenario": {"x": scenario}}).encode(), "x")


def test_parts_that_are_faulty_themselves_are_no_traceback() -> None:
    """What another decoder refuses is met by that of scenarios too."""
    document = json.loads(phases_of("", GOOD)[0].spec)
    events = [
        {"at": 1, "controller": "a", "set": "phs"},
        {"at": 1, "load": "b", "index": 1, "set": {"P0": 1}},
        {"at": 1, "reference": "a", "set": [1, 1]},
        {"at": 1, "connect": "a", "filter": "discharged"},
    ]
    faulty: list[dict[str, object]] = [
        {"controller": 5},
        {"controller": {"phs": 5, "pi": {"kind": ["linear"]}}},
        {"controller": {"phs": {"kind": "linear", "F": 5}, "pi": {"kind": "linear", "F": [[1]]}}},
        {"node": {"a": {"dgu": None}, "b": {"load": [5, 5]}, "d": 5}},
        {"node": {"a": {"dgu": {"controller": ["phs"]}}, "b": {"load": [{}, {"kind": {}}]}}},
        {"node": {"a": {"dgu": {"controller": "none"}}, "b": {"load": {}}}},
        {"node": [], "line": {}},
    ]
    for change in faulty:
        for event in events:
            spec = {**document, **change, "scenario": {"x": {"end": 2, "event": [event]}}}
            with pytest.raises(SpecError):
                read_phases(json.dumps(spec).encode(), "x")


# What is refused

# (base, scenario, code, path, part of the message)
REFUSED = {
    "connect what is on": (
        GOOD,
        'event = [{ at = 1, disconnect = "a" }, { at = 2, connect = "a" }, { at = 3, connect = "a" }]',
        "S311",
        "scenario.x.event[2].connect",
        "DGU 'a' is on already at 3 s",
    ),
    "disconnect what is off": (
        GOOD,
        'disconnected = ["2"]\nevent = [{ at = 1.5, disconnect = "2" }]',
        "S311",
        "scenario.x.event[0].disconnect",
        "line '2' is off already at 1.5 s",
    ),
    "in order of time, not of the list": (
        GOOD,
        'event = [{ at = 2, disconnect = "a" }, { at = 1, connect = "a" }]',
        "S311",
        "scenario.x.event[1].connect",
        "at 1 s",
    ),
    "off twice": (GOOD, 'disconnected = ["a", "a"]', "S311", "scenario.x.disconnected[1]", "twice"),
    "a DGU and a line of one name": (
        GOOD.replace('name = "1"', 'name = "a"'),
        'event = [{ at = 1, disconnect = "a" }]',
        "S312",
        "scenario.x.event[0].disconnect",
        "both a DGU and a line",
    ),
    "a DGU and a line of one name, off": (
        GOOD.replace('name = "1"', 'name = "a"'),
        'disconnected = ["a"]',
        "S312",
        "scenario.x.disconnected[0]",
        "both a DGU and a line",
    ),
    "a load without coefficients": (
        GOOD.replace(LOADS, f"load = [{CURRENT}]"),
        'event = [{ at = 1, load = "b", set = { Y = [1, 1] } }]',
        "S313",
        "scenario.x.event[0].load",
        "load 0 at node 'b' is of kind 'current'; events change loads of kind zip, exp, rl",
    ),
    "a coefficient of another kind of load": (
        GOOD.replace(LOADS, 'load = [{ kind = "rl", R = 1, L = 1 }]'),
        'event = [{ at = 1, load = "b", set = { Y = [1, 1] } }]',
        "S101",
        "scenario.x.event[0].set.Y",
        "load 0 at node 'b' has no such coefficient",
    ),
    "a coefficient that is not positive": (
        GOOD.replace(LOADS, 'load = [{ kind = "rl", R = 1, L = 1 }]'),
        'event = [{ at = 1, load = "b", set = { R = 0 } }]',
        "S208",
        "scenario.x.event[0].set.R",
        "must be positive, got 0",
    ),
    "no load of that index": (
        GOOD,
        'event = [{ at = 1, load = "b", index = 2, set = { P0 = 1 } }]',
        "S314",
        "scenario.x.event[0].index",
        "there is no load 2: node 'b' has 2 loads, 0 to 1",
    ),
    "no such load to switch": (
        GOOD,
        'event = [{ at = 1, disconnect = { load = "b", index = 2 } }]',
        "S314",
        "scenario.x.event[0].disconnect.index",
        "there is no load 2",
    ),
    "no such load that is off": (
        GOOD,
        'disconnected = [{ load = "b", index = 7 }]',
        "S314",
        "scenario.x.disconnected[0].index",
        "there is no load 7",
    ),
    **{
        f"index {index}": (
            GOOD,
            f'disconnected = [{{ load = "b", index = {index} }}]',
            "S314",
            "scenario.x.disconnected[0].index",
            "expected a whole number from 0 up, got",
        )
        for index in ("-1", "1.0", "true", '"1"', "[0]", "0x" + "f" * 300, "1e0", "nan")
    },
    "a target without a node": (
        GOOD,
        "event = [{ at = 1, disconnect = { index = 0 } }]",
        "S102",
        "scenario.x.event[0].disconnect.load",
        "missing",
    ),
    "a target with too much": (
        GOOD,
        'event = [{ at = 1, disconnect = { load = "b", line = "1" } }]',
        "S101",
        "scenario.x.event[0].disconnect.line",
        "unknown key",
    ),
    "a target that is no name": (
        GOOD,
        "event = [{ at = 1, disconnect = 1 }]",
        "S306",
        "scenario.x.event[0].disconnect",
        "1 is not a DGU or line; did you mean '1', in quotes?",
    ),
    "a load at a node without": (
        GOOD,
        'disconnected = [{ load = "a" }]',
        "S306",
        "scenario.x.disconnected[0].load",
        "'a' is not a node with a load",
    ),
    "a load that is on": (
        GOOD,
        'event = [{ at = 1, connect = { load = "b" } }]',
        "S311",
        "scenario.x.event[0].connect",
        "load 0 at node 'b' is on already at 1 s",
    ),
    "a load that is off": (
        GOOD,
        'disconnected = [{ load = "b", index = 1 }]\nevent = [{ at = 1, disconnect = { load = "b", index = 1 } }]',
        "S311",
        "scenario.x.event[0].disconnect",
        "load 1 at node 'b' is off already at 1 s",
    ),
    "a load off twice": (
        GOOD,
        'disconnected = [{ load = "b" }, { load = "b", index = 0 }]',
        "S311",
        "scenario.x.disconnected[1]",
        "load 0 at node 'b' is named twice",
    ),
    "a filter of a line": (
        GOOD,
        'disconnected = ["1"]\nevent = [{ at = 1, connect = "1", filter = "discharged" }]',
        "S101",
        "scenario.x.event[0].filter",
        "only a DGU connects with a filter, and this is a line",
    ),
    "a filter of a load": (
        GOOD,
        'disconnected = [{ load = "b" }]\nevent = [{ at = 1, connect = { load = "b" }, filter = "synchronised" }]',
        "S101",
        "scenario.x.event[0].filter",
        "only a DGU connects with a filter, and this is a load",
    ),
    "a filter that disconnects": (
        GOOD,
        'event = [{ at = 1, disconnect = "a", filter = "discharged" }]',
        "S101",
        "scenario.x.event[0].filter",
        "unknown key",
    ),
    "a filter in another state": (
        GOOD,
        'disconnected = ["a"]\nevent = [{ at = 1, connect = "a", filter = "warm" }]',
        "S107",
        "scenario.x.event[0].filter",
        "'warm' is not a choice here; known here: synchronised, discharged",
    ),
    "a reference of no DGU": (
        GOOD,
        'event = [{ at = 1, reference = "b", set = [1, 1] }]',
        "S306",
        "scenario.x.event[0].reference",
        "'b' is not a node with a DGU; known here: a, d",
    ),
    "a reference of no node": (
        GOOD,
        'event = [{ at = 1, reference = "z", set = [1, 1] }]',
        "S306",
        "scenario.x.event[0].reference",
        "'z' is not a node with a DGU",
    ),
    "a reference of zero": (
        GOOD,
        'event = [{ at = 1, reference = "a", set = [0, "0 V"] }]',
        "S208",
        "scenario.x.event[0].set",
        "the reference voltage must not be zero",
    ),
    "a reference of one axis": (
        GOOD,
        'event = [{ at = 1, reference = "a", set = "1 pu" }]',
        "S103",
        "scenario.x.event[0].set",
        "expected a list of two values",
    ),
    "a reference in ampere": (
        GOOD,
        'event = [{ at = 1, reference = "a", set = ["1 A", 0] }]',
        "S203",
        "scenario.x.event[0].set[0]",
        "expected V",
    ),
    "a reference without a value": (
        GOOD,
        'event = [{ at = 1, reference = "a" }]',
        "S102",
        "scenario.x.event[0].set",
        "missing",
    ),
    "an unknown controller": (
        GOOD,
        'event = [{ at = 1, controller = "a", set = "phi" }]',
        "S306",
        "scenario.x.event[0].set",
        "'phi' is not a controller; did you mean 'pi'?",
    ),
    "a controller that is a table": (
        GOOD,
        'event = [{ at = 1, controller = "a", set = { kind = "constant" } }]',
        "S306",
        "scenario.x.event[0].set",
        "a dict is not a controller",
    ),
    "a controller of no DGU": (
        GOOD,
        'event = [{ at = 1, controller = "b", set = "pi" }]',
        "S306",
        "scenario.x.event[0].controller",
        "'b' is not a node with a DGU",
    ),
    "from a linear loop": (
        LOOP,
        'event = [{ at = 1, controller = "a", set = "pi" }]',
        "S315",
        "scenario.x.event[0].set",
        "'pi' is 'state-feedback', and 'loop' is 'linear', which node 'a' has",
    ),
    "to a linear loop": (
        LOOP,
        'event = [{ at = 1, controller = "d", set = "loop" }]',
        "S315",
        "scenario.x.event[0].set",
        "'loop' is 'linear', and 'pi' is 'state-feedback', which node 'd' has",
    ),
    "to a larger linear loop": (
        LOOP,
        'event = [{ at = 1, controller = "a", set = "more" }]',
        "S315",
        "scenario.x.event[0].set",
        "'more' has 3 states, and 'loop' has 2, which node 'a' has",
    ),
    "nothing set": (GOOD, 'event = [{ at = 1, load = "b", set = {} }]', "S102", "scenario.x.event[0].set", "no coef"),
    "loads that are no list": (
        GOOD.replace(LOADS, "load = 5"),
        'event = [{ at = 1, load = "b", set = { Y = [1, 1] } }]',
        "S306",
        "scenario.x.event[0].load",
        "not a node with a load",
    ),
    "two actions": (
        GOOD,
        'event = [{ at = 1, connect = "a", disconnect = "2" }]',
        "S107",
        "scenario.x.event[0]",
        "connect and disconnect are given; expected exactly one of",
    ),
    "no action": (GOOD, "event = [{ at = 1 }]", "S107", "scenario.x.event[0]", "none is given; expected exactly one"),
    "after the end": (GOOD, 'event = [{ at = 8, connect = "a" }]', "S309", "scenario.x.event[0].at", "at 8 s"),
}


@pytest.mark.parametrize("case", REFUSED, ids=str)
def test_scenario_that_is_refused(case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    base, text, code, path, message = REFUSED[case]
    file = tmp_path / "spec.toml"
    file.write_bytes(with_scenario(text, base))
    for more in ([], ["--scenario", "x"]):  # a plain proof refuses it too
        assert main(["prove", str(file), *more]) == 2
        told = capsys.readouterr()
        assert not told.out
        assert f"error[{code}]" in told.err
        assert re.search(rf"{re.escape(str(file))}:\d+: {re.escape(path)}\n  = help: ", told.err)
        assert message in told.err


def test_a_name_of_two_things_matters_only_if_it_is_used() -> None:
    base = GOOD.replace('name = "1"', 'name = "a"')
    assert len(phases_of('event = [{ at = 1, disconnect = "2" }, { at = 2, connect = "2" }]\ndisconnected = []', base))
    base = GOOD.replace('name = "1"', 'name = "b"')  # a node, but without DGU
    with pytest.raises(SpecError, match=r"S304 at node.b: no DGU .* phase 2 of scenario x, 1 s to 8 s"):
        phases_of('event = [{ at = 1, disconnect = "b" }, { at = 1, disconnect = "2" }]', base)


def test_no_false_faults_after_what_cannot_be_read() -> None:
    with pytest.raises(SpecError) as caught:
        phases_of('event = [{ at = "-1 s", disconnect = "a" }, { at = 2, connect = "a" }]', GOOD)
    assert [fault.code for fault in caught.value.faults] == ["S208"]


def test_phases_that_are_no_microgrids_are_all_told_before_anything_is_proved(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("certify.report.scenario.prove", None)
    spec = tmp_path / "spec.toml"
    spec.write_bytes(
        with_scenario(
            """disconnected = ["1"]
event = [{ at = 1, connect = "1" }, { at = 2, disconnect = "d" }, { at = 3, disconnect = "2" }, { at = 4, connect = "d" },
  { at = 5, load = "b", set = { Y = [1, 0] } }]""",
            GOOD,
        )
    )
    folder = tmp_path / "out"
    assert main(["prove", str(spec), "--scenario", "x", "-o", str(folder), "--json"]) == 2
    faults = json.loads(capsys.readouterr().out)["faults"]
    told = [(fault["code"], fault["path"], fault["message"].partition("(")[2]) for fault in faults]
    assert told == [
        ("S305", "node.b", "in phase 1 of scenario x, 0 s to 1 s)"),
        ("S305", "node.d", "in phase 3 of scenario x, 2 s to 3 s and in 1 more)"),
        ("S304", "node.d", "in phase 4 of scenario x, 3 s to 4 s)"),
    ]
    assert not folder.exists()


def test_exponents_that_do_not_go_together_are_found_in_their_phase() -> None:
    with pytest.raises(SpecError, match=r"S102 at node.c.load\[0\]: Q0 and nq go together \(in phase 2 of"):
        phases_of('event = [{ at = "0.25 s", load = "c", set = { Q0 = 100 } }]')


def test_specs_of_all_phases_have_a_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("certify.phases.MAX_TOTAL_BYTES", 3000)
    with pytest.raises(SpecError, match=r"S003 at scenario.x.event"):
        phases_of('event = [{ at = 1, disconnect = "ab" }, { at = 2, connect = "ab" }]')


@pytest.mark.parametrize(
    ("spec", "message"), [(CIGRE, "there are: plug-in"), ("specs/two-inverters.toml", "the spec has none")]
)
def test_unknown_scenario(spec: str, message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["prove", spec, "--scenario", "plugin"]) == 2
    told = capsys.readouterr().err
    assert "error[U002]: 'plugin' is no scenario of this spec" in told
    assert message in told
    assert f"{spec}: --scenario\n  = help" in told


# The command


def test_cigre_is_certified_phase_by_phase(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "out"
    assert main(["prove", CIGRE, "--scenario", "plug-in", "-o", str(folder)]) == 0
    told = capsys.readouterr().out
    assert told.startswith("CERTIFIED: scenario plug-in of specs/cigre-mv.toml, phases: 4")
    for text in ("phase 1, 0 s to 4 s: CERTIFIED", "off: 5", "DGU 5 connects", "load 0 at node 8 changes: I, P, Y"):
        assert text in told
    assert "not a proof" in told
    assert "the phase before having come to rest" in told.replace("\n", " ")
    names = [f"plug-in-{k}{end}" for k in range(1, 5) for end in (".cert.json", ".json")]
    assert sorted(file.name for file in tmp_path.rglob("*") if file.is_file()) == names
    for k in range(1, 5):
        assert main(["check", str(folder / f"plug-in-{k}.json"), str(folder / f"plug-in-{k}.cert.json")]) == 0
    capsys.readouterr()
    (folder / "mine.txt").write_text("kept")
    assert main(["prove", CIGRE, "--scenario", "plug-in", "-o", str(folder)]) == 0  # again, over the old ones
    assert sorted(file.name for file in folder.iterdir()) == ["mine.txt", *names]
    (tmp_path / "other").mkdir()
    assert folder.stat().st_mode == (tmp_path / "other").stat().st_mode
    capsys.readouterr()


def test_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["prove", CIGRE, "--scenario", "plug-in", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["outcome"], result["exit_code"], result["folder"]) == ("certified", 0, None)
    assert [(p["start"], p["end"], p["outcome"], p["off"]) for p in result["phases"]][:2] == [
        ("0", "4", "certified", ["5"]),
        ("4", "5", "certified", []),
    ]
    assert result["phases"][1]["events"] == [
        {"at": "4", "action": "connect", "part": "DGU", "target": "5", "filter": "synchronised"}
    ]
    event = result["phases"][2]["events"][0]
    assert (event["target"], event["index"], event["set"]) == ("5", 0, ["I", "P", "Y"])
    assert result["phases"][0]["jumps"] == []
    assert [jump["island"] for jump in result["phases"][1]["jumps"]] == ["1"]
    assert "not a proof" in result["about_jumps"]
    assert main(["prove", CIGRE, "--scenario", "plug-in", "--json", "-o", str(tmp_path)]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["phases"][3]["certificate"] == "plug-in-4.cert.json"
    assert (tmp_path / result["phases"][3]["spec"]).exists()


def test_the_exit_code_is_the_worst(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """DGU 1 of the printed gains is refuted; without it the network is certified."""
    base = Path(PRINTED).read_text().split("\n[scenario.")[0]
    file = tmp_path / "spec.toml"
    text = 'disconnected = ["1"]\nevent = [{ at = 1, connect = "1" }, { at = 2, disconnect = "1" }]'
    file.write_bytes(with_scenario(text, base))
    folder = tmp_path / "out"
    assert main(["prove", str(file), "--scenario", "x", "-o", str(folder), "--all"]) == 1
    told = capsys.readouterr().out
    assert told.startswith("REFUTED: ")
    assert "phase 1, 0 s to 1 s: CERTIFIED" in told
    assert "phase 2, 1 s to 2 s: REFUTED" in told
    assert "phase 3, 2 s to 8 s: CERTIFIED" in told
    assert "refuted[frequency-witness] dgu/1" in told
    assert "proved  line/23" in told
    codes = [main(["check", str(folder / f"x-{k}.json"), str(folder / f"x-{k}.cert.json")]) for k in (1, 2, 3)]
    assert codes == [0, 1, 0]
    file.write_bytes(with_scenario('disconnected = ["1"]', base))
    assert main(["prove", str(file), "--scenario", "x"]) == 0
    file.write_bytes(with_scenario("", Path("specs/negative/lossless.toml").read_text()))
    assert main(["prove", str(file), "--scenario", "x"]) == 3
    capsys.readouterr()


def test_a_method_that_only_samples_makes_phases_conditional(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "spec.toml"
    file.write_bytes(with_scenario('event = [{ at = 1, disconnect = "a" }]'))
    assert main(["prove", str(file), "--scenario", "x", "--method", "sampled"]) == 3
    told = capsys.readouterr().out
    assert told.startswith("CONDITIONAL")
    assert "within a phase, proved, if what the ledger says of sampled/b" in told


def test_stability_is_said_of_the_phases_that_have_it_only(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With 100 kW instead of its impedance the load at node b is not monotone, so nothing is proved of phase 2."""
    file = tmp_path / "spec.toml"
    change = 'load = "b", set = { Y = [0, 0], P = ["100 kW", 0] }'
    back = 'load = "b", set = { Y = ["10 mS", 0], P = [0, 0] }'
    file.write_bytes(with_scenario(f"event = [{{ at = 1, {change} }}, {{ at = 2, {back} }}]"))
    assert main(["prove", str(file), "--scenario", "x"]) == 1
    told = capsys.readouterr().out
    assert "phase 2, 1 s to 2 s: REFUTED" in told
    assert "within phases 1, 3, proved: every equilibrium" in told
    assert "within a phase" not in told


def test_reuse_does_not_go_with_a_scenario(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["prove", CIGRE, "--scenario", "plug-in", "--reuse", "missing"]) == 2
    assert "error[U001]: does not go with --scenario" in capsys.readouterr().err


def test_a_rejection_in_a_later_phase_writes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    done = []

    def fail_later(spec: bytes, *_: object, **__: object) -> Certificate:
        done.append(spec)
        if len(done) == 3:
            raise Rejected("K201", "dgu/1", "planted")
        return prove(spec)

    monkeypatch.setattr("certify.report.scenario.prove", fail_later)
    assert main(["prove", CIGRE, "--scenario", "plug-in", "-o", str(tmp_path / "out")]) == 4
    assert list(tmp_path.iterdir()) == []
    capsys.readouterr()


def test_phases_that_are_the_same_are_proved_once(monkeypatch: pytest.MonkeyPatch) -> None:
    from certify.report.scenario import prove_phases

    done: list[bytes] = []
    steps: list[tuple[int, int]] = []
    monkeypatch.setattr("certify.report.scenario.prove", lambda spec, *_, **__: done.append(spec) or prove(spec, _[0]))
    spec = with_scenario('event = [{ at = 1, disconnect = "ab" }, { at = 2, connect = "ab" }]')
    proved = prove_phases(spec, read_phases(spec, "x"), lambda count, total: steps.append((count, total)))
    assert len(done) == 2
    assert proved[0].certificate is proved[2].certificate
    assert steps == sorted(steps)
    assert {total for _, total in steps} == {3000}


@pytest.mark.parametrize("target", ["missing/folder", "file", "taken", "spec"])
def test_folders_that_cannot_be_written(
    target: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("certify.report.scenario.prove", None)  # it is told before any work
    (tmp_path / "file").write_text("kept")
    (tmp_path / "taken" / "plug-in-2.json").mkdir(parents=True)
    (tmp_path / "spec").mkdir()
    spec = tmp_path / "spec" / "plug-in-1.json"
    spec.write_bytes(Path(CIGRE).read_bytes())
    before = sorted(tmp_path.rglob("*"))
    assert main(["prove", str(spec), "--scenario", "plug-in", "-o", str(tmp_path / target)]) == 2
    assert "error[U001]: cannot write to the folder" in capsys.readouterr().err
    assert sorted(tmp_path.rglob("*")) == before
    assert spec.read_bytes() == Path(CIGRE).read_bytes()


@pytest.mark.parametrize("there", [False, True], ids=["new", "there"])
@pytest.mark.parametrize("step", ["write_bytes", "rename", "replace"])
def test_nothing_is_half_written(there: bool, step: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "out"
    if there:
        folder.mkdir()
        (folder / "a").write_bytes(b"old")
    calls, real = [], getattr(Path, step)

    def fail(path: Path, *arguments: object) -> object:
        calls.append(path)
        if len(calls) == (2 if step == "write_bytes" else 1):
            raise OSError(28, "No space left on device")
        return real(path, *arguments)

    monkeypatch.setattr(Path, step, fail)
    if step == ("rename" if there else "replace"):
        write_folder(str(folder), {"a": b"1", "b": b"2"})  # not a step of this way
        assert not calls
        return
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(SpecError, match=r"U001 at -o: cannot write to the folder .*: No space left"):
        write_folder(str(folder), {"a": b"1", "b": b"2"})
    assert sorted(tmp_path.rglob("*")) == before
    assert not there or (folder / "a").read_bytes() == b"old"


# How far events throw a microgrid: H of the new phase where the old one rests

Rest = dict[str, complex]  # by the names of facts, without the axis


def currents_of(node: Node, V: complex, w0: float) -> complex:
    """Into the static loads and the series R-L loads of a node."""
    total, v = 0j, abs(V)
    for load in node.loads:
        if isinstance(load, ZipLoad):
            S = sum(complex(*map(float, pair)) * v**e for pair, e in ((load.Y, 2), (load.I, 1), (load.P, 0)))
        elif isinstance(load, ExpLoad):
            x = v / float(load.V0_volt)
            S = complex(float(load.P0_watt) * x ** float(load.np), float(load.Q0_var) * x ** float(load.nq))
        total += (S.conjugate()) / v**2 * V
    return total + sum(V / complex(b.resistance_ohm, w0 * float(b.inductance_henry)) for b in node.branches)


def solve_rest(grid: Microgrid) -> Rest:
    """The equilibrium in floats, from Kirchhoff's laws: V = V* at DGUs, a fixed point of the load currents elsewhere."""
    w0, index = float(grid.w0), {node.name: k for k, node in enumerate(grid.nodes)}
    C = {name: float(c) for name, c in node_capacitances(grid).items()}
    Y = np.zeros((len(index), len(index)), complex)
    for line in grid.lines:
        y = 1 / complex(line.branch.resistance_ohm, w0 * float(line.branch.inductance_henry))
        a, b = index[line.start], index[line.end]
        Y[a, a] += y
        Y[b, b] += y
        Y[a, b] -= y
        Y[b, a] -= y
    V = np.array([complex(*map(float, node.dgu.reference_volt)) if node.dgu else 0 for node in grid.nodes])
    fixed = [index[node.name] for node in grid.nodes if node.dgu]
    free = [index[node.name] for node in grid.nodes if not node.dgu]
    V[free] = V[fixed].mean()
    shunt = np.diag([1j * w0 * C[name] for name in index])
    for _ in range(200):
        load = np.array([currents_of(node, V[index[node.name]], w0) for node in grid.nodes])
        V[free] = np.linalg.solve((Y + shunt)[np.ix_(free, free)], -(Y[np.ix_(free, fixed)] @ V[fixed]) - load[free])
    load = np.array([currents_of(node, V[index[node.name]], w0) for node in grid.nodes])
    into = Y @ V + shunt @ V + load  # what the DGU at a node has to deliver
    assert np.abs(into[free]).max(initial=0) < 1e-6
    rest: Rest = {f"voltage at node {name}": V[k] for name, k in index.items()}
    for line in grid.lines:
        drop = V[index[line.start]] - V[index[line.end]]
        z = complex(line.branch.resistance_ohm, w0 * float(line.branch.inductance_henry))
        rest[f"current in line {line.name}"] = drop / z
    for node in grid.nodes:
        if node.dgu and node.dgu.filter:
            k, own = index[node.name], node.dgu.filter
            rest[f"current of the DGU at node {node.name}"] = into[k]
            z = complex(own.resistance_ohm, w0 * float(own.inductance_henry))
            rest[f"terminal voltage of the DGU at node {node.name}"] = V[k] + z * into[k]
    return rest


def with_claims(
    phase: Phase, rest: Mapping[str, complex], level: Fraction | None, certificate: Certificate | None = None
) -> tuple[Phase, Certificate]:
    """The certificate of a phase as if its verdict had claims about equilibrium and region; no `level` means global."""
    certificate = certificate or prove(phase.spec)
    grid = decode(phase.spec)
    parts = (("d", "real"), ("q", "imag"))
    facts = tuple(
        (f"{name}, {axis}", Fraction(getattr(x, part)), "") for name, x in rest.items() for axis, part in parts
    )
    region = ("global", Fraction(1), "") if level is None else ("level c of the storage", level, "J")
    more: list[Claim] = []
    for island in components((node.name for node in grid.nodes), grid.lines):
        here = tuple(f for f in facts if not f[0].startswith("voltage at") or f[0][16:-3] in island)
        more += [
            Claim(
                f"equilibrium/{island[0]}", "", "proved", "x", (("radius of the proof", Fraction(1, 10**9), "V"), *here)
            ),
            Claim(f"region/{island[0]}", "", "proved", "x", (region, ("limited by node b", Fraction(3), "V"))),
        ]
    own = [claim for claim in certificate.verdict.claims if claim.id.split("/")[0] not in ("equilibrium", "region")]
    verdict = replace(certificate.verdict, claims=(*own, *more))
    return phase, replace(certificate, verdict=verdict)


def storage_of_dgu(node: Node, C: float, V: complex, I: complex, integrator: complex) -> float:  # noqa: E741
    """S of a passive DGU with scalar gains by the closed form of (X, Bm, H), all arguments but C in deviations.

    `integrator` is K13 v~. S = (C|V|^2 + L w' Bm^-1 w + v' X v)/2, w = I - X v, X = -H^-1 K13, Bm = 1 - K11 - L X.
    """
    assert node.dgu
    assert node.dgu.filter
    L, R, law = float(node.dgu.filter.inductance_henry), float(node.dgu.filter.resistance_ohm), node.dgu.controller
    if isinstance(law, IdaPbc):
        alpha, nu, ki = float(law.alpha[0]), float(law.nu[0]), float(law.ki[0])
        X, Bm, K13 = ki, nu, -alpha / nu * ki
    else:
        assert isinstance(law, StateFeedback)
        assert law.K13
        K11, K12, K13 = float(law.K11[0][0]), float(law.K12[0][0]), float(law.K13[0][0])
        X = -K13 / (K12 - R)
        Bm = 1 - K11 - L * X
    v = integrator / K13
    w = I - X * v
    return (C * abs(V) ** 2 + L / Bm * abs(w) ** 2 + X * abs(v) ** 2) / 2


def feedback(node: Node, V: complex, I: complex, w0: float) -> complex:  # noqa: E741
    """K11 V + K12 I."""
    assert node.dgu
    assert node.dgu.filter
    law = node.dgu.controller
    L, R = float(node.dgu.filter.inductance_henry), float(node.dgu.filter.resistance_ohm)
    if isinstance(law, IdaPbc):
        alpha, nu, ki = float(law.alpha[0]), float(law.nu[0]), float(law.ki[0])
        return (1 - nu - ki * L) * V + (alpha / nu + R + 1j * w0 * L) * I
    assert isinstance(law, StateFeedback)
    return float(law.K11[0][0]) * V + complex(law.K12[0][0], law.K12[1][0]) * I


def expected_parts(new: Microgrid, state: Rest, goal: Rest) -> Iterator[tuple[str, float]]:
    """The contributions to H; `state` has "integrator of NODE", K13 v + const, for DGUs."""
    w0, C = float(new.w0), {name: float(c) for name, c in node_capacitances(new).items()}
    for node in new.nodes:
        V = state[f"voltage at node {node.name}"] - goal[f"voltage at node {node.name}"]
        if node.dgu:
            at_rest = [goal[f"{what} at node {node.name}"] for what in ("voltage", "current of the DGU")]
            u = goal[f"terminal voltage of the DGU at node {node.name}"]
            kept = u - feedback(node, at_rest[0], at_rest[1], w0)
            I = state[f"current of the DGU at node {node.name}"] - at_rest[1]  # noqa: E741
            integrator = state[f"integrator of {node.name}"] - kept
            yield f"DGU at node {node.name}", storage_of_dgu(node, C[node.name], V, I, integrator)
        else:
            yield f"node {node.name}", C[node.name] * abs(V) ** 2 / 2
        for k, branch in enumerate(node.branches):
            L = float(branch.inductance_henry)
            I = state[f"branch {node.name} {k}"] - goal[f"branch {node.name} {k}"]  # noqa: E741
            yield f"series R-L load {k} at node {node.name}", L * abs(I) ** 2 / 2
    for line in new.lines:
        I = state[f"current in line {line.name}"] - goal[f"current in line {line.name}"]  # noqa: E741
        yield f"line {line.name}", float(line.branch.inductance_henry) * abs(I) ** 2 / 2


def completed(grid: Microgrid, rest: Rest) -> Rest:
    """With the integrators of DGUs and the currents of series R-L loads."""
    more, w0 = dict(rest), float(grid.w0)
    for node in grid.nodes:
        V = rest[f"voltage at node {node.name}"]
        for k, b in enumerate(node.branches):
            more[f"branch {node.name} {k}"] = V / complex(b.resistance_ohm, w0 * float(b.inductance_henry))
        if node.dgu:
            u = rest[f"terminal voltage of the DGU at node {node.name}"]
            more[f"integrator of {node.name}"] = u - feedback(
                node, V, rest[f"current of the DGU at node {node.name}"], w0
            )
    return more


def jump_between(spec: bytes, phases: tuple[Phase, ...], k: int, rests: list[Rest], level: Fraction | None) -> Jump:
    pair = [with_claims(phase, rest, level) for phase, rest in zip(phases[k : k + 2], rests[k : k + 2], strict=True)]
    (jump,) = find_jumps(decode(spec), *pair)
    return jump


def test_cigre_plug_in() -> None:
    """Connecting DGU 5: H by closed forms, from equilibria and a synchronised DGU that are computed here."""
    spec = read(CIGRE)
    phases = read_phases(spec, "plug-in")
    grids = [decode(phase.spec) for phase in phases]
    rests = [solve_rest(grid) for grid in grids]
    node = next(node for node in grids[1].nodes if node.name == "5")
    assert node.dgu
    assert node.dgu.filter
    w0, own = float(grids[0].w0), node.dgu.filter
    state = completed(grids[0], rests[0])
    V = state["voltage at node 5"]
    I = 1j * w0 * float(own.capacitance_farad) * V  # noqa: E741
    u = V + complex(own.resistance_ohm, w0 * float(own.inductance_henry)) * I
    state |= {"current of the DGU at node 5": I, "integrator of 5": u - feedback(node, V, I, w0)}
    expected = dict(expected_parts(grids[1], state, completed(grids[1], rests[1])))
    jump = jump_between(spec, phases, 0, rests, Fraction(10**6))
    assert jump.storage_joule is not None
    assert jump.island == "1"
    assert float(jump.storage_joule) == pytest.approx(sum(expected.values()), rel=1e-9)
    assert {name: float(x) for name, x in jump.parts} == pytest.approx(expected, rel=1e-6, abs=1e-9)
    assert jump.parts[0][0] == "DGU at node 5"
    assert jump.status == ("inside" if jump.storage_joule < 10**6 else "outside")
    assert jump.share == jump.storage_joule / 10**6
    # load steps are far smaller
    for k, name in ((1, "5"), (2, "8")):
        step = jump_between(spec, phases, k, rests, Fraction(10**6))
        wanted = sum(x for _, x in expected_parts(grids[k + 1], *(completed(grids[m], rests[m]) for m in (k, k + 1))))
        assert step.storage_joule is not None
        assert float(step.storage_joule) == pytest.approx(wanted, rel=1e-6), name
        assert step.storage_joule < jump.storage_joule / 1000
        assert step.status == "inside"


def test_by_hand() -> None:
    """Two nodes; rest states that are easy, whether or not they are equilibria."""
    base = SMALL[: SMALL.index("[node.c]")] + SMALL[SMALL.index("[[line]]") : SMALL.rindex("[[line]]")]
    base = base.replace(', { kind = "rl", R = 30, L = "50 mH" }', "")
    spec = with_scenario('event = [{ at = 1, load = "b", set = { Y = [0.02, 0] } }]', base)
    phases = read_phases(spec, "x")
    old = {
        "voltage at node a": 400,
        "voltage at node b": 400,
        "current in line ab": 4,
        "current of the DGU at node a": 3,
    }
    new = {"voltage at node a": 400, "voltage at node b": 398 - 1j, "current in line ab": 6 + 2j, "current of the DGU at node a": 5}  # fmt: skip
    key = "terminal voltage of the DGU at node a"
    # u~ = K12 I~ + K13 v~ with K12 = -5 + 0.1 + j w0 L (this part is put into u), K13 = 500, so v~ = -0.02 for:
    w0L = decode(spec).w0 * Fraction(2, 1000)
    old[key], new[key] = 0, 0
    pair = [with_claims(p, r, Fraction(1)) for p, r in zip(phases, (old, new), strict=True)]
    claims = list(pair[1][1].verdict.claims)
    # I~ = -2: u~ = -2 (-4.9 + j w0 L) + 500 (-0.02) = -0.2 - 2 j w0 L, so the new u is 0.2 + 2 j w0 L: exactly.
    exact = {f"{key}, d": Fraction(1, 5), f"{key}, q": 2 * w0L}
    k = next(k for k, claim in enumerate(claims) if claim.id == "equilibrium/a")
    facts = tuple((name, exact.get(name, x), unit) for name, x, unit in claims[k].facts)
    claims[k] = replace(claims[k], facts=facts)
    verdict = replace(pair[1][1].verdict, claims=tuple(claims))
    (jump,) = find_jumps(decode(spec), pair[0], (phases[1], replace(pair[1][1], verdict=verdict)))
    # node b: C = 2 uF, |2 + j|^2 = 5; line: L = 1 mH, |-2 - 2j|^2 = 8; DGU: w = I~ - ki v~ = -2 + 2 = 0, so only
    # X |v~|^2 / 2 = 100 * 0.0004 / 2 is left.
    parts = {"node b": Fraction(5, 10**6), "line ab": Fraction(4, 1000), "DGU at node a": Fraction(2, 100)}
    assert dict(jump.parts) == parts
    assert jump.parts[0][0] == "DGU at node a"
    assert jump.storage_joule is not None
    assert abs(jump.storage_joule - sum(parts.values())) < Fraction(1, 10**50)
    assert (jump.status, jump.level_joule) == ("inside", 1)


def test_nothing_changes() -> None:
    spec = with_scenario('event = [{ at = 1, load = "b", set = { Y = ["10 mS", 0] } }]')
    phases = read_phases(spec, "x")
    rest = solve_rest(decode(spec))
    jump = jump_between(spec, phases, 0, [rest, rest], Fraction(1))
    assert (jump.storage_joule, jump.share, jump.status) == (0, 0, "inside")


def test_a_line_connects_discharged() -> None:
    """Charge is conserved at both ends, and integrators do not jump with the voltage."""
    spec = with_scenario('disconnected = ["bc"]\nevent = [{ at = 1, connect = "bc" }]')
    phases = read_phases(spec, "x")
    grids = [decode(phase.spec) for phase in phases]
    rests = [solve_rest(grid) for grid in grids]
    state = completed(grids[0], rests[0]) | {"current in line bc": 0}
    before, after = (node_capacitances(grid) for grid in grids)
    for name in "bc":
        state[f"voltage at node {name}"] *= float(before[name] / after[name])
    assert abs(state["voltage at node b"]) == pytest.approx(abs(rests[0]["voltage at node b"]) * 2 / 3)
    expected = dict(expected_parts(grids[1], state, completed(grids[1], rests[1])))
    jump = jump_between(spec, phases, 0, rests, Fraction(1, 100))
    assert {name: float(x) for name, x in jump.parts} == pytest.approx(expected, rel=1e-6, abs=1e-12)
    assert "series R-L load 0 at node b" in dict(jump.parts)
    assert jump.status == "outside"
    assert jump.share is not None
    assert jump.share > 1


def test_what_disconnects_takes_its_states_along() -> None:
    spec = with_scenario('event = [{ at = 1, disconnect = "a" }]')
    phases = read_phases(spec, "x")
    grids = [decode(phase.spec) for phase in phases]
    rests = [solve_rest(grid) for grid in grids]
    expected = dict(expected_parts(grids[1], completed(grids[0], rests[0]), completed(grids[1], rests[1])))
    jump = jump_between(spec, phases, 0, rests, None)
    assert {name: float(x) for name, x in jump.parts} == pytest.approx(expected, rel=1e-6, abs=1e-12)
    assert "node a" in expected
    assert (jump.status, jump.level_joule, jump.share, jump.everything) == ("inside", None, None, True)


def law_of(node: Node, w0: float) -> tuple[complex, Callable[[complex, complex, complex], complex]]:
    """K13, and the law u(V, I, v) of a DGU with scalar gains, in absolute values; v is the integral of V* - V."""
    assert node.dgu
    assert node.dgu.filter
    law, reference = node.dgu.controller, complex(*map(float, node.dgu.reference_volt))
    if isinstance(law, IdaPbc):
        alpha, nu, ki, own = float(law.alpha[0]), float(law.nu[0]), float(law.ki[0]), law.design
        R, L, C = (float(x) for x in (own.resistance_ohm, own.inductance_henry, own.capacitance_farad))

        def shaped(V: complex, I: complex, v: complex) -> complex:  # noqa: E741
            off = V - reference
            damped = alpha / nu * (I - 1j * w0 * C * reference - ki * v)
            return damped - nu * off + (R + 1j * w0 * L) * I + V - L * ki * off

        return -alpha / nu * ki, shaped
    assert isinstance(law, StateFeedback)
    K13 = float(law.K13[0][0]) if law.K13 else 0.0
    return K13, lambda V, I, v: feedback(node, V, I, w0) + K13 * v  # noqa: E741


def integral_of(node: Node, rest: Mapping[str, complex], w0: float) -> complex:
    """The state v of an integrator at rest."""
    gain, law = law_of(node, w0)
    V, I = (rest[f"{what} at node {node.name}"] for what in ("voltage", "current of the DGU"))  # noqa: E741
    return (rest[f"terminal voltage of the DGU at node {node.name}"] - law(V, I, 0)) / gain


def nodes_of(grid: Microgrid) -> dict[str, Node]:
    return {node.name: node for node in grid.nodes}


def compared(spec: bytes, change: Callable[[Rest, list[dict[str, Node]], list[Microgrid]], object]) -> Jump:
    """The jump at the start of phase 2 against closed forms, for the state that `change` makes of rest in phase 1."""
    phases = read_phases(spec, "x")[:2]
    grids = [decode(phase.spec) for phase in phases]
    rests = [solve_rest(grid) for grid in grids]
    state = completed(grids[0], rests[0])
    change(state, [nodes_of(grid) for grid in grids], grids)
    expected = dict(expected_parts(grids[1], state, completed(grids[1], rests[1])))
    jump = jump_between(spec, phases, 0, rests, Fraction(10**6))
    assert {name: float(x) for name, x in jump.parts} == pytest.approx(expected, rel=1e-6, abs=1e-9)
    assert max(expected.values()) > 1e-4
    return jump


def test_a_dgu_connects_discharged() -> None:
    """Its capacitor shares the charge of its node, and nothing flows; here its reference was changed while it was off."""
    spec = with_scenario(
        'disconnected = ["a"]\nevent = [{ at = 1, reference = "a", set = [380, 5] },'
        ' { at = 1, connect = "a", filter = "discharged" }]'
    )

    def change(state: Rest, nodes: list[dict[str, Node]], grids: list[Microgrid]) -> None:
        before, after = (float(node_capacitances(grid)["a"]) for grid in grids)
        assert (before, after) == (pytest.approx(2e-6), pytest.approx(22e-6))
        state["voltage at node a"] *= before / after
        state["current of the DGU at node a"] = 0
        state["integrator of a"] = law_of(nodes[1]["a"], float(grids[1].w0))[1](0, 0, 0)
        assert state["integrator of a"] != 0  # of an IDA-PBC law the reference adds to what it asks for

    compared(spec, change)


def test_a_dgu_connects_synchronised_to_what_it_was_set_to_while_it_was_off() -> None:
    spec = with_scenario(
        'disconnected = ["c"]\nevent = [{ at = 0, reference = "c", set = [380, 5] },'
        ' { at = 0, controller = "c", set = "phs" }, { at = 1, connect = "c", filter = "synchronised" }]'
    )

    def change(state: Rest, nodes: list[dict[str, Node]], grids: list[Microgrid]) -> None:
        node, V, w0 = nodes[1]["c"], state["voltage at node c"], float(grids[1].w0)
        I = 1j * w0 * 20e-6 * V  # noqa: E741
        u = V + (0.1 + 1j * w0 * 2e-3) * I
        state |= {"current of the DGU at node c": I, "integrator of c": u - feedback(node, V, I, w0)}

    compared(spec, change)


@pytest.mark.parametrize("name", ["a", "c"])
def test_with_a_new_reference_no_state_jumps(name: str) -> None:
    """Nor does the integrator, though the same integrator means another voltage to an IDA-PBC law."""
    spec = with_scenario(f'event = [{{ at = 1, reference = "{name}", set = [396, -7] }}]')

    def change(state: Rest, nodes: list[dict[str, Node]], grids: list[Microgrid]) -> None:
        w0 = float(grids[0].w0)
        v = integral_of(nodes[0][name], state, w0)
        state[f"integrator of {name}"] = law_of(nodes[1][name], w0)[1](0, 0, v)

    compared(spec, change)


@pytest.mark.parametrize(("name", "new"), [("a", "pi"), ("c", "phs")])
def test_a_new_controller_takes_over_the_voltage(name: str, new: str) -> None:
    spec = with_scenario(
        f'event = [{{ at = 1, controller = "{name}", set = "{new}" }}, {{ at = 1, load = "b", set = {{ Y = [0.02, 0] }} }}]'
    )

    def change(state: Rest, nodes: list[dict[str, Node]], grids: list[Microgrid]) -> None:
        V, I = (state[f"{what} at node {name}"] for what in ("voltage", "current of the DGU"))  # noqa: E741
        u = state[f"terminal voltage of the DGU at node {name}"]
        state[f"integrator of {name}"] = u - feedback(nodes[1][name], V, I, float(grids[0].w0))

    compared(spec, change)


def test_a_new_controller_of_the_same_gains_changes_nothing() -> None:
    base = SMALL.replace(
        "[controller.pi]", '[controller.twin]\nkind = "ida-pbc"\nalpha = -5\nnu = 1\nki = 100\n[controller.pi]'
    )
    spec = with_scenario('event = [{ at = 1, controller = "a", set = "twin" }]', base)
    phases = read_phases(spec, "x")
    rest = solve_rest(decode(spec))
    jump = jump_between(spec, phases, 0, [rest, rest], Fraction(1))
    assert jump.storage_joule == 0


def test_events_at_one_time_act_one_after_another() -> None:
    """The reference first, so that the law that hands over is the old one with the new reference; and the other way."""
    change = ['{ at = 1, reference = "a", set = [396, -7] }', '{ at = 1, controller = "a", set = "pi" }']
    for order in (change, change[::-1]):
        spec = with_scenario(f"event = [{', '.join(order)}]")

        def states(
            state: Rest, nodes: list[dict[str, Node]], grids: list[Microgrid], first: bool = order is change
        ) -> None:
            w0 = float(grids[0].w0)
            V, I = (state[f"{what} at node a"] for what in ("voltage", "current of the DGU"))  # noqa: E741
            v, u = integral_of(nodes[0]["a"], state, w0), state["terminal voltage of the DGU at node a"]
            if first:
                assert nodes[0]["a"].dgu
                turned = replace(nodes[0]["a"].dgu, reference_volt=(Fraction(396), Fraction(-7)))
                u = law_of(replace(nodes[0]["a"], dgu=turned), w0)[1](V, I, v)
            state["integrator of a"] = u - feedback(nodes[1]["a"], V, I, w0)

        compared(spec, states)


def test_what_is_applied_ends_at_the_limits() -> None:
    """A line connects, the voltage drops, and the law asks for more than the inverter has when another takes over."""
    base = SMALL.replace("reference = [390, -10]", "reference = [390, -10], limits = [420, 430]")
    text = 'disconnected = ["bc"]\nevent = [{ at = 1, connect = "bc" }, { at = 1, controller = "c", set = "phs" }]'
    base = base.replace("ki = 1000 }", "ki = 1000 }").replace('C = "2 uF"', 'C = "30 uF"')
    seen = []

    def change(state: Rest, nodes: list[dict[str, Node]], grids: list[Microgrid]) -> None:
        w0 = float(grids[0].w0)
        v = integral_of(nodes[0]["c"], state, w0)
        before, after = (node_capacitances(grid) for grid in grids)
        for name in "bc":
            state[f"voltage at node {name}"] *= float(before[name] / after[name])
        state["current in line bc"] = 0
        V, I = (state[f"{what} at node c"] for what in ("voltage", "current of the DGU"))  # noqa: E741
        asked = law_of(nodes[0]["c"], w0)[1](V, I, v)
        u = complex(min(max(asked.real, -420), 420), min(max(asked.imag, -430), 430))
        seen.append(u != asked)
        state["integrator of c"] = u - feedback(nodes[1]["c"], V, I, w0)

    compared(with_scenario(text, base), change)
    assert seen == [True]


def test_an_integrator_that_cannot_take_over_is_not_known_and_none_is_needed_without() -> None:
    for gain, known in (("[[1, 2], [2, 4]]", False), (None, True)):
        K13 = f"K13 = {gain}\n" if gain else ""
        law = f'[controller.other]\nkind = "state-feedback"\nK11 = 0\nK12 = -5\n{K13}[controller.pi]'
        spec = with_scenario(
            'event = [{ at = 1, controller = "a", set = "other" }]', SMALL.replace("[controller.pi]", law)
        )
        phases = read_phases(spec, "x")
        rest = solve_rest(decode(spec))
        jump = jump_between(spec, phases, 0, [rest, rest], Fraction(1))
        assert (jump.storage_joule == 0) == known
        assert jump.reason == ("" if known else "the state of the DGU at node a is not known")
    # and a law without integrator hands over what it asks for
    back = 'event = [{ at = 0, controller = "a", set = "other" }, { at = 1, controller = "a", set = "phs" }]'
    spec = with_scenario(back, SMALL.replace("[controller.pi]", law))
    phases = read_phases(spec, "x")
    u = 2.0 - 5 * (3 + 1j)  # K11 V + K12 I + no integrator, of states that are no equilibrium
    law2 = law.replace("K11 = 0", "K11 = [[0.005, 0], [0, 0.005]]")
    spec = with_scenario(back, SMALL.replace("[controller.pi]", law2))
    phases = read_phases(spec, "x")
    old = rest | {
        "voltage at node a": 400,
        "current of the DGU at node a": 3 + 1j,
        "terminal voltage of the DGU at node a": u,
    }
    # where the new phase rests with just this voltage applied, nothing jumps
    jump = jump_between(spec, phases, 0, [old, old], Fraction(1))
    assert jump.storage_joule is not None
    assert jump.storage_joule < Fraction(1, 10**20)


def test_series_loads_connect_without_current_and_keep_it_when_they_change() -> None:
    """Indices are those of the spec, also where the claims of a phase count otherwise."""
    spec = with_scenario(
        """disconnected = [{ load = "b", index = 1 }]
event = [{ at = 1, connect = { load = "b", index = 1 } }, { at = 1, load = "b", index = 3, set = { R = 55, L = "90 mH" } },
  { at = 1, disconnect = { load = "b", index = 2 } }]""",
        MANY,
    )

    def change(state: Rest, nodes: list[dict[str, Node]], grids: list[Microgrid]) -> None:
        assert [len(found["b"].branches) for found in nodes] == [1, 2]
        kept = state.pop("branch b 0")
        assert kept == pytest.approx(state["voltage at node b"] / complex(40, float(grids[0].w0) * 0.08))
        state |= {"branch b 0": 0, "branch b 1": kept}

    jump = compared(spec, change)
    assert {"series R-L load 0 at node b", "series R-L load 1 at node b"} <= {name for name, _ in jump.parts}


def test_series_loads_that_disconnect_take_their_current_along() -> None:
    spec = with_scenario('event = [{ at = 1, disconnect = { load = "b", index = 1 } }]', MANY)

    def change(state: Rest, nodes: list[dict[str, Node]], _: list[Microgrid]) -> None:
        assert [len(found["b"].branches) for found in nodes] == [2, 1]
        state["branch b 0"] = state.pop("branch b 1")

    compared(spec, change)
    # off and on again at once: without current
    spec = with_scenario(
        'event = [{ at = 1, disconnect = { load = "b", index = 1 } }, { at = 1, connect = { load = "b", index = 1 } }]',
        MANY,
    )
    compared(spec, lambda state, *_: state.update({"branch b 0": 0}))


def test_events_in_words(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "spec.toml"
    file.write_bytes(
        with_scenario("""disconnected = ["c", { load = "b", index = 1 }]
event = [
  { at = 1, connect = "c", filter = "discharged" },
  { at = 1, connect = { load = "b", index = 1 } },
  { at = 1, load = "b", index = 1, set = { R = 31 } },
  { at = 2, reference = "a", set = ["401 V", 0.5] },
  { at = 2, controller = "c", set = "phs" },
]""")
    )
    assert main(["prove", str(file), "--scenario", "x"]) in (0, 3)
    told = capsys.readouterr().out
    for text in (
        "  off: c, load 1 at node b\n",
        "  DGU c connects, its filter discharged\n  load 1 at node b connects\n  load 1 at node b changes: R\n",
        "  DGU a gets another reference: 401 V, 0.5 V\n  DGU c gets another controller: phs\n",
    ):
        assert text in told
    assert "H = " in told
    main(["prove", str(file), "--scenario", "x", "--json"])
    phases = json.loads(capsys.readouterr().out)["phases"]
    assert phases[0]["off"] == ["c", "load 1 at node b"]
    assert [{k: v for k, v in e.items() if k != "at"} for phase in phases for e in phase["events"]] == [
        {"action": "connect", "part": "DGU", "target": "c", "filter": "discharged"},
        {"action": "connect", "part": "load", "target": "b", "index": 1},
        {"action": "load", "part": "load", "target": "b", "index": 1, "set": ["R"]},
        {"action": "reference", "part": "DGU", "target": "a", "set": ["401", "1/2"]},
        {"action": "controller", "part": "DGU", "target": "c", "set": "phs"},
    ]


def test_islands_are_told_apart_and_a_missing_one_is_unknown() -> None:
    spec = with_scenario('event = [{ at = 1, disconnect = "bc" }, { at = 2, connect = "bc" }]')
    phases = read_phases(spec, "x")
    rests = [solve_rest(decode(phase.spec)) for phase in phases]
    proved = [with_claims(phase, rest, Fraction(10**6)) for phase, rest in zip(phases, rests, strict=True)]
    apart = find_jumps(decode(spec), *proved[:2])
    assert [(jump.island, jump.status) for jump in apart] == [("a", "inside"), ("c", "inside")]
    assert {name for jump in apart for name, _ in jump.parts} == {
        "DGU at node a",
        "node b",
        "series R-L load 0 at node b",
        "line ab",
        "DGU at node c",
    }
    phase, certificate = proved[1]

    def without(name: str) -> tuple[Phase, Certificate]:
        claims = tuple(c if c.id != name else replace(c, status="unknown") for c in certificate.verdict.claims)
        return phase, replace(certificate, verdict=replace(certificate.verdict, claims=claims))

    apart = find_jumps(decode(spec), proved[0], without("equilibrium/c"))
    assert [(jump.status, jump.reason) for jump in apart] == [
        ("inside", ""),
        ("unknown", "phase 2 has no proved equilibrium there"),
    ]
    apart = find_jumps(decode(spec), proved[0], without("region/a"))
    assert [(jump.status, jump.reason) for jump in apart] == [
        ("unknown", "phase 2 has no proved region there"),
        ("inside", ""),
    ]
    assert apart[0].storage_joule is not None
    (together,) = find_jumps(decode(spec), without("equilibrium/c"), proved[2])
    assert (together.status, together.reason) == ("unknown", "phase 2 has no proved equilibrium there")


def test_a_shortage_has_its_own_storage_matrix() -> None:
    """Of a controller that assumes another L; P = D P0 D + c E, D = diag(c, c, 1, ..), E = diag(1, 1, 0, ..)."""
    base = SMALL.replace("ki = 100\n", 'ki = 100\ndesign = { L = "1.99 mH" }\n')
    spec = with_scenario('event = [{ at = 1, disconnect = "ab" }, { at = 2, connect = "ab" }]', base)
    phases = read_phases(spec, "x")
    grids = [decode(phase.spec) for phase in phases]
    rests = [solve_rest(grid) for grid in grids]
    certificate = json.loads(prove(phases[2].spec).data)
    claim = next(claim for claim in certificate["claims"] if claim["id"] == "dgu/a")
    assert claim["rule"] == "index-storage"
    rows = certificate["proofs"][claim["proof"]]["storage"]
    P0 = np.array([[float(Fraction(x)) for x in row.split(" ")] for row in rows])
    before, after = (float(node_capacitances(grid)["a"]) for grid in grids[1:])
    D = np.diag([after, after, 1, 1, 1, 1])
    P = D @ P0 @ D + np.diag([after, after, 0, 0, 0, 0])
    old, new = completed(grids[1], rests[1]), completed(grids[2], rests[2])
    V = old["voltage at node a"] * before / after - new["voltage at node a"]
    I = old["current of the DGU at node a"] - new["current of the DGU at node a"]  # noqa: E741
    K12 = -5 + 0.1 + 1j * float(grids[2].w0) * 0.00199  # alpha / nu + R + j w0 L, with the L of the design
    K11 = -100 * 0.00199  # 1 - nu - ki L
    kept = [
        rest["terminal voltage of the DGU at node a"]
        - K11 * rest["voltage at node a"]
        - K12 * rest["current of the DGU at node a"]
        for rest in (old, new)
    ]
    v = (kept[0] - kept[1]) / 500
    x = np.array([part for z in (V, I, v) for part in (z.real, z.imag)])
    jump = jump_between(spec, phases, 1, rests, Fraction(10**6))
    assert float(dict(jump.parts)["DGU at node a"]) == pytest.approx(x @ P @ x / 2, rel=1e-6)


def test_a_linear_loop_has_a_state_that_is_not_known() -> None:
    text = json.loads(Path("specs/custom-loop.json").read_text())
    text["scenario"] = {"x": {"end": 2, "event": []}}
    spec = json.dumps(text).encode()
    (phase,) = read_phases(spec, "x")
    grid = decode(spec)
    rest = {f"voltage at node {node.name}": 1 for node in grid.nodes} | {
        f"current in line {line.name}": 1 for line in grid.lines
    }
    pair = with_claims(phase, rest, Fraction(1))
    for jump in find_jumps(grid, pair, pair):
        assert jump.status == "unknown"
        assert "the state of the DGU at node" in jump.reason


def test_the_report_tells_jumps(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def pretend(spec: bytes, *_: object, **__: object) -> Certificate:
        phase = Phase(1, Fraction(0), Fraction(1), (), (), spec)
        return with_claims(phase, solve_rest(decode(spec)), Fraction(2500))[1]

    monkeypatch.setattr("certify.report.scenario.prove", pretend)
    assert main(["prove", CIGRE, "--scenario", "plug-in", "--json"]) == 0
    (jump,) = json.loads(capsys.readouterr().out)["phases"][2]["jumps"]
    assert (jump["status"], jump["level"], jump["reason"]) == ("inside", "2500", None)
    assert Fraction(jump["storage"]) / 2500 == Fraction(jump["share"])
    assert jump["largest"]["part"].startswith(("line ", "DGU at node ", "node "))
    assert main(["prove", CIGRE, "--scenario", "plug-in"]) == 0
    told = capsys.readouterr().out
    assert "of c = 2500 J (" in told
    assert "; most of it: DGU at node 5, " in told
