"""Text: letters of a real font, written, outlined or filled with places."""

from __future__ import annotations

import itertools
import unicodedata
from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np

from showc.script.diagnostic import ScriptError
from showc.script.formations.centreline import centreline
from showc.script.formations.contours import Contour, fill, fitted, follow
from showc.script.formations.shape import (
    Drawing,
    Request,
    Shape,
    any_count,
    plane_field,
    stand,
)
from showc.script.language.kinds import (
    Choice,
    Either,
    Field,
    File,
    Quantity,
    Section,
    Text,
)

if TYPE_CHECKING:
    from fontTools.ttLib import TTFont

    from showc.script.language.settings import Settings

BUNDLED = {"regular": "Vera.ttf", "bold": "VeraBd.ttf"}
"""Fonts that come with showc (Bitstream Vera)."""
_CURVE_PIECES = 8
"""Straight pieces of a curve: letters have many short ones."""
_COMPOSED = 10
"""How deep a letter may be composed of others that are composed themselves."""
_LARGEST_LETTER = 1000
"""Letters that one letter may be composed of."""
_NAMED = 8
"""Letters that a message names at most."""
_FARTHEST = 1e6
"""Farthest point of a letter, in the font's units, of which a letter has thousands."""

SECTION = Section(
    "text",
    "Text, with places along its strokes, along its outline, or inside it.",
    (
        Field(
            "text",
            Text(100, lines=True),
            "The text. `\\n` in double quotes begins a new line.",
            required=True,
            examples=("HI", "2025"),
        ),
        Field(
            "height",
            Quantity("m", minimum=0.1, maximum=1000.0),
            "Height of the text. A centreline lies half a stroke inside it, so places "
            "on it span a little less.",
            default=12.0,
        ),
        Field(
            "font",
            Either((Choice(tuple(BUNDLED)), File((".ttf", ".otf")))),
            "`regular` or `bold` (Bitstream Vera), or a font file beside the script.",
            default="regular",
        ),
        Field(
            "draw",
            Choice(("centreline", "outline", "inside")),
            "Where places lie: along the middle of the strokes, as a pen would write; "
            "along the outline of the letters; or all over their inside.",
            default="centreline",
        ),
        plane_field("front"),
    ),
)


def _font(settings: Settings, request: Request) -> TTFont:
    from fontTools.ttLib import TTFont  # noqa: PLC0415 - takes time

    name = settings.text("font")
    if name in BUNDLED:
        from importlib.resources import files  # noqa: PLC0415 - takes time

        folder = files("showc.script.formations") / "fonts"
        content = (folder / BUNDLED[name]).read_bytes()
    else:
        content = request.read(name, "font")
    try:
        font = TTFont(BytesIO(content), fontNumber=0, lazy=True)
        font.getGlyphSet()
    except Exception:  # noqa: BLE001 - damaged fonts end in anything
        raise _damaged(name) from None
    return font


def _damaged(name: str) -> ScriptError:
    return ScriptError(
        "SHW110",
        f"`{name}` is damaged, or not a font that showc reads",
        key="font",
    )


def outlines(font: TTFont, text: str, name: str) -> list[Contour]:
    """Return the outlines of a text, as :func:`letters` does, from any font.

    Raises
    ------
    ScriptError
        If the font lacks a letter, is damaged, or its letters are too large.
    """
    try:
        _judge(font, text)
        contours = letters(font, text)
    except ScriptError:
        raise
    except Exception:  # noqa: BLE001 - damaged fonts end in anything
        raise _damaged(name) from None
    if not all(np.all(np.abs(item.points) <= _FARTHEST) for item in contours):
        raise _damaged(name)
    return contours


def _judge(font: TTFont, text: str) -> None:
    """Refuse letters composed of more others than can be drawn in time."""
    if "glyf" not in font:
        return
    glyphs, names = font["glyf"], font.getBestCmap()
    known: dict[str, int] = {}

    def size(glyph: str, depth: int) -> int:
        if depth > _COMPOSED:
            return _LARGEST_LETTER + 1
        if glyph not in known:
            item = glyphs[glyph]
            parts = item.components if item.isComposite() else []
            known[glyph] = 1 + sum(size(part.glyphName, depth + 1) for part in parts)
        return known[glyph]

    for sign in set(text) - {"\n"}:
        if ord(sign) in names and size(names[ord(sign)], 0) > _LARGEST_LETTER:
            raise ScriptError(
                "SHW119",
                f"a letter of the font is composed of more than {_LARGEST_LETTER} "
                f"others, or more than {_COMPOSED} deep",
                key="font",
            )


