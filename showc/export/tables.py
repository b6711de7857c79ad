"""Flights as columns of numbers: CSV tables, polynomial pieces, Crazyflie's memory."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Self

import numpy as np

from showc.errors import ExportError
from showc.export.error import FitError, Sampled, error_of, error_of_lines
from showc.export.fit import TOGETHER, along, states, tracks_of
from showc.export.skyb import trajectory_block
from showc.export.skyc import Entry, archive, shared
from showc.foreign.closed import drone_name
from showc.foreign.motion import chosen, derivative
from showc.foreign.smoothing import rise, widened
from showc.foreign.tables import DEGREE, bernstein_of_powers
from showc.processes import side_by_side
from showc.verify.kernel.slices import Tracks

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from showc.arrays import ByteArray, FloatArray, IntArray
    from showc.export.fit import FittedFleet
    from showc.export.solved import SolvedShow


CSV_STEP = 0.05
"""Time between two rows of a table [s]: straight lines are 3 mm off at 10 m/s²."""

DECIMALS = 4
"""Of a place in metres: 0.1 mm, a hundredth of what a fit may be off."""

HEADING = "Time [msec],x [m],y [m],z [m],Red,Green,Blue"
"""First line of a table, as importers demand it."""

POLY7_STEPS = (1000, 500, 250, 200, 125, 100, 50)
"""Lengths of a polynomial piece that are tried, longest first [ms]."""

DIGITS = 12
"""Significant digits of a coefficient: the seventh power needs more than six."""

RAW_PIECES, COMPRESSED_BYTES = 31, 4096
"""What a Crazyflie's trajectory memory of 4 KiB holds: raw pieces, compressed bytes."""


def csv_zip(show: SolvedShow, lead: float) -> Sampled:
    """Return a zip of one table a drone."""
    samples = Samples.of(show, lead, CSV_STEP)
    milliseconds = np.rint(samples.times * 1000.0).astype(np.int64)

    def table(drones: Sequence[int]) -> list[Entry]:
        entries = []
        for drone in drones:
            place = np.rint(samples.places(drone) * 10.0**DECIMALS).astype(np.int64)
            columns = [
                decimals(milliseconds, 0),
                *(decimals(column, DECIMALS) for column in place.T),
                *(decimals(column, 0) for column in samples.lights[:, drone].T),
            ]
            text = f"{HEADING}\n".encode() + rows_of(columns)
            entries.append(Entry.of(f"{drone_name(drone)}.csv", text))
        return entries

    parts = [partial(table, some) for some in shared(show.drones)]
    content = archive(entry for some in side_by_side(parts) for entry in some)
    error = error_of_lines(samples.exact, CSV_STEP, 0.1**DECIMALS)
    return Sampled({"show.zip": content}, error, float(samples.times[-1]))


