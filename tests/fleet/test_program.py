"""The convex program of a spline: rows left out at first change nothing."""

import numpy as np
import pytest
from fleet.handmade import LIMITS, VEHICLE

from showc.fleet.shared_profile.profile import Profile
from showc.fleet.shared_profile.synchronise import shared_profile
from showc.fleet.single_drone import convex_program as module
from showc.fleet.single_drone.convex_program import NO_WALLS, WALL_DEGREE, Aim, Program
from showc.fleet.single_drone.model import Aircraft
from showc.fleet.single_drone.rows import System

CRAFT = Aircraft(VEHICLE, LIMITS, "held", 0.3)
START = np.array([0.0, 0.0, 20.0])
INTERVALS = 30


def made(goal):
    """A program for a move in less time than straight flight takes."""
    straight = shared_profile(VEHICLE, LIMITS, 0.3, START[None], goal[None])
    duration = 0.98 * straight.duration
    part = duration / straight.duration
    profile = Profile(duration, straight.phase * part, straight.ramp * part)
    reference = profile.derivatives()[0]
    return Program(CRAFT, START, goal, reference, INTERVALS, NO_WALLS)


def objective(program, position):
    """Value of a solution, from its coefficients."""
    count = INTERVALS + module.DEGREE
    local = np.linalg.solve(program.basis.position, position)
    whole = np.zeros((3, count))
    for k in range(INTERVALS):
        whole[:, k : k + module.LOCAL] = local[k].T
    free = whole.ravel()[program.free]
    gram = np.kron(np.eye(3), program.basis.gram)[np.ix_(program.free, program.free)]
    return 0.5 * free @ gram @ free + program._linear @ free, whole.ravel()


@pytest.mark.parametrize(
    "way", [(25.0, -8.0, 3.0), (3.0, 30.0, 12.0), (0.0, 12.0, -6.0), (40.0, 1.0, 0.0)]
)
def test_what_is_found_solves_the_program_with_all_rows(way, monkeypatch):
    program = made(START + np.array(way))
    found = program.solve(Aim())
    monkeypatch.setattr(module, "_NEAR", -np.inf)
    whole = program.solve(Aim())
    assert found is not None and whole is not None
    (value, coefficients), (least, _) = (
        objective(program, position) for position in (found, whole)
    )
    rows, hard = program._rows(Aim())
    system = System.of(rows, program.free, program.given, hard, WALL_DEGREE + 1)
    assert not system.passed(coefficients).any()
    # Some of the limits hold it back.
    bound = system.bounds > 0.0
    assert (system.reached(coefficients) > 0.999 * system.bounds)[bound].any()
    assert value == pytest.approx(least, abs=1e-5 * abs(least))
