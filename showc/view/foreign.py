"""Foreign shows on the same pages as our own: what their files say, and no more.

What a file does not say is named, and not drawn: fence, north, limits, lights. Curves
are samples to look at; findings, figures and closest encounters are those of the proof.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.errors import DamagedFileError
from showc.foreign.acts import holds
from showc.foreign.motion import derivative, place_at, portions
from showc.foreign.script import GROUND, ON_GROUND, colours_at, held
from showc.foreign.smoothing import GRAVITY, acceleration, tilt_of
from showc.log.showc_pb2 import Separation
from showc.view.digest import metric_scale, nearest_at
from showc.view.document import badge, clock, document, figure, row, small, table, text
from showc.view.findings import findings_of
from showc.view.fleet import DENSE, POINTS
from showc.view.overview import Overview, Picture
from showc.view.page import FRAME_BUDGET, SIGNAL_BUDGET, render_whole
from showc.view.pictures import pictures_section
from showc.view.report import (
    MOST_FILES,
    SIGNATURE,
    checks_section,
    figures_section,
    site_section,
)
from showc.view.scene import (
    Band,
    Chapter,
    Cue,
    Ground,
    Meeting,
    Scene,
    Signal,
    Soundtrack,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from showc.arrays import ByteArray, FloatArray
    from showc.foreign.facts import Asked
    from showc.foreign.script import Picture as Held
    from showc.foreign.show import ForeignShow

RATE = 20.0
"""Frames of a page [Hz]."""
MOST_HOLDS = 300
"""Holds that become chapters, the longest; a timeline has no room for more."""
LIT = 120
"""Grey in which drones are drawn whose lights are not known, of 255."""


@dataclass(frozen=True, slots=True)
class Judged:
    """A foreign show and what was found about it."""

    show: ForeignShow
    """As it was read."""
    verification: Mapping[str, Any]
    """What ``showc verify --json`` gives."""
    rules: Sequence[Asked]
    """What it was held against."""

    def least(self, name: str) -> float | None:
        """Return the least of a limit of all rules; None where none has one."""
        values = [getattr(one, name) for one in self.rules]
        return min((value for value in values if value is not None), default=None)

    @property
    def separation(self) -> Separation | None:
        """The separation that was asked for last; None where none was."""
        asked = [one.separation for one in self.rules]
        return next((one for one in reversed(asked) if one is not None), None)

    def checks(self, code: str) -> list[Mapping[str, Any]]:
        """Return the checks of a code that found a value."""
        found = self.verification["checks"]
        return [c for c in found if c["code"] == code and c["value"] is not None]


def render_foreign(judged: Judged) -> str:
    """Return the page that plays a foreign show."""
    return render_whole(foreign_scene(judged), judged.verification)


def foreign_scene(judged: Judged) -> Scene:
    """Return what a page draws of a foreign show."""
    show, tracks = judged.show, judged.show.tracks
    count = max(2, min(int(tracks.end * RATE), FRAME_BUDGET // show.drones))
    step = tracks.end / count
    times = np.linspace(0.0, tracks.end, count + 1)
    stride = max(1, -(-times.size * show.drones // SIGNAL_BUDGET))
    velocity = derivative(tracks)
    signals = [_speeds(velocity, times[::stride])]
    signals += _tilts(judged, times[::stride])
    unknown = _unknown(judged)
    try:
        colours = colours_at(show, times)
    except DamagedFileError as error:
        colours = None
        unknown.append(f"lights ({error})")
    if colours is None:
        colours = np.full((times.size, show.drones, 3), LIT, dtype=np.uint8)
    positions = np.stack([place_at(tracks, float(time)) for time in times])
    chapters = _chapters(_shown(show), tracks.end, landed=_landed(show))
    apart = _apart(judged, times, positions)
    return Scene(
        name=show.title,
        duration=tracks.end,
        step=step,
        positions=positions,
        colours=colours,
        chapters=chapters,
        ground=_ground(judged),
        encounters=_encounters(judged, chapters, apart),
        signals=tuple(signals),
        signal_step=step * stride,
        bands=(*_bands(judged, velocity, times, positions), *_nearest(judged, apart)),
        soundtrack=_cues(show),
        findings=findings_of(judged.verification, whole=True),
        unknown=tuple(unknown),
        names=show.names,
    )


def _unknown(judged: Judged) -> list[str]:
    """Name what neither the file nor the rules say."""
    show = judged.show
    missing = [
        (show.location is None, "place and north"),
        (not any(one.fence or one.volume for one in judged.rules), "fence"),
        (judged.separation is None, "least separation"),
        (_ceiling(judged) is None, "ceiling"),
        (judged.least("speed_xy") is None, "limits of speed"),
        (not any(one is not None for one in show.lights), "lights"),
    ]
    return [words for known, words in missing if known]


def _ceiling(judged: Judged) -> float | None:
    """Greatest height that is allowed [m]."""
    heights = [one.volume[1][2] for one in judged.rules if one.volume is not None]
    asked = judged.least("altitude")
    return min([*heights, *([] if asked is None else [asked])], default=None)


def _ground(judged: Judged) -> Ground:
    show, separation = judged.show, judged.separation
    kept = [one for asked in judged.rules for one in asked.fence if one.inclusion]
    location = show.location
    return Ground(
        fence=kept[0].points if kept else np.zeros((0, 2)),
        floor=None,
        ceiling=_ceiling(judged),
        pads=np.asarray(show.tracks.position[show.tracks.first[:-1], 0]),
        # Of +y, which points to the left of +x.
        heading=None if location is None else (location.orientation - 90.0) % 360.0,
        separation=None if separation is None else separation.distance,
        metric=np.ones(3) if separation is None else metric_scale(separation),
    )


def _speeds(velocity: Any, times: FloatArray) -> Signal:  # noqa: ANN401 - tracks
    found = [np.linalg.norm(place_at(velocity, float(time)), axis=1) for time in times]
    return Signal("Speed", "m/s", 2, np.stack(found))


def _tilts(judged: Judged, times: FloatArray) -> list[Signal]:
    """Tilt of the smoothed flights; none where no smoothing is enough."""
    smoothing = [one for one in judged.checks("VRF521") if one["verdict"] == "pass"]
    if not smoothing:
        return []
    width = float(smoothing[0]["value"])
    parts = []
    for _, part in portions(judged.show.tracks):
        change = acceleration(part, width)
        force = [place_at(change, float(time)) / GRAVITY for time in times]
        parts.append(tilt_of(np.stack(force) + np.array([0.0, 0.0, 1.0])))
    name = f"Tilt, smoothed over {width:g} s" if width else "Tilt"
    return [Signal(name, "°", 1, np.degrees(np.concatenate(parts, axis=1)))]


def _shown(show: ForeignShow) -> list[Held]:
    """Return what the fleet holds, the longest times where they are many."""
    spans = sorted(holds(show.tracks), key=lambda span: span[0] - span[1])
    return held(show, spans[:MOST_HOLDS])


def _landed(show: ForeignShow) -> bool:
    """Whether all drones end on the ground, wherever."""
    tracks = show.tracks
    first, last = tracks.position[tracks.first[:-1], 0], place_at(tracks, tracks.end)
    return bool((last[:, 2] - first[:, 2]).max() <= ON_GROUND)


def _chapters(shown: list[Held], end: float, *, landed: bool) -> tuple[Chapter, ...]:
    """Return holds, and the moves between them."""
    found, at, before = [], 0.0, GROUND
    for one in [*shown, None]:
        last = GROUND if landed else "the end"
        begin, name = (end, last) if one is None else (one.begin, one.name)
        if begin > at + 1e-9:
            found.append(_move(before, name, at, begin))
        if one is not None:
            still = one.end - one.begin
            picture = "" if name == GROUND else name
            found.append(Chapter(name, name, "hold", one.begin, still, picture))
            at = one.end
        before = name
    return tuple(found)


def _move(before: str, after: str, begin: float, end: float) -> Chapter:
    """Return the chapter of a flight from one picture, or the ground, to another."""
    name, kind, label = f"{before} → {after}", "transition", after
    if before == GROUND == after:
        name = label = "flight"
    elif before == GROUND:
        kind = label = "launch"
    elif after == GROUND:
        kind = label = "land"
    return Chapter(name, label, kind, begin, end - begin)


@dataclass(frozen=True, slots=True, eq=False)
class _Apart:
    """Nearest pairs at some frames."""

    times: FloatArray
    """Shape (k,) [s]."""
    pairs: tuple[Meeting, ...]
    """One for each."""


def _apart(judged: Judged, times: FloatArray, positions: FloatArray) -> _Apart | None:
    """Nearest pairs at some frames; None where the metric is no distance."""
    drones = positions.shape[1]
    separation = judged.separation or Separation()
    if drones < 2 or separation.shape == Separation.ALL_AXES:
        return None
    many = max(2, min(times.size, POINTS, DENSE * 1000 // drones))
    chosen = np.unique(np.linspace(0, times.size - 1, many).astype(int))
    pairs = []
    for frame in chosen.tolist():
        one = nearest_at(positions[frame], float(times[frame]), separation)
        assert one is not None  # noqa: S101 - there are pairs, and a distance
        pairs.append(Meeting(one.drone_a, one.drone_b, one.time, one.distance, False))
    return _Apart(times[chosen], tuple(pairs))


def _encounters(
    judged: Judged, chapters: Sequence[Chapter], apart: _Apart | None
) -> tuple[Meeting, ...]:
    """Nearest pair of every move by the frames, and of the show as it was proved."""
    found = []
    for one in chapters if apart is not None else ():
        assert apart is not None  # noqa: S101 - as said
        first, last = np.searchsorted(
            apart.times, [one.start, one.start + one.duration]
        )
        near = apart.pairs[first:last]
        if one.kind != "hold" and near:
            found.append(min(near, key=lambda pair: pair.distance))
    proved = judged.checks("VRF504")
    if proved:
        where, value = proved[-1]["where"], float(proved[-1]["value"])
        first, second = (drone - 1 for drone in where["pair"])
        time = float(where["time"])
        found = [near for near in found if near.distance > value]
        found.append(Meeting(first, second, time, value, tightest=True))
    return tuple(sorted(found, key=lambda pair: pair.time))


def _nearest(judged: Judged, apart: _Apart | None) -> list[Band]:
    """Curve of the nearest pair, the proved one in it."""
    if apart is None:
        return []
    values = np.array([pair.distance for pair in apart.pairs])
    for check in judged.checks("VRF504"):
        row_ = int(np.abs(apart.times - check["where"]["time"]).argmin())
        values[row_] = min(values[row_], check["value"])
    separation = judged.separation
    limit = np.full(values.size, np.nan if separation is None else separation.distance)
    return [Band("Closest pair", "m", 2, apart.times, values, limit, least=True)]


def _bands(
    judged: Judged,
    velocity: Any,  # noqa: ANN401 - tracks
    times: FloatArray,
    positions: FloatArray,
) -> list[Band]:
    """Speeds and height of the fleet against what is allowed."""
    edges = np.linspace(0, times.size, min(POINTS, times.size) + 1).astype(int)
    begins = times[edges[:-1]]
    level, up, down = (np.empty(times.size) for _ in range(3))
    for number, time in enumerate(times.tolist()):
        moving = place_at(velocity, time)
        level[number] = np.hypot(moving[:, 0], moving[:, 1]).max()
        up[number] = max(float(moving[:, 2].max()), 0.0)
        down[number] = max(float(-moving[:, 2].min()), 0.0)
    rows = (
        ("Greatest level speed", "m/s", 2, level, judged.least("speed_xy")),
        ("Greatest climb", "m/s", 2, up, judged.least("speed_up")),
        ("Greatest descent", "m/s", 2, down, judged.least("speed_down")),
        ("Greatest height", "m", 1, positions[..., 2].max(axis=1), _ceiling(judged)),
    )
    return [
        Band(
            name,
            unit,
            digits,
            begins,
            np.array([values[low:high].max() for low, high in pairwise(edges)]),
            np.full(begins.size, np.nan if limit is None else limit),
        )
        for name, unit, digits, values, limit in rows
    ]


def _cues(show: ForeignShow) -> Soundtrack | None:
    cues = tuple(Cue(one.time, one.name) for one in show.cues)
    return Soundtrack(0.0, "", cues, 0.0, 0.0) if cues else None


def render_foreign_report(judged: Judged, hashes: Mapping[str, str]) -> str:
    """Return the report of a foreign show as one printable HTML page.

    Parameters
    ----------
    judged
        The show.
    hashes
        SHA-256 of its files by name.
    """
    show, scene = judged.show, foreign_scene(judged)
    shown = [one for one in _shown(show) if one.name != GROUND]
    first = {one.name: one for one in reversed(shown)}
    heights = scene.positions[..., 2]
    overview = Overview(
        scene.ground,
        scene.positions[:: max(1, round(0.4 / scene.step))],
        float(heights.min()),
        float(heights.max()),
        tuple(
            Picture(one.name, one.begin, one.places, _seen(one.colours, show.drones))
            for one in sorted(first.values(), key=lambda one: one.begin)
        ),
    )
    body = [
        _head(judged, scene),
        _figures(judged),
        site_section(overview),
        pictures_section(overview),
        _moves(scene),
        checks_section(judged.verification),
        SIGNATURE,
        _files(hashes),
    ]
    return document(f"{show.title} – report", "\n".join(body))


def _seen(colours: ByteArray | None, drones: int) -> ByteArray:
    return np.full((drones, 3), LIT, np.uint8) if colours is None else colours


def _head(judged: Judged, scene: Scene) -> str:
    show = judged.show
    where = "site not known"
    if show.location is not None:
        place = show.location
        where = f"site {place.latitude:.6f}°, {place.longitude:.6f}°"
    missing = ""
    if scene.unknown:
        missing = f"<p>Not known: {text(', '.join(scene.unknown))}.</p>"
    return (
        f"<header><div><h1>{text(show.title)}</h1>"
        f"<p>Report on another tool's show, read from {text(show.format)} · {where}</p>"
        f"{missing}</div>{badge(judged.verification)}</header>"
    )


def _figures(judged: Judged) -> str:
    """Greatest figures, as they were proved."""
    show = judged.show
    shown = [
        (str(show.drones), "drones", ""),
        (clock(show.duration), "from start to end", ""),
    ]
    for code, name, words in (
        ("VRF506", "", "greatest height"),
        ("VRF505", "horizontal", "greatest level speed"),
        ("VRF504", "", "smallest separation"),
        ("VRF522", "", "furthest of the smoothed flight from the file"),
    ):
        found = [c for c in judged.checks(code) if c["name"].startswith(name)]
        if not found:
            shown.append(("–", words, ""))
            continue
        worst = next((c for c in found if c["verdict"] == "fail"), found[-1])
        limit = figure(worst["limit"], worst["unit"])
        bad = "fail" if worst["verdict"] == "fail" else ""
        rule = f" (rule: {limit})" if limit else ""
        shown.append((figure(worst["value"], worst["unit"]), words + rule, bad))
    return figures_section(shown)


def _moves(scene: Scene) -> str:
    """Table of the moves between what is held."""
    heads = ["", "Move", "Start", "Time [s]", "Smallest separation [m]", "Speed [m/s]"]
    words = frozenset({1})
    speed, times = scene.signals[0].values.max(axis=1), scene.signal_step
    rows, number = [], 0
    for one in scene.chapters:
        end = one.start + one.duration
        near = [e for e in scene.encounters if one.start <= e.time <= end]
        nearest = min(near, key=lambda pair: pair.distance, default=None)
        distance = ""
        if nearest is not None:
            pair = f"{nearest.a + 1} and {nearest.b + 1}, {clock(nearest.time)}"
            mark = "◆ " if nearest.tightest else ""
            distance = f"{mark}{nearest.distance:.2f}" + small(pair)
        moving = one.kind != "hold"
        number += moving
        low, high = int(one.start / times), int(end / times) + 1
        rows.append(
            row(
                [
                    str(number) if moving else "",
                    text(one.name),
                    clock(one.start),
                    f"{one.duration:.3f}",
                    distance,
                    f"{speed[low:high].max(initial=0.0):.2f}" if moving else "",
                ],
                kind="" if moving else "hold",
                words=words,
            )
        )
    note = (
        '<p class="note">Distances and speeds of single moves are those of samples; '
        "◆ and the table below are proved at every instant.</p>"
    )
    return f"<h2>Moves</h2>{table(heads, rows, words=words)}{note}"


def _files(hashes: Mapping[str, str]) -> str:
    words = frozenset({0, 1})
    listed = list(hashes.items())
    lines = [
        [text(name), f"<code>{text(value)}</code>"]
        for name, value in listed[:MOST_FILES]
    ]
    more = len(listed) - MOST_FILES
    rest = f'<p class="note">{more} more files are not listed.</p>' if more > 0 else ""
    shown = table(["File", "Hash"], lines, words=words)
    return f"<h2>Files<small>SHA-256</small></h2>{shown}{rest}"
