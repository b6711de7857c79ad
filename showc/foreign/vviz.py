"""Verge's visualisation format, 1.0: places as steps, colours as frames.

Its axes are x right, y up, z forward; the show frame's x forward, y left, z up, so
X = -y, Y = z, Z = x.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from showc.documents.archive import LARGEST_ENTRY
from showc.documents.numbers import array, number, places, rising
from showc.documents.values import parse_json
from showc.errors import DamagedFileError
from showc.files import read_file
from showc.foreign.show import Courses, ForeignShow, LightTrack, polyline

if TYPE_CHECKING:
    from pathlib import Path

    from showc.arrays import BoolArray, FloatArray
    from showc.foreign.show import Course


MOST_DRONES, MOST_SAMPLES = 5000, 50_000
"""Performances that are read, and samples of one."""


MOST_LOOSE = 200_000
"""Objects beside gathered samples: those of two lists, and four of each drone."""

MOST_LISTS = 2 * MOST_DRONES
"""Lists of a kind: drones may carry more than one lamp."""

_LISTS = {
    "agentTraversal": ("dx", "dy", "dz", "dt"),
    "payloadActions": ("r", "g", "b", "frames"),
}
"""Long lists of objects, and what each of those has."""


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """Numbers of a list of objects."""

    values: FloatArray
    """Shape (objects, 4); zero where an object has none."""
    given: BoolArray
    """Whether it has, the same shape."""

    @classmethod
    def of(cls, listed: list[dict[str, Any]], keys: tuple[str, ...], what: str) -> Self:
        """Gather numbers of objects.

        Raises
        ------
        DamagedFileError
            If what they have are no numbers.
        """
        values = [[one.get(key, 0.0) for key in keys] for one in listed]
        given = [[key in one for key in keys] for one in listed]
        return cls(array(values, (-1, len(keys)), what), np.array(given))


class _Gatherer:
    """Puts the numbers of an object's long lists into arrays, as they are read."""

    def __init__(self) -> None:
        self._loose = 0
        self._lists = dict.fromkeys(_LISTS, 0)

    def __call__(self, found: dict[str, Any]) -> dict[str, Any]:
        """Take the next object.

        Raises
        ------
        DamagedFileError
            If there are more than a show has, or a list of something else.
        """
        self._loose += 1
        if self._loose > MOST_LOOSE:
            raise DamagedFileError(
                f"has {MOST_LOOSE:,} objects that are no samples; no show has"
            )
        for name, keys in _LISTS.items():
            listed = found.get(name)
            if isinstance(listed, list) and 1 <= len(listed) <= MOST_SAMPLES:
                if not all(isinstance(one, dict) for one in listed):
                    raise DamagedFileError(f"an entry of {name} is no object")
                found[name] = _Rows.of(listed, keys, name)
                self._loose -= len(listed)
                self._lists[name] += 1
                if self._lists[name] > MOST_LISTS:
                    raise DamagedFileError(
                        f"has more than {MOST_LISTS:,} lists of {name}; wanted one for "
                        f"each of {MOST_DRONES:,} performances"
                    )
        return found


def _entry(value: Any, key: str, what: str, kind: type) -> Any:  # noqa: ANN401
    if not isinstance(value, dict) or not isinstance(value.get(key), kind):
        raise DamagedFileError(f"{what}: has no {key} that is a {kind.__name__}")
    return value[key]


def _parsed(path: Path) -> Any:  # noqa: ANN401 - any JSON
    try:
        return parse_json(read_file(path, LARGEST_ENTRY), str(path), _Gatherer())
    except DamagedFileError as error:
        text = str(error)
        name = "" if text.startswith(str(path)) else f"{path}: "
        raise DamagedFileError(name + text) from None


def read_vviz(path: Path) -> ForeignShow:
    """Read a visualisation.

    Raises
    ------
    DamagedFileError
        If it is not what the format wants.
    """
    top = _parsed(path)
    performances = _entry(top, "performances", str(path), list)
    if not 1 <= len(performances) <= MOST_DRONES:
        raise DamagedFileError(
            f"{path}: has {len(performances)} performances; wanted 1 to {MOST_DRONES}"
        )
    rate = number(top.get("defaultPositionRate", 4), f"{path}: defaultPositionRate")
    frames = number(top.get("defaultColorRate", 4), f"{path}: defaultColorRate")
    shift = number(top.get("timeOffsetSecs", 0), f"{path}: timeOffsetSecs")
    if rate <= 0.0 or frames <= 0.0:
        raise DamagedFileError(
            f"{path}: a rate is {min(rate, frames):g} Hz; wanted more"
        )
    courses = Courses(path)
    names, lights = [], []
    for index, performance in enumerate(performances):
        what = f"{path}: performance {index + 1}"
        agent = _entry(performance, "agentDescription", what, dict)
        courses.add(_course(agent, rate, shift, what))
        lights.append(_lights(performance, frames, shift, what))
        names.append(str(performance.get("id", index + 1))[:80])
    return ForeignShow(
        str(path),
        ".vviz",
        str(top.get("performanceName") or path.stem)[:200],
        tuple(names),
        courses.tracks(),
        lights=tuple(lights),
    )


def _course(agent: dict[str, Any], rate: float, shift: float, what: str) -> Course:
    home = [
        number(agent.get(f"home{axis}", 0), f"{what}: home{axis}") for axis in "XYZ"
    ]
    samples = agent.get("agentTraversal")
    if not isinstance(samples, _Rows):
        raise DamagedFileError(
            f"{what}: has no agentTraversal of 1 to {MOST_SAMPLES:,} samples"
        )
    steps = samples.values[:, :3]
    gaps = np.where(samples.given[:, 3], samples.values[:, 3], 1.0 / rate)
    gaps[0] = samples.values[0, 3]
    with np.errstate(invalid="ignore", over="ignore"):
        walked = np.array(home) + np.cumsum(steps, axis=0)
        times = shift + np.cumsum(gaps)
    place = np.stack([walked[:, 2], -walked[:, 0], walked[:, 1]], axis=1)
    return polyline(rising(times, what), places(place, what))


def _lights(
    performance: dict[str, Any], frames: float, shift: float, what: str
) -> LightTrack | None:
    payloads = performance.get("payloadDescription")
    if not isinstance(payloads, list):
        return None
    for payload in payloads:
        if not isinstance(payload, dict) or payload.get("type") != "Light":
            continue
        actions = payload.get("payloadActions")
        if not isinstance(actions, _Rows):
            return None
        colours = actions.values[:, :3]
        counts = np.where(actions.given[:, 3], actions.values[:, 3], 1.0)
        counts[0] = actions.values[0, 3]
        if not (np.all(np.isfinite(colours)) and np.all(counts >= 0.0)):
            raise DamagedFileError(f"{what}: a colour or a number of frames is bad")
        times = shift + np.cumsum(counts) / frames
        return LightTrack(times, np.clip(colours, 0.0, 255.0))
    return None
