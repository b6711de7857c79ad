"""The circle: places evenly spaced on a circle or an arc."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from showc.script.formations.shape import (
    Drawing,
    Request,
    Shape,
    any_count,
    plane_field,
    stand,
)
from showc.script.language.kinds import Field, Quantity, Section

if TYPE_CHECKING:
    from showc.script.language.settings import Settings

SECTION = Section(
    "circle",
    "Places evenly spaced on a circle, or on an arc of it, counter-clockwise.",
    (
        Field(
            "radius",
            Quantity("m", minimum=0.0, maximum=5000.0, positive=True),
            "Radius.",
            default_text="large enough for the spacing, or 1.5 times the separation",
            examples=(12, "12 m"),
        ),
        Field(
            "start",
            Quantity("deg", minimum=-360.0, maximum=360.0),
            "Angle of the first place, counter-clockwise from the drawing's right.",
            default=0.0,
        ),
        Field(
            "arc",
            Quantity("deg", minimum=0.0, maximum=360.0, positive=True),
            "Angle that the places span. An arc has a place at each end.",
            default=360.0,
        ),
        plane_field("horizontal"),
    ),
)


def draw(settings: Settings, request: Request) -> Drawing:
    """Draw the circle about its centre."""
    arc = settings.number("arc")
    whole = math.isclose(arc, 2.0 * math.pi)
    gaps = max(request.count if whole else request.count - 1, 1)
    step = arc / gaps
    radius = settings.optional("radius")
    if radius is None:
        chord = 2.0 * math.sin(min(step, math.pi) / 2.0)
        radius = request.spacing / chord * (1.0 + 1e-6)
    angle = settings.number("start") + step * np.arange(request.count)
    flat = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return Drawing(stand(flat, settings.text("plane")))


SHAPE = Shape(SECTION, any_count, draw)
