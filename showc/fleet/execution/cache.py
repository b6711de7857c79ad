"""Solved legs, kept by what they were solved from.

The key is a hash of everything the result depends on, so an entry is never wrong, only
unused. Entries are written under a temporary name and renamed, so two compiles at once
cannot harm each other; each carries its own checksum, and a damaged one counts as
absent. The least recently used go when the folder grows too large.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import io
import json
import os
import zipfile
from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from showc._version import __version__
from showc.files import UnreadableFileError, clear_all, read_file, stage_for
from showc.flight import (
    Certificate,
    DualWitness,
    Encounter,
    LegFlight,
    MeshTaken,
    Trajectory,
)
from showc.trajectory import PiecewisePolynomial

if TYPE_CHECKING:
    from showc.fleet.options import SolveOptions
    from showc.plan.itinerary import Leg
    from showc.script.show import Show

FORMAT = "showc-leg-4"
"""Changes whenever results or their encoding change."""
_MAGIC = b"showcleg"
_DIGEST = 32
"""Length of a SHA-256 [bytes]."""
_MOST_BYTES = 2_000_000_000
"""Largest entry that is read [bytes]: ten times that of a thousand drones."""


def digest(*parts: object) -> str:
    """Hash of values, by their content: numbers, text, arrays, dataclasses, nested."""
    hasher = hashlib.sha256()
    for part in parts:
        _feed(hasher, part)
    return hasher.hexdigest()


def _feed(hasher: Any, value: object) -> None:  # noqa: ANN401, C901 - one kind a branch
    """Every value is preceded by its kind, so that no two look alike."""
    if isinstance(value, np.ndarray):
        hasher.update(f"a{value.dtype.str}{value.shape}".encode())
        hasher.update(np.ascontiguousarray(value).tobytes())
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        hasher.update(f"d{type(value).__name__}".encode())
        for item in dataclasses.fields(value):
            hasher.update(item.name.encode())
            _feed(hasher, getattr(value, item.name))
    elif isinstance(value, Mapping):
        hasher.update(f"m{len(value)}".encode())
        for key in sorted(value):
            _feed(hasher, key)
            _feed(hasher, value[key])
    elif isinstance(value, float | np.floating):
        hasher.update(b"f" + float(value).hex().encode())
    elif isinstance(value, bytes):
        hasher.update(f"b{len(value)}:".encode() + value)
    elif isinstance(value, str):
        encoded = value.encode()
        hasher.update(f"s{len(encoded)}:".encode() + encoded)
    elif isinstance(value, bool | int | np.integer) or value is None:
        hasher.update(f"i{value!r};".encode())
    elif isinstance(value, Sequence):
        hasher.update(f"l{len(value)}".encode())
        for entry in value:
            _feed(hasher, entry)
    else:
        raise TypeError(f"cannot hash a {type(value).__name__}")


def leg_key(leg: Leg, show: Show, options: SolveOptions) -> str:
    """Name the entry of a leg: hash of all that its flight depends on."""
    return digest(
        FORMAT,
        __version__,
        _engine_versions(),
        show.vehicle,
        leg.limits,
        show.airframe_limits,
        show.site.fence,
        show.site.fence_margin,
        show.separation,
        show.yaw,
        show.heading,
        leg.kind,
        leg.drones,
        leg.start,
        leg.goal,
        leg.start_state,
        leg.goal_state,
        leg.duration,
        leg.others_parked,
        leg.others,
        leg.parts,
        leg.motion,
        *([show.battery, show.site.altitude] if leg.prefer == "energy" else []),
        [options.gap, options.gap_limit, options.effort, options.repair_rounds],
    )


@lru_cache(maxsize=1)
def _engine_versions() -> list[str]:
    """Versions of the libraries that solve, and a hash of the code that uses them.

    With the hash an entry made by other code, however little it differs, is never
    taken; in a released package it changes exactly with the release.
    """
    from importlib.metadata import version  # noqa: PLC0415 - slow to import

    names = ("casadi", "clarabel", "highspy", "numpy", "scipy")
    return [*(version(name) for name in names), _source_digest()]


SOLVING = ("vehicle", "ocp", "fleet")
"""Folders of the package on which solved legs depend."""


def _source_digest() -> str:
    package = Path(__file__).parents[2]
    files = [
        package / "trajectory.py",
        package / "script" / "moving.py",
    ]
    for part in SOLVING:
        files += sorted((package / part).rglob("*.py"))
    return digest([path.read_bytes() for path in files])


class Cache:
    """A folder of solved legs."""

    def __init__(self, folder: Path | None, limit: int) -> None:
        self._folder = folder
        self._limit = limit

    @classmethod
    def of(cls, options: SolveOptions) -> Cache:
        """Return the cache that the options ask for."""
        if not options.use_cache:
            return cls(None, 0)
        cache = cls(options.cache or default_folder(), options.cache_limit)
        cache._clear()
        return cache

    def _clear(self) -> None:
        """Remove what killed processes left half written."""
        if self._folder is not None:
            for folder in chain(
                self._folder.glob("??"), self._folder.glob("??/*.parts")
            ):
                clear_all(folder)

    def find(self, key: str, leg: Leg) -> LegFlight | None:
        """Look an entry up; None if there is none, or only a damaged one."""
        if self._folder is None:
            return None
        path = self._path(key)
        try:
            content = read_file(path, _MOST_BYTES)
        except UnreadableFileError:
            return None
        flight = None
        # Whatever a strange file provokes: numbers without end, keys that are missing.
        with contextlib.suppress(Exception):
            flight = _decoded(content, leg)
        if flight is None:
            self.forget(key)
        with contextlib.suppress(OSError):
            os.utime(path)
        return flight

    def forget(self, key: str) -> None:
        """Remove an entry that is not what it should be, if that can be."""
        if self._folder is not None:
            with contextlib.suppress(OSError):
                self._path(key).unlink()

    def keep(self, key: str, flight: LegFlight) -> None:
        """Store an entry; a full or read-only disk is no reason to fail."""
        if self._folder is None:
            return
        path = self._path(key)
        with contextlib.suppress(OSError):
            with stage_for(path) as stage:
                (stage / path.name).write_bytes(_encoded(flight))
                (stage / path.name).replace(path)
            self._shrink()

    def parts(self, key: str) -> Path | None:
        """Return the folder for parts of an entry; None where nothing is kept."""
        if self._folder is None:
            return None
        return self._path(key).with_suffix(".parts")

    def _path(self, key: str) -> Path:
        assert self._folder is not None  # noqa: S101 - callers look first
        return self._folder / key[:2] / f"{key}.leg"

    def _shrink(self) -> None:
        """Remove the least recently used entries beyond the limit."""
        assert self._folder is not None  # noqa: S101 - callers look first
        entries = []
        kept = (self._folder.glob("*/*.leg"), self._folder.glob("*/*.parts/*.part"))
        for path in chain.from_iterable(kept):
            with contextlib.suppress(OSError):
                status = path.stat()
                entries.append((status.st_mtime_ns, path.name, status.st_size, path))
        size = sum(entry[2] for entry in entries)
        for _, _, weight, path in sorted(entries):
            if size <= self._limit:
                break
            with contextlib.suppress(OSError):
                path.unlink()
            size -= weight


def default_folder() -> Path | None:
    """Return ``showc`` in the user's cache folder (XDG base directories).

    None for a user without a home: nothing is kept then.
    """
    base = os.environ.get("XDG_CACHE_HOME")
    if base and Path(base).is_absolute():
        return Path(base) / "showc"
    try:
        home = Path.home()
    except RuntimeError:
        return None
    return home / ".cache" / "showc" if home.is_absolute() else None


def _encoded(flight: LegFlight) -> bytes:
    arrays: dict[str, Any] = {}
    alike: dict[tuple[bytes, int, int], list[int]] = {}
    for index, trajectory in enumerate(flight.trajectories):
        key = (
            trajectory.state.breaks.tobytes(),
            trajectory.state.degree,
            trajectory.control.degree,
        )
        alike.setdefault(key, []).append(index)
    for number, members in enumerate(alike.values()):
        flights = [flight.trajectories[index] for index in members]
        arrays[f"members{number}"] = np.array(members)
        arrays[f"breaks{number}"] = flights[0].state.breaks
        arrays[f"state{number}"] = np.stack([f.state.coefficients for f in flights])
        arrays[f"control{number}"] = np.stack([f.control.coefficients for f in flights])
    note = {
        "duration": flight.duration,
        "groups": len(alike),
        "certificate": dataclasses.asdict(flight.certificate),
        "meshes": {
            index: [dataclasses.asdict(mesh) for mesh in trajectory.meshes]
            for index, trajectory in enumerate(flight.trajectories)
            if trajectory.meshes
        },
    }
    arrays["note"] = np.frombuffer(json.dumps(note).encode(), dtype=np.uint8)
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    payload = stream.getvalue()
    return _MAGIC + hashlib.sha256(payload).digest() + payload


def _decoded(content: bytes, leg: Leg) -> LegFlight | None:
    head = len(_MAGIC)
    payload = content[head + _DIGEST :]
    if (
        content[:head] != _MAGIC
        or hashlib.sha256(payload).digest() != content[head : head + _DIGEST]
    ):
        return None
    with zipfile.ZipFile(io.BytesIO(payload)) as packed:
        # Ours are not compressed: what grows is not one of them.
        if sum(item.file_size for item in packed.infolist()) > len(payload):
            return None
    with np.load(io.BytesIO(payload), allow_pickle=False) as arrays:
        note = json.loads(arrays["note"].tobytes())
        trajectories: dict[int, Trajectory] = {}
        for number in range(note["groups"]):
            breaks = arrays[f"breaks{number}"]
            states, controls = arrays[f"state{number}"], arrays[f"control{number}"]
            for place, index in enumerate(arrays[f"members{number}"].tolist()):
                trajectories[index] = Trajectory(
                    PiecewisePolynomial(breaks, states[place]),
                    PiecewisePolynomial(breaks, controls[place]),
                    tuple(map(_mesh, note["meshes"].get(str(index), ()))),
                )
    record = note["certificate"]
    witness, closest = record.pop("witness"), record.pop("closest")
    if witness is not None:
        witness = DualWitness(
            witness["drone"],
            witness["time"],
            tuple(witness["beta"]),
            tuple(witness["knots"]),
            tuple(tuple(row) for row in witness["multipliers"]),
        )
    certificate = Certificate(
        witness=witness,
        closest=None if closest is None else Encounter(**closest),
        **record,
    )
    ordered = tuple(trajectories[index] for index in range(len(trajectories)))
    return LegFlight(leg, note["duration"], ordered, certificate)


def _mesh(record: dict[str, Any]) -> MeshTaken:
    parts: dict[str, Any] = {
        key: tuple(value) if isinstance(value, list) else value
        for key, value in record.items()
    }
    return MeshTaken(**parts)
