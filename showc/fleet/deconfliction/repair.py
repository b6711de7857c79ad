"""Repair: independent flights at one common time, changed until they keep apart.

Where pairs come too near, all flights are changed together; every drone that has to
change is solved again near what came out, on its side of moving half-spaces. That is
repeated about the outcome until no pair comes too near.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.deconfliction.bending import Bending
from showc.fleet.deconfliction.changed import fly_changed
from showc.fleet.deconfliction.crowd import Allowed, Crowd, Planes, sampled
from showc.fleet.deconfliction.enclosure import Detour, fence_walls
from showc.fleet.deconfliction.flights import Flights, Ways, Work
from showc.fleet.deconfliction.independent import Independent
from showc.fleet.deconfliction.untangling import (
    OF_MANY,
    SOON,
    hopeless,
    quickest,
    untangle,
    untangle_near,
)
from showc.fleet.deconfliction.walls import interpolated
from showc.fleet.single_drone.common_time import OPTIMAL, SPLINE, STRAIGHT
from showc.trajectory import evaluated

if TYPE_CHECKING:
    from collections.abc import Mapping

    from showc.arrays import FloatArray, IntArray
    from showc.fleet.deconfliction.changes import Untangled
    from showc.fleet.deconfliction.conflicts import Encounters
    from showc.fleet.deconfliction.flights import Move
    from showc.fleet.execution.pool import Workers
    from showc.flight import Trajectory
    from showc.progress import Progress
    from showc.trajectory import PiecewisePolynomial


_PATIENCE = 4
"""Rounds in which nothing gets better, after which single drones are moved."""
_STILL = 1e-9
"""Length of a way that has no direction [m]."""
_FEW_LEFT, _FALLING, _LESS = 8, 0.1, 0.8
"""Conflicts up to which every one fewer counts, and a fifth less of what they lack; of
more, a tenth has to go in half as many rounds. Few are left to single drones, which
move around all others while that fifth goes."""
_SOME, _DEEP, _SLIGHT = 24, 0.1, 0.01
"""Conflicts up to which few drones settle one by one (more drones: ``_FEW_LEFT``),
share of the separation that they may lack on average, and share up to which drones
settle before another round of all."""
_EACH = 3
"""Instants on each interval of a change, for few drones: with fewer, changes break
limits between them. More drones have no time for it, and their changes are seldom that
short."""
_ALONG = 0.8
"""How much less readily drones change along their ways: there they have no time."""
_NOT_AT_ALL, _FEW_DRONES = 10.0, 30
"""How far from parted a crowd counts whose flights did not follow their changes, and
one of few drones: with these another time costs little."""
_LEFT = 0.5
"""Share of the distance lacking that the first flights may leave: else time is too
short."""
_HOVERING = 0.1
"""How readily a drone that hovers moves, where others cannot go round it."""
_TANGLED = ((0.35, 0.0), (0.0, 8.0), (OF_MANY, 0.0))
"""Pairs too near and drones beyond limits after all changes, from which on no change is
flown: for each drone, and besides. The middle one of these is meant."""
_HARDLY, _DOZEN = 2.0, 12
"""What may be wrong with any crowd all the same; and drones of which each may be wrong:
to fly them takes no longer than to look for better ways."""
_LEAST = 1e-3
"""Changes, over the separation, below which a flight stays as it is."""
_MISSED, _STIFFER = 0.05, 0.6
"""How far a flight may miss its change, in separations, and how much less readily the
drone is moved from then on if it does."""
_SETTLING = 4
"""Rounds in which single drones move around all others."""


class Repair:
    """Flights of all drones over one common time.

    Parameters
    ----------
    move
        What is to be flown.
    duration
        The common time [s].
    shortest
        Flights in least time, by row, as far as they are known.
    """

    def __init__(
        self,
        move: Move,
        duration: float,
        shortest: Mapping[int, Trajectory],
        workers: Workers,
        progress: Progress,
    ) -> None:
        self.move, self.duration = move, duration
        self.separation = move.separation
        self.flights = Flights(move, duration)
        self.made = Work(move.name, workers, progress)
        self._alone = Independent(self.flights, self.made, shortest)
        self.trouble = ""
        self.done = False
        self.tangled = 0.0
        """How far from parting the crowd its changes are: beyond 1 none was flown."""
        self.crowd: Crowd | None = None
        """What is first changed together."""
        self.soonest: Untangled | None = None
        """What parts it sooner than any other change, if that takes more time."""
        self._first: list[PiecewisePolynomial] = []
        """Positions and velocities of the flights in it."""
        self._ways = {} if move.known is None else move.known.bent
        self._slowed: dict[int, PiecewisePolynomial] = {}
        """Slowed flights, by row, that stand for those flown until they are changed."""
        self._stiff = np.ones(len(move.start))
        """How readily each drone is moved aside: less where it did not follow."""
        self._often: dict[tuple[int, int], int] = {}
        """In how many rounds each pair came too near all the same."""
        self._settled = np.inf
        """What pairs lacked at least after single drones had moved [m]."""

    @property
    def trajectories(self) -> tuple[Trajectory, ...]:
        """What was found; meaningful after :meth:`run` has succeeded."""
        return tuple(self.flights.flown)

    @property
    def ways(self) -> Ways:
        """Ways that leave their lines."""
        known = self._sooner
        return Ways(self.flights.bent, self._first if known is None else known.alone)

    @property
    def late(self) -> int | None:
        """A drone that finds no flight, however far the others are."""
        return self._alone.late

    @property
    def counts(self) -> dict[str, float]:
        """How often what was done, by name."""
        return self.made.counts

    @property
    def work(self) -> float:
        """What was done; the unit is a flight behind half-spaces that is solved."""
        return self.made.done

    @property
    def method(self) -> str:
        """What was done, in words."""
        text = f"independent flights at a common time: {self.flights.said}"
        rounds = int(self.counts.get("repair_rounds", 0))
        return text + (f"; {rounds} rounds of half-spaces" if rounds else "")

    def run(self) -> bool:
        """Find flights that keep apart; False leaves ``trouble`` saying why not."""
        if self._alone.run():
            self._bending = Bending(self.flights, self.made, built=self._alone.built)
            self.done = self._round_corners() and self._apart()
        else:
            self.trouble = self._alone.trouble
        return self.done

    def _round_corners(self) -> bool:
        """Lead drones round the corners of the fence that are on their lines."""
        detours, flights = self.move.detours, self.flights
        if not detours or self.move.shared is None:
            return True
        for row in detours:
            known = self._ways.get(row)
            if known is None:
                self._lead_round(row)
                continue
            # A way that kept apart at another pace, all others at theirs.
            at = flights.nodes
            places = known(at.ravel() * (known.end / self.duration))
            places = places.reshape(*at.shape, 3)
            flights.aim(row, places, interpolated(places, self.duration))
        self._bending.bend([], {}, dict.fromkeys(detours, 0.0))
        for row in sorted(row for row in detours if flights.kind[row] == STRAIGHT):
            halting = detours[row].halting(self.move.aircraft, self.duration)
            if halting is None:
                self.trouble = (
                    f"drone {self.move.names[row] + 1} finds no flight round the "
                    f"fence's corners in {self.duration:.3f} s"
                )
                return False
            flights.take(row, STRAIGHT, halting)
        return True

    def _apart(self) -> bool:
        """Lay half-spaces, round after round, until no pair comes too near."""
        fewest, stalled = len(self.flights.flown) ** 2, 0
        least = first = np.inf
        for number in range(self.move.rounds + 1):
            found, astray = self.flights.conflicts(), self.flights.astray()
            count, lack = len(found) + len(astray), self.flights.lacking(found)
            if number == 0:
                first = lack
                self.made.count("first_conflicts", len(found))
            slight = lack < _SLIGHT * self.separation.distance * count
            settles = number and slight and self.flights.few and count <= _SOME
            if not count or (settles and self._settle()):
                return True
            self.trouble = self.flights.wrong(found, astray)
            if number == self.move.rounds or self._spent():
                return self._settle()
            self.made.progress.note(
                f"{self.move.name}: conflicts left at {self.duration:.3f} s: {count}"
            )
            many = count > _FEW_LEFT
            most = (self.move.most, np.inf)[min(number, 1)]
            if len(found) > most or (number == 1 and many and lack > _LEFT * first):
                self.tangled = _NOT_AT_ALL
                return False
            wanted = (1.0 - _FALLING) * fewest if many else fewest - 1
            better = count <= wanted or (not many and lack < _LESS * least)
            stalled = 0 if better else stalled + 1
            fewest, least = min(fewest, count), min(least, lack)
            vain = settles and not self._gains()
            if vain or stalled > (_PATIENCE // 2 if many else _PATIENCE):
                return not vain and self._settle()
            self.made.count("repair_rounds")
            for pair in zip(found.first.tolist(), found.second.tolist(), strict=True):
                self._often[pair] = self._often.get(pair, 0) + 1
            for row in astray:
                self._lead_round(row)
            if not self._push_apart(number, found, astray):
                return not self.tangled and self._settle()
        return False

    def _lead_round(self, row: int) -> None:
        """Take a drone that leaves the fence back to a way that does not."""
        if self.move.shared is None:
            # Half-spaces of the fence alone keep a swing within it.
            return
        flights, move = self.flights, self.move
        around = move.detours.get(row)
        if around is None:
            around = Detour(np.stack([move.start[row], move.goal[row]]))
        profile = self._alone.profile
        assert profile is not None  # noqa: S101 - what is shared has one
        way = around.reference(move.aircraft, profile, flights.intervals)
        flights.aim(row, way(flights.nodes), way)

    def _push_apart(
        self, round_: int, met: Encounters, astray: Mapping[int, float]
    ) -> bool:
        """Change the flights of all drones together, and fly what comes out."""
        if self.separation.shape == "all-axes":
            # Pairs keep their order on every axis: there is no way round.
            pairs = zip(met.first.tolist(), met.second.tolist(), strict=True)
            return self._bending.bend(list(pairs), self._often, astray)
        if round_ == 0:
            self._first = self._begin()
            self.crowd = self._crowd(met)
            found = self._changed_together(self.crowd)
        else:
            wrong = np.concatenate([met.first, met.second, list(astray)])
            rows = np.unique(wrong.astype(np.int64))
            found = self.made.untangle(untangle_near, self._crowd(met), rows)
        flights, count = self.flights, len(self.flights.flown)
        many = sorted(each * count + more for each, more in _TANGLED)[1]
        many = max(many, count if count <= _DOZEN else _HARDLY)
        if found.duration > (1.0 + SOON) * self.duration:
            self.soonest, self.tangled = found, _NOT_AT_ALL
            return False
        if round_ == 0 and found.wrong > many:
            # The time is too short for this crowd: no flight of it is worth a solve.
            self.tangled = _NOT_AT_ALL if count <= _FEW_DRONES else found.wrong / many
            return False
        least = _LEAST * self.separation.distance
        size = np.abs(found.coefficients).max(axis=(1, 2))
        slowed = np.array([*self._slowed], dtype=np.int64)
        rows = np.union1d(np.nonzero(size > least)[0], slowed)
        at = flights.nodes
        aside = found.aside(rows, at.ravel()).reshape(rows.size, *at.shape, 3)
        wanted = {}
        for index, row in enumerate(rows.tolist()):
            wanted[row] = flights.sampled(row) + aside[index]
            flights.aim(row, wanted[row], interpolated(wanted[row], self.duration))
        # One that makes way for others is no obstacle any more.
        flights.hovers[rows] = False
        near = zip(found.near[0].tolist(), found.near[1].tolist(), strict=True)
        left = self._changed(rows, found)
        self._slowed.clear()
        busy = dict.fromkeys(left, 0.0) | dict(astray)
        if self.move.draft and len(busy) > self.move.work:
            self.tangled = _NOT_AT_ALL
            return False
        done = bool(busy) and self._bending.bend([], dict.fromkeys(near, 1), busy)
        done |= len(left) < rows.size
        for row, there in wanted.items():
            missed = np.abs(flights.sampled(row) - there).max()
            if missed > _MISSED * self.separation.distance:
                self._stiff[row] *= _STIFFER
                # In a great crowd they are better changed again: many more follow
                # together than one by one around what others left.
                if flights.few:
                    self._bending.missed.add(row)
        return done

    def _changed_together(self, crowd: Crowd) -> Untangled:
        """Change all flights at once, in more time where that is what it takes."""
        known = self._known()
        free = self.move.free and known is None
        onward = free and not self.move.draft
        task = partial(untangle, free=free, onward=onward)
        found = self.made.untangle(task, crowd, known)
        if onward and hopeless(found):
            found = self.made.worked(quickest(crowd, self.made.workers, found))
        return found

    def led(self, found: Untangled) -> Ways:
        """Ways to which changes of the first crowd lead, in their time."""
        rows = np.arange(len(self._first))
        at = self.flights.nodes
        later = at * (found.duration / self.duration)
        aside = found.aside(rows, later.ravel()).reshape(rows.size, *at.shape, 3)
        places = evaluated(self._first, at)[..., :3] + aside
        ways = [interpolated(one, found.duration) for one in places]
        return Ways(dict(enumerate(ways)), self._first)

    def _begin(self) -> list[PiecewisePolynomial]:
        """Positions and velocities of what is first changed.

        Where ways are known that take less time, the flights from which they were
        changed, as much slower: flights of this time differ from them by more
        than smooth changes. Drones that go round corners follow their ways already.
        """
        known, flights = self._sooner, self.flights
        if known is None:
            return self._now()
        at = flights.nodes
        for row in range(len(flights.flown)):
            if row in self.move.detours:
                continue
            slowed = known.slowed(row, self.duration)
            way = slowed.select(slice(0, 3))
            there = way(at.ravel()).reshape(*at.shape, 3)
            missed = np.abs(there - flights.sampled(row)).max()
            if missed > _LEAST * self.separation.distance:
                self._slowed[row] = slowed
                flights.aim(row, there, way)
        return self._now()

    @property
    def _sooner(self) -> Ways | None:
        """Ways that are known with the flights they come from, if these take less."""
        known = self.move.known
        if known is None or not known.alone or known.alone[0].end > self.duration:
            return None
        return known

    def _now(self) -> list[PiecewisePolynomial]:
        """Positions and velocities of all flights as they are, or slowed."""
        flown = [flight.state.select(slice(0, 6)) for flight in self.flights.flown]
        return [self._slowed.get(row, one) for row, one in enumerate(flown)]

    def _changed(self, rows: IntArray, found: Untangled) -> list[int]:
        """Fly changes as they are where that keeps all limits; return other rows."""
        flights = self.flights
        flat = [row for row in rows.tolist() if flights.kind[row] != OPTIMAL]
        left = set(rows.tolist())
        if flat:
            change = found.curves(np.array(flat))
            now = self._now()
            flown = fly_changed(self.move.aircraft, [now[row] for row in flat], change)
            for row, flight in zip(flat, flown, strict=True):
                if flight is not None:
                    flights.take(row, SPLINE, flight)
                    left.remove(row)
        self.made.count("changed_in_closed_form", rows.size - len(left))
        return sorted(left)

    def _known(self) -> FloatArray | None:
        """Return changes that kept all apart at another pace, at the crowd's times.

        Drones that go round corners follow those ways already.
        """
        bent = {
            row: way for row, way in self._ways.items() if row not in self.move.detours
        }
        if not bent:
            return None
        times = self._instants()
        flown, others = self.flights.flown, self.flights.others
        known = np.zeros((len(flown) + len(others), times.size, 3))
        for row, way in bent.items():
            alone = self._first[row](times)[:, :3]
            known[row] = way(times * (way.end / self.duration)) - alone
        return known

    def _instants(self) -> FloatArray:
        """Instants at which the crowd is looked at, shape (m,) [s]."""
        flights = self.flights
        return sampled(self.duration, _EACH * flights.changes if flights.few else 0)

    def _crowd(self, found: Encounters) -> Crowd:
        """Flights of all drones as they are, for all to be changed together."""
        flights, move = self.flights, self.move
        others, times = flights.others, self._instants()
        state = self._now()
        paths = [*(one.select(slice(0, 3)) for one in state), *others]
        speeds = [one.select(slice(3, 6)) for one in state]
        speeds += [one.derivative() for one in others]
        pulls = [one.derivative() for one in speeds]
        jerks = [one.derivative() for one in pulls]
        way = move.goal - move.start
        length = np.linalg.norm(way, axis=1)
        ahead = way / np.maximum(length, _STILL)[:, None]
        give = np.eye(3) - _ALONG * np.einsum("na,nb->nab", ahead, ahead)
        give = self._stiff[:, None, None] * give
        give[flights.hovers] *= _HOVERING
        still = np.zeros(len(others), dtype=bool)
        supple = np.array([kind != OPTIMAL for kind in flights.kind])
        return Crowd(
            times,
            evaluated(paths, times),
            evaluated(speeds, times),
            evaluated(pulls, times),
            evaluated(jerks, times),
            self.duration,
            flights.changes,
            self.separation,
            np.concatenate([give, np.zeros((len(others), 3, 3))]),
            np.append(flights.hovers, still),
            np.append(supple, still),
            self._planes(found, times),
            self._often,
            Allowed.of(move.aircraft),
        )

    def _planes(self, found: Encounters, times: FloatArray) -> Planes:
        """Planes of the fence for drones that come too near others."""
        flights, fence, count = self.flights, self.move.fence, len(self.flights.flown)
        rows = np.unique(np.concatenate([found.first, found.second]))
        drone, instant = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        normal, offset = [np.zeros((0, 3))], [np.zeros(0)]
        intervals = flights.intervals
        at = np.clip(times / self.duration * intervals, 0, intervals - 1)
        at = at.astype(np.int64)
        for row in rows[rows < count].tolist() if fence is not None else ():
            assert fence is not None  # noqa: S101 - the line above says so
            interval, normals, offsets = fence_walls(fence, flights.sampled(row), 0.0)
            plane, sample = np.nonzero(interval[:, None] == at)
            drone.append(np.full(plane.size, row))
            instant.append(sample)
            normal.append(normals[plane, 0])
            offset.append(offsets[plane, 0])
        return Planes(
            np.concatenate(drone),
            np.concatenate(instant),
            np.concatenate(normal),
            np.concatenate(offset),
        )

    def _gains(self) -> bool:
        """Whether single drones left pairs lacking less than they ever did before."""
        lack = self.flights.lacking(self.flights.conflicts())
        before, self._settled = self._settled, min(self._settled, lack)
        return lack < _LESS * before

    def _spent(self) -> bool:
        """Whether as much was solved as may be."""
        return self.work >= self.move.work

    def _settle(self) -> bool:
        """Move one drone at a time, around all that are near it, while that helps.

        Where both drones of a pair move at once, each into others that move as well,
        rounds can go on for ever; here what is lacking falls with every change.
        """
        for tries in range(1, _SETTLING + 1):
            found = self.flights.conflicts()
            if not len(found):
                return not self.flights.astray()
            lack = self.separation.distance - found.distance
            deep = float(lack.mean()) > _DEEP * self.separation.distance
            some = _SOME if self.flights.few else _FEW_LEFT
            if len(found) > some or deep or self._spent():
                return False
            if not self._bending.one_by_one(found, tries) and tries == _SETTLING:
                return False
        return not len(self.flights.conflicts()) and not self.flights.astray()
