"""Samples held against the polynomials, to the rounding that the log declares.

Samples are float32 numbers rounded to a grid; the metadata name the grid of each
quantity. Allowed is half a step of the grid, the rounding of float32, and the change of
the quantity within the nanosecond to which the sample's time is rounded. Where controls
jump, between two mesh intervals, the value on either side is right.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import TYPE_CHECKING, Literal

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud

from showc.verify.damage import Damage
from showc.verify.decode import parse
from showc.verify.fleet import Fleet
from showc.verify.report import Check, Place
from showc.verify.sample import (
    POINT_FIELDS,
    expected_fields,
    frames,
    point_layout,
    points_of,
    same_sign,
)
from showc.verify.wire import columns

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from showc.verify.kernel.show import LoggedShow
    from showc.verify.logfile import LogFile

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]

FLEET, TRANSFORMS = "/fleet/state", "/tf"
DRONE_STATE = re.compile(r"/drone/(\d+)/state")
GROUP = "choreography"

GRIDS = ("position", "velocity", "attitude", "body_rate", "thrust", "torque")


_STATE_FIELDS: dict[tuple[int, ...], str] = {
    **{
        (group, axis): f"{group}.{axis}" for group in (1, 2, 3, 4) for axis in (1, 2, 3)
    },
    (5,): "5",
    **{(6, axis): f"6.{axis}" for axis in (1, 2, 3)},
}

Kind = Literal["point", "state", "transform"]

_QUANTITIES = {
    "point": np.repeat([0, 1, 2, 3, 4, 5], [3, 3, 4, 3, 1, 3]),
    "state": np.repeat([0, 1, 2, 3, 4, 5], [3, 3, 3, 3, 1, 3]),
    "transform": np.repeat([0, 2], [3, 4]),
}
"""Which of ``GRIDS`` each field of a sample has."""


SHARES = 32
"""Parts of the file whose samples can be compared side by side."""

_SIDE = 3e-9
"""How far to look to either side of an instant at which a value jumps [s]."""


@dataclass(slots=True)
class Compared:
    """The worst sample of one kind, as error over what is allowed."""

    value: float = 0.0
    where: Place = field(default_factory=Place)
    samples: int = 0
    bad: int = 0

    def join(self, other: Compared) -> None:
        """Add what was found in other samples of the kind."""
        self.samples += other.samples
        self.bad += other.bad
        if other.value > self.value:
            self.value, self.where = other.value, other.where

    def check(self, code: str, name: str, *notes: str) -> Check:
        """Turn into a check."""
        found = (f"{self.samples:,} numbers compared", *notes)
        if self.bad:
            found += (f"{self.bad:,} of them are off",)
        return Check(
            code,
            GROUP,
            name,
            "pass" if self.bad == 0 and self.samples else "fail",
            self.value,
            1.0,
            "of the rounding",
            self.where,
            found,
        )


def check_samples(log: LogFile, show: LoggedShow, grids: FloatArray) -> list[Check]:
    """Hold all samples of the log against the polynomials.

    Parameters
    ----------
    log
        The file.
    show
        Its polynomials.
    grids
        Rounding step of each of ``GRIDS``, shape (6,) (SI units).
    """
    fleet = [part() for part in fleet_parts(log, show, grids)]
    return join_samples(log, show, fleet, check_other_samples(log, show, grids))


def fleet_parts(
    log: LogFile, show: LoggedShow, grids: FloatArray
) -> list[Callable[[], Compared]]:
    """Comparisons of the fleet's samples, each of a part of the file."""
    channel = _topics(log).get(FLEET)
    if channel is None:
        return []
    comparison = _Comparison(log, show, grids)
    # Once for all parts, before they are handed out to copies of this process.
    _ = comparison.fleet_at
    return [partial(comparison.fleet, channel, share) for share in range(SHARES)]


