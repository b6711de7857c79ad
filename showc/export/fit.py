"""Flights written again as cubics on the grid of a format, under a stated error.

Every drone's flight is cut into pieces, each a cubic that has the flight's position and
velocity at both ends (Hermite). Pieces are as long as a power of two allows: where two
of them are nearly one cubic, they become one. A long piece has a finer grid of
velocities, so what an aircraft does for long, say climb as steeply as it may, is
written as it is. The pieces of a drone are laid so that it passes the take-off height
at a joint: a firmware that looks for that instant finds it there without solving a
cubic. The odd rest of the time lies before the launch, where the drone stands.

What the fit costs in position, velocity and acceleration is bounded at every instant
from the difference of both polynomials, the rounding included.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from showc.errors import ExportError
from showc.export.error import NO_ERROR, FitError, error_of
from showc.export.grid import STANDING, Joints, on_grid
from showc.foreign.motion import (
    chosen,
    derivative,
    values,
)
from showc.processes import side_by_side
from showc.verify.kernel.slices import Tracks

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.export.solved import SolvedShow
    from showc.foreign.showmode import Followed


STEPS = (250, 125, 100, 50, 40, 20)
"""Lengths of the shortest piece that are tried, longest first [ms]: Skybrush's server,
which loses a millisecond of some durations, keeps these and their multiples up to
4 s."""

LONGEST = 4_000
"""Longest piece [ms]. The format holds 65,535, but Skybrush's server shortens some
durations by 1 ms (see ``STEPS``; the first multiple that it does not keep is 4,020)."""

TAKEOFF_HEIGHT = 2.5
"""SHOW_TAKEOFF_ALT: up to here the firmware climbs on its own [m]."""

TOLERANCE = 0.01
"""Greatest distance of the written flight from the solved one, unless asked [m]: a
thirtieth of what a flight controller itself is off."""

YAW_STEP = 1000
"""Length of a step of yaw [ms]: drones turn slowly beside how they move."""

_TRIALS = (
    (STEPS[0], (0.0, 0.1)),
    (STEPS[0], (0.0, 0.02)),
    (STEPS[1], (0.5, 0.1)),
    (STEPS[1], (0.25, 0.05)),
    (STEPS[1], (0.1, 0.02)),
    *((step, (0.0, 0.0)) for step in STEPS),
)
"""Pieces that are tried: the shortest [ms], and which share of the tolerance joining
two may cost, up to ``STEPS[0]`` and beyond."""

_BENT = 0.01
"""How much joining two pieces may change the mean acceleration of each [m/s²]."""

TOGETHER = 32
"""Drones that are fitted together: what they take stays near the processor."""


@dataclass(frozen=True, slots=True, eq=False)
class FittedFleet:
    """Cubics of a whole fleet, in whole steps of the format's grid.

    The pieces of a drone follow each other, from the start of the file on.
    """

    lead: int
    """How much later than in the solved show everything happens [ms]."""
    first: IntArray
    """First piece of each drone, and the number of pieces, shape (drones + 1,)."""
    starts: IntArray
    """When each piece begins, shape (pieces,) [ms]."""
    lengths: IntArray
    """How long it is, shape (pieces,) [ms]."""
    points: IntArray
    """Its control points in steps of the grid, shape (pieces, 4, 3)."""
    scale: IntArray
    """Step of the grid of each drone, shape (drones,) [mm]."""
    yaw: FloatArray
    """Yaw every ``YAW_STEP`` from the start of the file on, counter-clockwise from +x,
    shape (drones, n) [deg]."""
    error: FitError
    """What it costs."""

    @property
    def drones(self) -> int:
        """Size of the fleet."""
        return int(self.scale.size)

    def rows(self, drone: int) -> slice:
        """Pieces of one drone."""
        return slice(int(self.first[drone]), int(self.first[drone + 1]))

    @property
    def grid(self) -> FloatArray:
        """Step of the grid of each piece, shape (pieces,) [m]."""
        return np.asarray(np.repeat(self.scale / 1000.0, np.diff(self.first)))

    @property
    def duration(self) -> float:
        """When the last drone's last piece ends [s]."""
        return float((self.starts + self.lengths).max()) / 1000.0

    @property
    def shortest(self) -> int:
        """Length of the shortest piece in which a drone moves [ms]."""
        moving = np.any(self.points != self.points[:, :1], axis=(1, 2))
        return int(self.lengths[moving].min(initial=LONGEST))


