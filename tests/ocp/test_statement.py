"""What is stated wrong is said at once: what, with which value, in which line."""

from __future__ import annotations

import inspect

import casadi as ca
import numpy as np
import pytest

from showc import ocp


def here(offset: int = 0) -> str:
    """File and line of the caller, and ``offset`` lines on."""
    frame = inspect.currentframe().f_back
    return f"test_statement.py:{frame.f_lineno + offset}: "


def integrator() -> tuple[ocp.Problem, ocp.Phase]:
    problem = ocp.Problem("integrator")
    phase = problem.phase(duration=(0.1, 10.0))
    x = phase.state("x", start=0.0, end=1.0)
    v = phase.state("v", start=0.0, end=0.0)
    u = phase.control("u", -1.0, 1.0)
    phase.derivative(x, v)
    phase.derivative(v, u)
    problem.minimise(phase.duration)
    return problem, phase


def test_a_fault_names_the_users_line():
    _, phase = integrator()
    line = here(2)
    with pytest.raises(ocp.StatementError) as fault:
        phase.state("w", 2.0, 1.0)
    assert str(fault.value) == f"{line}state 'w' is to be at least 2 and at most 1"


def test_a_missing_derivative_names_the_line_of_its_state():
    problem, phase = integrator()
    line = here(1)
    phase.state("w")
    with pytest.raises(ocp.StatementError, match="no derivative for state w") as fault:
        ocp.solve(problem)
    assert str(fault.value).startswith(line)


@pytest.mark.parametrize(
    ("state", "words"),
    [
        (lambda p: p.state("x"), "two quantities named 'x'"),
        (lambda p: p.state("a.b"), "without a dot"),
        (lambda p: p.state("w", scale=0.0), "scale of state 'w' is 0.0"),
        (lambda p: p.state("w", float("nan")), "is not a number"),
        (lambda p: p.state("w", start=(1.0, 2.0, 3.0)), "has 3 bounds"),
        (lambda p: p.state("w", start="far"), "is of type str"),
        (lambda p: p.state("w", start=ca.MX.sym("m")), "is a CasADi MX"),
        (lambda p: p.control("w", degree=-1), "degree of control 'w' is -1"),
        (
            lambda p: p.derivative(p.controls["u"].quantity.symbol, 1.0),
            "'u' is a control of phase 'phase'; only states have a derivative",
        ),
        (
            lambda p: p.derivative(p.states["x"].quantity.symbol, ca.SX.zeros(2)),
            "shape 2 x 1",
        ),
        (lambda p: p.derivative(ca.SX.sym("x"), 1.0), "is no state or control"),
        (lambda p: p.derivative("x", 1.0), "'x' is given; wanted a symbol of state"),
        (lambda p: p.constrain(ca.MX.sym("m"), 0.0), "is a CasADi MX"),
        (lambda p: p.constrain(ca.SX.sym("m", 2), 0.0), "shape 2 x 1"),
        (lambda p: p.integral(np.ones(3)), "shape 3 x 1"),
        (lambda p: p.state("w", start=float("inf")), "wanted a finite number"),
        (lambda p: p.state("w", shape=2.0), "shape 2.0; wanted a length"),
        (lambda p: p.state("w", shape=(2, 2, 2)), "wanted a length, or rows and col"),
        (lambda p: p.constrain(p.time <= 1.0), "has no bounds"),
    ],
)
def test_what_makes_no_sense_in_a_phase_is_refused(state, words):
    _, phase = integrator()
    with pytest.raises(ocp.StatementError, match=words):
        state(phase)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"overrides": {"x": 1.0}}, r"is of type dict; wanted ocp\.Overrides"),
        ({"overrides": ocp.Overrides(durations={"leg": 1.0})}, "names 'leg'; there is"),
        ({"options": {"tolerance": 1.0}}, r"is of type dict; wanted ocp\.Options"),
        ({"options": ocp.Options(mesh=ocp.Mesh(()))}, "has 0 phases; the problem has"),
        ({"parameters": {"mass": float("nan")}}, "parameter 'mass' is not a number"),
        ({"parameters": {"mass": "2"}}, "parameter 'mass' is of type str"),
    ],
)
def test_what_makes_no_sense_in_a_solve_is_refused(wrong, words):
    problem, _ = integrator()
    problem.parameter("mass", 1.0)
    with pytest.raises(ocp.StatementError, match=words):
        ocp.solve(problem, **wrong)


def test_an_option_that_the_solver_does_not_know_is_named():
    solver = ocp.SolverOptions(extra={"no_such": 1})
    with pytest.raises(ocp.StatementError, match="No such IPOPT option: no_such"):
        ocp.solve(integrator()[0], options=ocp.Options(solver=solver))
    with pytest.raises(ocp.StatementError, match="solver is 'knitro'"):
        ocp.SolverOptions("knitro")


