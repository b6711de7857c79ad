"""The parameters with which show mode was measured to follow showc's flights."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.vehicle.presets import ARDUCOPTER

if TYPE_CHECKING:
    from showc.verify.kernel.slices import Tracks

FIRMWARE = "Skybrush ArduCopter, branch CMCopter-4.6"
"""Firmware whose names and units these are."""

AIRFRAME = "the default simulated quadrotor"
"""Airframe whose gains these are."""

LAND_SPEED = (30, 200)
"""Least and greatest LAND_SPEED that ArduPilot takes [cm/s]."""

SHOW_MODE: dict[str, float] = {
    # From the branch: 3 follows the file's acceleration too, which decides.
    "SHOW_CTRL_MODE": 3,
    "SHOW_CTRL_RATE": 50,
    "SHOW_TAKEOFF_ALT": 2.5,
    **dict(ARDUCOPTER.parameters),
    # Stiffer than for missions: an aircraft that falls as its file does has less thrust
    # to hold its level speed with, and was 0.37 m off with the gains of missions.
    "PSC_POSXY_P": 2,
    "PSC_VELXY_P": 7,
    "PSC_VELXY_I": 3,
}
"""Name and value in ArduPilot's units, measured to keep within 0.3 m in calm air."""


def parameter_file(landing_speed: float) -> bytes:
    """Return the ``.parm`` file to load onto every vehicle.

    Parameters
    ----------
    landing_speed
        How fast the files descend where LAND is commanded [m/s]; the firmware's own
        landing goes on at this speed.
    """
    slowest, fastest = LAND_SPEED
    values = SHOW_MODE | {
        "LAND_SPEED": float(min(max(round(100.0 * landing_speed), slowest), fastest))
    }
    lines = [
        f"# Parameters of {FIRMWARE}, measured with {AIRFRAME}.",
        "# PSC and ATC gains belong to that airframe: tune yours, carry over the rest.",
        "# SHOW_START_TIME and SHOW_START_AUTH are reset at boot: set them after it.",
        "# Send the origin with COMMAND_INT 31011: parameters round it to 0.4 m.",
        *(f"{name},{values[name]:g}" for name in sorted(values)),
    ]
    return ("\n".join(lines) + "\n").encode("ascii")


def landing_speed(tracks: Tracks) -> float:
    """How fast a fleet descends over the last stretch before its pads [m/s].

    It is counted in whole millimetres and milliseconds, as files are: what is read of
    them gives the same number.
    """
    begin = np.rint(1000.0 * tracks.position[:, 0, 2])
    end = np.rint(1000.0 * tracks.position[:, -1, 2])
    last = np.repeat(end[tracks.first[1:] - 1], np.diff(tracks.first))
    starts, ends = np.rint(1000.0 * tracks.starts), np.rint(1000.0 * tracks.ends)
    above, speed = begin - last, (begin - end) / np.maximum(ends - starts, 1.0)
    late = starts >= 0.5 * ends.max()
    near = (above < 2500.0) & (above > 1000.0) & (speed > 0.0) & late
    return float(np.median(speed[near])) if near.any() else 1.0
