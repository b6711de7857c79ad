"""What the autopilots will make of the missions, proved again from the files' bytes.

Drones fly straight lines from place to place, and beyond their ends by the overshoot at
most. A line is a polynomial of degree 1, so that the kernel's proof of the fence holds
for it, concave fences included.
"""

from __future__ import annotations

from datetime import UTC, datetime
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.verify.kernel.fence import RESOLUTION as TOUCHES
from showc.verify.kernel.fence import enclosed
from showc.verify.kernel.show import xyz
from showc.verify.missions.language import MissionFormatError
from showc.verify.missions.law import CLOCK_LAG, FIRMWARE, SETTLING, SPREAD
from showc.verify.missions.legs import DAY, HOUR, Clock
from showc.verify.missions.separation import (
    RESOLUTION,
    Nearest,
    OverlappingLegsError,
    nearest_timed,
    nearest_untimed,
)
from showc.verify.report import Place, agreement, checked
from showc.verify.specification.compare import unlike

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from showc.arrays import FloatArray, IntArray
    from showc.log.showc_pb2 import Site
    from showc.script.show import Show
    from showc.verify.kernel.show import LoggedShow
    from showc.verify.missions.legs import FleetLegs
    from showc.verify.report import Check, Verdict
    from showc.verify.specification.demands import Move


ROUNDING = 0.02
"""How far off a stored place may be, and how much nearer two places [m]."""

AGREEMENT = 0.01
"""How far the manifest's nearest encounter may be off: both have their resolutions,
and delays are written in whole milliseconds [m]."""

PLACE_RESOLUTION = np.array([0.0112, 0.0112, 0.012])
"""1e-7 degrees, level, and a centimetre with the 2 mm that keep it, upright [m]."""

LIFT_OFF = 0.9
"""Time from the start of a mission to leaving the ground, once armed [s]."""

SPIN_UP = 3.25
"""By how much that may be longer, if a vehicle is armed straight before [s]."""

_PREDICTED = {
    *("start_minute", "latest_mission_start", "duration", "delay", "launch", "legs"),
    *("land", "land_start"),
}
"""Keys of a prediction, besides those whose values are known."""

_LEG = {
    *("leg", "name", "encoding", "slots", "durations", "slot", "duration", "drones"),
    *("optimal_start", "optimal_duration", "delays", "arrivals", "ended", "closest"),
    *("position_difference", "arrival_difference"),
}
"""Keys of a leg of a prediction."""

TICK = 0.1
"""Slots are whole multiples of this [s]."""

SAME = 1e-3
"""Times that differ by less are the same: slots are written in milliseconds [s]."""


def mission_clock(described: Mapping[str, Any]) -> Clock:
    """Return what slots count from, by what the manifest says of the missions.

    Raises
    ------
    MissionFormatError
        If it names neither a start of whole seconds nor a minute.
    """
    start = described.get("start")
    prediction = described.get("prediction")
    minute = prediction.get("start_minute") if isinstance(prediction, dict) else None
    if start is None and type(minute) is int and 0 <= minute < 60:
        return Clock(60.0 * minute, HOUR)
    try:
        moment = datetime.fromisoformat(start) if isinstance(start, str) else None
        moment = None if moment is None else moment.astimezone(UTC)
    except (ValueError, OverflowError):
        moment = None
    if moment is None or moment.microsecond:
        raise MissionFormatError("the manifest names no start of the missions")
    return Clock(3600.0 * moment.hour + 60.0 * moment.minute + moment.second, DAY)


def check_flight(
    fleet: FleetLegs,
    show: LoggedShow,
    described: Mapping[str, Any],
    script: Show,
    logged: list[Move],
) -> list[Check]:
    """Prove what ArduCopter will make of a fleet's missions.

    ``described`` is what the manifest says of them; they are to fly the moves
    ``logged``, with the slack that the script asks for after the latest end of a leg.
    """
    rules = show.rules
    ends, reached = _check_ends(fleet, show, logged)
    checks = [
        ends,
        _check_slots(fleet, reached, logged, script),
        *_boundaries(fleet, rules.site),
    ]
    if fleet.drones < 2:
        note = "one drone flies alone"
        alone = checked("VRF411", "pass", notes=(note,))
        return [*checks, alone, _as_claimed({}, fleet, show, described, logged)]
    wanted = rules.separation
    try:
        timed = nearest_timed(fleet, wanted)
    except OverlappingLegsError as error:
        note = f"{error} is released before the leg before it has surely ended"
        place = Place(error.drone + 1)
        return [*checks, checked("VRF411", "fail", where=place, notes=(note,))]
    nearest = {
        "legs": timed,
        "launch": nearest_untimed(fleet, wanted, landing=False),
        "land": nearest_untimed(fleet, wanted, landing=True),
    }
    for code, key in (("VRF411", "legs"), ("VRF412", "launch"), ("VRF413", "land")):
        checks.append(_apart(code, nearest[key], wanted.distance))
    return [*checks, _as_claimed(nearest, fleet, show, described, logged)]


