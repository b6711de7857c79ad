"""Exports that lie beside a log, proved against the log itself.

Nothing is taken from their own manifests but the hashes: rules come from the log, and
the written flights are held against the solved ones at every instant.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from mcap.reader import make_reader

from showc.errors import DamagedFileError
from showc.export.error import error_of
from showc.export.fit import tracks_of
from showc.export.lights import TOLERANCE as FADE
from showc.export.pictures import RATE
from showc.export.solved import solved_show
from showc.export.stage import (
    SAMPLED,
    WAITING,
    ExportOptions,
    folder_for,
    kept_apart,
    rules_of,
)
from showc.export.tables import CSV_STEP
from showc.export.takeoff import slowed
from showc.files import open_file
from showc.foreign.folder import MAPS, hashes, is_export, prove, read_manifest
from showc.foreign.lights import FRAME, read_lights
from showc.foreign.reading import read_show as read_foreign
from showc.foreign.verdict import damaged
from showc.log.additions import digest_of
from showc.log.reader import read_log
from showc.log.schema import METADATA_NAME
from showc.script import read_show
from showc.verify.report import Check, Place

if TYPE_CHECKING:
    from pathlib import Path

    from showc.export.solved import SolvedShow
    from showc.foreign.show import ForeignShow
    from showc.script.show import Export

UNLIT = {"poly7", "crazyflie"}
"""Formats without lights."""

STEPS = {"skybrush-csv": CSV_STEP, "vviz": 1.0 / RATE}
"""Time between two samples of lights [s]."""

TURNED = 0.5
"""Greatest difference of yaw [deg]: it is written to 0.1 deg, and straight between the
nodes of the fit."""

ROUNDING = 1e-6
"""How far rounding may carry a written flight beyond the tolerance [m]."""


def verify_beside(log: Path) -> list[Check]:
    """Prove the exports that the script in a log asks for.

    Parameters
    ----------
    log
        A log that is proved itself; its exports lie in folders beside it.

    Returns
    -------
    list
        Checks of all exports, each under the heading of its format; none where the
        script asks for no exports.
    """
    # Most shows ask for none: the index leads to the script, the rest stays unread.
    with open_file(log) as stream:
        reader = make_reader(stream)
        metadata = {one.name: one.metadata for one in reader.iter_metadata()}
        attached = {one.name: one.data for one in reader.iter_attachments()}
    name = metadata.get(METADATA_NAME, {}).get("script", "")
    show = read_show(attached.pop(name, b""), path=name, attached=attached).show
    if show is None or not show.exports:
        return []
    digest = digest_of(log)
    solved = solved_show(read_log(log), show)
    return [
        replace(check, group=f"export {wish.to}")
        for wish in show.exports
        for check in _one(folder_for(log, wish.to), wish, solved, digest)
    ]


def _one(folder: Path, wish: Export, solved: SolvedShow, digest: str) -> list[Check]:
    where = Place(file=str(folder))
    if not is_export(folder):
        note = f"there is no export {folder.name!r} beside the log; compile again"
        return [_check("VRF583", "export of this log", where, [note])]
    try:
        manifest = read_manifest(folder)
        checks = [hashes(folder, manifest.files)]
        wrong = []
        if manifest.source != digest:
            wrong.append("it was made from another log, by its manifest")
        if manifest.format != wish.to:
            wrong.append(f"its manifest says {manifest.format!r}")
        checks.append(_check("VRF583", "export of this log", where, wrong))
        flown = kept_apart(solved, wish.separation)
        if wish.to in MAPS:
            return checks + prove(folder, wish.to, [rules_of(solved, 0.0, 0.0)], flown)
        written = read_foreign(folder)
    except DamagedFileError as error:
        return list(damaged(folder, error).checks)
    if written.drones != solved.drones:
        note = f"it has {written.drones} flights, the log {solved.drones}"
        return [*checks, _check("VRF584", "flights of the log", where, [note])]
    lead = ExportOptions.usual(wish.to).lead if wish.lead is None else wish.lead
    lead = round(lead, 3)
    followed = slowed(solved, lead) if wish.to in WAITING else solved
    fit = error_of(tracks_of(followed), written.tracks, lead - followed.early)
    limit = max(wish.tolerance, SAMPLED.get(wish.to, 0.0))
    off = fit.position
    checks.append(
        Check(
            "VRF584",
            "",
            "flights of the log, their distance at every instant",
            "pass" if off.upper <= limit + ROUNDING else "fail",
            off.upper,
            limit,
            "m",
            Place(file=str(folder), drone=off.drone + 1, time=off.time),
        )
    )
    checks += _lit(written, solved, wish, lead, where)
    checks += _turned(written, followed, wish, lead, where)
    asked = rules_of(solved, off.upper, fit.velocity.upper)
    return checks + prove(folder, wish.to, [asked], flown)


def _lit(
    written: ForeignShow, solved: SolvedShow, wish: Export, lead: float, where: Place
) -> list[Check]:
    """Hold lights against the log's samples, at the instants that the format keeps."""
    if wish.to in UNLIT:
        return []
    name = "lights of the log, their difference at its samples"
    if len(written.lights) != solved.drones or None in written.lights:
        return [_check("VRF585", name, where, ["a drone has no lights"])]
    step = STEPS.get(wish.to, FRAME)
    frame = np.rint((solved.light_times + lead) / step)
    # Of samples in one frame the last one counts.
    keep = np.append(np.diff(frame) > 0.0, True)
    moments = frame[keep] * step
    shown = solved.lights[keep]
    if wish.to in STEPS:
        # A table has the sample before each of its rows.
        moments = step * np.arange(frame[0] + 1.0, frame[-1])
        row = np.searchsorted(solved.light_times, moments - lead + 1e-9, side="right")
        shown = solved.lights[row - 1]
    worst, drone, time = 0.0, 0, 0.0
    for number, light in enumerate(written.lights):
        end = float(moments[-1]) + step
        if isinstance(light, bytes):
            track = read_lights(light, written.names[number], end)
        elif light is not None:
            track = light
        off = np.abs(track.at(moments) - shown[:, number]).max(axis=1)
        if off.max() > worst:
            most = int(np.argmax(off))
            worst, drone, time = float(off[most]), number, float(moments[most] - lead)
    return [
        Check(
            "VRF585",
            "",
            name,
            "pass" if worst <= FADE + 1.0 else "fail",
            worst,
            FADE + 1.0,
            "of 255",
            replace(where, drone=drone + 1, time=time),
        )
    ]


