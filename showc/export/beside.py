"""Exports that lie beside a log, proved against the log itself.

Nothing is taken from their own manifests but the hashes: rules come from the log, and
the written flights are held against the solved ones at every instant. What a file holds
besides (site, fence, names, parameters) is what the export makes of this log: it is
written again, and compared.
"""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import replace
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.documents.archive import LARGEST_FILE
from showc.documents.values import unlike
from showc.errors import DamagedFileError, UsageError
from showc.export.error import error_of
from showc.export.fit import tracks_of
from showc.export.lights import TOLERANCE as FADE
from showc.export.pictures import RATE
from showc.export.skyc import entries_of
from showc.export.solved import solved_show
from showc.export.stage import (
    FORMATS,
    SAMPLED,
    WAITING,
    ExportOptions,
    described,
    folder_for,
    kept_apart,
    rules_of,
)
from showc.export.tables import CSV_STEP
from showc.export.takeoff import slowed
from showc.files import UnreadableFileError, read_file
from showc.foreign.folder import (
    MANIFEST,
    MAPS,
    hashes,
    is_export,
    prove,
    read_document,
    read_manifest,
    rules_to_json,
)
from showc.foreign.lights import FRAME, Budget, read_lights
from showc.foreign.reading import read_show as read_foreign
from showc.foreign.verdict import damaged
from showc.log.additions import digest_of
from showc.log.reader import read_log
from showc.verify.report import NAMED, Check, Place

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from collections.abc import Mapping as TypingMapping
    from pathlib import Path

    from showc.export.solved import SolvedShow
    from showc.foreign.show import ForeignShow
    from showc.script.show import Export, Show

UNLIT = {"poly7", "crazyflie"}
"""Formats without lights."""

STEPS = {"skybrush-csv": CSV_STEP, "vviz": 1.0 / RATE}
"""Time between two samples of lights [s]."""

TURNED = 0.5
"""Greatest difference of yaw [deg]: it is written to 0.1 deg, and straight between the
nodes of the fit."""

_FIGURES = {"value", "limit", "where", "notes"}
"""What a check says that rounding may change, and how its folder was named."""

_BESIDE = 8
"""Commands of a light program before its first sample and after its last, at most."""

ROUNDING = 1e-6
"""How far rounding may carry a written flight beyond the tolerance [m]."""


def verify_beside(log: Path, show: Show) -> list[Check]:
    """Prove the exports that the script in a log asks for.

    Parameters
    ----------
    log
        A log that is proved itself; its exports lie in folders beside it.
    show
        The show of its script.

    Returns
    -------
    list
        Checks of all exports, each under the heading of its format.
    """
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
        checks = [hashes(folder, read_manifest(folder).files)]
        usual = ExportOptions.usual(wish.to).lead
        lead = round(usual if wish.lead is None else wish.lead, 3)
        options = ExportOptions(lead, wish.tolerance, wish.separation)
        again, flown = (
            FORMATS[wish.to](solved, options),
            kept_apart(solved, wish.separation),
        )
        rules = rules_of(solved, again.position_error, again.speed_error)
        written = None if wish.to in MAPS else read_foreign(folder)
        if written is not None and written.drones != solved.drones:
            note = f"it has {written.drones} flights, the log {solved.drones}"
            return [*checks, _check("VRF584", "flights of the log", where, [note])]
        proved = prove(folder, wish.to, [rules], flown)
        source = {"data_sha256": digest}
        asked = described(solved, source, wish.to, again, rules_to_json(rules, flown))
        wrong = [*_unlike(folder, again.files), *_said(folder, asked, proved)]
        checks.append(_check("VRF583", "export of this log", where, wrong))
        if written is None:
            return checks + proved
    except DamagedFileError as error:
        return list(damaged(folder, error).checks)
    except UsageError as error:
        return [_check("VRF583", "export of this log", where, [str(error)])]
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
    return checks + proved


def _unlike(folder: Path, wanted: TypingMapping[str, bytes]) -> Iterator[str]:
    """Say which files are not those ``wanted``; archives may be packed otherwise."""
    for name, content in wanted.items():
        same = False
        with suppress(UnreadableFileError, ValueError, RuntimeError):
            found = read_file(folder / name, LARGEST_FILE)
            same = found == content
            if content.startswith(b"PK") and not same:
                entries = entries_of(content)
                most = sum(len(one) for _, one in entries)
                same = entries_of(found, most) == entries
        if not same:
            yield f"{name} is not what this release of showc writes of this log"


def _said(
    folder: Path, asked: TypingMapping[str, Any], proved: Sequence[Check]
) -> Iterator[str]:
    """Say what the manifest of an export has otherwise; figures of proofs aside."""
    found = read_document(folder)
    checks = [one.to_json() for one in proved]
    wanted = json.loads(json.dumps({**asked, "checks": checks}))
    wanted["proved"] = all(one.verdict != "fail" for one in proved)
    try:
        for said, one in zip(found["checks"], wanted["checks"], strict=False):
            one |= {key: said[key] for key in _FIGURES & one.keys()}
        # The log may have another name by now; hashes are held against the files.
        wanted["source"]["log"] = str(found["source"]["log"])
        wanted["files"] = {name: found["files"][name] for name in wanted["files"]}
    except (LookupError, TypeError):
        yield f"{MANIFEST} lacks what every export says"
    yield from islice(unlike(found, wanted, MANIFEST), NAMED)


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
    # Each sample takes two commands at most: one sets a colour, and one fades.
    budget = Budget(solved.drones * (2 * solved.light_times.size + _BESIDE))
    for number, light in enumerate(written.lights):
        end = float(moments[-1]) + step
        if isinstance(light, bytes):
            try:
                track = read_lights(light, written.names[number], end, budget)
            except DamagedFileError as error:
                return [_check("VRF585", name, where, [str(error)])]
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
