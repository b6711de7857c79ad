"""The log's bytes: deterministic, in order, complete, true to the flight."""

from __future__ import annotations

import hashlib
import itertools
import json
import os
import subprocess
import sys
from collections import defaultdict
from dataclasses import replace
from datetime import UTC, datetime
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf import descriptor_pool
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Chunk, DataEnd, Footer
from mcap.stream_reader import StreamReader
from synthetic import gliding_flight

from showc.light import LightProgram, srgb_bytes
from showc.log import showc_pb2 as pb
from showc.log.sample import (
    DRONE_STATE,
    GRID,
    POINT,
    pack_drone_states,
    quaternion,
    sample_times,
)
from showc.log.sampling import FleetSampler
from showc.log.writer import Topics, write_log
from showc.plan.itinerary import Itinerary
from showc.trajectory import PiecewisePolynomial

if TYPE_CHECKING:
    from showc.flight import Flight

EPOCH = int(datetime(2026, 1, 1, tzinfo=UTC).timestamp()) * 10**9


def messages(data: bytes, *topics: str):
    reader = make_reader(BytesIO(data), validate_crcs=True)
    for _, channel, message in reader.iter_messages(topics or None):
        yield channel.topic, message


def at_rate(flight: Flight, rate: float) -> Flight:
    show = replace(flight.itinerary.show, log_rate=rate)
    return replace(flight, itinerary=Itinerary(show, flight.itinerary.legs))


def test_two_writes_have_the_same_bytes(vertical, vertical_bytes, write):
    assert write(vertical) == vertical_bytes


def test_bytes_do_not_depend_on_the_process(gliding_bytes, tmp_path):
    code = (
        "import sys; from pathlib import Path\n"
        "from synthetic import gliding_flight\n"
        "from showc.log.writer import write_log\n"
        "write_log(gliding_flight(16), Path(sys.argv[1]),"
        " manifest=b'{\"files\": {}}\\n')\n"
    )
    root = Path(__file__).parents[2]
    environment = {
        **os.environ,
        "PYTHONHASHSEED": "12345",
        "PYTHONPATH": os.pathsep.join([str(root), str(root / "tests")]),
    }
    path = tmp_path / "other.mcap"
    subprocess.run([sys.executable, "-c", code, path], check=True, env=environment)
    theirs = hashlib.sha256(path.read_bytes()).hexdigest()
    assert theirs == hashlib.sha256(gliding_bytes).hexdigest()


def test_every_checksum_is_present(gliding_bytes):
    records = list(
        StreamReader(
            BytesIO(gliding_bytes), emit_chunks=True, validate_crcs=True
        ).records
    )
    chunks = [record for record in records if isinstance(record, Chunk)]
    assert len(chunks) > 2 and all(chunk.uncompressed_crc for chunk in chunks)
    assert all(
        r.data_section_crc if isinstance(r, DataEnd) else r.summary_crc
        for r in records
        if isinstance(r, DataEnd | Footer)
    )
    assert all(chunk.compression == "zstd" for chunk in chunks)
    assert max(chunk.uncompressed_size for chunk in chunks) < 1.5 * 2**20


def test_time_order_and_sequences(gliding_bytes):
    last, counters = 0, defaultdict(int)
    reader = StreamReader(BytesIO(gliding_bytes), validate_crcs=True)
    for record in reader.records:
        if type(record).__name__ != "Message":
            continue
        assert record.log_time == record.publish_time >= last
        assert record.sequence == counters[record.channel_id]
        counters[record.channel_id] += 1
        last = record.log_time
    assert sum(counters.values()) > 1000


def test_chunks_do_not_overlap(gliding_bytes):
    summary = make_reader(BytesIO(gliding_bytes)).get_summary()
    indexes = summary.chunk_indexes
    for before, after in itertools.pairwise(indexes):
        assert before.message_end_time <= after.message_start_time


