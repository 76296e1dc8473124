"""What may be wrong with how a command, or a function of the library, is used."""

from __future__ import annotations

from certify.diagnostics.entry import Diagnostic

ENTRIES = (
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
        "A certificate is about the bytes of one spec. This one has changed since, so nothing is known of it. Line "
        "ends are bytes too, and git may change them when it checks files out.",
        "`certify gate --write SPEC` proves it as it is now and replaces the certificate; commit both. If only line "
        "ends differ, put `*.toml -text` into .gitattributes and check it out again",
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
)
