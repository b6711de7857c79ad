"""Small sound inputs of every kind, from which mutations begin."""

import base64
import io
import json
import math
import struct
from importlib.resources import files

import numpy as np
from PIL import Image


def _corners(rings=6, sides=8):
    for ring in range(rings + 1):
        for side in range(sides):
            polar, angle = math.pi * ring / rings, math.tau * side / sides
            yield (
                math.sin(polar) * math.cos(angle),
                math.sin(polar) * math.sin(angle),
                math.cos(polar),
            )


def _faces(rings=6, sides=8):
    for ring in range(rings):
        for side in range(sides):
            here, beside = ring * sides + side, ring * sides + (side + 1) % sides
            yield here, beside, beside + sides
            yield here, beside + sides, here + sides


CORNERS, FACES = list(_corners()), list(_faces())


def csv():
    """Places with colours, and a comment."""
    rows = [f"{3 * n},{n % 2},{10 + n},{n},200,{255 - n}" for n in range(12)]
    return "\n".join(["# places", "x,y,z,red,green,blue", *rows]).encode()


def svg():
    """Shapes of several kinds, groups, copies, styles and a transform."""
    return b"""<?xml version="1.0"?>
<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"
 width="100" height="80mm" viewBox="0 0 100 80">
<style>.a { fill: #ff8800; stroke: none } #b { stroke: rgb(10, 20, 30) }</style>
<defs><g id="leaf"><path d="M0 0 C 5 5 10 5 15 0 S 25 -5 30 0 Q 35 5 40 0 T 50 0"/></g>
</defs>
<g transform="translate(10 20) rotate(30) scale(1.5, 0.5)" id="b">
<rect class="a" x="1" y="2" width="30" height="20" rx="3"/>
<circle cx="50" cy="40" r="12" style="fill:red;stroke-width:2"/>
<ellipse cx="20" cy="60" rx="12" ry="6"/>
<polygon points="10,10 20,10 15,20"/><polyline points="60 10 70 10 65 20"/>
<line x1="0" y1="0" x2="9" y2="9"/>
<path d="M 10 10 h 5 v 5 l -3 -3 A 5 8 30 1 0 30 30 z m 20 20 L 40 40 40 50 Z"/>
<use xlink:href="#leaf" x="3" y="4"/><use href="#leaf"/>
</g></svg>"""


def obj():
    """A ball of triangles."""
    lines = [f"v {x:.4f} {y:.4f} {z:.4f}" for x, y, z in CORNERS]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in FACES]
    return ("# ball\no ball\n" + "\n".join(lines) + "\n").encode()


def off():
    """The same."""
    lines = [f"{x:.4f} {y:.4f} {z:.4f}" for x, y, z in CORNERS]
    lines += [f"3 {a} {b} {c}" for a, b, c in FACES]
    return f"OFF\n{len(CORNERS)} {len(FACES)} 0\n".encode() + "\n".join(lines).encode()


def ply():
    """The same, its numbers binary."""
    head = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(CORNERS)}\nproperty float x\nproperty float y\n"
        f"property float z\nelement face {len(FACES)}\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    body = np.array(CORNERS, dtype="<f4").tobytes()
    return (
        head.encode() + body + b"".join(struct.pack("<Biii", 3, *row) for row in FACES)
    )


def stl():
    """The same, binary."""
    body = b"".join(
        struct.pack("<12fH", 0, 0, 1, *(v for n in face for v in CORNERS[n]), 0)
        for face in FACES
    )
    return b"ball".ljust(80) + struct.pack("<I", len(FACES)) + body


def stl_text():
    """A few facets as text."""
    facets = [
        "facet normal 0 0 1\nouter loop\n"
        + "".join("vertex {} {} {}\n".format(*CORNERS[n]) for n in face)
        + "endloop\nendfacet\n"
        for face in FACES[:20]
    ]
    return ("solid ball\n" + "".join(facets) + "endsolid ball\n").encode()