def _check_ends(
    fleet: FleetLegs, show: LoggedShow, logged: list[Move]
) -> tuple[Check, IntArray]:
    """Whether each mission visits the ends of its drone's moves in order.

    Also returns which leg each move of each drone ends, (drones, moves); -1 where that
    was not found, and for the moves of others.
    """
    found = np.full((fleet.drones, len(logged)), -1)
    stops = np.full((fleet.drones, 1 + len(logged), 3), np.nan)
    stops[:, 0] = show.segments[0].ends()[0][:, :3]
    for number, move in enumerate(logged, 1):
        stops[move.drones, number] = move.goals
    worst, where, note = 0.0, 0, ""
    for drone, (first, end) in enumerate(pairwise(fleet.first.tolist())):
        own = np.flatnonzero(np.isfinite(stops[drone, :, 0]))
        places = np.concatenate([fleet.begin[[first]], fleet.end[first:end]])
        visited, off = _visits(places, stops[drone, own])
        found[drone, own[1 : len(visited)] - 1] = np.array(visited[1:]) + first - 1
        if visited[:1] != [0]:
            note = "no item flies to the pad in its turn"
        elif len(visited) < own.size:
            name = logged[own[len(visited)] - 1].name
            note = f"no item flies to the end of “{name}” in its turn"
        elif visited[-1] != end - first:
            note = "flies on after its landing in the log"
        if note or off > worst:
            worst, where = off, drone
        if note:
            break
    visits = np.count_nonzero(found >= 0)
    seen = f"{visits:,} places, to 1e-7 degrees and 1.2 cm of height"
    check = checked(
        "VRF404",
        "fail" if note else "pass",
        worst,
        1.0,
        "of the resolution",
        where=Place(where + 1),
        notes=(note or seen,),
    )
    return check, found


def _visits(places: FloatArray, stops: FloatArray) -> tuple[list[int], float]:
    """Which of ``places`` (n, 3) [m] are stops (m, 3), in order, up to one that is not.

    Also returns how far off the worst is, over what the format stores.
    """
    found, worst = [0], 0.0
    for stop in stops:
        off = np.abs(places[found[-1] :] - stop) / PLACE_RESOLUTION
        ratio = off.max(axis=1)
        fits = np.flatnonzero(ratio <= 1.0)
        if not fits.size:
            return found[1:], float(ratio.min(initial=np.inf))
        found.append(found[-1] + int(fits[0]))
        worst = max(worst, float(ratio[fits[0]]))
    return found[1:], worst


def _climbs(fleet: FleetLegs) -> FloatArray:
    """Likely time of each drone's take-off and climb, shape (drones,) [s]."""
    likely, first = fleet.profiles.followed(0.0), fleet.first[:-1]
    return LIFT_OFF + likely[first] + likely[first + 1]


def _check_slots(
    fleet: FleetLegs, reached: IntArray, logged: list[Move], script: Show
) -> Check:
    """Whether each drone reaches its slots in time, and none waits for nothing.

    The latest end of a leg, with the spread of its delay and the lag of the clock, lies
    ``pause`` [s] before the next slot; what the log holds is held. The fleet as a whole
    waits no longer than that, so no slot is an hour late.
    """
    flights, timed = fleet.profiles, np.flatnonzero(fleet.timed)
    pause, holds = max(script.mission.slack, SETTLING), [one.held for one in logged]
    held = np.zeros(fleet.release.size)
    held[reached] = np.where(reached < 0, 0.0, holds)
    free = fleet.release + np.maximum(
        flights.followed(flights.late) + CLOCK_LAG + pause,
        flights.followed(0.0) + 0.5 * CLOCK_LAG + held,
    )
    climbed = _climbs(fleet) + 2.0 * SPREAD + pause
    free[fleet.first[:-1] + 1] = climbed
    spare = fleet.release[timed] - free[timed - 1]
    worst, where = float(spare.min(initial=np.inf)), Place()
    if timed.size:
        leg = timed[int(np.argmin(spare))]
        where = Place(int(fleet.owner[leg]) + 1, time=float(fleet.release[leg]))
    # How long no drone needs before a slot: all had climbed, or were free before it.
    order = timed[np.argsort(fleet.release[timed], kind="stable")]
    before = np.maximum.accumulate([float(climbed.max()), *free[order]])[:-1]
    idle = fleet.release[order] - before
    longest = float(idle.max(initial=0.0))
    # Holds of formations, colours that change while no drone moves, and times to come.
    ends = [0.0, *(one.start + one.duration for one in logged)]
    waits = [one - before for before, one in pairwise(sorted(ends))]
    patience = max(waits) + 2.0 * TICK + SPIN_UP
    note = f"{timed.size:,} slots, at least {pause:g} s after the latest end"
    value = worst if timed.size else 0.0
    verdict: Verdict = "pass"
    if not worst >= -SAME:
        line, verdict = fleet.lines[leg - 1], "fail"
        note = f"released {-worst:.2f} s too early after line {line}"
    elif not longest <= patience:
        value, verdict = -longest, "fail"
        where = Place(time=float(fleet.release[order[int(np.argmax(idle))]]))
        note = f"no drone flies for {longest:.1f} s longer than slots need"
    return checked("VRF408", verdict, value, 0.0, "s", where=where, notes=(note,))


