"""All flights at one common time: independent first, then repaired until apart.

Drones that can, fly straight on the shared profile; the others follow it as near as
they can, first as splines, then by optimal control. Where pairs come too near, all
flights are changed together until they keep apart; every drone that has to change is
solved again near what came out, on its side of moving half-spaces, and again about the
outcome until no pair comes too near.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.deconfliction.changed import fly_changed
from showc.fleet.deconfliction.conflicts import conflicts
from showc.fleet.deconfliction.crowd import Allowed, Crowd, Planes, sampled
from showc.fleet.deconfliction.enclosure import Detour, fence_walls
from showc.fleet.deconfliction.tracks import tracks_of
from showc.fleet.deconfliction.untangling import untangle, untangle_near
from showc.fleet.deconfliction.walls import NODES, gathered, pair_walls
from showc.fleet.shared_profile.flat import keeps_limits
from showc.fleet.shared_profile.straight import fly_straight
from showc.fleet.shared_profile.synchronise import best_profile
from showc.fleet.single_drone.audit import greatest_excess
from showc.fleet.single_drone.convex_program import NO_WALLS, WALL_DEGREE
from showc.fleet.single_drone.following import hover
from showc.fleet.single_drone.judgement import KEPT
from showc.fleet.single_drone.model import in_motion
from showc.fleet.single_drone.staying import (
    OPTIMAL,
    SPLINE,
    STRAIGHT,
    stay_apart,
    stay_calm,
    stay_near,
)
from showc.fleet.single_drone.symmetry import image, kinds
from showc.plan.itinerary import STILL
from showc.trajectory import PiecewisePolynomial, bernstein_basis_inverse
from showc.vehicle.metric import measure

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from showc.arrays import FloatArray, IntArray
    from showc.fleet.deconfliction.changes import Untangled
    from showc.fleet.deconfliction.conflicts import Encounters
    from showc.fleet.deconfliction.walls import PairWalls
    from showc.fleet.execution.pool import Workers
    from showc.fleet.shared_profile.profile import Profile
    from showc.fleet.single_drone.single import Aircraft
    from showc.fleet.single_drone.staying import Outcome
    from showc.flight import Trajectory
    from showc.progress import Progress
    from showc.script.fence import Fence
    from showc.vehicle import Separation


TOLERANCE = 1e-7
"""How much nearer than the separation a pair may come by rounding [m]."""
_MARGIN = 2e-3
_INTERVAL = 0.15
_PATIENCE = 4
_STILL = 1e-9
_FEW = 32
"""Kinds of moves below which it is building programs that takes the time."""
_FEW_LEFT, _FALLING, _LESS = 8, 0.1, 0.8
"""Conflicts up to which every one fewer counts, and a fifth less of what they lack; of
more, a tenth has to go in half as many rounds. With this few left, single drones move
around all others."""
_DEEP = 0.1
"""Share of the separation that few conflicts may lack on average, for that to help."""
_CLEARANCE = 0.04
_STRAY = 0.02
"""How much farther from the fence walls go each time that they were not enough [m]."""
_HALTING = 3
"""Walls that were not enough, after which a drone stops at every corner."""
_ALONG = 0.8
"""How much less readily drones change along their ways: there they have no time."""
_NOT_AT_ALL, _FEW_DRONES = 10.0, 30
"""How far from parted a crowd counts whose flights did not follow their changes, and
one of few drones: with these another time costs little."""
_PRODUCTS = 5e8
"""Products of numbers in an untangling that take as long as one flight's solve."""
_LEFT = 0.5
"""Share of the distance lacking that the first flights may leave: else time is too
short."""
_HOVERING = 0.1
"""How readily a drone that hovers moves, where others cannot go round it."""
_TANGLED = ((0.35, 0.0), (0.0, 8.0), (0.03, 0.0))
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
_REACH = 2.5
"""Distance of others around which a single drone is moved, in separations."""


_Laid = tuple["IntArray", "FloatArray", "FloatArray"]
"""Walls of one drone: intervals, normals, offsets at ``NODES``."""


