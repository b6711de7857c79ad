"""When samples are taken, and one of them as it stands in the bytes of the log."""

from __future__ import annotations

from fractions import Fraction
from math import floor
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.arrays import ByteArray, FloatArray, IntArray


POINT = np.dtype(
    [
        *((name, "<f4") for name in ("x", "y", "z")),
        *((name, "u1") for name in ("red", "green", "blue", "alpha")),
        *((name, "<f4") for name in ("vx", "vy", "vz")),
        *((name, "<f4") for name in ("qx", "qy", "qz", "qw")),
        *((name, "<f4") for name in ("wx", "wy", "wz")),
        *((name, "<f4") for name in ("u0", "u1", "u2", "u3")),
    ]
)
"""A point of /fleet/state: position [m], screen colour (sRGB), velocity [m/s],
quaternion from body to map, body rates [rad/s], thrust [N] and torques [N m]."""

PLACE = np.dtype([(name, POINT[name]) for name in (POINT.names or ())[:7]])
"""A point of /fleet/predicted: position and colour alone."""

PREDICTED_COLOUR = (128, 128, 128)
"""Screen colour of the predicted fleet: grey, which is no light of a show."""
SMALL_FLEET = 100
"""Fleets up to this size are logged drone by drone as well."""
TRANSFORM_RATE = 5.0
"""Frames of single drones per second [Hz]: viewers draw straight lines in between, 5 cm
off at 10 m/s²."""
NANOSECONDS = 1_000_000_000
"""Per second."""
GRID = {
    "position": 2.0**-10,
    "velocity": 2.0**-10,
    "attitude": 2.0**-15,
    "body_rate": 2.0**-12,
    "thrust": 2.0**-12,
    "torque": 2.0**-17,
}
"""Samples are rounded to whole multiples of these (SI units); it halves the file."""


def nanoseconds(seconds: float) -> int:
    """Nearest whole nanosecond of a time [s]."""
    return round(Fraction(seconds) * NANOSECONDS)


def sample_times(duration: float, rate: float) -> IntArray:
    """Return the samples' times [ns]: the grid k / rate, and the end if not on it.

    Parameters
    ----------
    duration
        Length of the show [s].
    rate
        Samples per second [Hz].

    Returns
    -------
    ndarray
        Increasing from 0 to the end; grid times are rounded down to nanoseconds.
    """
    end = nanoseconds(duration)
    step = NANOSECONDS / Fraction(rate).limit_denominator(1_000_000)
    count = floor(end / step)
    times = np.arange(count + 1, dtype=np.int64) * step.numerator // step.denominator
    return times if times[-1] == end else np.append(times, end)


def on_grid(values: FloatArray, quantity: str) -> FloatArray:
    """Round to the grid of ``quantity``; never negative zero."""
    step = GRID[quantity]
    return np.asarray(np.rint(values / step) * step + 0.0)


def quaternion(attitude: FloatArray) -> FloatArray:
    """Rotation from body to map, x y z w, of roll, pitch, yaw [rad] (..., 3).

    The rotation is Rz(yaw) Ry(pitch) Rx(roll) (Diebel 2006, Representing attitude,
    sequence 1-2-3). Continuous in the angles, so no sign jumps between samples.
    """
    half = 0.5 * attitude
    sr, sp, sy = np.moveaxis(np.sin(half), -1, 0)
    cr, cp, cy = np.moveaxis(np.cos(half), -1, 0)
    return np.stack(
        [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ],
        axis=-1,
    )


