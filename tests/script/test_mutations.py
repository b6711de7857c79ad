"""Whatever stands in a script for whatever else, reading answers with findings."""

import copy
import random

import pytest
import yaml
from repository import ROOT

from showc.script import read_show

FULL = """
showc: 1
name: All
epoch: 2025-06-01T23:30:00+02:00
site:
  origin: {latitude: 52.5 deg, longitude: 13, altitude: 48}
  heading: 30
  volume: {min: [-60, -60, -1], max: [60, 60, 80]}
  fence: [[-50, -50], [50, -50], [50, 50], [-50, 50]]
vehicle: {preset: formation-625g, mass: 700 g, inertia: [0.002, 0.002, 0.003]}
limits: {speed: [5, 5, 3], tilt: 20, body_rate: 1.7 rad/s, torque: [0.6, 0.6, 0.1]}
separation: {distance: 1.6, shape: ellipsoid, vertical_stretch: 1.5}
yaw: {mode: held, heading: 10}
drones: 9
pads: {type: grid, step: 3}
parking: {type: line, count: 5, centre: [0, -40, 15], spacing: 3}
launch: {altitude: 12}
landing: {altitude: 12, assignment: fixed}
groups: {left: 1-4, right: [5, 6-9]}
formations:
  ring: {type: circle, radius: 9, colour: {gradient: [red, blue], along: order}}
  twin: {like: ring, transform: [{rotate: {angle: 30, axis: z}}, {scale: 1.5}]}
  both:
    parts:
      - {type: points, points: [[0, 0, 0], [4, 0, 0]]}
      - {type: helix, radius: 12, height: 9, count: 5}
    centre: [0, 0, 30]
    effect: {kind: sweep, direction: [0, 0, 1]}
  word: {type: text, text: A, height: 20, spread: true, spacing: 2}
  west: {type: sphere, radius: 6, centre: [-25, 0, 25], count: 4}
  east: {type: cube, size: 9, centre: [25, 0, 25], count: 5, colour: {each: [red]}}
transitions:
  - {to: ring, hold: 3, colour: gold, fade: start, effect: pulse, name: Go}
  - {to: twin, duration: 30, assignment: fixed}
  - both
  - {to: west, group: left}
  - {to: east, group: right}
  - word
mission: {light_servos: [9, 10, 11], light_pwm: [1000, 2000], slack: 4, board: cube}
log_rate: 30
seed: 3
"""
JUNK = [
    None, True, False, 0, -1, 1e9, 3.5, float("nan"), float("inf"), "", "no", "x",
    "1 m", "5 deg", "1-4", "9-1", "ring", "ghost", "#fff", "red", [], {}, [[]],
    [1, 2, 3], [0, 0, 0], ["a", "b"], {"type": "circle"}, {"like": "ring"},
    {"parts": []}, {"kind": "pulse"}, {"solid": "red"}, {"x": 1}, [None], "\u4f60",
    "a" * 300, 10**30,
]  # fmt: skip


def places(node, path=()):
    yield path
    if isinstance(node, dict):
        for key, value in node.items():
            yield from places(value, (*path, key))
    elif isinstance(node, list):
        for index, value in enumerate(node):
            yield from places(value, (*path, index))


def mutated(chance):
    script = yaml.load(FULL, yaml.BaseLoader)  # noqa: S506 - texts only
    for _ in range(chance.randint(1, 4)):
        path = chance.choice([path for path in places(script) if path])
        node = script
        for step in path[:-1]:
            node = node[step]
        match chance.randrange(4):
            case 0:
                del node[path[-1]]
            case 1 if isinstance(node, dict):
                node[chance.choice(["centre", "count", "colour", "to", "type"])] = (
                    copy.deepcopy(chance.choice(JUNK))
                )
            case _:
                node[path[-1]] = copy.deepcopy(chance.choice(JUNK))
    text = yaml.safe_dump(script, sort_keys=False)
    return text.replace("'true'", "true").encode()


def test_the_script_itself_is_right():
    result = read_show(FULL.encode())
    assert result.errors == ()
    assert result.show is not None


@pytest.mark.parametrize("seed", range(25))
def test_mutations_are_answered(seed):
    chance = random.Random(seed)
    for _ in range(6):
        result = read_show(mutated(chance), folder=ROOT)
        assert (result.show is None) == bool(result.errors)
        if result.show is not None:
            for formation in result.show.formations.values():
                assert formation.points.shape[1] == 3
            for move in result.show.transitions:
                assert move.to in result.show.formations
