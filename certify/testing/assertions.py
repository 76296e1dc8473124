"""Assertions about specs: what the kernel accepts counts, and what is open counts for nothing, neither way.

Each returns the certificate that it rests on, or raises an AssertionError that says what failed, by which rule and
witness, and about which spec. A spec is bytes, a path, a document (a mapping of its JSON shape), or an object with
`to_bytes`. Bad input is no failure of an assertion: it raises SpecError, its faults with the spec in the message.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import Any, NoReturn

from certify.certificate import Certificate, prove
from certify.checking import check
from certify.gating.judge import may_pass, missing_names
from certify.gating.policy import Policy
from certify.inputs import decode_all, to_bytes
from certify.kernel.claims import Claim
from certify.kernel.errors import Rejected, SpecError
from certify.testing.assembly import FREQUENCY, dgu_spec
from certify.testing.records import note
from certify.testing.tracing import unexplained
from certify.testing.words import about, claim_in_words, faults_in_words, file_of, spec_in_words, verdict_in_words


def assert_certified(spec: Any, *, allow: str | Iterable[str] = (), certificate: Any = None) -> Certificate:
    """The spec is certified - or conditional on nothing but assumptions of the ledger that `allow` names.

    `allow`: names such as sampled/9, or patterns such as "sampled/*", as in `certify gate --allow`. `certificate`: one
    to check (bytes or a path) instead of a proof. Raises: AssertionError; SpecError.

    >>> assert_certified("specs/two-inverters.toml").verdict.outcome
    'certified'
    """
    __tracebackhide__ = True
    data, found = _found(spec, certificate)
    policy = allowing(allow)
    if not may_pass(found.verdict, policy):
        _fail(verdict_in_words(found, f"certified: {about(spec)}", missing_names(found.verdict, policy)), spec, data)
    return found


def assert_refuted(spec: Any, claim: str | None = None, *, certificate: Any = None) -> Certificate:
    """The spec is refuted: a claim has an exact witness against it - the one with this id, or of this kind.

    A claim that is only not proved is not refuted. Raises: AssertionError; SpecError.

    >>> found = assert_refuted("specs/cigre-mv-as-printed.toml", "dgu/1")
    """
    __tracebackhide__ = True
    data, found = _found(spec, certificate)
    if claim is None:
        if found.verdict.outcome != "refuted":
            _fail(verdict_in_words(found, f"refuted: {about(spec)}"), spec, data)
        return found
    meant = [c for c in found.verdict.claims if claim in (c.id, c.kind)]
    if not meant:
        ids = ", ".join(c.id for c in found.verdict.claims[:12])
        _fail(
            f"there is no claim {claim!r} about {about(spec)}, so it is not refuted; there are {ids}, ...", spec, data
        )
    if not any(c.status == "refuted" for c in meant):
        told = "\n".join(claim_in_words(c, found.notes) for c in meant[:6])
        _fail(f"not refuted: {claim} of {about(spec)}\n{told}", spec, data)
    return found


def assert_not_certified(spec: Any, *, allow: str | Iterable[str] = (), certificate: Any = None) -> Certificate:
    """The spec is not certified, be it refuted, unknown, or conditional on more than `allow` names.

    Raises: AssertionError; SpecError.
    """
    __tracebackhide__ = True
    data, found = _found(spec, certificate)
    if may_pass(found.verdict, allowing(allow)):
        _fail(f"certified, and should not be: {about(spec)} ({found.verdict.outcome})", spec, data)
    return found


def assert_passive(
    filter: Mapping[str, Any], controller: Mapping[str, Any], *, frequency: Any = FREQUENCY
) -> Certificate:
    """The inverter with this filter and controller is passive, exactly: a storage function proves it.

    This is asked of a design, and more than a network needs. Gains have to be formulas ("R - h"), or exact numbers
    (Fraction, with `certify.testing.w0`): of a float its shortest decimal counts, and rounding alone makes a design
    passive but for a shortage. For such, and for filters with a tolerance, prove a network by `assert_certified`.
    Raises: AssertionError; SpecError.

    >>> law = {"kind": "ida-pbc", "alpha": -5, "nu": 1, "ki": 100}
    >>> found = assert_passive({"R": 0.1, "L": "1.8 mH", "C": 25e-6}, law)
    """
    __tracebackhide__ = True
    data, found, claim = _passivity(filter, controller, frequency)
    if claim.status != "proved":
        text = f"not passive, as far as proved\n{claim_in_words(claim, found.notes)}"
        if claim.status == "refuted":
            text = f"not passive\n{claim_in_words(claim, found.notes)}"
        if any(map(_has_floats, controller.values())):
            text += "\n  = help: gains are given as floats; take formulas, or Fractions with certify.testing.w0"
        _fail(text, None, data)
    return found


def assert_not_passive(
    filter: Mapping[str, Any], controller: Mapping[str, Any], *, frequency: Any = FREQUENCY
) -> Certificate:
    """There is no storage function for the inverter with this filter and controller: a witness refutes every one.

    Raises: AssertionError if it is passive, or if neither is known; SpecError.
    """
    __tracebackhide__ = True
    data, found, claim = _passivity(filter, controller, frequency)
    if claim.status != "refuted":
        _fail(f"not refuted\n{claim_in_words(claim, found.notes)}", None, data)
    return found


def allowing(names: str | Iterable[str]) -> Policy:
    """What the gate would be asked for with these names or patterns."""
    return Policy(allow=(names,) if isinstance(names, str) else tuple(names))


def _passivity(filter: Any, controller: Any, frequency: Any) -> tuple[bytes, Certificate, Claim]:
    from certify.testing.passivity import prove_passivity

    __tracebackhide__ = True
    data = dgu_spec(filter, controller, frequency=frequency).to_bytes()
    try:
        with unexplained():
            found = prove_passivity(data)
    except SpecError as error:
        error.add_note(f"\n{faults_in_words(error.faults, '')}\n\n{spec_in_words(data)}")
        raise
    note(data, found.verdict, "proved, without shortage")
    return data, found, next(c for c in found.verdict.claims if c.kind == "dgu")


def _found(spec: Any, certificate: Any) -> tuple[bytes, Certificate]:
    """The bytes of the spec, and its certificate: proved, or checked if there is one."""
    __tracebackhide__ = True
    source = file_of(spec)
    data = b""
    try:
        data = to_bytes(spec)
        with unexplained():
            if certificate is not None:
                decode_all(data)  # with its scenarios, which the kernel does not read and `prove` does
            found = prove(data) if certificate is None else check(data, certificate)
    except SpecError as error:
        told = "" if source or not data else f"\n\n{spec_in_words(data)}"
        error.add_note(f"\n{faults_in_words(error.faults, source)}{told}")
        raise
    except Rejected as error:
        _fail(f"the certificate does not prove what it says about {about(spec)}: {error}", spec, data)
    file = f": {certificate}" if isinstance(certificate, str | os.PathLike) else ""
    note(data, found.verdict, "proved" if certificate is None else f"checked{file}", source)
    return data, found


def _has_floats(value: Any) -> bool:
    if isinstance(value, list | tuple):
        return any(map(_has_floats, value))
    dtype = getattr(value, "dtype", None)
    return isinstance(value, float) or (dtype is not None and dtype.kind == "f")


def _fail(text: str, spec: Any, data: bytes) -> NoReturn:
    """Raise the failure, with the spec, unless it is in a file that the message names."""
    __tracebackhide__ = True
    raise AssertionError(text if file_of(spec) else f"{text}\n\n{spec_in_words(data)}")
