"""The script that a log is held against; the rules and documents that it must carry."""

from __future__ import annotations

import re
from itertools import islice
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

from google.protobuf.json_format import MessageToDict

from showc.documents.values import read_json, unlike
from showc.files import read_file
from showc.log import facts
from showc.log.schema import ADDITIONS, LAYOUT_NAME, MANIFEST_NAME, PREDICTED
from showc.script import read_show
from showc.verify.decode import CAPS
from showc.verify.report import NAMED, Check, agreement, checked

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from google.protobuf.message import Message

    from showc.log.container import LogFile
    from showc.script.show import Show
    from showc.verify.kernel.show import LoggedShow

_NIL: dict[str, Any] = {"autopilot": None, "files": {}, "prediction": {}, "start": None}
"""What a manifest says where there are none; else they are checked by themselves."""

_MORE = 10_000
"""Bytes beyond twice its own from which a message is not gone into: as text it would
take a hundred times as many."""

_TEXT = re.compile(".*", re.DOTALL)
_TOKEN = re.compile("[0-9a-f]{64}")
_DIALECT = re.compile("ardupilot|px4")
_LIBRARIES = "casadi", "mcap", "numpy", "protobuf", "scipy", "zstandard"
_RELEASE = re.compile(r"\d[\w.+-]{0,40}")


def read_anchor(
    log: LogFile, metadata: Mapping[str, str], script: Path | None = None
) -> tuple[str, Show | None, list[Check]]:
    """Read the script with all files that it names: everything is compared with it.

    It is ``script``, or the attachment that the log's metadata name. Returned are its
    name without its folder, with its hash and where it came from; what it asks for,
    None if it cannot be read; and whether it could be, and is the one in the log.

    Raises
    ------
    UnreadableFileError
        If ``script`` cannot be read.
    """
    name = metadata.get("script", "")
    attached = {entry.name: log.attachment(entry.name) for entry in log.attachments}
    content = attached.pop(name, None) if name else None
    own = {MANIFEST_NAME, LAYOUT_NAME, *ADDITIONS}
    inputs = {key: data or b"" for key, data in attached.items() if key not in own}
    bad: list[str] = []
    if content is None:
        bad.append(f"the log carries no script {name!r}")
    source = "given with --script, and compared with the one in the log"
    if script is None:
        source = "found in the log; give your own with --script to trust no other"
        text = content or b""
        result = read_show(text, path=name, attached=inputs)
    else:
        text = read_file(script, CAPS["script"])
        ways: Any = {"folder": script.parent, "allow_outside": True}
        result = read_show(text, path=str(script), **ways)
        if content not in {None, text}:
            bad.append("the script in the log is another one than the script given")
        wanted = {} if result.show is None else dict(result.show.source.inputs)
        odd = sorted(k for k in wanted | inputs if wanted.get(k) != inputs.get(k))
        bad += [f"the input file {key!r} in the log is not the script's" for key in odd]
    notes = tuple(f"{found.code}: {found.message}" for found in result.errors[:5])
    readable = checked("VRF202", "fail" if result.show is None else "pass", notes=notes)
    checks = [agreement("VRF201", bad), readable]
    digest = facts.sha256(text) if text else "none"
    shown = PurePath(name if script is None else script).name
    said = f"script “{shown}”, sha256 {digest}: {source}"
    return said, result.show, checks


def check_cover(
    log: LogFile, metadata: Mapping[str, str], show: LoggedShow, script: Show
) -> list[Check]:
    """Work metadata, attachments and manifest out of script and flight; compare."""
    return [
        agreement("VRF105", _metadata(log, metadata, show, script)),
        agreement("VRF106", _attachments(log, show, script)),
        agreement("VRF107", _manifest(log, show, script)),
    ]


def read_manifest(log: LogFile) -> dict[str, Any]:
    """Return the manifest inside the log; empty if it is no JSON object."""
    try:
        manifest = read_json(log.attachment(MANIFEST_NAME) or b"", CAPS["document"])
    except ValueError:
        return {}
    return manifest if isinstance(manifest, dict) else {}


