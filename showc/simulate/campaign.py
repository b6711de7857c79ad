"""Many runs of a show in wind: how far drones stray, how near they come."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import bdtr

from showc.processes import side_by_side
from showc.simulate.gusts import LOWEST, SEVERITY, Gusts, Normals, Scales
from showc.simulate.plant import Imperfections, Plant
from showc.simulate.predictive import Predictor
from showc.simulate.results import CONFIDENCE, WANTED, WHOLE, Campaign, Tube
from showc.simulate.tracking import Course, Gains, Tracker

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from showc.arrays import FloatArray
    from showc.log.reader import LoggedShow
    from showc.progress import Progress
    from showc.script.show import Show
    from showc.simulate.results import Weather
    from showc.vehicle import Limits

STEP = 0.005
"""Step of the integration, classical Runge-Kutta [s]."""
CONTROL = 2
"""Steps between two commands: 100 Hz."""
TOGETHER = 200
"""Drones that fly together, in one run or several."""
LOOK = 20
"""Steps between two looks at the distances of drones: 0.1 s."""


@dataclass(frozen=True, slots=True)
class Model:
    """What flies, besides the vehicle."""

    gains: Gains = field(default_factory=Gains)
    """Of the controller."""
    imperfections: Imperfections = field(default_factory=Imperfections)
    """Of rotors and estimator."""
    predictive: bool = False
    """Whether it looks ahead, see :mod:`showc.simulate.predictive`."""


def tube_radius(errors: FloatArray) -> tuple[float, float]:
    """Return a radius that holds flights, and the share that it holds surely.

    An order statistic: of n independent flights the k-th smallest error lies above the
    quantile p with the probability that fewer than k of n lie below it. Where there are
    too few flights for the wanted share, the greatest error holds a smaller one.

    Parameters
    ----------
    errors
        Greatest error of each flight, shape (n,) [m].
    """
    ordered = np.sort(errors)
    count = ordered.size
    # How likely at most j flights lie beyond the quantile, for every j.
    missed = bdtr(np.arange(count), count, 1.0 - WANTED)
    enough = np.flatnonzero(missed <= 1.0 - CONFIDENCE)
    if enough.size:
        # As many of the greatest may be left out.
        return float(ordered[count - 1 - int(enough[-1])]), WANTED
    return float(ordered[-1]), float((1.0 - CONFIDENCE) ** (1.0 / count))


def campaign(
    logged: LoggedShow,
    show: Show,
    weather: Weather,
    progress: Progress,
    *,
    model: Model | None = None,
) -> Campaign:
    """Fly a show several times in wind.

    Parameters
    ----------
    logged
        The log.
    show
        What its script asks for.
    weather
        Wind, gusts, how many runs.
    progress
        Notified of every run.
    model
        Controller, rotors and estimator; None: as usual.
    """
    model = model or Model()
    course = course_of(logged)
    legs = [(one.message.name, one.start, one.duration) for one in logged.segments]
    legs = [*legs, (WHOLE, 0.0, logged.duration)]
    spans = [_span(course.times, start, time) for _, start, time in legs]
    progress.stage(f"simulating {weather.runs} flights", weather.runs)
    # Numpy takes as long for a few drones as for many: they fly several runs at once.
    # How many depends on nothing but the drones, so that results are the same anywhere.
    together = 1 if model.predictive else max(1, TOGETHER // logged.drones)
    runs = [
        range(first, min(first + together, weather.runs))
        for first in range(0, weather.runs, together)
    ]
    parts = [
        partial(_summed, partial(fly, show, course, weather, some, model), spans)
        for some in runs
    ]
    waiting = iter(runs)
    found = side_by_side(parts, None, lambda: progress.advance(len(next(waiting))))
    flown = [one for some in found for one in some]
    # Of each run and leg, so that long shows of many drones fit into memory.
    errors = np.stack([one.errors for one in flown])
    tubes = []
    for number, (name, start, _) in enumerate(legs):
        each = errors[:, number].ravel()
        tubes.append(
            Tube(
                name,
                start,
                float(each.max()),
                *tube_radius(each),
                float(np.sqrt(np.mean([one.squares[number] for one in flown]))),
                float(np.min([one.closest[number] for one in flown])),
                float(np.mean([one.saturated[number] for one in flown])),
                float(np.max([one.used[number] for one in flown])),
            )
        )
    return Campaign(
        weather,
        tuple(tubes),
        "predictive" if model.predictive else "flatness",
        observer=model.gains.observer > 0.0,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Legs:
    """What one flight came to, leg by leg."""

    errors: FloatArray
    """Greatest of each drone, shape (legs, drones) [m]."""
    squares: FloatArray
    """Mean of the squared errors, shape (legs,) [m²]."""
    closest: FloatArray
    """Shape (legs,) [m]."""
    saturated: FloatArray
    """Mean share, shape (legs,)."""
    used: FloatArray
    """Greatest share, shape (legs,)."""


def _span(times: FloatArray, start: float, duration: float) -> slice:
    """Return which commands belong to a leg: one at least."""
    first = min(int(np.searchsorted(times, start)), times.size - 1)
    last = int(np.searchsorted(times, start + duration, side="right"))
    return slice(first, max(last, first + 1))


def _summed(fly: Callable[[], list[Flown]], spans: list[slice]) -> list[_Legs]:
    """Fly, and sum up what each flight found over ``spans`` of commands."""
    return [
        _Legs(
            np.array([flown.errors[one].max(axis=0) for one in spans]),
            np.array([np.mean(flown.errors[one] ** 2) for one in spans]),
            np.array([flown.closest[one].min() for one in spans]),
            np.array([flown.saturated[one].mean() for one in spans]),
            np.array([flown.used[one].max() for one in spans]),
        )
        for flown in fly()
    ]


def course_of(logged: LoggedShow) -> Course:
    """Read what the drones of a show are to do at the times of commands."""
    flights = [logged.trajectory(drone) for drone in range(logged.drones)]
    at = np.arange(0.0, logged.duration, STEP * CONTROL)
    return Course(
        at,
        np.stack([flight.state(at) for flight in flights], axis=1),
        np.stack([flight.control(at) for flight in flights], axis=1),
        np.stack(
            [flight.state.select([3, 4, 5]).derivative()(at) for flight in flights],
            axis=1,
        ),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Flown:
    """One flight of a course."""

    errors: FloatArray
    """Distance from the reference, shape (commands, drones) [m]."""
    closest: FloatArray
    """Least distance of two drones, (commands,) [m]; infinite where nothing looked."""
    saturated: FloatArray
    """Share of drones whose rotors could not follow, shape (commands,)."""
    used: FloatArray
    """Greatest share of a limit that any drone took, see :func:`shares_of_limits`,
    shape (commands,)."""


def fly(
    show: Show, course: Course, weather: Weather, runs: Sequence[int], model: Model
) -> list[Flown]:
    """Fly a course from hover to hover, in the gusts of each of ``runs``."""
    return _Runs(show, course, weather, runs, model).fly()


class _Runs:
    """Some flights of the whole show: rows are all drones of the first, of the next."""

    def __init__(
        self,
        show: Show,
        course: Course,
        weather: Weather,
        runs: Sequence[int],
        model: Model,
    ) -> None:
        self.course, self.off = course, model.imperfections
        self.shape = len(runs), course.state.shape[1]
        self.limits = replace(show.limits, tilt=model.gains.lean)
        area = 0.5 * sum(show.body.drag_area)
        self.plant = Plant(show.vehicle, area, self.off.rotor_lag)
        step = STEP * CONTROL
        if model.predictive and len(runs) > 1:
            raise ValueError("the predictive controller flies one run at a time")
        self.tracker = (
            Predictor(
                show.vehicle,
                course,
                self.off.delay + self.off.rotor_lag,
                step,
                limits=show.limits,
                gains=model.gains,
            )
            if model.predictive
            else Tracker(show.vehicle, course, step, model.gains, len(runs))
        )
        self.random = [np.random.default_rng([weather.seed, run, 1]) for run in runs]
        bearing = np.array([one.uniform(0.0, 2.0 * np.pi) for one in self.random])
        zero = np.zeros_like(bearing)
        along = np.stack([np.cos(bearing), np.sin(bearing), zero], axis=1)
        across = np.stack([-along[:, 1], along[:, 0], zero], axis=1)
        up = np.broadcast_to([0.0, 0.0, 1.0], along.shape)
        # Shape (runs, 3, 3).
        self.frame = np.stack([along, across, up], axis=1)
        self.mean = weather.wind * along[:, None]
        height = course.state[:, :, 2].max(axis=0)
        scales = Scales.at(height, weather.wind * SEVERITY[weather.gusts])
        seeds = [int(one.integers(2**31)) for one in self.random]
        self.gusts = Gusts(scales, weather.wind, step, seeds)

    def fly(self) -> list[Flown]:
        """Fly from the first hover to the last."""
        course, off, (runs, drones) = self.course, self.off, self.shape
        state, thrust = (
            np.tile(part[0], (runs, 1)) for part in (course.state, course.control)
        )
        sizes = np.repeat([off.position, off.velocity, off.attitude, off.rate], 3)
        fade = np.exp(-STEP * CONTROL / off.correlation) if off.correlation else 0.0
        normals = Normals(self.random, (drones, 12))
        error = sizes * normals().reshape(-1, 12)
        waiting = [thrust] * max(1, round(off.delay / (STEP * CONTROL)))
        count = course.times.size
        errors = np.empty((count, runs, drones))
        used, clipped = np.empty((count, runs)), np.empty((count, runs))
        closest = np.full((count, runs), np.inf)
        for number in range(count):
            noise = sizes * normals().reshape(-1, 12)
            error = fade * error + np.sqrt(1.0 - fade**2) * noise
            estimate = state + error
            wanted = course.state[number]
            asked, limited = self.plant.allotted(self.tracker.command(estimate, number))
            clipped[number] = limited.reshape(self.shape).mean(axis=1)
            waiting.append(asked)
            command = waiting.pop(0)
            air = self.mean + self.gusts() @ self.frame
            places = state[:, :3].reshape(runs, drones, 3)
            errors[number] = np.linalg.norm(places - wanted[:, :3], axis=2)
            if number % (LOOK // CONTROL) == 0:
                closest[number] = [_closest(one) for one in places]
            # The ground brakes the wind, and holds what stands on it.
            air *= np.clip(wanted[:, 2:3] / LOWEST, 0.0, 1.0)
            wind = air.reshape(-1, 3)
            for _ in range(CONTROL):
                state, thrust = self.plant.after(state, thrust, command, wind, STEP)
            shares = shares_of_limits(self.limits, state, thrust)
            used[number] = shares.reshape(self.shape).max(axis=1)
            self.tracker.observe(estimate, thrust)
        return [
            Flown(errors[:, run], closest[:, run], clipped[:, run], used[:, run])
            for run in range(runs)
        ]


def shares_of_limits(
    limits: Limits, state: FloatArray, control: FloatArray
) -> FloatArray:
    """Return the greatest share of a limit that each drone takes, (n,).

    Above 1 it is beyond that limit.

    Looked at are roll and pitch, body rates, thrust, torques and speeds.

    Parameters
    ----------
    limits
        Of flight.
    state, control
        Shapes (n, 12) and (n, 4).
    """
    torque, rate = np.array(limits.torque_max), np.array(limits.body_rate)
    low = [*limits.velocity_min, -limits.tilt, -limits.tilt, *-rate]
    high = [*limits.velocity_max, limits.tilt, limits.tilt, *rate]
    low, high = [*low, limits.thrust_min, *-torque], [*high, limits.thrust_max, *torque]
    middle, half = np.add(low, high) / 2.0, np.subtract(high, low) / 2.0
    value = np.hstack([state[:, [3, 4, 5, 6, 7, 9, 10, 11]], control])
    share = (np.abs(value - middle) / half).max(axis=1)
    if not limits.level_speed:
        return np.asarray(share)
    level = np.hypot(state[:, 3], state[:, 4])
    return np.asarray(np.maximum(share, level / limits.level_speed))


def _closest(places: FloatArray) -> float:
    """Least distance of two of n places (n, 3) [m]."""
    if len(places) < 2:
        return np.inf
    square = np.sum(places**2, axis=1)
    gap = square[:, None] + square[None, :] - 2.0 * places @ places.T
    np.fill_diagonal(gap, np.inf)
    return float(np.sqrt(max(gap.min(), 0.0)))
