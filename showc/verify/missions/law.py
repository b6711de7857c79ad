"""How ArduCopter flies a straight leg, worked out anew, and under which parameters.

From rest to rest along a line, jerk rising and falling as a raised cosine. A leg is 15
phases; in each of them the jerk is c0 + c1 cos(pi s / tau), s being the time since the
phase began and tau its length, so that distance, speed and acceleration follow by exact
integration. Nothing here is taken from the code that wrote the missions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import floor, tan
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from showc.codes import read_table
from showc.verify.missions.language import MissionFormatError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import ArrayLike

    from showc.arrays import FloatArray, IntArray
    from showc.script.show import Show

KNOWN: dict[str, Any] = read_table(__package__ or "", "law.toml")
"""What ``law.toml`` says."""

CONSTANTS: dict[str, float] = KNOWN["constants"]
"""What was measured, and what the autopilot reckons with (SI)."""

_HALVINGS = 80  # of a speed: beyond float64
_SHORTEST = 1e-6  # leg [m]
_PHASES = 15  # of a leg


@dataclass(frozen=True, slots=True)
class Law:
    """The parameters of the law, in SI."""

    acceleration: float
    vertical_acceleration: float
    jerk: float
    snap: float

    @classmethod
    def of(cls, values: Mapping[str, float]) -> Law:
        """Return the law under the ``values`` of a parameter file."""
        jerk, time = values["WPNAV_JERK"], max(values["ATC_INPUT_TC"], 0.1)
        turn = min(values["ATC_ACCEL_R_MAX"], values["ATC_ACCEL_P_MAX"]) / 100.0
        turn = np.radians(turn) * CONSTANTS["gravity"]
        level, upright = values["WPNAV_ACCEL"] / 100.0, values["WPNAV_ACCEL_Z"] / 100.0
        return cls(level, upright, jerk, 0.5 * min(np.pi * jerk / (2.0 * time), turn))


class Covered(NamedTuple):
    """What is flown of legs between two times: parts of them (m,), or (m, axes) [m]."""

    rear: FloatArray
    """Covered at the first of them."""
    front: FloatArray
    """Covered at the second."""
    slow: FloatArray
    """Least rate or velocity meanwhile [1/s, m/s]."""
    fast: FloatArray
    """Greatest rate or velocity meanwhile [1/s, m/s]."""


@dataclass(frozen=True, eq=False)
class Profiles:
    """Distance over time of n legs."""

    length: FloatArray
    """Shape (n,) [m]."""
    speed: FloatArray
    """Cruise speed, shape (n,) [m/s]."""
    duration: FloatArray
    """Time of each leg, shape (n,) [s]."""
    edges: FloatArray
    """When one phase follows another, shape (n, 14) [s]."""
    phases: FloatArray
    """When each phase begins [s]; distance, speed, acceleration there, c0 and c1
    [m/s³], and pi / tau [1/s], shape (15 n, 7): side by side what is used together."""
    level: FloatArray
    """Horizontal part of the direction, shape (n,): how late a drone follows."""
    overshoot: FloatArray
    """How far a drone may fly beyond its end, shape (n,) [m]."""
    excess: FloatArray
    """Foremost place over the end of each leg, shape (n,), at least 1."""
    spread: FloatArray
    """How much more or less than its delay a drone may be late, shape (n,) [s]."""
    late: FloatArray
    """How much later than predicted it may arrive, shape (n,) [s]."""

    @cached_property
    def fastest(self) -> FloatArray:
        """Rate in the middle of each leg, (n,) [1/s]: it rises, stays and falls."""
        return self.share(np.arange(self.length.size), 0.5 * self.duration)[1]

    def law_time(self, leg: IntArray, since: ArrayLike) -> FloatArray:
        """Time of the law at which drones on legs ``leg`` (m,) are now, shape (m,) [s].

        ``since`` (m,) the release [s]: late by 0.16 s if upright, by up to 0.44 s if
        level, the more the longer they fly.
        """
        t = np.asarray(since, dtype=np.float64)
        gap = 0.44 * np.exp(np.minimum(-t, 0.0) / 1.33)
        return np.asarray(t - 0.16 + self.level[leg] ** 2 * (gap - 0.28))

    def between(self, leg: IntArray, low: FloatArray, high: FloatArray) -> Covered:
        """Return what is covered of legs (m,) from low to high (m,) since release [s].

        That is from the latest drone at low to the earliest one at high.
        """
        late = self.law_time(leg, low) - self.spread[leg]
        # Many drones rest at their ends.
        found = np.repeat([[1.0], [1.0], [0.0], [0.0]], late.size, axis=1)
        flies = np.flatnonzero(~(late > self.duration[leg]))
        leg, late = leg[flies], late[flies]
        early = self.law_time(leg, high[flies]) + self.spread[leg]
        (rear, before), (front, after) = (self.share(leg, t) for t in (late, early))
        slow, fast = np.minimum(before, after), np.maximum(before, after)
        middle = 0.5 * self.duration[leg]
        amid = (late < middle) & (middle < early)
        found[:, flies] = rear, front, slow, np.where(amid, self.fastest[leg], fast)
        return Covered(*found)

    def followed(self, late: float | FloatArray) -> FloatArray:
        """Time (n,) [s] since its release at which each leg has surely been flown.

        By drones that are later than they most likely are by ``late`` [s]. The delay
        grows by at most 0.35 s/s: each round is nearer by that factor, or more.
        """
        rows = np.arange(self.length.size)
        since = wanted = self.duration + late
        for _ in range(30):
            since = since + wanted - self.law_time(rows, since)
        return since

    def share(self, leg: IntArray, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return shares of legs (m,) flown at times (m,) of the law; rates [1/s]."""
        way, rate = np.where(time > 0.0, 1.0, 0.0), np.zeros(time.size)
        # Many drones rest, before their legs or after them.
        flies = np.flatnonzero((time > 0.0) & (time < self.duration[leg]))
        own, t = leg[flies], time[flies]
        phase = np.sum(t[:, None] >= self.edges.take(own, axis=0), axis=1)
        begin, *state = self.phases.take(_PHASES * own + phase, axis=0).T
        flown, speed, _ = np.divide(_advanced(state, t - begin), self.length[own])
        way[flies], rate[flies] = np.clip(flown, 0.0, 1.0), np.maximum(speed, 0.0)
        return way, rate


