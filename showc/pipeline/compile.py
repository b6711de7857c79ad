"""From the path of a script to the artifact on disk: every stage, in order."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from showc._version import __version__
from showc.errors import ExportError, ShowError
from showc.fleet.options import SolveOptions
from showc.log.content import segment_message
from showc.log.facts import manifest_of, sha256
from showc.pipeline.artifact import folder_of, place, prepare
from showc.progress import Silent

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from datetime import datetime
    from pathlib import Path
    from typing import BinaryIO

    from showc.flight import Flight
    from showc.mission import MissionSet
    from showc.progress import Progress
    from showc.script import LoadResult


FORMAT_VERSION = 1
"""Version of the manifest's format."""

_LIBRARIES = ("casadi", "mcap", "numpy", "protobuf", "scipy", "zstandard")


def versions() -> dict[str, str]:
    """Versions of showc and of the libraries that its results depend on."""
    return {
        "showc": __version__,
        **{name: importlib.metadata.version(name) for name in _LIBRARIES},
    }


def log_token(flight: Flight) -> str:
    """Return a word for a compile without missions: SHA-256 of what was solved."""
    digest = hashlib.sha256(flight.itinerary.show.source.content)
    for leg in flight.legs:
        for trajectory in leg.trajectories:
            digest.update(trajectory.state.coefficients.tobytes())
    return digest.hexdigest()


