"""Imports of pandapower's networks: its own calculations are the reference; and hostile files."""

from __future__ import annotations

import json
import random
from collections import Counter
from collections.abc import Callable, Iterator
from copy import deepcopy
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest

from certify.cli import main
from certify.importing import Placement, Settings
from certify.importing.pandapower import from_net
from certify.importing.pandapower.file import clean_document, import_pandapower, load_net, to_net
from certify.importing.pandapower.read import REFUSED
from certify.kernel.errors import SpecError
from tests.conftest import ROOT
from tests.pandapower_oracle import clean_json, imported, quiet, row_powers, worst_row, worst_voltage

DATA = ROOT / "tests" / "data" / "networks"
GRID = Placement(kinds=("ext-grid",))
BEHIND = Settings(bus_capacitance=Fraction(1, 10**15))  # too little to show


@pytest.fixture(scope="module", autouse=True)
def pp() -> Iterator[Any]:
    """pandapower, with an empty network that is made once and copied: making its tables takes longer than most tests."""
    package = import_pandapower()
    import pandapower.io_utils
    import pandapower.networks.cigre_networks
    import pandapower.networks.kerber_networks

    makers = (package, pandapower.io_utils, pandapower.networks.cigre_networks, pandapower.networks.kerber_networks)
    make = package.create_empty_network
    empty = quiet(make)

    def copied(*arguments: Any, **more: Any) -> Any:
        if arguments or set(more) - {"name"}:
            return make(*arguments, **more)
        return deepcopy(empty)

    with pytest.MonkeyPatch.context() as patch:
        for module in makers:
            if hasattr(module, "create_empty_network"):
                patch.setattr(module, "create_empty_network", copied)
        yield package


@pytest.fixture(scope="module")
def nets() -> dict[str, Any]:
    def make() -> dict[str, Any]:
        import pandapower.networks as networks

        return {
            "cigre": networks.create_cigre_network_mv(),
            "cigre-der": networks.create_cigre_network_mv(with_der="all"),
            "kerber": networks.create_kerber_landnetz_kabel_1(),
            "freileitung": networks.create_kerber_landnetz_freileitung_1(),
        }

    made: dict[str, Any] = quiet(make)
    for code in ("1-LV-rural1--0-sw", "1-LV-semiurb4--0-sw"):
        made[code] = load_net(str(DATA / f"{code}.json"))
    return made


NAMES = ("cigre", "cigre-der", "kerber", "freileitung", "1-LV-rural1--0-sw", "1-LV-semiurb4--0-sw")
STATED = Settings(line_capacitance=Fraction(1, 10**11), bus_capacitance=Fraction(1, 10**9))


def voltage_dependent(net: Any, seed: int = 1) -> Any:
    """A copy with shares of its own in each row, but the same in all rows at a bus: pandapower averages them there."""
    net, draw = deepcopy(net), random.Random(seed)
    for _, rows in net.load.groupby("bus"):
        for kind in "pq":
            z = draw.choice([0, 20, 35.5, 50])
            net.load.loc[rows.index, [f"const_z_{kind}_percent", f"const_i_{kind}_percent"]] = (
                z,
                draw.choice([0, 12.3, 40]),
            )
    return net


def accounts(net: Any, draft: Any) -> tuple[list[str], list[str]]:
    """Keys of all rows of the net, and those of all rows that the import speaks of, each as often as it does."""
    rows = [
        f"{key} {index}"
        for key, table in net.items()
        if hasattr(table, "itertuples") and not key.startswith(("_", "res_"))
        for index in table.index
    ]
    told = [*draft.mapped, *dict.fromkeys(u.element for u in draft.unmapped)]
    return rows, [element.split(" (")[0] for element in told]


def test_every_load_row_draws_what_pandapower_computes(nets: dict[str, Any]) -> None:
    """As published, and with shares that differ between rows, also at one bus: each row is alone in the reference."""
    cases = []
    for name in NAMES:
        net = voltage_dependent(nets[name])
        net.load["const_z_p_percent"] += net.load.index % 7
        cases += [(x, *imported(x, GRID, STATED)) for x in (nets[name], net)]
    off, where = worst_row(cases)
    assert off < 1e-12, where


