"""Write a flight as MCAP: samples that any viewer draws, and the exact solution.

Same input, same bytes: every time stamp comes from the script's epoch, every order
is fixed, and the compression has one thread and one level.
"""

from __future__ import annotations

from collections import defaultdict, deque
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, Protocol

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms

from showc._version import __version__
from showc.light import LightProgram, srgb_bytes
from showc.light.colour import GREATEST, drive_bytes
from showc.log import schema
from showc.log import showc_pb2 as pb
from showc.log.chunks import ChunkWriter
from showc.log.content import rules_message, segment_message, trajectory_message
from showc.log.facts import TYPES, attachments_of, epoch_of, media_type, metadata_of
from showc.log.sample import (
    DRONE_STATE,
    NANOSECONDS,
    PLACE,
    POINT,
    PREDICTED_COLOUR,
    SMALL_FLEET,
    TRANSFORM_RATE,
    nanoseconds,
    pack_drone_states,
    pack_places,
    pack_points,
    sample_times,
)
from showc.log.sampling import FleetSampler
from showc.log.scene import (
    fleet_transforms,
    point_cloud,
    root_transform,
    scene_update,
)
from showc.progress import Silent

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from concurrent.futures import Future

    from google.protobuf.message import Message
    from numpy.typing import NDArray

    from showc.arrays import FloatArray, IntArray
    from showc.flight import Flight
    from showc.progress import Progress
    from showc.script.show import Show


SAMPLES = 100_000
"""Samples (times x drones) that are evaluated and held at a time."""


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
        """Evaluate one after the other, the next one while the last is written."""
        sampler = FleetSampler(self._flight)
        lights = self._lights or LightProgram.of(self._flight)
        with ThreadPoolExecutor(1) as ahead:
            waiting: deque[Future[Window]] = deque()
            for begin in range(0, self.times.size, self._length):
                times = self.times[begin : begin + self._length]
                waiting.append(ahead.submit(self._window, times, sampler, lights))
                if len(waiting) > 1:
                    yield waiting.popleft().result()
            yield waiting.popleft().result()

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


CHUNK_SIZE = 1 << 20
"""Uncompressed bytes after which a chunk is closed."""


@dataclass(frozen=True, slots=True)
class Topics:
    """Which drones have topics of their own."""

    states: tuple[int, ...]
    """Drones with samples on /drone/NNNN/state, counting from 0."""
    transforms: tuple[int, ...]
    """Drones with a frame on /tf, counting from 0."""

    @classmethod
    def default(cls, drones: int) -> Topics:
        """All drones of a small fleet, none of a great one."""
        chosen = tuple(range(drones)) if drones <= SMALL_FLEET else ()
        return cls(chosen, chosen)


@dataclass(frozen=True, slots=True)
class LogSummary:
    """What was written."""

    messages: int
    """Number of messages of all topics."""
    samples: int
    """Number of steps of the fleet."""