def build_manifest(
    flight: Flight,
    *,
    token: str,
    missions: Mapping[str, Any],
    files: Mapping[str, bytes],
) -> bytes:
    """JSON of the manifest, the same bytes for the same flight.

    Parameters
    ----------
    flight
        What was solved.
    token
        One word that all files of one compile share, and no two compiles share.
    missions
        What the mission stage says of its files: autopilot, start, prediction.
    files
        Content of the output folder by relative path, without the manifest.
    """
    legs = flight.legs
    facts = manifest_of(
        flight.itinerary.show,
        [segment_message(flight, number) for number in range(len(legs))],
        _greatest_height(flight),
        [one.leg.assignment for one in legs],
    )
    listed = {name: sha256(content) for name, content in sorted(files.items())}
    manifest = {
        "format_version": FORMAT_VERSION,
        "fleet": token,
        "versions": versions(),
        **facts,
        "missions": {**missions, "files": listed},
    }
    return (
        json.dumps(manifest, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    ).encode()


def _greatest_height(flight: Flight) -> float:
    """Upper bound on the height of any drone at any instant, show frame [m].

    All coefficients of a leg are those of one degree: of a greater one, they are less.
    """
    heights: list[float] = []
    for leg in flight.legs:
        states = [one.state.select([2]) for one in leg.trajectories]
        degree = max(state.degree for state in states)
        heights += [float(one.elevated(degree).coefficients.max()) for one in states]
    return max(heights)


NO_MISSIONS = "compiled without missions: fly the log with `showc stream`"
"""What the manifest says where missions were not wanted."""


class RejectedScriptError(ShowError):
    """The script has findings that forbid compiling it; ``result`` has them all."""

    def __init__(self, result: LoadResult) -> None:
        super().__init__(f"{result.path} has findings")
        self.result = result


@dataclass(frozen=True, slots=True)
class CompileOptions:
    """What a user may choose about a compile, beyond the script."""

    solve: SolveOptions = field(default_factory=SolveOptions)
    """How to solve."""
    start: datetime | None = None
    """UTC time at which the missions begin; None: at a minute of any hour."""
    start_minute: int | None = None
    """That minute; None: the script's."""
    autopilot: Literal["ardupilot", "px4"] | None = None
    """Dialect of the missions; None: the script's."""
    missions: bool = True
    """Whether to make mission files; without them the log alone can be streamed."""
    strict: bool = False
    """Whether warnings about the script forbid compiling it."""
    allow_outside: bool = False
    """Whether the script's files may lie outside its folder."""


@dataclass(frozen=True, slots=True, eq=False)
class Compiled:
    """What a compile made."""

    log: Path
    """The trajectory log."""
    folder: Path
    """Its folder, with ``manifest.json`` and ``missions/``."""
    manifest: dict[str, Any]
    """Content of the manifest."""
    flight: Flight
    """What was solved."""
    result: LoadResult
    """The script and its warnings."""
    warnings: tuple[str, ...] = field(default=())
    """What the missions cannot carry, and other things worth knowing."""
    refused: str | None = None
    """Why there are no missions, although they were wanted."""


def compile_script(
    script: Path | str,
    log: Path,
    options: CompileOptions | None = None,
    progress: Progress | None = None,
    accepted: Callable[[LoadResult], None] | None = None,
) -> Compiled:
    """Compile ``script`` to the log at ``log`` and the folder beside it.

    All or nothing: on any error the former log and folder are whole. ``accepted`` is
    hears what the script says, and its warnings, before anything long begins.

    Raises
    ------
    RejectedScriptError
        If the script has errors (or warnings, if ``options.strict``).
    PlanError, SolveError, ExportError
        If the show cannot be flown, or does not fit the mission files.
    UsageError
        If a file cannot be read or written.
    """
    from showc.fleet import solve_itinerary  # noqa: PLC0415
    from showc.log.writer import write_log  # noqa: PLC0415 - heavy, not for check
    from showc.plan import build_itinerary  # noqa: PLC0415
    from showc.script import load_show  # noqa: PLC0415

    options = options or CompileOptions()
    watcher = progress or Silent()
    folder = folder_of(log)
    prepare(log)
    result = load_show(script, allow_outside=options.allow_outside)
    if result.show is None or result.exit_code(strict=options.strict):
        raise RejectedScriptError(result)
    if accepted is not None:
        accepted(result)
    autopilot = options.autopilot or result.show.mission.autopilot
    itinerary = build_itinerary(result.show, watcher)
    flight = solve_itinerary(itinerary, options.solve, watcher)
    missions, refused = _missions(flight, options, watcher), None
    if isinstance(missions, str):
        refused, missions = missions, _none(flight, missions)
    manifest = build_manifest(
        flight,
        token=missions.fleet_token,
        missions={
            "autopilot": autopilot if missions.files else None,
            "start": None if options.start is None else options.start.isoformat(),
            "warnings": list(missions.warnings),
            "prediction": missions.prediction,
        },
        files=missions.files,
    )

    def write(stream: BinaryIO) -> None:
        write_log(
            flight,
            stream,
            manifest=manifest,
            predicted=missions.predicted,
            progress=watcher,
        )

    place(log, write, {**missions.files, "manifest.json": manifest})
    return Compiled(
        log=log,
        folder=folder,
        manifest=json.loads(manifest),
        flight=flight,
        result=result,
        warnings=missions.warnings,
        refused=refused,
    )


def _missions(
    flight: Flight, options: CompileOptions, watcher: Progress
) -> MissionSet | str:
    """Missions as the options ask for; why not, where there can be none.

    What was solved, perhaps for long, is worth writing without them.
    """
    from showc.mission import mission_files  # noqa: PLC0415 - heavy

    if not (options.missions and flight.itinerary.show.mission.wanted):
        return _none(flight, NO_MISSIONS)
    try:
        return mission_files(
            flight,
            start=options.start,
            start_minute=options.start_minute,
            autopilot=options.autopilot or flight.itinerary.show.mission.autopilot,
            progress=watcher,
            jobs=options.solve.jobs,
        )
    except ExportError as error:
        return f"no missions were written: {error} (--no-missions leaves them out)"


def _none(flight: Flight, why: str) -> MissionSet:
    """Return what the manifest needs where there are no missions."""
    from showc.mission import MissionSet  # noqa: PLC0415 - heavy

    return MissionSet({}, log_token(flight), {}, (why,), None)
