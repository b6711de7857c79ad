"""All proofs of one log: physics, limits, separation, choreography, missions."""

from __future__ import annotations

from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.log.container import LogFile, open_log
from showc.log.records import Damage
from showc.log.schema import ABORT_NAME, ADDITIONS, METADATA_NAME
from showc.processes import side_by_side
from showc.progress import Progress, Silent
from showc.verify.decode import check_schemas, read_show
from showc.verify.kernel.certificates import certified, closest_claims, excess
from showc.verify.kernel.choreography import joined_up
from showc.verify.kernel.dynamics import radius, ties
from showc.verify.kernel.limits import extremes, kept
from showc.verify.kernel.separation import closest_of, encounter_parts, separated
from showc.verify.missions.folder import Missions
from showc.verify.report import Check, Place, Verification, agreement, checked
from showc.verify.samples import Samples, join
from showc.verify.specification.aborts import Aborts, bound_to
from showc.verify.specification.cover import check_cover, read_anchor
from showc.verify.specification.demands import hold_against

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from showc.verify.kernel.show import Statement


def verify_log(
    path: Path | str,
    *,
    missions: bool = True,
    jobs: int | None = 1,
    progress: Progress | None = None,
    script: Path | None = None,
) -> Verification:
    """Prove a compiled show again, from its bytes alone.

    Parameters
    ----------
    path
        The log, ``output.mcap``; beside it the folder ``output``.
    missions
        Whether to check the files in that folder too.
    jobs
        Processes to share the work; None: one for each core. The copies are made by
        ``fork``: a caller with threads of its own had better leave it at 1. What is
        found does not depend on it.
    progress
        Hears of the course of the work.
    script
        The script to hold the log against; None: the one attached to the log.

    Raises
    ------
    UsageError
        If the log cannot be read.
    DamagedFileError
        If it is cut, altered, or not a log of showc's; as
        :class:`showc.log.records.DamagedLogError`, with the byte offset.
    """
    watch = progress or Silent()
    watch.stage("reading every byte")
    log = open_log(Path(path))
    # What overflows is infinite or undefined, and no check passes with that.
    with log.reported(), np.errstate(all="ignore"):
        return _proved(log, watch, missions=missions, jobs=jobs, script=script)


def _proved(
    log: LogFile,
    watch: Progress,
    *,
    missions: bool,
    jobs: int | None,
    script: Path | None,
) -> Verification:
    """Prove what a log says, every byte of which is accounted for."""
    metadata = dict(log.metadata).get(METADATA_NAME)
    if metadata is None:
        raise Damage(0, f"the metadata record {METADATA_NAME!r} is missing")
    anchor, asked, checks = read_anchor(log, metadata, script)
    show, lights = read_show(log), None
    if asked is not None:
        demands = hold_against(asked, show)
        work: dict[str, Sequence[Callable[[], Any]]] = {"motions": demands.motions}
        lights = None if demands.rules else demands.lights
        if lights is not None:
            beside = Missions(log, show, asked, demands) if missions else None
            added = [one for one in ADDITIONS if log.attachment(one) is not None]
            aborts = Aborts(log, show, asked) if ABORT_NAME in added else None
            tubes = None if beside is None else beside.tubes
            claimed = [*show.segments, *demands.claims]
            samples = Samples(log, show, lights, asked, tubes)
            # The longest parts first, so that no process works alone at the end.
            rules, segments = show.rules, show.segments
            work |= {
                "missions": [] if beside is None else beside.parts(),
                "aborts": [] if aborts is None else aborts.parts(),
                "physics": [partial(radius, one, rules.vehicle) for one in segments],
                "limits": [partial(extremes, one, rules) for one in segments],
                "separation": encounter_parts(show),
                "bounds": [partial(excess, show, one) for one in claimed],
                "choreography": [partial(joined_up, show)],
                "samples": samples.parts(),
            }
        found = _done(work, jobs, watch)
        checks += demands.checks(found["motions"])
        checks += check_cover(log, metadata, show, asked)
    checks += [_integrity(log), check_schemas(log)]
    if lights is not None:
        checks += [bound_to(log, added)] if added else []
        radii, encounters = found["physics"], found["separation"]
        stated = [
            *ties(show, radii),
            *kept(show, radii, found["limits"]),
            separated(show, radii, closest_of(encounters)),
            *certified(claimed, found["bounds"]),
            closest_claims(show, encounters),
            *found["choreography"][0],
        ]
        checks += map(_check, stated)
        if aborts is not None:
            rows, stated = aborts.checks(found["aborts"])
            checks += [rows, *map(_check, stated)]
        checks += join(found["samples"])
        checks += [check for part in found["missions"] for check in part]
    elif missions:
        note = "not looked at: the log is of no script that can be read"
        checks.append(agreement("VRF410", [note]))
    if not missions:
        checks.append(_left_out(log))
    facts = show.rules.name, show.drones, show.duration, anchor
    return Verification(str(log.path), *facts, tuple(checks))


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
    if parts:
        names = [name for name, some in work.items() if some]
        watch.stage(f"proving {', '.join(names)}", len(parts))
    results = iter(side_by_side(parts, jobs, watch.advance))
    return {name: list(islice(results, len(some))) for name, some in work.items()}


def _integrity(log: LogFile) -> Check:
    messages = sum(chunk.time.size for chunk in log.chunks)
    whole = (
        f"{messages:,} messages on {len(log.channels):,} channels in "
        f"{len(log.chunks):,} chunks: CRCs, indexes, statistics, order, sequence"
    )
    size = float(len(log.view))
    return checked("VRF101", "pass", size, unit="bytes", notes=(whole,))


def _check(statement: Statement) -> Check:
    """Turn what the kernel proves into a check."""
    drones = [drone + 1 for drone in statement.drones]
    drone = drones[0] if len(drones) == 1 else None
    pair = (drones[0], drones[1]) if len(drones) == 2 else None
    where = Place(drone, pair, statement.segment, statement.time)
    facts = statement.holds, statement.value, statement.limit, statement.unit
    return checked(statement.code, *facts, where=where, notes=statement.notes)
