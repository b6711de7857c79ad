"""The audit finds what is wrong with a solution that is not one."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from showc import ocp
from showc.ocp.audit.residuals import PhaseAuditor
from showc.ocp.transcription.collocation.statement import Statement
from showc.trajectory import PiecewisePolynomial


def oscillator(*, ceiling: float | None = None) -> ocp.Problem:
    problem = ocp.Problem("oscillator")
    phase = problem.phase(duration=3.0)
    x = phase.state("x", start=1.0)
    v = phase.state("v", start=0.0)
    u = phase.control("u", -1.0, 1.0, degree=2)
    phase.derivative(x, v)
    phase.derivative(v, -ca.sin(x) + u)
    if ceiling is not None:
        phase.constrain(v**2, None, ceiling, name="speed")
    problem.minimise(phase.integral(x**2 + u**2))
    return problem


def audited(problem: ocp.Problem, change=lambda part: part):
    solution = ocp.Transcription(problem, ocp.Mesh.uniform(6, 5)).solve()
    part = change(solution.phases[0])
    solution = replace(solution, phases=(part,))
    statement = Statement(problem)
    table = statement.table(statement.parameters({}))
    auditor = PhaseAuditor(problem, problem.phases[0], 0)
    audit = auditor.audit(solution, table)
    return auditor.shot(audit, solution, table), solution


def test_a_good_solution_passes():
    audit, solution = audited(oscillator())
    assert audit.dynamics.max() < 1e-6
    assert audit.shooting < 1e-6
    gap = audit.objective_control.sum() + audit.objective_dynamics.sum()
    assert gap < 1e-3 * solution.objective
    assert audit.path.max() == 0.0 and audit.worst_path == ""


def test_a_bent_state_is_found_in_its_interval():
    def bend(part):
        coefficients = part.states.coefficients.copy()
        coefficients[3, 2, 0] += 0.01
        return replace(
            part, states=PiecewisePolynomial(part.states.breaks, coefficients)
        )

    audit, _ = audited(oscillator(), bend)
    assert int(np.argmax(audit.dynamics)) == 3
    assert audit.dynamics[3] > 1e-3
    assert np.delete(audit.dynamics, 3).max() < 1e-6


def test_a_control_beyond_its_bound_is_flown_clipped():
    def push(part):
        coefficients = part.controls.coefficients.copy()
        coefficients[2] = 5.0
        return replace(
            part, controls=PiecewisePolynomial(part.controls.breaks, coefficients)
        )

    def hold(part):
        coefficients = part.controls.coefficients.copy()
        coefficients[2] = 1.0
        return replace(
            part, controls=PiecewisePolynomial(part.controls.breaks, coefficients)
        )

    beyond, _ = audited(oscillator(), push)
    at_bound, _ = audited(oscillator(), hold)
    assert beyond.dynamics[2] > 1e-2
    assert beyond.dynamics == pytest.approx(at_bound.dynamics)


def test_a_worse_control_shows_in_the_minimum_principle():
    def coast(part):
        return replace(
            part,
            controls=PiecewisePolynomial(
                part.controls.breaks, np.zeros_like(part.controls.coefficients)
            ),
        )

    good, _ = audited(oscillator())
    bad, _ = audited(oscillator(), coast)
    assert bad.objective_control.sum() > 50.0 * good.objective_control.sum()


def test_a_violation_between_the_nodes_is_found_with_its_place():
    problem = oscillator()
    audit, solution = audited(problem)
    times = np.linspace(0.0, 3.0, 30_001)
    speed = solution.phases[0].states(times)[:, 1] ** 2
    ceiling = 0.9 * speed.max()
    # The same trajectory, judged by a stricter problem.
    stricter = oscillator(ceiling=ceiling)
    statement = Statement(stricter)
    auditor = PhaseAuditor(stricter, stricter.phases[0], 0)
    part = solution.phases[0]
    part = replace(part, path_multipliers=np.zeros((part.costates.shape[0], 1)))
    solution = replace(solution, phases=(part,))
    audit = auditor.audit(solution, statement.table(np.zeros(0)))
    assert audit.path.max() == pytest.approx(
        (speed.max() - ceiling) / ceiling, rel=1e-2
    )
    assert "'speed' at t = " in audit.worst_path
    told = float(audit.worst_path.split("t = ")[1].split()[0])
    assert told == pytest.approx(times[np.argmax(speed)], abs=0.03)
    k = int(np.argmax(audit.path))
    assert len(audit.path_places[k]) >= 1


def test_controls_that_enter_linearly_are_known():
    problem = ocp.Problem("mixed")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", start=0.0)
    names = ("linear", "square", "angle", "limited")
    a, b, c, d = (phase.control(name, -1.0, 1.0) for name in names)
    phase.derivative(x, a * x + b + ca.sin(c) + d)
    phase.constrain(d**2, None, 0.5, name="disc")
    problem.minimise(phase.integral(b**2))
    assert PhaseAuditor(problem, phase, 0).principle.affine == (
        True,
        False,
        False,
        False,
    )


def test_an_overshoot_just_behind_a_border_is_found():
    """One that an even row of places would miss."""
    problem = ocp.Problem("hump")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", start=0.0)
    u = phase.control("u")
    phase.derivative(x, u)
    place = 0.012
    hump = ca.exp(-(((phase.time - place) / 0.004) ** 2))
    phase.constrain(x + hump, None, 0.5, name="hump")
    problem.minimise(phase.integral(u**2))
    # The trajectory of a problem without the constraint.
    free = ocp.Problem("hump")
    same = free.phase(duration=1.0)
    y = same.state("x", start=0.0)
    v = same.control("u")
    same.derivative(y, v)
    free.minimise(same.integral(v**2))
    solution = ocp.Transcription(free, ocp.Mesh.uniform(1, 4)).solve()
    part = solution.phases[0]
    part = replace(part, path_multipliers=np.zeros((part.costates.shape[0], 1)))
    solution = replace(solution, phases=(part,))
    auditor = PhaseAuditor(problem, phase, 0)
    audit = auditor.audit(solution, Statement(problem).table(np.zeros(0)))
    # The hump is as far above the bound as the bound is above zero, its scale.
    assert 0.3 < audit.path.max() <= 1.0
    (places,) = audit.path_places
    assert min(abs(s - place) for s in places) < 0.003


def test_dynamics_are_not_asked_for_beyond_the_bounds_of_states():
    """A model may end there; an integrated state is beyond by rounding."""
    problem = ocp.Problem("on the ground")
    phase = problem.phase(duration=1.0)
    height = phase.state("height", 0.0, 10.0, start=0.0)
    speed = phase.state("speed", start=0.0)
    climb = phase.control("climb", -1.0, 1.0)
    phase.derivative(height, climb)
    phase.derivative(speed, ca.if_else(height >= 0.0, 1.0, -50.0))
    problem.maximise(phase.final(speed) - phase.final(height))

    def sink(part):
        states = part.states.coefficients.copy()
        states[:, :, 0] = 0.0
        breaks = part.states.breaks
        steps = np.linspace(0.0, 1.0, states.shape[1])
        states[:, :, 1] = breaks[:-1, None] + np.diff(breaks)[:, None] * steps
        down = np.full_like(part.controls.coefficients, -1e-9)
        return replace(
            part,
            states=PiecewisePolynomial(breaks, states),
            controls=PiecewisePolynomial(breaks, down),
        )

    audit, _ = audited(problem, sink)
    assert audit.dynamics.max() < 1e-6
    assert audit.shooting < 1e-6


def test_stiff_dynamics_with_slopes_that_vary_are_integrated():
    """Time constants of 1e-3 to 1e-5 within an interval: no stage is taken for lost."""
    problem = ocp.Problem("stiff")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", start=1.0)
    y = phase.state("y", start=0.0)
    u = phase.control("u", -1.0, 1.0)
    phase.derivative(x, -x + u)
    phase.derivative(y, (1e3 + 1e5 * phase.time) * (ca.sin(x) - y))
    problem.minimise(phase.integral(x**2 + u**2))
    solution = ocp.solve(problem)
    assert solution.result is ocp.Result.SOLVED
    assert solution.error.dynamics < 1e-6
    assert solution.error.shooting < 1e-6


@pytest.mark.parametrize(("degree", "intervals"), [(1, 10), (1, 20), (1, 40), (2, 10)])
def test_a_singular_arc_errs_by_what_its_control_misses_not_by_its_slopes(
    degree, intervals
):
    problem = ocp.Problem("follow")
    phase = problem.phase(duration=3.0)
    x = phase.state("x", start=0.0)
    u = phase.control("u", -2.0, 2.0, degree=degree)
    phase.derivative(x, u - 0.3 * x)
    # The wave can be followed exactly, by a control that no mesh here represents.
    problem.minimise(1.0 + phase.integral((x - 0.8 * ca.sin(2.0 * phase.time)) ** 2))
    options = ocp.Options(mesh=ocp.Mesh.uniform(intervals, 6), meshes=1, switches=False)
    solution = ocp.solve(problem, options=options)
    true = solution.objective - 1.0
    assert 1e-10 < true <= solution.error.objective <= 30.0 * true