def test_random_load_rows(pp: Any) -> None:
    draw = random.Random(7)

    def make() -> Any:
        net = pp.create_empty_network()
        a, *others = pp.create_buses(net, 61, 12.47)
        pp.create_ext_grid(net, a)
        for b in others:
            pp.create_line_from_parameters(net, a, b, 0.1, 0.3, 0.2, 10.0, 1.0)
        size = range(120)
        shares = {}
        for kind in "pq":
            shares[f"const_z_{kind}_percent"] = [draw.uniform(0, 60) for _ in size]
            shares[f"const_i_{kind}_percent"] = [draw.uniform(0, 100 - z) for z in shares[f"const_z_{kind}_percent"]]
        power = [draw.uniform(0.001, 3) for _ in size], [draw.uniform(-1, 1) for _ in size]
        pp.create_loads(net, others * 2, *power, scaling=[draw.choice([1, 0.3, 1.7]) for _ in size], **shares)
        return net

    net = quiet(make)
    off, where = worst_row([(net, *imported(net, GRID))])
    assert off < 1e-12, where


def test_the_reference_is_no_formula_of_ours() -> None:
    """It sees a wrong share, so that comparing with it means something."""
    row = {"p_mw": 1.0, "q_mvar": 0.5, "const_z_p_percent": 50.0, "const_i_q_percent": 100.0}
    ((p, q),) = row_powers([row], [0.9])
    assert p == pytest.approx(1e6 * (0.5 * 0.81 + 0.5), rel=1e-12)
    assert q == pytest.approx(0.5e6 * 0.9, rel=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_the_equilibrium_is_the_power_flow(nets: dict[str, Any], name: str) -> None:
    """Through transformers, in the same phasors: a factor of sqrt(3) or 3 anywhere would show."""
    net = voltage_dependent(nets[name], seed=3)
    net.load["scaling"] *= 0.4
    net.ext_grid["vm_pu"] = 1.02
    settings = BEHIND
    if name == "freileitung":  # the same network for both: lines with the capacitance that is stated
        net.line["c_nf_per_km"] = 10.0
    if name == "cigre-der":
        net.storage.drop(net.storage.index, inplace=True)
        net.sgen.drop(net.sgen.index, inplace=True)
    # pandapower applies the shares of loads to all that a bus feeds in or draws
    net.sgen.drop(net.sgen.index, inplace=True)
    network, draft = imported(net, GRID, settings)
    assert worst_voltage(net, network, draft) < 1e-8


def test_all_elements_at_once(pp: Any) -> None:
    """Taps, shifts, parallel lines, conductances, impedances, shunts, wards, motors, switches, three voltage levels."""

    def make() -> Any:
        net = pp.create_empty_network(f_hz=60.0, sn_mva=10.0)
        b = [
            pp.create_bus(net, vn, name=f"b{k}") for k, vn in enumerate([110, 20, 20, 20, 0.4, 0.4, 20, 20, 10, 20, 20])
        ]
        pp.create_ext_grid(net, b[0], vm_pu=1.01, va_degree=12.0)
        pp.create_transformer_from_parameters(
            net, b[0], b[1], 25.0, 110.0, 20.5, 0.4, 12.0, 14.0, 0.07, shift_degree=150, tap_side="hv", tap_neutral=0,
            tap_pos=3, tap_step_percent=1.5, tap_step_degree=0.0, tap_changer_type="Ratio", parallel=2,
        )  # fmt: skip
        pp.create_transformer_from_parameters(
            net, b[3], b[4], 0.63, 20.0, 0.41, 1.1, 6.0, 1.2, 0.3, shift_degree=30, tap_side="lv", tap_neutral=1,
            tap_pos=-1, tap_step_percent=2.0, tap_step_degree=60.0, tap_changer_type="Ratio",
        )  # fmt: skip
        pp.create_transformer_from_parameters(
            net, b[1], b[8], 5.0, 20.0, 10.0, 0.5, 7.0, 3.0, 0.2, tap_side="hv", tap_neutral=0, tap_pos=2,
            tap_step_degree=5.0, tap_step_percent=0.0, tap_changer_type="Ideal",
        )  # fmt: skip
        pp.create_line_from_parameters(net, b[1], b[2], 3.3, 0.2, 0.35, 250.0, 1.0, g_us_per_km=2.0, parallel=2)
        pp.create_line_from_parameters(net, b[2], b[3], 1.7, 0.3, 0.31, 12.0, 1.0)
        pp.create_line_from_parameters(net, b[1], b[3], 5.0, 0.3, 0.31, 12.0, 1.0)
        pp.create_line_from_parameters(net, b[4], b[5], 0.2, 0.2, 0.08, 260.0, 1.0)
        pp.create_line_from_parameters(net, b[2], b[6], 9.0, 0.2, 0.35, 250.0, 1.0, name="open one")
        pp.create_line_from_parameters(net, b[8], b[8], 1.0, 0.2, 0.35, 1.0, 1.0)
        pp.create_switch(net, b[6], 4, "l", closed=False)
        pp.create_switch(net, b[2], 4, "l", closed=True)
        pp.create_switch(net, b[6], b[3], "b", closed=True)
        pp.create_switch(net, b[7], b[2], "b", closed=True, z_ohm=0.7)
        pp.create_impedance(net, b[7], b[9], 0.01, 0.03, 8.0, gf_pu=0.002, bf_pu=0.01, gt_pu=0.001, bt_pu=-0.004)
        pp.create_load(net, b[5], 0.1, 0.03, const_z_p_percent=30, const_i_q_percent=20)
        pp.create_load(
            net, b[2], 2.0, 0.7, const_z_p_percent=10, const_i_p_percent=20, const_z_q_percent=35, scaling=0.8
        )
        pp.create_load(net, b[6], 1.0, 0.2)
        pp.create_shunt(net, b[3], -0.6, 0.02, vn_kv=21.0, step=2)
        pp.create_ward(net, b[9], 0.3, 0.1, 0.2, -0.1)
        pp.create_motor(net, b[8], pn_mech_mw=0.4, cos_phi=0.88, efficiency_percent=93.0, loading_percent=80.0)
        pp.create_sgen(net, b[8], 0.3, 0.05, scaling=0.9)
        pp.create_storage(net, b[9], 0.2, 1.0, 0.05)
        pp.create_asymmetric_load(net, b[8], 0.1, 0.1, 0.1, 0.02, 0.02, 0.02)
        pp.create_load(net, b[10], 1.0)
        return net

    net = quiet(make)
    network, draft = imported(net, GRID, BEHIND)
    assert worst_voltage(net, network, draft) < 1e-8
    rows, told = accounts(net, draft)
    assert Counter(rows) == Counter(told)
    reasons = {u.element.split(" (")[0]: u.reason for u in draft.unmapped}
    assert reasons == dict.fromkeys(("bus 10", "load 3"), "no DGU is connected to it")


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("where", ["ext-grid", "bus", "sources"])
def test_every_row_is_accounted_for_once(nets: dict[str, Any], name: str, where: str) -> None:
    net = deepcopy(nets[name])
    net.line.loc[net.line.index[0], "in_service"] = False
    placement = {
        "ext-grid": GRID,
        "bus": Placement(buses=(str(net.load.bus.iloc[-1]),)),
        "sources": Placement(kinds=("static-generators",)),
    }[where]
    if where == "sources" and not len(net.sgen):
        with pytest.raises(SpecError, match="no static-generators"):
            imported(net, placement, STATED)
        return
    _, draft = imported(net, placement, STATED)
    rows, told = accounts(net, draft)
    assert Counter(rows) == Counter(told)
    assert draft.spec == imported(net, placement, STATED)[1].spec


def test_a_file_is_read_as_the_net_was(pp: Any, nets: dict[str, Any], tmp_path: Path) -> None:
    """pandapower itself writes at most 15 decimals, so the second file is compared with the first."""
    placement = Placement(kinds=("static-generators",))
    for name in ("cigre-der", "1-LV-rural1--0-sw"):
        net, specs = nets[name], []
        for number in range(2):
            file = tmp_path / f"net-{number}.json"
            quiet(lambda net=net, file=file: pp.to_json(net, str(file)))
            net = load_net(str(file))
            specs.append(imported(net, placement)[1].spec)
        assert specs[0] == specs[1]
        columns = ["p_mw", "q_mvar", "bus"]
        assert (abs(net.load[columns] - nets[name].load[columns]) < 1e-14).all(axis=None)


def test_older_files_are_converted(nets: dict[str, Any]) -> None:
    """Percentages that once stood for active and reactive power alike."""
    net = deepcopy(nets["kerber"])
    net.load["const_z_p_percent"] = 40.0
    net.load["const_i_p_percent"] = 10.0
    net.load = net.load.drop(columns=["const_z_q_percent", "const_i_q_percent"]).rename(
        columns={"const_z_p_percent": "const_z_percent", "const_i_p_percent": "const_i_percent"}
    )
    network = from_net(net, "a test", GRID)
    document = clean_document(clean_json(net))
    document["_object"] |= {"version": "2.14.0", "format_version": "2.14.0"}
    again = from_net(to_net(document), "a test", GRID)
    assert network.loads == again.loads
    row = network.loads[0]
    assert row.apparent[0] * Fraction(4, 10) == row.impedance[0]  # type: ignore[union-attr]


# What is refused

Change = Callable[[Any], None]


def set_cell(table: str, column: str, value: Any) -> Change:
    def change(net: Any) -> None:
        net[table][column] = net[table][column].astype(object)
        net[table].loc[net[table].index[0], column] = value

    return change


def add(name: str, *arguments: Any, **more: Any) -> Change:
    def change(net: Any) -> None:
        getattr(import_pandapower(), f"create_{name}")(net, *arguments, **more)

    return change


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (set_cell("load", "p_mw", float("nan")), {("I003", "load[0].p_mw")}),
        (set_cell("load", "p_mw", float("inf")), {("I003", "load[0].p_mw")}),
        (set_cell("load", "q_mvar", "lots"), {("I003", "load[0].q_mvar")}),
        (set_cell("load", "p_mw", 1e300), {("I003", "load[0].p_mw")}),
        (set_cell("load", "bus", 4711), {("I004", "load[0].bus")}),
        (set_cell("load", "in_service", "maybe"), {("I003", "load[0].in_service")}),
        (set_cell("load", "in_service", None), {("I003", "load[0].in_service")}),
        (set_cell("load", "p_mw", 10**400), {("I003", "load[0].p_mw")}),
        (set_cell("switch", "closed", None), {("I003", "switch[0].closed")}),
        (set_cell("bus", "vn_kv", -20.0), {("I003", "bus[0].vn_kv")}),
        (set_cell("line", "length_km", -1.0), {("I003", "line[0].length_km")}),
        (set_cell("line", "x_ohm_per_km", 0.0), {("I020", "line[0].x_ohm_per_km")}),
        (set_cell("line", "r_ohm_per_km", 0.0), {("I020", "line[0].r_ohm_per_km")}),
        (set_cell("line", "c_nf_per_km", -5.0), {("I003", "line[0].c_nf_per_km")}),
        (set_cell("line", "parallel", 0), {("I003", "line[0].parallel")}),
        (set_cell("line", "from_bus", 99), {("I004", "line[0].from_bus")}),
        (set_cell("trafo", "vkr_percent", 13.0), {("I020", "trafo[0].vkr_percent")}),
        (set_cell("trafo", "tap_dependency_table", True), {("I006", "trafo[0].tap_dependency_table")}),
        (set_cell("switch", "element", 99), {("I004", "switch[0].element")}),
        (set_cell("switch", "bus", 1), {("I004", "switch[0].bus")}),
        (add("asymmetric_load", 3, 0.1, 0.2, 0.1), {("I005", "asymmetric_load[0]")}),
        (add("asymmetric_sgen", 3, 0.1, 0.1, 0.3), {("I005", "asymmetric_sgen[0]")}),
        (add("gen", 3, 1.0), {("I006", "gen[0]")}),
        (add("dcline", 3, 8, 1.0, 1.0, 0.1, 1.0, 1.0), {("I006", "dcline[0]")}),
        (add("impedance", 3, 8, 0.1, 0.2, 1.0, rtf_pu=0.3), {("I006", "impedance[0].rtf_pu")}),
        (add("ext_grid", 0, vm_pu=1.05), {("I025", "ext_grid[1].vm_pu")}),
        (add("switch", 0, 1, "b"), {("I003", "bus[1].vn_kv"), ("I003", "line[0]")}),
    ],
    ids=lambda x: "" if callable(x) else " ".join(sorted(f"{a}-{b}" for a, b in x)),
)
def test_rows_that_are_refused(nets: dict[str, Any], change: Change, expected: set[tuple[str, str]]) -> None:
    net = deepcopy(nets["cigre"])
    quiet(lambda: change(net))
    with pytest.raises(SpecError) as caught:
        imported(net, GRID)
    assert {(fault.code, fault.path) for fault in caught.value.faults} == expected


