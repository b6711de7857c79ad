"""SVG: an outline from a vector drawing, followed or filled with places."""

from __future__ import annotations

from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.script.diagnostic import ScriptError
from showc.script.formations.contours import Contour, fill, fitted, follow
from showc.script.formations.shape import (
    Drawing,
    Request,
    Shape,
    any_count,
    plane_field,
    stand,
)
from showc.script.language.kinds import Choice, Field, File, Quantity, Section

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.script.language.settings import Settings

_CURVE_PIECES = 24
"""Straight pieces of a curve: a circle's quarter is missed by 0.0005 of its radius."""
_DARK = 0.05
"""Level of all three colours up to which a stroke is black and has no light, 0 to 1."""
_FARTHEST = 1e9
"""Farthest coordinate of a point, in the drawing's units."""
_FLAT = 1e-12
"""Area of a square that a `transform` makes a line of, over what rounding leaves."""
MAX_ELEMENTS = 20_000
"""Elements of a drawing, copies by ``use`` written out."""
MAX_DEPTH = 60
"""Deepest nesting of elements, copies by ``use`` written out."""
MAX_COPIES = 3000
"""Copies by ``use``."""
MAX_CHANGES = 4_000_000
"""Characters of ``transform``, those of all elements around an element included."""

SECTION = Section(
    "svg",
    "Places along the curves of an SVG drawing, or inside them, in the drawing's "
    "colours.",
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
            "Where places lie: along the curves, or inside closed ones.",
            default="outline",
        ),
        plane_field("front"),
    ),
)


def contours_of(content: bytes, name: str) -> list[Contour]:
    """Return the curves of a drawing, y upwards, in the drawing's units.

    Raises
    ------
    ScriptError
        If it is not SVG, or has no curves.
    """
    import svgelements  # noqa: PLC0415 - takes time

    judge(content, name)
    try:
        drawing = svgelements.SVG.parse(BytesIO(_set_apart(content)), reify=True)
        contours = _contours(drawing)
    except ScriptError:
        raise
    except Exception:  # noqa: BLE001 - damaged drawings end in anything
        raise ScriptError(
            "SHW110", f"`{name}` is not SVG, or it is damaged", key="file"
        ) from None
    if not contours:
        raise ScriptError(
            "SHW110",
            f"`{name}` has no curves",
            key="file",
            help_text="convert texts and bitmaps of the drawing to paths first",
        )
    return contours


def _contours(drawing: Any) -> list[Contour]:  # noqa: ANN401 - a library without types
    """Return the curves of a drawing that was read."""
    import svgelements  # noqa: PLC0415 - takes time

    contours = []
    for element in drawing.elements():
        if not isinstance(element, svgelements.Shape):
            continue
        if not _rendered(element):
            continue
        colour = _colour(element)
        for part in svgelements.Path(element).as_subpaths():
            points = _flatten(svgelements.Path(part))
            if not np.all(np.abs(points) <= _FARTHEST):
                raise ScriptError(
                    "SHW110",
                    "the drawing has a point that is not a number, or is too far away",
                    key="file",
                )
            if len(points) > 1 and float(np.ptp(points, axis=0).max()) > 0.0:
                contours.append(Contour(points * [1.0, -1.0], colour))
    return contours


def _set_apart(content: bytes) -> bytes:
    """Return a drawing in which what is never drawn by itself stands in ``defs``.

    Masks, markers and symbols are drawn by what refers to them, if at all.
    """
    from xml.etree.ElementTree import (  # noqa: PLC0415 - takes time
        Element,
        fromstring,
        tostring,
    )

    root = fromstring(content)  # noqa: S314 - judged before
    found = [
        (parent, place, child)
        for parent in root.iter()
        for place, child in enumerate(parent)
        if child.tag.rpartition("}")[2] in {"mask", "marker", "symbol"}
    ]
    for parent, place, child in found:
        space, mark, _ = child.tag.rpartition("}")
        parent[place] = Element(f"{space}{mark}defs")
        parent[place].append(child)
    return tostring(root) if found else content


def _rendered(element: Any) -> bool:  # noqa: ANN401 - of a library without types
    """Tell whether a shape is drawn: it may be hidden, or have no size."""
    import svgelements  # noqa: PLC0415 - takes time

    if str(element.values.get("visibility", "")) in {"hidden", "collapse"}:
        return False
    own = element.values.get("attributes", {})
    # Negative sizes are an error, with which a shape is left out.
    if any(str(own.get(key, "")).strip()[:1] == "-" for key in _sizes(element)):
        return False
    change = svgelements.Matrix(element.values.get("transform", ""))
    across = change.a * change.d - change.b * change.c
    square = change.a**2 + change.b**2 + change.c**2 + change.d**2
    return bool(abs(across) > _FLAT * square)


