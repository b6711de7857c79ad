"""All proofs of one log: physics, limits, separation, choreography, missions."""

from __future__ import annotations

from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Any

from showc.verify.certificates import check_certificates
from showc.verify.choreography import check_choreography
from showc.verify.crew import run_all
from showc.verify.damage import Damage
from showc.verify.decode import read_show
from showc.verify.kernel.dynamics import Tube, ties, tube
from showc.verify.limits import TOLERANCE, Extreme, extremes
from showc.verify.missions import parts_of_script
from showc.verify.report import Check, Place, Verification
from showc.verify.samples import Samples
from showc.verify.samples import join as join_samples
from showc.verify.schemas import check_schemas
from showc.verify.separation import (
    RESOLUTION,
    Encounter,
    closest_of,
    encounter_parts,
)
from showc.verify.specification.cover import check_cover
from showc.verify.specification.demands import hold_against
from showc.verify.specification.script import read_anchor

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from showc.log import showc_pb2 as pb
    from showc.verify.kernel.show import LoggedShow, Segment
    from showc.verify.kernel.statement import Statement
    from showc.verify.logfile import LogFile
    from showc.verify.progress import Progress

SEPARATION_TOLERANCE = 1e-6
"""How far the separation may be missed: rounding, not flight [m]."""

BEGUN = (
    *("missions", "segments", "separation"),
    *("certificates", "choreography", "samples"),
)
"""Kinds of work, those with the longest parts first."""


def prove(
    log: LogFile,
    watch: Progress,
    *,
    missions: bool,
    jobs: int | None,
    script: Path | None,
) -> Verification:
    """Prove what a log says, and its files beside it.

    Parameters
    ----------
    log
        The log, every byte of it accounted for.
    watch
        Is told of the course of the work.
    missions
        Whether to check the files beside the log.
    jobs
        Processes to share the work; None: one for each core.
    script
        The script to hold the log against; None: the one attached.

    Raises
    ------
    Damage
        If the log contradicts itself.
    """
    show = read_show(log)
    metadata = _metadata(log)
    anchor = read_anchor(log, metadata, script)
    checks = [*anchor.checks, *_integrity(log), check_schemas(log)]
    lights = None
    if anchor.show is not None:
        demands = hold_against(anchor.show, show)
        checks[len(anchor.checks) : len(anchor.checks)] = demands.checks()
        lights = demands.lights
    checks += check_cover(log, metadata, show, anchor)
    samples = Samples(log, show, lights, anchor.show)
    # In the order in which damage is reported if there is more than one.
    work: dict[str, Sequence[Callable[[], Any]]] = {
        "segments": [partial(_examined, one, show.rules) for one in show.segments],
        "separation": encounter_parts(show),
        "choreography": [partial(check_choreography, show)],
        "samples": samples.parts(),
        "certificates": [partial(check_certificates, show)],
        "missions": parts_of_script(log, show, anchor.show) if missions else [],
    }
    found = _done(work, jobs, watch)
    checks += _segments(show, found["segments"])
    checks.append(_separation(show, closest_of(found["separation"])))
    checks += found["choreography"][0]
    checks += join_samples(found["samples"])
    checks += found["certificates"][0]
    if missions:
        checks += [check for part in found["missions"] for check in part]
    else:
        checks.append(_left_out(log))
    return Verification(
        str(log.path),
        show.rules.name,
        show.drones,
        show.duration,
        str(anchor),
        tuple(checks),
    )


def _left_out(log: LogFile) -> Check:
    """Say that missions were not looked at, and whether any lie there."""
    folder = log.path.with_suffix("")
    lie_there = (folder / "missions").exists()
    note = "left out as asked"
    if lie_there:
        note += f"; but they lie in {folder.name}, and nothing is proved of them"
    return Check(
        "VRF400",
        "missions",
        "mission files",
        "unproved" if lie_there else "skipped",
        notes=(note,),
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
    if not found:
        raise Damage(0, "the metadata record 'showc' is missing")
    return found[0]


def _integrity(log: LogFile) -> list[Check]:
    messages = sum(chunk.messages.size.size for chunk in log.chunks)
    whole = (
        f"{messages:,} messages on {len(log.channels):,} channels in "
        f"{len(log.chunks):,} chunks: CRCs, indexes, statistics, order, sequence"
    )
    checks = [
        Check(
            "VRF101",
            "integrity",
            "every byte accounted for",
            "pass",
            float(len(log.view)),
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


def _at(segment: Segment, found: Extreme) -> Place:
    return Place(
        found.drone + 1, segment=segment.message.name, time=segment.start + found.time
    )


def _check(group: str, statement: Statement) -> Check:
    """Turn what the kernel proves into a check."""
    holds, drones = statement.holds, tuple(drone + 1 for drone in statement.drones)
    return Check(
        statement.code,
        group,
        statement.title,
        "skipped" if holds is None else "pass" if holds else "fail",
        statement.value,
        statement.limit,
        statement.unit,
        Place(
            drones[0] if len(drones) == 1 else None,
            (drones[0], drones[1]) if len(drones) == 2 else None,
            statement.segment,
            statement.time,
        ),
        statement.notes,
    )


def _examined(segment: Segment, rules: pb.Rules) -> tuple[Tube, list[Extreme]]:
    """Physics and limits of one segment."""
    return tube(segment, rules.vehicle), extremes(segment, rules)


def _segments(
    show: LoggedShow, found: Sequence[tuple[Tube, list[Extreme]]]
) -> list[Check]:
    """Physics and limits: the worst of all segments."""
    tightest: dict[str, tuple[Extreme, Segment]] = {}
    for segment, (_, tight) in zip(show.segments, found, strict=True):
        for extreme in tight:
            key = extreme.bound.quantity
            if key not in tightest or extreme.margin < tightest[key][0].margin:
                tightest[key] = extreme, segment
    physics = ties(show, [flown for flown, _ in found])
    return [
        *(_check("physics", statement) for statement in physics),
        *(_limit(*found) for found in tightest.values()),
    ]


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
