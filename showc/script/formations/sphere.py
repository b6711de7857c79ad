"""The sphere: places spread evenly over it."""

from __future__ import annotations

from math import pi, sqrt
from typing import TYPE_CHECKING

import numpy as np

from showc.script.formations.shape import Drawing, Request, Shape, any_count
from showc.script.language.kinds import Field, Quantity, Section

if TYPE_CHECKING:
    from showc.script.language.settings import Settings

SECTION = Section(
    "sphere",
    "Places spread evenly over a sphere, in a spiral from bottom to top (Fibonacci "
    "lattice).",
    (
        Field(
            "radius",
            Quantity("m", minimum=0.0, maximum=5000.0, positive=True),
            "Radius.",
            default_text="large enough for the spacing, or 1.5 times the separation",
        ),
    ),
)


def unit_sphere(count: int) -> np.ndarray:
    """Return the Fibonacci lattice on the unit sphere, shape (count, 3).

    Swinbank and Purser 2006, with the offset of one half.
    """
    index = np.arange(count)
    height = (2.0 * index + 1.0) / count - 1.0
    angle = pi * (3.0 - sqrt(5.0)) * index
    level = np.sqrt(1.0 - height * height)
    return np.column_stack([level * np.cos(angle), level * np.sin(angle), height])


def draw(settings: Settings, request: Request) -> Drawing:
    """Draw the sphere about its centre."""
    points = unit_sphere(request.count)
    radius = settings.optional("radius")
    if radius is None:
        gap = np.inf
        for index in range(1, request.count):
            step = points[index:] - points[:-index]
            gap = min(gap, float(np.sqrt(np.sum(step * step, axis=1).min())))
        radius = request.spacing / gap * (1.0 + 1e-6) if request.count > 1 else 1.0
    return Drawing(radius * points)


SHAPE = Shape(SECTION, any_count, draw)
