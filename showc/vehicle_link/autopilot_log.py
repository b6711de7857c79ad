"""Logs of autopilots as tracks: ``.BIN`` of their cards, ``.tlog`` of a link."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from pymavlink import DFReader, mavutil
from pymavlink.dialects.v20 import ardupilotmega as dialect

from showc.errors import DamagedFileError, UsageError

if TYPE_CHECKING:
    from pathlib import Path

    from showc.arrays import FloatArray


ENDINGS = {".bin", ".tlog"}
"""Of the files that are read here, in small letters."""

GPS_EPOCH = 315_964_800
"""1980-01-06 UTC [s since 1970]."""

WEEK = 604_800
"""[s]."""

LEAP_SECONDS = 18
"""GPS time less UTC since 2017 [s]; no further leap second is announced."""

MISSION_NAME = re.compile(r"drone_(\d{4,})")
"""Of a mission's file without its ending; a card's log of that name is that drone's."""

AUTO = 3
"""Mode of ArduCopter that flies missions."""

FIX_3D = 3
"""Status of a GPS that knows its place."""

_DAMAGE = (
    OSError,
    ValueError,
    KeyError,
    IndexError,
    TypeError,
    AttributeError,
    struct.error,
)
"""All that the library raises on bytes that are no log."""

ARMED, DISARMED = 10, 11
"""Events of ArduPilot's log."""


@dataclass(frozen=True, slots=True, eq=False)
class AutopilotTrack:
    """Where one vehicle was by its own estimate."""

    source: str
    """Its log."""
    system: int
    """MAVLink system id; 0 where the log does not tell."""
    times: FloatArray
    """UTC [s since 1970] if ``utc``, else since the vehicle started; shape (n,)."""
    utc: bool
    """Whether the log tells how the two lie to each other."""
    geodetic: FloatArray
    """Latitude, longitude [deg], height above home [m]; shape (n, 3)."""
    missions: bool
    """Whether it flew a mission."""


@dataclass(slots=True)
class _Rows:
    """What a log says of one vehicle, as it is read."""

    system: int = 0
    places: list[tuple[float, float, float, float]] = field(default_factory=list)
    """Vehicle's time [s], latitude, longitude [deg], height above home [m]."""
    clocks: list[float] = field(default_factory=list)
    """UTC less the vehicle's time at which it came to the log [s]."""
    received: list[float] = field(default_factory=list)
    """UTC less the vehicle's time at which it was received [s]."""
    fix: tuple[float, float] | None = None
    """When the last one was logged, and the UTC that it tells [s]."""
    missions: bool = False
    armed: list[tuple[float, bool]] = field(default_factory=list)
    """Since when it was armed or not, by its own time [s]."""

    def track(self, source: str) -> AutopilotTrack | None:
        """Return the track while it was armed; None if there is none."""
        if not self.places:
            return None
        table = np.array(self.places)
        times, keep = np.unique(table[:, 0], return_index=True)
        table = table[keep]
        if self.armed:
            moments = np.array([moment for moment, _ in self.armed])
            states = np.array([False, *(state for _, state in self.armed)])
            table = table[states[np.searchsorted(moments, times, side="right")]]
        if not len(table):
            return None
        # A fix is logged some time after it was taken: the least delayed one tells.
        clocks = self.received or self.clocks
        offset = max(clocks, default=0.0)
        return AutopilotTrack(
            source,
            self.system,
            table[:, 0] + offset,
            bool(clocks),
            table[:, 1:],
            self.missions,
        )


def read_autopilot_log(path: Path) -> list[AutopilotTrack]:
    """Read a ``.BIN`` or ``.tlog``: one track for each vehicle in it.

    Raises
    ------
    UsageError
        If it cannot be read, or no vehicle was armed in it.
    DamagedFileError
        If it is no such log.
    """
    try:
        with path.open("rb") as stream:
            stream.read(1)
    except OSError as error:
        raise UsageError(f"{path}: cannot be read ({error.strerror})") from None
    try:
        rows = _telemetry(path) if path.suffix.lower() == ".tlog" else _card(path)
    except _DAMAGE as error:
        raise DamagedFileError(
            f"{path}: is not a log of an autopilot ({type(error).__name__}: {error}); "
            "wanted a .BIN of ArduPilot's card or a .tlog of a ground station"
        ) from None
    tracks = [track for row in rows if (track := row.track(str(path))) is not None]
    if not tracks:
        raise UsageError(
            f"{path}: holds no position of an armed vehicle; wanted the log of a flight"
        )
    return tracks


