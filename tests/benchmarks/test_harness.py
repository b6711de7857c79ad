"""The benchmark harness: tables, translated problems, and the audit itself."""

import subprocess
import sys
from dataclasses import replace
from math import cos, exp, sin, sqrt
from pathlib import Path

import numpy as np
import pytest
from benchmarks import cases, quadrotor
from benchmarks.audit import (
    Answer,
    Piece,
    Polynomial,
    bound_violation,
    reintegrate,
    report,
)
from benchmarks.clock import cpu_time
from benchmarks.document import page
from benchmarks.environment import PEERS
from benchmarks.measure import Effort, Row
from benchmarks.problem import NUMBERS, Problem, evaluate
from benchmarks.table import error, length, markdown, percent, ratio, seconds

PROBLEMS = cases.load()


def test_table_is_aligned_markdown():
    text = markdown(("a", "bb"), [("x", "1"), ("long | name", "22")])
    assert text.splitlines() == [
        "| a            |  bb |",
        "| ------------ | --: |",
        "| x            |   1 |",
        r"| long \| name |  22 |",
    ]
    with pytest.raises(ValueError, match="has 1 cells; wanted 2"):
        markdown(("a", "b"), [("x",)])


@pytest.mark.parametrize(
    ("written", "wanted"),
    [
        (error(4.3e-7), "4e-07"),
        (error(None), "–"),
        (error(139.4), "140"),
        (error(float("inf")), "diverges"),
        (seconds(0.1234), "0.123"),
        (seconds(12.34), "12.3"),
        (seconds(1234.0), "1234"),
        (percent(0.2193), "22 %"),
        (percent(0.0), "0"),
        (percent(3.4e-6), "3e-06"),
        (length(0.00052), "0.5 mm"),
        (length(0.0123), "1.2 cm"),
        (length(91.2), "91 m"),
        (ratio(4.96), "5 x"),
        (ratio(212.3), "210 x"),
        (percent(1.049), "100 %"),
        (length(145.3), "150 m"),
    ],
)
def test_numbers_are_written_for_people(written, wanted):
    assert written == wanted


def test_expressions_are_arithmetic_and_nothing_else():
    assert evaluate("-2*x**2 + 3/4 - (x - 1)", {"x": 3.0}) == -19.25
    assert evaluate("sqrt(x)*cos(pi)", {"x": 4.0}) == -2.0
    with pytest.raises(ValueError, match="unknown name 'y'"):
        evaluate("x + y", {"x": 1.0})
    with pytest.raises(ValueError, match="is no arithmetic"):
        evaluate("__import__('os').getcwd()", {})
    with pytest.raises(ValueError, match="is no arithmetic"):
        evaluate("x.real", {"x": 1.0})


