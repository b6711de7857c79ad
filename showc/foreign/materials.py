"""Lights of a glTF: the colours of materials, and how they change.

A drone's light is what its material emits; of a material that emits nothing, its base
colour. Both are linear, from 0 to 1, as light is. KHR_materials_emissive_strength makes
it brighter; the brightest instant of a material is full light. Colours change with
KHR_animation_pointer.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from showc.documents.numbers import array, number
from showc.foreign.show import LightTrack

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.documents.gltf import Document, Keys

_BASE = "pbrMetallicRoughness"
_STRENGTH = "KHR_materials_emissive_strength"
_EMITTED, _REFLECTED = "emissiveFactor", f"{_BASE}/baseColorFactor"
_BRIGHT = f"extensions/{_STRENGTH}/emissiveStrength"
_KINDS = {_EMITTED: "VEC3", _REFLECTED: "VEC4", _BRIGHT: "SCALAR"}
"""What of a material can change, and its numbers."""
_PARTS = 8
"""Straight lines for each piece of a spline: colours are looked at, not flown."""
MOST_COLOURS = 2_000_000
"""Colours of all materials that a file may have: a thousand of 80 s at 24 Hz."""
_STEP_GAP = 1e-4
"""Time in which a STEP sampler changes here [s]."""


class Materials:
    """The materials of a document that drones show.

    Parameters
    ----------
    document
        Where they are.
    shown
        Their numbers.

    Raises
    ------
    DamagedFileError
        If a channel that changes one of them is not what the format wants.
    """

    def __init__(self, document: Document, shown: set[int]) -> None:
        self._document = document
        self._changes: dict[tuple[int, str], LightTrack] = {}
        count = 0
        for channel in document.channels():
            parts = channel.path.split("/", 3)
            if len(parts) != 4 or parts[1] != "materials" or not parts[2].isdecimal():
                continue
            number_, name = int(parts[2]), parts[3]
            if number_ not in shown or name not in _KINDS:
                continue
            what = f"{name} of material {number_}"
            if (number_, name) in self._changes:
                raise document.damage(f"{what} is changed by two channels")
            keys = document.keys(channel, _KINDS[name], what)
            self._changes[number_, name] = _track(keys)
            count += len(self._changes[number_, name].times)
            if count > MOST_COLOURS:
                raise document.damage(
                    f"up to {what} there are {count:,} colours; wanted at most "
                    f"{MOST_COLOURS:,}"
                )

    def light(self, index: int) -> LightTrack | None:
        """Return the light that a material shows; None: it is painted by a picture."""
        material = self._document.entry("materials", index)
        what = f"{self._document.name}: material {index}"
        emits = array(material.get(_EMITTED, [0, 0, 0]), (3,), f"{what}: {_EMITTED}")
        colour = self._changes.get((index, _EMITTED))
        if colour is None and emits.any():
            colour = _still(emits)
        if colour is None:
            base = material.get(_BASE)
            base = base if isinstance(base, dict) else {}
            if "baseColorTexture" in base:
                return None
            given = base.get("baseColorFactor", [1, 1, 1, 1])
            still = _still(array(given, (4,), f"{what}: baseColorFactor"))
            return _full(self._changes.get((index, _REFLECTED), still))
        if "emissiveTexture" in material:
            return None
        bright = self._changes.get((index, _BRIGHT))
        if bright is None:
            bright = _still(np.array([_strength(material, what)]))
        times = np.union1d(colour.times, bright.times)
        # Both sides of a jump stand for themselves, a hair apart.
        product = colour.at(times)[:, :3] * bright.at(times)[:, :1]
        return _full(LightTrack(times, product))


def _strength(material: dict[str, Any], what: str) -> float:
    extensions = material.get("extensions")
    held = extensions if isinstance(extensions, dict) else {}
    found = held.get(_STRENGTH)
    value = found.get("emissiveStrength", 1.0) if isinstance(found, dict) else 1.0
    return number(value, f"{what}: emissiveStrength")


def _still(colour: FloatArray) -> LightTrack:
    return LightTrack(np.zeros(1), colour[None])


def _full(track: LightTrack) -> LightTrack:
    """From shares to numbers up to 255, the brightest at most that."""
    colours = np.nan_to_num(np.maximum(track.colours[:, :3], 0.0), posinf=0.0)
    return LightTrack(track.times, 255.0 * colours / max(colours.max(), 1.0))


def _track(keys: Keys) -> LightTrack:
    """Straight lines through what a sampler says."""
    times, values = keys.times, keys.values
    if keys.way == "CUBICSPLINE":
        keyed = values.reshape(times.size, 3, -1)
        if times.size == 1:
            return LightTrack(times, keyed[:, 1])
        width = np.diff(times)[:, None, None]
        u = (np.arange(_PARTS) / _PARTS)[None, :, None]
        begin, end = keyed[:-1, None, 1], keyed[1:, None, 1]
        leave, arrive = keyed[:-1, None, 2], keyed[1:, None, 0]
        body = (
            (1.0 + 2.0 * u) * (1.0 - u) ** 2 * begin
            + u * (1.0 - u) ** 2 * width * leave
            + u**2 * (3.0 - 2.0 * u) * end
            - u**2 * (1.0 - u) * width * arrive
        )
        moments = times[:-1, None] + width[:, :, 0] * u[0, :, 0]
        return LightTrack(
            np.append(moments, times[-1]),
            np.concatenate([body.reshape(-1, values.shape[1]), keyed[-1:, 1]]),
        )
    if keys.way == "STEP" and times.size > 1:
        before = np.maximum(times[1:] - _STEP_GAP, 0.5 * (times[:-1] + times[1:]))
        moments = np.empty(2 * times.size - 1)
        moments[::2], moments[1::2] = times, before
        return LightTrack(moments, np.repeat(values, 2, axis=0)[:-1])
    return LightTrack(times, values)
