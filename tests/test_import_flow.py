"""Imports against the source's own power flow, by an admittance matrix of the spec's numbers: what random networks
found."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from copy import deepcopy
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest

from certify.importing import Placement, Settings, to_spec
from certify.importing.opendss.circuit import to_circuit
from certify.importing.opendss.engine import Session
from certify.importing.opendss.read import to_network
from certify.importing.pandapower.file import NOT_PLAIN, clean_document, import_pandapower, to_net
from certify.kernel.errors import SpecError
from tests.flow_oracle import flow
from tests.pandapower_oracle import clean_json, imported, quiet

GRID = Placement(kinds=("ext-grid",))
BEHIND = Settings(bus_capacitance=Fraction(1, 10**15))  # too little to show
Change = Callable[[Any, Any], Any]


@pytest.fixture(scope="module")
def small() -> Any:
    """A feeder with a transformer that draws without load, between two lines that are closed to a loop."""

    def make() -> Any:
        pp = import_pandapower()
        net = pp.create_empty_network()
        a, b, c = pp.create_buses(net, 3, 20.0)
        d, e = pp.create_buses(net, 2, 0.4)
        pp.create_ext_grid(net, a, vm_pu=1.01)
        for start, end in ((a, b), (b, c)):
            pp.create_line_from_parameters(net, start, end, 8.0, 0.2, 0.3, 200.0, 1.0, g_us_per_km=2.0)
        pp.create_line_from_parameters(net, d, e, 0.1, 0.2, 0.08, 200.0, 1.0)
        for high, low in ((b, d), (c, e)):
            pp.create_transformer_from_parameters(
                net, high, low, 0.63, 20.5, 0.41, 1.1, 6.0, 1.2, 0.5, shift_degree=150, tap_side="hv", tap_neutral=0,
                tap_pos=2, tap_step_percent=2.5, tap_changer_type="Ratio", parallel=2,
            )  # fmt: skip
        pp.create_load(net, b, 1.0, 0.5)
        pp.create_load(net, e, 0.1, 0.05, scaling=0.8)
        pp.create_shunt(net, c, -0.1, 0.01, step=2)
        return net

    return quiet(make)


def off(net: Any) -> float:
    """Largest difference between voltages of the spec and of pandapower, as a share; only in size."""
    network, draft = imported(net, GRID, BEHIND)
    ours = flow(draft.microgrid)
    nominal = {bus.name: float(bus.nominal_volt) for bus in network.buses}
    factor = {name: float(level.factor) for level in draft.levels for name in level.buses}
    options = {"trafo_model": "pi", "calculate_voltage_angles": True, "tolerance_mva": 1e-11, "numba": False}
    quiet(lambda: import_pandapower().runpp(net, **options))
    theirs = {network.aliases[str(k)]: v for k, v in net.res_bus.vm_pu.items() if not math.isnan(v)}
    assert theirs.keys() <= ours.keys()
    return max(abs(abs(ours[n]) / (nominal[n] * factor[n]) / v - 1) for n, v in theirs.items())


@pytest.mark.parametrize(
    "change",
    [
        lambda _, net: net,
        lambda pp, net: pp.create_switch(net, net.trafo.lv_bus[0], 0, "t", closed=False),
        lambda pp, net: pp.create_switch(net, net.trafo.hv_bus[0], 0, "t", closed=False),
        lambda pp, net: [
            pp.create_switch(net, net.trafo[side][0], 0, "t", closed=False) for side in ("hv_bus", "lv_bus")
        ],
        lambda _, net: net.trafo.__setitem__("tap_pos", math.nan),
    ],
    ids=["as it is", "open at the low side", "open at the high side", "open at both", "no tap position"],
)
def test_the_spec_flows_as_pandapower_does(small: Any, change: Change) -> None:
    """A transformer that is open at one side still draws what magnetises it from the other."""
    net = deepcopy(small)
    change(import_pandapower(), net)
    assert off(net) < 1e-9


@pytest.mark.parametrize(
    ("table", "column"),
    [
        ("load", "q_mvar"),
        ("load", "scaling"),
        ("load", "const_z_p_percent"),
        ("line", "c_nf_per_km"),
        ("line", "g_us_per_km"),
        ("line", "parallel"),
        ("trafo", "i0_percent"),
        ("trafo", "shift_degree"),
        ("shunt", "step"),
    ],
)
def test_an_empty_cell_is_no_value(small: Any, table: str, column: str) -> None:
    """pandapower computes nothing then; nor is there a spec with zero or one in its place."""
    net = deepcopy(small)
    net[table].loc[0, column] = math.nan
    with pytest.raises(SpecError) as caught:
        imported(net, GRID, BEHIND)
    assert {(f.code, f.path) for f in caught.value.faults} == {("I003", f"{table}[0].{column}")}


@pytest.mark.parametrize("column", ["q_mvar", "scaling"])
def test_a_column_that_pandapower_needs_is_no_default(small: Any, column: str) -> None:
    net = deepcopy(small)
    del net.load[column]
    with pytest.raises(SpecError, match="the number is missing"):
        imported(net, GRID, BEHIND)


def test_a_list_in_a_cell_is_a_fault_of_that_cell(small: Any) -> None:
    """Its column was passed over once, and all loads had the default of it."""
    document = clean_json(small)
    table = document["_object"]["load"]
    cells = json.loads(table["_object"])
    cells["data"][1][cells["columns"].index("const_z_p_percent")] = [50]
    table["_object"] = json.dumps(cells)
    with pytest.raises(SpecError) as caught:
        imported(to_net(clean_document(document)), GRID, BEHIND)
    (fault,) = caught.value.faults
    assert (fault.code, fault.path) == ("I003", "load[1].const_z_p_percent")
    assert NOT_PLAIN[:12] in fault.message


def test_options_without_effect_are_told(small: Any) -> None:
    net = deepcopy(small)
    settings = Settings(line_capacitance=Fraction(1, 10**11), bus_capacitance=Fraction(1, 10**9))
    _, draft = imported(net, GRID, settings)
    told = " ".join(note.text for note in draft.notes)
    assert "--line-capacitance has no effect" in told
    assert "--bus-capacitance has no effect" in told


def test_a_bus_means_one(small: Any) -> None:
    net = deepcopy(small)
    net.bus["name"] = ["x", "x", "0", "1", ""]
    network, draft = imported(net, Placement(buses=("1", "4")), BEHIND)
    assert any("--dgu 1 is the index of this bus; it is the name of bus 3" in note.text for note in draft.notes)
    for references, says in (
        ({"x": Fraction(1)}, "a name of 2 buses"),
        ({"1": Fraction(1), network.aliases["1"]: Fraction(2)}, "a name of 2 buses|twice for bus"),
    ):
        with pytest.raises(SpecError, match=says):
            to_spec(network, Settings(bus_capacitance=Fraction(1, 10**15), references=references))


# OpenDSS

HEAD = """clear
new circuit.c basekv=0.4 bus1=src r1=0 x1=1e-9 r0=0 x0=1e-9
new line.l bus1=src bus2=b r1=0.01 x1=0.01 c1=100 length=1 units=km
"""


def read(text: str, folder: Path) -> dict[str, Any]:
    path = folder / "c.dss"
    path.write_text(HEAD + text)
    session = Session()
    session.run_file(path, "", folder)
    assert session.faults == []
    return {"circuit": session.circuit()}


@pytest.mark.parametrize("option", ["allocationfactors=0.9", "cfactors=5"])
def test_powers_that_opendss_tells_but_does_not_take(option: str, tmp_path: Path) -> None:
    """`Set` scales what it says of the kvar of models 6 and 7, whose currents keep to the one before."""
    load = "new load.a bus1=b kv=0.4 xfkva=5 pf=0.8 allocationfactor=0.7 model={}\nset {}"
    with pytest.raises(SpecError) as caught:
        to_circuit(read(load.format(6, option), tmp_path))
    (fault,) = caught.value.faults
    assert (fault.code, fault.path) == ("I053", "load.a")
    to_circuit(read(load.format(1, option), tmp_path))


def test_a_part_without_source_and_voltage_goes(tmp_path: Path) -> None:
    """Such as a line that is open where it was fed, and charged by nothing."""
    text = "new line.o bus1=b bus2=far r1=0.2 x1=0.3 c1=150 length=2 units=km\nopen line.o 1\nnew load.a bus1=b kv=0.4"
    network = to_network(to_circuit(read(text, tmp_path)), "c.dss", BEHIND, GRID)
    draft = to_spec(network, BEHIND)
    assert ("line.o", "no DGU is connected to it") in {(u.element, u.reason) for u in draft.unmapped}
    with pytest.raises(SpecError, match="no nominal voltage"):
        to_network(to_circuit(read(text, tmp_path)), "c.dss", BEHIND, Placement(buses=("far",)))


def test_the_engine_prints_what_is_no_number() -> None:
    """It leaves entries of matrices that nothing has set to what memory held."""
    from certify.importing.opendss.engine import _parse

    text = '{"a" : [\n  [\n   1.0,\n                      Nan,\n    +Inf\n  ]\n ], "b" : "Nan,"}'
    assert _parse(text) == {"a": [[1.0, None, None]], "b": "Nan,"}
