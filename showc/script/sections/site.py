"""The site of a script: frame, volume, fence, and what lies around."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.script.fence import area_of, crossed_edges
from showc.script.show import Audience, Building, Risk, Site

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.script.language.reader import Reader
    from showc.script.language.settings import Settings

LEAST_AREA = 0.01
"""Of a fence, an audience or a building [m²]: less is a mistake."""


def site_of(settings: Settings, reader: Reader) -> Site | None:
    """Return the site, or None if its volume is turned inside out."""
    origin, volume = settings.section("origin"), settings.section("volume")
    if origin.broken or volume.broken or settings.broken or _unsound(settings):
        return None
    low, high = volume.vector("min"), volume.vector("max")
    for axis, letter in enumerate("xyz"):
        if low[axis] >= high[axis]:
            reader.say(
                "SHW120",
                f"the volume has {letter} from {low[axis]:g} to {high[axis]:g} m",
                volume.mark_of("max" if volume.written("max") else "min"),
                help_text="`max` must be greater than `min` along every axis",
            )
            return None
    around = [*settings.sections("audience"), *settings.sections("buildings")]
    outlines = [(settings, "fence"), *((section, "area") for section in around)]
    twisted = [_twisted(*outline, reader) for outline in outlines]
    if any(twisted):
        return None
    risk = settings.section("risk")
    return settings.made(
        Site,
        latitude=origin.number("latitude"),
        longitude=origin.number("longitude"),
        altitude=origin.number("altitude"),
        volume_min=low,
        volume_max=high,
        fence=_points(settings, "fence") if "fence" in settings else None,
        audience=tuple(_audience(item) for item in settings.sections("audience")),
        buildings=tuple(_building(item) for item in settings.sections("buildings")),
        risk=Risk(**{"wind": settings.number("wind")} | risk.named(Risk)),
    )


def _twisted(settings: Settings, key: str, reader: Reader) -> bool:
    """Tell whether an outline crosses itself or is a line, and say so (SHW123)."""
    if key not in settings:
        return False
    corners = _points(settings, key)
    crossed = crossed_edges(corners)
    if crossed is None and abs(area_of(corners)) < LEAST_AREA:
        reader.say(
            "SHW123",
            "the outline encloses no area: its corners are on one line",
            settings.mark_of(key),
            help_text="list corners that enclose an area",
        )
        return True
    if crossed is None:
        return False
    count = len(settings.values[key].plain)
    one, other = (
        f"from corner {first + 1} to {(first + 1) % count + 1}" for first in crossed
    )
    reader.say(
        "SHW123",
        f"the outline crosses itself: the edges {one} and {other}",
        settings.mark_of(key),
        help_text="list the corners in the order of a walk around the area",
    )
    return True


def _unsound(settings: Settings) -> bool:
    """Tell whether something around the site could not be read."""
    if "risk" not in settings or settings.section("risk").broken:
        return True
    around = settings.sections("audience") + settings.sections("buildings")
    return any(section.broken for section in around)


def _points(settings: Settings, key: str) -> FloatArray:
    """Return a list of points, shape (n, 2) [m]; read-only."""
    points = np.array(settings.values[key].plain, dtype=np.float64)
    points.setflags(write=False)
    return points


def _audience(settings: Settings) -> Audience:
    area = "area" in settings
    points = _points(settings, "area" if area else "line")
    return Audience(settings.text("name"), points, area)


def _building(settings: Settings) -> Building:
    return Building(
        settings.text("name"), _points(settings, "area"), settings.number("height")
    )
