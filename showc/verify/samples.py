"""What a viewer shows, held against the polynomials and the script.

Samples are float32 numbers rounded to a grid. Allowed is half a step of the grid, the
rounding of float32, and the change of the quantity within the nanosecond to which the
sample's time is rounded. Where controls jump, between two mesh intervals, the value on
either side is right. Everything else in a message (names, frames, poses, time stamps,
layouts) must be to the byte what showc writes.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property, partial
from typing import TYPE_CHECKING, Literal

import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp

from showc.light.colour import drive_bytes, srgb_bytes
from showc.log.scene import root_transform, scene_update
from showc.verify.decode import parse
from showc.verify.fleet import flown
from showc.verify.report import Check, Place

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from numpy.typing import NDArray

    from showc.arrays import FloatArray, IntArray
    from showc.light.program import LightProgram
    from showc.script.show import Show
    from showc.verify.kernel.show import LoggedShow
    from showc.verify.logfile import LogFile, Messages


FLEET, PREDICTED, TRANSFORMS = "/fleet/state", "/fleet/predicted", "/tf"
SCENE, RULES, SEGMENTS = "/show/scene", "/show/rules", "/show/segments"
GROUP = "samples"

GRIDS = {
    "position": 2.0**-10,
    "velocity": 2.0**-10,
    "attitude": 2.0**-15,
    "body_rate": 2.0**-12,
    "thrust": 2.0**-12,
    "torque": 2.0**-17,
}
"""Samples are whole multiples of these (SI units)."""

SMALL_FLEET = 100
"""Fleets up to this size have topics for each drone."""

FRAME_RATE = 5.0
"""Frames of single drones per second [Hz]."""

SHARES = 32
"""Parts of the file whose samples can be compared side by side."""

COLOUR_ERROR = 1
"""How far a colour byte may be off: the rounding of another library's powers."""

PREDICTED_COLOUR = (128, 128, 128, 255)
"""Screen colour of the predicted fleet."""

_SIDE = 3e-9
"""How far to look to either side of an instant at which a value jumps [s]."""

_NAMES = (
    *("x", "y", "z", "red", "green", "blue", "alpha", "vx", "vy", "vz"),
    *("qx", "qy", "qz", "qw", "wx", "wy", "wz", "u0", "u1", "u2", "u3"),
)
_COLOURS = ("red", "green", "blue", "alpha")
_POINT = np.dtype([(name, "u1" if name in _COLOURS else "<f4") for name in _NAMES])
_PLACE = np.dtype([(name, _POINT[name]) for name in _NAMES[:7]])
_NUMBERS = tuple(name for name in _NAMES if name not in _COLOURS)

_FIELDS = (3, 3, 3, 3, 1, 3, 3)
"""Numbers in each field of a ``showc.DroneState``; the last is its colour."""


def _state_layout() -> np.dtype[np.void]:
    """Bytes of a ``showc.DroneState``: tags and lengths as "h", numbers as "v"."""
    parts: list[tuple[str, str]] = []
    for number, size in enumerate(_FIELDS):
        heads = 1 if size == 1 else 2
        parts += [(f"h{len(parts) + k}", "u1") for k in range(heads)]
        for axis in range(size):
            if size > 1:
                parts.append((f"h{len(parts)}", "u1"))
            parts.append((f"v{number}{axis}", "<f8"))
    return np.dtype(parts)


def _state_heads() -> list[int]:
    """Return the tags and lengths of that layout, in order."""
    heads = []
    for number, size in enumerate(_FIELDS, 1):
        if size == 1:
            heads.append(number << 3 | 1)
        else:
            heads += [number << 3 | 2, 9 * size]
            heads += [axis << 3 | 1 for axis in range(1, size + 1)]
    return heads


_STATE, _HEADS = _state_layout(), _state_heads()

Kind = Literal["point", "state", "transform"]

_QUANTITIES = {
    "point": np.repeat([0, 1, 2, 3, 4, 5], [3, 3, 4, 3, 1, 3]),
    "state": np.repeat([0, 1, 2, 3, 4, 5], [3, 3, 3, 3, 1, 3]),
    "transform": np.repeat([0, 2], [3, 4]),
}
"""Which of ``GRIDS`` each field of a sample has."""

_STEPS = np.array(list(GRIDS.values()))

