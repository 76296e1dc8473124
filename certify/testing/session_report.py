"""What a test session has proved, as Markdown and JSON: one entry for each test, written whole after the run."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import pytest

from certify import __version__
from certify.certificate import write_atomically
from certify.kernel.errors import Fault, SpecError
from certify.report.files import check_folder, write_folder
from certify.testing.records import Record
from certify.testing.words import json_text

OPTION = "--certify-report"
FORMAT = "certify/test-report@1"
TITLE = "# What the tests proved"
FILES = ("certify.md", "certify.json")
MOST_VERDICTS = 20  # on specs that one test has made which are listed one by one; of the others only how many
MOST_CLAIMS = 8  # open ones of one spec


def _may_be_replaced(path: Path) -> bool:
    """Whether there is nothing, or a report of an earlier session: no file of the user's own is lost by a slip."""
    if not path.exists():
        return True
    try:
        with path.open("rb") as file:
            start = file.read(100)
    except OSError:
        return False
    return start.startswith(TITLE.encode()) or f'"format": "{FORMAT}"'.encode() in start


def summarise(records: Iterable[Record]) -> dict[str, Any]:
    """What one test has proved, as JSON: each spec once, those from files first, then those not certified."""
    distinct = {(record.spec_sha256, record.how): record for record in records}
    in_files = [record for record in distinct.values() if record.source]
    made = sorted((r for r in distinct.values() if not r.source), key=lambda r: r.verdict.outcome == "certified")
    outcomes = Counter(record.verdict.outcome for record in distinct.values())
    listed = [_entry(record) for record in (*in_files, *made[:MOST_VERDICTS])]
    return {"outcomes": dict(sorted(outcomes.items())), "verdicts": listed}


def _entry(record: Record) -> dict[str, Any]:
    listed = [{"id": c.id, "status": c.status, "rule": c.rule} for c in record.open_claims[:MOST_CLAIMS]]
    return {
        "spec": record.source or None,
        "sha256": record.spec_sha256,
        "how": record.how,
        "outcome": record.verdict.outcome,
        "claims": record.counts,
        "open": listed,
        "assumed": [name for name, _ in record.verdict.assumptions],
    }


