"""From script to show: defaults, units, fleets, groups, limits, what is refused."""

import math
from dataclasses import replace
from datetime import UTC, datetime
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from repository import ROOT, SHOWS

from showc.plan.build import build_itinerary
from showc.script import load_show, read_show
from showc.script.fence import fence_distance, inside_polygon
from showc.script.formations.spacing import (
    close_pairs,
    closest,
    closest_between,
    crowded,
)
from showc.script.language.colours import COLOUR_NAMES, linear_light, parse_colour
from showc.script.rules.least_time import _furthest, least_times
from showc.vehicle import PRESETS, Separation
from showc.vehicle.metric import measure

TEN_LINES = """\
drones: 16
formations:
  ring: {type: circle, radius: 8}
transitions:
  - ring
"""


@pytest.mark.parametrize("path", SHOWS, ids=lambda path: path.stem)
def test_the_shows_are_right(path):
    result = load_show(path)
    assert result.diagnostics == ()
    assert result.show.source.content == path.read_bytes()
    for formation in result.show.formations.values():
        assert not formation.points.flags.writeable
        assert not formation.colours.flags.writeable
        assert formation.points.shape == formation.colours.shape


def test_the_grid_is_the_printed_case():
    show = load_show(ROOT / "shows" / "grid.yaml").show
    assert show.drones == 6
    limits = show.limits
    assert limits.velocity_max == (5.0, 5.0, 5.0)
    assert limits.velocity_min == (-5.0, -5.0, -5.0)
    assert limits.tilt == math.radians(20.0)
    assert limits.body_rate == (1.7, 1.7, 1.7)
    assert (limits.thrust_min, limits.thrust_max) == (0.0, 21.03)
    assert limits.torque_max == (0.67, 0.67, 0.105)
    assert show.separation == Separation(1.0)
    assert show.vehicle.mass == 0.625
    assert show.vehicle.torque_arm == "included"
    above = show.formations["pads"].points + [0, 0, show.launch.altitude]
    (move,) = show.transitions
    assert move.assignment == "fixed"
    shift = show.formations[move.to].points - above
    assert np.array_equal(shift, np.tile([30.0, 20.0, 10.0], (6, 1)))


def test_the_swap_is_antipodal():
    show = load_show(ROOT / "shows" / "swap.yaml").show
    start, goal = (show.formations[name].points for name in ("pads", "swapped"))
    assert np.allclose(start[:, :2], -goal[:, :2])
    assert show.transitions[0].assignment == "fixed"
    assert np.all(goal[:, 2] == show.launch.altitude)


def test_defaults_make_a_show(show):
    made = show(TEN_LINES)
    assert made.name == "show"
    assert made.epoch == datetime(2025, 1, 1, tzinfo=UTC)
    assert made.vehicle == PRESETS["formation-625g"].vehicle
    assert made.separation == Separation(1.5)
    assert made.site.volume_max == (100.0, 100.0, 120.0)
    assert made.limits.position_max == made.site.volume_max
    pads = made.formations["pads"]
    assert made.pads == "pads"
    assert np.all(pads.points[:, 2] == 0.0)
    assert closest(pads.points, 10.0, Separation(1.0)).distance == 2.25
    (move,) = made.transitions
    assert (move.name, move.hold, move.duration) == ("launch -> ring", 5.0, None)
    assert made.formations["ring"].points[:, 2].tolist() == [10.0] * 16
    assert np.all(made.formations["ring"].colours == 1.0)
    assert (made.yaw, made.heading, made.parking) == ("held", 0.0, None)
    assert made.mission.light_servos is None


