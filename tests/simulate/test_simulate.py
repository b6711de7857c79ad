"""Gusts have Dryden's statistics, the plant the physics, the tubes their confidence."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given as drawn
from hypothesis import settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from showc.log.reader import read_log
from showc.log.schema import WIND_NAME
from showc.progress import Silent
from showc.safety.assessment import safety_case, show_of
from showc.script import load_show
from showc.simulate.campaign import (
    Model,
    campaign,
    course_of,
    fly,
    shares_of_limits,
    tube_radius,
)
from showc.simulate.gusts import SEVERITY, Gusts, Scales
from showc.simulate.plant import AIR_DENSITY, Imperfections, Plant
from showc.simulate.predictive import RESERVE_SPEED, followable
from showc.simulate.results import WANTED, Campaign, Weather
from showc.simulate.tracking import Course, Gains, Tracker, body_rates
from showc.vehicle import PRESETS, Limits
from showc.verify import verify_log
from showc.view import render_safety

VEHICLE = PRESETS["formation-625g"].vehicle
IDEAL = Imperfections(position=0.0, velocity=0.0, attitude=0.0, rate=0.0)


@pytest.fixture(scope="module")
def flown(compiled):
    """One flight of each model in each wind, flown once."""
    logged = read_log(compiled("swap"))
    kept = {}

    def fly(wind, model):
        key = wind, model
        if key not in kept:
            weather = Weather(wind, "none", 1)
            kept[key] = campaign(
                logged, show_of(logged), weather, Silent(), model=model
            )
        return kept[key]

    return fly


def test_scales_are_those_of_the_standard():
    # At 30 m, with the wind of 5 m/s at 20 ft: 0.50 and 0.86 m/s, 152 and 30 m.
    scales = Scales.at(np.array([30.0]), 5.0)
    assert scales.sigma_up[0] == pytest.approx(0.50, abs=0.005)
    assert scales.sigma[0] == pytest.approx(0.86, abs=0.01)
    # Levels are to each other as the standard's 15, 30 and 45 knots.
    assert [SEVERITY[one] for one in ("light", "moderate", "severe")] == [0.5, 1.0, 1.5]
    assert scales.length[0] == pytest.approx(152.0, abs=1.0)
    assert scales.length_up[0] == pytest.approx(30.0)


def test_gusts_have_their_variance_and_fade_with_their_scale():
    scales = Scales.at(np.full(400, 30.0), 10.0)
    step, speed = 0.5, 10.0
    gusts = Gusts(scales, speed, step, [3])
    series = np.array([gusts()[0] for _ in range(400)])
    wanted = [scales.sigma[0], scales.sigma[0], scales.sigma_up[0]]
    assert series.std(axis=(0, 1)) == pytest.approx(wanted, rel=0.08)
    # First order: the correlation falls with exp(-t V / L).
    lag = 10
    along = series[:, :, 0]
    same = np.mean(along[:-lag] * along[lag:]) / np.mean(along**2)
    fade = np.exp(-lag * step * speed / scales.length[0])
    assert same == pytest.approx(fade, abs=0.05)
    # Second order, from its spectrum: (1 - t / (2 T)) exp(-t / T) after t.
    share = lag * step * speed / scales.length[0]
    across = series[:, :, 1]
    same = np.mean(across[:-lag] * across[lag:]) / np.mean(across**2)
    assert same == pytest.approx((1.0 - 0.5 * share) * np.exp(-share), abs=0.05)


def test_a_seed_gives_the_same_gusts_and_another_gives_others():
    scales = Scales.at(np.full(2, 20.0), 4.0)
    one, same, other = Gusts(scales, 5.0, 0.01, [1, 1, 2])()
    assert (one == same).all()
    assert (one != other).all()


def test_a_drone_without_thrust_reaches_its_terminal_speed():
    plant = Plant(VEHICLE, 0.03, 0.03)
    state, control = np.zeros((1, 12)), np.zeros((1, 4))
    for _ in range(4000):
        state, control = plant.after(state, control, control, np.zeros((1, 3)), 0.005)
    speed = np.sqrt(2.0 * VEHICLE.hover_thrust / (AIR_DENSITY * 0.03))
    assert -state[0, 5] == pytest.approx(speed, rel=1e-3)


def test_rotors_follow_with_their_lag():
    plant = Plant(VEHICLE, 0.03, 0.05)
    hover = VEHICLE.hover_control()[None]
    _, control = plant.after(
        np.zeros((1, 12)), 0.0 * hover, hover, np.zeros((1, 3)), 0.05
    )
    assert control[0, 0] / hover[0, 0] == pytest.approx(1.0 - np.exp(-1.0))


def test_rotors_give_no_more_than_they_can():
    plant = Plant(VEHICLE, 0.03, 0.05)
    asked = np.array([[100.0, 0.0, 0.0, 0.0], VEHICLE.hover_control()])
    given, limited = plant.allotted(asked)
    assert given[0, 0] == pytest.approx(VEHICLE.thrust_max)
    assert limited.tolist() == [True, False]
    assert given[1] == pytest.approx(asked[1])


@settings(max_examples=60)
@drawn(st.integers(0, 10_000))
def test_yaw_gives_way_before_thrust_and_thrust_before_roll_and_pitch(seed):
    plant = Plant(VEHICLE, 0.03, 0.05)
    most = np.array([VEHICLE.thrust_max, *VEHICLE.torque_max])
    asked = np.random.default_rng(seed).uniform([0, -1, -1, -1], 1, (40, 4)) * most
    given, limited = plant.allotted(asked)
    fractions = given @ VEHICLE.rotor_fractions().T
    assert (fractions > -1e-9).all() and (fractions < 1.0 + 1e-9).all()
    kept = np.isclose(given, asked, rtol=0.0, atol=1e-6 * most)
    assert (limited == ~kept.all(axis=1)).all()
    # Thrust is lost where it would not fit without any yaw.
    level = asked[:, :3] @ VEHICLE.rotor_fractions()[:, :3].T
    assert (kept[:, 0] | (level < 0.0).any(axis=1) | (level > 1.0).any(axis=1)).all()
    turning = np.ptp(asked[:, 1:3] @ VEHICLE.rotor_fractions()[:, 1:3].T, axis=1)
    assert (kept[:, 1:3].all(axis=1) | (turning > 1.0)).all()


def test_the_plant_flies_as_rotorpy_does():
    # An independent simulator: quaternions, quadratic drag, its own integration.
    multirotor = pytest.importorskip("rotorpy.vehicles.multirotor")
    area, arm = 0.03, VEHICLE.arm_length
    drag = 0.5 * AIR_DENSITY * area
    rng = np.random.default_rng(5)
    # Rotors where our allocation has them: behind, right, ahead, left.
    places = [(-arm, 0.0), (0.0, -arm), (arm, 0.0), (0.0, arm)]
    ix, iy, iz = VEHICLE.inertia
    other = multirotor.Multirotor(
        {
            "mass": VEHICLE.mass, "Ixx": ix, "Iyy": iy, "Izz": iz,
            "Ixy": 0.0, "Ixz": 0.0, "Iyz": 0.0,
            "c_Dx": drag, "c_Dy": drag, "c_Dz": drag,
            "num_rotors": 4, "rotor_directions": np.array([1, -1, 1, -1]),
            "rotor_pos": {k: np.array([*at, 0.0]) for k, at in enumerate(places)},
            "rotor_speed_min": 0.0, "rotor_speed_max": VEHICLE.rotor_speed_max,
            "k_eta": VEHICLE.thrust_coefficient, "k_m": VEHICLE.torque_coefficient,
            "tau_m": 0.03,
        },
        integrator_kwargs={"rtol": 1e-9, "atol": 1e-9},
    )  # fmt: skip
    other.weight = np.array([0.0, 0.0, -VEHICLE.hover_thrust])
    plant = Plant(VEHICLE, area, 0.03)
    wind = np.array([5.0, -4.0, 1.0])
    state = np.zeros((1, 12))
    state[0, 3:12] = rng.uniform(-1.0, 1.0, 9) * [3, 3, 3, 0.5, 0.5, 1.5, 2, 2, 2]
    now = {
        "x": state[0, :3], "v": state[0, 3:6], "w": state[0, 9:12], "wind": wind,
        "q": Rotation.from_euler("ZYX", state[0, 8:5:-1]).as_quat(),
        "rotor_speeds": np.zeros(4),
    }  # fmt: skip
    for _ in range(40):
        # Torques that damp what turns, and some noise: a flight through large angles.
        torque = -0.02 * state[0, 9:12] + rng.normal(0.0, 0.02, 3)
        asked = np.array([[VEHICLE.hover_thrust * rng.uniform(0.8, 1.3), *torque]])
        control, _ = plant.allotted(asked)
        speeds = VEHICLE.rotor_speed_max * np.sqrt(
            np.clip(control[0] @ VEHICLE.rotor_fractions().T, 0.0, 1.0)
        )
        now = other.step(
            now | {"rotor_speeds": speeds}, {"cmd_motor_speeds": speeds}, 0.05
        )
        for _ in range(10):
            state, _ = plant.after(state, control, control, wind[None], 0.005)
    turned = Rotation.from_euler("ZYX", state[0, 8:5:-1])
    assert np.abs(state[0, 6:8]).max() > 0.1
    assert state[0, :3] == pytest.approx(now["x"], abs=1e-4)
    assert state[0, 3:6] == pytest.approx(now["v"], abs=1e-4)
    assert state[0, 9:12] == pytest.approx(now["w"], abs=1e-4)
    assert (turned.inv() * Rotation.from_quat(now["q"])).magnitude() < 1e-4


def test_flights_are_the_same_side_by_side(compiled):
    logged = read_log(compiled("swap"))
    whole = course_of(logged)
    course = Course(
        whole.times[:300],
        whole.state[:300],
        whole.control[:300],
        whole.acceleration[:300],
    )
    weather, show = Weather(8.0, "moderate", 3), show_of(logged)
    together = fly(show, course, weather, [0, 1, 4], Model())
    for run, one in zip([0, 1, 4], together, strict=True):
        alone = fly(show, course, weather, [run], Model())[0]
        for name in ("errors", "closest", "saturated", "used"):
            assert getattr(one, name) == pytest.approx(getattr(alone, name), rel=1e-6)


def test_in_calm_air_drones_fly_near_their_paths(flown):
    found = flown(0.0, Model(imperfections=IDEAL))
    assert found.tubes[-1].greatest < 0.25
    assert found.tubes[-1].rms < 0.06


def test_wind_pushes_and_the_observer_pushes_back(flown):
    calm = flown(0.0, Model(imperfections=IDEAL)).tubes[-1].rms
    blown = flown(8.0, Model(replace(Gains(), observer=0.0))).tubes[-1].rms
    watched = flown(8.0, Model()).tubes[-1].rms
    assert calm < watched < 0.5 * blown
    # Drag over the stiffness of the position loop, where nothing else resists.
    area = 0.5 * sum(PRESETS["formation-625g"].body.drag_area)
    push = 0.5 * AIR_DENSITY * area * 8.0**2 / VEHICLE.mass / Gains().position
    assert blown == pytest.approx(push, rel=0.35)


@pytest.fixture(scope="module")
def lonely(compiled):
    """One drone of a show and its course over the first seconds of a swap."""
    logged = read_log(compiled("swap"))
    # From the hover before it: controllers begin with the first control of the course.
    whole, begin = course_of(logged), logged.segments[2].start - 0.5
    some = (whole.times >= begin) & (whole.times < begin + 6.5)
    course = Course(
        whole.times[some] - begin,
        *(part[some][:, :1] for part in (whole.state, whole.control)),
        whole.acceleration[some][:, :1],
    )
    return show_of(logged), course


def test_looking_ahead_halves_the_error_in_gusts(lonely):
    show, course = lonely
    weather = Weather(8.0, "moderate", 1)
    stray = {}
    for name, model in {
        "flatness": Model(replace(Gains(), observer=0.0)),
        "predictive": Model(predictive=True),
    }.items():
        flown = [fly(show, course, weather, [run], model)[0] for run in range(2)]
        # The wind is there at once; what it adds is learnt within two seconds.
        squares = [np.mean(found.errors[200:] ** 2) for found in flown]
        stray[name] = float(np.sqrt(np.mean(squares)))
        if name == "predictive":
            # No rotor, speed, body rate, thrust, torque or tilt beyond its limit.
            assert not any(found.saturated.any() for found in flown)
            assert max(found.used.max() for found in flown) <= 1.0
        else:
            assert max(found.used.max() for found in flown) > 1.0
    assert stray["predictive"] < 0.5 * stray["flatness"]


def test_shares_of_limits_are_those_of_the_greatest():
    limits = Limits(
        (-4.0, -4.0, -1.0), (4.0, 4.0, 3.0), 0.5, (2.0, 2.0, 1.0), 2.0, 10.0,
        (0.5, 0.5, 0.1), (-9.0,) * 3, (9.0,) * 3,
    )  # fmt: skip
    state, control = np.zeros((2, 12)), np.zeros((2, 4))
    control[:, 0] = 6.0
    # At rest the fastest climb is farther off than the fastest descent.
    assert shares_of_limits(limits, state, control).max() == pytest.approx(0.5)
    for number, value, share in (
        (3, 3.0, 0.75), (5, 3.3, 1.15), (5, -1.0, 1.0), (6, -0.6, 1.2), (11, 0.9, 0.9),
    ):  # fmt: skip
        changed = state.copy()
        changed[1, number] = value
        assert shares_of_limits(limits, changed, control).max() == pytest.approx(share)
    changed = state.copy()
    changed[0, 3:5] = 3.0, 4.0
    round_ = replace(limits, level_speed=4.0)
    assert shares_of_limits(round_, changed, control).max() == pytest.approx(1.25)
    control[0, 3] = 0.2
    assert shares_of_limits(limits, state, control).max() == pytest.approx(2.0)


def hovering(vehicle, first, rest):
    """A course that hovers in ``rest`` (12,), and begins with 50 steps of ``first``."""
    state = np.concatenate([np.tile(first, (50, 1, 1)), np.tile(rest, (400, 1, 1))])
    control = np.tile(vehicle.hover_control(), (len(state), 1, 1))
    times = 0.01 * np.arange(len(state))
    return Course(times, state, control, np.zeros((len(state), 1, 3)))


def test_body_rates_turn_the_attitude_as_wanted():
    rng = np.random.default_rng(7)
    state = np.zeros((50, 12))
    state[:, 6:9] = rng.uniform(-1.0, 1.0, (50, 3)) * [0.8, 0.8, 3.0]
    change = rng.uniform(-2.0, 2.0, (50, 3))
    state[:, 9:12] = body_rates(state[:, 6:9], change)
    step, control = 1e-5, np.zeros((50, 4))
    after, _ = Plant(VEHICLE, 0.03, 0.03).after(state, control, control, 0.0, step)
    assert (after[:, 6:9] - state[:, 6:9]) / step == pytest.approx(change, abs=1e-3)


@pytest.mark.parametrize("observer", [0.0, 3.0])
def test_a_drone_that_leans_far_in_roll_and_pitch_does_not_swing(observer):
    # Beyond 30 degrees the rates of roll, pitch and yaw are no longer the body's.
    rest = np.zeros(12)
    rest[2] = 20.0
    course = hovering(VEHICLE, rest, rest)
    state, control = course.state[0].copy(), course.control[0]
    state[0, 9:12] = 0.5
    tracker = Tracker(VEHICLE, course, 0.01, replace(Gains(), observer=observer))
    plant, waiting = Plant(VEHICLE, 0.03, 0.03), [control, control]
    wind = np.array([[14.0, 14.0, 0.0]])
    for number in range(len(course.times)):
        waiting.append(plant.allotted(tracker.command(state, number))[0])
        command = waiting.pop(0)
        for _ in range(2):
            state, control = plant.after(state, control, command, wind, 0.005)
        tracker.observe(state, control)
    assert np.abs(state[0, 6:8]).min() > 0.5
    assert np.abs(state[0, 8:12]).max() < 0.01


def test_looking_ahead_finds_back_from_where_it_should_not_be(lonely):
    # Two metres aside and without a wind: no overshoot worth the name, no limit broken.
    show, _ = lonely
    # As fast as rotors can: of body rates there is no limit.
    show = replace(show, limits=replace(show.limits, body_rate=(20.0, 20.0, 20.0)))
    aside = np.zeros(12)
    aside[0] = 2.0
    jump = hovering(show.vehicle, aside, np.zeros(12))
    model = Model(Gains(), IDEAL, predictive=True)
    (found,) = fly(show, jump, Weather(0.0, "none", 1), [0], model)
    assert not found.saturated.any()
    # It knows of the jump beforehand and leaves early, by as much as serves both.
    assert found.errors[:, 0].max() < 1.6
    assert found.errors[-50:, 0].max() < 0.02


def test_what_is_followed_keeps_a_reserve_of_speed_and_is_near(lonely):
    limits = replace(
        lonely[0].limits, velocity_min=(-5.0, -3.0, -1.0), velocity_max=(5.0, 4.0, 2.0)
    )
    time = 0.01 * np.arange(1200)
    # Up to each axis's limit and back, at one that is slower, and away and home again.
    speed = np.clip(np.stack([2.0 * time, 0.3 * time, np.sin(time)], axis=1), -0.9, 5.0)
    speed *= np.clip(12.0 - time, 0.0, 1.0)[:, None]
    state = np.zeros((1200, 1, 6))
    state[:, 0, :3], state[:, 0, 3:] = 0.01 * np.cumsum(speed, axis=0), speed
    found = followable(state, limits, 0.01)
    kept = np.diff(found[:, 0, :3], axis=0) / 0.01
    assert (kept <= np.array(limits.velocity_max) - RESERVE_SPEED + 1e-9).all()
    assert (kept >= np.array(limits.velocity_min) + RESERVE_SPEED - 1e-9).all()
    assert (found[:, :, 1] == state[:, :, 1]).all()
    off = found[:, 0, 0] - state[:, 0, 0]
    assert off.min() < -0.5 < 0.5 < off.max()
    assert abs(off.mean()) < 1e-3
    assert off[0] == pytest.approx(0.0, abs=1e-6)


def test_the_command_flies_the_same_again_and_the_log_holds_it(
    compiled, run_showc, flown, tmp_path
):
    log = tmp_path / "swap.mcap"
    log.write_bytes(compiled("swap").read_bytes())
    place = tmp_path / "wind.json"
    run = run_showc(
        "simulate", log, "--wind", "8", "--runs", "1", "--json", "-o", place
    )
    assert run.code == 0, run.err
    found = flown(8.0, Model())
    assert json.loads(run.out) == found.to_json()
    content = json.loads(place.read_text(encoding="utf-8"))
    assert Campaign.from_json(content).to_json() == found.to_json()
    # The report takes it from the log, wherever the file is.
    place.unlink()
    logged = read_log(log)
    assert Campaign.of(logged).to_json() == found.to_json()
    page = render_safety(logged, safety_case(logged))
    assert f"{found.whole.radius:.2f}" in page
    assert f">{100.0 * found.whole.used:.0f}<" in page
    assert "8 m/s" in page
    checked = verify_log(log, missions=False)
    assert checked.proved
    assert "nothing of them is proved" in "".join(checked.check("VRF108").notes)


@pytest.mark.parametrize("content", [b"{}", b"[]", b"3", b'{"legs": []}', b"\xff"])
def test_what_holds_no_flights_is_passed_over(compiled, content):
    logged = replace(read_log(compiled("swap")), added={WIND_NAME: content})
    assert Campaign.of(logged) is None


def test_gusts_without_a_wind_are_refused(compiled, run_showc):
    log = compiled("swap")
    before = log.read_bytes()
    run = run_showc("simulate", log, "--gusts", "light", "--runs", "1")
    assert run.code == 2
    assert "give --wind" in run.err
    assert log.read_bytes() == before


def test_legs_say_how_near_drones_came_and_whether_rotors_could(flown):
    found = flown(8.0, Model())
    legs, whole = found.tubes[:-1], found.whole
    assert min(leg.closest for leg in legs) == pytest.approx(whole.closest)
    assert max(leg.greatest for leg in legs) == pytest.approx(whole.greatest)
    swap = next(leg for leg in legs if leg.name == "The swap")
    assert 0.0 < swap.closest < min(leg.closest for leg in legs if leg is not swap)
    assert 0.0 <= whole.saturated <= max(leg.saturated for leg in legs)


SCRIPT = """
showc: 1
drones: 2
limits: {speed: 4}
mission: {wanted: false}
separation: {distance: 2, tracking: measured}
formations:
  row: {type: line, length: 8, centre: [0, 0, 12]}
  back: {type: points, points: [[4, 0, 12], [-4, 0, 12]]}
