"""The cross-check of a whole simulation: every phase against its certificate, then attempts to break what it claims."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import numpy

from certify.crosscheck.audit import audit_balance
from certify.crosscheck.claimed import Claimed
from certify.crosscheck.energy import Storage, Watch
from certify.crosscheck.falsify import Attempts, Falsifier
from certify.crosscheck.findings import Finding
from certify.crosscheck.model import compare_loads, compare_model, compare_rest, find_reference
from certify.kernel.check import check
from certify.phases import Phase
from certify.simulation import Stage
from certify.simulator.motion import Piece, natural_sizes
from certify.simulator.plant import Array

ATTEMPTS = 8  # on each island with a region
MAX_ATTEMPT_STATES = 400  # beyond which no attempts are made: each is a simulation of its own


@dataclass
class Checked:
    """One phase: the outcome of its certificate, what was found, H on each island at times, and the attempts.

    `covered`: for how much of the time the claims spoke of the motion, by island; `islands` are their first nodes.
    `reason` says why less than everything was looked at.
    """

    number: int
    outcome: str
    islands: tuple[str, ...] = ()
    findings: list[Finding] = field(default_factory=list)
    times: Array = field(default_factory=lambda: numpy.zeros(0), repr=False)
    storages: Array = field(default_factory=lambda: numpy.zeros((0, 0)), repr=False)
    covered: tuple[float, ...] = ()
    attempts: Attempts = field(default_factory=Attempts)
    reason: str = ""

    @property
    def contradictions(self) -> list[Finding]:
        """What does not agree, of the motion and of the attempts."""
        return [found for found in (*self.findings, *self.attempts.findings) if not found.agrees]


class CrossCheck:
    """Looks on while a simulation runs (`see`), and makes its attempts afterwards (`finish`).

    `certificates`: by the number of the phase, each about the spec of the phase. Raises: Rejected if the kernel does
    not accept one.
    """

    def __init__(
        self,
        phases: Iterable[Phase],
        certificates: Mapping[int, bytes],
        tolerance: float,
        attempts: int = ATTEMPTS,
        seed: int = 1,
    ) -> None:
        self.certificates, self.tolerance, self.attempts, self.seed = certificates, tolerance, attempts, seed
        self.verdicts = {phase.number: check(phase.spec, certificates[phase.number]) for phase in phases}
        self.checked: list[Checked] = []
        self._stage: Stage | None = None
        self._watch: Watch | None = None
        self._storages: list[Storage | None] = []

    def see(self, stage: Stage, piece: Piece) -> None:
        """The next piece of a simulation, in order."""
        if stage is not self._stage:
            self._close()
            self._stage = stage
            self._begin(stage)
        if self._watch is not None:
            self._watch.see(piece)

    def _begin(self, stage: Stage) -> None:
        phase = stage.phase
        certificate, verdict = self.certificates[phase.number], self.verdicts[phase.number]
        checked = Checked(phase.number, verdict.outcome)
        self.checked.append(checked)
        self._watch = None
        self._storages.append(None)
        claimed = Claimed(stage.plant, certificate, verdict)
        rest = find_reference(claimed)
        checked.findings += compare_loads(claimed) + compare_rest(claimed, rest)
        checked.findings += compare_model(claimed, stage.first if rest is None else rest, self.seed)
        if rest is None:
            checked.reason = "the simulator finds no equilibrium: no storage is looked at"
            return
        storage = Storage(claimed, rest)
        checked.islands = tuple(storage.first)
        if not storage.first:
            checked.reason = "no island has a storage function that is proved for all of its DGUs"
        self._storages[-1] = storage
        sizes = natural_sizes(stage.plant, rest)
        checked.findings += audit_balance(storage, stage.first, sizes)
        self._watch = Watch(storage, self.tolerance, sizes)

    def _close(self) -> None:
        watch = self._watch
        if watch is None:
            return
        checked = self.checked[-1]
        checked.findings += watch.findings
        checked.times, checked.storages = watch.storages()
        checked.covered = tuple(float(s) / watch.seconds if watch.seconds else 0.0 for s in watch.covered_seconds)
        self._watch = None

    def finish(self, progress: Callable[[float, float], None] | None = None) -> list[Checked]:
        """End the last phase, and try to break the claims of each."""
        self._close()
        for k, (checked, storage) in enumerate(zip(self.checked, self._storages, strict=True)):
            if storage is None or not self.attempts:
                continue
            if storage.plant.size > MAX_ATTEMPT_STATES:
                checked.reason = checked.reason or f"{storage.plant.size} states are too many for attempts to break it"
                continue

            def step(done: float, of: float, k: int = k) -> None:
                if progress:
                    progress(k + done / max(of, 1), len(self.checked))

            checked.attempts = Falsifier(storage, self.tolerance, self.seed).run(self.attempts, step)
        return self.checked
