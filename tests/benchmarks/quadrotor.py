"""The quadrotor move of the benchmarks, as a problem every peer can translate.

Twelve states and four controls a drone: the small-angle model as it is widely printed,
with ``arm U2 / Ix`` (the form that the reference 6.6665 +- 0.001 s of fine meshes is
for; the consistent form, without the arm, is 0.03 s faster). Yaw is free on the way
and 0 at both ends, as are attitude, rates and velocity. Several drones share the final
time; each pair keeps its distance at every instant.
"""

from __future__ import annotations

from itertools import combinations

from benchmarks.problem import Control, Path, Problem, State

MASS, GRAVITY = 0.625, 9.80665
ARM = 0.1275
INERTIA = (2.3e-3, 2.4e-3, 2.6e-3)
SPEED, TILT, RATE = 5.0, 20.0 * 3.141592653589793 / 180.0, 1.7
THRUST_MAX, TORQUE_MAX, YAW_TORQUE_MAX = 21.03, 0.67, 0.105
SEPARATION = 1.0
SHIFT = (30.0, 20.0, 10.0)
GRID = tuple((2.0 * (i % 3), 2.0 * (i // 3), 0.0) for i in range(6))


def drone(
    suffix: str, start: tuple[float, ...], end: tuple[float, ...]
) -> tuple[list[State], list[Control]]:
    """States and controls of one drone, their names ending in ``suffix``."""

    def n(name: str) -> str:
        return name + suffix

    phi, theta, psi, u1 = n("phi"), n("theta"), n("psi"), n("u1")
    p, q, r = n("p"), n("q"), n("r")
    ix, iy, iz = INERTIA
    rates = {
        "x": n("vx"),
        "y": n("vy"),
        "z": n("vz"),
        "vx": f"{u1}/{MASS}*(cos({phi})*sin({theta})*cos({psi})"
        f" + sin({phi})*sin({psi}))",
        "vy": f"{u1}/{MASS}*(cos({phi})*sin({theta})*sin({psi})"
        f" - sin({phi})*cos({psi}))",
        "vz": f"{u1}/{MASS}*cos({phi})*cos({theta}) - {GRAVITY}",
        "phi": p,
        "theta": q,
        "psi": r,
        "p": f"{ARM}*{n('u2')}/{ix} + {(iy - iz) / ix}*{q}*{r}",
        "q": f"{ARM}*{n('u3')}/{iy} + {(iz - ix) / iy}*{p}*{r}",
        "r": f"{n('u4')}/{iz} + {(ix - iy) / iz}*{p}*{q}",
    }
    limits = {
        "x": None, "y": None, "z": None, "vx": SPEED, "vy": SPEED, "vz": SPEED,
        "phi": TILT, "theta": TILT, "psi": 3.141592653589793,
        "p": RATE, "q": RATE, "r": RATE,
    }  # fmt: skip
    states = []
    for name, rate in rates.items():
        axis = "xyz".find(name)
        first = start[axis] if axis >= 0 else 0.0
        last = end[axis] if axis >= 0 else 0.0
        bound = limits[name]
        low = None if bound is None else -bound
        states.append(State(n(name), rate, first, last, low, bound, last))
    controls = [
        Control(n("u1"), 0.0, THRUST_MAX, MASS * GRAVITY),
        Control(n("u2"), -TORQUE_MAX, TORQUE_MAX, 0.0),
        Control(n("u3"), -TORQUE_MAX, TORQUE_MAX, 0.0),
        Control(n("u4"), -YAW_TORQUE_MAX, YAW_TORQUE_MAX, 0.0),
    ]
    return states, controls


def move(
    name: str,
    starts: tuple[tuple[float, ...], ...],
    ends: tuple[tuple[float, ...], ...],
) -> Problem:
    """Minimum common time for drones from ``starts`` to ``ends`` [m]."""
    states: list[State] = []
    controls: list[Control] = []
    suffixes = [f"_{i + 1}" for i in range(len(starts))] if len(starts) > 1 else [""]
    for suffix, start, end in zip(suffixes, starts, ends, strict=True):
        more_states, more_controls = drone(suffix, start, end)
        states += more_states
        controls += more_controls
    paths = tuple(
        Path(
            f"distance{a}{b}",
            " + ".join(f"({axis}{a} - {axis}{b})**2" for axis in "xyz"),
            SEPARATION**2,
        )
        for a, b in combinations(suffixes, 2)
    )
    return Problem(
        name=name,
        states=tuple(states),
        controls=tuple(controls),
        duration=(1.0, 60.0),
        duration_guess=8.0,
        objective="t",
        integrand=None,
        maximise=False,
        where={},
        paths=paths,
        optimum=None,
        accuracy=0.0,
        source="",
    )


def _shifted(places):
    return tuple(
        tuple(a + b for a, b in zip(place, SHIFT, strict=True)) for place in places
    )


def one() -> Problem:
    """One drone over (30, 20, 10) m."""
    return move("quadrotor", ((0.0, 0.0, 0.0),), (SHIFT,))


def six() -> Problem:
    """Six drones on a 2 x 3 grid of 2 m, all over (30, 20, 10) m."""
    return move("six quadrotors", GRID, _shifted(GRID))


def six_crossed() -> Problem:
    """The same with the target grid turned by 180 degrees: the paths cross."""
    turned = tuple((4.0 - x, 2.0 - y, z) for x, y, z in GRID)
    return move("six quadrotors, crossed", GRID, _shifted(turned))


MOVES = {"quadrotor": one, "six": six, "six_crossed": six_crossed}
