"""How many items a mission may have, by autopilot board."""

from __future__ import annotations

from showc.errors import ExportError

ARDUPILOT_ITEMS = {
    "4k": 161,
    "f405": 303,
    "f4": 303,
    "8k": 303,
    "15k": 303,
    "16k": 650,
    "pixhawk": 650,
    "cube": 650,
    "fmuv3": 650,
    "sitl": 650,
    "32k": 1306,
    "h743": 1306,
}
"""Items including home, of which ArduPilot keeps 15 bytes each, less 4 bytes."""

PX4_ITEMS = 500
"""Items on PX4's usual boards."""


def item_budget(autopilot: str, board: str) -> int:
    """Return the greatest number of items a mission may have.

    Raises
    ------
    ExportError
        If nothing is known about ``board``.
    """
    if autopilot == "px4":
        return PX4_ITEMS
    try:
        return ARDUPILOT_ITEMS[board.lower()]
    except KeyError:
        known = ", ".join(sorted(ARDUPILOT_ITEMS))
        raise ExportError(
            f"mission board {board!r} is not known; wanted one of {known}"
        ) from None


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