def check_other_samples(
    log: LogFile, show: LoggedShow, grids: FloatArray
) -> list[Check]:
    """Hold the samples of single drones and their frames against the polynomials."""
    topics = _topics(log)
    comparison = _Comparison(log, show, grids)
    single = {
        number: int(match[1]) - 1
        for topic, number in topics.items()
        if (match := DRONE_STATE.fullmatch(topic))
    }
    checks = []
    if single and FLEET in topics:
        checks.append(comparison.single(single, topics[FLEET]))
    if TRANSFORMS in topics:
        checks.append(comparison.transforms(topics[TRANSFORMS]))
    return checks


def join_samples(
    log: LogFile, show: LoggedShow, fleet: list[Compared], others: list[Check]
) -> list[Check]:
    """All checks of samples, from what the parts found."""
    channel = _topics(log).get(FLEET)
    if channel is None:
        return [
            Check("VRF121", GROUP, "samples", "fail", notes=(f"there is no {FLEET}",))
        ]
    worst = Compared()
    for part in fleet:
        worst.join(part)
    return [
        _times(log, show, channel),
        worst.check("VRF122", "fleet samples equal to the polynomials"),
        *others,
    ]


def _topics(log: LogFile) -> dict[str, int]:
    return {channel.topic: number for number, channel in log.channels.items()}


def _times(log: LogFile, show: LoggedShow, channel: int) -> Check:
    """Whether a sample stands at every multiple of the period, and at the end."""
    found = log.times(channel) - show.epoch
    end = round(show.duration * 1e9)
    count = int(show.duration * show.rules.log_rate + 1e-6)
    grid = np.arange(count + 1) * (1e9 / show.rules.log_rate)
    if end - grid[-1] > 2.0:
        grid = np.append(grid, end)
    same = found.size == grid.size and bool(np.all(np.abs(found - grid) <= 2.0))
    return Check(
        "VRF121",
        GROUP,
        "samples at every step of the log rate",
        "pass" if same else "fail",
        float(found.size),
        float(grid.size),
        "samples",
    )


