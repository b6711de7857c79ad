"""The other formats: what is read back is what was solved, within the stated error."""

import csv
import io
import json
import shutil
import struct
import zipfile
from decimal import Decimal
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from showc.errors import ExportError
from showc.export.error import error_of, error_of_lines
from showc.export.fit import fit_fleet, tracks_of
from showc.export.stage import FORMATS, WAITING, ExportOptions, export
from showc.export.tables import (
    HEADING,
    Samples,
    crazyflie_files,
    decimals,
    rows_of,
    uniform,
)
from showc.export.takeoff import slowed
from showc.foreign.facts import own_rules
from showc.foreign.folder import verify_export
from showc.foreign.motion import derivative, jumps, place_at
from showc.foreign.reading import read_show
from showc.view.foreign import Judged, foreign_scene

SOURCE = {"log": "show.mcap", "data_sha256": "0" * 64}
DRAWN = sorted(set(FORMATS) - {"kml"})


@pytest.fixture(scope="module")
def exports(gliding, tmp_path_factory):
    folder = tmp_path_factory.mktemp("formats")
    return {
        form: export(gliding, SOURCE, form, folder / form, ExportOptions.usual(form))
        for form in FORMATS
    }


def followed(show, form):
    """Flights as a format has them, and when they begin in its file [s].

    In formats that are flown the launch is slower, and begins earlier.
    """
    lead = ExportOptions.usual(form).lead
    flown = slowed(show, lead) if form in WAITING else show
    return tracks_of(flown), lead - flown.early


@pytest.mark.parametrize("form", DRAWN)
def test_what_is_read_back_is_within_the_stated_error(gliding, exports, form):
    written = exports[form].written
    read = read_show(exports[form].folder)
    exact, begin = followed(gliding, form)
    assert read.drones == gliding.drones
    for time in np.linspace(0.0, exact.end, 157):
        off = place_at(read.tracks, time + begin) - place_at(exact, time)[:, :3]
        size = np.sqrt((off**2).sum(axis=1)).max()
        assert size <= written.position_error + 1e-6


@pytest.mark.parametrize("form", sorted(FORMATS))
def test_verify_proves_every_format_from_its_bytes(exports, form):
    found = verify_export(exports[form].folder)
    wanted = [check for check in exports[form].checks if check.verdict == "fail"]
    assert [check for check in found.checks if check.verdict == "fail"] == wanted
    assert found.check("VRF581").verdict == "pass"


@pytest.mark.parametrize("form", sorted(FORMATS))
def test_every_format_says_what_it_cannot_carry(exports, form):
    assert exports[form].written.lost


@pytest.mark.parametrize("form", ["skyc", "skyb", "poly7", "crazyflie", "gltf"])
def test_velocity_goes_on_in_every_smooth_format(exports, form):
    _, off = jumps(derivative(read_show(exports[form].folder).tracks))
    assert np.abs(off).max() < 1e-4


def test_pieces_of_degree_seven_have_three_derivatives(exports):
    tracks = read_show(exports["poly7"].folder).tracks
    for bound in (1e-6, 1e-5, 1e-4, 1e-2):
        _, off = jumps(tracks)
        assert np.abs(off).max() < bound
        tracks = derivative(tracks)


def test_pieces_have_the_columns_that_their_readers_load(exports):
    for path in sorted(exports["poly7"].folder.glob("*.csv")):
        rows = np.loadtxt(path, delimiter=",", skiprows=1, usecols=range(33))
        assert rows.ndim == 2 and rows.shape[0] >= 2 and rows.shape[1] == 33


def test_tables_have_the_heading_that_importers_demand(exports):
    with zipfile.ZipFile(exports["skybrush-csv"].folder / "show.zip") as archive:
        names = archive.namelist()
        text = archive.read(names[0]).decode()
    assert names == [f"drone_{drone:04d}.csv" for drone in range(1, 10)]
    rows = list(csv.reader(io.StringIO(text)))
    assert ",".join(rows[0]) == HEADING
    times = [int(row[0]) for row in rows[1:]]
    assert times == list(range(0, 50 * len(times), 50))
    assert all(0 <= int(value) <= 255 for row in rows[1:] for value in row[4:])


