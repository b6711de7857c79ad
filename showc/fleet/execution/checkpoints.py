"""Checkpoints: what an interrupted compile had found already is not solved again.

Each result is kept as soon as it is known, under a hash of the leg, the function and
its arguments. It is forgotten when the leg as a whole is kept. Results are plain data;
reading one back creates showc's own dataclasses and arrays, and nothing else.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import importlib
import io
import pickle
import shutil
from functools import partial
from typing import TYPE_CHECKING, Any

from showc.files import UnreadableFileError, read_file, stage_for
from showc.fleet.execution.cache import digest

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from showc.fleet.execution.pool import Workers

_MAGIC = b"showcpart"
_HASH = 32
"""Length of a SHA-256 [bytes]."""
_MOST_BYTES = 1_000_000_000
"""Largest part that is read [bytes]."""
_ARRAYS = {
    ("numpy", "dtype"),
    ("numpy", "ndarray"),
    ("numpy._core.multiarray", "_reconstruct"),
    ("numpy._core.multiarray", "scalar"),
    ("numpy._core.numeric", "_frombuffer"),
    ("numpy.core.multiarray", "_reconstruct"),
    ("numpy.core.multiarray", "scalar"),
    ("numpy.core.numeric", "_frombuffer"),
}


class _Reader(pickle.Unpickler):
    """Reads what was kept; whatever else a file asks for is refused."""

    def find_class(self, module: str, name: str) -> Any:  # noqa: ANN401 - as in pickle
        """Return a dataclass of showc's, or a part of numpy's arrays."""
        if (module, name) in _ARRAYS:
            return super().find_class(module, name)
        if module.startswith("showc."):
            found = getattr(importlib.import_module(module), name, None)
            if isinstance(found, type) and dataclasses.is_dataclass(found):
                return found
        raise pickle.UnpicklingError(f"{module}.{name} is not kept")


class Checkpointing:
    """Workers that look results up before they work, and keep what they find.

    Parameters
    ----------
    workers
        The workers.
    folder
        Where the parts of this leg are kept; made when needed.
    key
        Name of the leg's entry in the cache: everything that it depends on.
    """

    def __init__(self, workers: Workers, folder: Path, key: str) -> None:
        self._workers = workers
        self._folder = folder
        self._key = key

    def prepare(self) -> None:
        """See :class:`showc.fleet.execution.pool.Workers`."""
        self._workers.prepare()

    def run(
        self,
        function: Callable[..., Any],
        tasks: Sequence[tuple[Any, ...]],
        done: Callable[[int], None] = lambda _: None,
        found: Callable[[int, Any], None] = lambda _, __: None,
    ) -> list[Any]:
        """See :class:`showc.fleet.execution.pool.Workers`."""
        try:
            name = _name(function)
            keys = [digest(self._key, name, *task) for task in tasks]
        except (TypeError, AttributeError):  # what has no name or hash is not kept
            return self._workers.run(function, tasks, done, found)
        paths = [self._folder / f"{key}.part" for key in keys]
        results: dict[int, Any] = {}
        for number, path in enumerate(paths):
            kept = _read(path)
            if kept is not None:
                results[number] = kept[0]
                found(number, kept[0])
        if results:
            done(len(results))
        missing = [number for number in range(len(tasks)) if number not in results]

        def keep(place: int, value: Any) -> None:  # noqa: ANN401 - any result
            _write(paths[missing[place]], value)
            found(missing[place], value)

        if missing:
            values = self._workers.run(
                function, [tasks[number] for number in missing], done, keep
            )
            results.update(zip(missing, values, strict=True))
        return [results[number] for number in range(len(tasks))]

    def forget(self) -> None:
        """Remove all parts: the leg as a whole is kept."""
        shutil.rmtree(self._folder, ignore_errors=True)


def _name(function: Callable[..., Any]) -> list[Any]:
    """Return what a function is called, and what it was given beforehand."""
    given: list[Any] = []
    while isinstance(function, partial):
        given += [function.args, function.keywords]
        function = function.func
    return [f"{function.__module__}.{function.__qualname__}", *given]


def _read(path: Path) -> tuple[Any] | None:
    """Return the result kept at ``path``; None if there is none, or a damaged one."""
    try:
        content = read_file(path, _MOST_BYTES)
    except UnreadableFileError:
        return None
    head = len(_MAGIC) + _HASH
    payload = content[head:]
    if content[:head] == _MAGIC + hashlib.sha256(payload).digest():
        with contextlib.suppress(Exception):  # whatever a strange file provokes
            return (_Reader(io.BytesIO(payload)).load(),)
    with contextlib.suppress(OSError):
        path.unlink()
    return None


def _write(path: Path, value: object) -> None:
    """Keep a result; a full or read-only disk is no reason to fail."""
    payload = pickle.dumps(value, protocol=5)
    with contextlib.suppress(OSError), stage_for(path) as stage:
        new = stage / path.name
        new.write_bytes(_MAGIC + hashlib.sha256(payload).digest() + payload)
        new.replace(path)
