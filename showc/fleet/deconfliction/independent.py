"""The first flights at a common time: each drone on its own.

Drones that can, fly straight on the shared profile; the others follow it as near as
they can, first as splines, then by optimal control.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.deconfliction.enclosure import displacement
from showc.fleet.shared_profile.flat import keeps_limits
from showc.fleet.shared_profile.straight import fly_straight
from showc.fleet.shared_profile.synchronise import best_profile
from showc.fleet.single_drone.audit import greatest_excess
from showc.fleet.single_drone.common_time import (
    OPTIMAL,
    STRAIGHT,
    Known,
    fly_near,
    fly_smoothly,
)
from showc.fleet.single_drone.following import hover
from showc.fleet.single_drone.judgement import KEPT
from showc.fleet.single_drone.symmetry import image, kinds

if TYPE_CHECKING:
    from collections.abc import Mapping

    from showc.arrays import FloatArray, IntArray
    from showc.fleet.deconfliction.flights import Flights, Work
    from showc.fleet.shared_profile.profile import Profile
    from showc.fleet.single_drone.common_time import Outcome
    from showc.flight import Trajectory


_FEW = 32
"""Kinds of moves below which it is building programs that takes the time."""
_LIKE = 0.5
"""Difference of two displacements, over the one that is flown, up to which the other's
flight is a start for it: 34 of 36 such searches took less time, by a half."""


class Independent:
    """Finds a flight for each drone, wherever the others are.

    Parameters
    ----------
    flights
        Gets what is found.
    shortest
        Flights in least time, by row, as far as they are known.
    """

    def __init__(
        self, flights: Flights, work: Work, shortest: Mapping[int, Trajectory]
    ) -> None:
        self.flights, self.work, self.shortest = flights, work, shortest
        self.move, self.aircraft = flights.move, flights.aircraft
        self.trouble = ""
        self.late: int | None = None
        """A drone that finds no flight."""
        self.profile: Profile | None = None
        """What drones share in this time."""
        self.built = False
        """Whether all processes have built the program behind walls."""

    def run(self) -> bool:
        """Find all flights; False leaves ``trouble`` saying why not.

        Drones that are to go round a corner of the fence fly straight.
        """
        shared, duration = self.move.shared, self.flights.duration
        if shared is None:
            return self._swung()
        vehicle, heading = self.aircraft.vehicle, self.aircraft.heading
        start, goal = self.move.start, self.move.goal
        if duration >= shared.duration:
            profile = shared.stretched(duration)
        else:
            limits = self.aircraft.limits
            ways = displacement(self.aircraft, start, goal, self.move.detours)
            profile, _ = best_profile(vehicle, limits, heading, ways, duration)
        self.profile, self.flights.reference = profile, profile.derivatives()[0]
        straight = fly_straight(vehicle, heading, start, goal, profile)
        good = keeps_limits(vehicle, self.aircraft.limits, straight)
        good[list(self.move.detours)] = True
        self.flights.flown = [straight.trajectory(row) for row in range(len(start))]
        self.flights.kind = [STRAIGHT] * len(start)
        slow = np.nonzero(~good)[0]
        return not slow.size or self._slow(slow)

    def _swung(self) -> bool:
        """Each drone between ends of which some are in motion."""
        flights, move = self.flights, self.move
        rows = list(range(len(move.start)))
        flights.flown = [
            hover(self.aircraft, place, flights.duration) for place in move.goal
        ]
        flights.kind = [OPTIMAL] * len(rows)
        ways = [
            (
                self.aircraft,
                *move.ends[row],
                flights.duration,
                self.shortest.get(row),
            )
            for row in rows
        ]
        name = "solves_without_slack"
        return self._taken(
            rows, self.work.solve(name, fly_smoothly, ways, "drones in motion")
        )

    def _slow(self, rows: IntArray) -> bool:
        """Drones that cannot fly straight on the profile: one of each kind of move."""
        flights, start, goal = self.flights, self.move.start, self.move.goal
        stands, signs = kinds(self.aircraft, goal - start)
        alike: dict[tuple[float, ...], list[int]] = {}
        for row in rows.tolist():
            alike.setdefault(tuple(stands[row].tolist()), []).append(row)
        groups = [
            sorted(group, key=lambda row: (row not in self.shortest, row))
            for group in alike.values()
        ]
        # With a few kinds of move it is building programs that takes the time.
        self.built = len(groups) < _FEW and len(flights.conflicts()) > 0
        turned = stands, signs
        if not self._near([group[0] for group in groups], turned):
            return False
        broken = []
        for first, *others in groups:
            for row in others:
                mirror = signs[row] * signs[first]
                copied = image(
                    self.aircraft, flights.flown[first], mirror, start[row], goal[row]
                )
                flights.take(row, flights.kind[first], copied)
                if greatest_excess(self.aircraft, copied).relative > KEPT:
                    broken.append(row)
        return self._near(broken, turned)

    def _near(self, rows: list[int], turned: tuple[FloatArray, FloatArray]) -> bool:
        """Fly drones near the profile; ``turned`` is what :func:`kinds` returns."""
        tasks = [
            (
                self.aircraft,
                self.move.start[row],
                self.move.goal[row],
                self.flights.reference,
                self.flights.intervals,
                Known(self.shortest.get(row), self._like(row, *turned), self.built),
            )
            for row in rows
        ]
        name, title = "solves_without_slack", "drones without slack"
        return self._taken(rows, self.work.solve(name, fly_near, tasks, title))

    def _like(
        self, row: int, stands: FloatArray, signs: FloatArray
    ) -> Trajectory | None:
        """Return the known flight of least time that is nearest to a drone's move.

        It is mirrored as that move is, and begins at the origin.
        """
        others = np.array(sorted(self.shortest), dtype=np.int64)
        if row in self.shortest or not others.size:
            return None
        away = np.linalg.norm(stands[others] - stands[row], axis=1)
        if away.min() > _LIKE * np.linalg.norm(stands[row]):
            return None
        nearest = int(others[away.argmin()])
        mirror = signs[row] * signs[nearest]
        way = mirror * (self.move.goal[nearest] - self.move.start[nearest])
        flight = self.shortest[nearest]
        return image(self.aircraft, flight, mirror, np.zeros(3), way)

    def _taken(self, rows: list[int], results: list[Outcome]) -> bool:
        """Take flights of drones; False where there is none."""
        for row, (kind, flight, message) in zip(rows, results, strict=True):
            if flight is None:
                way = self.move.goal[row] - self.move.start[row]
                self.late = row
                self.trouble = (
                    f"drone {self.move.names[row] + 1} on its way of "
                    f"{float(np.linalg.norm(way)):.2f} m: {message}"
                )
                return False
            self.flights.take(row, kind, flight)
        return True
