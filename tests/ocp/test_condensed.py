"""Cascades and condensed programs on problems with known answers."""

from __future__ import annotations

import os
import time

import casadi
import numpy as np
import pytest

from showc import ocp
from showc.ocp.outcome import Result
from showc.ocp.problem import Problem
from showc.ocp.transcription.condensed.cascade import (
    Cascade,
    Composition,
    elevate,
    value_at,
)
from showc.ocp.transcription.condensed.guarded import AVAILABLE, Guarded
from showc.ocp.transcription.condensed.transcription import (
    CondensedOptions,
    CondensedTranscription,
)
from showc.ocp.transcription.solver import SolverOptions
from showc.trajectory import bernstein_basis


def double_integrator(*, speed=None):
    problem = Problem("double integrator")
    phase = problem.phase("flight", duration=(0.1, 10.0))
    goal = problem.parameter("goal", 1.0)
    x = phase.state("x", start=0.0, end=goal, scale=1.0)
    bound = None if speed is None else (-speed, speed)
    v = phase.state("v", *(bound or ()), start=0.0, end=0.0, scale=1.0)
    u = phase.control("u", -1.0, 1.0, degree=1)
    phase.derivative(x, v)
    phase.derivative(v, u)
    problem.minimise(phase.duration + 1e-6 * phase.integral(u**2))
    return problem


def start_of(intervals, goal=1.0, duration=2.5):
    times = np.linspace(0.0, 1.0, intervals + 1)
    states = np.stack([goal * times, np.full_like(times, goal / duration)], axis=1)
    states[[0, -1], 1] = 0.0
    return ocp.Guess({"x": states[:, 0], "v": states[:, 1]})


@pytest.mark.parametrize("solver", ["fatrop", "ipopt"])
@pytest.mark.parametrize("kind", ["free", "movable"])
def test_bang_bang_time_of_the_double_integrator(solver, kind):
    program = CondensedTranscription(
        double_integrator(),
        8,
        time=kind,
        options=CondensedOptions(SolverOptions(solver, 1e-6)),
    )
    solution = program.solve(widths=np.full(8, 2.5 / 8), guess=start_of(8))
    assert solution.result is Result.SOLVED
    assert solution.duration == pytest.approx(2.0, abs=2e-4)
    assert np.abs(solution.phases[0].controls.coefficients).max() <= 1.0
    part = solution.phases[0]
    flown = part.state("v").derivative()(part.states.breaks[:-1])
    np.testing.assert_allclose(flown, part.controls.coefficients[:, 0], atol=1e-7)
    assert part.widths.sum() == pytest.approx(solution.duration, rel=1e-14)


def test_a_speed_limit_holds_on_all_coefficients_and_costs_what_it_must():
    program = CondensedTranscription(double_integrator(speed=0.5), 30, time="movable")
    solution = program.solve(
        widths=np.full(30, 3.0 / 30), guess=start_of(30, duration=3.0)
    )
    assert solution.result is Result.SOLVED
    assert solution.phases[0].state("v").coefficients.max() <= 0.5
    # 1 m at 0.5 m/s with two ramps of 0.5 s.
    assert solution.duration == pytest.approx(2.5, abs=1e-3)


def test_one_program_many_goals_and_bounds():
    program = CondensedTranscription(double_integrator(speed=0.5), 30, time="movable")
    for goal, speed in ((1.0, 0.5), (4.0, 1.0), (4.0, 10.0)):
        exact = goal / speed + speed if goal > speed**2 else 2.0 * np.sqrt(goal)
        solution = program.solve(
            widths=np.full(30, 1.2 * exact / 30),
            guess=start_of(30, goal, 1.2 * exact),
            parameters={"goal": goal},
            bounds={("bounds", "v"): (-speed, speed)},
        )
        assert solution.result is Result.SOLVED
        assert solution.duration == pytest.approx(exact, rel=2e-3)


def test_an_answer_does_not_depend_on_which_bounds_were_infinite_before():
    def solved(program, speed):
        solution = program.solve(
            widths=np.full(12, 5.0 / 12),
            guess=start_of(12, 4.0, 5.0),
            parameters={"goal": 4.0},
            bounds={("bounds", "v"): (-speed, speed)},
        )
        return solution.duration, solution.iterations, solution.result

    orders = ([0.9, np.inf, 0.9], [np.inf, 0.9, np.inf])
    for kind in ("free", "movable"):
        found = {}
        for order in orders:
            program = CondensedTranscription(
                double_integrator(speed=0.5), 12, time=kind
            )
            for speed in order:
                answer = solved(program, speed)
                assert found.setdefault(speed, answer) == answer


def test_half_spaces_that_are_off_leave_no_trace():
    problem = double_integrator()
    phase = problem.phases[0]
    x, v = (phase.states[name].quantity.symbol for name in ("x", "v"))
    phase.half_space("walls", [x, v], 2)
    program = CondensedTranscription(problem, 8, time="free")
    widths = np.full(8, 2.5 / 8)
    plain = program.solve(widths=widths, guess=start_of(8))
    normals, bound = np.zeros((8, 2, 2)), np.full((8, 2), -np.inf)
    normals[:, 0, 1], bound[3:5, 0] = -1.0, -0.5
    slower = program.solve(
        widths=widths, guess=start_of(8), half_spaces={"walls": (normals, bound)}
    )
    again = program.solve(widths=widths, guess=start_of(8))
    assert slower.phases[0].state("v").coefficients[3:5].max() <= 0.5
    assert slower.duration > plain.duration + 0.05
    assert again.duration == plain.duration == pytest.approx(2.0, abs=2e-4)


