"""What may be wrong with a network of another program, or keep it from being a spec."""

from __future__ import annotations

from certify.diagnostics.entry import Diagnostic

ENTRIES = (
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
        "Networks of pandapower and SimBench are read by these packages themselves, which are extras of this one.",
        "run the command of the message; the extras are pandapower, simbench and opendss",
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
)
