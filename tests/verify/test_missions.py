"""Mission files: hashes, places, and an own geodesy against another library's."""

import hashlib
import json
import shutil
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from verified import loaded, manifest_of, proved_flight, written

from showc.log import showc_pb2 as pb
from showc.mission import mission_files
from showc.verify import verify_log
from showc.verify.geodesy import east_north_up, to_east_north_up
from showc.verify.missions import check_missions
from showc.verify.waypoints import MissionFormatError, parse

SAME = "VRF402"
HASHES = "VRF401"
ENDS = "VRF404"


def digest(content):
    return hashlib.sha256(content).hexdigest()


@pytest.fixture(scope="session")
def compiled_folder(tmp_path_factory):
    """A compiled show: log, manifest and missions."""
    flight = proved_flight()
    missions = mission_files(flight).files
    nothing = {"autopilot": "px4", "start": None, "warnings": [], "prediction": None}
    manifest = manifest_of(flight, nothing, missions)
    folder = tmp_path_factory.mktemp("compiled")
    write_folder(folder, missions, manifest)
    written(flight, folder / "output.mcap", manifest)
    return folder


def write_folder(folder, missions, manifest):
    for name, content in missions.items():
        path = folder / "output" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    (folder / "output" / "manifest.json").write_bytes(manifest)


@pytest.fixture
def folder(compiled_folder, tmp_path):
    return shutil.copytree(compiled_folder, tmp_path / "copy")


def failures(folder):
    verification = verify_log(folder / "output.mcap")
    return verification, {
        check.code for check in verification.checks if check.verdict == "fail"
    }


def replaced(folder, drone, change):
    """Change one mission file, and manifest and log so that all hashes fit."""
    path = folder / "output" / "missions" / f"drone_{drone:04d}.waypoints"
    content = change(path.read_bytes())
    path.write_bytes(content)
    manifest_path = folder / "output" / "manifest.json"
    manifest = json.loads(manifest_path.read_bytes())
    manifest["missions"]["files"][f"missions/{path.name}"] = digest(content)
    manifest_path.write_bytes(json.dumps(manifest).encode())
    written(proved_flight(), folder / "output.mcap", manifest_path.read_bytes())


def with_field(command, column, change, which=0):
    """Change one field of the row number ``which`` with a command."""

    def edit(content):
        rows = [line.split("\t") for line in content.decode().splitlines()]
        found = [row for row in rows[2:] if row[3] == str(command)]
        found[which][column] = change(found[which][column])
        return "\n".join("\t".join(row) for row in rows).encode() + b"\n"

    return edit


def test_a_compiled_show_passes_whole(folder):
    verification, found = failures(folder)
    assert found == set()
    assert verification.exit_code == 0
    assert verification.check(ENDS).value < 1.0
    assert verification.check(HASHES).value >= 4


def test_no_folder_is_a_finding(folder):
    shutil.rmtree(folder / "output")
    verification, found = failures(folder)
    assert found == {HASHES}
    assert verification.exit_code == 1
    assert verify_log(folder / "output.mcap", missions=False).exit_code == 0


def test_a_changed_file_is_found(folder):
    path = folder / "output" / "missions" / "drone_0002.waypoints"
    path.write_bytes(path.read_bytes().replace(b"\t22\t", b"\t16\t"))
    verification, found = failures(folder)
    assert HASHES in found
    assert "drone_0002" in str(verification.check(HASHES).where)


def test_a_missing_file_is_found(folder):
    (folder / "output" / "missions" / "drone_0003.waypoints").unlink()
    assert HASHES in failures(folder)[1]


def test_a_file_too_many_is_found(folder):
    (folder / "output" / "missions" / "drone_0099.waypoints").write_text(
        "QGC WPL 110\n"
    )
    assert HASHES in failures(folder)[1]


def test_a_manifest_of_another_compile_is_found(folder):
    path = folder / "output" / "manifest.json"
    path.write_bytes(path.read_bytes() + b"\n")
    assert SAME in failures(folder)[1]


@pytest.mark.parametrize(
    ("column", "shift"),
    [(8, 3e-7), (8, -3e-7), (9, 4e-7), (10, 0.03), (10, -0.03)],
)
def test_a_moved_waypoint_is_found_though_all_hashes_fit(folder, column, shift):
    replaced(
        folder,
        2,
        with_field(16, column, lambda text: f"{float(text) + shift:.8f}", which=1),
    )
    verification, found = failures(folder)
    assert found == {ENDS}
    assert verification.check(ENDS).where.drone == 2


def test_a_landing_beside_the_pad_is_found(folder):
    replaced(folder, 1, with_field(21, 9, lambda text: f"{float(text) + 5e-7:.8f}"))
    assert failures(folder)[1] == {ENDS}


