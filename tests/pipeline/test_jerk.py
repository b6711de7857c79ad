"""A show whose jerk is limited, from the script to the proof of its log."""

import json

import numpy as np
import pytest

from showc.log.reader import read_log
from showc.vehicle.motion import thrust_direction

LIMIT = 12.0
SCRIPT = f"""\
showc: 1
drones: 2
separation: 1
limits: {{jerk: {LIMIT}}}
pads: {{type: points, points: [[-4, 0, 0], [4, 0, 0]]}}
formations:
  swapped: {{type: points, points: [[4, 0, 12], [-4, 0, 12]]}}
  wide: {{type: points, points: [[6, 3, 14], [-6, -3, 14]]}}
transitions:
  - {{to: swapped, assignment: fixed, hold: 1}}
  - to: wide
    assignment: fixed
    hold: 20
    motion: [{{rotate: {{angle: 360 deg}}}}]
    arrive: moving
    leave: moving
mission: {{wanted: false}}
"""


@pytest.mark.slow
def test_a_swap_and_a_motion_on_the_fly_keep_jerk_and_are_proved(run_showc, tmp_path):
    (tmp_path / "jerk.yaml").write_text(SCRIPT)
    run = run_showc("compile", "jerk.yaml", "-o", "jerk.mcap", cwd=tmp_path)
    assert run.code == 0, run.err
    proof = run_showc("verify", "jerk.mcap", "--json", cwd=tmp_path)
    assert proof.code == 0
    checks = {one["code"]: one for one in json.loads(proof.out)["checks"]}
    assert checks["VRF320"]["verdict"] == checks["VRF334"]["verdict"] == "pass"
    logged = read_log(tmp_path / "jerk.mcap")
    # What thrust and attitude give over the whole show, differentiated by samples.
    vehicle, times = logged.rules.vehicle, np.arange(0.0, logged.duration, 1e-3)
    for drone in range(2):
        flight = logged.trajectory(drone)
        state, control = flight.state(times), flight.control(times)
        direction = np.stack(thrust_direction(*state[:, 6:9].T), axis=-1)
        change = np.diff(control[:, :1] / vehicle.mass * direction, axis=0)
        jerk = np.linalg.norm(change, axis=1) / 1e-3
        assert 0.9 * LIMIT < jerk.max() <= LIMIT * (1.0 + 1e-6)
