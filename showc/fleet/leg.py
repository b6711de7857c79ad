"""One leg: the least common time of its drones, flown apart, with a certificate."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from showc.errors import SolveError
from showc.fleet.deconfliction.conflicts import Encounters, closest, conflicts
from showc.fleet.deconfliction.tracks import tracks_of
from showc.fleet.ends import TOLERANCE, check_ends, pair_names, place
from showc.fleet.lower_bound.bound import lower_bound
from showc.fleet.lower_bound.relaxation import Relaxation
from showc.fleet.motion import fly_motion
from showc.fleet.search import Found, Room, Search
from showc.fleet.shared_profile.sparing import Fleet, flown_energy, sparing_profile
from showc.fleet.single_drone.common_time import lingering
from showc.fleet.single_drone.following import hover
from showc.fleet.single_drone.model import Aircraft, in_motion
from showc.fleet.single_drone.vertical import fly_upright, quickest_ascent
from showc.flight import Certificate, DualWitness, Encounter, LegFlight, Trajectory
from showc.plan.itinerary import STILL
from showc.script.fence import Fence
from showc.script.lanes import SHORTEST_MOTION, whole_milliseconds
from showc.vehicle.metric import measure
from showc.vehicle.power import Power

if TYPE_CHECKING:
    from showc.fleet.execution.pool import Workers
    from showc.fleet.lower_bound.limiting import Limiting
    from showc.fleet.options import SolveOptions
    from showc.fleet.shared_profile.profile import Profile
    from showc.plan.itinerary import Leg
    from showc.progress import Progress
    from showc.script.show import Show
    from showc.vehicle import Separation

_WORTH = 0.02
"""Share of the slowest drone's time beyond it from which on pairs are bounded."""


def aircraft_of(show: Show, leg: Leg) -> Aircraft:
    """Return what flies on this leg, with the leg's own limits."""
    return Aircraft(show.vehicle, leg.limits, show.yaw, show.heading)


def fleet_of(show: Show, leg: Leg) -> Fleet:
    """Return what a leg's moves cost."""
    power = Power.of(show.battery, show.vehicle, show.site.altitude)
    return Fleet(aircraft_of(show, leg), power, leg.goal - leg.start)


