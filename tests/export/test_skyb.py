"""Skybrush's binary files: our bytes, and what its own library answered to them."""

import contextlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from showc.errors import DamagedFileError, ExportError
from showc.export.fit import decoded, fit_fleet, kept_whole, waiting
from showc.export.lights import LightNodes, bytecode, light_nodes, varuint
from showc.export.skyb import (
    skyb_file,
    trajectory_block,
    yaw_block,
)
from showc.foreign.firmware import Firmware, phases
from showc.foreign.lights import FRAME, read_lights
from showc.foreign.motion import component, difference, greatest, length
from showc.foreign.show import fleet
from showc.foreign.skyb import checksum, read_skyb

# Blocks 1, 2, 5, 6 and 3; scale 3; libskybrush 4.2.0 answered what the tests below say.
GOLDEN = bytes.fromhex(
    "736b79620201278aeaa101580003204e68c5000000000088132070170000a00fa00f00e8032a401f2"
    "04ef6e5f6e568c510271027a00fbc34bc3411a00fa8e4c83200b88800b8882a2823a8e4204e204e10"
    "2768c568c5c832a00fa00f20e02ea00f0000000002220006fa010c0308ff8000320940190d03d8040"
    "40a141e640bc80107c8010564320a6400050f00008403881300007017c201401f7cfc061400c83200"
    "00010200000000803e00000102ffffffff030c0073686f776320676f6c64656e"
)
# The example of the .skyc format as a binary: 22 s, libskybrush 4.3.
EXAMPLE = bytes.fromhex(
    "736b7962020112d25735013600010000000000000000"
    "00d00720a00f000010271027"
    "2a8813d007a00f70170000b80bb80b1027e02ee02e00b80b15401f000000000000"
    "020f0004ff0000000800ff000064".replace("000064", "0064")
    + "02320a3200"
    + "0302006869"
)


def at(course, time):
    """Position, velocity and acceleration in mm, mm/s, mm/s²."""
    tracks = fleet([course])
    values = []
    from showc.foreign.motion import derivative, place_at

    for _ in range(3):
        values.append(1000.0 * place_at(tracks, time)[0])
        tracks = derivative(tracks)
    return values


@pytest.mark.parametrize(
    ("time", "place", "velocity", "acceleration"),
    [
        (6.5, (60000, -45000, 1875), (0, 0, 2250), (0, 0, 1000)),
        (8.0, (60000, -45000, 6000), (0, 0, 3000), (0, 0, 0)),
        (10.0, (60000, -45000, 11111.11), (0, 0, 1666.67), (0, 0, -1333.33)),
        (
            12.5,
            (59101.59, -44157.71, 12320.07),
            (-3515.54, 3295.90, 1252.44),
            (-6562.34, 6152.34, 2337.89),
        ),
        (16.0, (20001, -7500, 26250), (-14999.62, 14062.5, 5343.75), (0, 0, 0)),
        (22.0, (-20499, 30000, 39750), (-250.5, 0, -375), (0, 0, 0)),
        (60.0, (-21000, 30000, 39000), (0, 0, 0), (0, 0, 0)),
        (98.5, (19500, -7500, 25500), (13500, -12500, -4500), None),
        (115.0, (60000, -45000, 0), None, None),
    ],
)
def test_golden_file_plays_as_the_library_plays_it(time, place, velocity, acceleration):
    found = at(read_skyb(GOLDEN, "golden").course, time)
    for one, wanted in zip(found, (place, velocity, acceleration), strict=True):
        if wanted is not None:
            assert one == pytest.approx(wanted, abs=0.01)


def test_golden_file_takes_off_and_lands_as_the_library_says():
    golden = read_skyb(GOLDEN, "golden")
    firmware = Firmware(climb_speed=2.5, climb_acceleration=2.5, spool_up=0.0)
    found = phases(fleet([golden.course]), (golden.stored,), firmware)
    assert golden.course.times[-1] == 115.0
    assert found.above[0] == pytest.approx(6.7633, abs=1e-4)
    assert found.takeoff[0] == pytest.approx(4.7633, abs=1e-4)
    assert found.landing[0] == pytest.approx(111.4734, abs=1e-3)


