"""Networks of pandapower: its tables, with bus-bus switches closed and each row accounted for.

What a row means is what pandapower's power flow does with it, with the pi model for transformers: a tested property.
Every row of every table ends up in the spec, or in the list of what was left out with the reason, or is refused.
"""

from __future__ import annotations

from collections import defaultdict
from fractions import Fraction
from typing import Any

from certify.importing.names import Names
from certify.importing.network import NONE, Branch, Bus, ExpRow, Network, Source, ZipRow
from certify.importing.numbers import inductance, root
from certify.importing.pandapower.branches import impedance, line, transformer
from certify.importing.pandapower.generating import SOURCES, read_sources
from certify.importing.pandapower.loads import (
    asymmetric_load,
    asymmetric_sgen,
    load,
    motor,
    sgen,
    shunt,
    storage,
    ward,
)
from certify.importing.pandapower.rows import Reading, Row, first_of
from certify.importing.settings import Placement
from certify.kernel.errors import Fault, SpecError
from certify.kernel.quantity import shorten
from certify.kernel.spec import angular_frequency

ROWS = {
    "load": load,
    "sgen": sgen,
    "storage": storage,
    "motor": motor,
    "ward": ward,
    "shunt": shunt,
    "asymmetric_load": asymmetric_load,
    "asymmetric_sgen": asymmetric_sgen,
}
BRANCHES = {"line": line, "trafo": transformer, "impedance": impedance}
# Tables of pandapower that change what flows, and that a spec cannot express; `in_service` says which rows do.
REFUSED = {
    "gen": "a machine that holds its voltage, where no DGU is placed: --dgus-at generators places one",
    "trafo3w": "a transformer with three windings",
    "dcline": "a direct-current link between buses",
    "svc": "a controlled reactance",
    "ssc": "a controlled source of reactive power",
    "tcsc": "a controlled series capacitor",
    "vsc": "a converter to a direct-current network",
    "vsc_stacked": "a converter to a direct-current network",
    "vsc_bipolar": "a converter to a direct-current network",
    "b2b_vsc": "a converter between alternating-current networks",
}
LEFT_OUT = {
    "ext_grid": "the grid outside, which an island has not",
    "xward": "an equivalent of the grid outside, which an island has not",
    "bus_dc": "direct current: no part of the three-phase network",
    "line_dc": "direct current: no part of the three-phase network",
    "load_dc": "direct current: no part of the three-phase network",
    "source_dc": "direct current: no part of the three-phase network",
    "measurement": "a measurement",
    "pwl_cost": "a cost",
    "poly_cost": "a cost",
    "controller": "a controller of pandapower's own, which acts between power flows",
    "group": "a group of other elements",
}


def from_net(net: Any, origin: str, placement: Placement) -> Network:
    """The network of a pandapowerNet of pandapower 3. `origin` says where it comes from.

    Units: of pandapower's tables; the result is in SI. Raises: SpecError I003 to I007, with all faults.
    """
    return _Reader(net, placement).network(origin)


