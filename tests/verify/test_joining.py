"""Arrival into and departure from formations that move: states, bounds, and lies."""

from dataclasses import replace

import numpy as np
import pytest
from findings import failed
from verified import loaded, strays

from showc.pipeline.compile import CompileOptions, compile_script
from showc.script import load_show, read_show
from showc.verify import verify_log
from showc.verify.kernel.certificates import certified, excess
from showc.verify.kernel.choreography import joined_up
from showc.verify.specification.demands import hold_against

SCRIPT = """\
showc: 1
name: Joining
drones: 4
separation: 2
launch: {altitude: 8, hold: 1}
formations:
  ring: {type: circle, radius: 6, start: 200 deg, centre: [0, 0, 18]}
  row: {type: line, length: 15, centre: [0, -14, 12]}
transitions:
  - to: ring
    assignment: fixed
    hold: 6
    motion: [{rotate: {angle: 100 deg, ramp: 2}}]
    arrive: moving
    leave: moving
  - to: row
    hold: 6.3
    motion: [{wave: {amplitude: 1, period: 5, wavelength: 15}}]
    arrive: moving
    leave: moving
"""
ROTATION, WAVE = 3, 5
MOVES = (2, 4, 6)
"""Into the rotation, from it into the wave, and out of that to the pads."""


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    folder = tmp_path_factory.mktemp("joining")
    script = folder / "joining.yaml"
    script.write_text(SCRIPT)
    compile_script(script, folder / "output.mcap", CompileOptions(missions=False))
    return folder


@pytest.fixture(scope="module")
def logged(compiled):
    return loaded(compiled / "output.mcap")[1]


@pytest.fixture(scope="module")
def show(compiled):
    return load_show(compiled / "joining.yaml").show


def test_arrivals_and_departures_in_motion_are_proved(compiled):
    verification = verify_log(
        compiled / "output.mcap", script=compiled / "joining.yaml"
    )
    assert failed(verification) == set()


def test_moves_between_motions_take_two_percent_more_than_their_bounds_at_most(logged):
    for number in MOVES:
        segment = logged.segments[number]
        certificate = segment.message.certificate
        assert certificate.HasField("witness")
        assert certificate.dual_bound > 0.0
        assert segment.duration <= 1.02 * certificate.dual_bound


def test_a_pair_that_would_meet_on_the_way_is_parted(logged):
    done = logged.segments[MOVES[0]].message.certificate.statistics
    assert done["first_conflicts"] == 1.0
    assert done["repair_rounds"] >= 1.0


def acceleration(show, segment, drone, *, end):
    """What thrust and attitude give at an end of a segment [m/s²]."""
    table = segment.table
    column = int(np.searchsorted(table.drones, drone))
    row = int(table.first[column + 1]) - 1 if end else int(table.first[column])
    state, control = (
        part[row, -1 if end else 0] for part in (table.state, table.control)
    )
    roll, pitch, _ = state[6:9]
    push = control[0] / show.vehicle.mass
    lean = np.cos(roll) * np.sin(pitch), -np.sin(roll), np.cos(roll) * np.cos(pitch)
    return push * np.array(lean) - [0.0, 0.0, show.vehicle.gravity]


def test_position_velocity_attitude_rates_and_acceleration_pass_the_joints(
    show, logged
):
    for number in (2, 3, 4, 5):
        before, after = logged.segments[number : number + 2]
        assert np.abs(before.ends()[1] - after.ends()[0]).max() <= 1e-6
        for drone in range(4):
            jump = acceleration(show, before, drone, end=True) - acceleration(
                show, after, drone, end=False
            )
            # The thrust may miss by 5e-4 of what hovering takes.
            assert np.linalg.norm(jump) <= 5.5e-4 * show.vehicle.gravity


def test_drones_meet_the_rotation_at_its_even_rate(logged):
    rate = np.radians(100.0) / 6.0
    for side in (0, 1):
        state = logged.segments[ROTATION].ends()[side]
        arm = state[:, :3] - [0.0, 0.0, 18.0]
        wanted = rate * np.cross([0.0, 0.0, 1.0], arm)
        assert np.abs(state[:, 3:6] - wanted).max() < 1e-6
        assert np.linalg.norm(wanted, axis=1) == pytest.approx(6.0 * rate)