def test_everything_said_is_taken(show):
    made = show(
        "name: All\nepoch: 2025-06-01T23:30:00+02:00\n"
        "site: {origin: {latitude: 52.5 deg, longitude: -0.1, altitude: 1 km}, "
        "heading: 0.5 turn, volume: {min: [-30, -40, -1], max: [30, 40, 60]}, "
        "fence: [[-20, -20], [20, -20], [0, 30]]}\n"
        "vehicle: {preset: formation-625g, mass: 700 g, torque_arm: multiplied}\n"
        "limits: {speed: [18 km/h, 4, 3], descent: 1.5, tilt: 0.3 rad, "
        "body_rate: [90, 90, 1 rad/s], thrust_min: 1, thrust_max: 15 N, "
        "torque: [0.5, 0.4, 0.1]}\n"
        "separation: {distance: 2 m, shape: ellipsoid, vertical_stretch: 2}\n"
        "yaw: {mode: free, heading: 90}\ndrones: 4\nlog_rate: 50\nseed: 7\n"
        "pads: {type: line, length: 12}\n"
        "launch: {altitude: 12, climb_speed: 1, hold: 4}\n"
        "landing: {altitude: 9, descent_speed: 0.5, hold: 3, assignment: fixed}\n"
        "formations:\n  ring: {type: circle, radius: 4, colour: gold, "
        "effect: {kind: sweep, period: 3, direction: [0, 2, 0], depth: 0.5}}\n"
        "transitions:\n  - {to: ring, hold: 1 min, assignment: fixed, duration: 20, "
        "colour: {each: [red, blue]}, fade: start, effect: pulse, name: Go}\n"
        "mission: {light_servos: [9, 10, 11], light_pwm: [900, 2100], slack: 4, "
        "board: cube}\n"
    )
    assert made.name == "All"
    assert made.epoch == datetime(2025, 6, 1, 21, 30, tzinfo=UTC)
    site = made.site
    assert (site.latitude, site.longitude, site.altitude) == (52.5, -0.1, 1000.0)
    assert site.heading == pytest.approx(180.0)
    assert site.fence.tolist() == [[-20, -20], [20, -20], [0, 30]]
    assert (made.vehicle.name, made.vehicle.mass) == ("custom", 0.7)
    assert made.vehicle.torque_arm == "multiplied"
    limits = made.limits
    assert limits.velocity_max == pytest.approx((5.0, 4.0, 3.0))
    assert limits.velocity_min == pytest.approx((-5.0, -4.0, -1.5))
    assert limits.tilt == 0.3
    assert limits.body_rate == pytest.approx((math.pi / 2, math.pi / 2, 1.0))
    assert (limits.thrust_min, limits.thrust_max) == (1.0, 15.0)
    assert limits.torque_max == (0.5, 0.4, 0.1)
    assert made.separation == Separation(2.0, "ellipsoid", 2.0)
    assert (made.yaw, made.heading) == ("free", math.radians(90))
    assert (made.log_rate, made.seed) == (50.0, 7)
    launch, landing = made.launch, made.landing
    assert (launch.altitude, launch.climb_speed, launch.hold) == (12.0, 1.0, 4.0)
    assert (landing.altitude, landing.descent_speed) == (9.0, 0.5)
    assert (landing.hold, landing.assignment) == (3.0, "fixed")
    (move,) = made.transitions
    assert (move.name, move.hold, move.duration) == ("Go", 60.0, 20.0)
    assert (move.assignment, move.fade, move.effect.kind) == ("fixed", "start", "pulse")
    assert move.colours.tolist() == [[1, 0, 0], [0, 0, 1]] * 2
    ring = made.formations["ring"]
    assert np.allclose(ring.colours, linear_light(np.array([1, 215 / 255, 0])))
    assert ring.effect.direction == (0.0, 1.0, 0.0)
    assert (ring.effect.kind, ring.effect.depth) == ("sweep", 0.5)
    mission = made.mission
    assert (mission.light_servos, mission.light_pwm) == ((9, 10, 11), (900, 2100))
    assert (mission.slack, mission.board) == (4.0, "cube")


def test_groups(show):
    made = show(
        "groups: {left: 1-4, right: [8, 5-7]}\nformations:\n"
        "  west: {type: circle, radius: 5, centre: [-20, 0, 20]}\n"
        "  east: {type: circle, radius: 5, centre: [20, 0, 20]}\n"
        "  all: {type: circle, radius: 12, centre: [0, 0, 40]}\n"
        "transitions:\n  - {to: west, group: left}\n  - {to: east, group: right}\n"
        "  - all\n"
    )
    assert made.drones == 8
    assert made.groups == {"left": (0, 1, 2, 3), "right": (4, 5, 6, 7)}
    assert len(made.formations["west"].points) == 4
    assert len(made.formations["all"].points) == 8
    assert [move.name for move in made.transitions][:2] == [
        "launch -> west", "launch -> east",
    ]  # fmt: skip


def test_parking(show):
    made = show(
        "drones: 10\nparking: {type: line, count: 4, centre: [0, -30, 12]}\n"
        "formations:\n  small: {type: circle, radius: 6, count: 6}\n"
        "  whole: {type: circle, radius: 12}\ntransitions: [small, whole]\n"
    )
    assert made.parking == "parking"
    assert len(made.formations["parking"].points) == 4
    assert len(made.formations["small"].points) == 6