def tracks_of(show: SolvedShow) -> Tracks:
    """Position and yaw of all drones, rows of one degree, in the show's own time."""
    degree = max(flight.degree for flight in show.flights)
    rows = [flight.elevated(degree).coefficients for flight in show.flights]
    counts = [flight.intervals for flight in show.flights]
    return Tracks(
        0.0,
        max(flight.end for flight in show.flights),
        np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        np.concatenate([flight.breaks[:-1] for flight in show.flights]),
        np.concatenate([flight.breaks[1:] for flight in show.flights]),
        np.concatenate(rows),
    )


def fit_fleet(
    show: SolvedShow,
    *,
    lead: float,
    tolerance: float = TOLERANCE,
    followed: Followed | None = None,
) -> FittedFleet:
    """Fit with the longest pieces that keep within ``tolerance`` [m].

    Parameters
    ----------
    show
        What was solved.
    lead
        How long the fleet stands before the show begins [s], whole milliseconds. With
        less than a piece, no joint is put at the take-off height.
    tolerance
        Greatest distance of the fit from the solved flight at any instant [m].
    followed
        Accelerations up to which rounding carries no flight that is within them; None:
        rounding is to the nearest step.

    Raises
    ------
    ExportError
        If no length of the pieces keeps within the tolerance, or the show is too wide.
    """
    exact = tracks_of(show)
    shift = round(1000.0 * (lead - show.early))
    fit = _Fit(shift, round(1000.0 * lead), tolerance, followed)
    return _together(
        side_by_side(
            [
                partial(fit.made, chosen(exact, slice(low, low + TOGETHER)), low)
                for low in range(0, exact.drones, TOGETHER)
            ]
        )
    )


