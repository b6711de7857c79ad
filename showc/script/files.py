"""Files that a script names: read once, kept for hashes and attachments."""

from __future__ import annotations

from pathlib import PurePath
from typing import TYPE_CHECKING

from showc.files import OutsideFolderError, UnreadableFileError, inside, read_file
from showc.script.diagnostic import ScriptError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

_MEGABYTE = 1_000_000
"""[bytes]."""
MOST_BYTES = {
    ".csv": 4 * _MEGABYTE,
    ".tsv": 4 * _MEGABYTE,
    ".txt": 4 * _MEGABYTE,
    ".json": _MEGABYTE,
    ".svg": 2 * _MEGABYTE,
    ".png": 32 * _MEGABYTE,
    ".jpg": 32 * _MEGABYTE,
    ".jpeg": 32 * _MEGABYTE,
    ".webp": 32 * _MEGABYTE,
    ".gif": 32 * _MEGABYTE,
    ".bmp": 32 * _MEGABYTE,
    ".ttf": 32 * _MEGABYTE,
    ".otf": 32 * _MEGABYTE,
    ".mp3": 32 * _MEGABYTE,
    ".ogg": 32 * _MEGABYTE,
    ".m4a": 32 * _MEGABYTE,
    ".flac": 48 * _MEGABYTE,
    ".wav": 48 * _MEGABYTE,
}
"""Largest file that is read, by its ending [bytes]: what the largest fleet can use, and
what can be decoded in 300 MB of memory."""
MESH_BYTES = 6 * _MEGABYTE
"""Largest file with any other ending, which is a model's [bytes]."""
TOTAL_BYTES = 64 * _MEGABYTE
"""All files of one script together [bytes]."""
TAKEN = {"manifest.json", "layout.json", "showc:abort.pb", "showc:wind.json"}
"""What a log has attached itself, beside the script and its files."""


class InputFiles:
    """Reads input files relative to the script's folder.

    Parameters
    ----------
    folder
        Of the script.
    outside
        Whether files elsewhere are read too.
    attached
        All files there are, by the name in the script: then none is read from the
        disk. None: they are read from ``folder``.
    """

    def __init__(
        self,
        folder: Path,
        *,
        outside: bool = False,
        attached: Mapping[str, bytes] | None = None,
    ) -> None:
        self._folder = folder
        self._outside = outside
        self._attached = attached
        self.contents: dict[str, bytes] = {}
        """What was read, by the name in the script."""

    def read(self, name: str, key: str) -> bytes:
        """Return a file's bytes.

        Parameters
        ----------
        name
            As the script names it.
        key
            The key that names it, for the error.

        Raises
        ------
        ScriptError
            If it cannot be read, is too large, or lies outside the script's folder.
        """
        if name in self.contents:
            return self.contents[name]
        if name in TAKEN:
            raise ScriptError(
                "SHW109",
                f"`{name}` cannot be read: the log has a file of its own of this name",
                key=key,
                help_text="give the file another name",
            )
        path = self._folder / name
        most = MOST_BYTES.get(PurePath(name).suffix.lower(), MESH_BYTES)
        try:
            if self._attached is not None:
                content = self._given(name, most)
            else:
                if not self._outside:
                    path = inside(path, self._folder)
                content = read_file(path, most)
        except UnreadableFileError as fault:
            raise ScriptError(
                "SHW109",
                f"`{name}` cannot be read: {fault.reason}",
                key=key,
                help_text="put it beside the script, or allow files elsewhere with "
                "--allow-outside"
                if isinstance(fault, OutsideFolderError)
                else self._near(name),
            ) from None
        total = sum(map(len, self.contents.values())) + len(content)
        if total > TOTAL_BYTES:
            raise ScriptError(
                "SHW119",
                f"`{name}` brings the script's files to {total} bytes, at most "
                f"{TOTAL_BYTES} are read",
                key=key,
            )
        self.contents[name] = content
        return content

    def _near(self, name: str) -> str:
        """Say which file is meant by a name that is none, as far as can be seen."""
        from showc.script.language.scalars import suggestion  # noqa: PLC0415 - start-up counts

        if "://" in name:
            return "download the file, and put it beside the script"
        otherwise = "names are relative to the script's folder"
        there = PurePath(name.replace("\\", "/"))
        if self._attached is not None or there.is_absolute() or ".." in there.parts:
            return otherwise
        try:
            beside = (self._folder / there.parent).iterdir()
            found = sorted(path.name for path in beside)
        except OSError:
            return otherwise
        near = suggestion(there.name, [one for one in found if "." in one])
        if not near or str(there.parent / near) == name:
            return otherwise
        return f"did you mean `{there.parent / near}`? {otherwise}"

    def _given(self, name: str, most: int) -> bytes:
        """Return the bytes of an attached file."""
        content = (self._attached or {}).get(name)
        if content is None:
            raise UnreadableFileError(name, "it is not attached")
        if len(content) > most:
            raise UnreadableFileError(name, f"it has more than {most} bytes")
        return content