def airframe_of(show: Show, leg: Leg) -> Aircraft | None:
    """Return the aircraft alone, without autopilot or limit of jerk; None if it is."""
    own = show.airframe_limits or (leg.limits if leg.limits.jerk else None)
    if own is None:
        return None
    limits = replace(
        leg.limits,
        level_speed=own.level_speed,
        acceleration=own.acceleration,
        acceleration_up=own.acceleration_up,
        acceleration_down=own.acceleration_down,
        jerk=0.0,
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
        self.leg, self.show = leg, show
        self.aircraft = aircraft_of(show, leg)
        self.separation: Separation = show.separation
        self.options = options
        self.workers = workers
        self.progress = progress
        self.where = place(leg)
        self.airframe = airframe_of(show, leg)
        self.fence = Fence.of(show.site)

    def solve(self) -> LegFlight:
        """Go through the stages."""
        leg = self.leg
        check_ends(leg, self.show)
        if leg.motion:
            return self._moving()
        moving = np.linalg.norm(leg.goal - leg.start, axis=1) > STILL
        # A formation of one place that turns in itself leaves its drone at a hover.
        ends = (end for row in range(leg.drones.size) for end in leg.ends(row))
        if not (moving.any() or any(map(in_motion, ends))):
            return self._hold()
        if leg.kind in {"launch", "land"}:
            return self._upright()
        search = Search(
            leg,
            self.where,
            self.aircraft,
            Room(self.separation, self.fence),
            self.options,
            self.workers,
            self.progress,
        )
        if leg.duration is not None and leg.prefer == "energy":
            return self._sparing(search, whole_milliseconds(leg.duration))
        if leg.duration is not None:
            return self._fixed(search, whole_milliseconds(leg.duration))
        return self._finish(search, *search.least())

    def _hold(self) -> LegFlight:
        asked = self.leg.duration
        duration = 0.001 if asked is None else whole_milliseconds(asked)
        trajectories = tuple(
            hover(self.aircraft, at, duration) for at in self.leg.start
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
        if wrong := moved.trouble(leg.drones):
            raise SolveError(f"{self.where}: {wrong}")
        flights = moved.trajectories
        if self.fence is not None:
            for row, flight in enumerate(flights):
                way = flight.state.coefficients[..., :2]
                time = self.fence.first_breach(way, flight.state.breaks)
                if time is not None:
                    raise SolveError(
                        f"{self.where}: drone {leg.drones[row] + 1} "
                        f"{self.fence.breach} at {time:.2f} s of its motion; make the "
                        "motion smaller, or move the formation"
                    )
        met = self._met(flights)
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
        met = self._met(flights)
        if len(met):
            raise SolveError(
                f"{self.where}: {self._pair(met)} come within {met.distance[0]:.3f} m "
                f"straight above their pads, the separation is "
                f"{self.separation.distance:.3f} m; move the pads apart"
            )
        least = [
            quickest_ascent(aircraft, heights[row : row + 1]).duration
            if heights[row]
            else 0.0
            for row in range(heights.size)
        ]
        slowest = int(np.argmax(least))
        alone = least[slowest]
        witness = self._bound(aircraft, slowest, alone)
        statistics = {"drones": float(heights.size), "dual_bounds": 1.0}
        statistics |= self._airframe_bound(slowest, alone)
        certificate = Certificate(
            ascent.duration,
            min(alone, ascent.duration),
            witness.time,
            witness if witness.time > 0.0 else None,
            nearest_pair(leg, flights, self.separation),
            "straight up or down, all on one profile",
            dict(sorted(statistics.items())),
        )
        return LegFlight(leg, ascent.duration, flights, certificate)

    def _met(self, flights: tuple[Trajectory, ...]) -> Encounters:
        """Find pairs nearer than the separation, drones that stand by among them."""
        return conflicts(
            tracks_of(flights, self.leg.others_parked),
            self.separation,
            self.separation.distance - TOLERANCE,
        )

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
        # Nothing is bounded where drones only leave, or meet, a motion on the spot.
        if self.airframe is None or guess <= 0.0:
            return {}
        return {"airframe_bound": self._bound(self.airframe, row, guess).time}

    def _sparing(self, search: Search, time: float) -> LegFlight:
        """Fly the leg in the time given with little energy; say what that saves."""
        quickest = search.shared
        if quickest is None:
            return self._fixed(search, time)
        fleet = fleet_of(self.show, self.leg)
        found = self._fixed(search, time, sparing_profile(fleet, quickest, time))
        spent = flown_energy(fleet, found.trajectories)
        waiting = max(time - quickest.duration, 0.0)
        at_once = fleet.energy(quickest) + fleet.hover * waiting
        said = {"energy": round(spent, 1), "energy_at_once": round(at_once, 1)}
        certificate = found.certificate
        counts = dict(sorted({**certificate.statistics, **said}.items()))
        return replace(found, certificate=replace(certificate, statistics=counts))

    def _fixed(
        self, search: Search, time: float, sparing: Profile | None = None
    ) -> LegFlight:
        """Fly the leg in the time that the script gives; minimum times need no solving.

        The rigorous bound stands for the single-drone minimum then.
        """
        limiting = search.limiting(solve=False)
        if time < limiting.time:
            drone = int(self.leg.drones[limiting.drone])
            why = (
                f"it is proved that drone {drone + 1} cannot make its way of "
                f"{limiting.distance:.2f} m in less under its limits"
            )
            raise self._too_short(time, "needs >=", limiting.time, why)
        repair = search.at(time, shared=sparing)
        if not repair.done and sparing is not None:
            repair = search.at(time)
        if repair.done:
            return self._finish(search, repair, limiting)
        if self.leg.others:
            # How they fly is known for this time alone.
            raise SolveError(f"{self.where}: {repair.trouble}")
        found, _ = search.least()
        if found.duration > time or self.leg.in_motion:
            needs = "no flight was found in less than"
            raise self._too_short(time, needs, found.duration, repair.trouble)
        return self._finish(search, found, limiting, time)

    def _too_short(self, time: float, needs: str, least: float, why: str) -> SolveError:
        """Say by how much the time that the script leaves is too short."""
        if self.leg.arrive is None:
            return SolveError(
                f"{self.where}: {needs} {least:.3f} s, script gives {time:.3f} s: "
                f"{why}; give it more time or leave 'duration' out"
            )
        return SolveError(
            f"{self.where}: cannot arrive at {self.leg.arrive:.3f} s of the show, "
            f"{least - time:.3f} s too early: {needs} {least:.3f} s, the script "
            f"leaves {time:.3f} s: {why}; the earliest time is "
            f"{self.leg.arrive + least - time:.3f} s, or shorten what comes before"
        )

    def _finish(
        self,
        search: Search,
        found: Found,
        limiting: Limiting,
        time: float | None = None,
    ) -> LegFlight:
        """Write down what was found; before it all wait if it takes less than a time.

        Parameters
        ----------
        time
            [s]; None: as long as the flights take.
        """
        trajectories, duration, method = found.trajectories, found.duration, ""
        if time is not None and time > duration:
            method = f"; all wait for {time - duration:.3f} s first"
            trajectories = tuple(
                lingering(self.aircraft, flight, start[:3], time, early=True)
                for flight, start in zip(trajectories, self.leg.start, strict=True)
            )
            duration = time
        nearest = nearest_pair(self.leg, trajectories, self.separation)
        statistics = {
            **search.counts,
            **found.counts,
            "drones": float(len(trajectories)),
            "dual_bounds": float(limiting.bounds),
            **self._airframe_bound(limiting.drone, limiting.time),
        }
        if self.leg.duration is None and search.effort:
            statistics |= self._passing(duration, limiting.time)
        certificate = Certificate(
            duration,
            min(limiting.time, duration),
            limiting.witness.time,
            limiting.witness if limiting.witness.time > 0.0 else None,
            nearest,
            found.method + method,
            dict(sorted(statistics.items())),
        )
        return LegFlight(self.leg, duration, trajectories, certificate)

    def _passing(self, duration: float, least: float) -> dict[str, float]:
        """Bound a time [s] by pairs that pass each other, where that tells more.

        The planner's own bound: its proof is not kept.
        """
        leg = self.leg
        apart = duration < (1.0 + _WORTH) * least or self.separation.shape == "all-axes"
        if leg.in_motion or apart:
            return {}
        # HiGHS is loaded only where something is solved.
        from showc.fleet.lower_bound.passing import passing_bound  # noqa: PLC0415

        self.progress.note(f"{leg.name}: bounding how fast pairs can pass each other")
        found = passing_bound(
            self.aircraft, self.separation, leg.start, leg.goal, duration
        )
        if found is None or found.time <= least:
            return {}
        pair = leg.drones[found.first], leg.drones[found.second]
        return {
            "passing_bound": found.time,
            "passing_drone": float(pair[0] + 1),
            "passing_other": float(pair[1] + 1),
        }

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
    one, other = (trajectories[k].state(found.time)[0, :3] for k in (first, second))
    return Encounter(
        int(leg.drones[first]),
        int(leg.drones[second]),
        float(found.time[0]),
        float(measure(one - other, separation)),
    )