@dataclass(frozen=True, slots=True, eq=False)
class Move:
    """What a fleet is to fly in one common time."""

    name: str
    """For people."""
    aircraft: Aircraft
    separation: Separation
    start: FloatArray
    """Shape (n, 3) [m]."""
    goal: FloatArray
    """Shape (n, 3) [m]."""
    ends: Sequence[tuple[FloatArray, FloatArray]]
    """Start and goal of each drone: places (3,) to hover at, or states (13,)."""
    parked: FloatArray | None
    """Positions of drones that stand still and take no part, shape (m, 3) [m]."""
    names: IntArray
    """Numbers of the drones, from 0, shape (n,)."""
    shared: Profile | None
    """A profile that all drones can fly straight, however slow; None where some do not
    hover at an end."""
    detours: Mapping[int, Detour]
    """Ways of the drones, by row, that go round the fence's corners."""
    fence: Fence | None
    rounds: int
    """Rounds of half-spaces at most."""
    work: float
    """What may be done at most, as :attr:`Repair.work` counts it."""
    bent: Mapping[int, Trajectory] = field(default_factory=dict)
    """Flights, by row, that left their lines in another common time and kept apart."""
    others: Sequence[PiecewisePolynomial] = ()
    """Positions over the common time of drones that fly, and take no part."""
    most: float = np.inf
    """Pairs too near, from which on this time is not worth a search."""


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
        self.move, self.duration, self.shortest = move, duration, shortest
        self.aircraft, self.separation = move.aircraft, move.separation
        self.start, self.goal = move.start, move.goal
        standing = () if move.parked is None else move.parked
        # Positions over time of all that take no part.
        self.others = [
            *move.others,
            *(PiecewisePolynomial.constant(one, 0.0, duration) for one in standing),
        ]
        self.workers, self.progress, self.name = workers, progress, move.name
        self.names = move.names
        self.trouble = ""
        self.done = False
        # How far from parting the crowd its changes are: beyond 1 none was flown.
        self.tangled = 0.0
        # Of a drone that finds no flight, however far the others are.
        self.late: int | None = None
        self.counts: dict[str, float] = {}
        # Done so far; the unit is a flight behind half-spaces that is solved.
        self.work = 0.0
        # Of splines; of changes half as many, so that both fit together.
        self.intervals = 2 * int(np.clip(np.ceil(0.5 * duration / _INTERVAL), 10, 36))
        self.flown: list[Trajectory] = []
        self.kind: list[str] = []
        self._positions: dict[int, FloatArray] = {}
        # What a drone that leaves its line flies near to, its position over time.
        self._ways: dict[int, PiecewisePolynomial] = {}
        self._rigid: set[int] = set()
        # Whether all processes have the program behind walls from the beginning.
        self._bending = False
        # A drone that does not move hovers, and is flown around.
        self._hovers = np.linalg.norm(move.goal - move.start, axis=1) < STILL
        for row, ends in enumerate(move.ends):
            self._hovers[row] &= not any(in_motion(end) for end in ends)
        # How readily each drone is moved aside: less where it did not follow.
        self._stiff = np.ones(len(move.start))
        # In how many rounds each pair came too near all the same.
        self._often: dict[tuple[int, int], int] = {}
        # How often a drone was found outside the fence, and which were not.
        self._strayed: dict[int, int] = {}
        self._kept: set[int] = set()
        # Drones without a flight of their own yet.
        self._unfit: set[int] = set()

    @property
    def trajectories(self) -> tuple[Trajectory, ...]:
        """What was found; meaningful after :meth:`run` has succeeded."""
        return tuple(self.flown)

    @property
    def bent(self) -> dict[int, Trajectory]:
        """Flights that leave their lines, by row."""
        return {
            row: flight
            for row, (flight, kind) in enumerate(
                zip(self.flown, self.kind, strict=True)
            )
            if kind != STRAIGHT
        }

    @property
    def method(self) -> str:
        """What was done, in words."""
        parts = [
            f"{self.kind.count(kind)} {words}"
            for kind, words in (
                (STRAIGHT, "straight on the shared profile"),
                (SPLINE, "by splines"),
                (OPTIMAL, "by optimal control"),
            )
            if kind in self.kind
        ]
        text = "independent flights at a common time: " + ", ".join(parts)
        rounds = int(self.counts.get("repair_rounds", 0))
        if rounds:
            text += f"; {rounds} rounds of half-spaces"
        return text

    def run(self) -> bool:
        """Find flights that keep apart; False leaves ``trouble`` saying why not."""
        self.done = self._base() and self._apart()
        return self.done

    def _base(self) -> bool:
        """Each drone on its own."""
        aircraft, duration = self.aircraft, self.duration
        way = self.goal - self.start
        shared = self.move.shared
        if shared is None:
            return self._swung()
        if duration >= shared.duration:
            profile = shared.stretched(duration)
        else:
            profile, _ = best_profile(
                aircraft.vehicle, aircraft.limits, aircraft.heading, way, duration
            )
        flights = fly_straight(
            aircraft.vehicle, aircraft.heading, self.start, self.goal, profile
        )
        good = keeps_limits(aircraft.vehicle, aircraft.limits, flights)
        self.profile, self.reference = profile, profile.derivatives()[0]
        # Drones that go round a corner are flown behind walls, not straight: until
        # they are, what they would fly counts for nothing.
        self._unfit = set(self.move.detours)
        good[list(self._unfit)] = True
        self.flown = [flights.trajectory(row) for row in range(way.shape[0])]
        self.kind = [STRAIGHT] * way.shape[0]
        slow = np.nonzero(~good)[0]
        if slow.size and not self._slow(slow):
            return False
        if not self.move.detours:
            return True
        for row in self.move.detours:
            self._lead_round(row)
        self._bend([], {}, dict.fromkeys(self.move.detours, 0.0))
        for row in sorted(self._unfit):
            halting = self.move.detours[row].halting(self.aircraft, self.duration)
            if halting is not None:
                self._unfit.discard(row)
                self.flown[row] = halting
        if self._unfit:
            row = min(self._unfit)
            self.trouble = (
                f"drone {self.names[row] + 1} finds no flight round the fence's "
                f"corners in {self.duration:.3f} s"
            )
        return not self._unfit

    def _swung(self) -> bool:
        """Each drone on its own between ends of which some are in motion."""
        rows = list(range(len(self.start)))
        self.flown = [hover(self.aircraft, place, self.duration) for place in self.goal]
        self.kind = [OPTIMAL] * len(rows)
        return self._flown(
            rows,
            self.workers.run(
                stay_calm,
                [
                    (
                        self.aircraft,
                        *self.move.ends[row],
                        self.duration,
                        self.shortest.get(row),
                    )
                    for row in rows
                ],
                self.progress.advance,
            ),
        )

    def _slow(self, rows: IntArray) -> bool:
        """Drones that cannot fly straight on the profile: one of each kind of move."""
        stands, signs = kinds(self.aircraft, self.goal - self.start)
        alike: dict[tuple[float, ...], list[int]] = {}
        for row in rows.tolist():
            alike.setdefault(tuple(stands[row].tolist()), []).append(row)
        groups = [
            sorted(group, key=lambda row: (row not in self.shortest, row))
            for group in alike.values()
        ]
        # With a few kinds of move it is building programs that takes the time.
        bending = len(groups) < _FEW and len(self._conflicts()) > 0
        self._bending = bending
        if not self._near([group[0] for group in groups], bending=bending):
            return False
        broken = []
        for first, *others in groups:
            for row in others:
                copied = image(
                    self.aircraft,
                    self.flown[first],
                    signs[row] * signs[first],
                    self.start[row],
                    self.goal[row],
                )
                self.flown[row], self.kind[row] = copied, self.kind[first]
                if greatest_excess(self.aircraft, copied).relative > KEPT:
                    broken.append(row)
        return self._near(broken, bending=bending)

    def _near(self, rows: list[int], *, bending: bool) -> bool:
        """Fly drones near the profile, each on its own."""
        self.progress.stage(f"{self.name}: drones without slack", len(rows))
        results: list[Outcome] = self.workers.run(
            stay_near,
            [
                (
                    self.aircraft,
                    self.start[row],
                    self.goal[row],
                    self._ways.get(row, self.reference),
                    self.intervals,
                    self.shortest.get(row),
                    bending,
                )
                for row in rows
            ],
            self.progress.advance,
        )
        return self._flown(rows, results)

    def _flown(self, rows: list[int], results: list[Outcome]) -> bool:
        """Take flights of drones, each on its own; False where there is none."""
        self._count("solves_without_slack", len(rows))
        self.work += len(rows)
        for row, (kind, trajectory, message) in zip(rows, results, strict=True):
            if trajectory is None and row in self._ways:
                # Its line is flown already: half-spaces part it from the others.
                del self._ways[row]
                continue
            if trajectory is None:
                length = float(np.linalg.norm(self.goal[row] - self.start[row]))
                self.late = row
                self.trouble = (
                    f"drone {self.names[row] + 1} finds no flight of its "
                    f"{length:.2f} m in {self.duration:.3f} s: {message}"
                )
                return False
            self.flown[row], self.kind[row] = trajectory, kind
        return True

    def _push_apart(
        self, round_: int, met: Encounters, astray: Mapping[int, float]
    ) -> bool:
        """Change the flights of all drones together, and fly what comes out."""
        if self.separation.shape == "all-axes":
            # Pairs keep their order on every axis: there is no way round.
            pairs = zip(met.first.tolist(), met.second.tolist(), strict=True)
            return self._bend(list(pairs), self._often, astray)
        if round_ == 0:
            found = untangle(self._crowd(met), self._known())
        else:
            wrong = np.concatenate([met.first, met.second, list(astray)])
            found = untangle_near(self._crowd(met), np.unique(wrong.astype(np.int64)))
        self._count("untangled", 1)
        self.work += found.work / _PRODUCTS
        many = sorted(each * len(self.flown) + more for each, more in _TANGLED)[1]
        few = len(self.flown) <= _FEW_DRONES
        many = max(many, len(self.flown) if len(self.flown) <= _DOZEN else _HARDLY)
        if round_ == 0 and found.wrong > many:
            # The time is too short for this crowd: no flight of it is worth a solve.
            self.tangled = _NOT_AT_ALL if few else found.wrong / many
            return False
        least = _LEAST * self.separation.distance
        size = np.abs(found.coefficients).max(axis=(1, 2))
        rows = np.nonzero(size > least)[0]
        width = self.duration / self.intervals
        at = width * (np.arange(self.intervals)[:, None] + NODES)
        aside = found.aside(rows, at.ravel()).reshape(rows.size, *at.shape, 3)
        inverse = bernstein_basis_inverse(WALL_DEGREE, tuple(NODES))
        breaks = np.linspace(0.0, self.duration, self.intervals + 1)
        for index, row in enumerate(rows.tolist()):
            self._positions[row] = self._sampled(row) + aside[index]
            self._ways[row] = PiecewisePolynomial(
                breaks, np.einsum("ij,kja->kia", inverse, self._positions[row])
            )
        wanted = {row: self._positions[row] for row in rows.tolist()}
        # One that makes way for others is no obstacle any more.
        self._hovers[rows] = False
        near = zip(found.near[0].tolist(), found.near[1].tolist(), strict=True)
        left = self._changed(rows, found)
        busy = dict.fromkeys(left, 0.0) | dict(astray)
        done = bool(busy) and self._bend([], dict.fromkeys(near, 1), busy)
        done |= len(left) < rows.size
        for row, there in wanted.items():
            missed = np.abs(self._sampled(row) - there).max()
            if missed > _MISSED * self.separation.distance:
                self._stiff[row] *= _STIFFER
        return done

    def _changed(self, rows: IntArray, found: Untangled) -> list[int]:
        """Fly changes as they are where that keeps all limits; return other rows."""
        flat = [row for row in rows.tolist() if self.kind[row] != OPTIMAL]
        left = set(rows.tolist())
        if flat:
            change = found.curves(np.array(flat))
            flights = [self.flown[row] for row in flat]
            flown = fly_changed(self.aircraft, flights, change)
            for row, flight in zip(flat, flown, strict=True):
                if flight is not None:
                    self.flown[row], self.kind[row] = flight, SPLINE
                    self._positions.pop(row, None)
                    self._kept.discard(row)
                    left.remove(row)
        self._count("changed_in_closed_form", rows.size - len(left))
        return sorted(left)

    def _known(self) -> FloatArray | None:
        """Return changes that kept all apart at another pace, at the crowd's times."""
        if not self.move.bent:
            return None
        times = sampled(self.duration)
        known = np.zeros((len(self.flown) + len(self.others), times.size, 3))
        for row, flight in self.move.bent.items():
            pace = flight.state.end / self.duration
            there = flight.state.select(slice(0, 3))(times * pace)
            known[row] = there - self.flown[row].state.select(slice(0, 3))(times)
        return known

    def _crowd(self, found: Encounters) -> Crowd:
        """Flights of all drones as they are, for all to be changed together."""
        times = sampled(self.duration)
        state = [flight.state for flight in self.flown]
        paths = [*(one.select(slice(0, 3)) for one in state), *self.others]
        speeds = [one.select(slice(3, 6)) for one in state]
        speeds += [one.derivative() for one in self.others]
        places = np.stack([one(times) for one in paths])
        rates = np.stack([one(times) for one in speeds])
        pulls = np.stack([one.derivative()(times) for one in speeds])
        jerks = np.stack([one.derivative().derivative()(times) for one in speeds])
        way = self.goal - self.start
        length = np.linalg.norm(way, axis=1)
        ahead = way / np.maximum(length, _STILL)[:, None]
        give = np.eye(3) - _ALONG * np.einsum("na,nb->nab", ahead, ahead)
        give = self._stiff[:, None, None] * give
        give[self._hovers] *= _HOVERING
        others = len(self.others)
        return Crowd(
            places,
            rates,
            pulls,
            jerks,
            self.duration,
            self.intervals // 2,
            self.separation,
            np.concatenate([give, np.zeros((others, 3, 3))]),
            np.append(self._hovers, np.zeros(others, dtype=bool)),
            np.array([kind != OPTIMAL for kind in self.kind] + [False] * others),
            self._planes(found, times),
            self._often,
            Allowed.of(self.aircraft),
        )

    def _planes(self, found: Encounters, times: FloatArray) -> Planes:
        """Planes of the fence for drones that come too near others."""
        fence, count = self.move.fence, len(self.flown)
        rows = np.unique(np.concatenate([found.first, found.second]))
        drone, instant = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        normal, offset = [np.zeros((0, 3))], [np.zeros(0)]
        at = np.clip(times / self.duration * self.intervals, 0, self.intervals - 1)
        at = at.astype(np.int64)
        for row in rows[rows < count].tolist() if fence is not None else ():
            assert fence is not None  # noqa: S101 - the line above says so
            interval, normals, offsets = fence_walls(fence, self._sampled(row), 0.0)
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

    def _apart(self) -> bool:
        """Lay half-spaces, round after round, until no pair comes too near."""
        fewest, stalled, least, first = len(self.flown) ** 2, 0, np.inf, np.inf
        for number in range(self.move.rounds + 1):
            found, astray = self._conflicts(), self._astray()
            count = len(found) + len(astray)
            lack = float((self.separation.distance - found.distance).sum())
            if number == 0:
                first = lack
                self._count("first_conflicts", len(found))
            if not count:
                return True
            self._say(found, astray)
            if number == self.move.rounds or self._spent():
                return self._settle()
            self.progress.note(
                f"{self.name}: conflicts left: {count}, at {self.duration:.3f} s"
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
            if stalled > (_PATIENCE // 2 if many else _PATIENCE):
                return self._settle()
            self._count("repair_rounds", 1)
            for pair in zip(found.first.tolist(), found.second.tolist(), strict=True):
                self._often[pair] = self._often.get(pair, 0) + 1
            for row in astray:
                self._lead_round(row)
            if not self._push_apart(number, found, astray):
                return not self.tangled and self._settle()
        return False

    def _say(self, found: Encounters, astray: Mapping[int, float]) -> None:
        """Put what is wrong into words."""
        if not len(found):
            row = min(astray)
            margin = 0.0 if self.move.fence is None else self.move.fence.margin
            self.trouble = (
                f"drone {self.names[row] + 1} comes nearer than {margin:.2f} m to the "
                f"fence at {astray[row]:.2f} s ({len(astray)} drones in all)"
            )
            return
        worst = int(np.argmin(found.distance))
        pair = int(found.first[worst]), int(found.second[worst])
        self.trouble = (
            f"{self._names(*pair)} come within {found.distance[worst]:.3f} m "
            f"at {found.time[worst]:.2f} s, the separation is "
            f"{self.separation.distance:.3f} m ({len(found)} pairs in all)"
        )

    def _astray(self) -> dict[int, float]:
        """Rows of drones outside the fence's margin, and when that is found [s]."""
        fence = self.move.fence
        found: dict[int, float] = {}
        if fence is None:
            return found
        for row, flight in enumerate(self.flown):
            if row in self._kept:
                continue
            state = flight.state
            time = fence.first_breach(state.coefficients[..., :2], state.breaks)
            if time is None:
                self._kept.add(row)
            else:
                found[row] = time
                self._strayed[row] = self._strayed.get(row, 0) + 1
        return found

    def _lead_round(self, row: int) -> None:
        """Take a drone that leaves the fence back to a way that does not."""
        if self.move.shared is None:
            # Half-spaces of the fence alone keep a swing within it.
            return
        around = self.move.detours.get(row)
        if around is None:
            around = Detour(np.stack([self.start[row], self.goal[row]]))
        reference = around.reference(self.aircraft, self.profile, self.intervals)
        width = self.duration / self.intervals
        at = width * (np.arange(self.intervals)[:, None] + NODES)
        self._ways[row] = reference
        self._positions[row] = reference(at)

    def _halting(self, row: int) -> Outcome | None:
        """Stop at every corner, as a last resort, where walls were not enough."""
        if self._strayed.get(row, 0) < _HALTING or row not in self.move.detours:
            return None
        flight = self.move.detours[row].halting(self.aircraft, self.duration)
        return None if flight is None else (STRAIGHT, flight, "")

    def _spent(self) -> bool:
        """Whether as much was solved as may be."""
        return self.work >= self.move.work

    def _settle(self) -> bool:
        """Move one drone at a time, around all that are near it, while that helps.

        Where both drones of a pair move at once, each into others that move as well,
        rounds can go on for ever; here what is lacking falls with every change.
        """
        for tries in range(1, _SETTLING + 1):
            found = self._conflicts()
            if not len(found):
                return not self._astray()
            changed = False
            lack = self.separation.distance - found.distance
            deep = float(lack.mean()) > _DEEP * self.separation.distance
            if len(found) > _FEW_LEFT or deep or self._spent():
                return False
            for number in np.argsort(found.distance, kind="stable").tolist():
                pair = int(found.first[number]), int(found.second[number])
                changed |= any(self._around_others(row, tries) for row in pair)
            if not changed and tries == _SETTLING:
                return False
        return not len(self._conflicts()) and not self._astray()

    def _around_others(self, row: int, tries: int) -> bool:
        """Solve one drone around all others as they fly; whether that is better."""
        if row >= len(self.flown) or self._hovers[row]:
            return False
        own = self._sampled(row)
        everyone = len(self.flown) + len(self.others)
        near = [
            other
            for other in range(everyone)
            if other != row
            and measure(own - self._sampled(other), self.separation).min()
            < _REACH * self.separation.distance
        ]
        before = self._lack(self.flown[row], near)
        if before == 0.0:
            return False
        walls = [
            pair_walls(
                own,
                self._sampled(other),
                self.separation,
                1.0,
                _MARGIN * 3**tries,
                tries - 1,
            )
            for other in near
        ]
        laid = [(one.interval, one.normal, one.first) for one in walls]
        if self.move.fence is not None:
            laid.append(fence_walls(self.move.fence, own, _STRAY))
        task = (
            self.aircraft,
            *self.move.ends[row],
            self._way(row),
            self.intervals,
            gathered([part for part in laid if part[0].size]),
            own,
            _CLEARANCE * self.separation.distance * tries,
            self.flown[row] if self.kind[row] == OPTIMAL else None,
            False,
        )
        ((kind, trajectory, _),) = self.workers.run(stay_apart, [task], _unheard)
        self._count("repair_solves", 1)
        self.work += 1
        if trajectory is None or self._lack(trajectory, near) >= before:
            return False
        self._kept.discard(row)
        self.flown[row], self.kind[row] = trajectory, kind
        self._positions.pop(row, None)
        return True

    def _lack(self, flight: Trajectory, near: list[int]) -> float:
        """Sum of what a flight's distances to some drones lack [m]."""
        others = [self.flown[row] for row in near if row < len(self.flown)]
        found = conflicts(
            tracks_of([flight, *others], others=self.others),
            self.separation,
            self.separation.distance - TOLERANCE,
        )
        own = found.distance[found.first == 0]
        return float(np.sum(self.separation.distance - own))

    def _conflicts(self) -> Encounters:
        return conflicts(
            tracks_of(self.flown, others=self.others),
            self.separation,
            self.separation.distance - TOLERANCE,
        )

    def _bend(
        self,
        pairs: Sequence[tuple[int, int]],
        active: Mapping[tuple[int, int], int],
        astray: Mapping[int, float],
    ) -> bool:
        """Solve drones again, behind the walls of all active pairs and of the fence.

        Parameters
        ----------
        pairs
            Pairs that come too near.
        active
            All pairs that did, and how often.
        astray
            Rows of drones that left the fence.
        """
        count = len(self.flown)
        busy = sorted(
            {
                row
                for pair in pairs
                for row in pair
                if row < count and not self._hovers[row]
            }
            | set(astray)
        )
        walls, tried = self._walls(busy, active)
        self.progress.stage(f"{self.name}: repair", len(busy))
        results: list[Outcome] = self.workers.run(
            stay_apart,
            [
                (
                    self.aircraft,
                    *self.move.ends[row],
                    self._way(row),
                    self.intervals,
                    gathered(walls[row]) if walls[row] else NO_WALLS,
                    self._sampled(row),
                    _CLEARANCE * self.separation.distance * tried[row],
                    self.flown[row] if self.kind[row] == OPTIMAL else None,
                    tried[row] == 1 and not self._bending,
                )
                for row in busy
            ],
            self.progress.advance,
        )
        self._count("repair_solves", len(busy))
        self.work += len(busy)
        changed = False
        self._rigid.clear()
        for row, outcome in zip(busy, results, strict=True):
            kind, trajectory, _ = self._halting(row) or outcome
            self._positions.pop(row, None)
            self._kept.discard(row)
            if trajectory is None:
                # It stays as it is; its partners take the whole correction next.
                self._rigid.add(row)
                continue
            changed = True
            self._unfit.discard(row)
            self.flown[row] = trajectory
            self.kind[row] = kind
        return changed

    def _walls(
        self, busy: Sequence[int], active: Mapping[tuple[int, int], int]
    ) -> tuple[dict[int, list[_Laid]], dict[int, int]]:
        """Lay the walls of drones that are solved again, and count their tries."""
        walls: dict[int, list[_Laid]] = {row: [] for row in busy}
        tried = dict.fromkeys(busy, 1)
        fence = self.move.fence
        for row in busy if fence is not None else ():
            assert fence is not None  # noqa: S101 - the line above says so
            again = self._strayed.get(row, 0)
            tried[row] = max(tried[row], again)
            extra = _STRAY * max(again - 1, 0)
            laid = fence_walls(fence, self._sampled(row), extra)
            if laid[0].size:
                walls[row].append(laid)
        for (first, second), tries in active.items():
            for row in {first, second} & walls.keys():
                tried[row] = max(tried[row], tries)
            if first not in walls and second not in walls:
                continue
            found = self._pair_walls(first, second, tries)
            if first in walls and found.interval.size:
                walls[first].append((found.interval, found.normal, found.first))
            if second in walls and found.interval.size:
                walls[second].append((found.interval, -found.normal, found.second))
        return walls, tried

    def _pair_walls(self, first: int, second: int, tries: int) -> PairWalls:
        count = len(self.flown)
        stuck = [row >= count or row in self._rigid for row in (first, second)]
        hovering = [row >= count or self._hovers[row] for row in (first, second)]
        if hovering[0] != hovering[1]:
            stuck = hovering
        share = 0.5 if stuck[0] == stuck[1] else float(stuck[1])
        return pair_walls(
            self._sampled(first),
            self._sampled(second),
            self.separation,
            share,
            _MARGIN * min(tries, 25),
            tries - 1,
        )

    def _way(self, row: int) -> PiecewisePolynomial:
        """Return what a drone that leaves its line flies near to."""
        if row in self._ways:
            return self._ways[row]
        if self.move.shared is not None:
            return self.reference
        breaks = np.linspace(0.0, self.duration, self.intervals + 1)
        inverse = bernstein_basis_inverse(WALL_DEGREE, tuple(NODES))
        way = np.einsum("ij,kja->kia", inverse, self._sampled(row))
        self._ways[row] = PiecewisePolynomial(breaks, way)
        return self._ways[row]

    def _sampled(self, row: int) -> FloatArray:
        """Positions at the nodes of the spline's intervals, shape (K, 7, 3)."""
        if row not in self._positions:
            width = self.duration / self.intervals
            at = width * (np.arange(self.intervals)[:, None] + NODES)
            if row < len(self.flown):
                position = self.flown[row].state.select(slice(0, 3))(at)
            else:
                position = self.others[row - len(self.flown)](at)
            self._positions[row] = position
        return self._positions[row]

    def _names(self, first: int, second: int) -> str:
        if second >= len(self.flown):
            return f"drone {self.names[first] + 1} and another drone"
        return f"drones {self.names[first] + 1} and {self.names[second] + 1}"

    def _count(self, name: str, value: float) -> None:
        self.counts[name] = self.counts.get(name, 0.0) + value


def _unheard(steps: int) -> None:
    """Say nothing of a single drone's progress."""
