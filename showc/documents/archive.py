"""Archives of unknown origin, read within bounds.

An archive is looked at before anything of it is unpacked: names that lead out of it,
sizes that no show has and contents that unpack to many times their size are refused.
"""

from __future__ import annotations

import zipfile
import zlib
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any

from showc.documents.values import parse_json
from showc.errors import DamagedFileError
from showc.files import open_file

if TYPE_CHECKING:
    from pathlib import Path

MOST_ENTRIES = 20_000
"""Files in an archive: 5,000 drones with four files each."""

LARGEST_FILE = 1 << 29
"""Length of a file on disk that is opened at all [bytes]: half of what it may hold
unpacked."""

LARGEST_ENTRY = 1 << 27
"""Unpacked length of one entry [bytes]: 5,000 drones in one document, 26 kB each."""

LARGEST_ARCHIVE = 1 << 30
"""Unpacked length of all entries [bytes]: 5,000 drones, 200 kB each."""

SUSPICIOUS = 1 << 21
"""Unpacked length from which the ratio counts [bytes]."""

GREATEST_RATIO = 60
"""Unpacked over packed: numbers as text reach 10, repeated ones 30."""

MOST_UNPACKED = 1 << 30
"""Unpacked length of all documents that references read, each as often as it is read
[bytes]."""

DEEPEST_REFERENCE = 16
"""References that lead to references: longer chains are loops, or made to harm."""


class Archive:
    """A zip file, judged before it is unpacked.

    Raises
    ------
    DamagedFileError
        If it is no zip file, or one that harms.
    """

    def __init__(self, path: Path) -> None:
        self.name = str(path)
        stream = open_file(path)
        size = stream.seek(0, 2)
        if size > LARGEST_FILE:
            raise DamagedFileError(f"{path}: has {size:,} bytes; too long for a show")
        try:
            self._zip = zipfile.ZipFile(stream)
            entries = self._zip.infolist()
        except (OSError, zipfile.BadZipFile, ValueError, NotImplementedError) as error:
            raise DamagedFileError(f"{path}: is no whole zip file ({error})") from None
        if len(entries) > MOST_ENTRIES:
            raise DamagedFileError(
                f"{path}: has {len(entries):,} entries; wanted at most {MOST_ENTRIES:,}"
            )
        self._entries: dict[str, zipfile.ZipInfo] = {}
        for entry in entries:
            self._judge(entry)
            if entry.filename in self._entries:
                raise DamagedFileError(
                    f"{path}: has two entries named {entry.filename!r}"
                )
            self._entries[entry.filename] = entry
        total = sum(entry.file_size for entry in entries)
        if total > LARGEST_ARCHIVE:
            raise DamagedFileError(
                f"{path}: unpacks to {total:,} bytes; wanted at most "
                f"{LARGEST_ARCHIVE:,}"
            )

    def _judge(self, entry: zipfile.ZipInfo) -> None:
        name = entry.filename
        parts = PurePosixPath(name.replace("\\", "/"))
        if parts.is_absolute() or ".." in parts.parts or ":" in name.split("/")[0]:
            raise DamagedFileError(
                f"{self.name}: the entry {name!r} leads out of the archive"
            )
        if entry.file_size > LARGEST_ENTRY:
            raise DamagedFileError(
                f"{self.name}: the entry {name!r} unpacks to {entry.file_size:,} bytes;"
                f" wanted at most {LARGEST_ENTRY:,}"
            )
        ratio = entry.file_size / max(entry.compress_size, 1)
        if entry.file_size > SUSPICIOUS and ratio > GREATEST_RATIO:
            raise DamagedFileError(
                f"{self.name}: the entry {name!r} unpacks to {ratio:.0f} times its "
                f"size; wanted at most {GREATEST_RATIO} times"
            )

    @property
    def names(self) -> list[str]:
        """Names of all entries that are files, in order."""
        return [name for name in self._entries if not name.endswith("/")]

    def read(self, name: str) -> bytes:
        """Unpack one entry.

        Raises
        ------
        DamagedFileError
            If there is none of that name, or it is damaged or longer than it says.
        """
        if name not in self._entries:
            raise DamagedFileError(f"{self.name}: has no entry {name!r}")
        entry = self._entries[name]
        try:
            with self._zip.open(entry) as stream:
                content = stream.read(entry.file_size + 1)
        except (
            OSError,
            zipfile.BadZipFile,
            zlib.error,
            EOFError,
            RuntimeError,
            NotImplementedError,
            ValueError,
        ) as error:
            raise DamagedFileError(
                f"{self.name}: the entry {name!r} is damaged ({error})"
            ) from None
        if len(content) > entry.file_size:
            raise DamagedFileError(
                f"{self.name}: the entry {name!r} is longer than the archive says"
            )
        return content


class References:
    """Documents of an archive that refer to each other with ``$ref``."""

    def __init__(self, archive: Archive) -> None:
        self._archive = archive
        self._documents: dict[str, Any] = {}
        self._unpacked = 0
        self.followed: list[str] = []
        """Every reference that was followed, in order."""

    def resolved(self, value: Any) -> Any:  # noqa: ANN401 - any JSON
        """Follow references until there is a value; only this level is followed.

        Raises
        ------
        DamagedFileError
            If one leads nowhere, out of the archive, or in a circle.
        """
        seen: list[str] = []
        while isinstance(value, dict) and isinstance(value.get("$ref"), str):
            target = value["$ref"]
            if target in seen or len(seen) >= DEEPEST_REFERENCE:
                raise DamagedFileError(
                    f"{self._archive.name}: references go in a circle: "
                    + " -> ".join([*seen, target][:4])
                )
            seen.append(target)
            self.followed.append(target)
            value = self._target(target)
        return value

    def _target(self, target: str) -> Any:  # noqa: ANN401 - any JSON
        path, _, pointer = target.partition("#")
        name = str(PurePosixPath(path))
        if path.startswith("/") or ".." in PurePosixPath(path).parts or ":" in path:
            raise DamagedFileError(
                f"{self._archive.name}: the reference {target!r} leads out of the "
                "archive"
            )
        if name not in self._documents:
            content = self._archive.read(name)
            self._unpacked += len(content)
            if self._unpacked > MOST_UNPACKED:
                raise DamagedFileError(
                    f"{self._archive.name}: its references unpack more than "
                    f"{MOST_UNPACKED:,} bytes: the same documents over and over"
                )
            self._documents[name] = parse_json(content, f"{self._archive.name}:{name}")
        value = self._documents[name]
        for step in filter(None, pointer.split("/")):
            key = step.replace("~1", "/").replace("~0", "~")
            if isinstance(value, dict) and key in value:
                value = value[key]
            elif isinstance(value, list) and key.isdigit() and int(key) < len(value):
                value = value[int(key)]
            else:
                raise DamagedFileError(
                    f"{self._archive.name}: the reference {target!r} leads nowhere"
                )
        return value

    def forget(self) -> None:
        """Let go of parsed documents: each drone has its own, read once."""
        self._documents.clear()
        self.followed.clear()
