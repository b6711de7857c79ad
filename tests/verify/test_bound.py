"""The lower bound: support functions against points, integrals against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from showc.fleet.lower_bound.bound import lower_bound
from showc.fleet.lower_bound.relaxation import Relaxation
from showc.fleet.single_drone.model import Aircraft
from showc.fleet.single_drone.shortest import minimum_time
from showc.log import showc_pb2 as pb
from showc.vehicle import Limits, Quadrotor
from showc.vehicle.flatness import state_in_motion
from showc.verify.kernel.certificates import Relaxed, refuted

HOVERS = np.zeros((2, 12))
VEHICLE = Quadrotor(
    name="seed",
    mass=0.625,
    arm_length=0.1275,
    thrust_coefficient=2.103e-6,
    torque_coefficient=2.091e-8,
    inertia=(2.3e-3, 2.4e-3, 2.6e-3),
    rotor_speed_max=1581.0,
)
LIMITS = Limits(
    velocity_min=(-5.0, -4.0, -2.0),
    velocity_max=(5.0, 4.0, 3.0),
    tilt=np.radians(20.0),
    body_rate=(1.7, 1.5, 1.2),
    thrust_min=1.0,
    thrust_max=12.0,
    torque_max=(0.67, 0.5, 0.105),
    position_min=(-500.0, -500.0, -1.0),
    position_max=(500.0, 500.0, 200.0),
)


def vector(values):
    x, y, z = (float(value) for value in values)
    return pb.Vector3(x=x, y=y, z=z)


def rules(*, held=True, heading=0.3):
    return pb.Rules(
        yaw_held=held,
        heading=heading,
        vehicle=pb.Vehicle(
            mass=VEHICLE.mass,
            arm_length=VEHICLE.arm_length,
            thrust_coefficient=VEHICLE.thrust_coefficient,
            torque_coefficient=VEHICLE.torque_coefficient,
            inertia=vector(VEHICLE.inertia),
            rotor_speed_max=VEHICLE.rotor_speed_max,
            gravity=VEHICLE.gravity,
            torque_factor=1.0,
        ),
        limits=[
            pb.Limits(
                velocity_min=vector(LIMITS.velocity_min),
                velocity_max=vector(LIMITS.velocity_max),
                tilt=LIMITS.tilt,
                body_rate=vector(LIMITS.body_rate),
                thrust_min=LIMITS.thrust_min,
                thrust_max=LIMITS.thrust_max,
                torque_max=vector(LIMITS.torque_max),
            )
        ],
    )


def claim(witness):
    message = pb.Segment(name="leg")
    message.certificate.dual_bound = witness.time
    message.certificate.witness.CopyFrom(
        pb.Witness(
            drone=0,
            time=witness.time,
            beta=vector(witness.beta),
            knots=witness.knots,
            multipliers=[x for knot in witness.multipliers for x in knot],
        )
    )
    return message


@settings(deadline=None, max_examples=60, derandomize=True)
@given(
    st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    st.floats(0.0, 1.2),
    st.floats(0.0, 1.2),
    st.booleans(),
    st.integers(0, 1000),
)
def test_no_thrust_goes_beyond_the_support_function(direction, roll, pitch, held, seed):
    relaxed = Relaxed(rules(held=held), rules().limits[0])
    rng = np.random.default_rng(seed)
    phi = rng.uniform(-roll, roll, 4000)
    theta = rng.uniform(-pitch, pitch, 4000)
    phi[:2], theta[:2] = [roll, -roll], [pitch, pitch]
    psi = 0.3 if held else rng.uniform(-np.pi, np.pi, 4000)
    push = rng.uniform(relaxed.least, relaxed.most, 4000)
    push[:1000], push[1000:2000] = relaxed.most, relaxed.least
    c, s = np.cos, np.sin
    thrust = push * np.array(
        [
            c(phi) * s(theta) * c(psi) + s(phi) * s(psi),
            c(phi) * s(theta) * s(psi) - s(phi) * c(psi),
            c(phi) * c(theta),
        ]
    )
    (support,) = relaxed.thrust_supports(
        np.array(direction), np.array([-roll, roll]), np.array([-pitch, pitch])
    )
    reached = np.array(direction) @ thrust
    assert reached.max() <= support + 1e-9
    # And it is no loose superset: of random points something comes near.
    size = relaxed.most * np.linalg.norm(direction)
    assert reached.max() >= support - 0.2 * size - 1e-9


@settings(deadline=None, max_examples=30, derandomize=True)
@given(st.floats(0.0, 3.0), st.integers(0, 1000))
def test_no_turn_from_rest_goes_beyond_the_caps(duration, seed):
    """Fly random torques within limits: roll stays below the cap."""
    relaxed = Relaxed(rules(), rules().limits[0])
    rng = np.random.default_rng(seed)
    steps = 2000
    push = rng.choice([-1.0, 1.0, 1.0], steps) * relaxed.acceleration[0]
    rate = np.clip(
        np.cumsum(push) * duration / steps, -relaxed.rate[0], relaxed.rate[0]
    )
    roll = np.abs(np.cumsum(rate) * duration / steps)
    time = (np.arange(steps) + 1) * duration / steps
    (floor, cap), _ = relaxed.caps(time, np.full_like(time, 9.0), HOVERS)
    assert np.array_equal(floor, -cap)
    slack = 2 * relaxed.rate[0] * duration / steps
    assert np.all(np.minimum(roll, relaxed.tilt) <= cap + slack)


@pytest.mark.parametrize("jerk", [0.0, 12.0])
@pytest.mark.parametrize("held", [True, False])
@pytest.mark.parametrize(
    "way", [(30.0, 20.0, 10.0), (0.0, -12.0, 0.5), (0.0, 0.0, -9.0)]
)
def test_proves_what_the_planner_claims(way, held, jerk):
    """Two codes, one theorem: a claim of the planner's holds here to a microsecond."""
    limits, known = replace(LIMITS, jerk=jerk), rules(held=held)
    known.limits[0].jerk = jerk
    relaxation = Relaxation(VEHICLE, limits, "held" if held else "free", 0.3)
    witness = lower_bound(relaxation, 0, np.array(way), 5.0)
    assert witness.time > 1.0
    assert refuted(claim(witness), known, np.array(way), HOVERS)


