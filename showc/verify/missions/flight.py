"""What the autopilots will make of the missions, proved again from the files' bytes."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.verify.missions.language import MissionFormatError
from showc.verify.missions.law import CLOCK_LAG, SETTLING, SPREAD
from showc.verify.missions.legs import DAY, HOUR, Clock
from showc.verify.missions.separation import (
    RESOLUTION,
    Nearest,
    OverlappingLegsError,
    nearest_timed,
    nearest_untimed,
)
from showc.verify.missions.space import ROUNDING as BOUNDARY
from showc.verify.missions.space import Inside, inside_fence, inside_volume
from showc.verify.missions.terms import FIRMWARE
from showc.verify.report import Check, Place, Verdict

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from showc.arrays import FloatArray
    from showc.verify.kernel.show import LoggedShow
    from showc.verify.missions.legs import MissionLegs


GROUP = "missions"

APART = "predicted flights keep the separation at every delay"

CLAIMED = "predicted flights as near as the manifest says"

ENDS = "missions end their legs where the trajectory does"

SLOTS = "slots leave time for every leg and hold, and no more"

VOLUME, FENCE = "missions stay in the flight volume", "missions stay inside the fence"

ROUNDING = 0.02
"""How much nearer two places can be by the mission's rounding [m]."""

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
    missions: Sequence[MissionLegs],
    show: LoggedShow,
    described: Mapping[str, Any],
    slack: float,
) -> list[Check]:
    """Prove what ArduCopter will make of a fleet's missions.

    Parameters
    ----------
    missions
        Of every drone.
    show
        The log's rules and segments.
    described
        What the manifest says of the missions.
    slack
        What slots leave after the latest end of a leg, by the script [s].
    """
    rules = show.rules
    ends, stops = _check_ends(missions, show)
    checks = [
        ends,
        _check_slots(missions, stops, show, max(slack, SETTLING)),
        _boundary("VRF415", VOLUME, inside_volume(missions, rules.site)),
    ]
    fenced = inside_fence(missions, rules.site)
    if fenced is not None:
        checks.append(_boundary("VRF416", FENCE, fenced))
    if len(missions) < 2:
        note = "one drone flies alone"
        alone = Check("VRF411", GROUP, APART, "pass", notes=(note,))
        return [*checks, alone, _as_claimed({}, missions, show, described)]
    wanted = rules.separation
    try:
        timed = nearest_timed(missions, wanted)
    except OverlappingLegsError as error:
        note = f"{error} is released before the leg before it has surely ended"
        place = Place(error.drone + 1)
        return [
            *checks,
            Check("VRF411", GROUP, APART, "fail", where=place, notes=(note,)),
        ]
    checks.append(_verdict("VRF411", APART, timed, wanted.distance))
    nearest: dict[str, Nearest | None] = {"legs": timed}
    for code, key, name in (
        ("VRF412", "launch", "take-off"),
        ("VRF413", "land", "landing"),
    ):
        nearest[key] = nearest_untimed(missions, wanted, landing=key == "land")
        text = f"{name} keeps the separation at any timing"
        checks.append(_verdict(code, text, nearest[key], wanted.distance))
    return [*checks, _as_claimed(nearest, missions, show, described)]


