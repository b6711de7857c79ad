"""How one leg of the show becomes stages that an autopilot flies apart.

The straight line in the shortest common time comes first. Where the predicted flights
come too near, the encoding changes: drones leave one after the other, fly in other
times, along the solved flight's bend, in layers of height, or above the others. The
quickest that is proved is taken, up to the moment at which the next leg may begin;
candidates are worked out no sooner than their turn may come.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from heapq import heappop, heappush
from typing import TYPE_CHECKING

import numpy as np

from showc.errors import ExportError
from showc.mission.detours import bends, layers
from showc.mission.gaps import release_gaps
from showc.mission.geodesy import POSITION_RESOLUTION
from showc.mission.hops import hops
from showc.mission.law import LegProfile
from showc.mission.separation import (
    TOLERANCE,
    Closest,
    Motion,
    closest_encounter,
)
from showc.mission.stagger import MARGIN, staggered
from showc.mission.timing import CLOCK_LAG, EXACT

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from numpy.typing import NDArray

    from showc.flight import LegFlight
    from showc.mission.gaps import Gaps
    from showc.mission.stage import Lines, Stage, StageBuilder
    from showc.mission.timing import Timing
    from showc.plan.itinerary import Leg
    from showc.vehicle import Separation

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]
    Choice = tuple[float, str, "list[Stage] | Callable[[], Iterable[Choice]]"]

STRETCHES = (1.1, 1.2, 1.35, 1.5, 1.75, 2.0, 2.5, 3.2, 4.0, 5.0, 6.5, 8.0)
"""Factors on the times of legs that take longer than they must."""

BRISK = (0.8, 0.6, 0.4)
"""Factors on the common time in which legs that are short enough are flown."""

CLOSE = 0.15
"""So near the least time that there is, no other times are looked for [s]."""

MARGINS = (MARGIN, 0.1, 0.3)
"""How much farther than their gaps releases are apart, if less is not proved [s]."""


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
    pause: float = 0.0
    """Least time between the latest end of a stage and the next release [s]."""

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
    """All encodings: the straight one, then the quickest first."""
    straight = builder.lines(
        leg.drones, around.positions[leg.drones], leg.goal, leg.limits
    )
    first = straight.lasting(max(flight.duration, straight.together))
    yield "straight", [first]
    if first.drones.size == 0:
        return
    choices = _Choices(leg, flight, builder, around)
    waiting: list[tuple[float, int, Choice]] = []
    made = 0
    for choice in choices.straight(straight, first):
        heappush(waiting, (choice[0], made := made + 1, choice))
    while waiting:
        _, _, (_, name, found) = heappop(waiting)
        if isinstance(found, list):
            yield name, found
            continue
        for choice in found():
            heappush(waiting, (choice[0], made := made + 1, choice))


@dataclass(frozen=True, slots=True, eq=False)
class _Choices:
    """Encodings of one leg with what they cost: time until the next may begin.

    What is not worked out yet stands as a function, with the least that it may cost.
    """

    leg: Leg
    flight: LegFlight
    builder: StageBuilder
    around: Surroundings

    def straight(self, lines: Lines, first: Stage) -> Iterator[Choice]:
        """Straight lines, some drones later or in other times; and all other ways."""
        least, stop = self._cost([first]), self._cost([])

        def others() -> Iterator[Choice]:
            gaps = self._gaps(first)
            if gaps.hopeless():
                return
            found = list(self._with_waits("straight", [first], [gaps], 0))
            yield from found
            if not found or found[0][0] > least + CLOSE:
                yield least, "straight, own times", partial(brisk, 0)
            promise = self._longer("straight", [lines], least, 0, stagger=True)
            yield promise[0], "straight", partial(self._if_apart, [first], promise)

        def brisk(number: int) -> Iterator[Choice]:
            times = np.maximum(lines.shortest, BRISK[number] * first.duration)
            stage = lines.lasting(times)
            name = "straight, own times"
            found = list(self._with_waits(name, [stage], [self._gaps(stage)], 0))
            yield from found
            enough = found and found[0][0] <= least + CLOSE
            if number + 1 < len(BRISK) and not enough:
                yield least, name, partial(brisk, number + 1)

        yield least, "straight", others
        for stops in (1, 2):
            yield least + stops * stop, "bends", partial(self._bends, stops)
        yield least + 2.0 * stop, "layers", lambda: self._layers(first)
        yield least + 2.0 * stop, "hops", lambda: self._hops(first)

    def _cost(self, stages: list[Stage]) -> float:
        """Time [s] from the first release until the next leg may begin, about.

        Of no stages, that of a further stop.
        """
        pause = CLOCK_LAG + self.around.pause
        if not stages:
            return pause
        late = self.around.timing.spread
        return sum(stage.finish(late) + pause for stage in stages)

    def _apart(self, stage: Stage, positions: FloatArray) -> bool:
        """Whether the stage's drones keep apart if all delays are as expected."""
        required = self.around.required
        found = closest_encounter(
            stage_motion(stage, positions, EXACT),
            self.around.separation,
            enough=required,
        )
        return found is None or found.distance >= required

    def _gaps(self, stage: Stage) -> Gaps:
        # The proof of the whole stage falls short of the pairs' by its tolerance.
        apart = self.around.required + TOLERANCE
        return release_gaps(stage, self.around.separation, self.around.timing, apart)

    def _staggered(
        self, name: str, make: Callable[[], list[Stage]], least: float
    ) -> Choice:
        """Promise stages with waits."""

        def work_out() -> Iterator[Choice]:
            stages = make()
            gaps = [self._gaps(stage) for stage in stages]
            return self._with_waits(name, stages, gaps, 0)

        return least, name, work_out

    def _with_waits(
        self, name: str, stages: list[Stage], gaps: list[Gaps], retry: int
    ) -> Iterator[Choice]:
        waits = [
            staggered(gap, stage.followed, MARGINS[retry])
            for stage, gap in zip(stages, gaps, strict=True)
        ]
        later = [
            stage.waiting(wait)
            for stage, wait in zip(stages, waits, strict=True)
            if wait is not None
        ]
        if len(later) < len(stages):
            return
        cost = self._cost(later)
        longest = max(float(stage.wait.max(initial=0.0)) for stage in later)
        full = f"{name}, staggered by up to {longest:g} s" if longest else name
        yield cost, full, later
        if retry + 1 < len(MARGINS):
            yield (
                cost,
                name,
                lambda: self._with_waits(name, stages, gaps, retry + 1),
            )

    def _bends(self, stops: int) -> Iterator[Choice]:
        ways = bends(self.leg, self.flight, self.builder, self.around, stops)
        for name, lines in ways:
            yield from self._several(name, lines)

    def _layers(self, straight: Stage) -> Iterator[Choice]:
        for name, ways in layers(self.leg, self.builder, self.around, straight):
            yield from self._several(name, ways)

    def _hops(self, straight: Stage) -> Iterator[Choice]:
        gaps = self._gaps(straight)
        if staggered(gaps, straight.followed) is not None:
            return
        for name, ways in hops(self.leg, self.builder, self.around, straight, gaps):
            quick = _flown(ways, [lines.together for lines in ways])
            make = partial(_flown, ways, [lines.together for lines in ways])
            yield self._staggered(name, make, self._cost(quick))

    def _several(self, name: str, ways: list[Lines]) -> Iterator[Choice]:
        """Ways of several legs: in their shortest times, staggered, in longer ones."""
        quick = _flown(ways, [lines.together for lines in ways])
        cost = self._cost(quick)
        yield cost, name, quick
        yield self._staggered(name, lambda: quick, cost)
        promise = self._longer(name, ways, cost, 0)
        yield promise[0], name, partial(self._if_apart, quick, promise)

    def _if_apart(self, quick: list[Stage], longer: Choice) -> Iterator[Choice]:
        """Go on to longer times only if they can help.

        Time scales a flight nearly without changing its shape: it helps little where
        drones meet even without any delay.
        """
        positions = self.around.positions
        for stage in quick:
            if not self._apart(stage, positions):
                return
            positions = positions.copy()
            positions[stage.drones] = stage.end
        yield longer

    def _longer(
        self,
        name: str,
        ways: list[Lines],
        cost: float,
        number: int,
        *,
        stagger: bool = False,
    ) -> Choice:
        """Promise the ways in longer times than those that ``cost`` [s] is for."""
        stretch = STRETCHES[number]
        named = f"{name}, time x {stretch:g}"
        least = cost + (stretch - 1.0) * sum(lines.together for lines in ways)

        make = partial(_flown, ways, [stretch * lines.together for lines in ways])

        def work_out() -> Iterator[Choice]:
            if stagger:
                yield self._staggered(named, make, least)
            else:
                yield least, named, make()
            if number + 1 < len(STRETCHES):
                yield self._longer(name, ways, cost, number + 1, stagger=stagger)

        return least, named, work_out


def _flown(ways: list[Lines], times: Sequence[float | FloatArray]) -> list[Stage]:
    """Return the stages that take so long [s]."""
    return [lines.lasting(time) for lines, time in zip(ways, times, strict=True)]


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
