"""What each segment claims of itself, held against what is proved here."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.log import showc_pb2 as pb
from showc.verify.bound import TOLERANCE, proved_time
from showc.verify.fleet import evaluate
from showc.verify.report import Check, Place

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.verify.kernel.show import LoggedShow, Segment

    FloatArray = NDArray[np.float64]

GROUP = "certificates"

DISTANCE_TOLERANCE = 1e-3
"""How far a claimed closest encounter may be from the distance at its time [m]."""


def check_certificates(show: LoggedShow) -> list[Check]:
    """Check bounds on time and claimed encounters of all segments."""
    return [_witnesses(show), _order(show), _encounters(show)]


def _moves(show: LoggedShow) -> list[Segment]:
    return [segment for segment in show.segments if not segment.holds]


def _witnesses(show: LoggedShow) -> Check:
    """Prove every claimed lower bound on a segment's time from its witness."""
    name = "no claimed lower bound on a time beyond its proof"
    moves = [one for one in _moves(show) if one.message.certificate.dual_bound > 0.0]
    if not moves:
        return Check("VRF341", GROUP, name, "skipped", notes=("no segment claims one",))
    worst, where, failed = np.inf, Place(), []
    for segment in moves:
        message = segment.message
        certificate = message.certificate
        drone = certificate.witness.drone
        proved = 0.0
        if certificate.HasField("witness") and drone in segment.drones:
            row = int(np.searchsorted(segment.drones, drone))
            way = segment.goals[row] - segment.ends()[0][row, :3]
            proved = proved_time(message, show.rules, way)
        slack = proved - certificate.dual_bound
        if slack < -TOLERANCE:
            failed.append(
                f"“{message.name}” claims {certificate.dual_bound:.6f} s, the witness "
                f"proves {proved:.6f} s"
            )
        if slack < worst:
            worst = slack
            where = Place(drone + 1, segment=message.name, time=segment.start)
    ratios = [one.message.certificate.dual_bound / one.duration for one in moves]
    note = (
        f"{len(moves)} witnesses; the bounds are {min(ratios):.1%} to "
        f"{max(ratios):.1%} of the times flown (tolerance {TOLERANCE:.0e} s)"
    )
    return Check(
        "VRF341",
        GROUP,
        name,
        "fail" if failed else "pass",
        max(-worst, 0.0) + 0.0,
        TOLERANCE,
        "s",
        where,
        (note, *failed[:5]),
    )


def _order(show: LoggedShow) -> Check:
    """Bound <= greatest single-drone minimum <= time flown."""
    bad = []
    where = Place()
    for segment in _moves(show):
        certificate = segment.message.certificate
        bound, single = certificate.dual_bound, certificate.single_drone_minimum
        if bound > segment.duration or (single > 0.0 and bound > single):
            bad.append(
                f"“{segment.message.name}”: bound {bound:.6f} s, single drone "
                f"{single:.6f} s, flown {segment.duration:.6f} s"
            )
            where = Place(segment=segment.message.name, time=segment.start)
    return Check(
        "VRF342",
        GROUP,
        "lower bound below single-drone minimum and time flown",
        "fail" if bad else "pass",
        where=where,
        notes=tuple(bad[:5]),
    )


def _encounters(show: LoggedShow) -> Check:
    """Whether claimed closest encounters are what the polynomials give there."""
    name = "claimed closest encounters are as claimed"
    worst, where, count = 0.0, Place(), 0
    for segment in show.segments:
        certificate = segment.message.certificate
        if not certificate.HasField("closest"):
            continue
        closest = certificate.closest
        pair = closest.drone_a, closest.drone_b
        place = Place(
            pair=(pair[0] + 1, pair[1] + 1),
            segment=segment.message.name,
            time=segment.start + closest.time,
        )
        count += 1
        gap = np.inf
        if (
            pair[0] != pair[1]
            and set(pair) <= set(segment.drones.tolist())
            and 0.0 <= closest.time <= segment.duration + 1e-9
        ):
            difference = _position(segment, pair[0], closest.time) - _position(
                segment, pair[1], closest.time
            )
            gap = abs(_distance(show.rules.separation, difference) - closest.distance)
        if not gap <= worst:
            worst, where = gap, place
    if not count:
        return Check("VRF343", GROUP, name, "skipped", notes=("no segment claims one",))
    return Check(
        "VRF343",
        GROUP,
        name,
        "pass" if worst <= DISTANCE_TOLERANCE else "fail",
        worst,
        DISTANCE_TOLERANCE,
        "m",
        where,
        (f"{count} encounters",),
    )


def _position(segment: Segment, drone: int, time: float) -> FloatArray:
    for table in segment.tables:
        found = np.flatnonzero(table.drones == drone)
        if found.size:
            values = evaluate(table.only(int(found[0])), np.array([time]))
            return np.asarray(values[:3, 0, 0])
    raise KeyError(drone)


def _distance(separation: pb.Separation, difference: FloatArray) -> float:
    shape = separation.shape
    if shape == pb.Separation.ANY_AXIS:
        return float(np.abs(difference).max())
    if shape == pb.Separation.ALL_AXES:
        return float(np.abs(difference).min())
    stretch = separation.vertical_stretch if shape == pb.Separation.ELLIPSOID else 1.0
    return float(np.sqrt(np.sum((difference / np.array([1.0, 1.0, stretch])) ** 2)))
