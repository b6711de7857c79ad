"""How one leg of the show becomes stages that an autopilot flies apart.

The straight line in the shortest common time comes first. Where the predicted flights
come too near, the encoding changes: drones leave one after the other, fly in other
times, along the solved flight's bend, in layers of height, or above the others. The
quickest that is proved is taken. What counts is the time until the next leg may begin:
every stop has delays and slack. Candidates are worked out no sooner than their turn may
come: what they take at least is known before their flights are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from heapq import heappop, heappush
from itertools import count
from typing import TYPE_CHECKING, Protocol

import numpy as np

from showc.autopilot.stage import flown
from showc.autopilot.timing import CLOCK_LAG, EXACT
from showc.errors import ExportError
from showc.schedule.detours import barred, bends, hops, layers
from showc.schedule.headways import release_gaps
from showc.schedule.releases import MARGIN, staggered
from showc.schedule.separation import TOLERANCE, closest_encounter
from showc.schedule.surroundings import Surroundings, leaves, stage_motion

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from showc.autopilot.stage import Lines, Stage, StageBuilder
    from showc.flight import Encounter, LegFlight
    from showc.plan.itinerary import Leg
    from showc.schedule.headways import Gaps

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


@dataclass(frozen=True, slots=True, eq=False)
class Encoding:
    """The stages of one leg, proved apart."""

    name: str
    """What was done, in words."""
    stages: tuple[Stage, ...]
    """In order; one without drones when none moves."""
    closest: tuple[Encounter | None, ...]
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
    best: Encounter | None = None
    outside: int | None = None
    for worked in candidates(leg, flight, builder, around):
        # What is proved is what is flown: stages without a drone take no time.
        stages = tuple(stage for stage in worked.stages if stage.drones.size)
        stages = stages or worked.stages[:1]
        closest, encounters = [], around.closest(stages)
        for stage in stages:
            out = stage.drones[leaves(stage, around.site)]
            if out.size:
                outside = outside or int(out[0]) + 1
                break
            found = next(encounters)
            closest.append(found)
            if found is not None and found.distance < around.required:
                if best is None or found.distance > best.distance:
                    best = found
                break
        else:
            return Encoding(worked.name, stages, tuple(closest))
    raise _refusal(leg, best, around.separation.distance, outside)


def _refusal(
    leg: Leg, best: Encounter | None, wanted: float, outside: int | None
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


def candidates(
    leg: Leg, flight: LegFlight | None, builder: StageBuilder, around: Surroundings
) -> Iterator[Worked]:
    """All encodings: the straight one, then the quickest first."""
    lines = builder.lines(
        leg.drones, around.positions[leg.drones], leg.goal, leg.limits
    )
    solved = 0.0 if flight is None else flight.duration
    first = lines.lasting(max(solved, lines.together))
    search = _Search(leg, flight, builder, around, lines, first)
    yield Worked(search.cost([first]), "straight", (first,))
    if first.drones.size == 0:
        return
    waiting: list[tuple[float, int, Worked | Promise]] = []
    number = count()
    for promise in search.promises():
        heappush(waiting, (promise.cost, next(number), promise))
    while waiting:
        _, _, found = heappop(waiting)
        if isinstance(found, Worked):
            yield found
            continue
        for choice in found.kept(search):
            heappush(waiting, (choice.cost, next(number), choice))


@dataclass(frozen=True, slots=True, eq=False)
class Worked:
    """Stages in which a leg can be flown."""

    cost: float
    """Time from the first release until the next leg may begin, about [s]."""
    name: str
    """What was done, in words."""
    stages: tuple[Stage, ...]
    """In order."""


class Promise(Protocol):
    """Encodings that are worked out no sooner than their turn may come."""

    @property
    def cost(self) -> float:
        """The least that any of them may cost [s]."""

    def kept(self, search: _Search) -> Iterable[Worked | Promise]:
        """Work them out, or put them off further."""


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    """One leg, and how its encodings are judged."""

    leg: Leg
    flight: LegFlight | None
    builder: StageBuilder
    around: Surroundings
    lines: Lines
    """The straight lines of all drones that move."""
    first: Stage
    """These flown in the shortest common time."""

    def promises(self) -> Iterator[Promise]:
        """Promise all encodings but the straight lines themselves."""
        least = self.cost([self.first])
        yield _Straight(least)
        yield _Bent(least + self.stop)
        yield _Layered(least + 2.0 * self.stop)
        yield _Above(least + 2.0 * self.stop)

    @property
    def stop(self) -> float:
        """What a further stop costs at least [s]."""
        return CLOCK_LAG + self.around.pause

    def cost(self, stages: Sequence[Stage]) -> float:
        """Time from the first release until the next leg may begin, about [s]."""
        late = self.around.timing.late
        return sum(
            stage.finish(late(stage.profile.speed)) + self.stop for stage in stages
        )

    def apart(self, stage: Stage) -> bool:
        """Whether the drones keep apart if all delays are as expected."""
        required = self.around.required
        found = closest_encounter(
            stage_motion(stage, self.around.positions, EXACT),
            self.around.separation,
            enough=required,
            plenty=required + TOLERANCE,
        )
        return found is None or found.distance >= required

    @property
    def by_axes(self) -> bool:
        """Whether drones are kept apart as boxes."""
        return self.around.separation.shape in {"any-axis", "all-axes"}

    def gaps(self, stage: Stage, retry: int = 0) -> Gaps:
        """By how much the stage's drones must leave one after the other."""
        # The proof of the whole stage falls short of the pairs' by its tolerance.
        apart = self.around.required + TOLERANCE
        if self.by_axes:
            # And that of boxes, around where drones may be, short of both.
            apart += WIDER[retry]
        return release_gaps(stage, self.around.separation, self.around.timing, apart)


