"""Missions that an autopilot flies together and on time.

Import :mod:`showc.mission.fleet` for the files.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from showc.mission.fleet import MissionSet, mission_files

__all__ = ["MissionSet", "mission_files"]


def __getattr__(name: str) -> object:
    """Import the fleet's files only when they are asked for: start-up counts."""
    if name in __all__:
        from showc.mission import fleet  # noqa: PLC0415

        return getattr(fleet, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
