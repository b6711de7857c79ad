"""The missions of a compiled show as they lie on disk, checked against the manifest."""

from __future__ import annotations

import json
from dataclasses import dataclass
from hashlib import sha256
from typing import TYPE_CHECKING, Any

from showc.errors import UsageError
from showc.files import UnreadableFileError, inside, read_file
from showc.log.facts import fleet_token
from showc.vehicle_link.wire import WireItem, parse_parameters, parse_waypoints
from showc.verify.missions.language import MissionFormatError, read_mission

if TYPE_CHECKING:
    from pathlib import Path

_MANIFEST_BYTES = 100_000_000
"""Largest manifest that is read [bytes]: 10 kB for each of 10,000 drones."""
_MISSION_BYTES = 10_000_000
"""Largest file of the folder that is read [bytes]: a hundred thousand items."""


@dataclass(frozen=True, slots=True)
class FleetMission:
    """One drone's mission file."""

    drone: int
    """Counting from 1, as in the file's name."""
    name: str
    """Relative to the folder: ``missions/drone_0001.waypoints``."""
    digest: str
    """SHA-256 of its bytes, hexadecimal."""
    items: tuple[WireItem, ...]
    """What it says."""


@dataclass(frozen=True, slots=True)
class FleetFolder:
    """All missions of one compile."""

    token: str
    """The compile they belong to."""
    autopilot: str
    """Whose dialect they speak."""
    missions: tuple[FleetMission, ...]
    """By drone."""
    parameters: dict[str, float]
    """What the ``.parm`` file beside the missions sets, by name."""


def read_fleet(folder: Path) -> FleetFolder:
    """Read the missions in ``folder`` and hold them against its manifest.

    Raises
    ------
    UsageError
        If the folder, the manifest or a file cannot be read, a file is missing, was
        changed, or says what no mission of showc's says, or the missions are of more
        than one compile.
    """
    manifest = _manifest(folder)
    try:
        token = str(manifest["fleet"])
        described = manifest["missions"]
        listed = dict(described["files"])
        autopilot = str(described["autopilot"])
    except (KeyError, TypeError, ValueError):
        raise UsageError(
            f"{folder / 'manifest.json'}: is not a manifest of this version; compile "
            "the show again"
        ) from None
    wanted = sorted(name for name in listed if name.endswith(".waypoints"))
    found = sorted(
        f"missions/{path.name}" for path in (folder / "missions").glob("*.waypoints")
    )
    strangers = sorted(set(found) - set(wanted))
    if strangers:
        raise UsageError(
            f"{folder / strangers[0]}: is not in the manifest: the folder holds files "
            "of more than one compile; compile the show again"
        )
    contents = {name: _checked(folder, name, listed[name]) for name in wanted}
    if fleet_token(contents) != token:
        raise UsageError(
            f"{folder}: the missions are not those of compile {token[:12]}…; compile "
            "the show again"
        )
    parameters: dict[str, float] = {}
    name = f"missions/{autopilot}.parm"
    if name in listed:
        content = _checked(folder, name, listed[name])
        parameters = parse_parameters(content, str(folder / name))
    missions = tuple(
        FleetMission(
            _drone_of(name),
            name,
            sha256(content).hexdigest(),
            _known(content, str(folder / name), autopilot),
        )
        for name, content in contents.items()
    )
    return FleetFolder(token, autopilot, missions, parameters)


def _known(content: bytes, name: str, autopilot: str) -> tuple[WireItem, ...]:
    """Read a mission, every row of which is one that showc writes.

    What the verification refuses is put onto no vehicle: a stray item may end a flight
    anywhere.
    """
    try:
        read_mission(content, autopilot)
    except MissionFormatError as error:
        raise UsageError(
            f"{name}: {error}; compile the show again, and verify it"
        ) from None
    return parse_waypoints(content, name)


def _manifest(folder: Path) -> dict[str, Any]:
    path = folder / "manifest.json"
    try:
        content = json.loads(read_file(path, _MANIFEST_BYTES))
    except UnreadableFileError as error:
        raise UsageError(
            f"{path}: cannot be read ({error.reason}); give the folder that "
            "`showc compile` wrote"
        ) from None
    except (ValueError, RecursionError):
        raise UsageError(f"{path}: is not JSON") from None
    if not isinstance(content, dict):
        raise UsageError(f"{path}: is not a manifest; compile the show again")
    return content


def _checked(folder: Path, name: str, digest: str) -> bytes:
    """Content of a file whose hash the manifest names."""
    path = folder / name
    try:
        content = read_file(inside(path, folder), _MISSION_BYTES)
    except UnreadableFileError as error:
        raise UsageError(
            f"{path}: is in the manifest and cannot be read ({error.reason}); "
            "compile the show again"
        ) from None
    found = sha256(content).hexdigest()
    if found != digest:
        raise UsageError(
            f"{path}: has hash {found[:12]}…, the manifest says {digest[:12]}…: it was "
            "changed, or is of another compile; compile the show again"
        )
    return content


def _drone_of(name: str) -> int:
    return int(name.rsplit("_", 1)[1].removesuffix(".waypoints"))
