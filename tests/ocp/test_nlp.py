"""The assembled derivatives are those of the assembled functions."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from showc import ocp


def coupled(*, integral_in_constraint: bool) -> ocp.Problem:
    """A problem that uses every kind of row there is."""
    problem = ocp.Problem("everything")
    p = problem.parameter("p", default=0.7)
    s = problem.static("s", 0.1, 2.0)
    first = problem.phase("first", duration=(0.5, 3.0), start=(0.0, 1.0))
    second = problem.phase("second", duration=(0.5, 3.0))
    costs = 0.0
    for phase in (first, second):
        x = phase.state("x", -2.0, 2.0, start=0.3 if phase is first else None)
        y = phase.state("y", -3.0, 3.0, end=0.1 if phase is second else None)
        u = phase.control("u", -1.0, 1.0, degree=1)
        w = phase.control("w", -1.0, 1.0)
        phase.derivative(x, y * ca.cos(x) + s * u * phase.time)
        phase.derivative(y, p * x**2 - ca.sin(y) * w + u**3)
        phase.constrain(x**2 + u * w, None, 1.5, name="circle")
        phase.half_space("wall", [x, y], 2) if phase is first else None
        cost = phase.integral(u**2 + w**2 * p + x * y)
        if phase is first and integral_in_constraint:
            problem.constrain_boundary(cost**2, None, 4.0, name="energy")
        costs += cost * p
    problem.link(first, second)
    problem.constrain_boundary(
        second.final(second.states["x"].quantity.symbol) * s, 0.0, 0.5, name="end"
    )
    problem.minimise(costs + second.final_time**2 + s**2)
    return problem


@pytest.mark.parametrize("integral_in_constraint", [False, True])
@pytest.mark.parametrize("scheme", ["gauss", "radau", "lobatto"])
def test_gradient_jacobian_and_hessian_equal_casadis_own(
    scheme, integral_in_constraint
):
    mesh = ocp.Mesh(
        (
            ocp.PhaseMesh(
                (0.3, 0.7, 1.0), (3, 4, 2), (0, 0, 1), {}, ((0.0, 0.4), (), (1.0,))
            ),
            ocp.PhaseMesh.uniform(2, 3),
        )
    )
    problem = coupled(integral_in_constraint=integral_in_constraint)
    built = ocp.Transcription(problem, mesh, scheme=scheme).discretisation
    program = built.program
    x, p = program.oracle["x"], program.oracle["p"]
    f, g = program.oracle["f"], program.oracle["g"]
    weight, dual = ca.MX.sym("s"), ca.MX.sym("l", program.constraints)
    rng = np.random.default_rng(5)
    at = rng.normal(scale=0.5, size=program.unknowns)
    parameters = rng.normal(size=program.parameters)
    multipliers = rng.normal(size=program.constraints)

    reference = ca.Function("r", [x, p], [ca.gradient(f, x), ca.jacobian(g, x)])
    gradient, jacobian = (np.asarray(m) for m in reference(at, parameters))
    mine = np.asarray(program.objective_gradient(at, parameters)[1])
    assert mine == pytest.approx(gradient, abs=1e-12)
    mine = np.asarray(program.constraint_jacobian(at, parameters)[1])
    assert mine == pytest.approx(jacobian, abs=1e-12)

    lagrangian = weight * f + ca.dot(dual, g)
    reference = ca.Function("h", [x, p, weight, dual], [ca.hessian(lagrangian, x)[0]])
    hessian = np.triu(np.asarray(reference(at, parameters, 1.3, multipliers)))
    mine = program.lagrangian_hessian(at, parameters, 1.3, multipliers)
    assert np.asarray(mine) == pytest.approx(hessian, abs=1e-11)


def test_building_traces_the_dynamics_once_whatever_the_mesh():
    calls = []

    def problem() -> ocp.Problem:
        made = ocp.Problem("counted")
        phase = made.phase(duration=1.0)
        x = phase.state("x", start=1.0)
        u = phase.control("u")
        calls.append(1)
        phase.derivative(x, -x + u)
        made.minimise(phase.integral(x**2 + u**2))
        return made

    fine = ocp.Transcription(problem(), ocp.Mesh.uniform(200, 3))
    coarse = ocp.Transcription(problem(), ocp.Mesh.uniform(2, 3))
    small = coarse.discretisation.program.constraint_jacobian
    large = fine.discretisation.program.constraint_jacobian
    # The work grows in the mapped columns, not in the number of instructions.
    assert large.n_instructions() == small.n_instructions()
