"""An export of showc's as it lies on disk: proved again from its bytes.

The folder has a manifest, ``export.json``: which rules the files were proved against,
what was proved, and the hash of every file. Nothing of what it says about the proof is
believed: files are read, decoded and judged anew.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from hashlib import sha256
from typing import TYPE_CHECKING, Any

from showc.documents.archive import LARGEST_FILE
from showc.documents.numbers import array, number
from showc.documents.values import read_json
from showc.errors import DamagedFileError
from showc.files import read_file, reason_of
from showc.foreign.closed import what_is_written
from showc.foreign.facts import Asked
from showc.foreign.firmware import Firmware
from showc.foreign.reading import read_show
from showc.foreign.show import FencePolygon
from showc.foreign.showmode import what_show_mode_makes
from showc.foreign.verdict import INTEGRITY, Drawing, answer, damaged
from showc.log.showc_pb2 import Separation
from showc.verify.report import Check, Verification

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from showc.foreign.show import ForeignShow

MANIFEST = "export.json"
"""Name of the manifest in the folder."""

FORMAT_VERSION = 1
"""Version of the manifest's format."""

FORMATS = {
    "skyc": ".skyc",
    "skyb": ".skyb",
    "skybrush-csv": "Skybrush .csv",
    "poly7": "poly7 .csv",
    "crazyflie": "Crazyflie .traj",
    "vviz": ".vviz",
    "gltf": "glTF",
    "kml": "",
}
"""What readers call a format, by its name on the command line; none reads maps."""

MOST_CORNERS = 100_000
"""Corners of the fence in a manifest: as many as a list of a script may have entries.
Flights are held against them as long as the pairs of both are few enough."""

LARGEST_MANIFEST = 1 << 23
"""Longest manifest that is read [bytes]: that of 10,000 drones has a ninth of it, and
one of brackets alone takes 0.25 GB of memory."""

SHOW_MODE = {"skyb", "skyc"}
"""Formats that show mode flies."""

SMOOTH = SHOW_MODE | {"poly7", "crazyflie", "gltf"}
"""Formats in which velocity goes on without a jump."""

MAPS = {"kml"}
"""Formats without flights."""

DRAWINGS = MAPS | {"gltf", "vviz"}
"""Formats that no aircraft flies."""


def is_export(path: Path) -> bool:
    """Whether ``path`` is a folder that ``showc export`` wrote."""
    try:
        return path.is_dir() and (path / MANIFEST).is_file()
    except OSError:  # a folder that may not be entered
        return False


def rules_to_json(asked: Asked, flown: Separation) -> dict[str, Any]:
    """Write down the rules that an export is proved against."""
    separation = asked.separation
    assert separation is not None  # noqa: S101 - a solved show has one
    return {
        "separation": {
            "distance": separation.distance,
            "shape": Separation.Shape.Name(separation.shape).lower(),
            "vertical_stretch": separation.vertical_stretch,
        },
        "separation_flown": flown.distance,
        "speed_xy": asked.speed_xy,
        "speed_up": asked.speed_up,
        "speed_down": asked.speed_down,
        "volume": asked.volume,
        "fence": [polygon.points.tolist() for polygon in asked.fence],
    }


def rules_from_json(content: Any, name: str) -> tuple[Asked, Separation]:  # noqa: ANN401
    """Read what :func:`rules_to_json` wrote.

    Raises
    ------
    DamagedFileError
        If it is not that.
    """
    try:
        separation = content["separation"]
        shape = str(separation["shape"]).upper()
        kept = Separation(
            distance=number(separation["distance"], f"{name}: separation"),
            shape=shape,
            vertical_stretch=number(separation["vertical_stretch"], f"{name}: stretch"),
        )
        flown = Separation()
        flown.CopyFrom(kept)
        flown.distance = number(
            content["separation_flown"], f"{name}: separation flown"
        )
        volume = array(content["volume"], (2, 3), f"{name}: volume")
        level, up, down = (
            number(content[key], f"{name}: {key}")
            for key in ("speed_xy", "speed_up", "speed_down")
        )
        fence = tuple(
            FencePolygon(True, array(points, (-1, 2), f"{name}: fence"))
            for points in content["fence"]
        )
    except (KeyError, TypeError, ValueError) as error:
        raise DamagedFileError(
            f"{name}: its rules cannot be read ({error!r})"
        ) from None
    corners = sum(len(polygon.points) for polygon in fence)
    if corners > MOST_CORNERS or any(len(one.points) < 3 for one in fence):
        raise DamagedFileError(
            f"{name}: its fence has {corners:,} corners; wanted 3 or more of each "
            f"polygon, and {MOST_CORNERS:,} in all"
        )
    (x, y, z), (far_x, far_y, far_z) = volume.tolist()
    asked = Asked(
        "the script's",
        kept,
        None,
        level,
        up,
        down,
        ((x, y, z), (far_x, far_y, far_z)),
        fence,
    )
    return asked, flown


@dataclass(frozen=True, slots=True)
class Manifest:
    """What ``export.json`` says."""

    format: str
    """Format by its name on the command line."""
    source: str
    """SHA-256 of the log that it was made from."""
    show: str
    """Name of the show."""
    drones: int
    """Size of the fleet."""
    duration: float
    """Of the written show [s]."""
    asked: Asked
    """Rules that the written flights must keep."""
    flown: Separation
    """Separation that must be left when show mode flies them."""
    files: Mapping[str, str]
    """SHA-256 by name."""
    release: str
    """Release of showc that wrote it."""
    error: float
    """Error of positions [m]."""


