"""Shows to look at: Verge's visualisation format, animated glTF, KML.

None of them is flown; the first two are proved as they are written all the same, for
what a client sees should be what flies.
"""

from __future__ import annotations

import json
import struct
from functools import partial
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import escape

import numpy as np

from showc.documents.gltf import FLOAT, MAGIC
from showc.export.error import Sampled, error_of_lines
from showc.export.lights import LightNodes, light_nodes
from showc.export.skyc import shared
from showc.export.tables import Samples
from showc.foreign.closed import drone_name
from showc.foreign.lights import FRAME
from showc.processes import side_by_side

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import FloatArray
    from showc.export.fit import FittedFleet
    from showc.export.solved import SolvedShow
    from showc.safety.case import SafetyCase


RATE = 10
"""Places and colours a second of a visualisation [Hz]: straight lines are 13 mm off at
10 m/s²."""

PATH_STEP = 0.5
"""Time between two points of a path on a map [s]: lines are 0.3 m off at 10 m/s²."""

_JSON, _BINARY = 0x4E4F534A, 0x004E4942
"""Kinds of the chunks of a binary glTF: ``JSON`` and ``BIN`` (glTF 2.0, 4.4.3)."""
_ARRAY_BUFFER = 34962
"""Target of a view of vertices: ARRAY_BUFFER (glTF 2.0, 5.11)."""
_POINTER = "KHR_animation_pointer"
"""Extension that animates colours."""
_RADIUS = 0.15
"""Size of the diamond that stands for a drone [m]: about its own."""


def vviz_file(show: SolvedShow, lead: float) -> Sampled:
    """Return a visualisation.

    Steps are differences of rounded places: rounded steps would add up.
    """
    samples = Samples.of(show, lead, 1.0 / RATE)
    site = show.rules.site
    top = {
        "version": "1.0",
        "performanceName": show.rules.name,
        "coordinateFrame": "ogl",
        "globalReferenceFrame": {
            "lat": site.latitude,
            "lon": site.longitude,
            "alt": site.altitude,
        },
        "defaultPositionRate": RATE,
        "defaultColorRate": RATE,
        "timeOffsetSecs": 0,
    }

    # One drone after the other: a great fleet as one document would take a gigabyte.
    def performances(drones: Sequence[int]) -> str:
        return ",".join(_compact(_performance(samples, drone)) for drone in drones)

    parts = [partial(performances, some) for some in shared(show.drones)]
    every = ",".join(side_by_side(parts))
    error = error_of_lines(samples.exact, 1.0 / RATE, 1e-3)
    text = f'{_compact(top)[:-1]},"performances":[{every}]}}'
    return Sampled({"show.vviz": text.encode()}, error, float(samples.times[-1]))


def _compact(value: dict[str, Any]) -> str:
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"))


def _performance(samples: Samples, drone: int) -> dict[str, Any]:
    rounded = np.round(samples.places(drone), 3) + 0.0
    axes = np.stack([-rounded[:, 1], rounded[:, 2], rounded[:, 0]], axis=1)
    steps = np.round(np.diff(axes, axis=0), 3) + 0.0
    light = samples.lights[:, drone]
    moves = [{"dx": 0.0, "dy": 0.0, "dz": 0.0}]
    moves += [{"dx": x, "dy": y, "dz": z} for x, y, z in steps.tolist()]
    lit = {"id": 1, "type": "Light", "payloadActions": _actions(light.tolist())}
    places = dict(
        zip(("homeX", "homeY", "homeZ"), (axes[0] + 0.0).tolist(), strict=True)
    )
    return {
        "id": drone + 1,
        "agentDescription": {**places, "agentTraversal": moves},
        "payloadDescription": [lit],
    }


