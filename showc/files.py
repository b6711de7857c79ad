"""The one place that opens files which others may have made.

A file is read only if it is a regular one, so that a pipe cannot keep showc waiting and
a device cannot feed it for ever; only up to a limit; and, where a folder is given, only
if it lies inside, links followed. What is wrong is said without a byte of its content.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import TYPE_CHECKING

from showc.errors import UsageError

if TYPE_CHECKING:
    from typing import BinaryIO

_WITHOUT_WAITING = (
    getattr(os, "O_NONBLOCK", 0)
    | getattr(os, "O_CLOEXEC", 0)
    | getattr(os, "O_NOCTTY", 0)
    | getattr(os, "O_BINARY", 0)
)
_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)


class UnreadableFileError(UsageError):
    """A file is not read; ``reason`` says why in a few words."""

    def __init__(self, path: Path | str, reason: str) -> None:
        super().__init__(f"{str(path)!r} cannot be read: {reason}")
        self.reason = reason
        """Why, without the name."""


class OutsideFolderError(UnreadableFileError):
    """A file lies outside the folder that it must lie in."""


def open_file(path: Path | str) -> BinaryIO:
    """Open a regular file for reading bytes.

    Raises
    ------
    UnreadableFileError
        If it cannot be opened, or is a pipe, a device, a folder or a socket.
    """
    try:
        # Opening a device may do something already: look first, and look again after
        # opening, for the name may have been given to another file meanwhile.
        _demand_regular(path, Path(path).stat().st_mode)
        descriptor = os.open(path, os.O_RDONLY | _WITHOUT_WAITING)
        try:
            _demand_regular(path, os.fstat(descriptor).st_mode)
            return os.fdopen(descriptor, "rb")
        except BaseException:
            os.close(descriptor)
            raise
    except (OSError, ValueError) as fault:
        raise UnreadableFileError(path, reason_of(fault)) from None


def read_file(path: Path | str, most: int) -> bytes:
    """Read a regular file whole.

    Parameters
    ----------
    path
        Which one.
    most
        Largest size that is read [bytes].

    Raises
    ------
    UnreadableFileError
        If it cannot be read, is no regular file, or is larger.
    """
    with open_file(path) as stream:
        try:
            size = os.fstat(stream.fileno()).st_size
            # What grows meanwhile, or does not know its size, is judged by its bytes.
            content = stream.read(most + 1) if size <= most else b""
        except OSError as fault:
            raise UnreadableFileError(path, reason_of(fault)) from None
    if size > most or len(content) > most:
        raise UnreadableFileError(
            path,
            f"it has {max(size, len(content))} bytes, at most {most} are read",
        )
    return content


def inside(path: Path, folder: Path) -> Path:
    """Return where a path leads, all links followed, if that is inside a folder.

    Raises
    ------
    OutsideFolderError
        If it leads elsewhere.
    UnreadableFileError
        If it cannot be followed.
    """
    try:
        target = path.resolve()
        root = folder.resolve()
    except (OSError, ValueError, RuntimeError) as fault:
        raise UnreadableFileError(path, reason_of(fault)) from None
    if not target.is_relative_to(root):
        raise OutsideFolderError(path, "it lies outside the folder of the script")
    return target


def reason_of(fault: Exception) -> str:
    """Return what the system says of a fault, without the file's name."""
    return getattr(fault, "strerror", None) or str(fault) or type(fault).__name__


def _demand_regular(path: Path | str, mode: int) -> None:
    if not stat.S_ISREG(mode):
        kind = next((name for test, name in _KINDS if test(mode)), "no regular file")
        raise UnreadableFileError(path, f"it is {kind}, a regular file is wanted")
