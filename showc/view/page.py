"""One HTML page that plays a logged show, with nothing to load from elsewhere.

Positions are sent as 16-bit steps of the flight's bounding box, colours and plots as
bytes, all as differences in time, deflated. The page's own code lies in ``assets/``.
"""

from __future__ import annotations

import base64
import html
import json
import zlib
from importlib.resources import files
from string import Template
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.view.digest import digest, metric_scale, speeds, tightest, tilt_angles
from showc.view.document import badge

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from showc.arrays import FloatArray, IntArray
    from showc.log.reader import LoggedShow
    from showc.view.digest import Digest


SCRIPTS = ("data.js", "camera.js", "stage.js", "timeline.js", "plots.js", "player.js")
"""The page's code, in the order in which it is joined."""
FRAME_BUDGET = 3_500_000
"""Greatest number of positions in a page (frames x drones)."""
SIGNAL_BUDGET = 1_600_000
"""Greatest number of values of each plotted quantity (frames x drones)."""
STEPS = 65_000
"""Steps over the bounding box along each axis; fits 16 bits."""


def render_page(
    logged: LoggedShow, verification: Mapping[str, Any] | None = None
) -> str:
    """Return the page as HTML, with the verdict of ``showc verify --json``, or none.

    The positions in it are within a 130,000th of the flight's extent of the logged
    ones (1 mm for 130 m), between frames along straight lines. The address of the page
    may carry ``?t=41&play=0&drone=7&view=top`` (show time, whether it plays, chosen
    drone, camera).
    """
    digests = digest(logged)
    stride = _stride(logged, FRAME_BUDGET)
    signal_stride = _stride(logged, SIGNAL_BUDGET)
    signal_stride = max(stride, signal_stride - signal_stride % stride)
    frames = _steps(logged, stride)
    signal_frames = _steps(logged, signal_stride)
    low = logged.positions.min(axis=(0, 1))
    high = logged.positions.max(axis=(0, 1))
    scale = np.maximum((high - low) / STEPS, 1e-4)
    signals, series = _signals(logged, signal_frames)
    meshes, mesh_index = _meshes(logged)
    payload = b"".join(
        [
            _pack_positions((logged.positions[frames] - low) / scale),
            _pack_colours(logged.samples[frames]),
            *series,
            mesh_index.astype("<u2").tobytes(),
        ]
    )
    header = {
        "name": logged.rules.name,
        "drones": logged.drones,
        "duration": logged.duration,
        "chapters": sum(d.moving for d in digests),
        "frames": int(frames.size),
        "frameStep": stride / logged.rules.log_rate,
        "signalFrames": int(signal_frames.size),
        "signalStep": signal_stride / logged.rules.log_rate,
        "origin": (low + scale * (STEPS // 2)).tolist(),
        "scale": scale.tolist(),
        "bounds": [low.tolist(), high.tolist()],
        "signals": signals,
        "meshes": meshes,
        "segments": [_segment(one) for one in digests],
        "encounters": _encounters(digests),
        **_site(logged),
    }
    folder = files("showc.view") / "assets"
    return Template((folder / "page.html").read_text("utf-8")).substitute(
        title=html.escape(logged.rules.name),
        badge=badge(verification),
        style=(folder / "style.css").read_text("utf-8"),
        script="\n".join((folder / name).read_text("utf-8") for name in SCRIPTS),
        # A "<" inside a script element could end it or hide what follows.
        header=json.dumps(header, separators=(",", ":")).replace("<", "\\u003c"),
        data=base64.b64encode(zlib.compress(payload, 6)).decode("ascii"),
    )


def _stride(logged: LoggedShow, budget: int) -> int:
    """Take every so-manyth step of the log, so that no more than ``budget`` remain."""
    return max(1, -(-logged.samples.size // budget))


def _steps(logged: LoggedShow, stride: int) -> IntArray:
    """Every ``stride``-th step of the log's grid, and the last step of all."""
    steps = np.arange(0, logged.times.size, stride)
    last = logged.times.size - 1
    return steps if steps[-1] == last else np.append(steps, last)


def _planes(values: NDArray[np.uint16]) -> bytes:
    """All low bytes, then all high bytes: these are nearly always 0 or 255."""
    pairs = np.ascontiguousarray(values).astype("<u2").view(np.uint8).reshape(-1, 2)
    return pairs[:, 0].tobytes() + pairs[:, 1].tobytes()


def _pack_positions(steps: FloatArray) -> bytes:
    """Second differences in time of positions (frames, drones, 3), axis by axis."""
    whole = np.rint(steps).astype(np.int32) - STEPS // 2
    whole = np.moveaxis(whole, -1, 0)
    first = np.diff(whole, axis=1, prepend=0)
    second = np.diff(first, axis=1, prepend=0)
    return _planes(second.astype(np.uint16))


def _pack_colours(samples: NDArray[np.void]) -> bytes:
    """First differences in time of the screen colours, channel by channel."""
    shown = np.stack([samples[name] for name in ("red", "green", "blue")])
    return np.diff(shown, axis=1, prepend=np.uint8(0)).tobytes()


def _signals(
    logged: LoggedShow, frames: IntArray
) -> tuple[list[dict[str, Any]], list[bytes]]:
    """Describe the plotted quantities, and give the bytes of their differences."""
    samples = logged.samples[frames]
    limits = logged.rules.limits
    described: tuple[tuple[str, str, int, FloatArray, list[float]], ...] = (
        ("Speed", "m/s", 2, speeds(samples), []),
        (
            "Tilt (roll or pitch)",
            "°",
            1,
            np.degrees(tilt_angles(samples)),
            [float(np.degrees(max(one.tilt for one in limits)))],
        ),
        (
            "Thrust",
            "N",
            2,
            samples["u0"].astype(np.float64),
            [max(one.thrust_max for one in limits)],
        ),
    )
    signals, series = [], []
    for name, unit, digits, values, bounds in described:
        extent = max(float(values.max()) * 1.08, 1e-3)
        # A limit not much above the values is drawn as well.
        extent = max([extent, *(b * 1.05 for b in bounds if b < 2.5 * extent)])
        steps = np.rint(np.clip(values, 0.0, None) / extent * 255.0).astype(np.uint8)
        series.append(np.diff(steps, axis=0, prepend=np.uint8(0)).tobytes())
        signals.append(
            {
                "name": name,
                "unit": unit,
                "digits": digits,
                "range": extent,
                "limits": bounds,
            }
        )
    return signals, series


def _meshes(logged: LoggedShow) -> tuple[list[list[float]], IntArray]:
    """Different meshes as fractions of their leg, and which each drone has on each."""
    known: dict[tuple[float, ...], int] = {(): 0}
    index = np.zeros((len(logged.segments), logged.drones), dtype=np.int64)
    for row, segment in enumerate(logged.segments):
        if segment.kind == "hold":
            continue
        for position, drone in enumerate(segment.drones.tolist()):
            breaks = segment.trajectory(position).state.breaks / segment.duration
            mesh = tuple(np.round(breaks, 4).tolist())
            index[row, drone] = known.setdefault(mesh, len(known))
    return [list(mesh) for mesh in known], index


def _segment(one: Digest) -> dict[str, Any]:
    message = one.segment.message
    label = {"launch": "launch", "approach": "to the pads", "land": "land"}
    return {
        "name": message.name.replace("->", "→"),
        "label": label.get(one.segment.kind, message.to_formation or message.name),
        "kind": one.segment.kind,
        "start": one.segment.start,
        "duration": one.segment.duration,
    }


def _encounters(digests: tuple[Digest, ...]) -> list[dict[str, Any]]:
    """Nearest pair of every move, and of the show, which may be in a hold."""
    nearest = tightest(digests)
    found = [
        one.closest
        for one in digests
        if one.closest is not None and (one.moving or one.closest is nearest)
    ]
    return [
        {
            "a": closest.drone_a,
            "b": closest.drone_b,
            "time": closest.time,
            "distance": closest.distance,
            "tightest": closest is nearest,
        }
        for closest in found
    ]


def _site(logged: LoggedShow) -> dict[str, Any]:
    """Ground, fence, pads and heading of the site."""
    site, rules = logged.rules.site, logged.rules
    volume = (site.volume_min, site.volume_max)
    fence = np.reshape(site.fence, (-1, 2))
    if fence.size == 0:
        (a, b), (c, d) = ((corner.x, corner.y) for corner in volume)
        fence = np.array([[a, b], [c, b], [c, d], [a, d]])
    pads = next(f for f in rules.formations if f.name == _pads_name(logged))
    return {
        "fence": fence.tolist(),
        "ground": [fence.min(axis=0).tolist(), fence.max(axis=0).tolist()],
        "ceiling": site.volume_max.z,
        "pads": np.reshape(pads.points, (-1, 3)).tolist(),
        "heading": site.heading,
        "separation": rules.separation.distance,
        "metric": metric_scale(rules.separation).tolist(),
    }


def _pads_name(logged: LoggedShow) -> str:
    """Name of the formation on the ground: the one that the launch leaves."""
    return str(logged.segments[0].message.from_formation)
