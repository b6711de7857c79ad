"""Mesh: places spread evenly over the surface of a model."""

from __future__ import annotations

import json
import logging
import re
import struct
import sys
import warnings
from io import BytesIO
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.script.diagnostic import ScriptError
from showc.script.formations.evenly import candidates_for, spread_evenly
from showc.script.formations.shape import (
    Drawing,
    Request,
    Shape,
    any_count,
    centred,
)
from showc.script.language.kinds import Choice, Field, File, Quantity, Section

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.script.language.settings import Settings


MAX_TRIANGLES = 400_000
"""Triangles or corners of a model, copies written out: what fits into its file."""
_FARTHEST = 1e9
"""Farthest coordinate of a corner, in the model's units; others count as damaged."""
_HEAD = 10_000
"""Part of a file in which its head ends [bytes]."""
_SUFFIXES = (".obj", ".stl", ".gltf", ".glb", ".ply", ".off")

SECTION = Section(
    "mesh",
    "Places spread evenly over the surface of a model.",
    (
        Field(
            "file", File(_SUFFIXES), "The model (OBJ, STL, glTF, PLY).", required=True
        ),
        Field(
            "size",
            Quantity("m", minimum=0.1, maximum=1000.0),
            "Length of the longest side of the box around it.",
            default=20.0,
        ),
        Field(
            "up",
            Choice(("y", "z")),
            "Axis of the model that points up.",
            default_text="y for OBJ and glTF, z for the others",
        ),
    ),
)


def _trimesh() -> Any:  # noqa: ANN401 - a module without types
    """Import trimesh without scipy and lxml.

    It imports both if it can, which takes longer than everything a check of a
    script does, and needs neither to read a model.
    """
    blocked = [name for name in ("scipy", "lxml") if name not in sys.modules]
    sys.modules.update(dict.fromkeys(blocked))  # type: ignore[arg-type]
    try:
        import trimesh  # noqa: PLC0415 - takes time
    finally:
        for name in blocked:
            del sys.modules[name]
    return trimesh


def triangles_of(content: bytes, name: str) -> FloatArray:
    """Return the triangles of a model, shape (triangles, 3, 3), in its own units.

    Raises
    ------
    ScriptError
        If it is no model of its kind, or has no surface.
    """
    suffix = PurePath(name).suffix.lower()
    if suffix not in _SUFFIXES:
        raise ScriptError(
            "SHW110",
            f"`{name}` is not a model that showc reads",
            key="file",
            help_text=f"endings: {', '.join(_SUFFIXES)}",
        )
    judge(content, name, suffix)
    trimesh = _trimesh()
    heard = logging.root.manager.disable
    logging.disable()  # it tells everyone of damaged files, with tracebacks
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            loaded = trimesh.load(
                BytesIO(content),
                file_type=suffix[1:],
                process=False,
                maintain_order=True,
            )
        mesh = loaded.to_mesh() if isinstance(loaded, trimesh.Scene) else loaded
        solid = isinstance(mesh, trimesh.Trimesh)
        corners = np.asarray(mesh.triangles if solid else (), dtype=np.float64)
    except Exception:  # noqa: BLE001 - readers of models raise anything
        raise _unreadable(name, suffix) from None
    finally:
        logging.disable(heard)
    if not solid:
        raise ScriptError(
            "SHW110",
            f"`{name}` has points or lines, but no faces",
            key="file",
            help_text="give it faces, or write its points as a table (`type: csv`)",
        )
    if corners.shape[1:] != (3, 3):
        raise _unreadable(name, suffix)
    if len(corners) > MAX_TRIANGLES:
        raise _too_much(name, len(corners))
    there = len(corners)
    corners = corners[np.all(np.abs(corners) <= _FARTHEST, axis=(1, 2))]
    if there and not len(corners):
        raise ScriptError(
            "SHW110",
            f"`{name}` has no face whose corners are numbers up to {_FARTHEST:g}",
            key="file",
        )
    if not len(corners) or not float(_areas(corners).sum()) > 0.0:
        raise ScriptError("SHW110", f"`{name}` has no surface", key="file")
    return corners


