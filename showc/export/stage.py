"""From a trajectory log to files of another format, proved as they were written."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from showc._version import __version__
from showc.errors import DamagedFileError, UsageError
from showc.export.error import Sampled
from showc.export.fit import TOLERANCE, YAW_STEP, FittedFleet, decoded, fit_fleet
from showc.export.lights import bytecode, light_nodes
from showc.export.pictures import glb_file, kml_file, vviz_file
from showc.export.skyb import skyb_file, trajectory_block, yaw_block
from showc.export.skyc import Setpoints, skyc_file
from showc.export.tables import crazyflie_files, csv_zip, memory_notes, poly7_files
from showc.export.takeoff import slowed
from showc.files import alone, stage_for, unwritable, write_through
from showc.foreign.closed import PARAMETERS, drone_name
from showc.foreign.facts import Asked
from showc.foreign.folder import (
    FORMAT_VERSION,
    MANIFEST,
    prove,
    read_manifest,
    rules_to_json,
)
from showc.foreign.parameters import landing_speed, parameter_file
from showc.foreign.show import FencePolygon
from showc.foreign.showmode import FOLLOWED

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from showc.export.solved import SolvedShow
    from showc.log.showc_pb2 import Separation
    from showc.verify.report import Check

LEAD = 10.0
"""How long the fleet stands before the show begins, unless asked [s]: the firmware
needs it to start motors and climb."""

SAMPLED = {"skybrush-csv": 0.03, "vviz": 0.05}
"""Greatest distance from the solved flight where straight lines join samples [m]: at
20 m/s² an eighth of the square of the step, and what rounding takes."""

_FORMER = "former"


@dataclass(frozen=True, slots=True)
class ExportOptions:
    """What a user may choose about an export."""

    lead: float
    """How long the fleet stands before the show begins [s]."""
    tolerance: float = TOLERANCE
    """Greatest distance of the written flight from the solved one [m]."""
    separation: float | None = None
    """Distance to keep in the air [m]; None: the script's."""

    @classmethod
    def usual(cls, form: str) -> Self:
        """Return what serves a format unless a user says otherwise."""
        return cls(LEAD if form in WAITING else 0.0)


@dataclass(frozen=True, slots=True)
class Written:
    """Files of one format, before they are on disk."""

    files: Mapping[str, bytes]
    """Content by name."""
    fit: Mapping[str, Any]
    """What the fit cost, for the manifest."""
    speed_error: float
    """Greatest error of a velocity [m/s]."""
    position_error: float
    """Greatest error of a position [m]."""
    duration: float
    """How long the written show is [s]."""
    lost: tuple[str, ...]
    """What the format cannot carry."""


@dataclass(frozen=True, slots=True)
class Exported:
    """An export on disk."""

    folder: Path
    """Where it lies."""
    written: Written
    """What it holds."""
    checks: tuple[Check, ...]
    """What was proved of its bytes."""

    @property
    def proved(self) -> bool:
        """Whether no check failed."""
        return all(check.verdict != "fail" for check in self.checks)


def _flown(show: SolvedShow, options: ExportOptions) -> FittedFleet:
    """Fit what show mode is to follow."""
    return fit_fleet(
        show, lead=options.lead, tolerance=options.tolerance, followed=FOLLOWED
    )


def _binary(show: SolvedShow, options: ExportOptions) -> Written:
    """Make one binary file a drone."""
    show = slowed(show, options.lead)
    fitted = _flown(show, options)
    programs = _programs(show, options.lead, range(show.drones))
    comment = f"showc {__version__}: {show.rules.name}"
    times = YAW_STEP * np.arange(fitted.yaw.shape[1])
    files = {
        f"{drone_name(drone)}.skyb": skyb_file(
            trajectory_block(fitted, drone),
            programs[drone],
            yaw_block(_yaw(fitted, drone), times.tolist()),
            f"{comment}, drone {drone + 1}",
        )
        for drone in range(show.drones)
    }
    files[PARAMETERS] = parameter_file(landing_speed(decoded(fitted)))
    return _fitted(
        files,
        fitted,
        (
            "site, fence, cues and validation settings: one file is one drone's",
            *_LOST_BY_PROGRAMS,
        ),
    )


def _compiled(show: SolvedShow, options: ExportOptions) -> Written:
    """Put the whole show in one archive."""
    show = slowed(show, options.lead)
    fitted = _flown(show, options)
    times = YAW_STEP * np.arange(fitted.yaw.shape[1])

    def beside(drones: Sequence[int]) -> list[tuple[bytes, Setpoints]]:
        programs = _programs(show, options.lead, drones)
        yaws = [_setpoints(_yaw(fitted, drone), times) for drone in drones]
        return list(zip(programs, yaws, strict=True))

    archive = skyc_file(show, fitted, beside)
    files = {
        "show.skyc": archive,
        PARAMETERS: parameter_file(landing_speed(decoded(fitted))),
    }
    return _fitted(files, fitted, _LOST_BY_PROGRAMS)