class _Reader(Reading):
    """Buses by their index in the net; `node` is the name of the bus in the spec that one belongs to."""

    def __init__(self, net: Any, placement: Placement) -> None:
        super().__init__()
        self.placement = placement
        self.tables = {
            key: tuple(
                Row(key, index, dict(zip(map(str, table.columns), cells, strict=True)))
                for index, cells in zip(table.index, table.itertuples(index=False, name=None), strict=True)
            )
            for key, table in net.items()
            if hasattr(table, "itertuples") and len(table) and not key.startswith(("_", "res_"))
        }
        self.net_name = str(net.get("name") or "")
        head = Row("net", "", {"f_hz": net.get("f_hz", 50), "sn_mva": net.get("sn_mva", 1)})
        self.frequency = self.number(head, "f_hz", "> 0")
        self.w0 = angular_frequency(self.frequency)
        self.bus_names, self.branch_names = Names(), Names()
        self.node: dict[Any, str] = {}
        self.volt: dict[str, Fraction] = {}
        self.buses: dict[str, Bus] = {}
        self.branches: list[Branch] = []
        self.loads: list[ZipRow | ExpRow] = []
        self.out_of_service: set[Any] = set()
        self.switches: dict[tuple[str, Any], list[Row]] = defaultdict(list)

    def network(self, origin: str) -> Network:
        self.ask_what_to_leave_out()
        self.read_buses()
        sources = read_sources(self)
        for table, rows in self.tables.items():
            if table not in ("bus", "switch"):
                for row in rows:
                    self.read(row, sources)
        if self.faults:
            raise SpecError(first_of(self.faults))
        return Network(
            self.net_name,
            origin,
            self.frequency,
            tuple(self.buses.values()),
            tuple(self.branches),
            tuple(self.loads),
            tuple(sources.values()),
            tuple(self.unmapped),
            tuple(self.notes),
            self.aliases(),
        )

    def ask_what_to_leave_out(self) -> None:
        for table in self.placement.leave_out:
            if table in ("bus", "switch") or table not in self.tables:
                known = ", ".join(key for key in self.tables if key not in ("bus", "switch"))
                text = f"{shorten(table)} cannot be left out; tables with rows: {known}"
                self.faults.append(Fault("I006", "--leave-out", text))

    def read(self, row: Row, sources: dict[str, Source]) -> None:
        """One row of any table but buses and switches: into the network, or why not."""
        if row.table in self.placement.leave_out:
            self.leave_out(row, "left out as asked")
        elif row.table not in {*ROWS, *BRANCHES, *REFUSED, *SOURCES.values()}:
            self.leave_out(row, LEFT_OUT.get(row.table, "a table that no power flow reads"))
        elif not self.flag(row, "in_service"):
            self.leave_out(row, "out of service")
        elif row.table in BRANCHES:
            branch = BRANCHES[row.table](self, row)
            if branch is not None:
                self.branches.append(branch)
        elif row.table in LEFT_OUT:
            if self.bus(row) not in sources or row.label not in sources[self.bus(row)].origins:
                self.leave_out(row, LEFT_OUT[row.table])
        else:
            self.read_at_bus(row, sources)

    def read_at_bus(self, row: Row, sources: dict[str, Source]) -> None:
        if row.table in ("gen", *ROWS):
            node = self.bus(row)
            if not node:
                self.leave_out(row, "its bus is out of service")
                return
            if node in sources and row.label in sources[node].origins:
                return
            if row.table in ROWS:
                made = ROWS[row.table](self, row, node)
                if made is None or made.apparent == NONE:
                    self.leave_out(row, "draws nothing")
                else:
                    self.loads.append(made)
                return
        self.fault("I006", row, "", f"{REFUSED[row.table]}; --leave-out {row.table} does without")

    # Buses

    def read_buses(self) -> None:
        known = {row.index: row for row in self.tables.get("bus", ())}
        parent = {index: index for index, row in known.items() if self.flag(row, "in_service")}
        self.out_of_service = known.keys() - parent.keys()
        for index in known:
            if index in self.out_of_service:
                self.leave_out(known[index], "out of service")
        with_impedance, closed = [], []
        place = {index: k for k, index in enumerate(parent)}

        def first(index: Any) -> Any:
            while parent[index] != index:
                parent[index] = parent[parent[index]]
                index = parent[index]
            return index

        for row in self.tables.get("switch", ()):
            kind, bus, other = self.text(row, "et"), self.whole(row, "bus"), self.whole(row, "element")
            if kind != "b":
                self.switches[{"l": "line", "t": "trafo", "t3": "trafo3w"}.get(kind, kind), other].append(row)
            elif bus not in known or other not in known:
                self.fault("I004", row, "bus" if bus not in known else "element", "there is no such bus")
            elif not self.flag(row, "closed"):
                self.leave_out(row, "open")
            elif bus not in parent or other not in parent:
                self.leave_out(row, "one of its buses is out of service")
            elif self.number(row, "z_ohm", ">= 0", Fraction(0)):
                with_impedance.append((row, bus, other))
            else:
                closed.append((row, bus, other))
                low, high = sorted((first(bus), first(other)), key=place.__getitem__)
                parent[high] = low
        groups: dict[Any, list[Any]] = defaultdict(list)
        for index in parent:
            groups[first(index)].append(index)
        origins: dict[Any, list[str]] = {root_: [known[k].label for k in group] for root_, group in groups.items()}
        for row, bus, _ in closed:
            origins[first(bus)].append(row.label)
        for root_, group in groups.items():
            volts = [self.number(known[k], "vn_kv", "> 0") * 1000 for k in group]
            for k, volt in zip(group, volts, strict=True):
                if volt != volts[0]:
                    self.fault(
                        "I003", known[k], "vn_kv", f"another nominal voltage than bus {group[0]}, joined by a switch"
                    )
            name = self.bus_names.take(self.text(known[group[0]], "name"), f"bus-{group[0]}")
            self.buses[name] = Bus(name, volts[0], tuple(origins[root_]))
            self.volt[name] = volts[0]
            self.node |= dict.fromkeys(group, name)
        for row, bus, other in with_impedance:
            self.branches.append(self.switch_with_impedance(row, self.node[bus], self.node[other]))
        self.check_switches()

    def switch_with_impedance(self, row: Row, start: str, end: str) -> Branch:
        """z_ohm with R/X = 2, which is what pandapower takes unless it is told otherwise."""
        z = self.number(row, "z_ohm")
        x = root(z * z / 5)
        name = self.branch_names.take(self.text(row, "name"), f"switch-{row.index}")
        return Branch(name, start, end, 2 * x, inductance(x, self.w0), origins=(row.label,))

    def check_switches(self) -> None:
        """Switches at branches belong to one that is there, at one of its ends."""
        ends = {
            "line": ("from_bus", "to_bus"),
            "trafo": ("hv_bus", "lv_bus"),
            "trafo3w": ("hv_bus", "mv_bus", "lv_bus"),
        }
        branches = {(table, row.index): row for table in ends for row in self.tables.get(table, ())}
        for (table, index), rows in self.switches.items():
            branch = branches.get((table, index))
            for row in rows:
                if branch is None:
                    self.fault("I004", row, "element", f"there is no {table} {index}")
                elif self.whole(row, "bus") not in [self.whole(branch, end) for end in ends[table]]:
                    self.fault("I004", row, "bus", f"not a bus of {branch.key}")
        left = {(t, i) for t, i in branches if t in self.placement.leave_out or t == "trafo3w"}
        left |= {key for key, row in branches.items() if not self.flag(row, "in_service")}
        for key in left:
            for row in self.switches.get(key, ()):
                self.leave_out(row, "its branch is left out")

    def bus(self, row: Row, column: str = "bus") -> str:
        """The node that a row is at; empty if its bus is out of service, or is not there, which is a fault."""
        index = self.whole(row, column)
        if index not in self.node and index not in self.out_of_service:
            self.fault("I004", row, column, f"there is no bus {row.values.get(column)}")
        return self.node.get(index, "")

    def aliases(self) -> dict[str, str]:
        """Index and name of each bus, as options may call it; the index comes first. A name of several is none."""
        named: dict[str, set[str]] = defaultdict(set)
        for row in self.tables.get("bus", ()):
            if row.index in self.node:
                named[self.text(row, "name")].add(self.node[row.index])
        result = {
            name: next(iter(nodes)) if len(nodes) == 1 else f"{name}, a name of {len(nodes)} buses"
            for name, nodes in named.items()
        }
        return result | {str(index): node for index, node in self.node.items()}
