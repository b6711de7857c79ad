"""Jerk: how fast the acceleration of a quadrotor may change, in closed form.

With thrust T along the unit vector b of the attitude, the acceleration is (T / m) b
less gravity, and the jerk (T' / m) b + (T / m) b'. As b and b' are at right angles,

    |jerk|² = (T' / m)² + (T / m)² |b'|².

Roll and pitch alone turn b by |b'|² = p² + q² cos² roll <= p² + q². Yaw adds at most
sin(lean) |r| to |b'|, lean being the angle of b to the vertical, and (a + s c)² <=
(1 + s) (a² + s c²). So with s the sine of the greatest lean, 0 where yaw is held or
stands still,

    (m |jerk|)² <= T'² + (1 + s) T² (p² + q² + s r²).

The right side, a polynomial in what is flown, is what is limited. It leaves out cos²
roll: at 20 degrees that asks for at most 6 % less jerk than allowed. Where thrust jumps
no bound holds, so it must be continuous besides.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from showc.trajectory import product

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import FloatArray
    from showc.vehicle.quadrotor import Quadrotor

THRUST_JOINT = 5e-7
"""Greatest jump of the thrust at a joint [N]: half of what the proof allows."""


_AT_REST, _STILL = [3, 4, 5, 6, 7, 9, 10, 11], 1e-6
"""States that are zero at a hover, and how far off they may be: what a proof allows."""


def lean_factor(tilt: float, yaw: Literal["held", "free"]) -> float:
    """Sine s of the greatest lean where yaw is free, else 0.

    Parameters
    ----------
    tilt
        Greatest |roll| and |pitch| [rad].
    """
    return 0.0 if yaw == "held" else float(np.sqrt(1.0 - np.cos(tilt) ** 4))


def jerk_square(
    thrust: Any,  # noqa: ANN401 - numbers, arrays or symbols
    change: Any,  # noqa: ANN401 - same
    rates: Sequence[Any],
    lean: float,
) -> Any:  # noqa: ANN401 - same
    """Bound on the squared mass times jerk [N²/s²], of numbers or of symbols.

    Parameters
    ----------
    thrust, change
        T [N] and its rate T' [N/s].
    rates
        p and q, and r unless yaw is held [rad/s].
    lean
        s of :func:`lean_factor`.
    """
    p, q, *r = rates
    turning = p**2 + q**2 + lean * sum(rate**2 for rate in r)
    return change**2 + (1.0 + lean) * thrust**2 * turning


def greatest_jerk(
    vehicle: Quadrotor,
    lean: float,
    breaks: FloatArray,
    state: FloatArray,
    control: FloatArray,
) -> FloatArray:
    """Bounds on the jerk whose greatest one holds at every instant.

    They are roots of the Bernstein coefficients of :func:`jerk_square`.

    Parameters
    ----------
    lean
        s of :func:`lean_factor`; it counts where yaw turns.
    breaks
        Shape (K + 1,) [s].
    state, control
        Bernstein coefficients of flights, shapes (..., K, degree + 1, 12 and 4).

    Returns
    -------
    ndarray, shape (..., K, m)
        [m/s³]; infinite where thrust jumps at a joint, or is not that of a hover at an
        end at rest.
    """
    thrust, hover = control[..., 0], vehicle.hover_thrust
    degree = thrust.shape[-1] - 1
    change = degree * np.diff(thrust, axis=-1) / np.diff(breaks)[:, None]
    if not degree:
        change = np.zeros_like(thrust)
    turns = np.any(state[..., 11], axis=-1, keepdims=True)
    sine = lean * turns
    share = np.sqrt((1.0 + sine) * np.array([1.0, 1.0, lean]))
    turning = [
        share[..., axis : axis + 1] * product(thrust, state[..., 9 + axis])
        for axis in range(3 if lean else 2)
    ]
    # Times 1, written in what the degree lacks.
    ones = np.ones(turning[0].shape[-1] - change.shape[-1] + 1)
    square = sum(product(part, part) for part in (product(change, ones), *turning))
    size = np.sqrt(np.maximum(square, 0.0)) / vehicle.mass
    ends = (
        (thrust[..., :1, 0], state[..., :1, 0, :]),
        (
            thrust[..., -1:, -1],
            state[..., -1:, -1, :],
        ),
    )
    # What comes before and after an end that moves is for others to join.
    outer = [
        np.where(np.abs(at[..., _AT_REST]).max(axis=-1) > _STILL, push, hover)
        for push, at in ends
    ]
    before = np.concatenate([outer[0], thrust[..., -1]], axis=-1)
    after = np.concatenate([thrust[..., 0], outer[1]], axis=-1)
    leaps = np.abs(after - before) > THRUST_JOINT
    size[leaps[..., :-1] | leaps[..., 1:]] = np.inf
    return size
