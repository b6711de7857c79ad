"""One HTML page that plays a logged show, with nothing to load from elsewhere.

The page's own code lies in ``assets/``; what it draws is a scene, deflated.
"""

from __future__ import annotations

import base64
import html
import json
import zlib
from dataclasses import replace
from importlib.resources import files
from string import Template
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.simulate.results import Campaign
from showc.view.digest import (
    digest,
    every,
    speeds,
    stride_within,
    tightest,
    tilt_angles,
)
from showc.view.document import badge
from showc.view.findings import findings_of
from showc.view.fleet import bands_of
from showc.view.overview import ground_of
from showc.view.scene import Band, Chapter, GroupMove, Meeting, Scene, Signal
from showc.view.second_fleet import predicted_fleet

if TYPE_CHECKING:
    from collections.abc import Mapping

    from showc.arrays import IntArray
    from showc.log.reader import LoggedShow
    from showc.view.digest import Digest
    from showc.view.scene import SecondFleet, Soundtrack


SCRIPTS = (
    "data.js",
    "camera.js",
    "stage.js",
    "timeline.js",
    "plots.js",
    "findings.js",
    "sound.js",
    "player.js",
)
"""The page's code, in the order in which it is joined."""
FRAME_BUDGET = 3_500_000
"""Greatest number of positions in a page (frames x drones)."""
SIGNAL_BUDGET = 1_600_000
"""Greatest number of values of each plotted quantity (frames x drones)."""


def render_page(
    logged: LoggedShow,
    verification: Mapping[str, Any] | None = None,
    soundtrack: Soundtrack | None = None,
    recording: bytes = b"",
    *,
    flown: SecondFleet | None = None,
) -> str:
    """Return the page as HTML, with the verdict of ``showc verify --json``, or none.

    The cues of a ``soundtrack`` stand on its ruler; a ``recording`` (the bytes of a
    sound file) becomes a part of it. Tubes of simulated flights in wind that the log
    holds are drawn about the drones. Beside them stands the fleet as it was
    ``flown``; without it, as the missions are predicted.

    The positions in it are within a 130,000th of the flight's extent of the logged
    ones (1 mm for 130 m), between frames along straight lines. The address of the page
    may carry ``?t=41&play=0&drone=7&view=top&client=1`` (show time, whether it plays,
    chosen drone, camera, without engineering).
    """
    scene = replace(scene_of(logged, soundtrack), findings=findings_of(verification))
    scene = replace(scene, second=flown or predicted_fleet(logged))
    wind = Campaign.of(logged)
    if wind is not None:
        scene = _with_tubes(scene, wind)
    return render_whole(scene, verification, recording)


def _with_tubes(scene: Scene, wind: Campaign) -> Scene:
    """Add how far drones strayed in simulated wind, leg by leg."""
    legs = wind.tubes[:-1]
    if [one.start for one in legs] != [round(one.start, 3) for one in scene.chapters]:
        return scene
    chapters = tuple(
        replace(chapter, tube=leg.radius)
        for chapter, leg in zip(scene.chapters, legs, strict=True)
    )
    starts = np.array([chapter.start for chapter in chapters])
    ends = starts + [chapter.duration for chapter in chapters]
    weather = f"{wind.weather.wind:g} m/s, {wind.weather.gusts} gusts"
    band = Band(
        f"Simulated tube, {100.0 * wind.whole.share:.1f} %, {weather}",
        "m",
        2,
        np.stack([starts, ends], axis=1).ravel(),
        np.repeat([leg.radius for leg in legs], 2),
        np.full(2 * len(legs), np.nan),
    )
    return replace(scene, chapters=chapters, bands=(*scene.bands, band))


def render_whole(
    scene: Scene,
    verification: Mapping[str, Any] | None = None,
    recording: bytes = b"",
) -> str:
    """Return the page of a scene that carries everything itself."""
    return render_scene(
        scene.name,
        scene.header(),
        base64.b64encode(zlib.compress(scene.payload(), 6)).decode("ascii"),
        badge(verification),
        recording=base64.b64encode(recording).decode("ascii"),
    )