def profiles(
    displacement: FloatArray,
    level: FloatArray,
    vertical: FloatArray,
    law: Law,
    wind: float = 0.0,
) -> Profiles:
    """Return the legs of ``displacement`` (n, 3) [m] in the autopilot's metric.

    ``level`` and ``vertical`` (n,) [m/s] are the speeds in force, ``wind`` [m/s] is
    what the script states. Along a line, speed and acceleration are the greatest that
    keep the horizontal and the vertical limits.
    """
    length = np.linalg.norm(displacement, axis=1)
    length = np.where(length > _SHORTEST, length, 0.0)
    unit = np.abs(displacement) / np.where(length > 0.0, length, 1.0)[:, None]
    flat, steep = np.hypot(unit[:, 0], unit[:, 1]), unit[:, 2]
    with np.errstate(divide="ignore", over="ignore"):
        speed = np.minimum(level / flat, vertical / steep)
        push = np.minimum(law.acceleration / flat, law.vertical_acceleration / steep)
    speed, push = (np.where(length > 0.0, some, 1.0) for some in (speed, push))
    short = np.flatnonzero(~(speed * _ramp_time(_ramp(speed, push, law)) <= length))
    low, high = np.zeros(short.size), speed[short]
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        time = _ramp_time(_ramp(middle, push[short], law))
        inside = middle * time <= length[short]
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    speed[short] = low
    times = _assembled(length, speed, _ramp(speed, push, law))
    cruise = np.where(length > 0.0, speed, 0.0)
    # Fitted to measured flights, as the delay is: 90 and 45 ms of cruise.
    beyond = 0.045 * (1.0 + flat**2) * cruise
    excess = 1.0 + beyond / np.where(length > 0.0, length, np.inf)
    spread, late = _tubes(cruise, wind)
    return Profiles(length, speed, *times, flat, beyond, excess, spread, late)


def _tubes(speed: FloatArray, wind: float) -> tuple[FloatArray, FloatArray]:
    """Spreads and latenesses (n,) [s] of legs by their speeds (n,) [m/s]."""
    known = [row for row in KNOWN["tubes"] if wind <= row["wind"]]
    if not known:
        text = f"how missions are flown in a wind of {wind:g} m/s was not measured"
        raise MissionFormatError(text)
    (tops, widths), (slow, fast) = np.array(known[0]["off"]).T, known[0]["late"]
    band = np.minimum(np.searchsorted(tops, speed), tops.size - 1)
    spread = np.maximum((widths / tops)[band], CONSTANTS["spread"])
    return spread, np.maximum(np.where(speed <= CONSTANTS["brisk"], slow, fast), spread)