def test_fleet_is_sampled_on_the_grid_and_at_the_end(vertical, vertical_bytes):
    times = [m.log_time - EPOCH for _, m in messages(vertical_bytes, "/fleet/state")]
    end = round(vertical.duration * 1e9)
    assert times[:-1] == [k * 50_000_000 for k in range(len(times) - 1)]
    assert times[-1] == end and 0 < end - times[-2] < 50_000_000


@given(
    milliseconds=st.integers(1, 600_000),
    rate=st.sampled_from([1.0, 5.0, 20.0, 24.0, 25.0, 29.97, 30.0, 50.0, 60.0]),
)
def test_sample_times_have_no_gap(milliseconds, rate):
    times = sample_times(milliseconds / 1000.0, rate)
    steps = np.diff(times)
    assert times[0] == 0 and times[-1] == milliseconds * 1_000_000
    assert np.all(steps > 0)
    assert np.all(np.abs(steps[:-1] - 1e9 / rate) <= 1.0)


def test_samples_equal_the_polynomials(gliding, gliding_log):
    # A control may jump between legs: there the later leg counts.
    for drone in (0, 7, 15):
        flight = gliding.drone(drone)
        sample = gliding_log.samples[:, drone]
        state = flight.state(gliding_log.times)
        control = flight.control(gliding_log.times)
        wanted = {
            ("x", "y", "z"): (state[:, :3], "position"),
            ("vx", "vy", "vz"): (state[:, 3:6], "velocity"),
            ("qx", "qy", "qz", "qw"): (quaternion(state[:, 6:9]), "attitude"),
            ("wx", "wy", "wz"): (state[:, 9:12], "body_rate"),
            ("u0",): (control[:, :1], "thrust"),
            ("u1", "u2", "u3"): (control[:, 1:], "torque"),
        }
        for names, (values, quantity) in wanted.items():
            logged = np.stack([sample[name] for name in names], axis=-1).astype(float)
            assert np.abs(logged - values).max() <= 0.5 * GRID[quantity] + 1e-9
            assert np.all(logged % GRID[quantity] == 0.0)


def test_sampler_agrees_with_the_trajectories_on_any_window(gliding):
    times = np.arange(0.0, gliding.duration, 0.0731)
    sampler = FleetSampler(gliding)
    parts = [sampler(part) for part in np.array_split(times, 7)]
    state = np.concatenate([part[0] for part in parts])
    control = np.concatenate([part[1] for part in parts])
    for drone in range(16):
        flight = gliding.drone(drone)
        assert np.allclose(state[:, drone], flight.state(times), atol=1e-11)
        assert np.allclose(control[:, drone], flight.control(times), atol=1e-9)


def test_sampler_keeps_a_drone_where_its_last_leg_leaves_it(vertical):
    short = replace(vertical, legs=vertical.legs[:3], starts=vertical.starts[:3])
    state, control = FleetSampler(short)(np.array([0.0, short.duration + 1.0]))
    goal = vertical.legs[2].leg.goal
    assert np.allclose(state[1, :, :3], goal, atol=1e-12)
    assert np.allclose(control[1, :, 0], 0.625 * 9.80665)


@given(st.lists(st.floats(-1.5, 1.5), min_size=3, max_size=3))
def test_quaternion_turns_the_body_as_the_angles_do(angles):
    roll, pitch, yaw = angles
    rx = np.array(
        [[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]]
    )
    ry = np.array(
        [
            [np.cos(pitch), 0, np.sin(pitch)],
            [0, 1, 0],
            [-np.sin(pitch), 0, np.cos(pitch)],
        ]
    )
    rz = np.array(
        [[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]]
    )
    x, y, z, w = quaternion(np.array(angles))
    matrix = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    assert np.allclose(matrix, rz @ ry @ rx, atol=1e-12)


