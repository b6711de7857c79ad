"""Motions: what a formation does while it is held, as a script says it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from showc.script.formations.frames import frames_of
from showc.script.settings import Settings
from showc.script.show import (
    Breathe,
    Follow,
    Morph,
    Motion,
    Orbit,
    Rotate,
    Travel,
    Wave,
)

if TYPE_CHECKING:
    from showc.script.files import InputFiles
    from showc.script.settings import Setting
    from showc.vehicle import Vector

SETTING_IN = 0.75
"""Ramp of a breath, wave or orbit unless it is given [periods]. A swing reaches 1.33
times its acceleration while it sets in, whatever its phase; with half a period 1.82
times. A breath in a hold of two periods still reaches 0.89 of its size."""


def formations_of(transition: Settings) -> list[str]:
    """Return the names of formations that a transition's motions become."""
    return [
        str(name.value)
        for item in _items(transition)
        if "morph" in item
        for name in item.items("morph")
    ]


def _items(transition: Settings) -> list[Settings]:
    found: list[Setting] = transition.items("motion") if "motion" in transition else []
    values = [item.value for item in found]
    return [item for item in values if isinstance(item, Settings) and not item.broken]


def motions_of(transition: Settings, files: InputFiles) -> tuple[Motion, ...]:
    """Return the motions that a transition asks for.

    Raises
    ------
    FormationError
        If an axis has no length, or a file no frames.
    """
    return tuple(_motion(item, files) for item in _items(transition))


def _motion(item: Settings, files: InputFiles) -> Motion:
    if "follow" in item:
        own = item.section("follow")
        name = own.text("file")
        frames = frames_of(name, "motion", files.read)
        return Follow(name, frames.points, frames.length, own.number("ramp"))
    if "travel" in item:
        ways = []
        for point in item.items("travel"):
            x, y, z = Settings("", point.mark, {"point": point}).vector("point")
            ways.append((x, y, z))
        return Travel(tuple(ways))
    if "morph" in item:
        return Morph(tuple(str(name.value) for name in item.items("morph")))
    key = next(iter({"rotate", "breathe", "wave", "orbit"} & item.values.keys()))
    own = item.section(key)
    about = own.vector("about") if "about" in own else None
    if key == "rotate":
        angle, axis = own.number("angle"), _unit(own, "axis")
        return Rotate(angle, axis, about, own.number("ramp"))
    period = own.number("period")
    asked = own.optional("ramp")
    ramp = SETTING_IN * period if asked is None else asked
    if key == "breathe":
        return Breathe(own.number("scale"), period, about, ramp)
    length = own.optional("wavelength")
    size = own.number("amplitude" if key == "wave" else "radius")
    return (Wave if key == "wave" else Orbit)(
        size,
        _unit(own, "axis"),
        period,
        _unit(own, "direction"),
        math.inf if length is None else length,
        ramp,
    )


def _unit(own: Settings, key: str) -> Vector:
    from showc.script.placing import unit_vector  # noqa: PLC0415 - imports numpy

    x, y, z = (float(part) for part in unit_vector(own, key))
    return x, y, z
