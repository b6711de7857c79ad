"""Shows of others as scripts: what they hold is what the script shows."""

import json

import numpy as np
import pytest
import yaml
from click.testing import CliRunner
from synthetic import gliding_flight

from showc.cli.diff import command as diff
from showc.cli.import_ import command as import_
from showc.errors import UsageError
from showc.foreign.acts import holds
from showc.foreign.reading import read_show
from showc.foreign.script import import_show, pictures
from showc.foreign.show import (
    Declared,
    FencePolygon,
    ForeignShow,
    LightTrack,
    Location,
    fleet,
    polyline,
)
from showc.log.writer import write_log
from showc.script import load_show


def staged(**more):
    """Two drones: up, a picture for 3 s, another for 2 s, and down."""
    times = np.array([0.0, 2.0, 6.0, 9.0, 13.0, 15.0, 20.0])
    heights = np.array([0.0, 0.0, 12.0, 12.0, 15.0, 15.0, 0.0])
    courses = []
    for x in (0.0, 5.0):
        shift = np.array([0.0, 0.0, 0.0, 0.0, 2.0, 2.0, 0.0]) * (1.0 + x)
        places = np.stack([np.full(7, x), shift, heights], axis=1)
        courses.append(polyline(times, places))
    red = LightTrack(np.array([0.0, 7.0, 7.0, 20.0]), np.array(
        [[0, 0, 0], [0, 0, 0], [255, 0, 0], [255, 0, 0]], dtype=float))  # fmt: skip
    return ForeignShow(
        "staged.skyc",
        ".skyc",
        "Staged: a 'show'",
        ("a", "b"),
        fleet(courses),
        lights=(red, None),
        **more,
    )


def test_holds_are_where_no_drone_moves():
    assert holds(staged().tracks) == [(0.0, 2.0), (6.0, 9.0), (13.0, 15.0)]


def test_pictures_are_the_holds_in_the_air():
    first, second = pictures(staged())
    assert (first.begin, first.end) == (6.0, 9.0)
    assert first.places == pytest.approx(np.array([[0, 0, 12], [5, 0, 12]]))
    assert second.places[:, 1] == pytest.approx([2.0, 12.0])
    # A drone without a program is dark.
    assert first.colours.tolist() == [[255, 0, 0], [0, 0, 0]]


def test_instants_that_are_asked_for_become_pictures_too():
    found = pictures(staged(), [11.0])
    assert [picture.begin for picture in found] == [6.0, 11.0, 13.0]
    for outside in (-1.0, 1000.0):
        with pytest.raises(UsageError, match="no time of the show; wanted 0 to 20 s"):
            pictures(staged(), [11.0, outside])


def test_a_show_that_never_holds_asks_for_instants():
    course = polyline(np.array([0.0, 10.0]), np.array([[0.0, 0, 0], [0, 0, 30.0]]))
    show = ForeignShow("a.csv", "CSV", "a", ("1",), fleet([course]))
    with pytest.raises(UsageError, match="--at"):
        import_show(show, "a")
    assert len(import_show(show, "a", [5.0]).pictures) == 1


def test_the_script_is_sound_and_shows_the_pictures(tmp_path):
    show = staged(
        declared=Declared(60.0, 7.0, 2.0, 3.0, 2.5),
        fences=(
            FencePolygon(
                True, np.array([[-40.0, -40], [40, -40], [40, 40], [-40, 40]])
            ),
        ),
        location=Location(52.5, 13.4, 40.0, 120.0),
    )
    imported = import_show(show, "night")
    for name, table in imported.tables.items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(table)
    (tmp_path / "night.yaml").write_text(imported.script)
    result = load_show(tmp_path / "night.yaml")
    assert result.show is not None, [str(one) for one in result.diagnostics]
    loaded = result.show
    assert loaded.name == show.title
    assert loaded.drones == 2 and loaded.separation.distance == 2.5
    assert loaded.site.heading == pytest.approx(30.0)
    assert loaded.limits.velocity_max[2] == 3.0
    assert loaded.limits.velocity_min[2] == -2.0
    for picture in imported.pictures:
        formation = loaded.formations[picture.name]
        assert formation.points == pytest.approx(picture.places, abs=1e-3)
    assert [one.hold for one in loaded.transitions] == [3.0, 2.0]
    assert yaml.safe_load(imported.script)["site"]["fence"][0] == [-40.0, -40.0]


def test_what_is_not_in_the_script_is_said():
    lost = " ".join(import_show(staged(), "x").lost)
    assert "15.0 s of 20.0 s" in lost and "assigned anew" in lost and "lights" in lost