_CHECKS = {
    "VRF120": "topics and times of messages are those of the show",
    "VRF121": "samples at every step of the log rate",
    "VRF122": "fleet samples equal to the polynomials",
    "VRF123": "samples of single drones equal to the polynomials",
    "VRF124": "frames of the drones equal to the polynomials",
    "VRF125": "colours are those of the script",
    "VRF126": "drawn scene is that of the script",
    "VRF127": "predicted fleet drawn as showc draws it",
}


@dataclass(slots=True)
class Compared:
    """The worst sample of one kind, as error over what is allowed."""

    value: float = 0.0
    where: Place = field(default_factory=Place)
    samples: int = 0
    bad: int = 0
    odd: list[str] = field(default_factory=list)
    """What is wrong besides numbers."""

    def join(self, other: Compared) -> None:
        """Add what was found in other samples of the kind."""
        self.samples += other.samples
        self.bad += other.bad
        self.odd += other.odd
        if other.value > self.value:
            self.value, self.where = other.value, other.where

    def see(self, ratio: FloatArray, times: FloatArray, drones: IntArray) -> None:
        """Look at errors over what is allowed, shape (fields, times, drones)."""
        self.samples += ratio.size
        greatest = float(ratio.max(initial=0.0))
        if greatest > 1.0:
            self.bad += int(np.sum(ratio > 1.0))
        if greatest > self.value:
            # The first in time, then of the drones, among equals.
            worst_of = ratio.max(axis=0)
            time, drone = np.unravel_index(int(np.argmax(worst_of)), worst_of.shape)
            self.value = greatest
            self.where = Place(drone=int(drones[drone]) + 1, time=float(times[time]))

    def check(self, code: str) -> Check:
        """Turn into a check."""
        notes = [f"{self.samples:,} numbers compared"] if self.samples else []
        if self.bad:
            notes.append(f"{self.bad:,} of them are off")
        return Check(
            code,
            GROUP,
            _CHECKS[code],
            "fail" if self.bad or self.odd else "pass",
            self.value if self.samples else None,
            1.0 if self.samples else None,
            "of the rounding" if self.samples else "",
            self.where,
            (*notes, *self.odd[:3]),
        )


Found = dict[str, Compared]
"""What was found, by the code of the check."""


def join(found: Iterable[Found]) -> list[Check]:
    """Turn what the parts found into checks."""
    whole: defaultdict[str, Compared] = defaultdict(Compared)
    for part in found:
        for code, compared in part.items():
            whole[code].join(compared)
    return [compared.check(code) for code, compared in sorted(whole.items())]


def sample_times(duration: float, rate: float) -> IntArray:
    """Return times of samples since the start [ns]: the grid k / rate, and the end."""
    end = round(Fraction(duration) * 1_000_000_000)
    step = 1_000_000_000 / Fraction(rate).limit_denominator(1_000_000)
    count = end * step.denominator // step.numerator
    times = np.arange(count + 1, dtype=np.int64) * step.numerator // step.denominator
    return times if times[-1] == end else np.append(times, end)