def test_of_very_many_faults_the_first_are_told(nets: dict[str, Any]) -> None:
    net = deepcopy(nets["1-LV-semiurb4--0-sw"])
    net.line["length_km"] = -1.0
    net.load["p_mw"] = float("nan")
    with pytest.raises(SpecError) as caught:
        imported(net, GRID)
    assert len(caught.value.faults) == 50
    assert caught.value.faults[-1].message.endswith("; and 33 more faults of this network")


def test_all_faults_come_at_once_and_tables_can_be_left_out(nets: dict[str, Any]) -> None:
    net = deepcopy(nets["cigre"])
    for change in (add("gen", 3, 1.0), add("asymmetric_load", 3, 0.1, 0.2, 0.1), set_cell("line", "length_km", 0.0)):
        quiet(lambda change=change: change(net))
    with pytest.raises(SpecError) as caught:
        imported(net, GRID)
    assert {fault.code for fault in caught.value.faults} == {"I003", "I005", "I006"}
    net.line.loc[0, "length_km"] = 1.0
    placement = Placement(kinds=("ext-grid",), leave_out=("gen", "asymmetric_load"))
    _, draft = imported(net, placement)
    assert [u.reason for u in draft.unmapped] == ["left out as asked"] * 2
    with pytest.raises(SpecError, match="cannot be left out"):
        imported(net, Placement(kinds=("ext-grid",), leave_out=("bus", "nonsense")))


