"""Published networks through `certify import`: what becomes of them, and what pandapower says of the same.

    python tests/campaign_imports.py [--report reports/imports.md] [--only NAME]

CIGRE's medium-voltage network, all Kerber networks and two SimBench grids, once as published (all loads of constant power)
and once with shares of constant impedance and current: each with DGUs at the connection to the grid, and where it has sources
at these. For each: every load row at 0.9, 1.0 and 1.1 pu against pandapower's own power flow, to 1e-12; the proved equilibrium
against its power flow of the whole network, to 1e-6 pu; every row of every table accounted for once. Exit code 1 if any of
that fails.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))  # so that it runs as a script too

from certify.certificate import prove
from certify.importing import Placement, Settings
from certify.importing.pandapower.file import import_pandapower, load_net
from certify.kernel.claims import Verdict
from certify.report.importing import tables
from tests.campaign_loops import to_table
from tests.pandapower_oracle import flow, imported, quiet, worst_row, worst_voltage

DATA = Path(__file__).resolve().parent / "data" / "networks"
ROWS, VOLTS = 1e-12, 1e-6
SHARES = {"const_z_p_percent": 60.0, "const_i_p_percent": 20.0, "const_z_q_percent": 60.0, "const_i_q_percent": 20.0}


@dataclass(frozen=True)
class Result:
    name: str
    where: str
    loads: str
    counts: dict[str, int]
    constant: int
    stated: str
    left_out: str
    seconds: tuple[float, float]
    verdict: Verdict
    why: str
    row: float
    voltage: float | None
    diverges: bool
    lost: list[str]

    @property
    def wrong(self) -> bool:
        return self.row > ROWS or (self.voltage is not None and self.voltage > VOLTS) or bool(self.lost)


def networks() -> Iterator[tuple[str, Callable[[], Any]]]:
    import_pandapower()
    import pandapower.networks as library

    yield "CIGRE MV", library.create_cigre_network_mv
    yield "CIGRE MV with DER", lambda: library.create_cigre_network_mv(with_der="all")
    for name in sorted(x for x in dir(library) if x.startswith("create_kerber_")):
        yield name.removeprefix("create_").replace("_", " "), getattr(library, name)
    for file in sorted(DATA.glob("*.json")):
        yield f"SimBench {file.stem}", lambda file=file: load_net(str(file))


def flow_net(net: Any, network: Any, draft: Any, settings: Settings) -> Any:
    """The same island for pandapower: a stiff grid at each DGU instead of its sources, no transformer that is left out,
    and the capacitances that are stated.
    """
    pp, net = import_pandapower(), deepcopy(net)
    held = {source.bus: source for source in network.sources}
    for table in ("ext_grid", "sgen", "storage"):
        at = net[table].bus.map(lambda bus: network.aliases[str(bus)])
        net[table] = net[table][at.isin(held)] if table == "ext_grid" else net[table][~at.isin(held)]
    with_grid = set(net.ext_grid.bus.map(lambda bus: network.aliases[str(bus)]))
    for name in held.keys() - with_grid:
        pp.create_ext_grid(net, next(int(k) for k, v in network.aliases.items() if v == name and k.isdecimal()))
    gone = [int(u.element.split()[1]) for u in draft.unmapped if u.element.startswith("trafo ")]
    net.trafo.loc[gone, "in_service"] = False
    if settings.line_capacitance:
        net.line.loc[net.line.c_nf_per_km == 0, "c_nf_per_km"] = float(settings.line_capacitance * 10**12)
    return net


def lost_rows(net: Any, draft: Any) -> list[str]:
    """Rows that the import says nothing of, or speaks of twice."""
    rows = Counter(
        f"{key} {index}"
        for key, table in net.items()
        if hasattr(table, "itertuples") and not key.startswith(("_", "res_"))
        for index in table.index
    )
    told = Counter(e.split(" (")[0] for e in [*draft.mapped, *dict.fromkeys(u.element for u in draft.unmapped)])
    return sorted((rows - told) + (told - rows))


def study(name: str, net: Any, where: str, loads: str) -> Result:
    kinds = ("ext-grid",) if where == "grid" else tuple(k for k in ("static-generators", "storage") if _has(net, k))
    if loads == "shares":
        net = deepcopy(net)
        for column, share in SHARES.items():
            net.load[column] = share
    bare = bool((net.line.c_nf_per_km == 0).any())
    settings = Settings(line_capacitance=Fraction(1, 10**11) if bare else None)
    start = time.perf_counter()
    network, draft = imported(net, Placement(kinds=kinds), settings)
    middle = time.perf_counter()
    certificate = prove(draft.spec)
    verdict = certificate.verdict
    end = time.perf_counter()
    voltage: float | None = None
    diverges = False
    island = quiet(lambda: flow_net(net, network, draft, settings))
    if all(c.status == "proved" for c in verdict.claims if c.id.startswith("equilibrium/")):
        voltage = worst_voltage(island, network, draft, by_row=True)
    else:
        from pandapower import LoadflowNotConverged

        try:
            flow(island, by_row=True)
        except LoadflowNotConverged:
            diverges = True
    return Result(
        name,
        where,
        loads,
        draft.counts,
        draft.constant_power,
        "lines: 10 nF/km" if bare else "",
        tables(u.element for u in draft.unmapped),
        (middle - start, end - middle),
        verdict,
        reasons(verdict, certificate.notes),
        worst_row([(net, network, draft)])[0],
        voltage,
        diverges,
        lost_rows(net, draft),
    )


def _has(net: Any, kind: str) -> bool:
    return bool(len(net["sgen" if kind == "static-generators" else kind]))


def reasons(verdict: Verdict, notes: Mapping[str, str]) -> str:
    """Kinds of claims that are not proved, with their status, and the rule or code why."""
    counts = Counter(
        (c.id.split("/")[0], c.status, c.rule or notes.get(c.id, "follows from others"))
        for c in verdict.claims
        if c.status != "proved"
    )
    return ", ".join(f"{count} {kind} {status} ({why})" for (kind, status, why), count in counts.items())


def to_report(results: list[Result]) -> str:
    import pandapower

    head = f"""# Networks of others, imported