def test_lights_of_tables_and_visualisations_are_those_of_the_show(gliding, exports):
    for form in ("skybrush-csv", "vviz"):
        read = read_show(exports[form].folder)
        for drone, light in enumerate(read.lights):
            assert light is not None
            shown = light.at(light.times)
            row = np.searchsorted(gliding.light_times, light.times + 1e-9, "right") - 1
            wanted = gliding.lights[row, drone]
            assert np.abs(shown - wanted).max() <= 1.0


def test_lights_of_a_scene_fade_as_those_of_the_show(gliding, exports):
    read = read_show(exports["gltf"].folder)
    assert len({light.colours.tobytes() for light in read.lights}) > 1
    for drone, light in enumerate(read.lights):
        # Between frames of 20 ms, where a jump may lie, nothing is stated.
        moments = np.round(gliding.light_times, 2)
        row = np.searchsorted(gliding.light_times, moments + 1e-9, "right") - 1
        off = np.abs(light.at(moments) - gliding.lights[row, drone]).max(axis=1)
        assert np.mean(off > 5.0) < 0.02


# Bytes that cflib 0.1.34 packs: CompressedStart(0.1, -0.25, 0, 0), then segments of
# half a second (x cubic, z cubic) and of 1.25 s at rest.
CFLIB = bytes.fromhex("640006ff0000000022f401640096002c010000c800900100e204")


def test_compressed_trajectories_are_read_as_cflib_packs_them(tmp_path):
    (tmp_path / "1.traj").write_bytes(CFLIB)
    tracks = read_show(tmp_path).tracks
    assert tracks.position[0][:, 0] == pytest.approx([0.1, 0.1, 0.15, 0.3])
    assert tracks.position[0][:, 2] == pytest.approx([0.0, 0.0, 0.2, 0.4])
    assert tracks.position[1][:, 0] == pytest.approx(0.3)
    assert tracks.ends == pytest.approx([0.5, 1.75])


def test_cflib_packs_the_same_bytes(exports):
    memory = pytest.importorskip("cflib.crazyflie.mem.trajectory_memory")
    for path in sorted(exports["crazyflie"].folder.glob("*.traj")):
        content = path.read_bytes()
        x, y, z, yaw = struct.unpack_from("<4h", content)
        start = [value / 1000.0 + np.sign(value) * 1e-7 for value in (x, y, z)]
        packed = bytes(memory.CompressedStart(*start, np.radians(yaw / 10.0)).pack())
        position = 8
        while position < len(content):
            header, duration = struct.unpack_from("<BH", content, position)
            position += 3
            elements = []
            for axis in range(4):
                count = (0, 1, 3, 7)[(header >> (2 * axis)) & 3]
                values = struct.unpack_from(f"<{count}h", content, position)
                # cflib drops fractions: none may be left by the last bit of a float.
                elements.append([v / 1000.0 + np.sign(v) * 1e-7 for v in values])
                position += 2 * count
            seconds = duration / 1000.0 + 1e-7
            packed += bytes(memory.CompressedSegment(seconds, *elements).pack())
        assert packed == content


def test_a_show_too_wide_for_a_millimetre_grid_is_refused(gliding):
    fitted = fit_fleet(gliding, lead=0.0)
    wide = np.full_like(fitted.scale, 2)
    from dataclasses import replace

    with pytest.raises(ExportError, match=r"32\.767 m"):
        crazyflie_files(replace(fitted, scale=wide))