def test_a_mission_in_another_frame_is_found(folder):
    replaced(folder, 1, with_field(16, 2, lambda _: "0"))
    assert ENDS in failures(folder)[1]


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"QGC WPL 120\n",
        b"QGC WPL 110\n0\t1\t0\n",
        b"QGC WPL 110\n"
        + b"\t".join([b"0", b"1", b"0", b"16"] + [b"nan"] * 7 + [b"1"]),
        b"QGC WPL 110\n" + b"\t".join([b"3", b"1", b"0", b"16"] + [b"0"] * 7 + [b"1"]),
        b"\xff\xfe",
    ],
)
def test_a_file_that_is_no_mission_is_found(folder, content):
    with pytest.raises(MissionFormatError):
        parse(content)
    replaced(folder, 1, lambda _: content)
    assert ENDS in failures(folder)[1]


@pytest.mark.parametrize("name", ["../secret", "/etc/passwd", "missions/../../x"])
def test_a_manifest_cannot_point_outside(folder, name):
    manifest_path = folder / "output" / "manifest.json"
    manifest = json.loads(manifest_path.read_bytes())
    manifest["missions"]["files"][name] = "0" * 64
    manifest_path.write_bytes(json.dumps(manifest).encode())
    written(proved_flight(), folder / "output.mcap", manifest_path.read_bytes())
    verification, _ = failures(folder)
    assert not any(
        name in note for check in verification.checks for note in check.notes
    )


@settings(deadline=None, max_examples=100, derandomize=True)
@given(
    st.floats(-80.0, 80.0),
    st.floats(-180.0, 180.0),
    st.floats(-100.0, 4000.0),
    st.floats(0.0, 360.0),
    st.tuples(st.floats(-2000, 2000), st.floats(-2000, 2000), st.floats(-5, 500)),
)
def test_geodesy_agrees_with_another_library(
    latitude, longitude, altitude, heading, point
):
    import pymap3d

    site = pb.Site(
        latitude=latitude, longitude=longitude, altitude=altitude, heading=heading
    )
    enu = to_east_north_up(site, np.array(point))
    # The show frame's y axis points along the heading.
    ahead = to_east_north_up(site, np.array([0.0, 1.0, 0.0]))
    bearing = np.degrees(np.arctan2(ahead[0], ahead[1])) % 360.0
    assert abs((bearing - heading + 180.0) % 360.0 - 180.0) < 1e-9
    geodetic = pymap3d.enu2geodetic(*enu, latitude, longitude, altitude)
    np.testing.assert_allclose(east_north_up(site, *geodetic), enu, atol=1e-5)


NUMBERS = [
    "0",
    "-1",
    "1e308",
    "-1e308",
    "99999999999999999999",
    "1e-320",
    "181",
    "7",
    "x",
]


@settings(
    deadline=None,
    max_examples=60,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    row=st.integers(0, 40),
    column=st.integers(0, 11),
    text=st.sampled_from(NUMBERS),
    drop=st.booleans(),
)
def test_whatever_stands_in_a_mission_raises_nothing(folder, row, column, text, drop):
    """Altered after compiling, hashes and all: findings, never a traceback."""
    path = folder / "output" / "missions" / "drone_0001.waypoints"
    content = path.read_bytes()
    rows = [line.split("\t") for line in content.decode().splitlines()]
    chosen = 1 + row % (len(rows) - 1)
    if drop:
        del rows[chosen]
    else:
        rows[chosen][column] = text
    altered = "\n".join("\t".join(fields) for fields in rows).encode() + b"\n"
    path.write_bytes(altered)
    log, show = loaded(folder / "output.mcap")
    checks = check_missions(log, show)
    path.write_bytes(content)
    found = {check.code for check in checks if check.verdict == "fail"}
    assert (HASHES in found) == (altered != content)


@settings(
    deadline=None,
    max_examples=60,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    st.recursive(
        st.none()
        | st.booleans()
        | st.floats()
        | st.sampled_from(["ardupilot", "px4", "2026-06-01T20:00:00Z"]),
        lambda inner: (
            st.lists(inner, max_size=3)
            | st.dictionaries(
                st.sampled_from(
                    ["missions", "show", "files", "legs", "prediction", "closest"]
                    + ["autopilot", "start", "missions/drone_0001.waypoints"]
                ),
                inner,
                max_size=4,
            )
        ),
        max_leaves=12,
    )
)
def test_whatever_stands_in_a_manifest_raises_nothing(folder, manifest):
    content = json.dumps(manifest).encode()
    (folder / "output" / "manifest.json").write_bytes(content)
    log, show = loaded(folder / "output.mcap")
    other = SimpleNamespace(path=log.path, attachment=lambda _: content)
    found = {c.code for c in check_missions(other, show) if c.verdict == "fail"}
    assert HASHES in found
    assert SAME not in found
