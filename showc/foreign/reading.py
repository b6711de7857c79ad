"""Open a show of any format that is known here."""

from __future__ import annotations

from typing import TYPE_CHECKING

from showc.errors import DamagedFileError, UsageError
from showc.files import UnreadableFileError, read_file, reason_of
from showc.foreign.gltf import read_gltf
from showc.foreign.show import Courses, ForeignShow
from showc.foreign.skyb import read_compressed, read_skyb
from showc.foreign.skyc import read_skyc
from showc.foreign.tables import read_csv_files, read_csv_zip
from showc.foreign.vviz import read_vviz

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

LARGEST_BINARY = 1 << 20
"""Length of one drone's binary file that is read [bytes]: sixteen whole blocks."""

MOST_FILES = 5000
"""Drones in a folder."""

SHORTEST = 1e-4
"""Flights that take less are damage: formats count in milliseconds [s]."""

SUFFIXES = (".skyc", ".skyb", ".zip", ".csv", ".traj", ".vviz", ".gltf", ".glb")
"""Endings of the files that are known here."""

KNOWN = (
    "a .skyc, a .skyb or a folder of them, a Skybrush CSV zip or folder, a folder of "
    "poly7 .csv files, a .vviz, a .gltf or .glb"
)
"""What is known, for messages."""


def read_show(path: Path) -> ForeignShow:
    """Read a show of any known format.

    Raises
    ------
    UsageError
        If there is nothing there, or nothing that is known.
    DamagedFileError
        If the bytes are not what the format wants; the message says where.
    """
    show = _read(path)
    if show.duration < SHORTEST:
        raise DamagedFileError(
            f"{path}: its flights take {show.duration:.3g} s; wanted at least "
            f"{SHORTEST} s"
        )
    return show


def _read(path: Path) -> ForeignShow:
    if not path.exists():
        raise UsageError(f"{path}: is not there; wanted {KNOWN}")
    if path.is_dir():
        return _folder(path)
    readers: dict[str, Callable[[Path], ForeignShow]] = {
        ".skyc": read_skyc,
        ".skyb": lambda file: _binaries(file, [file]),
        ".traj": lambda file: _binaries(file, [file]),
        ".zip": read_csv_zip,
        ".csv": lambda file: read_csv_files(file, [file]),
        ".vviz": read_vviz,
        ".gltf": read_gltf,
        ".glb": read_gltf,
    }
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise UsageError(f"{path}: is of no format that is known; wanted {KNOWN}")
    return reader(path)


def _folder(path: Path) -> ForeignShow:
    try:
        files = sorted(
            file
            for file in path.iterdir()
            if file.suffix.lower() in SUFFIXES
            and not file.name.startswith(".")
            and file.is_file()
        )
    except OSError as error:
        raise UnreadableFileError(path, reason_of(error)) from None
    kinds = {file.suffix.lower() for file in files}
    if len(files) > MOST_FILES:
        raise DamagedFileError(
            f"{path}: has {len(files):,} show files; wanted at most {MOST_FILES:,}"
        )
    if kinds in ({".skyb"}, {".traj"}):
        return _binaries(path, files)
    if kinds == {".csv"}:
        return read_csv_files(path, sorted(files, key=lambda file: _natural(file.stem)))
    if len(files) == 1:
        return read_show(files[0])
    raise UsageError(
        f"{path}: holds {', '.join(sorted(kinds)) or 'no show files'}; wanted {KNOWN}"
    )


def _binaries(path: Path, files: list[Path]) -> ForeignShow:
    """One show of the binary files of its drones, in the order of their names."""
    files = sorted(files, key=lambda file: _natural(file.stem))
    raw = files[0].suffix.lower() == ".traj"
    read = read_compressed if raw else read_skyb
    courses, found = Courses(path), []
    for file in files:
        found.append(read(_binary(file), file.name))
        courses.add(found[-1].course)
    return ForeignShow(
        path=str(path),
        format="Crazyflie .traj" if raw else ".skyb",
        title=path.stem,
        names=tuple(file.stem for file in files),
        tracks=courses.tracks(),
        lights=() if raw else tuple(one.lights for one in found),
        yaws=() if raw else tuple(one.yaw for one in found),
        stored=() if raw else tuple(one.stored for one in found),
    )


def _binary(file: Path) -> bytes:
    """Read one drone's binary file; one that is too long is not a show."""
    try:
        return read_file(file, LARGEST_BINARY)
    except UnreadableFileError as error:
        raise DamagedFileError(str(error)) from None


def _natural(name: str) -> tuple[tuple[int, int, str], ...]:
    """Sort key that puts drone 2 before drone 10."""
    parts, digits, letters = [], "", ""
    for letter in name + "\0":
        if letter.isdigit() and letter.isascii():
            if letters:
                parts.append((1, 0, letters))
                letters = ""
            digits += letter
        else:
            if digits:
                parts.append((0, int(digits[:18]), ""))
                digits = ""
            letters += letter
    return tuple(parts)
