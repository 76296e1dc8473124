"""For test suites of one's own: strategies that shrink to readable specs, assertions, and a pytest plugin.

    from hypothesis import given
    from certify.testing import assert_passive, filters

    @given(filters(L=("0.5 mH", "5 mH")))
    def test_the_design_is_passive_with_every_filter(filter):
        assert_passive(filter, my_design(filter))

Strategies and plugin need `pip install 'certify-eip[testing]'`; the assertions need nothing more than certify. Proofs
take milliseconds, but some take longer than hypothesis expects: give `@settings(deadline=None)`. Drawing them uses no
randomness but that of hypothesis, so a run with `derandomize=True` is the same each time.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from certify.testing.assembly import dgu_spec, network_spec, w0
    from certify.testing.assertions import (
        assert_certified,
        assert_not_certified,
        assert_not_passive,
        assert_passive,
        assert_refuted,
    )
    from certify.testing.parts import Controller, Document, Filter, Line, Load
    from certify.testing.strategies import (
        boundary_controllers,
        controllers,
        decimals,
        filters,
        lines,
        loads,
        networks,
        non_passive_controllers,
        passive_controllers,
        quantities,
        references,
        specs,
    )

__all__ = [
    "Controller",
    "Document",
    "Filter",
    "Line",
    "Load",
    "assert_certified",
    "assert_not_certified",
    "assert_not_passive",
    "assert_passive",
    "assert_refuted",
    "boundary_controllers",
    "controllers",
    "decimals",
    "dgu_spec",
    "filters",
    "lines",
    "loads",
    "network_spec",
    "networks",
    "non_passive_controllers",
    "passive_controllers",
    "quantities",
    "references",
    "specs",
    "w0",
]
_PARTS = ("Controller", "Document", "Filter", "Line", "Load")
_ASSEMBLY = ("dgu_spec", "network_spec", "w0")


def __getattr__(name: str) -> Any:
    """Public names are imported when they are first used: the plugin is loaded at every start of pytest."""
    if name not in __all__:
        raise AttributeError(f"module 'certify.testing' has no attribute {name!r}")
    home = "assertions" if name.startswith("assert_") else "strategies"
    home = "parts" if name in _PARTS else "assembly" if name in _ASSEMBLY else home
    return getattr(import_module(f"certify.testing.{home}"), name)
