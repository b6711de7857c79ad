"""What the autopilots will make of the missions, proved again from the files' bytes."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.verify.crew import run_all
from showc.verify.drawn import check_drawn
from showc.verify.legs import MissionRows, fly_rows, read_parameters, read_rows
from showc.verify.predicted import (
    RESOLUTION,
    Nearest,
    nearest_timed,
    nearest_untimed,
)
from showc.verify.report import Check, Place, Verdict
from showc.verify.stretches import OverlappingLegsError
from showc.verify.waypoints import MissionFormatError, parse

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from showc.log import showc_pb2 as pb
    from showc.verify.kernel.show import LoggedShow
    from showc.verify.logfile import LogFile

GROUP = "missions"

NAME = "predicted flights keep the separation at every delay"

CLAIMED = "predicted flights as near as the manifest says"

ROUNDING = 0.02
"""How much nearer two places can be by the mission's rounding [m]."""

AGREEMENT = 0.01
"""How far the manifest's nearest encounter may be off: both have their resolutions,
and delays are written in whole milliseconds [m]."""

UNCLOCKED = (
    "only for legs released together: these missions wait for no clock, and nothing "
    "but equal starts keeps the drones together"
)
"""What the proof does not say of missions without a start time."""

PARAMETERS = "missions/ardupilot.parm"


def check_mission_flight(
    folder: Path,
    missions: Mapping[int, str],
    description: Mapping[str, Any],
    rules: pb.Rules,
    *,
    drawn: tuple[LogFile, LoggedShow] | None = None,
    jobs: int | None = 1,
) -> list[Check]:
    """Prove the separation of the flights that the autopilots will make.

    Parameters
    ----------
    folder
        Where the files lie.
    missions
        Mission file of each drone, counting from 0, relative to ``folder``.
    description
        What the manifest says of the missions: ``autopilot`` and ``prediction``.
    rules
        Site and separation, from the log.
    drawn
        The log, if the predicted fleet that it draws is to be checked too.
    jobs
        Processes to share the work; None: one for each core.
    """
    if description.get("autopilot") != "ardupilot":
        note = "how this autopilot flies a leg is not known: nothing is predicted"
        return [Check("VRF411", GROUP, NAME, "skipped", notes=(note,))]
    where = Place(file=f"{folder.name}/{PARAMETERS}")
    try:
        values = read_parameters((folder / PARAMETERS).read_bytes())
        rows: list[MissionRows] = []
        for drone in sorted(missions):
            where = Place(drone + 1, file=f"{folder.name}/{missions[drone]}")
            items = parse((folder / missions[drone]).read_bytes())
            rows.append(read_rows(items, rules.site, values))
        fleet = fly_rows(rows, values)
    except (OSError, MissionFormatError, ValueError, IndexError) as error:
        return [Check("VRF411", GROUP, NAME, "fail", where=where, notes=(str(error),))]
    flown = fleet.missions
    if len(flown) < 2:
        return [Check("VRF411", GROUP, NAME, "pass", notes=("one drone flies alone",))]
    wanted = rules.separation
    work: list[Callable[[], Any]] = [
        partial(nearest_timed, flown, wanted),
        partial(nearest_untimed, flown, wanted, landing=False),
        partial(nearest_untimed, flown, wanted, landing=True),
    ]
    if drawn is not None:
        begin = _start_of_day(description) if description.get("start") else None
        work.append(partial(check_drawn, *drawn, fleet, begin))
    try:
        timed, climb, land, *rest = run_all(work, jobs)
    except OverlappingLegsError as error:
        note = f"{error} is released before the leg before it has surely ended"
        place = Place(error.drone + 1)
        return [Check("VRF411", GROUP, NAME, "fail", where=place, notes=(note,))]
    if timed is not None:
        timed = replace(timed, time=timed.time - _start_of_day(description))
    checks = [_verdict("VRF411", NAME, timed, wanted.distance)]
    if not any(kind == "clock" for mission in rows for kind, _ in mission.waits):
        loose = (*checks[0].notes, UNCLOCKED)
        checks = [replace(checks[0], notes=loose)]
    checks += [
        _verdict(
            code, f"{name} keeps the separation at any timing", found, wanted.distance
        )
        for code, name, found in (
            ("VRF412", "take-off", climb),
            ("VRF413", "landing", land),
        )
    ]
    return [*checks, _as_claimed(timed, description), *rest]


def _start_of_day(description: Mapping[str, Any]) -> float:
    """Seconds of the UTC day at which the missions begin; 0 without a clock."""
    start = description.get("start")
    try:
        moment = datetime.fromisoformat(str(start)) if start else None
    except ValueError:
        moment = None
    if moment is None:
        return 0.0
    moment = moment.astimezone(UTC)
    return 3600.0 * moment.hour + 60.0 * moment.minute + moment.second


def _verdict(code: str, name: str, found: Nearest | None, wanted: float) -> Check:
    if found is None:
        return Check(code, GROUP, name, "pass", notes=("nobody moves on time",))
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


def _as_claimed(found: Nearest | None, description: Mapping[str, Any]) -> Check:
    """Hold the manifest's own nearest encounter against what was found here."""
    prediction = description.get("prediction")
    legs = prediction.get("legs") if isinstance(prediction, dict) else None
    try:
        claims = [
            float(leg["closest"]["distance"])
            for leg in legs or []
            if leg.get("closest") is not None
        ]
    except (KeyError, TypeError, ValueError, AttributeError):
        note = "the manifest's prediction cannot be read"
        return Check("VRF414", GROUP, CLAIMED, "fail", notes=(note,))
    claimed = min(claims, default=np.inf)
    actual = np.inf if found is None else found.distance
    off = 0.0 if claimed == actual else abs(claimed - actual)
    verdict: Verdict = "pass" if off <= AGREEMENT else "fail"
    return Check("VRF414", GROUP, CLAIMED, verdict, off, AGREEMENT, "m")
