"""What pandapower itself computes, to compare imports with: the power of single load rows, and power flows."""

from __future__ import annotations

import cmath
import json
import math
import warnings
from collections import defaultdict
from copy import deepcopy
from fractions import Fraction
from typing import Any

from certify.certificate import prove
from certify.importing import Draft, Network, Placement, Settings, to_spec
from certify.importing.pandapower import from_net
from certify.importing.pandapower.file import import_pandapower
from certify.kernel.claims import Claim
from certify.kernel.spec import Node, ZipLoad

VOLTAGES = (0.9, 1.0, 1.1)


def quiet(action: Any) -> Any:
    """A call into pandapower, whose own warnings are none of ours."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return action()


def row_powers(rows: list[dict[str, Any]], volts_pu: list[float]) -> list[tuple[float, float]]:
    """Watt and var that pandapower's power flow gives each row, alone at a bus that a stiff grid holds at so many pu."""
    pp = import_pandapower()
    shares = [f"const_{part}_{kind}_percent" for part in "zi" for kind in "pq"]

    def compute() -> Any:
        net = pp.create_empty_network()
        buses = pp.create_buses(net, len(rows), 0.4)
        columns = {column: [float(row.get(column, 0)) for row in rows] for column in shares}
        columns["scaling"] = [float(row.get("scaling", 1)) for row in rows]
        power = ([float(row[column]) for row in rows] for column in ("p_mw", "q_mvar"))
        pp.create_loads(net, buses, *power, **columns)
        pp.create_ext_grid(net, buses[0])
        net.ext_grid = net.ext_grid.loc[[0] * len(rows)].reset_index(drop=True)  # a stiff grid at every bus
        net.ext_grid["bus"], net.ext_grid["vm_pu"] = buses, volts_pu
        pp.runpp(net, voltage_depend_loads=True, numba=False)
        assert abs(net.res_bus.vm_pu - volts_pu).max() < 1e-14
        return net.res_load

    result = quiet(compute)
    return [(p * 1e6, q * 1e6) for p, q in zip(result.p_mw, result.q_mvar, strict=True)]


def imported(net: Any, placement: Placement, settings: Settings | None = None) -> tuple[Network, Draft]:
    network = from_net(net, "a test", placement)
    return network, to_spec(network, settings or Settings())


def spec_powers(network: Network, draft: Draft, v: float) -> dict[str, tuple[float, float]]:
    """Watt and var of each load row in the spec at v pu of its bus, by the row's label: exact, then rounded once."""
    nodes: dict[str, Node] = {node.name: node for node in draft.microgrid.nodes}
    position: dict[str, int] = defaultdict(int)
    referred = {name: level for level in draft.levels for name in level.buses}
    result = {}
    for row in network.loads:
        if row.bus not in nodes:
            continue
        load = nodes[row.bus].loads[position[row.bus]]
        position[row.bus] += 1
        assert isinstance(load, ZipLoad)
        volt = Fraction(repr(v)) * row.nominal_volt * referred[row.bus].factor
        p, q = (float(load.Y[k] * volt**2 + load.I[k] * volt + load.P[k]) for k in (0, 1))
        result[row.origins[0]] = (p, q)
    return result


def worst_row(cases: list[tuple[Any, Network, Draft]]) -> tuple[float, str]:
    """Largest relative difference between specs and pandapower over all rows of net.load and three voltages, and where.

    A row that the spec has not must be one that draws nothing.
    """
    rows: list[dict[str, Any]] = []
    volts: list[float] = []
    ours: list[tuple[str, tuple[float, float]]] = []
    for net, network, draft in cases:
        for v in VOLTAGES:
            powers = {label.split(" (")[0]: power for label, power in spec_powers(network, draft, v).items()}
            for index, row in net.load[net.load.in_service].iterrows():
                rows.append(dict(row))
                volts.append(v)
                ours.append((f"load {index} at {v} pu", powers.get(f"load {index}", (0.0, 0.0))))
    worst, where = 0.0, ""
    for (label, mine), theirs in zip(ours, row_powers(rows, volts), strict=True):
        for a, b in zip(mine, theirs, strict=True):
            off = abs(a - b) / max(abs(b), 1e-9)
            worst, where = max((worst, where), (off, label))
    return worst, where


def equilibrium(draft: Draft) -> dict[str, complex]:
    """Proved voltages of all nodes, over the nominal voltage of each as referred, from the certificate's facts."""
    nominal = {name: float(level.referred_volt) for level in draft.levels for name in level.buses}
    claims: list[Claim] = [c for c in prove(draft.spec).verdict.claims if c.id.startswith("equilibrium/")]
    parts: dict[str, dict[str, float]] = defaultdict(dict)
    for claim in claims:
        assert claim.status == "proved", claim
        for text, value, _ in claim.facts:
            if text.startswith("voltage at node "):
                name, axis = text.removeprefix("voltage at node ").rsplit(", ", 1)
                parts[name][axis] = float(value)
    return {name: complex(x["d"], x["q"]) / nominal[name] for name, x in parts.items()}


def flow(net: Any, by_row: bool) -> Any:
    """Voltages of pandapower's power flow: all branches as pi sections, loads that depend on the voltage.

    pandapower gives the mean shares of a bus to all that is connected there. With `by_row` each row has its own instead:
    power flows with constant powers, each with those of its rows at the voltages of the one before, until nothing changes.
    """
    pp = import_pandapower()
    options = {"trafo_model": "pi", "calculate_voltage_angles": True, "tolerance_mva": 1e-10, "max_iteration": 50}
    if not by_row:
        quiet(lambda: pp.runpp(net, voltage_depend_loads=True, numba=False, **options))
        return net.res_bus
    net, table = deepcopy(net), net.load
    for _ in range(60):
        if "vm_pu" in net.res_bus and len(net.res_bus):
            v = net.res_bus.vm_pu.reindex(table.bus).fillna(1.0).to_numpy()
            for column, kind in (("p_mw", "p"), ("q_mvar", "q")):
                z, i = (table[f"const_{part}_{kind}_percent"].to_numpy() / 100 for part in "zi")
                net.load[column] = table[column].to_numpy() * (z * v**2 + i * v + 1 - z - i)
        before = net.res_bus.vm_pu.to_numpy() if len(net.res_bus) else None
        quiet(lambda: pp.runpp(net, voltage_depend_loads=False, numba=False, **options))
        if before is not None and abs(net.res_bus.vm_pu.fillna(0) - before).fillna(0).max() < 1e-13:
            break
    return net.res_bus


def worst_voltage(net: Any, network: Network, draft: Draft, by_row: bool = False) -> float:
    """Largest difference in pu, as a phasor, between the proved equilibrium and pandapower's power flow."""
    turned = {name: float(level.angle_degree) for level in draft.levels for name in level.buses}
    ours = equilibrium(draft)
    worst, offset = 0.0, None
    for index, row in flow(net, by_row).iterrows():
        name = network.aliases.get(str(index))
        if name not in ours or row.vm_pu != row.vm_pu:
            continue
        theirs = cmath.rect(row.vm_pu, math.radians(row.va_degree + turned[name]))
        offset = offset if offset is not None else ours[name] / abs(ours[name]) / (theirs / abs(theirs))
        worst = max(worst, abs(ours[name] - theirs * offset))
    assert offset is not None
    return worst


def clean_json(net: Any) -> dict[str, Any]:
    """The document that pandapower writes."""
    pp = import_pandapower()
    document: dict[str, Any] = json.loads(quiet(lambda: pp.to_json(net)))
    return document