def decimals(whole: IntArray, places: int) -> ByteArray:
    """Write numbers, whole steps of a power of ten, as characters.

    Parameters
    ----------
    whole
        The numbers times 10 to the ``places``, shape (n,).
    places
        Digits after the point; without any there is no point.

    Returns
    -------
    ndarray
        ASCII, shape (n, width); zero where a shorter number has nothing.
    """
    size = np.abs(whole.astype(np.int64))
    digits = max(len(str(int(size.max(initial=0)))), places + 1)
    powers = 10 ** np.arange(digits - 1, -1, -1)
    shown = size[:, None] >= powers
    shown[:, digits - 1 - places :] = True
    signs = np.where(whole < 0, ord("-"), 0)[:, None]
    written = np.where(shown, size[:, None] // powers % 10 + ord("0"), 0)
    parts = [signs, written[:, : digits - places]]
    if places:
        points = np.full_like(signs, ord("."))
        parts += [points, written[:, digits - places :]]
    return np.concatenate(parts, axis=1).astype(np.uint8)


def rows_of(columns: Sequence[ByteArray]) -> bytes:
    """Join columns of characters, each of n rows: commas between, one line a row."""
    rows = columns[0].shape[0]
    parts = []
    for index, column in enumerate(columns):
        last = index + 1 == len(columns)
        end = ord("\n") if last else ord(",")
        parts += [column, np.full((rows, 1), end, dtype=np.uint8)]
    block = np.concatenate(parts, axis=1)
    return bytes(block[block != 0].tobytes())


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Places and lights of a show at even times."""

    exact: Tracks
    """The flights, in the show's own time."""
    times: FloatArray
    """Of the file, shape (T,) [s]; whole milliseconds, a whole number of steps."""
    lead: float
    """How much later than in the show everything happens [s]."""
    lights: ByteArray
    """Linear light, 0 to 255, shape (T, drones, 3)."""

    @classmethod
    def of(cls, show: SolvedShow, lead: float, step: float) -> Self:
        """Sample every ``step`` [s]; places are worked out drone by drone."""
        count = int(np.ceil((show.duration + lead) / step - 1e-9)) + 1
        times = np.round(step * np.arange(count), 3)
        moments = times - lead + 1e-9
        row = np.searchsorted(show.light_times, moments, side="right") - 1
        lights = show.lights[np.clip(row, 0, show.light_times.size - 1)]
        lights[times < lead] = 0
        return cls(tracks_of(show), times, lead, lights)

    def places(self, drone: int) -> FloatArray:
        """Places of a drone, shape (T, 3) [m]."""
        return along(self.exact, drone, self.times - self.lead)[:, :3]


def uniform(times: FloatArray, body: FloatArray) -> Tracks:
    """Tracks of a fleet whose pieces (drones, n, degree + 1, 3) share their times."""
    drones, pieces = body.shape[:2]
    return Tracks(
        float(times[0]),
        float(times[-1]),
        np.arange(drones + 1) * pieces,
        np.tile(times[:-1], drones),
        np.tile(times[1:], drones),
        body.reshape(-1, *body.shape[2:]),
    )


@dataclass(frozen=True, slots=True)
class _Pieces:
    """Polynomial pieces of some drones."""

    texts: list[bytes]
    """One file each."""
    error: FitError
    """What they cost."""
    step: int
    """Length of a piece [ms]."""
    end: float
    """When the last one ends [s]."""


def poly7_files(show: SolvedShow, lead: float, tolerance: float) -> tuple[Sampled, int]:
    """Return one file of polynomial pieces a drone, and the shortest piece [ms].

    Pieces have the flight's position and velocity at both ends, and its acceleration
    and jerk averaged over half a piece, so that the file has three derivatives. Some
    drones at a time have pieces of one length, the longest of ``POLY7_STEPS`` that
    keeps.

    Raises
    ------
    ExportError
        If no length of the pieces keeps within ``tolerance`` [m].
    """
    exact = tracks_of(show)

    def some(low: int) -> _Pieces:
        part, worst = chosen(exact, slice(low, low + TOGETHER)), np.inf
        for step in POLY7_STEPS:
            times, body = _septics(part, lead, step / 1000.0)
            lines = uniform(times, body[..., :3])
            error = error_of(part, lines, lead, first=low, jobs=1)
            worst = min(worst, error.position.upper)
            if error.position.upper <= tolerance:
                return _Pieces(_poly7_texts(times, body), error, step, float(times[-1]))
        raise ExportError(
            f"polynomial pieces of {POLY7_STEPS[-1]} ms miss the solved flight by "
            f"{1e3 * worst:.3g} mm; wanted at most {1e3 * tolerance:g} mm: allow more "
            "(`tolerance`)"
        )

    parts = side_by_side(
        [partial(some, low) for low in range(0, show.drones, TOGETHER)]
    )
    texts = [text for part in parts for text in part.texts]
    written = Sampled(
        {f"{drone_name(drone)}.csv": text for drone, text in enumerate(texts)},
        FitError.worst([part.error for part in parts]),
        max(part.end for part in parts),
    )
    return written, min(part.step for part in parts)


def _septics(exact: Tracks, lead: float, step: float) -> tuple[FloatArray, FloatArray]:
    """Return times (n + 1,) and coefficients (drones, n, 8, 4) of the pieces."""
    count = max(2, int(np.ceil((exact.end + lead) / step - 1e-9)))
    times = np.round(step * np.arange(count + 1), 6)
    nodes = np.broadcast_to(times - lead, (exact.drones, count + 1))
    wide = widened(exact, 2.0 * max(lead, 0.0) + 8.0 * step)
    window = 0.5 * step
    change = rise(derivative(wide), window)
    place, velocity = states(exact, nodes)
    push, _ = states(change, nodes)
    jerk, _ = states(rise(change, window), nodes)
    begin = (slice(None), slice(None, -1))
    end = (slice(None), slice(1, None))
    first = _ends(place[begin], velocity[begin], push[begin], jerk[begin], step)
    last = _ends(place[end], velocity[end], push[end], jerk[end], -step)
    return times, np.stack([*first, *last[::-1]], axis=2)


def _ends(
    place: FloatArray,
    velocity: FloatArray,
    push: FloatArray,
    jerk: FloatArray,
    step: float,
) -> list[FloatArray]:
    """First four Bernstein coefficients of degree 7 from three derivatives."""
    first = place
    second = first + velocity * step / 7.0
    third = 2.0 * second - first + push * step**2 / 42.0
    fourth = 3.0 * third - 3.0 * second + first + jerk * step**3 / 210.0
    return [first, second, third, fourth]


def _poly7_texts(times: FloatArray, body: FloatArray) -> list[bytes]:
    """Write pieces of some drones, coefficients (drones, n, 8, 4)."""
    powers = np.linalg.inv(bernstein_of_powers(DEGREE))
    width = np.diff(times)
    scale = width[:, None] ** np.arange(DEGREE + 1)
    ascending = np.einsum("kj,dnja->dnak", powers, body) / scale[None, :, None, :]
    heading = ",".join(
        ["duration"]
        + [f"{axis}^{power}" for axis in ("x", "y", "z", "yaw") for power in range(8)]
    )
    texts = []
    for drone in range(body.shape[0]):
        rows = [heading]
        for duration, piece in zip(
            width.tolist(),
            ascending[drone].reshape(width.size, -1).tolist(),
            strict=True,
        ):
            values = ",".join(f"{value:.{DIGITS}g}" for value in piece)
            rows.append(f"{duration:.6g},{values}")
        texts.append(("\n".join(rows) + "\n").encode("ascii"))
    return texts


def crazyflie_files(fitted: FittedFleet) -> dict[str, bytes]:
    """Return one compressed trajectory a drone, as a Crazyflie's memory holds it.

    Raises
    ------
    ExportError
        If the show is too wide for a grid of one millimetre.
    """
    if int(fitted.scale.max()) > 1:
        raise ExportError(
            "the show reaches further than 32.767 m from its origin; a Crazyflie's "
            "compressed trajectory holds no more"
        )
    files: dict[str, bytes] = {}
    for drone in range(fitted.drones):
        yaw = round(10.0 * float(fitted.yaw[drone, 0]))
        block = trajectory_block(fitted, drone, yaw=yaw)
        files[f"{drone_name(drone)}.traj"] = block[1:]
    return files


def memory_notes(files: Mapping[str, bytes], pieces: int | None) -> tuple[str, ...]:
    """Say which files a Crazyflie's memory does not hold."""
    found, most, unit = pieces, RAW_PIECES, "raw pieces"
    if found is None:
        found = max(len(content) for content in files.values())
        most, unit = COMPRESSED_BYTES, "bytes"
    if found <= most:
        return ()
    return (f"a Crazyflie's memory: it holds {most} {unit}, this show has {found}",)
