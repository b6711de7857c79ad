"""The ``.waypoints`` file: QGC WPL 110, tab-separated text."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from showc.mission.items import Mission, MissionItem

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
