"""Scenes of glTF 2.0: nodes whose translations move, in the show frame.

Samplers are LINEAR, STEP or CUBICSPLINE (a cubic Hermite: in-tangent, value,
out-tangent for every key). glTF has y up: (x, y, z) of the show frame is (x, z, -y).
A node's place is that in the world: nodes above it may shift, turn and scale it, but
not move themselves, for what moves twice is no polynomial any more.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.documents.numbers import array, places

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import FloatArray
    from showc.documents.gltf import Channel, Document, Keys


MOST_DRONES = 5000
"""Animated nodes that are read: as many drones as Skybrush reads."""

_BAKE = "bake the animation onto the drones themselves, without parents"
MOST_NODES = 50_000
"""Nodes of a scene: ten for each drone."""

_DEEPEST = 64
"""Nodes above a node: deeper trees are made to harm, not to be drawn."""


class Scene:
    """Nodes of a document, and what moves them."""

    def __init__(self, document: Document) -> None:
        self.document = document
        self.top = document.top
        self.entry, self._damage = document.entry, document.damage
        self._moved_by: dict[tuple[Any, bytes], int] = {}
        self._parents: dict[Any, int] = {}

    def _moved(self) -> tuple[list[Channel], set[int]]:
        """Find what moves nodes, and nodes that turn."""
        moves: list[Channel] = []
        turned: set[int] = set()
        shown = self._shown()
        for channel in self.document.channels():
            node = channel.node
            if node is None or "camera" in self.entry("nodes", node):
                continue
            if shown and shown.isdisjoint({node, *self.above(node)}):
                continue
            if channel.path == "translation":
                moves.append(channel)
            elif channel.path in {"rotation", "scale"}:
                turned.add(node)
        return moves, turned

    def _shown(self) -> set[Any]:
        """Return the nodes that the scene begins with; none: all nodes are shown."""
        scenes = self.top.get("scenes")
        if not isinstance(scenes, list) or not scenes:
            return set()
        roots = self.entry("scenes", self.top.get("scene", 0)).get("nodes")
        return {one for one in roots if isinstance(one, int)} if roots else set()

    def _family(self) -> None:
        """Note the parent of each node."""
        nodes = self.top.get("nodes")
        if isinstance(nodes, list) and len(nodes) > MOST_NODES:
            raise self._damage(f"has {len(nodes):,} nodes; wanted {MOST_NODES:,}")
        for parent, node in enumerate(nodes if isinstance(nodes, list) else []):
            children = node.get("children") if isinstance(node, dict) else None
            for child in children if isinstance(children, list) else []:
                self.entry("nodes", child)
                if self._parents.setdefault(child, parent) != parent:
                    raise self._damage(f"node {child} has two parents")

    def above(self, node: int) -> list[int]:
        """Return the nodes that carry a node, the nearest first."""
        found: list[int] = []
        while node in self._parents:
            node = self._parents[node]
            if node in found or len(found) >= _DEEPEST:
                raise self._damage(f"node {node} carries itself, or too deep a tree")
            found.append(node)
        return found

    def _placed(self, node: int, moving: set[int]) -> FloatArray:
        """Where nodes above put a node: an affine map (4, 4) in glTF's axes."""
        result = np.eye(4)
        for carrier in self.above(node):
            if carrier in moving:
                raise self._damage(
                    f"node {node} is carried by node {carrier}, which moves too; "
                    f"{_BAKE}"
                )
            result = self._local(carrier) @ result
        return result

    def _local(self, index: int) -> FloatArray:
        """Affine map of a node that stands still (4, 4)."""
        node, what = self.entry("nodes", index), f"{self.document.name}: node {index}"
        if node.get("matrix") is not None:
            # By columns.
            return array(node["matrix"], (16,), what).reshape(4, 4).T
        x, y, z, w = array(node.get("rotation", [0, 0, 0, 1]), (4,), what).tolist()
        turn = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )
        result = np.eye(4)
        result[:3, :3] = turn * array(node.get("scale", [1, 1, 1]), (3,), what)
        result[:3, 3] = array(node.get("translation", [0, 0, 0]), (3,), what)
        return result

    def _none_forgotten(self, found: set[int], turned: set[int]) -> None:
        """Refuse a scene in which something flies on a node that only turns."""
        nodes = self.top.get("nodes")
        for index, node in enumerate(nodes if isinstance(nodes, list) else []):
            if not isinstance(node, dict) or node.get("mesh") is None:
                continue
            above = self.above(index)
            if not found & {index, *above} and turned & set(above):
                raise self._damage(
                    f"node {index} is swung about by a node above it; {_BAKE}"
                )

    def moves(self) -> Iterator[tuple[int, Keys]]:
        """Yield each node whose translation moves, and where it is in the show frame.

        Raises
        ------
        DamagedFileError
            If that is no curve by itself, or not what the format wants.
        """
        found: dict[int, str] = {}
        self._family()
        moves, turned = self._moved()
        moving = {one.node for one in moves} | turned
        for channel in moves:
            node = channel.node
            if node in found:
                clips = " and ".join({found[node]: 0, _clip(channel.animation): 0})
                raise self._damage(
                    f"node {node} is moved by two channels, of {clips}; export one "
                    "animation for the whole show"
                )
            if len(found) >= MOST_DRONES:
                raise self._damage(f"moves more than {MOST_DRONES} nodes")
            found[node] = _clip(channel.animation)
            put = self._placed(node, moving)
            keys = self.document.keys(channel, "VEC3", f"node {node}")
            same = keys.output, put.tobytes()
            other = self._moved_by.setdefault(same, node)
            if other != node:
                raise self._damage(
                    f"nodes {other} and {node} have the same places; wanted for each "
                    "drone some of its own"
                )
            yield node, _placed_keys(keys, put, f"{self.document.name}: node {node}")
        self._none_forgotten(set(found), turned)

    def name_of(self, node: int) -> str:
        """Return what a node is called."""
        return str(self.entry("nodes", node).get("name") or f"node {node}")[:80]

    def materials_of(self, nodes: list[int]) -> list[int | None]:
        """Return for each of some nodes the material that it shows, or a node below."""
        found: dict[int, int] = {}
        every = self.top.get("nodes")
        for index, node in enumerate(every if isinstance(every, list) else []):
            mesh = node.get("mesh") if isinstance(node, dict) else None
            if mesh is None:
                continue
            parts = self.entry("meshes", mesh).get("primitives")
            for part in parts if isinstance(parts, list) else []:
                material = part.get("material") if isinstance(part, dict) else None
                if material is not None:
                    self.entry("materials", material)
                    for carrier in (index, *self.above(index)):
                        found.setdefault(carrier, material)
                    break
        return [found.get(node) for node in nodes]


def _clip(animation: dict[str, Any]) -> str:
    name = animation.get("name")
    return f"animation {str(name)[:40]!r}" if name else "an animation without a name"


def _placed_keys(keys: Keys, put: FloatArray, what: str) -> Keys:
    """Return keys as ``put`` (4, 4) puts their node into the world, show frame."""
    # What is not finite, or becomes so, is refused with its number.
    with np.errstate(invalid="ignore", over="ignore"):
        values = keys.values @ put[:3, :3].T
    # Tangents are turned and scaled, but not shifted.
    shift = np.broadcast_to(put[:3, 3], values.shape).copy()
    if keys.way == "CUBICSPLINE":
        shift.reshape(-1, 3, 3)[:, ::2] = 0.0
    x, y, z = (values + shift).T
    return replace(keys, values=places(np.stack([x, -z, y], axis=1), what))
