"""What each segment claims of itself, held against what is proved here."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.log import showc_pb2 as pb
from showc.verify.kernel.bernstein import values
from showc.verify.kernel.bound import refuted
from showc.verify.kernel.statement import Statement

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.verify.kernel.show import LoggedShow, Segment


TOLERANCE = 1e-6
"""How far a claimed bound may lie above the time of its witness [s]."""

DISTANCE_TOLERANCE = 1e-3
"""How far a claimed closest encounter may be from the distance at its time [m]."""


def certified(show: LoggedShow) -> list[Statement]:
    """State what bounds on time and claimed encounters of all segments are worth."""
    moves = [segment for segment in show.segments if not segment.holds]
    return [_witnesses(show, moves), _order(moves), _encounters(show)]


def _witnesses(show: LoggedShow, moves: list[Segment]) -> Statement:
    """Every claimed lower bound on a segment's time follows from its witness."""
    title = "no claimed lower bound on a time beyond its proof"
    claims = [one for one in moves if one.message.certificate.dual_bound > 0.0]
    if not claims:
        return Statement("VRF341", title, None, notes=("no segment claims one",))
    worst, where, failed = -np.inf, claims[0], []
    for segment in claims:
        certificate = segment.message.certificate
        witness = certificate.witness
        proved = 0.0
        if certificate.HasField("witness") and witness.drone in segment.drones:
            row = int(np.searchsorted(segment.drones, witness.drone))
            way = segment.goals[row] - segment.ends()[0][row, :3]
            proved = witness.time if refuted(segment.message, show.rules, way) else 0.0
        excess = certificate.dual_bound - proved
        if excess > TOLERANCE:
            failed.append(
                f"“{segment.message.name}” claims {certificate.dual_bound:.6f} s, the "
                f"witness proves {proved:.6f} s"
            )
        if excess > worst:
            worst, where = excess, segment
    shares = [one.message.certificate.dual_bound / one.duration for one in claims]
    note = (
        f"{len(claims)} witnesses; the bounds are {min(shares):.1%} to "
        f"{max(shares):.1%} of the times flown (tolerance {TOLERANCE:.0e} s)"
    )
    return Statement(
        "VRF341",
        title,
        not failed,
        max(worst, 0.0),
        TOLERANCE,
        "s",
        (where.message.certificate.witness.drone,),
        where.message.name,
        where.start,
        (note, *failed[:5]),
    )


def _order(moves: list[Segment]) -> Statement:
    """Bound <= greatest single-drone minimum <= time flown."""
    bad, name, time = [], None, None
    for segment in moves:
        certificate = segment.message.certificate
        bound, single = certificate.dual_bound, certificate.single_drone_minimum
        if bound > segment.duration or (single > 0.0 and bound > single):
            bad.append(
                f"“{segment.message.name}”: bound {bound:.6f} s, single drone "
                f"{single:.6f} s, flown {segment.duration:.6f} s"
            )
            name, time = segment.message.name, segment.start
    return Statement(
        "VRF342",
        "lower bound below single-drone minimum and time flown",
        not bad,
        segment=name,
        time=time,
        notes=tuple(bad[:5]),
    )


def _encounters(show: LoggedShow) -> Statement:
    """Claimed closest encounters are what the polynomials give at their times."""
    title = "claimed closest encounters are as claimed"
    worst, count, where, pair = -1.0, 0, 0.0, (0, 0)
    name = ""
    for segment in show.segments:
        if not segment.message.certificate.HasField("closest"):
            continue
        count += 1
        closest = segment.message.certificate.closest
        one, other, moment = closest.drone_a, closest.drone_b, closest.time
        gap = np.inf
        if (
            one != other
            and {one, other} <= set(segment.drones.tolist())
            and 0.0 <= moment <= segment.duration + 1e-9
        ):
            off = _position(segment, one, moment) - _position(segment, other, moment)
            gap = abs(_distance(show.rules.separation, off) - closest.distance)
        if not gap <= worst:
            worst, where, pair = gap, segment.start + moment, (one, other)
            name = segment.message.name
    if not count:
        return Statement("VRF343", title, None, notes=("no segment claims one",))
    return Statement(
        "VRF343",
        title,
        worst <= DISTANCE_TOLERANCE,
        worst,
        DISTANCE_TOLERANCE,
        "m",
        pair,
        name,
        where,
        (f"{count} encounters",),
    )


def _position(segment: Segment, drone: int, time: float) -> FloatArray:
    table = next(table for table in segment.tables if drone in table.drones)
    table = table.only(int(np.searchsorted(table.drones, drone)))
    row = max(int(np.searchsorted(table.start, time, side="right")) - 1, 0)
    share = (time - table.start[row]) / (table.end[row] - table.start[row])
    found = values(table.state[row : row + 1, :, :3], np.clip([share], 0.0, 1.0))
    return np.asarray(found[0])


def _distance(separation: pb.Separation, difference: FloatArray) -> float:
    shape = separation.shape
    if shape == pb.Separation.ANY_AXIS:
        return float(np.abs(difference).max())
    if shape == pb.Separation.ALL_AXES:
        return float(np.abs(difference).min())
    stretch = separation.vertical_stretch if shape == pb.Separation.ELLIPSOID else 1.0
    return float(np.sqrt(np.sum((difference / np.array([1.0, 1.0, stretch])) ** 2)))
