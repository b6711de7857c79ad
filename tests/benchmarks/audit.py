"""What a peer's answer is worth between its nodes, measured the same way for all."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from benchmarks.problem import Problem

GRID_RATE = 1000.0
"""Samples a second of the grid on which bounds are checked [1/s]."""
LEAST_SAMPLES = 10_000
MOST_SAMPLES = 1_000_000
STABILITY_LIMIT = 1e12


@dataclass(frozen=True)
class Piece:
    """One mesh interval: polynomials through values at nodes.

    ``state_times`` (n,), ``states`` (n, states), ``control_times`` (m,) and
    ``controls`` (m, controls); one control node means a constant.
    """

    start: float
    end: float
    state_times: np.ndarray
    states: np.ndarray
    control_times: np.ndarray
    controls: np.ndarray


@dataclass(frozen=True)
class Answer:
    """What a peer gives back."""

    objective: float
    pieces: list[Piece]
    solves: int
    """Nonlinear programs solved, one a mesh."""
    points: int
    """Collocation points of the last mesh."""
    message: str
    solved: bool
    """Whether the peer itself says it has reached its tolerance."""


class Polynomial:
    """Lagrange interpolation through nodes, in the barycentric form."""

    def __init__(self, nodes: np.ndarray, values: np.ndarray) -> None:
        self.nodes = np.asarray(nodes, dtype=float)
        self.values = np.asarray(values, dtype=float)
        scale = max(float(np.ptp(self.nodes)), 1e-300)
        difference = (self.nodes[:, None] - self.nodes[None, :]) / scale * 4.0
        np.fill_diagonal(difference, 1.0)
        self.weights = 1.0 / difference.prod(axis=1)

    def __call__(self, times: np.ndarray) -> np.ndarray:
        """Values at ``times`` (k,), shape (k, components)."""
        distance = np.asarray(times, dtype=float)[:, None] - self.nodes[None, :]
        exact = np.abs(distance) < 1e-15 * max(1.0, np.abs(self.nodes).max())
        terms = self.weights / np.where(exact, 1.0, distance)
        hit = exact.any(axis=1)
        terms[hit] = exact[hit]
        return (terms @ self.values) / terms.sum(axis=1, keepdims=True)


def sample(pieces: list[Piece], samples: int) -> tuple[np.ndarray, ...]:
    """Times, states and controls on about ``samples`` times, each interval whole."""
    total = pieces[-1].end - pieces[0].start
    times, states, controls = [], [], []
    for piece in pieces:
        count = max(2, int(np.ceil(samples * (piece.end - piece.start) / total)) + 1)
        grid = np.linspace(piece.start, piece.end, count)
        times.append(grid)
        states.append(Polynomial(piece.state_times, piece.states)(grid))
        controls.append(Polynomial(piece.control_times, piece.controls)(grid))
    return np.concatenate(times), np.concatenate(states), np.concatenate(controls)


def bound_violation(problem: Problem, pieces: list[Piece]) -> tuple[float, str]:
    """Greatest violation of a bound, as a fraction of its range, and whose it is.

    On a grid of 1 kHz, at least 10,000 samples and at most a million. Where one bound
    is missing the range is that of the values themselves.
    """
    duration = pieces[-1].end - pieces[0].start
    count = int(np.clip(duration * GRID_RATE, LEAST_SAMPLES, MOST_SAMPLES))
    _, states, controls = sample(pieces, count)
    worst, whose = 0.0, ""
    quantities = [*problem.states, *problem.controls]
    values = np.concatenate([states, controls], axis=1)
    for column, quantity in enumerate(quantities):
        series = values[:, column]
        low, high = quantity.lower, quantity.upper
        if low is not None and high is not None:
            extent = high - low
        else:
            extent = max(float(np.ptp(series)), 1e-12)
        over = 0.0 if high is None else float(series.max()) - high
        under = 0.0 if low is None else low - float(series.min())
        violation = max(over, under, 0.0) / extent
        if violation > worst:
            worst, whose = violation, quantity.name
    return worst, whose


def least_path_margin(problem: Problem, pieces: list[Piece]) -> float | None:
    """Least of all path expressions over the same grid, or None without paths."""
    if not problem.paths:
        return None
    duration = pieces[-1].end - pieces[0].start
    count = int(np.clip(duration * GRID_RATE, LEAST_SAMPLES, MOST_SAMPLES))
    _, states, controls = sample(pieces, count)
    values = problem.path_values(list(states.T), list(controls.T), np)
    return float(min(np.min(value) for value in values))


def reintegrate(
    problem: Problem, pieces: list[Piece], *, clip: bool = True
) -> np.ndarray:
    """Greatest error of each state when the controls are flown, shape (states,).

    One integration from the start to the end, order 8, relative tolerance 1e-10,
    restarted at mesh borders because controls may jump there; with ``clip`` the
    controls are cut at their bounds. Compared at both ends and at nine instants
    within every interval. Infinite where the flight diverges.
    """
    from scipy.integrate import solve_ivp

    low = np.array([-np.inf if c.lower is None else c.lower for c in problem.controls])
    high = np.array([np.inf if c.upper is None else c.upper for c in problem.controls])
    if not clip:
        low[:], high[:] = -np.inf, np.inf
    state = np.array([s.start for s in problem.states], dtype=float)
    error = np.zeros(len(state))
    for piece in pieces:
        control = Polynomial(piece.control_times, piece.controls)
        reference = Polynomial(piece.state_times, piece.states)

        def rates(time, values, control=control):
            clipped = np.clip(control(np.array([time]))[0], low, high)
            return problem.rates(list(values), list(clipped), np)

        grid = np.linspace(piece.start, piece.end, 11)
        flown = solve_ivp(
            rates,
            (piece.start, piece.end),
            state,
            method="DOP853",
            t_eval=grid,
            rtol=1e-10,
            atol=1e-12,
        )
        values = flown.y.T
        if not flown.success or not np.all(np.abs(values) < STABILITY_LIMIT):
            return np.full(len(state), np.inf)
        error = np.maximum(error, np.abs(values - reference(grid)).max(axis=0))
        state = values[-1]
    return error


def report(problem: Problem, answer: Answer) -> dict[str, object]:
    """All figures of one answer but the time, as plain data."""
    pieces = answer.pieces
    figures: dict[str, object] = {
        "objective": answer.objective,
        "solves": answer.solves,
        "points": answer.points,
        "message": answer.message,
        "solved": answer.solved,
    }
    if problem.optimum:
        figures["relative_error"] = abs(answer.objective / problem.optimum - 1.0)
    if not pieces:
        return figures
    violation, whose = bound_violation(problem, pieces)
    figures |= {"bound_violation": violation, "violated": whose}
    margin = least_path_margin(problem, pieces)
    if margin is not None:
        figures["least_distance"] = float(np.sqrt(max(margin, 0.0)))
    with np.errstate(all="ignore"):
        error = reintegrate(problem, pieces)
        _, states, _ = sample(pieces, LEAST_SAMPLES)
        extent = np.maximum(np.ptp(states, axis=0), 1e-12)
    figures["flown_error"] = float((error / extent).max())
    triples = problem.place_columns()
    if triples:
        distances = np.sqrt((error[np.array(triples)] ** 2).sum(axis=1))
        figures["position_error"] = float(distances.max())
    return figures


def limit_threads() -> None:
    """Let no library start threads of its own: CPU time is compared."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
