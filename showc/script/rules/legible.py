"""Legibility: pictures with too few drones to be read, or that read from behind.

A flat drawing reads from the side to which right x up points: an audience there sees
its right on the right. From the other side it is mirrored.
"""

from __future__ import annotations

from math import radians, sin, sqrt
from typing import TYPE_CHECKING

import numpy as np

from showc.script.diagnostic import Diagnostic, Severity, Spot
from showc.script.formations.shape import PLANES
from showc.script.language.settings import Settings
from showc.script.language.wording import number_text
from showc.script.sections.placing import transform

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import FloatArray
    from showc.script.sections.build import Sketch
    from showc.script.show import Formation

STEM = {"centreline": 3.5, "outline": 3.5, "inside": 5.0}
"""Least height of a letter as a multiple of the distance of neighbouring places, by how
it is drawn: the coarsest letters of dots that people read are 3 wide and 5 high, which
is four times; places along strokes lie on no grid, so that a little less does. Places
inside of strokes lie now on one side, now on the other: pictures of words were looked
at, and the first that could be read had five times."""


_TRIES, _MOST = 8, 3.0
"""How often a text is drawn again with more places, and how many times as many at once:
more of them also fill corners and crossings."""
_ROOM = 2.0
"""Distance of neighbours in a text that is advised, as a multiple of the separation:
where strokes meet, places are half as far apart as elsewhere, or a little less."""


EYES = 1.7
"""Height of eyes above the ground [m]: of a standing adult."""
_EDGE = sin(radians(10.0))
"""Sine of the angle to its plane below which a picture is seen from its edge: neither
as it is drawn nor mirrored."""
_LEVEL = 0.7
"""Cosine of the steepest way down or up at which a picture counts as lying flat."""
_ALIKE = 0.5
"""How near a mirrored place comes to one of the picture, in distances of neighbours,
on the average, where the picture and its mirror image count as one."""
_FEW = 3
"""Places from which on there is a picture that could be mirrored."""


def legibility_findings(sketch: Sketch) -> Iterator[Diagnostic]:
    """Yield texts and pictures that cannot be read (SHW216, SHW218)."""
    yield from _coarse(sketch)
    yield from _mirrored(sketch)


def _drawn(sketch: Sketch) -> Iterator[tuple[str, Settings, Formation]]:
    """Yield the formations that could be drawn, with what the script says of them."""
    if "formations" not in sketch.settings:
        return
    for name, setting in sketch.settings.section("formations").values.items():
        own, formation = setting.value, sketch.formations.get(name)
        if (
            isinstance(own, Settings)
            and not own.broken
            and formation is not None
            and len(formation.points) > 1
            and name not in {sketch.pads, sketch.parking}
        ):
            yield name, own, formation


def _coarse(sketch: Sketch) -> Iterator[Diagnostic]:
    """Find texts with too few drones to be read (SHW216)."""
    for name, own, formation in _drawn(sketch):
        if "text" not in own:
            continue
        points, least = formation.points, STEM[own.text("draw")]
        stem, apart = _letters(points, own)
        if stem >= least * apart:
            continue
        needed, read = _enough(sketch, own, points)
        enough = f"{needed} drones" if needed else "more drones"
        wanted = (
            least * _ROOM * (sketch.separation.distance if sketch.separation else 0)
        )
        if wanted > read > 0.0:
            # That number of places keeps apart only in letters that are larger.
            larger = np.ceil(own.number("height") * wanted / read)
            enough += f" and `height: {number_text(float(larger))}`"
        yield Diagnostic(
            "SHW216",
            f"the text of `{name}` is illegible: its letters are "
            f"{number_text(round(stem, 1))} m high, its places "
            f"{number_text(round(apart, 1))} m apart",
            own.mark_of("text"),
            notes=(f"it has {len(points)} drones",),
            help=f"use {enough}, or a shorter text",
            spot=Spot(name, ()),
            severity=Severity.WARNING,
        )


def _letters(points: FloatArray, own: Settings) -> tuple[float, float]:
    """Height of a text's letters, and how far apart its places are [m].

    As drawn; a transform that scales it scales both. Along outlines, the next place is
    not the nearest where the other side of the stroke is nearer.
    """
    lines = own.text("text").count("\n") + 1
    extent = float(np.max(np.ptp(points, axis=0)[1:]))
    follows = own.text("draw") == "outline"
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    apart = steps if follows else _neighbours(points)
    return extent / lines, float(np.median(apart))


