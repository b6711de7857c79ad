"""Colours: CSS names and hexadecimal, gradients, and linear light.

Scripts speak of colours as screens do (sRGB). Lamps are driven with linear light, so
that a fade half way is half the light.
"""

from __future__ import annotations

import re
from importlib import resources
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from showc.arrays import FloatArray


Colour = tuple[float, float, float]

COLOUR_NAMES: Mapping[str, str] = MappingProxyType(
    dict(
        line.split()
        for line in resources.files(__package__)
        .joinpath("colours.txt")
        .read_text("ascii")
        .splitlines()
    )
)
"""The named colours of CSS (CSS Color Module Level 4) as hexadecimal."""

_RGB = re.compile(
    r"rgba?\(\s*(\d{1,3})\s*[, ]\s*(\d{1,3})\s*[, ]\s*(\d{1,3})\s*\)", re.IGNORECASE
)
_HEX = re.compile(r"#?([0-9a-f]{3}|[0-9a-f]{6})", re.IGNORECASE)


def parse_colour(text: str) -> Colour | None:
    """Return a colour's sRGB components, 0 to 1, or None if the text is no colour."""
    word = text.strip().lower()
    if (given := _RGB.fullmatch(word)) is not None:
        parts = [int(part) for part in given.groups()]
        red, green, blue = (part / 255.0 for part in parts)
        return (red, green, blue) if max(parts) <= 255 else None
    digits = COLOUR_NAMES.get(word)
    if digits is None:
        match = _HEX.fullmatch(word)
        if match is None:
            return None
        digits = match.group(1)
        if len(digits) == 3:
            digits = "".join(digit * 2 for digit in digits)
    red, green, blue = (int(digits[at : at + 2], 16) / 255.0 for at in (0, 2, 4))
    return red, green, blue


def linear_light(srgb: FloatArray) -> FloatArray:
    """Return linear light of sRGB components, both 0 to 1, of any shape.

    The transfer function of IEC 61966-2-1.
    """
    low = srgb / 12.92
    high = ((srgb + 0.055) / 1.055) ** 2.4
    return np.where(srgb <= 0.04045, low, high)


def gradient(stops: Sequence[Colour], along: FloatArray) -> FloatArray:
    """Run through colours.

    Parameters
    ----------
    stops
        Two or more sRGB colours, evenly spaced from 0 to 1.
    along
        Where each place lies, 0 to 1, shape (places,).

    Returns
    -------
    FloatArray
        sRGB colours, shape (places, 3), interpolated linearly.
    """
    table = np.array(stops, dtype=np.float64)
    knots = np.linspace(0.0, 1.0, len(stops))
    return np.column_stack([np.interp(along, knots, table[:, k]) for k in range(3)])
