"""How one leg of the show becomes stages that an autopilot flies apart.

The straight line in the shortest common time comes first. Where the predicted flights
come too near, the encoding changes: more time (delays then cost less distance), drones
that leave one after the other, a bend along the solved flight, layers of height. The
first that is proved is taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from showc.errors import ExportError
from showc.mission.conflicts import conflict_colours
from showc.mission.geodesy import POSITION_RESOLUTION
from showc.mission.law import LegProfile
from showc.mission.separation import (
    TOLERANCE,
    Closest,
    Motion,
    closest_encounter,
)
from showc.mission.stagger import staggered
from showc.mission.timing import Timing

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from showc.flight import LegFlight
    from showc.mission.stage import Stage, StageBuilder
    from showc.plan.itinerary import Leg
    from showc.vehicle import Separation

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]

STRETCHES = (1.0, 1.25, 1.6, 2.0, 2.5, 3.2, 4.0, 5.0, 6.5, 8.0)
"""Factors on the time of a straight leg."""

BENDS = (1.0, 1.15, 1.3, 1.6, 2.0)
"""Factors on the sideways part of the solved flight's bend."""

BEND_STRETCHES = (1.0, 1.6, 2.5, 4.0)
"""Factors on the times of the legs of a bend."""

STOP = 4.0
"""About what a further stage costs besides its flying: slack and a whole second [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class Encoding:
    """The stages of one leg, proved apart."""

    name: str
    """What was done, in words."""
    stages: tuple[Stage, ...]
    """In order; none when nobody moves."""
    closest: tuple[Closest | None, ...]
    """Nearest encounter of each stage, times since its release [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """Where all drones are while one leg is looked at, and what must hold."""

    positions: FloatArray
    """Where everyone is before the leg, shape (drones, 3), on the grid [m]."""
    separation: Separation
    """What every pair keeps."""
    timing: Timing
    """How late legs are."""

    @property
    def required(self) -> float:
        """Least distance that a proof must show [m].

        Places that are as near as the separation allows can be nearer by the
        resolution of the mission's numbers; a proof may fall short of the truth by its
        tolerance.
        """
        return self.separation.distance - POSITION_RESOLUTION - TOLERANCE


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
    return Motion(
        begin,
        end,
        with_rest(stage.profile).select(rank),
        start + np.append(stage.wait, 0.0)[rank],
        np.full(count, timing.low),
        np.full(count, timing.high),
        (start + timing.low, start + stage.duration + timing.high),
    )


def with_rest(profile: LegProfile) -> LegProfile:
    """Return the legs of ``profile`` and behind them one of length 0."""
    return LegProfile(
        *(
            np.append(getattr(profile, name), 0.0)
            for name in profile.__dataclass_fields__
        )
    )


def choose_encoding(
    leg: Leg, flight: LegFlight, builder: StageBuilder, around: Surroundings
) -> Encoding:
    """Return the first encoding of ``leg`` whose predicted flights keep apart.

    Raises
    ------
    ExportError
        If none does; names the pair, the time and the distance of the best one.
    """
    best: Closest | None = None
    for name, stages in _candidates(leg, flight, builder, around):
        closest, positions = [], around.positions
        for stage in stages:
            found = closest_encounter(
                stage_motion(stage, positions, around.timing),
                around.separation,
                enough=around.required,
            )
            closest.append(found)
            if found is not None and found.distance < around.required:
                if best is None or found.distance > best.distance:
                    best = found
                break
            positions = positions.copy()
            positions[stage.drones] = stage.end
        else:
            return Encoding(name, tuple(stages), tuple(closest))
    raise _refusal(leg, best, around)


def _candidates(
    leg: Leg, flight: LegFlight, builder: StageBuilder, around: Surroundings
) -> Iterator[tuple[str, list[Stage]]]:
    """All encodings, simplest first."""
    drones = leg.drones
    start, goal = around.positions[drones], leg.goal

    def straight(duration: float) -> Stage:
        return builder.build(drones, start, goal, leg.limits, duration=duration)

    first = straight(flight.duration)
    yield "straight", [first]
    if first.drones.size == 0:
        return
    yield from _slower(first, straight, around)
    found = [
        *_bends(leg, flight, builder, around),
        *_layers(leg, builder, around, first),
    ]
    # Quickest first, every stop paid for; equal ones in the order of their making.
    yield from sorted(
        found, key=lambda item: sum(stage.duration + STOP for stage in item[1])
    )
    for name, stages in _bends(leg, flight, builder, around, stretches=(1.0,)):
        yield f"{name}, staggered", [_staggered_stage(one, around) for one in stages]


def _slower(
    first: Stage, straight: Callable[[float], Stage], around: Surroundings
) -> Iterator[tuple[str, list[Stage]]]:
    """Straight lines with more time, or one after the other, quickest first."""
    found: list[tuple[float, str, float | FloatArray]] = []
    exact = closest_encounter(
        stage_motion(first, around.positions, Timing(around.timing.delay, 0.0)),
        around.separation,
        enough=around.required,
    )
    # Time scales a flight without changing its shape: it helps only against delays.
    if exact is None or exact.distance >= around.required:
        found = [
            (first.duration * stretch, f"straight, time x {stretch:g}", stretch)
            for stretch in STRETCHES[1:]
        ]
    waits = _waits(first, around)
    if waits is not None:
        longest = float(waits.max())
        name = f"straight, staggered by up to {longest:g} s"
        found.append((first.duration + longest, name, waits))
    for duration, name, how in sorted(found, key=lambda item: item[0]):
        if isinstance(how, float):
            yield name, [straight(duration)]
        else:
            yield name, [first.waiting(how)]


def _waits(stage: Stage, around: Surroundings) -> FloatArray | None:
    """How long each drone of a stage may wait so that all keep apart."""
    # The proof of the whole stage falls short of the pairs' by its tolerance.
    apart = around.required + TOLERANCE
    return staggered(stage, around.separation, around.timing, apart)


def _staggered_stage(stage: Stage, around: Surroundings) -> Stage:
    waits = _waits(stage, around)
    return stage if waits is None else stage.waiting(waits)


def _bends(
    leg: Leg,
    flight: LegFlight,
    builder: StageBuilder,
    around: Surroundings,
    *,
    stretches: tuple[float, ...] = BEND_STRETCHES,
) -> Iterator[tuple[str, list[Stage]]]:
    """Two or three straight legs along the solved flight, or outside it."""
    start, goal = around.positions[leg.drones], leg.goal
    low, high = np.array(leg.limits.position_min), np.array(leg.limits.position_max)
    for stops in ((0.5,), (1.0 / 3.0, 2.0 / 3.0)):
        for bend in BENDS:
            places = [start]
            for stop in stops:
                solved = np.array(
                    [
                        trajectory.state(stop * flight.duration)[:3]
                        for trajectory in flight.trajectories
                    ]
                )
                line = _nearest_on_line(solved, start, goal)
                places.append(np.clip(line + bend * (solved - line), low, high))
            places.append(goal)
            for stretch in stretches:
                stages = []
                for begin, end in pairwise(places):
                    quick = builder.build(leg.drones, begin, end, leg.limits)
                    stages.append(
                        quick
                        if stretch == 1.0
                        else builder.build(
                            leg.drones,
                            begin,
                            end,
                            leg.limits,
                            duration=stretch * quick.duration,
                        )
                    )
                yield (
                    f"{len(places) - 1} legs, bend x {bend:g}, time x {stretch:g}",
                    stages,
                )


def _nearest_on_line(
    points: FloatArray, start: FloatArray, goal: FloatArray
) -> FloatArray:
    """Feet (n, 3) of ``points`` on the straight lines from ``start`` to ``goal``."""
    along = goal - start
    length = np.sum(along**2, axis=1)
    part = np.sum((points - start) * along, axis=1) / np.where(length > 0, length, 1.0)
    return np.asarray(start + np.clip(part, 0.0, 1.0)[:, None] * along)


def _layers(
    leg: Leg, builder: StageBuilder, around: Surroundings, straight: Stage
) -> Iterator[tuple[str, list[Stage]]]:
    """Apart in height, across, and back: drones whose lines meet get other layers."""
    colour = conflict_colours(straight, around.separation, around.required)
    separation = around.separation
    step = 1.05 * separation.distance / separation.metric_scale[2] + 0.05
    low, high = leg.limits.position_min[2], leg.limits.position_max[2]
    for direction in (1.0, -1.0, 0.0):
        lift = np.zeros(leg.drones.size)
        rank = np.searchsorted(leg.drones, straight.drones)
        if direction == 0.0:
            # Alternately above and below.
            lift[rank] = np.where(colour % 2, (colour + 1) // 2, -(colour // 2)) * step
        else:
            lift[rank] = direction * colour * step
        rise = np.stack([np.zeros_like(lift), np.zeros_like(lift), lift], axis=1)
        start, goal = around.positions[leg.drones], leg.goal
        heights = np.concatenate([(start + rise)[:, 2], (goal + rise)[:, 2]])
        if heights.min() < low or heights.max() > high:
            continue
        for stretch in BEND_STRETCHES:
            stages = []
            for begin, end in (
                (start, start + rise),
                (start + rise, goal + rise),
                (goal + rise, goal),
            ):
                quick = builder.build(leg.drones, begin, end, leg.limits)
                stages.append(
                    builder.build(
                        leg.drones,
                        begin,
                        end,
                        leg.limits,
                        duration=stretch * quick.duration,
                    )
                )
            yield f"{int(colour.max()) + 1} layers, time x {stretch:g}", stages


def _refusal(leg: Leg, best: Closest | None, around: Surroundings) -> ExportError:
    if best is None:
        return ExportError(
            f"{leg.name}: no mission encoding of this leg was found; "
            "fly it with `showc stream`"
        )
    return ExportError(
        f"{leg.name}: drones {best.drone_a + 1} and {best.drone_b + 1} come as near as "
        f"{best.distance:.2f} m at {best.time:.1f} s of the leg on the flights that "
        f"the autopilot would make (start delays {around.timing.low:.2f} to "
        f"{around.timing.high:.2f} s); wanted {around.separation.distance:g} m. "
        "Straight legs, more time, staggered releases, bends and layers of height were "
        "tried. Give "
        "the formations more room, or fly the show with `showc stream`"
    )
