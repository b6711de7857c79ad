"""What moves while it is shown comes in as a moving formation, and can be solved."""

import numpy as np
import pytest
from click.testing import CliRunner

from showc.cli.compile import command as compile_
from showc.cli.diff import command as diff
from showc.cli.import_ import command as import_
from showc.errors import UsageError
from showc.export.fit import tracks_of
from showc.export.solved import solved_show
from showc.foreign.acts import Act, acts, frames_of, holds, strays
from showc.foreign.motion import place_at
from showc.foreign.reading import read_show
from showc.foreign.show import fleet, polyline
from showc.log.reader import read_log
from showc.verify import verify_log

RATE = 10


def smooth(times, begin, end):
    """From 0 to 1, with two derivatives that are continuous."""
    share = np.clip((times - begin) / (end - begin), 0.0, 1.0)
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


def places(times, drone, turn=np.pi):
    """Up, half a turn from 11 to 23 s, 8 m aside from 25 to 29 s, and down."""
    angle = np.pi * drone + turn * smooth(times, 11.0, 23.0)
    x = 5.0 * np.cos(angle) + 8.0 * smooth(times, 25.0, 29.0)
    height = 10.0 * (smooth(times, 3.0, 9.0) - smooth(times, 33.0, 40.0))
    return np.stack([x, 5.0 * np.sin(angle), height], axis=-1)


def dance(**more):
    times = np.linspace(0.0, 42.0, 42 * RATE + 1)
    return fleet([polyline(times, places(times, k, **more)) for k in range(2)])


def in_the_air(tracks):
    return [one for one in holds(tracks) if place_at(tracks, one[0])[0, 2] > 1.0]


def test_a_turn_is_a_moving_picture_and_a_shift_is_not():
    tracks = dance()
    assert strays(tracks, 11.0, 23.0) > 0.4
    assert strays(tracks, 25.0, 29.0) < 0.01
    turning, shifted = acts(tracks, in_the_air(tracks))
    assert turning.moves and not shifted.moves
    assert turning.begin == pytest.approx(9.0, abs=0.5)
    assert turning.end == pytest.approx(25.0, abs=0.5)


def test_an_eighth_of_a_turn_is_a_transition():
    tracks = dance(turn=np.pi / 4.0)
    assert [one.moves for one in acts(tracks, in_the_air(tracks))] == [False] * 3


def test_what_is_asked_for_is_played_as_it_is():
    tracks = dance(turn=np.pi / 4.0)
    found = acts(tracks, in_the_air(tracks), [(24.5, 29.5)])
    assert [one.moves for one in found] == [False, True]
    with pytest.raises(UsageError, match="no stretch"):
        acts(tracks, [], [(40.0, 50.0)])


@pytest.mark.parametrize("rate", [4, 10, 25])
def test_the_curve_through_frames_is_near_the_flight(rate):
    times = np.linspace(0.0, 42.0, 42 * rate + 1)
    tracks = fleet([polyline(times, places(times, k)) for k in range(2)])
    found = frames_of(tracks, Act(10.0, 24.0, moves=True))
    assert found.length == pytest.approx(14.0)
    assert found.beside < 0.005 and found.ramp == 0.2


def test_a_cut_in_full_flight_sets_in_gently():
    found = frames_of(dance(), Act(15.0, 19.0, moves=True))
    speed = 5.0 * np.pi * 1.8 / 12.0
    assert found.ramp == pytest.approx(0.75 * speed, rel=0.4)
    assert 35.0 / 16.0 * speed / found.ramp < 4.0


@pytest.fixture(scope="module")
def again(tmp_path_factory):
    """Tables of a dance as spreadsheets have them, and the script that they became."""
    folder = tmp_path_factory.mktemp("dance")
    tables = folder / "dance"
    tables.mkdir()
    times = np.linspace(0.0, 42.0, 42 * RATE + 1)
    for drone in range(2):
        red = np.where(times < 18.0, 255, 0)
        rows = [
            f"{1000 * time:.0f},{x:.4f},{y:.4f},{z:.4f},{red},0,{255 - red}"
            for time, (x, y, z), red in zip(
                times, places(times, drone), red, strict=True
            )
        ]
        text = "\n".join(["Time [msec],x [m],y [m],z [m],Red,Green,Blue", *rows])
        (tables / f"Drone {drone + 1}.csv").write_text(text)
    script = folder / "again.yaml"
    arguments = [str(tables), "-o", str(script)]
    run = CliRunner().invoke(import_, arguments, standalone_mode=False)
    assert run.return_value == 0, run.output
    log = script.with_suffix(".mcap")
    arguments = [str(script), "-o", str(log), "-q", "-j", "1"]
    run = CliRunner().invoke(compile_, arguments, standalone_mode=False)
    assert run.return_value == 0, run.output
    return tables, log


def test_a_dance_is_solved_again_and_proved(again):
    _, log = again
    assert verify_log(log, jobs=1).proved
    kinds = [leg.kind for leg in read_log(log).segments]
    assert kinds.count("motion") == 1


def test_a_dance_is_flown_as_it_was_recorded(again):
    tables, log = again
    flown = read_log(log)
    exact = tracks_of(solved_show(flown))
    leg = next(one for one in flown.segments if one.kind == "motion")
    recorded = read_show(tables).tracks
    begin, _ = holds(recorded)[1]
    for late in np.linspace(0.0, leg.duration - 0.2, 20).tolist():
        # The ramp of 0.2 s sets in and ends: what is between is half of it late.
        wanted = place_at(recorded, begin + late)
        near = place_at(exact, leg.start + late + 0.1)[:, :3]
        off = np.linalg.norm(near[:, None] - wanted[None], axis=2).min(axis=1)
        assert off.max() < 0.02


def test_gains_are_told_of_the_transitions_alone(again):
    run = CliRunner().invoke(diff, [str(one) for one in again], standalone_mode=False)
    flights = [line for line in run.output.splitlines() if line.startswith("from ")]
    assert [line.partition(" [s]")[0] for line in flights] == [
        "from on the ground to hold-1",
        "from hold-1 to hold-3",
        "from hold-3 to on the ground",
    ]