`python tests/campaign_imports.py --report reports/imports.md`: networks of pandapower {pandapower.__version__} and SimBench through
`certify import`, on one core. *DGUs at*: the connection to the grid, or the static generators and storages of the network, then
without that connection. *loads*: as published, which is constant power throughout; or every row with 60 % constant
impedance, 20 % constant current and 20 % constant power, active and reactive. Filters and controllers are the placeholders
of the import, so this is about networks and loads, not about anyone's inverters.

*row*: the largest relative difference, over all load rows at 0.9, 1.0 and 1.1 pu, between the power in the spec and what
pandapower's power flow gives that row, alone at a bus. *flow*: the largest difference of a voltage phasor, in pu, between
the proved equilibrium and pandapower's power flow of the same island. There pandapower would give the mean shares of a bus
to all that is connected to it, sources included, by which rows that differ lose power; so its loads are set to what their
rows draw at the voltage found, until that does not change. *diverges*: certify finds no equilibrium, and that power flow
does not converge either. Every row of every table is in the spec or listed as left out.

Loads of constant power are not monotone, so their claims are refuted, and with that nothing is claimed about the network;
the equilibrium is proved nevertheless, but for others further away. With the shares all is certified, except where sources
that are no DGUs feed constant power in (refuted at their buses), or there is no equilibrium to be found.

"""
    columns = [
        "network",
        "DGUs at",
        "loads",
        "nodes, DGUs, lines, load rows",
        "stated",
        "left out",
        "import s",
        "prove s",
        "verdict",
        "not proved",
        "row",
        "flow",
    ]
    rows: list[list[object]] = [
        [
            r.name,
            r.where,
            r.loads,
            ", ".join(map(str, r.counts.values())),
            r.stated,
            r.left_out,
            f"{r.seconds[0]:.2f}",
            f"{r.seconds[1]:.2f}",
            r.verdict.outcome,
            r.why,
            f"{r.row:.1e}",
            ("diverges" if r.diverges else "") if r.voltage is None else f"{r.voltage:.1e}",
        ]
        for r in results
    ]
    return head + "\n".join(to_table(columns, rows, 3)) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="networks whose name has this in it")
    parser.add_argument("--report", type=Path, help="write the report to this file")
    arguments = parser.parse_args()
    results: list[Result] = []
    for name, make in networks():
        if arguments.only.lower() not in name.lower():
            continue
        net = quiet(make)
        for where in ("grid", "sources") if _has(net, "static-generators") else ("grid",):
            for loads in ("as published", "shares"):
                result = study(name, net, where, loads)
                results.append(result)
                told = f"{result.verdict.outcome}; {result.why or 'all proved'}"
                print(
                    f"{name}, {where}, {loads}: {told}; {result.row:.1e}, {result.voltage}", file=sys.stderr, flush=True
                )
                if result.wrong:
                    print(f"  WRONG: {result.lost}", file=sys.stderr)
    report = to_report(results)
    if arguments.report:
        arguments.report.write_text(report)
    else:
        sys.stdout.write(report)
    return int(any(result.wrong for result in results))


if __name__ == "__main__":
    sys.exit(main())
