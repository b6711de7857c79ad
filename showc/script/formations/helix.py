"""The helix: one or more strands winding upwards."""

from __future__ import annotations

from math import tau
from typing import TYPE_CHECKING

import numpy as np

from showc.script.formations.shape import Drawing, Request, Shape, any_count
from showc.script.language.kinds import Field, Integer, Quantity, Section

if TYPE_CHECKING:
    from showc.script.language.settings import Settings

SECTION = Section(
    "helix",
    "Places evenly spaced along strands that wind up around the vertical axis.",
    (
        Field(
            "radius",
            Quantity("m", minimum=0.0, maximum=1000.0, positive=True),
            "Radius.",
            default=8.0,
        ),
        Field(
            "height",
            Quantity("m", minimum=0.0, maximum=1000.0),
            "Height from the lowest place to the highest.",
            default=20.0,
        ),
        Field(
            "turns",
            Quantity(minimum=-100.0, maximum=100.0),
            "Turns from bottom to top, counter-clockwise seen from above. Negative "
            "turns are clockwise.",
            default=2.0,
        ),
        Field("strands", Integer(1, 20), "Number of strands.", default=1),
    ),
)


def draw(settings: Settings, request: Request) -> Drawing:
    """Draw the helix, centred; places are numbered strand by strand."""
    strands = settings.integer("strands")
    sizes = [
        request.count // strands + (index < request.count % strands)
        for index in range(strands)
    ]
    parts = []
    for index, size in enumerate(sizes):
        along = np.linspace(0.0, 1.0, size) if size > 1 else np.full(size, 0.5)
        angle = tau * (settings.number("turns") * along + index / strands)
        radius = settings.number("radius")
        height = (along - 0.5) * settings.number("height")
        parts.append(
            np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])
        )
    return Drawing(np.concatenate(parts))


SHAPE = Shape(SECTION, any_count, draw)
