"""Legs in which nobody moves, and landings from where the fleet stands already."""

import pytest
from mission.flights import formula_flight, rows
from mission.planted import Case

from showc.plan import build_itinerary
from showc.script import read_show

SCRIPT = """\
showc: 1
drones: 2
mission: {light_servos: [9, 10, 11]}
pads: {type: line, length: 4}
launch: {altitude: 8, hold: 1}
formations:
  pair: {type: line, length: 6, centre: [0, 3, 8], colour: red}
  above: {type: line, length: 4, centre: [0, 0, 8], colour: blue}
transitions:
  - {to: pair, hold: 1}
  - {to: pair, colour: lime, hold: 4, assignment: fixed}
  - {to: above, hold: 7, assignment: fixed}
landing: {altitude: 8, hold: 2}
"""


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    flight = formula_flight(build_itinerary(read_show(SCRIPT.encode()).show))
    return Case(tmp_path_factory.mktemp("still"), flight)


def test_colours_alone_have_a_slot_and_are_proved(case):
    assert case.failures() == set()
    table = rows(case.files["missions/drone_0001.waypoints"])
    commands = [int(row[3]) for row in table]
    # A slot, its tenths, then green for red, and the next slot.
    green = next(k for k, row in enumerate(table) if row[3:6] == [183, 10, 2000])
    assert commands[green - 3 : green + 2] == [93, 93, 183, 183, 93]
    moved = [leg["name"] for leg in case.missions.prediction["legs"]]
    assert moved == ["launch -> pair", "pair -> pair", "pair -> above"]


def test_what_stands_above_the_pads_is_held_and_lands_dark(case):
    table = rows(case.files["missions/drone_0001.waypoints"])
    pause, dark, land = table[-3:]
    assert (pause[3], pause[4]) == (93, 9.0)
    assert dark[3:6] == [183, 11, 1000]
    assert land[3] == 21

    def sooner(fields):
        fields[-3][4] = "2"
        return fields

    def lit(fields):
        return [*fields[:-2], fields[-1]]

    assert "VRF405" in case.caught(case.with_row(1, sooner))
    assert "VRF409" in case.caught(case.with_row(1, lit))
