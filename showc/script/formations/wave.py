"""The wave: a level grid whose height runs through a sine."""

from __future__ import annotations

from math import tau
from typing import TYPE_CHECKING

import numpy as np

from showc.script.diagnostic import ScriptError
from showc.script.formations import grid
from showc.script.formations.shape import Drawing, Request, Shape
from showc.script.language.kinds import Field, Items, Quantity, Section

if TYPE_CHECKING:
    from showc.script.language.settings import Settings

SECTION = Section(
    "wave",
    "A horizontal grid of rows and columns whose heights follow a sine wave.",
    (
        *(field for field in grid.SECTION.fields if field.key != "plane"),
        Field(
            "amplitude",
            Quantity("m", minimum=0.0, maximum=500.0),
            "Height of the crests above the middle.",
            default=3.0,
        ),
        Field(
            "wavelength",
            Quantity("m", minimum=0.1, maximum=10_000.0),
            "Distance from crest to crest.",
            default=20.0,
        ),
        Field(
            "phase",
            Quantity("deg", minimum=-3600.0, maximum=3600.0),
            "Phase in the middle of the grid.",
            default=0.0,
        ),
        Field(
            "direction",
            Items(Quantity(minimum=-1e3, maximum=1e3), 2, 2),
            "Direction `[x, y]` in which the wave runs. Its length does not matter.",
            default=[1, 0],
        ),
    ),
)


def draw(settings: Settings, request: Request) -> Drawing:
    """Draw the wave about its middle."""
    points = grid.lattice(settings, request, "horizontal")
    direction = np.array(settings.numbers("direction"))
    size = float(np.linalg.norm(direction))
    if size == 0.0:
        raise ScriptError(
            "SHW104",
            "`direction` has length zero",
            key="direction",
            help_text="write for example `[1, 0]`",
        )
    way = points[:, :2] @ direction / size
    angle = tau * way / settings.number("wavelength") + settings.number("phase")
    points[:, 2] += settings.number("amplitude") * np.sin(angle)
    return Drawing(points)


SHAPE = Shape(SECTION, grid.own_count, draw)