class _Comparison:
    def __init__(self, log: LogFile, show: LoggedShow, grids: FloatArray) -> None:
        self.log = log
        self.show = show
        self.grids = grids

    @cached_property
    def fleet_at(self) -> Fleet:
        """State and control at given times."""
        return Fleet(self.show)

    def seconds(self, times: IntArray) -> FloatArray:
        """Show time of time stamps [s]."""
        return np.asarray((times - self.show.epoch) * 1e-9)

    def fleet(self, channel: int, share: int) -> Compared:
        """Compare the messages of the whole fleet in one share of the file."""
        worst = Compared()
        layout: np.dtype[np.void] | None = None
        for data, m, offset in self.log.read({channel}, share, SHARES):
            values = np.empty((len(POINT_FIELDS), m.size.size, self.show.drones))
            for moment, (start, size) in enumerate(
                zip(m.payload.tolist(), m.size.tolist(), strict=True)
            ):
                cloud = parse(PointCloud, data[start : start + size], offset)
                layout = layout or point_layout(cloud, offset)
                points = points_of(cloud, layout, self.show.drones, offset)
                for row, name in zip(values, POINT_FIELDS, strict=True):
                    row[moment] = points[name]
            drones = np.arange(self.show.drones)
            self._compare(
                worst,
                values,
                self.seconds(m.log_time),
                drones,
                "point",
            )
        return worst

    def single(self, channels: dict[int, int], fleet: int) -> Check:
        """Check the messages of single drones, which must be as many as the fleet's."""
        worst = Compared()
        expected = self.log.times(fleet)
        for channel, drone in channels.items():
            times = self.log.times(channel)
            if drone >= self.show.drones or not np.array_equal(times, expected):
                return Check(
                    "VRF123",
                    GROUP,
                    "samples of single drones equal to the polynomials",
                    "fail",
                    float(times.size),
                    float(expected.size),
                    "samples",
                    Place(drone + 1),
                )
        for data, m, offset in self.log.read(set(channels)):
            try:
                table = columns(data, m.payload, m.size, _STATE_FIELDS)
            except Damage as damage:
                raise Damage(offset, damage.text) from damage
            values = np.stack(list(table.values()))
            # Undefined numbers must not pass for drones that have no samples.
            values[np.isnan(values)] = np.inf
            owner = np.array([channels[number] for number in m.channel.tolist()])
            moments, index = np.unique(m.log_time, return_inverse=True)
            grid = np.full((len(values), moments.size, self.show.drones), np.nan)
            grid[:, index, owner] = values
            drones = np.unique(owner)
            self._compare(
                worst,
                grid[:, :, drones],
                self.seconds(moments),
                drones,
                "state",
            )
        return worst.check(
            "VRF123", "samples of single drones equal to the polynomials"
        )

    def transforms(self, channel: int) -> Check:
        """Check the frames of the drones."""
        worst = Compared()
        for data, m, offset in self.log.read({channel}):
            for start, size, time in zip(
                m.payload.tolist(), m.size.tolist(), m.log_time, strict=True
            ):
                message = parse(FrameTransforms, data[start : start + size], offset)
                drones, values = frames(message, self.show.drones, offset)
                if drones.size:
                    self._compare(
                        worst,
                        values.T[:, None],
                        self.seconds(np.array([time])),
                        drones,
                        "transform",
                    )
        if worst.samples == 0:
            return Check(
                "VRF124",
                GROUP,
                "frames of the drones equal to the polynomials",
                "skipped",
                notes=("the log has none",),
            )
        return worst.check("VRF124", "frames of the drones equal to the polynomials")

    def _compare(
        self,
        worst: Compared,
        values: FloatArray,
        times: FloatArray,
        drones: IntArray,
        kind: Kind,
    ) -> None:
        """Compare values (fields, times, drones); NaN means: not logged."""
        ratio = self._ratio(values, self._flown(times, drones), kind)
        late = np.flatnonzero(ratio.max(axis=(0, 2), initial=0.0) > 1.0)
        for index in late.tolist():
            one = slice(index, index + 1)
            for side in (-_SIDE, _SIDE):
                other = self._flown(times[one] + side, drones)
                again = self._ratio(values[:, one], other, kind)
                ratio[:, one] = np.minimum(ratio[:, one], again)
        worst.samples += values.size - int(np.count_nonzero(np.isnan(values)))
        greatest = float(ratio.max(initial=0.0))
        if greatest > 1.0:
            worst.bad += int(np.sum(ratio > 1.0))
        if greatest > worst.value:
            # The first in time, then of the drones, among equals.
            worst_of = ratio.max(axis=0)
            time, drone = np.unravel_index(int(np.argmax(worst_of)), worst_of.shape)
            worst.value = greatest
            worst.where = Place(drone=int(drones[drone]) + 1, time=float(times[time]))

    def _flown(self, times: FloatArray, drones: IntArray) -> FloatArray:
        """State and control of some drones, shape (16, times, drones)."""
        flown = self.fleet_at(times)
        return flown if drones.size == self.show.drones else flown[..., drones]

    def _ratio(self, values: FloatArray, flown: FloatArray, kind: Kind) -> FloatArray:
        """Error over what is allowed, shape of ``values``; 0 where not logged."""
        expected = expected_fields(flown, kind)
        if kind != "state":
            values = same_sign(values, expected, kind)
        quantity = _QUANTITIES[kind]
        fixed = 0.5 * self.grids[quantity] + self._drift(flown)[quantity] + 1e-9
        ratio = np.abs(values - expected)
        allowed = np.abs(expected, out=expected)
        allowed *= 2.0**-23 + 1e-9
        allowed += fixed[:, None, None]
        ratio /= allowed
        ratio[np.isnan(ratio)] = np.inf
        if kind == "state":
            ratio[np.isnan(values)] = 0.0
        return ratio

    @staticmethod
    def _drift(flown: FloatArray) -> FloatArray:
        """Change of each quantity within the nanosecond of rounding, shape (6,)."""
        fastest = max(
            float(max(rows.max(initial=0.0), -rows.min(initial=0.0)))
            for rows in (flown[3:6], flown[9:12])
        )
        return 1e-9 * np.array([fastest, 100.0, fastest, 1e3, 1e3, 1e2])