def _ramp(speed: FloatArray, push: FloatArray, law: Law) -> FloatArray:
    """Jerk, its rise time, time held, time without jerk: shape (4, n)."""
    rise = np.pi * law.jerk / (2.0 * law.snap)
    gentle = np.minimum(push, speed / (2.0 * rise)) < law.jerk * rise
    short = np.minimum(rise, np.cbrt(np.pi * speed / (4.0 * law.snap)))
    short = np.minimum(short, np.sqrt(np.pi * push / (2.0 * law.snap)))
    held = np.sqrt(rise**2 + 4.0 * speed / law.jerk) - rise
    top = np.minimum(push, 0.5 * law.jerk * held)
    jerk = np.where(gentle, 2.0 * law.snap * short / np.pi, law.jerk)
    time = np.where(gentle, short, rise)
    hold = np.where(gentle, 0.0, np.maximum(top / law.jerk - rise, 0.0))
    reached = np.where(gentle, jerk * short, top)
    rest = speed / np.where(reached > 0.0, reached, 1.0) - 2.0 * time - hold
    return np.stack([jerk, time, hold, np.maximum(rest, 0.0)])


def _ramp_time(ramp: FloatArray) -> FloatArray:
    return np.asarray(4.0 * ramp[1] + 2.0 * ramp[2] + ramp[3])


def _assembled(
    length: FloatArray, speed: FloatArray, ramp: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Put the phases together: durations of whole legs, edges and phases of them."""
    jerk, rise, hold, push = ramp
    rest = length / np.where(speed > 0.0, speed, 1.0) - _ramp_time(ramp)
    cruise, none = np.maximum(rest, 0.0), np.zeros_like(rise)
    up = [(rise, 0.5, -0.5), (hold, 1.0, 0.0), (rise, 0.5, 0.5)]
    down = [(time, -c0, -c1) for time, c0, c1 in up]
    held = [(push, 0.0, 0.0)]
    phases = [*up, *held, *down, (cruise, 0.0, 0.0), *down, *held, *up]
    spans = np.stack([np.where(length > 0.0, time, none) for time, _, _ in phases])
    edges = np.zeros((len(phases) + 1, length.size))
    np.cumsum(spans, axis=0, out=edges[1:])
    found = np.empty((length.size, len(phases), 7))
    state: Sequence[FloatArray] = (none, none, none)
    for number, (tau, (_, c0, c1)) in enumerate(zip(spans, phases, strict=True)):
        turn = np.pi / np.where(tau > 0.0, tau, 1.0)
        phase = [*state, c0 * jerk, c1 * jerk, turn]
        found[:, number] = np.stack([edges[number], *phase], axis=1)
        state = _advanced(phase, tau)
    return edges[-1], np.ascontiguousarray(edges[1:-1].T), found.reshape(-1, 7)


def _advanced(phase: Sequence[FloatArray], since: FloatArray) -> Sequence[FloatArray]:
    """Distance, speed, acceleration (n,) after ``since`` (n,) of phases: six facts."""
    distance, speed, push, c0, c1, turn = phase
    angle = turn * since
    # Integrals of the cosine.
    once, twice = np.sin(angle) / turn, (1.0 - np.cos(angle)) / turn**2
    thrice = (since - once) / turn**2
    distance = distance + since * (speed + since * (0.5 * push + since * (c0 / 6.0)))
    speed = speed + since * (push + since * (0.5 * c0))
    push = push + since * c0
    return distance + c1 * thrice, speed + c1 * twice, push + c1 * once


def parameters(show: Show) -> dict[str, float]:
    """Parameters under which the leg law holds, within the limits of a script's show.

    They are the measured ones, or less where tilt and velocities of the show allow no
    more. No speed below 10 cm/s is heeded, no acceleration below 50 cm/s².
    """
    limits = show.limits
    allowed = (
        ("LAND_SPEED_HIGH", 10, show.landing.descent_speed),
        ("WPNAV_SPEED_DN", 10, -limits.velocity_min[2]),
        ("WPNAV_SPEED_UP", 10, min(limits.velocity_max[2], show.launch.climb_speed)),
        ("WPNAV_ACCEL", 50, CONSTANTS["gravity"] * tan(limits.tilt)),
    )
    values = dict(KNOWN["parameters"])
    for name, least, most in allowed:
        values[name] = max(least, min(values[name], floor(100.0 * most + 1e-9)))
    return values


def fastest_level(show: Show) -> float:
    """Greatest level speed of the legs of a show's missions [m/s]."""
    return float(KNOWN["windy" if show.site.wind else "cruise"])


def parameter_file(show: Show) -> bytes:
    """Return the bytes that ``ardupilot.parm`` must have."""
    lines = [f"{name},{value:g}\n" for name, value in sorted(parameters(show).items())]
    return "".join([KNOWN["head"], *lines]).encode("ascii")
