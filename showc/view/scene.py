"""A scene: what a page draws, from a log or from a plan, and its bytes.

Positions are sent as 16-bit steps of the flight's bounding box, colours and plots as
bytes, all as differences in time.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, Self

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.arrays import ByteArray, FloatArray, IntArray
    from showc.script.show import Music
    from showc.view.findings import Finding

STEPS = 65_000
"""Steps over the bounding box along each axis; fits 16 bits."""

NOWHERE = -32_768
"""The step that says that a place is not known: the least of 16 bits."""


@dataclass(frozen=True, slots=True, eq=False)
class Signal:
    """A quantity of every drone, plotted for the chosen one."""

    name: str
    unit: str
    digits: int
    """Decimals shown."""
    values: FloatArray
    """At the signals' times, not negative, shape (S, drones)."""
    limits: tuple[float, ...] = ()
    """Levels that are drawn if they are not far above."""


@dataclass(frozen=True, slots=True)
class GroupMove:
    """A move of a group that has times of its own."""

    name: str
    group: str
    start: float
    """[s]."""
    duration: float
    """[s]."""
    label: str
    """Formation that it reaches, or holds."""
    held: bool
    """Whether the group holds it in motion."""

    @classmethod
    def of(
        cls, name: str, group: str, time: tuple[float, float], to: str, *, held: bool
    ) -> Self:
        """Name what a group does from a time on, for a while [s]."""
        said = f"{to} in motion" if held else name.replace("->", "→")
        return cls(said, group, *time, to, held)


@dataclass(frozen=True, slots=True)
class Chapter:
    """One leg on the timeline."""

    name: str
    label: str
    """Short, for the timeline."""
    kind: str
    """As in the log."""
    start: float
    """[s]."""
    duration: float
    """[s]."""
    picture: str = ""
    """Name of the formation that is held; empty during moves."""
    state: str = ""
    """``straight`` or ``solved`` where not all are solved yet."""
    moves: tuple[GroupMove, ...] = ()
    """Of groups that have times of their own."""
    tube: float = 0.0
    """Radius that held drones in simulated wind [m]; 0: none was simulated."""


@dataclass(frozen=True, slots=True)
class Meeting:
    """Two drones at their nearest, to be marked."""

    a: int
    """Counting from 0."""
    b: int
    """Counting from 0."""
    time: float
    """[s]."""
    distance: float
    """In the separation's metric [m]."""
    tightest: bool
    """Whether it is the nearest of all."""


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """What stands still; None where it is not known."""

    fence: FloatArray
    """Corners, shape (n, 2) [m]; none: no fence is known."""
    floor: float | None
    """Least height of the flight volume [m]."""
    ceiling: float | None
    """[m]."""
    pads: FloatArray
    """Shape (n, 3) [m]."""
    heading: float | None
    """Compass bearing of +y [deg]."""
    separation: float | None
    """[m]."""
    metric: FloatArray
    """Factors on (x, y, z) that make the separation's shape a sphere, (3,)."""


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """A quantity of the whole fleet against its limit."""

    name: str
    unit: str
    digits: int
    """Decimals shown."""
    times: FloatArray
    """Shape (k,), increasing [s]."""
    values: FloatArray
    """Shape (k,)."""
    limits: FloatArray
    """Shape (k,); not a number where there is none."""
    least: bool = False
    """Whether values must not be less than the limit, instead of not more."""


@dataclass(frozen=True, slots=True)
class Cue:
    """A moment with a name."""

    time: float
    """Show time [s]."""
    name: str


@dataclass(frozen=True, slots=True)
class Soundtrack:
    """What the show is flown to."""

    offset: float
    """Show time at which the music begins [s]."""
    file: str
    """Name of the recording; empty: the script names none."""
    cues: tuple[Cue, ...]
    bar: float
    """Time of a bar [s]; 0: not known."""
    first_bar: float
    """Show time of the first bar [s]."""

    @classmethod
    def of(cls, music: Music | None) -> Soundtrack | None:
        """Return what a page shows of a script's music; None where there is none."""
        if music is None:
            return None
        beat = 60.0 / music.bpm if music.bpm else 0.0
        cues = sorted((time + music.offset, name) for name, time in music.cues.items())
        return cls(
            offset=music.offset,
            file=music.file or "",
            cues=tuple(Cue(round(time, 3), name) for time, name in cues),
            bar=beat * music.beats_per_bar,
            first_bar=music.offset + music.first_beat,
        )


