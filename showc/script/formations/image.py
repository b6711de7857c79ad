"""Image: places spread evenly over the bright parts of a picture, in its colours."""

from __future__ import annotations

import warnings
from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np

from showc.script.diagnostic import ScriptError
from showc.script.formations.evenly import candidates_for, spread_evenly
from showc.script.formations.shape import (
    Drawing,
    Request,
    Shape,
    any_count,
    centred,
    plane_field,
    stand,
)
from showc.script.language.kinds import Choice, Field, File, Quantity, Section

if TYPE_CHECKING:
    from PIL.Image import Image

    from showc.arrays import BoolArray, FloatArray
    from showc.script.language.settings import Settings


MAX_PIXELS = 16_000_000
"""Largest picture that is decoded [pixels]: four bytes each, and a copy at times.
JPEG pictures are decoded at a half, a quarter or an eighth of their size."""
_LARGEST_SIDE = 1500
"""Side of the raster that places are chosen from [pixels], however little of it
counts."""
_FORMATS = ("PNG", "JPEG", "WEBP", "GIF", "BMP")

SECTION = Section(
    "image",
    "Places spread evenly over the bright, dark or opaque parts of an image, in the "
    "image's colours.",
    (
        Field(
            "file",
            File((".png", ".jpg", ".jpeg", ".webp", ".gif", ".bmp")),
            "The image.",
            required=True,
        ),
        Field(
            "height",
            Quantity("m", minimum=0.1, maximum=1000.0),
            "Height of these parts.",
            default=20.0,
        ),
        Field(
            "keep",
            Choice(("bright", "dark", "opaque")),
            "Which pixels to use: those brighter than the threshold, those darker, or "
            "all that are not transparent. Transparent pixels are never used.",
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


def picture_of(content: bytes, name: str) -> Image:
    """Decode a picture, judged by its head first.

    Returns
    -------
    Image
        Its first frame.

    Raises
    ------
    ScriptError
        If it is no picture, damaged or too large.
    """
    from PIL import Image  # noqa: PLC0415 - takes time

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            opened = Image.open(BytesIO(content), formats=_FORMATS)
        opened.draft("RGB", (_LARGEST_SIDE, _LARGEST_SIDE))
        pixels = opened.width * opened.height
        if pixels <= MAX_PIXELS:
            opened.load()
            as_it_is = opened.mode in {"RGB", "RGBA", "L"}
            return opened if as_it_is else opened.convert("RGBA")
    except Image.DecompressionBombError:
        pixels = 0
    except Exception:  # noqa: BLE001 - decoders of pictures raise anything
        raise ScriptError(
            "SHW110",
            f"`{name}` is not an image that showc reads, or it is damaged",
            key="file",
            help_text=f"formats: {', '.join(_FORMATS)}",
        ) from None
    size = f"{pixels} pixels" if pixels else "hundreds of millions of pixels"
    raise ScriptError(
        "SHW119", f"`{name}` has {size}; at most {MAX_PIXELS} are read", key="file"
    )


def pixels_of(picture: Image, side: int) -> FloatArray:
    """Return a picture's pixels, red, green, blue, alpha from 0 to 1, (h, w, 4).

    Parameters
    ----------
    picture
        What :func:`picture_of` returned.
    side
        Pixels along the longer side.
    """
    scale = side / max(picture.width, picture.height)
    size = (
        max(round(picture.width * scale), 1),
        max(round(picture.height * scale), 1),
    )
    # Values of Pillow's Resampling.BOX and NEAREST.
    small = picture.resize(size, 4 if scale < 1.0 else 0).convert("RGBA")
    return np.asarray(small, dtype=np.float64) / 255.0


def draw(settings: Settings, request: Request) -> Drawing:
    """Draw the picture's part that counts, centred, in its plane."""
    name = settings.text("file")
    picture = picture_of(request.read(name, "file"), name)
    wanted = candidates_for(request.count)
    side = int(np.ceil(np.sqrt(wanted)))
    for _ in range(4):
        side = min(side, _LARGEST_SIDE)
        pixels = pixels_of(picture, side)
        counts = _mask(pixels, settings)
        found = int(counts.sum())
        if found >= wanted or found == 0:
            break
        side = int(np.ceil(side * np.sqrt(wanted / found) * 1.05))
    if found < request.count:
        keep = settings.text("keep")
        raise ScriptError(
            "SHW110",
            f"`{name}` has {found} pixels that count as {keep}",
            key="keep",
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


def _mask(pixels: FloatArray, settings: Settings) -> BoolArray:
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
