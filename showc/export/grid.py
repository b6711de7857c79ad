"""Joints of flights as whole steps of a format's grid.

Places are rounded to the grid. Of a velocity the grid holds multiples of three steps
over the length of the shorter piece beside the joint: both sides then have the same,
and velocity is continuous exactly. Rounding may ask for more acceleration than an
aircraft was flown with. Then neighbouring steps are searched that ask for no more (the
closest vector problem of lattices, in which only the joints of the pieces in question
move; Agrell et al. 2002, Closest point search in lattices, section II).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from showc.errors import ExportError
from showc.foreign.showmode import WINDOW

if TYPE_CHECKING:
    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.foreign.showmode import Followed


GREATEST = 32_767
"""Greatest control point in steps of the grid: 16 bits, signed."""

COARSEST = 127
"""Coarsest grid that the format knows [mm]."""

STANDING = 1e-6
"""An axis slower than this stands [m/s]: what rounding leaves of a hold."""

_ROUNDS = 12
"""How often all joints in question are looked at again: what one of them gains, its
neighbour has to keep."""

_FURTHEST = 1.5
"""Greatest rounding of a place or velocity [steps]: the nearest step is within a half,
and both of its neighbours are within this."""

_NEAREST = 1e-4
"""Weight of the square of a rounding in steps, beside the square of what is too much
acceleration in m/s²: of two choices that keep it, the nearer one."""

_TURNS = np.array(list(product((0, -1, 1), repeat=3)))
_MOVES = np.concatenate(
    [
        np.hstack([np.zeros_like(_TURNS), _TURNS]),
        *(
            np.kron([[place, turn]], np.eye(3, dtype=np.int64))
            for place, turn in product((-1, 1), (0, -1, 1))
        ),
    ]
)
"""Steps of place and velocity that are tried at a joint, shape (n, 6)."""

_JOINTS = 4_000
"""Joints that are searched together: their trials stay within 20 MB."""


@dataclass(frozen=True, slots=True, eq=False)
class Joints:
    """Where the pieces of some drones meet, and where they begin and end."""

    first: IntArray
    """First joint of each drone, and the number of joints, shape (drones + 1,)."""
    times: IntArray
    """When, shape (n,) [ms]."""
    place: FloatArray
    """Where, shape (n, 3) [m]."""
    velocity: FloatArray
    """Shape (n, 3) [m/s]."""
    height: FloatArray
    """How far above the first point of its drone a joint must be, or less than a step
    more, shape (n,) [m]; NaN: as it is."""

    @property
    def owner(self) -> IntArray:
        """Drone of each joint, shape (n,)."""
        return np.repeat(np.arange(self.first.size - 1), np.diff(self.first))

    @property
    def pieces(self) -> IntArray:
        """Joints at which a piece begins, shape (pieces,)."""
        ends = np.zeros(self.times.size, dtype=bool)
        ends[self.first[1:] - 1] = True
        return np.flatnonzero(~ends)


def on_grid(joints: Joints, followed: Followed | None) -> tuple[IntArray, IntArray]:
    """Round all joints.

    Parameters
    ----------
    joints
        Where the pieces meet; neighbouring lengths divide each other.
    followed
        Accelerations up to which rounding carries no flight that is within them; None:
        rounding is to the nearest step.

    Returns
    -------
    scale
        Finest grid of each drone, shape (drones,) [mm].
    points
        Control points of all pieces in steps of the grid, shape (pieces, 4, 3).

    Raises
    ------
    ExportError
        If a drone flies further than the coarsest grid reaches.
    """
    begin = joints.pieces
    lengths = np.diff(joints.times)[begin]
    scale = _scale(joints, begin, lengths)
    grid = (scale[joints.owner] / 1000.0)[:, None]
    shorter = np.full(joints.times.size, np.iinfo(np.int64).max)
    np.minimum.at(shorter, begin, lengths)
    np.minimum.at(shorter, begin + 1, lengths)
    steps = _Steps(
        joints,
        begin,
        lengths / 1000.0,
        grid,
        3000.0 * grid / shorter[:, None],
        np.rint(joints.place / grid).astype(np.int64),
        np.zeros(joints.place.shape, dtype=np.int64),
    )
    steps.slope[:] = np.rint(joints.velocity / steps.unit)
    set_high = np.flatnonzero(np.isfinite(joints.height))
    home = joints.first[joints.owner[set_high]]
    climb = np.ceil(joints.height[set_high] / grid[set_high, 0] - 1e-9)
    steps.whole[set_high, 2] = steps.whole[home, 2] + climb.astype(np.int64)
    if followed is not None:
        asked = accelerations(
            joints.place[begin + 1] - joints.place[begin],
            joints.velocity[begin],
            joints.velocity[begin + 1],
            lengths / 1000.0,
        )
        greatest = np.zeros((scale.size, 3))
        np.maximum.at(greatest, joints.owner[begin], asked)
        steps.search(followed.limits(greatest))
    handles = [
        steps.slope[rows] * (lengths // shorter[rows])[:, None]
        for rows in (begin, begin + 1)
    ]
    low, high = steps.whole[begin], steps.whole[begin + 1]
    points = np.stack([low, low + handles[0], high - handles[1], high], axis=1)
    return scale, points.astype(np.int32)


def _scale(joints: Joints, begin: IntArray, lengths: IntArray) -> IntArray:
    """Finest grid [mm] on which the control points of each drone fit 16 bits."""
    handle = lengths[:, None] / 3000.0
    reach = np.abs(joints.place).max(axis=1)
    after = np.abs(joints.place[begin] + handle * joints.velocity[begin])
    before = np.abs(joints.place[begin + 1] - handle * joints.velocity[begin + 1])
    reach[begin] = np.maximum(reach[begin], np.maximum(after, before).max(axis=1))
    widest = 1000.0 * np.maximum.reduceat(reach, joints.first[:-1])
    # As Skybrush's server works it out, that it stores what was fitted; with a step of
    # rounding for the place and one for the handle.
    needed = np.ceil((np.ceil(widest) + 1.0) / (GREATEST + 1.0))
    needed = np.ceil((np.ceil(widest + 2.0 * needed) + 1.0) / (GREATEST + 1.0))
    if needed.max() > COARSEST:
        raise ExportError(
            f"the show reaches {widest.max() / 1000.0:.0f} m from its origin; the "
            f"format holds {GREATEST * COARSEST / 1000.0:.0f} m"
        )
    return np.asarray(np.maximum(needed.astype(np.int64), 1))


def accelerations(
    way: FloatArray, first: FloatArray, last: FloatArray, seconds: FloatArray
) -> FloatArray:
    """Greatest mean accelerations of cubics over a window inside of them.

    Parameters
    ----------
    way
        From the begin of each piece to its end, shape (..., 3) [m].
    first
        Velocities at the begin, shape (..., 3) [m/s].
    last
        At the end.
    seconds
        Lengths, shape (...) [s]: of one shorter than the window it is the mean.

    Returns
    -------
    ndarray
        Sideways, up, down, shape (..., 3) [m/s²].
    """
    time = seconds[..., None]
    begin = (6.0 * way / time - 4.0 * first - 2.0 * last) / time
    end = (-6.0 * way / time + 2.0 * first + 4.0 * last) / time
    # The acceleration of a cubic changes evenly: its means are extreme at the ends.
    turn = 0.5 * np.minimum(WINDOW, time) / time * (end - begin)
    both = np.stack([begin + turn, end - turn])
    sideways = np.hypot(both[..., 0], both[..., 1])
    up = both[..., 2]
    return np.asarray(np.stack([sideways, up, -up], axis=-1).max(axis=0))


@dataclass(frozen=True, slots=True, eq=False)
class _Steps:
    """Joints in whole steps, and how they are moved to neighbouring ones."""

    joints: Joints
    begin: IntArray
    """Joints at which a piece begins, shape (pieces,)."""
    seconds: FloatArray
    """Lengths of the pieces, shape (pieces,) [s]."""
    grid: FloatArray
    """Step of a place, shape (n, 1) [m]."""
    unit: FloatArray
    """Step of a velocity, shape (n, 1) [m/s]."""
    whole: IntArray
    """Places in steps, shape (n, 3)."""
    slope: IntArray
    """Velocities in steps, shape (n, 3)."""

    def search(self, limits: FloatArray) -> None:
        """Move joints of pieces that ask for more than ``limits`` (drones, 3)."""
        every = limits[self.joints.owner[self.begin]]
        count = self.joints.times.size
        # Piece that begins at each joint; -1: none does.
        piece = np.full(count + 1, -1)
        piece[self.begin] = np.arange(self.begin.size)
        still = np.abs(self.joints.velocity) < STANDING
        still[np.isfinite(self.joints.height), 2] = True
        low, high = self.begin, self.begin + 1
        for turn in range(_ROUNDS):
            place, velocity = self.whole * self.grid, self.slope * self.unit
            asked = accelerations(
                place[high] - place[low], velocity[low], velocity[high], self.seconds
            )
            over = np.any(asked > every, axis=1)
            if not over.any():
                return
            ends = np.union1d(low[over], high[over])
            # No two that move together share a piece.
            some = ends[ends % 2 == turn % 2]
            for first in range(0, some.size, _JOINTS):
                self._move(some[first : first + _JOINTS], still, piece, every)

    def _move(
        self, some: IntArray, still: BoolArray, piece: IntArray, limits: FloatArray
    ) -> None:
        """Move ``some`` joints to where their pieces ask for least too much."""
        moves = _MOVES * np.tile(~still[some], 2)[:, None]
        grid, unit = self.grid[some, None], self.unit[some, None]
        place = (self.whole[some, None] + moves[..., :3]) * grid
        velocity = (self.slope[some, None] + moves[..., 3:]) * unit
        off = np.concatenate(
            [
                (place - self.joints.place[some, None]) / grid,
                (velocity - self.joints.velocity[some, None]) / unit,
            ],
            axis=2,
        )
        cost = _NEAREST * (off**2).sum(axis=2)
        cost[np.abs(off).max(axis=2) > _FURTHEST] = np.inf
        for sign, rows in ((-1, piece[some - 1]), (1, piece[some])):
            has = np.flatnonzero(rows >= 0)
            row, other = rows[has, None], some[has, None] + sign
            way = sign * (self.whole[other] * self.grid[other] - place[has])
            beyond = np.broadcast_to(self.slope[other] * self.unit[other], way.shape)
            first, last = (velocity[has], beyond)[::sign]
            asked = accelerations(way, first, last, self.seconds[row])
            over = np.maximum(asked - limits[row], 0.0)
            cost[has] += (over**2).sum(axis=2)
        # The first is to stay: it is taken where nothing is better.
        best = np.argmin(cost, axis=1)
        taken = moves[np.arange(some.size), best]
        self.whole[some] += taken[:, :3]
        self.slope[some] += taken[:, 3:]