def _sizes(element: Any) -> tuple[str, ...]:  # noqa: ANN401
    """Return the keys of a shape's sizes."""
    import svgelements  # noqa: PLC0415 - takes time

    match element:
        case svgelements.Rect():
            return "width", "height"
        case svgelements.Circle():
            return ("r",)
        case svgelements.Ellipse():
            return "rx", "ry"
        case _:
            return ()


def judge(content: bytes, name: str) -> None:
    """Refuse a drawing that is small in the file and large once it is read.

    Elements are counted without building anything, and those that ``use`` copies as
    often as they are copied.

    Raises
    ------
    ScriptError
        If it is no XML, nested too deep, has too many elements, or copies itself.
    """
    from xml.etree.ElementTree import ParseError  # noqa: PLC0415 - takes time

    try:
        outline = _Outline.of(content)
    except (ParseError, ValueError, LookupError) as fault:
        line = getattr(fault, "position", (0, 0))[0]
        where = f", line {line}" if line else ""
        raise ScriptError(
            "SHW110", f"`{name}`{where}: the file is not XML", key="file"
        ) from None
    size, depth = outline.measured()
    if depth >= _ENDLESS:
        found = "has a `use` that copies itself"
    elif depth > MAX_DEPTH:
        found = f"is nested more than {MAX_DEPTH} deep"
    elif size > MAX_ELEMENTS:
        found = f"has more than {MAX_ELEMENTS} elements"
    elif outline.copies > MAX_COPIES:
        found = f"has {outline.copies} copies by `use`; at most {MAX_COPIES} are read"
    elif outline.changes > MAX_CHANGES:
        found = f"has more than {MAX_CHANGES} characters of `transform`"
    else:
        return
    raise ScriptError(
        "SHW119",
        f"`{name}` {found}, copies and what is inherited counted",
        key="file",
        help_text="convert the drawing to plain paths",
    )


_ENDLESS = 10**9
"""Depth of what copies itself."""


class _Outline:
    """What a drawing consists of: elements, nested, some of them copies of others."""

    def __init__(self) -> None:
        self.children: list[list[int]] = []
        """Elements directly within each element, by number."""
        self.copied: dict[int, str] = {}
        """Name of what an element copies."""
        self.names: dict[str, int] = {}
        """The first element of a name."""
        self.copies = 0
        """Number of elements that copy others."""
        self.changes = 0
        """Characters of changes of place that must be read, inherited ones too."""

    @classmethod
    def of(cls, content: bytes) -> _Outline:
        """Read the elements; ends early where there are too many of them."""
        from xml.etree.ElementTree import iterparse  # noqa: PLC0415 - takes time

        outline = cls()
        open_: list[int] = []
        changes: list[int] = [0]
        for event, element in iterparse(BytesIO(content), events=("start", "end")):  # noqa: S314 - expat bounds how much entities may grow
            if event == "end":
                open_.pop()
                changes.pop()
                element.clear()
                continue
            number = len(outline.children)
            outline.children.append([])
            if open_:
                outline.children[open_[-1]].append(number)
            open_.append(number)
            attributes = element.attrib
            changes.append(changes[-1] + len(attributes.get("transform", "")))
            outline.changes += changes[-1]
            if "id" in attributes:
                outline.names.setdefault(attributes["id"], number)
            if element.tag.rpartition("}")[2] == "use":
                target = attributes.get("href") or attributes.get(_LINK, "")
                outline.copied[number] = target.lstrip("#")
                outline.copies += 1
            if (
                number > MAX_ELEMENTS
                or len(open_) > MAX_DEPTH
                or outline.changes > MAX_CHANGES
            ):
                break
        return outline

    def measured(self) -> tuple[int, int]:
        """Return how many elements there are, written out, and how deep they nest."""
        known: dict[int, tuple[int, int]] = {}
        begun: set[int] = set()
        stack = [0]
        while stack:
            number = stack[-1]
            if number in known:
                stack.pop()
                continue
            within = list(self.children[number])
            target = self.names.get(self.copied.get(number, ""))
            if target is not None:
                within.append(target)
            missing = [other for other in within if other not in known]
            if missing and number in begun:
                return len(self.children), _ENDLESS
            if missing:
                begun.add(number)
                stack += missing
                continue
            sizes = [known[other] for other in within]
            known[number] = (
                1 + sum(size for size, _ in sizes),
                1 + max((depth for _, depth in sizes), default=0),
            )
            stack.pop()
        return known[0]


_LINK = "{http://www.w3.org/1999/xlink}href"


def _flatten(path: object) -> FloatArray:
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
