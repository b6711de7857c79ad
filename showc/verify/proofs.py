"""All proofs of one log: physics, limits, separation, choreography, missions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Any

from showc.processes import side_by_side
from showc.verify.decode import check_schemas, read_show
from showc.verify.kernel.certificates import certified
from showc.verify.kernel.choreography import joined_up
from showc.verify.kernel.dynamics import radius, ties
from showc.verify.kernel.limits import Extreme, extremes, kept
from showc.verify.kernel.separation import closest_of, encounter_parts, separated
from showc.verify.missions import Missions
from showc.verify.records import Damage
from showc.verify.report import Place, Verification, checked
from showc.verify.samples import Samples
from showc.verify.samples import join as join_samples
from showc.verify.specification.cover import check_cover
from showc.verify.specification.demands import hold_against
from showc.verify.specification.script import read_anchor

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from showc.log.showc_pb2 import Rules
    from showc.progress import Progress
    from showc.verify.kernel.separation import Encounter
    from showc.verify.kernel.show import LoggedShow, Segment, Statement
    from showc.verify.mcap import LogFile
    from showc.verify.report import Check


def prove(
    log: LogFile,
    watch: Progress,
    *,
    missions: bool,
    jobs: int | None,
    script: Path | None,
) -> Verification:
    """Prove what a log says, every byte of which is accounted for.

    The rest is as :func:`showc.verify.run.verify_log` has it; what contradicts itself
    is ``Damage``.
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
    beside = None
    if missions and anchor.show is not None:
        beside = Missions(log, show, anchor.show, lights)
    tubes = None if beside is None else beside.tubes
    samples = Samples(log, show, lights, anchor.show, tubes)
    # The longest parts first, so that no process works alone at the end.
    work: dict[str, Sequence[Callable[[], Any]]] = {
        "missions": [] if beside is None else beside.parts(),
        "segments": [partial(_examined, one, show.rules) for one in show.segments],
        "separation": encounter_parts(show),
        "choreography": [partial(joined_up, show)],
        "samples": samples.parts(),
    }
    found = _done(work, jobs, watch)
    checks += flight_checks(show, found["segments"], found["separation"])
    checks += [_check(one) for one in found["choreography"][0]]
    checks += join_samples(found["samples"])
    checks += [check for part in found["missions"] for check in part]
    if not missions:
        checks.append(_left_out(log))
    elif beside is None:
        note = "without a script that can be read it is not known what they must be"
        checks.append(checked("VRF410", "fail", notes=(note,)))
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
    if not (folder / "missions").exists():
        return checked("VRF400", "skipped", notes=("left out as asked",))
    note = f"left out as asked; but they lie in {folder.name}, and nothing is proved"
    return checked("VRF400", "unproved", notes=(f"{note} of them",))


def _done(
    work: dict[str, Sequence[Callable[[], Any]]], jobs: int | None, watch: Progress
) -> dict[str, list[Any]]:
    """Do all parts of the work; what they found, under the same names."""
    parts = [part for some in work.values() for part in some]
    watch.stage(
        "physics, limits, separation, choreography, samples, missions", len(parts)
    )
    results = iter(side_by_side(parts, jobs, watch.advance))
    return {name: list(islice(results, len(some))) for name, some in work.items()}


def _metadata(log: LogFile) -> dict[str, str]:
    found = [content for name, content in log.metadata if name == "showc"]
    if not found:
        raise Damage(0, "the metadata record 'showc' is missing")
    return found[0]


def _integrity(log: LogFile) -> list[Check]:
    messages = sum(chunk.time.size for chunk in log.chunks)
    whole = (
        f"{messages:,} messages on {len(log.channels):,} channels in "
        f"{len(log.chunks):,} chunks: CRCs, indexes, statistics, order, sequence"
    )
    size = float(len(log.view))
    return [
        checked("VRF101", "pass", size, unit="bytes", notes=(whole,)),
        *(
            checked(
                "VRF102",
                "warning",
                where=Place(offset=offset),
                notes=(f"{text}: what it would cover is protected less",),
            )
            for offset, text in log.warnings
        ),
    ]


@dataclass(frozen=True, slots=True)
class Examined:
    """What is proved about one segment by itself."""

    radius: NDArray[np.float64]
    extremes: list[Extreme]


def _examined(segment: Segment, rules: Rules) -> Examined:
    return Examined(radius(segment, rules.vehicle), extremes(segment, rules))


def flight_checks(
    show: LoggedShow, examined: Sequence[Examined], encounters: Sequence[Encounter]
) -> list[Check]:
    """Join what the parts found, in the order of the segments."""
    radii = [one.radius for one in examined]
    limits = kept(show, radii, [one.extremes for one in examined])
    apart = separated(show, radii, closest_of(encounters))
    return [
        _check(one)
        for one in (
            *ties(show, radii),
            *limits,
            apart,
            *certified(show, encounters),
        )
    ]


def _check(statement: Statement) -> Check:
    """Turn what the kernel proves into a check."""
    holds, drones = statement.holds, [drone + 1 for drone in statement.drones]
    return checked(
        statement.code,
        "skipped" if holds is None else "pass" if holds else "fail",
        statement.value,
        statement.limit,
        statement.unit,
        where=Place(
            drones[0] if len(drones) == 1 else None,
            (drones[0], drones[1]) if len(drones) == 2 else None,
            statement.segment,
            statement.time,
        ),
        notes=statement.notes,
    )
