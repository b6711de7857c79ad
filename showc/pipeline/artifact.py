"""Put the compiler's results in place: all of them, or none.

An artifact is the log ``STEM.mcap`` and, beside it, the folder ``STEM/`` with the
manifest and the missions. Both are written into a stage first (:mod:`showc.files`);
only when every byte is on disk do they take the places of the former ones.
"""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

from showc.errors import UsageError
from showc.files import (
    UnreadableFileError,
    alone,
    clear,
    flush,
    read_file,
    stage_for,
    unwritable,
    write_through,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path
    from typing import BinaryIO


WRITERS = 4
"""Threads that write the small files: the disk makes several at once durable."""
_FORMER, _READY = "former", "ready"
_MANIFEST_BYTES = 100_000_000
"""Largest manifest that is read [bytes]: some hundred for each of 10,000 drones and
each of their legs."""
_DROPPINGS = {".DS_Store", "Thumbs.db"}
"""What systems put into any folder that is looked at."""


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
    try:
        with stage_for(log, _finish(log)) as stage:
            new_log, new_folder = stage / log.name, stage / folder.name
            paths = {new_folder / name: content for name, content in files.items()}
            for parent in {path.parent for path in paths}:
                parent.mkdir(parents=True, exist_ok=True)
            # Thousands of small files wait for the disk while the log is worked out.
            with ThreadPoolExecutor(WRITERS) as writers:
                written = [
                    writers.submit(write_through, *pair) for pair in paths.items()
                ]
                try:
                    with new_log.open("wb") as stream:
                        write_log(stream)
                        flush(stream)
                    for file in written:
                        file.result()
                except BaseException:
                    writers.shutdown(wait=False, cancel_futures=True)
                    raise
            with alone(log.parent):
                _refuse_foreign(folder)
                _exchange(log, folder, stage)
    except OSError as error:
        raise unwritable(log, error) from error


def prepare(log: Path) -> None:
    """See that a log can be placed, and clear away what killed processes left there.

    Raises
    ------
    UsageError
        If the folder beside the log is not one that showc wrote, or the log's name is
        none or that of a folder.
    """
    if log.is_dir():
        raise UsageError(
            f"{str(log)!r} is a folder; choose another name for the log with -o"
        )
    _refuse_foreign(folder_of(log))
    if log.parent.is_dir():
        clear(log, _finish(log))


def _finish(log: Path) -> Callable[[Path], None]:
    """Return what finishes the exchange that a stage of a killed process began."""

    def finish(stage: Path) -> None:
        if (stage / _READY).exists():
            _refuse_foreign(folder_of(log))
            _exchange(log, folder_of(log), stage)

    return finish


def _exchange(log: Path, folder: Path, stage: Path) -> None:
    """Swap old for new; whatever interrupts it, the old comes back.

    A kill cannot be answered at once: the mark says that all is ready, and calling this
    again finishes what is left to do.
    """
    new_log, new_folder = stage / log.name, stage / folder.name
    former = stage / _FORMER
    (stage / _READY).touch()
    moved_away = moved_in = False
    try:
        if new_folder.exists():
            if folder.exists():
                folder.rename(former)
                moved_away = True
            new_folder.rename(folder)
            moved_in = True
        if new_log.exists():
            new_log.replace(log)
    except BaseException:
        (stage / _READY).unlink()
        if moved_in:
            folder.rename(new_folder)
        if moved_away:
            former.rename(folder)
        raise


def _refuse_foreign(folder: Path) -> None:
    """Never replace a folder that holds anything that showc did not write.

    Raises
    ------
    UsageError
        Naming what is in the way.
    """
    if not folder.exists():
        return
    if not folder.is_dir():
        raise _foreign(folder, "is a file")
    there = {
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*")
        if (path.is_symlink() or not path.is_dir()) and path.name not in _DROPPINGS
    }
    if not there:
        return
    if "manifest.json" not in there:
        raise _foreign(folder, "has no manifest.json")
    written = _listed(folder / "manifest.json")
    if written is None:
        raise _foreign(folder, "has a manifest.json of something else")
    others = sorted(there - written)
    if others:
        more = f" and {len(others) - 1} more" if len(others) > 1 else ""
        raise _foreign(folder, f"has {others[0]!r}{more}")


def _listed(manifest: Path) -> set[str] | None:
    """Return the files that a manifest of showc's lists; None if it is none."""
    try:
        content = json.loads(read_file(manifest, _MANIFEST_BYTES))
        if not isinstance(content["versions"]["showc"], str):
            return None
        if not isinstance(content["fleet"], str):
            return None
        return {"manifest.json", *map(str, content["missions"]["files"])}
    except (UnreadableFileError, ValueError, KeyError, TypeError, RecursionError):
        return None


def _foreign(folder: Path, why: str) -> UsageError:
    return UsageError(
        f"{str(folder)!r} is not a folder that showc wrote: it {why}; move it away or "
        "choose another output with -o"
    )
