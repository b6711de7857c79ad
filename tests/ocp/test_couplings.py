"""Constraints between subsystems: imposed where an audit finds them violated."""

from dataclasses import replace
from itertools import combinations

import casadi as ca
import numpy as np
import pytest

from showc import ocp
from showc.ocp.audit.couplings import CouplingAuditor
from showc.ocp.coupling import Imposed, merged, polynomial_degree
from showc.ocp.refinement.constraint_generation import Couplings, enforce
from showc.ocp.transcription.collocation.statement import Statement


def across(angles):
    """Starts and ends on opposite sides of a circle."""
    starts = [(4.0 * np.cos(angle), 4.0 * np.sin(angle)) for angle in angles]
    return starts, [(-x, -y) for x, y in starts]


def crossing(starts, ends, *, apart=1.0, duration=7.0):
    """Double integrators in a plane, each on its way with the least effort."""
    problem = ocp.Problem("crossing")
    phase = problem.phase(duration=duration)
    places, effort = [], 0.0
    for k, ways in enumerate(zip(starts, ends, strict=True)):
        place = []
        for axis, start, end in zip("xy", *ways, strict=True):
            position = phase.state(f"{axis}{k}", start=start, end=end)
            speed = phase.state(f"v{axis}{k}", -2.0, 2.0, start=0.0, end=0.0)
            push = phase.control(f"u{axis}{k}", -1.0, 1.0)
            phase.derivative(position, speed)
            phase.derivative(speed, push)
            place.append(position)
            effort += push**2
        places.append(place)
    for i, j in combinations(range(len(starts)), 2):
        squared = sum((a - b) ** 2 for a, b in zip(places[i], places[j], strict=True))
        phase.couple(squared, apart**2, None, name=f"{i} and {j}")
    problem.minimise(phase.integral(effort))
    return problem


def distance(solution, i, j):
    part = solution.phases[0]
    times = np.linspace(part.start, part.end, 40_001)
    place = [
        np.stack([part.state(f"{axis}{k}")(times)[:, 0] for axis in "xy"])
        for k in (i, j)
    ]
    return float(np.linalg.norm(place[0] - place[1], axis=0).min())


def test_three_that_cross_keep_apart_at_every_instant():
    problem = crossing(*across([0.0, 2.0, 4.0]))
    options = ocp.Options(tolerance=1e-5)
    solution = ocp.solve(problem, options=options)
    assert solution.result is ocp.Result.SOLVED
    assert Couplings(problem).violations(solution) == []
    nearest = [distance(solution, *pair) for pair in ((0, 1), (0, 2), (1, 2))]
    assert min(nearest) == pytest.approx(1.0, abs=1e-5)
    assert min(nearest) >= 1.0 - 1e-9
    # Carrying all pairs along everywhere gains nothing.
    everywhere = tuple(
        Imposed(0, coupling.name, ((0.0, 1.0),))
        for coupling in problem.phases[0].couplings
    )
    options = replace(options, couplings=everywhere)
    full = ocp.solve(problem, guess=solution, options=options)
    assert solution.objective == pytest.approx(full.objective, rel=1e-5)


def test_a_pair_that_is_never_near_is_not_imposed():
    starts, ends = across([0.0, 2.0])
    ways = [*starts, (0.0, 9.0)], [*ends, (2.0, 9.0)]
    problem = crossing(*ways)
    couplings = Couplings(problem)
    imposed = []

    def once(present, former):
        imposed.append({entry.name for entry in present})
        mesh = ocp.Mesh.uniform(10, 4)
        built = ocp.Transcription(problem, mesh, couplings=present)
        return built.solve(guess=former)

    solution = enforce(couplings, once)
    assert imposed[0] == set()
    assert imposed[-1] == {"0 and 1"}
    assert couplings.violations(solution) == []
    assert distance(solution, 0, 1) >= 1.0 - 1e-9
    (entry,) = couplings.imposed
    ((start, end),) = entry.stretches
    assert end - start < 0.6


def test_no_violated_coupling_costs_nothing():
    ways = [(0.0, 0.0), (3.0, 1.0)], [(1.0, 5.0), (4.0, 6.0)]
    problem, bare = crossing(*ways), crossing(*ways)
    bare.phases[0].couplings.clear()
    with_them, without = ocp.solve(problem), ocp.solve(bare)
    assert with_them.iterations == without.iterations
    assert with_them.objective == without.objective


def test_two_that_meet_head_on_pass_each_other():
    """The gradient of their distance vanishes where they meet."""
    problem = crossing([(-4.0, 0.0), (4.0, 0.0)], [(4.0, 0.0), (-4.0, 0.0)])
    solution = ocp.solve(problem, options=ocp.Options(tolerance=1e-4))
    assert solution.result is ocp.Result.SOLVED
    assert 1.0 - 1e-9 <= distance(solution, 0, 1) < 1.001
    assert solution.iterations < 200


def test_the_audit_sees_a_dip_between_samples():
    """A coupling that dips under its bound for 1 ms of 7 s is found, and where."""
    problem = ocp.Problem("dip")
    phase = problem.phase(duration=7.0)
    x = phase.state("x", start=-3.5, end=3.5)
    phase.derivative(x, phase.control("u", 1.0, 1.0))
    phase.couple((x - 0.123456) ** 2, (0.5e-3) ** 2, None, name="dip")
    problem.minimise(0.0)
    solution = ocp.Transcription(problem, ocp.Mesh.uniform(3, 2)).solve()
    table = Statement(problem).table(np.zeros(0))
    (found,) = CouplingAuditor(problem, phase, 0).violations(solution, table)
    assert found.time == pytest.approx(3.623456, abs=1e-3)
    assert found.amount == pytest.approx((0.5e-3) ** 2, rel=0.05)
    ((start, end),) = found.stretches
    assert start < found.time / 7.0 < end


def test_what_cannot_be_kept_is_named():
    """A distance that the ends contradict: the message says which pair it is."""
    problem = crossing(*across([0.0, 2.0]), apart=7.5)
    solution = ocp.solve(problem, options=ocp.Options(meshes=2))
    assert not solution.result.usable
    assert "0 and 1" in solution.message


@pytest.mark.parametrize(
    ("expression", "degree"),
    [
        (lambda x, y: x - y, 1),
        (lambda x, y: (x - y) ** 2 + y**2, 2),
        (lambda x, y: x * y * (x + y), 3),
        (lambda x, _: 7.0 + 0.0 * x, 0),
        (lambda x, y: ca.sqrt(x**2 + y**2), None),
    ],
)
def test_degree(expression, degree):
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    found = polynomial_degree(ca.SX(expression(x, y)), ca.vertcat(x, y))
    assert found == degree


def test_what_is_no_polynomial_in_the_states_is_refused():
    problem = ocp.Problem("refused")
    phase = problem.phase()
    x, u = phase.state("x"), phase.control("u")
    for expression in (ca.sin(x), u**2, x * phase.time):
        with pytest.raises(ValueError, match="polynomial of degree 4"):
            phase.couple(expression, 0.0)
    phase.couple(x**2, 0.0, name="one")
    with pytest.raises(ValueError, match="two couplings named 'one'"):
        phase.couple(x, 0.0, name="one")


def test_stretches_are_joined():
    parts = [(0.4, 0.5), (0.1, 0.2), (0.5, 0.7), (0.15, 0.3)]
    assert merged(parts) == ((0.1, 0.3), (0.4, 0.7))