def _scene(length, uri=None):
    where = {"byteLength": length} | ({"uri": uri} if uri else {})
    faces = 2 * 3 * len(FACES)
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "children": [1]}, {"mesh": 0, "translation": [3, 0, 0]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 1}, "indices": 0}]}],
        "buffers": [where],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": faces},
            {"buffer": 0, "byteOffset": faces, "byteLength": 12 * len(CORNERS)},
        ],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": 5123,
                "count": 3 * len(FACES),
                "type": "SCALAR",
            },
            {
                "bufferView": 1,
                "componentType": 5126,
                "count": len(CORNERS),
                "type": "VEC3",
                "min": [-1, -1, -1],
                "max": [1, 1, 1],
            },
        ],
    }


def glb():
    """The same ball twice, as a binary scene."""
    body = np.array(FACES, dtype="<u2").tobytes() + np.array(CORNERS, "<f4").tobytes()
    body += b"\0" * (-len(body) % 4)
    text = json.dumps(_scene(len(body))).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(body), b"BIN\0") + body
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def picture(form):
    """A bright disc on black, 48 pixels wide."""
    y, x = np.mgrid[-1:1:48j, -1:1:48j]
    disc = (x * x + y * y < 0.7).astype(np.uint8)
    pixels = np.stack([disc * 255, disc * 200, disc * 90], axis=-1)
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, form)
    return stream.getvalue()


def font():
    """The font that comes with showc."""
    folder = files("showc.script.formations") / "fonts"
    return (folder / "Vera.ttf").read_bytes()


def dance():
    """Three places at six moments."""
    rows = [
        f"{0.5 * frame},{place + 1},{6 * place + 0.1 * frame},{0.2 * frame},18"
        for frame in range(6)
        for place in range(3)
    ]
    return "\n".join(["time,place,x,y,z", *rows]).encode()


def animated():
    """A scene with one node that moves."""
    body = struct.pack("<4f", *range(4)) + struct.pack("<12f", *range(12))
    content = base64.b64encode(body).decode()
    scene = {
        "asset": {"version": "2.0"},
        "nodes": [{"name": "one"}],
        "buffers": [
            {"byteLength": 64, "uri": f"data:application/octet-stream;base64,{content}"}
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 16},
            {"buffer": 0, "byteOffset": 16, "byteLength": 48},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "SCALAR"},
            {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC3"},
        ],
        "animations": [
            {
                "samplers": [{"input": 0, "output": 1}],
                "channels": [
                    {"sampler": 0, "target": {"node": 0, "path": "translation"}}
                ],
            }
        ],
    }
    return json.dumps(scene).encode()


FILES = {
    "places.csv": csv,
    "dance.csv": dance,
    "dance.gltf": animated,
    "drawing.svg": svg,
    "ball.obj": obj,
    "ball.off": off,
    "ball.ply": ply,
    "ball.stl": stl,
    "text.stl": stl_text,
    "ball.glb": glb,
    "disc.png": lambda: picture("PNG"),
    "disc.jpg": lambda: picture("JPEG"),
    "disc.gif": lambda: picture("GIF"),
    "disc.bmp": lambda: picture("BMP"),
    "disc.webp": lambda: picture("WEBP"),
    "letters.ttf": font,
}
"""What makes each file, by its name."""


