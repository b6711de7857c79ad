"""Placing: a drawing changed by transforms, put where it belongs, and coloured."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.script.language.colours import Colour, gradient, linear_light

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.script.language.settings import Setting, Settings


def _rotation(settings: Settings) -> FloatArray:
    """Return the rotation matrix about an axis (Rodrigues' formula), (3, 3)."""
    axis = settings.unit_vector("axis")
    angle = settings.number("angle")
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    # Rounding to 1e-15 keeps quarter and half turns exact.
    matrix = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return np.asarray(np.round(matrix, 15), dtype=np.float64)


def transform(
    points: FloatArray, changes: list[Settings]
) -> tuple[FloatArray, FloatArray]:
    """Apply changes in order, about zero.

    Parameters
    ----------
    points
        Shape (places, 3) [m].
    changes
        Settings of the ``transform`` section.

    Returns
    -------
    tuple
        The points with everything done, and the same with the shifts left out, whose
        lowest point says how high the formation stands above its own floor.
    """
    moved, unshifted = points, points
    for settings in changes:
        if "shift" in settings:
            moved = moved + np.array(settings.vector("shift"))
            continue
        if "rotate" in settings:
            matrix = _rotation(settings.section("rotate"))
        elif "scale" in settings:
            value = settings.values["scale"].value
            factors = (
                settings.numbers("scale")
                if isinstance(value, list)
                else [settings.number("scale")] * 3
            )
            matrix = np.diag(factors)
        else:
            signs = np.ones(3)
            signs["xyz".index(settings.text("mirror"))] = -1.0
            matrix = np.diag(signs)
        moved, unshifted = moved @ matrix.T, unshifted @ matrix.T
    return moved, unshifted


def paint(settings: Settings, points: FloatArray) -> FloatArray:
    """Return the sRGB colours, shape (places, 3), that a colour section asks for."""
    count = len(points)
    if "solid" in settings:
        return np.tile(np.array(_colour(settings.values["solid"])), (count, 1))
    if "each" in settings:
        table = np.array([_colour(item) for item in settings.items("each")])
        return np.asarray(table[np.arange(count) % len(table)], dtype=np.float64)
    stops = [_colour(item) for item in settings.items("gradient")]
    return gradient(stops, _along(settings, points))


def colours_in(settings: Settings, key: str) -> FloatArray:
    """Return a list of colours in linear light, shape (n, 3)."""
    srgb = np.array([_colour(item) for item in settings.items(key)])
    return linear_light(srgb)


def _along(settings: Settings, points: FloatArray) -> FloatArray:
    """Return where each place lies on a gradient, 0 to 1."""
    value = settings.values["along"].value
    if value == "order":
        way = np.arange(len(points), dtype=np.float64)
    elif value == "centre":
        middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
        way = np.linalg.norm(points - middle, axis=1)
    else:
        way = points @ settings.unit_vector("along")
    span = float(np.ptp(way))
    return (way - way.min()) / span if span > 0.0 else np.zeros(len(points))


def _colour(setting: Setting) -> Colour:
    value = setting.value
    if not isinstance(value, tuple):
        raise TypeError(f"{value!r} is not a colour")
    red, green, blue = value
    return float(red), float(green), float(blue)


__all__ = ["colours_in", "paint", "transform"]
