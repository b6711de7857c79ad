"""One leg: the least common time of its drones, flown apart, with a certificate."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from showc.errors import SolveError
from showc.fleet.deconfliction.conflicts import Encounters, closest, conflicts
from showc.fleet.deconfliction.enclosure import Detour, detours
from showc.fleet.deconfliction.repair import Move, Repair
from showc.fleet.deconfliction.stretched import StretchedFlights, fly_ways_slowly
from showc.fleet.deconfliction.tracks import tracks_of
from showc.fleet.deconfliction.walls import reversed_order
from showc.fleet.deconfliction.ways import Crossing
from showc.fleet.lower_bound.bound import lower_bound
from showc.fleet.lower_bound.limiting import (
    Limiting,
    limiting_in_motion,
    limiting_time,
)
from showc.fleet.lower_bound.relaxation import Relaxation
from showc.fleet.motion import fly_motion
from showc.fleet.shared_profile.synchronise import shared_profile
from showc.fleet.single_drone.single import Aircraft, hover, minimum_time
from showc.fleet.single_drone.vertical import fly_upright, quickest_ascent
from showc.flight import (
    Certificate,
    DualWitness,
    Encounter,
    LegFlight,
    Trajectory,
)
from showc.script.fence import Fence
from showc.vehicle.metric import measure

if TYPE_CHECKING:
    from collections.abc import Mapping

    from showc.fleet.execution.pool import Workers
    from showc.fleet.options import SolveOptions
    from showc.fleet.shared_profile.profile import Profile
    from showc.plan.itinerary import Leg
    from showc.progress import Progress
    from showc.script.show import Show
    from showc.vehicle import Separation


TOLERANCE = 1e-6
"""How much nearer than the separation a pair may come by rounding [m]."""
_STILL = 1e-9
SHORTEST_MOTION = 0.5
"""Least time of a motion [s]."""
_GROWTH, _SLOWLY, _NEARLY = 4.0, 2.0, 1.5
"""Growth of the time allowed over the least one after a failure, and where a crowd was
nearly parted: with fewer times what may be wrong."""
_FOLLOWED = 128
"""Drones up to which flights that kept apart are followed at a quicker pace: that takes
a solve for each of them."""
_TRIES = 8
"""Common times tried at most, unless none of them has led to a flight."""
_CLOSE, _CLOSE_SHARE, _CLOSE_OF_MANY = 0.0015, 0.2, 0.8
"""Time between a failed and a flown one that is near enough: a share of the least time,
and a share of what is flown beyond it; of many drones, of which each try costs as much
as all before it, a greater one, over the effort."""
_BOLD = 0.3
"""Where a slow flight is the best so far, share of the time between a failed one and it
that is tried: ways flown slowly take far longer than they need."""
_SOLVES, _SOLVES_EACH = 200, 4
"""Flights behind half-spaces that are solved at most while shorter times are looked
for, and how many more for each drone."""
_SLOWER = 4
"""Drones at most that prove slower than those that were thought the slowest."""


_NONE: Mapping[int, Trajectory] = MappingProxyType({})


def whole_milliseconds(time: float) -> float:
    """Round a time up to a whole millisecond [s]."""
    return math.ceil(time * 1000.0 - 1e-6) / 1000.0


@dataclass(slots=True)
class _Attempts:
    """What has been tried, for the certificate."""

    counts: dict[str, float] = field(default_factory=dict)

    def add(self, name: str, value: float = 1.0) -> None:
        self.counts[name] = self.counts.get(name, 0.0) + value


def aircraft_of(show: Show, leg: Leg) -> Aircraft:
    """Return what flies on this leg, with the leg's own limits."""
    return Aircraft(show.vehicle, leg.limits, show.yaw, show.heading)


def airframe_of(show: Show, leg: Leg) -> Aircraft | None:
    """Return the aircraft without its autopilot; None where the same limits hold."""
    own = show.airframe_limits
    if own is None:
        return None
    limits = replace(
        leg.limits,
        level_speed=own.level_speed,
        acceleration=own.acceleration,
        acceleration_up=own.acceleration_up,
        acceleration_down=own.acceleration_down,
    )
    return Aircraft(show.vehicle, limits, show.yaw, show.heading)


