"""Shared fixtures: the repository's folders and ready-made specs."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
from hypothesis import settings

# Where the package is not installed, pytest has not found its plugin.
pytest_plugins = [] if "certify.testing.plugin" in sys.modules else ["certify.testing.plugin"]

ROOT = Path(__file__).resolve().parent.parent
# Every spec of the repository that is well formed; beside some of them lies a certificate.
SPECS = [p for p in sorted((ROOT / "specs").glob("*.*")) if not p.name.endswith(".cert.json")]

# A gate must give the same answer twice; at a desk new examples are welcome.
settings.register_profile("ci", derandomize=True)
if os.environ.get("CI"):
    settings.load_profile("ci")


@pytest.fixture(scope="session")
def root() -> Path:
    return ROOT


@pytest.fixture(scope="session")
def specs() -> Path:
    return ROOT / "specs"


@pytest.fixture(autouse=True)
def _at_root(monkeypatch: pytest.MonkeyPatch) -> None:
    """Doctests and commands name specs as a user in the repository would."""
    monkeypatch.chdir(ROOT)


@pytest.fixture(autouse=True)
def _own_cache(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> None:
    """What the user's machine remembers is neither asked nor changed."""
    monkeypatch.setenv("CERTIFY_CACHE", str(tmp_path_factory.getbasetemp() / "accepted"))