def judge(content: bytes, name: str, suffix: str) -> None:
    """Refuse a model whose file promises more than it can hold, before it is decoded.

    Raises
    ------
    ScriptError
        If it is too large once decoded, or counts what is not there.
    """
    match suffix:
        case ".ply":
            numbers = [
                int(word)
                for word in re.findall(
                    rb"^element\s+\S+\s+(\d{1,18})", content[:_HEAD], re.MULTILINE
                )
            ]
        case ".off":
            words = content[:_HEAD].split(maxsplit=4)[1:4]
            numbers = [int(word) for word in words if word.isdigit()]
        case ".gltf" | ".glb":
            numbers = [_gltf_size(content, name, suffix)]
        case _:
            # A line, or fifty bytes, for each triangle: the size is the judge.
            return
    for number in numbers:
        if number > MAX_TRIANGLES:
            raise _too_much(name, number)


def _gltf_size(content: bytes, name: str, suffix: str) -> int:
    """Return how many corners a glTF scene has, all its copies written out."""
    try:
        if suffix == ".glb":
            (length,) = struct.unpack_from("<I", content, 12)
            content = content[20 : 20 + length]
        scene = json.loads(content)
        counts = [int(item["count"]) for item in scene.get("accessors", [])]
        meshes = [
            sum(
                counts[primitive.get("indices", primitive["attributes"]["POSITION"])]
                for primitive in mesh["primitives"]
            )
            for mesh in scene.get("meshes", [])
        ]
        nodes = scene.get("nodes", [])
        children = [child for node in nodes for child in node.get("children", [])]
        copies = sum(meshes[node["mesh"]] for node in nodes if "mesh" in node)
        once = len(children) == len(set(children))
    except Exception:  # noqa: BLE001 - whatever a damaged scene holds
        raise _unreadable(name, suffix) from None
    if not once:
        # Two parents each would copy it, and their parents would copy those.
        raise _unreadable(name, suffix)
    return max([copies, len(nodes), *counts], default=0)


def _unreadable(name: str, suffix: str) -> ScriptError:
    return ScriptError(
        "SHW110",
        f"`{name}` cannot be read as {suffix[1:].upper()}, or it is damaged",
        key="file",
    )


def _too_much(name: str, number: int) -> ScriptError:
    return ScriptError(
        "SHW119",
        f"`{name}` has {number} corners or triangles; at most {MAX_TRIANGLES} are read",
        key="file",
    )


def _areas(triangles: FloatArray) -> FloatArray:
    first = triangles[:, 1] - triangles[:, 0]
    second = triangles[:, 2] - triangles[:, 0]
    return np.asarray(np.linalg.norm(np.cross(first, second), axis=1) / 2.0)


def surface_points(triangles: FloatArray, count: int) -> FloatArray:
    """Return points on triangles, evenly by area and without chance, (count, 3).

    Systematic sampling over the summed areas picks the triangle, the R2 sequence
    (Roberts 2018) the place in it.
    """
    area = np.cumsum(_areas(triangles))
    index = np.arange(count)
    picked = np.searchsorted(area, (index + 0.5) / count * area[-1])
    picked = np.minimum(picked, len(triangles) - 1)
    golden = 1.324717957244746
    u = (0.5 + index / golden) % 1.0
    v = (0.5 + index / golden**2) % 1.0
    flip = u + v > 1.0
    u, v = np.where(flip, 1.0 - u, u), np.where(flip, 1.0 - v, v)
    corner = triangles[picked]
    return np.asarray(
        corner[:, 0]
        + u[:, None] * (corner[:, 1] - corner[:, 0])
        + v[:, None] * (corner[:, 2] - corner[:, 0])
    )


def draw(settings: Settings, request: Request) -> Drawing:
    """Draw the model, centred."""
    name = settings.text("file")
    triangles = triangles_of(request.read(name, "file"), name)
    default = "y" if PurePath(name).suffix.lower() in {".obj", ".gltf", ".glb"} else "z"
    up = settings.text("up") if "up" in settings else default
    if up == "y":
        triangles = triangles[..., [0, 2, 1]] * [1.0, -1.0, 1.0]
    corners = triangles.reshape(-1, 3)
    extent = float(np.ptp(corners, axis=0).max())
    scaled = centred(corners).reshape(-1, 3, 3) * settings.number("size") / extent
    dense = surface_points(scaled, candidates_for(request.count))
    return Drawing(dense[spread_evenly(dense, request.count)])


SHAPE = Shape(SECTION, any_count, draw)
