"""The gallery: formations, motions and effects, drawn from the lines that make them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from io import BytesIO

import numpy as np
from PIL import Image, ImageDraw

from showc.preview.draft import Memory, lay_out, scene_of
from showc.script import read_show
from showc.script.formations import SHAPES

WIDTH, HEIGHT = 300, 190
"""Of a picture, in its own units."""
AZIMUTH, ELEVATION = 0.45, 0.35
"""Where the pictures are seen from [rad]: half from the side, a little from above."""
HEAD = """showc: 1
site: {volume: {min: [-60, -60, 0], max: [60, 60, 90]}}
landing: {assignment: optimal}
"""
TURNED = "motion: [{rotate: {angle: 120 deg, ramp: 1 s}}], hold: 10 s"


def heart():
    """Return a heart as an SVG path."""
    return b"""<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 90">
<path d="M50 88 C10 55 0 35 8 17 C18 -3 42 2 50 22
C58 2 82 -3 92 17 C100 35 90 55 50 88z"/>
</svg>"""


def sun():
    """Return a disc with rays as a PNG."""
    image = Image.new("RGB", (96, 96), "black")
    draw = ImageDraw.Draw(image)
    for number in range(8):
        angle = np.pi * number / 4.0
        end = [48 + 44 * np.cos(angle), 48 + 44 * np.sin(angle)]
        draw.line([48, 48, *end], fill=(255, 120, 20), width=7)
    draw.ellipse([26, 26, 70, 70], fill=(255, 220, 40))
    stream = BytesIO()
    image.save(stream, "PNG")
    return stream.getvalue()


def pyramid():
    """Return a pyramid as an OBJ model."""
    return b"""v -1 0 -1
