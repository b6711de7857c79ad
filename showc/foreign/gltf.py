"""Animated glTF 2.0: nodes whose translations move, as drones.

The light of a drone is that of the first material that its node, or one below, has.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.documents.archive import LARGEST_ENTRY
from showc.documents.gltf import Document
from showc.documents.scene import Scene
from showc.errors import DamagedFileError
from showc.files import read_file
from showc.foreign.materials import Materials
from showc.foreign.show import Course, Courses, ForeignShow, fleet, polyline

if TYPE_CHECKING:
    from pathlib import Path

    from showc.arrays import FloatArray
    from showc.documents.gltf import Keys

_LAST = 1e-3
"""How long the last place of a STEP sampler is kept [s]: there is no later one."""


def _course_of(keys: Keys) -> Course:
    """Return the course of a node, its keys in the show frame."""
    times, values = keys.times, keys.values
    if keys.way == "CUBICSPLINE":
        return _hermite(times, values.reshape(-1, 3, 3))
    if keys.way == "STEP" and times.size > 1:
        return Course(np.append(times, times[-1] + _LAST), values[:, None])
    return polyline(times, values)


def _hermite(times: FloatArray, keys: FloatArray) -> Course:
    """Cubics through keys (n, 3, 3) of in-tangent, value, out-tangent."""
    if times.size == 1:
        return polyline(times, keys[:, 1])
    width = np.diff(times)[:, None] / 3.0
    begin, end = keys[:-1, 1], keys[1:, 1]
    body = np.stack(
        [begin, begin + width * keys[:-1, 2], end - width * keys[1:, 0], end], axis=1
    )
    return Course(times, body)


def read_gltf(path: Path) -> ForeignShow:
    """Read an animated scene: every node whose translation moves is a drone.

    Raises
    ------
    DamagedFileError
        If it is not what the format wants, or nothing in it moves.
    """
    document = Document(
        str(path),
        read_file(path, LARGEST_ENTRY),
        lambda name: read_file(path.parent / name, LARGEST_ENTRY),
    )
    scene, counted = Scene(document), Courses(path)
    found: dict[int, Course] = {}
    for node, keys in scene.moves():
        found[node] = _course_of(keys)
        counted.add(found[node])
    if not found:
        raise DamagedFileError(f"{path}: no node's translation is animated")
    nodes = sorted(found)
    names = tuple(scene.name_of(node) for node in nodes)
    shown = scene.materials_of(nodes)
    materials = Materials(document, {one for one in shown if one is not None})
    known = {one: materials.light(one) for one in set(shown) if one is not None}
    lights = tuple(None if one is None else known[one] for one in shown)
    return ForeignShow(
        str(path),
        "glTF",
        path.stem,
        names,
        fleet([found[node] for node in nodes]),
        lights=lights if any(light is not None for light in lights) else (),
    )