class Samples:
    """Everything of a log that a viewer shows.

    Parameters
    ----------
    log
        The file.
    show
        Its polynomials.
    lights
        Light that the script asks for; None if its legs are not the log's.
    script
        The script; None if it cannot be read.
    """

    def __init__(
        self,
        log: LogFile,
        show: LoggedShow,
        lights: LightProgram | None,
        script: Show | None,
    ) -> None:
        self.log, self.show, self.lights, self.script = log, show, lights, script
        self.topics = {c.topic: number for number, c in log.channels.items()}
        self.all = np.arange(show.drones)
        self.single = {
            self.topics[topic]: drone
            for drone in range(show.drones if show.drones <= SMALL_FLEET else 0)
            if (topic := f"/drone/{drone + 1:04d}/state") in self.topics
        }

    def parts(self) -> list[Callable[[], Found]]:
        """Return comparisons that can be made side by side."""
        parts: list[Callable[[], Found]] = [self.outline, self.frames, self.predicted]
        if FLEET in self.topics:
            parts += [partial(self.fleet, share) for share in range(SHARES)]
        if self.single:
            parts += [partial(self.states, share) for share in range(SHARES)]
        return parts

    @cached_property
    def times(self) -> IntArray:
        """Time stamps at which the fleet is sampled [ns]."""
        found = sample_times(self.show.duration, self.show.rules.log_rate)
        return found + self.show.epoch

    def outline(self) -> Found:
        """Check topics, times of messages, and the scene."""
        show, log = self.show, self.log
        fleet = range(1, show.drones + 1)
        small = show.drones <= SMALL_FLEET
        wanted = {RULES, SEGMENTS, SCENE, TRANSFORMS, FLEET}
        wanted |= {f"/drone/{drone:04d}/trajectory" for drone in fleet}
        wanted |= {f"/drone/{drone:04d}/state" for drone in fleet if small}
        topics, steps = Compared(), Compared()
        names = [channel.topic for channel in log.channels.values()]
        topics.odd += [f"{name} is missing" for name in sorted(wanted - set(names))]
        topics.odd += [
            f"showc writes no {name!r} for this show"
            for name in sorted(set(names) - wanted - {PREDICTED})
        ]
        if len(set(names)) != len(names):
            topics.odd.append("a topic has two channels")
        start = np.array([show.epoch])
        stride = max(1, round(show.rules.log_rate / FRAME_RATE))
        frames = np.concatenate([start, self.times[::stride]]) if small else start
        singles = sorted(name for name in names if name.endswith("/state"))
        for found, topic, times in (
            (topics, RULES, start),
            (topics, SCENE, start),
            (topics, TRANSFORMS, frames),
            *((steps, topic, self.times) for topic in {FLEET, *singles}),
        ):
            if not np.array_equal(log.times(self.topics.get(topic, -1)), times):
                found.odd.append(f"{topic} has messages at other times")
        return {"VRF120": topics, "VRF121": steps, "VRF126": self._scene()}

    def _scene(self) -> Compared:
        """Compare the scene, which is the same throughout."""
        scene = Compared()
        if self.script is None:
            scene.odd.append("not compared: the script cannot be read")
            return scene
        drawn = scene_update(self.show.epoch, self.script)
        for data, m, offset in self.log.read({self.topics.get(SCENE, -1)}):
            for start, size in zip(m.payload, m.size, strict=True):
                if parse(SceneUpdate, data[start : start + size], offset) != drawn:
                    scene.odd.append("it is another scene")
        return scene

    def fleet(self, share: int) -> Found:
        """Compare the messages of the whole fleet in one share of the file."""
        numbers, colours = Compared(), Compared()
        for data, m, offset in self.log.read({self.topics[FLEET]}, share, SHARES):
            points = self._points(data, m, offset, _POINT, numbers)
            if points is None:
                continue
            values = np.stack([points[name] for name in _NUMBERS])
            seconds = self._seconds(m.log_time)
            self._compare(numbers, values, seconds, self.all, "point")
            if self.lights is None:
                colours.odd.append("not compared: the legs are not the script's")
                continue
            light = srgb_bytes(self.lights.linear(seconds))
            wanted = [*np.moveaxis(light, -1, 0), np.full(points.shape, 255)]
            off = np.stack(
                [
                    np.abs(points[name].astype(np.int64) - shade)
                    for name, shade in zip(_COLOURS, wanted, strict=True)
                ]
            )
            colours.see(off / COLOUR_ERROR, seconds, self.all)
        return {"VRF122": numbers, "VRF125": colours}

    def states(self, share: int) -> Found:
        """Compare the messages of single drones in one share of the file."""
        numbers, colours = Compared(), Compared()
        for data, m, _ in self.log.read(set(self.single), share, SHARES):
            sized = m.size == _STATE.itemsize
            # Whatever stands where another size does is not compared, but odd.
            begin = np.where(sized, m.payload, 0)
            raw = np.frombuffer(data.ljust(_STATE.itemsize, b"\0"), dtype=np.uint8)
            rows = raw[begin[:, None] + np.arange(_STATE.itemsize)]
            table = np.ascontiguousarray(rows).view(_STATE)[:, 0]
            heads = [name for name in _STATE.names or () if name[0] == "h"]
            for name, value in zip(heads, _HEADS, strict=True):
                sized &= table[name] == value
            moments, index = np.unique(m.log_time, return_inverse=True)
            seconds = self._seconds(moments)
            owner = np.array([self.single[number] for number in m.channel.tolist()])
            if not sized.all():
                row = int(np.argmin(sized))
                numbers.odd.append("a sample is not laid out as showc's are")
                numbers.value = np.inf
                numbers.where = Place(
                    drone=int(owner[row]) + 1, time=float(seconds[index[row]])
                )
                continue
            every = [table[name] for name in _STATE.names or () if name[0] == "v"]
            grid = np.full((len(every), moments.size, self.show.drones), np.nan)
            # Undefined numbers must not pass for drones that have no samples.
            grid[:, index, owner] = np.nan_to_num(np.stack(every), nan=np.inf)
            drones = np.unique(owner)
            self._compare(numbers, grid[:16, :, drones], seconds, drones, "state")
            if self.lights is None:
                colours.odd.append("not compared: the legs are not the script's")
                continue
            light = drive_bytes(self.lights.linear(seconds)[:, drones])
            off = np.abs(grid[16:, :, drones] * 255.0 - np.moveaxis(light, -1, 0))
            off = np.where(np.isnan(grid[16:, :, drones]), 0.0, off)
            colours.see(off / COLOUR_ERROR, seconds, drones)
        return {"VRF123": numbers, "VRF125": colours}

    def frames(self) -> Found:
        """Compare the frames of the drones, and of the show."""
        worst, first = Compared(), True
        for data, m, offset in self.log.read({self.topics.get(TRANSFORMS, -1)}):
            for start, size, time in zip(
                m.payload.tolist(), m.size.tolist(), m.log_time.tolist(), strict=True
            ):
                message = parse(FrameTransforms, data[start : start + size], offset)
                if first:
                    first = False
                    root = (
                        [root_transform(time, self.script.site)] if self.script else []
                    )
                    if message != FrameTransforms(transforms=root):
                        worst.odd.append("the show's own frame is not the script's")
                    continue
                values = []
                for frame in message.transforms:
                    t, q = frame.translation, frame.rotation
                    values.append((t.x, t.y, t.z, q.x, q.y, q.z, q.w))
                    # What else the frame says must be what showc writes.
                    t.CopyFrom(Vector3())
                    q.CopyFrom(Quaternion())
                if message != self._frames(time):
                    worst.odd.append("frames are not those of the drones")
                    continue
                table = np.array(values).T[:, None]
                seconds = self._seconds(np.array([time]))
                self._compare(worst, table, seconds, self.all, "transform")
        return {"VRF124": worst}

    def predicted(self) -> Found:
        """Check how the predicted fleet is drawn; where, is the missions' matter."""
        if PREDICTED not in self.topics:
            return {}
        worst = Compared()
        for data, m, offset in self.log.read({self.topics[PREDICTED]}):
            points = self._points(data, m, offset, _PLACE, worst)
            if points is not None and any(
                np.any(points[name] != value)
                for name, value in zip(_COLOURS, PREDICTED_COLOUR, strict=True)
            ):
                worst.odd.append("it has another colour")
        rate = self.show.rules.log_rate
        found = self.log.times(self.topics[PREDICTED]) - self.show.epoch
        end = float(found[-1]) * 1e-9 if found.size else 0.0
        if not np.array_equal(found[:-1], sample_times(end, rate)[:-1]):
            worst.odd.append("its samples are not at the steps of the log rate")
        return {"VRF127": worst}

    def _frames(self, time: int) -> FrameTransforms:
        """Frames of all drones without their places."""
        return FrameTransforms(
            transforms=[
                FrameTransform(
                    timestamp=_stamp(time),
                    parent_frame_id="map",
                    child_frame_id=f"drone_{drone + 1:04d}",
                    translation=Vector3(),
                    rotation=Quaternion(),
                )
                for drone in range(self.show.drones)
            ]
        )

    def _points(
        self,
        data: bytes,
        m: Messages,
        offset: int,
        layout: np.dtype[np.void],
        found: Compared,
    ) -> NDArray[np.void] | None:
        """Return points (times, drones) of a chunk; None if they are laid out oddly."""
        template = PointCloud(
            frame_id="map",
            pose=Pose(position=Vector3(), orientation=Quaternion(w=1.0)),
            point_stride=layout.itemsize,
            fields=[
                PackedElementField(
                    name=name,
                    offset=entry[1],
                    type=PackedElementField.UINT8
                    if entry[0].itemsize == 1
                    else PackedElementField.FLOAT32,
                )
                for name, entry in (layout.fields or {}).items()
            ],
        )
        points = np.empty((m.size.size, self.show.drones), dtype=layout)
        for row, (start, size, time) in enumerate(
            zip(m.payload.tolist(), m.size.tolist(), m.log_time.tolist(), strict=True)
        ):
            cloud = parse(PointCloud, data[start : start + size], offset)
            content = cloud.data
            cloud.ClearField("data")
            template.timestamp.CopyFrom(_stamp(time))
            if cloud != template:
                found.odd.append("a point cloud says other things than showc's do")
                return None
            if len(content) != points[row].nbytes:
                found.odd.append(
                    f"a point cloud does not hold {points.shape[1]} drones"
                )
                return None
            points[row] = np.frombuffer(content, dtype=layout)
        return points

    def _seconds(self, times: IntArray) -> FloatArray:
        """Show time of time stamps [s]."""
        return np.asarray((times - self.show.epoch) / 1e9)

    def _compare(
        self,
        worst: Compared,
        values: FloatArray,
        times: FloatArray,
        drones: IntArray,
        kind: Kind,
    ) -> None:
        """Compare values (fields, times, drones); NaN in states means: not logged."""
        ratio = self._ratio(values, self._flown(times, drones), kind)
        late = np.flatnonzero(ratio.max(axis=(0, 2), initial=0.0) > 1.0)
        for index in late.tolist():
            one = slice(index, index + 1)
            for side in (-_SIDE, _SIDE):
                other = self._flown(times[one] + side, drones)
                again = self._ratio(values[:, one], other, kind)
                ratio[:, one] = np.minimum(ratio[:, one], again)
        worst.see(ratio, times, drones)

    def _flown(self, times: FloatArray, drones: IntArray) -> FloatArray:
        """State and control of some drones, shape (16, times, drones)."""
        return flown(self.show, times)[..., drones]

    def _ratio(self, values: FloatArray, flown: FloatArray, kind: Kind) -> FloatArray:
        """Error over what is allowed, shape of ``values``; 0 where not logged."""
        expected = _expected(flown, kind)
        quantity = _QUANTITIES[kind]
        fixed = 0.5 * _STEPS[quantity] + _drift(flown)[quantity] + 1e-9
        ratio = np.abs(values - expected)
        allowed = np.abs(expected, out=expected)
        allowed *= 2.0**-23 + 1e-9
        allowed += fixed[:, None, None]
        ratio /= allowed
        ratio[np.isnan(ratio)] = np.inf
        if kind == "state":
            ratio[np.isnan(values)] = 0.0
        return ratio