def test_why_a_moving_picture_has_no_frames_is_said():
    times = np.arange(0.0, 21.0)
    courses = [
        polyline(times, np.stack([times, 9.0 * np.sin(times), 20.0 + 0.0 * times], 1))
    ]
    show = ForeignShow("a.csv", "CSV", "a", ("1",), fleet(courses))
    (why,) = [
        one for one in import_show(show, "x", (), [(5, 15)]).lost if "move-1" in one
    ]
    assert why.endswith("the file's rows are 1.0 s apart; wanted 0.5 s or less")


def test_our_own_export_comes_back(tmp_path):
    from io import BytesIO

    from showc.export.solved import solved_show
    from showc.export.stage import ExportOptions, export
    from showc.log.reader import read_log
    from showc.log.writer import write_log

    stream = BytesIO()
    write_log(gliding_flight(9), stream, manifest=b'{"files": {}}\n')
    solved = solved_show(read_log(stream.getvalue()))
    source = {"log": "x", "sha256": "0"}
    written = export(solved, source, "skyc", tmp_path / "c", ExportOptions(10.0))
    show = read_show(written.folder)
    found = pictures(show)
    shapes = list(solved.rules.formations)[1:]
    wanted = {
        name: np.array(points).reshape(-1, 3)
        for name, points in ((shape.name, shape.points) for shape in shapes)
    }
    for places in wanted.values():
        off = min(
            np.abs(np.sort(picture.places, axis=0) - np.sort(places, axis=0)).max()
            for picture in found
        )
        assert off < 0.01
    assert json.dumps(import_show(show, "c").script)


def table_of(folder, swap):
    """Two drones that go up, swap sides within ``swap`` [s] and come down."""
    folder.mkdir()
    times = np.cumsum([0.0, 2.0, 5.0, 3.0, swap, 2.0, 6.0])
    heights = [0, 0, 10, 10, 10, 10, 0]
    for side in (-1, 1):
        across = side * np.array([4, 4, 4, 4, -4, -4, -4])
        rows = [
            f"{1000 * time:.0f},{x},{side},{z}"
            for time, x, z in zip(times, across, heights, strict=True)
        ]
        (folder / f"{side}.csv").write_text("\n".join(rows) + "\n")
    return folder


def test_diff_says_what_each_flight_gains(tmp_path):
    slow, fast = table_of(tmp_path / "slow", 8.0), table_of(tmp_path / "fast", 5.0)
    run = CliRunner().invoke(diff, [str(slow), str(fast)], standalone_mode=False)
    assert run.return_value == 1
    assert run.output.splitlines() == [
        "from hold-1 to hold-2 [s]: 8.0 -> 5.0",
        "the flights of both, 16 % less [s]: 19.0 -> 16.0",
    ]
    same = CliRunner().invoke(diff, [str(slow), str(slow)], standalone_mode=False)
    assert (same.return_value, same.output) == (0, "both shows are the same\n")


def test_diff_holds_a_file_against_a_log(tmp_path):
    log = tmp_path / "show.mcap"
    flight = gliding_flight(4, moves=2)
    with log.open("wb") as stream:
        write_log(flight, stream, manifest=b"{}")
    moves = [one for one in flight.legs if one.leg.kind == "transition"]
    legs = {one.leg.to_formation: one for one in moves}
    run = CliRunner().invoke(
        diff,
        [str(table_of(tmp_path / "slow", 8.0)), str(log), "--json"],
        standalone_mode=False,
    )
    found = {one["what"]: one for one in json.loads(run.output)["differences"]}
    assert found["from hold-1 to hold-2 [s]"]["after"] is None
    move = found["from sphere-1 to helix-2 [s]"]
    assert move["before"] is None
    assert move["after"] == pytest.approx(legs["helix-2"].duration, abs=1e-3)


def test_an_imported_script_leaves_room_for_what_compile_writes(tmp_path):
    source, output = table_of(tmp_path / "slow", 8.0), tmp_path / "again.yaml"
    run = CliRunner().invoke(
        import_, [str(source), "-o", str(output)], standalone_mode=False
    )
    assert run.return_value == 0 and f"showc diff {source}" in run.output
    assert load_show(output).show is not None
    assert not (tmp_path / "again").exists()
    assert (tmp_path / "again-formations" / "hold-1.csv").exists()


def test_an_imported_script_that_check_refuses_is_not_handed_to_compile(
    tmp_path, monkeypatch
):
    source, output = table_of(tmp_path / "slow", 8.0), tmp_path / "again.yaml"

    def spoilt(path):
        path.write_text(path.read_text().replace("showc: 1", "showc: 1\nlog_rate: -1"))
        return load_show(path)

    monkeypatch.setattr("showc.script.load_show", spoilt)
    run = CliRunner().invoke(
        import_, [str(source), "-o", str(output)], standalone_mode=False
    )
    assert "4 findings of showc check" in run.output
    assert f"next: showc check {output}, and mend" in run.output
    assert "showc compile" not in run.output
