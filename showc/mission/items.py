"""One item of a MAVLink mission, and the few commands a show needs."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class Command(IntEnum):
    """MAV_CMD values used."""

    NAV_WAYPOINT = 16
    NAV_LAND = 21
    NAV_TAKEOFF = 22
    NAV_DELAY = 93
    CONDITION_DELAY = 112
    DO_CHANGE_SPEED = 178
    DO_SET_SERVO = 183


class Frame(IntEnum):
    """MAV_FRAME values used."""

    GLOBAL = 0
    """Altitude above mean sea level: the home row only."""
    MISSION = 2
    """No position."""
    GLOBAL_RELATIVE = 3
    """Height above home."""


class SpeedKind(IntEnum):
    """First parameter of DO_CHANGE_SPEED."""

    LEVEL = 1
    CLIMB = 2
    DESCENT = 3


@dataclass(frozen=True, slots=True)
class MissionItem:
    """One row of a mission."""

    command: Command
    frame: Frame
    parameters: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    """The first four parameters, in the command's units."""
    latitude: int = 0
    """Latitude, WGS 84 [1e-7 deg]."""
    longitude: int = 0
    """Longitude, WGS 84 [1e-7 deg]."""
    height: float = 0.0
    """Third coordinate in the item's frame [m]."""


@dataclass(frozen=True, slots=True)
class Mission:
    """The mission of one drone, the home row aside."""

    drone: int
    """Counting from 0."""
    home: MissionItem
    """Where the drone stands before take-off."""
    items: tuple[MissionItem, ...]
    """What it flies, in order."""


def without_position(command: Command, *parameters: float) -> MissionItem:
    """Return an item that has no position, its missing parameters zero."""
    padded = (*parameters, 0.0, 0.0, 0.0, 0.0)[:4]
    return MissionItem(
        command, Frame.MISSION, (padded[0], padded[1], padded[2], padded[3])
    )
