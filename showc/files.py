"""The one place that opens files which others may have made, and that makes new ones.

A file is read only if it is a regular one, so that a pipe cannot keep showc waiting and
a device cannot feed it for ever; only up to a limit; and, where a folder is given, only
if it lies inside, links followed. What is wrong is said without a byte of its content.

A file is written into a stage first, a folder with a name of chance in the same place.
A process holds its stages locked. A stage that no process holds shows that its
process was killed, and clears it away.
"""

from __future__ import annotations

import errno
import os
import re
import shutil
import stat
import tempfile
import time
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from showc.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from typing import BinaryIO

try:
    import fcntl
except ImportError:  # where there are no such locks, nothing is known of the others
    fcntl = None  # type: ignore[assignment]

_SUFFIX = ".showc-part"
_LONGEST_CHANGE = 20.0
"""Time after which a folder that another process holds is given up [s]: ten thousand
small files are put in their place in a tenth of that."""
_PAUSE = 0.02
"""Time between two looks at a lock [s]: fifty a second cost no time that counts."""
_SCRATCH = re.compile(r"\.showc-[a-z0-9_]{8}")
"""Name of a folder for what is temporary: short, for sockets in it have short names."""
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


def read_files(
    folder: Path, names: Sequence[str], each: int, whole: int
) -> tuple[dict[str, bytes], list[str]]:
    """Read regular files of a folder, each whole; one that cannot be read is empty.

    Parameters
    ----------
    folder
        Where they are.
    names
        Their paths in it.
    each, whole
        Largest size of one that is read, and of all; the rest is left out [bytes].

    Returns
    -------
    tuple
        Content of each file by its name; and what is wrong, with the names.
    """
    contents, wrong = dict[str, bytes](), list[str]()
    for name in names:
        content = b""
        try:
            content = read_file(folder / name, each)
        except UnreadableFileError as error:
            wrong.append(f"{name}: cannot be read: {error.reason}")
        whole -= len(content)
        if whole < 0:
            wrong.append(f"{name}: the files up to here are too large in sum")
            break
        contents[name] = content
    return contents, wrong


def strangers(folder: Path, inner: Sequence[str], known: Sequence[str]) -> list[str]:
    """Return what is in a folder beside what is ``known``, by its paths in it, sorted.

    Also looked into are the folders ``inner`` of it, and no others; no link is known.

    Raises
    ------
    OSError
        If one of them cannot be listed.
    """
    folders = [folder, *(folder / name for name in inner)]
    expected = {folder / name for name in known}
    expected |= {one for one in folders if not one.is_symlink()}
    found = {one for each in folders for one in each.iterdir()} - expected
    return sorted(one.relative_to(folder).as_posix() for one in found)


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
        raise UnreadableFileError(path, f"it is {kind}; expected a regular file")


def write_file(path: Path, content: bytes) -> None:
    """Write one file, whole or not at all.

    Raises
    ------
    UsageError
        If it cannot be written, or is no regular file.
    """
    try:
        if path.exists() and not path.is_file():
            raise UsageError(f"cannot write {str(path)!r}: it is no regular file")
        with stage_for(path) as stage:
            write_through(stage / path.name, content)
            (stage / path.name).replace(path)
    except OSError as error:
        raise unwritable(path, error) from error


def rewrite_file(path: Path, content: bytes) -> None:
    """Replace a user's file, whole or not at all; links and permissions stay.

    Raises
    ------
    UsageError
        If it cannot be written, or is no regular file.
    """
    target = path.resolve()
    try:
        if not target.is_file():
            raise UsageError(f"cannot write {str(path)!r}: it is no regular file")
        with stage_for(target) as stage:
            write_through(stage / target.name, content)
            (stage / target.name).chmod(stat.S_IMODE(target.stat().st_mode))
            (stage / target.name).replace(target)
    except OSError as error:
        raise unwritable(path, error) from error


def write_through(path: Path, content: bytes) -> None:
    """Write a new file, down to the disk."""
    with path.open("wb") as stream:
        stream.write(content)
        flush(stream)


def flush(stream: BinaryIO) -> None:
    """Wait until what was written is on the disk."""
    stream.flush()
    os.fsync(stream.fileno())


