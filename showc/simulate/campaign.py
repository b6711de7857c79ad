"""Many runs of a show in wind: how far drones stray, how near they come."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import bdtr

from showc.processes import side_by_side
from showc.simulate.gusts import LOWEST, SEVERITY, Gusts, Scales
from showc.simulate.plant import Imperfections, Plant
from showc.simulate.predictive import Predictor
from showc.simulate.results import CONFIDENCE, WANTED, WHOLE, Campaign, Tube
from showc.simulate.tracking import Course, Gains, Tracker

if TYPE_CHECKING:
    from collections.abc import Callable

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
    runs = [
        partial(_summed, partial(fly_once, show, course, weather, run, model), spans)
        for run in range(weather.runs)
    ]
    flown = side_by_side(runs, None, progress.advance)
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


def _summed(fly: Callable[[], Flown], spans: list[slice]) -> _Legs:
    """Fly, and sum up what was found over ``spans`` of commands."""
    flown = fly()
    return _Legs(
        np.array([flown.errors[one].max(axis=0) for one in spans]),
        np.array([np.mean(flown.errors[one] ** 2) for one in spans]),
        np.array([flown.closest[one].min() for one in spans]),
        np.array([flown.saturated[one].mean() for one in spans]),
        np.array([flown.used[one].max() for one in spans]),
    )


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
    """Greatest share of a limit that any drone took, see :func:`share_of_limits`,
    shape (commands,)."""


def fly_once(
    show: Show, course: Course, weather: Weather, run: int, model: Model
) -> Flown:
    """Fly a course from the first hover to the last, in the gusts of ``run``."""
    return _Run(show, course, weather, run, model).fly()


class _Run:
    """One flight of the whole show."""

    def __init__(
        self,
        show: Show,
        course: Course,
        weather: Weather,
        run: int,
        model: Model,
    ) -> None:
        self.course, self.off = course, model.imperfections
        self.limits = replace(show.limits, tilt=model.gains.lean)
        area = 0.5 * sum(show.body.drag_area)
        self.plant = Plant(show.vehicle, area, self.off.rotor_lag)
        step = STEP * CONTROL
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
            else Tracker(show.vehicle, course, step, model.gains)
        )
        self.random = np.random.default_rng([weather.seed, run, 1])
        bearing = self.random.uniform(0.0, 2.0 * np.pi)
        along = np.array([np.cos(bearing), np.sin(bearing), 0.0])
        across = np.array([-along[1], along[0], 0.0])
        self.frame = np.stack([along, across, [0.0, 0.0, 1.0]])
        self.mean = weather.wind * along
        height = course.state[:, :, 2].max(axis=0)
        scales = Scales.at(height, weather.wind * SEVERITY[weather.gusts])
        seed = int(self.random.integers(2**31))
        self.gusts = Gusts(scales, weather.wind, STEP * CONTROL, seed)

    def fly(self) -> Flown:
        """Fly from the first hover to the last."""
        course, off = self.course, self.off
        drones = course.state.shape[1]
        state, thrust = course.state[0].copy(), course.control[0].copy()
        sizes = np.repeat([off.position, off.velocity, off.attitude, off.rate], 3)
        fade = np.exp(-STEP * CONTROL / off.correlation) if off.correlation else 0.0
        error = sizes * self.random.standard_normal((drones, 12))
        waiting = [course.control[0]] * max(1, round(off.delay / (STEP * CONTROL)))
        errors = np.empty(course.state.shape[:2])
        used = np.empty(course.times.size)
        closest = np.full(course.times.size, np.inf)
        clipped = np.empty(course.times.size)
        for number in range(course.times.size):
            noise = sizes * self.random.standard_normal((drones, 12))
            error = fade * error + np.sqrt(1.0 - fade**2) * noise
            estimate = state + error
            wanted = course.state[number]
            asked, limited = self.plant.allotted(self.tracker.command(estimate, number))
            clipped[number] = limited.mean()
            waiting.append(asked)
            command = waiting.pop(0)
            air = self.mean + self.gusts() @ self.frame
            errors[number] = np.linalg.norm(state[:, :3] - wanted[:, :3], axis=1)
            if number % (LOOK // CONTROL) == 0:
                closest[number] = _closest(state[:, :3])
            # The ground brakes the wind, and holds what stands on it.
            air *= np.clip(wanted[:, 2:3] / LOWEST, 0.0, 1.0)
            for _ in range(CONTROL):
                state, thrust = self.plant.after(state, thrust, command, air, STEP)
            used[number] = share_of_limits(self.limits, state, thrust)
            self.tracker.observe(estimate, thrust)
        return Flown(errors, closest, clipped, used)


def share_of_limits(limits: Limits, state: FloatArray, control: FloatArray) -> float:
    """Return the greatest share of a limit that n drones take; above 1: beyond it.

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
    share = float((np.abs(value - middle) / half).max())
    if not limits.level_speed:
        return share
    level = np.hypot(state[:, 3], state[:, 4]).max()
    return max(share, float(level) / limits.level_speed)


def _closest(places: FloatArray) -> float:
    """Least distance of two of n places (n, 3) [m]."""
    if len(places) < 2:
        return np.inf
    square = np.sum(places**2, axis=1)
    gap = square[:, None] + square[None, :] - 2.0 * places @ places.T
    np.fill_diagonal(gap, np.inf)
    return float(np.sqrt(max(gap.min(), 0.0)))
