"""Several agents in one time: the slowest decides, those in conflict go in order."""

from itertools import combinations

import numpy as np
import pytest

from showc import ocp
from showc.ocp.agents.agent import LeastEffort, least_time, shiftable, shifted
from showc.ocp.agents.joined import solve_joined
from showc.ocp.agents.walls import Apart, Walls, bent, clusters, conflicts, sampled


def integrator(*, low=None, high=None):
    """A double integrator in a plane: 1 m/s² an axis, 2 m/s."""
    problem = ocp.Problem("double integrator")
    phase = problem.phase("go", duration=(0.5, 60.0))
    for axis in "xy":
        position = phase.state(axis, low, high, scale=5.0)
        speed = phase.state(f"v{axis}", -2.0, 2.0, start=0.0, end=0.0)
        push = phase.control(f"u{axis}", -1.0, 1.0)
        phase.derivative(position, speed)
        phase.derivative(speed, push)
    problem.minimise(phase.duration)
    return problem


def agents(starts, ends):
    return [
        ocp.Agent(dict(zip("xy", a, strict=True)), dict(zip("xy", b, strict=True)))
        for a, b in zip(starts, ends, strict=True)
    ]


def solve(starts, ends, *, distance=1.0, **options):
    return ocp.solve_agents(
        integrator(),
        agents(starts, ends),
        position="xy",
        distance=distance,
        options=ocp.AgentsOptions(**options),
    )


def nearest(found):
    times = np.linspace(0.0, found.duration, 20_001)
    ways = [each.phases[0].states(times)[:, [0, 2]] for each in found.solutions]
    return min(np.linalg.norm(a - b, axis=1).min() for a, b in combinations(ways, 2))


def check(found, starts, ends):
    """Bounds, ends and dynamics of every agent, by means of the test's own."""
    for each, start, end in zip(found.solutions, starts, ends, strict=True):
        (part,) = each.phases
        assert part.duration == pytest.approx(found.duration)
        low, high = part.states.bounds()
        assert np.all(low[[1, 3]] >= -2.0 - 1e-9) and np.all(high[[1, 3]] <= 2.0 + 1e-9)
        low, high = part.controls.bounds()
        assert low.min() >= -1.0 - 1e-9 and high.max() <= 1.0 + 1e-9
        assert part.states(0.0) == pytest.approx([start[0], 0, start[1], 0], abs=1e-6)
        last = part.states(found.duration)
        assert last == pytest.approx([end[0], 0, end[1], 0], abs=1e-6)
        times = np.linspace(0.0, found.duration, 30_001)
        speed = np.cumsum(part.controls(times), axis=0) * (times[1] - times[0])
        assert np.abs(speed - part.states(times)[:, [1, 3]]).max() < 2e-3


