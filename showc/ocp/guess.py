"""First guesses: from functions, from numbers, from an earlier solution."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from showc.arrays import FloatArray
from showc.ocp.fault import StatementError, check_known, check_number
from showc.trajectory import PiecewisePolynomial

if TYPE_CHECKING:
    from showc.ocp.problem import Problem
    from showc.ocp.solution import PhaseSolution


@dataclass(frozen=True, slots=True)
class Data:
    """Values at given times, joined by straight lines; constant before and after."""

    times: Sequence[float] | FloatArray
    """Increasing, in the problem's unit of time."""
    values: Sequence[float] | FloatArray

    def __post_init__(self) -> None:
        try:
            times = np.asarray(self.times, dtype=np.float64)
            values = np.asarray(self.values, dtype=np.float64)
        except (TypeError, ValueError):
            raise StatementError("times and values of data are no numbers") from None
        if times.shape != values.shape or times.ndim != 1 or times.size == 0:
            raise StatementError(
                f"data with {times.shape} times and {values.shape} values; wanted one "
                "value for each time"
            )
        if not np.all(np.isfinite([times, values])) or np.any(np.diff(times) <= 0.0):
            raise StatementError("the times of data do not increase, or are no numbers")


Curve = (
    float | FloatArray | Data | PiecewisePolynomial | Callable[[FloatArray], FloatArray]
)
"""A number, values at equal steps over the phase, values at given times, a polynomial
in time, or a function of the fraction of the phase (an array in [0, 1])."""


@dataclass(frozen=True, slots=True)
class Guess:
    """Where the search starts; what is not given is filled in from the bounds.

    Names of states and controls are ``"x"``, or ``"phase.x"`` where several phases
    have an ``x``.
    """

    curves: Mapping[str, Curve] = field(default_factory=dict)
    durations: Mapping[str, float] = field(default_factory=dict)
    """Duration by phase name."""
    starts: Mapping[str, float] = field(default_factory=dict)
    """Start time by phase name."""
    statics: Mapping[str, float] = field(default_factory=dict)


def check_guess(problem: Problem, guess: object) -> None:
    """Raise where a guess is none, or names what the problem does not have.

    Raises
    ------
    StatementError
        With the names there are.
    """
    if guess is None:
        return
    if hasattr(guess, "phases"):
        found = [part.name for part in guess.phases]
        wanted = [phase.name for phase in problem.phases]
        if len(found) != len(wanted):
            raise StatementError(
                f"the guess is a solution with the phases {', '.join(found)}; the "
                f"problem has {', '.join(wanted)}"
            )
        return
    if not isinstance(guess, Guess):
        hint = "ocp.Guess({...})" if isinstance(guess, dict) else "an ocp.Guess"
        raise StatementError(
            f"the guess is of type {type(guess).__name__}; wanted {hint} or a solution"
        )
    for what in ("curves", "durations", "starts", "statics"):
        if not isinstance(getattr(guess, what), Mapping):
            kind = type(getattr(guess, what)).__name__
            raise StatementError(f"{what} of the guess are a {kind}; wanted a dict")
    _check_names(problem, guess)
    _check_numbers(guess)
    for name, curve in guess.curves.items():
        if not isinstance(curve, (Data, PiecewisePolynomial)):
            _check_curve(name, curve)


def _check_names(problem: Problem, guess: Guess) -> None:
    """Raise where a guess names what the problem does not have."""
    phases = {phase.name for phase in problem.phases}
    known = [
        called
        for phase in problem.phases
        for name in (*phase.states, *phase.controls)
        for called in (name, f"{phase.name}.{name}")
    ]
    check_known(guess.curves, known, "the guess")
    check_known(guess.durations, phases, "the guess of durations")
    check_known(guess.starts, phases, "the guess of starts")
    check_known(
        guess.statics, [s.name for s in problem.statics], "the guess of statics"
    )


def _check_numbers(guess: Guess) -> None:
    """Raise where a guessed duration, start or static is no number."""
    for name, length in guess.durations.items():
        if check_number(length, f"the guessed duration of {name!r}") <= 0.0:
            raise StatementError(
                f"the guessed duration of {name!r} is {length}; wanted above 0"
            )
    for name, value in (*guess.starts.items(), *guess.statics.items()):
        check_number(value, f"the guess of {name!r}")


def _check_curve(name: str, curve: object) -> None:
    """Raise where a guessed curve is no row of finite numbers, and gives none."""
    what, places = f"the guess of {name!r}", np.linspace(0.0, 1.0, 5)
    found: object = curve
    if callable(curve):
        try:
            with np.errstate(all="ignore"):
                found = curve(places)
        except Exception as fault:
            raise StatementError(
                f"{what} cannot be called with an array of fractions: {fault}"
            ) from fault
    wanted = "a number, a row of numbers, ocp.Data, or a function of fractions"
    try:
        values = np.asarray(found, dtype=np.float64)
    except (TypeError, ValueError):
        raise StatementError(f"{what} is no number; wanted {wanted}") from None
    odd = values.ndim == 1 and callable(curve) and values.size not in {1, places.size}
    if values.ndim > 1 or odd:
        given = f" for fractions of shape {places.shape}" if callable(curve) else ""
        raise StatementError(f"{what} has shape {values.shape}{given}; wanted {wanted}")
    if not np.all(np.isfinite(values)):
        raise StatementError(f"{what} is not finite everywhere; wanted {wanted}")


def sample(
    curve: Curve, fraction: FloatArray, start: float = 0.0, duration: float = 1.0
) -> FloatArray:
    """Values of ``curve`` at ``fraction`` of a phase that lies there in time."""
    if isinstance(curve, Data):
        return np.asarray(
            np.interp(start + fraction * duration, curve.times, curve.values)
        )
    if isinstance(curve, PiecewisePolynomial):
        return curve(start + fraction * duration)[..., 0]
    if callable(curve):
        return np.broadcast_to(np.asarray(curve(fraction), dtype=float), fraction.shape)
    values = np.atleast_1d(np.asarray(curve, dtype=np.float64))
    if values.size == 1:
        return np.full(fraction.shape, values[0])
    return np.asarray(np.interp(fraction, np.linspace(0.0, 1.0, values.size), values))


def curves_of(phase: PhaseSolution) -> dict[str, Curve]:
    """Curves of an earlier solution's phase, by the fraction of its duration."""

    def state(index: int) -> Curve:
        return lambda s: phase.states(phase.start + s * phase.duration)[..., index]

    def control(index: int) -> Curve:
        return lambda s: phase.controls(phase.start + s * phase.duration)[..., index]

    curves = {name: state(i) for i, name in enumerate(phase.state_names)}
    curves |= {name: control(i) for i, name in enumerate(phase.control_names)}
    return curves
