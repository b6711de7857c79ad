"""Formations: the shapes a script can draw, one noun a module."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING

from showc.script.formations import (
    circle,
    csv_file,
    cube,
    grid,
    helix,
    image,
    line,
    mesh,
    points,
    sphere,
    svg,
    text,
    wave,
)
from showc.script.formations.shape import Drawing, FormationError, Request, Shape

if TYPE_CHECKING:
    from collections.abc import Mapping

_DRAWN = (grid, line, circle, sphere, helix, cube, wave, text)
_READ = (svg, points, csv_file, mesh, image)

SHAPES: Mapping[str, Shape] = MappingProxyType(
    {module.SHAPE.section.name: module.SHAPE for module in (*_DRAWN, *_READ)}
)
"""Every shape, by the word that ``type`` gives."""

__all__ = ["SHAPES", "Drawing", "FormationError", "Request", "Shape"]
