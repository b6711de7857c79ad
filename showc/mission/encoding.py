"""How one leg of the show becomes stages that an autopilot flies apart.

The straight line in the shortest common time comes first. Where the predicted flights
come too near, the encoding changes: more time (delays then cost less distance), drones
that leave one after the other, a bend along the solved flight, layers of height. The
first that is proved is taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.errors import ExportError
from showc.mission.detours import bends, layers
from showc.mission.geodesy import POSITION_RESOLUTION
from showc.mission.hops import hops
from showc.mission.law import LegProfile
from showc.mission.pair_table import pair_table
from showc.mission.separation import (
    TOLERANCE,
    Closest,
    Motion,
    closest_encounter,
)
from showc.mission.stagger import staggered
from showc.mission.timing import EXACT

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from showc.flight import LegFlight
    from showc.mission.pair_table import PairTable
    from showc.mission.stage import Stage, StageBuilder
    from showc.mission.timing import Timing
    from showc.plan.itinerary import Leg
    from showc.vehicle import Separation

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]

STRETCHES = (1.0, 1.25, 1.6, 2.0, 2.5, 3.2, 4.0, 5.0, 6.5, 8.0)
"""Factors on the time of a straight leg."""

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
    """How surely legs are flown on time."""

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
    # At no time in particular, there is no last instant.
    last = stage.finish(timing.spread) if np.isfinite(timing.spread) else np.inf
    beyond = stage.overshoot if timing.overshoots else np.zeros(stage.drones.size)
    return Motion(
        begin,
        end,
        with_rest(stage.profile).select(rank),
        start + np.append(stage.wait, 0.0)[rank],
        np.append(stage.level, 0.0)[rank],
        np.full(count, timing.spread),
        np.append(beyond, 0.0)[rank],
        (
            start - timing.spread,
            start + last,
        ),
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
    found = list(_slower(first, straight, around))
    # Who flies by turns flies as fast as may be.
    swift = straight(0.0)
    table = _table(swift, around)
    waits = staggered(table)
    if waits is not None:
        name = f"straight, staggered by up to {waits.max():g} s"
        found.append((name, [swift.waiting(waits)]))
    else:
        found.extend(
            (name, [_staggered_stage(one, around) for one in stages])
            for name, stages in hops(leg, builder, around, swift, table)
        )
    found.extend(bends(leg, flight, builder, around))
    found.extend(layers(leg, builder, around, first))
    # Quickest first, every stop paid for; equal ones in the order of their making.
    yield from sorted(
        found, key=lambda item: sum(stage.duration + STOP for stage in item[1])
    )
    for name, stages in bends(leg, flight, builder, around, stretches=(1.0,)):
        yield f"{name}, staggered", [_staggered_stage(one, around) for one in stages]


def _slower(
    first: Stage, straight: Callable[[float], Stage], around: Surroundings
) -> Iterator[tuple[str, list[Stage]]]:
    """Straight lines with more time."""
    exact = closest_encounter(
        stage_motion(first, around.positions, EXACT),
        around.separation,
        enough=around.required,
    )
    # Time scales a flight without changing its shape: it helps only against delays.
    if exact is None or exact.distance >= around.required:
        for stretch in STRETCHES[1:]:
            longer = straight(first.duration * stretch)
            yield f"straight, time x {stretch:g}", [longer]


def _table(stage: Stage, around: Surroundings) -> PairTable:
    """When the drones of a stage may leave so that all keep apart."""
    # The proof of the whole stage falls short of the pairs' by its tolerance.
    apart = around.required + TOLERANCE
    return pair_table(stage, around.separation, around.timing, apart)


def _staggered_stage(stage: Stage, around: Surroundings) -> Stage:
    waits = staggered(_table(stage, around))
    return stage if waits is None else stage.waiting(waits)


def _refusal(leg: Leg, best: Closest | None, around: Surroundings) -> ExportError:
    if best is None:
        return ExportError(
            f"{leg.name}: no mission encoding of this leg was found; "
            "fly it with `showc stream`"
        )
    return ExportError(
        f"{leg.name}: drones {best.drone_a + 1} and {best.drone_b + 1} come as near as "
        f"{best.distance:.2f} m at {best.time:.1f} s of the leg on the flights that "
        f"the autopilot would make (each delay up to {around.timing.spread:.2f} s more "
        f"or less than its leg's); wanted {around.separation.distance:g} m. "
        "Straight legs, more time, staggered releases, bends, layers of height and "
        "ways above the others were tried. Give "
        "the formations more room, or fly the show with `showc stream`"
    )
