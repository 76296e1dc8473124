"""Lines, transformers and impedances of pandapower as branches, as its power flow models them."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING

from certify.importing.network import NONE, Branch, Bus, Note, ZipRow
from certify.importing.numbers import from_float, inductance, root
from certify.importing.pandapower.rows import Row, missing
from certify.kernel.quantity import shorten

if TYPE_CHECKING:
    from certify.importing.pandapower.read import _Reader

ONE = Fraction(1)


def line(net: _Reader, row: Row) -> Branch | None:
    """A pi section. With an open switch at one end, or a bus out of service there, it stays connected at the other."""
    switches = net.switches.get(("line", row.index), [])
    kept = [row.label, *(s.label for s in switches if net.flag(s, "closed"))]
    ends = []
    for column in ("from_bus", "to_bus"):
        node, index = net.bus(row, column), net.whole(row, column)
        opened = [s.label for s in switches if not net.flag(s, "closed") and net.whole(s, "bus") == index]
        ends.append((node, index, opened))
    dead = [not node or bool(opened) for node, _, opened in ends]
    if all(dead):
        net.leave_out(row, "open at both ends, or its buses are out of service")
        for switch in switches:
            net.leave_out(switch, "its branch is left out")
        return None
    length = net.number(row, "length_km", "> 0") * 1000
    parallel = net.number(row, "parallel", "> 0")
    if parallel.denominator != 1:
        net.fault("I003", row, "parallel", f"not a whole number of lines: {float(parallel):g}")
    r = net.number(row, "r_ohm_per_km", ">= 0") / 1000
    x = net.number(row, "x_ohm_per_km") / 1000
    c = net.number(row, "c_nf_per_km", ">= 0") / 10**12
    g = net.number(row, "g_us_per_km", default=Fraction(0)) / 10**9
    if x <= 0 or r <= 0:
        which = "x_ohm_per_km" if x <= 0 else "r_ohm_per_km"
        net.fault(
            "I020", row, which, f"must be positive, as R and L of a line are; got {float(net.number(row, which)):g}"
        )
    volts = {net.volt[node] for node, _, _ in ends if node}
    if len(volts) > 1:
        net.fault("I003", row, "", "a line between buses of different nominal voltages")
    names = [_open_end(net, row, *end) if off else end[0] for end, off in zip(ends, dead, strict=True)]
    return Branch(
        net.branch_names.take(net.text(row, "name"), f"line-{row.index}"),
        names[0],
        names[1],
        r * length / parallel,
        inductance(x, net.w0) * length / parallel,
        c * length * parallel,
        (g * length * parallel, Fraction(0)),
        length,
        net.text(row, "std_type") + (f" x{parallel}" if parallel != 1 else ""),
        origins=tuple(kept),
    )


def _open_end(net: _Reader, row: Row, node: str, index: int | None, opened: list[str]) -> str:
    """A node of its own for the end of a line that is not connected, with half the line's capacitance."""
    name = net.bus_names.take(f"{net.text(row, 'name') or row.key} open", f"line-{row.index}-open")
    other = net.whole(row, "to_bus" if net.whole(row, "from_bus") == index else "from_bus")
    volt = net.volt.get(node or net.node.get(other, ""), ONE)
    net.buses[name] = Bus(name, volt, tuple(opened))
    net.volt[name] = volt
    net.notes.append(Note(row.label, f"not connected at bus {index}: it ends at a node of its own"))
    return name


def transformer(net: _Reader, row: Row) -> Branch | None:
    """An ideal ratio with tap and shift, and the short-circuit impedance as seen from the low-voltage side."""
    switches = net.switches.get(("trafo", row.index), [])
    high, low = net.bus(row, "hv_bus"), net.bus(row, "lv_bus")
    opened = {net.whole(s, "bus") for s in switches if not net.flag(s, "closed")}
    if not high or not low:
        _left_out(net, row, switches, "one of its buses is out of service")
        return None
    kilo = Fraction(1000)
    shift = net.number(row, "shift_degree")
    volts = {side: net.number(row, f"vn_{side}_kv", "> 0") * kilo for side in ("hv", "lv")}
    if net.flag(row, "tap_dependency_table", False):
        net.fault("I006", row, "tap_dependency_table", "a tap changer given by a table of characteristics")
    for tap in ("tap", "tap2"):
        side = net.text(row, f"{tap}_side")
        if side in volts:
            volts[side], turn = _tapped(net, row, tap, volts[side])
            shift += turn if side == "hv" else -turn
    power = net.number(row, "sn_mva", "> 0") * 10**6
    parallel = net.number(row, "parallel", "> 0")
    base = volts["lv"] ** 2 / power
    z = net.number(row, "vk_percent", "> 0") / 100 * base
    r = net.number(row, "vkr_percent", ">= 0") / 100 * base
    if not 0 < r < z:
        values = [float(net.number(row, column)) for column in ("vkr_percent", "vk_percent")]
        text = f"{values[0]:g} is not between 0 and vk_percent, {values[1]:g}: R and L of a branch are positive"
        net.fault("I020", row, "vkr_percent", text)
        z, r = 2 * base, base
    iron = net.number(row, "pfe_kw", ">= 0") * kilo
    idle = net.number(row, "i0_percent") / 100 * power
    magnetising = root(max(idle * idle - iron * iron, Fraction(0)))
    if iron or magnetising:
        text = "a pi section: half of what it draws without load at either side, as trafo_model='pi' of pandapower"
        net.notes.append(Note(row.label, text))
    made = Branch(
        "",
        high,
        low,
        r / parallel,
        inductance(root(z * z - r * r), net.w0) / parallel,
        shunt_siemens=(iron * parallel / volts["lv"] ** 2, magnetising * parallel / volts["lv"] ** 2),
        ratio=volts["hv"] / volts["lv"],
        shift_degree=shift,
        origins=(row.label, *(s.label for s in switches)),
    )
    closed_ends = [end for end in ("hv", "lv") if net.whole(row, f"{end}_bus") not in opened]
    if len(closed_ends) == 2:
        return replace(made, name=net.branch_names.take(net.text(row, "name"), f"trafo-{row.index}"))
    if not closed_ends or made.shunt_siemens == NONE:
        _left_out(net, row, switches, "open, and draws nothing")
        return None
    node = high if closed_ends == ["hv"] else low
    net.loads.append(_magnetised(made, node, net.volt[node], made.ratio if node == high else ONE, net.w0))
    net.notes.append(Note(row.label, "open at one side: what it draws from the other is a constant impedance there"))
    return None