@pytest.mark.parametrize(
    ("time", "colour"),
    [
        (2.0, (0, 0, 0)),
        (5.5, (127.5, 64, 0)),
        (6.0, (255, 128, 0)),
        (6.25, (159.5, 96, 32)),
        (6.5, (64, 64, 64)),
        (9.4, (102.2, 76.8, 51.2)),
        (11.0, (64, 64, 64)),
        (13.0, (10, 20, 30)),
        (15.0, (71.25, 78.75, 86.25)),
        (20.0, (255, 255, 255)),
        (22.5, (100, 100, 100)),
        (24.0, (50, 50, 50)),
        (25.0, (0, 0, 0)),
    ],
)
def test_golden_file_glows_as_the_library_shows_it(time, colour):
    track = read_lights(read_skyb(GOLDEN, "golden").lights, "golden", 115.0)
    # The library drops fractions of a step.
    assert track.at(np.array([time]))[0] == pytest.approx(colour, abs=1.0)


def test_golden_file_turns_as_the_library_says():
    yaw = read_skyb(GOLDEN, "golden").yaw
    found = np.interp([2.0, 6.0, 10.0, 12.0, 18.0, 20.0], yaw.times, yaw.angles)
    assert found == pytest.approx([90.0, 97.5, 127.5, 123.75, 56.25, 45.0])


def test_example_of_the_format_is_read_as_the_library_reads_it():
    example = read_skyb(EXAMPLE, "example")
    place, velocity, _ = at(example.course, 8.0)
    assert example.course.times[-1] == 22.0
    assert place == pytest.approx((2400, 1056, 10704), abs=0.01)
    assert velocity == pytest.approx((1200, 864, 576), abs=0.01)
    assert example.comment == "hi" and example.crc


def test_every_changed_byte_is_noticed():
    for position in range(6, len(EXAMPLE)):
        changed = bytearray(EXAMPLE)
        changed[position] ^= 0x10
        with pytest.raises(DamagedFileError):
            read_skyb(bytes(changed), "changed")


@given(st.binary(max_size=80))
def test_bytes_of_any_kind_are_read_or_refused(junk):
    for content in (junk, b"skyb\x01" + junk, b"skyb\x01\x01\x20\x00" + junk):
        with contextlib.suppress(DamagedFileError):
            assert read_skyb(content, "junk").course.position.size


@pytest.fixture(scope="module", params=["vertical", "gliding"])
def fitted(request):
    show = request.getfixturevalue(request.param)
    return fit_fleet(show, lead=10.0, tolerance=0.01)


def test_what_is_written_is_read_back_exactly(fitted):
    files = [
        skyb_file(trajectory_block(fitted, drone), b"\0", None, "test")
        for drone in range(fitted.drones)
    ]
    read = fleet([read_skyb(content, "ours").course for content in files])
    apart = difference(read, decoded(fitted))
    assert greatest(apart, length((0, 1, 2)), 1e-9).upper < 1e-8


def test_no_axis_is_ever_written_in_degree_seven(fitted):
    for drone in range(fitted.drones):
        block = trajectory_block(fitted, drone)
        stored = read_skyb(skyb_file(block, None, None, ""), "ours").stored
        assert set(np.unique(stored.degrees)) <= {0, 3}


def test_firmware_finds_the_takeoff_height_at_a_joint(fitted):
    read = [
        read_skyb(skyb_file(trajectory_block(fitted, drone), None, None, ""), "ours")
        for drone in range(fitted.drones)
    ]
    tracks = fleet([one.course for one in read])
    found = phases(tracks, tuple(one.stored for one in read), Firmware())
    for drone in range(fitted.drones):
        assert np.any(np.abs(read[drone].course.times - found.above[drone]) < 1e-9)


