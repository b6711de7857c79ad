"""The search for the least common time of a leg, from below and from above.

From below, times a little over the least that any drone needs are tried, then longer
ones. From above there is a flight in closed form, wherever that exists: the search may
end at any time, and does once its work is done. What lies between a time that failed
and the best flight so far is halved while that is worth it.

Work is counted, not timed: the same leg takes the same tries on every machine.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from showc.errors import SolveError
from showc.fleet.deconfliction.clock import ClosedFlights
from showc.fleet.deconfliction.crowd import Crossing
from showc.fleet.deconfliction.enclosure import Detour, detours, displacement
from showc.fleet.deconfliction.flights import PRODUCTS, Move, Ways
from showc.fleet.deconfliction.layered import fly_layered
from showc.fleet.deconfliction.repair import Repair
from showc.fleet.deconfliction.untangling import quickest
from showc.fleet.deconfliction.widened import fly_widened
from showc.fleet.lower_bound.limiting import (
    Limiting,
    least_time_within,
    limiting_in_motion,
    limiting_time,
)
from showc.fleet.shared_profile.synchronise import shared_profile
from showc.fleet.single_drone.shortest import minimum_time
from showc.script.lanes import whole_milliseconds

if TYPE_CHECKING:
    from showc.fleet.execution.pool import Workers
    from showc.fleet.options import SolveOptions
    from showc.fleet.shared_profile.profile import Profile
    from showc.fleet.single_drone.model import Aircraft
    from showc.flight import Trajectory
    from showc.plan.itinerary import Leg
    from showc.progress import Progress
    from showc.script.fence import Fence
    from showc.vehicle import Separation


_STILL = 1e-9
"""Difference of two moves that is rounding [m]."""
_GROWTH, _SLOWLY, _NEARLY, _BOLDLY = 4.0, 2.0, 1.5, 16.0
"""Growth of the time allowed over the least one after a failure; where a crowd was
nearly parted, with fewer times what may be wrong; and of many drones at first."""
_GREAT, _MEETING, _FEW = 500, 0.25, 8
"""Drones from which on a time near the least is passed over where more pairs than this
share of them meet on straight lines: a search there takes as long as all others. In a
draft it is passed over for any number of drones, but not for so few pairs."""
_SMALL = 0.01
"""Share of the least time beyond it up to which growth is quick all the same."""
_MANY = 128
"""Drones from which on a try costs as much as all before it; up to these, flights that
kept apart are followed at a quicker pace: that takes a solve for each of them."""
_CLOSE, _CLOSE_SHARE, _CLOSE_OF_MANY = 0.004, 0.2, 0.8
"""Time between a failed and a flown one that is near enough: a share of the least time,
and a share of what is flown beyond it, greater where there are many drones; the first
and that of many are over the effort."""
_ENOUGH_OF_MANY = 0.02
"""Share of the least time beyond it, over the effort, at which a flight of many drones
is enough: nearer ones take as long as all before."""
_STEP = 0.02
"""Share by which the time differs from what ways were found for, at first."""
_SOON = 0.003
"""Share of the least time by which the next time is longer at least."""
_BOLD = 0.3
"""Where a flight in closed form is the best so far, share of the time between a failed
one and it that is tried: that flight takes far longer than it needs."""
_WORK, _WORK_EACH, _WORK_EACH_MORE = 600.0, 4.0, 1.0
"""Work after which no shorter time is tried, and how much more for each drone, and for
each of those beyond ``_MANY``. The unit is a flight behind half-spaces that is solved,
0.01 to 0.07 s on one core."""
_WORK_ROUND = 0.5
"""Share of this work where drones go round corners: a flight between walls of the fence
takes two to ten times as long to solve."""
_IN_CLOSED_FORM = 2.0
"""How much more work may be done while a flight in closed form is all there is."""
_AT_ONCE, _LEAST_WORK = 0.6, 200.0
"""Share of the work left that any one time may take, and what it may at least."""
_DRAFT_WORK, _DRAFT_GAPS = 60.0, (0.03, 0.1, 0.3)
"""Work of each try of a draft: three times what 100 drones take that hardly meet. And
shares of the least time beyond it that a draft of a crowd tries after the first one:
nearer to it each drone is solved again and again, as splines are not supple enough."""
_DRAFT_SEARCH = 150.0
"""Work of a draft up to which a try looks for ways through a fourth dimension."""
_SLOWER = 4
"""Drones at most that prove slower than those that were thought the slowest."""

Found = Repair | ClosedFlights
"""Flights of all drones over one common time, and how they were found."""


@dataclass(frozen=True, slots=True)
class Room:
    """Where drones may be."""

    separation: Separation
    """How far from each other."""
    fence: Fence | None
    """Inside what, if there is one."""


class Search:
    """Looks for flights of a leg's drones over one common time.

    Parameters
    ----------
    where
        The leg's place in the script, for people.
    """

    def __init__(  # noqa: PLR0917 - a leg, its show's rules, and the means
        self,
        leg: Leg,
        where: str,
        aircraft: Aircraft,
        room: Room,
        options: SolveOptions,
        workers: Workers,
        progress: Progress,
    ) -> None:
        self.leg, self.where, self.aircraft = leg, where, aircraft
        self.separation, self.fence, self.options = room.separation, room.fence, options
        # A time that the script gives is no matter of effort.
        self.effort = options.effort if leg.duration is None else max(options.effort, 1)
        self.workers, self.progress = workers, progress
        self.counts: dict[str, float] = {}
        self.shortest: dict[int, Trajectory] = {}
        self.work = 0.0
        # On which the crowd parts soonest, by row, and how much more time is tried.
        self.ways: Ways | None = None
        self.step = 0.5 * _STEP
        self.detours = self._detours()
        # Drones that are in motion at an end fly no straight lines.
        self.shared = None
        if not leg.in_motion:
            self.shared = shared_profile(
                aircraft.vehicle,
                leg.limits,
                aircraft.heading,
                np.zeros_like(leg.start),
                displacement(aircraft, leg.start, leg.goal, self.detours),
            )
        # The flight in closed form, and the time up to which it was looked for [s].
        self._known: ClosedFlights | None = None
        self._sought = 0.0
        self._flown = False

    def limiting(self, *, solve: bool) -> Limiting:
        """Find the slowest drones, and prove how long they need."""
        leg, common = self.leg, (self.workers, self.progress)
        if leg.in_motion:
            limiting = limiting_in_motion(
                self.aircraft,
                [leg.ends(row) for row in range(leg.drones.size)],
                *common,
                name=leg.name,
                solve=solve,
            )
        else:
            limiting = limiting_time(
                self.aircraft,
                leg.start,
                leg.goal,
                *common,
                name=leg.name,
                solve=solve,
            )
        self._count("minimum_time_solves", limiting.solves)
        self.shortest = {
            row: result.trajectory
            for row, result in limiting.flights.items()
            if result.trajectory is not None
        }
        return limiting

    def least(self) -> tuple[Found, Limiting]:
        """Find flights in the least common time.

        Raises
        ------
        SolveError
            If a pair cannot be kept apart in any time that is tried.
        """
        limiting = self._round(self.limiting(solve=True))
        together = self._side_by_side(limiting)
        if together is not None:
            return together, limiting
        best: Found | None = None
        least = limiting.time
        if self.detours and self.shared is not None:
            # Ways round corners are nearer to straight flights that cruise as long.
            least = max(least, self.shared.duration)
        longest = None
        failed, gap, slower = 0.0, self.options.gap, 0
        while True:
            time = whole_milliseconds(least * (1.0 + gap))
            if best is not None and (time >= best.duration or self.spent):
                break
            most = self._most(gap)
            repair = self.at(time, self.ways, most=most)
            if repair.done:
                best = repair
                break
            self.progress.note(
                f"{self.leg.name}: {repair.trouble}; trying longer than {time:.3f} s"
            )
            late = repair.late
            if late is not None and late not in self.shortest and slower < _SLOWER:
                # It may need longer than those that the bounds called the slowest.
                slower += 1
                limiting = self._with(limiting, late)
                least = max(least, limiting.time)
                continue
            longest = self._longest(least) if longest is None else longest
            # That flight takes long to find: after a time near the least, of which
            # little is expected, another comes first.
            last = gap >= longest
            if best is None and most == np.inf and not self._drafts_on(gap):
                best = self.surely(np.inf if last else least * (1.0 + longest))
            if best is None and last:
                raise self._parted(time, limiting, repair.trouble)
            if best is not None and (last or self.spent):
                break
            ways = self.ways
            gap = min(self._later(repair, gap, least), longest)
            # Nothing has failed with ways that are just found in more time.
            failed = 0.0 if repair.tangled and self.ways is not ways else time
        return self._narrowed(best, max(failed, limiting.time), limiting), limiting

    def _later(self, repair: Repair, gap: float, least: float) -> float:
        """Share of a least time [s] beyond it that is tried after one that failed.

        First that in which the crowd parts soonest, then a little more each time.
        Where others fly, or drones are in motion, ways are good for one time alone.
        """
        if self._drafts_on(gap):
            return next(longer for longer in _DRAFT_GAPS if longer > gap)
        if self.ways is None and repair.crowd is not None and repair.move.free:
            if repair.tangled:
                found = repair.soonest
                if found is None:
                    found = quickest(repair.crowd, self.workers)
                    self.work += found.work / PRODUCTS
                self.ways = repair.led(found)
                return max(found.duration / least - 1.0, gap + _SOON)
            # Few pairs are left that come too near: a little more time may part them.
            self.ways = repair.ways
        if self.ways is None:
            return self._growth(repair, gap) * gap
        self.step *= 2.0
        return (1.0 + gap) * (1.0 + self.step) - 1.0

    def _drafts_on(self, gap: float) -> bool:
        """Whether a draft tries longer times before it flies in closed form."""
        more = not self.effort and gap < _DRAFT_GAPS[-1]
        return more and self.crossing() is not None

    def _most(self, gap: float) -> float:
        """Pairs that may be too near where a time is worth a search, early on."""
        drones = self.leg.drones.size
        hasty = (drones >= _GREAT and self.effort <= 1) or self._drafts_on(gap)
        most = max(_MEETING * drones, _FEW)
        return most if hasty and gap <= _SMALL else np.inf

    def _growth(self, repair: Repair, gap: float) -> float:
        """How much more than a time that failed is tried next, beyond the least."""
        many = self.leg.drones.size > _MANY and self.effort <= 1
        if many and gap <= _SMALL:
            return _BOLDLY
        # Where it nearly parts, the next time is near.
        near = 0.0 < repair.tangled < _NEARLY or (not repair.tangled and gap > _SMALL)
        return _SLOWLY if near else _GROWTH

    def _narrowed(self, best: Found, failed: float, limiting: Limiting) -> Found:
        """Halve what lies between a time that failed [s] and the best one flown.

        The nearer the best is to the least time, the finer: at last the first time that
        was tried is tried again, with ways that are known since.
        """
        if self.spent:
            return best
        floor = limiting.time
        first = whole_milliseconds(floor * (1.0 + self.options.gap))
        many = self.leg.drones.size > _MANY
        part = _CLOSE_OF_MANY / self.effort if many else _CLOSE_SHARE
        enough = _ENOUGH_OF_MANY / self.effort * floor
        while not self.spent:
            beyond = best.duration - floor
            if many and beyond < enough:
                break
            near = max(_CLOSE * floor / self.effort, part * beyond)
            share = 0.5 if isinstance(best, Repair) else _BOLD
            middle = failed + share * (best.duration - failed)
            if self.ways is not None and isinstance(best, Repair):
                middle = max(middle, (1.0 - _STEP) * best.duration)
            middle = whole_milliseconds(middle)
            if best.duration - failed < near or middle <= first:
                middle = first
                if many or failed >= first:
                    break
            if middle >= best.duration:
                break
            known = best.ways if self.ways is not None or not many else None
            if isinstance(best, ClosedFlights) and self.ways is not None:
                known = self.ways
            self.progress.note(
                f"{self.leg.name}: found {best.duration:.3f} s, "
                f"{max(100.0 * (best.duration / limiting.time - 1.0), 0.0):.1f} % over "
                f"the minimum; trying {middle:.3f} s"
            )
            repair = self.at(middle, known)
            if repair.done:
                best = repair
            else:
                failed = middle
        return best

    @property
    def spent(self) -> bool:
        """Whether the work is done that shorter times are worth."""
        return self.left <= 0.0

    @property
    def left(self) -> float:
        """Work that may still be done for shorter times."""
        drones = self.leg.drones.size
        allowed = _WORK + _WORK_EACH * min(drones, _MANY)
        allowed += _WORK_EACH_MORE * max(drones - _MANY, 0)
        if self.detours:
            allowed *= _WORK_ROUND
        if self._known is not None and not self._flown:
            allowed *= _IN_CLOSED_FORM
        return self.effort * allowed - self.work

    def at(
        self,
        time: float,
        known: Ways | None = None,
        shared: Profile | None = None,
        most: float = np.inf,
    ) -> Repair:
        """Look for flights over a time [s]; ``done`` tells whether they are found.

        Parameters
        ----------
        known
            Ways over another time that kept apart.
        shared
            The profile that drones share; None: the quickest one.
        most
            Pairs too near, from which on the time is not worth a search.
        """
        leg, closed = self.leg, self.crossing() is not None
        # Without effort, crowds that do not part soon fly in closed form if they can.
        draft = closed and not (self.effort or self._sought)
        move = Move(
            name=leg.name,
            aircraft=self.aircraft,
            separation=self.separation,
            start=leg.start,
            goal=leg.goal,
            ends=[leg.ends(row) for row in range(leg.drones.size)],
            parked=leg.others_parked,
            others=leg.others,
            names=leg.drones,
            shared=self.shared if shared is None else shared,
            detours=self.detours,
            fence=self.fence,
            rounds=self.options.repair_rounds,
            work=_DRAFT_WORK if draft else max(_AT_ONCE * self.left, _LEAST_WORK),
            known=known,
            free=closed and not (draft and self.work < _DRAFT_SEARCH),
            draft=draft,
            most=most,
        )
        repair = Repair(move, time, self.shortest, self.workers, self.progress)
        repair.run()
        self._count("common_times_" + ("passed_over" if repair.tangled else "tried"))
        self.work += repair.work
        self._flown |= repair.done
        return repair

    def surely(self, most: float = np.inf) -> ClosedFlights | None:
        """Return the flight in closed form, if there is one that takes less time [s].

        Layers take many times what drones need where they climb slowly.
        """
        crossing = self.crossing()
        if self._known is None and most > self._sought:
            found = None
            if crossing is not None and not self.detours:
                found = None if self._sought else fly_widened(crossing)
                found = found or fly_layered(crossing, most)
            self._known = found if found is not None and self._inside(found) else None
        self._sought = max(most, self._sought)
        return self._known

    def _inside(self, found: ClosedFlights) -> bool:
        """Whether flights stay within the fence."""
        fence = self.fence
        states = [flight.state for flight in found.trajectories]
        return fence is None or all(
            fence.first_breach(state.coefficients[..., :2], state.breaks) is None
            for state in states
        )

    def crossing(self) -> Crossing | None:
        """Return what is flown in closed form; None among others that fly."""
        leg = self.leg
        if self.shared is None or leg.others:
            return None
        ends, room = (leg.start, leg.goal, leg.others_parked), (self.shared, self.fence)
        return Crossing(self.aircraft, self.separation, *ends, *room)

    def _detours(self) -> dict[int, Detour]:
        """Find ways for the drones whose straight way leaves the fence."""
        fence, leg, found = self.fence, self.leg, {}
        if fence is None:
            return {}
        for row, way in detours(fence, self.aircraft, leg.start, leg.goal).items():
            start, goal = leg.start[row], leg.goal[row]
            if way is None:
                raise SolveError(
                    f"{self.where}: drone {leg.drones[row] + 1} has no way from "
                    f"({start[0]:.2f}, {start[1]:.2f}) m to ({goal[0]:.2f}, "
                    f"{goal[1]:.2f}) m that stays {fence.margin:.2f} m within the "
                    "fence; widen the passage or ask for less 'fence_margin'"
                )
            found[row] = way
        return found

    def _parted(self, time: float, limiting: Limiting, trouble: str) -> SolveError:
        """Say that the drones cannot be kept apart, even in a time [s]."""
        return SolveError(
            f"{self.where}: {trouble}, even in {time:.3f} s "
            f"({100.0 * (time / limiting.time - 1.0):.0f} % more than the "
            "slowest drone needs); move the formations apart or let the "
            "assignment be optimal"
        )

    def _with(self, limiting: Limiting, row: int) -> Limiting:
        """Solve one more drone's least time; it may be the greatest."""
        start, goal = self.leg.ends(row)
        task = self.aircraft, start, goal
        (result,) = self.workers.run(minimum_time, [task], _unheard)
        self._count("minimum_time_solves")
        if not result.solved or result.trajectory is None:
            return limiting
        self.shortest[row] = result.trajectory
        if result.duration <= limiting.time:
            return limiting
        length = float(np.linalg.norm(goal[:3] - start[:3]))
        return replace(limiting, time=result.duration, drone=row, distance=length)

    def _round(self, limiting: Limiting) -> Limiting:
        """Raise the least time to what the way round the fence's corners takes."""
        fence, leg = self.fence, self.leg
        for row in self.detours if fence is not None else ():
            start, goal = leg.start[row], leg.goal[row]
            assert fence is not None  # noqa: S101 - the line above says so
            length = fence.least_length(start[:2], goal[:2])
            time = least_time_within(self.aircraft, fence, start[:2], goal[:2])
            self.counts["fence_bound"] = max(time, self.counts.get("fence_bound", 0.0))
            if time > limiting.time:
                limiting = replace(limiting, time=time, drone=row, distance=length)
        return limiting

    def _longest(self, least: float) -> float:
        """Share of a least time [s] that may be added to it at most.

        Ways round the fence's corners may take several times as long.
        """
        halting = [way.halting_time(self.aircraft) for way in self.detours.values()]
        return self.options.gap_limit + 2.0 * max(halting, default=0.0) / least

    def _side_by_side(self, limiting: Limiting) -> Repair | None:
        """Where all drones make the same move, none comes nearer: no slack."""
        if self.shared is None:
            return None
        moves = self.leg.goal - self.leg.start
        if np.abs(moves - moves[0]).max() > _STILL:
            return None
        repair = self.at(whole_milliseconds(limiting.time))
        return repair if repair.done else None

    def _count(self, name: str, value: float = 1.0) -> None:
        self.counts[name] = self.counts.get(name, 0.0) + value


def _unheard(steps: int) -> None:
    """Say nothing of a single drone's progress."""
