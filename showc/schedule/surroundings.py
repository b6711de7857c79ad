"""Where all drones are while a leg is looked at, and how they move in a stage."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil
from typing import TYPE_CHECKING

import numpy as np

from showc.autopilot.following import SETTLING, time_followed
from showc.autopilot.s_curve import LegProfile
from showc.autopilot.timing import CLOCK_LAG
from showc.geodesy import POSITION_RESOLUTION
from showc.schedule.distances import segment_distance
from showc.schedule.releases import STEP
from showc.schedule.separation import TOLERANCE, Motion, closest_encounter

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.autopilot.stage import Stage
    from showc.autopilot.timing import Timing
    from showc.flight import Encounter
    from showc.script.show import Site
    from showc.vehicle import Separation


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """Where all drones are while one leg is looked at, and what must hold."""

    positions: FloatArray
    """Where everyone is before the leg, shape (drones, 3), on the grid [m]."""
    separation: Separation
    """What every pair keeps."""
    site: Site
    """Whose volume and fence they keep."""
    timing: Timing
    """How surely legs are flown on time."""
    pause: float = 0.0
    """Least time between the latest end of a stage and the next release [s]."""
    others: tuple[tuple[float, Stage], ...] = ()
    """Stages that other drones fly meanwhile, with their releases since that of the
    leg's first stage [s]."""

    def following(self, release: float, stage: Stage) -> float:
        """Return the release after ``stage``, a multiple of 0.1 s; both [s]."""
        late = stage.finish(self.timing.late(stage.profile.speed))
        return tick(release + late + CLOCK_LAG + self.pause)

    def closest(self, stages: Sequence[Stage]) -> Iterator[Encounter | None]:
        """Yield the nearest encounter of each stage, one after the other.

        Times count from its release [s]. The last one that is too near ends the search
        early, as :func:`closest_encounter` says.
        """
        if not self.others:
            positions = self.positions
            for stage in stages:
                motion = stage_motion(stage, positions, self.timing)
                yield closest_encounter(motion, self.separation, enough=self.required)
                positions = positions.copy()
                positions[stage.drones] = stage.end
            return
        release, flown = 0.0, list(self.others)
        for stage in stages:
            flown.append((release, stage))
            found = self.nearest(flown, release)
            yield None if found is None else replace(found, time=found.time - release)
            release = self.following(release, stage)

    def nearest(
        self,
        flown: Sequence[tuple[float, Stage]],
        begin: float,
        end: float = np.inf,
    ) -> Encounter | None:
        """Nearest encounter while stages are ``flown`` at their releases.

        From the release ``begin`` on until ``end``, as late as may be [s].
        """
        best = None
        for motion in fleet_motions(flown, self.positions, self.timing, (begin, end)):
            found = closest_encounter(motion, self.separation, enough=self.required)
            if found is not None and (best is None or found.distance < best.distance):
                best = found
            if best is not None and best.distance < self.required:
                break
        return best

    @property
    def required(self) -> float:
        """Least distance that a proof must show [m].

        Places that are as near as the separation allows can be nearer by the
        resolution of the mission's numbers; a proof may fall short of the truth by its
        tolerance.
        """
        return self.separation.distance - POSITION_RESOLUTION - TOLERANCE


def tick(time: float) -> float:
    """Return the first slot that is not before a time [s]."""
    return round(ceil(time / STEP - 1e-6) * STEP, 6)


def stage_motion(
    stage: Stage, positions: FloatArray, timing: Timing, start: float = 0.0
) -> Motion:
    """Return the motion of the whole fleet while ``stage`` is flown.

    ``positions`` (drones, 3) is where everyone is before it, ``start`` the time of its
    release [s]. Drones that it leaves out rest.
    """
    count = positions.shape[0]
    begin, end = positions.copy(), positions.copy()
    begin[stage.drones], end[stage.drones] = stage.begin, stage.end
    rank = np.full(count, len(stage.profile), dtype=np.int64)
    rank[stage.drones] = np.arange(stage.drones.size)
    spread = timing.spread(stage.profile.speed)
    # At no time in particular, there is no last instant.
    last = stage.finish(spread) if np.isfinite(spread).all() else np.inf
    beyond = stage.overshoot if timing.overshoots else np.zeros(stage.drones.size)
    return Motion(
        begin,
        end,
        with_rest(stage.profile).select(rank),
        start + np.append(stage.wait, 0.0)[rank],
        np.append(stage.level, 0.0)[rank],
        np.append(spread, timing.spread(np.zeros(1)))[rank],
        np.append(beyond, 0.0)[rank],
        (start - float(spread.max(initial=0.0)), start + last),
    )


