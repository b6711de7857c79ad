"""Motions: what a formation does while it is held, as a script says it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from showc.script.formations.frames import frames_of
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
    from showc.script.language.settings import Setting, Settings

SETTING_IN = 0.75
"""Ramp of a breath, wave or orbit unless it is given [periods]. A swing reaches 1.33
times its acceleration while it sets in, whatever its phase; with half a period 1.82
times. A breath in a hold of two periods still reaches 0.89 of its size."""

_KINDS: dict[str, tuple[type[Rotate | Breathe | Wave | Orbit], dict[str, Any]]] = {
    "rotate": (Rotate, {"about": None}),
    "breathe": (Breathe, {"about": None}),
    "wave": (Wave, {"wavelength": math.inf}),
    "orbit": (Orbit, {"wavelength": math.inf}),
}
"""What the keys of a motion make, and what holds where a script says nothing."""


def formations_of(transition: Settings) -> list[str]:
    """Return the names of formations that a transition's motions become."""
    return [str(name.value) for name in morphs_of(transition)]


def morphs_of(transition: Settings) -> list[Setting]:
    """Return the same as they are written."""
    morphs = [item for item in transition.sound("motion") if "morph" in item]
    return [name for item in morphs for name in item.items("morph")]


def motion_of(item: Settings, files: InputFiles) -> Motion:
    """Return a motion that a transition asks for.

    Raises
    ------
    ScriptError
        If an axis has no length, or a file no frames.
    """
    if "follow" in item:
        own = item.section("follow")
        name = own.text("file")
        frames = frames_of(name, "motion", files.read)
        return Follow(name, frames.points, frames.length, own.number("ramp"))
    if "travel" in item:
        return Travel(item.values["travel"].plain)
    if "morph" in item:
        return Morph(item.values["morph"].plain)
    key = next(iter(_KINDS.keys() & item.values.keys()))
    own, (kind, given) = item.section(key), _KINDS[key]
    given = given | own.named(kind)
    named = (name for name in ("axis", "direction") if name in own)
    given |= {name: own.unit_vector(name) for name in named}
    if "ramp" not in own:
        given["ramp"] = SETTING_IN * own.number("period")
    return kind(**given)
