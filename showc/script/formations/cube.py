"""The cube: a box drawn by its edges, its faces, or its inside."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from showc.script.formations.evenly import candidates_for, spread_evenly
from showc.script.formations.mesh import surface_points
from showc.script.formations.shape import Drawing, Request, Shape, any_count
from showc.script.formations.wire import Wire, string
from showc.script.language.kinds import Choice, Either, Field, Items, Quantity, Section

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.script.language.settings import Settings


_SIDE = Quantity("m", minimum=0.0, maximum=1000.0, positive=True)

SECTION = Section(
    "cube",
    "A cube or box, drawn by its edges, its faces, or its inside.",
    (
        Field(
            "size",
            Either((_SIDE, Items(_SIDE, 3, 3))),
            "Length of the sides: one number, or one each along x, y, z.",
            default=12.0,
        ),
        Field(
            "draw",
            Choice(("edges", "faces", "inside")),
            "Where to put the places. Edges begin with a place at every corner.",
            default="edges",
        ),
    ),
)


def _corners(size: FloatArray) -> FloatArray:
    return np.array(list(product((-0.5, 0.5), repeat=3))) * size


def _edges(size: FloatArray, count: int) -> FloatArray:
    """Return the corners, then places spread over the twelve edges by length."""
    corners = _corners(size)
    pairs = [
        (first, second)
        for first in range(8)
        for second in range(first + 1, 8)
        if np.count_nonzero(corners[first] != corners[second]) == 1
    ]
    wires = [Wire(corners[list(pair)]) for pair in pairs]
    return string(corners, wires, count)


def _faces(size: FloatArray, count: int) -> FloatArray:
    triangles = []
    for axis, side in product(range(3), (-0.5, 0.5)):
        others = [other for other in range(3) if other != axis]
        quad = np.zeros((4, 3))
        quad[:, axis] = side
        quad[:, others] = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
        triangles += [quad[[0, 1, 2]], quad[[0, 2, 3]]]
    dense = surface_points(np.array(triangles) * size, candidates_for(count))
    return np.asarray(dense[spread_evenly(dense, count)])


def _inside(size: FloatArray, count: int) -> FloatArray:
    """Return the densest lattice with enough places, cut to the number wanted."""
    number = np.ones(3, dtype=np.int64)
    while int(np.prod(number)) < count:
        number[int(np.argmax(np.round(size / number, 9)))] += 1
    axes = [
        np.linspace(-0.5, 0.5, int(n)) * side if n > 1 else np.zeros(1)
        for n, side in zip(number, size, strict=True)
    ]
    lattice = np.array(list(product(*axes)))
    return np.asarray(lattice[spread_evenly(lattice, count, rounds=0)])


def draw(settings: Settings, request: Request) -> Drawing:
    """Draw the box about its centre."""
    value = settings.values["size"].value
    size = np.array(
        settings.numbers("size")
        if isinstance(value, list)
        else [settings.number("size")] * 3
    )
    match settings.text("draw"):
        case "edges":
            return Drawing(_edges(size, request.count))
        case "faces":
            return Drawing(_faces(size, request.count))
        case _:
            return Drawing(_inside(size, request.count))


SHAPE = Shape(SECTION, any_count, draw)
