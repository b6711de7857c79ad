"""Formations: the shapes a script can draw, one noun a module.

A module of this folder that has a ``SHAPE`` is a type of formation: its keys, its page
in the documents, its schema and its completion follow from the table in that module.
"""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules
from types import MappingProxyType
from typing import TYPE_CHECKING

from showc.script.formations.shape import Drawing, Request, Shape

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping


def _found() -> Iterator[Shape]:
    for module in iter_modules(__path__):
        shape = getattr(import_module(f"{__name__}.{module.name}"), "SHAPE", None)
        if isinstance(shape, Shape):
            yield shape


SHAPES: Mapping[str, Shape] = MappingProxyType(
    {
        shape.section.name: shape
        for shape in sorted(_found(), key=lambda found: found.section.name)
    }
)
"""Every shape, by the word that ``type`` gives."""

__all__ = ["SHAPES", "Drawing", "Request", "Shape"]
