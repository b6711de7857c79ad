"""The field table of a formation: its shape, its place, its colours."""

from __future__ import annotations

from showc.script.formations import SHAPES
from showc.script.kinds import (
    NAME,
    Choice,
    Either,
    Field,
    Flag,
    Integer,
    Items,
    Kind,
    Named,
    Paint,
    Quantity,
    Reference,
    Section,
)

_LENGTH = Quantity("m", minimum=-10_000.0, maximum=10_000.0)
_DIRECTION = Items(Quantity(minimum=-1e3, maximum=1e3), 3, 3)

EFFECT = Section(
    "effect",
    "A colour effect in time.",
    (
        Field(
            "kind",
            Choice(("pulse", "sweep", "rainbow", "strobe", "twinkle", "run")),
            "`pulse` darkens and brightens all together, `sweep` runs a bright band "
            "along the direction, `rainbow` runs the hues along it, `strobe` flashes "
            "all for the first quarter of each period, `twinkle` darkens and brightens "
            "each drone in its own time, `run` runs `colours` along the direction.",
            required=True,
        ),
        Field(
            "period",
            Quantity("s", minimum=0.1, maximum=600.0),
            "Time of one cycle.",
            default=2.0,
        ),
        Field(
            "beats",
            Quantity(minimum=0.125, maximum=1024.0),
            "Time of one cycle in beats of the music, instead of `period`; cycles "
            "begin on the beat.",
            default_text="none: cycles begin with the hold",
        ),
        Field(
            "colours",
            Items(Paint(), 2, 20),
            "What `run` goes through, and then again.",
            examples=(["deepskyblue", "white", "magenta"],),
        ),
        Field(
            "direction",
            _DIRECTION,
            "Axis along which sweep, rainbow or `run` go, show frame; its length does "
            "not matter.",
            default=[1, 0, 0],
        ),
        Field(
            "depth",
            Quantity(minimum=0.0, maximum=1.0),
            "How far all but rainbow and `run` darken, 0 to 1.",
            default=1.0,
        ),
        Field(
            "wavelength",
            Quantity("m", minimum=0.1, maximum=10_000.0),
            "Length of one cycle along the direction.",
            default=10.0,
        ),
    ),
    short="kind",
)

COLOUR = Section(
    "colour",
    "Colours of the places.",
    (
        Field("solid", Paint(), "One colour for all.", examples=("gold", "#ff8800")),
        Field(
            "each",
            Items(Paint()),
            "One colour for each place in order, from the start again when the list "
            "ends.",
            examples=(["red", "white"],),
        ),
        Field(
            "gradient",
            Items(Paint(), 2, 20),
            "Colours to run through, evenly spaced.",
            examples=(["deepskyblue", "white", "magenta"],),
        ),
        Field(
            "along",
            Either(
                (Choice(("x", "y", "z", "order", "centre")), _DIRECTION),
            ),
            "What the gradient runs along: an axis of the show frame, a direction, "
            "`order` (first place to last) or `centre` (from the middle outwards).",
            default="x",
        ),
    ),
    one_of=("solid", "each", "gradient"),
    short="solid",
)

TRANSFORM = Section(
    "transform",
    "One change of a formation; a list of them is done in order.",
    (
        Field("shift", Items(_LENGTH, 3, 3), "Move by this much in the show frame."),
        Field(
            "rotate",
            Section(
                "rotate",
                "A rotation about the formation's own origin, right-handed.",
                (
                    Field(
                        "angle",
                        Quantity("deg", minimum=-3600.0, maximum=3600.0),
                        "By how much.",
                        required=True,
                    ),
                    Field(
                        "axis",
                        Either((Choice(("x", "y", "z")), _DIRECTION)),
                        "About which axis of the show frame.",
                        default="z",
                    ),
                ),
                short="angle",
            ),
            "Turn about the formation's own origin.",
            examples=(45, {"angle": "90 deg", "axis": "x"}),
        ),
        Field(
            "scale",
            Either(
                (
                    Quantity(minimum=0.001, maximum=1000.0),
                    Items(Quantity(minimum=0.001, maximum=1000.0), 3, 3),
                )
            ),
            "Factor, or one for each axis, about the formation's own origin.",
            examples=(1.5, [1, 1, 0.5]),
        ),
        Field(
            "mirror",
            Choice(("x", "y", "z")),
            "Reverse this axis about the formation's own origin.",
        ),
    ),
    one_of=("shift", "rotate", "scale", "mirror"),
)


_SOURCES = (
    Field(
        "type",
        Choice(tuple(SHAPES)),
        "Which shape it is; each has keys of its own.",
    ),
    Field(
        "like",
        Reference("formation"),
        "Start from another formation, where it stands, in its colours.",
    ),
    Field(
        "parts",
        Items(Named("formation"), 1, 1000),
        "Several formations as one; places are numbered part by part. A part without "
        "a number of places of its own takes what the others leave.",
    ),
)

_COMMON = (
    Field(
        "count",
        Integer(1, 10_000),
        "Number of places.",
        default_text="what the shape fixes by itself, or as many as drones fly to it",
    ),
    Field(
        "spacing",
        Quantity("m", minimum=0.0, maximum=1000.0, positive=True),
        "Least distance between two places. Below it the formation is refused, or "
        "repaired with `spread`.",
        default_text="the separation",
    ),
    Field(
        "spread",
        Flag(),
        "Push places apart, as little as can be, until they keep the spacing.",
        default=False,
    ),
    Field(
        "transform",
        Items(TRANSFORM, 1, 100),
        "Changes to make in order, about the formation's own origin, before `centre`.",
        examples=([{"rotate": 45}, {"shift": [0, 0, 5]}],),
    ),
    Field(
        "centre",
        Items(_LENGTH, 3, 3),
        "Where the formation's own origin comes to stand, show frame.",
        default_text="above the site's origin, the lowest place at the launch "
        "altitude; no move for shapes with places of their own (points, csv, like)",
        examples=([0, 20, 40],),
    ),
    Field(
        "colour",
        COLOUR,
        "Colour of the places: a name, hexadecimal in quotes, a list or a gradient.",
        default_text="the shape's own (image, csv, like), else white",
        examples=("gold", "#ff8800", {"gradient": ["red", "blue"], "along": "z"}),
    ),
    Field("effect", EFFECT, "Colour effect while the formation is held."),
)

FORMATION = Section(
    "formation",
    "Places of the drones in one picture: one shape, changed, placed and coloured.",
    _SOURCES + _COMMON,
    one_of=("type", "like", "parts"),
    tag="type",
    variants=tuple(shape.section for shape in SHAPES.values()),
)

NAMED: dict[str, Section] = {"formation": FORMATION}
"""Sections that hold others of their own kind."""


def resolve(kind: Kind) -> Kind:
    """Return the section a name stands for; other kinds as they are."""
    return NAMED[kind.name] if isinstance(kind, Named) else kind


__all__ = ["COLOUR", "EFFECT", "FORMATION", "NAME", "NAMED", "TRANSFORM", "resolve"]
