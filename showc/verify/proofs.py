"""All proofs of one log: physics, limits, separation, choreography, missions."""

from __future__ import annotations

import math
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.verify.certificates import check_certificates
from showc.verify.choreography import check_choreography
from showc.verify.crew import run_all
from showc.verify.damage import Damage
from showc.verify.decode import read_show
from showc.verify.limits import TOLERANCE, Extreme, extremes
from showc.verify.missions import check_attachments, mission_parts
from showc.verify.physics import Deviation, Replay, replay
from showc.verify.report import Check, Place, Verification
from showc.verify.samples import (
    GRIDS,
    check_other_samples,
    fleet_parts,
    join_samples,
)
from showc.verify.schemas import check_schemas
from showc.verify.separation import (
    RESOLUTION,
    Encounter,
    closest_of,
    encounter_parts,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from showc.log import showc_pb2 as pb
    from showc.verify.kernel.show import LoggedShow, Segment
    from showc.verify.logfile import LogFile
    from showc.verify.progress import Progress

POSITION_ERROR = 1e-3
"""Greatest deviation of the flown controls from the logged positions [m]."""

ATTITUDE_ERROR = math.radians(0.01)
"""Greatest deviation of the flown controls from the logged attitude [rad]."""

SEPARATION_TOLERANCE = 1e-6
"""How far the separation may be missed: rounding, not flight [m]."""

BEGUN = (
    *("missions", "others", "segments", "separation"),
    *("certificates", "choreography", "samples"),
)
"""Kinds of work, those with the longest parts first."""


def prove(
    log: LogFile,
    watch: Progress,
    flight: Callable[[], list[Check]] | None,
    *,
    missions: bool,
    jobs: int | None,
) -> Verification:
    """Prove what a log says, and its files beside it.

    Parameters
    ----------
    log
        The log, every byte of it accounted for.
    watch
        Is told of the course of the work.
    flight
        Check of what the missions fly; None if there is nothing to fly.
    missions
        Whether to check the files beside the log.
    jobs
        Processes to share the work; None: one for each core.

    Raises
    ------
    Damage
        If the log contradicts itself.
    """
    show = read_show(log)
    metadata = _metadata(log)
    checks = [
        *_integrity(log),
        *check_schemas(log),
        _agreement(show, metadata),
        *check_attachments(log, metadata),
    ]
    grids = _grids(metadata)
    # In the order in which damage is reported if there is more than one.
    work: dict[str, Sequence[Callable[[], Any]]] = {
        "segments": [partial(_examined, one, show.rules) for one in show.segments],
        "separation": encounter_parts(show),
        "choreography": [partial(check_choreography, show)],
        "samples": fleet_parts(log, show, grids),
        "others": [partial(check_other_samples, log, show, grids)],
        "certificates": [partial(check_certificates, show)],
        "missions": mission_parts(log, show, flight) if missions else [],
    }
    found = _done(work, jobs, watch)
    checks += _segments(show, found["segments"])
    checks.append(_separation(show, closest_of(found["separation"])))
    checks += found["choreography"][0]
    checks += join_samples(log, show, found["samples"], found["others"][0])
    checks += found["certificates"][0]
    if missions:
        checks += [check for part in found["missions"] for check in part]
    else:
        checks.append(
            Check("VRF400", "missions", "mission files", "skipped", notes=("as asked",))
        )
    return Verification(
        str(log.path), show.rules.name, show.drones, show.duration, tuple(checks)
    )


def _done(
    work: dict[str, Sequence[Callable[[], Any]]], jobs: int | None, watch: Progress
) -> dict[str, list[Any]]:
    """Do all parts of the work; what they found, under the same names."""
    named = [(name, part) for name, some in work.items() for part in some]
    parts = [part for _, part in named]
    watch.stage(
        "physics, limits, separation, choreography, samples, missions", len(parts)
    )
    begin = sorted(range(len(named)), key=lambda number: BEGUN.index(named[number][0]))
    results = iter(run_all(parts, jobs, watch.advance, begin=begin))
    return {name: list(islice(results, len(some))) for name, some in work.items()}


def _metadata(log: LogFile) -> dict[str, str]:
    found = [content for name, content in log.metadata if name == "showc"]
    if len(found) != 1:
        raise Damage(0, "the metadata record 'showc' is missing")
    return found[0]


def _grids(metadata: dict[str, str]) -> NDArray[np.float64]:
    try:
        grids = np.array([float(metadata[f"grid_{name}"]) for name in GRIDS])
    except (KeyError, ValueError) as error:
        raise Damage(
            0, f"the metadata do not declare the rounding ({error})"
        ) from error
    # A coarse grid would make the comparison of samples say nothing.
    if not np.all((grids > 0.0) & (grids <= 2.0**-8)):
        raise Damage(0, "the metadata declare a rounding that no log of showc's has")
    return grids


def _integrity(log: LogFile) -> list[Check]:
    statistics = log.contents.statistics()
    whole = (
        f"{statistics.messages:,} messages on {statistics.channels:,} channels in "
        f"{statistics.chunks:,} chunks: CRCs, indexes, statistics, order, sequence"
    )
    checks = [
        Check(
            "VRF101",
            "integrity",
            "every byte accounted for",
            "pass",
            float(log.size),
            None,
            "bytes",
            notes=(whole,),
        )
    ]
    checks += [
        Check(
            "VRF102",
            "integrity",
            "CRC present",
            "warning",
            where=Place(offset=offset),
            notes=(f"{text}: what it would cover is protected less",),
        )
        for offset, text in log.warnings
    ]
    return checks


def _agreement(show: LoggedShow, metadata: dict[str, str]) -> Check:
    """Whether the metadata say the same of the show as its rules."""
    site = show.rules.site
    wanted = {
        "drones": show.drones,
        "rate_hz": show.rules.log_rate,
        "duration_s": show.duration,
        "epoch_ns": show.epoch,
        "origin_latitude": site.latitude,
        "origin_longitude": site.longitude,
        "origin_altitude": site.altitude,
        "heading": site.heading,
    }
    bad = []
    for key, value in wanted.items():
        try:
            same = abs(float(metadata[key]) - value) <= 1e-9 * max(1.0, abs(value))
        except (KeyError, ValueError):
            same = False
        if not same:
            bad.append(f"{key}: {metadata.get(key)!r}, the rules say {value!r}")
    return Check(
        "VRF105",
        "integrity",
        "metadata, rules and segments agree",
        "fail" if bad else "pass",
        notes=tuple(bad),
    )


def _at(segment: Segment, deviation: Deviation | Extreme) -> Place:
    return Place(
        deviation.drone + 1,
        segment=segment.message.name,
        time=segment.start + deviation.time,
    )


def _examined(segment: Segment, rules: pb.Rules) -> tuple[Replay, list[Extreme]]:
    """Physics and limits of one segment."""
    return replay(segment, rules.vehicle), extremes(segment, rules)


def _segments(
    show: LoggedShow, found: Sequence[tuple[Replay, list[Extreme]]]
) -> list[Check]:
    """Physics and limits: the worst of all segments."""
    position: tuple[float, Place] = (-1.0, Place())
    attitude: tuple[float, Place] = (-1.0, Place())
    error, clipped = 0.0, 0.0
    tightest: dict[str, tuple[Extreme, Segment]] = {}
    for segment, (flown, tight) in zip(show.segments, found, strict=True):
        if flown.position.value > position[0]:
            position = flown.position.value, _at(segment, flown.position)
        if flown.attitude.value > attitude[0]:
            attitude = flown.attitude.value, _at(segment, flown.attitude)
        error = max(error, flown.integration_error)
        clipped = max(clipped, flown.clipped)
        for extreme in tight:
            key = extreme.bound.quantity
            if key not in tightest or extreme.margin < tightest[key][0].margin:
                tightest[key] = extreme, segment
    notes = [f"flown again with an integration error of {error:.1e} m"]
    if clipped > 0.0:
        notes.append(f"controls exceed the rotors by {clipped:.1e} and were cut")
    checks = [
        Check(
            "VRF301",
            "physics",
            "controls fly the logged positions",
            "pass" if position[0] < POSITION_ERROR else "fail",
            position[0],
            POSITION_ERROR,
            "m",
            position[1],
            tuple(notes),
        ),
        Check(
            "VRF302",
            "physics",
            "controls fly the logged attitude",
            "pass" if attitude[0] < ATTITUDE_ERROR else "fail",
            math.degrees(attitude[0]),
            math.degrees(ATTITUDE_ERROR),
            "deg",
            attitude[1],
        ),
    ]
    checks += [_limit(*found) for found in tightest.values()]
    return checks


_LIMITS = {
    "volume": "VRF311",
    "velocity": "VRF312",
    "tilt": "VRF313",
    "body rates": "VRF314",
    "thrust": "VRF315",
    "torques": "VRF316",
    "rotor speeds": "VRF317",
}
"""Code of each family of limits."""


def _limit(extreme: Extreme, segment: Segment) -> Check:
    bound = extreme.bound
    sign = -1.0 if bound.name.startswith("least") else 1.0
    note = (
        f"{bound.name}: margin {extreme.margin:+.3%} of the range "
        f"(tolerance {TOLERANCE:.0e} of it)"
    )
    return Check(
        _LIMITS[bound.quantity],
        "limits",
        f"{bound.quantity} within limits at every instant",
        "pass" if extreme.margin >= -TOLERANCE else "fail",
        sign * extreme.upper + 0.0,
        sign * bound.top + 0.0,
        bound.unit,
        _at(segment, extreme),
        (note,),
    )


def _separation(show: LoggedShow, encounter: Encounter | None) -> Check:
    name = "separation of every pair at every instant"
    wanted = show.rules.separation.distance
    if encounter is None:
        return Check(
            "VRF321", "separation", name, "skipped", notes=("there is only one drone",)
        )
    a, b = encounter.pair
    note = (
        f"{show.drones * (show.drones - 1) // 2:,} pairs; the closest encounter "
        f"lies in [{encounter.lower:.7f}, {encounter.upper:.7f}] m (resolution "
        f"{RESOLUTION:.0e} m, tolerance {SEPARATION_TOLERANCE:.0e} m)"
    )
    return Check(
        "VRF321",
        "separation",
        name,
        "pass" if encounter.lower >= wanted - SEPARATION_TOLERANCE else "fail",
        encounter.lower,
        wanted,
        "m",
        Place(
            pair=(a + 1, b + 1),
            segment=", ".join(encounter.segments),
            time=encounter.time,
        ),
        (note,),
    )