def letters(font: TTFont, text: str) -> list[Contour]:
    """Return the outlines of a text in the font's own units.

    Lines are centred under each other; kerning is left out.

    Raises
    ------
    ScriptError
        If the font lacks a letter.
    """
    from fontTools.pens.recordingPen import (  # noqa: PLC0415 - takes time
        DecomposingRecordingPen,
    )

    glyphs, names = font.getGlyphSet(), font.getBestCmap()
    missing = sorted({sign for sign in text if sign != "\n" and ord(sign) not in names})
    if missing:
        named = ", ".join(map(_shown, missing[:_NAMED]))
        more = f" and {len(missing) - _NAMED} more" if len(missing) > _NAMED else ""
        raise ScriptError(
            "SHW110",
            f"the font has no {named}{more}",
            key="text",
            help_text="write `font:` with a font file that has it",
        )
    head, metrics = font["head"], font["hhea"]
    line_height = (metrics.ascent - metrics.descent + metrics.lineGap) or (
        1.2 * head.unitsPerEm
    )
    contours = []
    for row, line in enumerate(text.split("\n")):
        signs = [glyphs[names[ord(sign)]] for sign in line]
        width = float(sum(sign.width for sign in signs))
        pen_x = -width / 2.0
        for sign in signs:
            pen = DecomposingRecordingPen(glyphs)
            sign.draw(pen)
            shift = np.array([pen_x, -row * line_height])
            contours += [
                Contour(points + shift) for points in _flatten(pen.value) if len(points)
            ]
            pen_x += sign.width
    return contours


def _flatten(  # noqa: C901 - one case a verb of the pen
    record: list[tuple[str, tuple[object, ...]]],
) -> list[np.ndarray]:
    """Turn a recorded outline into chains of points, curves cut into pieces."""
    from fontTools.pens.basePen import (  # noqa: PLC0415 - takes time
        decomposeQuadraticSegment,
        decomposeSuperBezierSegment,
    )

    chains: list[list[np.ndarray]] = []
    for verb, arguments in record:
        points = [
            np.array(point, dtype=np.float64)
            for point in arguments
            if isinstance(point, tuple)
        ]
        if verb == "moveTo":
            chains.append([points[0]])
        elif verb == "lineTo":
            chains[-1].append(points[0])
        elif verb == "qCurveTo" and arguments[-1] is None:
            # A closed curve without a single corner: begin between two controls.
            start = (points[-1] + points[0]) / 2.0
            chains.append([start])
            for control, end in decomposeQuadraticSegment([*points, start]):
                _bend(chains[-1], [np.array(control), np.array(end)])
        elif verb == "qCurveTo":
            for control, end in decomposeQuadraticSegment(points):
                _bend(chains[-1], [np.array(control), np.array(end)])
        elif verb == "curveTo":
            for curve in decomposeSuperBezierSegment(points):
                _bend(chains[-1], [np.array(point) for point in curve])
        elif verb == "closePath" and chains:
            chains[-1].append(chains[-1][0])
    return [np.array(chain) for chain in chains if len(chain) > 2]


def _shown(sign: str) -> str:
    """Show a letter; by its number where it shows nothing by itself."""
    alone = sign.isprintable() and not unicodedata.combining(sign)
    return f"`{sign}`" if alone else f"U+{ord(sign):04X}"


def _bend(chain: list[np.ndarray], points: list[np.ndarray]) -> None:
    """Add a Bézier curve from the chain's end as short pieces (de Casteljau)."""
    start = chain[-1]
    for step in range(1, _CURVE_PIECES + 1):
        share = step / _CURVE_PIECES
        level = [start, *points]
        while len(level) > 1:
            level = [
                first + share * (second - first)
                for first, second in itertools.pairwise(level)
            ]
        chain.append(level[0])


def _text(settings: Settings) -> str:
    """Return the text with letters and their accents composed, as fonts have them."""
    return unicodedata.normalize("NFC", settings.text("text"))


def draw(settings: Settings, request: Request) -> Drawing:
    """Draw the text, centred, in its plane."""
    name = settings.text("font")
    contours = outlines(_font(settings, request), _text(settings), name)
    if not contours:
        raise ScriptError("SHW104", "the text has no visible letters", key="text")
    drawn = fitted(contours, settings.number("height"), axis=1)
    match settings.text("draw"):
        case "centreline":
            points = centreline(drawn, request.count)
        case "outline":
            points, _ = follow(drawn, request.count)
        case _:
            points, _ = fill(drawn, request.count)
    return Drawing(stand(points, settings.text("plane")))


SHAPE = Shape(SECTION, any_count, draw)