def test_point_cloud_is_what_viewers_colour_without_setup(gliding, gliding_bytes):
    clouds = [
        PointCloud.FromString(m.data)
        for _, m in messages(gliding_bytes, "/fleet/state")
    ]
    first = clouds[0]
    assert first.frame_id == "map" and first.pose.orientation.w == 1.0
    assert first.point_stride == 72 == POINT.itemsize
    names = [field.name for field in first.fields]
    assert names[:7] == ["x", "y", "z", "red", "green", "blue", "alpha"]
    assert {f.name: f.offset for f in first.fields} == {
        name: entry[1] for name, entry in POINT.fields.items()
    }
    time = gliding.starts[3] + 0.5
    step = round(time * 20.0)
    light = srgb_bytes(LightProgram.of(gliding).linear([step / 20.0]))[0]
    shown = np.frombuffer(clouds[step].data, dtype=POINT)
    assert np.array_equal(
        np.stack([shown[n] for n in ("red", "green", "blue")], axis=-1), light
    )
    assert light.max() > 150 and np.all(shown["alpha"] == 255)


def test_transforms_have_the_site_heading_as_root(gliding_bytes):
    all_frames = [
        FrameTransforms.FromString(m.data) for _, m in messages(gliding_bytes, "/tf")
    ]
    root = all_frames[0].transforms[0]
    assert (root.parent_frame_id, root.child_frame_id) == ("enu", "map")
    # Heading 30 deg: the show's +y points 30 deg east of north.
    turn = 2.0 * np.arctan2(root.rotation.z, root.rotation.w)
    ahead = np.array([-np.sin(turn), np.cos(turn)])
    assert np.allclose(ahead, [np.sin(np.pi / 6), np.cos(np.pi / 6)])
    assert len(all_frames[5].transforms) == 16
    assert all_frames[5].transforms[6].child_frame_id == "drone_0007"
    times = [t.transforms[0].timestamp for t in all_frames[1:4]]
    assert [t.nanos for t in times] == [0, 200_000_000, 400_000_000]


def test_scene_stands_at_the_start_and_fences_the_site(gliding, gliding_bytes):
    found = list(messages(gliding_bytes, "/show/scene"))
    assert len(found) == 1 and found[0][1].log_time == EPOCH
    entities = {e.id: e for e in SceneUpdate.FromString(found[0][1].data).entities}
    corners = {(p.x, p.y) for p in entities["fence"].lines[0].points}
    assert corners == {tuple(c) for c in gliding.itinerary.show.site.fence}
    assert len(entities["pads"].cubes) == 16


def test_drone_states_decode_to_the_same_numbers(gliding, gliding_bytes, gliding_log):
    found = [m.data for _, m in messages(gliding_bytes, "/drone/0008/state")]
    light = LightProgram.of(gliding).sample(gliding_log.times)
    for step in (0, 400, len(found) - 1):
        message = pb.DroneState.FromString(found[step])
        sample = gliding_log.samples[step, 7]
        assert (message.position.x, message.position.z) == (sample["x"], sample["z"])
        assert message.velocity.y == sample["vy"]
        assert message.body_rate.x == sample["wx"]
        assert (message.thrust, message.torque.y) == (sample["u0"], sample["u2"])
        assert round(message.led.green * 255) == light[step, 7, 1]


@given(
    st.lists(
        st.floats(-100.0, 100.0).map(lambda v: round(v * 8) / 8),
        min_size=16,
        max_size=16,
    )
)
def test_packed_drone_state_is_the_message(values):
    state, control = np.array(values[:12]), np.array(values[12:])
    light = np.array([0.0, 0.25, 1.0])
    packed = pack_drone_states(
        state[None, None], control[None, None], light[None, None]
    )
    message = pb.DroneState(
        position=pb.Vector3(x=state[0], y=state[1], z=state[2]),
        velocity=pb.Vector3(x=state[3], y=state[4], z=state[5]),
        attitude=pb.Vector3(x=state[6], y=state[7], z=state[8]),
        body_rate=pb.Vector3(x=state[9], y=state[10], z=state[11]),
        thrust=control[0],
        torque=pb.Vector3(x=control[1], y=control[2], z=control[3]),
        led=pb.Colour(red=0.0, green=0.25, blue=1.0),
    )
    decoded = pb.DroneState.FromString(packed[0, 0].tobytes())
    assert decoded == message and len(packed.tobytes()) == DRONE_STATE.itemsize


