"""What a file says, proved as it stands: nothing is assumed beyond its polynomials."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from showc.foreign.fence import RESOLUTION, Work, beyond_reach, furthest_outside
from showc.foreign.motion import (
    Greatest,
    component,
    derivative,
    during,
    greatest,
    jumps,
    length,
    over_fleet,
    owners,
    place_at,
)
from showc.foreign.smoothing import CORNER
from showc.log.showc_pb2 import Separation
from showc.verify.kernel.separation import closest_in
from showc.verify.report import Check, Place

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from showc.foreign.show import FencePolygon, ForeignShow
    from showc.verify.kernel.separation import Encounter
    from showc.verify.kernel.slices import Tracks
    from showc.verify.report import Verdict


GROUP = "what the file says"
"""Heading of these checks."""

ROUNDING = 1e-6
"""How far rounding may carry a value over its limit [SI]."""

SPEED_RESOLUTION, LENGTH_RESOLUTION = 1e-4, 1e-4
"""Widths of the enclosures of speeds [m/s] and of lengths [m]."""

CONTINUOUS = 1e-3
"""Distance between the end of a piece and the start of the next that is rounding of
the file's numbers [m]."""

NO_LIMIT = "no limit is known: the file has none, and none was asked for"
"""Said of what was measured and could not be judged."""

TOUCHING = "aircraft of any size touch there, whatever is asked"
"""Said of a pair that is nearer than that where no limit is known."""

COLLISION = 0.05
"""Distance of two centres at which aircraft of any size touch [m]: the least that fly
in shows are 0.09 m wide."""

_NARROW = 0.5
"""Least separation with which pairs are sought [m]."""

_MOST_PARTS = 1_000
"""Parts into which a search cuts the time: what ten minutes at 5 m/s need."""

_BURIED = 1.0
"""Depth below all pads from which flights are remarked [m]: no stage has such holes."""

_HEAP = 8
"""Equally near pairs for each drone beyond which they are not listed."""

_FINDINGS = 8
"""Oddities that are spelt out; the rest are counted."""


@dataclass(frozen=True, slots=True)
class Asked:
    """Rules that a show is held against; None and empty: not asked."""

    source: str
    """Whose rules these are, for people: ``the file's own``, ``asked``."""
    separation: Separation | None = None
    """How far drones stay apart."""
    altitude: float | None = None
    """Greatest height [m]."""
    speed_xy: float | None = None
    """Greatest horizontal speed [m/s]."""
    speed_up: float | None = None
    """Greatest speed of climb [m/s]."""
    speed_down: float | None = None
    """Greatest speed of descent [m/s]."""
    volume: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None
    """Lower and upper corner that positions stay between [m]."""
    fence: tuple[FencePolygon, ...] = field(default=())
    """Areas to stay in, or out of."""

    @property
    def any(self) -> bool:
        """Whether anything is asked at all."""
        return bool(self.fence) or any(
            one is not None
            for one in (
                self.separation,
                self.altitude,
                self.speed_xy,
                self.speed_up,
                self.speed_down,
                self.volume,
            )
        )


def own_rules(show: ForeignShow) -> Asked:
    """Return what the file itself declares."""
    declared = show.declared
    separation = None
    if declared.distance is not None:
        separation = Separation(distance=declared.distance, vertical_stretch=1.0)
    return Asked(
        "the file's own",
        separation,
        declared.altitude,
        declared.speed_xy,
        declared.speed_up,
        declared.speed_down,
        None,
        show.fences,
    )


def each_alone(show: ForeignShow, rules: list[Asked]) -> list[Check]:
    """Prove or refute what is asked of the drones one by one, at every instant.

    Parameters
    ----------
    show
        The file.
    rules
        Its own and those of others; every one is judged by itself.
    """
    tracks = show.tracks
    velocity = derivative(tracks)
    checks = [_bytes(show), _continuous(tracks), _corners(velocity)]
    checks += _speeds(velocity, rules)
    height = _highest(tracks)
    checks += [
        _limited("VRF506", f"height, {asked.source}", height, asked.altitude, "m")
        for asked in rules
        if asked.altitude is not None
    ]
    if all(asked.altitude is None for asked in rules):
        checks.append(_limited("VRF506", "height", height, None, "m"))
    checks += _depth(tracks)
    for asked in rules:
        if asked.volume is not None:
            checks.append(_volume(tracks, asked))
        if asked.fence:
            checks.append(_fenced(tracks, asked))
    return checks


