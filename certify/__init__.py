"""certify: exact, checkable proofs of the stability of islanded AC microgrids.

>>> import certify
>>> certificate = certify.prove("specs/two-inverters.toml")
>>> certificate.outcome, certificate["dgu/a"].status
('certified', 'proved')
>>> certify.check("specs/two-inverters.toml", certificate.data).outcome
'certified'

A spec is given by the path of a file, its text in bytes, a mapping as JSON has it, or a `Spec` that is built here.
Every error that a user can cause is a `CertifyError`; a `SpecError` has all faults, each with code, place and message.
Functions keep no state between calls but caches, and may be called from several threads.
"""

from __future__ import annotations

TYPE_CHECKING = False  # type checkers know this name; `typing` itself takes longer to import than all of this
if TYPE_CHECKING:
    from typing import Any

    from certify.arrays import NetworkModel, PortModel, dgu_model, line_model, network_model
    from certify.building import Spec
    from certify.certificate import Certificate, prove
    from certify.checking import CrossCheck, check, cross_check
    from certify.difference import Difference, diff
    from certify.explaining import explain
    from certify.inputs import load, read
    from certify.kernel.claims import Claim, Verdict
    from certify.kernel.errors import CertifyError, Fault, Rejected, SpecError
    from certify.simulation import Simulation, simulate
    from certify.synthesis import Synthesis, synthesize
    from certify.tolerance import LargestTolerance, largest_tolerance
    from certify.verdicts import CertifiedClaim, NotProved

__version__ = "0.1.0"
__all__ = [
    "Certificate",
    "CertifiedClaim",
    "CertifyError",
    "Claim",
    "CrossCheck",
    "Difference",
    "Fault",
    "LargestTolerance",
    "NetworkModel",
    "NotProved",
    "PortModel",
    "Rejected",
    "Simulation",
    "Spec",
    "SpecError",
    "Synthesis",
    "Verdict",
    "check",
    "cross_check",
    "dgu_model",
    "diff",
    "explain",
    "largest_tolerance",
    "line_model",
    "load",
    "network_model",
    "prove",
    "read",
    "simulate",
    "synthesize",
]

_HOMES = {
    "arrays": ("NetworkModel", "PortModel", "dgu_model", "line_model", "network_model"),
    "building": ("Spec",),
    "certificate": ("Certificate", "prove"),
    "checking": ("CrossCheck", "check", "cross_check"),
    "difference": ("Difference", "diff"),
    "explaining": ("explain",),
    "inputs": ("load", "read"),
    "kernel.claims": ("Claim", "Verdict"),
    "kernel.errors": ("CertifyError", "Fault", "Rejected", "SpecError"),
    "simulation": ("Simulation", "simulate"),
    "synthesis": ("Synthesis", "synthesize"),
    "tolerance": ("LargestTolerance", "largest_tolerance"),
    "verdicts": ("CertifiedClaim", "NotProved"),
}


def __getattr__(name: str) -> Any:
    """Public names are imported when they are first used, so that a start is quick."""
    from importlib import import_module

    for home, names in _HOMES.items():
        if name in names:
            return getattr(import_module(f"certify.{home}"), name)
    raise AttributeError(f"module 'certify' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
