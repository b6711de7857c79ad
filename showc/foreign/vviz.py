"""Verge's visualisation format, 1.0: places as steps, colours as frames.

Its axes are x right, y up, z forward; the show frame's x forward, y left, z up, so
X = -y, Y = z, Z = x.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from showc.documents.archive import LARGEST_ENTRY, parse_json
from showc.documents.numbers import array, number, places, rising
from showc.errors import DamagedFileError
from showc.files import read_file
from showc.foreign.show import Courses, ForeignShow, LightTrack, polyline

if TYPE_CHECKING:
    from pathlib import Path

    from showc.foreign.show import Course


MOST_DRONES, MOST_SAMPLES = 5000, 50_000
"""Performances that are read, and samples of one."""


def _entry(value: Any, key: str, what: str, kind: type) -> Any:  # noqa: ANN401
    if not isinstance(value, dict) or not isinstance(value.get(key), kind):
        raise DamagedFileError(f"{what}: has no {key} that is a {kind.__name__}")
    return value[key]


def read_vviz(path: Path) -> ForeignShow:
    """Read a visualisation.

    Raises
    ------
    DamagedFileError
        If it is not what the format wants.
    """
    top = parse_json(read_file(path, LARGEST_ENTRY), str(path))
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
    samples = _entry(agent, "agentTraversal", what, list)
    if not 1 <= len(samples) <= MOST_SAMPLES:
        raise DamagedFileError(
            f"{what}: has {len(samples)} samples; wanted 1 to {MOST_SAMPLES:,}"
        )
    if not all(isinstance(sample, dict) for sample in samples):
        raise DamagedFileError(f"{what}: a sample is no object")
    steps = array(
        [[sample.get(key, 0.0) for key in ("dx", "dy", "dz")] for sample in samples],
        (-1, 3),
        f"{what}: steps",
    )
    gaps = array(
        [sample.get("dt", 1.0 / rate) for sample in samples], (-1,), f"{what}: dt"
    )
    gaps[0] = samples[0].get("dt", 0.0) if "dt" in samples[0] else 0.0
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
        actions = _entry(payload, "payloadActions", what, list)[:MOST_SAMPLES]
        if not actions or not all(isinstance(one, dict) for one in actions):
            return None
        colours = array(
            [[one.get(key, 0) for key in "rgb"] for one in actions],
            (-1, 3),
            f"{what}: colours",
        )
        counts = array(
            [one.get("frames", 1 if index else 0) for index, one in enumerate(actions)],
            (-1,),
            f"{what}: frames",
        )
        if not (np.all(np.isfinite(colours)) and np.all(counts >= 0.0)):
            raise DamagedFileError(f"{what}: a colour or a number of frames is bad")
        times = shift + np.cumsum(counts) / frames
        return LightTrack(times, np.clip(colours, 0.0, 255.0))
    return None
