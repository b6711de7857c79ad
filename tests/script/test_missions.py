"""What missions cannot carry is said by check, and holds of the missions written."""

import pytest
from mission.flights import rows, shift_flight

from showc.autopilot.stage import SLOWEST_COMMAND
from showc.autopilot.takeoff import LEAST_HEIGHT
from showc.mission import mission_files
from showc.mission.feasibility import mission_outlook
from showc.script import read_show
from showc.script.rules import missions
from showc.script.show import MissionOptions

HEAD = "showc: 1\n"
RINGS = """drones: 4
formations:
  low: {type: circle, radius: 6, centre: [0, 0, 12], colour: red}
  high: {type: circle, radius: 6, centre: [0, 0, 20], colour: lime}
"""


def warned(text):
    found = read_show((HEAD + text).encode()).diagnostics
    return [(item.message, item.span.line) for item in found if item.code == "SHW308"]


def turns(count, more=""):
    names = ["low", "high"] * count
    return "transitions:\n" + "".join(
        f"  - {{to: {name}{more}}}\n" for name in names[:count]
    )


@pytest.mark.parametrize(
    ("options", "most"),
    [
        ("board: 4k", 77),
        # Red to green and back changes two outputs half way, at first it is one.
        ("board: 4k, light_servos: [9, 10, 11]", 30),
        ("autopilot: px4", 248),
    ],
)
def test_more_legs_than_a_board_holds_are_a_finding_at_the_board(options, most):
    mission = f"mission: {{{options}}}\n"
    long = [
        message
        for count in (most, most + 1)
        for message, _ in warned(mission + RINGS + turns(count))
        if "items" in message
    ]
    assert len(long) == 1
    assert ("PX4 holds" in long[0]) == ("px4" in options)
    ((_, line),) = [
        found
        for found in warned(mission + RINGS + turns(most + 1))
        if "items" in found[0]
    ]
    assert line == 2


def test_what_some_group_flies_alone_counts_for_its_drones():
    groups = "groups: {few: 1-2, rest: 3-4}\n"
    pair = (
        "drones: 4\nformations:\n  here: {type: line, count: 2, centre: [0, 0, 12]}\n"
        "  there: {type: line, count: 2, centre: [0, 0, 20]}\n"
    )
    moves = "transitions:\n" + "".join(
        f"  - {{to: {('here', 'there')[k % 2]}, group: few, at: {30 + 20 * k}, "
        "duration: 9}\n"
        for k in range(100)
    )
    board = "mission: {board: 4k}\n"
    assert any(
        "207 items" in message for message, _ in warned(board + groups + pair + moves)
    )


def test_a_show_beyond_the_hour_is_a_finding_and_one_within_is_none():
    def said(hold):
        text = RINGS + f"transitions: [{{to: low, hold: {hold} s}}]\n"
        return [message for message, _ in warned(text)]

    assert said(3599) == []
    assert any("within the hour" in message for message in said(3600))


def test_px4_is_a_finding_and_no_missions_are_none():
    plain = RINGS + turns(1)
    ((message, _),) = warned("mission: {autopilot: px4}\n" + plain)
    assert "not known" in message
    assert warned("mission: {autopilot: px4, wanted: false}\n" + plain) == []


@pytest.mark.parametrize("servos", [None, (9, 10, 11)])
@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_no_mission_has_fewer_items_than_is_said_before(servos, autopilot, monkeypatch):
    options = MissionOptions(light_servos=servos, autopilot=autopilot)
    flight = shift_flight(4, options=options)
    written = mission_files(flight, autopilot=autopilot).files
    counts = [
        len(rows(content))
        for name, content in written.items()
        if name.endswith(".waypoints")
    ]
    # Where a board holds next to nothing, everything is counted.
    monkeypatch.setattr(missions, "item_budget", lambda *_: 1)
    least = missions.least_items(flight.itinerary.show)
    assert least <= max(counts)
    assert least >= 0.5 * max(counts)
    (long,) = [
        found
        for found in (
            *mission_outlook(flight.itinerary).refused,
            *mission_outlook(flight.itinerary).notes,
        )
        if "items" in found
    ]
    assert least <= int(long.split("at least ")[1].split()[0]) <= max(counts)


@pytest.mark.parametrize(
    ("latitude", "longitude", "volume", "said"),
    [
        (-16.8, 179.9999, "", True),
        (-16.8, -179.9999, "", True),
        (-16.8, 180.0, "", True),
        # East of it, and so far that nothing reaches it.
        (-16.8, -179.9999, ", volume: {min: [12, -90, 0], max: [90, 90, 90]}", False),
        (-16.8, -179.99, "", False),
        # Longitudes are nearer to each other where the volume is nearest to a pole.
        (89, 176.7, ", volume: {min: [-1, -1, 0], max: [6000, 9999, 90]}", True),
        (89, 176.7, ", volume: {min: [-1, -1, 0], max: [6000, 99, 90]}", False),
    ],
)
def test_a_site_across_the_180th_meridian_has_no_missions(
    latitude, longitude, volume, said
):
    origin = f"{{latitude: {latitude}, longitude: {longitude}}}"
    site = f"site: {{origin: {origin}{volume}}}\n"
    text = site + RINGS + turns(1)
    assert any("180th" in message for message, _ in warned(text)) == said
    show = read_show((HEAD + text).encode()).draft
    assert show is not None
    assert any("180th" in one.message for one in missions.refusals(show)) == said


@pytest.mark.parametrize(
    ("section", "said"),
    [
        ("launch: {altitude: 1 m}", "takes off to more than 1 m"),
        ("launch: {altitude: 1.1 m}", None),
        ("limits: {climb: 0.149}", "heeds 0.15 m/s at least"),
        ("limits: {descent: 0.1}", "heeds 0.15 m/s at least"),
        ("limits: {climb: 0.15, descent: 0.15}", None),
    ],
)
def test_what_autopilots_do_not_do_is_said_before_the_solve(section, said):
    found = [message for message, _ in warned(f"{section}\n{RINGS}{turns(1)}")]
    assert len(found) == (said is not None)
    assert said is None or said in found[0]
    least = missions.LEAST_TAKEOFF, missions.LEAST_VERTICAL
    assert least == (LEAST_HEIGHT, SLOWEST_COMMAND)


@pytest.mark.parametrize("distance", [1.5, 2.5])
@pytest.mark.parametrize("left", ["", ", separation: 2"])
def test_what_an_export_advises_leaves_it_the_room(distance, left):
    def found(separation, wish):
        text = f"""showc: 1
drones: 4
mission: {{wanted: false}}
separation: {separation}
exports: [{wish}]
formations: {{ring: {{type: circle, radius: 9, centre: [0, 0, 20]}}}}
transitions: [ring]
"""
        result = read_show(text.encode())
        return [one.help for one in result.diagnostics if one.code == "SHW310"]

    wish = f"{{to: skyb{left}}}"
    advised = found(f"{{distance: {distance}, tracking: 0}}", wish)
    for said in advised:
        _, separation, _, other, _ = said.split("`")
        assert not found(separation.removeprefix("separation: "), wish)
        assert not found(f"{{distance: {distance}, tracking: 0}}", other)
    assert bool(advised) is not (distance > 2.0 and bool(left))
