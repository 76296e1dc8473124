"""Rows of pandapower that draw power at one bus: each as its row says, never averaged over a bus."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

from certify.importing.network import Pair, ZipRow
from certify.importing.numbers import root
from certify.importing.pandapower.rows import Row, missing

if TYPE_CHECKING:
    from certify.importing.pandapower.read import _Reader

MEGA = 10**6
ZERO, ONE = Fraction(0), Fraction(1)


def _power(net: _Reader, row: Row, p: str = "p_mw", q: str = "q_mvar") -> Pair:
    """Watt and var of a row, scaled."""
    scaling = net.number(row, "scaling")
    return net.number(row, p) * scaling * MEGA, net.number(row, q) * scaling * MEGA


def load(net: _Reader, row: Row, node: str) -> ZipRow:
    """P(v) = p_mw scaling (z v^2 + i v + 1 - z - i), v in pu of the bus, and Q alike with percentages of its own."""
    power = _power(net, row)
    shares = []
    for part in "zi":
        pair = []
        for kind in "pq":
            column = f"const_{part}_{kind}_percent"
            older = f"const_{part}_percent"  # of pandapower 2, for both
            name = older if column not in row.values and older in row.values else column
            pair.append(net.number(row, name, default=ZERO) / 100)
        shares.append(pair)
    z, i = shares
    return ZipRow(
        node,
        net.volt[node],
        (power[0] * z[0], power[1] * z[1]),
        (power[0] * i[0], power[1] * i[1]),
        (power[0] * (1 - z[0] - i[0]), power[1] * (1 - z[1] - i[1])),
        (row.label,),
    )


def _constant(net: _Reader, row: Row, node: str, power: Pair) -> ZipRow:
    return ZipRow(node, net.volt[node], power=power, origins=(row.label,))


def sgen(net: _Reader, row: Row, node: str) -> ZipRow:
    """A source of constant power: a load with the other sign."""
    p, q = _power(net, row)
    return _constant(net, row, node, (-p, -q))


def storage(net: _Reader, row: Row, node: str) -> ZipRow:
    """Constant power, positive while it charges."""
    return _constant(net, row, node, _power(net, row))


def motor(net: _Reader, row: Row, node: str) -> ZipRow:
    """The electrical power that the mechanical one needs, at its power factor; constant, as in pandapower."""
    share = net.number(row, "loading_percent", ">= 0") / 100 * net.number(row, "scaling")
    efficiency = net.number(row, "efficiency_percent", "> 0") / 100
    p = net.number(row, "pn_mech_mw") * MEGA / efficiency * share
    cosine = net.number(row, "cos_phi", "> 0")
    if cosine > 1:
        net.fault("I003", row, "cos_phi", f"a power factor above one: {float(cosine):g}")
        cosine = ONE
    s = p / cosine
    return _constant(net, row, node, (p, root(s * s - p * p)))


def ward(net: _Reader, row: Row, node: str) -> ZipRow:
    """Constant power and constant impedance, the latter at nominal voltage."""
    constant = (net.number(row, "ps_mw") * MEGA, net.number(row, "qs_mvar") * MEGA)
    fixed = (net.number(row, "pz_mw") * MEGA, net.number(row, "qz_mvar") * MEGA)
    return ZipRow(node, net.volt[node], fixed, power=constant, origins=(row.label,))


def shunt(net: _Reader, row: Row, node: str) -> ZipRow:
    """A constant impedance that draws `step` times its power at its own voltage; a capacitor has a negative q_mvar."""
    if net.flag(row, "step_dependency_table", False):
        net.fault("I006", row, "step_dependency_table", "a shunt given by a table of characteristics")
    steps = net.number(row, "step", ">= 0")
    own = net.volt[node] if missing(row.values.get("vn_kv")) else net.number(row, "vn_kv", "> 0") * 1000
    power = (net.number(row, "p_mw") * steps * MEGA, net.number(row, "q_mvar") * steps * MEGA)
    share = (net.volt[node] / own) ** 2
    return ZipRow(node, net.volt[node], (power[0] * share, power[1] * share), origins=(row.label,))


def asymmetric_load(net: _Reader, row: Row, node: str, sign: int = 1) -> ZipRow:
    """Three times the power of one phase, if all three are equal."""
    phases = [(net.number(row, f"p_{phase}_mw"), net.number(row, f"q_{phase}_mvar")) for phase in "abc"]
    if len(set(phases)) > 1:
        listed = ", ".join(f"{float(p):g} MW + {float(q):g} Mvar" for p, q in phases)
        net.fault("I005", row, "", f"three-phase unbalance: the phases draw {listed}")
    scaling = net.number(row, "scaling") * sign * 3 * MEGA
    return _constant(net, row, node, (phases[0][0] * scaling, phases[0][1] * scaling))


def asymmetric_sgen(net: _Reader, row: Row, node: str) -> ZipRow:
    """As an asymmetric load, with the other sign."""
    return asymmetric_load(net, row, node, -1)


def rating(net: _Reader, row: Row) -> Fraction | None:
    """VA of a source: sn_mva, or else the size of its power; None if it says neither."""
    if not missing(row.values.get("sn_mva")):
        rated = net.number(row, "sn_mva", ">= 0")
        if rated:
            return rated * MEGA
    if row.table == "ext_grid":
        return None
    p, q = (abs(x) for x in _power(net, row))
    return root(p * p + q * q) or None