def test_every_table_of_pandapower_has_a_meaning(pp: Any) -> None:
    """A table that a new version adds must not pass as one that no power flow reads."""
    from certify.importing.pandapower.read import BRANCHES, LEFT_OUT, ROWS

    tables = {
        k for k, v in pp.create_empty_network().items() if hasattr(v, "columns") and not k.startswith(("_", "res_"))
    }
    assert tables <= {"bus", "switch", *BRANCHES, *ROWS, *REFUSED, *LEFT_OUT}


def test_where_dgus_are_must_be_said(nets: dict[str, Any]) -> None:
    for placement, message in (
        (Placement(), "static-generators at buses 3, 4"),
        (Placement(buses=("99",)), "bus '99' is not there"),
        (Placement(buses=("Bus 77",)), "is not there"),
        (Placement(kinds=("generators",)), "no generators in service"),
    ):
        with pytest.raises(SpecError, match=message):
            from_net(nets["cigre-der"], "a test", placement)
    by_index, by_name = (from_net(nets["cigre"], "a test", Placement(buses=(x,))).sources for x in ("3", "Bus 3"))
    assert by_index == by_name
    network = from_net(nets["cigre-der"], "a test", Placement(buses=("5",)))
    assert [s.origins for s in network.sources] == [("storage 0 (Battery 1)", "sgen 2 (PV 5)")] or network.sources[
        0
    ].origins


