"""Derivatives by names are those of the expression as a whole."""

from __future__ import annotations

import casadi
import numpy as np
import pytest

from showc.ocp.transcription.condensed.lifting import Lifting


def test_hessian_and_gradient_through_names_are_those_of_the_whole_expression():
    z = casadi.SX.sym("z", 4)
    lifting = Lifting()
    angles = lifting.named([z[0] + 2.0 * z[1], z[1] * z[2]])
    pulls = lifting.named([casadi.sin(angles[0]) * angles[1], casadi.exp(angles[1])])
    last = lifting.named([pulls[0] ** 2 + z[3] * angles[0]])
    value = last[0] * pulls[1] + z[3] ** 3 + angles[0] * z[2]
    bend, slope = lifting.curvature(value, z)
    written = casadi.Function("written", [z], lifting.restored(bend, slope))
    (whole,) = lifting.restored(value)
    derived = casadi.Function("derived", [z], [*casadi.hessian(whole, z)])
    assert not {str(one) for one in casadi.symvar(whole)} - {f"z_{k}" for k in range(4)}
    for seed in range(5):
        point = np.random.default_rng(seed).normal(size=4)
        for found, wanted in zip(written(point), derived(point), strict=True):
            assert np.array(found) == pytest.approx(np.array(wanted), abs=1e-12)


def test_a_curve_asked_again_at_the_same_fractions_keeps_its_symbols():
    z = casadi.SX.sym("z", 2)
    lifting = Lifting()
    first = lifting.curve("roll", [z[0], z[1]], [0.2, 0.8])
    again = lifting.curve("roll", [z[0], z[1]], [0.2, 0.8])
    other = lifting.curve("roll", [z[0]], [0.5])
    assert [str(one) for one in first] == [str(one) for one in again]
    assert str(other[0]) not in {str(one) for one in first}
