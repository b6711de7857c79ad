"""Points: places written out in the script."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.script.diagnostic import ScriptError
from showc.script.formations.shape import Drawing, Request, Shape
from showc.script.language.kinds import Field, Items, Quantity, Section
from showc.script.language.settings import as_numbers

if TYPE_CHECKING:
    from collections.abc import Callable

    from showc.script.language.settings import Settings

SECTION = Section(
    "points",
    "Places listed one by one, show frame.",
    (
        Field(
            "points",
            Items(Items(Quantity("m", minimum=-10_000.0, maximum=10_000.0), 3, 3)),
            "The places, each `[x, y, z]`.",
            required=True,
            examples=([[0, 0, 10], [2, 0, 10]],),
        ),
    ),
)


def own_count(
    settings: Settings, _read: Callable[[str, str], bytes] | None = None
) -> int | None:
    """Return the number of points written."""
    return len(settings.items("points"))


def draw(settings: Settings, request: Request) -> Drawing:
    """Return the points as they are, the first ``count`` of them."""
    rows = [as_numbers(item) for item in settings.items("points")]
    if len(rows) < request.count:
        raise ScriptError(
            "SHW205",
            f"{len(rows)} points are written; {request.count} are needed",
            key="points",
            help_text="add points",
        )
    return Drawing(np.array(rows[: request.count], dtype=np.float64))


SHAPE = Shape(SECTION, own_count, draw, absolute=True)
