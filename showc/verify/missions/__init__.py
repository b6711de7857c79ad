"""The missions beside a log, proved from their bytes.

``language`` is what may stand in a mission, ``folder`` holds every file against the
script, ``legs`` and ``law`` say what an autopilot makes of the rows, ``flight`` proves
separation, time and space of that, and ``drawn`` what the log shows of it.
"""

from __future__ import annotations

from showc.verify.missions.folder import Missions

__all__ = ["Missions"]
