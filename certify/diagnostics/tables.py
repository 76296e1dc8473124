"""What may be wrong with a table of loads, and what its columns and results are."""

from __future__ import annotations

from certify.diagnostics.entry import Diagnostic

ENTRIES = (
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
)
