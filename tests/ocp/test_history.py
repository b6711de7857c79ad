"""The history of a solve tells every mesh, what was done to it, and why."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from benchmarks.ocp_further import alp_rider, two_phase_waypoint
from benchmarks.ocp_problems import goddard
from benchmarks.ocp_textbook import long_hypersensitive

from showc import ocp


@pytest.fixture(scope="module")
def flown() -> ocp.Solution:
    return ocp.solve(goddard())


@pytest.fixture(scope="module")
def constrained() -> ocp.Solution:
    return ocp.solve(alp_rider())


def test_records_are_the_meshes_that_were_solved(flown):
    assert flown.iterations == sum(record.iterations for record in flown.history)
    for record in flown.history:
        (phase,) = record.phases
        assert len(phase.intervals) == record.intervals
        assert sum(interval.points for interval in phase.intervals) == record.points
        ends = [interval.end for interval in phase.intervals[:-1]]
        assert ends == [interval.start for interval in phase.intervals[1:]]
    last = flown.history[-1].phases[0]
    assert last.intervals[-1].end == flown.phases[0].end
    assert all(i.decision.step is ocp.Step.KEPT for i in last.intervals)


def test_no_mesh_is_left_out_of_the_history(constrained):
    """Failed trials, other starts and meshes that were no better included."""
    for solution in (constrained, ocp.solve(long_hypersensitive())):
        assert solution.iterations == sum(r.iterations for r in solution.history)


def test_a_problem_without_solution_tells_all_that_was_tried():
    problem = ocp.Problem("too far")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", start=0.0, end=5.0)
    u = phase.control("u", -1.0, 1.0)
    phase.derivative(x, u)
    problem.minimise(phase.integral(u**2))
    solution = ocp.solve(problem)
    assert not solution.result.usable
    assert solution.iterations == sum(r.iterations for r in solution.history)
    assert len(solution.history) > 2
    assert all(record.phases for record in solution.history)


def test_errors_of_intervals_make_up_the_error_of_the_mesh(flown):
    for record in flown.history:
        intervals = record.phases[0].intervals
        assert record.error is not None
        assert max(i.dynamics for i in intervals) == record.error.dynamics
        assert max(i.path for i in intervals) == record.error.path
        shares = sum(i.objective for i in intervals)
        assert shares == pytest.approx(record.error.objective, rel=1e-9)


def test_each_decision_is_what_the_next_mesh_shows(flown):
    for record, after in zip(flown.history, flown.history[1:], strict=False):
        before, then = record.phases[0], after.phases[0]
        steps = [interval.decision.step for interval in before.intervals]
        assert all(i.decision.reason for i in before.intervals
                   if i.decision.step is not ocp.Step.KEPT)  # fmt: skip
        if ocp.Step.SWITCH in steps:
            assert len(then.switches) > len(before.switches)
            continue
        raised = steps.count(ocp.Step.RAISED)
        assert after.points > record.points or not raised
        if ocp.Step.CUT not in steps:
            merged = steps.count(ocp.Step.MERGED)
            assert after.intervals == record.intervals - merged


def test_a_switch_says_which_control_leaves_which_bound(flown):
    words = " ".join(
        interval.decision.reason
        for record in flown.history
        for interval in record.phases[0].intervals
        if interval.decision.step is ocp.Step.SWITCH
    )
    assert "T goes from its upper bound to no bound" in words
    assert "T goes from no bound to its lower bound" in words


def two_hills():
    """A way over two narrow hills, each touched between the nodes of coarse meshes."""
    problem = ocp.Problem("two hills")
    phase = problem.phase(duration=4.0)
    height, push = phase.state("height", start=0.1, end=0.1), phase.control("push")
    phase.derivative(height, push - height)
    hills = sum(ca.exp(-30.0 * (phase.time - top) ** 2) for top in (1.0, 2.7))
    phase.constrain(height - hills, 0.0, None, name="terrain")
    problem.minimise(phase.integral(height**2 + 0.01 * push**2))
    return problem


def test_a_violated_path_constraint_is_named():
    solution = ocp.solve(two_hills())
    assert solution.result is ocp.Result.SOLVED
    named = {
        interval.decision.constraint
        for record in solution.history
        for interval in record.phases[0].intervals
        if interval.decision.step is ocp.Step.CONSTRAINED
    }
    assert named == {"terrain"}


def test_every_phase_has_its_mesh():
    solution = ocp.solve(two_phase_waypoint())
    for record in solution.history:
        assert [phase.name for phase in record.phases] == ["out", "back"]
        assert sum(len(phase.intervals) for phase in record.phases) == record.intervals


def test_margins_are_distances_to_the_bounds():
    problem = ocp.Problem("push")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", start=0.0, end=1.0)
    u = phase.control("u", -2.0, 6.0)
    phase.derivative(x, u)
    phase.constrain(x + u, None, 5.0, name="sum")
    problem.minimise(phase.integral(u**2))
    solution = ocp.solve(problem)
    control, total = ocp.margins(problem, solution)
    assert (control.kind, control.name) == ("control", "u")
    assert control.room == pytest.approx(np.full(control.times.size, 3.0 / 8.0))
    assert (total.kind, total.name, total.upper) == ("path", "sum", 5.0)
    assert total.values == pytest.approx(1.0 + total.times, abs=1e-6)
    tighter = ocp.Overrides(bounds={"u": (0.0, 2.0)})
    again = ocp.margins(problem, solution, overrides=tighter)[0]
    assert again.room == pytest.approx(np.full(control.times.size, 0.5))


def test_a_solve_on_a_given_mesh_has_no_history():
    built = ocp.Transcription(goddard(), ocp.Mesh.uniform(10, 4))
    assert built.solve().history == ()