def solve_leg(
    leg: Leg,
    show: Show,
    options: SolveOptions,
    workers: Workers,
    progress: Progress,
) -> LegFlight:
    """Find the least common time of ``leg`` and a flight of each drone that keeps it.

    Returns
    -------
    LegFlight
        Every limit kept at every instant, every pair apart in continuous time, the
        duration a whole number of milliseconds.

    Raises
    ------
    SolveError
        If the leg cannot be flown in the time the script gives, or a pair cannot be
        kept apart; the message names them, the constraint and the time needed.
    """
    return _Solver(leg, show, options, workers, progress).solve()


class _Solver:
    """Carries one leg through its stages."""

    def __init__(
        self,
        leg: Leg,
        show: Show,
        options: SolveOptions,
        workers: Workers,
        progress: Progress,
    ) -> None:
        self.leg = leg
        self.aircraft = aircraft_of(show, leg)
        self.separation: Separation = show.separation
        self.options = options
        self.workers = workers
        self.progress = progress
        self.tried = _Attempts()
        self.where = place(leg)
        self.airframe = airframe_of(show, leg)
        self.fence = Fence.of(show.site)
        self.detours: dict[int, Detour] = {}
        self.shortest: dict[int, Trajectory] = {}
        # Flights behind half-spaces that were solved, at all common times.
        self.solves = 0

    def solve(self) -> LegFlight:
        """Go through the stages."""
        leg = self.leg
        self._check_ends()
        if leg.motion:
            return self._moving()
        self._find_detours()
        self._check_order()
        moving = np.linalg.norm(leg.goal - leg.start, axis=1) > _STILL
        if not (moving.any() or leg.in_motion):
            return self._hold()
        if leg.kind in {"launch", "land"}:
            return self._upright()
        shared = None
        if not leg.in_motion:
            shared = shared_profile(
                self.aircraft.vehicle,
                leg.limits,
                self.aircraft.heading,
                leg.start,
                leg.goal,
            )
        if leg.duration is not None:
            return self._fixed(leg.duration, shared)
        limiting = self._limiting(solve=True)
        return self._shortest(limiting, shared)

    def _limiting(self, *, solve: bool) -> Limiting:
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
        self.tried.add("minimum_time_solves", limiting.solves)
        self.shortest = {
            row: result.trajectory
            for row, result in limiting.flights.items()
            if result.trajectory is not None
        }
        return limiting

    def _find_detours(self) -> None:
        """Find ways for the drones whose straight way leaves the fence."""
        fence, leg = self.fence, self.leg
        if fence is None:
            return
        for row, found in detours(fence, self.aircraft, leg.start, leg.goal).items():
            start, goal = leg.start[row], leg.goal[row]
            if found is None:
                raise SolveError(
                    f"{self.where}: drone {leg.drones[row] + 1} has no way from "
                    f"({start[0]:.2f}, {start[1]:.2f}) m to ({goal[0]:.2f}, "
                    f"{goal[1]:.2f}) m that stays {fence.margin:.2f} m within the "
                    "fence; widen the passage or ask for less 'fence_margin'"
                )
            self.detours[row] = found

    def _hold(self) -> LegFlight:
        if self.leg.duration is None:
            duration = 0.001
        else:
            duration = whole_milliseconds(self.leg.duration)
        trajectories = tuple(
            hover(self.aircraft, position, duration) for position in self.leg.start
        )
        nearest = nearest_pair(self.leg, trajectories, self.separation)
        certificate = Certificate(
            duration, 0.0, 0.0, None, nearest, "hold: every drone hovers", {}
        )
        return LegFlight(self.leg, duration, trajectories, certificate)

    def _moving(self) -> LegFlight:
        """Fly a formation that moves while it is held."""
        leg, duration = self.leg, whole_milliseconds(self.leg.duration or 0.0)
        if duration < SHORTEST_MOTION:
            raise SolveError(
                f"{self.where}: a motion in {duration:.3f} s; hold the formation for "
                f"{SHORTEST_MOTION:g} s or more"
            )
        moved = fly_motion(leg, self.aircraft, duration)
        if wrong := moved.trouble():
            raise SolveError(f"{self.where}: {wrong}")
        flights = moved.trajectories
        if self.fence is not None:
            for row, flight in enumerate(flights):
                way = flight.state.coefficients[..., :2]
                time = self.fence.first_breach(way, flight.state.breaks)
                if time is not None:
                    raise SolveError(
                        f"{self.where}: drone {leg.drones[row] + 1} comes nearer to "
                        f"the fence than {self.fence.margin:.2f} m at {time:.2f} s of "
                        "its motion; make the motion smaller, or move the formation"
                    )
        met = conflicts(
            tracks_of(flights, leg.others_parked),
            self.separation,
            self.separation.distance - TOLERANCE,
        )
        if len(met):
            nearest = int(np.argmin(met.distance))
            names = pair_names(leg, int(met.first[nearest]), int(met.second[nearest]))
            raise SolveError(
                f"{self.where}: {names} come within {met.distance[nearest]:.3f} m at "
                f"{met.time[nearest]:.2f} s of the motion, the separation is "
                f"{self.separation.distance:.3f} m; spread the formation, or make the "
                "motion smaller"
            )
        certificate = Certificate(
            duration,
            0.0,
            0.0,
            None,
            nearest_pair(leg, flights, self.separation),
            f"moving formation: polynomials within {moved.error:.1e} m of the motion",
            {
                "drones": float(leg.drones.size),
                "intervals": float(flights[0].state.intervals),
                "motion_error": moved.error,
            },
        )
        return LegFlight(leg, duration, flights, certificate)

    def _upright(self) -> LegFlight:
        """Fly launch and landing: straight up or down, upright."""
        aircraft, leg = self.aircraft, self.leg
        heights = leg.goal[:, 2] - leg.start[:, 2]
        ascent = quickest_ascent(aircraft, heights)
        ascent = ascent.stretched(whole_milliseconds(ascent.duration))
        flights = fly_upright(aircraft, leg.start, leg.goal, ascent)
        met = conflicts(
            tracks_of(flights, leg.others_parked),
            self.separation,
            self.separation.distance - TOLERANCE,
        )
        if len(met):
            raise SolveError(
                f"{self.where}: {self._pair(met)} come within {met.distance[0]:.3f} m "
                f"straight above their pads, the separation is "
                f"{self.separation.distance:.3f} m; move the pads apart"
            )
        slowest = int(
            np.argmax(
                [
                    quickest_ascent(aircraft, heights[row : row + 1]).duration
                    if heights[row]
                    else 0.0
                    for row in range(heights.size)
                ]
            )
        )
        alone = quickest_ascent(aircraft, heights[slowest : slowest + 1]).duration
        witness = self._bound(aircraft, slowest, alone)
        statistics = {"drones": float(heights.size), "dual_bounds": 1.0}
        statistics |= self._airframe_bound(slowest, alone)
        certificate = Certificate(
            ascent.duration,
            min(alone, ascent.duration),
            witness.time,
            witness,
            nearest_pair(leg, flights, self.separation),
            "straight up or down, all on one profile",
            dict(sorted(statistics.items())),
        )
        return LegFlight(leg, ascent.duration, flights, certificate)

    def _bound(self, aircraft: Aircraft, row: int, guess: float) -> DualWitness:
        """Prove how long the drone in a row needs at least."""
        relaxation = Relaxation(
            aircraft.vehicle, aircraft.limits, aircraft.yaw, aircraft.heading
        )
        ends = np.stack([aircraft.end(end) for end in self.leg.ends(row)])
        way = self.leg.goal[row] - self.leg.start[row]
        return lower_bound(relaxation, row, way, guess, ends=ends)

    def _airframe_bound(self, row: int, guess: float) -> dict[str, float]:
        """Time that a drone's airframe needs at least, whatever its autopilot [s].

        What the flight takes beyond it is the most that the envelope may cost.
        """
        if self.airframe is None:
            return {}
        return {"airframe_bound": self._bound(self.airframe, row, guess).time}

    def _fixed(self, duration: float, shared: Profile | None) -> LegFlight:
        """Fly the leg in the time that the script gives; minimum times need no solving.

        The rigorous bound stands for the single-drone minimum then.
        """
        time = whole_milliseconds(duration)
        limiting = self._limiting(solve=False)
        if time < limiting.time:
            drone = int(self.leg.drones[limiting.drone])
            raise self._too_short(
                time,
                limiting.time,
                f"it is proved that drone {drone + 1} cannot make its way of "
                f"{limiting.distance:.2f} m in less under its limits",
            )
        repair = self._repair(time, shared)
        if repair.done:
            return self._finish(repair, limiting)
        trouble = repair.trouble
        least = self._shortest(self._limiting(solve=True), shared)
        raise self._too_short(time, least.duration, trouble)

    def _too_short(self, time: float, least: float, why: str) -> SolveError:
        """Say by how much the time that the script leaves is too short."""
        if self.leg.arrive is None:
            return SolveError(
                f"{self.where}: needs >= {least:.3f} s, script gives {time:.3f} s: "
                f"{why}; give it more time or leave 'duration' out"
            )
        return SolveError(
            f"{self.where}: cannot arrive at {self.leg.arrive:.3f} s of the show, "
            f"{least - time:.3f} s too early: needs >= {least:.3f} s, the script "
            f"leaves {time:.3f} s: {why}; the earliest time is "
            f"{self.leg.arrive + least - time:.3f} s, or shorten what comes before"
        )

    def _shortest(self, limiting: Limiting, shared: Profile | None) -> LegFlight:
        """Fly the leg in the least time found."""
        together = self._side_by_side(limiting, shared)
        if together is not None:
            return self._finish(together, limiting)
        best: Repair | StretchedFlights | None = None
        least, longest = self._times(limiting)
        failed, gap, slower = 0.0, self.options.gap, 0
        while best is None:
            time = whole_milliseconds(least * (1.0 + gap))
            repair = self._repair(time, shared)
            if repair.done:
                best = repair
                break
            self.progress.note(
                f"{self.leg.name}: {repair.trouble}; trying more than {time:.3f} s"
            )
            late = repair.late
            if late is not None and late not in self.shortest and slower < _SLOWER:
                # It may need longer than those that the bounds called the slowest.
                slower += 1
                limiting = self._with(limiting, late)
                least = max(least, limiting.time)
                continue
            failed = time
            if gap >= longest:
                best = self._slowly(shared)
                if best is None:
                    raise self._parted(time, limiting, repair.trouble)
            # Where that is seen early and nearly parts, the next time is near.
            nearly = 0.0 < repair.tangled < _NEARLY
            growth = _SLOWLY if nearly else _GROWTH
            gap = min(growth * gap, longest)
        lowest = 0.9 * least if self.detours else limiting.time
        best = self._narrowed(best, max(failed, lowest), limiting, shared)
        return self._finish(best, limiting)

    def _narrowed(
        self,
        best: Repair | StretchedFlights,
        failed: float,
        limiting: Limiting,
        shared: Profile | None,
    ) -> Repair | StretchedFlights:
        """Halve what lies between a time that failed [s] and the best one flown."""
        while self._may_try():
            beyond = best.duration - limiting.time
            many = self.leg.drones.size > _FOLLOWED
            part = _CLOSE_OF_MANY / self.options.effort if many else _CLOSE_SHARE
            near = max(_CLOSE * limiting.time, part * beyond)
            share = 0.5 if isinstance(best, Repair) else _BOLD
            middle = failed + share * (best.duration - failed)
            middle = whole_milliseconds(middle)
            if best.duration - failed < near or middle >= best.duration:
                break
            bent = best.bent if self.leg.drones.size <= _FOLLOWED else {}
            self.progress.note(
                f"{self.leg.name}: found {best.duration:.3f} s, "
                f"{100.0 * (best.duration / limiting.time - 1.0):.1f} % over the "
                f"least; trying {middle:.3f} s"
            )
            repair = self._repair(middle, shared, bent)
            if repair.done:
                best = repair
            else:
                failed = middle
        return best

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
        self.tried.add("minimum_time_solves")
        if not result.solved or result.trajectory is None:
            return limiting
        self.shortest[row] = result.trajectory
        if result.duration <= limiting.time:
            return limiting
        length = float(np.linalg.norm(goal[:3] - start[:3]))
        return replace(limiting, time=result.duration, drone=row, distance=length)

    def _times(self, limiting: Limiting) -> tuple[float, float]:
        """Time to begin with [s], and the share of it that may be added at most.

        Ways round the fence's corners take longer than any drone alone would.
        """
        least, longest = limiting.time, self.options.gap_limit
        for way in self.detours.values():
            least = max(least, way.estimate(self.aircraft))
        if self.detours:
            halting = max(
                way.halting_time(self.aircraft) for way in self.detours.values()
            )
            longest += 2.0 * halting / least
        return least, longest

    def _side_by_side(
        self, limiting: Limiting, shared: Profile | None
    ) -> Repair | None:
        """Where all drones make the same move, none comes nearer: no slack."""
        if shared is None:
            return None
        moves = self.leg.goal - self.leg.start
        if np.abs(moves - moves[0]).max() > _STILL:
            return None
        repair = self._repair(whole_milliseconds(limiting.time), shared)
        return repair if repair.done else None

    def _slowly(self, shared: Profile | None) -> StretchedFlights | None:
        """Look for a flight that takes its time; it bounds the search from above."""
        if shared is None:
            return None
        found = fly_ways_slowly(
            Crossing(
                self.aircraft,
                self.separation,
                self.leg.start,
                self.leg.goal,
                self.leg.others_parked,
                shared,
                np.zeros(self.leg.drones.size, dtype=bool),
            )
        )
        if found is None or self.fence is None:
            return found
        for flight in found.trajectories:
            state = flight.state
            way = state.coefficients[..., :2]
            if self.fence.first_breach(way, state.breaks) is not None:
                return None
        return found

    def _may_try(self) -> bool:
        """Whether a shorter time may be tried, by what was spent."""
        tries = self.tried.counts.get("common_times_tried", 0.0)
        return tries < self.options.effort * _TRIES and self._solves_left() > 0

    def _solves_left(self) -> int:
        """Flights behind half-spaces that may still be solved for shorter times."""
        allowed = self.options.effort * (_SOLVES + _SOLVES_EACH * self.leg.drones.size)
        return allowed - self.solves

    def _repair(
        self,
        time: float,
        shared: Profile | None,
        bent: Mapping[int, Trajectory] = _NONE,
    ) -> Repair:
        """Look for flights at a common time; ``done`` tells whether they are found."""
        move = Move(
            name=self.leg.name,
            aircraft=self.aircraft,
            separation=self.separation,
            start=self.leg.start,
            goal=self.leg.goal,
            ends=[self.leg.ends(row) for row in range(self.leg.drones.size)],
            parked=self.leg.others_parked,
            others=self.leg.others,
            names=self.leg.drones,
            shared=shared,
            detours=self.detours,
            fence=self.fence,
            rounds=self.options.repair_rounds,
            solves=max(self._solves_left(), _SOLVES),
            bent=bent,
        )
        repair = Repair(move, time, self.shortest, self.workers, self.progress)
        repair.run()
        tangled = repair.tangled
        self.tried.add("common_times_" + ("passed_over" if tangled else "tried"))
        solved = ("repair_solves", "solves_without_slack")
        self.solves += int(sum(repair.counts.get(name, 0.0) for name in solved))
        return repair

    def _finish(
        self, repair: Repair | StretchedFlights, limiting: Limiting
    ) -> LegFlight:
        trajectories = repair.trajectories
        nearest = nearest_pair(self.leg, trajectories, self.separation)
        statistics = {
            **self.tried.counts,
            **repair.counts,
            "drones": float(len(trajectories)),
            "dual_bounds": float(limiting.bounds),
            **self._airframe_bound(limiting.drone, limiting.time),
        }
        certificate = Certificate(
            repair.duration,
            min(limiting.time, repair.duration),
            limiting.witness.time,
            limiting.witness,
            nearest,
            repair.method,
            dict(sorted(statistics.items())),
        )
        return LegFlight(self.leg, repair.duration, trajectories, certificate)

    def _check_ends(self) -> None:
        """Refuse formations that break the separation or the flight volume."""
        leg, limits = self.leg, self.leg.limits
        for points, formation in (
            (leg.start, leg.from_formation),
            (leg.goal, leg.to_formation),
        ):
            outside = np.any(
                (points < np.asarray(limits.position_min) - _STILL)
                | (points > np.asarray(limits.position_max) + _STILL),
                axis=1,
            )
            if outside.any():
                drone = int(leg.drones[int(np.argmax(outside))])
                x, y, z = points[int(np.argmax(outside))]
                raise SolveError(
                    f"{self.where}: drone {drone + 1} at ({x:.2f}, {y:.2f}, {z:.2f}) m "
                    f"in {formation!r} is outside the flight volume; move the "
                    "formation or widen the volume"
                )
            if self.fence is not None and not self.fence.keeps(points[:, :2]).all():
                clearance = self.fence.clearance(points[:, :2])
                drone = int(leg.drones[int(np.argmin(clearance))])
                raise SolveError(
                    f"{self.where}: drone {drone + 1} in {formation!r} is "
                    f"{clearance.min():.2f} m within the fence, the margin is "
                    f"{self.fence.margin:.2f} m; move the formation or the fence"
                )
            still = tuple(hover(self.aircraft, point, 1.0) for point in points)
            tracks = tracks_of(still, leg.others_parked)
            found = closest(tracks, self.separation)
            if len(found) and found.distance[0] < self.separation.distance - TOLERANCE:
                raise SolveError(
                    f"{self.where}: {self._pair(found)} stand "
                    f"{found.distance[0]:.3f} m apart in {formation!r}, the separation "
                    f"is {self.separation.distance:.3f} m; spread the formation"
                )

    def _check_order(self) -> None:
        """Refuse what no flight can do: change order with all axes kept apart."""
        leg = self.leg
        if self.separation.shape != "all-axes":
            return
        found = reversed_order(leg.start, leg.goal, leg.others_parked)
        if found is None:
            return
        first, second, axis = found
        raise SolveError(
            f"{self.where}: {pair_names(leg, first, second)} stand in one order along "
            f"{'xyz'[axis]} in {leg.from_formation!r} and in the other in "
            f"{leg.to_formation!r}, but have to be {self.separation.distance:.3f} m "
            "apart along all three axes at every instant: no time is enough; let "
            "'any-axis' or 'sphere' hold, or choose another assignment"
        )

    def _pair(self, found: Encounters) -> str:
        return pair_names(self.leg, int(found.first[0]), int(found.second[0]))