v 1 0 -1
v 1 0 1
v -1 0 1
v 0 1.6 0
f 1 2 3 4
f 1 2 5
f 2 3 5
f 3 4 5
f 4 1 5
"""


def spiral():
    """Return a table of places and colours."""
    rows = ["x,y,z,red,green,blue"]
    for number in range(40):
        angle, radius = 2.4 * number, 2.4 * number**0.5
        x, z = radius * np.cos(angle), 28.0 + radius * np.sin(angle)
        rows.append(f"{x:.2f},0,{z:.2f},{60 + 4 * number},{250 - 5 * number},255")
    return "\n".join(rows).encode()


def dance():
    """Return the frames of twelve places that come from a ring into a lemniscate."""
    rows = ["time,place,x,y,z"]
    for frame in range(161):
        time = 0.125 * frame
        bend = 0.5 - 0.5 * np.cos(np.pi * min(time / 8.0, 1.0))
        for place in range(12):
            turn = 2.0 * np.pi * (place / 12.0 + time / 40.0)
            x = 20.0 * np.cos(turn)
            z = 24.0 + 10.0 * ((1.0 - bend) * np.sin(turn) + bend * np.sin(2.0 * turn))
            rows.append(
                f"{time:.3f},{place + 1},{x:.3f},{6 * bend * np.sin(turn):.3f},{z:.3f}"
            )
    return "\n".join(rows).encode()


FILES = {
    "dance.csv": dance(),
    "heart.svg": heart(),
    "sun.png": sun(),
    "pyramid.obj": pyramid(),
    "spiral.csv": spiral(),
}


@dataclass(frozen=True)
class Piece:
    """One entry."""

    name: str
    drones: int
    formation: str
    """What stands behind ``it:``."""
    transition: str = ""
    """What stands beside ``to: it``."""
    more: str = ""
    """Other formations that it needs, as lines."""

    @property
    def lines(self) -> str:
        """The part of the script that makes it."""
        text = f"formations:\n{self.more}  it: {self.formation}\n"
        if self.transition:
            text += f"transitions:\n  - {{to: it, {self.transition}}}\n"
        return text

    @property
    def script(self) -> str:
        """A whole script."""
        tail = "" if self.transition else "transitions: [it]\n"
        return f"{HEAD}drones: {self.drones}\n{self.lines}{tail}"


FORMATIONS = [
    Piece("circle", 24, "{type: circle, radius: 12, plane: front, colour: gold}"),
    Piece("line", 12, "{type: line, spacing: 3, colour: {gradient: [red, gold]}}"),
    Piece("grid", 48, "{type: grid, step: 3, plane: front, colour: deepskyblue}"),
    Piece("wave", 64, "{type: wave, step: 3, amplitude: 2, wavelength: 20}"),
    Piece(
        "helix", 48, "{type: helix, radius: 8, height: 24, turns: 3, colour: magenta}"
    ),
    Piece("sphere", 80, "{type: sphere, radius: 11, colour: aquamarine}"),
    Piece("cube", 56, "{type: cube, size: 16, colour: tomato}"),
    Piece(
        "points",
        4,
        "{type: points, points: [[-9, 0, 12], [9, 0, 12], [0, 9, 12], [0, 3, 26]]}",
    ),
    Piece("text", 70, '{type: text, text: "HELLO", height: 14, colour: white}'),
    Piece("svg", 60, "{type: svg, file: heart.svg, height: 30, colour: crimson}"),
    Piece("image", 120, "{type: image, file: sun.png, height: 30, spread: true}"),
    Piece("mesh", 90, "{type: mesh, file: pyramid.obj, size: 24, colour: gold}"),
    Piece("csv", 40, "{type: csv, file: spiral.csv}"),
    Piece(
        "parts",
        44,
        "{parts: [{type: circle, radius: 13, plane: front, centre: [0, 0, 24]}, "
        "{type: sphere, count: 20, radius: 5, centre: [0, 0, 24], colour: gold}]}",
    ),
    Piece(
        "transform",
        36,
        "{like: wall, transform: [{rotate: {angle: 40 deg, axis: x}}, "
        "{shift: [0, 0, 6]}]}",
        more="  wall: {type: grid, step: 3, plane: front, colour: dodgerblue}\n",
    ),
]
# A type that has no picture above gets one with its usual sizes.
FORMATIONS += [
    Piece(name, 40, f"{{type: {name}, spread: true}}")
    for name, shape in SHAPES.items()
    if not any(f"type: {name}" in piece.formation for piece in FORMATIONS)
    and not any(field.required for field in shape.section.fields)
]
RING = "{type: circle, radius: 11, plane: front, centre: [0, 0, 30], colour: gold}"
SQUARE = "{type: grid, step: 3, centre: [0, 0, 26], colour: aquamarine}"
MOTIONS = [
    Piece("rotate", 24, RING, "hold: 10, motion: [{rotate: {angle: 120, axis: z}}]"),
    Piece("breathe", 24, RING, "hold: 12, motion: [{breathe: 1.25}]"),
    Piece(
        "wave",
        49,
        SQUARE,
        "hold: 12, motion: [{wave: {amplitude: 2, period: 6, wavelength: 20}}]",
    ),
    Piece(
        "orbit",
        16,
        "{type: line, spacing: 4, centre: [0, 0, 26], colour: magenta}",
        "hold: 12, motion: [{orbit: {radius: 3, axis: y, period: 8, wavelength: 30}}]",
    ),
    Piece("travel", 24, RING, "hold: 14, motion: [{travel: [[14, 0, 0], [14, 0, 8]]}]"),
    Piece(
        "morph",
        24,
        RING,
        "hold: 20, motion: [{morph: [wide, tall]}]",
        more="  wide: {like: it, transform: [{scale: [1.4, 1, 0.6]}]}\n"
        "  tall: {like: it, transform: [{scale: [0.6, 1, 1.4]}]}\n",
    ),
    Piece(
        "follow",
        12,
        "{type: frames, file: dance.csv, colour: orchid}",
        "motion: [{follow: dance.csv}]",
    ),
    Piece(
        "several motions",
        36,
        SQUARE.replace("aquamarine", "tomato"),
        "hold: 20, motion: [{rotate: 90}, {wave: {amplitude: 1.5, wavelength: 30}}]",
    ),
]
WALL = "type: grid, step: 3, plane: front"
EFFECTS = [
    Piece("pulse", 48, f"{{{WALL}, colour: gold}}", "effect: pulse"),
    Piece(
        "sweep",
        48,
        f"{{{WALL}, colour: deepskyblue}}",
        "effect: {kind: sweep, wavelength: 20}",
    ),
    Piece("rainbow", 48, f"{{{WALL}}}", "effect: {kind: rainbow, wavelength: 24}"),
    Piece("strobe", 48, f"{{{WALL}, colour: white}}", "effect: {kind: strobe}"),
    Piece("twinkle", 48, f"{{{WALL}, colour: white}}", "effect: {kind: twinkle}"),
    Piece(
        "run",
        48,
        f"{{{WALL}}}",
        "effect: {kind: run, colours: [deepskyblue, white, magenta], wavelength: 24}",
    ),
    Piece(
        "moments",
        48,
        f"{{{WALL}, colour: white}}",
        "lights: [{after: 1, colour: red}, {after: 1.6, colour: {gradient: [gold, "
        "blue], along: x}, fade: end}]",
    ),
]
GROUPS = {"Formations": FORMATIONS, "Motions": MOTIONS, "Lights": EFFECTS}
INTRODUCTION = """# Gallery

