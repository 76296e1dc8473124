"""What each code means, why it matters and what to try: data for `certify explain` and for the help of messages."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Diagnostic:
    """A stable code with its title, the reason behind it, and what to try. `example` is a short good input."""

    code: str
    title: str
    why: str
    remedy: str
    example: str = ""


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

# The name of a note that is evidence for people, beside the code why a claim is open.
IN_FLOATS = "in floats"

_ALL = (
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
    Diagnostic(
        "U001",
        "usage",
        "The command line does not fit the command.",
        "see `certify --help` and `certify COMMAND --help`",
    ),
    Diagnostic(
        "U002",
        "no such scenario",
        "`--scenario` takes the NAME of a table [scenario.NAME] of the spec.",
        "take one of the names in the message, or add the table to the spec",
        '[scenario.plug-in]\nend = "8 s"\ndisconnected = ["5"]\nevent = [{ at = "4 s", connect = "5" }]',
    ),
    Diagnostic(
        "U003",
        "no certificate to reuse",
        "Proofs can be tried again only if the file is a certificate of a microgrid, of whatever spec.",
        "name a file that `certify prove SPEC -o CERT` has written, or leave --reuse out",
    ),
    Diagnostic(
        "U005",
        "a number with which nothing can be simulated",
        "A simulation begins at 0 s and ends after it, a scenario not after its own end; its tolerance is what each "
        "step may add to the error of a state, as a share of its size; errors within the band count as settled.",
        '--end "0.5 s", not after the end of the scenario; --tolerance 1e-13 to 1e-2; --samples 1 or more; --band '
        '"2 V", "0.0001 pu" or "0.01 %"',
    ),
    Diagnostic(
        "U006",
        "not a state to start from",
        "A start is flat (each node at the reference of the nearest DGU, no currents), zero, equilibrium, or a FILE: "
        "samples written by `certify simulate -o` (.npz or .csv), of which the last is taken, or JSON with a number in "
        "SI for each column of what is on in the first phase, by name, or a list of all columns. What is off may be "
        "null.",
        "begin with the columns of `certify simulate SPEC -o state.csv`, which has their names and units",
        '{"voltage at node a, d": 20000, "voltage at node a, q": 0, ...}',
    ),
    Diagnostic(
        "U007",
        "more than fits into memory",
        "All samples of all states are kept, as one table of numbers.",
        "fewer --samples, or a shorter --end",
    ),
    Diagnostic(
        "U008",
        "no certificate to cross-check",
        "A simulation without a scenario is compared with the certificate of the spec; one of a scenario with those of "
        "its phases, which are specs of their own.",
        "`certify prove SPEC -o CERT` and --check CERT, or `certify prove SPEC --scenario NAME -o FOLDER` and --check "
        "FOLDER; or `certify prove SPEC [--scenario NAME] --simulate`, which does both",
    ),
    Diagnostic(
        "U010",
        "no committed certificate",
        "With --require-certificate nothing is proved: what passes has a certificate that the kernel accepts.",
        "`certify gate --write SPEC` or `certify prove SPEC -o NAME.cert.json`, and commit what it writes; or leave "
        "--require-certificate out",
    ),
    Diagnostic(
        "U011",
        "certificate of another state of the spec",
        "A certificate is about the bytes of one spec. This one has changed since, so nothing is known of it.",
        "`certify gate --write SPEC` proves it as it is now and replaces the certificate; commit both",
    ),
    Diagnostic(
        "U012",
        "certificate too old, or of unknown age",
        "--max-age asks when a certificate was made. Certificates carry no time unless that is asked for, so that the "
        "same spec gives the same bytes. The time is a remark of whoever made the certificate: nothing proves it.",
        "`certify prove SPEC --stamp -o CERT`, or delete it and let `certify gate --write --stamp SPEC` write it again",
    ),
    Diagnostic(
        "U013",
        "not a credible time",
        "The time of a certificate cannot be read, or lies in the future: then its age means nothing.",
        "check the clock, and write it again with `certify prove SPEC --stamp -o CERT`",
    ),
    Diagnostic(
        "U014",
        "a baseline that cannot be used",
        "What was so before excuses what is no worse now, so it must be readable, and not the certificate that is "
        "judged itself.",
        "--baseline FOLDER with the certificates of the base branch, such as of `git worktree add base "
        "origin/main`, or FILE with what `certify gate --json` printed there",
    ),
    Diagnostic(
        "U015",
        "a certificate without its spec",
        "A certificate NAME.cert.json is read together with NAME.toml or NAME.json, which is the spec that it proves.",
        "name the spec; put the certificate beside it, or say where certificates are with --certificates FOLDER",
    ),
    Diagnostic(
        "U020",
        "the report of a test session cannot be written",
        "It is checked before the run, so that no proof is lost: a folder that is there or can be made, or a file .md "
        "or .json in one.",
        "--certify-report FOLDER, or --certify-report FILE.md",
    ),
    Diagnostic(
        "U030",
        "a value that no spec can hold",
        "A spec has text, numbers, lists and tables. From Python these are str, int, float, Fraction, Decimal, complex "
        "(a pair [d, q]), scalars and arrays of numpy, lists, tuples and mappings.",
        "convert the value first, for example with `.tolist()` or `float()`",
        "certify.prove({'frequency': 50, 'node': {'a': ...}, ...})",
    ),
    Diagnostic(
        "U031",
        "text where a path is expected",
        "A str names a file. The text of a spec or certificate itself is given as bytes, because that is what "
        "certificates are about.",
        "`text.encode()`, or the path of a file",
        "certify.prove(text.encode())",
    ),
    Diagnostic(
        "U032",
        "a file that cannot be written",
        "Files are written whole beside their place and then renamed, so a file that was there is as it was.",
        "take a folder that is there and that you may write to",
    ),
    Diagnostic(
        "U033",
        "no such part to model",
        "A model is of the DGU at a node, of a line, or of a DGU with axes held at limits that it has.",
        "take one of the names in the message",
        "certify.dgu_model(spec, 'a'); certify.line_model(spec, 'a-b')",
    ),
    Diagnostic(
        "U034",
        "no such code",
        "What can be explained are certificates, the codes of messages, and the names of proof rules.",
        "take one of those in the message",
        "certify.explain('S203'); certify.explain(certify.prove(spec))",
    ),
    Diagnostic(
        "U035",
        "nothing at this place of the spec",
        "Places are named as messages name them: filter.lc.L, node.a.load[0].P, and lines by their names, line.a-b.R.",
        "take a key that is there, or a new key of a table that is there",
        "spec.replace({'filter.lc.L': '2 mH', 'line.a-b.R': 0.1})",
    ),
    Diagnostic(
        "U036",
        "a name that is taken",
        "Each filter, controller, type of line, node, line and scenario is defined once.",
        "another name; or `spec.replace({..})` to change values, `spec.without(path)` to take the part out first",
    ),
    Diagnostic(
        "K101",
        "not a certificate",
        "The file is not JSON of the certificate's shape.",
        "write it again with `certify prove SPEC -o CERT`, or `certify loads TABLE --cert CERT`",
    ),
    Diagnostic(
        "K102",
        "another format",
        "A certificate of another version says other things.",
        "write it again with `certify prove SPEC -o CERT`, or `certify loads TABLE --cert CERT`",
    ),
    Diagnostic(
        "K103",
        "about another spec",
        "A certificate names its spec or table by a hash of all its bytes.",
        "prove the changed file again: `certify prove SPEC -o CERT`, or `certify loads TABLE --cert CERT`",
    ),
    *(
        Diagnostic(
            code,
            title,
            "The certificate is not as the format has it, so nothing in it is believed.",
            "write it again with `certify prove SPEC -o CERT`, or `certify loads TABLE --cert CERT`",
        )
        for code, title in (
            ("K104", "proof does not match its key"),
            ("K105", "claims are not those of the spec"),
            ("K106", "unknown claim with a proof"),
            ("K107", "rule does not fit the claim"),
            ("K108", "proof missing"),
            ("K109", "proof of nothing"),
            ("K110", "ledger is not that of the spec"),
            ("K111", "verdict does not follow"),
        )
    ),
    Diagnostic(
        "K201",
        "proof does not hold",
        "The kernel rebuilt the claim from the spec, and a side condition of the rule fails.",
        "do not use this certificate; write it again with `certify prove`, or `certify loads --cert`",
    ),
    Diagnostic(
        "T001",
        "not a table of loads",
        "A table is CSV with one header line, or a JSON list of rows.",
        "`certify explain loads` shows the columns",
    ),
    Diagnostic(
        "T002",
        "a row that cannot be read",
        "It has another number of cells than the header, is not UTF-8 CSV, or is absurdly long.",
        "mend the row, or leave it out with --keep-going",
    ),
    Diagnostic(
        "T101",
        "unknown column",
        "A column that is not understood may change what a row means, so none is ignored.",
        "rename or remove it; `certify explain loads` shows the columns",
    ),
    Diagnostic(
        "T102",
        "a row without the columns of one kind of load",
        "Fractions (Zp ..), absolute coefficients (Yp ..) and exponents (np, nq) are different laws; a row states one "
        "of them wholly.",
        "fill the cell, or use --keep-going to decide the other rows",
    ),
    Diagnostic(
        "T103",
        "fractions that do not add up",
        "Z + I + P is 1 up to rounding (0.05), or P0 is not the power at V0; other sums are mostly percentages.",
        'write "50 %", or use absolute coefficients Yp, Ip, Pp, Yq, Iq, Pq',
    ),
    Diagnostic(
        "T104",
        "columns that exclude each other",
        "Q0 and the power factor say the same, and columns of two kinds of load cannot hold at once.",
        "empty the cells of one",
    ),
    Diagnostic(
        "T105",
        "not a power factor",
        "It is the ratio of active to apparent power at V0: negative if the current leads.",
        'a number between -1 and 1 that is not zero, such as 0.9, or "90 %"',
    ),
    Diagnostic(
        "T106",
        "a band far from V0",
        "Bare numbers are volts; a load is asked about around its own voltage.",
        "write 0.9pu, or put [pu] into the header",
    ),
    Diagnostic(
        "I001",
        "not a network of this format",
        "An import reads the file formats of other programs, written by these programs themselves.",
        "for pandapower: the file that pandapower.to_json(net, FILE) writes",
    ),
    Diagnostic(
        "I002",
        "a network file that names code",
        "Files of pandapower may name any Python class, which would be imported and run. Tables and plain values are "
        "read, and nothing else.",
        "write the network again without this object: del net[KEY] before pandapower.to_json",
    ),
    Diagnostic(
        "I003",
        "a value that an element cannot have",
        "Missing numbers, NaN, infinite ones and wrong signs are not guessed at.",
        "mend the row in the source, or set in_service of the element to False",
    ),
    Diagnostic(
        "I004",
        "an element at something that is not there",
        "A row refers to a bus or an element that the network has not.",
        "mend the row, or leave its table out with --leave-out",
    ),
    Diagnostic(
        "I005",
        "phases that differ",
        "The models and claims are those of balanced networks: one dq vector stands for three phases. A load that "
        "differs between phases has no place there.",
        "replace it by a balanced load, or leave it out with --leave-out",
    ),
    Diagnostic(
        "I006",
        "an element that no spec can express",
        "Leaving it out makes another network of it, so that has to be said.",
        "--leave-out TABLE says so for all rows of a table; or take it out of the source",
    ),
    Diagnostic(
        "I007",
        "where the DGUs are is not said",
        "An island needs inverters that form it, and which elements of the network these are is a choice.",
        "--dgu BUS,BUS names buses; --dgus-at KINDS takes all elements of some kinds: generators, storage, "
        "static-generators, ext-grid",
    ),
    Diagnostic(
        "I008",
        "a package that is not installed",
        "Networks of pandapower are read by pandapower itself, which is an extra of this package.",
        "pip install 'certify-eip[pandapower]'",
    ),
    Diagnostic(
        "I009",
        "pandapower cannot read the file",
        "The file is well formed, but pandapower refuses it: written by a newer version, or damaged.",
        "a newer pandapower; or write the file again with the one installed",
    ),
    Diagnostic(
        "I010",
        "no such SimBench grid",
        "A code such as 1-LV-rural1--0-sw names one of the grids that the package simbench ships.",
        "simbench.collect_all_simbench_codes() lists them",
    ),
    Diagnostic(
        "I020",
        "a branch that is no resistance and inductance in series",
        "Line currents are states, so each line needs L > 0, and R > 0 makes it dissipate, on which every proof rests.",
        "give the line a small reactance or resistance, or join its buses by a closed switch",
    ),
    Diagnostic(
        "I021",
        "no DGU",
        "Without a grid-forming inverter an island has no voltage.",
        "--dgu BUS or --dgus-at KINDS",
    ),
    Diagnostic(
        "I022",
        "a bus without capacitance",
        "The voltage of a bus without a DGU is a state only if there is a capacitance, which lines bring. Where the "
        "source has none, a value must be stated; it is never made up.",
        '--line-capacitance "10 nF/km" for lines without one, --bus-capacitance "1 nF" for buses that no such line '
        "reaches",
    ),
    Diagnostic(
        "I023",
        "transformers that contradict each other",
        "Voltages are referred to one side of all transformers, which is exact if their ratios multiply to one and "
        "their shifts add up to zero around every loop.",
        "set the taps of parallel transformers alike, or open the loop",
    ),
    Diagnostic(
        "I024",
        "no filter or controller for the DGUs",
        "A DGU needs both. They are placeholders that are built in, or taken from another spec.",
        "--filter-from SPEC with --filter NAME and --controller NAME; without it --controller ida-pbc or pi",
    ),
    Diagnostic(
        "I025",
        "references that do not fit",
        "A DGU keeps the voltage of its bus at its reference, so there is one of each at a bus.",
        '--reference "1.02 pu" for all DGUs, --reference BUS=1.02pu for one',
    ),
    Diagnostic(
        "I040",
        "the OpenDSS engine is not installed",
        "Scripts of OpenDSS are understood by the engine of OpenDSS itself, which is an extra of this package.",
        "pip install 'certify-eip[opendss]'",
    ),
    Diagnostic(
        "I041",
        "a script that cannot be read",
        "An OpenDSS script is a text: a plain file of at most 16 MiB, and 500,000 lines with all that it calls for.",
        "name the master file of the circuit, the one with `New Circuit`",
    ),
    Diagnostic(
        "I042",
        "a file that a script calls for",
        "Redirect, Compile and tables of numbers name files relative to the script; backslashes and the case of "
        "letters do not matter. A script must not call for itself.",
        "put the file there, or mend its name; take out a load shape that is not there, because shapes are not used",
    ),
    Diagnostic(
        "I043",
        "a command that an import does not run",
        "Commands that only show or solve are left out. What would change the circuit in a way that is not followed "
        "(`Reduce`, `AllocateLoads`), start a program, load a library or change folders is refused.",
        "take the line out; for commands that change the circuit run them in OpenDSS, `save circuit`, and import what "
        "that writes",
    ),
    Diagnostic(
        "I044",
        "OpenDSS refuses a line",
        "The message is that of the engine, or says what the engine would pass over in silence, such as a change of "
        "an element that is not there.",
        "mend the line; OpenDSS itself shows the same error",
    ),
    Diagnostic(
        "I045",
        "the OpenDSS engine broke down",
        "It runs in a process of its own, with limits of time and memory, so nothing else is touched.",
        "look for absurd numbers of phases or steps; cut the script in half to find the line",
    ),
    Diagnostic(
        "I046",
        "no circuit",
        "There is nothing to import without `New Circuit.NAME`, lines and loads.",
        "name the master file of the circuit",
    ),
    Diagnostic(
        "I047",
        "an element that is not balanced",
        "One dq vector stands for three equal phases, in all models and claims. Only elements with three phases, on "
        "the nodes 1, 2 and 3 of their buses in one order, have a place there; of loads also three equal ones on one "
        "phase each.",
        "replace it by a balanced one, or leave it out with --leave-out ELEMENT",
    ),
    Diagnostic(
        "I048",
        "a line whose phases differ",
        "The positive sequence of a line stands alone only if its matrices have one value on the diagonal and one "
        "beside it, to 12 digits. An average would be another line.",
        "state r1, x1, c1 (and r0, x0, c0) of the line as if it were transposed",
    ),
    Diagnostic(
        "I049",
        "a load without a law on the band",
        "A load of OpenDSS has its law from vminpu (or vlowpu, if that is higher) to vmaxpu. Its band in the spec is "
        "the part of that within --band, and a ZIPV load must not fade away in it.",
        "another --band; or vminpu and vmaxpu as wide as the law is meant",
    ),
    Diagnostic(
        "I050",
        "an element that no spec can express",
        "Leaving it out makes another circuit of it, so that has to be said.",
        "--leave-out CLASS or ELEMENT says so; generating elements may be DGUs: --dgus-at",
    ),
    Diagnostic(
        "I051",
        "a value that an element cannot have",
        "Missing numbers, NaN, infinite and absurd ones are not guessed at.",
        "mend the value in the script",
    ),
    Diagnostic(
        "I052",
        "an element that is not what its properties say",
        "Each line, transformer, reactor and capacitor that is imported is compared with the admittance that OpenDSS "
        "itself gives it. Here they differ: a long line that is corrected for its length, or a property that is not "
        "read.",
        "state r1, x1, c1 of the line as they are to count; or leave the element out with --leave-out",
    ),
    Diagnostic(
        "I053",
        "a setting that is not followed",
        "Loads are imported as they are in a snapshot at the base frequency, in year 0.",
        "take the `Set` out of the script",
    ),
    Diagnostic(
        "I054",
        "nothing of this name to leave out",
        "--leave-out takes classes such as `pvsystem` and elements such as `load.a`.",
        "the names are those of the script, in any case",
    ),
    Diagnostic(
        "pandapower",
        "how networks of pandapower become specs",
        "line: a pi section, with half its conductance as a load at either end; open at one end it ends at a node of "
        "its own. trafo: ideal ratio with taps and shift, taken out by referring all to one side, then resistance and "
        "inductance, with half of what it draws without load at either end. impedance: the same with its own shunts. "
        "load: for each row Y, I and P from its percentages. sgen, storage, motor: constant power. shunt: constant "
        "impedance. ward: both. asymmetric_load, asymmetric_sgen: refused unless the phases are equal. switch: closed "
        "between buses it joins them, or is a branch with R/X = 2 if it has z_ohm. gen, sgen, storage, ext_grid: a DGU "
        "where you place one; an ext_grid or xward without a DGU is left out, a gen is refused. trafo3w, dcline, svc, "
        "ssc, tcsc, vsc: refused unless --leave-out names them. What is out of service, open, or fed by no DGU is left "
        "out, and so are dead ends without capacitance. Numbers are the shortest decimals of the file's.",
        "`certify import pandapower FILE --dgu BUS` without -o tells what would become of it, and writes nothing",
    ),
    Diagnostic(
        "results",
        "the results of `certify loads`",
        "verdict and rule; from_V and to_V, the band; critical_V and critical_pu, the voltage from which on the load "
        "is monotone up to the top of its band (an upper bound, within 1e-9 of it or of the top; 0: from every "
        "voltage on; none: not "
        "even at the top; empty: not found); strict, whether it is strictly so; modulus_S and lipschitz_S, proved "
        "bounds m and Lambda with m |V - U|^2 <= <V - U, I(V) - I(U)> and |I(V) - I(U)| <= Lambda |V - U|; margin_pu,"
        " the smallest eigenvalue of the symmetric part of the Jacobian over |S0| / V0^2: of a monotone load a proved"
        " lower bound, of another the least on its band, in floats. If refuted: violation_V, where the linearised "
        "load is active; pair_a_V, pair_b_V and pair_angle_deg, two voltages between which a disturbance gains "
        "product_W. JSON has the same exactly, critical as a bracket, tangent of half the angle.",
        "-o results.csv, or results.json for exact numbers",
    ),
    Diagnostic(
        "loads",
        "the columns of a table of loads",
        "name (optional); V0; and one of: P0, Q0 or pf, Zp, Ip, Pp, Zq, Iq, Pq (fractions of P0 and Q0 at V0); Yp, "
        "Ip, Pp, Yq, Iq, Pq (absolute, in S, A, W and S, A, var); P0, np, Q0 or pf, nq (exponents). v_min and v_max "
        "(optional) are the row's own band. Bare numbers are SI; a unit may stand in the cell, or, in a CSV, in the "
        "header for the cells that have none, as in P0 [kW]. If Q0 = 0 or pf = 1 the reactive columns may be left "
        "out. With a power factor Q0 = P0 tan(acos pf), to 40 digits; a negative one leads. No other columns, so that"
        " none is ignored.",
        "a CSV with one header line, or a JSON list of tables with these keys",
        """name,P0 [kW],pf,V0,Zp,Ip,Pp,Zq,Iq,Pq