_LOST_BY_PROGRAMS = (
    (
        "lights between their samples: fades are straight within 4 of 255, on a grid "
        "of 20 ms"
    ),
    "attitude, body rates, thrust: the firmware finds its own",
)

_LOST_BY_PATHS = ("attitude, body rates, thrust", "site, fence, rules")


def _tables(show: SolvedShow, options: ExportOptions) -> Written:
    """Make a zip of one table a drone."""
    lost = (
        "what lies between two rows: straight lines 50 ms long, so velocity jumps",
        *_LOST_BY_PATHS,
    )
    return _sampled(csv_zip(show, options.lead), lost)


def _pieces(show: SolvedShow, options: ExportOptions) -> Written:
    """Make one file of polynomial pieces a drone."""
    found, step = poly7_files(show, options.lead, options.tolerance)
    pieces = round(found.duration * 1000.0 / step)
    lost = ("lights", *_LOST_BY_PATHS, *memory_notes(found.files, pieces))
    return _sampled(found, lost, {"pieces_ms": step})


def _compressed(show: SolvedShow, options: ExportOptions) -> Written:
    """Make one compressed trajectory a drone."""
    fitted = fit_fleet(show, lead=options.lead, tolerance=options.tolerance)
    files = crazyflie_files(fitted)
    lost = (
        "lights",
        "yaw that changes: it stays what it is at the start",
        *_LOST_BY_PATHS,
        *memory_notes(files, None),
    )
    return _fitted(files, fitted, lost)


def _visualisation(show: SolvedShow, options: ExportOptions) -> Written:
    """Make one document of steps and colours."""
    lost = (
        "what lies between two samples: straight lines 100 ms long",
        "attitude, body rates, thrust, fence, rules",
    )
    return _sampled(vviz_file(show, options.lead), lost)


def _scene(show: SolvedShow, options: ExportOptions) -> Written:
    """Make one animated scene."""
    fitted = fit_fleet(show, lead=options.lead, tolerance=options.tolerance)
    lost = (
        (
            "lights between their samples: fades are straight within 4 of 255; what "
            "lacks KHR_animation_pointer shows each drone's brightest colour"
        ),
        *_LOST_BY_PATHS,
    )
    return _fitted({"show.glb": glb_file(show, fitted)}, fitted, lost)


def _map(show: SolvedShow, options: ExportOptions) -> Written:
    """Make a map of the site and the ways."""
    del options
    lost = ("times, lights, attitude: a map shows where, not when",)
    files = {"show.kml": kml_file(show)}
    return Written(files, {}, 0.0, 0.0, show.duration, lost)


FORMATS: dict[str, Callable[[SolvedShow, ExportOptions], Written]] = {
    "skyc": _compiled,
    "skyb": _binary,
    "skybrush-csv": _tables,
    "poly7": _pieces,
    "crazyflie": _compressed,
    "vviz": _visualisation,
    "gltf": _scene,
    "kml": _map,
}
"""Writers by the format's name on the command line."""

WAITING = {"skyc", "skyb"}
"""Formats in which the fleet stands before the show begins, for motors and climb."""


def _sampled(
    found: Sampled,
    lost: tuple[str, ...],
    more: Mapping[str, Any] = MappingProxyType({}),
) -> Written:
    error = found.error
    fit = {
        **more,
        "position_error_m": _rounded(error.position.upper),
        "velocity_error_m_s": _rounded(error.velocity.upper),
        "acceleration_error_m_s2": _rounded(error.acceleration.upper),
    }
    return Written(
        found.files,
        fit,
        error.velocity.upper,
        error.position.upper,
        found.duration,
        lost,
    )


def _programs(show: SolvedShow, lead: float, drones: Sequence[int]) -> list[bytes]:
    lights = show.lights[:, drones[0] : drones[-1] + 1]
    return [bytecode(one) for one in light_nodes(show.light_times, lights, lead)]


def _fitted(
    files: dict[str, bytes], fitted: FittedFleet, lost: tuple[str, ...]
) -> Written:
    grid = {
        "pieces_ms": fitted.shortest,
        "lead_s": fitted.lead / 1000.0,
        "grid_mm": int(fitted.scale.max()),
    }
    return _sampled(Sampled(files, fitted.error, fitted.duration), lost, grid)


def _rounded(value: float) -> float:
    """Round up to four decimals: an error bound stays one."""
    return float(np.ceil(value * 1e4) / 1e4)


def _yaw(fitted: FittedFleet, drone: int) -> list[float]:
    """Degrees clockwise from +x every ``YAW_STEP``."""
    return [-value for value in fitted.yaw[drone].tolist()]


def _setpoints(
    degrees: list[float], times: np.ndarray[Any, np.dtype[np.int64]]
) -> list[list[float]]:
    """Keep the first set point, and those where the yaw changes."""
    rounded = [round(value, 1) + 0.0 for value in degrees]
    kept = [0]
    for index in range(1, len(rounded)):
        last = index + 1 == len(rounded)
        if rounded[index] != rounded[kept[-1]] or (
            not last and rounded[index + 1] != rounded[index]
        ):
            kept.append(index)
    return [[int(times[index]) / 1000.0, rounded[index]] for index in kept]