def _actions(colours: list[list[int]]) -> list[dict[str, int]]:
    """Colours with the frames since the one before; equal ones are left out."""
    found: list[dict[str, int]] = []
    last = 0
    for frame, (red, green, blue) in enumerate(colours):
        colour = {"r": red, "g": green, "b": blue}
        if not found:
            found.append(colour)
        elif colours[frame] != colours[frame - 1]:
            if frame - 1 > last:
                # The colour before stays until one frame ago.
                before = dict(zip("rgb", colours[frame - 1], strict=True))
                found.append({**before, "frames": frame - 1 - last})
                last = frame - 1
            found.append({**colour, "frames": frame - last})
            last = frame
    return found


def glb_file(show: SolvedShow, fitted: FittedFleet) -> bytes:
    """Return a binary glTF: a diamond for each drone, moved by cubic splines.

    Keys are the nodes of the fit, tangents its velocities: the picture is the flight.
    Lights change the diamonds' materials (KHR_animation_pointer); what does not know
    that shows the brightest colour of each.
    """
    scene = _Scene()
    scene.diamond()
    nodes = []
    lights = light_nodes(show.light_times, show.lights, fitted.lead / 1000.0)
    for drone in range(fitted.drones):
        times, place, tangent = _keys(fitted, drone)
        clock = scene.numbers(times[:, None], "SCALAR")
        values = np.stack([tangent, place, tangent], axis=1)
        output = scene.numbers(values.reshape(-1, 3), "VEC3")
        scene.animate(
            clock, output, "CUBICSPLINE", {"node": drone, "path": "translation"}
        )
        nodes.append(
            {
                "name": drone_name(drone),
                "mesh": scene.lit(lights[drone]),
                "translation": place[0].tolist(),
            }
        )
    return scene.binary(nodes, show.rules.name)


def _keys(fitted: FittedFleet, drone: int) -> tuple[FloatArray, ...]:
    """Return times (n,) [s], places and velocities (n, 3) [m, m/s] of joints."""
    rows = fitted.rows(drone)
    points = fitted.points[rows] * (fitted.scale[drone] / 1000.0)
    ends = (fitted.starts[rows] + fitted.lengths[rows]) / 1000.0
    last = points[-1:]
    slope = 3000.0 * (points[:, 1] - points[:, 0]) / fitted.lengths[rows, None]
    still = 3000.0 * (last[:, 3] - last[:, 2]) / fitted.lengths[rows][-1]
    return (
        np.append(0.0, ends),
        _gltf_axes(np.concatenate([points[:, 0], last[:, 3]])),
        _gltf_axes(np.concatenate([slope, still])),
    )


def _gltf_axes(values: FloatArray) -> FloatArray:
    """From the show frame to glTF's axes, y up."""
    return np.stack([values[..., 0], values[..., 2], -values[..., 1]], axis=-1) + 0.0


