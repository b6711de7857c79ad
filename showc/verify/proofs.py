"""All proofs of one log: physics, limits, separation, choreography, missions."""

from __future__ import annotations

from functools import partial
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.log.container import LogFile, open_log
from showc.log.records import Damage
from showc.log.schema import ABORT_NAME, ADDITIONS, METADATA_NAME
from showc.processes import side_by_side
from showc.progress import Progress, Silent
from showc.verify.decode import check_container, decoding
from showc.verify.kernel.certificates import certified, closest_claims, excess
from showc.verify.kernel.choreography import joined_up
from showc.verify.kernel.dynamics import radius, ties
from showc.verify.kernel.limits import extremes, kept
from showc.verify.kernel.separation import closest_of, encounter_parts, separated
from showc.verify.missions.folder import Folder, Missions
from showc.verify.report import Check, Verification, agreement, check_of, checked
from showc.verify.samples import Samples, join
from showc.verify.specification.aborts import Aborts, bound_to
from showc.verify.specification.cover import check_cover, read_anchor
from showc.verify.specification.demands import Demands, hold_against

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from showc.script.show import Show
    from showc.verify.kernel.show import LoggedShow, Segment

    Room = tuple[
        Sequence[Callable[[], Any]], Callable[[list[Any]], Iterable[Check]]
    ]  # what is to be done, in parts for side by side; how it becomes checks


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
        Processes, forked, to share the work; None: one for each core. A caller with
        threads of its own had better leave it at 1.
    progress
        Hears of the course of the work.
    script
        The script to hold the log against; None: the one attached to the log.

    Raises
    ------
    UsageError, DamagedFileError
        If the log cannot be read; if it is cut, altered, or not a log of showc's, as
        :class:`showc.log.records.DamagedLogError` with the byte offset.
    """
    watch = progress or Silent()
    watch.stage("reading every byte")
    log = open_log(Path(path))
    # What overflows is infinite or undefined, and no check passes with that.
    with log.reported(), np.errstate(all="ignore"):
        metadata = dict(log.metadata).get(METADATA_NAME)
        if metadata is None:
            raise Damage(0, f"the metadata record {METADATA_NAME!r} is missing")
        segments, joined = decoding(log)
        reading: Any = partial(_read, log, metadata, script, missions=missions)
        read, *tables = side_by_side([reading, *segments], jobs, here=len(segments))
        (anchor, asked, checks, folder), show = read, joined(tables)
        # Missions have the longest part: begun last, it would keep one process alone.
        rooms = [*_rooms(log, metadata, show, asked, folder, missions=missions)][::-1]
        parts = [part for work, _ in rooms for part in work]
        watch.stage("proving", len(parts))
        results = iter(side_by_side(parts, jobs, watch.advance))
        found = [done([*islice(results, len(work))]) for work, done in rooms]
        checks += chain.from_iterable(found[::-1])
    facts = show.rules.name, show.drones, show.duration, anchor
    return Verification(str(log.path), *facts, tuple(checks))


def _read(
    log: LogFile, metadata: Mapping[str, str], script: Path | None, *, missions: bool
) -> tuple[str, Show | None, list[Check], Folder | None]:
    """Read what is beside the log's own topics: the script, and then the missions."""
    anchor, asked, checks = read_anchor(log, metadata, script)
    folder = Folder(log, asked) if missions and asked is not None else None
    return anchor, asked, checks, folder


def _rooms(
    log: LogFile,
    metadata: Mapping[str, str],
    show: LoggedShow,
    asked: Show | None,
    folder: Folder | None,
    *,
    missions: bool,
) -> Iterator[Room]:
    """Yield all that is looked at, in the order in which it is reported."""
    demands = Demands(rules=["unknown"])
    if asked is not None:
        demands = hold_against(asked, show)
        yield demands.motions, demands.checks
        cover = partial(check_cover, log, metadata, show, asked)
        yield [cover], chain.from_iterable
    yield [partial(check_container, log)], chain.from_iterable
    lights = None if demands.rules else demands.lights
    if asked is not None and lights is not None:
        # Now the legs are known to be those of the script.
        added = [one for one in ADDITIONS if log.attachment(one) is not None]
        yield [partial(bound_to, log, added)] * bool(added), list
        yield _flight(show, demands.claims)
        if ABORT_NAME in added:
            aborts = Aborts(log, show, asked)
            yield aborts.parts(), aborts.checks
        beside = None if folder is None else Missions(folder, log, show, demands)
        tubes = None if beside is None else beside.tubes
        yield Samples(log, show, lights, asked, tubes).parts(), join
        yield [] if beside is None else beside.parts(), chain.from_iterable
    elif missions:
        note = "not looked at: the log is of no script that can be read"
        yield [partial(agreement, "VRF410", [note])], list
    if not missions:
        there = log.path.with_suffix("")
        lie, note = (there / "missions").exists(), "left out as asked"
        note += f"; but they lie in {there.name}, and nothing is proved of them" * lie
        look = partial(checked, "VRF400", "unproved" if lie else None, notes=(note,))
        yield [look], list


def _flight(show: LoggedShow, moves: Sequence[Segment]) -> Room:
    """Return what the kernel proves; ``moves`` of groups claim bounds of their own."""
    segments, claimed = show.segments, [*show.segments, *moves]
    parts: list[Callable[[], Any]] = [
        *(partial(radius, one, show.rules.vehicle) for one in segments),
        *(partial(extremes, one, show.rules) for one in segments),
        *encounter_parts(show),
        *(partial(excess, show, one) for one in claimed),
        partial(joined_up, show),
    ]

    def checks(found: list[Any]) -> Iterator[Check]:
        rest = iter(found)
        radii, limits, near = ([*islice(rest, len(segments))] for _ in range(3))
        stated = (
            *ties(show, radii),
            *kept(show, radii, limits),
            separated(show, radii, closest_of(near)),
            *certified(claimed, [*islice(rest, len(claimed))]),
            closest_claims(show, near),
            *next(rest),
        )
        return map(check_of, stated)

    return parts, checks
