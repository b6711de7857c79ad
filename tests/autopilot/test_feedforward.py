"""What setpoints are shifted by, flown by the loops of an autopilot."""

import numpy as np
import pytest

from showc.autopilot.feedforward import AHEAD, Feedforward
from showc.autopilot.parameters import GAINS, Gains
from showc.vehicle import STANDARD_GRAVITY
from showc.vehicle.presets import ARDUCOPTER

STEP = 0.01
PERIOD = 0.05
MEASURED = Gains.of(GAINS | dict(ARDUCOPTER.parameters))


def dive(rise):
    """Flight of 40 m sideways and ``rise`` up or down, as far as limits of 7.1 and 5
    m/s, 4.2 and 3 m/s² go: position, velocity, acceleration at a time."""

    def one(time, way, speed, push):
        speed = min(speed, np.sqrt(way * push))
        ramp, rest = speed / push, way / speed
        gain = np.clip(time, 0.0, ramp), np.clip(time - rest, 0.0, ramp)
        cruise = np.clip(time - ramp, 0.0, rest - ramp)
        return np.array(
            [
                push * gain[0] ** 2 / 2.0
                + speed * (cruise + gain[1])
                - push * gain[1] ** 2 / 2.0,
                push * (gain[0] - gain[1]),
                push * ((0.0 < time < ramp) - float(rest < time < rest + ramp)),
            ]
        )

    direction = np.array([0.6, 0.8, np.sign(rise)])

    def at(time):
        level = one(time - 1.0, 40.0, 7.1, 4.2)
        upright = one(time - 1.5, abs(rise), 4.5, 3.0)
        ways = np.stack([level, level, upright], axis=-1) * direction
        return tuple(value[None] for value in ways)

    return at


def flown(at, gains, *, shifted, until=12.0):
    """Greatest distance to the trajectory, level and upright [m]: the loops that the
    autopilot's module on controllers writes down, in steps of 10 ms."""
    shift = Feedforward(gains, 1)
    place, speed, _ = at(0.0)
    missed, total, change = np.zeros((1, 3)), np.zeros((1, 2)), np.zeros((1, 2))
    asked, lean, lift, lifted = np.zeros((1, 2)), np.zeros((1, 2)), 0.0, 0.0
    hold = np.array([gains.place, gains.place, gains.height])
    worst = np.zeros(2)
    for step in range(int(until / STEP)):
        time = STEP * step
        if step % round(PERIOD / STEP) == 0:
            goal = at(time)
            if shifted:
                shift.advance(PERIOD, goal[1:], at(time + AHEAD)[1:])
                beyond = shift.place, shift.speed, shift.push
                goal = tuple(a + b for a, b in zip(goal, beyond, strict=True))
        wanted = goal[1] + hold * (goal[0] - place)
        before = missed
        missed = missed + (wanted - speed - missed) * STEP / (STEP + 1 / (10 * np.pi))
        rate = (missed - before)[:, :2] / STEP
        change = change + (rate - change) * STEP / (STEP + 1 / (10 * np.pi))
        total = total + STEP * missed[:, :2]
        level = goal[2][:, :2] + gains.speed * missed[:, :2] + gains.total * total
        level = level + gains.change * change + gains.forward * wanted[:, :2]
        fast = np.hypot(*speed[0, :2])
        brake = 0.25 + 0.027 * np.array([fast, fast, abs(speed[0, 2])])
        push = (
            np.append(lean[0] * (1.0 + lift / STANDARD_GRAVITY), lift)
            - brake * speed[0]
        )
        lacking = goal[2][0, 2] + gains.climb * missed[0, 2] - push[2]
        lifted += STEP * 2.515 * lacking
        lift += STEP * (1.257 * lacking + lifted - lift) / 0.075
        lean = lean + STEP * (asked - lean) / 0.03
        asked = asked + STEP * (level - asked) / 0.1
        place = place + STEP * speed + STEP**2 * push / 2.0
        speed = speed + STEP * push
        # The autopilot carries its setpoint on until the next one.
        goal = goal[0] + STEP * goal[1], goal[1] + STEP * goal[2], goal[2]
        off = place - at(time + STEP)[0]
        worst = np.maximum(worst, [np.hypot(*off[0, :2]), abs(off[0, 2])])
    return worst


@pytest.mark.parametrize("rise", [-25.0, 25.0, 1e-3])
def test_shifted_setpoints_bring_a_vehicle_onto_its_trajectory(rise):
    plain = flown(dive(rise), MEASURED, shifted=False)
    level, upright = flown(dive(rise), MEASURED, shifted=True)
    assert level < 0.12
    assert upright < 0.12
    assert plain[0] > 2.0 * level


def test_gains_are_made_up_for_whatever_they_are():
    soft = Gains.of(GAINS | {"ANGLE_MAX": 4500.0})
    assert flown(dive(-25.0), soft, shifted=False)[0] > 1.0
    assert flown(dive(-25.0), soft, shifted=True)[0] < 0.25


def test_vehicles_at_rest_are_sent_where_they_are_to_be():
    shift = Feedforward(MEASURED, 2)
    still = np.zeros((2, 3)), np.zeros((2, 3))
    moving = np.full((2, 3), 3.0), np.zeros((2, 3))
    for _ in range(20):
        shift.advance(PERIOD, moving, moving)
    assert np.linalg.norm(shift.place, axis=1).min() > 0.02
    for _ in range(400):
        shift.advance(PERIOD, still, still)
    np.testing.assert_allclose(shift.place, 0.0, atol=0.01)
    np.testing.assert_allclose(shift.speed, 0.0, atol=0.01)


@pytest.mark.parametrize("gap", [0.5, 30.0])
def test_a_gap_between_setpoints_lets_no_shift_run_away(gap):
    shift = Feedforward(MEASURED, 1)
    diving = np.array([[5.0, 5.0, -5.0]]), np.array([[4.2, 0.0, -3.8]])
    for _ in range(50):
        shift.advance(gap, diving, diving)
        assert np.abs(shift.place).max() < 1.5