def folder_for(log: Path, form: str) -> Path:
    """Return where an export goes unless a user says otherwise."""
    return log.with_name(f"{log.stem}-{form}")


def kept_apart(show: SolvedShow, distance: float | None) -> Separation:
    """Return the separation that must be left in the air; None: the script's [m]."""
    flown = show.separation
    if distance is not None:
        flown.distance = distance
    return flown


def rules_of(show: SolvedShow, error: float, speed_error: float) -> Asked:
    """Rules of the script, as the written flights must keep them.

    Speeds and walls include the error of the fit [m], [m/s]; the separation does not.
    """
    site, speeds = show.rules.site, show.speeds
    low, high = site.volume_min, site.volume_max
    return Asked(
        "the script's",
        show.separation,
        None,
        speeds.horizontal + speed_error,
        speeds.up + speed_error,
        speeds.down + speed_error,
        (
            (low.x - error, low.y - error, low.z - error),
            (high.x + error, high.y + error, high.z + error),
        ),
        (FencePolygon(True, show.fence),) if show.rules.site.fence else (),
    )


def export(
    show: SolvedShow,
    source: Mapping[str, str],
    form: str,
    folder: Path,
    options: ExportOptions,
) -> Exported:
    """Write a show in a format, prove the bytes, and put the folder in place.

    The former folder stays whole if anything goes wrong; what the proof finds does not
    keep the new one back, it stands in its manifest.

    Parameters
    ----------
    show
        What was solved.
    source
        For the manifest: name and hash of the log.
    form
        One of ``FORMATS``.
    folder
        Where the files go.
    options
        What the user chose.

    Raises
    ------
    ExportError
        If the show does not fit the format.
    UsageError
        If the place cannot be written, or holds what is no export.
    """
    refuse_foreign(folder)
    written = FORMATS[form](show, options)
    asked = rules_of(show, written.position_error, written.speed_error)
    flown = kept_apart(show, options.separation)
    try:
        with stage_for(folder, partial(_put_back, folder)) as stage:
            fresh = stage / folder.name
            fresh.mkdir()
            for name, content in written.files.items():
                (fresh / name).parent.mkdir(parents=True, exist_ok=True)
                write_through(fresh / name, content)
            exported = Exported(
                folder, written, tuple(prove(fresh, form, [asked], flown))
            )
            manifest = {
                **described(show, source, form, written, rules_to_json(asked, flown)),
                "proved": exported.proved,
                "checks": [check.to_json() for check in exported.checks],
            }
            text = json.dumps(manifest, indent=1, ensure_ascii=False) + "\n"
            write_through(fresh / MANIFEST, text.encode())
            with alone(folder.parent):
                refuse_foreign(folder)
                _exchange(folder, fresh, stage / _FORMER)
    except OSError as error:
        raise unwritable(folder, error) from error
    return exported


def described(
    show: SolvedShow,
    source: Mapping[str, str],
    form: str,
    written: Written,
    rules: Mapping[str, Any],
) -> dict[str, Any]:
    """Return what the manifest says of an export, its proof aside."""
    return {
        "format_version": FORMAT_VERSION,
        "showc": __version__,
        "format": form,
        "source": dict(source),
        "show": show.rules.name,
        "drones": show.drones,
        "duration": round(written.duration, 3),
        "fit": dict(written.fit),
        "cannot_carry": list(written.lost),
        "rules": dict(rules),
        "files": {
            name: sha256(content).hexdigest()
            for name, content in sorted(written.files.items())
        },
    }


def refuse_foreign(folder: Path) -> None:
    """Never replace what showc did not write.

    Raises
    ------
    UsageError
        If there is something at ``folder`` that is no export, or holds more.
    """
    if not folder.exists():
        return
    wrong = "is no folder"
    if folder.is_dir():
        there = {
            path.relative_to(folder).as_posix()
            for path in folder.rglob("*")
            if path.is_symlink() or not path.is_dir()
        }
        wrong = ""
        if there and MANIFEST not in there:
            wrong = f"has no {MANIFEST}"
        elif there:
            try:
                others = there - {MANIFEST, *read_manifest(folder).files}
                wrong = f"has {min(others)!r}" if others else ""
            except DamagedFileError:
                wrong = f"has an {MANIFEST} of something else"
    if wrong:
        raise UsageError(
            f"{str(folder)!r} exists and is no export of showc's (it {wrong}); move it "
            "away or choose another place with -o"
        )


def _put_back(folder: Path, stage: Path) -> None:
    """Put a former export back that a kill between two renames left in a stage."""
    if (stage / _FORMER).exists() and not folder.exists():
        (stage / _FORMER).rename(folder)


def _exchange(folder: Path, fresh: Path, former: Path) -> None:
    """Swap old for new; whatever interrupts it, the old comes back."""
    had = folder.exists()
    if had:
        folder.rename(former)
    try:
        fresh.rename(folder)
    except BaseException:
        if had:
            former.rename(folder)
        raise