Formations, motions and lights, each with the lines that make it. `showc` draws the
pictures from its own places and colours, seen from the front left and a little from
above. Drones at the back are darker. Motions are drawn with the drones' paths, effects
at six moments within two seconds, row by row. Files such as `heart.svg` stand for
yours.

[Show scripts](script.md) explains every key. `showc preview` shows your script while
you write it.
"""


@cache
def drawn(piece: Piece):
    """Return the draft and the scene of a piece."""
    result = read_show(piece.script.encode(), attached=FILES)
    if result.show is None:
        raise ValueError([item.message for item in result.errors])
    draft = lay_out(result.show, Memory())
    return draft, scene_of(draft, Memory())


def held(piece: Piece) -> tuple[float, float]:
    """Return when the formation begins to be held, and how long it is [s]."""
    draft, _ = drawn(piece)
    number = next(
        k
        for k, leg in enumerate(draft.itinerary.legs)
        if leg.kind in {"hold", "motion"} and leg.transition is not None
    )
    return draft.starts[number], draft.durations[number]


def seen(points: np.ndarray) -> np.ndarray:
    """Return places (..., 3) [m] as they are seen, x to the right and y down."""
    x, y, z = np.moveaxis(points, -1, 0)
    across = np.cos(AZIMUTH) * x - np.sin(AZIMUTH) * y
    deep = np.sin(AZIMUTH) * x + np.cos(AZIMUTH) * y
    return np.stack(
        [across, -(np.cos(ELEVATION) * z + np.sin(ELEVATION) * deep)], axis=-1
    )


def depth(points: np.ndarray) -> np.ndarray:
    """Return how far places (n, 3) [m] lie behind the origin, as they are seen [m]."""
    return np.sin(AZIMUTH) * points[:, 0] + np.cos(AZIMUTH) * points[:, 1]


def shade(points: np.ndarray) -> np.ndarray:
    """Return the brightness of places: what stands up straight is all bright."""
    behind = points[:, 1] - points[:, 1].min()
    return 1.0 - 0.6 * behind / max(behind.max(), 6.0)


def fitted(points: np.ndarray, width: float, height: float) -> np.ndarray:
    """Return seen places in the middle of a picture, as large as it lets them be."""
    flat = points.reshape(-1, 2)
    low, high = flat.min(axis=0), flat.max(axis=0)
    room = 14.0
    scale = min(
        (width - 2 * room) / max(high[0] - low[0], 1.0),
        (height - 2 * room) / max(high[1] - low[1], 1.0),
        9.0,
    )
    return (points - 0.5 * (low + high)) * scale + np.array([width, height]) / 2.0


def picture(piece: Piece) -> str:
    """Return the picture of a piece as SVG."""
    _, scene = drawn(piece)
    start, duration = held(piece)
    first = int(np.ceil(start / scene.step)) + 1
    last = int((start + duration) / scene.step) - 1
    body = ""
    if piece in EFFECTS:
        rows = first + np.round(np.arange(6) / 3.0 / scene.step + 0.6 / scene.step)
        body = frames(scene, rows.astype(int))
    elif piece in MOTIONS:
        rows = np.linspace(first, last, 33).astype(int)
        places = fitted(seen(scene.positions[rows]), WIDTH, HEIGHT)
        ways = (
            "".join(f"{'ML'[k > 0]}{x:.1f} {y:.1f}" for k, (x, y) in enumerate(way))
            for way in np.moveaxis(places, 1, 0)
        )
        body = f'<path d="{"".join(ways)}" class="way"/>'
        body += lights(places[0], 0.35 * scene.colours[rows[0]])
        body += lights(places[20], scene.colours[rows[0]])
    else:
        points = scene.positions[first]
        order = np.argsort(-depth(points), kind="stable")
        places = fitted(seen(points), WIDTH, HEIGHT)
        colours = scene.colours[first] * shade(points)[:, None]
        body = lights(places[order], colours[order])
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" '
        f'width="{WIDTH}" height="{HEIGHT}"><style>.way{{fill:none;stroke:#7db4ff;'
        "stroke-width:.7;stroke-opacity:.45}</style>"
        f'<rect width="{WIDTH}" height="{HEIGHT}" rx="8" fill="#070b14"/>{body}</svg>\n'
    )


def frames(scene, rows) -> str:
    """Return six moments beside and below each other."""
    width, height = WIDTH / 3.0, HEIGHT / 2.0
    parts = []
    for number, row in enumerate(rows):
        places = fitted(seen(scene.positions[row]), width, height)
        shift = np.array([width * (number % 3), height * (number // 3)])
        parts.append(lights(places + shift, scene.colours[row], size=1.6))
    return "".join(parts)


def lights(places: np.ndarray, colours: np.ndarray, size: float = 2.4) -> str:
    """Return drones as dots, dark ones grey."""
    parts: dict[str, list[str]] = {}
    for (x, y), colour in zip(places, colours, strict=True):
        shown = np.maximum(np.round(colour / 8.0) * 8.0, 40.0).astype(int).clip(0, 255)
        key = "#" + "".join(f"{value:02x}" for value in shown)
        parts.setdefault(key, []).append(f"M{x:.1f} {y:.1f}h0")
    return "".join(
        f'<path d="{"".join(dots)}" stroke="{key}" stroke-width="{2 * size:g}" '
        'stroke-linecap="round"/>'
        for key, dots in parts.items()
    )


def file_of(group: str, piece: Piece) -> str:
    """Return the name of a picture."""
    return f"gallery/{group.lower()}-{piece.name.replace(' ', '-')}.svg"


TITLES = {"svg": "SVG drawing", "csv": "CSV table", "moments": "Lights at moments"}


def page() -> str:
    """Return the gallery as Markdown."""
    parts = [INTRODUCTION]
    for group, pieces in GROUPS.items():
        parts.append(f"## {group}\n")
        parts += [
            f"### {TITLES.get(piece.name, piece.name.capitalize())}\n\n"
            f"![{piece.name}: {piece.drones} drones]({file_of(group, piece)})\n\n"
            f"```yaml\ndrones: {piece.drones}\n{piece.lines}```\n"
            for piece in pieces
        ]
    return "\n".join(parts)
