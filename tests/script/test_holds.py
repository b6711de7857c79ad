"""Motions that check refuses are those that cannot be flown."""

import pytest

from showc.fleet.motion import fly_motion
from showc.fleet.single_drone.model import Aircraft
from showc.plan import build_itinerary
from showc.script import read_show

SCRIPT = """showc: 1
drones: 20
{music}formations:
  ring: {{type: circle, radius: 10, centre: [0, 0, 20]}}
  flat: {{type: grid, rows: 4, columns: 5, step: 2.5, centre: [0, 0, 20]}}
transitions:
  - {{to: {to}, {times}motion: [{motion}]}}
{more}"""


def read(to, motion, times="hold: 20, ", more="", music=""):
    text = SCRIPT.format(to=to, motion=motion, times=times, more=more, music=music)
    return read_show(text.encode())


def refused(result):
    return [item.message for item in result.errors if item.code == "SHW217"]


@pytest.mark.parametrize(
    ("to", "motion", "said"),
    [
        ("ring", "{wave: {amplitude: 5, period: 4}}", "of upward acceleration"),
        ("ring", "{rotate: 1440}", "of level acceleration"),
        ("ring", "{travel: [[0, 0, 60], [0, 0, 0]]}", "of speed along z"),
        ("ring", "{breathe: {scale: 0.2, period: 30}}", "come within"),
        ("flat", "{travel: [[0, 0, -21]]}", "leaves the flight volume"),
        ("flat", "{orbit: {radius: 2, period: 9, wavelength: 9}}", "come within"),
        ("flat", "{wave: 1}, {wave: {amplitude: 4, period: 5}}", "acceleration"),
    ],
)
def test_what_cannot_be_flown_is_refused_with_what_would_do(to, motion, said):
    (message,) = refused(read(to, motion))
    assert said in message


AREA = "[[-15, -15], [15, -15], [15, 15], [-15, 15]]"
NOTCHED = "[[-15, -15], [15, -15], [15, -9], [6, 0], [15, 9], [15, 15], [-15, 15]]"


@pytest.mark.parametrize(
    ("site", "motion", "said"),
    [
        (f"fence: {AREA}", "{travel: [[11, 0, 0], [0, 0, 0]]}", "leaves the fence"),
        (f"fence: {AREA}, fence_margin: 3", "{travel: [[8, 0, 0]]}", "within 2 m"),
        # The places that are furthest out pass this corner on both sides.
        (f"fence: {NOTCHED}", "{travel: [[4, 0, 0], [0, 0, 0]]}", "leaves the fence"),
        (f"fence: {AREA}, fence_margin: 3", "{travel: [[1.9, 0, 0], [0, 0, 0]]}", ""),
        (f"fence: {AREA}", "{rotate: 90}", ""),
    ],
)
def test_motions_that_lead_over_the_fence_are_refused(site, motion, said):
    top = f"mission: {{wanted: false}}\nsite: {{{site}}}\n"
    found = refused(read("flat", motion, "hold: 40, ", music=top))
    assert len(found) == bool(said) and all(said in one for one in found)
    if said:
        assert " s into its motion" in found[0]


@pytest.mark.parametrize(
    ("east", "motion", "code"),
    [(6, "{travel: [[2, 0, 0], [0, 0, 0]]}", "SHW217"), (8, "{rotate: 9}", "SHW203")],
)
@pytest.mark.parametrize("margin", [0, 3])
def test_without_a_fence_the_margin_is_kept_from_the_walls(east, motion, code, margin):
    walls = "volume: {min: [-15, -15, 0], max: [15, 15, 40]}"
    text = f"""showc: 1
drones: 4
mission: {{wanted: false}}
site: {{{walls}, fence_margin: {margin}}}
formations: {{ring: {{type: circle, radius: 5, centre: [{east}, 0, 20]}}}}
transitions: [{{to: ring, hold: 40, motion: [{motion}]}}]
"""
    errors = read_show(text.encode()).errors
    assert [one.code for one in errors] == [code] * bool(margin)
    assert all("3 m from the walls" in one.notes[-1] for one in errors)


@pytest.mark.parametrize(
    ("site", "motion", "said"),
    [
        ("ceiling: 25", "{travel: [[0, 0, 15], [0, 0, 0]]}", "above the ceiling of 25"),
        ("ceiling: 40", "{travel: [[0, 0, 15], [0, 0, 0]]}", ""),
        (
            "buildings: [{name: tower, height: 60, area: [[20, -5], [30, 0], [9, 9]]}]",
            "{travel: [[25, 0, 0], [0, 0, 0]]}",
            "gets into `tower`",
        ),
        (
            "buildings: [{name: shed, height: 6, area: [[20, -5], [30, -5], [30, 5]]}]",
            "{travel: [[25, 0, 0], [0, 0, 0]]}",
            "",
        ),
        (
            "audience: [{name: stands, area: [[-5, 30], [5, 30], [5, 40], [-5, 40]]}]",
            "{travel: [[0, 35, 0], [0, 0, 0]]}",
            "gets over `stands`",
        ),
    ],
)
def test_motions_keep_below_the_ceiling_and_off_what_is_around(site, motion, said):
    text = f"""showc: 1
drones: 6
mission: {{wanted: false}}
site: {{{site}}}
formations: {{ring: {{type: circle, radius: 5, centre: [0, 0, 20]}}}}
transitions: [{{to: ring, hold: 60, motion: [{motion}]}}]
"""
    errors = read_show(text.encode()).errors
    assert [one.code for one in errors] == ["SHW217"] * bool(said)
    assert all(
        said in one.message and "into its motion" in one.message for one in errors
    )


