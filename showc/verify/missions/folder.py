"""The files beside the log: those of this compile, every line of them known.

The log carries the manifest as an attachment; beside ``output.mcap`` lies the folder
``output`` with the same manifest and the files whose hashes it names. Which files these
are, and what stands in them, follows from the script and from the missions' own
language; whatever else lies there is a finding.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from functools import partial
from itertools import zip_longest
from typing import TYPE_CHECKING, Any

from showc import files
from showc.verify.missions.drawn import check_drawn
from showc.verify.missions.flight import check_flight, mission_clock
from showc.verify.missions.language import Mission, MissionFormatError, read_mission
from showc.verify.missions.legs import fleet_legs
from showc.verify.missions.plan import check_plan
from showc.verify.missions.terms import Terms, parameter_file
from showc.verify.report import Check, Place
from showc.verify.specification.cover import read_manifest

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from showc.script.show import Show
    from showc.verify.kernel.show import LoggedShow
    from showc.verify.logfile import LogFile
    from showc.verify.missions.legs import FleetLegs
    from showc.verify.report import Verdict

GROUP = "missions"

MANIFEST = "manifest.json"

PARAMETERS = "missions/ardupilot.parm"

LARGEST_FILE = 1 << 26
"""A manifest of 10,000 drones has less [bytes]."""

LARGEST_FOLDER = 1 << 29
"""Missions of 10,000 drones have less in sum [bytes]."""

SHOWN = 5
"""Findings of a kind that are named."""


def parts_of_script(
    log: LogFile, show: LoggedShow, script: Show | None
) -> list[Callable[[], list[Check]]]:
    """Return the checks of the folder beside the log, by the ``script`` of its show."""
    if script is not None:
        return mission_parts(log, show, Terms.of(script))
    note = "without a script that can be read it is not known what missions must be"
    unknown = Check("VRF410", GROUP, KNOWN, "fail", notes=(note,))
    return [lambda: [unknown]]


def mission_parts(
    log: LogFile, show: LoggedShow, terms: Terms
) -> list[Callable[[], list[Check]]]:
    """Return the checks of the folder beside the log, in parts for side by side.

    Parameters
    ----------
    log, show
        The log, and what it says.
    terms
        What the script asks of the missions.
    """
    folder = log.path.with_suffix("")
    manifest = read_manifest(log) or {}
    described = manifest.get("missions")
    if not isinstance(described, dict):
        described = {}
    if described.get("autopilot", "") is None and described.get("files") == {}:
        return [partial(_without, folder, log)]
    # A dialect that the script does not name is read as such, and stays unproved.
    accepted = terms.autopilot
    if described.get("autopilot") == "px4":
        terms = replace(terms, autopilot="px4")
    wanted = _Folder(folder, show.drones, terms)
    read = partial(_check_files, wanted, log, show, manifest, accepted)
    if terms.autopilot != "ardupilot":
        return [read]
    return [
        read,
        partial(_check_flown, wanted, show, described),
        partial(_check_drawn, wanted, log, show, described),
    ]


def check_missions(log: LogFile, show: LoggedShow, terms: Terms) -> list[Check]:
    """Check the folder beside the log whole."""
    return [check for part in mission_parts(log, show, terms) for check in part()]


def _without(folder: Path, log: LogFile) -> list[Check]:
    """Check a compile without missions: nothing to be flown may lie there."""
    note = "compiled without missions"
    skipped = Check("VRF400", GROUP, "mission files", "skipped", notes=(note,))
    if not folder.is_dir():
        return [skipped]
    names = _present(folder)
    return [
        _same_manifest(folder, log),
        _listed("VRF401", FILES, [f"{name}: not in the manifest" for name in names]),
        skipped,
    ]


FILES = "files beside the log are those of its compile"

CLOSED = "every row of every mission is one that showc writes"

PLANS = "plans equal the missions, with the script's fence"

PARAMETER_LINES = "every line of ardupilot.parm is as the script has it"

LIGHTS = "lights are on the script's outputs"

KNOWN = "what the missions fly is known"


@dataclass(frozen=True, slots=True)
class _Folder:
    """The files of one compile, by name."""

    path: Path
    drones: int
    terms: Terms

    def names(self) -> list[str]:
        """All files that must be there, and no others."""
        stems = [f"missions/drone_{drone + 1:04d}" for drone in range(self.drones)]
        files = [f"{stem}{kind}" for stem in stems for kind in (".waypoints", ".plan")]
        return [*files, *([PARAMETERS] if self.terms.autopilot != "px4" else [])]

    def place(self, name: str, drone: int | None = None) -> Place:
        return Place(
            None if drone is None else drone + 1, file=f"{self.path.name}/{name}"
        )

    def mission(self, drone: int) -> Mission:
        """Read the mission of a drone, from 0.

        Raises
        ------
        MissionFormatError
            If it cannot be read, or is none.
        """
        content = read_file(self.path / f"missions/drone_{drone + 1:04d}.waypoints")
        return read_mission(content, self.terms.autopilot)

    def flown(self, show: LoggedShow, described: dict[str, Any]) -> FleetLegs:
        """Return what all drones fly.

        Raises
        ------
        MissionFormatError
            If that cannot be said; names the drone.
        """
        clock = mission_clock(described)
        every = []
        for drone in range(self.drones):
            try:
                every.append(self.mission(drone))
            except MissionFormatError as error:
                raise MissionFormatError(f"drone {drone + 1}: {error}") from None
        return fleet_legs(every, show.rules.site, self.terms, clock)


def read_file(path: Path) -> bytes:
    """Return the bytes of a regular file.

    Raises
    ------
    MissionFormatError
        If it is missing, no regular file, or too large.
    """
    try:
        return files.read_file(path, LARGEST_FILE)
    except files.UnreadableFileError as error:
        raise MissionFormatError(f"cannot be read: {error.reason}") from None


def _present(folder: Path) -> list[str]:
    """Names of everything in the folder but the manifest; of folders, links alone."""
    every = (
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*")
        if path.is_symlink() or not path.is_dir()
    )
    return sorted(name for name in every if name != MANIFEST)


def _same_manifest(folder: Path, log: LogFile) -> Check:
    name = "manifest in the log and manifest in the folder are one"
    try:
        same, why = read_file(folder / MANIFEST) == log.attachment(MANIFEST), "differs"
    except MissionFormatError as error:
        same, why = False, str(error)
    note = f"{why}: files of two compiles are mixed"
    return Check(
        "VRF402",
        GROUP,
        name,
        "pass" if same else "fail",
        where=Place() if same else Place(file=f"{folder.name}/{MANIFEST}"),
        notes=() if same else (note,),
    )


def _listed(
    code: str, name: str, bad: list[str], count: int | None = None, unit: str = "files"
) -> Check:
    """Return a check that fails if anything is ``bad``, and names what is."""
    more = [f"and {len(bad) - SHOWN} more"] if len(bad) > SHOWN else []
    return Check(
        code,
        GROUP,
        name,
        "fail" if bad else "pass",
        None if count is None else float(count),
        None,
        "" if count is None else unit,
        Place(file=bad[0].split(":")[0]) if bad else Place(),
        tuple(bad[:SHOWN] + more),
    )


def _check_files(
    wanted: _Folder,
    log: LogFile,
    show: LoggedShow,
    manifest: dict[str, Any],
    accepted: str,
) -> list[Check]:
    """Check names, hashes and every line of the files."""
    folder, terms = wanted.path, wanted.terms
    if not folder.is_dir():
        note = (
            f"there is no folder {folder.name!r} beside the log; copy it there, or "
            "leave missions out of the verification"
        )
        place = Place(file=str(folder))
        return [Check("VRF401", GROUP, FILES, "fail", where=place, notes=(note,))]
    described = manifest.get("missions")
    described = described if isinstance(described, dict) else {}
    listed = described.get("files")
    listed = listed if isinstance(listed, dict) else {}
    contents, bad = _contents(wanted, listed)
    odd = [
        f"{name}: {'only' if name in listed else 'not'} in the manifest"
        for name in sorted(set(listed) ^ set(wanted.names()))
    ]
    checks = [
        _same_manifest(folder, log),
        _listed("VRF401", FILES, bad, len(contents)),
        _listed("VRF403", "files for each drone, and no others", odd),
        *_check_lines(wanted, contents, show, str(manifest.get("fleet"))),
    ]
    if described.get("autopilot") != terms.autopilot:
        said = str(described.get("autopilot"))[:20]
        note = f"the manifest says {said!r}, the script {terms.autopilot!r}"
        checks.append(Check("VRF410", GROUP, KNOWN, "fail", notes=(note,)))
    elif terms.autopilot != "ardupilot":
        named = accepted == terms.autopilot
        note = f"mission.autopilot of the script is {accepted}"
        verdict: Verdict = "accepted" if named else "unproved"
        checks.append(Check("VRF410", GROUP, KNOWN, verdict, notes=(note,)))
    else:
        found = contents.get(PARAMETERS, b"")
        checks.append(_check_parameters(found, parameter_file(terms)))
    return checks


def _contents(
    wanted: _Folder, listed: dict[str, Any]
) -> tuple[dict[str, bytes], list[str]]:
    """Read the files of a compile; also return what is wrong with them."""
    names = wanted.names()
    strangers = sorted(set(_present(wanted.path)) - set(names))
    bad = [f"{name}: is no file of a compile" for name in strangers]
    contents: dict[str, bytes] = {}
    total = 0
    for name in names:
        try:
            content = read_file(wanted.path / name)
        except MissionFormatError as error:
            bad.append(f"{name}: {error}")
            continue
        total += len(content)
        if total > LARGEST_FOLDER:
            bad.append(f"{name}: the files up to here are too large in sum")
            break
        contents[name] = content
        if hashlib.sha256(content).hexdigest() != listed.get(name):
            bad.append(f"{name}: the hash is not the manifest's")
    return contents, bad


def _check_lines(
    wanted: _Folder, contents: dict[str, bytes], show: LoggedShow, token: str
) -> list[Check]:
    """Check every row of the missions, and every key of the plans."""
    terms = wanted.terms
    rows, plans, lights = list[str](), list[str](), list[str]()
    found = fleet_token(contents)
    if found != token:
        rows.append(f"{MANIFEST}: the fleet token is not that of these missions")
    for drone in range(wanted.drones):
        stem = f"missions/drone_{drone + 1:04d}"
        name, plan = f"{stem}.waypoints", f"{stem}.plan"
        try:
            mission = read_mission(contents.get(name, b""), terms.autopilot)
        except MissionFormatError as error:
            rows.append(f"{name}: {error}")
            continue
        rows += [f"{name}: {wrong}" for wrong in _wrong_pause(mission, terms)]
        lights += [f"{name}: {wrong}" for wrong in _wrong_lights(mission, terms)]
        try:
            site = show.rules.site
            check_plan(contents.get(plan, b""), mission, site, terms, found)
        except MissionFormatError as error:
            plans.append(f"{plan}: {error}")
    return [
        _listed("VRF405", CLOSED, rows, wanted.drones, "missions"),
        _listed("VRF406", PLANS, plans, wanted.drones, "plans"),
        _listed("VRF409", LIGHTS, lights),
    ]


def _check_parameters(found: bytes, wanted: bytes) -> Check:
    """Hold the parameter file against the one that the script asks for."""
    lines, right = (
        text.decode("ascii", "replace").split("\n") for text in (found, wanted)
    )
    bad = [
        f"{PARAMETERS}: line {number} is {(one or '')[:40]!r}, by the script {other!r}"
        for number, (one, other) in enumerate(zip_longest(lines, right), start=1)
        if one != other
    ]
    return _listed("VRF407", PARAMETER_LINES, bad)


def fleet_token(contents: dict[str, bytes]) -> str:
    """Hash over the names and bytes of all missions, sorted."""
    digest = hashlib.sha256()
    for name in sorted(contents):
        if name.endswith(".waypoints"):
            digest.update(name.encode())
            digest.update(hashlib.sha256(contents[name]).digest())
    return digest.hexdigest()


def _wrong_lights(mission: Mission, terms: Terms) -> Iterator[str]:
    """Name servo items that are not the script's."""
    low, high = sorted(terms.pulses)
    for line, item in enumerate(mission.items, start=3):
        output, pulse = item.parameters[:2]
        if item.word == "V" and output not in terms.servos:
            yield f"line {line} sets output {output:g}, which the script does not name"
        elif item.word == "V" and not low <= pulse <= high:
            yield f"line {line} sets {pulse:g} us, the script has {low} to {high}"


def _wrong_pause(mission: Mission, terms: Terms) -> Iterator[str]:
    """Say if a drone hovers longer or shorter before its landing than it must."""
    pause = mission.items[-2].parameters[0]
    if pause != terms.pause:
        yield f"hovers {pause:g} s before its landing, by the script {terms.pause:g} s"


def _check_flown(
    wanted: _Folder, show: LoggedShow, described: dict[str, Any]
) -> list[Check]:
    try:
        flown = wanted.flown(show, described)
    except MissionFormatError as error:
        return [Check("VRF410", GROUP, KNOWN, "fail", notes=(str(error),))]
    return check_flight(flown, show, described, wanted.terms.slack)


def _check_drawn(
    wanted: _Folder, log: LogFile, show: LoggedShow, described: dict[str, Any]
) -> list[Check]:
    try:
        return [check_drawn(log, show, wanted.flown(show, described))]
    except MissionFormatError:
        # What is wrong with the missions is said by their own checks.
        return []
