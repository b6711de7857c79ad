"""The script that a log is held against, and what a log says around its flight."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

from showc.files import read_file
from showc.log import showc_pb2 as pb
from showc.log.layout import layout_json
from showc.log.sample import GRID
from showc.script import read_show
from showc.verify.report import agreement, checked
from showc.verify.specification.compare import read_json, same, unlike

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from showc.script import LoadResult
    from showc.script.show import Show
    from showc.verify.kernel.show import LoggedShow, Segment
    from showc.verify.mcap import LogFile
    from showc.verify.report import Check

MANIFEST, LAYOUT = "manifest.json", "layout.json"

LARGEST_SCRIPT = 16_000_000
"""Size from which a script is refused [bytes]."""

FREE = ("fleet", "versions", "missions")
"""Parts of the manifest that the flight does not fix; missions are checked by
themselves."""

MISSIONS = {"autopilot", "files", "prediction", "start", "warnings"}
"""What a manifest says of its missions."""

PREDICTED = "/fleet/predicted"

_TOKEN = re.compile("[0-9a-f]{64}")
_RELEASE = re.compile(r"showc \d[\w.+-]{0,40}")

_MEDIA = {
    ".yaml": "application/yaml",
    ".yml": "application/yaml",
    ".json": "application/json",
    ".csv": "text/csv",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".jpg": "image/jpeg",
    ".jpeg": "image/jpeg",
}


@dataclass(frozen=True, slots=True, eq=False)
class Anchor:
    """What is trusted: everything else is compared with it."""

    name: str
    """Name of the script, without its folder."""
    sha256: str
    """Of its bytes, hexadecimal; empty if there are none."""
    given: bool
    """Whether it was given with the log, and not found in it."""
    show: Show | None
    """What it asks for; None if it cannot be read."""
    checks: tuple[Check, ...]
    """Whether it could be read, and is the one that the log carries."""

    def __str__(self) -> str:
        source = (
            "given with --script, and compared with the one in the log"
            if self.given
            else "found in the log; give your own with --script to trust no other"
        )
        return f"script “{self.name}”, sha256 {self.sha256 or 'none'}: {source}"


def read_anchor(
    log: LogFile, metadata: Mapping[str, str], script: Path | None = None
) -> Anchor:
    """Read the script with all files that it names.

    Parameters
    ----------
    log
        The log, whose attachments hold a script and its input files.
    metadata
        Of the log: ``script`` names the attachment.
    script
        The script to trust; None: the one attached.

    Raises
    ------
    UnreadableFileError
        If ``script`` cannot be read.
    """
    name = metadata.get("script", "")
    attached = {entry.name: log.attachment(entry.name) for entry in log.attachments}
    content = attached.pop(name, None) if name else None
    inputs = {
        key: data
        for key, data in attached.items()
        if key not in {MANIFEST, LAYOUT} and data is not None
    }
    bad: list[str] = []
    if content is None:
        bad.append(f"the log carries no script {name!r}")
    if script is None:
        text = content or b""
        result = read_show(text, path=name, attached=inputs)
    else:
        text = read_file(script, LARGEST_SCRIPT)
        result = read_show(
            text, path=str(script), folder=script.parent, allow_outside=True
        )
        bad += _others(text, content, result, inputs)
    checks = [
        agreement("VRF201", bad),
        _readable(result),
    ]
    digest = hashlib.sha256(text).hexdigest() if text else ""
    shown = PurePath(name if script is None else script).name
    return Anchor(shown, digest, script is not None, result.show, tuple(checks))


def _others(
    text: bytes,
    content: bytes | None,
    result: LoadResult,
    inputs: Mapping[str, bytes],
) -> list[str]:
    """How script and input files differ from those in the log."""
    bad = []
    if content is not None and content != text:
        bad.append("the script in the log is another one than the script given")
    wanted = {} if result.show is None else dict(result.show.source.inputs)
    bad += [
        f"the input file {name!r} in the log is not the script's"
        for name in sorted(wanted.keys() | inputs.keys())
        if wanted.get(name) != inputs.get(name)
    ]
    return bad


def _readable(result: LoadResult) -> Check:
    notes = tuple(f"{found.code}: {found.message}" for found in result.errors)
    return checked("VRF202", "fail" if result.show is None else "pass", notes=notes[:5])


def check_cover(
    log: LogFile, metadata: Mapping[str, str], show: LoggedShow, anchor: Anchor
) -> list[Check]:
    """Derive metadata, attachments and manifest from script and flight, and compare.

    Parameters
    ----------
    log
        The file.
    metadata
        Its metadata record.
    show
        The flight.
    anchor
        The script.
    """
    manifest = read_manifest(log)
    return [
        agreement("VRF105", _metadata(log, metadata, show, anchor)),
        agreement("VRF106", _attachments(log, metadata, show, anchor)),
        agreement("VRF107", _manifest(manifest, log, show, anchor)),
    ]


def read_manifest(log: LogFile) -> dict[str, Any] | None:
    """Return the manifest inside the log; None if it is no JSON object."""
    try:
        manifest = read_json(log.attachment(MANIFEST) or b"")
    except ValueError:
        return None
    return manifest if isinstance(manifest, dict) else None


def _sha256(content: bytes | None) -> str:
    return "" if content is None else hashlib.sha256(content).hexdigest()


def _metadata(
    log: LogFile, found: Mapping[str, str], show: LoggedShow, anchor: Anchor
) -> Iterator[str]:
    if len(log.metadata) != 1:
        yield f"there are {len(log.metadata)} metadata records, not one"
    epoch = show.epoch
    if anchor.show is not None:
        epoch = round(Fraction(anchor.show.epoch.timestamp()) * 1_000_000_000)
    if show.epoch != epoch:
        yield f"the log begins at {show.epoch} ns, the script at {epoch} ns"
    script = found.get("script", "")
    site = show.rules.site
    wanted: dict[str, str | float] = {
        "format_version": "1",
        "showc_version": log.library.removeprefix("showc "),
        "name": show.rules.name,
        "drones": str(show.drones),
        "rate_hz": show.rules.log_rate,
        "duration_s": show.duration,
        "epoch_ns": str(epoch),
        "frame": "map: origin at the site's origin, z up, +y along the heading",
        "body_frame": "forward, left, up; quaternion from body to map, x y z w",
        "origin_latitude": site.latitude,
        "origin_longitude": site.longitude,
        "origin_altitude": site.altitude,
        "heading": site.heading,
        "colours": "sRGB bytes on /fleet/state, linear on /drone/NNNN/state",
        "script": anchor.name,
        "script_sha256": _sha256(log.attachment(script)),
        "manifest_sha256": _sha256(log.attachment(MANIFEST)),
        **{f"grid_{name}": step for name, step in GRID.items()},
    }
    for key in sorted(wanted.keys() | found.keys()):
        if key not in found:
            yield f"{key} is missing"
        elif key not in wanted:
            yield f"{key!r} is no metadata of showc's"
        elif not _says(found[key], wanted[key]):
            yield f"{key}: the log says {found[key]!r}, it must be {wanted[key]!r}"


def _says(found: str, wanted: str | float) -> bool:
    if isinstance(wanted, str):
        return found == wanted
    try:
        return found == repr(float(found)) and same(float(found), wanted)
    except ValueError:
        return False


def _attachments(
    log: LogFile, metadata: Mapping[str, str], show: LoggedShow, anchor: Anchor
) -> Iterator[str]:
    if anchor.show is None:
        yield "not looked at: the script cannot be read"
        return
    script = metadata.get("script", "")
    names = [script, *sorted(anchor.show.source.inputs), MANIFEST, LAYOUT]
    found = log.attachments
    if [entry.name for entry in found] != names:
        yield f"the log carries {[one.name for one in found]}, the show has {names}"
    for entry in found:
        media = _MEDIA.get(
            PurePath(entry.name).suffix.lower(), "application/octet-stream"
        )
        if entry.media_type != media:
            yield f"{entry.name!r} has the type {entry.media_type!r}, not {media!r}"
        if not entry.log_time == entry.create_time == show.epoch:
            yield f"{entry.name!r} is not from the time of the show"
    plots = "/drone/0001/state" in {one.topic for one in log.channels.values()}
    if log.attachment(LAYOUT) != layout_json(anchor.show, plots=plots):
        yield "the layout for viewers is not the one of the show"


def _manifest(
    manifest: dict[str, Any] | None, log: LogFile, show: LoggedShow, anchor: Anchor
) -> Iterator[str]:
    if manifest is None:
        yield f"{MANIFEST} inside the log is no JSON object"
        return
    if anchor.show is None:
        yield "not looked at: the script cannot be read"
        return
    source = anchor.show.source
    height = max(
        float(table.state[:, :, 2].max())
        for segment in show.segments
        for table in segment.tables
    )
    wanted = {
        "format_version": 1,
        "show": {
            "name": anchor.show.name,
            "script": anchor.name,
            "sha256": anchor.sha256,
            "inputs": {name: _sha256(data) for name, data in source.inputs.items()},
            "epoch": anchor.show.epoch.isoformat(),
        },
        "drones": show.drones,
        "duration": round(show.duration, 3),
        "greatest_height": round(height, 3),
        "segments": [_leg(segment) for segment in show.segments],
    }
    # How the places were given out is said in words, and fixed by nothing.
    found = dict(manifest)
    if isinstance(found.get("segments"), list):
        found["segments"] = [
            {key: leg[key] for key in leg if key != "assignment"}
            if isinstance(leg, dict) and isinstance(leg.get("assignment"), str)
            else leg
            for leg in found["segments"]
        ]
    yield from _releases(found, log)
    for key in sorted(found.keys() | wanted.keys() | set(FREE)):
        if key not in found:
            yield f"{key} is missing"
        elif key in wanted:
            yield from unlike(found[key], wanted[key], key)
        elif key not in FREE:
            yield f"{key!r} is no part of a manifest"


def _releases(found: Mapping[str, Any], log: LogFile) -> Iterator[str]:
    """Hold what no flight fixes to its form."""
    missions = found.get("missions")
    if not isinstance(missions, dict) or missions.keys() != MISSIONS:
        yield f"missions says other things than {', '.join(sorted(MISSIONS))}"
    elif missions["autopilot"] is None and (
        missions["files"] or missions["prediction"] or missions["start"] is not None
    ):
        yield "there are no missions, and something is said of them"
    elif missions["autopilot"] is None and PREDICTED in {
        channel.topic for channel in log.channels.values()
    }:
        yield f"there are no missions, and {PREDICTED} draws them"
    elif not _texts(missions["warnings"]):
        yield "warnings on missions are no texts"
    if not _TOKEN.fullmatch(str(found.get("fleet"))):
        yield "fleet is no hash"
    if not _RELEASE.fullmatch(log.library):
        yield f"{log.library!r} is no release of showc's"
    versions = found.get("versions")
    if (
        not isinstance(versions, dict)
        or f"showc {versions.get('showc')}" != log.library
    ):
        yield "it is of another version of showc than the log"
    elif not all(_RELEASE.fullmatch(f"showc {one}") for one in versions.values()):
        yield "versions holds what is no version"


def _texts(value: object) -> bool:
    return isinstance(value, list) and all(isinstance(one, str) for one in value)


def _leg(segment: Segment) -> dict[str, Any]:
    """Return what the manifest says of a leg, from what the log says of it."""
    message = segment.message
    certificate = message.certificate
    single = certificate.single_drone_minimum
    witness, closest = certificate.witness, certificate.closest
    flat, knots = list(witness.multipliers), list(witness.knots)
    each = len(flat) // len(knots) if knots else 1
    beta = witness.beta
    return {
        "index": message.index,
        "name": message.name,
        "kind": pb.Segment.Kind.Name(message.kind).lower(),
        "start": round(message.start, 3),
        "duration": message.duration,
        "from": message.from_formation,
        "to": message.to_formation,
        "certificate": {
            "single_drone_minimum": single,
            "gap": message.duration / single - 1.0 if single > 0.0 else 0.0,
            "dual_bound": certificate.dual_bound,
            "witness": {
                "drone": witness.drone + 1,
                "time": witness.time,
                "beta": [beta.x, beta.y, beta.z],
                "knots": knots,
                "multipliers": [flat[k * each :][:each] for k in range(len(knots))],
            }
            if certificate.HasField("witness")
            else None,
            "closest": {
                "drones": [closest.drone_a + 1, closest.drone_b + 1],
                "time": closest.time,
                "distance": closest.distance,
            }
            if certificate.HasField("closest")
            else None,
            "method": certificate.method,
            "statistics": dict(certificate.statistics),
        },
    }
