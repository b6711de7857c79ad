"""The files beside the log: those of this compile, every line of them known.

The log carries the manifest as an attachment; beside ``output.mcap`` lies the folder
``output`` with the same manifest and the files whose hashes it names. Which files these
are, and what stands in them, follows from the script and from the missions' own
language; whatever else lies there is a finding.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import TYPE_CHECKING, Any

from showc import files
from showc.verify.missions.drawn import check_drawn
from showc.verify.missions.flight import check_flight, mission_clock
from showc.verify.missions.language import Mission, MissionFormatError, read_mission
from showc.verify.missions.legs import fleet_legs
from showc.verify.missions.plan import check_plan
from showc.verify.missions.terms import Terms, parameter_file
from showc.verify.report import agreement, checked
from showc.verify.specification.cover import read_manifest

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from showc.script.show import Show
    from showc.verify.kernel.show import LoggedShow
    from showc.verify.logfile import LogFile
    from showc.verify.missions.legs import FleetLegs
    from showc.verify.report import Check, Verdict

MANIFEST = "manifest.json"

PARAMETERS = "missions/ardupilot.parm"

LARGEST_FILE = 1 << 26
"""A manifest of 10,000 drones has less [bytes]."""

LARGEST_FOLDER = 1 << 29
"""Missions of 10,000 drones have less in sum [bytes]."""


def parts_of_script(
    log: LogFile, show: LoggedShow, script: Show | None
) -> list[Callable[[], list[Check]]]:
    """Return the checks of the folder beside the log, by the ``script`` of its show."""
    if script is not None:
        return mission_parts(log, show, Terms.of(script))
    note = "without a script that can be read it is not known what missions must be"
    unknown = checked("VRF410", "fail", notes=(note,))
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
    manifest = read_manifest(log) or {}
    described = _object(manifest, "missions")
    # A dialect that the script does not name is read as such, and stays unproved.
    spoken = "px4" if described.get("autopilot") == "px4" else terms.autopilot
    beside = _Beside(log, show, replace(terms, autopilot=spoken), manifest)
    if described.get("autopilot", "") is None and described.get("files") == {}:
        return [beside.without]
    if spoken != "ardupilot":
        return [lambda: [*beside.files(), beside.unknown(terms.autopilot)]]
    return [lambda: [*beside.files(), beside.parameters()], beside.flight, beside.drawn]


def check_missions(log: LogFile, show: LoggedShow, terms: Terms) -> list[Check]:
    """Check the folder beside the log whole."""
    return [check for part in mission_parts(log, show, terms) for check in part()]


def _object(value: dict[str, Any], key: str) -> dict[str, Any]:
    """Return what stands under a key of a JSON object, if that is an object itself."""
    found = value.get(key)
    return found if isinstance(found, dict) else {}


@dataclass(frozen=True, slots=True)
class _Beside:
    """The files of one compile."""

    log: LogFile
    show: LoggedShow
    terms: Terms
    manifest: dict[str, Any]

    @property
    def folder(self) -> Path:
        return self.log.path.with_suffix("")

    @property
    def described(self) -> dict[str, Any]:
        return _object(self.manifest, "missions")

    def names(self) -> list[str]:
        """All files that must be there, and no others."""
        drones = range(1, self.show.drones + 1)
        stems = [f"missions/drone_{drone:04d}" for drone in drones]
        found = [f"{stem}{kind}" for stem in stems for kind in (".waypoints", ".plan")]
        return [*found, *([PARAMETERS] if self.terms.autopilot != "px4" else [])]

    def present(self) -> set[str]:
        """Names of everything but the manifest; of folders, links alone."""
        every = (
            path.relative_to(self.folder).as_posix()
            for path in self.folder.rglob("*")
            if path.is_symlink() or not path.is_dir()
        )
        return set(every) - {MANIFEST}

    def without(self) -> list[Check]:
        """Check a compile without missions: nothing to be flown may lie there."""
        note = "compiled without missions"
        skipped = checked("VRF400", "skipped", notes=(note,))
        if not self.folder.is_dir():
            return [skipped]
        strangers = [f"{name}: not in the manifest" for name in sorted(self.present())]
        return [self._same_manifest(), agreement("VRF401", strangers), skipped]

    def files(self) -> list[Check]:
        """Check names, hashes and every line of the files."""
        if not self.folder.is_dir():
            note = (
                f"there is no folder {self.folder.name!r} beside the log; copy it "
                "there, or leave missions out of the verification"
            )
            return [agreement("VRF401", [note])]
        contents, bad = self._contents()
        listed = _object(self.described, "files")
        odd = [
            f"{name}: {'only' if name in listed else 'not'} in the manifest"
            for name in sorted(set(listed) ^ set(self.names()))
        ]
        return [
            self._same_manifest(),
            agreement("VRF401", bad),
            agreement("VRF403", odd),
            *self._lines(contents),
        ]

    def _same_manifest(self) -> Check:
        wrong = []
        try:
            if read_file(self.folder / MANIFEST) != self.log.attachment(MANIFEST):
                wrong.append(f"{MANIFEST} differs: files of two compiles are mixed")
        except MissionFormatError as error:
            wrong.append(f"{MANIFEST}: {error}")
        return agreement("VRF402", wrong)

    def _contents(self) -> tuple[dict[str, bytes], list[str]]:
        """Read all files; also return what is wrong with them."""
        names, listed = self.names(), _object(self.described, "files")
        strangers = sorted(self.present() - set(names))
        bad = [f"{name}: is no file of a compile" for name in strangers]
        contents: dict[str, bytes] = {}
        total = 0
        for name in names:
            try:
                content = read_file(self.folder / name)
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

    def _lines(self, contents: dict[str, bytes]) -> list[Check]:
        """Check every row of the missions, and every key of the plans."""
        terms, site = self.terms, self.show.rules.site
        rows, plans, lights = list[str](), list[str](), list[str]()
        token = fleet_token(contents)
        if token != str(self.manifest.get("fleet")):
            rows.append(f"{MANIFEST}: the fleet token is not that of these missions")
        for name in self.names():
            if not name.endswith(".waypoints"):
                continue
            plan = name.replace(".waypoints", ".plan")
            try:
                mission = read_mission(contents.get(name, b""), terms.autopilot)
            except MissionFormatError as error:
                rows.append(f"{name}: {error}")
                continue
            rows += [f"{name}: {wrong}" for wrong in _wrong_pause(mission, terms)]
            lights += [f"{name}: {wrong}" for wrong in _wrong_lights(mission, terms)]
            try:
                check_plan(contents.get(plan, b""), mission, site, terms, token)
            except MissionFormatError as error:
                plans.append(f"{plan}: {error}")
        return [
            agreement("VRF405", rows),
            agreement("VRF406", plans),
            agreement("VRF409", lights),
        ]

    def unknown(self, accepted: str) -> Check:
        """Say of missions whose flight is not known whether the script accepts them."""
        spoken = self.terms.autopilot
        if self.described.get("autopilot") != spoken:
            return self._other_autopilot()
        note = f"mission.autopilot of the script is {accepted}"
        verdict: Verdict = "accepted" if accepted == spoken else "unproved"
        return checked("VRF410", verdict, notes=(note,))

    def _other_autopilot(self) -> Check:
        said = str(self.described.get("autopilot"))[:20]
        note = f"the manifest says {said!r}, the script {self.terms.autopilot!r}"
        return checked("VRF410", "fail", notes=(note,))

    def parameters(self) -> Check:
        """Hold the parameter file against the one that the script asks for."""
        if self.described.get("autopilot") != self.terms.autopilot:
            return self._other_autopilot()
        try:
            found = read_file(self.folder / PARAMETERS)
        except MissionFormatError:
            found = b""
        return check_parameters(found, parameter_file(self.terms))

    def flown(self) -> FleetLegs:
        """Return what all drones fly.

        Raises
        ------
        MissionFormatError
            If that cannot be said; names the file.
        """
        clock, terms = mission_clock(self.described), self.terms
        missions = []
        for name in self.names():
            if name.endswith(".waypoints"):
                try:
                    content = read_file(self.folder / name)
                    missions.append(read_mission(content, terms.autopilot))
                except MissionFormatError as error:
                    raise MissionFormatError(f"{name}: {error}") from None
        return fleet_legs(missions, self.show.rules.site, terms, clock)

    def flight(self) -> list[Check]:
        """Check what the missions fly."""
        try:
            flown = self.flown()
        except MissionFormatError as error:
            return [checked("VRF410", "fail", notes=(str(error),))]
        return check_flight(flown, self.show, self.described, self.terms.slack)

    def drawn(self) -> list[Check]:
        """Check what the log draws of that."""
        try:
            return [check_drawn(self.log, self.show, self.flown())]
        except MissionFormatError:
            # What is wrong with the missions is said by their own checks.
            return []


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


def check_parameters(found: bytes, wanted: bytes) -> Check:
    """Hold the lines of a parameter file against those wanted."""
    lines, right = (
        text.decode("ascii", "replace").split("\n") for text in (found, wanted)
    )
    return agreement(
        "VRF407",
        (
            f"line {number} is {(one or '')[:40]!r}, by the script {other!r}"
            for number, (one, other) in enumerate(zip_longest(lines, right), start=1)
            if one != other
        ),
    )


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