class SessionReport:
    """A plugin that gathers what the tests of a session report, on the process that sees all of them.

    `said`: what came of writing it.
    """

    def __init__(self, target: Path, shown: str) -> None:
        self.target, self.shown = target, shown
        self.tests: dict[str, dict[str, Any]] = {}
        self.said, self.written = "", False

    @classmethod
    def to(cls, path: str, folder: Path) -> SessionReport:
        """A report that can be written there, as far as can be told before. Raises: SpecError U020."""
        target = Path(folder, path)
        if target.suffix in (".md", ".json"):
            there = target.parent
            reason = "it is a folder" if target.is_dir() else "" if there.is_dir() else "there is no such folder"
            reason = reason or ("" if _may_be_replaced(target) else "what is there is no such report")
        else:
            try:
                check_folder(str(target), FILES, "", OPTION)
                kept = [name for name in FILES if not _may_be_replaced(target / name)]
                reason = f"{kept[0]} there is no such report" if kept else ""
            except SpecError as error:
                reason = error.faults[0].message.rpartition(": ")[2]
            there = target if target.is_dir() else target.parent
        if not reason and not os.access(there, os.W_OK | os.X_OK):
            reason = "permission denied"
        if reason:
            raise SpecError((Fault("U020", OPTION, f"{OPTION}: cannot write {path}: {reason}"),))
        return cls(target, path)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.add(report.nodeid, report.outcome, getattr(report, "certify", None))

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if not session.config.option.collectonly and not self.write():
            session.exitstatus = pytest.ExitCode.USAGE_ERROR

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        if self.said:
            terminalreporter.write_line(self.said, red=not self.written)

    def add(self, nodeid: str, outcome: str, proved: dict[str, Any] | None) -> None:
        """Take in one report of a phase of a test; the last one of a test that failed in any phase counts as that."""
        if proved is None:
            if outcome == "failed" and nodeid in self.tests:
                self.tests[nodeid]["result"] = "failed"
            return
        if proved["verdicts"]:
            self.tests[nodeid] = {"test": nodeid, "result": outcome, **proved}

    def write(self) -> bool:
        """Write it, whole or not at all; whether that was possible."""
        texts = {"certify.md": self.to_markdown(), "certify.json": self.to_json()}
        try:
            if self.target.suffix in (".md", ".json"):
                write_atomically(self.target, texts[f"certify{self.target.suffix}"].encode())
            else:
                write_folder(str(self.target), {name: text.encode() for name, text in texts.items()}, OPTION)
        except (OSError, SpecError) as error:
            reason = error.strerror if isinstance(error, OSError) else error
            self.said = f"{OPTION}: cannot write {self.shown}: {reason}"
            return False
        count = sum(sum(test["outcomes"].values()) for test in self.tests.values())
        self.said, self.written = f"certify: {count:,} verdicts of {len(self.tests)} tests in {self.shown}", True
        return True

    def to_json(self) -> str:
        listed = [self.tests[nodeid] for nodeid in sorted(self.tests)]
        return json_text({"format": FORMAT, "certify": __version__, "tests": listed})

    def to_markdown(self) -> str:
        tests = [self.tests[nodeid] for nodeid in sorted(self.tests)]
        total = Counter[str]()
        for test in tests:
            total.update(test["outcomes"])
        told = _told(total) or "no spec was proved or checked"
        lines = [TITLE, "", f"{len(tests)} tests; verdicts of the kernel: {told}. certify {__version__}.", ""]
        lines += ["| test | result | spec | verdict | claims | how |", "| --- | --- | --- | --- | --- | --- |"]
        for test in tests:
            lines += _rows(test)
        unsettled = [_unsettled(test, entry) for test in tests for entry in test["verdicts"] if entry["open"]]
        lines += ["", "## Not proved", "", *unsettled] if unsettled else []
        names = sorted({name for test in tests for entry in test["verdicts"] for name in entry["assumed"]})
        if names:
            lines += ["", f"Assumed, not proved, in one or more of them: {_plain(', '.join(names))}."]
        return "\n".join(lines) + "\n"


def _told(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count:,} {outcome}" for outcome, count in sorted(counts.items()))


def _rows(test: dict[str, Any]) -> list[str]:
    """A row for each spec that is in a file, and one for all that the test has made."""
    in_files = [entry for entry in test["verdicts"] if entry["spec"]]
    rows = []
    for entry in in_files:
        claims = ", ".join(f"{count} {status}" for status, count in entry["claims"].items())
        rows.append(_cells(test["test"], test["result"], entry["spec"], entry["outcome"], claims, entry["how"]))
    made = Counter(test["outcomes"]) - Counter(entry["outcome"] for entry in in_files)
    if made:
        how = " / ".join(sorted({entry["how"] for entry in test["verdicts"] if not entry["spec"]}))
        rows.append(_cells(test["test"], test["result"], f"{made.total():,} made by the test", _told(made), "", how))
    return rows


def _unsettled(test: dict[str, Any], entry: dict[str, Any]) -> str:
    claims = ", ".join(f"{c['id']} {c['status']}" + (f" ({c['rule']})" if c["rule"] else "") for c in entry["open"])
    return f"- {_plain(entry['spec'] or entry['sha256'][:12])} in {_plain(test['test'])}: {_plain(claims)}"


def _cells(*cells: str) -> str:
    return f"| {' | '.join(_plain(cell) for cell in cells)} |"


def _plain(text: str) -> str:
    """Text in a cell or a line of a list; names of tests and files as code, which nothing in them can end.

    >>> _plain("2 proved"), _plain("a/b_c.py::x[1|2]")
    ('2 proved', '`a/b_c.py::x[1/2]`')
    """
    shown = "".join(c if c.isprintable() else " " for c in text).replace("|", "/").replace("`", "'")
    return shown if re.fullmatch(r"[\w ,;:()/-]*", shown, re.ASCII) and "_" not in shown else f"`{shown}`"
