"""What the show mode of Skybrush's ArduCopter makes of a file.

The rules are those of branch CMCopter-4.6 with libskybrush 4.2.0, read in its source
and asked of its own code:

- The take-off height is the first altitude plus SHOW_TAKEOFF_ALT. The first piece that
  touches it is sought; of pieces of degree 4 and more none is ever found, and a show
  without that instant is refused. Take-off is commanded one climb and the motors'
  spool-up before it, which must not be before the start.
- Until it has climbed there the vehicle flies ArduPilot's own take-off, straight up.
- Landing begins where SHOW_TAKEOFF_ALT is left of the last unbroken run of pieces that
  do not climb and whose ends lie within 50 mm of their starts; at the run's start, if
  it is shorter; at the end of the file, if there is none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil, sqrt
from typing import TYPE_CHECKING

import numpy as np

from showc.errors import DamagedFileError
from showc.foreign.lights import Budget, read_lights
from showc.foreign.motion import ROWS_AT_ONCE, owners, values
from showc.foreign.show import Stored
from showc.verify.kernel.bernstein import elevate
from showc.verify.kernel.slices import Tracks
from showc.verify.report import Check, Place

if TYPE_CHECKING:
    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.foreign.show import ForeignShow


GROUP = "what the firmware makes of it"
"""Heading of these checks."""

VERTICAL = 0.05
"""How far the end of a piece that counts as vertical may lie from its start [m]."""

LARGEST_BLOCK = 65_535
"""Longest block of a binary file [bytes]."""

HIGHEST_SOLVED = 3
"""Highest degree in which the firmware finds the take-off height."""

PASSED = 0.9
"""Speed at the take-off height up to which vehicles stayed within 0.3 m of their files
after the hand-over, in flight [m/s]; a twentieth is for rounding."""

_LIGHTS_JUDGED = 300
"""Light programs that are played; the rest are alike as a rule."""


@dataclass(frozen=True, slots=True)
class Firmware:
    """Parameters that the rules depend on, in SI: the branch's defaults."""

    takeoff_height: float = 2.5
    """SHOW_TAKEOFF_ALT [m]."""
    takeoff_error: float = 3.0
    """SHOW_TAKEOFF_ERR [m]."""
    climb_speed: float = 2.5
    """WPNAV_SPEED_UP [m/s]."""
    climb_acceleration: float = 1.0
    """WPNAV_ACCEL_Z [m/s²]."""
    spool_up: float = 0.5
    """MOT_SPOOL_TIME [s]."""

    @property
    def climb_time(self) -> float:
        """Time of the climb to the take-off height, rest to rest [s]."""
        way, speed, push = (
            self.takeoff_height,
            self.climb_speed,
            self.climb_acceleration,
        )
        if way >= speed * speed / push:
            return way / speed + speed / push
        return 2.0 * sqrt(way / push)


@dataclass(frozen=True, slots=True, eq=False)
class Phases:
    """When the firmware takes off and lands, for every drone."""

    above: FloatArray
    """When the file is first at the take-off height [s]; inf: not found, (drones,)."""
    passing: FloatArray
    """How fast it climbs there [m/s], shape (drones,)."""
    takeoff: FloatArray
    """When the motors start [s], shape (drones,)."""
    landing: FloatArray
    """When it commands LAND [s], shape (drones,)."""
    landing_height: FloatArray
    """How high above the file's end that is [m], shape (drones,)."""
    drift: FloatArray
    """How far the file is from straight above its start until it passes the take-off
    height, at most [m], shape (drones,)."""


