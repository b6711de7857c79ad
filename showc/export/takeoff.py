"""The first climb as show mode can join it: slow where the firmware hands over.

Up to the take-off height the firmware climbs on its own, to stand there; from the
instant at which the file passes that height it follows the file. A file that passes it
at speed is ahead at once: 0.7 m at 2 m/s, as flown. The fleet of the file climbs slowly
until its last drone is there, and faster from then on, until it is with the show.

It is the clock of the whole fleet that is slower: places, and all that are occupied at
once, are those of the solved launch, and so are distances. Nothing after the launch
changes; the fleet leaves the ground earlier.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil, sqrt
from typing import TYPE_CHECKING

import numpy as np

from showc.export.fit import crossings, tracks_of
from showc.trajectory import (
    PiecewisePolynomial,
    bernstein_basis_inverse,
    concatenate,
)

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.export.solved import SolvedShow

PASSING = 0.85
"""Greatest speed of the file at the take-off height [m/s]."""

SETTLING = 0.8
"""How long the fleet goes on at that speed [s]: so long vehicles take to be with their
files after the hand-over."""

PUSH = 1.0
"""What getting faster adds to the acceleration upwards, at most [m/s²]."""

_LOOKS = 65
"""Instants at which a launch is looked at for its greatest speed, beside its breaks:
solved launches have theirs at one."""


@dataclass(frozen=True, slots=True)
class _Clock:
    """Which instant of the launch the fleet is at: at a low rate, then a rising one."""

    rate: float
    """Instants of the launch in a second, at first."""
    gain: float
    """How much the rate rises in a second [1/s]."""
    first: float
    """Up to which instant of the launch the rate is low [s]."""
    last: float
    """From which on it is one [s]."""

    @property
    def ramp(self) -> float:
        """When the rate begins to rise, after the start [s]."""
        return self.first / self.rate

    def when(self, instants: FloatArray) -> FloatArray:
        """How long after the start the fleet is at instants of the launch [s]."""
        since = np.clip(instants, self.first, self.last) - self.first
        rising = np.sqrt(self.rate**2 + 2.0 * self.gain * since) - self.rate
        return np.asarray(
            np.minimum(instants, self.first) / self.rate
            + rising / self.gain
            + np.maximum(instants - self.last, 0.0)
        )

    def rising(self, times: FloatArray) -> FloatArray:
        """Instants of the launch at times after the start at which the rate rises."""
        since = times - self.ramp
        return np.asarray(self.first + self.rate * since + 0.5 * self.gain * since**2)


def slowed(show: SolvedShow, lead: float) -> SolvedShow:
    """Return the show with a launch that is slow at the take-off height.

    A show stays as it is in which drones are slow there, or pass it later than in the
    launch; and one for which the fleet would leave before it may.

    Parameters
    ----------
    show
        What was solved.
    lead
        How long the fleet stands before the show begins [s]; the time that a slower
        launch takes is taken from it.
    """
    clock = _clock(show)
    if clock is None:
        return show
    end = max(one.end for one in show.launches)
    # Whole milliseconds, as formats have them; the rest is spent standing.
    early = ceil(1000.0 * float(clock.when(np.array(end)) - end) + 1e-6) / 1000.0
    if early > lead:
        return show
    flights = tuple(
        _later(_launch(one, clock), flight, one.end, early)
        for one, flight in zip(show.launches, show.flights, strict=True)
    )
    return replace(show, flights=flights, early=early)


def _clock(show: SolvedShow) -> _Clock | None:
    """Return the clock of a slower launch; None: nothing is to be slower."""
    if len(show.launches) != show.drones:
        return None
    above = crossings(tracks_of(replace(show, flights=show.launches)))
    if not np.all(np.isfinite(above)):
        return None
    end = min(one.end for one in show.launches)
    begun, fastest, passing = list[float](), 0.0, 0.0
    for launch, moment in zip(show.launches, above, strict=True):
        climb = launch.derivative()
        instants = np.union1d(launch.breaks, np.linspace(0.0, end, _LOOKS))
        speed = climb(instants)[:, 2]
        begun.append(float(instants[int(np.argmax(speed))]))
        fastest = max(fastest, float(speed.max()))
        passing = max(passing, float(climb(moment)[2]))
    if passing <= PASSING:
        return None
    rate, gain = PASSING / passing, PUSH / fastest
    first = min(end, max(float(above.max()) + SETTLING * rate, *begun))
    reached = min(1.0, sqrt(rate**2 + 2.0 * gain * (end - first)))
    return _Clock(rate, gain, first, first + (reached**2 - rate**2) / (2.0 * gain))


def _launch(launch: PiecewisePolynomial, clock: _Clock) -> list[PiecewisePolynomial]:
    """Return a launch by another clock, from its start on.

    Where the rate rises the launch is a polynomial of a quadratic: of twice its degree.
    """
    parts = launch.split([clock.first, clock.last])
    times = clock.when(parts.breaks)
    degree = 2 * launch.degree
    nodes = np.linspace(0.0, 1.0, degree + 1)
    inverse = bernstein_basis_inverse(degree, tuple(nodes.tolist()))
    found = []
    for row, (begin, end) in enumerate(pairwise(times.tolist())):
        body = parts.coefficients[row]
        if clock.ramp - 1e-9 <= begin and parts.breaks[row + 1] <= clock.last + 1e-9:
            body = inverse @ launch(clock.rising(begin + (end - begin) * nodes))
        found.append(PiecewisePolynomial(np.array([begin, end]), body[None]))
    return found


def _later(
    launch: list[PiecewisePolynomial],
    flight: PiecewisePolynomial,
    end: float,
    early: float,
) -> PiecewisePolynomial:
    """Join a launch and what follows its ``end`` [s], ``early`` [s] later."""
    rest = int(np.searchsorted(flight.breaks, end - 1e-9))
    shift = end + early - launch[-1].end
    still = PiecewisePolynomial.constant(launch[0].coefficients[0, 0], 0.0, shift)
    after = PiecewisePolynomial(flight.breaks[rest:], flight.coefficients[rest:])
    return concatenate(
        [still, *(one.shifted(shift) for one in launch), after.shifted(early)]
    )