def _check_ends(
    missions: Sequence[MissionLegs], show: LoggedShow
) -> tuple[Check, list[list[int]]]:
    """Whether each mission visits the ends of its drone's moves in order.

    Also returns which places of each mission those are, as far as they were found.
    """
    moves = [segment for segment in show.segments if not segment.holds]
    ends = [moves[0].ends()[0], *(move.ends()[1] for move in moves)]
    names = ["the pad", *(f"the end of “{move.message.name}”" for move in moves)]
    worst, where, note, found = 0.0, Place(), "", list[list[int]]()
    for drone, mission in enumerate(missions):
        stops = np.stack([one[drone, :3] for one in ends])
        off = np.abs(mission.places[None] - stops[:, None]) / PLACE_RESOLUTION
        rows: list[int] = []
        for name, ratio in zip(names, off.max(axis=2), strict=True):
            at = rows[-1] if rows else 0
            fits = np.flatnonzero(ratio[at:] <= 1.0)
            # The pad is the first place, and the last one is the landing.
            if not fits.size or (not rows and fits[0] > 0):
                worst, where = float(ratio[at:].min(initial=np.inf)), Place(drone + 1)
                note = f"no item flies to {name} in its turn"
                break
            rows.append(at + int(fits[0]))
            worst = max(worst, float(ratio[rows[-1]]))
        else:
            if rows[-1] != len(mission.places) - 1:
                worst, where = np.inf, Place(drone + 1)
                note = "flies on after its landing in the log"
        found.append(rows)
        if note:
            break
    places = f"{sum(map(len, found)):,} places, to 1e-7 degrees and 1.2 cm of height"
    verdict: Verdict = "fail" if note or len(found) != len(missions) else "pass"
    unit, notes = "of the resolution", (note or places,)
    return Check("VRF404", GROUP, ENDS, verdict, worst, 1.0, unit, where, notes), found


def _holds(show: LoggedShow) -> FloatArray:
    """For how long the fleet is held after each move of the log, shape (n,) [s]."""
    found: list[float] = []
    for segment in show.segments:
        if not segment.holds:
            found.append(0.0)
        elif found:
            found[-1] += segment.duration
    return np.array(found)


def _check_slots(
    missions: Sequence[MissionLegs],
    stops: Sequence[list[int]],
    show: LoggedShow,
    pause: float,
) -> Check:
    """Whether each drone reaches its slots in time, and none waits for nothing.

    The latest end of a leg, with the spread of its delay and the lag of the clock, lies
    ``pause`` [s] before the next slot; what the log holds is held. The fleet as a whole
    waits no longer than that, so no slot is an hour late.
    """
    worst, where, note = np.inf, Place(), ""
    legs, climbed, holds = [], 0.0, _holds(show)
    for drone, (mission, own) in enumerate(zip(missions, stops, strict=False)):
        surely = mission.profiles.followed(mission.profiles.late)
        likely = mission.profiles.followed(0.0)
        held = np.zeros(mission.release.size)
        ended = np.array(own[1:], dtype=np.int64)
        held[ended - 1] = holds[: ended.size]
        free = LIFT_OFF + float(likely[:2].sum()) + 2.0 * SPREAD + pause
        climbed, line = max(climbed, free), int(mission.lines[1])
        for leg in np.flatnonzero(np.isfinite(mission.release)).tolist():
            release = float(mission.release[leg])
            if release - free < worst:
                worst, where = release - free, Place(drone + 1, time=release)
                note = f"released {free - release:.2f} s too early after line {line}"
            free = release + max(
                float(surely[leg]) + CLOCK_LAG + pause,
                float(likely[leg]) + 0.5 * CLOCK_LAG + float(held[leg]),
            )
            legs.append((release, free))
            line = int(mission.lines[leg])
    idle, moment = _longest_idle(legs, climbed)
    # Holds of formations, and colours that change while no drone moves.
    patience = max(one.duration for one in show.segments) + 2.0 * TICK + SPIN_UP
    if worst < -SAME:
        return _slots_fail(worst, where, note)
    if not idle <= patience:
        text = f"no drone flies for {idle:.1f} s longer than slots need"
        return _slots_fail(-idle, Place(time=moment), text)
    notes = (f"{len(legs):,} slots, at least {pause:g} s after the latest end",)
    found = worst if np.isfinite(worst) else 0.0
    return Check("VRF408", GROUP, SLOTS, "pass", found, 0.0, "s", where, notes)


def _slots_fail(value: float, where: Place, note: str) -> Check:
    return Check("VRF408", GROUP, SLOTS, "fail", value, 0.0, "s", where, (note,))


def _longest_idle(
    legs: list[tuple[float, float]], climbed: float
) -> tuple[float, float]:
    """Longest time that no drone needs before a slot, and when it ends [s].

    From ``legs`` (release, when the drone was free after it), and when all had
    ``climbed`` [s].
    """
    idle, moment, free = 0.0, 0.0, climbed
    for release, after in sorted(legs):
        if release - free > idle:
            idle, moment = release - free, release
        free = max(free, after)
    return idle, moment