def test_trajectories_keep_every_bit(gliding, gliding_log):
    for number, segment in enumerate(gliding_log.segments):
        flown = gliding.legs[number]
        assert segment.start == gliding.starts[number]
        assert segment.duration == flown.duration
        assert np.array_equal(segment.drones, flown.leg.drones)
        for logged, solved in zip(
            segment.trajectories, flown.trajectories, strict=True
        ):
            assert np.array_equal(logged.state.breaks, solved.state.breaks)
            assert np.array_equal(logged.state.coefficients, solved.state.coefficients)
            assert np.array_equal(
                logged.control.coefficients, solved.control.coefficients
            )


def test_rules_say_what_the_show_asks(vertical, vertical_log):
    show, rules = vertical.itinerary.show, vertical_log.rules
    assert (rules.name, rules.drones, rules.log_rate) == (show.name, 4, 20.0)
    assert rules.duration == vertical.duration
    assert rules.separation.distance == 1.0
    assert rules.separation.shape == pb.Separation.SPHERE
    assert rules.vehicle.mass == 0.625 and rules.vehicle.torque_factor == 1.0
    assert np.array_equal(
        np.reshape(rules.site.fence, (-1, 2)), np.asarray(show.site.fence)
    )
    assert {f.name for f in rules.formations} == set(show.formations)
    climb, launch = rules.limits[1], vertical_log.segments[0].message
    assert rules.limits[launch.limits].velocity_max.z == 3.0
    assert climb.velocity_max.z == 5.0
    segment = vertical_log.segments[2].message
    assert segment.to_formation == "steps" and list(segment.places) == [0, 1, 2, 3]
    assert np.array_equal(
        np.reshape(segment.goals, (-1, 3)), show.formations["steps"].points
    )
    certificate = vertical.legs[2].certificate
    minimum = segment.certificate.single_drone_minimum
    assert minimum == certificate.single_drone_minimum
    assert segment.certificate.closest.distance >= 1.0


def test_attachments_and_metadata_carry_the_sources(vertical, vertical_log):
    show = vertical.itinerary.show
    assert vertical_log.script == show.source.content
    assert vertical_log.attachments["points.csv"] == b"0,0,0\n"
    assert vertical_log.attachments["manifest.json"] == b'{"files": {}}\n'
    layout = json.loads(vertical_log.attachments["layout.json"])
    plots = [key for key in layout["configById"] if key.startswith("Plot!")]
    assert "/drone/0001/state.position.z" in json.dumps(layout) and len(plots) == 3
    metadata = vertical_log.metadata
    digest = hashlib.sha256(show.source.content).hexdigest()
    assert metadata["script_sha256"] == digest
    assert int(metadata["epoch_ns"]) == EPOCH
    assert float(metadata["grid_position"]) == 2.0**-10


def test_schemas_load_on_their_own(gliding_bytes):
    summary = make_reader(BytesIO(gliding_bytes)).get_summary()
    assert {s.name for s in summary.schemas.values()} == {
        "foxglove.PointCloud",
        "foxglove.FrameTransforms",
        "foxglove.SceneUpdate",
        "showc.Rules",
        "showc.Segment",
        "showc.Trajectory",
        "showc.DroneState",
    }
    for found in summary.schemas.values():
        pool = descriptor_pool.DescriptorPool()
        for file in FileDescriptorSet.FromString(found.data).file:
            pool.Add(file)
        assert pool.FindMessageTypeByName(found.name).full_name == found.name


