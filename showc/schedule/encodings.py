"""How one leg of the show becomes stages that an autopilot flies apart.

The straight line in the shortest common time comes first. Where the predicted flights
come too near, the encoding changes: drones leave one after the other, fly in other
times, along the solved flight's bend, in layers of height, or above the others. The
quickest that is proved is taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from heapq import heappop, heappush
from typing import TYPE_CHECKING

import numpy as np

from showc.autopilot.stage import flown
from showc.autopilot.timing import CLOCK_LAG, EXACT
from showc.errors import ExportError
from showc.schedule.detours import bends, hops, layers
from showc.schedule.headways import release_gaps
from showc.schedule.releases import MARGIN, staggered
from showc.schedule.separation import TOLERANCE, Closest, closest_encounter
from showc.schedule.surroundings import Surroundings, leaves, stage_motion

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from showc.arrays import FloatArray
    from showc.autopilot.stage import Lines, Stage, StageBuilder
    from showc.flight import LegFlight
    from showc.plan.itinerary import Leg
    from showc.schedule.headways import Gaps

    Choice = tuple[float, str, "list[Stage] | Callable[[], Iterable[Choice]]"]


@dataclass(frozen=True, slots=True, eq=False)
class Encoding:
    """The stages of one leg, proved apart."""

    name: str
    """What was done, in words."""
    stages: tuple[Stage, ...]
    """In order; none when no drone moves."""
    closest: tuple[Closest | None, ...]
    """Nearest encounter of each stage, times since its release [s]."""


def choose_encoding(
    leg: Leg, flight: LegFlight | None, builder: StageBuilder, around: Surroundings
) -> Encoding:
    """Return the first encoding of ``leg`` whose predicted flights keep apart.

    ``flight`` is the leg solved; None before that: then no bend can follow it.

    Raises
    ------
    ExportError
        If none does; names the pair, the time and the distance of the best one.
    """
    best: Closest | None = None
    outside: int | None = None
    for name, stages in candidates(leg, flight, builder, around):
        closest, positions = [], around.positions
        for stage in stages:
            out = stage.drones[leaves(stage, around.site)]
            if out.size:
                outside = outside or int(out[0]) + 1
                break
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
    raise _refusal(leg, best, around.separation.distance, outside)


def _refusal(
    leg: Leg, best: Closest | None, wanted: float, outside: int | None
) -> ExportError:
    if best is None and outside is not None:
        return ExportError(
            f"{leg.name}: the straight legs of missions leave the flight volume or the "
            f"fence (drone {outside}, with what an autopilot flies beyond its end); "
            "give the formations more room, or fly the show with `showc stream`"
        )
    if best is None:
        return ExportError(
            f"{leg.name}: no mission encoding of this leg was found; "
            "fly it with `showc stream`"
        )
    return ExportError(
        f"{leg.name}: drones {best.drone_a + 1} and {best.drone_b + 1} come as near as "
        f"{best.distance:.2f} m at {best.time:.1f} s of the leg on the flights that "
        f"the autopilot would make; wanted {wanted:g} m. "
        "Straight legs, more time, staggered releases, bends, layers of height and "
        "ways above the others were tried. Give "
        "the formations more room, or fly the show with `showc stream`"
    )


STRETCHES = (1.1, 1.2, 1.35, 1.5, 1.75, 2.0, 2.5, 3.2, 4.0, 5.0, 6.5, 8.0)
"""Factors on the times of legs that take longer than they must."""

BRISK = (0.8, 0.6, 0.4)
"""Factors on the common time in which legs that are short enough are flown."""

CLOSE = 0.15
"""So near the least time that there is, no other times are looked for [s]."""

MARGINS = (MARGIN, 0.05, 0.1, 0.2, 0.3, 0.4)
"""How much farther than their gaps releases are apart, if less is not proved [s]."""

WIDER = (0.0, 0.05, 0.1, 0.15, 0.25, 0.5)
"""How much more room drones get then if the separation goes by axes [m]."""


def candidates(
    leg: Leg, flight: LegFlight | None, builder: StageBuilder, around: Surroundings
) -> Iterator[tuple[str, list[Stage]]]:
    """All encodings: the straight one, then the quickest first."""
    straight = builder.lines(
        leg.drones, around.positions[leg.drones], leg.goal, leg.limits
    )
    solved = 0.0 if flight is None else flight.duration
    first = straight.lasting(max(solved, straight.together))
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
    flight: LegFlight | None
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
        late = self.around.timing.late
        return sum(stage.finish(late(stage.profile.speed)) + pause for stage in stages)

    def _apart(self, stage: Stage, positions: FloatArray) -> bool:
        """Whether the stage's drones keep apart if all delays are as expected."""
        required = self.around.required
        found = closest_encounter(
            stage_motion(stage, positions, EXACT),
            self.around.separation,
            enough=required,
            plenty=required + TOLERANCE,
        )
        return found is None or found.distance >= required

    @property
    def _by_axes(self) -> bool:
        return self.around.separation.shape in {"any-axis", "all-axes"}

    def _gaps(self, stage: Stage, retry: int = 0) -> Gaps:
        # The proof of the whole stage falls short of the pairs' by its tolerance.
        apart = self.around.required + TOLERANCE
        if self._by_axes:
            # And that of boxes, around where drones may be, short of both.
            apart += WIDER[retry]
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
            if gap.drones
            else np.zeros(0)
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
            yield cost, name, partial(self._again, name, stages, retry + 1)

    def _again(self, name: str, stages: list[Stage], retry: int) -> Iterator[Choice]:
        gaps = [self._gaps(stage, retry) for stage in stages]
        return self._with_waits(name, stages, gaps, retry)

    def _bends(self, stops: int) -> Iterator[Choice]:
        if self.flight is None:
            return
        ways = bends(self.leg, self.flight, self.builder, self.around, stops)
        legs = [lines for _, way in ways for lines in way]
        quick = iter(flown(legs, [lines.together for lines in legs]))
        for name, way in ways:
            yield from self._several(name, way, [next(quick) for _ in way])

    def _layers(self, straight: Stage) -> Iterator[Choice]:
        for name, ways in layers(self.leg, self.builder, self.around, straight):
            quick = flown(ways, [lines.together for lines in ways])
            yield from self._several(name, ways, quick)

    def _hops(self, straight: Stage) -> Iterator[Choice]:
        for retry in range(len(WIDER) if self._by_axes else 1):
            gaps = self._gaps(straight, retry)
            if staggered(gaps, straight.followed) is not None:
                continue
            for name, ways in hops(self.leg, self.builder, self.around, straight, gaps):
                make = partial(flown, ways, [lines.together for lines in ways])
                yield self._staggered(name, make, self._cost(make()))

    def _several(
        self, name: str, ways: list[Lines], quick: list[Stage]
    ) -> Iterator[Choice]:
        """Ways of several legs: in their shortest times, staggered, in longer ones.

        ``quick`` is how they are flown in their shortest times.
        """
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

        make = partial(flown, ways, [stretch * lines.together for lines in ways])

        def work_out() -> Iterator[Choice]:
            if stagger:
                yield self._staggered(named, make, least)
            else:
                yield least, named, make()
            if number + 1 < len(STRETCHES):
                yield self._longer(name, ways, cost, number + 1, stagger=stagger)

        return least, named, work_out
