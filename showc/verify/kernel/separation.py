"""Separation of every pair of drones at every instant of the show.

**Theorem.** In the separation's own measure no two drones of the logged polynomials
come nearer to each other at any instant than :attr:`Encounter.lower`. Every segment
holds the whole fleet, hovering drones too. What is flown comes no nearer than that,
less both radii (:mod:`showc.verify.kernel.dynamics`).

Proof. Time is cut into slices. Pairs that are further apart throughout a slice than the
closest encounter known so far are settled by :mod:`showc.verify.kernel.slices`. For the
others the difference of positions is a polynomial on each common mesh interval. Its
length is bounded from below by the Bernstein coefficients of the sum of its squares
(for the forms per axis, of each component);
values at interval ends are reached (Farouki 2012, The Bernstein polynomial basis: a
centennial retrospective, section 4). Halving brings both to :data:`RESOLUTION` of each
other (:func:`showc.verify.kernel.bernstein.least`). No sampling decides anything.

*Rounding.* Fewer than 1000 steps lie between logged coefficients and what is compared:
:data:`GAMMA` of the greatest coordinate for lengths, of the greatest coefficient for
squares (Higham 2002, section 3.1). Times that differ by less than ``MOMENT`` count as
one; what is flown in it comes off the bound.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from showc.verify.kernel import slices
from showc.verify.kernel.bernstein import least, square_sum
from showc.verify.kernel.dynamics import GAMMA, POSITION
from showc.verify.kernel.show import LoggedShow, Statement

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from showc.arrays import FloatArray, IntArray
    from showc.log.showc_pb2 import Separation

RESOLUTION = 5e-7  # width of the enclosure of the closest encounter [m]

TOLERANCE = 1e-6
"""How far the separation may be missed by the polynomials: what a solver calls equal
[m]. What is flown may miss it by the tolerances of two positions besides."""

_FURTHEST = 2.0
"""How far drones fly in a slice, in separations: more slices take longer to cut, fewer
leave more pairs to their polynomials."""
_CROWD = 200
"""Pairs for each drone that are looked at in a slice: formations as dense as the
separation allows have half of them. Where there are more, slices are halved."""
_HALVINGS = 20  # how often a slice is halved at most: to a millionth


@dataclass(slots=True)
class Encounter:
    """The closest two drones come, of all that were looked at."""

    upper: float = np.inf  # distance reached, in the separation's own measure [m]
    pair: tuple[int, int] = (0, 0)  # the pair that reaches it, counting from 0
    time: float = 0.0  # when it does: show time, or on the missions' clock [s]
    lower: float = 0.0  # no pair comes nearer at any instant [m]
    segment: str = ""  # name of what is under way then
    error: float = 0.0  # rounding of numbers and times that ``lower`` allows for [m]

    def take(self, pairs: IntArray, time: float, gaps: FloatArray) -> None:
        """Remember the nearest of encounters of pairs (n, 2), if it is nearer."""
        row = int(np.argmin(gaps)) if gaps.size else 0
        if gaps.size and gaps[row] < self.upper:
            first, second = sorted(pairs[row].tolist())
            self.pair, self.time = (first, second), time
            self.upper = float(gaps[row])


def encounter_parts(show: LoggedShow) -> list[Callable[[], Encounter | None]]:
    """Return searches for the closest encounter, each over a part of the show."""
    tracks = [(slices.Tracks.of(one), one.message.name) for one in show.segments]
    wanted = show.rules.separation
    return [partial(closest_in, own, wanted, name) for own, name in tracks]


def closest_in(
    tracks: slices.Tracks, wanted: Separation, during: str = ""
) -> Encounter | None:
    """Enclose the closest encounter of a fleet ``during`` a leg; None of one drone."""
    if tracks.drones < 2:
        return None
    looks = (_Search(one, wanted.distance) for one in slices.measures(wanted))
    return closest_of([look.over(tracks, during) for look in looks])


def closest_of(parts: Sequence[Encounter | None]) -> Encounter | None:
    """Return the closest of what the parts found, the first among equals."""
    found = [one for one in parts if one is not None]
    if not found:
        return None
    lower, error = min(one.lower for one in found), max(one.error for one in found)
    return replace(min(found, key=lambda one: one.upper), lower=lower, error=error)


def separated(
    show: LoggedShow, radii: Sequence[FloatArray], encounter: Encounter | None
) -> Statement:
    """State whether the separation is kept, and by how much.

    There is one of ``radii`` for each segment; ``encounter`` is the show's closest one.
    """
    if encounter is None:
        return Statement("VRF321", None, notes=("there is only one drone",))
    separation = show.rules.separation
    scale = max(measure.scale[-1] for measure in slices.measures(separation))
    radius = float(np.linalg.norm(np.array(radii)[:, :, :3], axis=2).max())
    # Where positions are not proved, VRF301 says so; what would be flown is unknown.
    away = min(radius, POSITION) * max(scale, 1.0)
    flown = max(encounter.lower - 2.0 * away, 0.0)
    note = (
        f"{show.drones * (show.drones - 1) // 2:,} pairs; the closest encounter of the "
        f"polynomials lies in [{encounter.lower:.7f}, {encounter.upper:.7f}] m "
        f"(resolution {RESOLUTION:.0e} m, rounding {encounter.error:.0e} m, tolerance "
        f"{TOLERANCE:.0e} m); flown {radius:.1e} m off at most, allowed {POSITION:.0e}"
    )
    enough, asked = separation.distance - TOLERANCE, separation.distance
    holds = encounter.lower >= enough and radius <= POSITION
    where = encounter.pair, encounter.segment, encounter.time
    return Statement("VRF321", holds, flown, asked, "m", *where, (note,))


class _Search:
    """Branch and bound over the tracks of a fleet with one measure."""

    def __init__(self, measure: slices.Measure, wanted: float) -> None:
        self.measure, self.wanted, self.best = measure, wanted, Encounter()

    def over(self, tracks: slices.Tracks, during: str) -> Encounter:
        """Search the tracks from their begin to their end."""
        scaled = self.measure.space(tracks.position)
        positions = replace(tracks, position=np.ascontiguousarray(scaled))
        # Each drone of a pair, by rounding and by what it flies in a moment.
        rounding = GAMMA * float(max(scaled.max(initial=0.0), -scaled.min(initial=0.0)))
        self.best.error = 2.0 * (rounding + slices.MOMENT * positions.speed)
        self._start(positions.position[positions.first[:-1], 0], positions.begin)
        reach = _FURTHEST * max(self.best.upper, self.wanted)
        for low, high in slices.edges(tracks.begin, tracks.end, positions.speed, reach):
            self._slice(positions, low, high, _HALVINGS)
            if self._over:
                break
        best = self.best
        best.segment = during
        best.lower = max(best.upper - RESOLUTION - best.error, 0.0)
        return best

    def _start(self, place: FloatArray, time: float) -> None:
        """Take the closest pair of one instant: a start that makes pruning work.

        Neighbours along one axis may be far apart, and too many pairs as near as they.
        Where a lattice has more than the crowd, some are nearer than 0.8 of its edge:
        no more than 150 a drone are within reach else. The 100th is 2e-10 as wide.
        """

        def look(pairs: IntArray) -> None:
            gaps = self.measure(place[pairs[:, 0]] - place[pairs[:, 1]])
            self.best.take(pairs, time, gaps)

        look(slices.neighbours(place))
        reach = self.best.upper
        for cut in range(100):
            pairs = slices.near_pairs(place, reach * 0.8**cut, _CROWD * len(place))
            if pairs is not None:
                look(pairs)
                break

    def _slice(
        self, positions: slices.Tracks, low: float, high: float, halvings: int
    ) -> None:
        """Search a slice of time, in halves where drones stand in heaps."""
        piece = slices.take(positions, low, high, self.measure)
        most = _CROWD * positions.drones
        pairs = piece.near(self.measure, self.best.upper - RESOLUTION / 2, most)
        if pairs is not None:
            self._decide(positions, pairs, low, high)
            return
        if not halvings:
            # Drones without number are as near each other as any: nothing is proved.
            self.best.error = np.inf
        middle = 0.5 * (low + high)
        for begin, end in ((low, middle), (middle, high)):
            if not self._over:
                self._slice(positions, begin, end, halvings - 1)

    @property
    def _over(self) -> bool:
        """Whether nothing can come nearer, or nothing can be proved."""
        return self.best.upper <= RESOLUTION or not np.isfinite(self.best.error)

    def _decide(
        self, positions: slices.Tracks, pairs: IntArray, low: float, high: float
    ) -> None:
        """Enclose the distances of candidate pairs (n, 2) over a slice."""
        drones, begin = pairs.T, np.full(len(pairs), low)
        rows, last = positions.at(drones, begin), positions.first[drones + 1] - 1
        while begin.size:
            ends = np.where(rows < last, positions.ends[rows], np.inf)
            # Up to where the first of the two polynomials ends.
            stop = np.minimum(high, ends.min(axis=0))
            one, other = (positions.between(row, begin, stop) for row in rows)
            self._enclose(one - other, drones, begin, stop)
            more = stop < high
            rows, last = (rows + (ends <= stop))[:, more], last[:, more]
            drones, begin = drones[:, more], stop[more]

    def _enclose(
        self, work: FloatArray, drones: IntArray, begin: FloatArray, end: FloatArray
    ) -> None:
        """Enclose distances from differences, (n, degree + 1, axes), of pairs (2, n).

        These are their coefficients between times (n,) [s].
        """
        if not self.measure.largest:
            work = square_sum(work)[:, :, None]
        least_ = self.best.upper
        found = least(work, self._lower, self._value, RESOLUTION / 2, least_)
        row = found.row
        time = float(begin[row] + found.fraction * (end[row] - begin[row]))
        self.best.take(drones.T[[row]], time, np.array([found.upper]))
        if not np.isfinite(found.lower):
            # Rounding is coarser than what is wanted: nothing is proved.
            self.best.error = np.inf

    def _lower(self, work: FloatArray) -> FloatArray:
        """Lower bounds of the distances on the intervals, shape (n,)."""
        if not self.measure.largest:
            squares = work[:, :, 0]
            bound = squares.min(axis=1) - GAMMA * squares.max(axis=1)
            return np.asarray(np.sqrt(np.maximum(bound, 0.0)))
        away = np.maximum(work.min(axis=1), -work.max(axis=1))
        return np.asarray(np.maximum(away.max(axis=1), 0.0))

    def _value(self, work: FloatArray) -> FloatArray:
        """Distances from one column of ``work`` (n, components)."""
        if not self.measure.largest:
            return np.asarray(np.sqrt(np.maximum(work[:, 0], 0.0)))
        return np.asarray(np.abs(work).max(axis=1))
