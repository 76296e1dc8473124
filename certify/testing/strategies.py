"""Hypothesis strategies for parts of microgrids and for whole specs; what each of them promises, a proof confirms."""

from __future__ import annotations

from importlib import import_module

try:
    import hypothesis  # noqa: F401
except ImportError as error:  # said once, for everybody who uses any of them
    raise ImportError("strategies need hypothesis: pip install 'certify-eip[testing]'") from error

from certify.testing.dgus import (
    boundary_controllers,
    controllers,
    filters,
    non_passive_controllers,
    passive_controllers,
    references,
)
from certify.testing.load_kinds import loads
from certify.testing.short_numbers import decimals, quantities
from certify.testing.topologies import Network, lines, networks, specs

# What proofs and refutations import when they first need it: now, because the first example would take a fifth of a
# second longer than the others, and hypothesis would call that unreliable.
for _name in (
    "certify.testing.assertions",
    "certify.testing.passivity",
    "certify.search.contradiction",
    "flint",
    "numpy",
):
    import_module(_name)

__all__ = [
    "Network",
    "boundary_controllers",
    "controllers",
    "decimals",
    "filters",
    "lines",
    "loads",
    "networks",
    "non_passive_controllers",
    "passive_controllers",
    "quantities",
    "references",
    "specs",
]
