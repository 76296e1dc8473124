"""What may be wrong with a spec."""

from __future__ import annotations

from certify.diagnostics.entry import Diagnostic

_SMALLEST = """format = "certify/microgrid@1"
frequency = "50 Hz"
[filter.lc]
R = "0.1 ohm"
L = "1.8 mH"
C = "25 uF"
[controller.phs]
kind = "ida-pbc"
alpha = -5
nu = 1
ki = 100
[node.a]
dgu = { filter = "lc", controller = "phs", reference = ["20 kV", "0 V"] }
load = [{ kind = "rl", R = "50 ohm", L = "0.1 H" }]"""

ENTRIES = (
    Diagnostic(
        "S000",
        "the file cannot be read",
        "It does not exist, is a directory, or may not be read.",
        "check the path",
    ),
    Diagnostic(
        "S001",
        "not UTF-8 text",
        "Specs and certificates are UTF-8, so that a hash of the bytes means one text.",
        "save the file as UTF-8",
    ),
    Diagnostic(
        "S002",
        "not valid TOML or JSON",
        "A file that starts with { is read as JSON, any other as TOML.",
        "the message names the place; a smallest spec is in `certify explain S002`. A table of loads is for `certify "
        "loads`",
        _SMALLEST,
    ),
    Diagnostic(
        "S003",
        "absurdly large or deep",
        "Input that no microgrid needs is refused before it costs time.",
        "generated specs of many nodes belong into JSON",
    ),
    Diagnostic(
        "S101",
        "unknown key",
        "A misspelt key that was ignored would change what is proved.",
        "remove it or spell it as the format does",
    ),
    Diagnostic("S102", "missing key", "Nothing that changes the model has a silent default.", "add the key"),
    Diagnostic(
        "S103",
        "wrong shape",
        "A table, list or text stands where the format has another.",
        "compare with the specs in the folder specs/",
    ),
    Diagnostic(
        "S105",
        "not a usable name",
        "Names appear in paths, claims and reports.",
        "letters, digits, _ . : + - and inner spaces; in `let` a word that is not R, L, C or w0",
    ),
    Diagnostic(
        "S107",
        "not one of the choices",
        "The kind decides which equations a part has.",
        "take one of the words in the message",
        'kind = "zip"',
    ),
    Diagnostic("S108", "too many faults", "Only the first ones are listed.", "mend these first"),
    Diagnostic(
        "S201",
        "not a number",
        "Numbers are finite decimals and mean exactly what they say.",
        'write for example 1.8e-3 or "1.8 mH"',
        'L = "1.8 mH"',
    ),
    Diagnostic(
        "S202",
        "absurd size",
        "Numbers are bounded in length, exponent and value, so that hostile input costs nothing.",
        "the message names the bound",
    ),
    Diagnostic(
        "S203",
        "wrong unit",
        "The unit must measure what the key asks for; prefixes f to T may stand before it.",
        "ohm, H, F, S, V, A, W, var, VA, Hz, s, m, pu, per metre for lines, % for pure numbers; a bare number is SI",
        'R = "0.343 ohm/km"',
    ),
    Diagnostic(
        "S204",
        "per unit without a base",
        "pu means nothing without base_voltage, and for powers, currents and impedances base_power.",
        "give the base, or the value in SI",
        'base_voltage = "20 kV"',
    ),
    Diagnostic(
        "S205",
        "formula cannot be read",
        "Formulas have numbers, names, + - * / ^ and parentheses; ^ takes a small whole number.",
        "write it with numbers, names, + - * / ^ and parentheses only; there are no functions",
        'K11 = "1 - kp*L"',
    ),
    Diagnostic(
        "S206",
        "unknown name in a formula",
        "For gains R, L, C, w0 of the controller's design are in scope, and the names of `let` before it; for the "
        "current of a load only Vd and Vq.",
        "define it in `let` of the controller, or write the number",
        "let = { kp = 1000 }",
    ),
    Diagnostic("S207", "division by zero", "The gain has no value.", "check the numbers that the formula uses"),
    Diagnostic(
        "S208",
        "wrong sign",
        "Inductances, capacitances, lengths, voltages of a band and the resistance of a line are positive; "
        "a filter's resistance may be zero.",
        "check the sign, and that it is not zero",
    ),
    Diagnostic(
        "S209",
        "not a tolerance",
        "A tolerance is a share of the value. At 100 % the box contains zero, where the model has no meaning.",
        "give a share of the value, from 0 % up to but not including 100 %",
        'tolerance = "10 %"',
    ),
    Diagnostic(
        "S210",
        "tolerance of a filter under a linear loop",
        "F, B and C of a linear loop hold plant and controller in one; what varies in them is not known.",
        'leave the tolerance out, or give that filter tolerance = "0 %"',
    ),
    Diagnostic(
        "S211",
        "unstable cancellation",
        "A mode that grows by itself and that the port does not show or reach cancels in the transfer function. It is "
        "unstable in every network, however passive the loop looks from outside.",
        "check the signs in F; leave out states that have no effect",
    ),
    Diagnostic(
        "S212",
        "anti-windup that cannot act",
        "Back-calculation moves the integrators by K13^-1 (sat(u) - u)/T while an axis is at its limit: it needs "
        "limits, and an integral gain K13 that can be inverted (for ida-pbc alpha and ki not zero on both axes).",
        "give limits and a controller with integral action on both axes, or leave anti_windup out",
        'dgu = { filter = "lc", controller = "pi", reference = ["20 kV", 0], limits = ["25 kV", "25 kV"], '
        'anti_windup = "20 ms" }',
    ),
    Diagnostic(
        "S301", "line to nowhere", "Both ends of a line are names of nodes.", "define the node, or mend the name"
    ),
    Diagnostic("S302", "self-loop", "A line joins two different nodes.", "mend `from` or `to`"),
    Diagnostic("S303", "two lines of one name", "Claims are named after lines.", "rename one"),
    Diagnostic(
        "S304",
        "island without a DGU",
        "Without an inverter nothing forms a voltage there, so there is no equilibrium to speak of.",
        "connect it, give it a DGU, or leave it out",
    ),
    Diagnostic(
        "S305",
        "node without capacitance",
        "At a node without a DGU the voltage is the state of the line legs; without any it is no state.",
        "give its lines a C, or the node a capacitance",
        'capacitance = "10 nF"',
    ),
    Diagnostic("S306", "not defined", "Filters, controllers and line types are defined by name.", "define it"),
    Diagnostic(
        "S307",
        "empty voltage band",
        "The claim on a load must hold between two voltages, the lower first.",
        "give two positive voltages in order",
        'voltage_band = ["0.6 pu", "1.2 pu"]',
    ),
    Diagnostic("S308", "no node", "A microgrid has at least one node with a DGU.", "define one"),
    Diagnostic("S309", "event out of time", "Events come before the end of their scenario.", "mend `at` or `end`"),
    Diagnostic(
        "S310",
        "a load given by its current that cannot be added up",
        "The sum of the loads at a node must stay a quotient of polynomials in Vd and Vq, on one disk.",
        "move the other loads to a node of their own, or write them into the formula",
        'load = [{ kind = "current", I = ["Vd/50", "Vq/50"], centre = ["1 pu", "0 pu"], radius = "0.2 pu" }]',
    ),
    Diagnostic(
        "S311",
        "switched to where it is already",
        "Events are followed in order of time, from what `disconnected` names: what is on cannot be connected, and "
        "what is off cannot be disconnected.",
        "mend the times of the events, or `disconnected`",
        'disconnected = ["5"]\nevent = [{ at = "4 s", connect = "5" }, { at = "6 s", disconnect = "5" }]',
    ),
    Diagnostic(
        "S314",
        "not the index of a load",
        "A load is named by its node and its place in the node's list of loads as it stands in the spec, counted from "
        "0, whatever is off.",
        "mend `index`, or leave it out for the first load",
        'disconnected = [{ load = "8", index = 1 }]\nevent = [{ at = "4 s", connect = { load = "8", index = 1 } }]',
    ),
    Diagnostic(
        "S315",
        "a controller with other states",
        "An event may give a DGU another controller whose integrator can take over. A linear loop has states of its "
        "own, of which nothing is known but their number: it can only be changed for one with as many.",
        "take a controller of such a kind, or disconnect this DGU and connect another",
        'event = [{ at = "4 s", controller = "5", set = "pi" }]',
    ),
    Diagnostic(
        "S312",
        "a name of two things",
        "Events name a DGU by its node, so they cannot tell it from a line of the same name.",
        "rename the line",
    ),
    Diagnostic(
        "S313",
        "a load that events cannot change",
        "An event sets coefficients of a load: of a ZIP load Y, I, P, of an exponential one P0, np, Q0, nq, of a "
        "series R-L load R, L.",
        "name a zip, exp or rl load by its `index`, counted from 0 in the list of the node's loads",
        'event = [{ at = "5 s", load = "5", set = { Y = ["120 uS", "120 uS"] } }]',
    ),
)