# Files and the command


@pytest.fixture(scope="module")
def cigre_document(nets: dict[str, Any]) -> dict[str, Any]:
    return clean_json(nets["cigre"])


@pytest.fixture
def cigre_file(cigre_document: dict[str, Any], tmp_path: Path) -> Path:
    file = tmp_path / "cigre.json"
    file.write_text(json.dumps(cigre_document))
    return file


def run(*arguments: str) -> int:
    return main(["import", *arguments])


def test_the_command(cigre_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec = tmp_path / "cigre.toml"
    arguments = ["pandapower", str(cigre_file), "-o", str(spec), "--dgu", "1,12", "--reference", "12=1.01 pu"]
    assert run(*arguments) == 0
    output = capsys.readouterr().out
    assert output.startswith(f"IMPORTED: {cigre_file}")
    assert "left out: ext_grid 0: the grid outside, which an island has not" in output
    assert "18 of 18 load rows have a part of constant power" in output
    assert f"next: certify prove {spec}" in output
    first = spec.read_bytes()
    assert run(*arguments, "--json") == 0
    assert spec.read_bytes() == first
    told = json.loads(capsys.readouterr().out)
    assert told["left_out"] == [{"element": "ext_grid 0", "reason": "the grid outside, which an island has not"}]
    assert main(["prove", str(spec)]) == 1  # loads of constant power
    assert "load/Bus 3" in capsys.readouterr().out


def test_inverters_of_another_spec(cigre_file: Path, tmp_path: Path) -> None:
    spec = tmp_path / "cigre.toml"
    taken = ["--filter-from", str(ROOT / "specs" / "cigre-mv.toml"), "--controller", "phs"]
    assert run("pandapower", str(cigre_file), "-o", str(spec), "--dgu", "1,12", *taken) == 0
    assert 'L = "1.8 mH"' in spec.read_text()
    assert "placeholder" not in spec.read_text()


@pytest.mark.parametrize(
    ("more", "code"),
    [
        (["--dgu", "1", "--band", "1.1pu", "0.9pu"], "U001"),
        (["--dgu", "1", "--band", "high", "low"], "U001"),
        (["--dgu", "1", "--line-capacitance", "10 nF"], "U001"),
        (["--dgu", "1", "--line-capacitance", "-1 nF/km"], "U001"),
        (["--dgu", "1", "--bus-capacitance", "much"], "U001"),
        (["--dgu", "1", "--frequency", "0 Hz"], "U001"),
        (["--dgu", "1", "--reference", "1=zero"], "U001"),
        (["--dgu", "1", "--reference", "7=1.0"], "I025"),
        (["--dgu", "1", "--reference", "1", "--reference", "2"], "U001"),
        (["--dgus-at", "everywhere"], "U001"),
        (["--dgu", "1", "--filter", "lc"], "U001"),
        (["--dgu", "1", "--controller", "mine"], "I024"),
        (["--dgu", "1", "--filter-from", "nowhere.toml"], "S000"),
        (["--dgu", "1", "--filter-from", str(ROOT / "specs" / "negative" / "many-faults.toml")], "S203"),
        (["--dgu", "1", "-o", "no/such/folder/x.toml"], "U001"),
        (["--dgu", "nowhere"], "I007"),
        ([], "I007"),
    ],
)
def test_bad_options(
    cigre_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], more: list[str], code: str
) -> None:
    before = sorted(tmp_path.iterdir())
    output = [] if "-o" in more else ["-o", str(tmp_path / "new.toml")]
    assert run("pandapower", str(cigre_file), *output, *more) == 2
    error = capsys.readouterr().err
    assert f"error[{code}]" in error
    assert "Traceback" not in error
    assert sorted(tmp_path.iterdir()) == before