def test_impossible_tasks_name_the_constraint_and_the_time():
    problem = double_integrator(speed=0.5)
    program = CondensedTranscription(
        problem, 8, options=CondensedOptions(SolverOptions("ipopt", 1e-6, 60))
    )
    solution = program.solve(widths=np.full(8, 0.1), guess=start_of(8))
    assert not solution.result.usable
    assert "near time" in solution.message


def test_polynomial_expressions_are_exact_and_others_are_said_not_to_be():
    a, b = casadi.SX.sym("a"), casadi.SX.sym("b")
    members = {"a": a, "b": b}
    polynomials = {"a": [casadi.SX(v) for v in (1.0, -2.0, 0.5)], "b": [3.0, 1.0]}
    made = Composition.of(a * b - 2.0 * a**2 + 1.0, members)
    assert made.order == 2
    coefficients = np.array([float(c) for c in made.coefficients(polynomials, members)])
    for s in np.linspace(0.0, 1.0, 7):
        va, vb = (float(value_at(polynomials[n], s)) for n in "ab")
        value = bernstein_basis(4, s) @ coefficients
        assert value == pytest.approx(va * vb - 2.0 * va**2 + 1.0, abs=1e-12)
    assert Composition.of(casadi.sin(a), members).order is None
    raised = elevate([1.0, -2.0, 0.5], 5)
    assert value_at(raised, 0.3) == pytest.approx(value_at([1.0, -2.0, 0.5], 0.3))


def test_circles_are_refused_by_name():
    problem = Problem("oscillator")
    phase = problem.phase("p", duration=1.0)
    x, v = phase.state("x"), phase.state("v")
    phase.derivative(x, v)
    phase.derivative(v, -x)
    with pytest.raises(ValueError, match="x, v of phase 'p' depend on each other"):
        Cascade.of(phase)


class Endless:
    """A solver that hangs on negative numbers."""

    def __call__(self, x0):
        while x0[0] < 0.0:
            pass
        return {"x": 2.0 * x0, "g": x0[:1], "f": 7.0}

    @staticmethod
    def stats():
        return {"success": True, "iter_count": 3}


@pytest.mark.skipif(not AVAILABLE, reason="no fork here")
def test_a_solver_that_never_returns_is_stopped_and_serves_again():
    guarded = Guarded(Endless(), ["x0"], [2], (2, 1), 0.2)
    for _ in range(2):
        found = guarded([np.array([1.0, 2.0])])
        assert found.unknowns.tolist() == [2.0, 4.0] and found.rows.tolist() == [1.0]
        assert found.objective == 7.0
        assert found.success is True and found.iterations == 3
        before = time.monotonic()
        assert guarded([np.array([-1.0, 2.0])]) is None
        assert time.monotonic() - before < 20.0


@pytest.mark.skipif(not AVAILABLE, reason="no fork here")
def test_the_child_ends_with_its_guard():
    guarded = Guarded(Endless(), ["x0"], [2], (2, 1), 0.2)
    guarded([np.array([1.0, 2.0])])
    child = guarded._child
    del guarded
    with pytest.raises(ProcessLookupError):
        os.kill(child, 0)


@pytest.mark.skipif(not AVAILABLE, reason="no fork here")
def test_the_child_keeps_no_pipe_of_its_parent_open():
    """Else a process pool that ends while it writes waits for this reader for ever."""
    reading, writing = os.pipe()
    guarded = Guarded(Endless(), ["x0"], [2], (2, 1), 0.2)
    guarded([np.array([1.0, 2.0])])
    os.close(reading)
    with pytest.raises(BrokenPipeError):
        os.write(writing, b"x")
    os.close(writing)


def tilting(kind):
    """A cascade with all that a program can have: half-spaces, an ending, limits."""
    problem = Problem("tilting")
    phase = problem.phase("flight", duration=(0.1, 10.0))
    price = problem.parameter("price", 2.0)
    x = phase.state("x", -3.0, 3.0, start=0.0, end=1.0, scale=2.0)
    v = phase.state("v", -2.0, 2.0, start=0.0, scale=1.5)
    angle = phase.state("angle", -0.9, 0.9, start=0.0, end=0.0)
    rate = phase.control("rate", -1.0, 1.0, degree=1)
    phase.derivative(x, v)
    phase.derivative(v, 9.81 * casadi.tan(angle))
    phase.derivative(angle, rate)
    phase.half_space("wall", [x], 2)
    effort = phase.integral(price * rate**2 + casadi.sin(angle) ** 2)
    time = 0.0 if kind == "given" else phase.duration
    problem.minimise(effort + 0.3 * price * phase.final(v) ** 2 + time)
    return problem


@pytest.mark.parametrize("solver", ["fatrop", "ipopt"])
@pytest.mark.parametrize("kind", ["given", "free", "movable"])
def test_derivatives_of_the_chain_are_those_that_casadi_derives(solver, kind):
    program = CondensedTranscription(tilting(kind), 5, time=kind)
    chain = program._chain
    options = {"structure_detection": "auto", "equality": program._equal.tolist()}
    derived = casadi.nlpsol(
        "derived", solver, chain.program, options if solver == "fatrop" else {}
    )
    rng = np.random.default_rng(3)
    sizes = [chain.program[name].numel() for name in ("x", "p", "f", "g")]
    point = [0.3 * rng.normal(size=size) for size in sizes]
    for name, ours in chain.derivatives(solver).items():
        theirs = derived.get_function(name)
        assert ours.name_in() == theirs.name_in()
        assert ours.name_out() == theirs.name_out()
        given = point[: ours.n_in()]
        for mine, expected in zip(ours.call(given), theirs.call(given), strict=True):
            np.testing.assert_allclose(
                mine.full(), expected.full(), rtol=1e-12, atol=1e-12
            )