def skyc():
    """A show of two drones: curves, lights, a fence, limits, a site and a cue."""
    points = [
        [0, [0, 0, 0], []],
        [4, [0, 0, 10], [[0, 0, 0], [0, 0, 10]]],
        [9, [6, 3, 12], []],
        [12, [6, 3, 0], []],
    ]
    apart = [[time, [x + 4, y, z], []] for time, (x, y, z), _ in points]
    flights = [
        {
            "name": f"d{number}",
            "trajectory": {"version": 1, "points": rows, "takeoffTime": 1},
            "lights": {"version": 1, "data": "DAAE/wAAAQcBDQ=="},
            "home": rows[0][1],
        }
        for number, rows in enumerate((points, apart))
    ]
    show = {
        "version": 1,
        "meta": {"title": "two"},
        "environment": {"location": {"origin": [190000000, 474000000, 1000]}},
        "settings": {
            "validation": {"maxAltitude": 50, "minDistance": 3, "maxVelocityXY": 8},
            "geofence": {
                "polygons": [
                    {"isInclusion": True, "points": [[-9, -9], [30, -9], [30, 30]]}
                ]
            },
            "cues": {"items": [{"time": 4, "name": "up"}]},
        },
        "swarm": {"drones": [{"type": "x", "settings": one} for one in flights]},
    }
    return json.dumps(show).encode()


def vviz():
    """Two performances with a light each."""
    steps = [{"dx": 0.1, "dy": 0.5, "dz": 0, "dt": 0.25} for _ in range(12)]
    light = [{"r": 9, "g": 20, "b": 255, "frames": 4} for _ in range(4)]
    performances = [
        {
            "id": number,
            "agentDescription": {"homeX": 4 * number, "agentTraversal": steps},
            "payloadDescription": [{"type": "Light", "payloadActions": light}],
        }
        for number in range(2)
    ]
    top = {"version": "1.0", "defaultPositionRate": 4, "performances": performances}
    return json.dumps(top).encode()


def table():
    """One drone's places and colours."""
    rows = [f"{n * 200},{n % 3},{n},{min(n, 9 - n)},255,{n},0" for n in range(10)]
    head = "Time [msec],x [m],y [m],z [m],Red,Green,Blue"
    return "\n".join([head, *rows]).encode()


def poly7():
    """One drone's polynomial pieces."""
    head = "duration," + ",".join(f"{axis}^{n}" for axis in "xyzw" for n in range(8))
    row = ",".join(["1", *(["0", "0.5", *["0"] * 6] * 4)])
    return "\n".join([head, row, row.replace("0.5", "-0.5")]).encode()


SHOWS = {
    "show.skyc": skyc,
    "show.vviz": vviz,
    "show.gltf": animated,
    "show.zip": table,
    "table.csv": table,
    "pieces.csv": poly7,
}
"""What makes each show of others, unpacked, by its name."""
KINDS = {".csv": "csv", ".svg": "svg", ".ttf": "text"}
KINDS |= dict.fromkeys((".obj", ".off", ".ply", ".stl", ".glb"), "mesh")
KINDS |= dict.fromkeys((".png", ".jpg", ".gif", ".bmp", ".webp"), "image")


def show_with(name):
    """A script whose only formation is drawn from a file."""
    if name.startswith("dance"):
        return (
            "showc: 1\nseparation: 0.1\nformations:\n"
            f"  it: {{type: frames, file: {name}}}\n"
            f"transitions: [{{to: it, motion: [{{follow: {name}}}]}}]\n"
        ).encode()
    kind = KINDS[name[name.rindex(".") :]]
    keys = f"text: Az9, font: {name}" if kind == "text" else f"file: {name}"
    return (
        "showc: 1\ndrones: 9\nseparation: 0.1\n"
        f"formations:\n  it: {{type: {kind}, {keys}}}\ntransitions: [it]\n"
    ).encode()


