"""Motions: what a formation may do while it is held, and how a script says so."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from showc.script.formations.frames import FILE, frames_of
from showc.script.kinds import (
    Choice,
    Either,
    Field,
    Items,
    Quantity,
    Reference,
    Section,
)
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

_LENGTH = Quantity("m", minimum=-10_000.0, maximum=10_000.0)
_POINT = Items(_LENGTH, 3, 3)
_AXIS = Either(
    (
        Choice(("x", "y", "z")),
        Items(Quantity(minimum=-1e3, maximum=1e3), 3, 3),
    )
)
_PERIOD = Quantity("s", minimum=0.5, maximum=3600.0)
_RAMP = Field(
    "ramp",
    Quantity("s", minimum=0.2, maximum=600.0),
    "Time to set in, and to end; half of the hold at most.",
    default=3.0,
)
_SETTING_IN = Field(
    "ramp",
    Quantity("s", minimum=0.2, maximum=600.0),
    "Time to set in, and to end; half of the hold at most.",
    default_text="three quarters of a period",
)
SETTING_IN = 0.75
"""Ramp of a breath, wave or orbit unless it is given [periods]. A swing reaches 1.33
times its acceleration while it sets in, whatever its phase; with half a period 1.82
times. A breath in a hold of two periods still reaches 0.89 of its size."""
_ABOUT = Field(
    "about",
    _POINT,
    "The point that stays, show frame.",
    default_text="the middle of the box around the formation",
)
_PHASE = (
    Field(
        "direction",
        _AXIS,
        "Along which drones lag behind each other, show frame.",
        default="x",
    ),
    Field(
        "wavelength",
        Quantity("m", minimum=0.1, maximum=10_000.0),
        "Distance over which they lag by one period.",
        default_text="none: all move alike",
    ),
)

MOTION = Section(
    "motion",
    "One motion of a formation that is held; each works on where those before it put "
    "the places.",
    (
        Field(
            "rotate",
            Section(
                "rotating",
                "A turn about an axis, right-handed, over the whole hold.",
                (
                    Field(
                        "angle",
                        Quantity("deg", minimum=-36_000.0, maximum=36_000.0),
                        "By how much.",
                        default=360,
                    ),
                    Field("axis", _AXIS, "About which axis.", default="z"),
                    _ABOUT,
                    _RAMP,
                ),
                short="angle",
            ),
            "Turn about an axis, evenly but for the ramps.",
            examples=("90 deg", {"angle": 360, "axis": "y"}),
        ),
        Field(
            "breathe",
            Section(
                "breathing",
                "A size that changes to and fro.",
                (
                    Field(
                        "scale",
                        Quantity(minimum=0.1, maximum=10.0),
                        "Size at the end of a breath in, as a share of its own.",
                        required=True,
                    ),
                    Field("period", _PERIOD, "Time of one breath.", default=6.0),
                    _ABOUT,
                    _SETTING_IN,
                ),
                short="scale",
            ),
            "Grow, or shrink, and come back.",
            examples=(1.3,),
        ),
        Field(
            "wave",
            Section(
                "waving",
                "A swing along an axis that runs through the formation.",
                (
                    Field(
                        "amplitude",
                        Quantity("m", minimum=0.01, maximum=100.0),
                        "Greatest distance from the place.",
                        required=True,
                    ),
                    Field("axis", _AXIS, "Along which drones swing.", default="z"),
                    Field("period", _PERIOD, "Time of one swing.", default=6.0),
                    *_PHASE,
                    _SETTING_IN,
                ),
                short="amplitude",
            ),
            "Swing to and fro, as a wave where a wavelength is given.",
            examples=({"amplitude": 2, "period": 6, "wavelength": 20},),
        ),
        Field(
            "orbit",
            Section(
                "orbiting",
                "A circle of each drone about its place.",
                (
                    Field(
                        "radius",
                        Quantity("m", minimum=0.01, maximum=100.0),
                        "Of the circle.",
                        required=True,
                    ),
                    Field("axis", _AXIS, "Normal of the circle.", default="z"),
                    Field("period", _PERIOD, "Time of one turn.", default=6.0),
                    *_PHASE,
                    _SETTING_IN,
                ),
                short="radius",
            ),
            "Circle about the place, one after the other where a wavelength is given.",
            examples=({"radius": 1.5, "period": 8},),
        ),
        Field(
            "travel",
            Items(_POINT, 1, 100),
            "Move as a whole by these displacements from where it stands, at rest in "
            "each; a last `[0, 0, 0]` brings it back.",
            examples=([[10, 0, 0], [0, 0, 0]],),
        ),
        Field(
            "morph",
            Items(Reference("formation"), 1, 100),
            "Become these formations one after the other, at rest in each, place i "
            "going to place i.",
            examples=(["star", "heart"],),
        ),
        Field(
            "follow",
            Section(
                "following",
                "Frames that an animation was written to, played over the whole hold: "
                "as recorded where the hold is as long as they are, and a ramp more; "
                "that is its time where none is written.",
                (
                    Field(
                        "file",
                        FILE,
                        "A table or scene, as `type: frames` takes it. Places go as "
                        "far as they go there since the first frame, along a smooth "
                        "curve: with frames a time h apart, at most h²/4 times their "
                        "acceleration beside them.",
                        required=True,
                    ),
                    _RAMP,
                ),
                short="file",
            ),
            "Follow the frames of a file, evenly but for the ramps, place i as its "
            "place i.",
            examples=("dance.csv", {"file": "dance.glb", "ramp": 1}),
        ),
    ),
    one_of=("rotate", "breathe", "wave", "orbit", "travel", "morph", "follow"),
)


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