def _boundary(code: str, name: str, found: Inside) -> Check:
    note = f"with what is flown beyond the ends of legs, to {BOUNDARY:g} m of rounding"
    return Check(
        code,
        GROUP,
        name,
        "pass" if found.spare >= -BOUNDARY else "fail",
        found.spare,
        0.0,
        "m to spare",
        Place(found.drone + 1),
        (f"tightest on the way to the place of line {found.line}", note),
    )


def _verdict(code: str, name: str, found: Nearest | None, wanted: float) -> Check:
    if found is None:
        return Check(code, GROUP, name, "pass", notes=("no drone moves on time",))
    limit = wanted - ROUNDING - 3.0 * RESOLUTION
    bound = found.distance - RESOLUTION
    verdict: Verdict = "pass" if bound >= limit else "fail"
    note = (
        f"{wanted:g} m less {100.0 * ROUNDING:g} cm of the format's rounding and "
        f"{3000.0 * RESOLUTION:g} mm of the proofs' resolution"
    )
    pair = found.pair[0] + 1, found.pair[1] + 1
    place = Place(pair=pair, time=found.time if found.time > 0.0 else None)
    return Check(code, GROUP, name, verdict, bound, limit, "m", place, (note,))


def _as_claimed(
    found: Mapping[str, Nearest | None],
    missions: Sequence[MissionLegs],
    show: LoggedShow,
    described: Mapping[str, Any],
) -> Check:
    """Hold what the manifest predicts against what was found here.

    ``found`` are the nearest encounters of the ``legs``, the ``launch``, the ``land``.
    """
    said: Any = described.get("prediction")
    start = described.get("start")
    wanted = {
        "firmware": FIRMWARE,
        "clock": "hour" if start is None else "UTC",
        "start": start,
        "delay_spread": SPREAD,
        "clock_lag": CLOCK_LAG,
        "required_separation": show.rules.separation.distance,
    }
    names = {(one.message.index, one.message.name) for one in show.segments}
    keys = _LEG if start is None else _LEG | {"slots_utc"}
    try:
        bad = [key for key, value in wanted.items() if said[key] != value]
        bad += ["keys"] if said.keys() != wanted.keys() | _PREDICTED else []
        bad += [
            f"leg {leg['leg']}"
            for leg in said["legs"]
            if leg.keys() != keys or (leg["leg"], leg["name"]) not in names
        ]
        latest = said["latest_mission_start"]
        if latest is not None and not latest <= _latest_start(missions):
            bad.append("latest_mission_start")
        near = {
            "launch": said["launch"],
            "land": said["land"],
            "legs": min(
                (leg["closest"] for leg in said["legs"] if leg["closest"] is not None),
                key=lambda one: one["distance"],
                default=None,
            ),
        }
        off = [
            abs(
                (np.inf if near[key] is None else float(near[key]["distance"]))
                - (np.inf if one is None else one.distance)
            )
            for key, one in found.items()
            if (near[key], one) != (None, None)
        ]
    except (KeyError, TypeError, ValueError, AttributeError):
        bad, off = ["nothing that can be read"], []
    worst = max(off, default=0.0)
    verdict: Verdict = "pass" if worst <= AGREEMENT and not bad else "fail"
    notes = (f"not as it must be: {', '.join(bad)}",) if bad else ()
    return Check("VRF414", GROUP, CLAIMED, verdict, worst, AGREEMENT, "m", notes=notes)


def _latest_start(missions: Sequence[MissionLegs]) -> float:
    """Mission time until which a mission may start and reach its first slot [s]."""
    found = []
    for mission in missions:
        climbed = LIFT_OFF + float(mission.profiles.followed(0.0)[:2].sum())
        first = mission.release[np.isfinite(mission.release)]
        found.append(float(first.min(initial=np.inf)) - climbed)
    return min(found, default=np.inf)
