"""Whole logs, each true in itself, of other flights and shows than the script's.

A lie is flown, sampled, drawn and signed by the compiler's own code: nothing in the log
contradicts anything else in it. What tells is the script, whose bytes it carries.
"""

from dataclasses import replace

import numpy as np
import pytest
from findings import failed
from synthetic import vertical_flight
from verified import manifest_of, proved_flight, script_of, written

from showc.flight import Trajectory
from showc.light.program import LightProgram
from showc.log.writer import Topics, write_log
from showc.trajectory import PiecewisePolynomial
from showc.verify import DamagedLogError, verify_log

DRONES = 2


@pytest.fixture(scope="module")
def flight():
    return proved_flight(DRONES)


def failures(flight, folder, **options):
    """Codes that fail of a flight that was written whole."""
    log = folder / "output.mcap"
    with log.open("wb") as stream:
        write_log(flight, stream, manifest=manifest_of(flight), **options)
    try:
        return set(failed(verify_log(log, missions=False)))
    except DamagedLogError:
        return {"damage"}


def test_the_flight_itself_passes(flight, tmp_path):
    assert failures(flight, tmp_path) == set()


# Other shows under this script --------------------------------------------------


def at(path, change):
    """Change what lies at a path of a show: attributes, keys, positions."""

    def deeper(whole, steps):
        if not steps:
            return change(whole)
        step, *rest = steps
        if isinstance(whole, dict):
            return {**whole, step: deeper(whole[step], rest)}
        if isinstance(whole, tuple):
            inner = deeper(whole[step], rest)
            return (*whole[:step], inner, *whole[step + 1 :])
        return replace(whole, **{step: deeper(getattr(whole, step), rest)})

    return lambda show: deeper(show, path)


def plus(amount):
    return lambda value: value + amount


def put(value):
    return lambda _: value


SHOWS = {
    "another name": ("VRF203", at(["name"], put("Improved"))),
    "another hour": ("VRF105", at(["epoch"], lambda t: t.replace(hour=5))),
    "a place a metre off": ("VRF203", at(["site", "latitude"], plus(1e-5))),
    "another height above the sea": ("VRF203", at(["site", "altitude"], plus(0.5))),
    "a site turned": ("VRF203", at(["site", "heading"], plus(0.01))),
    "a higher ceiling": ("VRF203", at(["site", "volume_max", 2], plus(1.0))),
    "a wider fence": ("VRF203", at(["site", "fence"], lambda f: f * 1.01)),
    "no fence": ("VRF203", at(["site", "fence"], put(None))),
    "a margin of the fence": ("VRF203", at(["site", "fence_margin"], plus(0.1))),
    "a lighter vehicle": ("VRF203", at(["vehicle", "mass"], plus(-1e-6))),
    "a stronger vehicle": ("VRF203", at(["vehicle", "rotor_speed_max"], plus(1.0))),
    "another name of it": ("VRF203", at(["vehicle", "name"], put("racer"))),
    "faster level flight": ("VRF203", at(["limits", "level_speed"], plus(3.0))),
    "more tilt": ("VRF203", at(["limits", "tilt"], plus(1e-3))),
    "no jerk": ("VRF203", at(["limits", "jerk"], plus(1.0))),
    "harder climbs": ("VRF203", at(["limits", "acceleration_up"], plus(1.0))),
    "half the separation": ("VRF203", at(["separation", "distance"], put(0.5))),
    "another shape of it": ("VRF203", at(["separation", "shape"], put("ellipsoid"))),
    "free yaw": ("VRF203", at(["yaw"], put("free"))),
    "other samples": ("VRF203", at(["log_rate"], put(10.0))),
    "other pads by name": (
        "VRF203|VRF204",
        at(["formations"], lambda f: f | {"x": f["pads"]}),
    ),
    "a colour of its picture": (
        "VRF125",
        at(["formations", "steps", "colours"], lambda c: c * 0.5),
    ),
    "an effect that it has not": (
        "VRF125",
        at(["formations", "steps", "effect"], put(None)),
    ),
    "a fade of the other kind": (
        "VRF125",
        at(["transitions", 0, "fade"], put("start")),
    ),
    "lights of no hold": ("VRF125", at(["transitions", 0, "lights"], put(()))),
    "a longer hold": ("VRF204", at(["transitions", 0, "hold"], plus(0.5))),
    "a shorter hold": ("VRF204", at(["transitions", 1, "hold"], plus(-0.5))),
    "a hold of the launch": ("VRF204", at(["launch", "hold"], plus(1.0))),
    "a hold before the landing": ("VRF204", at(["landing", "hold"], plus(1.0))),
    "other names of moves": ("VRF204", at(["transitions", 0, "name"], put("up"))),
}