def _drift(flown: FloatArray) -> FloatArray:
    """Change of each quantity within the nanosecond of rounding, shape (6,)."""
    fastest = max(
        float(max(rows.max(initial=0.0), -rows.min(initial=0.0)))
        for rows in (flown[3:6], flown[9:12])
    )
    return 1e-9 * np.array([fastest, 100.0, fastest, 1e3, 1e3, 1e2])


def _stamp(time: int) -> Timestamp:
    return Timestamp(seconds=time // 1_000_000_000, nanos=time % 1_000_000_000)


def _expected(flown: FloatArray, kind: Kind) -> FloatArray:
    """Fields (fields, ...) of a sample from states and controls (16, ...)."""
    if kind == "state":
        return flown.copy()
    turned = _quaternion(*flown[6:9])
    if kind == "transform":
        return np.concatenate([flown[:3], turned])
    return np.concatenate([flown[:6], turned, flown[9:]])


def _quaternion(roll: FloatArray, pitch: FloatArray, yaw: FloatArray) -> FloatArray:
    """Rotation by roll about x, then pitch about y, then yaw about z: x, y, z, w."""
    # Product of the three elementary quaternions qz qy qx.
    half = 0.5 * pitch
    pitched, level = np.sin(half), np.cos(half)
    half = 0.5 * roll
    rolled, upright = np.sin(half), np.cos(half)
    result = np.stack(
        [level * rolled, pitched * upright, -pitched * rolled, level * upright]
    )
    if not yaw.any():
        return result
    x, y, z, w = result.copy()
    half = 0.5 * yaw
    sine, cosine = np.sin(half), np.cos(half)
    result *= cosine
    result += np.stack([-sine * y, sine * x, sine * w, -sine * z])
    return result
