"""Moving formations are proved from the script, by a derivation of verify's own."""

from dataclasses import replace

import numpy as np
import pytest
from findings import failed
from verified import loaded, strays

from showc.pipeline.compile import CompileOptions, RejectedScriptError, compile_script
from showc.script import load_show
from showc.script.show import Rotate
from showc.verify import verify_log
from showc.verify.kernel.show import PieceTable
from showc.verify.specification.demands import hold_against

SCRIPT = """\
showc: 1
name: Moving
drones: 4
separation: 1.5
launch: {altitude: 8, hold: 1}
groups: {pair: [1, 2]}
formations:
  ring: {type: circle, radius: 6, centre: [0, 0, 16]}
  big: {type: circle, radius: 8, centre: [0, 0, 18]}
  row: {type: line, length: 5, centre: [16, 0, 14]}
transitions:
  - to: ring
    hold: 16
    motion:
      - rotate: 120 deg
      - {wave: {amplitude: 0.6, period: 6, wavelength: 15}}
      - breathe: {scale: 1.2, period: 8}
  - to: ring
    assignment: keep
    hold: 14
    motion: [{morph: [big]}, {travel: [[0, 3, 0], [0, 0, 0]]}]
  - to: row
    group: pair
    hold: 12
    motion: [{orbit: {radius: 0.8, axis: x, wavelength: 20}}]
  - {to: big, at: 90}
"""
MOVING = (3, 5, 7)


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    folder = tmp_path_factory.mktemp("moving")
    script = folder / "moving.yaml"
    script.write_text(SCRIPT)
    compile_script(script, folder / "output.mcap", CompileOptions(missions=False))
    return folder


def test_motions_are_proved_from_the_script(compiled):
    verification = verify_log(compiled / "output.mcap", script=compiled / "moving.yaml")
    assert failed(verification) == set()
    _, logged = loaded(compiled / "output.mcap")
    kinds = [
        segment.message.Kind.Name(segment.message.kind) for segment in logged.segments
    ]
    assert [at for at, kind in enumerate(kinds) if kind == "MOTION"] == list(MOVING)
    # The last arrival is in time, although a formation moves before it.
    ends = [one.end for one in logged.segments if one.message.name.endswith("-> big")]
    assert ends[0] == 90.0


def test_the_error_of_the_polynomials_is_stated(compiled):
    _, logged = loaded(compiled / "output.mcap")
    for number in MOVING:
        stated = logged.segments[number].message.certificate.statistics
        assert 0.0 < stated["motion_error"] <= 1e-5


def test_drones_keep_the_numbers_of_their_places(compiled):
    _, logged = loaded(compiled / "output.mcap")
    show = load_show(compiled / "moving.yaml").show
    places = [list(logged.segments[at].message.places) for at in (2, 4)]
    assert places[0] == places[1] != sorted(places[0])
    fixed = replace(show.transitions[1], assignment="fixed")
    asked = (show.transitions[0], fixed, *show.transitions[2:])
    assert hold_against(show, logged).places == []
    assert hold_against(replace(show, transitions=asked), logged).places


def with_motion(compiled, change):
    """What is found if the script asked for another motion of the first ring."""
    _, logged = loaded(compiled / "output.mcap")
    show = load_show(compiled / "moving.yaml").show
    first = show.transitions[0]
    asked = replace(first, motion=change(first.motion))
    return hold_against(
        replace(show, transitions=(asked, *show.transitions[1:])), logged
    )


@pytest.mark.parametrize(
    "change",
    [
        lambda motion: (replace(motion[0], ramp=3.01), *motion[1:]),
        lambda motion: (motion[0], replace(motion[1], period=6.01), motion[2]),
        lambda motion: (motion[0], replace(motion[1], wavelength=15.1), motion[2]),
        lambda motion: (*motion[:2], replace(motion[2], scale=1.201)),
        lambda motion: motion[:2],
        lambda motion: (motion[2], *motion[:2]),
        lambda motion: (replace(motion[0], angle=motion[0].angle + 0.001), *motion[1:]),
        lambda motion: (
            Rotate(motion[0].angle, (0, 0, 1), (0.01, 0, 0), 3.0),
            *motion[1:],
        ),
    ],
)
def test_another_motion_is_not_the_one_flown(compiled, change):
    assert strays(with_motion(compiled, lambda motion: motion)) == []
    assert len(strays(with_motion(compiled, change))) == 1


def wrong_where_drone_4_stands(compiled, change):
    """What is found if ``change`` makes another table of the last motion."""
    _, logged = loaded(compiled / "output.mcap")
    segments = list(logged.segments)
    segment = segments[MOVING[2]]
    segments[MOVING[2]] = replace(segment, table=change(segment.table))
    show = load_show(compiled / "moving.yaml").show
    return strays(hold_against(show, replace(logged, segments=tuple(segments))))