def unwritable(path: Path, error: OSError) -> UsageError:
    """Return what to raise where a file cannot be written."""
    return UsageError(
        f"cannot write {str(path)!r}: {reason_of(error)}; former files are whole"
    )


@contextmanager
def stage_for(
    target: Path, finish: Callable[[Path], None] | None = None
) -> Iterator[Path]:
    """Make a folder beside a file to be, held as long as this goes on, then removed.

    Parameters
    ----------
    target
        The file that will take its content from there.
    finish
        See :func:`clear`, which is called first.

    Raises
    ------
    OSError
        If the folder cannot be made.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    with alone(target.parent):
        _clear(target.parent, _stages(target.name), finish)
        stage = Path(
            tempfile.mkdtemp(
                prefix=f".{target.name}.", suffix=_SUFFIX, dir=target.parent
            )
        )
        held = _held(stage)
    try:
        yield stage
    finally:
        shutil.rmtree(stage, ignore_errors=True)
        if held is not None:
            os.close(held)


def clear(target: Path, finish: Callable[[Path], None] | None = None) -> None:
    """Remove the stages that killed processes left beside a file, if that can be.

    Parameters
    ----------
    target
        The file that they were for; its folder exists.
    finish
        Given each stage before it is removed: completes what had begun.
    """
    with suppress(OSError), alone(target.parent):
        _clear(target.parent, _stages(target.name), finish)


def clear_all(folder: Path) -> None:
    """Remove what killed processes left in a folder that only showc writes to."""
    with suppress(OSError), alone(folder):
        _clear(folder, _stages(None), None)


@contextmanager
def scratch(place: Path | None = None) -> Iterator[Path]:
    """Make a folder for what is of no use afterwards.

    Held as long as this goes on, then removed; what a killed process left there is
    removed by the next one.

    Parameters
    ----------
    place
        Where to make it; None: in the system's folder for temporary files.

    Raises
    ------
    OSError
        If it cannot be made.
    """
    place = place or Path(tempfile.gettempdir())
    # Others write there too: no lock on the place is waited for.
    with suppress(OSError):
        _clear(place, _SCRATCH, None)
    made = Path(tempfile.mkdtemp(prefix="showc-", dir=place))
    held = _held(made)
    # Only now has it a name that others clear: they see the lock.
    folder = made.rename(made.with_name(f".{made.name}"))
    owner = os.getpid()
    try:
        yield folder
    finally:
        # A copy of this process that lets go of all it has leaves the folder alone.
        if os.getpid() == owner:
            shutil.rmtree(folder, ignore_errors=True)
        if held is not None:
            os.close(held)


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Keep other processes of showc from changing a folder meanwhile.

    Raises
    ------
    OSError
        If another process, stopped perhaps, holds it longer than any change takes.
    """
    if fcntl is None:
        yield
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        end = time.monotonic() + _LONGEST_CHANGE
        while True:
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                if time.monotonic() > end:
                    raise OSError(
                        errno.EBUSY, f"another process holds {str(folder)!r} locked"
                    ) from None
                time.sleep(_PAUSE)
                continue
            except OSError:
                pass  # without locks what is done here is as quick as it was
            break
        yield
    finally:
        os.close(descriptor)


def _held(stage: Path) -> int | None:
    """Lock a stage for this process; None if another one holds it."""
    if fcntl is None:
        return None
    descriptor = os.open(stage, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        return None
    return descriptor


def _stages(name: str | None) -> re.Pattern[str]:
    """Return what the stages for a file are called; None: for any."""
    which = re.escape(name) if name is not None else ".+"
    return re.compile(rf"\.{which}\.[a-z0-9_]{{8}}{re.escape(_SUFFIX)}")


def _clear(
    folder: Path, pattern: re.Pattern[str], finish: Callable[[Path], None] | None
) -> None:
    """Remove the folders in a folder of such names that no process holds."""
    for stage in folder.iterdir():
        if not pattern.fullmatch(stage.name) or stage.is_symlink():
            continue
        with suppress(OSError):
            held = _held(stage)
            if held is None:
                continue
            try:
                if finish is not None:
                    finish(stage)
                shutil.rmtree(stage)
            finally:
                os.close(held)