def test_a_bound_by_jerk_needs_its_multipliers_and_its_limit():
    limits, known, way = replace(LIMITS, jerk=6.0), rules(), np.array([9.0, 4.0, 3.0])
    known.limits[0].jerk = 6.0
    witness = lower_bound(Relaxation(VEHICLE, limits, "held", 0.3), 0, way, 5.0)
    plain = lower_bound(Relaxation(VEHICLE, LIMITS, "held", 0.3), 0, way, 5.0)
    assert witness.time > 1.03 * plain.time
    assert refuted(claim(witness), known, way, HOVERS)
    halved = claim(witness)
    rows = np.array(witness.multipliers) * [1.0, 1.0, 1.0, 0.5, 0.5, 0.5]
    halved.certificate.witness.multipliers[:] = rows.ravel().tolist()
    assert not refuted(halved, known, way, HOVERS)
    # What may change its thrust faster is bound by less; what may always, by lambda.
    known.limits[0].jerk = 7.0
    assert not refuted(claim(witness), known, way, HOVERS)
    known.limits[0].jerk = 0.0
    assert not refuted(claim(witness), known, way, HOVERS)
    assert refuted(claim(plain), known, way, HOVERS)


def turning(rng):
    """State and thrust of a drone on a circle within the limits."""
    radius, rate, phase = (
        rng.uniform(2.0, 9.0),
        rng.uniform(-0.4, 0.4),
        rng.uniform(0, 6),
    )
    out = np.array([np.cos(phase), np.sin(phase), 0.0])
    along = np.array([-out[1], out[0], 0.0])
    place = radius * out + [0.0, 0.0, rng.uniform(10.0, 20.0)]
    steps = rate * along, -(rate**2) * out, -(rate**3) * along
    derivatives = np.stack([place, *(radius * step for step in steps)])[:, None]
    return state_in_motion(VEHICLE, derivatives, 0.3)[0]