kettle,2,1,230,0.96,0.05,-0.01,0,0,1""",
    ),
    Diagnostic(
        "P201",
        "passivity of a DGU undecided",
        "Neither a storage function nor a witness against all of them was found. Usual reasons: an integrator that "
        "does not act on the output (K13 singular), or a lossless design whose storage function is not unique.",
        "leave out the integrator (no K13), or add damping",
    ),
    Diagnostic(
        "P202",
        "monotonicity of a load undecided",
        "Sums of powers with broken exponents are decided by enclosures, and the margin is too small for them.",
        "narrow the voltage band; `--method sampled` gathers evidence, which is no proof",
    ),
    Diagnostic(
        "P203",
        "convergence undecided",
        "On the island some claim is not proved, or a motion without dissipation other than rest cannot be excluded: "
        "then the equilibrium is stable at best, not asymptotically.",
        "look at the claims of its DGUs and loads first; then add damping, integral action or a strictly monotone load",
    ),
    Diagnostic(
        "P204",
        "stability of the microgrid not proved",
        "It follows when every other claim is proved. A refuted claim about a part does not refute the stability of "
        "the network: other parts may make up for it.",
        "mend the claims that are not proved",
    ),
    Diagnostic(
        "P206",
        "algebraic loop",
        "With the capacitance of the lines and the node added, the equations of this linear loop cannot be solved for "
        "the rates of its states: its C B has an eigenvalue that cancels the capacitance.",
        "check the signs of B and C: C B is one over the capacitance at the port",
    ),
    Diagnostic(
        "P207",
        "the lines do not make up for the shortage of a DGU",
        "The DGU is passive but for a shortage, S' <= <z, d> + eps |d|^2 with a proved eps. Lines with R above the sum "
        "of eps deg over both ends would make up for it, and strongly monotone loads at its node; they do not.",
        "better gains (`certify synth`), a smaller tolerance, or fewer and longer lines at this node",
    ),
    Diagnostic(
        "P210",
        "a load that this method does not decide",
        "`--method` allows one method only, and it neither proves this load nor is the load refuted.",
        "leave --method out: then the cheapest method that decides is taken",
    ),
    Diagnostic(
        "P211",
        "monotonicity of a load given by its current undecided",
        "Neither sums of squares on its disk nor two voltages that refute were found: its denominator may vanish "
        "there, or it is hardly monotone at a voltage that is no rational number.",
        "a smaller disk, or a formula of lower degree",
    ),
    Diagnostic(
        "P208",
        "a DGU with tolerances undecided",
        "No storage function was found that serves every corner of its box of tolerances, and no corner was refuted.",
        "a smaller tolerance, or more damping",
    ),
    Diagnostic(
        "P209",
        "tolerance of the lines at a linear loop",
        "Half the capacitance of each line belongs to the node, and no rule covers its tolerance under a linear loop.",
        'give the C of these lines no tolerance: tolerance = { C = "0 %" }',
    ),
    Diagnostic(
        "P212",
        "nothing says where a DGU comes to rest",
        "Without integral action on both axes (K13 missing or singular) a DGU comes to rest at a voltage that depends "
        "on the network, and no rule proves where. A linear loop has to have a nonsingular F, and -C F^-1 B, which a "
        "current changes of its voltage at rest, has to be zero or a complex impedance.",
        'integral action on both axes, or kind = "constant" for an inverter without feedback',
    ),
    Diagnostic(
        "P213",
        "no equilibrium found",
        "Newton's method found no voltages at which all currents add up, also when the loads were switched on little "
        "by little. There may be none: the loads may be more than the lines can carry. That is evidence, not a proof.",
        "less load, shorter lines, or a DGU nearer to the load",
    ),
    Diagnostic(
        "P214",
        "existence of the equilibrium not proved",
        "In floats there is one, but the equations are not shown to be strongly monotone around it: loads of constant "
        "power near the most that the lines can carry, or tolerances too wide. Or an inverter is as good as at its "
        "limits.",
        "less load, smaller tolerances, or wider limits",
    ),
    Diagnostic(
        "P215",
        "a load outside its band at the equilibrium",
        "The equilibrium that was found, in floats, has the voltage of a load outside the band in which the claim "
        "about the load is made, so nothing follows for it.",
        "a wider voltage_band, other references, less load or stronger lines",
    ),
    Diagnostic(
        "P216",
        "no region of attraction",
        "It needs a proved equilibrium, all claims about the parts of its island, and room: no load at the end of its "
        "band and no inverter at its limits.",
        "look at the claims about the equilibrium and the invariant set of this island first",
    ),
    Diagnostic(
        "P205",
        "undecided",
        "The rule for this claim does not apply.",
        "the rule always applies: this is a defect of the tool",
    ),
    Diagnostic(
        "series-branch",
        "proof rule: series branch",
        "A resistance and an inductance in series store L|I~|^2/2 and dissipate R|I~|^2, with both positive.",
        "nothing to search for",
    ),
    Diagnostic(
        "quadratic-storage",
        "proof rule: quadratic storage function",
        "S = x~'P x~/2 with P > 0, P B = C' and -(F'P + PF) >= 0, all exact: S' = <z~, d~> - dissipation at every "
        "equilibrium. The certificate holds P, the kernel rebuilds F, B and C from the spec.",
        "gains must be formulas of the plant data: the feasible ones have measure zero",
    ),
    Diagnostic(
        "index-storage",
        "proof rule: storage function with a shortage",
        "S = x~'P x~/2 with P > 0 and S' <= <z~, d~> + eps |d~|^2, exact, at every corner of the box of R, L, C: the "
        "inequality is affine in R, 1/L and 1/C one by one, so the corners prove the whole box. Lines with enough "
        "resistance make up for eps, which is part of the claim about the island.",
        "eps times the number of lines, summed over both ends of a line, must stay below its resistance",
    ),
    Diagnostic(
        "frequency-witness",
        "refutation: a growing oscillation that gives power away",
        "At a point s0 of the right half-plane a current u exp(s0 t) takes power out of the DGU although it grows from "
        "rest: Re(u* Z(s0) u) < 0. No storage function of any kind can allow that. It refutes passivity of this part, "
        "not stability of the network.",
        "correct the gains; the `2 w0 L` and the sign of kp*L are the classic errors",
    ),
    Diagnostic(
        "storage-contradiction",
        "refutation: the equations for a storage function contradict each other",
        "If any storage function exists, a quadratic one does (the available storage). A chain of identities shows "
        "that no P >= 0 satisfies P B = C' and -(F'P + PF) >= 0. It catches what frequencies do not see: a mode that "
        "the port does not excite, but that drives it.",
        "look for a controller state that nothing damps through the port",
    ),
    Diagnostic(
        "monotone-ends",
        "proof rule: monotone load, ends of the band",
        "For one exponential load 4 (np-1) P^2 > (nq-2)^2 Q^2 changes sign at most once in v; for a ZIP load without "
        "negative parameters D v^2 increases. So the ends of the band decide.",
        "complete for these loads",
    ),
    Diagnostic(
        "monotone-sturm",
        "proof rule: monotone load, Sturm sequences",
        "G >= 0 and D = G (G + v G') - (v B')^2/4 >= 0 on the band, by counting roots; strict if both are > 0.",
        "complete for ZIP loads, whole exponents, and their sums",
    ),
    Diagnostic(
        "monotone-bernstein",
        "proof rule: monotone load, Bernstein coefficients",
        "On each cell of the band, G v^2 and D v^4 have no negative coefficient in the Bernstein basis.",
        "for whole exponents; cheap, and complete but for roots inside the band",
    ),
    Diagnostic(
        "monotone-sos",
        "proof rule: monotone load, sums of squares",
        "G v^2 and D v^4 are sigma0 + (v - v1)(v2 - v) sigma1 with exact Gram matrices, as an identity of polynomials.",
        "complete for whole exponents; the search needs a solver, the check does not",
    ),
    Diagnostic(
        "monotone-enclosure",
        "proof rule: monotone load by enclosures",
        "The band is cut into cells, on each of which rigorous enclosures show that G and D are not negative.",
        "for sums of loads with broken exponents; not complete",
    ),
    Diagnostic(
        "sampled",
        "evidence, not a proof: a load tried at many voltages",
        "At none of many low-discrepancy voltages was the load found not to be monotone. That proves nothing: the "
        "claim becomes an assumption of the ledger, and what rests on it is conditional.",
        "prove without --method; `certify gate --allow NAME` lets a conditional verdict pass",
    ),
    Diagnostic(
        "monotone-disk",
        "proof rule: a load given by its current, on a disk",
        "The symmetric part of its Jacobian, times the squared denominator, is a sum of squares plus (r^2 - |V - V0|^2)"
        " times another, with exact Gram matrices; the denominator keeps away from zero in the same way.",
        "complete but for zeros on the disk that are no rational numbers; the degree of the sums is at most 6",
    ),
    Diagnostic(
        "current-pair",
        "refutation: two voltages between which the load current falls",
        "For two voltages of the disk <V - U, I(V) - I(U)> < 0, exactly. It refutes monotonicity on the disk, not "
        "stability of the network.",
        "a smaller disk, or another load beside it",
    ),
    Diagnostic(
        "voltage-pair",
        "refutation: two voltages between which the load current falls",
        "At one voltage the linearised load is active, and for two voltages of the band <V - U, I(V) - I(U)> < 0, "
        "both checked exactly. It refutes monotonicity on the band, not stability of the network.",
        "a band in which the load is monotone (`certify loads SPEC` tells from where on), less constant power, or a "
        "reactive exponent nearer to 2",
    ),
    Diagnostic(
        "skew-incidence",
        "proof rule: interconnection",
        "What lines feed into nodes is minus the transpose of what nodes feed into lines, so no energy arises.",
        "holds for every network of lines and nodes",
    ),
    Diagnostic(
        "invariant-set",
        "proof rule: LaSalle on one island",
        "Where nothing dissipates, line currents rest, so all voltage deviations are equal; at the pin they vanish; "
        "and then no DGU can move unseen. Checked by exact ranks.",
        "needs one strictly monotone load, series R-L load or suitable DGU on each island",
    ),
    Diagnostic(
        "strong-monotonicity",
        "proof rule: the equilibrium of an island",
        "Around the voltages given, the currents E(V) into the nodes that no DGU holds satisfy Re <V - U, f (E(V) - "
        "E(U))> >= mu |V - U|^2, and |f E| <= mu rho: so exactly one equilibrium lies within rho. mu comes from the "
        "lines, by weights that make the real part of their admittance matrix diagonally dominant, and from the "
        "slopes of the loads. All in enclosures. If the loads are monotone on their bands, no other equilibrium has "
        "them all there.",
        "needs integral action (or constant = inverters) and loads well below what the lines can carry",
    ),
    Diagnostic(
        "local-monotonicity",
        "proof rule: an equilibrium, alone near by",
        "As strong-monotonicity, but a load at a node that no DGU holds is not proved to be monotone on its band: so "
        "there may be other equilibria with all loads in their bands, as there are with loads of constant power.",
        "loads that are monotone on their bands (`certify loads SPEC`)",
    ),
    Diagnostic(
        "limits-exceeded",
        "refutation: an inverter would need more than its limits",
        "The only equilibrium with all loads in their bands is known, and there the voltage u = V + (R + j w0 L) I "
        "that an inverter has to make is larger than a limit of it. So with these references the network does not "
        "come to rest unsaturated.",
        "references closer together, less load, or wider limits",
    ),
    Diagnostic(
        "reference-outside-band",
        "refutation: a reference outside the band of the load at the same node",
        "The DGU keeps its node at its reference, and its modulus is not strictly inside the band in which the claim "
        "about the load at that node is made.",
        "another reference, or a wider band",
    ),
    Diagnostic(
        "sublevel-set",
        "proof rule: region of attraction",
        "Below the level c the sum H of all storage functions leaves no room for a load to leave its band or an "
        "inverter to reach its limits: c = min (margin^2 / (2 k)), |x|^2 <= 2 k H. H does not increase, so what "
        "starts below c stays, and by LaSalle's principle tends to the equilibrium. Without such bounds it is global.",
        'a wider band, a cut-off (below = "constant-impedance"), more capacitance at the limiting node',
    ),
    Diagnostic(
        "passive-interconnection",
        "proof rule: the network",
        "The sum of all storage functions is a Lyapunov function of every equilibrium, known or not.",
        "needs every other claim",
    ),
)
DIAGNOSTICS = {entry.code: entry for entry in _ALL}


def explain(code: str) -> str:
    """What / Why / What to try for one code, as text. Raises: KeyError for an unknown code.

    >>> explain("S302").splitlines()[0]
    'S302: self-loop'
    """
    entry = DIAGNOSTICS[code]
    lines = [f"{entry.code}: {entry.title}", "", entry.why, "", f"What to try: {entry.remedy}."]
    if entry.example:
        lines += ["", "Example:", *(f"    {line}" for line in entry.example.splitlines())]
    return "\n".join(lines)
