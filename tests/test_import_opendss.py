"""Imports from OpenDSS, against its own engine: powers of loads, admittances, a power flow; and hostile scripts."""

from __future__ import annotations

import cmath
import math
import random
import re
from collections import Counter
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest

from certify.certificate import prove
from certify.cli import main
from certify.diagnostics import DIAGNOSTICS
from certify.importing import Draft, Network, Settings, to_spec
from certify.importing.network import ZipRow
from certify.importing.opendss.circuit import run_engine, to_circuit
from certify.importing.opendss.engine import Session, new_engine, read_circuit
from certify.importing.opendss.read import to_network
from certify.importing.settings import Placement
from certify.kernel.errors import SpecError
from certify.kernel.spec import ExpLoad, ZipLoad
from certify.rests import read_rest

F = Fraction
DATA = Path(__file__).parent / "data" / "opendss"
GRID = Placement(kinds=("ext-grid",))
STIFF = """clear
set defaultbasefrequency=50
new circuit.stiff basekv=0.4 pu=1 bus1=src r1=0 x1=1e-6 r0=0 x0=1e-6
new line.l bus1=src bus2=b r1=1e-5 x1=1e-5 c1=100 length=1 units=km
"""


@pytest.fixture(scope="module")
def context() -> Any:
    return new_engine()


