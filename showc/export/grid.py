"""Joints of flights as whole steps of a format's grid.

Places are rounded to the grid. Of a velocity the grid holds multiples of three steps
over the length of the shorter piece beside the joint: both sides then have the same,
and velocity is continuous exactly. Rounding may ask for more acceleration than an
aircraft was flown with. Then neighbouring steps are searched that ask for no more: of
all choices of the nearest step or one beside it, the one that asks least too much.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from showc.errors import ExportError
from showc.foreign.showmode import WINDOW

if TYPE_CHECKING:
    from showc.arrays import FloatArray, IntArray
    from showc.foreign.showmode import Followed


GREATEST = 32_767
"""Greatest control point in steps of the grid: 16 bits, signed."""

COARSEST = 127
"""Coarsest grid that the format knows [mm]."""

STANDING = 1e-6
"""An axis slower than this stands [m/s]: what rounding leaves of a hold."""

_NEAREST = 1e-4
"""Weight of the square of a rounding in steps, beside the square of what is too much
acceleration in m/s²: of two choices that keep it, the nearer one."""

_STEP = (0, -1, 1)
"""Units of the grid by which a number is changed, the least change first."""
_LEVEL = np.array(
    [(0, 0, 0, x, y, 0) for x, y in product(_STEP, repeat=2)]
    + [(1, 0, 0, 0, 0, 0), (-1, 0, 0, 0, 0, 0), (0, 1, 0, 0, 0, 0), (0, -1, 0, 0, 0, 0)]
)
"""Steps of place and velocity that are tried at a joint for sideways, shape (n, 6)."""

_UPRIGHT = np.array([(0, 0, z, 0, 0, turn) for z, turn in product(_STEP, repeat=2)])
"""Steps that are tried for up and down, shape (n, 6)."""


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
        """Move joints where pieces ask for more than ``limits`` (drones, 3)."""
        joints = self.joints
        every = limits[joints.owner[self.begin]]
        still = np.abs(joints.velocity) < STANDING
        free = np.tile(~still, 2)
        free[np.isfinite(joints.height), 2] = False
        # Stretches between joints that stay do not touch each other.
        ends = np.union1d(joints.first[:-1], joints.first[1:] - 1)
        anchors = np.union1d(np.flatnonzero(still.all(axis=1)), ends)
        piece = np.zeros(joints.times.size, dtype=np.int64)
        piece[self.begin] = np.arange(self.begin.size)
        for moves, kinds in ((_LEVEL, [0]), (_UPRIGHT, [1, 2])):
            over = np.any(self._asked()[:, kinds] > every[:, kinds], axis=1)
            found = np.searchsorted(anchors, self.begin[over], side="right") - 1
            for index in np.unique(found).tolist():
                chain = slice(int(anchors[index]), int(anchors[index + 1]) + 1)
                rows = slice(int(piece[chain.start]), int(piece[chain.stop - 2]) + 1)
                allowed = moves * free[chain, None]
                self._walk(chain, rows, allowed, every[rows][:, kinds], kinds)

    def _asked(self) -> FloatArray:
        """Accelerations of all pieces as they are, shape (pieces, 3) [m/s²]."""
        place, velocity = self.whole * self.grid, self.slope * self.unit
        low, high = self.begin, self.begin + 1
        return accelerations(
            place[high] - place[low], velocity[low], velocity[high], self.seconds
        )

    def _walk(
        self,
        chain: slice,
        rows: slice,
        moves: IntArray,
        limits: FloatArray,
        kinds: list[int],
    ) -> None:
        """Move the joints of a chain by those steps of which the whole costs least.

        What a joint's moves cost depends on its neighbours alone, so the best way from
        one end to the other is found joint by joint (Viterbi 1967).

        Parameters
        ----------
        chain
            Joints.
        rows
            Pieces between them.
        moves
            What is tried at each joint, shape (joints, n, 6).
        limits
            What each piece may ask, shape (pieces, kinds) [m/s²].
        kinds
            Which of sideways, up and down.
        """
        place = (self.whole[chain, None] + moves[..., :3]) * self.grid[chain, None]
        velocity = (self.slope[chain, None] + moves[..., 3:]) * self.unit[chain, None]
        off = (place - self.joints.place[chain, None]) / self.grid[chain, None]
        turned = velocity - self.joints.velocity[chain, None]
        turned = turned / self.unit[chain, None]
        own = _NEAREST * (off**2 + turned**2).sum(axis=2)
        way = place[1:, None] - place[:-1, :, None]
        asked = accelerations(
            way,
            np.broadcast_to(velocity[:-1, :, None], way.shape),
            np.broadcast_to(velocity[1:, None], way.shape),
            self.seconds[rows, None, None],
        )
        over = np.maximum(asked[..., kinds] - limits[:, None, None], 0.0)
        between = (over**2).sum(axis=3) + own[1:, None]
        best, behind = own[0], []
        for cost in between:
            total = best[:, None] + cost
            behind.append(np.argmin(total, axis=0))
            best = total.min(axis=0)
        at = int(np.argmin(best))
        taken = [at]
        for back in reversed(behind):
            at = int(back[at])
            taken.append(at)
        moved = moves[np.arange(moves.shape[0]), taken[::-1]]
        self.whole[chain] += moved[:, :3]
        self.slope[chain] += moved[:, 3:]
