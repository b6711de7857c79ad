"""A layout for Foxglove and Lichtblick: the show in 3-D, and plots of a drone."""

from __future__ import annotations

import json
from importlib import resources
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from showc.script.show import Show

_SCENE = "3D!show"
"""Name of the panel that draws the show."""


def layout_json(show: Show, *, plots: bool) -> bytes:
    """Return the layout; with ``plots`` only where the log has samples per drone."""
    text = resources.files(__package__).joinpath("layout.json").read_text("utf-8")
    layout = json.loads(text)
    scene = layout["configById"][_SCENE]
    low, high = show.site.volume_min, show.site.volume_max
    size = max(b - a for a, b in zip(low, high, strict=True))
    middle = [(a + b) / 2.0 for a, b in zip(low, high, strict=True)]
    # From so far away the whole volume is seen at 45 degrees of view.
    scene["cameraState"] |= {"distance": 1.6 * size, "targetOffset": middle}
    if not plots:
        layout |= {"configById": {_SCENE: scene}, "layout": _SCENE}
    return (json.dumps(layout, indent=2) + "\n").encode()
