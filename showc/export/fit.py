"""Flights written again as cubics on the grid of a format, under a stated error.

Every drone's flight is cut into pieces of one length, each a cubic that has the
flight's position and velocity at both ends (Hermite). Control points are whole steps
of the format's grid: position and handle at a node are rounded once and serve the
pieces on both sides, which are equally long, so that velocity is continuous exactly.
The pieces of a drone are laid so that it passes the take-off height at a node: a
firmware that looks for that instant finds it there without solving a cubic. The odd
rest of the time lies before the launch, where the drone stands.

What the fit costs in position, velocity and acceleration is bounded at every instant
from the difference of both polynomials, the rounding included.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from showc.errors import ExportError
from showc.foreign.motion import (
    Greatest,
    derivative,
    difference,
    greatest,
    length,
    portions,
    standing,
)
from showc.processes import side_by_side
from showc.verify.kernel.bernstein import values
from showc.verify.kernel.slices import Tracks

if TYPE_CHECKING:
    from showc.arrays import FloatArray, IntArray
    from showc.export.solved import SolvedShow


STEPS = (250, 125, 100, 50, 40, 20)
"""Lengths of a piece that are tried, longest first [ms]: Skybrush's server, which loses
a millisecond of some durations, keeps these and their multiples up to 4 s."""

GREATEST = 32_767
"""Greatest control point in steps of the grid: 16 bits, signed."""

COARSEST = 127
"""Coarsest grid that the format knows [mm]."""

TAKEOFF_HEIGHT = 2.5
"""SHOW_TAKEOFF_ALT: up to here the firmware climbs on its own [m]."""

TOLERANCE = 0.01
"""Greatest distance of the written flight from the solved one, unless asked [m]: a
thirtieth of what a flight controller itself is off."""

_POSITION_RESOLUTION, _VELOCITY_RESOLUTION, _ACCELERATION_RESOLUTION = 1e-4, 1e-3, 1e-2
"""Widths of the enclosures of the three errors [m, m/s, m/s²]."""


@dataclass(frozen=True, slots=True)
class FitError:
    """How far the written flight is from the solved one, at most, at any instant."""

    position: Greatest
    """[m]"""
    velocity: Greatest
    """[m/s]"""
    acceleration: Greatest
    """[m/s²]: large where the solved one jumps, for a cubic cannot."""


@dataclass(frozen=True, slots=True, eq=False)
class FittedFleet:
    """Cubics of a whole fleet, in whole steps of the format's grid."""

    lead: int
    """How much later than in the solved show everything happens [ms]."""
    step: int
    """Length of every piece [ms]."""
    begin: IntArray
    """When the first piece of each drone begins; before it the drone stands at the
    first point, shape (drones,) [ms]."""
    scale: IntArray
    """Step of the grid of each drone, shape (drones,) [mm]."""
    points: IntArray
    """Control points in steps of the grid, shape (drones, pieces, 4, 3)."""
    yaw: FloatArray
    """Yaw at the nodes, counter-clockwise from +x, shape (drones, pieces + 1) [deg]."""
    error: FitError
    """What it costs."""

    @property
    def drones(self) -> int:
        """Size of the fleet."""
        return int(self.begin.size)

    @property
    def pieces(self) -> int:
        """Pieces of each drone."""
        return int(self.points.shape[1])

    @property
    def times(self) -> IntArray:
        """When each drone is at its nodes, shape (drones, pieces + 1) [ms]."""
        return self.begin[:, None] + self.step * np.arange(self.pieces + 1)

    def times_of(self, drone: int) -> IntArray:
        """When one drone is at its nodes, shape (pieces + 1,) [ms]."""
        return np.asarray(self.begin[drone] + self.step * np.arange(self.pieces + 1))

    @property
    def duration(self) -> float:
        """When the last drone's last piece ends [s]."""
        return float(self.begin.max() + self.step * self.pieces) / 1000.0


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
    show: SolvedShow, *, lead: float, tolerance: float = TOLERANCE
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

    Raises
    ------
    ExportError
        If no length of the pieces keeps within it, or the show is too wide.
    """
    exact = tracks_of(show)
    fitted = None
    for step in STEPS:
        fitted = _fit(exact, round(1000.0 * (lead - show.early)), step)
        fitted = replace(fitted, lead=round(1000.0 * lead))
        if fitted.error.position.upper <= tolerance:
            return fitted
    assert fitted is not None  # noqa: S101 - there are steps
    worst = fitted.error.position
    raise ExportError(
        f"drone {worst.drone + 1} at {worst.time:.2f} s: pieces of {STEPS[-1]} ms on a "
        f"grid of {fitted.scale.max()} mm miss the solved flight by "
        f"{worst.upper:.3f} m; wanted at most {tolerance:g} m: ask for less with "
        "--tolerance, or bring the show nearer to its origin"
    )


def _fit(exact: Tracks, lead: int, step: int) -> FittedFleet:
    crossing = crossings(exact)
    if lead < step:
        # The odd rest of the time lies before the launch, and there is no room for it.
        crossing = np.full_like(crossing, np.inf)
    at_crossing = np.rint(1000.0 * np.where(np.isfinite(crossing), crossing, 0.0))
    begin = lead - -at_crossing.astype(np.int64) % step
    pieces = int(np.ceil((lead + 1000.0 * exact.end - begin.min()) / step))
    nodes = (begin[:, None] + step * np.arange(pieces + 1) - lead) / 1000.0
    place, velocity = states(exact, nodes)
    scale = _scale(place[:, :, :3], velocity[:, :, :3] * (step / 3000.0))
    grid = scale[:, None, None] / 1000.0
    # A long show of many drones is millions of numbers: as small as they fit.
    whole = np.rint(place[:, :, :3] / grid).astype(np.int32)
    handle = np.rint(velocity[:, :, :3] * (step / 3000.0) / grid).astype(np.int32)
    # Exactly at the take-off height above the first point, or the next step above.
    rows = np.flatnonzero(np.isfinite(crossing))
    node = np.rint((lead + at_crossing - begin) / step).astype(np.int64)[rows]
    climb = -(-round(1000.0 * TAKEOFF_HEIGHT) // scale[rows])
    whole[rows, node, 2] = whole[rows, 0, 2] + climb
    points = np.stack(
        [
            whole[:, :-1],
            whole[:, :-1] + handle[:, :-1],
            whole[:, 1:] - handle[:, 1:],
            whole[:, 1:],
        ],
        axis=2,
    )
    if points.size and int(np.abs(points).max()) > GREATEST:
        raise ExportError(
            f"the show reaches {np.abs(place[:, :, :3]).max():.0f} m from its origin; "
            f"the format holds {GREATEST * COARSEST / 1000.0:.0f} m"
        )
    fitted = FittedFleet(
        lead,
        step,
        begin,
        scale,
        points,
        np.degrees(place[:, :, 3]),
        _NOTHING,
    )
    error = error_of(exact, decoded(fitted), lead / 1000.0)
    return replace(fitted, error=error)


_NOTHING = FitError(*(Greatest(0.0, 0.0, 0, 0.0) for _ in range(3)))


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
    # Before the start and after the end a drone stands.
    inside = np.clip(nodes, exact.begin, exact.end)
    for drone in range(exact.drones):
        rows = slice(int(exact.first[drone]), int(exact.first[drone + 1]))
        start, end = exact.starts[rows], exact.ends[rows]
        row = np.searchsorted(start, inside[drone], side="right") - 1
        row = np.clip(row, 0, start.size - 1)
        share = (inside[drone] - start[row]) / (end[row] - start[row])
        share = np.clip(share, 0.0, 1.0)
        place[drone] = values(exact.position[rows][row], share)
        velocity[drone] = values(slope.position[rows][row], share)
    velocity[(nodes <= exact.begin) | (nodes >= exact.end)] = 0.0
    return place, velocity


def _scale(place: FloatArray, handle: FloatArray) -> IntArray:
    """Finest grid [mm] on which the control points of each drone fit 16 bits."""
    reach = (np.abs(place) + np.abs(handle)).max(axis=(1, 2))
    # As Skybrush's server works it out, that it stores what was fitted.
    needed = np.ceil((np.ceil(1000.0 * reach) + 1.0) / (GREATEST + 1.0))
    return np.asarray(np.clip(needed.astype(np.int64), 1, COARSEST))


def decoded(fitted: FittedFleet) -> Tracks:
    """Return the tracks that the control points stand for, in the file's time."""
    drones, pieces = fitted.drones, fitted.pieces
    times = fitted.times / 1000.0
    # Written into its place: a copy of a long show would be hundreds of megabytes.
    body = np.empty((drones, pieces + 1, 4, 3))
    np.multiply(
        fitted.points, fitted.scale[:, None, None, None] / 1000.0, out=body[:, 1:]
    )
    body[:, 0] = body[:, 1, :1]
    return Tracks(
        0.0,
        fitted.duration,
        np.arange(drones + 1) * (pieces + 1),
        np.concatenate([np.zeros((drones, 1)), times[:, :-1]], axis=1).ravel(),
        times.ravel(),
        body.reshape(-1, 4, 3),
    )