def test_a_solution_of_other_phases_is_no_guess():
    solution = ocp.solve(integrator()[0], options=ocp.Options(meshes=1))
    problem = ocp.Problem("two legs")
    for name in ("out", "back"):
        leg = problem.phase(name, duration=1.0)
        leg.derivative(leg.state("x"), 1.0)
    problem.minimise(0.0)
    with pytest.raises(ocp.StatementError, match="the problem has out, back"):
        ocp.solve(problem, guess=solution)


def test_lists_of_rates_are_taken_for_vectors():
    problem = ocp.Problem("plane")
    phase = problem.phase(duration=1.0)
    place = phase.state("place", start=0.0, end=[1.0, 2.0], shape=2)
    pace = phase.control("pace", shape=2)
    phase.derivative(place, [pace[0], pace[1]])
    problem.minimise(phase.integral(ca.sumsqr(pace)))
    assert ocp.solve(problem).objective == pytest.approx(5.0, rel=1e-6)


def test_a_longer_time_without_bound_is_said_to_be_unlimited():
    problem = ocp.Problem("for ever")
    phase = problem.phase()
    x = phase.state("x", start=0.0)
    phase.derivative(x, phase.control("u", -1.0, 1.0))
    problem.maximise(phase.final(x))
    solution = ocp.solve(problem)
    assert solution.result is ocp.Result.UNBOUNDED
    assert "'duration' of phase 'phase'" in solution.message


def test_an_objective_must_be_stated():
    problem = ocp.Problem("aimless")
    phase = problem.phase(duration=1.0)
    phase.derivative(phase.state("x"), 1.0)
    with pytest.raises(ocp.StatementError, match="has no objective; call minimise"):
        ocp.solve(problem)


def test_an_objective_of_a_state_itself_says_what_to_write():
    problem, phase = integrator()
    problem.minimise(phase.states["x"].quantity.symbol)
    with pytest.raises(ocp.StatementError, match=r"final\(x\) or an integral"):
        ocp.solve(problem)


def test_symbols_of_elsewhere_are_named():
    problem, phase = integrator()
    phase.constrain(phase.duration * phase.states["x"].quantity.symbol, None, 1.0)
    with pytest.raises(ocp.StatementError, match=r"contains 'phase\.duration'"):
        ocp.solve(problem)
    problem, phase = integrator()
    problem.minimise(phase.duration + ca.SX.sym("stray"))
    with pytest.raises(ocp.StatementError, match="contains 'stray' itself"):
        ocp.solve(problem)


@pytest.mark.parametrize(
    ("guess", "words"),
    [
        ({"x": 1.0}, r"of type dict; wanted ocp\.Guess"),
        (ocp.Guess({"z": 1.0}), "names 'z'; there is x, phase.x, v"),
        (ocp.Guess(durations={"leg": 1.0}), "names 'leg'; there is phase"),
        (ocp.Guess(statics={"m": 1.0}), "names 'm'; there is nothing"),
        (ocp.Guess({"x": np.ones((2, 2))}), r"has shape \(2, 2\)"),
        (ocp.Guess({"x": ca.DM([0.0, 1.0])}), r"has shape \(2, 1\)"),
        (ocp.Guess({"x": [0.0, float("nan")]}), "'x' is not finite everywhere"),
        (ocp.Guess({"x": lambda s: s / 0.0}), "'x' is not finite everywhere"),
        (ocp.Guess({"x": lambda _: np.ones(3)}), r"shape \(3,\) for fractions of"),
        (ocp.Guess({"x": lambda: 1.0}), "'x' cannot be called with an array"),
        (ocp.Guess({"x": "far"}), "'x' is no number"),
        (ocp.Guess(["x"]), "curves of the guess are a list; wanted a dict"),
        (ocp.Guess(durations={"phase": -1.0}), "'phase' is -1.0; wanted above 0"),
    ],
)
def test_a_wrong_guess_is_refused(guess, words):
    with pytest.raises(ocp.StatementError, match=words):
        ocp.solve(integrator()[0], guess=guess)


@pytest.mark.parametrize("scales", [{"z": 1.0}, {"x": 0.0}, {"x": -1.0}])
def test_a_wrong_scale_is_refused(scales):
    with pytest.raises(ocp.StatementError, match="scale"):
        ocp.solve(integrator()[0], options=ocp.Options(scales=scales))


@pytest.mark.parametrize(
    "wrong",
    [
        {"tolerance": 0.0},
        {"meshes": 0},
        {"scheme": "simpson"},
        {"starts": 2.5},
        {"mesh": 20},
        {"solver": "ipopt"},
    ],
)
def test_a_wrong_option_is_refused(wrong):
    with pytest.raises(ocp.StatementError, match=next(iter(wrong))):
        ocp.Options(**wrong)