@settings(deadline=None, max_examples=6)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["arrive", "leave", "between"]))
def test_a_bound_in_motion_is_proved_and_near_a_flight_that_exists(seed, joint):
    rng = np.random.default_rng(seed)
    aircraft = Aircraft(VEHICLE, LIMITS, "held", 0.3)
    still = aircraft.end(rng.uniform([-30, -30, 5], [30, 30, 30]))
    moving, other = turning(rng), turning(rng)
    other[:3] += still[:3]
    start = still if joint == "arrive" else other
    goal = still if joint == "leave" else moving
    flown = minimum_time(aircraft, start, goal)
    assert flown.solved, flown.message
    ends = np.stack([start, goal])
    state = flown.trajectory.state.coefficients
    assert np.array_equal([state[0, 0], state[-1, -1]], ends[:, :12])
    for thrust, end in zip(
        flown.trajectory.control.coefficients[[0, -1], [0, -1], 0], ends, strict=True
    ):
        # As at a hover, any thrust will do where nothing moves.
        assert not end[-1] or abs(thrust - end[-1]) < 1e-3 * VEHICLE.hover_thrust
    way = (goal - start)[:3]
    witness = lower_bound(
        Relaxation(VEHICLE, LIMITS, "held", 0.3), 0, way, flown.duration, ends=ends
    )
    assert 0.9 * flown.duration < witness.time <= flown.duration
    assert refuted(claim(witness), rules(), way, ends[:, :12])


def test_a_claim_beyond_the_proof_falls_short():
    way = np.array([30.0, 20.0, 10.0])
    relaxation = Relaxation(VEHICLE, LIMITS, "held", 0.3)
    witness = lower_bound(relaxation, 0, way, 5.0)
    message = claim(witness)
    message.certificate.witness.time *= 1.02
    assert not refuted(message, rules(), way, HOVERS)
    # A shorter way takes less: the same numbers prove less.
    assert not refuted(claim(witness), rules(), 0.97 * way, HOVERS)
    # A drone with stronger motors and less weight is bound by less.
    lighter = rules()
    lighter.vehicle.mass *= 0.5
    lighter.limits[0].tilt *= 2.0
    assert not refuted(claim(witness), lighter, way, HOVERS)


def test_straight_up_the_bound_is_the_time_of_full_thrust():
    """Bang-bang climb in closed form: the bound meets the minimum time."""
    limits = rules()
    limits.limits[0].velocity_max.z = 100.0
    limits.limits[0].velocity_min.z = -100.0
    # A tilted drone falls faster; straight up is the best only if it cannot tilt.
    limits.limits[0].tilt = 1e-9
    up = LIMITS.thrust_max / VEHICLE.mass - VEHICLE.gravity
    down = VEHICLE.gravity - LIMITS.thrust_min / VEHICLE.mass
    way = 8.0
    least = np.sqrt(2.0 * way * (up + down) / (up * down))
    switch = down / (up + down)
    witness = pb.Witness(drone=0, beta=vector((0, 0, 1)), knots=[0.0, switch, 1.0])

    def proved(time):
        # lambda falls with slope -1 (so that beta + lambda' is 0), zero at the switch.
        witness.time = time
        values = [(switch - knot) * time for knot in witness.knots]
        del witness.multipliers[:]
        witness.multipliers.extend([x for value in values for x in (0.0, 0.0, value)])
        message = pb.Segment(name="up")
        message.certificate.witness.CopyFrom(witness)
        return refuted(message, limits, np.array([0.0, 0.0, way]), HOVERS)

    assert proved(least * (1.0 - 1e-6))
    assert not proved(least * (1.0 + 1e-6))


@pytest.mark.parametrize(
    "spoil",
    [
        lambda w: w.ClearField("knots"),
        lambda w: w.multipliers.append(0.0),
        lambda w: setattr(w, "time", float("nan")),
        lambda w: w.multipliers.__setitem__(0, float("inf")),
        lambda w: w.knots.__setitem__(1, -0.5),
    ],
)
def test_a_malformed_witness_proves_nothing(spoil):
    way = np.array([5.0, 0.0, 0.0])
    message = claim(lower_bound(Relaxation(VEHICLE, LIMITS), 0, way, 2.0))
    spoil(message.certificate.witness)
    assert not refuted(message, rules(heading=0.0), way, HOVERS)
