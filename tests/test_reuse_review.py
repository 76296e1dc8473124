"""Attacks on proving with an older certificate: what it takes over, what it remembers, and what it is told."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from certify import accepted
from certify.certificate import prove
from certify.kernel.errors import SpecError
from certify.reuse import prove_again
from tests.test_reuse import BASE, CERTIFICATE, edited, faults_of, text

Spec = dict[str, Any]


@pytest.fixture(autouse=True)
def _any_size(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(accepted, "MIN_BYTES", 0)
    monkeypatch.setenv("CERTIFY_CACHE", str(tmp_path / "cache"))


@pytest.mark.parametrize("value", [None, {}, 5, {"R": 1, "L": 1, "C": 1}], ids=str)
@pytest.mark.parametrize("name", ["idle", "", "\ud800", "x\n", "a" * 65])
@pytest.mark.parametrize("section", ["filter", "controller"])
def test_a_new_part_that_nobody_has_is_read_all_the_same(section: str, name: str, value: object) -> None:
    """Null is a fault, and not the same as nothing; a name need not be one that can be encoded."""
    spec = text(edited(lambda s: s[section].update({name: value})))
    if (section, name, bool(value), value) == ("filter", "idle", True, {"R": 1, "L": 1, "C": 1}):
        return
    accepted.remember(text(BASE), CERTIFICATE.data)
    expected = faults_of(lambda: prove(spec))
    assert expected
    assert faults_of(lambda: prove_again(spec, CERTIFICATE.data)) == expected