def _enough(sketch: Sketch, own: Settings, points: FloatArray) -> tuple[int, float]:
    """Return how many places make a text legible, and the height of its letters [m].

    It is drawn with more of them until it is; 0: not found.
    """
    # Along strokes the number grows with the length, over areas with its square.
    power = 2.0 if own.text("draw") == "inside" else 1.0
    least = STEM[own.text("draw")]
    stem, apart = _letters(points, own)
    for _ in range(_TRIES):
        # Places in a level row have letters without height.
        share = (least * apart / max(stem, 1e-6)) ** power
        count = max(int(np.ceil(len(points) * min(share, _MOST))), len(points) + 1)
        more = sketch.redrawn(own, count)
        if more is None:
            break
        points = more
        stem, apart = _letters(points, own)
        if stem >= least * apart:
            return count, stem
    return 0, stem


_ASKED = 200
"""Places of a text that are asked for their neighbours: enough for a median."""


def _neighbours(points: FloatArray) -> FloatArray:
    """Distance of some places, evenly chosen, from the next one, shape (k,) [m]."""
    rows = np.arange(0, len(points), -(-len(points) // _ASKED))
    found = np.empty(len(rows))
    for at, row in enumerate(rows):
        square = ((points - points[row]) ** 2).sum(axis=1)
        square[row] = np.inf
        found[at] = sqrt(float(square.min()))
    return found


def _mirrored(sketch: Sketch) -> Iterator[Diagnostic]:
    """Find pictures that an audience sees from behind (SHW218)."""
    audience = sketch.site.audience if sketch.site is not None else ()
    for name, own, formation in _drawn(sketch) if audience else ():
        axes = _axes(sketch, own)
        if axes is None or len(formation.points) < _FEW:
            continue
        right, up = axes
        facing = np.cross(right, up)
        if _symmetric(formation.points, right):
            continue
        middle = formation.points.mean(axis=0)
        before, behind = [], []
        for people in audience:
            eyes = np.column_stack([people.points, np.full(len(people.points), EYES)])
            ways = eyes - middle
            turned = ways @ facing / np.linalg.norm(ways, axis=1)
            before += [people.name] * bool((turned > _EDGE).any())
            behind += [people.name] * bool((turned < -_EDGE).any())
        if not behind:
            continue
        names = ", ".join(f"`{one}`" for one in dict.fromkeys(behind))
        if before:
            others = ", ".join(f"`{one}`" for one in dict.fromkeys(before))
            help_text = (
                f"turned by 180° it would be mirrored for {others}: show it twice, "
                "once for each side, or a picture that is the same from both"
            )
        elif abs(facing[2]) > _LEVEL:
            help_text = "write `transform: [{mirror: x}]`: it is seen from below"
        else:
            help_text = "turn it round: `transform: [{rotate: 180}]`"
        yield Diagnostic(
            "SHW218",
            f"`{name}` is mirrored for the audience {names}",
            own.mark_of("transform") if "transform" in own else formation.mark,
            notes=(f"it is readable from the side of {_side(facing)}",),
            help=help_text,
            spot=Spot(name, ()),
            severity=Severity.WARNING,
        )


def _axes(sketch: Sketch, own: Settings) -> tuple[FloatArray, FloatArray] | None:
    """Return unit vectors to a flat picture's right and up; None for other shapes."""
    axes = None
    if "like" in own:
        base = sketch.settings.section("formations").values[own.text("like")].value
        axes = _axes(sketch, base) if isinstance(base, Settings) else None
    elif "type" in own and own.text("type") in {"text", "svg", "image"}:
        axes = PLANES[own.text("plane")][0], PLANES[own.text("plane")][1]
    if axes is not None and "transform" in own:
        # Without shifts: directions have no place.
        _, (right, up) = transform(np.stack(axes), own.sections("transform"))
        axes = right, up
    return (_unit(axes[0]), _unit(axes[1])) if axes is not None else None


def _unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / np.linalg.norm(vector))


def _symmetric(points: FloatArray, right: FloatArray) -> bool:
    """Tell whether a picture looks the same when its right becomes its left."""
    along = points @ right
    middle = (along.min() + along.max()) / 2.0
    rows = np.arange(0, len(points), -(-len(points) // _ASKED))
    image = points[rows] + 2.0 * (middle - along[rows])[:, None] * right
    gaps = [sqrt(float(((points - one) ** 2).sum(axis=1).min())) for one in image]
    return float(np.mean(gaps)) < _ALIKE * float(np.median(_neighbours(points)))


def _side(facing: FloatArray) -> str:
    """Name the side to which a picture faces, by the nearest axis of the show frame."""
    axis = int(np.argmax(np.abs(facing)))
    return f"{'-' if facing[axis] < 0.0 else '+'}{'xyz'[axis]}"