def test_pads_may_be_a_formation(show):
    made = show(
        "drones: 4\npads: ground\nformations:\n  ground: {type: line, length: 9}\n"
        "  ring: {type: circle, radius: 5}\ntransitions: [ring]\n"
    )
    assert made.pads == "ground"
    assert np.all(made.formations["ground"].points[:, 2] == 0.0)


def test_the_same_script_gives_the_same_show(read):
    text = (ROOT / "shows" / "chapters.yaml").read_text(encoding="utf-8")
    body = text.split("showc: 1\n")[1]
    first, second = read(body).show, read(body).show
    for name, formation in first.formations.items():
        again = second.formations[name]
        assert formation.points.tobytes() == again.points.tobytes()
        assert formation.colours.tobytes() == again.colours.tobytes()


@pytest.mark.parametrize(
    ("shape", "stretch", "apart"),
    [
        ("sphere", 1.0, 2.0),
        ("ellipsoid", 2.0, 4.0),
        ("any-axis", 1.0, 2.0),
    ],
)
def test_spacing_is_measured_in_the_separations_shape(read, shape, stretch, apart):
    """Two places above each other must keep the separation of that shape."""
    script = (
        "separation: {distance: 2, shape: %s, vertical_stretch: %g}\nformations:\n"
        "  tower: {type: points, points: [[0, 0, 20], [0, 0, %.3f]]}\n"
        "transitions: [tower]\n"
    )
    near = read(script % (shape, stretch, 20 + apart - 0.01))
    assert [item.code for item in near.errors] == ["SHW201"]
    assert not read(script % (shape, stretch, 20 + apart + 0.01)).errors


def test_all_axes_refuses_neighbours_on_one_level(read):
    result = read(
        "separation: {distance: 1, shape: all-axes}\n"
        "formations: {row: {type: line, count: 2, length: 9}}\ntransitions: [row]\n"
    )
    found = [item for item in result.errors if "`row`" in item.message]
    assert [item.code for item in found] == ["SHW201"]


def scattered(count, seed):
    """Places at random, on a raster, in heaps, or the same one often."""
    chance = np.random.default_rng(seed)
    points = chance.uniform(-3, 3, size=(count, 3)) * chance.integers(0, 2, size=3)
    match seed % 4:
        case 1:
            points = np.round(points)
        case 2:
            points[::2] *= 1e-6
        case 3:
            points[::3] = points[0]
    return points


SHAPES = st.sampled_from(["sphere", "ellipsoid", "any-axis", "all-axes"])


@settings(deadline=None)
@given(st.integers(2, 90), st.integers(0, 10**6), SHAPES, st.floats(0.05, 3.0))
def test_the_closest_pair_is_found(count, seed, shape, threshold):
    points = scattered(count, seed)
    separation = Separation(1.0, shape, 2.0)
    upper = np.array(np.triu_indices(count, 1))
    distance = measure(points[upper[0]] - points[upper[1]], separation)
    found = closest(points, threshold, separation)
    near = distance < threshold * (1 - 1e-9)
    assert crowded(points, threshold, separation) == np.unique(upper[:, near]).size
    if not near.any():
        assert found is None
    else:
        first = int(np.argmin(distance))
        assert found.distance == distance[first]
        if found.distance > 0.0:
            assert [found.first, found.second] == upper[:, first].tolist()
    if shape != "all-axes" and not (distance == 0.0).any():
        pairs = [
            pair
            for first, second, _ in close_pairs(points, threshold, separation)
            for pair in np.sort([first, second], axis=0).T.tolist()
        ]
        assert sorted(pairs) == upper[:, near].T.tolist()


@settings(deadline=None)
@given(
    st.tuples(st.integers(1, 50), st.integers(1, 50)),
    st.integers(0, 10**6),
    SHAPES,
    st.floats(0.05, 3.0),
)
def test_the_closest_places_of_two_formations_are_found(counts, seed, shape, threshold):
    one, other = scattered(counts[0], seed), scattered(counts[1], seed + 5)
    separation = Separation(1.0, shape, 2.0)
    distance = measure(one[:, None] - other, separation)
    found = closest_between(one, other, threshold, separation)
    if distance.min() >= threshold * (1 - 1e-9):
        assert found is None
    else:
        assert found.distance == distance.min()
        assert distance[found.first, found.second] == found.distance


