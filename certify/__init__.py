"""certify: exact, checkable proofs of the stability of islanded AC microgrids.

>>> import certify
>>> spec = certify.read("specs/two-inverters.toml")
>>> certify.prove(spec).verdict.outcome
'certified'
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from certify.certificate import Certificate, prove
    from certify.inputs import load, read
    from certify.kernel.check import check
    from certify.kernel.claims import Claim, Verdict
    from certify.kernel.errors import CertifyError, Fault, Rejected, SpecError
    from certify.synthesis import Synthesis, synthesize
    from certify.tolerance import LargestTolerance, largest_tolerance

__version__ = "0.1.0"
__all__ = [
    "Certificate",
    "CertifyError",
    "Claim",
    "Fault",
    "LargestTolerance",
    "Rejected",
    "SpecError",
    "Synthesis",
    "Verdict",
    "check",
    "largest_tolerance",
    "load",
    "prove",
    "read",
    "synthesize",
]

_HOMES = {
    "certificate": ("Certificate", "prove"),
    "inputs": ("load", "read"),
    "kernel.check": ("check",),
    "kernel.claims": ("Claim", "Verdict"),
    "kernel.errors": ("CertifyError", "Fault", "Rejected", "SpecError"),
    "synthesis": ("Synthesis", "synthesize"),
    "tolerance": ("LargestTolerance", "largest_tolerance"),
}


def __getattr__(name: str) -> Any:
    """Public names are imported when they are first used, so that a start is quick."""
    for home, names in _HOMES.items():
        if name in names:
            return getattr(import_module(f"certify.{home}"), name)
    raise AttributeError(f"module 'certify' has no attribute {name!r}")
