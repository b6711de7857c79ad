"""The log of what was flown: MCAP with a topic for each drone."""

from __future__ import annotations

import json
from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, BinaryIO, Self

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.writer import Writer

from showc._version import __version__
from showc.errors import DamagedFileError, UsageError
from showc.files import flush, open_file, stage_for, unwritable

if TYPE_CHECKING:
    from pathlib import Path
    from types import TracebackType

    from showc.arrays import FloatArray


NANOSECONDS = 1_000_000_000
"""In a second: logs count time in them."""

PREFIX, SUFFIX = "/drone/", "/flown"

FIELDS = ("x", "y", "z", "vx", "vy", "vz")

SCHEMA = {
    "type": "object",
    "title": "showc.Flown",
    "description": "Where a vehicle said it was: show frame, metres and metres/second.",
    "properties": {
        "time": {"type": "number", "description": "Show time [s]"},
        **{name: {"type": "number"} for name in FIELDS},
    },
}


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """What one drone flew."""

    drone: int
    """Counting from 0."""
    times: FloatArray
    """Show time, increasing, shape (n,) [s]."""
    positions: FloatArray
    """Shape (n, 3), show frame [m]."""


class FlownLog:
    """Writes the positions of a fleet as they come in.

    The file takes its name when it is whole: at the end of the ``with`` statement,
    however that ends. Until then a former one stays.

    Parameters
    ----------
    path
        File to write.
    drones
        Drones of the fleet, counting from 0.
    epoch
        Time stamp of show time zero [ns], as in the plan's log, so that both lie over
        each other in a viewer.

    Raises
    ------
    UsageError
        If the file cannot be written.
    """

    def __init__(self, path: Path, drones: tuple[int, ...], epoch: int) -> None:
        self.epoch = epoch
        self.fault = ""
        """Why the flight is not recorded; empty: nothing hinders it."""
        self._path, self._sequence = path, 0
        self._end = ExitStack()
        try:
            if path.exists() and not path.is_file():
                raise UsageError(f"cannot write {str(path)!r}: it is no regular file")
            if not path.parent.is_dir():
                raise UsageError(f"cannot write {str(path)!r}: there is no such folder")
            self._part = self._end.enter_context(stage_for(path)) / path.name
            self._stream: BinaryIO = self._end.enter_context(self._part.open("wb"))
        except OSError as error:
            self._end.close()
            raise unwritable(path, error) from None
        self._writer = Writer(self._stream)
        self._writer.start(profile="", library=f"showc {__version__}")
        schema = self._writer.register_schema(
            "showc.Flown", "jsonschema", json.dumps(SCHEMA).encode()
        )
        self._channels = {
            drone: self._writer.register_channel(
                f"{PREFIX}{drone + 1:04d}{SUFFIX}", "json", schema
            )
            for drone in drones
        }

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            with self._end:
                if not self._sequence:
                    self.fault = self.fault or (
                        f"{str(self._path)!r} is not written: nothing was flown; a "
                        "former one is whole"
                    )
                if not self.fault:
                    self._writer.finish()
                    flush(self._stream)
                    self._part.replace(self._path)
        except OSError as error:
            self.fault = str(unwritable(self._path, error))

    def add(
        self, drone: int, time: float, position: FloatArray, velocity: FloatArray
    ) -> None:
        """Note where ``drone`` is at show ``time`` [s]; (3,) each, show frame.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        values = [*position.tolist(), *velocity.tolist()]
        body = {"time": round(time, 4)} | {
            name: round(value, 4) for name, value in zip(FIELDS, values, strict=True)
        }
        stamp = self.epoch + round(time * NANOSECONDS)
        self._sequence += 1
        self._writer.add_message(
            self._channels[drone],
            stamp,
            json.dumps(body).encode(),
            stamp,
            self._sequence,
        )


def read_flown(path: Path) -> dict[int, Track]:
    """Read a log of what was flown, by drone counting from 0.

    Raises
    ------
    UsageError
        If it cannot be read, or nothing was flown.
    DamagedFileError
        If it is no such log.
    """
    rows: dict[int, list[list[float]]] = {}
    try:
        with open_file(path) as stream:
            for _, channel, message in make_reader(
                stream, validate_crcs=True
            ).iter_messages():
                if channel.topic.startswith(PREFIX) and channel.topic.endswith(SUFFIX):
                    drone = int(channel.topic[len(PREFIX) : -len(SUFFIX)]) - 1
                    body = json.loads(message.data)
                    values = [float(body[name]) for name in ("time", "x", "y", "z")]
                    rows.setdefault(drone, []).append(values)
    except OSError as error:
        raise UsageError(f"{path}: cannot be read ({error.strerror})") from None
    except (McapError, ValueError, KeyError, TypeError) as error:
        raise DamagedFileError(
            f"{path}: is not a whole log of what was flown ({error}); wanted what "
            "`showc stream` writes"
        ) from None
    if not rows:
        raise UsageError(
            f"{path}: holds no flown positions; wanted what `showc stream` writes"
        )
    return {drone: _track(drone, np.array(rows[drone])) for drone in sorted(rows)}


def _track(drone: int, table: FloatArray) -> Track:
    times, keep = np.unique(table[:, 0], return_index=True)
    return Track(drone, times, table[keep, 1:4])