def pack_points(
    state: FloatArray, control: FloatArray, screen: ByteArray
) -> NDArray[np.void]:
    """Return samples of a fleet as ``POINT`` records.

    Parameters
    ----------
    state
        Shape (T, drones, 12), order of ``showc.vehicle.STATE_NAMES``.
    control
        Shape (T, drones, 4).
    screen
        sRGB bytes, shape (T, drones, 3).

    Returns
    -------
    ndarray of POINT, shape (T, drones)
    """
    points = np.empty(state.shape[:2], dtype=POINT)
    columns: dict[tuple[str, ...], NDArray[Any]] = {
        ("x", "y", "z"): on_grid(state[..., 0:3], "position"),
        ("vx", "vy", "vz"): on_grid(state[..., 3:6], "velocity"),
        ("qx", "qy", "qz", "qw"): on_grid(quaternion(state[..., 6:9]), "attitude"),
        ("wx", "wy", "wz"): on_grid(state[..., 9:12], "body_rate"),
        ("u0",): on_grid(control[..., :1], "thrust"),
        ("u1", "u2", "u3"): on_grid(control[..., 1:], "torque"),
        ("red", "green", "blue"): screen,
    }
    for names, values in columns.items():
        for index, name in enumerate(names):
            points[name] = values[..., index]
    points["alpha"] = 255
    return points


def pack_places(position: FloatArray, colour: tuple[int, int, int]) -> NDArray[np.void]:
    """Positions (T, drones, 3) [m] in one screen colour, as ``PLACE`` records."""
    places = np.empty(position.shape[:2], dtype=PLACE)
    rounded = on_grid(position, "position")
    for index, name in enumerate(("x", "y", "z")):
        places[name] = rounded[..., index]
    for name, value in zip(("red", "green", "blue"), colour, strict=True):
        places[name] = value
    places["alpha"] = 255
    return places


def _message(number: int, names: tuple[str, ...]) -> list[tuple[str, str]]:
    """Fields of an embedded message of doubles: its tag and length, then its own."""
    fields = [(f"tag{number}", "u1"), (f"length{number}", "u1")]
    for index, name in enumerate(names):
        fields += [(f"tag{number}_{index + 1}", "u1"), (name, "<f8")]
    return fields


# Fields of a ``showc.DroneState`` by their numbers in the schema, with those inside.
_STATE_FIELDS = (
    (1, ("x", "y", "z")),
    (2, ("vx", "vy", "vz")),
    (3, ("roll", "pitch", "yaw")),
    (4, ("p", "q", "r")),
    (5, ("thrust",)),
    (6, ("torque_x", "torque_y", "torque_z")),
    (7, ("red", "green", "blue")),
)
DRONE_STATE = np.dtype(
    [
        field
        for number, names in _STATE_FIELDS
        for field in (
            [(f"tag{number}", "u1"), (names[0], "<f8")]
            if len(names) == 1
            else _message(number, names)
        )
    ]
)
"""The bytes of a ``showc.DroneState`` with every field present: always as long."""
_VARIABLE, _FIXED64, _LENGTH = 3, 1, 2
"""Protocol Buffers: bits of the wire type in a tag, and the types of doubles and of
embedded messages."""


def pack_drone_states(
    state: FloatArray, control: FloatArray, light: FloatArray
) -> NDArray[np.void]:
    """Return samples as encoded ``showc.DroneState`` messages, shape (T, drones).

    A million small messages made one by one would take longer than the rest of the
    log; with every field present, zeros too, all have one layout and numpy fills it.

    Parameters
    ----------
    state, control
        As for ``pack_points``.
    light
        Linear light, 0 to 1, shape (T, drones, 3).
    """
    quantities = ("position", "velocity", "attitude", "body_rate")
    groups = [
        on_grid(state[..., 3 * k : 3 * k + 3], name)
        for k, name in enumerate(quantities)
    ]
    groups += [on_grid(control[..., :1], "thrust"), on_grid(control[..., 1:], "torque")]
    groups.append(np.asarray(light))
    packed = np.empty(state.shape[:2], dtype=DRONE_STATE)
    for (number, names), values in zip(_STATE_FIELDS, groups, strict=True):
        single = len(names) == 1
        packed[f"tag{number}"] = number << _VARIABLE | (_FIXED64 if single else _LENGTH)
        if not single:
            packed[f"length{number}"] = 9 * len(names)
        for index, name in enumerate(names):
            if not single:
                packed[f"tag{number}_{index + 1}"] = (index + 1) << _VARIABLE | _FIXED64
            packed[name] = values[..., index]
    return packed
