"""One item of a MAVLink mission, and the few commands a show needs."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from showc.errors import ExportError
from showc.script.rules.missions import item_budget


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


def check_budget(count: int, autopilot: str, board: str, drone: int) -> None:
    """Refuse a mission of ``count`` items that ``board`` cannot hold.

    Raises
    ------
    ExportError
        With the count, the budget and what to do.
    """
    budget = item_budget(autopilot, board)
    if count > budget:
        raise ExportError(
            f"the mission of drone {drone + 1} has {count} items, board {board!r} "
            f"holds {budget}; choose a larger board, take transitions out or leave "
            "the lights to another carrier"
        )


HEADER = "QGC WPL 110"


def waypoint_file(mission: Mission, *, home_row: bool) -> bytes:
    """Return the file of one drone.

    ArduPilot takes row 0 for the planned home and throws it away; other autopilots
    take it for an item. ``home_row`` says which reader the file is for. Latitudes and
    longitudes have the seven decimals that the protocol's integers have, and one more.
    """
    rows = [mission.home, *mission.items] if home_row else list(mission.items)
    lines = [HEADER, *(_row(index, item) for index, item in enumerate(rows))]
    return ("\n".join(lines) + "\n").encode("ascii")


def _row(index: int, item: MissionItem) -> str:
    fields = [
        str(index),
        "1" if index == 0 else "0",
        str(int(item.frame)),
        str(int(item.command)),
        *(_number(value) for value in item.parameters),
        _degrees(item.latitude),
        _degrees(item.longitude),
        f"{item.height:.3f}",
        "1",
    ]
    return "\t".join(fields)


def _number(value: float) -> str:
    """Shortest text of up to four decimals."""
    text = f"{value:.4f}".rstrip("0").rstrip(".")
    return "0" if text in {"", "-0"} else text


def _degrees(value: int) -> str:
    """Exact decimal text of whole 1e-7 degrees, with eight decimals."""
    sign = "-" if value < 0 else ""
    whole, part = divmod(abs(value), 10_000_000)
    return f"{sign}{whole}.{part:07d}0"
