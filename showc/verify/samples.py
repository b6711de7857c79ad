"""Are the samples what the polynomials say, to the rounding that the log declares?

Samples are float32 numbers rounded to a grid; the metadata name the grid of each
quantity. Allowed is half a step of the grid, the rounding of float32, and the change of
the quantity within the nanosecond to which the sample's time is rounded. Where controls
jump, between two mesh intervals, the value on either side is right.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from google.protobuf.message import DecodeError

from showc.verify.damage import Damage
from showc.verify.fleet import Fleet
from showc.verify.report import Check, Place
from showc.verify.wire import columns

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from showc.verify.mcap import LogFile
    from showc.verify.show import LoggedShow

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]

FLEET, TRANSFORMS = "/fleet/state", "/tf"
DRONE_STATE = re.compile(r"/drone/(\d+)/state")
_FRAME = re.compile(r"drone_(\d+)")

GROUP = "choreography"

GRIDS = ("position", "velocity", "attitude", "body_rate", "thrust", "torque")

_POINT_FIELDS = (
    *("x", "y", "z", "vx", "vy", "vz", "qx", "qy", "qz", "qw"),
    *("wx", "wy", "wz", "u0", "u1", "u2", "u3"),
)
_POINT_QUANTITY = np.repeat([0, 1, 2, 3, 4, 5], [3, 3, 4, 3, 1, 3])

_STATE_FIELDS = (
    {
        (number, axis): f"{number}.{axis}"
        for number in (1, 2, 3, 4)
        for axis in (1, 2, 3)
    }
    | {(5,): "5"}
    | {(6, axis): f"6.{axis}" for axis in (1, 2, 3)}
)
_STATE_QUANTITY = np.repeat([0, 1, 2, 3, 4, 5], [3, 3, 3, 3, 1, 3])

_TRANSFORM_QUANTITY = np.repeat([0, 2], [3, 4])

_NUMPY = {
    PackedElementField.FLOAT32: "<f4",
    PackedElementField.FLOAT64: "<f8",
    PackedElementField.UINT8: "u1",
}

_SIDE = 3e-9
"""How far to look to either side of an instant at which a value jumps [s]."""


@dataclass(slots=True)
class _Compared:
    """The worst sample of one kind, as error over what is allowed."""

    value: float = 0.0
    where: Place = Place()
    samples: int = 0
    bad: int = 0

    def check(self, name: str, *notes: str) -> Check:
        found = (f"{self.samples:,} numbers compared", *notes)
        if self.bad:
            found += (f"{self.bad:,} of them are off",)
        return Check(
            GROUP,
            name,
            "pass" if self.bad == 0 and self.samples else "fail",
            self.value,
            1.0,
            "of the rounding allowed",
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
    comparison = _Comparison(log, show, grids)
    topics = {channel.topic: number for number, channel in log.channels.items()}
    if FLEET not in topics:
        return [Check(GROUP, "samples", "fail", notes=(f"there is no {FLEET}",))]
    checks = [
        _times(log, show, topics[FLEET]),
        comparison.fleet(topics[FLEET]),
    ]
    single = {
        number: int(match[1]) - 1
        for topic, number in topics.items()
        if (match := DRONE_STATE.fullmatch(topic))
    }
    if single:
        checks.append(comparison.single(single, topics[FLEET]))
    if TRANSFORMS in topics:
        checks.append(comparison.transforms(topics[TRANSFORMS]))
    return checks


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
        self.fleet_at = Fleet(show)
        self.grids = grids

    def seconds(self, times: IntArray) -> FloatArray:
        """Show time of time stamps [s]."""
        return np.asarray((times - self.show.epoch) * 1e-9)

    def fleet(self, channel: int) -> Check:
        """Check the messages of the whole fleet."""
        worst = _Compared()
        layout: np.dtype[np.void] | None = None
        for data, m, offset in self.log.read({channel}):
            clouds = []
            for start, size in zip(m.payload.tolist(), m.size.tolist(), strict=True):
                cloud = _decode(PointCloud, data[start : start + size], offset)
                layout = layout or _point_layout(cloud, offset)
                clouds.append(_points(cloud, layout, self.show.drones, offset))
            points = np.stack(clouds)
            values = np.stack([points[name] for name in _POINT_FIELDS], axis=-1)
            times = self.seconds(m.log_time)
            drones = np.arange(self.show.drones)
            self._compare(
                worst,
                values.astype(np.float64),
                times,
                drones,
                "point",
                _POINT_QUANTITY,
            )
        return worst.check("fleet samples equal to the polynomials")

    def single(self, channels: dict[int, int], fleet: int) -> Check:
        """Check the messages of single drones, which must be as many as the fleet's."""
        worst = _Compared()
        expected = self.log.times(fleet)
        for channel, drone in channels.items():
            times = self.log.times(channel)
            if drone >= self.show.drones or not np.array_equal(times, expected):
                return Check(
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
            values = np.stack(list(table.values()), axis=-1)
            owner = np.array([channels[number] for number in m.channel.tolist()])
            moments, index = np.unique(m.log_time, return_inverse=True)
            grid = np.full((moments.size, self.show.drones, values.shape[1]), np.nan)
            grid[index, owner] = values
            drones = np.unique(owner)
            self._compare(
                worst,
                grid[:, drones],
                self.seconds(moments),
                drones,
                "state",
                _STATE_QUANTITY,
            )
        return worst.check("samples of single drones equal to the polynomials")

    def transforms(self, channel: int) -> Check:
        """Check the frames of the drones."""
        worst = _Compared()
        for data, m, offset in self.log.read({channel}):
            for start, size, time in zip(
                m.payload.tolist(), m.size.tolist(), m.log_time, strict=True
            ):
                message = _decode(FrameTransforms, data[start : start + size], offset)
                drones, values = _frames(message, self.show.drones, offset)
                if drones.size:
                    self._compare(
                        worst,
                        values[None],
                        self.seconds(np.array([time])),
                        drones,
                        "transform",
                        _TRANSFORM_QUANTITY,
                    )
        if worst.samples == 0:
            return Check(
                GROUP,
                "frames of the drones equal to the polynomials",
                "skipped",
                notes=("the log has none",),
            )
        return worst.check("frames of the drones equal to the polynomials")

    def _compare(
        self,
        worst: _Compared,
        values: FloatArray,
        times: FloatArray,
        drones: IntArray,
        kind: str,
        quantity: IntArray,
    ) -> None:
        """Compare values (times, drones, fields); NaN means: not logged."""
        flown = self.fleet_at(times)[:, drones]
        ratio = self._ratio(values, flown, kind, quantity)
        late = np.flatnonzero(np.any(ratio > 1.0, axis=(1, 2)))
        for index in late.tolist():
            for side in (-_SIDE, _SIDE):
                other = self.fleet_at(times[index : index + 1] + side)[:, drones]
                again = self._ratio(values[index : index + 1], other, kind, quantity)
                ratio[index] = np.minimum(ratio[index], again[0])
        worst.samples += int(np.sum(~np.isnan(values)))
        worst.bad += int(np.sum(ratio > 1.0))
        greatest = float(ratio.max(initial=0.0))
        if greatest > worst.value:
            place = np.unravel_index(int(np.argmax(ratio)), ratio.shape)
            worst.value = greatest
            worst.where = Place(
                drone=int(drones[place[1]]) + 1, time=float(times[place[0]])
            )

    def _ratio(
        self, values: FloatArray, flown: FloatArray, kind: str, quantity: IntArray
    ) -> FloatArray:
        """Error over what is allowed, shape of ``values``; 0 where not logged."""
        expected = _expected(flown, kind)
        if kind != "state":
            values = _same_sign(values, expected, kind)
        allowed = 0.5 * self.grids[quantity] + 2.0**-23 * np.abs(expected)
        allowed = (
            allowed + 1e-9 * (1.0 + np.abs(expected)) + self._drift(flown, quantity)
        )
        ratio = np.abs(values - expected) / allowed
        missing = np.isnan(values)
        if kind == "state":
            return np.where(missing, 0.0, ratio)
        return np.where(missing, np.inf, ratio)

    def _drift(self, flown: FloatArray, quantity: IntArray) -> FloatArray:
        """Change of each field within the rounding of time, one for all samples."""
        fastest = np.abs(flown[..., [3, 4, 5, 9, 10, 11]]).max(initial=0.0)
        rate = np.array([fastest, 100.0, fastest, 1e3, 1e3, 1e2])
        return np.asarray(1e-9 * rate[quantity])


def _expected(flown: FloatArray, kind: str) -> FloatArray:
    """Fields of a sample from states and controls (..., 16)."""
    if kind == "state":
        return flown
    turned = _quaternion(flown[..., 6:9])
    if kind == "transform":
        return np.concatenate([flown[..., :3], turned], axis=-1)
    return np.concatenate([flown[..., :6], turned, flown[..., 9:]], axis=-1)


def _quaternion(angles: FloatArray) -> FloatArray:
    """Rotation by roll about x, then pitch about y, then yaw about z: x, y, z, w."""
    roll, pitch, yaw = np.moveaxis(0.5 * angles, -1, 0)
    # Product of the three elementary quaternions qz qy qx.
    a = np.cos(yaw) * np.cos(pitch)
    b = np.sin(yaw) * np.sin(pitch)
    c = np.cos(yaw) * np.sin(pitch)
    d = np.sin(yaw) * np.cos(pitch)
    sine, cosine = np.sin(roll), np.cos(roll)
    return np.stack(
        [
            a * sine - b * cosine,
            c * cosine + d * sine,
            d * cosine - c * sine,
            a * cosine + b * sine,
        ],
        axis=-1,
    )


def _same_sign(values: FloatArray, expected: FloatArray, kind: str) -> FloatArray:
    """A quaternion and its negative are one rotation."""
    part = slice(3, 7) if kind == "transform" else slice(6, 10)
    product = np.sum(values[..., part] * expected[..., part], axis=-1, keepdims=True)
    if np.all(product >= 0.0):
        return values
    result = values.copy()
    result[..., part] *= np.where(product < 0.0, -1.0, 1.0)
    return result


def _decode(kind, data, offset):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    try:
        return kind.FromString(data)
    except (DecodeError, RecursionError, MemoryError) as error:
        raise Damage(
            offset, f"a {kind.DESCRIPTOR.full_name} does not decode"
        ) from error


def _point_layout(cloud: PointCloud, offset: int) -> np.dtype[np.void]:
    """Read the layout of a point from the message's own description."""
    names = [field.name for field in cloud.fields]
    known = all(field.type in _NUMPY for field in cloud.fields)
    if (
        not known
        or len(set(names)) != len(names)
        or not set(_POINT_FIELDS) <= set(names)
    ):
        raise Damage(offset, f"{FLEET} does not describe its points")
    try:
        return np.dtype(
            {
                "names": names,
                "formats": [_NUMPY[field.type] for field in cloud.fields],
                "offsets": [field.offset for field in cloud.fields],
                "itemsize": cloud.point_stride,
            }
        )
    except (ValueError, TypeError) as error:
        raise Damage(offset, f"{FLEET} does not describe its points") from error


def _points(
    cloud: PointCloud, layout: np.dtype[np.void], drones: int, offset: int
) -> NDArray[np.void]:
    if (
        cloud.point_stride != layout.itemsize
        or len(cloud.data) != drones * layout.itemsize
    ):
        raise Damage(offset, f"a message on {FLEET} does not hold {drones} drones")
    return np.frombuffer(cloud.data, dtype=layout)


def _frames(
    message: FrameTransforms, drones: int, offset: int
) -> tuple[IntArray, FloatArray]:
    """Drones and their x y z, qx qy qz qw; other frames are left aside."""
    found, rows = [], []
    for frame in _drone_frames(message):
        drone = int(frame.child_frame_id.removeprefix("drone_")) - 1
        if not 0 <= drone < drones:
            raise Damage(offset, f"{TRANSFORMS} names {frame.child_frame_id!r}")
        t, q = frame.translation, frame.rotation
        found.append(drone)
        rows.append((t.x, t.y, t.z, q.x, q.y, q.z, q.w))
    return np.array(found, dtype=np.int64), np.array(rows).reshape(-1, 7)


def _drone_frames(message: FrameTransforms) -> Iterator:  # type: ignore[type-arg]
    return (
        frame for frame in message.transforms if _FRAME.fullmatch(frame.child_frame_id)
    )