def test_a_climb_in_degree_seven_is_not_found_by_the_firmware():
    # The file of which libskybrush says: above inf, landing 12 m up.
    import struct

    climb = struct.pack("<BH7h", 0x30, 8000, *[0, 0, 0, 12000, 12000, 12000, 12000])
    descent = struct.pack("<BH7h", 0x30, 12000, *[12000, 12000, 12000, 0, 0, 0, 0])
    block = struct.pack("<B4h", 1, 0, 0, 0, 0) + climb + descent
    read = read_skyb(skyb_file(block, None, None, ""), "negative")
    found = phases(fleet([read.course]), (read.stored,), Firmware())
    assert np.isinf(found.above[0])
    assert found.landing[0] == 8.0 and found.landing_height[0] == pytest.approx(12.0)


@given(st.integers(0, 200_000))
def test_waiting_is_cut_into_durations_the_server_keeps(milliseconds):
    parts = waiting(milliseconds)
    assert sum(parts) == milliseconds
    assert all(kept_whole(part) and part <= 4_000 for part in parts)


def test_the_server_would_shorten_some_durations():
    lost = [whole for whole in range(1, 65_536) if not kept_whole(whole)]
    assert lost[:2] == [1001, 1003] and 2002 in lost
    assert len(lost) == 741


def test_a_block_that_is_too_long_is_refused():
    with pytest.raises(ExportError, match="65535"):
        skyb_file(bytes(65_536), None, None, "")


def test_checksum_is_that_of_third_party_files():
    assert (
        checksum(EXAMPLE[:6] + bytes(4) + EXAMPLE[10:]).to_bytes(4, "little")
        == (EXAMPLE[6:10])
    )


def test_yaw_is_written_in_steps_and_constants_without_any():
    assert yaw_block([90.0, 90.0, 90.0], [0, 1000, 2000]) == bytes.fromhex("008403")
    body = yaw_block([0.0, 7.5, -15.0], [0, 1000, 2000])
    read = read_skyb(skyb_file(bytes.fromhex("01" + "00" * 8), None, body, ""), "yaw")
    assert read.yaw.angles == pytest.approx([0.0, 7.5, -15.0])
    assert read.yaw.times == pytest.approx([0.0, 1.0, 2.0])


@given(
    st.lists(
        st.tuples(
            st.integers(1, 3000), st.tuples(*[st.integers(0, 255) for _ in range(3)])
        ),
        min_size=2,
        max_size=12,
    )
)
def test_programs_show_the_colours_they_are_made_of(steps):
    frames = np.cumsum([gap for gap, _ in steps])
    colours = np.array([colour for _, colour in steps], dtype=np.uint8)
    program = bytecode(LightNodes(frames, colours))
    track = read_lights(program, "ours", 1e4)
    # Just before the end, which is dark.
    moments = np.minimum(frames * FRAME, frames[-1] * FRAME - 1e-6)
    assert track.at(moments) == pytest.approx(colours, abs=0.02)
    assert track.at(np.array([frames[-1] * FRAME + 1.0]))[0] == pytest.approx(0.0)


def test_fades_stay_within_their_tolerance_of_the_samples(gliding):
    times = np.rint(gliding.light_times / FRAME) * FRAME
    times, kept = np.unique(times, return_index=True)
    lights = gliding.lights[kept]
    nodes = light_nodes(times, lights, 0.0)
    for drone, one in enumerate(nodes):
        shown = np.stack(
            [
                np.interp(times, one.frames * FRAME, one.colours[:, channel])
                for channel in range(3)
            ],
            axis=1,
        )
        assert np.abs(shown - lights[:, drone]).max() <= 4.0 + 1e-9
        assert one.frames.size < times.size / 2


def test_numbers_of_seven_bits_a_byte():
    assert varuint(0) == b"\0" and varuint(127) == b"\x7f"
    assert varuint(128) == b"\x80\x01" and varuint(1000) == b"\xe8\x07"


def test_component_measures_one_axis():
    assert component(1, -1.0)(np.array([[1.0, 2.0, 3.0]]))[0] == -2.0
