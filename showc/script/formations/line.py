"""The line: places evenly spaced along a straight line."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.script.formations.shape import (
    Drawing,
    Request,
    Shape,
    any_count,
)
from showc.script.language.kinds import Choice, Either, Field, Items, Quantity, Section

if TYPE_CHECKING:
    from showc.script.language.settings import Settings

SECTION = Section(
    "line",
    "Places evenly spaced along a straight line, centred.",
    (
        Field(
            "length",
            Quantity("m", minimum=0.0, maximum=10_000.0),
            "Distance from the first place to the last.",
            default_text="the spacing between neighbours, or 1.5 times the separation",
        ),
        Field(
            "direction",
            Either(
                (
                    Choice(("x", "y", "z")),
                    Items(Quantity(minimum=-1e3, maximum=1e3), 3, 3),
                )
            ),
            "Direction of the line, show frame. Its length does not matter.",
            default="x",
        ),
    ),
)


def draw(settings: Settings, request: Request) -> Drawing:
    """Draw the line, centred."""
    gaps = max(request.count - 1, 1)
    length = settings.optional("length")
    step = request.spacing if length is None else length / gaps
    along = (np.arange(request.count) - (request.count - 1) / 2.0) * step
    return Drawing(along[:, None] * np.array(settings.unit_vector("direction")))


SHAPE = Shape(SECTION, any_count, draw)
