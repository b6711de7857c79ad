"""The files beside the log: those of this compile, and flying to its places.

The log carries the manifest as an attachment; beside ``output.mcap`` lies the folder
``output`` with the same manifest and the files whose hashes it names. Each drone's
mission must visit, in order, the end of every leg of its trajectory, to what the format
can tell apart: 1e-7 degrees, and one centimetre plus the 2 mm that keep the centimetre.
"""

from __future__ import annotations

import hashlib
import json
import re
from functools import partial
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.log import showc_pb2 as pb
from showc.verify.geodesy import east_north_up, to_east_north_up
from showc.verify.mission_flight import check_mission_flight
from showc.verify.report import Check, Place, Verdict
from showc.verify.waypoints import (
    GLOBAL,
    LAND,
    RELATIVE,
    TAKEOFF,
    WAYPOINT,
    Item,
    MissionFormatError,
    parse,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from numpy.typing import NDArray

    from showc.verify.kernel.show import LoggedShow
    from showc.verify.logfile import LogFile

    FloatArray = NDArray[np.float64]

GROUP = "missions"

FILES = "files beside the log are those of its compile"

MANIFEST = "manifest.json"

LEVEL_RESOLUTION = 0.0112
"""1e-7 degrees of latitude [m]; of longitude it is less."""

HEIGHT_RESOLUTION = 0.012
"""One centimetre, and the 2 mm that are written on top [m]."""

_MISSION = re.compile(r"missions/drone_(\d+)\.waypoints")

_LARGEST_FILE = 1 << 26


def _manifest(log: LogFile) -> dict[str, Any] | None:
    content = log.attachment(MANIFEST)
    try:
        manifest = json.loads(content or b"")
    except (ValueError, RecursionError):
        return None
    return manifest if isinstance(manifest, dict) else None


def check_missions(log: LogFile, show: LoggedShow) -> list[Check]:
    """Check the folder beside the log: manifest, hashes, end points, flights."""
    flight = flight_part(log, show)
    return [check for part in mission_parts(log, show, flight) for check in part()]


def flight_part(
    log: LogFile, show: LoggedShow, jobs: int | None = 1
) -> Callable[[], list[Check]] | None:
    """Return the check of what the missions fly; None if there is nothing to fly.

    It takes long, and is shared by ``jobs`` processes once more. Of the ``show`` it
    needs the rules alone.
    """
    manifest = _manifest(log)
    folder = log.path.with_suffix("")
    described = (manifest or {}).get("missions")
    missions = _missions(_files(manifest))
    if not (
        isinstance(described, dict)
        and folder.is_dir()
        and sorted(missions) == list(range(show.drones))
    ):
        return None
    drawn = log, show
    return partial(
        check_mission_flight,
        folder,
        missions,
        described,
        show.rules,
        drawn=drawn,
        jobs=jobs,
    )


def mission_parts(
    log: LogFile, show: LoggedShow, flight: Callable[[], list[Check]] | None
) -> list[Callable[[], list[Check]]]:
    """Return the checks of the folder beside the log, in parts for side by side.

    ``flight`` is that of :func:`flight_part`.
    """
    folder = log.path.with_suffix("")
    manifest = _manifest(log)
    if not folder.is_dir():
        note = (
            f"there is no folder {folder.name!r} beside the log; copy it there, or "
            "leave missions out of the verification"
        )
        place = Place(file=str(folder))
        missing = Check("VRF401", GROUP, FILES, "fail", where=place, notes=(note,))
        return [lambda: [missing]]
    if _without_missions(manifest) and not _present(folder):
        note = "compiled without missions"
        skipped = Check("VRF400", GROUP, "mission files", "skipped", notes=(note,))
        return [lambda: [_same_manifest(log, folder), skipped]]
    files = _files(manifest)
    parts: list[Callable[[], list[Check]]] = [
        partial(_check_files, log, show, files, _missions(files))
    ]
    return parts if flight is None else [*parts, flight]


def _missions(files: Iterable[str]) -> dict[int, str]:
    """Paths of the missions among those of all files, by drone."""
    return {
        int(match[1]) - 1: path for path in files if (match := _MISSION.fullmatch(path))
    }


def _check_files(
    log: LogFile, show: LoggedShow, files: dict[str, str], missions: dict[int, str]
) -> list[Check]:
    """Check manifest, hashes and end points; ``missions`` are paths by drone."""
    folder = log.path.with_suffix("")
    checks = [_same_manifest(log, folder), _hashes(folder, files, FILES)]
    if sorted(missions) != list(range(show.drones)):
        note = f"the manifest names missions of {len(missions)} drones"
        checks.append(
            Check("VRF403", GROUP, "one mission for each drone", "fail", notes=(note,))
        )
    checks.append(_end_points(folder, missions, show))
    return checks


def _files(manifest: dict[str, Any] | None) -> dict[str, str]:
    """Paths and hashes that the manifest names; nothing outside its folder."""
    missions = (manifest or {}).get("missions")
    listed = missions.get("files") if isinstance(missions, dict) else None
    if not isinstance(listed, dict):
        return {}
    found = {}
    for path, digest in listed.items():
        pure = PurePosixPath(path)
        if not pure.is_absolute() and ".." not in pure.parts:
            found[path] = str(digest)
    return found


def _without_missions(manifest: dict[str, Any] | None) -> bool:
    """Whether the manifest says that no missions were made."""
    missions = (manifest or {}).get("missions")
    if not isinstance(missions, dict):
        return False
    return missions.get("autopilot", "") is None and missions.get("files") == {}


def _present(folder: Path) -> set[str]:
    """Paths of the files in the folder of missions."""
    return {
        file.relative_to(folder).as_posix()
        for file in (folder / "missions").rglob("*")
        if file.is_file()
    }


def _read(path: Path) -> bytes | None:
    try:
        if path.stat().st_size > _LARGEST_FILE:
            return None
        return path.read_bytes()
    except (OSError, ValueError):
        return None


def _same_manifest(log: LogFile, folder: Path) -> Check:
    same = _read(folder / MANIFEST) == log.attachment(MANIFEST)
    note = "they differ, or the file cannot be read: files of two compiles are mixed"
    return Check(
        "VRF402",
        GROUP,
        "manifest in the log and manifest in the folder are one",
        "pass" if same else "fail",
        where=Place() if same else Place(file=f"{folder.name}/{MANIFEST}"),
        notes=() if same else (note,),
    )


def _hashes(folder: Path, files: dict[str, str], name: str) -> Check:
    bad = []
    for path, digest in files.items():
        content = _read(folder / path)
        if content is None:
            bad.append(f"{path}: missing or unreadable")
        elif hashlib.sha256(content).hexdigest() != digest:
            bad.append(f"{path}: the hash is not the manifest's")
    strangers = sorted(_present(folder) - set(files))
    bad += [f"{path}: not in the manifest" for path in strangers]
    if not files:
        bad.append("the manifest names no files")
    more = [f"and {len(bad) - 5} more"] if len(bad) > 5 else []
    return Check(
        "VRF401",
        GROUP,
        name,
        "fail" if bad else "pass",
        float(len(files)),
        None,
        "files",
        Place(file=f"{folder.name}/{bad[0].split(':')[0]}") if bad else Place(),
        tuple(bad[:5] + more),
    )


def _end_points(folder: Path, missions: dict[int, str], show: LoggedShow) -> Check:
    """Whether each mission visits the ends of its drone's legs in order."""
    name = "missions end their legs where the trajectory does"
    legs = _leg_ends(show)
    worst, where, count = 0.0, Place(), 0
    for drone, path in sorted(missions.items()):
        place = Place(drone + 1, file=f"{folder.name}/{path}")
        content = _read(folder / path)
        if content is None or drone >= show.drones:
            continue
        try:
            items = parse(content)
        except MissionFormatError as error:
            return Check(
                "VRF404", GROUP, name, "fail", where=place, notes=(str(error),)
            )
        ends, names = legs[drone]
        ratio, missed = _follow(items, ends, show.rules.site)
        count += len(names)
        if missed is not None:
            note = f"no item flies to the end of “{names[missed]}” in its turn"
            return Check(
                "VRF404",
                GROUP,
                name,
                "fail",
                ratio,
                1.0,
                "of the resolution",
                place,
                (note,),
            )
        if not any(item.command == LAND for item in items[-1:]):
            note = "the last item is not a landing"
            return Check("VRF404", GROUP, name, "fail", where=place, notes=(note,))
        if ratio > worst:
            worst, where = ratio, place
    note = f"{count:,} ends of legs, to 1e-7 degrees and 1.2 cm of height"
    verdict: Verdict = "pass" if count else "fail"
    return Check(
        "VRF404", GROUP, name, verdict, worst, 1.0, "of the resolution", where, (note,)
    )


def _leg_ends(show: LoggedShow) -> list[tuple[FloatArray, list[str]]]:
    """East, north, up of the ends (n, 3) of each drone's moves, with their names.

    The first row is where the drone stands before its first move.
    """
    ends: list[list[FloatArray]] = [[] for _ in range(show.drones)]
    names: list[list[str]] = [[] for _ in range(show.drones)]
    for segment in sorted(show.segments, key=lambda one: one.start):
        if segment.message.kind == pb.Segment.HOLD:
            continue
        first, last = segment.ends()
        for row, drone in enumerate(segment.drones.tolist()):
            if not ends[drone]:
                ends[drone].append(first[row, :3])
            ends[drone].append(last[row, :3])
            names[drone].append(segment.message.name)
    site = show.rules.site
    return [
        (to_east_north_up(site, np.array(rows).reshape(-1, 3)), labels)
        for rows, labels in zip(ends, names, strict=True)
    ]


def _follow(
    items: list[Item], ends: FloatArray, site: pb.Site
) -> tuple[float, int | None]:
    """Greatest error over resolution, and the leg whose end is not visited."""
    begins_home = bool(items) and items[0].frame == GLOBAL
    home = items[0] if begins_home else None
    flown = [
        item
        for item in (items[1:] if begins_home else items)
        if item.command in (WAYPOINT, LAND, TAKEOFF) and item.frame == RELATIVE
    ]
    if not flown or ends.shape[0] < 2:
        return 0.0, 0
    # Height of home above the site: the home row's, or else the drone's pad.
    base = home.height if home is not None else site.altitude + float(ends[0, 2])
    rows = flown if home is None else [home, *flown]
    heights = [0.0 if item is home else item.height for item in rows]
    places = east_north_up(
        site,
        [item.latitude for item in rows],
        [item.longitude for item in rows],
        np.array(heights) + base,
    )
    resolution = np.array([LEVEL_RESOLUTION, LEVEL_RESOLUTION, HEIGHT_RESOLUTION])
    worst, at = 0.0, 0
    if home is not None:
        worst = float(np.max(np.abs(places[0] - ends[0]) / resolution))
        if not worst <= 1.0:
            return worst, 0
        places = places[1:]
    # A take-off goes up from the pad; autopilots ignore its place.
    takes_off = np.array([item.command == TAKEOFF for item in flown])
    places[takes_off, :2] = ends[0, :2]
    # Of each end to each place, shape (ends, places).
    ratios = np.max(np.abs(places - ends[1:, None]) / resolution, axis=2)
    for leg, ratio in enumerate(ratios):
        fits = np.flatnonzero(ratio[at:] <= 1.0)
        if fits.size == 0:
            return float(ratio[at:].min()), leg
        at += int(fits[0])
        worst = max(worst, float(ratio[at]))
    return worst, None