def test_times_of_a_scene_never_run_below_zero(exports):
    content = (exports["gltf"].folder / "show.glb").read_bytes()
    size = struct.unpack_from("<I", content, 12)[0]
    top = json.loads(content[20 : 20 + size])
    assert struct.unpack_from("<4sII", content)[2] == len(content)
    inputs = {
        sampler["input"]
        for animation in top["animations"]
        for sampler in animation["samplers"]
    }
    assert min(top["accessors"][index]["min"][0] for index in inputs) >= 0.0
    assert all(view["byteOffset"] % 4 == 0 for view in top["bufferViews"])


def test_a_map_has_pads_ways_and_the_volume_where_the_site_is(gliding, exports):
    tree = ET.parse(exports["kml"].folder / "show.kml")  # noqa: S314 - ours
    space = "{http://www.opengis.net/kml/2.2}"
    folders = [one.findtext(f"{space}name") for one in tree.iter(f"{space}Folder")]
    assert folders == ["Flight volume", "Fence", "Pads", "Ways"]
    site = gliding.rules.site
    for element in tree.iter(f"{space}coordinates"):
        for point in element.text.split():
            longitude, latitude, _ = (float(value) for value in point.split(","))
            assert longitude == pytest.approx(site.longitude, abs=0.01)
            assert latitude == pytest.approx(site.latitude, abs=0.01)


def test_same_show_gives_the_same_bytes_in_every_format(gliding, exports, tmp_path):
    for form in FORMATS:
        options = ExportOptions.usual(form)
        again = export(gliding, SOURCE, form, tmp_path / form, options)
        assert again.written.files == exports[form].written.files


@pytest.mark.parametrize("form", DRAWN)
def test_a_page_plays_every_format_as_it_was_solved(gliding, exports, form, tmp_path):
    # As a stranger's: without the manifest that says whose it is.
    for file in exports[form].folder.iterdir():
        if file.name != "export.json" and file.suffix != ".parm":
            shutil.copy(file, tmp_path)
    show = read_show(tmp_path)
    nothing = {
        "checks": [],
        "passed": False,
        "proved": False,
        "verdict": "",
        "anchor": "",
    }
    scene = foreign_scene(Judged(show, nothing, [own_rules(show)]))
    flown, begin = followed(gliding, form)
    for frame in range(0, len(scene.positions), 40):
        time = min(max(frame * scene.step - begin, 0.0), flown.end)
        off = scene.positions[frame] - place_at(flown, time)[:, :3]
        assert np.linalg.norm(off, axis=1).max() < 0.06
    assert ("fence" in scene.unknown) == (form != "skyc")
    assert ("least separation" in scene.unknown) == (form != "skyc")
    assert ("lights" in scene.unknown) == (form in {"poly7", "crazyflie"})


@given(
    st.lists(st.integers(-(10**7), 10**7), min_size=1, max_size=20),
    st.integers(0, 4),
)
def test_numbers_are_written_as_python_writes_them(whole, places):
    columns = [decimals(np.array(whole), places), decimals(np.array(whole[::-1]), 0)]
    wanted = "".join(
        f"{Decimal(one).scaleb(-places):.{places}f},{other}\n"
        for one, other in zip(whole, whole[::-1], strict=True)
    )
    assert rows_of(columns).decode() == wanted


def test_lines_between_samples_miss_no_more_than_is_stated(gliding):
    samples = Samples.of(gliding, 0.0, 0.25)
    stated = error_of_lines(samples.exact, 0.25, 1e-3)
    places = np.stack([samples.places(drone) for drone in range(gliding.drones)])
    places = np.round(places, 3)
    lines = uniform(samples.times, np.stack([places[:, :-1], places[:, 1:]], axis=2))
    measured = error_of(samples.exact, lines, 0.0)
    assert measured.position.lower <= stated.position.upper
    assert measured.velocity.lower <= stated.velocity.upper
    assert measured.acceleration.lower <= stated.acceleration.upper
    assert stated.position.upper <= 2.0 * measured.position.upper