def test_equal_moves_cost_one_solve_and_take_the_least_time():
    starts = np.array([[2.0 * (k % 3), 2.0 * (k // 3)] for k in range(6)])
    ends = starts + [6.0, 3.0]
    found = solve(starts, ends)
    # x decides: up to 2 m/s and down again takes 4 m and 4 s, 2 m more take 1 s.
    assert found.solved and found.solves == 0 and found.groups == ()
    assert found.duration == found.bound == pytest.approx(5.0, rel=2e-3)
    assert nearest(found) == pytest.approx(2.0)
    check(found, starts, ends)


def test_two_that_change_places_pass_each_other():
    starts, ends = np.array([[-4.0, 0.0], [4.0, 0.0]]), np.array([[4.0, 0], [-4, 0.0]])
    found = solve(starts, ends)
    assert found.solved and found.groups == ((0, 1),)
    assert found.bound == pytest.approx(6.0, rel=2e-3)
    assert found.duration <= 1.0031 * found.bound
    assert nearest(found) >= 1.0
    check(found, starts, ends)


def test_only_those_in_conflict_are_planned_again():
    starts = np.array([[-4.0, 0.0], [4.0, 0.0], [-4.0, 9.0], [-4.0, -9.0]])
    ends = np.array([[4.0, 0.0], [-4.0, 0.0], [0.0, 9.5], [3.0, -9.0]])
    found = solve(starts, ends)
    assert found.solved and found.groups == ((0, 1),)
    assert nearest(found) >= 1.0
    check(found, starts, ends)


@pytest.mark.parametrize("count", [3, pytest.param(5, marks=pytest.mark.slow)])
def test_many_through_one_place(count):
    angle = 2.0 * np.pi * np.arange(count) / count + 0.2
    starts = 5.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    found = solve(starts, -starts, distance=1.0)
    assert found.solved, found.message
    assert found.duration <= 1.07 * found.bound
    assert nearest(found) >= 1.0
    check(found, starts, -starts)
    again = solve(starts, -starts, distance=1.0)
    for a, b in zip(found.solutions, again.solutions, strict=True):
        assert np.array_equal(
            a.phases[0].states.coefficients, b.phases[0].states.coefficients
        )


def test_a_group_in_one_problem():
    """Both give way at once: apart at every instant, least effort for the two."""
    problem = integrator()
    pair = agents([[-4.0, 0.0], [4.0, 0.0]], [[4.0, 0.0], [-4.0, 0.0]])
    model = least_time(problem, pair[0], None)
    program = LeastEffort(problem, model, "xy", 0)
    duration = 1.05 * model.duration
    alone = [program.solve(agent, duration, model) for agent in pair]
    ways = {k: program.place(solution) for k, solution in enumerate(alone)}
    fractions = np.concatenate([[0.0], np.cumsum(program.mesh.phases[0].fractions)])
    apart = Apart(1.0, (1.0, 1.0))
    start = bent(ways, fractions, [0, 1], apart)
    found = solve_joined(
        program, pair, duration, alone=alone, start=[start[0], start[1]], apart=apart
    )
    assert found is not None
    first, second = map(program.place, found)
    assert apart.lacking(first, second) == 0.0
    # By symmetry each gives way by half of the distance, to its own right; the barrier
    # that is kept makes it a little more.
    aside = -first[..., 1].min()
    assert 0.5 < aside < 0.75
    assert second[..., 1].max() == pytest.approx(aside, abs=0.02)
    assert max(program.missed(solution) for solution in found) < 2e-5


def test_no_way_is_an_answer_too():
    """Ends that are nearer than the distance leave no way."""
    starts, ends = np.array([[0.0, 0.0], [4.0, 0.0]]), np.array([[6.0, 0], [6.0, 0.5]])
    found = solve(starts, ends, gaps=(0.003,), orders=2)
    assert not found.solved and found.solutions == ()
    assert "find no ways" in found.message


def test_times_are_rounded_up():
    starts, ends = np.array([[0.0, 0.0], [0.0, 3.0]]), np.array([[6.0, 0], [5.0, 3.0]])
    found = solve(starts, ends, round_up=0.25)
    assert found.solved and found.duration == 5.25


def test_what_may_be_shifted():
    assert shiftable(integrator()) == {"x", "y"}
    assert shiftable(integrator(low=-9.0, high=9.0)) == set()
    problem = integrator()
    phase = problem.phases[0]
    x = phase.states["x"].quantity.symbol
    phase.constrain(x, None, 50.0)
    assert shiftable(problem) == {"y"}
    (agent,) = agents([[0.0, 0.0]], [[6.0, 3.0]])
    solution = ocp.solve_graded(integrator(), overrides=agent.overrides())
    moved = shifted(solution, {"y": 2.5})
    difference = moved.phases[0].states(1.7) - solution.phases[0].states(1.7)
    assert difference == pytest.approx([0.0, 0.0, 2.5, 0.0])


def test_lacking_distance_is_found_between_samples():
    """Two straight ways that come within 0.1 for a moment."""
    fraction = np.array([0.0, 1.0])
    first = np.stack([40.0 * fraction, 0.0 * fraction], axis=1)[None]
    second = np.stack([13.37 + 0.0 * fraction, 0.1 - 0.0 * fraction], axis=1)[None]
    apart = Apart(1.0, (1.0, 1.0))
    assert apart.lacking(first, second) == pytest.approx(0.9, rel=0.01)
    assert apart.lacking(first, second) >= 0.9
    assert Apart(0.0999, (1.0, 1.0)).lacking(first, second) == 0.0
    # Twice as far in the metric's second axis.
    assert Apart(0.1999, (1.0, 2.0)).lacking(first, second) == 0.0
    assert conflicts({0: first, 1: second}, apart) == [(0, 1)]
    assert conflicts({0: first, 1: second + [0.0, 2.0]}, apart) == []


def test_planes_keep_the_distance():
    """Whatever keeps the planes is apart from the others at every instant."""
    rng = np.random.default_rng(4)
    apart = Apart(1.0, (1.0, 0.5, 2.0))
    for _ in range(50):
        own, other = rng.normal(size=(2, 4, 4, 3)) * 1.5
        walls = Walls([other], apart, 2)
        laid = walls.about(sampled(own))
        if laid is None:
            continue
        normals, lower = laid
        for k in np.nonzero(np.isfinite(lower[:, 0]))[0]:
            lack = lower[k, 0] - own[k] @ normals[k, 0]
            unit = normals[k, 0] / (normals[k, 0] @ normals[k, 0])
            kept = own[k] + np.maximum(lack, 0.0)[:, None] * unit
            assert apart.lacking(kept[None], other[k : k + 1]) == 0.0


def test_groups():
    assert clusters([(0, 1), (2, 3), (1, 4), (6, 7)]) == [(0, 1, 4), (2, 3), (6, 7)]
