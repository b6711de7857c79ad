"""What a viewer shows, held against the polynomials and the script.

Samples are float32 numbers rounded to a grid. Allowed is half a step of the grid, the
rounding of float32, and the change of the quantity within the nanosecond to which the
sample's time is rounded. Where controls jump, between two mesh intervals, the value on
either side is right. Everything else in a message (names, frames, poses, time stamps,
layouts) must be to the byte what showc writes: the numbers are taken out, and what the
log's own encoders make of them is compared.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import groupby, islice
from typing import TYPE_CHECKING

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from numpy.lib.recfunctions import structured_to_unstructured

from showc.documents.values import unlike
from showc.light.colour import drive_bytes, srgb_bytes
from showc.log import sample
from showc.log.scene import fleet_transforms, point_cloud, root_transform, scene_update
from showc.log.schema import FLEET, PREDICTED, RULES, SCENE, SEGMENTS, TRANSFORMS
from showc.verify.kernel.bernstein import basis
from showc.verify.kernel.slices import Tracks
from showc.verify.report import Check, Place, checked

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from google.protobuf.message import Message as ProtobufMessage
    from numpy.typing import NDArray

    from showc.arrays import FloatArray, IntArray
    from showc.light.program import LightProgram
    from showc.log.container import LogFile, Message
    from showc.script.show import Show
    from showc.verify.kernel.show import LoggedShow, PieceTable
    from showc.verify.missions.separation import Tubes

SHARES = 32
"""Parts of the file whose samples can be compared side by side."""

_SIDE = 3e-9
"""How far to look to either side of an instant at which a value jumps [s]."""

_COLOURS = ("red", "green", "blue", "alpha")
_NUMBERS = tuple(name for name in sample.POINT.names or () if name not in _COLOURS)
_STATE = tuple(
    name for name in sample.DRONE_STATE.names or () if sample.DRONE_STATE[name] == "<f8"
)
_BETWEEN = set(sample.DRONE_STATE.names or ()) - {*_STATE}
_TEMPLATE = sample.pack_drone_states(
    np.zeros((1, 1, 12)), np.zeros((1, 1, 4)), np.zeros((1, 1, 3))
)[0]
"""A ``showc.DroneState`` of zeros: what stands between the numbers."""

_ENCODERS = {"VRF122": srgb_bytes, "VRF123": drive_bytes}
"""How light becomes colour bytes, on the screen and on the lamps."""

_STEPS = np.array(list(sample.GRID.values()))
"""Of position, velocity, attitude, rates, thrust and torques."""

_LARGEST = 256  # bytes of each drone in a message that is read: frames have 100
_AT_ONCE = 16384  # places on polynomials evaluated together; bounds the memory


def flown(show: LoggedShow, times: FloatArray) -> FloatArray:
    """State and control (n, drones, 16) at show times (n,) [s].

    At the joint of two segments the later one counts; before the first one a drone is
    as at its start, after the last one as at its end.
    """
    result = np.empty((times.size, show.drones, 16))
    starts = np.array([segment.start for segment in show.segments])
    number = np.maximum(np.searchsorted(starts, times, side="right") - 1, 0)
    for chosen in np.unique(number).tolist():
        at, segment = np.flatnonzero(number == chosen), show.segments[chosen]
        result[at] = evaluate(segment.table, times[at] - segment.start)
    return result


def evaluate(table: PieceTable, times: FloatArray) -> FloatArray:
    """State and control (n, drones of the table, 16) at times (n,) of a segment [s].

    Of a table with fewer columns, those that it has. At the joint of two mesh intervals
    the later one counts.
    """
    drones = np.arange(table.drones.size)[:, None]
    both = [some for some in (table.state, table.control) if some.size]
    result = np.empty((drones.size * times.size, sum(x.shape[2] for x in both)))
    order = np.arange(len(result)).reshape(times.size, -1).T
    ends = 0.0, float(table.end.max())
    tracks = Tracks(*ends, table.first, table.start, table.end, table.state[:, :, :3])
    moments = np.clip(times, *ends)
    for part in np.array_split(drones, 1 + len(result) // (2 * _AT_ONCE)):
        row = tracks.at(part, moments).ravel()
        start, end = table.start[row], table.end[row]
        share = np.clip((np.tile(moments, len(part)) - start) / (end - start), 0.0, 1.0)
        # Drone after drone, places on one polynomial are next to each other.
        begin = np.flatnonzero(np.diff(row, prepend=-1))
        count, own = np.diff(begin, append=row.size), order[part].ravel()
        for many in np.unique(count):
            first = begin[count == many]
            at = first[:, None] + np.arange(many)
            values = [basis(x.shape[1] - 1, share[at]) @ x[row[first]] for x in both]
            result[own[at]] = np.concatenate(values, axis=2)
    return result.reshape(times.size, drones.size, -1)


@dataclass(slots=True)
class Compared:
    """The worst sample of one kind, as error over what is allowed."""

    value: float = 0.0
    where: Place = field(default_factory=Place)
    samples: int = 0
    bad: int = 0
    odd: list[str] = field(default_factory=list)
    """What is wrong besides numbers."""

    def see(self, ratio: FloatArray, times: FloatArray, drones: IntArray) -> None:
        """Look at errors over what is allowed, (n, fields), at times of drones."""
        self.samples += ratio.size
        top = float(ratio.max(initial=0.0))
        self.bad += 0 if top <= 1.0 else int(np.sum(~(ratio <= 1.0)))
        if not top <= self.value:
            worst_of = np.where(np.isnan(ratio), np.inf, ratio).max(axis=1)
            self.value, at = float(worst_of.max()), int(worst_of.argmax())
            self.where = Place(drone=int(drones[at]) + 1, time=float(times[at]))

    def check(self, code: str) -> Check:
        """Turn into a check."""
        holds = not (self.bad or self.odd)
        notes = [f"{self.samples:,} numbers compared"] * bool(self.samples)
        notes += [f"{self.bad:,} of them are off"] * bool(self.bad) + self.odd[:3]
        facts = (self.value, 1.0, "of what is allowed") if self.samples else ()
        return checked(code, holds, *facts, where=self.where, notes=tuple(notes))


Found = dict[str, Compared]
"""What was found, by the code of the check."""


def join(found: Iterable[Found]) -> list[Check]:
    """Turn what the parts found into checks."""
    whole: defaultdict[str, Compared] = defaultdict(Compared)
    for code, one in (seen for part in found for seen in part.items()):
        before = whole[code]
        worst = one if one.value > before.value else before
        counts = before.samples + one.samples, before.bad + one.bad
        whole[code] = Compared(worst.value, worst.where, *counts, before.odd + one.odd)
    return [compared.check(code) for code, compared in sorted(whole.items())]


class Samples:
    """Everything of a log that a viewer shows, by its polynomials and its script.

    ``lights`` are those that the script asks for; ``tubes`` is where missions fly, None
    if that is not looked at, or cannot be said.
    """

    def __init__(
        self,
        log: LogFile,
        show: LoggedShow,
        lights: LightProgram,
        script: Show,
        tubes: Tubes | None,
    ) -> None:
        self.log, self.show, self.script = log, show, script
        self.lights, self.tubes = lights, tubes
        self.topics = {c.topic: number for number, c in log.channels.items()}
        small = range(show.drones if show.drones <= sample.SMALL_FLEET else 0)
        own = ((self.topics.get(f"/drone/{n + 1:04d}/state"), n) for n in small)
        self.single = {channel: n for channel, n in own if channel is not None}

    def parts(self) -> list[Callable[[], Found]]:
        """Return comparisons that can be made side by side."""
        looks = [self.clouds, *[self.states] * bool(self.single)]
        parts = (partial(look, share) for look in looks for share in range(SHARES))
        return [self.outline, self.frames, *parts]

    @cached_property
    def times(self) -> IntArray:
        """Time stamps at which the fleet is sampled [ns]."""
        found = sample.sample_times(self.show.duration, self.show.rules.log_rate)
        return found + self.show.epoch

    def outline(self) -> Found:
        """Check topics, times of messages, and the scene."""
        drones = range(1, self.show.drones + 1)
        small = self.show.drones <= sample.SMALL_FLEET
        start = np.array([self.show.epoch])
        stride = max(1, round(self.show.rules.log_rate / sample.TRANSFORM_RATE))
        frames = np.concatenate([start, self.times[::stride]]) if small else start
        wanted = {RULES: start, SCENE: start, TRANSFORMS: frames, FLEET: self.times}
        wanted |= {f"/drone/{n:04d}/state": self.times for n in drones if small}
        # Their times are held against those of the segments.
        others = {SEGMENTS, *(f"/drone/{n:04d}/trajectory" for n in drones)}
        topics, steps = Compared(), Compared()
        names = [channel.topic for channel in self.log.channels.values()]
        both = {*names}, others | {*wanted}
        there, asked = (dict.fromkeys(some - {PREDICTED}) for some in both)
        topics.odd += unlike(there, asked, "topics")
        topics.odd += ["a topic has two channels"] * (len({*names}) < len(names))
        for topic, times in wanted.items():
            if not np.array_equal(self.log.times(self.topics.get(topic, -1)), times):
                found = steps if times is self.times else topics
                found.odd.append(f"{topic} has messages at other times")
        drawn = _bytes(scene_update(self.show.epoch, self.script))
        said = (one.data for one in self.log.messages({self.topics.get(SCENE, -1)}))
        scene = ["it is another scene"] * any(one != drawn for one in said)
        seen = {"VRF120": topics, "VRF121": steps, "VRF126": Compared(odd=scene)}
        return {**seen, **self._prediction()}

    def _prediction(self) -> Found:
        """Check the times at which the predicted fleet is drawn, and until when."""
        layout, drawn = Compared(), Compared()
        times = self.log.times(self.topics.get(PREDICTED, -1)) - self.show.epoch
        end, rate = 1e-9 * float(times.max(initial=0)), self.show.rules.log_rate
        # However late the last one is, there are no more steps than samples.
        steps = sample.sample_times(min(end, times.size / rate), rate)[:-1]
        if not np.array_equal(times[:-1], steps):
            layout.odd.append("its samples are not at the steps of the log rate")
        if self.tubes is None:
            return {"VRF127": layout} if PREDICTED in self.topics else {}
        channel, share = {self.topics.get(PREDICTED, -1)}, max(times.size, 1)
        final = [*self._messages(channel, share - 1, share)]
        points, ended = self._points(final, sample.PLACE), False
        if points is not None and self.tubes.last <= end <= self.tubes.latest:
            ended = self.tubes.landed(_columns(points, "xyz"))
        if not ended:
            drawn.odd.append("the log does not draw the missions to their end")
        return {"VRF127": layout, "VRF421": drawn}

    def _messages(
        self, channels: set[int], share: int = 0, shares: int = 1
    ) -> Iterator[Message]:
        """Messages on channels, empty where they have more than any of showc's."""
        most = _LARGEST * (self.show.drones + 100)
        for one in self.log.messages(channels, share, shares):
            yield one if len(one.data) <= most else one._replace(data=b"")

    def clouds(self, share: int) -> Found:
        """Compare what is drawn of whole fleets in one share of the file."""
        found: Found = defaultdict(Compared)
        kinds = {
            self.topics.get(FLEET, -1): ("VRF122", sample.POINT, self._fleet),
            self.topics.get(PREDICTED, -1): ("VRF127", sample.PLACE, self._predicted),
        }
        both = self._messages({*kinds}, share, SHARES)
        while some := [*islice(both, max(1, 2 * _AT_ONCE // self.show.drones))]:
            for channel, (code, layout, look) in kinds.items():
                own = [one for one in some if one.channel == channel]
                if (points := self._points(own, layout)) is None:
                    found[code].odd.append("a point cloud is not as showc's are")
                elif own:
                    look(found, points, self._since(own))
        return found

    def _fleet(self, found: Found, points: NDArray[np.void], times: FloatArray) -> None:
        """Compare points (n, drones) of the fleet at times (n,) [s]."""
        both = (_columns(points, names) for names in (_NUMBERS, _COLOURS))
        self._compare(found, "VRF122", self._every(times), *both)

    def _predicted(
        self, found: Found, points: NDArray[np.void], times: FloatArray
    ) -> None:
        """Compare points (n, drones) of the predicted fleet at times (n,) [s]."""
        colours = zip(_COLOURS, (*sample.PREDICTED_COLOUR, 255), strict=True)
        if any(np.any(points[name] != value) for name, value in colours):
            found["VRF127"].odd.append("it has another colour")
        if self.tubes is not None:
            off = self.tubes.outside(times, _columns(points, "xyz"))
            found["VRF421"].see(off[:, None], *self._every(times))

    def _since(self, messages: list[Message]) -> FloatArray:
        """Show times (n,) of messages [s]."""
        return np.array([one.time - self.show.epoch for one in messages]) / 1e9

    def _every(self, times: FloatArray) -> tuple[FloatArray, IntArray]:
        """Show time [s] and drone of each point of the whole fleet."""
        fleet = np.arange(self.show.drones)
        return np.repeat(times, fleet.size), np.tile(fleet, times.size)

    def states(self, share: int) -> Found:
        """Compare the messages of single drones in one share of the file."""
        found: Found = defaultdict(Compared)
        messages = self._messages({*self.single}, share, SHARES)
        while some := [*islice(messages, _AT_ONCE)]:
            drones = np.array([self.single[one.channel] for one in some])
            times, size = self._since(some), sample.DRONE_STATE.itemsize
            content = (d if len(d := one.data) == size else bytes(size) for one in some)
            table = np.frombuffer(b"".join(content), sample.DRONE_STATE)
            other = [table[name] != _TEMPLATE[name] for name in _BETWEEN]
            odd = np.flatnonzero(np.any(other, axis=0))
            if odd.size:
                found["VRF123"].odd.append("a sample is not laid out as showc's are")
                off = np.full((odd.size, 1), np.inf)
                found["VRF123"].see(off, times[odd], drones[odd])
                continue
            values = _columns(table, _STATE)
            light = 255.0 * values[:, 16:]
            self._compare(found, "VRF123", (times, drones), values[:, :16], light)
        return found

    def frames(self) -> Found:
        """Compare the frames of the drones with the points of the fleet, and the root.

        The points are held against the polynomials by themselves.
        """
        found = Compared()
        base = root_transform(self.show.epoch, self.script.site)
        root = FrameTransforms(transforms=[base])
        wanted = {self.show.epoch: [_bytes(root)]}
        topics = {TRANSFORMS, *[FLEET] * (self.show.drones <= sample.SMALL_FLEET)}
        # Of one time frames and points may come in any order.
        some = self._messages({self.topics.get(topic, -1) for topic in topics})
        for time, messages in groupby(some, key=lambda one: one.time):
            expected, frames = wanted.pop(time, []), list[bytes]()
            for message in messages:
                if message.channel == self.topics.get(TRANSFORMS):
                    frames.append(message.data)
                elif (points := self._points([message], sample.POINT)) is not None:
                    drones = range(self.show.drones)
                    expected.append(_bytes(fleet_transforms(time, points[0], drones)))
            # How many there must be, is a matter of the times of messages.
            if frames != expected[: len(frames)]:
                found.odd.append("frames are not those of the drones")
        return {"VRF124": found}

    def _points(
        self, messages: list[Message], layout: np.dtype[np.void]
    ) -> NDArray[np.void] | None:
        """Points (n, drones) of messages; None if they are not what showc writes."""
        found, size = [], self.show.drones * layout.itemsize
        for message in messages:
            content = message.data[-size:]  # the points come last
            points = np.frombuffer(content if len(content) == size else b"", layout)
            same = _bytes(point_cloud(message.time, points)) == message.data
            found += [content] * (same and points.size > 0)
        table = np.frombuffer(b"".join(found), layout).reshape(-1, self.show.drones)
        return table if len(table) == len(messages) else None

    def _compare(
        self,
        found: Found,
        code: str,
        where: tuple[FloatArray, IntArray],
        values: FloatArray,
        shown: FloatArray,
    ) -> None:
        """Compare numbers, each at a show time of a drone (n,), ``where``.

        ``values`` are states and controls (n, 16), or with a quaternion (n, 17);
        ``shown`` are colour bytes (n, 3), or with an alpha that hides nothing (n, 4).
        """
        (times, drones), encode = where, _ENCODERS[code]
        moments, index = np.unique(times, return_inverse=True)
        row, grid = index * self.show.drones + drones, moments.size * self.show.drones
        # Where it is all there is, in its order, nothing is to be picked.
        pick = np.s_[:] if np.array_equal(row, np.arange(grid)) else row
        ratio = _ratio(values, flown(self.show, moments).reshape(grid, -1)[pick])
        late = np.unique(np.nonzero(~(ratio <= 1.0))[0])
        for side in (-_SIDE, _SIDE) if late.size else ():
            moved, at = np.unique(times[late] + side, return_inverse=True)
            then = _ratio(values[late], flown(self.show, moved)[at, drones[late]])
            ratio[late] = np.minimum(ratio[late], then)
        found[code].see(ratio, times, drones)
        # A byte may be off by one: the rounding of another library's powers.
        shown[:, :3] -= encode(self.lights.linear(moments)).reshape(grid, 3)[pick]
        # What hides something is no rounding.
        shown[:, 3:] = 2.0 * (shown[:, 3:] - 255.0)
        found["VRF125"].see(np.abs(shown), times, drones)


def _bytes(message: ProtobufMessage) -> bytes:
    return message.SerializeToString(deterministic=True)


def _columns(table: NDArray[np.void], names: Sequence[str]) -> FloatArray:
    """Fields of all records, a column each, shape (n, names)."""
    return structured_to_unstructured(table.ravel()[[*names]], np.float64)


def _ratio(values: FloatArray, flown: FloatArray) -> FloatArray:
    """Error over what is allowed, shape of ``values``.

    ``flown`` are states and controls (n, 16); ``values`` the same, or (n, 17) with a
    quaternion in place of the angles.
    """
    expected, turned = flown, values.shape[1] > flown.shape[1]
    # The change of each quantity within the nanosecond of rounding.
    fastest = max(np.abs(flown[:, k : k + 3]).max() for k in (3, 9))
    drift = 1e-9 * np.array([fastest, 100.0, fastest, 1e3, 1e3, 1e2])
    fixed = np.repeat(0.5 * _STEPS + drift + 1e-9, [3, 3, 3 + turned, 3, 1, 3])
    if turned:
        turn = sample.quaternion(flown[:, 6:9])
        expected = np.concatenate([flown[:, :6], turn, flown[:, 9:]], axis=1)
    allowed = np.abs(expected) * (2.0**-23 + 1e-9) + fixed
    return np.asarray(np.abs(values - expected) / allowed)
