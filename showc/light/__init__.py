"""The light of every drone at every time."""

from showc.light.colour import srgb_bytes
from showc.light.program import LightProgram

__all__ = ["LightProgram", "srgb_bytes"]
