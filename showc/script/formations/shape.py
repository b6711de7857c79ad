"""The shape: what every kind of formation gives to the builder."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from showc.script.language.kinds import Choice, Field

if TYPE_CHECKING:
    from collections.abc import Callable

    from showc.arrays import FloatArray
    from showc.script.language.kinds import Section
    from showc.script.language.settings import Settings


Plane = Literal["horizontal", "front", "side"]

PLANES: dict[str, FloatArray] = {
    "horizontal": np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    "front": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    "side": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
}
"""Directions of a flat drawing's right and up in the show frame."""


@dataclass(frozen=True, slots=True)
class Request:
    """What a shape is asked for."""

    count: int
    """Number of places wanted, if the shape itself does not fix it."""
    spacing: float
    """Distance places should keep [m]; shapes may choose their size by it."""
    seed: int
    """Seed of anything random."""
    read: Callable[[str, str], bytes]
    """Reads a file by its name in the script; the second is the key that names it."""


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """Places of a shape, before it is moved anywhere."""

    points: FloatArray
    """Shape (places, 3) [m]."""
    colours: FloatArray | None = None
    """The shape's own colours, sRGB from 0 to 1, shape (places, 3)."""


@dataclass(frozen=True, slots=True)
class Shape:
    """One kind of formation."""

    section: Section
    """Its keys."""
    own_count: Callable[[Settings, Callable[[str, str], bytes]], int | None]
    """Number of places its keys fix by themselves; None: as many as asked for."""
    draw: Callable[[Settings, Request], Drawing]
    """Draws it about its own origin."""
    absolute: bool = False
    """Whether its points are places in the show already, so that ``at`` is zero."""


def any_count(_settings: Settings, _read: Callable[[str, str], bytes]) -> int | None:
    """Say that a shape has as many places as it is asked for."""
    return None


def plane_field(default: Plane) -> Field:
    """Return the field that says in which plane a flat shape stands."""
    return Field(
        "plane",
        Choice(tuple(PLANES)),
        "Plane of the drawing: `horizontal` (x right, y up), `front` (x right, z up: "
        "seen by an audience that looks along +y), `side` (y right, z up).",
        default=default,
    )


def stand(flat: FloatArray, plane: str) -> FloatArray:
    """Put a flat drawing, shape (places, 2) [m], into its plane: (places, 3)."""
    return np.asarray(flat @ PLANES[plane], dtype=np.float64)


def centred(points: FloatArray) -> FloatArray:
    """Move points, shape (places, k), so that their bounding box is about zero."""
    middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
    return np.asarray(points - middle, dtype=np.float64)
