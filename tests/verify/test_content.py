"""Logs that are whole as files but whose messages were changed."""

import math
import struct
from dataclasses import replace

import numpy as np
import pytest
from findings import failed
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rewritten import rewritten
from verified import loaded, proved_flight, written

from showc.errors import DamagedFileError
from showc.log import showc_pb2 as pb
from showc.log.container import open_log
from showc.verify import DamagedLogError, verify_log
from showc.verify.decode import CAPS
from showc.verify.kernel.dynamics import radius, ties
from showc.verify.kernel.limits import extremes, kept

SETTINGS = settings(
    max_examples=30,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
TOPICS = (
    "/show/rules",
    "/show/segments",
    "/drone/0002/trajectory",
    "/fleet/state",
    "/drone/0003/state",
    "/tf",
)


class Bytes(bytes):
    """Bytes that do not print themselves when a test fails."""

    __slots__ = ()

    def __repr__(self):
        return f"<{len(self)} bytes>"


@pytest.fixture(scope="module")
def data(log_path):
    return Bytes(log_path.read_bytes())


def verified(content, tmp_path):
    path = tmp_path / "output.mcap"
    path.write_bytes(content)
    return verify_log(path, missions=False)


def changed(data, kind, topic, number, change):
    """Log in which ``change`` was called on one decoded message."""

    def replace(found, index, message):
        if found != topic or index != number:
            return message
        decoded = kind.FromString(message)
        change(decoded)
        return decoded.SerializeToString(deterministic=True)

    return rewritten(data, replace)


def test_writing_again_changes_nothing(data, tmp_path):
    again = rewritten(data, lambda *found: found[-1])
    assert again != data
    verification = verified(again, tmp_path)
    assert verification.passed
    assert not any(check.verdict == "warning" for check in verification.checks)


def with_extra_field(wanted):
    """Add a field to the first message of the last file of one schema."""

    def change(name, data):
        if name != wanted:
            return data
        files = FileDescriptorSet.FromString(data)
        field = files.file[-1].message_type[0].field.add()
        field.CopyFrom(files.file[-1].message_type[0].field[0])
        field.name, field.number = "more", 99
        return files.SerializeToString(deterministic=True)

    return change


def test_another_definition_of_a_message_of_ours_fails(data, tmp_path):
    content = rewritten(
        data, lambda *found: found[-1], with_extra_field("showc.Segment")
    )
    assert failed(verified(content, tmp_path)) == {"VRF103"}


def test_another_definition_of_a_message_of_foxgloves_fails(data, tmp_path):
    """A viewer would read other things out of the same bytes."""
    content = rewritten(
        data, lambda *found: found[-1], with_extra_field("foxglove.PointCloud")
    )
    assert failed(verified(content, tmp_path)) == {"VRF103"}


@SETTINGS
@given(
    topic=st.sampled_from(TOPICS),
    number=st.integers(min_value=0, max_value=8),
    place=st.integers(min_value=0),
    new=st.binary(min_size=1, max_size=24),
    cut=st.booleans(),
)
def test_garbage_in_messages_raises_nothing_else(
    data, tmp_path, *, topic, number, place, new, cut
):
    def replace(found, index, message):
        if found != topic or index != number:
            return message
        start = place % len(message)
        return message[:start] + new + (b"" if cut else message[start + len(new) :])

    content = rewritten(data, replace)
    try:
        verification = verified(content, tmp_path)
    except DamagedFileError as error:
        assert "byte" in str(error)  # noqa: PT017
    else:
        assert verification.passed == (not failed(verification))


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(
    ("kind", "topic", "field"),
    [
        (pb.Trajectory, "/drone/0001/trajectory", "state"),
        (pb.Trajectory, "/drone/0001/trajectory", "control"),
        (pb.Trajectory, "/drone/0001/trajectory", "breaks"),
        (pb.Segment, "/show/segments", "goals"),
    ],
)
def test_numbers_that_are_none_are_damage(data, tmp_path, *, kind, topic, field, value):
    def change(message):
        getattr(message, field)[1] = value

    content = changed(data, kind, topic, 0, change)
    with pytest.raises(DamagedLogError, match="contradicts itself"):
        verified(content, tmp_path)


def test_a_log_of_other_rules_than_the_scripts_is_judged_by_none(data, tmp_path):
    def change(rules):
        rules.vehicle.mass = 0.0

    verification = verified(changed(data, pb.Rules, "/show/rules", 0, change), tmp_path)
    assert failed(verification) == {"VRF203"}
    assert verification.trajectories == "not proved"
    assert not any(one.code.startswith("VRF3") for one in verification.checks)


FIELDS = [
    *(("vehicle", name) for name in ("mass", "arm_length", "torque_factor")),
    *(("vehicle", name) for name in ("thrust_coefficient", "torque_coefficient")),
    *(("vehicle", name) for name in ("rotor_speed_max", "gravity")),
    *(("separation", name) for name in ("distance", "vertical_stretch")),
    *(("site", name) for name in ("latitude", "altitude", "heading")),
    ("", "duration"),
    ("", "log_rate"),
    ("", "heading"),
]


@SETTINGS
@given(
    field=st.sampled_from(FIELDS),
    value=st.sampled_from([0.0, -1.0, 1e-300, 1e-14, 1e-6, 1e6, 9e8, 1e300]),
)
def test_absurd_rules_raise_nothing_else(data, tmp_path, field, value):
    part, name = field

    def change(rules):
        setattr(getattr(rules, part) if part else rules, name, value)

    content = changed(data, pb.Rules, "/show/rules", 0, change)
    try:
        verification = verified(content, tmp_path)
    except DamagedFileError as error:
        assert "byte" in str(error)  # noqa: PT017
    else:
        assert verification.passed == (not failed(verification))


def test_a_trajectory_left_out_is_damage(data, tmp_path):
    content = rewritten(
        data,
        lambda topic, number, message: (
            None if (topic, number) == ("/drone/0002/trajectory", 3) else message
        ),
    )
    with pytest.raises(DamagedLogError, match="not one trajectory of each drone"):
        verified(content, tmp_path)


def test_a_heavier_drone_does_not_fly_these_controls(log_path):
    _, show = loaded(log_path)
    show.rules.vehicle.mass *= 1.001
    radii = [radius(one, show.rules.vehicle) for one in show.segments]
    assert "VRF301" in {one.code for one in ties(show, radii) if not one.holds}


def test_a_tighter_limit_is_kept_by_nobody(log_path):
    _, show = loaded(log_path)
    show.rules.limits[0].velocity_max.z = 2.7
    radii = [radius(one, show.rules.vehicle) for one in show.segments]
    found = kept(show, radii, [extremes(one, show.rules) for one in show.segments])
    (broken,) = (one for one in found if not one.holds)
    assert broken.code == "VRF312"
    assert broken.value == pytest.approx(2.70303, abs=1e-5)
    assert broken.limit == 2.7


def test_a_sample_moved_by_two_millimetres_is_found(data, tmp_path):
    from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud

    def change(cloud):
        points = bytearray(cloud.data)
        offset = 2 * cloud.point_stride
        (x,) = struct.unpack_from("<f", points, offset)
        struct.pack_into("<f", points, offset, x + 2.0 / 1024.0)
        cloud.data = bytes(points)

    verification = verified(
        changed(data, PointCloud, "/fleet/state", 58, change), tmp_path
    )
    # A frame of the same instant stands elsewhere, too.
    assert failed(verification) == {"VRF122", "VRF124"}
    check = verification.check("VRF122")
    assert check.where.drone == 3
    assert check.where.time == pytest.approx(58 / 5.0)


@pytest.mark.parametrize("field", ["position", "velocity", "attitude", "body_rate"])
def test_a_changed_sample_of_one_drone_is_found(data, tmp_path, field):
    def change(state):
        getattr(state, field).y += 0.01

    content = changed(data, pb.DroneState, "/drone/0004/state", 50, change)
    verification = verified(content, tmp_path)
    assert failed(verification) == {"VRF123"}
    where = verification.check("VRF123")
    assert where.where.drone == 4
    assert where.where.time == pytest.approx(10.0)


def test_a_changed_frame_is_found(data, tmp_path):
    from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms

    def change(message):
        message.transforms[1].rotation.z += 0.001

    content = changed(data, FrameTransforms, "/tf", 30, change)
    verification = verified(content, tmp_path)
    assert failed(verification) == {"VRF124"}


def test_a_sample_left_out_is_found(data, tmp_path):
    content = rewritten(
        data,
        lambda topic, number, message: (
            None if (topic, number) == ("/fleet/state", 40) else message
        ),
    )
    assert "VRF121" in failed(verified(content, tmp_path))


def test_a_witness_proves_what_it_proves_and_no_more(data, tmp_path):
    """A climb of 6 m at 3 m/s takes 2 s: beta alone proves that."""

    def claim(time):
        def change(segment):
            certificate = segment.certificate
            certificate.dual_bound = certificate.witness.time = time
            certificate.witness.beta.z = 1.0
            certificate.witness.knots.extend([0.0, 1.0])
            certificate.witness.multipliers.extend([0.0] * 6)

        content = changed(data, pb.Segment, "/show/segments", 0, change)
        return verified(content, tmp_path)

    name = "VRF341"
    assert name not in failed(claim(1.999))
    wrong = claim(2.001)
    assert name in failed(wrong)
    # A witness is checked at the time claimed: beyond it, it proves nothing.
    assert wrong.check(name).value == np.inf


def test_a_bound_above_the_time_flown_is_found(data, tmp_path):
    def change(segment):
        segment.certificate.dual_bound = segment.duration + 0.001

    content = changed(data, pb.Segment, "/show/segments", 0, change)
    assert "VRF342" in failed(verified(content, tmp_path))


def test_a_wrong_claim_of_the_closest_encounter_is_found(data, tmp_path):
    def change(segment):
        segment.certificate.closest.distance += 0.01

    content = changed(data, pb.Segment, "/show/segments", 0, change)
    assert "VRF343" in failed(verified(content, tmp_path))


def test_a_hold_without_its_closest_encounter_is_found(data, tmp_path):
    names = []

    def change(segment):
        names.append(segment.kind)
        segment.certificate.ClearField("closest")

    content = changed(data, pb.Segment, "/show/segments", 1, change)
    assert names == [pb.Segment.HOLD]
    assert "VRF343" in failed(verified(content, tmp_path))


def test_a_single_drone_meets_no_other(tmp_path):
    data = written(proved_flight(1), tmp_path / "one.mcap").read_bytes()
    assert "VRF343" not in failed(verified(data, tmp_path))

    def change(segment):
        segment.certificate.closest.distance = 0.05

    content = changed(data, pb.Segment, "/show/segments", 0, change)
    assert "VRF343" in failed(verified(content, tmp_path))


@pytest.mark.parametrize("many", ["statistics", "moves"])
def test_a_segment_that_says_far_too_much_is_refused(data, tmp_path, many):
    def change(segment):
        if many == "moves":
            segment.moves.extend([pb.Move()] * 5_000_000)
        else:
            segment.certificate.statistics.update({str(n): 1.0 for n in range(2000)})

    content = changed(data, pb.Segment, "/show/segments", 0, change)
    with pytest.raises(DamagedLogError, match=r"too many|contradicts itself"):
        verified(content, tmp_path)


def test_rules_of_far_too_many_limits_are_refused(data, tmp_path):
    """An empty part takes two bytes in a message, and a hundred in memory."""

    def change(rules):
        rules.limits.extend([pb.Limits()] * 1_000_000)

    content = changed(data, pb.Rules, "/show/rules", 0, change)
    with pytest.raises(DamagedLogError, match="more fields than any"):
        verified(content, tmp_path)


def test_moves_of_all_segments_together_are_refused_beyond_reason(data, tmp_path):
    def replace(topic, index, message):
        del index
        more = b"j\x00" * 4000  # an empty move each
        return message + more * (topic == "/show/segments")

    assert not pb.Segment.FromString(b"j\x00").moves[0].name
    with pytest.raises(DamagedLogError, match="is not in its turn"):
        verified(rewritten(data, replace), tmp_path)


def test_flights_far_larger_than_the_log_are_refused(data, tmp_path, monkeypatch):
    """A hold of high degree in many intervals packs into almost nothing."""
    monkeypatch.setitem(CAPS, "held", 1 << 20)

    def wide(topic, index, message):
        del index
        if not topic.endswith("/trajectory"):
            return message
        flight, pieces = pb.Trajectory.FromString(message), 100
        flight.state_degree = flight.control_degree = CAPS["degree"]
        flight.breaks[:] = np.linspace(0.0, flight.breaks[-1], pieces + 1)
        flight.state[:] = [*flight.state[:12]] * ((CAPS["degree"] + 1) * pieces)
        flight.control[:] = [*flight.control[:4]] * ((CAPS["degree"] + 1) * pieces)
        return flight.SerializeToString(deterministic=True)

    with pytest.raises(DamagedLogError, match="too many"):
        verified(rewritten(data, wide), tmp_path)


def test_a_flight_larger_than_any_is_refused(data, tmp_path, monkeypatch):
    sizes = open_log(data).sizes({*open_log(data).channels})
    assert sizes.max() < CAPS["message"]
    monkeypatch.setitem(CAPS, "message", 100)
    with pytest.raises(DamagedLogError, match="too many"):
        verified(data, tmp_path)


def test_flights_of_an_honest_log_are_few_beside_it(data):
    log = open_log(data)
    flights = {n for n, one in log.channels.items() if one.topic.endswith("trajectory")}
    sizes = log.sizes(flights)
    assert sizes.tolist() == [len(one.data) for one in log.messages(flights)]
    assert sizes.sum() < 0.2 * CAPS["packed"] * len(data)


@pytest.mark.parametrize("more", [0, 1])
def test_a_flight_of_more_intervals_than_its_time_takes_is_refused(
    data, tmp_path, more
):
    """A hold cut into thousands packs into almost nothing, and takes long to prove."""

    def change(flight):
        (end,) = flight.breaks[1:]
        pieces = CAPS["few"] + int(CAPS["pace"] * end) + more
        flight.breaks[:] = np.linspace(0.0, end, pieces + 1)
        flight.state.extend([*flight.state] * (pieces - 1))
        flight.control.extend([*flight.control] * (pieces - 1))

    content = changed(data, pb.Trajectory, "/drone/0002/trajectory", 1, change)
    if not more:
        assert verified(content, tmp_path).passed
        return
    with pytest.raises(DamagedLogError, match=r"contradicts itself, at byte [\d,]+"):
        verified(content, tmp_path)


def test_json_and_text_tell_the_same(log_path):
    import json

    from showc.cli.findings import render_text

    verification = verify_log(log_path, missions=False)
    result = json.loads(json.dumps(verification.to_json(), allow_nan=False))
    assert result["passed"] is True
    assert result["exit_code"] == 0
    text = render_text(verification)
    for check in result["checks"]:
        assert check["name"] in text
    assert "PROVED" in text
    assert np.isfinite(result["duration"])


def test_lights_at_moments_of_a_hold_are_those_of_the_script(flight, tmp_path):
    itinerary = flight.itinerary
    moves = itinerary.show.transitions
    assert moves[0].lights
    dark = replace(
        itinerary,
        show=replace(itinerary.show, transitions=tuple(
            replace(one, lights=()) for one in moves
        )),
    )  # fmt: skip
    path = written(replace(flight, itinerary=dark), tmp_path / "output.mcap")
    assert "VRF125" in failed(verify_log(path, missions=False))