transitions:
  - {to: row, assignment: fixed}
  - {to: back, assignment: fixed}
"""


def test_a_measured_tube_is_kept_by_the_paths_and_proved(tmp_path, run_showc):
    tube = {"name": "whole show", "radius": 0.35, "share": WANTED}
    (tmp_path / "wind.json").write_text(json.dumps({"legs": [tube]}), encoding="utf-8")
    script = tmp_path / "pair.yaml"
    script.write_text(SCRIPT, encoding="utf-8")
    log = tmp_path / "pair.mcap"
    run = run_showc("compile", script, "-o", log, "-q", cwd=tmp_path)
    assert run.code == 0, run.err
    found = json.loads(run_showc("verify", log, "--json", "-q").out)
    assert found["verdict"].startswith("PROVED")
    logged = read_log(log)
    assert logged.rules.separation.distance == pytest.approx(2.7)
    assert show_of(logged).tracking == 0.35
    # The paths meet in the middle: they give way by what both may stray.
    gaps = np.linalg.norm(np.diff(logged.positions, axis=1), axis=-1)
    assert 2.7 - 1e-6 <= gaps.min() < 2.9


@pytest.mark.parametrize(
    "content", ["", "[1]", '{"legs": []}', '{"legs": [{"radius": -1, "share": 1}]}']
)
def test_what_holds_no_tube_is_refused(content, tmp_path):
    (tmp_path / "wind.json").write_text(content, encoding="utf-8")
    script = tmp_path / "pair.yaml"
    script.write_text(SCRIPT, encoding="utf-8")
    assert [one.code for one in load_show(script).errors] == ["SHW122"]


def test_a_tube_holds_its_share_with_its_confidence():
    assert tube_radius(np.arange(10.0)) == (9.0, pytest.approx(0.05**0.1))
    assert tube_radius(np.arange(2994.0))[1] < WANTED
    assert tube_radius(np.arange(2995.0)) == (2994.0, WANTED)
    # The second greatest is enough from 4742 on (Wilks 1941).
    assert tube_radius(np.arange(4741.0)) == (4740.0, WANTED)
    assert tube_radius(np.arange(4742.0)) == (4740.0, WANTED)