def nearest_pair(
    leg: Leg, trajectories: tuple[Trajectory, ...], separation: Separation
) -> Encounter | None:
    """Return how near two drones of a leg come, at the nearest; None for one alone."""
    if len(trajectories) < 2:
        return None
    # Drones that take no part count for the separation, not for this record.
    found = closest(tracks_of(trajectories), separation)
    first, second = int(found.first[0]), int(found.second[0])
    gap = (
        trajectories[first].state(found.time)[0, :3]
        - trajectories[second].state(found.time)[0, :3]
    )
    return Encounter(
        int(leg.drones[first]),
        int(leg.drones[second]),
        float(found.time[0]),
        float(measure(gap, separation)),
    )


def place(leg: Leg) -> str:
    """Where the script asks for the leg, as ``path:line:column: name``."""
    if leg.mark is None:
        return leg.name
    return f"{leg.mark.path}:{leg.mark.line}:{leg.mark.column}: {leg.name}"


def pair_names(leg: Leg, first: int, second: int) -> str:
    """Names of two drones for people; after ``leg.drones`` come those of no part."""
    one = f"drone {int(leg.drones[first]) + 1}"
    if second < leg.drones.size:
        return f"{one} and drone {int(leg.drones[second]) + 1}"
    return f"{one} and another drone"


def _unheard(steps: int) -> None:
    """Say nothing of a single drone's progress."""