@pytest.mark.parametrize("lie", SHOWS)
def test_the_log_of_another_show_is_found(flight, tmp_path, lie):
    codes, change = SHOWS[lie]
    show = change(flight.itinerary.show)
    other = vertical_flight(DRONES, show=show)
    legs = [
        replace(mine, certificate=true.certificate)
        for mine, true in zip(other.legs, flight.legs, strict=True)
    ]
    if show.log_rate == flight.itinerary.show.log_rate:
        # Lights, names and holds are those of the other show; so is all that is drawn.
        assert failures(replace(other, legs=tuple(legs)), tmp_path) & {
            *codes.split("|")
        }
        return
    assert "VRF203" in failures(replace(other, legs=tuple(legs)), tmp_path)


# Other flights of this script ---------------------------------------------------


def legs_of(flight, change):
    """Change legs by number; what follows each starts when it ends."""
    legs = [change(number, leg) for number, leg in enumerate(flight.legs)]
    starts = np.round(np.cumsum([0.0, *(leg.duration for leg in legs[:-1])]), 3)
    return replace(flight, legs=tuple(legs), starts=starts)


def flown(which, change):
    """Change the trajectories of a leg; ``change`` takes all of them."""

    def lie(flight):
        return legs_of(
            flight,
            lambda number, leg: (
                replace(leg, trajectories=tuple(change(leg.trajectories)))
                if number in which
                else leg
            ),
        )

    return lie


def moved(trajectory, shift):
    """Fly the same elsewhere."""
    state = trajectory.state.coefficients.copy()
    state[:, :, :3] += shift
    return with_state(trajectory, state)


def with_state(trajectory, state):
    polynomial = PiecewisePolynomial(trajectory.state.breaks, state)
    return Trajectory(polynomial, trajectory.control, trajectory.meshes)


def backwards(trajectory):
    """Fly the same way back: velocities turn round."""
    state = trajectory.state.coefficients[::-1, ::-1].copy()
    state[:, :, 3:6] *= -1.0
    control = trajectory.control.coefficients[::-1, ::-1].copy()
    return Trajectory(
        PiecewisePolynomial(trajectory.state.breaks, state),
        PiecewisePolynomial(trajectory.control.breaks, control),
    )


def stretched(trajectory, factor):
    """Fly the same in another time: velocities fit, thrust does not."""
    state = trajectory.state.coefficients.copy()
    state[:, :, 3:6] /= factor
    return Trajectory(
        PiecewisePolynomial(trajectory.state.breaks * factor, state),
        PiecewisePolynomial(
            trajectory.control.breaks * factor, trajectory.control.coefficients
        ),
    )


def slower(which, factor):
    def lie(flight):
        def change(number, leg):
            if number not in which:
                return leg
            paths = tuple(stretched(one, factor) for one in leg.trajectories)
            duration = float(paths[0].state.breaks[-1])
            return replace(leg, duration=duration, trajectories=paths)

        return legs_of(flight, change)

    return lie


def with_goals(which, shift):
    """End elsewhere, and call that the goal; the next legs begin there."""

    def lie(flight):
        def change(number, leg):
            if number not in which:
                return leg
            goal = leg.leg.goal + shift
            paths = tuple(moved(one, shift) for one in leg.trajectories)
            return replace(leg, leg=replace(leg.leg, goal=goal), trajectories=paths)

        return legs_of(flight, change)

    return lie