def read_document(folder: Path) -> Any:  # noqa: ANN401 - JSON
    """Return what the manifest of an export says, to all readers alike.

    Raises
    ------
    DamagedFileError
        If it is no JSON, holds a key twice, or is nested too deeply.
    UsageError
        If it cannot be read, or is too large.
    """
    path = folder / MANIFEST
    try:
        return read_json(read_file(path, LARGEST_MANIFEST), LARGEST_MANIFEST)
    except ValueError as error:
        raise DamagedFileError(f"{path}: is no JSON ({error})") from None


def read_manifest(folder: Path) -> Manifest:
    """Read the manifest of an export.

    Raises
    ------
    DamagedFileError
        If it is none of this version.
    UsageError
        If it cannot be read.
    """
    path, content = folder / MANIFEST, read_document(folder)
    if not isinstance(content, dict) or content.get("format_version") != FORMAT_VERSION:
        raise DamagedFileError(f"{path}: is no manifest of version {FORMAT_VERSION}")
    asked, flown = rules_from_json(content.get("rules"), str(path))
    files, source = content.get("files"), content.get("source")
    fit = content.get("fit")
    fit = fit if isinstance(fit, dict) else {}
    if str(content.get("format")) not in FORMATS:
        raise DamagedFileError(f"{path}: `format` must be one of {', '.join(FORMATS)}")
    if not isinstance(files, dict):
        raise DamagedFileError(f"{path}: lists no files")
    return Manifest(
        str(content.get("format")),
        str(source.get("data_sha256")) if isinstance(source, dict) else "",
        str(content.get("show")),
        int(number(content.get("drones"), f"{path}: drones")),
        number(content.get("duration"), f"{path}: duration"),
        asked,
        flown,
        {str(name): str(digest) for name, digest in files.items()},
        str(content.get("showc")),
        number(fit.get("position_error_m", 0.0), f"{path}: position_error_m"),
    )


def verify_export(folder: Path, beside: Asked | None = None) -> Verification:
    """Prove an export again from its bytes.

    Parameters
    ----------
    folder
        Where it lies.
    beside
        Rules that the written flights must keep besides those of the manifest.
    """
    rules = f"the rules in {MANIFEST}"
    try:
        manifest = read_manifest(folder)
    except DamagedFileError as error:
        return damaged(folder, error)
    checks = [hashes(folder, manifest.files)]
    asked = [manifest.asked]
    if beside is not None:
        asked.insert(0, beside)
        rules += f" and {beside.source} rules"
    kind = Drawing if manifest.format in DRAWINGS else Verification
    drones, duration = manifest.drones, manifest.duration
    if manifest.format in MAPS:
        checks += prove(folder, manifest.format, asked, manifest.flown)
    else:
        try:
            show = _read(folder, manifest.format)
            checks += what_is_written(folder, manifest, show)
            checks += _proved(show, manifest.format, asked, manifest.flown)
            drones, duration = show.drones, show.duration
        except DamagedFileError as error:
            checks += damaged(folder, error).checks
    return kind(
        str(folder), manifest.show[:200], drones, duration, rules, tuple(checks)
    )


def prove(
    folder: Path, form: str, asked: list[Asked], flown: Separation
) -> list[Check]:
    """Prove the written files of an export.

    Parameters
    ----------
    folder
        Where they lie.
    form
        Format by its name on the command line.
    asked
        Rules that the written flights must keep, those of the show last.
    flown
        Separation that must be left when show mode flies them.
    """
    if form in MAPS:
        note = "a drawing for people: nothing is flown by it, nothing is proved"
        return [
            Check("VRF582", INTEGRITY, "flights in the file", "skipped", notes=(note,))
        ]
    try:
        show = _read(folder, form)
    except DamagedFileError as error:
        return list(damaged(folder, error).checks)
    return _proved(show, form, asked, flown)


def _read(folder: Path, form: str) -> ForeignShow:
    """Read the files of an export, which must be of the manifest's format."""
    show = read_show(folder)
    if show.format != FORMATS[form]:
        said = f"{folder}: {MANIFEST} says {form}, the files are {show.format}"
        raise DamagedFileError(said)
    return show


def _proved(
    show: ForeignShow, form: str, asked: list[Asked], flown: Separation
) -> list[Check]:
    # The parameter file beside the files makes the firmware climb faster: it is held
    # against what is written.
    firmware = Firmware(climb_speed=5.0, climb_acceleration=5.0)
    found = answer(show, asked, firmware if form in SHOW_MODE else None)
    checks = found.facts
    if form in SMOOTH:
        checks = [_strict(check) for check in checks]
    if form in SHOW_MODE:
        checks += [_strict(check) for check in found.becomes]
        checks += what_show_mode_makes(show.tracks, found.closest, flown)
    return checks


def _strict(check: Check) -> Check:
    """Call a fault of our own files what of others is remarked."""
    return replace(check, verdict="fail") if check.verdict == "warning" else check


def hashes(folder: Path, listed: Mapping[str, str]) -> Check:
    """Tell whether the folder holds what the manifest lists, and nothing else."""
    notes, found = [], set[str]()
    try:
        # No export has a folder in it.
        found = {one.name for one in folder.iterdir()} - {MANIFEST}
    except OSError as error:
        notes = [f"the folder cannot be listed: {reason_of(error)}"]
    notes += [f"{name} is missing" for name in sorted(set(listed) - found)]
    notes += [f"{name} is not in the manifest" for name in sorted(found - set(listed))]
    for name in sorted(found & set(listed)):
        digest = sha256(read_file(folder / name, LARGEST_FILE)).hexdigest()
        if digest != listed[name]:
            notes.append(f"{name} was changed since it was written")
    return Check(
        "VRF581",
        INTEGRITY,
        "files are those of the manifest",
        "fail" if notes else "pass",
        float(len(found)),
        float(len(listed)),
        "files",
        notes=tuple(notes[:8]),
    )