def _card(path: Path) -> list[_Rows]:
    """Read ArduPilot's own log: one vehicle."""
    named = MISSION_NAME.fullmatch(path.stem)
    found = _Rows(_number(path))
    log = DFReader.DFReader_binary(str(path))
    wanted = ["POS", "GPS", "GPA", "MODE", "PARM", "EV"]
    while (message := log.recv_match(type=wanted)) is not None:
        _take_card_row(found, message)
    if named:
        # A vehicle that flies a fleet's missions in turn keeps one system id.
        found.system = int(named[1])
    return [found]


def _take_card_row(found: _Rows, message: Any) -> None:  # noqa: ANN401 - pymavlink's
    kind, time = message.get_type(), message.TimeUS * 1e-6
    if kind == "POS":
        place = (time, message.Lat, message.Lng, message.RelHomeAlt)
        if np.isfinite(place).all():
            found.places.append(place)
    elif kind in {"GPS", "GPA"}:
        _take_fix(found, message, time)
    elif kind == "MODE":
        found.missions |= message.ModeNum == AUTO
    elif kind == "PARM":
        if message.Name in {"SYSID_THISMAV", "MAV_SYSID"}:
            found.system = int(message.Value)
    elif message.Id in {ARMED, DISARMED}:
        if not found.armed:
            # Logs begin with the arming, often just after its event.
            found.armed.append((-np.inf, message.Id == DISARMED))
        found.armed.append((time, message.Id == ARMED))


def _take_fix(found: _Rows, message: Any, time: float) -> None:  # noqa: ANN401 - as above
    """Note what a fix tells of the clock: GPS has its UTC, GPA when it was received."""
    if message.get_type() == "GPA":
        if found.fix is not None and found.fix[0] == time and message.SMS:
            found.received.append(found.fix[1] - message.SMS * 1e-3)
    elif message.Status >= FIX_3D and getattr(message, "I", 0) == 0 and message.GWk:
        utc = GPS_EPOCH + WEEK * message.GWk - LEAP_SECONDS + message.GMS * 1e-3
        found.fix = time, utc
        found.clocks.append(utc - time)


def _telemetry(path: Path) -> list[_Rows]:
    """Read what a ground station recorded: any number of vehicles."""
    log: Any = mavutil.mavlogfile(str(path))
    found: dict[int, _Rows] = {}
    clocks: dict[int, float] = {}
    wanted = ["GLOBAL_POSITION_INT", "SYSTEM_TIME", "HEARTBEAT"]
    while (message := log.recv_match(type=wanted)) is not None:
        if message.get_srcComponent() != dialect.MAV_COMP_ID_AUTOPILOT1:
            continue
        system = message.get_srcSystem()
        rows = found.setdefault(system, _Rows(system))
        kind = message.get_type()
        if kind == "HEARTBEAT":
            rows.missions |= message.custom_mode == AUTO
            armed = bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
            # Heartbeats have no time of their own: that of the position before.
            rows.armed.append((clocks.get(system, 0.0), armed))
            continue
        time = clocks[system] = message.time_boot_ms * 1e-3
        if kind == "SYSTEM_TIME":
            if message.time_unix_usec:
                rows.clocks.append(message.time_unix_usec * 1e-6 - time)
        elif message.lat or message.lon:
            height = message.relative_alt * 1e-3
            place = (time, message.lat * 1e-7, message.lon * 1e-7, height)
            rows.places.append(place)
    return list(found.values())


def _number(path: Path) -> int:
    """Return the number at the end of a file's name: 3 of ``drone_0003.BIN``."""
    digits = re.search(r"(\d+)$", path.stem)
    return int(digits[1]) if digits else 0