def _turned(
    written: ForeignShow, solved: SolvedShow, wish: Export, lead: float, where: Place
) -> list[Check]:
    """Hold yaw against the flights', at every second of the file."""
    if wish.to not in WAITING:
        return []
    name = "yaw of the log, its difference every second"
    if len(written.yaws) != solved.drones or None in written.yaws:
        return [_check("VRF586", name, where, ["a drone has no yaw"])]
    moments = np.arange(np.floor(written.duration) + 1.0)
    worst, drone, time = 0.0, 0, 0.0
    for number, (track, flight) in enumerate(
        zip(written.yaws, solved.flights, strict=True)
    ):
        assert track is not None  # noqa: S101 - seen above
        asked = -np.degrees(flight(moments - lead + solved.early)[:, 3])
        off = np.interp(moments, track.times, track.angles) - asked
        # Full turns say nothing.
        off = np.abs((off + 180.0) % 360.0 - 180.0)
        if off.max() > worst:
            row = int(np.argmax(off))
            worst, drone, time = float(off[row]), number, float(moments[row] - lead)
    return [
        Check(
            "VRF586",
            "",
            name,
            "pass" if worst <= TURNED else "fail",
            worst,
            TURNED,
            "deg",
            replace(where, drone=drone + 1, time=time),
        )
    ]


def _check(code: str, name: str, where: Place, wrong: list[str]) -> Check:
    return Check(
        code, "", name, "fail" if wrong else "pass", where=where, notes=tuple(wrong)
    )
