"""The storage functions of a certificate: what the proofs of its DGU claims say, with the part that the spec fixes."""

from __future__ import annotations

import json
from fractions import Fraction
from typing import Any

from certify.kernel.claims import Context
from certify.kernel.data import Data
from certify.kernel.linalg import Matrix
from certify.kernel.proofs import full_storage
from certify.kernel.rules import storage_at


def proved_storages(context: Context, certificate: bytes) -> dict[str, tuple[Matrix, Fraction]]:
    """The storage matrix P in the states of the port, and the shortage in ohm, of each DGU that is proved, by its node.

    With tolerances it is that at the values of the spec. `certificate` is one about the spec of `context` that the
    kernel has accepted.
    """
    document: dict[str, Any] = json.loads(certificate)
    found = {}
    for entry in document["claims"]:
        kind, _, name = entry["id"].partition("/")
        if kind == "dgu" and name in context.nodes and entry["rule"] in ("quadratic-storage", "index-storage"):
            proof = document["proofs"][entry["proof"]]
            port, given = context.port(name), Data(proof["storage"]).matrix()
            if entry["rule"] == "quadratic-storage":
                found[name] = full_storage(port, given), Fraction(0)
            else:
                found[name] = storage_at(port, given), Data(proof["shortage"]).scalar()
    return found