def as_stored(show: ForeignShow) -> tuple[Tracks, tuple[Stored, ...], list[str]]:
    """Return what the firmware gets: of other files than its own, the server's version.

    Skybrush's server multiplies by 1000, divides by the scale and drops the fraction;
    it raises quadratics to cubics and turns durations into whole milliseconds.

    Returns
    -------
    Tracks
        As the firmware plays them.
    tuple of Stored
        How they are stored.
    list of str
        What the server changes.
    """
    if show.stored:
        return show.tracks, show.stored, []
    tracks, notes = show.tracks, []
    owner = owners(tracks)
    reach = np.zeros(tracks.drones)
    np.maximum.at(reach, owner, np.abs(tracks.position).max(axis=(1, 2)))
    scale = np.maximum(1, np.ceil((np.ceil(1000.0 * reach) + 1.0) / 32_768.0))
    grid = scale[owner][:, None, None] / 1000.0
    durations = tracks.ends - tracks.starts
    exact = np.rint(durations * 1000.0)
    floored = np.floor(np.round(durations, 3) * 1000.0)
    short = np.flatnonzero(floored < exact)
    if short.size:
        lost = np.bincount(owner[short], minlength=tracks.drones)
        worst = int(np.argmax(lost))
        notes.append(
            f"the server shortens {short.size} durations by 1 ms; drone {worst + 1} "
            f"ends {int(lost[worst])} ms early"
        )
    times = np.cumsum(floored) / 1000.0
    begin = np.concatenate([[0.0], times])[tracks.first[:-1]]
    ends = times - begin[owner]
    starts = ends - floored / 1000.0
    keep = np.flatnonzero(floored > 0)
    first = np.concatenate(
        [[0], np.cumsum(np.bincount(owner[keep], minlength=tracks.drones))]
    )
    # In place: the numbers of a long show are hundreds of megabytes.
    steps = tracks.position[keep]
    steps *= (1000.0 / scale)[owner[keep]][:, None, None]
    parts = np.array_split(steps, 1 + keep.size // ROWS_AT_ONCE)
    degrees = np.concatenate([_degrees(part) for part in parts])
    # Numbers on the grid may fall a step by the last bit of a float, there as here.
    np.trunc(steps, out=steps)
    steps *= grid[keep]
    played = Tracks(0.0, float(ends.max()), first, starts[keep], ends[keep], steps)
    sizes = 3 + 2 * degrees.sum(axis=1)
    stored = tuple(
        Stored(
            degrees[first[drone] : first[drone + 1]],
            int(scale[drone]),
            9 + int(sizes[first[drone] : first[drone + 1]].sum()),
        )
        for drone in range(tracks.drones)
    )
    return played, stored, notes


def _degrees(points: FloatArray) -> IntArray:
    """Degree in which the server stores each axis of each piece, shape (rows, 4)."""
    top = points.shape[1] - 1
    result = np.full((points.shape[0], 4), 0)
    straight = elevate(points[:, [0, -1]], top) if top > 1 else points
    still = np.all(points == points[:, :1], axis=1)
    even = np.all(np.abs(points - straight) < 1e-6, axis=1)
    higher = 3 if top <= 3 else 7
    result[:, :3] = np.where(still, 0, np.where(even, 1, higher))
    return result


_AT_ONCE, _NARROWINGS = 65, 9
"""Places of a piece that are looked at together, and how often the part between two of
them is looked at again: 64 to the ninth is all that float64 tells apart."""


def phases(tracks: Tracks, stored: tuple[Stored, ...], firmware: Firmware) -> Phases:
    """Work out when the firmware takes off and lands."""
    count = tracks.drones
    above, drift, passing = np.full(count, np.inf), np.zeros(count), np.zeros(count)
    landing, height = np.empty(count), np.empty(count)
    for drone in range(count):
        rows = slice(int(tracks.first[drone]), int(tracks.first[drone + 1]))
        body = tracks.position[rows]
        starts, ends = tracks.starts[rows], tracks.ends[rows]
        degrees = stored[drone].degrees
        solved = np.ones(starts.size, dtype=bool)
        # Pieces at the end that only fill up the time are constants.
        solved[: degrees.shape[0]] = degrees[:, 2] <= HIGHEST_SOLVED
        above[drone], passing[drone] = _first_touch(
            body[:, :, 2], starts, ends, solved, firmware
        )
        early = body[starts < min(above[drone], ends[-1])][:, :, :2] - body[0, 0, :2]
        drift[drone] = np.sqrt((early**2).sum(axis=2)).max(initial=0.0)
        landing[drone], height[drone] = _landing(body, starts, ends, solved, firmware)
    takeoff = above - firmware.climb_time - firmware.spool_up
    return Phases(above, passing, takeoff, landing, height, drift)


def _first_touch(
    height: FloatArray,
    starts: FloatArray,
    ends: FloatArray,
    solved: BoolArray,
    firmware: Firmware,
) -> tuple[float, float]:
    """When a height (rows, degree + 1) [m] first is at the take-off height [s].

    And how fast it rises there [m/s]; inf and 0: never.
    """
    target = height[0, 0] + firmware.takeoff_height
    low, high = height.min(axis=1), height.max(axis=1)
    for row in np.flatnonzero(
        (low <= target + 1e-9) & (high >= target - 1e-9) & solved
    ):
        share = _touch(height[row], target)
        if share is not None:
            width = float(ends[row] - starts[row])
            slope = (height.shape[1] - 1) * np.diff(height[row])[None, :, None] / width
            # A joint belongs to the piece that goes on from it.
            return float(starts[row] + share * width), float(
                values(slope, np.array([share]))[0, 0]
            )
    return np.inf, 0.0


def _touch(points: FloatArray, target: float) -> float | None:
    """Least fraction of a piece at which it has the value ``target``, if any."""
    low, high = 0.0, 1.0
    for narrowing in range(_NARROWINGS):
        fractions = np.linspace(low, high, _AT_ONCE)
        value = values(np.repeat(points[None, :, None], _AT_ONCE, axis=0), fractions)
        over = value[:, 0] - target
        if not narrowing:
            hit = fractions[np.abs(over) < 1e-9]
            change = np.flatnonzero(over[:-1] * over[1:] < 0.0)
            if hit.size and (not change.size or hit[0] <= fractions[change[0]]):
                return float(hit[0])
            if not change.size:
                return None
            rising, place = over[change[0]] < 0.0, int(change[0]) + 1
        else:
            place = max(int(np.argmax((over >= 0.0) == rising)), 1)
        low, high = fractions[place - 1], fractions[place]
    return float(high)


def _landing(
    body: FloatArray,
    starts: FloatArray,
    ends: FloatArray,
    solved: BoolArray,
    firmware: Firmware,
) -> tuple[float, float]:
    """When LAND is commanded [s], and how high above the last point [m]."""
    off = np.abs(body[:, -1, :2] - body[:, 0, :2]).max(axis=1)
    vertical = (off <= VERTICAL + 1e-9) & (body[:, -1, 2] <= body[:, 0, 2])
    broken = np.flatnonzero(~vertical)
    first = int(broken[-1]) + 1 if broken.size else 0
    last = float(body[-1, -1, 2])
    if first == starts.size:
        return float(ends[-1]), 0.0
    top = float(body[first, 0, 2])
    if top - last <= firmware.takeoff_height:
        return float(starts[first]), top - last
    target = last + firmware.takeoff_height
    row = first + int(np.flatnonzero(body[first:, -1, 2] <= target + 1e-9)[0])
    share = _touch(body[row, :, 2], target) if solved[row] else 0.0
    share = 0.0 if share is None else share
    at = values(body[row : row + 1], np.array([share]))[0, 2]
    return float(starts[row] + share * (ends[row] - starts[row])), float(at - last)


def what_it_becomes(show: ForeignShow, firmware: Firmware | None = None) -> list[Check]:
    """Say what makes the firmware refuse a show, take off late or land early."""
    firmware = firmware or Firmware()
    tracks, stored, notes = as_stored(show)
    found = phases(tracks, stored, firmware)
    checks = [
        _block(stored, notes),
        _takeoff(found, firmware),
        _waits(found, firmware),
        _climb(found, firmware),
        _passes(found, firmware),
        _lands(found, tracks, firmware),
        _stands(show, tracks, firmware),
    ]
    if any(isinstance(light, bytes) for light in show.lights):
        checks.append(_lights(show))
    return checks


def _block(stored: tuple[Stored, ...], notes: list[str]) -> Check:
    sizes = [one.block for one in stored]
    worst = int(np.argmax(sizes))
    scale = max(one.scale for one in stored)
    return Check(
        "VRF541",
        GROUP,
        "trajectory fits its block",
        "pass" if sizes[worst] <= LARGEST_BLOCK and scale <= 127 else "fail",
        float(sizes[worst]),
        float(LARGEST_BLOCK),
        "bytes",
        Place(drone=worst + 1),
        (f"positions are whole multiples of {scale} mm", *notes),
    )


def _takeoff(found: Phases, firmware: Firmware) -> Check:
    missing = np.flatnonzero(~np.isfinite(found.above))
    if missing.size:
        return Check(
            "VRF542",
            GROUP,
            "take-off height is found",
            "fail",
            where=Place(drone=int(missing[0]) + 1),
            notes=(
                (
                    f"{missing.size} drones never pass {firmware.takeoff_height:g} m "
                    "above their first point in a piece of degree 3 or less: the "
                    "firmware refuses the show"
                ),
            ),
        )
    worst = int(np.argmax(found.above))
    return Check(
        "VRF542",
        GROUP,
        "take-off height is found",
        "pass",
        float(found.above[worst]),
        None,
        "s",
        Place(drone=worst + 1),
    )


def _waits(found: Phases, firmware: Firmware) -> Check:
    known = np.where(np.isfinite(found.takeoff), found.takeoff, np.inf)
    worst = int(np.argmin(known))
    value = float(known[worst])
    bad = value < 0.0
    need = ceil(-value) if bad else 0
    return Check(
        "VRF543",
        GROUP,
        "motors start after the show does",
        "fail" if bad else ("skipped" if not np.isfinite(value) else "pass"),
        value if np.isfinite(value) else None,
        0.0,
        "s",
        Place(drone=worst + 1),
        (
            (
                f"the climb takes {firmware.climb_time:.2f} s and the motors "
                f"{firmware.spool_up:g} s: let the fleet wait {need} s longer"
            ),
        )
        if bad
        else (),
    )


def _held(breach: Check, values: FloatArray, times: FloatArray | None = None) -> Check:
    """Hold the greatest of the drones' values against a limit.

    Parameters
    ----------
    breach
        What is said where the limit is exceeded.
    values
        By drone, in the limit's unit.
    times
        When each drone has its value [s], if that says anything.
    """
    assert breach.limit is not None  # noqa: S101 - given
    worst = int(np.argmax(values))
    place = Place(drone=worst + 1)
    if times is not None and np.isfinite(times[worst]):
        place = replace(place, time=float(times[worst]))
    found = replace(breach, value=float(values[worst]), where=place)
    if values[worst] > breach.limit:
        return found
    return replace(found, verdict="pass", notes=())


def _climb(found: Phases, firmware: Firmware) -> Check:
    name = f"file climbs straight to {firmware.takeoff_height:g} m"
    note = "the vehicle climbs straight up while the file moves sideways"
    breach = Check(
        "VRF544", GROUP, name, "fail", limit=VERTICAL, unit="m", notes=(note,)
    )
    return _held(breach, found.drift, found.above)


def _passes(found: Phases, firmware: Firmware) -> Check:
    """Whether the vehicle, which stops at the take-off height, falls behind there."""
    name = f"speed at which the file passes {firmware.takeoff_height:g} m"
    note = (
        "the vehicle's own climb ends standing at that height: at 2 m/s it was 0.7 m "
        "behind its file at once, and on it again after 1.2 s"
    )
    breach = Check(
        "VRF548", GROUP, name, "warning", limit=PASSED, unit="m/s", notes=(note,)
    )
    return _held(breach, found.passing, found.above)


def _lands(found: Phases, tracks: Tracks, firmware: Firmware) -> Check:
    ends = tracks.ends[tracks.first[1:] - 1]
    high = int(np.argmax(found.landing_height))
    value = float(found.landing_height[high])
    limit = firmware.takeoff_height
    late = np.isfinite(found.takeoff) & (found.landing < found.takeoff)
    early = np.flatnonzero(late)
    if early.size:
        return Check(
            "VRF545",
            GROUP,
            "landing follows the take-off",
            "fail",
            float(found.landing[early[0]]),
            float(found.takeoff[early[0]]),
            "s",
            Place(drone=int(early[0]) + 1),
            ("the firmware refuses the show",),
        )
    notes = [
        f"LAND is commanded {float((ends - found.landing).max()):.2f} s before the end"
    ]
    low = int(np.argmin(found.landing_height))
    if found.landing_height[low] < limit - 0.5:
        notes.append(
            f"drone {low + 1}: only {found.landing_height[low]:.2f} m of the descent "
            "are vertical"
        )
    return Check(
        "VRF545",
        GROUP,
        "LAND is commanded near the ground",
        "pass" if value <= limit + 0.01 else "fail",
        value,
        limit,
        "m",
        Place(drone=high + 1, time=float(found.landing[high])),
        tuple(notes),
    )


def _stands(show: ForeignShow, tracks: Tracks, firmware: Firmware) -> Check:
    """Whether drones stand where their files begin."""
    name = "drones stand at their first points"
    if show.home is None:
        return Check(
            "VRF546", GROUP, name, "skipped", notes=("the file does not say where",)
        )
    first = tracks.position[tracks.first[:-1], 0]
    off = np.sqrt(((first - show.home)[:, :2] ** 2).sum(axis=1))
    limit = firmware.takeoff_error
    return _held(Check("VRF546", GROUP, name, "fail", limit=limit, unit="m"), off)


def _lights(show: ForeignShow) -> Check:
    """Whether light programs are sound, and as long as the flight."""
    name = "light programs are sound"
    done: set[bytes] = set()
    budget, until = Budget.of(show.lights), min(show.duration, 600.0)
    for drone, program in enumerate(show.lights):
        if not isinstance(program, bytes) or program in done:
            continue
        if len(program) > LARGEST_BLOCK:
            size, most = float(len(program)), float(LARGEST_BLOCK)
            return Check("VRF547", GROUP, name, "fail", size, most, "bytes")
        if len(done) >= _LIGHTS_JUDGED:
            break
        done.add(program)
        try:
            read_lights(program, show.names[drone], until, budget)
        except DamagedFileError as error:
            return Check(
                "VRF547",
                GROUP,
                name,
                "fail",
                where=Place(drone=drone + 1),
                notes=(str(error),),
            )
    return Check("VRF547", GROUP, name, "pass", notes=(f"{len(done)} different ones",))