def fleet_motions(
    flown: Sequence[tuple[float, Stage]],
    places: FloatArray,
    timing: Timing,
    window: tuple[float, float],
) -> Iterator[Motion]:
    """Yield the motion of the fleet, cut so that each drone flies one leg in each.

    Parameters
    ----------
    flown
        Stages, each drone's in order, and their releases [s].
    places
        Where everyone is before the first of them, shape (drones, 3) [m].
    timing
        How surely they are flown on time.
    window
        The release from which on, and the time until which, motions are wanted [s].
    """
    spreads = [timing.spread(stage.profile.speed) for _, stage in flown]
    begins = [
        release - float(spread.max(initial=0.0))
        for (release, _), spread in zip(flown, spreads, strict=True)
    ]
    resting = float(timing.spread(np.zeros(1))[0])
    none = np.zeros(len(places))
    still = LegProfile(*([none] * len(LegProfile.__dataclass_fields__)))
    now = Motion(places, places, still, none, none, none + resting, none, (0.0, 0.0))
    over = np.full(len(places), -np.inf)
    order = sorted(range(len(flown)), key=lambda number: begins[number])
    first = min(
        (
            begin
            for begin, one in zip(begins, flown, strict=True)
            if one[0] >= window[0]
        ),
        default=window[0],
    )
    for turn, number in enumerate(order):
        (release, stage), spread = flown[number], spreads[number]
        last = stage_motion(stage, now.end, timing, release)
        now = _joined(now, last, stage.drones)
        late = time_followed(stage.level, stage.profile.duration + spread)
        over[stage.drones] = release + stage.wait + late + SETTLING
        until = begins[order[turn + 1]] if turn + 1 < len(order) else np.inf
        low = max(begins[number], first)
        high = min(until, window[1], float(over.max()))
        if high > low:
            yield replace(now, window=(low, high))


def _joined(now: Motion, last: Motion, drones: IntArray) -> Motion:
    """Return what everyone does ``now``, but ``drones`` what they do ``last``."""
    new = np.zeros(now.start.size, dtype=np.bool_)
    new[drones] = True
    names = ("start", "level", "spread", "overshoot")
    rows = {
        name: np.where(new, getattr(last, name), getattr(now, name)) for name in names
    }
    for name in ("begin", "end"):
        rows[name] = np.where(new[:, None], getattr(last, name), getattr(now, name))
    profile = LegProfile(
        *(
            np.where(new, getattr(last.profile, name), getattr(now.profile, name))
            for name in LegProfile.__dataclass_fields__
        )
    )
    return replace(now, profile=profile, **rows)


def with_rest(profile: LegProfile) -> LegProfile:
    """Return the legs of ``profile`` and behind them one of length 0."""
    return LegProfile(
        *(
            np.append(getattr(profile, name), 0.0)
            for name in profile.__dataclass_fields__
        )
    )


TOUCHES = 1e-9
"""Lines that are so near an edge touch it [m]."""


def leaves(stage: Stage, site: Site) -> BoolArray:
    """Return which drones of a stage leave the volume, or the fence, shape (n,).

    Lines keep the margin that the site asks for, to the resolution of missions; what
    is flown beyond their ends may use it up.
    """
    begin, end, far = stage.begin, stage.end, stage.farthest
    low, high = (np.array(corner) - POSITION_RESOLUTION for corner in site.room)
    high = high + 2.0 * POSITION_RESOLUTION
    inside = np.all((end >= low) & (end <= high), axis=1)
    least, most = np.array(site.volume_min), np.array(site.volume_max)
    inside &= np.all(far >= least - POSITION_RESOLUTION, axis=1)
    inside &= np.all(far <= most + POSITION_RESOLUTION, axis=1)
    if site.fence is not None:
        corners = np.asarray(site.fence, dtype=np.float64)
        lines = _edge_distance(begin, end, corners) - site.fence_margin
        spare = np.minimum(lines, _edge_distance(end, far, corners))
        inside &= (spare >= -POSITION_RESOLUTION) & _within(begin, corners)
    return np.asarray(~inside)


def _edge_distance(
    one: FloatArray, other: FloatArray, corners: FloatArray
) -> FloatArray:
    """Least level distance (n,) [m] of lines between places (n, 3) from a fence."""
    p, u = _flat(one), _flat(other) - _flat(one)
    least = np.full(len(p), np.inf)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        q = np.broadcast_to(np.append(a, 0.0), p.shape)
        v = np.broadcast_to(np.append(b - a, 0.0), p.shape)
        # A drone that goes straight up is a point from above.
        least = np.minimum(least, segment_distance(p, u, q, v))
    # What touches an edge may be on its other side, however near.
    return np.where(least > TOUCHES, least, -np.inf)


def _flat(places: FloatArray) -> FloatArray:
    flat = places.copy()
    flat[:, 2] = 0.0
    return flat


def _within(places: FloatArray, corners: FloatArray) -> BoolArray:
    """Whether places (n, 3) are inside: a ray from them crosses edges oddly often."""
    x, y = places[:, 0], places[:, 1]
    inside = np.zeros(len(places), dtype=np.bool_)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        crosses = (a[1] > y) != (b[1] > y)
        rise = b[1] - a[1] if b[1] != a[1] else 1.0
        inside ^= crosses & (x < a[0] + (y - a[1]) * (b[0] - a[0]) / rise)
    return inside
