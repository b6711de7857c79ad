"""The ``.plan`` file of a mission: every key of it follows from the other files."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from showc.verify.missions.language import MISSION, MissionFormatError
from showc.verify.missions.legs import to_show_frame
from showc.verify.specification.compare import read_json, unlike

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.log.showc_pb2 import Site
    from showc.script.show import Show
    from showc.verify.missions.language import Item, Mission


ARDUPILOT, PX4 = 3, 12
"""MAV_AUTOPILOT values."""

CRUISE, WINDY = 8.0, 4.2
"""Fastest leg of any mission [m/s], in calm air and where the script states wind."""

CORNER = 0.008
"""How far a corner may be off: half of 1e-7 degrees, north and east [m]."""


def check_plan(
    content: bytes,
    mission: Mission,
    site: Site,
    script: Show,
    *,
    station: str,
    token: str,
) -> None:
    """Hold a plan against its mission.

    Parameters
    ----------
    content
        The file's bytes.
    mission
        The drone's ``.waypoints``.
    site
        Whose fence it carries.
    script
        What is asked for.
    station, token
        The release that wrote the log, and the compile it belongs to.

    Raises
    ------
    MissionFormatError
        If a key is missing, is one too many, or has another value; names it.
    """
    try:
        plan = read_json(content)
    except ValueError as error:
        raise MissionFormatError(f"is not JSON ({str(error)[:80]})") from None
    try:
        fence = plan["geoFence"]["polygons"][0]["polygon"]
        height = plan["mission"]["plannedHomePosition"][2]
    except (KeyError, IndexError, TypeError):
        raise MissionFormatError("has no fence or home") from None
    pad = mission.home or mission.items[0]
    # PX4's missions do not say how high the pad is.
    known = mission.home is not None or type(height) not in {int, float}
    home = [pad.latitude / 1e7, pad.longitude / 1e7, pad.height if known else height]
    _check_fence(fence, site)
    cruise = WINDY if script.site.wind else CRUISE
    wanted = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": station,
        "fleetToken": token,
        "mission": {
            "version": 2,
            "firmwareType": PX4 if mission.home is None else ARDUPILOT,
            "vehicleType": 2,
            "cruiseSpeed": cruise,
            "hoverSpeed": cruise,
            "globalPlanAltitudeMode": 1,
            "plannedHomePosition": home,
            "items": [_entry(n, item) for n, item in enumerate(mission.items, 1)],
        },
        "geoFence": {
            "version": 2,
            "circles": [],
            "polygons": [{"version": 1, "inclusion": True, "polygon": fence}],
        },
        "rallyPoints": {
            "version": 2,
            "points": [[home[0], home[1], round(script.landing.altitude, 2)]],
        },
    }
    for different in unlike(plan, wanted, "plan", rounding=0.0):
        raise MissionFormatError(different)


def _entry(number: int, item: Item) -> dict[str, Any]:
    """Return QGroundControl's form of an item."""
    height = round(item.height, 3)
    entry: dict[str, Any] = {
        "type": "SimpleItem",
        "autoContinue": True,
        "command": item.command,
        "doJumpId": number,
        "frame": item.frame,
        "params": [
            *item.parameters,
            item.latitude / 1e7,
            item.longitude / 1e7,
            height,
        ],
    }
    if item.frame != MISSION:
        entry |= {
            "AMSLAltAboveTerrain": None,
            "Altitude": height,
            "AltitudeMode": 1,
        }
    return entry


def _check_fence(found: Any, site: Site) -> None:  # noqa: ANN401 - any JSON
    """Hold the corners of a fence against the site's, clockwise from above."""
    wanted = fence_corners(site)
    try:
        kinds = {type(value) for corner in found for value in corner}
        corners = np.array(found, dtype=np.float64)
    except (TypeError, ValueError):
        kinds, corners = {str}, wanted
    if not kinds <= {int, float} or corners.shape != wanted.shape:
        raise MissionFormatError(
            f"geoFence: the script's fence has {len(wanted)} corners, this another"
        )
    altitude = np.full(len(corners), site.altitude)
    level = to_show_frame(site, corners[:, 0], corners[:, 1], altitude)[:, :2]
    # A tangent plane has no corner off by its curve within any fence of a show.
    off = np.linalg.norm(level - wanted, axis=1)
    if not off.max() <= CORNER:
        number = int(off.argmax())
        raise MissionFormatError(
            f"geoFence: corner {number + 1} is {off[number]:.2f} m off the script's"
        )


def fence_corners(site: Site) -> FloatArray:
    """Return the corners (n, 2) of the site's fence, show frame [m], clockwise.

    The volume's walls where the site has no fence.
    """
    low, high = site.volume_min, site.volume_max
    walls = [(low.x, low.y), (low.x, high.y), (high.x, high.y), (high.x, low.y)]
    corners = np.array(site.fence, dtype=np.float64).reshape(-1, 2)
    if not len(corners):
        return np.array(walls)
    x, y = corners.T
    # Twice the area, positive if they go round to the left.
    area = np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)
    return corners if area <= 0.0 else corners[::-1]