def jump(**link) -> ocp.Problem:
    """Two seconds; the second phase starts with whatever the link leaves free."""
    problem = ocp.Problem("jump")
    first = problem.phase("first", duration=1.0)
    second = problem.phase("second", duration=1.0)
    for phase in (first, second):
        x = phase.state("x", -10.0, 10.0, **({"start": 1.0} if phase is first else {}))
        u = phase.control("u", -1.0, 1.0)
        phase.derivative(x, u)
    end = first.final(first.states["x"].quantity.symbol)
    if link.pop("halved", False):
        link["jumps"] = {"x": 0.5 * end}
    problem.link(first, second, **link)
    problem.minimise(second.final(second.states["x"].quantity.symbol))
    return problem


@pytest.mark.parametrize(
    ("link", "least"),
    [
        ({}, -1.0),
        ({"states": ["x"]}, -1.0),
        ({"states": []}, -10.0),
        ({"halved": True}, -1.0),
        ({"states": [], "halved": True}, -1.0),
    ],
)
def test_a_link_joins_what_it_says_and_no_more(link, least):
    solution = ocp.solve(jump(**link))
    assert solution.objective == pytest.approx(least, abs=1e-6)
    first, second = solution.phases
    assert second.start == pytest.approx(first.end, abs=1e-9)
    if link.get("halved"):
        assert second.state("x")(1.0) == pytest.approx(0.5 * first.state("x")(1.0))


def test_wrong_links_are_refused():
    problem = ocp.Problem("two")
    first, second = problem.phase("first"), problem.phase("second")
    stranger = ocp.Problem("other").phase("third")
    first.state("x")
    with pytest.raises(
        ocp.StatementError, match="'third' is no phase of problem 'two'"
    ):
        problem.link(first, stranger)
    with pytest.raises(ocp.StatementError, match="names 'x'; there is nothing"):
        problem.link(first, second, ["x"])
    with pytest.raises(ocp.StatementError, match="finds no state that both have"):
        problem.link(first, second)
    with pytest.raises(ocp.StatementError, match="joins a phase to itself"):
        problem.link(first, first)
    problem.link(first, second, [])
    with pytest.raises(ocp.StatementError, match="is stated twice"):
        problem.link(first, second, [])


def test_vectors_and_matrices_are_states_by_element():
    problem = ocp.Problem("plane")
    phase = problem.phase(duration=(0.1, 10.0))
    place = phase.state("place", start=[0.0, 0.0], end=[3.0, 4.0], shape=2)
    push = phase.control("push", -1.0, 1.0, shape=2)
    turn = phase.state("turn", start=np.eye(2).tolist(), shape=(2, 2))
    phase.derivative(place, push)
    phase.derivative(turn, ca.mtimes(ca.DM([[0.0, -1.0], [1.0, 0.0]]), turn))
    problem.minimise(phase.duration)
    assert phase.final(place).shape == (2, 1)
    solution = ocp.solve(problem)
    part = solution.phases[0]
    assert solution.objective == pytest.approx(4.0, rel=1e-6)
    assert part.state("place")(part.end) == pytest.approx([3.0, 4.0])
    angle = part.duration
    wanted = [np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)]
    assert part.state("turn")(part.end) == pytest.approx(wanted, abs=1e-6)
    with pytest.raises(ocp.StatementError, match="wanted one rate for each element"):
        phase.derivative(place, ca.SX.zeros(3))
    with pytest.raises(ocp.StatementError, match="'start' of 'w' has the shape"):
        phase.state("w", start=[1.0, 2.0, 3.0], shape=2)


def test_an_algebraic_variable_is_a_control_in_an_equation():
    # y = z² with z + z³ = x: the equation holds between the points too.
    problem = ocp.Problem("algebraic")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", start=1.0)
    z = phase.control("z")
    u = phase.control("u", -1.0, 1.0)
    phase.derivative(x, -z + u)
    phase.constrain(z + z**3 - x, 0.0, 0.0, name="equilibrium")
    problem.minimise(phase.integral(z**2 + 0.1 * u**2))
    assert phase.index_of("equilibrium") == 1
    solution = ocp.solve(problem)
    assert solution.result is ocp.Result.SOLVED, solution.message
    part = solution.phases[0]
    times = np.linspace(0.0, 1.0, 501)
    root, state = part.control("z")(times), part.state("x")(times)
    assert np.abs(root + root**3 - state).max() < 2e-6