INERTIA = ((5 - 4.2) ** 3 + 4.2**3) / 3
REFERENCE = {
    "bryson_denham": ([0.1, 0.7], [-3.0], [0.7, -3.0]),
    "double_integrator": ([0.1, 0.7], [-0.5], [0.7, -0.5]),
    "double_integrator_vmax": ([0.1, 0.7], [-0.5], [0.7, -0.5]),
    "brachistochrone": (
        [1.0, 2.0, 3.0],
        [0.4],
        [3.0 * sin(0.4), 3.0 * cos(0.4), 9.80665 * cos(0.4)],
    ),
    "goddard": (
        [1.004, 0.1, 0.8],
        [2.5],
        [
            0.1,
            (2.5 - 310 * 0.01 * exp(-2.0)) / 0.8 - 1 / 1.004**2,
            -5.0,
        ],
    ),
    "hypersensitive": ([1.2], [0.3], [0.3 - 1.728]),
    "hypersensitive_reversed": ([1.2], [0.3], [0.3 - 1.728]),
    "robot_arm": (
        [4.2, 0.1, 0.5, 0.2, 0.9, -0.3],
        [0.5, -0.25, 1.0],
        [0.1, 0.1, 0.2, -0.25 / (INERTIA * sin(0.9) ** 2), -0.3, 1 / INERTIA],
    ),
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_rates_equal_the_reference(name):
    states, controls, wanted = REFERENCE[name]
    rates = PROBLEMS[name].rates(states, controls, NUMBERS)
    assert rates == pytest.approx(wanted, rel=1e-12)


def test_integrands_equal_the_reference():
    assert PROBLEMS["bryson_denham"].cost_rate([0, 0], [3.0], NUMBERS) == 4.5
    assert PROBLEMS["hypersensitive"].cost_rate([2.0], [1.0], NUMBERS) == 2.5
    assert PROBLEMS["robot_arm"].cost_rate([0] * 6, [0] * 3, NUMBERS) is None


@pytest.mark.parametrize("problem", PROBLEMS.values(), ids=PROBLEMS)
def test_every_problem_has_an_optimum_with_its_source(problem):
    assert problem.optimum is not None and problem.optimum > 0.0
    assert problem.source
    assert 0.0 <= problem.accuracy <= 1e-9
    assert Problem.from_dict(problem.to_dict()) == problem


def test_the_analytic_optima_follow_from_the_data():
    assert PROBLEMS["bryson_denham"].optimum == 4 / (
        9 * PROBLEMS["bryson_denham"].states[0].upper
    )
    assert PROBLEMS["double_integrator"].optimum == 2 * sqrt(1 / 1)
    vmax = PROBLEMS["double_integrator_vmax"]
    speed = vmax.states[1].upper
    assert vmax.optimum == vmax.states[0].end / speed + speed / vmax.controls[0].upper


def test_the_hypersensitive_optima_follow_from_a_quadrature():
    nodes, weights = np.polynomial.legendre.leggauss(200)

    def integral(f, end):
        s = end * (nodes + 1) / 2
        return float(end / 2 * weights @ f(s))

    def inward(s):
        return -(s**3) + np.sqrt(s**6 + s**2)

    def outward(s):
        return s**3 + np.sqrt(s**6 + s**2)

    for name, start, end in (
        ("hypersensitive", 1.5, 1.0),
        ("hypersensitive_reversed", 1.0, 1.5),
    ):
        value = integral(inward, start) + integral(outward, end)
        assert PROBLEMS[name].optimum == pytest.approx(value, rel=1e-12)


def test_the_brachistochrone_optimum_follows_from_the_cycloid():
    low, high = 1.0, 6.0  # (angle - sin angle) / (1 - cos angle) = 10 / 5
    for _ in range(200):
        angle = (low + high) / 2
        if (angle - sin(angle)) / (1 - cos(angle)) < 2.0:
            low = angle
        else:
            high = angle
    radius = 5.0 / (1 - cos(angle))
    time = angle * sqrt(radius / 9.80665)
    assert PROBLEMS["brachistochrone"].optimum == pytest.approx(time, rel=1e-13)


def test_the_quadrotor_hovers_and_is_as_wide_as_it_should_be():
    one, six = quadrotor.one(), quadrotor.six()
    hover = [0.0] * 12
    thrust = [control.guess for control in one.controls]
    assert one.rates(hover, thrust, NUMBERS) == pytest.approx([0.0] * 12, abs=1e-12)
    assert (len(six.states), len(six.controls), len(six.paths)) == (72, 24, 15)
    assert six.place_columns()[1] == (12, 13, 14)
    places = [state.start for state in six.states]
    distances = np.sqrt(six.path_values(places, [0.0] * 24, NUMBERS))
    assert distances.min() == pytest.approx(2.0)
    tilted = [0.0] * 6 + [0.1, 0.2, 0.3, 0.0, 0.0, 0.0]
    rates = one.rates(tilted, [10.0, 0.0, 0.0, 0.0], NUMBERS)
    assert rates[3] == pytest.approx(
        16 * (cos(0.1) * sin(0.2) * cos(0.3) + sin(0.1) * sin(0.3))
    )
    turned = one.rates(hover, [0.0, 0.1, 0.0, 0.0], NUMBERS)
    assert turned[9] == pytest.approx(0.1275 * 0.1 / 2.3e-3)


def double_integrator_pieces(top=1.0):
    """The optimum of the double integrator; ``top``: what the control claims."""
    pieces = []
    for start, sign in ((0.0, 1.0), (1.0, -1.0)):
        times = np.linspace(start, start + 1.0, 3)
        if sign > 0:
            states = np.stack([times**2 / 2, times], 1)
        else:
            states = np.stack([1 - (2 - times) ** 2 / 2, 2 - times], 1)
        middle = np.array([start + 0.5])
        pieces.append(
            Piece(start, start + 1.0, times, states, middle, np.array([[sign * top]]))
        )
    return pieces


def test_the_audit_finds_nothing_on_an_exact_answer():
    problem = PROBLEMS["double_integrator"]
    answer = Answer(2.0, double_integrator_pieces(), 1, 6, "", solved=True)
    figures = report(problem, answer)
    assert figures["relative_error"] == 0.0
    assert figures["bound_violation"] == 0.0
    assert figures["flown_error"] < 1e-12


def test_the_audit_finds_a_control_beyond_its_bound():
    problem = PROBLEMS["double_integrator"]
    pieces = double_integrator_pieces(top=1.2)
    assert bound_violation(problem, pieces) == (pytest.approx(0.1), "u")
    # Cut at the bound it flies the true optimum; as claimed it overshoots.
    assert reintegrate(problem, pieces).max() < 1e-12
    assert reintegrate(problem, pieces, clip=False).max() == pytest.approx(0.2)


def test_the_audit_finds_a_peak_between_the_nodes():
    problem = PROBLEMS["double_integrator_vmax"]
    nodes = np.array([0.0, 1.0, 2.0])
    states = np.array([[0.0, 0.0], [1.0, 2.0], [2.0, 1.9]])
    piece = Piece(0.0, 2.0, nodes, states, np.array([1.0]), np.array([[0.0]]))
    violation, whose = bound_violation(problem, [piece])
    assert whose == "v"
    assert violation > 0.05


def test_interpolation_is_exact_for_its_degree():
    nodes = np.array([0.0, 0.3, 0.7, 1.0, 1.6])
    polynomial = Polynomial(nodes, np.stack([nodes**4, 1 - nodes**3], 1))
    times = np.array([0.0, 0.15, 0.7, 1.59])
    assert polynomial(times) == pytest.approx(
        np.stack([times**4, 1 - times**3], 1), abs=1e-12
    )


def test_no_peer_is_dropped_in_silence():
    good = {
        "objective": 2.0, "relative_error": 1e-9, "solves": 1, "points": 40,
        "solved": True, "bound_violation": 0.0, "flown_error": 1e-9, "version": "0.1",
    }  # fmt: skip
    rows = [
        Row("p showc", "p", "showc", "", 5, 0.1, good),
        Row("p maptor", "p", "maptor", "", 5, 0.5, good),
        Row("p yapss", "p", "yapss", "", 1, None, {"failure": "no result in 9 s"}),
    ]
    text = page(Effort(), rows, [], [], {"rockit": "no wheel"}, reused="")
    assert "- p yapss: no result in 9 s" in text
    assert "- rockit: not installed here: no wheel" in text
    assert "5 x" in text
    assert "takes 5 times the CPU time" in text
    for peer in PEERS:
        assert peer.name in text and peer.version in text


def test_every_case_names_a_known_solver():
    names = {"showc", *(peer.name for peer in PEERS)}
    everything = [*cases.classic(), *cases.flights()]
    assert {case.peer for case in everything} == names
    keys = [case.key for case in everything]
    assert len(keys) == len(set(keys))
    assert len(cases.classic()) == len(PROBLEMS) * len(names)


@pytest.mark.skipif(not Path("/proc/self/schedstat").exists(), reason="Linux only")
def test_the_clock_counts_children_at_work():
    burn = "import time\nwhile time.process_time() < 0.2: pass\nprint(1, flush=True)"
    before = cpu_time()
    code = burn + "\ninput()"
    with subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as child:
        child.stdout.readline()
        alive = cpu_time() - before
        child.communicate(b"\n")
    ended = cpu_time() - before
    assert 0.19 < alive <= ended + 0.02
    assert ended < 1.5


def test_a_fault_in_a_peer_is_its_own():
    broken = replace(PROBLEMS["double_integrator"], where={"bad": "unknown*2"})
    with pytest.raises(ValueError, match="unknown name"):
        broken.rates([0.0, 0.0], [0.0], NUMBERS)