def test_great_fleets_have_no_topics_per_drone_unless_asked(write):
    flight = gliding_flight(101, moves=1)
    topics = {topic for topic, _ in messages(write(flight))}
    assert not any(topic.endswith("/state") and "drone" in topic for topic in topics)
    assert "/drone/0101/trajectory" in topics
    some = write(flight, topics=Topics(states=(3,), transforms=(3,)))
    assert "/drone/0004/state" in {topic for topic, _ in messages(some)}


def test_predicted_fleet_may_outlast_the_show(vertical, write):
    class Late:
        duration = 30.02

        def position(self, times):
            return np.repeat(times[:, None, None], 4, axis=1) * [1.0, 0.0, 0.5]

    data = write(vertical, predicted=Late())
    found = [m for _, m in messages(data, "/fleet/predicted")]
    assert found[-1].log_time - EPOCH == 30_020_000_000
    cloud = PointCloud.FromString(found[-1].data)
    assert [f.name for f in cloud.fields][:3] == ["x", "y", "z"]
    x = np.frombuffer(cloud.data, dtype="<f4")[0]
    assert x == pytest.approx(30.02, abs=2.0**-11)
    last = [m.log_time for _, m in messages(data, "/fleet/state")][-1]
    assert last - EPOCH == round(vertical.duration * 1e9)


def test_other_rates_hit_every_step(vertical, write):
    data = write(at_rate(vertical, 30.0))
    times = [m.log_time - EPOCH for _, m in messages(data, "/fleet/state")]
    assert times[1:4] == [33_333_333, 66_666_666, 100_000_000]
    frames = [m.log_time - EPOCH for _, m in messages(data, "/tf")]
    assert frames[2] == 200_000_000


def test_a_thousand_drones_take_little_memory(tmp_path):
    # A subprocess, so that the memory of other tests does not count.
    code = (
        "import sys; from pathlib import Path\n"
        "from memory import peak\n"
        "from synthetic import gliding_flight\n"
        "from showc.log.writer import write_log\n"
        "flight = gliding_flight(1000, moves=1)\n"
        "write_log(flight, Path(sys.argv[1]), manifest=b'{}')\n"
        "print(peak())\n"
    )
    root = Path(__file__).parents[2]
    path = os.pathsep.join([str(root), str(root / "tests")])
    result = subprocess.run(
        [sys.executable, "-c", code, tmp_path / "big.mcap"],
        check=True,
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1"},
    )
    assert int(result.stdout) < 1 << 30


def test_a_full_disk_is_an_os_error(vertical):
    class Full(BytesIO):
        def write(self, data):
            if self.tell() + len(data) > 50_000:
                raise OSError(28, "No space left on device")
            return super().write(data)

    with pytest.raises(OSError, match="No space left"):
        write_log(vertical, Full(), manifest=b"{}")


def test_mixed_degrees_and_meshes_of_one_leg(vertical):
    # Half of the drones with another mesh, the rest with another degree.
    flown = vertical.legs[0]
    parts = []
    for index, trajectory in enumerate(flown.trajectories):
        if index % 2:
            times = np.linspace(0.0, flown.duration, 3 + index)
            state, control = (
                trajectory.state.split(times),
                trajectory.control.split(times),
            )
        else:
            state, control = trajectory.state.elevated(8), trajectory.control
        parts.append(replace(trajectory, state=state, control=control))
    other = replace(vertical, legs=(replace(flown, trajectories=tuple(parts)),))
    other = replace(other, starts=vertical.starts[:1])
    times = np.linspace(0.0, flown.duration, 57)
    state, control = FleetSampler(other)(times)
    for drone, trajectory in enumerate(flown.trajectories):
        assert isinstance(trajectory.state, PiecewisePolynomial)
        assert np.allclose(state[:, drone], trajectory.state(times), atol=1e-11)
        assert np.allclose(control[:, drone], trajectory.control(times), atol=1e-11)
