"""The grid: rows, columns and layers of places."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from showc.script.diagnostic import ScriptError
from showc.script.formations.shape import (
    PLANES,
    Drawing,
    Request,
    Shape,
    centred,
    plane_field,
)
from showc.script.language.kinds import Either, Field, Integer, Items, Quantity, Section

if TYPE_CHECKING:
    from collections.abc import Callable

    from showc.arrays import FloatArray
    from showc.script.language.settings import Settings


_STEP = Quantity("m", minimum=0.01, maximum=1000.0)
_USUAL = 2.0
"""Distance of neighbours where the script says nothing [m]: room for straight moves at
the usual separation."""

SECTION = Section(
    "grid",
    "Rows and columns of places, in one or more layers. Place 1 is the left end of "
    "the first (lowest or nearest) row. Places run along the row, then row by row.",
    (
        Field(
            "rows",
            Integer(1, 1000),
            "Number of rows.",
            default_text="as many as are needed",
        ),
        Field(
            "columns",
            Integer(1, 1000),
            "Number of places in a row.",
            default_text="as many as make the grid nearly square",
        ),
        Field("layers", Integer(1, 1000), "Number of layers.", default=1),
        Field(
            "step",
            Either((_STEP, Items(_STEP, 2, 3))),
            "Distance between neighbours: one number, or one each along a row, "
            "between rows and between layers.",
            default_text="2 m, or `spacing` where that is more",
            examples=(2.5, [3.0, 2.0], "250 cm"),
        ),
        plane_field("horizontal"),
    ),
)


def _size(settings: Settings, count: int) -> tuple[int, int]:
    """Return rows and columns for ``count`` places, a layer's share."""
    rows = settings.integer("rows") if "rows" in settings else 0
    columns = settings.integer("columns") if "columns" in settings else 0
    share = math.ceil(count / settings.integer("layers"))
    if rows and not columns:
        columns = math.ceil(share / rows)
    elif not columns:
        columns = math.ceil(math.sqrt(share))
    return rows or math.ceil(share / columns), columns


def own_count(
    settings: Settings, _read: Callable[[str, str], bytes] | None = None
) -> int | None:
    """Return rows times columns times layers, if both are given."""
    if "rows" in settings and "columns" in settings:
        rows, columns = settings.integer("rows"), settings.integer("columns")
        return rows * columns * settings.integer("layers")
    return None


def lattice(settings: Settings, request: Request, plane: str) -> FloatArray:
    """Return the grid's places, centred, shape (count, 3) [m].

    A last row that is not full is left-aligned.
    """
    count = request.count
    rows, columns = _size(settings, count)
    layers = settings.integer("layers")
    if rows * columns * layers < count:
        raise ScriptError(
            "SHW205",
            f"a grid of {rows} x {columns} x {layers} has {rows * columns * layers} "
            f"places; {count} are needed",
            help_text="leave out `rows` or `columns`, or make them larger",
        )
    steps: tuple[float, ...] = (max(_USUAL, settings.optional("spacing") or 0.0),)
    if "step" in settings:
        value = settings.values["step"].plain
        steps = value if isinstance(value, tuple) else (value,)
    steps = (*steps, *[steps[-1]] * (3 - len(steps)))
    index = np.arange(count)
    across = np.column_stack(
        [
            index % columns * steps[0],
            index // columns % rows * steps[1],
            index // (columns * rows) * steps[2],
        ]
    )
    right, up = PLANES[plane]
    frame = np.stack([right, up, np.abs(np.cross(right, up))])
    return np.asarray(centred(across) @ frame, dtype=np.float64)


def draw(settings: Settings, request: Request) -> Drawing:
    """Draw the grid in its plane."""
    return Drawing(lattice(settings, request, settings.text("plane")))


SHAPE = Shape(SECTION, own_count, draw)
