"""A first guess moved off a place where a coupling does not tell which way to go.

Where two subsystems meet exactly, the gradient of their squared distance vanishes: a
solver that starts there sees no direction in which the distance grows, and may stay
for ever. The coupling's curvature tells: along an eigenvector v of its second
derivatives with eigenvalue l, a step a v changes it by l a² / 2. Of those that help,
one across the motion is taken, so that the subsystems pass each other on one side.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi
import numpy as np

from showc.ocp.guess import Curve, Guess, curves_of

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from showc.arrays import FloatArray
    from showc.ocp.audit.couplings import Violation
    from showc.ocp.problem import Problem
    from showc.ocp.quantity import Quantity
    from showc.ocp.solution import Solution


_HEAD_ON = 0.3
"""Share of what is lacking that the gradient gains on the way that the curvature
needs; below it the gradient is no guide."""
_LEVEL = 1e-6
"""Length of a direction below which it is rounding."""


def nudged(
    problem: Problem, solution: Solution, violations: Sequence[Violation]
) -> Guess | None:
    """Guess from ``solution`` with the violated couplings' subsystems moved aside.

    ``None`` where the gradients tell enough already.
    """
    curves: dict[str, Curve] = {}
    moved = False
    for index, (phase, part) in enumerate(
        zip(problem.phases, solution.phases, strict=True)
    ):
        names = list(phase.states)
        aside = np.zeros(len(names))
        place = 0.5
        for found in violations:
            if found.phase != index:
                continue
            coupling = next(c for c in phase.couplings if c.name == found.name)
            at = part.states(np.array(found.time))
            motion = part.states.derivative()(np.array(found.time))
            step = _step(problem, index, coupling, (at, motion, found.amount), solution)
            if step is not None:
                aside += step
                place = found.place
        for name, curve in curves_of(part).items():
            number = names.index(name) if name in names else -1
            if number >= 0 and aside[number] != 0.0:
                moved = True
                curves[f"{phase.name}.{name}"] = _bent(curve, aside[number], place)
            else:
                curves[f"{phase.name}.{name}"] = curve
    if not moved:
        return None
    return Guess(
        curves,
        {part.name: part.duration for part in solution.phases},
        {part.name: part.start for part in solution.phases},
        solution.statics,
    )


def _step(
    problem: Problem,
    index: int,
    coupling: Quantity,
    where: tuple[FloatArray, FloatArray, float],
    solution: Solution,
) -> FloatArray | None:
    """Step of the states that mends a coupling, ``None`` if its gradient is a guide."""
    at, motion, lack = where
    phase = problem.phases[index]
    x = casadi.vertcat(*[s.quantity.symbol for s in phase.states.values()])
    p = casadi.vertcat(
        casadi.SX(0, 1),
        *[symbol for symbol, _ in problem.parameters.values()],
        *[static.symbol for static in problem.statics],
    )
    hessian, gradient = casadi.hessian(coupling.symbol, x)
    values = np.array([*solution.parameters.values(), *solution.statics.values()])
    function = casadi.Function("bends", [x, p], [coupling.symbol, gradient, hessian])
    value, slope, bend = (np.asarray(part) for part in function(at, values))
    # A value that is too small wants positive curvature, one too great negative.
    low = coupling.lower if isinstance(coupling.lower, (int, float)) else -np.inf
    sign = 1.0 if float(value.item()) < low else -1.0
    sizes, vectors = np.linalg.eigh(sign * bend)
    helping = vectors[:, sizes > 0.5 * max(sizes[-1], 1e-300)]
    if sizes[-1] <= 0.0 or helping.shape[1] == 0:
        return None
    length = np.sqrt(2.0 * lack / sizes[-1])
    if float(np.linalg.norm(slope)) * length > _HEAD_ON * lack:
        return None
    helping = _ordered(helping)
    along = helping.T @ motion
    pace = float(np.linalg.norm(along))
    if pace > 0.0:
        along /= pace
    # To the right of the motion in the first two dimensions: pairs that all meet in
    # one place then turn about it together.
    across = np.zeros(along.size)
    if along.size > 1 and np.hypot(*along[:2]) > _LEVEL:
        across[:2] = along[1], -along[0]
    else:
        across[0] = 1.0
    return np.asarray(length * (helping @ across) / np.linalg.norm(across))


def _ordered(space: FloatArray) -> FloatArray:
    """Orthonormal basis of the same space that follows the order of the states."""
    basis: list[FloatArray] = []
    for column in space @ space.T:
        rest = column - sum((b @ column) * b for b in basis)
        size = float(np.linalg.norm(rest))
        if size > _LEVEL and len(basis) < space.shape[1]:
            basis.append(rest / size)
    return np.stack(basis, axis=1)


def _bent(curve: Curve, aside: float, place: float) -> Curve:
    """Curve moved by ``aside`` at the fraction ``place``, by nothing at the ends."""
    plain: Callable[[FloatArray], FloatArray] = curve  # type: ignore[assignment]
    place = min(max(place, 0.05), 0.95)
    sharp = np.log(0.5) / np.log(place)

    def moved(fraction: FloatArray) -> FloatArray:
        s = np.clip(fraction, 0.0, 1.0) ** sharp
        return np.asarray(plain(fraction) + 16.0 * aside * (s * (1.0 - s)) ** 2)

    return moved
