"""Attempts to break a certificate: motion from states in and around the proved region.

From H <= c nothing may make H grow, leave the region, or stay away from the equilibrium. States are drawn at random on
a level of H, put where a voltage is nearest to the end of its band or an inverter to its limit, and improved step by
step towards what came nearest to breaking a claim. States beyond the region are tried too; nothing is claimed of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy
import scipy.linalg
from scipy.sparse import csr_matrix, identity, vstack

from certify.crosscheck.energy import Storage, Watch
from certify.crosscheck.findings import Finding
from certify.simulator.flow import free_flow
from certify.simulator.motion import Diverged, Follower, natural_sizes
from certify.simulator.plant import Array

SHARES = (0.999, 0.9, 0.5, 0.999)  # of the level c, in turn
BEYOND = (2.0, 10.0, 100.0)
SETTLED = 1e-2  # of H at first: what has to be left of it at the end at most
TIMES = 6.0  # of the slowest time constant is what a motion is given
LONGEST_SECOND = 20.0
MAX_STATES = 400  # for which the modes of the network are known
MUTATION = 0.3  # of a direction, when the worst attempt is made worse


@dataclass(frozen=True)
class Attempt:
    """One start and what came of it. `share` of the level c that H has at first; `kind` of start: "random", "worst
    case" or "improved".

    `rise`: the largest rise of H between two looks, as a share of H at first; `edge`: how far the motion went towards
    what limits the region (1: there); `left`: the share of H that is left at the end.
    """

    island: str
    kind: str
    share: float
    rise: float
    edge: float
    left: float
    seconds: float
    returned: bool
    start: Array = field(compare=False, repr=False)

    @property
    def inside(self) -> bool:
        return self.share <= 1

    @property
    def score(self) -> float:
        """How near it came to breaking a claim: 1 would have."""
        return max(self.edge, self.left / SETTLED if not self.returned else 0.0)


@dataclass
class Attempts:
    """All attempts on all islands, and the contradictions among them."""

    tried: list[Attempt] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)

    @property
    def best(self) -> Attempt | None:
        """The one inside the region that came nearest to breaking a claim."""
        return max((a for a in self.tried if a.inside), key=lambda a: a.score, default=None)


class Falsifier:
    """Starts motions on the islands that have a proved region, around the rest state of the simulator."""

    def __init__(self, storage: Storage, tolerance: float, seed: int = 1) -> None:
        self.storage, self.tolerance = storage, tolerance
        self.plant, self.claimed = storage.plant, storage.claimed
        self.sizes = natural_sizes(self.plant, storage.rest)
        self.rng = numpy.random.default_rng(seed)
        self.end = self._horizon()
        self._reaches: dict[str, tuple[csr_matrix, Array]] = {}

    def _horizon(self) -> float:
        """How long to follow a motion, in s."""
        values = numpy.linalg.eigvals(free_flow(self.plant).jacobian(self.storage.rest).toarray())
        slowest = float(numpy.min(-values.real))
        return min(TIMES / slowest, LONGEST_SECOND) if slowest > 0 else LONGEST_SECOND

    def run(self, count: int, progress: Callable[[float, float], None] | None = None) -> Attempts:
        """Make `count` attempts on each island with a region, and a few beyond it."""
        found = Attempts()
        islands = [first for first in self.storage.first if first in self.claimed.regions]
        total = len(islands) * (count + len(BEYOND))
        for first in islands:
            places = self._places(first)
            factor = scipy.linalg.cholesky(self.storage.P[places][:, places].toarray(), lower=True)
            level = self._level(first)
            starts = self._worst_cases(first, places, factor)
            for n in range(count + len(BEYOND)):
                if n >= count:
                    kind, share, direction = "random", BEYOND[n - count], self._random(len(places))
                else:
                    share = SHARES[n % len(SHARES)]
                    kind, direction = self._direction(n, starts, places, factor, found, first)
                # x'P x/2 is half the square of the direction
                off = scipy.linalg.solve_triangular(factor.T, direction) * numpy.sqrt(2 * share * level)
                x = self.storage.rest.copy()
                x[places] += off
                self._attempt(found, first, kind, share, x)
                if progress:
                    progress(len(found.tried), total)
        return found

    def edge_state(self, share: float = SHARES[0]) -> Array | None:
        """A state in the order of the plant with H = `share` c on each island with a level c; None if none has one.

        On each of them it is moved as far as that goes towards what sets the level.
        """
        x, found = self.storage.rest.copy(), False
        for first in self.storage.first:
            region = self.claimed.regions.get(first)
            if region is None or region.level is None:
                continue
            places = self._places(first)
            factor = scipy.linalg.cholesky(self.storage.P[places][:, places].toarray(), lower=True)
            cases = [case for case in self._cases(first) if region.limit == case[2]] or self._cases(first)
            row, _, _ = min(cases, key=lambda case: abs(case[1] - region.margin))
            direction = scipy.linalg.solve_triangular(factor, row[places], lower=True)
            direction *= numpy.sqrt(2 * share * region.level) / numpy.linalg.norm(direction)
            x[places] += scipy.linalg.solve_triangular(factor.T, direction)
            found = True
        return x if found else None

    def _places(self, first: str) -> Any:
        k = self.storage.first.index(first)
        of_island = numpy.flatnonzero(self.storage.island_of == k)
        return numpy.flatnonzero(numpy.isin(self.storage.part_of, of_island))

    def _level(self, first: str) -> float:
        """c in joule; where everything is attracted, H of deviations as large as the states themselves."""
        level = self.claimed.regions[first].level
        if level is not None:
            return level
        places = self._places(first)
        return float(self.storage.P.diagonal()[places] @ self.sizes[places] ** 2) / 2

    def _random(self, n: int) -> Array:
        direction = self.rng.normal(size=n)
        return direction / numpy.linalg.norm(direction)

    def _direction(
        self, n: int, worst: list[Array], places: Any, factor: Array, found: Attempts, first: str
    ) -> tuple[str, Array]:
        """Worst cases first, then random ones, and every third one an improvement of what came nearest."""
        if n < min(len(worst), 4):
            return "worst case", worst[n]
        own = [a for a in found.tried if a.island == first and a.inside]
        if n % 3 == 2 and own:
            best = max(own, key=lambda a: a.score)
            old = factor.T @ (best.start - self.storage.rest)[places]
            step = old / numpy.linalg.norm(old) + MUTATION * self._random(len(places))
            return "improved", step / numpy.linalg.norm(step)
        return "random", self._random(len(places))

    def _cases(self, first: str) -> list[tuple[Array, float, str]]:
        """All voltages of loads, and of inverters with limits, of an island: e of e'x, how far it is from an end, and
        how a region's limit calls it."""
        plant, rest, cases = self.plant, self.storage.rest, []
        V = plant.loaded_voltages(rest).reshape(-1, 2)
        k = self.storage.first.index(first)
        for j in numpy.flatnonzero(self.storage.load_island == k):
            centre, (low, high) = self.storage.bands[j, :2], self.storage.bands[j, 2:]
            away = V[j] - centre
            size = float(numpy.linalg.norm(away))
            row = (away / size) @ plant.S[2 * j : 2 * j + 2].toarray() if size else plant.S[2 * j].toarray()[0]
            what = f"node {plant.loaded[j]}"
            cases += [(sign * row, room, what) for sign, room in ((1.0, high - size), (-1.0, size - low))]
        asked, places, names = plant.asked(rest), self._places(first), list(plant.inverters)
        for j in numpy.flatnonzero(numpy.isfinite(plant.limits)):
            row = plant.K[j].toarray()[0]
            if numpy.any(row[places]):
                what = f"the terminal voltage of the DGU at node {names[j // 2]}, {'dq'[j % 2]}"
                cases += [(sign * row, plant.limits[j] - sign * asked[j], what) for sign in (1.0, -1.0)]
        return cases

    def _worst_cases(self, first: str, places: Any, factor: Array) -> list[Array]:
        """Directions in which a voltage of a load, or of an inverter's terminals, moves farthest for its H.

        Of all such quantities e'x the nearest to their ends come first: H = c moves e'x by sqrt(2 c e'P^-1 e).
        """
        reached = []
        for row, room, _ in self._cases(first):
            direction = scipy.linalg.solve_triangular(factor, row[places], lower=True)
            reach = float(numpy.linalg.norm(direction))
            if reach > 0 and room > 0:
                reached.append((reach / room, direction / reach))
        reached.sort(key=lambda case: -case[0])
        return [direction for _, direction in reached]

    def _attempt(self, found: Attempts, first: str, kind: str, share: float, x: Array) -> None:
        k = self.storage.first.index(first)
        watch = Watch(self.storage, self.tolerance, self.sizes, balance=False)
        follower = Follower(self.plant, x, self.tolerance)
        first_H = float(self.storage.of(x[None, :])[0, k])
        edge, last, seconds = 0.0, x, 0.0
        try:
            for piece in follower.pieces(x, 0.0, self.end):
                watch.see(piece)
                last, seconds = piece.last, piece.end
                edge = max(edge, self._edge(first, piece.states(numpy.linspace(piece.start, piece.end, 9))))
        except Diverged:
            edge = numpy.inf
        _, H = watch.storages()
        left = float(self.storage.of(last[None, :])[0, k]) / first_H
        rise = float(numpy.diff(H[:, k]).max(initial=0.0)) / first_H if len(H) > 1 else 0.0
        returned = bool(left <= SETTLED)
        attempt = Attempt(first, kind, share, rise, edge, left, seconds, returned, x)
        found.tried.append(attempt)
        if not attempt.inside:
            return  # nothing is claimed of it
        found.findings += [replace(f, start=x) for f in watch.findings if not f.agrees]
        if not returned and seconds < LONGEST_SECOND:
            found.findings.append(Finding("return", first, left, SETTLED, "", seconds, last, x))
        if edge > 1 + 1e-9:
            found.findings.append(Finding("region", first, edge, 1.0, "", seconds, last, x))

    def _edge(self, first: str, x: Array) -> float:
        """How near a voltage, a current or an inverter comes to what the region allows it, 1 being there."""
        storage, plant, region = self.storage, self.plant, self.claimed.regions[first]
        if region.level is None:
            return 0.0
        rows, reach = self._reach(first)
        off = (rows @ (x - storage.rest).T).T.reshape(len(x), -1, 2)
        largest = float((numpy.hypot(off[..., 0], off[..., 1]) / reach).max(initial=0.0))
        limited = numpy.isfinite(plant.limits)
        if not limited.any():
            return largest
        u, at_rest = plant.asked(x)[:, limited], plant.asked(storage.rest)[limited]
        room = plant.limits[limited] - numpy.abs(at_rest)
        gone = numpy.abs(u) - numpy.abs(at_rest)
        return max(largest, float((gone / numpy.where(room > 0, room, 1.0))[:, room > 0].max(initial=0.0)))

    def _reach(self, first: str) -> tuple[csr_matrix, Array]:
        """What reads the voltages and currents that a region bounds, two rows each, and their bounds in V and A."""
        if first not in self._reaches:
            plant, region = self.plant, self.claimed.regions[first]
            volts, _ = plant.voltages
            order = list(plant.nodes)
            rows = [volts[2 * order.index(name) : 2 * order.index(name) + 2] for name in region.nodes]
            rows += [identity(plant.size, format="csr")[plant.slices["line", name]] for name in region.lines]
            bounds = [*region.nodes.values(), *region.lines.values()]
            self._reaches[first] = vstack(rows).tocsr(), numpy.array(bounds)
        return self._reaches[first]
