"""The script that a log is held against: the one attached, or the one given."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

from showc.files import read_file
from showc.script import read_show
from showc.verify.report import agreement, checked

if TYPE_CHECKING:
    from collections.abc import Mapping

    from showc.script import LoadResult
    from showc.script.show import Show
    from showc.verify.mcap import LogFile
    from showc.verify.report import Check

MANIFEST, LAYOUT = "manifest.json", "layout.json"

LARGEST_SCRIPT = 16_000_000
"""Size from which a script is refused [bytes]."""


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
