"""A layout for Foxglove and Lichtblick: the show in 3-D, and plots of a drone."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from showc.log.schema import FLEET, FRAME, PREDICTED, SCENE, state_topic

if TYPE_CHECKING:
    from showc.script.show import Show

PLOTS = {
    "Height [m]": ("position.z",),
    "Velocity [m/s]": ("velocity.x", "velocity.y", "velocity.z"),
    "Thrust [N]": ("thrust",),
}
"""Title of each plot and the fields of ``showc.DroneState`` in it."""


def layout_json(show: Show, *, plots: bool) -> bytes:
    """Return the layout; with ``plots`` only where the log has samples per drone."""
    low, high = show.site.volume_min, show.site.volume_max
    middle = [(a + b) / 2.0 for a, b in zip(low, high, strict=True)]
    size = max(b - a for a, b in zip(low, high, strict=True))
    panels: dict[str, Any] = {
        "3D!show": {
            "cameraState": {
                "perspective": True,
                "distance": 1.6 * size,
                "phi": 75.0,
                "thetaOffset": 20.0,
                "targetOffset": middle,
                "target": [0.0, 0.0, 0.0],
                "targetOrientation": [0.0, 0.0, 0.0, 1.0],
                "fovy": 45.0,
                "near": 0.1,
                "far": 20000.0,
            },
            "followMode": "follow-none",
            "followTf": FRAME,
            "scene": {"backgroundColor": "#05070d", "enableStats": False},
            "transforms": {},
            "topics": {
                FLEET: {
                    "visible": True,
                    "colorMode": "rgba-fields",
                    "colorField": "red",
                    "pointShape": "circle",
                    "pointSize": 6,
                },
                PREDICTED: {"visible": False, "pointShape": "circle", "pointSize": 3},
                SCENE: {"visible": True},
            },
            "layers": {},
        }
    }
    layout: Any = "3D!show"
    if plots:
        names = []
        for title, fields in PLOTS.items():
            name = f"Plot!{fields[0].replace('.', '')}"
            names.append(name)
            panels[name] = {
                "title": title,
                "paths": [
                    {
                        "value": f"{state_topic(0)}.{field}",
                        "enabled": True,
                        "timestampMethod": "receiveTime",
                    }
                    for field in fields
                ],
                "xAxisVal": "timestamp",
                "showLegend": True,
                "isSynced": True,
            }
        column: Any = names[-1]
        for index, name in enumerate(reversed(names[:-1])):
            column = {
                "direction": "column",
                "first": name,
                "second": column,
                "splitPercentage": 100 / (index + 2),
            }
        layout = {
            "direction": "row",
            "first": "3D!show",
            "second": column,
            "splitPercentage": 70,
        }
    return (
        json.dumps(
            {
                "configById": panels,
                "globalVariables": {},
                "userNodes": {},
                "playbackConfig": {"speed": 1},
                "layout": layout,
            },
            indent=2,
        )
        + "\n"
    ).encode()