def trouble(show):
    leg = next(leg for leg in build_itinerary(show).legs if leg.kind == "motion")
    aircraft = Aircraft(show.vehicle, leg.limits, show.yaw, show.heading)
    return fly_motion(leg, aircraft, leg.duration).trouble(leg.drones)


@pytest.mark.parametrize("motion", ["{wave: 5}", "{rotate: 1440}", "{breathe: 4}"])
def test_what_is_refused_for_a_limit_could_not_be_flown(motion):
    result = read("ring", motion)
    assert refused(result)
    assert "times the greatest" in trouble(result.draft)


def test_that_missions_cannot_carry_a_motion_is_said_where_they_are_wanted():
    def warned(top):
        found = read("ring", "{rotate: 90}", music=top).diagnostics
        return [one.message for one in found if one.code == "SHW308"]

    assert warned("") == ["missions cannot carry the motion of `ring`"]
    assert warned("mission: {wanted: false}\n") == []


def test_jerk_is_a_limit_of_motions_too():
    def asked(limit):
        top = f"limits: {{jerk: {limit}}}\n"
        return read("flat", "{wave: {amplitude: 0.5, period: 3}}", music=top)

    assert not refused(asked(10))
    assert trouble(asked(10).show) == ""
    (message,) = refused(asked(8))
    assert "m/s³ of jerk; the limit is 8 m/s³" in message
    assert "acceleration, jerk or level speed" in trouble(asked(8).draft)


@pytest.mark.parametrize(
    ("to", "motion"),
    [
        ("ring", "{rotate: 90}"),
        ("ring", "{breathe: 1.3}"),
        ("flat", "{wave: {amplitude: 2, period: 6, wavelength: 20}}"),
        ("flat", "{orbit: {radius: 1.5, period: 8}}"),
        ("ring", "{travel: [[10, 0, 0], [0, 0, 0]]}"),
    ],
)
def test_examples_of_the_documents_can_be_flown(to, motion):
    result = read(to, motion)
    assert not result.errors
    assert trouble(result.show) == ""


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_the_size_that_a_message_names_divides_what_flies_from_what_does_not(share):
    message = refused(read("flat", "{wave: {amplitude: 6, period: 6, ramp: 6}}"))[0]
    asked, limit = _pair(message)
    amplitude = share * 6.0 * limit / asked
    found = refused(
        read("flat", f"{{wave: {{amplitude: {amplitude}, period: 6, ramp: 6}}}}")
    )
    assert bool(found) == (share > 1.0)


def _pair(message):
    words = message.replace(",", "").split()
    asked, limit = (index for index, word in enumerate(words) if word == "m/s²")
    return float(words[asked - 1]), float(words[limit - 1])


def test_a_hold_that_music_ends_is_judged_by_its_longest_time():
    def found(at):
        more = f"  - {{to: ring, at: {at}}}\n"
        return refused(read("flat", "{rotate: 720}", "at: 20, ", more, "music: {}\n"))

    assert found(40.0)
    assert not found(200.0)


def test_a_motion_left_at_rest_and_out_of_balance_is_refused_where_jerk_is_limited():
    wave, jerk = "{wave: {amplitude: 1, period: 8}}", "limits: {jerk: 20}\n"
    (message,) = refused(read("ring", wave, "hold: 18, leave: moving, ", jerk))
    assert "from rest where its motion is left" in message
    result = read("ring", wave, "hold: 18, leave: moving, ", jerk)
    assert "would jump where the motion is joined or left" in trouble(result.draft)
    assert not refused(read("ring", wave, "hold: 17.5, leave: moving, ", jerk))
    assert not refused(read("ring", wave, "hold: 18, leave: moving, "))


@pytest.mark.parametrize(
    ("formation", "code"),
    [
        ("{type: circle, radius: 2, centre: [0, 0, 20]}", "SHW201"),
        ("{type: circle, radius: 20, centre: [0, 90, 20]}", "SHW203"),
    ],
)
def test_a_picture_that_is_wrong_at_rest_is_no_fault_of_its_motion(formation, code):
    text = f"""showc: 1
drones: 20
formations: {{ring: {formation}}}
transitions: [{{to: ring, hold: 20, motion: [{{wave: {{amplitude: 0.2}}}}]}}]
"""
    assert [one.code for one in read_show(text.encode()).errors] == [code]


def test_lengths_in_beats_are_whole_milliseconds():
    times, music = "duration: 13 beats, hold: 19 beats, ", "music: {bpm: 140}\n"
    (one,) = read("ring", "{wave: 0.2}", times, music=music).draft.transitions
    assert (one.duration, one.hold) == (5.571, 8.143)


def test_places_that_pass_each_other_quickly_are_found():
    result = read_show(
        b"showc: 1\ndrones: 2\nformations:\n"
        b"  a: {type: points, points: [[-12, 0, 20], [0, 0.2, 20]]}\n"
        b"  b: {type: points, points: [[12, 0, 20], [0, 0.2, 20]]}\n"
        b"transitions: [{to: a, hold: 20, motion: [{morph: [b]}]}]\n"
    )
    (message,) = refused(result)
    assert message.startswith("places 1 and 2 of `a` come within")