def _fenced(tracks: Tracks, asked: Asked) -> Check:
    """How far drones leave the fence; what is not found within bounds is no proof."""
    name, note = f"outside the fence, {asked.source}", beyond_reach(tracks, asked.fence)
    if note is not None:
        return Check("VRF508", GROUP, name, "fail", notes=(note,))
    search = partial(furthest_outside, fence=asked.fence, work=Work())
    found = over_fleet(tracks, search)
    check = _limited("VRF508", name, found, 0.0, "m")
    if found.upper <= max(found.lower, ROUNDING) + 2.0 * RESOLUTION:
        return check
    note = f"only that it is at most {found.upper:.3f} m is known: too many pieces"
    return replace(check, verdict="fail", notes=(*check.notes, note))


def _depth(tracks: Tracks) -> list[Check]:
    """Remark flights far below every place where one begins or ends."""
    lowest = over_fleet(tracks, lambda part: greatest(part, component(2, -1.0), 1e-3))
    begin = tracks.position[tracks.first[:-1], 0, 2]
    end = tracks.position[tracks.first[1:] - 1, -1, 2]
    below = float(min(begin.min(), end.min())) + lowest.lower
    if below <= _BURIED:
        return []
    return [
        Check(
            "VRF506",
            GROUP,
            "depth below where flights begin and end",
            "warning",
            below,
            _BURIED,
            "m",
            Place(drone=lowest.drone + 1, time=lowest.time),
            ("is another axis the one that leads up in this file?",),
        )
    ]


def _bytes(show: ForeignShow) -> Check:
    """Whether the bytes are what the format wants."""
    notes = [
        f"{'' if one.drone is None else f'drone {one.drone}: '}{one.message}"
        for one in show.oddities[:_FINDINGS]
    ]
    if len(show.oddities) > _FINDINGS:
        notes.append(f"and {len(show.oddities) - _FINDINGS} more")
    first = show.oddities[0] if show.oddities else None
    return Check(
        "VRF501",
        GROUP,
        f"bytes are whole and sound ({show.format})",
        "fail" if show.oddities else "pass",
        where=Place() if first is None else Place(drone=first.drone, time=first.time),
        notes=tuple(notes),
    )


def _continuous(tracks: Tracks) -> Check:
    rows, off = jumps(tracks)
    size = np.sqrt((off[:, :3] ** 2).sum(axis=1))
    if size.size == 0 or size.max() <= CONTINUOUS:
        worst = float(size.max(initial=0.0))
        return Check(
            "VRF502",
            GROUP,
            "positions go on without a jump",
            "pass",
            worst,
            CONTINUOUS,
            "m",
        )
    index = int(np.argmax(size))
    return Check(
        "VRF502",
        GROUP,
        "positions go on without a jump",
        "fail",
        float(size[index]),
        CONTINUOUS,
        "m",
        Place(
            drone=int(owners(tracks)[rows[index]]) + 1,
            time=float(tracks.starts[rows[index]]),
        ),
        (f"{int((size > CONTINUOUS).sum())} jumps in all",),
    )


def _corners(velocity: Tracks) -> Check:
    """How much velocity jumps: no rule, but what smoothing has to round off."""
    rows, off = jumps(velocity)
    size = np.sqrt((off[:, :3] ** 2).sum(axis=1))
    worst = float(size.max(initial=0.0))
    name = "velocity goes on without a jump"
    if worst <= CORNER:
        return Check("VRF503", GROUP, name, "pass", worst, CORNER, "m/s")
    index = int(np.argmax(size))
    return Check(
        "VRF503",
        GROUP,
        name,
        "warning",
        worst,
        CORNER,
        "m/s",
        Place(
            drone=int(owners(velocity)[rows[index]]) + 1,
            time=float(velocity.starts[rows[index]]),
        ),
        (
            (
                f"{int((size > CORNER).sum())} corners; no aircraft flies one: see "
                "whether the show can be flown, below"
            ),
        ),
    )