def crept(trajectory, pieces=401, step=2e-4):
    """Hover, go a step aside at once, hover again; and back in the second half."""
    steps = np.array([step, -step])[2 * np.arange(pieces) // pieces]
    steps *= np.arange(pieces) % 2
    state = np.tile(trajectory.state.coefficients[0, 0], (pieces, 2, 1))
    state[:, :, 0] += np.cumsum([0.0, *steps])[[[k, k + 1] for k in range(pieces)]]
    breaks = np.linspace(0.0, trajectory.state.breaks[-1], pieces + 1)
    control = np.tile(trajectory.control.coefficients[0, :1], (pieces, 1, 1))
    return Trajectory(
        PiecewisePolynomial(breaks, state), PiecewisePolynomial(breaks, control)
    )


def spliced(flight):
    """The second half of the flight of a script that asks for a longer hold."""
    script = script_of(DRONES).replace(b"hold: 1.5", b"hold: 2.5")
    other = proved_flight(DRONES, script=script)
    return legs_of(
        flight, lambda number, leg: other.legs[number] if number > 2 else leg
    )


def renamed(flight):
    """Two drones fly each other's part throughout, pads included."""
    return flown(range(99), lambda paths: paths[::-1])(flight)


def claimed(**changes):
    def lie(flight):
        return legs_of(
            flight,
            lambda number, leg: (
                replace(leg, leg=replace(leg.leg, **changes)) if number == 2 else leg
            ),
        )

    return lie


EVERY = range(99)
AWAY = np.array([0.0, 0.0, 0.05])
FLIGHTS = {
    "drones exchanged in one leg": ("VRF337|VRF333", flown([2], lambda p: p[::-1])),
    "drones exchanged in one hold": ("VRF337|VRF333", flown([3], lambda p: p[::-1])),
    "drones exchanged throughout": ("VRF338|VRF333|VRF205", renamed),
    "a leg flown backwards": (
        "VRF337|VRF333",
        flown([2], lambda p: [backwards(one) for one in p]),
    ),
    "one drone flies a leg backwards": (
        "VRF337|VRF333",
        flown([2], lambda p: [backwards(p[0]), p[1]]),
    ),
    "both drones fly as one": ("VRF321", flown(EVERY, lambda p: [p[0], p[0]])),
    "a show a metre beside": (
        "VRF333|VRF338|VRF205",
        flown(
            EVERY,
            lambda p: [moved(one, [1.0, 0.0, 0.0]) for one in p],
        ),
    ),
    "a leg flown 5 cm too high": (
        "VRF337",
        flown([4], lambda p: [moved(o, AWAY) for o in p]),
    ),
    "a hold flown 5 cm too high": (
        "VRF337",
        flown([3], lambda p: [moved(o, AWAY) for o in p]),
    ),
    "a hold crept 2 cm aside": ("VRF301", flown([3], lambda p: [crept(p[0]), p[1]])),
    "a show 5 cm too high": ("VRF205", with_goals(EVERY, AWAY)),
    "a show 2 mm beside its places": ("VRF205", with_goals(EVERY, [0.002, 0.0, 0.0])),
    "a show 1 um beside its places": ("VRF205", with_goals(EVERY, [1e-6, 0.0, 0.0])),
    "a leg flown in twice its time": ("VRF301|VRF302|VRF303", slower([2], 2.0)),
    "a leg flown in 0.999 of its time": ("VRF301|VRF302|VRF303", slower([2], 0.999)),
    "a hold of twice its time": ("VRF204", slower([3], 2.0)),
    "a hold of 10 ms more": ("VRF204", slower([5], 1.01)),
    "the rest of another flight": ("VRF204", spliced),
    "a leg of other places": ("VRF205", claimed(places=np.array([1, 0]))),
    "a leg to another formation": ("VRF204", claimed(to_formation="level")),
    "a leg from another formation": ("VRF204", claimed(from_formation="pads")),
    "a leg of another kind": ("VRF204", claimed(kind="approach")),
}


@pytest.mark.parametrize("lie", FLIGHTS)
def test_another_flight_of_the_script_is_found(flight, tmp_path, lie):
    codes, change = FLIGHTS[lie]
    assert failures(change(flight), tmp_path) & {*codes.split("|")}


@pytest.mark.parametrize(
    "lit",
    [
        at(["formations", "level", "colours"], lambda c: c * 0.5),
        at(["formations", "steps", "effect"], put(None)),
        at(["transitions", 0, "lights"], put(())),
        at(["transitions", 1, "fade"], put("end")),
    ],
    ids=["colour", "effect", "keys", "fade"],
)
def test_a_fleet_lit_as_another_show_is_found(flight, tmp_path, lit):
    itinerary = replace(flight.itinerary, show=lit(flight.itinerary.show))
    lights = LightProgram.of(replace(flight, itinerary=itinerary))
    assert failures(flight, tmp_path, lights=lights) == {"VRF125"}


@pytest.mark.parametrize(
    "topics", [Topics((), ()), Topics((0,), (0, 1)), Topics((0, 1), ())]
)
def test_a_log_with_fewer_topics_is_found(flight, tmp_path, topics):
    assert failures(flight, tmp_path, topics=topics) & {"VRF120", "VRF124", "VRF106"}


def test_a_fleet_drawn_without_missions_is_found(flight, tmp_path):
    class Standing:
        duration = 3.0

        def position(self, times):
            return np.zeros((len(times), DRONES, 3))

    assert "VRF107" in failures(flight, tmp_path, predicted=Standing())


def test_two_logs_are_not_each_others(flight, tmp_path):
    """The script given is another one than the log's, by a byte of a comment."""
    script = tmp_path / "proved.yaml"
    script.write_bytes(script_of(DRONES) + b"# other\n")
    log = written(flight, tmp_path / "output.mcap")
    assert "VRF201" in failed(verify_log(log, missions=False, script=script))