def error_of(exact: Tracks, written: Tracks, lead: float) -> FitError:
    """Bound the difference of two fleets at every instant, some drones at a time.

    Parameters
    ----------
    exact
        What was solved, in the show's own time.
    written
        What the file says, in its time.
    lead
        How much later everything happens in the file [s].
    """
    end = max(written.end, exact.end + lead)

    def bounded(first: int, part: Tracks, solved: Tracks) -> list[Greatest]:
        moved = Tracks(
            0.0,
            end,
            solved.first,
            solved.starts + lead,
            solved.ends + lead,
            solved.position[:, :, :3],
        )
        apart = difference(standing(moved, 0.0, end), standing(part, 0.0, end))
        found = []
        for resolution in (
            _POSITION_RESOLUTION,
            _VELOCITY_RESOLUTION,
            _ACCELERATION_RESOLUTION,
        ):
            one = greatest(apart, length((0, 1, 2)), resolution)
            found.append(Greatest(one.upper, one.lower, one.drone + first, one.time))
            apart = derivative(apart)
        return found

    every = side_by_side(
        [
            partial(bounded, first, part, solved)
            for (first, part), solved in zip(
                portions(written), _alike(exact, written), strict=True
            )
        ]
    )
    return FitError(
        *(max(kind, key=lambda one: one.upper) for kind in zip(*every, strict=True))
    )


def _alike(exact: Tracks, written: Tracks) -> list[Tracks]:
    """Cut ``exact`` into the drones of the portions of ``written``."""
    parts = []
    for first, part in portions(written):
        rows = slice(int(exact.first[first]), int(exact.first[first + part.drones]))
        parts.append(
            Tracks(
                exact.begin,
                exact.end,
                exact.first[first : first + part.drones + 1] - exact.first[first],
                exact.starts[rows],
                exact.ends[rows],
                exact.position[rows],
            )
        )
    return parts