SCRIPT = """
showc: 1
name: All
epoch: 2025-06-01T23:30:00+02:00
site:
  origin: {latitude: 52.5 deg, longitude: 13, altitude: 48}
  heading: 30
  volume: {min: [-60, -60, -1], max: [60, 60, 80]}
  fence: [[-50, -50], [50, -50], [50, 50], [-50, 50]]
vehicle: {preset: formation-625g, mass: 700 g, inertia: [0.002, 0.002, 0.003]}
limits: {speed: [5, 5, 3], tilt: 20, body_rate: 1.7 rad/s, torque: [0.6, 0.6, 0.1]}
separation: {distance: 1.6, shape: ellipsoid, vertical_stretch: 1.5}
yaw: {mode: held, heading: 10}
drones: 9
pads: {type: grid, step: 3}
parking: {type: line, count: 5, centre: [0, -40, 15], spacing: 3}
launch: {altitude: 12}
landing: {altitude: 12, assignment: fixed}
groups: {left: 1-4, right: [5, 6-9]}
formations:
  ring: {type: circle, radius: 9, colour: {gradient: [red, blue], along: order}}
  twin: {like: ring, transform: [{rotate: {angle: 30, axis: z}}, {scale: 1.5}]}
  both:
    parts:
      - {type: points, points: [[0, 0, 0], [4, 0, 0]]}
      - {type: helix, radius: 12, height: 9, count: 5}
    centre: [0, 0, 30]
    effect: {kind: sweep, direction: [0, 0, 1]}
  word: {type: text, text: A, height: 20, spread: true, spacing: 2}
  west: {type: sphere, radius: 6, centre: [-25, 0, 25], count: 4}
  east: {type: cube, size: 9, centre: [25, 0, 25], count: 5, colour: {each: [red]}}
  table: {type: csv, file: places.csv}
  curves: {type: svg, file: drawing.svg, draw: inside}
  ball: {type: mesh, file: ball.obj, size: 30}
  disc: {type: image, file: disc.png}
transitions:
  - {to: ring, hold: 3, colour: gold, fade: start, effect: pulse, name: Go}
  - {to: twin, duration: 30, assignment: fixed}
  - both
  - {to: west, group: left}
  - {to: east, group: right}
  - word
  - table
  - curves
  - ball
  - disc
mission: {light_servos: [9, 10, 11], light_pwm: [1000, 2000], slack: 4, board: cube}
log_rate: 30
seed: 3
"""

MOVING = """
showc: 1
name: Lanes and motions
drones: 6
site:
  audience: [{name: stands, line: [[-30, -60], [30, -60]]}]
  buildings: [{name: hall, area: [[90, 0], [99, 0], [99, 40]], height: 12}]
  wind: 3
  ceiling: 90
limits: {jerk: 40, level_speed: 5, acceleration: 4, acceleration_up: 3}
separation: {distance: 1.5, tracking: 5 cm}
music: {bpm: 120, offset: 1, beats_per_bar: 4, cues: {drop: 44, end: 01:20}}
prefer: energy
groups: {left: 1-3, right: 4-6}
formations:
  ring: {type: circle, radius: 8, plane: front, centre: [0, 0, 20]}
  west: {type: circle, radius: 4, count: 3, centre: [-14, 0, 18]}
  east: {type: frames, file: dance.csv, transform: [{shift: [12, 0, 0]}]}
  sign: {type: text, text: HI, height: 16, spread: true, centre: [0, 0, 24]}
transitions:
  - {to: ring, at: bar 12, arrive: moving, leave: moving, hold: 8, prefer: time,
     motion: [{rotate: {angle: 90, axis: y}}, {wave: {amplitude: 1, wavelength: 30}}],
     lights: [{after: 1, colour: red}, {at: bar 14, colour: gold, fade: end}]}
  - {to: west, group: left, start: 34, at: "@drop"}
  - {to: east, group: right, start: bar 19, duration: 12, hold: 2}
  - {to: ring, at: beat 150, motion: [{breathe: 1.2}, {orbit: {radius: 0.5}}]}
  - {to: sign, motion: [{travel: [[4, 0, 0], [0, 0, 0]]}, {morph: [ring]}], hold: 20}
  - {to: ring, assignment: keep, prefer: 2, effect: {kind: run, beats: 2,
     colours: [red, white]}}
exports: [skyc, {to: kml}]
mission: {wanted: false}
"""
SCRIPTS = (SCRIPT, MOVING)
"""Scripts with every kind of thing that a show can have, between them."""