def write_log(
    flight: Flight,
    target: Path | BinaryIO,
    *,
    manifest: bytes,
    lights: LightProgram | None = None,
    topics: Topics | None = None,
    predicted: PositionSource | None = None,
    progress: Progress | None = None,
) -> LogSummary:
    """Write the trajectory log of ``flight``.

    The fleet is sampled at k / log_rate for every k up to the end of the show, and at
    the end itself if that is not on the grid. A step's messages come in this order:
    rules, scene, frames, segments, exact trajectories, fleet, predicted fleet, single
    drones.

    Parameters
    ----------
    flight
        A whole show, solved.
    target
        File to write, or a stream with ``write`` and ``tell``.
    manifest
        The bytes of manifest.json, attached as they are.
    lights
        Colours; by default those that the show describes.
    topics
        Which drones have topics of their own; by default ``Topics.default``.
    predicted
        A second flight, drawn grey on /fleet/predicted, in its own time.
    progress
        Advances once per second of show.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    if isinstance(target, Path):
        with target.open("wb") as stream:
            return write_log(
                flight,
                stream,
                manifest=manifest,
                lights=lights,
                topics=topics,
                predicted=predicted,
                progress=progress,
            )
    log = _Log(flight, target)
    show = flight.itinerary.show
    wanted = topics or Topics.default(show.drones)
    log.begin(manifest, plots=0 in wanted.states)
    log.register(wanted, predicted=predicted is not None)
    windows = Windows(flight, lights, wanted.states, predicted)
    return _Steps(log, wanted, windows, progress or Silent()).write()


class _Log:
    """An MCAP file under way: schemas, channels, counters, time stamps."""

    def __init__(self, flight: Flight, stream: BinaryIO) -> None:
        self.flight = flight
        self.show: Show = flight.itinerary.show
        self.epoch = epoch_of(self.show)
        self.messages = 0
        self._writer = ChunkWriter(stream, CHUNK_SIZE)
        self._writer.begin(f"showc {__version__}")
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._sequence: defaultdict[str, int] = defaultdict(int)

    def begin(self, manifest: bytes, *, plots: bool) -> None:
        """Header, metadata and attachments: first, so that a torn file has them."""
        facts = metadata_of(self.show, self.flight.duration, __version__, manifest)
        self._writer.add_metadata(schema.METADATA_NAME, facts)
        attached = attachments_of(self.show, manifest, plots=plots)
        for name, content in attached.items():
            self._writer.add_attachment(self.epoch, name, media_type(name), content)

    def register(self, topics: Topics, *, predicted: bool) -> None:
        """All schemas and channels, in one fixed order."""
        once = [schema.RULES, schema.SCENE, schema.TRANSFORMS, schema.SEGMENTS]
        once += [schema.FLEET, *[schema.PREDICTED] * predicted]
        channels = [(topic, TYPES[topic]) for topic in once]
        fleet = range(self.show.drones)
        channels += [(schema.trajectory_topic(i), pb.Trajectory) for i in fleet]
        channels += [(schema.state_topic(i), pb.DroneState) for i in topics.states]
        for topic, message in channels:
            name = message.DESCRIPTOR.full_name
            if name not in self._schemas:
                self._schemas[name] = self._writer.register_schema(
                    name, "protobuf", schema.descriptor_set(message)
                )
            self._channels[topic] = self._writer.register_channel(
                topic, "protobuf", self._schemas[name]
            )

    def add(self, topic: str, ns: int, message: Message | bytes) -> None:
        """Append one message at show time ``ns``."""
        if not isinstance(message, bytes):
            message = message.SerializeToString(deterministic=True)
        self._writer.add_message(
            self._channels[topic], self._sequence[topic], self.epoch + ns, message
        )
        self._sequence[topic] += 1
        self.messages += 1

    def add_states(
        self, topics: list[str], step: int, ns: int, states: NDArray[np.void]
    ) -> None:
        """Append the states (n,) of single drones at a step, at show time ``ns``."""
        channels = [self._channels[topic] for topic in topics]
        self._writer.add_messages(channels, step, self.epoch + ns, states)
        self.messages += len(channels)

    def finish(self) -> None:
        """Last chunk, summary, footer."""
        self._writer.finish()


class _Steps:
    """Writes everything in the order of time, some steps at once."""

    def __init__(
        self, log: _Log, topics: Topics, windows: Windows, progress: Progress
    ) -> None:
        self.log = log
        self.topics = topics
        self.windows = windows
        self.progress = progress
        self.state_topics = [schema.state_topic(drone) for drone in topics.states]
        self.stride = max(1, round(log.show.log_rate / TRANSFORM_RATE))

    def write(self) -> LogSummary:
        """Write all steps and close the file."""
        windows, events = self.windows, self._events()
        position, done = 0, 0
        seconds = int(windows.times[-1]) // NANOSECONDS + 1
        self.progress.stage("writing the log", seconds)
        for window in windows:
            rows = {int(windows.show_times[k]): k for k in window.steps}
            clouds = dict(
                zip(window.predicted_times.tolist(), window.places, strict=True)
            )
            for ns in window.times.tolist():
                while position < len(events) and events[position][0] <= ns:
                    events[position][1]()
                    position += 1
                if ns in rows:
                    self._fleet(window, rows[ns], ns)
                if ns in clouds:
                    cloud = point_cloud(self.log.epoch + ns, clouds[ns])
                    self.log.add(schema.PREDICTED, ns, cloud)
            seconds = int(window.times[-1]) // NANOSECONDS + 1
            self.progress.advance(seconds - done)
            done = seconds
        self.log.finish()
        return LogSummary(self.log.messages, int(windows.show_times.size))

    def _events(self) -> list[tuple[int, Callable[[], None]]]:
        """List what is written once, at its time: rules, scene, segments, flights."""
        log, flight = self.log, self.log.flight
        epoch = log.epoch

        def open_show() -> None:
            log.add(schema.RULES, 0, rules_message(flight))
            log.add(schema.SCENE, 0, scene_update(epoch, log.show))
            root = FrameTransforms(transforms=[root_transform(epoch, log.show.site)])
            log.add(schema.TRANSFORMS, 0, root)

        def open_leg(number: int, ns: int) -> None:
            flown = flight.legs[number]
            log.add(schema.SEGMENTS, ns, segment_message(flight, number))
            for place, drone in enumerate(flown.leg.drones.tolist()):
                topic = schema.trajectory_topic(drone)
                log.add(topic, ns, trajectory_message(flown, number, place))

        events: list[tuple[int, Callable[[], None]]] = [(0, open_show)]
        starts = [nanoseconds(float(start)) for start in flight.starts]
        for number in sorted(range(len(starts)), key=lambda k: (starts[k], k)):
            ns = starts[number]
            events.append((ns, partial(open_leg, number, ns)))
        return events

    def _fleet(self, window: Window, step: int, ns: int) -> None:
        log, row = self.log, step - window.steps.start
        points = window.points[row]
        if self.topics.transforms and step % self.stride == 0:
            frames = fleet_transforms(log.epoch + ns, points, self.topics.transforms)
            log.add(schema.TRANSFORMS, ns, frames)
        log.add(schema.FLEET, ns, point_cloud(log.epoch + ns, points))
        log.add_states(self.state_topics, step, ns, window.states[row])
