"""Certificates: built from a spec, checked by the kernel before they are written, renamed into place."""

from __future__ import annotations

import hashlib
import json
import os
import platform
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from json.encoder import encode_basestring
from pathlib import Path
from types import MappingProxyType
from typing import Any

from certify import __version__
from certify.atomic import open_atomically as open_atomically
from certify.atomic import write_atomically as write_atomically
from certify.inputs import SpecSource, decode_all, to_bytes
from certify.kernel.check import FORMAT, check
from certify.kernel.claims import Context, Fact, Verdict
from certify.kernel.errors import Fault, SpecError
from certify.kernel.linalg import Matrix
from certify.kernel.quantity import shorten
from certify.kernel.spec import decode
from certify.provenance import moment, settle_epoch
from certify.search.earlier import Earlier
from certify.search.methods import METHODS
from certify.search.prove import Progress, find_claims
from certify.storages import proved_storages
from certify.verdicts import CertifiedClaim, Claims, NotProved, count, margins, verdict_to_dict

SHOWN = 12  # claims that are not proved, in a notebook
MAX_NESTING = 12  # levels of a certificate that are written without `json`


@dataclass(frozen=True, repr=False)
class Certificate:
    """A certificate that the kernel has accepted: its bytes, the verdict, and why open claims are open.

    `notes` maps the id of an unknown claim to a code of `certify explain`. `spec`: the text that all of it is about, to
    the byte. Claims are looked up by id, as in `certificate["dgu/1"]`. A verdict has more than two values, so a
    certificate is neither true nor false: compare `outcome`.

    >>> certificate = prove("specs/two-inverters.toml")
    >>> certificate
    <Certificate: certified; 13 claims: 13 proved>
    >>> certificate["load/a"].status, certificate.outcome == "certified"
    ('proved', True)
    """

    data: bytes
    verdict: Verdict
    notes: dict[str, str] = field(hash=False)
    spec: bytes

    @property
    def outcome(self) -> str:
        """ "certified", "conditional" (if the assumptions of the ledger hold), "refuted" or "unknown"."""
        return self.verdict.outcome

    @property
    def assumptions(self) -> tuple[tuple[str, str], ...]:
        """The ledger: name and statement of everything that is taken as given."""
        return self.verdict.assumptions

    @cached_property
    def claims(self) -> Claims:
        """Every claim by its id, in the order of the spec."""
        return Claims(self.verdict, self.notes)

    def __getitem__(self, claim: str) -> CertifiedClaim:
        """One claim. Raises: KeyError, naming what is alike, if the spec calls for no such claim."""
        return self.claims[claim]

    @property
    def margins(self) -> Mapping[str, tuple[Fact, ...]]:
        """By how much claims hold: exact numbers (what, value, unit) of those that are proved, by their ids."""
        return MappingProxyType(margins(self.verdict.claims))

    def storage(self, node: str, exact: bool = False) -> Any:
        """The matrix P of the proved storage function x'Px/2 of the DGU at a node, in the states of `dgu_model`.

        Shapes: (n, n), symmetric; floats in a numpy array, or with `exact` a tuple of rows of Fractions.
        Units: joule per product of the states' units. With tolerances: P at the values of the spec.
        Raises: NotProved if no storage function of that DGU is proved.

        >>> P = prove("specs/single-inverter.toml").storage("bus")
        >>> P.shape, bool((P == P.T).all())
        ((6, 6), True)
        """
        P, _ = self._storage(node)
        if exact:
            return P
        from numpy import array

        return array([[float(x) for x in row] for row in P])

    def shortage(self, node: str) -> Fraction:
        """By how much the DGU at a node is not passive, in ohm: S' <= <z~, d~> + shortage |d~|^2; 0 if it is.

        Raises: NotProved if nothing of the kind is proved.
        """
        return self._storage(node)[1]

    @cached_property
    def _storages(self) -> dict[str, tuple[Matrix, Fraction]]:
        return proved_storages(Context(decode(self.spec)), self.data)

    def _storage(self, node: str) -> tuple[Matrix, Fraction]:
        if str(node) in self._storages:
            return self._storages[str(node)]
        claim = self.claims.get(f"dgu/{node}")
        has = ", ".join(self._storages) or "none"
        why = f"the claim about it is {claim.status}" if claim else "there is no DGU at that node"
        raise NotProved(f"no storage function is proved at node {node!r}: {why}; proved at: {has}")

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the certificate, whole or not at all. Raises: SpecError U032 if the file cannot be written."""
        save(path, self.data)

    def to_dict(self) -> dict[str, Any]:
        """Outcome, claims with their facts, and ledger, for JSON: exact numbers as text "p/q"."""
        return verdict_to_dict(self.verdict, self.notes)

    def __bool__(self) -> bool:
        raise TypeError('a verdict is more than true or false; write certificate.outcome == "certified"')

    def __repr__(self) -> str:
        claims = self.verdict.claims
        return f"<Certificate: {self.outcome}; {len(claims):,} claims: {count(claims)}>"

    def _repr_markdown_(self) -> str:
        """What a notebook shows: the outcome, and every claim that is not proved, up to a dozen."""
        claims = self.verdict.claims
        unsettled = [claim for claim in claims if claim.status != "proved"]
        lines = [f"**{self.outcome}**: {len(claims):,} claims, {count(claims)}", ""]
        lines += [
            f"- {claim.status} `{claim.id}` ({claim.rule or self.notes.get(claim.id, 'not found')})"
            for claim in unsettled[:SHOWN]
        ]
        return "\n".join(lines + [f"- and {len(unsettled) - SHOWN} more"] * (len(unsettled) > SHOWN))


def prove(
    spec: SpecSource,
    progress: Progress | None = None,
    refute: bool = True,
    method: str | None = None,
    earlier: Earlier | None = None,
    stamp: bool = False,
) -> Certificate:
    """Search for proofs of all claims of a spec, write them down and have the kernel check them from the bytes.

    `spec`: its text in bytes, a path, a mapping, or what is built in Python: see `certify.inputs.to_bytes`. Without
    `refute` no time is spent on why a DGU with tolerances has no proof. `method`: the only one to prove loads by, of
    `search.methods.METHODS`; without it the cheapest that decides. `earlier`: proofs to try first. `progress` is called
    with what is done and all there is to do. With `stamp` the certificate carries the time, which nobody has proved;
    without, the same spec gives the same bytes.

    Raises: SpecError if the spec is not well formed; Rejected if the kernel turns the result down, which is a defect
    of the search and never a wrong verdict.

    >>> prove("specs/cigre-mv-as-printed.toml")["dgu/1"].status
    'refuted'
    """
    settle_epoch()
    text = to_bytes(spec)
    if method is not None and method not in METHODS:
        message = f"expected {', '.join(METHODS)}, got {shorten(method)}"
        raise SpecError((Fault("U001", "--method", message),))
    found = find_claims(decode_all(text), progress, refute, method, earlier)
    notes = found.pop("notes")
    data = write_certificate(text, found, notes, stamp)
    return Certificate(data, check(text, data), notes, text)


def write_certificate(
    spec: bytes, found: dict[str, Any], notes: dict[str, str], stamp: bool = False, **more: str
) -> bytes:
    """The text of a certificate about this spec: `found` has its claims, proofs, ledger and verdict.

    Nothing is checked here. `more` goes into its provenance, with `stamp` also the time.
    """
    created = moment(stamp)
    document = {
        **found,
        "format": FORMAT,
        "spec_sha256": hashlib.sha256(spec).hexdigest(),
        "provenance": {
            "certify": __version__,
            "python": platform.python_version(),
            **({"created": created} if created else {}),
            "notes": notes,
            **more,
        },
    }
    return to_canonical_json(document)


def to_canonical_json(document: dict[str, Any]) -> bytes:
    """The one text of a certificate: keys sorted, one space of indentation, a final newline.

    That of `json.dumps(document, sort_keys=True, indent=1, ensure_ascii=False)`, in half the time.
    """
    return (_to_json(document, "\n") + "\n").encode()


def _to_json(value: Any, start: str) -> str:
    """The text of a value; `start` is a line break and the indentation of the line that the value stands in.

    Nearly all of a certificate is text, in tables and lists: that is written without a call for each. What is nested
    deeper than any proof is left to `json`, which takes less of the stack.
    """
    if len(start) > MAX_NESTING:
        return json.dumps(value, sort_keys=True, indent=1, ensure_ascii=False).replace("\n", start)
    inner = start + " "
    if isinstance(value, dict) and value:
        entries = [
            f"{encode_basestring(key)}: {encode_basestring(x) if type(x) is str else _to_json(x, inner)}"
            for key, x in sorted(value.items())
        ]
        return f"{{{inner}{f',{inner}'.join(entries)}{start}}}"
    if isinstance(value, list | tuple) and value:
        entries = [encode_basestring(x) if type(x) is str else _to_json(x, inner) for x in value]
        return f"[{inner}{f',{inner}'.join(entries)}{start}]"
    return json.dumps(value, ensure_ascii=False)


def save(path: str | os.PathLike[str], data: bytes) -> None:
    """As `write_atomically`, for the library. Raises: SpecError U032 that names the file."""
    target = Path(os.fsdecode(path))
    try:
        if target.is_dir():
            raise IsADirectoryError(0, "Is a directory")
        write_atomically(target, data)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise SpecError((Fault("U032", "", f"cannot write {shorten(str(target), 200)}: {reason}"),)) from None