def _boundaries(fleet: FleetLegs, site: Site) -> Iterator[Check]:
    """Hold all lines against walls and fence, with what is flown beyond their ends.

    Lines keep the fence's margin, from the walls where these are the fence; what is
    flown beyond their ends may use it up.
    """
    excess = fleet.profiles.excess.copy()
    # A landing ends on the ground.
    excess[fleet.first[1:] - 1] = 1.0
    beyond = fleet.begin + excess[:, None] * (fleet.end - fleet.begin)
    low, high, margin = xyz(site.volume_min), xyz(site.volume_max), site.fence_margin
    inset = np.array([0.0 if len(site.fence) else margin] * 2 + [0.0])
    spare = [
        (np.minimum(places - low, high - places) - less).min(axis=1)
        for places, less in ((fleet.begin, inset), (fleet.end, inset), (beyond, 0.0))
    ]
    nearest = np.min(spare, axis=0)
    leg = int(np.argmin(nearest))
    yield _boundary("VRF415", fleet, float(nearest[leg]), leg)
    if not len(site.fence):
        return
    fence, found = np.array(site.fence).reshape(-1, 2), []
    for begin, end, less in (
        (fleet.begin, fleet.end, margin),
        (fleet.end, beyond, 0.0),
    ):
        lines = np.stack([begin[:, :2], end[:, :2]], axis=1)
        lower, leg = enclosed(lines, fence)
        found.append((lower - less if lower >= TOUCHES else -np.inf, leg))
    yield _boundary("VRF416", fleet, *min(found))


def _boundary(code: str, fleet: FleetLegs, spare: float, leg: int) -> Check:
    note = f"with what is flown beyond the ends of legs, to {ROUNDING:g} m of rounding"
    return checked(
        code,
        "pass" if spare >= -ROUNDING else "fail",
        spare,
        0.0,
        "m to spare",
        where=Place(int(fleet.owner[leg]) + 1),
        notes=(f"tightest on the way to the place of line {fleet.lines[leg]}", note),
    )


def _apart(code: str, found: Nearest, wanted: float) -> Check:
    if found.distance == np.inf:
        return checked(code, "pass", notes=("no drone moves on time",))
    limit = wanted - ROUNDING - 3.0 * RESOLUTION
    bound = found.distance - RESOLUTION
    note = (
        f"{wanted:g} m less {100.0 * ROUNDING:g} cm of the format's rounding and "
        f"{3000.0 * RESOLUTION:g} mm of the proofs' resolution"
    )
    where = Place(
        pair=(found.pair[0] + 1, found.pair[1] + 1),
        time=found.time if found.time > 0.0 else None,
    )
    verdict: Verdict = "pass" if bound >= limit else "fail"
    return checked(code, verdict, bound, limit, "m", where=where, notes=(note,))


def _as_claimed(
    nearest: Mapping[str, Nearest],
    fleet: FleetLegs,
    show: LoggedShow,
    described: Mapping[str, Any],
    logged: list[Move],
) -> Check:
    """Hold what the manifest predicts against what was found here.

    ``nearest`` are the nearest encounters of the ``legs``, the ``launch``, the
    ``land``.
    """
    said: Any = described.get("prediction")
    start, timed = described.get("start"), logged[1:-1]
    try:
        keys = _LEG if start is None else _LEG | {"slots_utc"}
        legs = [*said["legs"], *[{}] * len(timed)]
        # What is free stands here as it is said.
        wanted = {key: said.get(key) for key in _PREDICTED} | {
            "firmware": FIRMWARE,
            "clock": "hour" if start is None else "UTC",
            "start": start,
            "delay_spread": SPREAD,
            "clock_lag": CLOCK_LAG,
            "required_separation": show.rules.separation.distance,
            "legs": [
                {key: leg.get(key) for key in keys}
                | {"leg": move.segment, "name": move.name}
                for leg, move in zip(legs, timed, strict=False)
            ],
        }
        wrong = list(unlike(said, wanted, "prediction", rounding=0.0))
        # Until when a mission may start, and reach its first slot.
        first = fleet.filled(fleet.release, np.inf)[:, 0]
        latest = float((first - _climbs(fleet)).min())
        if not (said["latest_mission_start"] or 0.0) <= latest:
            wrong.append(f"prediction.latest_mission_start is after {latest:.3f} s")
        met = [leg["closest"] for leg in said["legs"] if leg["closest"] is not None]
        claimed = {
            "launch": said["launch"],
            "land": said["land"],
            "legs": min(met, key=lambda one: one["distance"], default=None),
        }
        for key, one in nearest.items():
            close, found = claimed[key], one.distance
            near = np.inf if close is None else float(close["distance"])
            if near != found and not abs(near - found) <= AGREEMENT:
                wrong.append(f"prediction.{key}: nearest are {near} m, not {found} m")
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError):
        wrong = ["the prediction is nothing that can be read"]
    return agreement("VRF414", wrong)
