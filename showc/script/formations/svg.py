"""SVG: an outline from a vector drawing, followed or filled with places."""

from __future__ import annotations

from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np

from showc.script.formations.contours import Contour, fill, fitted, follow
from showc.script.formations.shape import (
    Drawing,
    FormationError,
    Request,
    Shape,
    any_count,
    plane_field,
    stand,
)
from showc.script.kinds import Choice, Field, File, Quantity, Section

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.script.settings import Settings

_CURVE_PIECES = 24
_DARK = 0.05

SECTION = Section(
    "svg",
    "The curves of an SVG drawing, followed by places or filled with them, in the "
    "drawing's colours.",
    (
        Field("file", File((".svg",)), "The drawing.", required=True),
        Field(
            "height",
            Quantity("m", minimum=0.1, maximum=1000.0),
            "Height of the drawn curves.",
            default=20.0,
        ),
        Field(
            "draw",
            Choice(("outline", "inside")),
            "Whether places lie along the curves or inside closed ones.",
            default="outline",
        ),
        plane_field("front"),
    ),
)


def contours_of(content: bytes, name: str) -> list[Contour]:
    """Return the curves of a drawing, y upwards, in the drawing's units.

    Raises
    ------
    FormationError
        If it is not SVG, or has no curves.
    """
    from xml.etree.ElementTree import ParseError  # noqa: PLC0415 - takes time

    import svgelements  # noqa: PLC0415 - takes time

    try:
        drawing = svgelements.SVG.parse(BytesIO(content), reify=True)
    except (ParseError, ValueError, TypeError, KeyError, AttributeError) as fault:
        raise FormationError(
            "SHW110", f"`{name}` is not SVG: {fault}", "file"
        ) from None
    contours = []
    for element in drawing.elements():
        if not isinstance(element, svgelements.Shape):
            continue
        if str(element.values.get("visibility", "")) == "hidden":
            continue
        colour = _colour(element)
        for part in svgelements.Path(element).as_subpaths():
            points = _flatten(svgelements.Path(part))
            if len(points) > 1 and float(np.ptp(points, axis=0).max()) > 0.0:
                contours.append(Contour(points * [1.0, -1.0], colour))
    if not contours:
        raise FormationError(
            "SHW110",
            f"`{name}` has no curves",
            "file",
            help_text="texts and bitmaps in a drawing must be made into paths first",
        )
    return contours


def _flatten(path: object) -> NDArray[np.float64]:
    """Return a curve as a chain of points, (corners, 2)."""
    import svgelements  # noqa: PLC0415 - takes time

    straight = svgelements.Move | svgelements.Line | svgelements.Close
    points: list[tuple[float, float]] = []
    for segment in path:  # type: ignore[attr-defined]
        if isinstance(segment, straight):
            if segment.end is not None:
                points.append((segment.end.x, segment.end.y))
        else:
            for step in range(1, _CURVE_PIECES + 1):
                point = segment.point(step / _CURVE_PIECES)
                points.append((point.x, point.y))
    return np.array(points, dtype=np.float64).reshape(-1, 2)


def _colour(element: object) -> tuple[float, float, float] | None:
    """Return a shape's stroke colour, else its fill; nothing if it is black."""
    for name in ("stroke", "fill"):
        colour = getattr(element, name, None)
        if colour is None or colour.value is None:
            continue
        red, green, blue = colour.red / 255, colour.green / 255, colour.blue / 255
        if max(red, green, blue) > _DARK:
            return red, green, blue
    return None


def draw(settings: Settings, request: Request) -> Drawing:
    """Draw the curves, centred, in their plane."""
    name = settings.text("file")
    contours = contours_of(request.read(name, "file"), name)
    drawn = fitted(contours, settings.number("height"), axis=1)
    method = fill if settings.text("draw") == "inside" else follow
    points, owner = method(drawn, request.count)
    white = (1.0, 1.0, 1.0)
    table = np.array([contour.colour or white for contour in drawn])
    return Drawing(stand(points, settings.text("plane")), table[owner])


SHAPE = Shape(SECTION, any_count, draw)