def edited(document: dict[str, Any], key: str, value: Any) -> bytes:
    return json.dumps({**document, "_object": {**document["_object"], key: value}}).encode()


def test_hostile_files(cigre_document: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Nothing that a file names is imported or opened, and each is refused with its reason."""
    document = cigre_document
    table = document["_object"]["load"]
    proof = tmp_path / "was-run"
    call = {"_module": "os", "_class": "system", "_object": f"touch {proof}"}
    other = tmp_path / "other.json"
    other.write_text(table["_object"])
    cells = json.loads(table["_object"])
    cells["data"][0][0] = call
    two = json.loads(table["_object"])
    two["columns"][1] = two["columns"][0]
    cases: list[tuple[bytes, str]] = [
        (b"", "I001"),
        (b"not json", "I001"),
        (b"\xff\xfe{}", "I001"),
        (b"[]", "I001"),
        (b"{}", "I001"),
        (b"[" * 100_000, "I001"),
        (b'{"_module": "pandapower.auxiliary", "_class": "pandapowerNet"}', "I001"),
        (b'{"_module": "pandapower.auxiliary", "_class": "pandapowerNet", "_object": {}}', "I001"),
        ((ROOT / "specs" / "cigre-mv.toml").read_bytes(), "I001"),
        (json.dumps(call).encode(), "I001"),
        (edited(document, "load", call), "I002"),
        (edited(document, "surprise", call), "I002"),
        (edited(document, "surprise", {"a": [{"b": call}]}), "I002"),
        (edited(document, "load", {**table, "_module": "pickle"}), "I002"),
        (edited(document, "load", {**table, "_module": ["pandas"]}), "I002"),
        (edited(document, "load", {**table, "_object": str(other)}), "I001"),
        (edited(document, "load", {**table, "_object": "[1, 2]"}), "I001"),
        (edited(document, "load", {**table, "_object": "[" * 100_000}), "I001"),
        (edited(document, "load", {**table, "orient": "table"}), "I001"),
        (edited(document, "load", {**table, "_object": json.dumps({**cells, "index": [0, 1]})}), "I001"),
        (edited(document, "load", {**table, "_object": json.dumps({**cells, "index": [0] * 18})}), "I001"),
        (edited(document, "load", {**table, "_object": json.dumps(two)}), "I001"),
        (edited(document, "f_hz", -50), "I003"),
        (edited(document, "f_hz", "often"), "I003"),
    ]
    file, spec = tmp_path / "net.json", tmp_path / "net.toml"
    for data, code in cases:
        file.write_bytes(data)
        assert run("pandapower", str(file), "-o", str(spec), "--dgu", "1") == 2, data[:80]
        error = capsys.readouterr().err
        assert f"error[{code}]" in error, (data[:80], error)
        assert "Traceback" not in error
        assert not spec.exists()
    # Cells that are no plain values make a column that is not read; names of code inside them stay text.
    file.write_bytes(edited(document, "load", {**table, "_object": json.dumps(cells)}))
    assert run("pandapower", str(file), "--dgu", "1") == 0
    assert not proof.exists()
    assert run("pandapower", str(tmp_path / "missing.json"), "--dgu", "1") == 2
    assert "error[S000]" in capsys.readouterr().err


def test_without_the_packages(
    cigre_file: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "simbench", None)
    assert run("simbench", "1-LV-rural1--0-sw", "--dgu", "1") == 2
    assert "pip install 'certify-eip[simbench]'" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "pandapower", None)
    assert run("pandapower", str(cigre_file), "--dgu", "1") == 2
    error = capsys.readouterr().err
    assert "error[I008]" in error
    assert "pip install 'certify-eip[pandapower]'" in error


def test_a_simbench_grid_from_its_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec = tmp_path / "rural.toml"
    file = DATA / "1-LV-rural1--0-sw.json"
    assert run("simbench", str(file), "-o", str(spec), "--dgus-at", "static-generators") == 0
    assert "13 load" in capsys.readouterr().out
    assert "1-LV-rural1--0-sw.json, a SimBench grid" in spec.read_text()