def named(show: ForeignShow, drones: Sequence[int]) -> tuple[str, ...]:
    """Note how the file names drones, counting from 0.

    There is no note where the names only count the drones, as ``drone_0003`` does.
    """
    names = [show.names[drone] for drone in drones]
    numbers = [[int(number) for number in re.findall(r"\d+", name)] for name in names]
    counted = numbers == [[drone + 1] for drone in drones]
    return () if counted else (" and ".join(names),)


def closest_pairs(tracks: Tracks, found: Encounter) -> list[tuple[int, int]]:
    """Pairs that come as near as the closest one at the same instant, in order.

    Shows are often symmetric; which of several equal pairs a search names is chance.
    Where drones stand in heaps, the pair that the search names stands for all.
    """
    place = place_at(tracks, found.time)
    tree, reach = cKDTree(place), found.upper + CONTINUOUS
    # Every drone counts with itself, every pair twice.
    if tree.count_neighbors(tree, reach) > tracks.drones * (1 + 2 * _HEAP):
        return [found.pair]
    pairs = tree.query_pairs(reach, output_type="ndarray")
    inside = [(int(first), int(second)) for first, second in np.sort(pairs, axis=1)]
    return sorted({*inside, found.pair})


def searched(tracks: Tracks, wanted: Separation) -> Separation:
    """Return the separation with which pairs are sought; the result does not change.

    The search cuts time where drones fly twice that far. Files that ask for nothing, or
    in which drones fly for hours at any speed, are cut into no more parts than this.
    """
    width = np.maximum(tracks.ends - tracks.starts, 1e-9)
    reach = tracks.position.max(axis=1) - tracks.position.min(axis=1)
    speed = float((np.sqrt((reach**2).sum(axis=1)) / width).max())
    found = Separation()
    found.CopyFrom(wanted)
    whole = speed * (tracks.end - tracks.begin)
    found.distance = max(wanted.distance, _NARROW, whole / (2.0 * _MOST_PARTS))
    return found


def searches(
    tracks: Tracks, rules: list[Asked], spans: int
) -> dict[Measured, list[Callable[[], Encounter | None]]]:
    """Return searches for the closest encounter by each measure that is asked for.

    Each searches one of ``spans`` parts of the time; a sphere where nothing is asked.
    """
    found: dict[Measured, list[Callable[[], Encounter | None]]] = {}
    borders = np.linspace(tracks.begin, tracks.end, spans + 1).tolist()
    for asked in _apart(rules):
        assert asked.separation is not None  # noqa: S101 - chosen so
        if _measure(asked.separation) not in found:
            wanted = searched(tracks, asked.separation)
            found[_measure(asked.separation)] = [
                partial(_closest, tracks, low, high, wanted)
                for low, high in pairwise(borders)
            ]
    return found


Measured = tuple[int, float]
"""A measure of distances: its shape and its vertical stretch."""


def _measure(separation: Separation) -> Measured:
    return separation.shape, separation.vertical_stretch


def _apart(rules: list[Asked]) -> list[Asked]:
    """Return the rules that ask for a separation; a sphere of 0 m where none does."""
    wanted = [asked for asked in rules if asked.separation is not None]
    return wanted or [Asked("", Separation(distance=0.0, vertical_stretch=1.0))]


def _closest(
    tracks: Tracks, begin: float, end: float, wanted: Separation
) -> Encounter | None:
    whole = begin == tracks.begin and end == tracks.end
    return closest_in(tracks if whole else during(tracks, begin, end), wanted)


