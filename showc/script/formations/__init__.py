"""Formations: the shapes a script can draw, one noun a module."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING

from showc.script.formations import circle, grid, line, points
from showc.script.formations.shape import (
    Drawing,
    FormationError,
    Request,
    Shape,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

SHAPES: Mapping[str, Shape] = MappingProxyType(
    {module.SHAPE.section.name: module.SHAPE for module in (grid, line, circle, points)}
)
"""Every shape, by the key that asks for it."""

__all__ = ["SHAPES", "Drawing", "FormationError", "Request", "Shape"]