@pytest.fixture(autouse=True)
def _one_engine(context: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """The engine takes a while to start, and every test begins with an empty one. (An import has a process for it.)"""
    context.Text.Command = "clearall"
    monkeypatch.setattr("certify.importing.opendss.engine.new_engine", lambda: context)


class Engine:
    """A circuit in an engine of its own, imported and then solved."""

    def __init__(self, script: str, folder: Path) -> None:
        path = folder / "circuit.dss"
        path.write_text(script)
        self.session = Session()
        self.session.run_file(path, "", folder)
        assert self.session.faults == []
        self.circuit = self.session.engine.ActiveCircuit

    def network(self, settings: Settings, placement: Placement = GRID) -> Network:
        return to_network(to_circuit({"circuit": self.session.circuit()}), "circuit.dss", settings, placement)

    def solve(self, pu: float | None = None) -> None:
        """To rounding, which the engine may not call converged: what is compared does not depend on that.

        With a coarser tolerance the powers that it tells are those of the last voltage but one.
        """
        if pu is not None:
            self.session.engine.Text.Command = f"edit vsource.source pu={pu}"
        self.session.engine.Text.Command = "set controlmode=off tolerance=1e-12 maxiterations=200"
        self.session.engine.Text.Command = "solve"

    def phases(self, element: str) -> list[float]:
        """Voltages across the phases of a load, referred to those from line to line."""
        self.circuit.SetActiveElement(element)
        active = self.circuit.ActiveCktElement
        n, conductors, raw = active.NumPhases, active.NumConductors, active.Voltages
        v = [complex(raw[2 * k], raw[2 * k + 1]) for k in range(conductors)]
        if active.Properties("conn").Val.lower().startswith("d"):
            return [abs(v[k] - v[(k + 1) % conductors]) for k in range(n)]
        return [abs(v[k] - v[-1]) * math.sqrt(3) for k in range(n)]

    def power(self, element: str) -> complex:
        """What goes into the first terminal of an element."""
        self.circuit.SetActiveElement(element)
        active = self.circuit.ActiveCktElement
        powers = active.Powers[: 2 * active.NumConductors]
        return 1000 * complex(sum(powers[::2]), sum(powers[1::2]))

    def volts(self, bus: str) -> complex:
        """Positive sequence, from line to line."""
        self.circuit.SetActiveBus(bus)
        raw = self.circuit.ActiveBus.Voltages
        v = [complex(raw[2 * k], raw[2 * k + 1]) for k in range(3)]
        turn = cmath.exp(2j * math.pi / 3)
        return (v[0] + turn * v[1] + turn**2 * v[2]) / 3 * math.sqrt(3)


def power_of(load: ZipLoad | ExpLoad, volt: float) -> complex:
    """What a load of a spec draws, in floats from its exact numbers."""
    if isinstance(load, ExpLoad):
        x = volt / float(load.V0_volt)
        return complex(float(load.P0_watt) * x ** float(load.np), float(load.Q0_var) * x ** float(load.nq))
    parts = zip(load.Y, load.I, load.P, strict=True)
    return complex(*(float(y) * volt**2 + float(i) * volt + float(p) for y, i, p in parts))


def draft_of(engine: Engine, settings: Settings, placement: Placement = GRID) -> tuple[Network, Draft]:
    network = engine.network(settings, placement)
    return network, to_spec(network, settings)


def random_load(rng: random.Random, k: int) -> str:
    model = k % 8 + 1
    text = f"new load.l{k} bus1=b kv=0.4 model={model} conn={rng.choice(['wye', 'delta'])}"
    text += f" vminpu=0.6 vmaxpu=1.4 vlowpu=0.4 status={rng.choice(['variable', 'fixed', 'exempt'])}"
    factor = rng.choice((-1, 1)) * round(rng.uniform(0.5, 1), 3)
    text += rng.choice(
        (
            f" kw={rng.uniform(1, 30):.5g} pf={factor}",
            f" kw={rng.uniform(-20, 30):.5g} kvar={rng.uniform(-20, 20):.5g}",
            f" kva={rng.uniform(1, 30):.5g} pf={factor}",
            f" xfkva={rng.uniform(1, 30):.5g} pf={factor} allocationfactor={rng.uniform(0.3, 1):.3g}",
        )
    )
    if model == 4:
        exponents = [rng.choice(["0", "1", "2", "3", f"{rng.uniform(-1, 6):.3f}"]) for _ in range(2)]
        text += f" cvrwatts={exponents[0]} cvrvars={exponents[1]}"
    if model == 8:  # not one in sum
        text += f" zipv=({' '.join(f'{rng.uniform(-1, 2):.3f}' for _ in range(6))} {rng.choice(['0', '0.55'])})"
    return text


@pytest.mark.parametrize("seed", range(3))
def test_a_load_of_the_spec_draws_what_opendss_says(seed: int, tmp_path: Path) -> None:
    rng = random.Random(seed)
    script = STIFF + "\n".join(random_load(rng, k) for k in range(40)) + "\nset loadmult=0.73"
    engine = Engine(script, tmp_path)
    network, draft = draft_of(engine, Settings(band_pu=(F("0.85"), F("1.15"))))
    loads = next(node.loads for node in draft.microgrid.nodes if node.name == "b")
    assert len(loads) == len(network.loads) == 40
    for pu in (0.9, 1.0, 1.1):
        engine.solve(pu)
        for row, load in zip(network.loads, loads, strict=True):
            volts, power = engine.phases(row.origins[0]), engine.power(row.origins[0])
            assert all(abs(volt / 400 - pu) < 0.01 for volt in volts)
            expected = sum(power_of(load, volt) / 3 for volt in volts)
            assert abs(expected - power) <= 1e-12 * abs(power), row.origins


@pytest.mark.parametrize(
    "wiring",
    [
        ("phases=1 bus1=b.1 kv=0.23", "phases=1 bus1=b.2 kv=0.23", "phases=1 bus1=b.3.0 kv=0.23"),
        ("phases=1 bus1=b.1.2 kv=0.4", "phases=1 bus1=b.2.3 kv=0.4", "phases=1 bus1=b.3.1 kv=0.4"),
        (
            "phases=1 bus1=b.2.1 kv=0.4 conn=delta",
            "phases=1 bus1=b.2.3 kv=0.4 conn=delta",
            "phases=1 bus1=b.3.1 kv=0.4 conn=delta",
        ),
    ],
)
def test_three_equal_loads_on_one_phase_each_are_one(wiring: tuple[str, ...], tmp_path: Path) -> None:
    law = "kw=3.3 pf=0.9 model=8 zipv=(0.1 0.2 0.7 0.3 0.3 0.4 0) vminpu=0.5 vmaxpu=1.6"
    engine = Engine(STIFF + "\n".join(f"new load.s{k} {text} {law}" for k, text in enumerate(wiring)), tmp_path)
    network, draft = draft_of(engine, Settings())
    assert network.loads[0].origins == ("load.s0", "load.s1", "load.s2")
    for pu in (0.9, 1.0, 1.1):
        engine.solve(pu)
        expected = sum(engine.power(f"load.s{k}") for k in range(3))
        got = power_of(draft.microgrid.nodes[1].loads[0], abs(engine.volts("b")))
        assert abs(got - expected) < 1e-12 * abs(expected) + 1e-8


@pytest.mark.parametrize(
    ("text", "band", "below"),
    [
        ("model=1", ("0.95", "1.05"), False),  # the defaults of OpenDSS
        ("model=1 vminpu=1", ("1", "1.05"), True),
        ("model=3 vminpu=0.9 vlowpu=1 vmaxpu=1.2", ("1", "1.1"), True),
        ("model=4 cvrwatts=1.5 vminpu=1", ("1", "1.05"), True),
        ("model=5 vminpu=1 vmaxpu=1.1", ("1", "1.1"), True),
        ("model=6 vminpu=1", ("1", "1.05"), True),
        ("model=7 vminpu=0.92 vlowpu=0", ("0.92", "1.05"), True),
        ("model=7 vminpu=0.92", ("0.92", "1.05"), False),
        ("model=8 zipv=(.5 .2 .3 .1 .2 .7 0) vminpu=1", ("1", "1.05"), True),
        ("model=8 zipv=(.5 .2 .4 .1 .2 .7 0) vminpu=1", ("1", "1.05"), False),  # 1.1 in sum, but rated below vlowpu
        ("model=8 zipv=(.5 .2 .4 .1 .2 .7 0) vminpu=1 vlowpu=0", ("1", "1.05"), True),
        ("model=8 zipv=(.5 .2 .3 .1 .2 .7 .5) vminpu=1", ("1", "1.05"), False),
        ("model=8 zipv=(.5 .2 .3 .1 .2 .7 .9)", ("0.95", "1.05"), False),
        ("model=2 vminpu=1", None, False),
        ("model=8 zipv=(1 0 0 1 0 0 0)", None, False),  # an impedance, whatever the limits
        ("model=1 vminpu=0.5 vmaxpu=1.5", None, False),
    ],
)
def test_a_load_has_the_band_on_which_its_law_is_that_of_opendss(
    text: str, band: tuple[str, str] | None, below: bool, tmp_path: Path
) -> None:
    engine = Engine(STIFF + f"new load.a bus1=b kv=0.4 kw=4 kvar=3 {text}", tmp_path)
    network, draft = draft_of(engine, Settings())
    row, load = network.loads[0], draft.microgrid.nodes[1].loads[0]
    assert row.band_pu == (band and (F(band[0]), F(band[1])))
    assert row.impedance_below == below
    low, high = (float(x) for x in row.band_pu or (F("0.9"), F("1.1")))
    for pu in (0.1, 0.3, 0.6, 0.8, low + 0.001, high - 0.001):
        engine.solve(pu)
        volt, power = engine.phases("load.a")[0], engine.power("load.a")
        inside = volt / 400 >= low
        if inside or below:
            frozen = 1.0 if inside else (volt / (400 * low)) ** 2
            expected = power_of(load, max(volt, 400 * low)) * frozen
            assert abs(power - expected) < 1e-9 * abs(expected), pu
    if band and not below:  # and just below the band it is another law, or a band that was asked for begins there
        engine.solve(low - 0.02)
        volt, power = engine.phases("load.a")[0], engine.power("load.a")
        assert abs(power - power_of(load, volt)) > 1e-6 * abs(power)


@pytest.mark.parametrize(
    ("text", "r", "x", "c"),
    [
        ("r1=0.2 x1=0.08 c1=260 length=150 units=m", "30", "12", "39000"),
        ("r1=0.2 x1=0.08 c1=260 length=3", "0.6", "0.24", "780"),
        ("units=ft r1=0.2 x1=0.08 c1=260 length=3 units=ft", "0.6", "0.24", "780"),
        ("linecode=mile length=5280 units=ft", "0.2", "0.08", "260"),
        ("linecode=mile length=0.25 units=mi", "0.05", "0.02", "65"),
        ("linecode=mile length=2", "0.4", "0.16", "520"),
        (
            "rmatrix=(1 | .25 1 | .25 .25 1) xmatrix=(2 | 1 2 | 1 1 2) cmatrix=(9 | -1 9 | -1 -1 9) length=2",
            "1.5",
            "2",
            "20",
        ),
        ("switch=y", "0.001", "0.001", "0.0011"),
        ("b1=100 r1=1 x1=1 length=1 units=km", "1", "1", None),
    ],
)
def test_lines_in_every_unit(text: str, r: str, x: str, c: str | None, tmp_path: Path) -> None:
    script = STIFF + f"new linecode.mile r1=0.2 x1=0.08 c1=260 units=mi\nnew line.a bus1=b bus2=c {text}"
    network = Engine(script, tmp_path).network(Settings())
    branch = next(branch for branch in network.branches if branch.name == "a")
    w0 = F("314.1592653589793238462643383279502884197")
    near = F(1, 10**13)
    assert abs(branch.resistance_ohm / F(r) - 1) < near
    assert abs(branch.inductance_henry * w0 / F(x) - 1) < near
    farad = F(c) / 10**9 if c else F(100, 10**6) / w0
    assert abs(branch.capacitance_farad / farad - 1) < near


def test_a_line_code_has_one_type_at_every_length(tmp_path: Path) -> None:
    script = STIFF + "new linecode.x r1=0.3 x1=0.1 c1=200 units=km\n"
    script += "\n".join(f"new line.a{k} bus1=b bus2=c{k} linecode=x length={0.3 + 0.07 * k} units=km" for k in range(9))
    _, draft = draft_of(Engine(script, tmp_path), Settings())
    assert draft.spec.count(b"[line_type.") == 2


def read_fixed(tmp_path: Path, text: str, placement: Placement = GRID, settings: Settings | None = None) -> Network:
    return Engine(STIFF + text, tmp_path).network(settings or Settings(), placement)


@pytest.mark.parametrize(
    ("text", "code", "named", "says"),
    [
        ("new load.a bus1=b.1 phases=1 kv=0.23 kw=1 pf=1", "I047", "load.a", "one phase, at b.1, without"),
        ("new load.a bus1=b.1.1 phases=1 kv=0.23 kw=1 pf=1", "I047", "load.a", "one phase, at b.1.1, without"),
        ("new load.a bus1=b.1.2 phases=2 kv=0.4 kw=1 pf=1", "I047", "load.a", "2 phases"),
        ("new load.a bus1=b.1.2.2 kv=0.4 kw=1 pf=1", "I047", "load.a", "b.1.2.2"),
        ("new line.a bus1=b.1.2.3 bus2=c.2.3.1 r1=1 x1=1", "I047", "line.a", "in one order"),
        ("new line.a bus1=b.1 bus2=c.1 phases=1 r1=1 x1=1", "I047", "line.a", "1 phase, b.1 to c.1"),
        (
            "new line.a bus1=b bus2=c rmatrix=(1 | 0 1 | 0 0 1.01) xmatrix=(1 | 0 1 | 0 0 1) cmatrix=(1|0 1|0 0 1)",
            "I048",
            "line.a",
            "on the diagonal differ by 0.99 %",
        ),
        (
            "new line.a bus1=b bus2=c rmatrix=(1 | 0.1 1 | 0.1 0.2 1) xmatrix=(1 | 0 1 | 0 0 1) cmatrix=(1|0 1|0 0 1)",
            "I048",
            "line.a",
            "beside the diagonal",
        ),
        (
            "new line.a bus1=b bus2=c r1=.1 x1=.4 c1=10 length=300 units=km\nset longlinecorrection=yes",
            "I052",
            "line.a",
            "by",
        ),
        ("new line.a bus1=b bus2=c r1=1 x1=1\nopen line.a 1 2", "I047", "line.a", "some of its phases"),
        ("new load.a bus1=b kv=0.4 kw=1 pf=1\nopen load.a 1 2", "I047", "load.a", "some of its phases"),
        ("new transformer.a phases=1 buses=(b.1 c.1) kvs=(.23 .23)", "I047", "transformer.a", "1 phase"),
        ("new transformer.a windings=3 buses=(b c d) kvs=(.4 .4 .4)", "I050", "transformer.a", "3 windings"),
        ("new capacitor.a bus1=b bus2=c kvar=5 kv=.4", "I050", "capacitor.a", "in series"),
        ("new capacitor.a bus1=b kvar=5 kv=.4 r=0.1", "I050", "capacitor.a", "resistance"),
        ("new reactor.a bus1=b kvar=5 kv=.4 rp=100", "I050", "reactor.a", "Rp"),
        ("new fault.a bus1=b", "I050", "fault.a", "fault"),
        ("new pvsystem.a bus1=b kv=.4", "I050", "pvsystem.a", "pvsystem that is no DGU"),
        ("new generator.a bus1=b kv=.4 model=3", "I050", "generator.a", "model 3"),
        ("new load.a bus1=b kv=.4 model=8 zipv=(1 0 0 1 0 0 .93)", "I049", "load.a", "0.97 pu or above"),
        ("new load.a bus1=b kv=.4 vminpu=1.2 vmaxpu=1.5", "I049", "load.a", "1.2 to 1.5"),
        ("new load.a bus1=b kv=.4 kw=nan", "I051", "load.a", "kW is no finite number"),
        ("new load.a bus1=b kv=.4 kw=1e40", "I051", "load.a", "absurd"),
        ("new load.a bus1=b kv=0", "I051", "load.a", "kV is"),
        ("new load.a bus1=b kv=.4 model=8", "I051", "load.a", "seven coefficients"),
        ("new generator.a bus1=b kv=.4 dispmode=loadlevel dispvalue=3", "I050", "generator.a", "dispatched"),
        ("new indmach012.a bus1=b kv=.4", "I050", "indmach012.a", "class indmach012"),
        ("set year=2", "I053", "", "year=2"),
        ("set frequency=60", "I053", "", "60"),
    ],
)
def test_what_is_refused(text: str, code: str, named: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(SpecError) as caught:
        read_fixed(tmp_path, text)
    (fault,) = caught.value.faults
    assert (fault.code, fault.path) == (code, named)
    assert says in fault.message


@pytest.mark.parametrize(
    ("placement", "code", "says"),
    [
        (Placement(), "I007", "vsource.source at bus src"),
        (Placement(("nowhere",)), "I007", "'nowhere' is no bus"),
        (Placement(kinds=("storage",)), "I007", "the circuit has none that is on"),
        (Placement(("b",), (), ("pvsystem",)), "I054", "no 'pvsystem'"),
    ],
)
def test_places_that_are_not_there(placement: Placement, code: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(SpecError) as caught:
        read_fixed(tmp_path, "", placement)
    assert any(fault.code == code and says in fault.message for fault in caught.value.faults)


def test_what_is_left_out_on_demand(tmp_path: Path) -> None:
    text = "new pvsystem.p bus1=b kv=.4\nnew load.a bus1=b.1 phases=1 kv=.23\nnew load.b bus1=b kv=.4 model=2"
    network = read_fixed(tmp_path, text, Placement(("B",), (), ("pvsystem", "Load.A")))
    assert {(u.element, u.reason) for u in network.unmapped} >= {
        ("pvsystem.p", "left out as asked for"),
        ("load.a", "left out as asked for"),
    }
    assert [row.origins for row in network.loads] == [("load.b",)]


@pytest.mark.parametrize(
    "text",
    ["model=1 kw=7 pf=0.9", "model=1 kw=7 kvar=-2 conn=delta", "model=2 kw=7 pf=-0.8 status=fixed", "kva=9 kw=4"],
)
def test_a_generator_that_is_no_dgu_is_a_negative_load(text: str, tmp_path: Path) -> None:
    script = STIFF + f"set genmult=0.8\nnew generator.g bus1=b kv=0.4 vminpu=0.8 vmaxpu=1.2 {text}"
    engine = Engine(script, tmp_path)
    _, draft = draft_of(engine, Settings())
    (load,) = next(node.loads for node in draft.microgrid.nodes if node.name == "b")
    for pu in (0.9, 1.0, 1.1):
        engine.solve(pu)
        expected = engine.power("generator.g")
        assert expected.real < 0
        assert abs(power_of(load, abs(engine.volts("b"))) - expected) < 1e-10 * abs(expected)


@pytest.fixture(scope="module")
def feeder() -> Engine:
    engine = Engine.__new__(Engine)
    engine.session = Session()
    engine.session.run_file(DATA / "feeder.dss", "", DATA)
    assert engine.session.faults == []
    engine.circuit = engine.session.engine.ActiveCircuit
    return engine


@pytest.mark.parametrize(
    "placement", [GRID, Placement(("a", "mv2")), Placement(("c",), ("generators",), ("capacitor",))]
)
def test_every_element_is_accounted_for_once(placement: Placement, feeder: Engine) -> None:
    raw = feeder.session.circuit()
    settings = Settings(bus_capacitance=F(1, 10**7))
    draft = to_spec(to_network(to_circuit({"circuit": raw}), "feeder.dss", settings, placement), settings)
    names = Counter(element["name"] for element in raw["elements"])
    assert len(names) == 24
    found = Counter(draft.mapped) + Counter(dict.fromkeys((u.element for u in draft.unmapped), 1))
    assert found == names
    assert {
        ("load.cvr", "its load shape is ignored"),
        ("load.one", "with load.two and load.three one balanced load"),
    } <= {(note.element, note.text) for note in draft.notes}


def test_the_equilibrium_is_the_power_flow_of_opendss(feeder: Engine) -> None:
    settings = Settings()
    network = feeder.network(settings)
    draft = to_spec(network, settings)
    verdict = prove(draft.spec).verdict
    rest = read_rest(next(claim for claim in verdict.claims if claim.id.startswith("equilibrium/")))
    feeder.solve()
    assert feeder.circuit.Solution.Converged
    factor = cmath.rect(20 / (0.4 * 1.025), math.radians(30))  # how the low-voltage side is referred
    assert set(rest.voltages) == {"grid", "mv1", "mv2", "lv", "a", "b", "c", "mv2 open tie"}
    for bus in ("grid", "mv1", "mv2", "lv", "a", "b", "c"):
        volt = rest.voltages[bus]
        expected = feeder.volts(bus) * (factor if bus in ("lv", "a", "b", "c") else 1)
        assert abs(volt - expected) < 1e-6 * abs(expected), bus
    # What the lines take there, line to line and power-invariant; the open one is charged from this end.
    volt = rest.voltages["grid"]
    legs = sum(0.5j * 2 * math.pi * 50 * 151.7e-9 * km * abs(volt) ** 2 for km in (2.8, 5))
    taken = sum(volt * rest.lines[name].conjugate() for name in ("mv1", "tie")) - legs
    assert abs(taken - feeder.power("line.mv1") - feeder.power("line.tie")) < 1e-6 * abs(taken)


def test_transformers_of_every_connection(tmp_path: Path) -> None:
    connections = [(a, b, lag) for a in ("wye", "delta") for b in ("wye", "delta") for lag in ("lag", "lead")]
    text = "\n".join(
        f"new transformer.t{k} buses=(src x{k}) conns=({a} {b}) kvs=(0.4 0.1) kvas=(50 50) xhl=4 %rs=(1 1.5) leadlag={lag}"
        f" taps=(1 0.95) %imag=0.4 %noloadloss=0.3"
        for k, (a, b, lag) in enumerate(connections)
    )
    network = read_fixed(tmp_path, text)
    shifts = [branch.shift_degree for branch in network.branches if branch.name.startswith("t")]
    assert shifts == [0, 0, 30, -30, 30, -30, 0, 0]  # "lag": the winding of less voltage is behind
    assert {branch.ratio for branch in network.branches if branch.name.startswith("t")} == {F(400, 95)}


def test_lines_without_capacitance_need_a_stated_one(tmp_path: Path) -> None:
    text = "new line.a bus1=b bus2=c r1=0.1 x1=0.1 c1=0 length=200 units=m\nnew load.a bus1=c kv=.4 model=2"
    network = read_fixed(tmp_path, text)
    with pytest.raises(SpecError, match=r"I022 at c: .*--line-capacitance"):
        to_spec(network, Settings())
    draft = to_spec(network, Settings(line_capacitance=F(10, 10**12)))
    assert draft.microgrid.lines[1].capacitance_farad == F(200 * 10, 10**12)


def test_values_that_opendss_has_by_default_are_told(tmp_path: Path) -> None:
    notes = {(n.element, n.text) for n in read_fixed(tmp_path, "new line.a bus1=b bus2=c").notes}
    assert ("line.a", "its capacitance is the default of OpenDSS, 3.4 nF per unit of length") in notes
    assert ("line.a", "its impedance is the default of OpenDSS, 0.058 + 0.1206j ohm per unit") in notes


def test_generating_elements_as_dgus(tmp_path: Path) -> None:
    text = """new pvsystem.p bus1=b kv=.4 kva=30 pmpp=25
    new storage.s bus1=b kv=.4 kva=20 kwrated=20 kwhrated=50
    new invcontrol.i mode=voltvar
    new line.far bus1=b bus2=c r1=.1 x1=.1 c1=100
    new generator.g bus1=c kv=.4 kva=12 kw=10 model=3"""
    placement = Placement(kinds=("static-generators", "storage", "generators"))
    network = read_fixed(tmp_path, text, placement)
    found = {source.bus: (source.rating_va, source.origins) for source in network.sources}
    assert found == {"b": (50000, ("storage.s", "pvsystem.p")), "c": (12000, ("generator.g",))}
    assert {u.element for u in network.unmapped} == {"vsource.source", "invcontrol.i"}
    assert prove(to_spec(network, Settings()).spec).verdict.outcome == "certified"


def test_files_that_scripts_call_for(tmp_path: Path) -> None:
    (tmp_path / "Inner").mkdir()
    (tmp_path / "Inner" / "LOADS.dss").write_text("redirect more.DSS\n")
    (tmp_path / "Inner" / "more.dss").write_text("new load.a bus1=b kv=.4 kw=7 pf=1 model=2\n")
    (tmp_path / "shape.csv").write_text("1\n2\n")
    text = "redirect inner\\Loads.dss\nnew loadshape.s npts=2 mult=(file=shape.csv)\nload.a.kw=8 pf=0.5"
    network = read_fixed(tmp_path, text)
    row = network.loads[0]
    assert isinstance(row, ZipRow)
    assert row.impedance[0] == 8000


HOSTILE = [
    ("doscmd touch pwned", "I043", "DOScmd"),
    ("cd /tmp", "I043", "CD"),
    ("new generator.g bus1=b kv=.4 model=6 usermodel=evil.so", "I043", "loads a library"),
    ("new generator.g bus1=b userm=evil.so", "I043", "write it in full"),
    ("new generator.g bus1=b u=evil.so", "I043", "write it in full"),
    ("new generator.g bus1=b debugtrace=yes", "I043", "writes a file"),
    ("new regcontrol.g transformer=t debugt=y", "I043", "writes a file"),
    ("new loadshape.s npts=2 mult=(1 2) action=dblsave", "I043", "is an action"),
    ("new loadshape.s npts=2 mult=(1 2) a=sngsave", "I043", "is an action"),
    ("new energymeter.m terminal=1 zonedump", "I043", "without a name"),
    ("new monitor.m line.l 1 0 save", "I043", "without a name"),
    ("new energymeter.m element=line.l\nenergymeter.m.action=zonedump", "I043", "is an action"),
    ('new generator.g "" usermodel=evil.so', "I043", "loads a library"),
    ("new generator.g bus1=b\n~ xdpp=0.2 1 1 evil.so", "I043", "without a name"),
    ("new generator.g bus1=b\ngenerator.g.usermodel=evil.so", "I043", "loads a library"),
    ("new storage.g bus1=b\nbatchedit storage..* dynadll=evil.so", "I043", "loads a library"),
    ("new loadshape.s npts=10 mult=(file=/dev/zero)", "I042", "/dev/zero"),
    ("new loadshape.s npts=10 csvfile='/dev/zero'", "I042", "/dev/zero"),
    ("new loadshape.s npts=10 csvf=/dev/zero", "I043", "write it in full"),
    ("redirect circuit.dss", "I042", "calls for itself"),
    ("redirect nothing.dss", "I042", "no file 'nothing.dss'"),
    ("redirect", "I042", "no file"),
    ("compile .", "I042", "no file"),
    ("var @c=export\n@c voltages", "I043", "variable"),
    ("reduce", "I043", "Reduce"),
    ("set cktmodel=positive", "I043", "Cktmodel"),
    ("set class=load", "I043", "class"),
    ('set year="0) datapath=/ ("', "I043", "no plain value"),
    ("set allowduplicates=yes", "I043", "Allowduplicates"),
    ("clear\nnew circuit.x bus1=a\nedit line.l r1=1", "I044", "no element 'line.l'"),
    ("kw=3", "I043", "a property alone"),
    ("foo bar", "I044", "'foo' is no command"),
    ("new foo.a", "I044", "does not name a class"),
    ("new load", "I044", "does not name a class"),
    ("edit line.zzz r1=1", "I044", "no element 'line.zzz'"),
    ("new load.x kw=abc", "I044", "abc"),
    ("new load.x bus1=b linecode=4", "I044", "linecode"),
    ("new load.x phases=-3", "I044", "negative"),
    ("new line.l bus1=a bus2=c", "I044", "Duplicate"),
    ("new load.x " + "a" * 100_001, "I041", "100,012 characters"),
    ("new load.x bus1=\0", "I041", "not a text"),
]


@pytest.mark.parametrize(("text", "code", "says"), HOSTILE)
def test_hostile_scripts(text: str, code: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "circuit.dss"
    path.write_text(STIFF + text + "\n")
    before = sorted(tmp_path.iterdir())
    with pytest.raises(SpecError) as caught:
        read_circuit(path)
    fault = caught.value.faults[0]
    assert (fault.code, says in fault.message) == (code, True), fault
    assert sorted(tmp_path.iterdir()) == before


def test_commands_that_show_or_write_are_not_run(tmp_path: Path) -> None:
    path = tmp_path / "circuit.dss"
    harmless = [
        "solve",
        "show voltages",
        "export voltages v.csv",
        "save circuit dir=saved",
        "plot profile",
        "fileedit x",
    ]
    harmless += [
        "set datapath=/etc editor=vi",
        "dump",
        "visualize what=currents element=line.l",
        "quit",
        "solve mode=yearly",
    ]
    path.write_text(
        STIFF
        + "\n".join(harmless)
        + "\nnew load.a bus1=b kv=.4 /* no comment\n/* new load.b bus1=b\n*/ new load.c bus1=b\n"
    )
    with pytest.raises(SpecError):  # what follows /* within a line is no comment
        read_circuit(path)
    path.write_text(path.read_text().replace("/* no comment", "! a comment"))
    circuit = read_circuit(path)
    assert [e["name"] for e in circuit["elements"] if e["kind"] == "load"] == ["load.a"]
    assert set(circuit["left_out"]) >= {"Solve", "Export", "Save", "Set Datapath=/etc"}
    assert [entry.name for entry in tmp_path.iterdir()] == ["circuit.dss"]


def test_every_code_is_explained() -> None:
    folder = Path(__file__).parent.parent / "certify" / "importing" / "opendss"
    used = set(re.findall(r'"(I\d{3})"', "".join(path.read_text() for path in folder.glob("*.py"))))
    assert used == {"I007"} | {code for code in DIAGNOSTICS if "I040" <= code <= "I069"}


def test_faults_without_end(tmp_path: Path) -> None:
    path = tmp_path / "circuit.dss"
    path.write_text("nonsense\n" * 1000)
    with pytest.raises(SpecError) as caught:
        read_circuit(path)
    assert len(caught.value.faults) == 51


def test_all_faults_at_once_with_their_lines(tmp_path: Path) -> None:
    path = tmp_path / "circuit.dss"
    (tmp_path / "inner.dss").write_text("\n\nnew load.c bus1=b what=3\n")
    path.write_text(STIFF + "new load.a kw=x\n~ pf=0.9\nedit line.q r1=1\nredirect inner.dss\nset nonsense=3\n")
    with pytest.raises(SpecError) as caught:
        read_circuit(path)
    assert [fault.path for fault in caught.value.faults] == [
        "circuit.dss:5",
        "circuit.dss:7",
        "inner.dss:3",
        "circuit.dss:9",
    ]


def test_unbalanced_feeders_name_every_element() -> None:
    with pytest.raises(SpecError) as caught:
        to_network(to_circuit({"circuit": read_circuit(DATA / "unbalanced.dss")}), "x", Settings(), GRID)
    assert {(fault.code, fault.path) for fault in caught.value.faults} == {
        ("I048", "line.trunk"),
        ("I047", "line.lateral"),
        ("I047", "line.two"),
        ("I047", "transformer.reg1"),
        ("I047", "transformer.reg2"),
        ("I047", "transformer.reg3"),
        ("I047", "load.a"),
        ("I047", "load.b"),
        ("I047", "load.open"),
        ("I047", "capacitor.one"),
    }


def test_without_the_engine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(SpecError) as caught:
        run_engine(DATA / "feeder.dss")
    assert caught.value.faults[0].code == "I040"
    assert "pip install 'certify-eip[opendss]'" in caught.value.faults[0].message


@pytest.mark.parametrize(("script", "code"), [("", "I046"), ("new circuit.x bus1=a", "I046")])
def test_scripts_without_a_network(script: str, code: str, tmp_path: Path) -> None:
    path = tmp_path / "circuit.dss"
    path.write_text(script)
    with pytest.raises(SpecError) as caught:
        to_network(to_circuit({"circuit": read_circuit(path)}), "x", Settings(), GRID)
    assert caught.value.faults[0].code == code


def test_the_command(feeder: Engine, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "feeder.toml"
    assert main(["import", "opendss", str(DATA / "feeder.dss"), "-o", str(target), "--dgus-at", "ext-grid"]) == 0
    assert (
        "mapped: 2 capacitor, 5 line, 1 transformer, 2 reactor, 8 load, 1 generator, 1 vsource"
        in capsys.readouterr().out
    )
    raw = {"circuit": feeder.session.circuit()}  # of another engine, in this process
    settings = Settings()
    assert to_spec(to_network(to_circuit(raw), "feeder.dss", settings, GRID), settings).spec == target.read_bytes()


def test_a_script_that_breaks_the_engine_is_a_fault(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "bad.dss").write_text(STIFF + "new line.x phases=1000000 bus1=b bus2=c\n")
    command = ["import", "opendss", str(tmp_path / "bad.dss"), "-o", str(tmp_path / "no.toml"), "--dgu", "b"]
    assert main(command) == 2
    assert "error[I045]: the OpenDSS engine broke down over this script" in capsys.readouterr().err
    assert [entry.name for entry in tmp_path.iterdir()] == ["bad.dss"]
