"""Pytest plugin: specs as test items, specs for tests by a marker, and a report of what a run has proved.

It is loaded at every start of pytest where this package is installed, so all else is imported when it is needed.
What pytest would rewrite has no assert statements: PYTEST_DONT_REWRITE.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from certify.certificate import Certificate
    from certify.kernel.claims import Verdict
    from certify.testing.items import MicrogridFile
    from certify.testing.marked import MarkedSpec
    from certify.testing.records import Record

SUFFIXES = (".microgrid.toml", ".microgrid.json")
MARKER = "certify_spec"
FIXTURES = {"certify_spec", "certify_certificate", "certify_verdict"}
HELP = "certify: specs *.microgrid.toml are test items, certified or, if called *.refuted.microgrid.toml, refuted"
_records: pytest.StashKey[list[Record]] = pytest.StashKey()


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("certify", HELP)
    group.addoption(
        "--certify-report",
        metavar="DIR_or_FILE",
        help="after the run write what was proved: certify.md and certify.json into a folder, or one file of that kind",
    )
    group.addoption(
        "--certify-allow",
        metavar="NAME",
        action="append",
        default=[],
        help="let *.microgrid.toml pass if it is certified but for this assumption of its ledger, such as sampled/NODE "
        "(may be given again)",
    )
    parser.addini("certify_allow", "assumptions as of --certify-allow, one in each line", type="linelist", default=[])


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line(
        "markers",
        f"{MARKER}(spec, ...): run the test for each of these specs, which its fixtures certify_spec, "
        "certify_certificate and certify_verdict are about; a path or a pattern, from the folder of the test file or "
        "from rootdir, or a spec made in Python",
    )
    config.addinivalue_line("markers", "certify: what spec files are as test items, for -m certify")
    target = config.getoption("certify_report", default=None)
    if target is not None and not hasattr(config, "workerinput"):
        from certify.kernel.errors import SpecError
        from certify.testing.session_report import SessionReport

        try:
            report = SessionReport.to(target, config.invocation_params.dir)
        except SpecError as error:
            raise pytest.UsageError("; ".join(fault.message for fault in error.faults)) from None
        config.pluginmanager.register(report, "certify-report")


def allowed(config: pytest.Config) -> tuple[str, ...]:
    """The assumptions that items may rest on."""
    return (*config.getini("certify_allow"), *config.getoption("certify_allow", default=[]))


# --- specs as items -----------------------------------------------------------------------------------------------


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> MicrogridFile | None:
    if not file_path.name.lower().endswith(SUFFIXES):
        return None
    from certify.testing.items import MicrogridFile

    collected: MicrogridFile = MicrogridFile.from_parent(parent, path=file_path)
    return collected


# --- specs for tests ----------------------------------------------------------------------------------------------


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    marks = _marks(metafunc.definition)
    if not marks:
        return
    if not FIXTURES & set(metafunc.fixturenames):
        if any(mark.name == MARKER for mark in metafunc.definition.own_markers):
            names = ", ".join(sorted(FIXTURES))
            pytest.fail(
                f"{metafunc.definition.nodeid} is marked with {MARKER}, but takes none of {names}", pytrace=False
            )
        return
    from certify.testing.marked import marked_specs

    specs = marked_specs([spec for mark in marks for spec in mark.args], metafunc.definition.path, metafunc.config)
    metafunc.parametrize(MARKER, specs, ids=[spec.name for spec in specs], indirect=True)


def _marks(definition: pytest.Item) -> Sequence[pytest.Mark]:
    """The marks of the function; else those of its class, else those of its module."""
    found = list(definition.iter_markers_with_node(MARKER))
    nearest = [mark for node, mark in found if node is found[0][0]]
    for mark in nearest:
        if not mark.args or mark.kwargs:
            pytest.fail(f"{definition.nodeid}: {MARKER} takes one or more specs, and nothing by name", pytrace=False)
    return nearest[::-1]


@pytest.fixture(scope="module")
def certify_spec(request: pytest.FixtureRequest) -> MarkedSpec:
    """The spec that `@pytest.mark.certify_spec(...)` names: its `data`, `document` and `path`; for every assertion."""
    spec: MarkedSpec | None = getattr(request, "param", None)
    if spec is None:
        pytest.fail(f"to use certify_spec, mark the test with @pytest.mark.{MARKER}(PATH, ...)", pytrace=False)
    return spec.read()


@pytest.fixture(scope="module")
def certify_certificate(certify_spec: MarkedSpec) -> Certificate:
    """The certificate of the spec: the one that lies beside it, checked, if that is about it as it is; else proved."""
    return certify_spec.certified()


@pytest.fixture(scope="module")
def certify_verdict(certify_certificate: Certificate) -> Verdict:
    """What the kernel says of the spec: `outcome`, `claims`, `assumptions`. Nothing is asserted about it yet."""
    from certify.testing.marked import ToldVerdict

    verdict = certify_certificate.verdict
    return ToldVerdict(verdict.outcome, verdict.claims, verdict.assumptions)


# --- the report ---------------------------------------------------------------------------------------------------


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    if item.config.getoption("certify_report", default=None) is None:
        return (yield)
    from certify.testing.records import listening

    with listening() as records:
        item.stash[_records] = records
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if _records in item.stash and (report.when == "call" or (report.when == "setup" and not report.passed)):
        from certify.testing.session_report import summarise

        records: list[Record] = item.stash[_records]
        spec = getattr(item, "funcargs", {}).get("certify_spec")
        if spec is not None and {"certify_certificate", "certify_verdict"} & set(getattr(item, "fixturenames", ())):
            records = [*spec.records(), *records]  # proved once for a module, and used here
        report.certify = summarise(records)  # type: ignore[attr-defined]  # goes with it from a worker of xdist
    return report
