"""Files that a script names: read once, kept for hashes and attachments."""

from __future__ import annotations

from typing import TYPE_CHECKING

from showc.script.formations.shape import FormationError

if TYPE_CHECKING:
    from pathlib import Path

MAX_INPUT_BYTES = 64_000_000
"""Largest input file that is read [bytes]."""


class InputFiles:
    """Reads input files relative to the script's folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
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
        FormationError
            If it cannot be read or is too large.
        """
        if name in self.contents:
            return self.contents[name]
        path = self._folder / name
        try:
            size = path.stat().st_size
            if size > MAX_INPUT_BYTES:
                raise FormationError(
                    "SHW109",
                    f"`{name}` has {size} bytes, at most {MAX_INPUT_BYTES} are read",
                    key,
                )
            content = path.read_bytes()
        except (OSError, ValueError) as fault:
            reason = getattr(fault, "strerror", None) or str(fault)
            raise FormationError(
                "SHW109",
                f"`{name}` cannot be read: {reason}",
                key,
                help_text="names are relative to the script's folder",
            ) from None
        self.contents[name] = content
        return content