@dataclass(frozen=True, slots=True, eq=False)
class _Straight:
    """Straight lines: some drones later, in times of their own, or all slower."""

    cost: float

    def kept(self, search: _Search) -> Iterator[Worked | Promise]:
        gaps = search.gaps(search.first)
        if gaps.hopeless():
            return
        later = _Staggered(self.cost, "straight", (search.first,))
        found = list(later.given(search, [gaps]))
        yield from found
        if not found or found[0].cost > self.cost + CLOSE:
            yield _OwnTimes(self.cost, 0)
        yield _Slower(self.cost, search.lines.together)


@dataclass(frozen=True, slots=True, eq=False)
class _OwnTimes:
    """Straight lines, short ones flown in less than the common time, staggered."""

    cost: float
    number: int
    """Of the factor on the common time."""

    def kept(self, search: _Search) -> Iterator[Worked | Promise]:
        common = BRISK[self.number] * search.first.duration
        stage = search.lines.lasting(np.maximum(search.lines.shortest, common))
        later = _Staggered(self.cost, "straight, own times", (stage,))
        found = list(later.kept(search))
        yield from found
        enough = found and found[0].cost <= self.cost + CLOSE
        if self.number + 1 < len(BRISK) and not enough:
            yield _OwnTimes(self.cost, self.number + 1)


@dataclass(frozen=True, slots=True, eq=False)
class _Staggered:
    """Stages whose drones leave one after the other."""

    cost: float
    name: str
    stages: tuple[Stage, ...]
    retry: int = 0
    """How often less room between them was not enough."""

    def kept(self, search: _Search) -> Iterator[Worked | Promise]:
        return self.given(
            search, [search.gaps(stage, self.retry) for stage in self.stages]
        )

    def given(self, search: _Search, gaps: list[Gaps]) -> Iterator[Worked | Promise]:
        """Give the drones their releases; none where an order cannot be found."""
        later = []
        for stage, gap in zip(self.stages, gaps, strict=True):
            wait = (
                staggered(gap, stage.followed, MARGINS[self.retry])
                if gap.drones
                else np.zeros(0)
            )
            if wait is None:
                return
            later.append(stage.waiting(wait))
        cost = search.cost(later)
        longest = max(float(stage.wait.max(initial=0.0)) for stage in later)
        name = f"{self.name}, staggered by up to {longest:g} s"
        yield Worked(cost, name if longest else self.name, tuple(later))
        if self.retry + 1 < len(MARGINS):
            yield _Staggered(cost, self.name, self.stages, self.retry + 1)


@dataclass(frozen=True, slots=True, eq=False)
class _Slower:
    """Straight lines in longer times, staggered: the same delays cost less distance.

    In wind that is what some fleets need. Time scales a flight nearly without changing
    its shape: it helps little where drones meet even without any delay.
    """

    quickest: float
    """Cost of the straight lines in their shortest time [s]."""
    together: float
    """That time [s]."""
    number: int = 0
    """Of the factor on the time."""

    @property
    def cost(self) -> float:
        return self.quickest + (STRETCHES[self.number] - 1.0) * self.together

    def kept(self, search: _Search) -> Iterator[Promise]:
        if self.number == 0 and not search.apart(search.first):
            return
        stretch = STRETCHES[self.number]
        stage = search.lines.lasting(stretch * self.together)
        yield _Staggered(self.cost, f"straight, time x {stretch:g}", (stage,))
        if self.number + 1 < len(STRETCHES):
            yield replace(self, number=self.number + 1)


def _several(
    search: _Search, name: str, stages: Sequence[Stage]
) -> Iterator[Worked | Promise]:
    """Ways of several legs, all at once and staggered."""
    cost = search.cost(stages)
    yield Worked(cost, name, tuple(stages))
    yield _Staggered(cost, name, tuple(stages))


def _quickest(ways: Sequence[Lines]) -> list[Stage]:
    return flown(ways, [lines.together for lines in ways])


@dataclass(frozen=True, slots=True, eq=False)
class _Bent:
    """Ways along the solved flight's bend."""

    cost: float

    def kept(self, search: _Search) -> Iterator[Worked | Promise]:
        if search.flight is None:
            return
        ways = bends(search.leg, search.flight, search.builder, search.around)
        quick = iter(_quickest([lines for _, way in ways for lines in way]))
        for name, way in ways:
            yield from _several(search, name, [next(quick) for _ in way])


@dataclass(frozen=True, slots=True, eq=False)
class _Layered:
    """Ways apart in height."""

    cost: float

    def kept(self, search: _Search) -> Iterator[Worked | Promise]:
        found = layers(search.leg, search.builder, search.around, search.first)
        for name, ways in found:
            yield from _several(search, name, _quickest(ways))


@dataclass(frozen=True, slots=True, eq=False)
class _Above:
    """Some drones above the others, these one after the other."""

    cost: float

    def kept(self, search: _Search) -> Iterator[Worked | Promise]:
        first, around = search.first, search.around
        # A drone whose line passes one that rests meets it whenever it leaves.
        stuck = bool(barred(first, around.positions, around))
        for retry in range(len(WIDER) if search.by_axes else 1):
            gaps = search.gaps(first, retry)
            if not stuck and staggered(gaps, first.followed) is not None:
                continue
            for name, ways in hops(search.leg, search.builder, around, first, gaps):
                stages = tuple(_quickest(ways))
                yield _Staggered(search.cost(stages), name, stages)
