"""Mission items as the MAVLink protocol carries them."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from math import isnan, trunc

from showc.errors import UsageError
from showc.mission.items import Command

POSITIONAL = {Command.NAV_WAYPOINT, Command.NAV_LAND, Command.NAV_TAKEOFF}
"""Commands whose last three numbers are a place."""

KEPT_BY_ARDUPILOT = {
    Command.NAV_DELAY: 4,
    Command.CONDITION_DELAY: 1,
    Command.DO_CHANGE_SPEED: 2,
    Command.DO_SET_SERVO: 2,
}
"""How many parameters ArduPilot keeps of what is sent here; of others, none."""


@dataclass(frozen=True, slots=True)
class WireItem:
    """The fields of MISSION_ITEM_INT."""

    sequence: int
    """Position in the mission, from 0."""
    frame: int
    """MAV_FRAME."""
    command: int
    """MAV_CMD."""
    parameters: tuple[float, float, float, float]
    """Single-precision numbers."""
    x: int
    """Latitude [1e-7 deg]."""
    y: int
    """Longitude [1e-7 deg]."""
    z: float
    """Altitude or height, single precision [m]."""


def single(value: float) -> float:
    """Return the single-precision number nearest to ``value``."""
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


def parse_waypoints(content: bytes, path: str) -> tuple[WireItem, ...]:
    """Read a QGC WPL 110 file as the items that are sent.

    Raises
    ------
    UsageError
        If it is not one; names the line.
    """
    lines = content.decode("ascii", errors="replace").splitlines()
    if not lines or lines[0].strip() != "QGC WPL 110":
        raise UsageError(f"{path}:1: is not a mission; wanted 'QGC WPL 110'")
    return tuple(
        _parse_row(line, number, f"{path}:{number + 2}")
        for number, line in enumerate(lines[1:])
    )


def _parse_row(line: str, number: int, where: str) -> WireItem:
    fields = line.split()
    try:
        sequence, frame, command = int(fields[0]), int(fields[2]), int(fields[3])
        values = [float(field) for field in fields[4:11]]
    except (ValueError, IndexError):
        sequence, frame, command, values = -1, 0, 0, []
    if len(fields) != 12 or sequence != number:
        raise UsageError(
            f"{where}: is not row {number} of a mission; wanted twelve numbers"
        )
    return WireItem(
        sequence,
        frame,
        command,
        (single(values[0]), single(values[1]), single(values[2]), single(values[3])),
        round(values[4] * 1e7),
        round(values[5] * 1e7),
        single(values[6]),
    )


def parse_parameters(content: bytes, path: str) -> dict[str, float]:
    """Read a ``.parm`` file: value by name.

    Raises
    ------
    UsageError
        If a line is neither a comment nor ``NAME,VALUE``; names the line.
    """
    found: dict[str, float] = {}
    lines = content.decode("ascii", errors="replace").splitlines()
    for number, line in enumerate(lines, start=1):
        fields = line.partition("#")[0].replace(",", " ").split()
        if not fields:
            continue
        try:
            name, value = fields
            found[name] = float(value)
        except ValueError:
            raise UsageError(
                f"{path}:{number}: is not a parameter; wanted NAME,VALUE"
            ) from None
    return found


def difference(sent: WireItem, held: WireItem, autopilot: str) -> str:
    """Say what a vehicle holds differently from what was sent; empty: nothing.

    ArduPilot keeps its own home for item 0, whole centimetres of height, frame 0 for
    items without a position, and of the parameters only those its commands use; all
    else must be equal to the last digit.
    """
    ardupilot = autopilot == "ardupilot"
    if sent.command != held.command:
        return f"command {held.command} instead of {sent.command}"
    if ardupilot and sent.sequence == 0:
        return ""
    positional = sent.command in POSITIONAL
    if (positional or not ardupilot) and sent.frame != held.frame:
        return f"frame {held.frame} instead of {sent.frame}"
    if positional:
        found = _place_difference(sent, held, ardupilot=ardupilot)
        if found:
            return found
    kept = KEPT_BY_ARDUPILOT.get(Command(sent.command), 0) if ardupilot else 4
    for index in range(kept):
        one, other = sent.parameters[index], held.parameters[index]
        if one != other and not (isnan(one) and isnan(other)):
            return f"parameter {index + 1} {other:g} instead of {one:g}"
    return ""


def _place_difference(sent: WireItem, held: WireItem, *, ardupilot: bool) -> str:
    if (sent.x, sent.y) != (held.x, held.y):
        return f"place {held.x}, {held.y} instead of {sent.x}, {sent.y}"
    # ArduPilot truncates; what it reads back is on the centimetre again.
    truncated = ardupilot and trunc(single(sent.z * 100.0)) == round(held.z * 100.0)
    if sent.z != held.z and not truncated:
        return f"height {held.z:.3f} m instead of {sent.z:.3f} m"
    return ""
