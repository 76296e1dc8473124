"""What the kernel says of a certificate, and what a simulation says beside it, for use from Python."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from certify.certificate import Certificate
from certify.inputs import SpecSource, read_named, to_bytes
from certify.kernel import check as kernel
from certify.kernel.errors import Fault, SpecError
from certify.verdicts import read_notes

if TYPE_CHECKING:
    from certify.crosscheck.findings import Finding
    from certify.crosscheck.run import Checked
    from certify.simulation import Progress, Second, Simulation
    from certify.simulator.plant import Array

CertificateSource = bytes | str | os.PathLike[str] | Certificate


def certificate_bytes(certificate: CertificateSource) -> bytes:
    """The text of a certificate: given in bytes, by a path, or as `prove` returned it.

    Raises: SpecError S000 if a file cannot be read, U031 for text in place of a path; TypeError for anything else.
    """
    if isinstance(certificate, Certificate):
        return certificate.data
    if isinstance(certificate, bytes | bytearray | memoryview):
        return bytes(certificate)
    if isinstance(certificate, str | os.PathLike):
        return read_named(certificate, "certificate")
    kinds = "its text in bytes, a path, or what `prove` returned"
    raise TypeError(f"a certificate is {kinds}, not a value of type {type(certificate).__name__}")


def check(spec: SpecSource, certificate: CertificateSource) -> Certificate:
    """Have the kernel check a certificate against the spec that it is about, from the bytes of both.

    Returns the certificate with the verdict of the kernel: what it proves, refuted claims included, so look at
    `outcome`. For `spec` see `certify.inputs.to_bytes`.
    Raises: SpecError if the spec is not well formed or a file cannot be read; Rejected if the certificate does not
    prove what it says, or is about another text.

    >>> import certify
    >>> proved = certify.prove("specs/two-inverters.toml")
    >>> check("specs/two-inverters.toml", proved.data).outcome
    'certified'
    >>> try:
    ...     check("specs/single-inverter.toml", proved)
    ... except certify.Rejected as error:
    ...     print(error)
    K103 at spec_sha256: the certificate is about another spec, or the spec has changed
    """
    text, data = to_bytes(spec), certificate_bytes(certificate)
    verdict = kernel.check(text, data)
    return Certificate(data, verdict, read_notes(data), text)


@dataclass(frozen=True, eq=False, repr=False)
class CrossCheck:
    """A certificate beside a simulation that shares no model with it. Agreement is evidence, and no proof.

    What `cross_check` returns. `phases` has an entry for each phase of the scenario: all that was compared, and H over
    time.
    """

    simulation: Simulation
    certificates: Mapping[int, Certificate]
    phases: tuple[Checked, ...]

    @property
    def contradictions(self) -> tuple[Finding, ...]:
        """Everything in which certificate and simulation do not agree: one of them is wrong."""
        return tuple(found for phase in self.phases for found in phase.contradictions)

    def storage(self, phase: int = 1) -> tuple[Any, dict[str, Any]]:
        """The storage function H of each island along the motion of a phase: times in s, and H in joule.

        Shapes: times (t,), and by the first node of each island (t,). Empty where no H is proved.
        """
        entry = next(entry for entry in self.phases if entry.number == phase)
        return entry.times, {first: entry.storages[:, k] for k, first in enumerate(entry.islands)}

    def __repr__(self) -> str:
        compared = sum(len(phase.findings) for phase in self.phases)
        return f"<CrossCheck: {compared} comparisons, {len(self.contradictions)} contradictions; evidence, no proof>"


def cross_check(
    spec: SpecSource,
    certificate: CertificateSource | Sequence[CertificateSource] | None = None,
    scenario: str | None = None,
    *,
    end: Second | None = None,
    start: str | Array | None = None,
    samples: int | Array | None = None,
    tolerance: float | None = None,
    method: str | None = None,
    attempts: int | None = None,
    seed: int = 1,
    progress: Progress | None = None,
) -> CrossCheck:
    """Simulate, hold the certificate against the motion, and try to break the region that it claims.

    `certificate`: that of the spec, or with a `scenario` one for each of its phases; without it they are proved first.
    `attempts` to break the region of each island, made from `seed`. The others are those of `simulate`.
    Raises: SpecError for bad input, U008 if there are not as many certificates as phases; Rejected if the kernel does
    not accept one of them.

    >>> found = cross_check("specs/two-inverters.toml", end="20 ms", attempts=0)
    >>> found.contradictions
    ()
    >>> times, H = found.storage()
    >>> bool(H["a"][-1] < H["a"][0])
    True
    """
    from certify.certificate import prove
    from certify.crosscheck.run import ATTEMPTS
    from certify.crosscheck.run import CrossCheck as Run
    from certify.simulation import DEFAULT_SAMPLES, TOLERANCE, Course, require_options, simulate_course, to_seconds

    text = to_bytes(spec)
    accuracy = TOLERANCE if tolerance is None else tolerance
    require_options(start, samples, accuracy, method)
    course = Course(text, scenario, to_seconds(end))
    phases = course.phases
    if certificate is None:
        proved = [prove(phase.spec) for phase in phases]
    else:
        single = isinstance(certificate, bytes | bytearray | memoryview | str | os.PathLike | Certificate)
        given: Any = [certificate] if single else certificate
        if len(given) != len(phases):
            message = f"{len(given)} certificates for {len(phases)} phases; each phase is a spec of its own"
            raise SpecError((Fault("U008", "certificate", message),))
        proved = [check(phase.spec, own) for phase, own in zip(phases, given, strict=True)]
    numbered = {phase.number: own for phase, own in zip(phases, proved, strict=True)}
    texts = {number: own.data for number, own in numbered.items()}
    run = Run(phases, texts, accuracy, ATTEMPTS if attempts is None else attempts, seed)
    motion = simulate_course(
        course,
        start=start,
        samples=DEFAULT_SAMPLES if samples is None else samples,
        tolerance=accuracy,
        method=method,
        progress=progress,
        observe=run.see,
    )
    return CrossCheck(motion, numbered, tuple(run.finish()))
