"""Hypothesis strategies for parts of microgrids and for whole specs; what each of them promises, a proof confirms."""

from __future__ import annotations

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