@given(st.tuples(*[st.floats(-60, 60)] * 3))
def test_the_least_time_is_below_a_flight_of_full_thrust(displacement):
    """No bang-bang flight along the straight line within generous bounds is quicker."""
    preset = PRESETS["formation-625g"]
    way = np.array(displacement)
    least = float(least_times(way, preset.limits, preset.vehicle))
    distance = float(np.linalg.norm(way))
    thrust = preset.limits.thrust_max / preset.vehicle.mass
    most = thrust + preset.vehicle.gravity
    assert least <= 2 * math.sqrt(max(distance, 0.0) / 1.0) + distance / 1.0 + 1e-9
    assert least >= 2 * math.sqrt(np.abs(way).max() / most) - 1e-9
    assert least >= np.abs(way).max() / 5.0 - 1e-9


def test_the_least_time_of_a_vertical_move_is_exact():
    """Full thrust up, free fall down, with the speed limit in between."""
    preset = PRESETS["formation-625g"]
    up = preset.limits.thrust_max / 0.625 - 9.80665
    down = 9.80665
    reach = 5.0**2 / 2 * (1 / up + 1 / down)
    assert reach < 20.0
    wanted = 5.0 / up + 5.0 / down + (20.0 - reach) / 5.0
    least = float(
        least_times(np.array([0.0, 0.0, 20.0]), preset.limits, preset.vehicle)
    )
    assert least == pytest.approx(wanted)


def test_a_short_move_takes_as_long_as_its_jerk_asks():
    """Rest to rest of the acceleration too: (32 d / j)^(1/3)."""
    preset = PRESETS["formation-625g"]
    limits = replace(preset.limits, jerk=4.0)
    least = float(least_times(np.array([0.3, 0.0, 0.4]), limits, preset.vehicle))
    assert least == pytest.approx((32.0 * 0.5 / 4.0) ** (1.0 / 3.0))


def test_jerk_is_a_limit_in_metres_a_second_cubed(show, read):
    lines = TEN_LINES + "limits: {jerk: WRITTEN}\n"
    assert show(TEN_LINES).limits.jerk == 0.0
    for text in ("15", "15 m/s^3", "15 m/s³"):
        made = show(lines.replace("WRITTEN", text))
        assert made.limits.jerk == made.limits.upright(1.0).jerk == 15.0
    for text in ("15 m/s²", "0", "-3", "1e6"):
        assert read(lines.replace("WRITTEN", text)).errors


def test_polygons():
    corners = np.array([[0.0, 0], [4, 0], [4, 4], [2, 1], [0, 4]])
    points = np.array([[1.0, 1], [2, 2], [3.5, 3], [5, 1], [-1, 0]])
    inside = inside_polygon(points, corners)
    assert inside.tolist() == [True, False, True, False, False]
    square = np.array([[0.0, 0], [4, 0], [4, 4], [0, 4]])
    near = fence_distance(np.array([[1.0, 2.0], [2, 3.5], [6, 4], [7, 8]]), square)
    assert near.tolist() == [1.0, 0.5, 2.0, 5.0]


def test_colours():
    assert parse_colour("Gold") == (1.0, 215 / 255, 0.0)
    assert parse_colour("#f80") == (1.0, 136 / 255, 0.0)
    assert parse_colour("rebeccapurple") == (0.4, 0.2, 0.6)
    assert parse_colour("#12345") is None
    assert len(COLOUR_NAMES) == 148
    ramp = linear_light(np.linspace(0, 1, 257))
    assert ramp[0] == 0.0 and ramp[-1] == 1.0
    assert np.all(np.diff(ramp) > 0)
    assert linear_light(np.array([0.5]))[0] == pytest.approx(0.21404114)


def test_gradients(show):
    made = show(
        "drones: 5\nformations:\n"
        "  row: {type: line, length: 40, colour: {gradient: [black, white]}}\n"
        "  out: {type: line, length: 40, "
        "colour: {gradient: [red, blue], along: centre}}\n"
        "transitions: [row, out]\n"
    )
    row, out = made.formations["row"].colours, made.formations["out"].colours
    assert np.allclose(row[:, 0], linear_light(np.linspace(0, 1, 5)))
    assert np.allclose(out[2], [1, 0, 0])
    assert np.allclose(out[[0, 4]], [0, 0, 1])


def test_all_faults_at_once_in_order(read):
    result = read(
        "drones: 4\nseparation: 2 kg\nlimits: {tilt: 200}\nsite: {fense: []}\n"
        "formations:\n  ring: {type: circle, raduis: 4}\n"
        "  near: {type: line, length: 3}\n"
        "transitions:\n  - {to: rong}\n  - {to: near, hold: -1}\n"
    )
    codes = [item.code for item in result.errors]
    assert codes == [
        "SHW105", "SHW104", "SHW101", "SHW101", "SHW107", "SHW104",
    ]  # fmt: skip
    places = [(item.span.line, item.span.column) for item in result.diagnostics]
    assert all(first <= second for first, second in pairwise(places))


