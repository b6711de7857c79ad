"""Put the compiler's results in place: all of them, or none.

An artifact is the log ``STEM.mcap`` and, beside it, the folder ``STEM/`` with the
manifest and the missions. Both are written under temporary names in the same folder
first; only when every byte is on disk do they take the places of the former ones.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from showc.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from typing import BinaryIO


WRITERS = 4
"""Threads that write the small files: the disk makes several at once durable."""


def folder_of(log: Path) -> Path:
    """Folder beside the log that holds manifest and missions.

    Raises
    ------
    UsageError
        If the log's name does not end in ``.mcap``.
    """
    if log.suffix != ".mcap" or not log.stem:
        raise UsageError(
            f"output {str(log)!r} does not end in .mcap; "
            "name the log, for example -o shows/grid.mcap"
        )
    return log.with_suffix("")


def place(
    log: Path, write_log: Callable[[BinaryIO], None], files: Mapping[str, bytes]
) -> None:
    """Write the log and the files of its folder, all or nothing.

    Parameters
    ----------
    log
        Path of the log; the folder is the same without ``.mcap``.
    write_log
        Writes the log's bytes to the open file it is given.
    files
        Content of the folder by relative path, with forward slashes.

    Raises
    ------
    UsageError
        If the place cannot be written. Former results are whole then.
    """
    folder = folder_of(log)
    _refuse_foreign(folder)
    try:
        log.parent.mkdir(parents=True, exist_ok=True)
        stage = Path(tempfile.mkdtemp(prefix=f".{log.stem}.", dir=log.parent))
    except OSError as error:
        raise _unwritable(log, error) from error
    try:
        new_log, new_folder = stage / log.name, stage / folder.name
        paths = {new_folder / name: content for name, content in files.items()}
        for parent in {path.parent for path in paths}:
            parent.mkdir(parents=True, exist_ok=True)
        # Thousands of small files wait for the disk while the log is worked out.
        with ThreadPoolExecutor(WRITERS) as writers:
            written = [writers.submit(_write, *pair) for pair in paths.items()]
            try:
                with new_log.open("wb") as stream:
                    write_log(stream)
                    _flush(stream)
                for file in written:
                    file.result()
            except BaseException:
                writers.shutdown(wait=False, cancel_futures=True)
                raise
        _exchange(log, new_log, folder, new_folder, stage / "former")
    except OSError as error:
        raise _unwritable(log, error) from error
    finally:
        shutil.rmtree(stage, ignore_errors=True)


def write_file(path: Path, content: bytes) -> None:
    """Write one file, whole or not at all.

    Raises
    ------
    UsageError
        If it cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(content)
                _flush(stream)
            Path(name).chmod(0o666 & ~_umask())
            Path(name).replace(path)
        except BaseException:
            with suppress(OSError):
                Path(name).unlink()
            raise
    except OSError as error:
        raise _unwritable(path, error) from error


def _exchange(
    log: Path, new_log: Path, folder: Path, new_folder: Path, former: Path
) -> None:
    """Swap old for new; whatever interrupts it, the old comes back."""
    had_folder = folder.exists()
    if had_folder:
        folder.rename(former)
    try:
        new_folder.rename(folder)
        try:
            new_log.replace(log)
        except BaseException:
            folder.rename(new_folder)
            raise
    except BaseException:
        if had_folder:
            former.rename(folder)
        raise


def _refuse_foreign(folder: Path) -> None:
    """Never replace a folder that showc did not write."""
    if not folder.exists():
        return
    if not folder.is_dir() or (
        any(folder.iterdir()) and not (folder / "manifest.json").is_file()
    ):
        raise UsageError(
            f"{str(folder)!r} exists and is not a folder that showc wrote (it has no "
            "manifest.json); move it away or choose another output with -o"
        )


def _write(path: Path, content: bytes) -> None:
    with path.open("wb") as stream:
        stream.write(content)
        _flush(stream)


def _flush(stream: BinaryIO) -> None:
    stream.flush()
    os.fsync(stream.fileno())


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _unwritable(path: Path, error: OSError) -> UsageError:
    reason = error.strerror or str(error)
    return UsageError(f"cannot write {str(path)!r}: {reason}; former files are whole")