def _left_out(net: _Reader, row: Row, switches: list[Row], reason: str) -> None:
    net.leave_out(row, reason)
    for switch in switches:
        net.leave_out(switch, "open, or its branch is left out")


def _magnetised(branch: Branch, node: str, volt: Fraction, ratio: Fraction, w0: Fraction) -> ZipRow:
    """What a transformer draws that is open at its other side: half its shunt, and the other half behind R and X."""
    g, b = (part / 2 for part in branch.shunt_siemens)
    size = g * g + b * b
    r, x = branch.resistance_ohm + g / size, branch.inductance_henry * w0 + b / size
    behind = r * r + x * x
    pair = ((g + r / behind) * (volt / ratio) ** 2, (b + x / behind) * (volt / ratio) ** 2)
    return ZipRow(node, volt, impedance=pair, origins=branch.origins)


def _tapped(net: _Reader, row: Row, tap: str, volt: Fraction) -> tuple[Fraction, Fraction]:
    """Rated voltage of a side with its tap changer, and by how many degrees it turns, as pandapower does it."""
    if missing(row.values.get(f"{tap}_pos")) or missing(row.values.get(f"{tap}_neutral")):
        net.notes.append(Note(row.label, f"its {tap}_pos or {tap}_neutral is missing: taken for the neutral position"))
        return volt, Fraction(0)
    steps = net.number(row, f"{tap}_pos") - net.number(row, f"{tap}_neutral")
    percent = net.number(row, f"{tap}_step_percent", default=Fraction(0), blank=True)
    degree = net.number(row, f"{tap}_step_degree", default=Fraction(0), blank=True)
    kind = net.text(row, f"{tap}_changer_type")
    if f"{tap}_changer_type" not in row.values and f"{tap}_phase_shifter" in row.values:  # pandapower 2
        kind = "Ideal" if net.flag(row, f"{tap}_phase_shifter", False) else "Ratio"
    if not steps:
        return volt, Fraction(0)
    if kind == "Ideal":
        if degree and percent:
            net.fault("I003", row, f"{tap}_step_degree", "both a step in degrees and one in percent")
        sine = max(-1.0, min(1.0, float(steps * percent / 200)))
        return volt, steps * degree if degree else from_float(math.degrees(2 * math.asin(sine)))
    if kind not in ("Ratio", "Symmetrical"):
        text = f"its {tap}_changer_type is {shorten(kind) if kind else 'not set'}, so its tap position has no effect"
        net.notes.append(Note(row.label, text))
        return volt, Fraction(0)
    share = steps * percent / 100
    if not degree:
        modulus, turn = abs(1 + share), Fraction(0)
    else:  # trigonometry in floats, to about 1e-16
        along = 1 + float(share) * math.cos(math.radians(float(degree)))
        across = float(share) * math.sin(math.radians(float(degree)))
        modulus, turn = from_float(math.hypot(along, across)), from_float(math.degrees(math.atan(across / along)))
    if not modulus:
        net.fault("I003", row, f"{tap}_pos", "at this tap position no voltage is left")
        modulus = ONE
    return volt * modulus, turn


def impedance(net: _Reader, row: Row) -> Branch | None:
    """A series impedance in per unit of its own power, with a shunt at either end."""
    start, end = net.bus(row, "from_bus"), net.bus(row, "to_bus")
    if not start or not end:
        net.leave_out(row, "one of its buses is out of service")
        return None
    power = net.number(row, "sn_mva", "> 0") * 10**6
    r, x = net.number(row, "rft_pu"), net.number(row, "xft_pu")
    if (r, x) != (net.number(row, "rtf_pu", default=r), net.number(row, "xtf_pu", default=x)):
        net.fault(
            "I006", row, "rtf_pu", "an impedance that depends on the direction is no branch of resistance and coil"
        )
    if r <= 0 or x <= 0:
        net.fault("I020", row, "rft_pu" if r <= 0 else "xft_pu", "must be positive: R and L of a branch are")
    base = net.volt[end] ** 2 / power
    for node, side in ((start, "f"), (end, "t")):
        g, b = (net.number(row, f"{part}{side}_pu", default=Fraction(0)) * power for part in "gb")
        if g or b:
            net.loads.append(ZipRow(node, net.volt[node], (g, -b), origins=(row.label,)))
    return Branch(
        net.branch_names.take(net.text(row, "name"), f"impedance-{row.index}"),
        start,
        end,
        r * base,
        inductance(x * base, net.w0),
        ratio=net.volt[start] / net.volt[end],
        origins=(row.label,),
    )
