"""Numbers of unknown origin, checked once: finite, in bounds, times that rise."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from showc.errors import DamagedFileError

if TYPE_CHECKING:
    from showc.arrays import FloatArray

LARGEST_COORDINATE = 1e5
"""Greatest coordinate that is read [m]: a hundred kilometres is no show."""

LONGEST = 1e5
"""Longest show that is read [s]: more than a day."""


def number(value: Any, what: str) -> float:  # noqa: ANN401 - anything may come
    """Return a finite number.

    Raises
    ------
    DamagedFileError
        If ``value`` is none; ``what`` names it.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise DamagedFileError(f"{what}: is {_shown(value)}; wanted a number")
    try:
        result = float(value)
    except OverflowError:
        result = np.inf
    if not np.isfinite(result):
        raise DamagedFileError(f"{what}: is {_shown(value)}; wanted a finite number")
    return result


def array(value: Any, shape: tuple[int, ...], what: str) -> FloatArray:  # noqa: ANN401
    """Return numbers in an array of ``shape``, of which -1 stands for any length.

    Raises
    ------
    DamagedFileError
        If they are no numbers, or not of that shape.
    """
    try:
        found = np.asarray(value)
    except (TypeError, ValueError, OverflowError):
        found = np.array(None)
    if found.dtype.kind not in "iuf" and found.size:
        raise DamagedFileError(
            f"{what}: is {_shown(value)}; wanted numbers:{_described(shape)}"
        )
    result = found.astype(np.float64)
    fits = result.ndim == len(shape) and all(
        wanted in {-1, size} for wanted, size in zip(shape, result.shape, strict=False)
    )
    if not fits:
        raise DamagedFileError(f"{what}: is {_shown(value)}; wanted{_described(shape)}")
    return np.asarray(result)


def places(value: FloatArray, what: str) -> FloatArray:
    """Check positions (..., 3) [m].

    Raises
    ------
    DamagedFileError
        If one is not finite or further away than any show.
    """
    bad = ~(np.abs(value) <= LARGEST_COORDINATE)
    if bad.any():
        index = int(np.flatnonzero(bad.reshape(-1, value.shape[-1]).any(axis=1))[0])
        found = value.reshape(-1, value.shape[-1])[index]
        raise DamagedFileError(
            f"{what}: point {index + 1} is at {found.tolist()}; wanted finite numbers "
            f"of at most {LARGEST_COORDINATE:g} m"
        )
    return value


def rising(times: FloatArray, what: str, *, strictly: bool = True) -> FloatArray:
    """Check instants (n,) [s].

    Raises
    ------
    DamagedFileError
        If they do not rise (``strictly``: or two are equal), or lie beyond any show.
    """
    bad = ~((times >= -LONGEST) & (times <= LONGEST))
    if bad.any():
        index = int(np.flatnonzero(bad)[0])
        raise DamagedFileError(
            f"{what}: the time of point {index + 1} is {times[index]:g} s; wanted at "
            f"most {LONGEST:g} s"
        )
    steps = np.diff(times)
    back = np.flatnonzero(steps <= 0.0 if strictly else steps < 0.0)
    if back.size:
        index = int(back[0])
        raise DamagedFileError(
            f"{what}: time runs from {times[index]:g} s to {times[index + 1]:g} s "
            f"between points {index + 1} and {index + 2}; wanted times that rise"
        )
    return times


def _shown(value: Any) -> str:  # noqa: ANN401 - anything may come
    """Say what a value is, in few characters."""
    if isinstance(value, (dict, list)):
        return f"a {type(value).__name__} of {len(value)}"
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."


def _described(shape: tuple[int, ...]) -> str:
    if not shape:
        return " one number"
    sizes = " x ".join("any" if size < 0 else str(size) for size in shape)
    return f" an array of {sizes}"