def all_pairs(
    show: ForeignShow, rules: list[Asked], known: dict[Measured, Encounter | None]
) -> tuple[list[Check], Encounter | None]:
    """Prove or refute the separation of all pairs, at every instant.

    ``known`` is the closest encounter by each measure.

    Returns
    -------
    list of Check
        One for each rule that asks for a separation.
    Encounter or None
        The closest one, in the measure of the last of them, as a sphere where none
        does; None: one drone.
    """
    checks, tracks = [], show.tracks
    found = None
    for asked in _apart(rules):
        assert asked.separation is not None  # noqa: S101 - chosen so
        found = known[_measure(asked.separation)]
        source = f", {asked.source}" if asked.source else ""
        name = f"separation of all pairs{source}"
        if found is None:
            checks.append(Check("VRF504", GROUP, name, "skipped", notes=("one drone",)))
            continue
        limit: float | None = asked.separation.distance
        pairs = closest_pairs(tracks, found)
        first = pairs[0]
        notes = [*named(show, first)]
        verdict: Verdict = "fail"
        if found.lower >= asked.separation.distance - ROUNDING:
            verdict = "pass"
        if not asked.source:
            collide = found.upper < COLLISION
            verdict, limit = ("fail", COLLISION) if collide else ("skipped", None)
            notes.append(TOUCHING if collide else NO_LIMIT)
        if len(pairs) > 1:
            notes.append(f"{len(pairs) - 1} more pairs are as near at that instant")
        checks.append(
            Check(
                "VRF504",
                GROUP,
                name,
                verdict,
                found.upper,
                limit,
                "m",
                Place(pair=(first[0] + 1, first[1] + 1), time=found.time),
                tuple(notes),
            )
        )
    return checks, found


def _speeds(velocity: Tracks, rules: list[Asked]) -> list[Check]:
    found = {
        "horizontal speed": over_fleet(
            velocity, lambda part: greatest(part, length((0, 1)), SPEED_RESOLUTION)
        ),
        "climb": over_fleet(
            velocity, lambda part: greatest(part, component(2), SPEED_RESOLUTION)
        ),
        "descent": over_fleet(
            velocity, lambda part: greatest(part, component(2, -1.0), SPEED_RESOLUTION)
        ),
    }
    checks = []
    for name, field_name in (
        ("horizontal speed", "speed_xy"),
        ("climb", "speed_up"),
        ("descent", "speed_down"),
    ):
        judged = [asked for asked in rules if getattr(asked, field_name) is not None]
        checks += [
            _limited(
                "VRF505",
                f"{name}, {asked.source}",
                found[name],
                getattr(asked, field_name),
                "m/s",
            )
            for asked in judged
        ]
        if not judged:
            checks.append(_limited("VRF505", name, found[name], None, "m/s"))
    return checks


def _highest(tracks: Tracks) -> Greatest:
    return over_fleet(
        tracks, lambda part: greatest(part, component(2), LENGTH_RESOLUTION)
    )


def _volume(tracks: Tracks, asked: Asked) -> Check:
    """How far positions leave the volume, the worst of six walls."""
    assert asked.volume is not None  # noqa: S101 - asked for
    low, high = asked.volume
    worst: Greatest | None = None
    for axis in range(3):
        for sign, wall in ((1.0, high[axis]), (-1.0, low[axis])):
            measured = component(axis, sign)
            one = over_fleet(
                tracks,
                partial(greatest, measured=measured, resolution=LENGTH_RESOLUTION),
            )
            off = sign * wall
            one = replace(one, upper=one.upper - off, lower=one.lower - off)
            if worst is None or one.upper > worst.upper:
                worst = one
    assert worst is not None  # noqa: S101 - there are six walls
    return _limited("VRF507", f"outside the volume, {asked.source}", worst, 0.0, "m")


def _limited(
    code: str, name: str, found: Greatest, limit: float | None, unit: str
) -> Check:
    """Hold the greatest value of something against its limit."""
    bad = limit is not None and found.lower > limit + ROUNDING
    return Check(
        code,
        GROUP,
        name,
        "skipped" if limit is None else "fail" if bad else "pass",
        found.lower,
        limit,
        unit,
        Place(drone=found.drone + 1, time=found.time),
        (NO_LIMIT,) if limit is None else (),
    )