def test_the_index_of_an_equation_is_said():
    problem = ocp.Problem("pendulum")
    phase = problem.phase(duration=1.0)
    x, y = phase.state("x", start=1.0), phase.state("y", start=0.0)
    vx, vy = phase.state("vx", start=0.0), phase.state("vy", start=0.0)
    pull = phase.control("pull")
    phase.derivative(x, vx)
    phase.derivative(y, vy)
    phase.derivative(vx, -pull * x)
    phase.derivative(vy, -pull * y - 9.81)
    phase.constrain(x**2 + y**2, 1.0, 1.0, name="rod")
    assert phase.index_of("rod") == 3


def test_guesses_may_be_data_over_time():
    problem, _ = integrator()
    data = ocp.Data([0.0, 0.5, 2.5], [0.0, 0.1, 1.0])
    built = ocp.Transcription(problem, ocp.Mesh.uniform(4, 3))
    solution = built.solve(guess=ocp.Guess({"x": data}))
    assert solution.objective == pytest.approx(2.0, rel=1e-3)
    with pytest.raises(ocp.StatementError, match="do not increase"):
        ocp.Data([0.0, 0.0], [1.0, 2.0])
    with pytest.raises(ocp.StatementError, match="one value for each time"):
        ocp.Data([0.0, 1.0], [1.0])


def test_an_objective_without_limit_says_so():
    problem = ocp.Problem("greedy")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", start=0.0)
    u = phase.control("u")
    phase.derivative(x, u)
    problem.maximise(phase.final(x))
    solution = ocp.solve(problem)
    assert solution.result is ocp.Result.UNBOUNDED
    assert "'u'" in solution.message or "'x'" in solution.message


def test_a_control_may_be_limited_in_how_fast_it_changes():
    # Jerk limited rest to rest: least time (32 d / j) to the power 1/3.
    problem = ocp.Problem("jerk")
    phase = problem.phase(duration=(0.1, 20.0))
    x = phase.state("x", start=0.0, end=1.0)
    v = phase.state("v", start=0.0, end=0.0)
    push = phase.control("push", -9.0, 9.0, rate=(-1.0, 1.0))
    phase.derivative(x, v)
    phase.derivative(v, push)
    for end in (phase.initial(push), phase.final(push)):
        problem.constrain_boundary(end, 0.0, 0.0)
    problem.minimise(phase.duration)
    solution = ocp.solve(problem)
    assert solution.objective == pytest.approx(32.0 ** (1.0 / 3.0), rel=1e-6)
    slope = solution.phases[0].state("push").derivative()
    times = np.linspace(0.0, solution.duration, 1001)
    assert np.abs(slope(times)).max() <= 1.0 + 1e-6
    with pytest.raises(ocp.StatementError, match="wanted two bounds"):
        phase.control("w", rate=1.0)


@pytest.mark.parametrize(
    ("state", "words"),
    [
        (
            lambda phase, v: phase.constrain(v < 0.5, None, 0.0, name="slow"),
            r"'slow' is a comparison .*; give what is compared",
        ),
        (lambda phase, _: phase.final("v"), "'v' is given; wanted a symbol of state"),
    ],
)
def test_what_only_looks_like_a_statement_is_refused(state, words):
    _, phase = integrator()
    with pytest.raises(ocp.StatementError, match=words):
        state(phase, phase.states["v"].quantity.symbol)


def test_any_trajectory_will_do_where_nothing_is_to_be_least():
    problem, phase = integrator()
    problem.minimise(0.0 * phase.duration)
    solution = ocp.solve(problem)
    assert solution.result is ocp.Result.SOLVED
    assert solution.objective == solution.error.objective == 0.0
    graded = ocp.solve(problem, options=ocp.Options.graded())
    assert graded.result is ocp.Result.SOLVED


def test_more_equations_than_unknowns_that_agree_are_solved_in_silence(capfd):
    problem = ocp.Problem("on a circle")
    phase = problem.phase(duration=1.0)
    x, y = phase.state("x", start=1.0, end=0.0), phase.state("y", start=0.0, end=1.0)
    u = phase.control("u", degree=0)
    phase.derivative(x, -y * u)
    phase.derivative(y, x * u)
    problem.minimise(phase.integral(u**2))
    mesh = ocp.Mesh.uniform(1, 8)
    solution = ocp.solve(problem, options=ocp.Options(mesh=mesh))
    assert solution.objective == pytest.approx((0.5 * np.pi) ** 2, rel=1e-6)
    assert not capfd.readouterr().err


def test_a_kink_that_stops_the_search_is_named():
    problem = ocp.Problem("least fuel")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", start=1.0, end=0.8)
    u = phase.control("u", -1.0, 1.0)
    phase.derivative(x, u - x)
    problem.minimise(phase.integral(ca.fabs(u)))
    solution = ocp.solve(problem)
    assert not solution.result.usable
    assert "The statement uses fabs, whose slope jumps" in solution.message
