"""Colours as numbers: linear light for lamps, sRGB for screens, hues for rainbows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from showc.arrays import ByteArray, FloatArray


GREATEST = 255
"""Greatest value of a colour byte."""


def drive_bytes(linear: FloatArray) -> ByteArray:
    """Values that an LED driver takes: proportional to the light, 0 to 255.

    Parameters
    ----------
    linear
        Linear light, 0 to 1, any shape.
    """
    scaled = np.rint(np.clip(linear, 0.0, 1.0) * GREATEST)
    return np.asarray(scaled, dtype=np.uint8)


def srgb_bytes(linear: FloatArray) -> ByteArray:
    """Values that a screen takes for the same light (IEC 61966-2-1).

    Parameters
    ----------
    linear
        Linear light, 0 to 1, any shape.
    """
    light = np.clip(linear, 0.0, 1.0)
    encoded = np.where(
        light <= 0.0031308, 12.92 * light, 1.055 * light ** (1.0 / 2.4) - 0.055
    )
    return np.asarray(np.rint(encoded * GREATEST), dtype=np.uint8)


def linear_light(srgb: ByteArray) -> FloatArray:
    """Linear light, 0 to 1, of a screen's bytes: the inverse of ``srgb_bytes``."""
    encoded = np.asarray(srgb, dtype=np.float64) / GREATEST
    return np.where(
        encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4
    )


def full_hue(turn: FloatArray) -> FloatArray:
    """Pure colours of the hue circle, shape (..., 3), linear.

    ``turn`` is the place on the circle in whole turns: 0 red, 1/3 green, 2/3 blue.
    """
    sector = (np.asarray(turn)[..., None] + np.array([0.0, 2.0, 1.0]) / 3.0) % 1.0
    return np.clip(np.abs(sector * 6.0 - 3.0) - 1.0, 0.0, 1.0)