class _Scene:
    """Collects the buffer of a glTF document."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []
        self.materials: list[dict[str, Any]] = []
        self.meshes: list[dict[str, Any]] = []
        self.samplers: list[dict[str, Any]] = []
        self.channels: list[dict[str, Any]] = []
        self._known: dict[bytes, int] = {}

    def animate(
        self, times: int, values: int, way: str, target: dict[str, Any]
    ) -> None:
        """Change something over time; times and values are numbers of accessors."""
        self.channels.append({"sampler": len(self.samplers), "target": target})
        self.samplers.append({"input": times, "output": values, "interpolation": way})

    def numbers(self, values: FloatArray, kind: str) -> int:
        """Append float32 numbers; return the index of their accessor."""
        packed = values.astype("<f4")
        self.views.append(
            {"buffer": 0, "byteOffset": len(self.data), "byteLength": packed.nbytes}
        )
        self.data += packed.tobytes()
        described: dict[str, Any] = {
            "bufferView": len(self.views) - 1,
            "componentType": FLOAT,
            "count": values.shape[0],
            "type": kind,
            "min": packed.min(axis=0).astype(float).tolist(),
            "max": packed.max(axis=0).astype(float).tolist(),
        }
        self.accessors.append(described)
        return len(self.accessors) - 1

    def diamond(self) -> None:
        """Append the shape of a drone, eight triangles."""
        tips = _RADIUS * np.array(
            [[1, 0, 0], [0, 0, -1], [-1, 0, 0], [0, 0, 1], [0, 1, 0], [0, -1, 0]]
        )
        faces = [
            corner
            for k in range(4)
            for corner in (k, (k + 1) % 4, 4, (k + 1) % 4, k, 5)
        ]
        self.numbers(tips[faces], "VEC3")
        self.views[0]["target"] = _ARRAY_BUFFER

    def lit(self, light: LightNodes) -> int:
        """Return the index of the mesh that shows a light; equal ones share it."""
        key = light.frames.tobytes() + light.colours.tobytes()
        if key in self._known:
            return self._known[key]
        material = len(self.materials)
        shown = np.asarray(light.colours / 255.0)
        self.materials.append(
            {
                "pbrMetallicRoughness": {
                    "baseColorFactor": [0.0, 0.0, 0.0, 1.0],
                    "metallicFactor": 0.0,
                },
                "emissiveFactor": [round(value, 3) for value in shown.max(axis=0)],
            }
        )
        if np.ptp(light.colours, axis=0).any():
            target = {"pointer": f"/materials/{material}/emissiveFactor"}
            self.animate(
                self.numbers(np.asarray(light.frames[:, None] * FRAME), "SCALAR"),
                self.numbers(shown, "VEC3"),
                "LINEAR",
                {"path": "pointer", "extensions": {_POINTER: target}},
            )
        part = {"attributes": {"POSITION": 0}, "material": material}
        self.meshes.append({"primitives": [part]})
        self._known[key] = len(self.meshes) - 1
        return self._known[key]

    def binary(self, nodes: list[dict[str, Any]], name: str) -> bytes:
        """Return the whole file."""
        moves = {"name": name, "samplers": self.samplers, "channels": self.channels}
        top: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "showc"},
            "scene": 0,
            "scenes": [{"name": name, "nodes": list(range(len(nodes)))}],
            "nodes": nodes,
            "meshes": self.meshes,
            "materials": self.materials,
            "animations": [moves],
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": len(self.data)}],
        }
        if any(channel["target"]["path"] == "pointer" for channel in self.channels):
            top["extensionsUsed"] = [_POINTER]
        text = json.dumps(top, separators=(",", ":"), ensure_ascii=False).encode()
        text += b" " * (-len(text) % 4)
        body = bytes(self.data) + bytes(-len(self.data) % 4)
        total = 12 + 8 + len(text) + 8 + len(body)
        return (
            MAGIC
            + struct.pack("<II", 2, total)
            + struct.pack("<II", len(text), _JSON)
            + text
            + struct.pack("<II", len(body), _BINARY)
            + body
        )


def kml_file(show: SolvedShow, case: SafetyCase | None = None) -> bytes:
    """Return a map of the site: fence, volume, pads, and the way of each drone.

    Parameters
    ----------
    show
        What is drawn.
    case
        Volumes, audience and buildings to draw too, a folder each; None: none.
    """
    samples = Samples.of(show, 0.0, PATH_STEP)
    site = show.rules.site
    low, high = site.volume_min, site.volume_max
    corners = np.array(
        [[low.x, low.y], [high.x, low.y], [high.x, high.y], [low.x, high.y]]
    )
    pads = np.stack([samples.places(drone)[0] for drone in range(show.drones)])
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<kml xmlns="http://www.opengis.net/kml/2.2"><Document>',
        f"<name>{escape(show.rules.name)}</name>",
        _style("volume", "ff50af4c", "3350af4c"),
        _style("fence", "ff0000ff", "00000000"),
        _style("way", "ffffaa33", "00000000"),
        "<Folder><name>Flight volume</name>",
        _area(show, "flight volume", "volume", corners, high.z),
        "</Folder>",
    ]
    if site.fence:
        lines += [
            "<Folder><name>Fence</name>",
            _area(show, "fence", "fence", show.fence, high.z),
            "</Folder>",
        ]
    if case is not None:
        lines += _risks(show, case)
    lines.append("<Folder><name>Pads</name>")
    for drone in range(show.drones):
        where = _coordinates(show, pads[drone : drone + 1])
        lines.append(
            f"<Placemark><name>{drone + 1}</name><Point><altitudeMode>absolute"
            f"</altitudeMode><coordinates>{where}</coordinates></Point></Placemark>"
        )
    lines.append("</Folder><Folder><name>Ways</name>")
    for drone in range(show.drones):
        where = _coordinates(show, samples.places(drone))
        lines.append(
            f"<Placemark><name>{drone_name(drone)}</name><styleUrl>#way</styleUrl>"
            "<LineString><altitudeMode>absolute</altitudeMode>"
            f"<coordinates>{where}</coordinates></LineString></Placemark>"
        )
    lines.append("</Folder></Document></kml>")
    return ("\n".join(lines) + "\n").encode()


def _risks(show: SolvedShow, case: SafetyCase) -> list[str]:
    """Return a folder for each volume of a safety case, and for what stands around."""
    # Aabbggrr, from the flight outwards.
    colours = ("ffc45924", "ff1e54d9", "ff3636c2", "ff8b3fb5", "ff787878")
    lines = []
    for number, (volume, colour) in enumerate(zip(case.volumes, colours, strict=True)):
        lines += [
            _style(f"risk{number}", colour, f"30{colour[2:]}"),
            f"<Folder><name>{volume.name}</name>",
            _area(show, volume.name, f"risk{number}", volume.corners, volume.top),
            "</Folder>",
        ]
    site = case.show.site
    lines += [_style("people", "ff00a5ff", "6000a5ff"), "<Folder><name>Audience</name>"]
    for people in site.audience:
        if people.area:
            lines.append(_area(show, escape(people.name), "people", people.points, 0.0))
            continue
        points = np.column_stack([people.points, np.zeros(len(people.points))])
        lines.append(
            f"<Placemark><name>{escape(people.name)}</name><styleUrl>#people</styleUrl>"
            f"<LineString><coordinates>{_coordinates(show, points)}</coordinates>"
            "</LineString></Placemark>"
        )
    lines += [
        "</Folder>",
        _style("building", "ff555555", "80888888"),
        "<Folder><name>Buildings</name>",
        *(
            _area(show, escape(one.name), "building", one.corners, one.height)
            for one in site.buildings
        ),
        "</Folder>",
    ]
    return lines


def _style(name: str, line: str, fill: str) -> str:
    return (
        f'<Style id="{name}"><LineStyle><color>{line}</color><width>2</width>'
        f"</LineStyle><PolyStyle><color>{fill}</color></PolyStyle></Style>"
    )


def _area(
    show: SolvedShow, name: str, style: str, corners: FloatArray, height: float
) -> str:
    """Return a prism from the ground to ``height`` [m] above the origin."""
    ring = np.concatenate([corners, corners[:1]])
    top = np.column_stack([ring, np.full(ring.shape[0], height)])
    return (
        f"<Placemark><name>{name}</name><styleUrl>#{style}</styleUrl><Polygon>"
        "<extrude>1</extrude><altitudeMode>absolute</altitudeMode><outerBoundaryIs>"
        f"<LinearRing><coordinates>{_coordinates(show, top)}</coordinates>"
        "</LinearRing></outerBoundaryIs></Polygon></Placemark>"
    )


def _coordinates(show: SolvedShow, points: FloatArray) -> str:
    """Longitude, latitude and altitude of show-frame ``points`` (n, 3)."""
    return " ".join(
        f"{longitude:.8f},{latitude:.8f},{altitude:.2f}"
        for latitude, longitude, altitude in show.frame.to_geodetic(points).tolist()
    )
