"""The ``.plan`` file of QGroundControl: mission, geofence and rally point as JSON."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from showc._version import __version__
from showc.geodesy import SiteFrame
from showc.mission.items import Frame

if TYPE_CHECKING:
    from showc.mission.items import Mission, MissionItem
    from showc.script.show import Site


FIRMWARE_TYPES = {"ardupilot": 3, "px4": 12}
"""MAV_AUTOPILOT values."""

QUADROTOR = 2
"""MAV_TYPE of a quadrotor."""

RELATIVE_ALTITUDE = 1
"""QGroundControl's name for heights above home."""


@dataclass(frozen=True, slots=True)
class PlanSettings:
    """What the plan files of a fleet have in common."""

    autopilot: str
    """``ardupilot`` or ``px4``."""
    fence: tuple[tuple[float, float], ...]
    """Corners of the geofence, latitude and longitude [deg], clockwise."""
    cruise_speed: float
    """For QGroundControl's own estimates [m/s]."""
    rally_height: float
    """Height of the rally point above home [m]."""
    fleet_token: str
    """Which compile the file belongs to."""


def fence_corners(site: Site) -> tuple[tuple[float, float], ...]:
    """Return the site's geofence, or its volume's walls, clockwise from above.

    Latitude and longitude in degrees, the first corner not repeated.
    """
    if site.fence is not None:
        corners = np.asarray(site.fence, dtype=np.float64)
    else:
        (left, back, _), (right, front, _) = site.volume_min, site.volume_max
        corners = np.array([[left, back], [left, front], [right, front], [right, back]])
    following = np.roll(corners, -1, axis=0)
    area = np.sum(corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0])
    if area > 0.0:
        corners = corners[::-1]
    ground = np.column_stack([corners, np.zeros(corners.shape[0])])
    places = SiteFrame.of(site).to_geodetic(ground)
    return tuple(
        (round(float(latitude), 7), round(float(longitude), 7))
        for latitude, longitude, _ in places
    )


def plan_file(mission: Mission, settings: PlanSettings) -> bytes:
    """Return the plan of one drone.

    Home stands only in ``plannedHomePosition``: a sender of the plan adds it for
    ArduPilot.
    """
    home = [
        mission.home.latitude / 1e7,
        mission.home.longitude / 1e7,
        mission.home.height,
    ]
    document = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": f"showc {__version__}",
        "fleetToken": settings.fleet_token,
        "mission": {
            "version": 2,
            "firmwareType": FIRMWARE_TYPES[settings.autopilot],
            "vehicleType": QUADROTOR,
            "cruiseSpeed": settings.cruise_speed,
            "hoverSpeed": settings.cruise_speed,
            "globalPlanAltitudeMode": RELATIVE_ALTITUDE,
            "plannedHomePosition": home,
            "items": [],
        },
        "geoFence": {
            "version": 2,
            "circles": [],
            "polygons": [
                {"version": 1, "inclusion": True, "polygon": list(settings.fence)}
            ],
        },
        "rallyPoints": {
            "version": 2,
            "points": [[home[0], home[1], round(settings.rally_height, 2)]],
        },
    }
    # A line for each item: short to read, and far quicker to write than indented.
    items = ",\n   ".join(
        json.dumps(_item(number, item)) for number, item in enumerate(mission.items, 1)
    )
    frame = json.dumps(document, indent=1)
    text = frame.replace('"items": []', f'"items": [\n   {items}\n  ]', 1)
    return (text + "\n").encode("ascii")


def _item(number: int, item: MissionItem) -> dict[str, Any]:
    """One SimpleItem."""
    height = round(item.height, 3)
    entry: dict[str, Any] = {
        "type": "SimpleItem",
        "autoContinue": True,
        "command": int(item.command),
        "doJumpId": number,
        "frame": int(item.frame),
        "params": [
            *item.parameters,
            item.latitude / 1e7,
            item.longitude / 1e7,
            height,
        ],
    }
    if item.frame is not Frame.MISSION:
        entry |= {
            "AMSLAltAboveTerrain": None,
            "Altitude": height,
            "AltitudeMode": RELATIVE_ALTITUDE,
        }
    return entry