def render_scene(
    title: str,
    header: Mapping[str, Any],
    data: str,
    verdict: str = "",
    *,
    recording: str = "",
    more: str = "",
    nonce: str = "",
) -> str:
    """Return the page around a scene.

    Parameters
    ----------
    title
        Of the page.
    header
        Of the scene.
    data
        Its payload, deflated, in base 64; empty: the page asks ``more`` for it.
    verdict
        HTML of the proof's outcome.
    recording
        A sound file in base 64; empty: none.
    more
        Name of a further file of code among the assets.
    nonce
        What the server's policy lets scripts and styles pass by.
    """
    folder = files("showc.view") / "assets"
    names = [*SCRIPTS, *([f"{more}.js"] if more else [])]
    marked = f' nonce="{nonce}"' if nonce else ""
    style = (folder / "style.css").read_text("utf-8")
    return Template((folder / "page.html").read_text("utf-8")).substitute(
        title=html.escape(title),
        badge=verdict,
        nonce=marked,
        style=style,
        script="\n".join((folder / name).read_text("utf-8") for name in names),
        # A "<" inside a script element could end it or hide what follows.
        header=json.dumps(header, separators=(",", ":")).replace("<", "\\u003c"),
        data=data,
        recording=recording,
    )


def scene_of(logged: LoggedShow, soundtrack: Soundtrack | None = None) -> Scene:
    """Return what a page draws of a log."""
    digests = digest(logged)
    rate = logged.rules.log_rate
    stride = stride_within(logged, FRAME_BUDGET)
    signal_stride = stride_within(logged, SIGNAL_BUDGET)
    signal_stride = max(stride, signal_stride - signal_stride % stride)
    frames = every(logged, stride)
    meshes, mesh_index = _meshes(logged)
    samples = logged.samples[frames]
    encounters = _encounters(digests)
    return Scene(
        name=logged.rules.name,
        duration=logged.duration,
        step=stride / rate,
        positions=logged.positions[frames],
        colours=np.stack([samples[name] for name in ("red", "green", "blue")], axis=-1),
        chapters=tuple(_chapter(one) for one in digests),
        ground=ground_of(logged),
        encounters=encounters,
        signals=_signals(logged, every(logged, signal_stride)),
        signal_step=signal_stride / rate,
        meshes=meshes,
        mesh_index=mesh_index,
        bands=bands_of(logged, encounters),
        soundtrack=soundtrack,
    )


def _signals(logged: LoggedShow, frames: IntArray) -> tuple[Signal, ...]:
    """Return the plotted quantities of every drone."""
    samples = logged.samples[frames]
    limits = logged.rules.limits
    tilt = float(np.degrees(max(one.tilt for one in limits)))
    thrust = max(one.thrust_max for one in limits)
    return (
        Signal("Speed", "m/s", 2, speeds(samples)),
        Signal(
            "Tilt (roll or pitch)", "°", 1, np.degrees(tilt_angles(samples)), (tilt,)
        ),
        Signal("Thrust", "N", 2, samples["u0"].astype(np.float64), (thrust,)),
    )


def _meshes(logged: LoggedShow) -> tuple[tuple[tuple[float, ...], ...], IntArray]:
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
    return tuple(known), index


def _chapter(one: Digest) -> Chapter:
    message = one.segment.message
    label = {"launch": "launch", "approach": "to the pads", "land": "land"}
    # What a moving formation becomes has a name of its own.
    held = {"hold": message.to_formation, "motion": message.from_formation}
    return Chapter(
        name=message.name.replace("->", "→"),
        label=label.get(one.segment.kind)
        or held.get(one.segment.kind)
        or message.to_formation
        or message.name,
        kind=one.segment.kind,
        start=one.segment.start,
        duration=one.segment.duration,
        picture=held.get(one.segment.kind, ""),
        moves=tuple(
            GroupMove.of(
                move.name,
                move.group,
                (move.start, move.duration),
                move.to_formation,
                held=move.kind == message.MOTION,
            )
            for move in message.moves
        ),
    )


def _encounters(digests: tuple[Digest, ...]) -> tuple[Meeting, ...]:
    """Nearest pair of every move, and of the show, which may be in a hold."""
    nearest = tightest(digests)
    found = [
        one.closest
        for one in digests
        if one.closest is not None and (one.moving or one.closest is nearest)
    ]
    return tuple(
        Meeting(one.drone_a, one.drone_b, one.time, one.distance, one is nearest)
        for one in found
    )
