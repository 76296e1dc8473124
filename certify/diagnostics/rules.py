"""The rules of proofs and refutations: what each one says."""

from __future__ import annotations

from certify.diagnostics.entry import Diagnostic

ENTRIES = (
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
