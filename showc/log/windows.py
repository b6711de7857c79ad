"""Samples of the whole fleet as they stand in the log, some steps at a time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from showc.light import LightProgram, srgb_bytes
from showc.light.colour import GREATEST, drive_bytes
from showc.log.sample import (
    DRONE_STATE,
    NANOSECONDS,
    PLACE,
    POINT,
    pack_drone_states,
    pack_places,
    pack_points,
    sample_times,
)
from showc.log.sampling import FleetSampler

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from showc.arrays import FloatArray, IntArray
    from showc.flight import Flight


SAMPLES = 100_000
"""Samples (times x drones) that are evaluated and held at a time."""
PREDICTED_COLOUR = (128, 128, 128)
"""Screen colour of the predicted fleet."""


class PositionSource(Protocol):
    """A second flight of the same fleet, for instance what the autopilots will fly."""

    @property
    def duration(self) -> float:
        """Its length [s]."""

    def position(self, times: FloatArray) -> FloatArray:
        """Positions (T, drones, 3), show frame [m], at ``times`` (T,) [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """Some steps after each other."""

    times: IntArray
    """Show times at which anything is sampled, shape (n,) [ns]."""
    steps: range
    """Numbers of the show's own steps among them."""
    points: NDArray[np.void]
    """The fleet at each of these, ``POINT`` records, shape (steps, drones)."""
    states: NDArray[np.void]
    """Single drones, ``DRONE_STATE`` records, shape (steps, drones with a topic)."""
    predicted_times: IntArray
    """When the second flight is sampled, shape (m,) [ns]."""
    places: NDArray[np.void]
    """Its fleet, ``PLACE`` records, shape (m, drones)."""


class Windows:
    """All samples of a log.

    Parameters
    ----------
    flight
        The solved show.
    lights
        Colours; None: those that the show describes.
    single
        Drones with topics of their own, counting from 0.
    predicted
        A second flight, if there is one.
    """

    def __init__(
        self,
        flight: Flight,
        lights: LightProgram | None,
        single: tuple[int, ...],
        predicted: PositionSource | None,
    ) -> None:
        self._flight, self._lights = flight, lights
        self._single, self._predicted = list(single), predicted
        show = flight.itinerary.show
        self._drones = show.drones
        self.show_times = sample_times(flight.duration, show.log_rate)
        self._other_times = np.empty(0, dtype=np.int64)
        if predicted is not None:
            self._other_times = sample_times(predicted.duration, show.log_rate)
        self.times = np.union1d(self.show_times, self._other_times)
        self._length = max(1, SAMPLES // show.drones)

    def __iter__(self) -> Iterator[Window]:
        """Evaluate one after the other."""
        sampler = FleetSampler(self._flight)
        lights = self._lights or LightProgram.of(self._flight)
        for begin in range(0, self.times.size, self._length):
            times = self.times[begin : begin + self._length]
            yield self._window(times, sampler, lights)

    def _window(
        self, times: IntArray, sampler: FleetSampler, lights: LightProgram
    ) -> Window:
        first = int(np.searchsorted(self.show_times, times[0]))
        last = int(np.searchsorted(self.show_times, times[-1], side="right"))
        points = np.empty((0, self._drones), dtype=POINT)
        states = np.empty((0, len(self._single)), dtype=DRONE_STATE)
        if last > first:
            points, states = self._fleet(
                self.show_times[first:last] / NANOSECONDS, sampler, lights
            )
        other = np.intersect1d(times, self._other_times)
        places = np.empty((0, self._drones), dtype=PLACE)
        if other.size and self._predicted is not None:
            position = self._predicted.position(other / NANOSECONDS)
            places = pack_places(position, PREDICTED_COLOUR)
        return Window(times, range(first, last), points, states, other, places)

    def _fleet(
        self, seconds: FloatArray, sampler: FleetSampler, lights: LightProgram
    ) -> tuple[NDArray[np.void], NDArray[np.void]]:
        state, control = sampler(seconds)
        light = lights.linear(seconds)
        single = self._single
        return pack_points(state, control, srgb_bytes(light)), pack_drone_states(
            state[:, single],
            control[:, single],
            drive_bytes(light[:, single]) / GREATEST,
        )
