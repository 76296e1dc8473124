"""Why a claim is open."""

from __future__ import annotations

from certify.diagnostics.entry import Diagnostic

ENTRIES = (
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
)
