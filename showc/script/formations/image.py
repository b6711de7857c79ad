"""Image: places spread evenly over the bright parts of a picture, in its colours."""

from __future__ import annotations

from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np

from showc.script.formations.evenly import candidates_for, spread_evenly
from showc.script.formations.shape import (
    Drawing,
    FormationError,
    Request,
    Shape,
    any_count,
    centred,
    plane_field,
    stand,
)
from showc.script.kinds import Choice, Field, File, Quantity, Section

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.script.settings import Settings

    FloatArray = NDArray[np.float64]

MAX_PIXELS = 40_000_000
"""Largest picture that is read [pixels]."""

SECTION = Section(
    "image",
    "Places spread evenly over the parts of a picture that count, in the picture's "
    "colours.",
    (
        Field(
            "file",
            File((".png", ".jpg", ".jpeg", ".webp", ".gif", ".bmp")),
            "The picture.",
            required=True,
        ),
        Field(
            "height",
            Quantity("m", minimum=0.1, maximum=1000.0),
            "Height of the part that counts.",
            default=20.0,
        ),
        Field(
            "keep",
            Choice(("bright", "dark", "opaque")),
            "Which pixels count: those brighter than the threshold, those darker, or "
            "those that are not transparent. Transparent pixels never count.",
            default="bright",
        ),
        Field(
            "threshold",
            Quantity(minimum=0.0, maximum=1.0),
            "Brightness between dark and bright, 0 to 1.",
            default=0.5,
        ),
        plane_field("front"),
    ),
)


def pixels_of(content: bytes, name: str, side: int) -> FloatArray:
    """Return a picture's pixels, red, green, blue, alpha from 0 to 1, (h, w, 4).

    Raises
    ------
    FormationError
        If it is no picture, or too large.
    """
    from PIL import Image, UnidentifiedImageError  # noqa: PLC0415 - takes time

    try:
        with Image.open(BytesIO(content)) as picture:
            if picture.width * picture.height > MAX_PIXELS:
                raise FormationError(
                    "SHW110",
                    f"`{name}` has {picture.width} x {picture.height} pixels, at most "
                    f"{MAX_PIXELS} are read",
                    "file",
                )
            scale = side / max(picture.width, picture.height)
            size = (
                max(round(picture.width * scale), 1),
                max(round(picture.height * scale), 1),
            )
            method = Image.Resampling.BOX if scale < 1.0 else Image.Resampling.NEAREST
            small = picture.convert("RGBA").resize(size, method)
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError) as fault:
        raise FormationError(
            "SHW110", f"`{name}` is not a picture showc reads: {fault}", "file"
        ) from None
    return np.asarray(small, dtype=np.float64) / 255.0


def draw(settings: Settings, request: Request) -> Drawing:
    """Draw the picture's part that counts, centred, in its plane."""
    name = settings.text("file")
    content = request.read(name, "file")
    wanted = candidates_for(request.count)
    side = int(np.ceil(np.sqrt(wanted)))
    for _ in range(4):
        pixels = pixels_of(content, name, side)
        counts = _mask(pixels, settings)
        found = int(counts.sum())
        if found >= wanted or found == 0:
            break
        side = int(np.ceil(side * np.sqrt(wanted / found) * 1.05))
    if found < request.count:
        keep = settings.text("keep")
        raise FormationError(
            "SHW110",
            f"`{name}` has {found} pixels that count as {keep}",
            "keep",
            help_text="change `keep` or `threshold`",
        )
    row, column = np.nonzero(counts)
    flat = centred(np.column_stack([column, -row]).astype(np.float64))
    extent = float(np.ptp(flat[:, 1])) or 1.0
    flat *= settings.number("height") / extent
    chosen = spread_evenly(flat, request.count)
    colours = pixels[row[chosen], column[chosen], :3]
    if settings.text("keep") == "dark":
        colours = np.ones_like(colours)  # dark lamps would not be seen
    return Drawing(stand(flat[chosen], settings.text("plane")), colours)


def _mask(pixels: FloatArray, settings: Settings) -> NDArray[np.bool_]:
    """Return which pixels count, (h, w)."""
    opaque = pixels[..., 3] >= 0.5
    brightness = pixels[..., :3] @ np.array([0.2126, 0.7152, 0.0722])
    threshold = settings.number("threshold")
    match settings.text("keep"):
        case "bright":
            return np.asarray(opaque & (brightness >= threshold))
        case "dark":
            return np.asarray(opaque & (brightness < threshold))
        case _:
            return np.asarray(opaque)


SHAPE = Shape(SECTION, any_count, draw)