def object_in(whole: Mapping[str, Any], key: str) -> dict[str, Any]:
    """Return what stands under a key of a JSON object, if that is an object itself."""
    found = whole.get(key)
    return found if isinstance(found, dict) else {}


def _metadata(
    log: LogFile, found: Mapping[str, str], show: LoggedShow, script: Show
) -> Iterator[str]:
    if len(log.metadata) != 1:
        yield f"there are {len(log.metadata)} metadata records, not one"
    epoch = facts.epoch_of(script)
    if show.epoch != epoch:
        yield f"the log begins at {show.epoch} ns, the script at {epoch} ns"
    version = log.library.removeprefix("showc ")
    manifest = log.attachment(MANIFEST_NAME) or b""
    wanted = facts.metadata_of(script, show.duration, version, manifest)
    yield from unlike(dict(found), wanted, "metadata")
    if [*found] != [*wanted]:
        yield f"the metadata are {', '.join(found)}, the show has {', '.join(wanted)}"


def _attachments(log: LogFile, show: LoggedShow, script: Show) -> Iterator[str]:
    plots = "/drone/0001/state" in {one.topic for one in log.channels.values()}
    manifest = log.attachment(MANIFEST_NAME) or b""
    wanted = facts.attachments_of(script, manifest, plots=plots)
    found = [one.name for one in log.attachments]
    names = [*wanted, *(one for one in ADDITIONS if one in found)]
    if found != names:
        yield f"the log carries {found}, the show has {names}"
    for entry in log.attachments:
        media = facts.media_type(entry.name)
        if entry.media_type != media:
            yield f"{entry.name!r} has the type {entry.media_type!r}, not {media!r}"
        if not entry.log_time == entry.create_time == show.epoch:
            yield f"{entry.name!r} is not from the time of the show"
        if wanted.get(entry.name) not in {None, log.attachment(entry.name)}:
            yield f"the content of {entry.name!r} is not the one of the show"


def _manifest(log: LogFile, show: LoggedShow, script: Show) -> Iterator[str]:
    found = read_manifest(log)
    if not found:
        yield f"{MANIFEST_NAME} inside the log is no JSON object"
        return
    height = max(float(one.table.state[:, :, 2].max()) for one in show.segments)
    messages = [one.message for one in show.segments]
    wanted = facts.manifest_of(script, messages, height, [""] * len(messages))
    # How places were given out is said in words, and fixed by nothing.
    for leg in wanted["segments"]:
        leg["assignment"] = _TEXT
    release, topics = log.library.removeprefix("showc "), log.channels.values()
    if not log.library.startswith("showc ") or not _RELEASE.fullmatch(release):
        yield f"{log.library!r} is no release of showc's"
    missions = object_in(found, "missions")
    none, known = (missions.get("autopilot") == one for one in (None, "ardupilot"))
    said = {key: missions.get(key) for key in _NIL} | {"autopilot": _DIALECT}
    if not known and any(one.topic == PREDICTED for one in topics):
        yield f"no flight of missions is known, and {PREDICTED} draws one"
    warnings = missions.get("warnings")
    texts = [_TEXT] * (len(warnings) if isinstance(warnings, list) else 0)
    wanted |= {
        "format_version": 1,
        "fleet": _TOKEN,
        "versions": dict.fromkeys(_LIBRARIES, _RELEASE) | {"showc": release},
        "missions": {**(_NIL if none else said), "warnings": texts},
    }
    yield from unlike(found, wanted, "manifest")


def differences(found: Message, wanted: Message) -> tuple[str, ...]:
    """Return what differs between two messages, at most a few lines."""
    if found == wanted:
        return ()
    if found.ByteSize() > 2 * wanted.ByteSize() + _MORE:
        return (f"{wanted.DESCRIPTOR.name} says far more than is asked for",)
    ways: dict[str, Any] = {"preserving_proto_field_name": True}
    ways |= {"always_print_fields_with_no_presence": True}
    one, other = (MessageToDict(message, **ways) for message in (found, wanted))
    return tuple(islice(unlike(one, other, wanted.DESCRIPTOR.name), NAMED))