@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize("side", [0, 1])
def test_a_script_that_asks_for_rest_is_not_flown_by_arriving_in_motion(
    show, logged, number, side
):
    asked = show.transitions[number]
    under_way = (side != 0, side != 1)
    transitions = list(show.transitions)
    transitions[number] = replace(asked, under_way=under_way)
    wrong = hold_against(replace(show, transitions=tuple(transitions)), logged)
    # A wave that begins at rest is met in other places.
    assert strays(wrong) or wrong.legs


def with_state(logged, number, change):
    """Change a copy of the coefficients of the first table of a segment."""
    segments = list(logged.segments)
    table = segments[number].table
    state = table.state.copy()
    change(state, int(table.first[1]) - 1)
    table = replace(table, state=state)
    segments[number] = replace(segments[number], table=table)
    return replace(logged, segments=tuple(segments))


@pytest.mark.parametrize("component", range(12))
def test_a_jump_at_the_joint_is_found(logged, component):
    def jump(state, last):
        state[last, -1, component] += 1e-5

    found = {one.code for one in joined_up(logged) if not one.holds}
    assert found == set()
    spoiled = with_state(logged, MOVES[0], jump)
    assert "VRF337" in {one.code for one in joined_up(spoiled) if not one.holds}


def test_a_motion_that_is_met_in_another_state_is_found(show, logged):
    """By far less than a millimetre: one coefficient is off by a micrometre."""

    def slow_start(state, _):
        state[0, 1, :3] += 1e-6

    assert strays(hold_against(show, logged)) == []
    spoiled = with_state(logged, ROTATION, slow_start)
    (said,) = strays(hold_against(show, spoiled))
    assert "in another state" in said


def test_a_bound_for_hovers_is_none_for_a_drone_that_arrives_in_motion(logged):
    """The witness holds with the states at the ends, and not without them."""

    def bounds(flown):
        beyond = [excess(flown, one) for one in flown.segments]
        found = certified(flown.segments, beyond)
        return next(one.holds for one in found if one.code == "VRF341")

    assert bounds(logged)
    number = MOVES[0]
    witness = logged.segments[number].message.certificate.witness
    table = logged.segments[number].table
    column = int(np.searchsorted(table.drones, witness.drone))
    last = int(table.first[column + 1]) - 1

    def other(axis, more):
        def change(state, _):
            state[last, -1, 3 + axis] += more

        return with_state(logged, number, change)

    # Of an arrival at another velocity the witness says nothing.
    others = [other(axis, more) for axis in range(3) for more in (3.0, -3.0)]
    assert not all(bounds(one) for one in others)


@pytest.mark.parametrize("key", ["arrive", "leave"])
def test_arriving_in_motion_without_a_motion_is_refused(key):
    text = SCRIPT.replace(
        "    motion: [{rotate: {angle: 100 deg, ramp: 2}}]\n"
        "    arrive: moving\n    leave: moving\n",
        f"    {key}: moving\n",
    )
    result = read_show(text.encode(), path="joining.yaml")
    (found,) = result.errors
    assert found.code == "SHW102"
    assert found.message == f"`{key}: moving` needs a motion"


def test_drones_that_come_to_rest_where_they_leave_a_motion_are_proved(tmp_path):
    """Nothing bounds the time of a move of no length: none is claimed.

    One drone only stands by.
    """
    script = tmp_path / "spot.yaml"
    script.write_text(
        """\
showc: 1
drones: 3
mission: {wanted: false}
groups: {a: 1-2}
formations: {it: {type: circle, radius: 6, centre: [0, 0, 14]}}
transitions:
  - {to: it, group: a, at: 16, hold: 6, motion: [{rotate: 180}], leave: moving}
  - {to: it, group: a, at: 36, hold: 1}
landing: {altitude: 10}
"""
    )
    log = tmp_path / "spot.mcap"
    flight = compile_script(script, log, CompileOptions(missions=False)).flight
    report = verify_log(log)
    assert report.proved, report.to_json()
    (spot,) = (one for one in flight.legs if one.leg.name == "it -> it")
    assert spot.certificate.witness is None
    assert spot.certificate.dual_bound == 0.0
