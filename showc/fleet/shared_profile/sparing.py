"""The shared profile that costs a fleet the least energy, and how long to take.

By the model of :mod:`showc.vehicle.power`: waiting costs what hovering costs, so that a
slow move saves what speed, climbing fast and leaning cost beyond that. Candidates are
the shapes of :mod:`showc.fleet.shared_profile.synchronise` over several times.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.shared_profile.profile import Profile
from showc.fleet.shared_profile.synchronise import SHAPES, proved, uses

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import FloatArray
    from showc.fleet.single_drone.model import Aircraft
    from showc.flight import Trajectory
    from showc.vehicle.power import Power

_TRIED = SHAPES[::3]
"""Shapes tried, (m, 2)."""
_SAMPLE = 16
"""Moves, of all lengths, by which shapes and times are compared."""
_TIMES = 9
"""Times tried between the quickest and the longest."""
_PROOFS = 4
"""Shapes that are proved for the whole fleet at most."""
_NODES, _WEIGHTS = (0.5 * part for part in np.polynomial.legendre.leggauss(3))


@dataclass(frozen=True, slots=True, eq=False)
class Fleet:
    """Moves of a fleet that are to cost little."""

    aircraft: Aircraft
    power: Power
    """What its rotors take."""
    displacement: FloatArray
    """Shape (n, 3) [m]."""

    @property
    def hover(self) -> float:
        """Power of all drones that hover [W]."""
        return len(self.displacement) * self.power.hover(self.aircraft.vehicle)

    def energy(self, profile: Profile) -> float:
        """Energy of straight flights along a profile [J]."""
        course = _course(
            profile.phase / profile.duration, profile.ramp / profile.duration
        )
        return float(self._energies(profile.duration, *course[None].swapaxes(0, 1))[0])

    def sample(self) -> Fleet:
        """Return a fleet of a few of the moves, the longest among them."""
        order = np.argsort(np.linalg.norm(self.displacement, axis=1), kind="stable")
        chosen = order[::-1][:: max(len(order) // _SAMPLE, 1)]
        return Fleet(self.aircraft, self.power, self.displacement[chosen])

    def candidates(self, duration: float) -> tuple[FloatArray, FloatArray]:
        """Return shapes (k, 2) that keep all limits, and energies (k,) [J], rising."""
        craft = self.aircraft
        used = uses(
            craft.vehicle,
            craft.limits,
            craft.heading,
            self.displacement,
            duration,
            _TRIED,
        )
        kept = np.flatnonzero(used.max(axis=0) <= 1.0)
        energy = self._energies(duration, *_courses()[:, kept])
        order = np.argsort(energy, kind="stable")
        return _TRIED[kept[order]], energy[order]

    def _energies(
        self, duration: float, rate: FloatArray, push: FloatArray, weight: FloatArray
    ) -> FloatArray:
        """Energies of courses: s', s'' and weights, each (m, nodes); shape (m,) [J]."""
        vehicle = self.aircraft.vehicle
        way = self.displacement[:, None, None, :]
        thrust = way * (push / duration**2)[None, ..., None]
        thrust[..., 2] += vehicle.gravity
        size = np.linalg.norm(thrust, axis=-1)
        climb = np.sum(thrust * way, axis=-1) / size * (rate / duration)
        rotor = np.repeat((0.25 * vehicle.mass * size)[..., None], 4, axis=-1)
        drawn = self.power(rotor, climb) * (weight * duration)
        return np.asarray(drawn.sum(axis=(0, 2)))


def _course(phase: float, ramp: float) -> FloatArray:
    """Return s', s'' and weights at the nodes of a profile over 1 s, (3, nodes)."""
    _, rate, push = Profile(1.0, phase, ramp).derivatives()
    width = np.diff(rate.breaks)
    at = (rate.breaks[:-1, None] + width[:, None] * (0.5 + _NODES)).ravel()
    weight = (width[:, None] * _WEIGHTS).ravel()
    return np.stack([rate(at)[:, 0], push(at)[:, 0], weight])


@lru_cache(maxsize=1)
def _courses() -> FloatArray:
    """Courses of the shapes tried, (3, m, nodes); short ones end in nothing."""
    each = [_course(float(phase), float(ramp)) for phase, ramp in _TRIED]
    found = np.zeros((3, len(each), max(one.shape[1] for one in each)))
    for row, one in enumerate(each):
        found[:, row, : one.shape[1]] = one
    return found


def sparing_time(fleet: Fleet, quickest: Profile, room: float) -> float:
    """Return how long a move takes that costs the least, with the hover before it [s].

    Parameters
    ----------
    fleet
        What is to be flown.
    quickest
        A profile that all can fly straight.
    room
        The time that there is [s].
    """
    if room <= quickest.duration:
        return room
    few = fleet.sample()
    best, found = np.inf, room
    for time in np.geomspace(quickest.duration, room, _TIMES).tolist():
        _, energy = few.candidates(time)
        usual = few.energy(quickest.stretched(time))
        least = min([usual, *energy[:1].tolist()])
        cost = least + few.hover * (room - time)
        if cost < best:
            best, found = cost, time
    return found


def sparing_profile(fleet: Fleet, quickest: Profile, duration: float) -> Profile:
    """Return the profile over a duration [s] that costs the fleet the least energy.

    ``quickest`` stretched, if no other is proved to keep all limits and costs less.
    """
    if duration <= quickest.duration:
        return quickest
    usual = quickest.stretched(duration)
    shapes, _ = fleet.sample().candidates(duration)
    craft, spent = fleet.aircraft, fleet.energy(usual)
    for phase, ramp in (duration * shapes[:_PROOFS]).tolist():
        profile = Profile(duration, phase, ramp)
        if (
            fleet.energy(profile) < spent
            and proved(
                craft.vehicle, craft.limits, craft.heading, fleet.displacement, profile
            ).all()
        ):
            return profile
    return usual


def flown_energy(fleet: Fleet, flights: Sequence[Trajectory]) -> float:
    """Energy of flights as they were solved [J]."""
    spent = 0.0
    for flight in flights:
        breaks = flight.state.breaks
        width = np.diff(breaks)[:, None]
        at = (breaks[:-1, None] + width * (0.5 + _NODES)).ravel()
        drawn = fleet.power.flown(
            fleet.aircraft.vehicle, flight.state(at), flight.control(at)
        )
        spent += float(drawn @ (width * _WEIGHTS).ravel())
    return spent