@pytest.mark.parametrize(
    ("component", "size", "said"), [(0, 0.01, "drone 4 may be"), (8, 0.7, "4 turns")]
)
def test_a_drone_that_should_stand_still_may_not_move(compiled, component, size, said):
    def change(table):
        state = table.state.copy()
        state[table.owner == 3, 1:-1, component] += size
        return replace(table, state=state)

    (wrong,) = wrong_where_drone_4_stands(compiled, change)
    assert said in wrong


def test_a_drone_that_creeps_between_the_instants_that_are_looked_at(compiled):
    """Two straight lines, there and back: the second difference of each is nought."""

    def change(table):
        drone = table.owner == 3
        others, own = table.chosen(~drone), table.chosen(drone)
        state = np.repeat(own.state[:1], 2, axis=0)
        way = np.linspace(0.0, 5e-3, state.shape[1])
        state[0, :, 0] += way
        state[1, :, 0] += way[::-1]
        bent = replace(
            own,
            first=np.array([0, 2]),
            start=own.end[-1] * np.array([0.0, 0.3]),
            end=own.end[-1] * np.array([0.3, 1.0]),
            state=state,
            control=np.repeat(own.control[:1], 2, axis=0),
        )
        return PieceTable.joined([others, bent])

    (wrong,) = wrong_where_drone_4_stands(compiled, change)
    assert "drone 4 may be 0.005" in wrong


def test_a_flight_that_would_take_minutes_to_look_at_is_refused(compiled):
    """It bends so much that instants would have to be nanoseconds apart."""

    def change(table):
        state = table.state.copy()
        own = np.flatnonzero(table.owner == 3)[0]
        state[own, 1:-1:2, 0] += 1e13
        return replace(table, state=state)

    (wrong,) = wrong_where_drone_4_stands(compiled, change)
    assert "drone 4 may be inf" in wrong


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("rotate: 120 deg", "rotate: 2000 deg", "acceleration"),
        ("scale: 1.2", "scale: 0.12, ramp: 3", "the separation is 1.5 m"),
        ("amplitude: 0.6", "amplitude: 40", "acceleration"),
    ],
)
def test_a_motion_that_cannot_be_flown_is_refused_before_the_solve(
    tmp_path, old, new, said
):
    assert old in SCRIPT
    script = tmp_path / "moving.yaml"
    script.write_text(SCRIPT.replace(old, new))
    with pytest.raises(RejectedScriptError) as refused:
        compile_script(script, tmp_path / "o.mcap", CompileOptions(missions=False))
    assert [said in one.message for one in refused.value.result.errors] == [True]


def test_a_motion_of_minutes_follows_frames_and_is_proved(tmp_path):
    """Without windows a bound of five minutes is a hundred times what is allowed."""
    times = np.arange(0.0, 300.0, 0.5)
    turns = [0.05 * times + np.pi * place for place in range(2)]
    rows = [
        f"{time:g},{place + 1},{6 * np.cos(turn):.4f},{6 * np.sin(turn):.4f},18"
        for place, along in enumerate(turns)
        for time, turn in zip(times, along, strict=True)
    ]
    (tmp_path / "dance.csv").write_text("time,place,x,y,z\n" + "\n".join(rows))
    script = tmp_path / "long.yaml"
    script.write_text(
        "showc: 1\nseparation: 1.5\nlog_rate: 2\n"
        "formations: {it: {type: frames, file: dance.csv}}\ntransitions:\n"
        "  - {to: it, motion: [{follow: dance.csv}, {wave: 0.5}]}\n"
    )
    log = tmp_path / "long.mcap"
    compile_script(script, log, CompileOptions(missions=False))
    found = verify_log(log)
    assert found.proved, [one for one in found.checks if one.verdict == "fail"]


@pytest.mark.parametrize(
    "moves",
    [
        """{to: it, hold: 8, motion: [{rotate: 90}], leave: moving}
  - {to: it, duration: 15}""",
        "{to: it, hold: 8, arrive: moving, duration: 10, motion: [{rotate: 90}]}",
    ],
)
def test_a_drone_in_the_middle_of_what_turns_stays_and_is_proved(tmp_path, moves):
    script, log = tmp_path / "middle.yaml", tmp_path / "middle.mcap"
    script.write_text(
        "showc: 1\nlaunch: {altitude: 10}\nlanding: {altitude: 10}\n"
        "formations: {it: {type: points, points: [[0, 0, 10]]}}\n"
        f"transitions:\n  - {moves}\n"
    )
    compile_script(script, log, CompileOptions(missions=False))
    found = verify_log(log)
    assert found.proved, found.verdict