@dataclass(frozen=True, slots=True, eq=False)
class SecondFleet:
    """The same drones as they fly elsewhere, drawn hollow beside the solved ones."""

    name: str
    """For people."""
    times: FloatArray
    """Show times, even but for the last, shape (T,) [s]."""
    positions: FloatArray
    """Shape (T, drones, 3), show frame [m]; not a number where it is not known."""
    shown: bool = False
    """Whether a page begins with it."""

    def header(self) -> dict[str, Any]:
        """Return what is not numbers of each drone."""
        low, scale = _box(self.positions)
        return {
            "name": self.name,
            "shown": self.shown,
            "frames": self.times.size,
            "frameStep": float(self.times[1] - self.times[0]),
            "origin": (low + scale * (STEPS // 2)).tolist(),
            "scale": scale.tolist(),
        }


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Everything a page draws."""

    name: str
    duration: float
    """[s]."""
    step: float
    """Time between frames [s]; the last one may come sooner."""
    positions: FloatArray
    """Shape (frames, drones, 3), show frame [m]."""
    colours: ByteArray
    """As screens show them, shape (frames, drones, 3)."""
    chapters: tuple[Chapter, ...]
    ground: Ground
    encounters: tuple[Meeting, ...] = ()
    signals: tuple[Signal, ...] = ()
    signal_step: float = 0.0
    """Time between values of the signals [s]."""
    meshes: tuple[tuple[float, ...], ...] = ((),)
    """Different meshes, as fractions of their leg."""
    mesh_index: IntArray = field(default_factory=lambda: np.zeros((0, 0), np.int64))
    """Which mesh each drone has on each chapter, shape (chapters, drones)."""
    bands: tuple[Band, ...] = ()
    """Of the whole fleet."""
    soundtrack: Soundtrack | None = None
    second: SecondFleet | None = None
    findings: tuple[Finding, ...] = ()
    """What verification says, listed and marked."""
    unknown: tuple[str, ...] = ()
    """What a foreign show does not say, in words."""
    names: tuple[str, ...] = ()
    """Of the drones; none: they are numbered."""

    def header(self) -> dict[str, Any]:
        """Return what is not numbers of each drone."""
        low, scale = _box(self.positions)
        high = self.positions.max(axis=(0, 1))
        count = self.signals[0].values.shape[0] if self.signals else 0
        return {
            "name": self.name,
            "drones": self.positions.shape[1],
            "duration": self.duration,
            "chapters": sum(one.kind != "hold" for one in self.chapters),
            "frames": self.positions.shape[0],
            "frameStep": self.step,
            "signalFrames": count,
            "signalStep": self.signal_step,
            "origin": (low + scale * (STEPS // 2)).tolist(),
            "scale": scale.tolist(),
            "bounds": [low.tolist(), high.tolist()],
            "signals": [_described(one) for one in self.signals],
            "meshes": [list(mesh) for mesh in self.meshes],
            "segments": [asdict(one) for one in self.chapters],
            "encounters": [asdict(one) for one in self.encounters],
            "fence": self.ground.fence.tolist(),
            "ground": [corner.tolist() for corner in self._extent()],
            "ceiling": self.ground.ceiling,
            "pads": self.ground.pads.tolist(),
            "heading": self.ground.heading,
            "separation": self.ground.separation,
            "metric": self.ground.metric.tolist(),
            "bands": [_drawn(one) for one in self.bands],
            "soundtrack": None if self.soundtrack is None else asdict(self.soundtrack),
            "second": None if self.second is None else self.second.header(),
            "findings": [asdict(one) for one in self.findings],
            "unknown": list(self.unknown),
            "names": list(self.names),
        }

    def _extent(self) -> tuple[FloatArray, FloatArray]:
        """Corners of the fence; of the flights where there is none, (2,) each [m]."""
        corners = self.ground.fence
        if not corners.size:
            corners = self.positions[..., :2].reshape(-1, 2)
        return corners.min(axis=0), corners.max(axis=0)

    def payload(self) -> bytes:
        """Return the numbers of each drone, as the page's ``data.js`` reads them."""
        index = self.mesh_index
        if not index.size:
            index = np.zeros((len(self.chapters), self.positions.shape[1]), np.int64)
        return b"".join(
            [
                _packed_positions(self.positions),
                _packed_colours(self.colours),
                *(_packed_signal(one) for one in self.signals),
                index.astype("<u2").tobytes(),
                *(
                    []
                    if self.second is None
                    else [_packed_positions(self.second.positions)]
                ),
            ]
        )


def _box(positions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lower corner of the bounding box, and a step along each axis, (3,) [m]."""
    low = np.nanmin(positions, axis=(0, 1))
    high = np.nanmax(positions, axis=(0, 1))
    return low, np.maximum((high - low) / STEPS, 1e-4)


def _described(signal: Signal) -> dict[str, Any]:
    return {
        "name": signal.name,
        "unit": signal.unit,
        "digits": signal.digits,
        "range": _extent(signal),
        "limits": list(signal.limits),
    }


def _drawn(band: Band) -> dict[str, Any]:
    return {
        "name": band.name,
        "unit": band.unit,
        "digits": band.digits,
        "least": band.least,
        "times": np.round(band.times, 3).tolist(),
        "values": np.round(band.values, 4).tolist(),
        "limits": [None if np.isnan(one) else round(one, 4) for one in band.limits],
    }


def _extent(signal: Signal) -> float:
    """Greatest value that fits the plot: a limit not much above is drawn as well."""
    extent = max(float(signal.values.max()) * 1.08, 1e-3)
    return max([extent, *(one * 1.05 for one in signal.limits if one < 2.5 * extent)])


def _packed_signal(signal: Signal) -> bytes:
    shares = np.clip(signal.values, 0.0, None) / _extent(signal)
    steps = np.rint(shares * 255.0).astype(np.uint8)
    return np.diff(steps, axis=0, prepend=np.uint8(0)).tobytes()


def _packed_positions(positions: FloatArray) -> bytes:
    """Second differences in time of positions (frames, drones, 3), axis by axis."""
    low, scale = _box(positions)
    steps = np.rint((positions - low) / scale) - STEPS // 2
    whole = np.where(np.isnan(steps), NOWHERE, steps).astype(np.int32)
    whole = np.moveaxis(whole, -1, 0)
    first = np.diff(whole, axis=1, prepend=0)
    second = np.diff(first, axis=1, prepend=0)
    return _planes(second.astype(np.uint16))


def _planes(values: NDArray[np.uint16]) -> bytes:
    """All low bytes, then all high bytes: these are nearly always 0 or 255."""
    pairs = np.ascontiguousarray(values).astype("<u2").view(np.uint8).reshape(-1, 2)
    return pairs[:, 0].tobytes() + pairs[:, 1].tobytes()


def _packed_colours(colours: ByteArray) -> bytes:
    """First differences in time of the screen colours, channel by channel."""
    shown = np.ascontiguousarray(np.moveaxis(colours, -1, 0))
    return np.diff(shown, axis=1, prepend=np.uint8(0)).tobytes()