@given(st.integers(1, 70), st.integers(1, 70), st.integers(0, 10**6))
def test_the_place_furthest_from_all_others_is_found(count, others, seed):
    chance = np.random.default_rng(seed)
    places = chance.uniform(-9, 9, (count, 3))
    goals = chance.uniform(-9, 9, (others, 3))

    def times(way):
        return np.linalg.norm(way, axis=-1)

    nearest = times(goals[None] - places[:, None]).min(axis=1)
    assert _furthest(places, goals, times, 10**6) == nearest.max()
    assert _furthest(places, goals, times, 1) <= nearest.max()


def test_a_preference_that_is_none_ends_in_one_message(read):
    text = "prefer: calm\nformations: {a: {type: circle, count: 4, radius: 6}}\n"
    (found,) = read(text + "transitions: [a]\n").errors
    assert found.code == "SHW106" and "`calm`" in found.message
    assert {"`time`", "`energy`"} <= set(found.help.replace(",", "").split())


def test_a_misspelt_group_is_answered_with_the_one_that_is_meant(read):
    text = (
        "groups: {left: 1-2, right: 3-4}\nformations: {a: {type: circle, radius: 9}}\n"
    )
    (found,) = read(text + "transitions: [{to: a, group: lefft}]\n").errors
    assert (found.code, found.help, found.fix) == (
        "SHW107", "did you mean `left`?", "left",
    )  # fmt: skip


def test_pads_that_are_not_written_are_refused_where_the_separation_stands(read):
    text = "drones: 4\nseparation: {distance: 1.5, shape: all-axes}\ntransitions: [a]\n"
    line = (
        "{type: line, count: 4, length: 12, direction: [1, 1, 1], centre: [0, 0, 20]}"
    )
    (found,) = read(f"{text}formations:\n  a: {line}\n").errors
    assert found.code == "SHW201" and found.span.line == 3
    assert "also on the ground" in found.help


@pytest.mark.parametrize(
    ("transitions", "kept"),
    [
        ("{to: all}, {to: all, assignment: keep}", True),
        ("{to: a, group: one}, {to: b, group: one, assignment: keep}", True),
        (
            "{to: a, group: one}, {to: b, group: two}, {to: all, assignment: keep}",
            False,
        ),
        ("{to: all, assignment: fixed}, {to: a, group: one, assignment: keep}", True),
        ("{to: all, assignment: fixed}, {to: a, group: two, assignment: keep}", False),
        ("{to: all}, {to: a, group: one, assignment: keep}", False),
        ("{to: few}, {to: all, assignment: keep}", False),
    ],
)
def test_numbers_of_places_that_cannot_be_kept_are_found_as_by_the_planner(
    transitions, kept
):
    result = read_show(
        f"""\
showc: 1
drones: 6
groups: {{one: 1-3, two: 4-6}}
parking: {{type: line, spacing: 3, count: 6, centre: [0, -30, 20]}}
formations:
  all: {{type: line, spacing: 3, count: 6, centre: [0, 0, 20]}}
  few: {{type: line, spacing: 3, count: 5, centre: [0, 0, 40]}}
  a: {{type: line, spacing: 3, count: 3, centre: [0, 20, 20]}}
  b: {{type: line, spacing: 3, count: 3, centre: [0, 40, 20]}}
transitions: [{transitions}]
""".encode()
    )
    assert ("SHW219" not in {one.code for one in result.errors}) == kept
    if kept:
        assert build_itinerary(result.draft).legs


@pytest.mark.parametrize(("ceiling", "top"), [(25, 25.0), (40, 40.0), (90, 40.0)])
def test_flights_keep_below_the_ceiling(ceiling, top):
    text = f"""showc: 1
drones: 4
site: {{ceiling: {ceiling}, volume: {{min: [-20, -20, 0], max: [20, 20, 40]}}}}
mission: {{wanted: false}}
formations: {{ring: {{type: circle, radius: 6, centre: [0, 0, 25]}}}}
transitions: [ring]
"""
    result = read_show(text.encode())
    assert not result.errors
    assert result.show.limits.position_max == (20.0, 20.0, top)
    assert result.show.site.volume_max == (20.0, 20.0, 40.0)
    # A place above it is one finding, not two.
    above = text.replace("0, 0, 25", f"0, 0, {ceiling + 1}")
    codes = [one.code for one in read_show(above.encode()).errors]
    assert codes == (["SHW214"] if ceiling < 40 else ["SHW203", "SHW214"])