@dataclass(frozen=True, slots=True)
class _Fit:
    """How some drones are fitted."""

    moved: int
    """How much later than the clock of the tracks everything happens [ms]."""
    lead: int
    """How much later than the clock of the show [ms]."""
    tolerance: float
    """[m]"""
    followed: Followed | None
    """Accelerations that rounding keeps."""

    def made(self, exact: Tracks, first: int) -> FittedFleet:
        """Fit drones, the first of which has this number, with the first that keeps."""
        for step, shares in _TRIALS:
            near, far = (share * self.tolerance for share in shares)
            fitted = self._cut(exact, step, (near, far))
            error = error_of(
                exact, decoded(fitted), self.moved / 1000.0, first=first, jobs=1
            )
            if error.position.upper <= self.tolerance:
                return replace(fitted, error=error)
            if exact.drones > 1:
                # Some of them need shorter pieces; the others do without.
                alone = [
                    self.made(chosen(exact, slice(drone, drone + 1)), first + drone)
                    for drone in range(exact.drones)
                ]
                return _together(alone)
        worst = error.position
        raise ExportError(
            f"drone {worst.drone + 1} at {worst.time:.2f} s: pieces of {STEPS[-1]} ms "
            f"on a grid of {fitted.scale.max()} mm miss the solved flight by "
            f"{1e3 * worst.upper:.3g} mm; wanted at most {1e3 * self.tolerance:g} mm: "
            "allow more (`tolerance`), or bring the show nearer to its origin"
        )

    def _cut(self, exact: Tracks, step: int, costs: tuple[float, float]) -> FittedFleet:
        """Fit with pieces of ``step`` [ms], joined where it costs at most ``costs``."""
        shift = self.moved
        crossing = crossings(exact)
        if shift < step:
            # The odd rest of the time lies before the launch; there is no room for it.
            crossing = np.full_like(crossing, np.inf)
        high = np.isfinite(crossing)
        at = np.rint(1000.0 * np.where(high, crossing, 0.0)).astype(np.int64)
        begin = shift - -at % step
        pieces = int(np.ceil((shift + 1000.0 * exact.end - begin.min()) / step))
        times = begin[:, None] + step * np.arange(pieces + 1)
        place, velocity = (
            part[..., :3] for part in states(exact, (times - shift) / 1000.0)
        )
        node = np.where(high, (shift + at - begin) // step, -1)
        drone, kept = np.nonzero(_joined(place, velocity, node, step, costs))
        counts = np.bincount(drone, minlength=exact.drones)
        joints = Joints(
            np.concatenate([[0], np.cumsum(counts)]),
            times[drone, kept],
            place[drone, kept],
            velocity[drone, kept],
            np.where(kept == node[drone], TAKEOFF_HEIGHT, np.nan),
        )
        scale, points = on_grid(joints, self.followed)
        return self._file(exact, joints, scale, points)

    def _file(
        self, exact: Tracks, joints: Joints, scale: IntArray, points: IntArray
    ) -> FittedFleet:
        """Put the time before the first joints in front."""
        moving = joints.pieces
        waits = [waiting(int(joints.times[row])) for row in joints.first[:-1]]
        before = np.array([len(one) for one in waits])
        ahead = np.concatenate([[0], np.cumsum(np.diff(joints.first) - 1)])
        # Where the pieces of each drone begin among all that move.
        at = np.repeat(ahead[:-1], before)
        lengths = np.insert(
            np.diff(joints.times)[moving], at, [one for some in waits for one in some]
        )
        points = np.insert(points, at, np.repeat(points[at, :1], 4, axis=1), axis=0)
        first = np.concatenate([[0], np.cumsum(before + np.diff(ahead))])
        end = np.cumsum(lengths)
        begin = np.concatenate([[0], end])[first[:-1]]
        starts = end - lengths - np.repeat(begin, np.diff(first))
        count = -(-int(self.moved + 1000.0 * exact.end) // YAW_STEP) + 1
        seconds = (YAW_STEP * np.arange(count) - self.moved) / 1000.0
        turned, _ = states(exact, np.broadcast_to(seconds, (exact.drones, count)))
        return FittedFleet(
            self.lead,
            first,
            starts,
            lengths,
            points,
            scale,
            np.degrees(turned[:, :, 3]),
            NO_ERROR,
        )


def _joined(
    place: FloatArray,
    velocity: FloatArray,
    node: IntArray,
    step: int,
    costs: tuple[float, float],
) -> BoolArray:
    """Which nodes stay joints when neighbouring pieces are joined.

    Two pieces of one length become one where the cubic between their outer ends passes
    near what they have in the middle. The difference is a cubic on either side of it,
    with the value d and the slope s there and none at the other end: at most
    |d| + 4/27 T |s|.

    Parameters
    ----------
    place
        Of all nodes, shape (drones, n + 1, 3) [m].
    velocity
        [m/s]
    node
        One of each drone that stays a joint; -1: none need, shape (drones,).
    step
        Between two nodes [ms].
    costs
        Greatest distances from what was joined, to pieces up to ``STEPS[0]`` and to
        longer ones [m].
    """
    pieces = place.shape[1] - 1
    joint = np.ones(place.shape[:2], dtype=bool)
    whole = np.ones((place.shape[0], pieces), dtype=bool)
    still = np.abs(velocity).max(axis=2) < STANDING
    width = 2
    while width * step <= LONGEST:
        count, half = pieces // width, width // 2
        low = slice(0, count * width, width)
        middle = slice(half, count * width, width)
        high = slice(width, count * width + 1, width)
        seconds = width * step / 1000.0
        way = place[:, high] - place[:, low]
        off = place[:, middle] - 0.5 * (place[:, low] + place[:, high])
        off -= seconds / 8.0 * (velocity[:, low] - velocity[:, high])
        turn = velocity[:, middle] - 1.5 * way / seconds
        turn += 0.25 * (velocity[:, low] + velocity[:, high])
        steep = np.linalg.norm(turn, axis=2)
        far = np.linalg.norm(off, axis=2) + 2.0 / 27.0 * seconds * steep
        whole = _side(whole, still[:, :: width // 2], count)
        long = width * step > STEPS[0]
        whole &= far <= costs[long]
        if long:
            whole &= steep <= 0.5 * _BENT * seconds
        whole &= half + width * np.arange(count) != node[:, None]
        joint[:, middle] &= ~whole
        width *= 2
    return joint


def _side(whole: BoolArray, still: BoolArray, count: int) -> BoolArray:
    """Which pairs of pieces may become one: both are there, and their neighbours.

    A drone that moves has velocities there that the shorter neighbour's grid holds;
    over a piece more than twice as long what is rounded off would carry it far.

    Parameters
    ----------
    whole
        Pieces of half the length that are there, shape (drones, n).
    still
        Whether the drone stands where they begin, and where the last one ends.
    count
        Number of pairs.
    """
    edge = np.ones((whole.shape[0], 1), dtype=bool)
    before = np.concatenate([edge, whole], axis=1)[:, 0 : 2 * count : 2]
    after = np.concatenate([whole, edge], axis=1)[:, 2 : 2 * count + 1 : 2]
    return np.asarray(
        whole[:, 0 : 2 * count : 2]
        & whole[:, 1 : 2 * count : 2]
        & (before | still[:, 0 : 2 * count : 2])
        & (after | still[:, 2 : 2 * count + 1 : 2])
    )


def _together(parts: Sequence[FittedFleet]) -> FittedFleet:
    """Put fleets together, one after the other."""
    counts = np.concatenate([np.diff(one.first) for one in parts])
    return FittedFleet(
        parts[0].lead,
        np.concatenate([[0], np.cumsum(counts)]),
        np.concatenate([one.starts for one in parts]),
        np.concatenate([one.lengths for one in parts]),
        np.concatenate([one.points for one in parts]),
        np.concatenate([one.scale for one in parts]),
        np.concatenate([one.yaw for one in parts]),
        FitError.worst([one.error for one in parts]),
    )


def crossings(exact: Tracks) -> FloatArray:
    """When each drone first is at the take-off height above its start [s]; inf: never.

    Shape (drones,).
    """
    height = exact.position[:, :, 2]
    target = height[exact.first[:-1], 0] + TAKEOFF_HEIGHT
    owner = np.repeat(np.arange(exact.drones), np.diff(exact.first))
    above = np.flatnonzero(height[:, -1] >= target[owner])
    result = np.full(exact.drones, np.inf)
    drones, index = np.unique(owner[above], return_index=True)
    row = above[index]
    low, high = np.zeros(row.size), np.ones(row.size)
    for _ in range(50):
        middle = 0.5 * (low + high)
        over = values(exact.position[row], middle)[:, 2] >= target[drones]
        low, high = np.where(over, low, middle), np.where(over, middle, high)
    width = exact.ends[row] - exact.starts[row]
    result[drones] = exact.starts[row] + high * width
    return result


def states(exact: Tracks, nodes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Values and slopes of all drones' tracks at their ``nodes`` (drones, n) [s].

    Both have the shape (drones, n, components); slopes are zero before and after.
    """
    slope = derivative(exact)
    place = np.empty((*nodes.shape, exact.position.shape[2]))
    velocity = np.empty_like(place)
    for drone in range(exact.drones):
        place[drone] = along(exact, drone, nodes[drone])
        velocity[drone] = along(slope, drone, nodes[drone])
    velocity[(nodes <= exact.begin) | (nodes >= exact.end)] = 0.0
    return place, velocity


def along(tracks: Tracks, drone: int, moments: FloatArray) -> FloatArray:
    """Values of a drone's track at ``moments`` (n,) [s], shape (n, components).

    Before the start and after the end they are those at the start and the end.
    """
    rows = slice(int(tracks.first[drone]), int(tracks.first[drone + 1]))
    start, end = tracks.starts[rows], tracks.ends[rows]
    row = np.clip(np.searchsorted(start, moments, side="right") - 1, 0, start.size - 1)
    share = np.clip((moments - start[row]) / (end[row] - start[row]), 0.0, 1.0)
    return values(tracks.position[rows][row], share)


def decoded(fitted: FittedFleet) -> Tracks:
    """Return the tracks that the control points stand for, in the file's time."""
    return Tracks(
        0.0,
        fitted.duration,
        fitted.first,
        fitted.starts / 1000.0,
        (fitted.starts + fitted.lengths) / 1000.0,
        fitted.points * fitted.grid[:, None, None],
    )


def waiting(begin: int) -> list[int]:
    """Cut a time [ms] into durations that the server keeps whole."""
    found = [LONGEST] * (begin // LONGEST)
    rest = begin % LONGEST
    if rest == 0:
        return found
    if kept_whole(rest):
        return [*found, rest]
    part = next(
        part
        for part in range(rest - 1, 0, -1)
        if kept_whole(part) and kept_whole(rest - part)
    )
    return [*found, part, rest - part]


def kept_whole(milliseconds: int) -> bool:
    """Whether Skybrush's server turns this duration, written in seconds, into itself.

    It takes the whole part of a thousand times the rounded seconds, in floating point.
    """
    return int(round(milliseconds / 1000.0, 3) * 1000.0) == milliseconds
