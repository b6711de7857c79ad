"""What each segment claims of itself, held against what is proved here.

The bound on a segment's time is proved by :mod:`showc.verify.kernel.bound`; a claimed
encounter is the distance of two polynomials at one instant, right to rounding (Higham
2002, section 3.1), far below the tolerance.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.verify.kernel.bound import refuted
from showc.verify.kernel.show import Statement
from showc.verify.kernel.slices import Tracks, measures

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.verify.kernel.separation import Encounter
    from showc.verify.kernel.show import LoggedShow, Segment

TOLERANCE = 1e-6
"""How far a claimed bound may lie above the time of its witness [s]."""

DISTANCE_TOLERANCE = 1e-3
"""How far a claimed closest encounter may be from the distance at its time [m]."""


def certified(
    show: LoggedShow, encounters: Sequence[Encounter | None]
) -> list[Statement]:
    """State what bounds on time and claimed encounters of all segments are worth.

    ``encounters`` are the closest ones, one for each segment.
    """
    moves = [segment for segment in show.segments if not segment.holds]
    return [_witnesses(show, moves), _order(moves), _encounters(show, encounters)]


def _witnesses(show: LoggedShow, moves: list[Segment]) -> Statement:
    """Every claimed lower bound on a segment's time follows from its witness."""
    claims = [
        one
        for one in moves
        if (said := one.message.certificate).dual_bound or said.HasField("witness")
    ]
    if not claims:
        return Statement("VRF341", None, notes=("no segment claims one",))
    excess = [_excess(show, segment) for segment in claims]
    worst = int(np.argmax(excess))
    where = claims[worst]
    failed = [
        f"“{one.message.name}” claims {one.message.certificate.dual_bound:.6f} s, its "
        f"witness proves {over:.6f} s less"
        for one, over in zip(claims, excess, strict=True)
        if over > TOLERANCE
    ]
    shares = [one.message.certificate.dual_bound / one.duration for one in claims]
    note = (
        f"{len(claims)} witnesses; the bounds are {min(shares):.1%} to "
        f"{max(shares):.1%} of the times flown (tolerance {TOLERANCE:.0e} s)"
    )
    return Statement(
        "VRF341",
        not failed,
        max(excess[worst], 0.0),
        TOLERANCE,
        "s",
        (where.message.certificate.witness.drone,),
        where.message.name,
        where.start,
        (note, *failed[:5]),
    )


def _excess(show: LoggedShow, segment: Segment) -> float:
    """By how much a claimed bound is beyond what its witness proves [s]."""
    certificate, proved = segment.message.certificate, False
    witness = certificate.witness
    if certificate.HasField("witness") and witness.drone < show.drones:
        way = segment.goals[witness.drone] - segment.ends()[0][witness.drone, :3]
        proved = refuted(segment.message, show.rules, way)
    return certificate.dual_bound - witness.time if proved else np.inf


def _order(moves: list[Segment]) -> Statement:
    """Bound <= greatest single-drone minimum <= time flown."""
    bad, name, time = [], None, None
    for segment in moves:
        certificate = segment.message.certificate
        bound, single = certificate.dual_bound, certificate.single_drone_minimum
        flown = segment.duration
        if not 0.0 <= bound <= (single or flown) <= flown + TOLERANCE:
            bad.append(
                f"“{segment.message.name}”: bound {bound:.6f} s, single drone "
                f"{single:.6f} s, flown {flown:.6f} s"
            )
            name, time = segment.message.name, segment.start
    return Statement(
        "VRF342",
        not bad,
        segment=name,
        time=time,
        notes=tuple(bad[:5]),
    )


def _encounters(show: LoggedShow, found: Sequence[Encounter | None]) -> Statement:
    """Claimed encounters are the closest ones, and there at their times."""
    moves = [
        (segment, encounter)
        for segment, encounter in zip(show.segments, found, strict=True)
        if encounter is not None and not segment.holds
    ]
    if not moves:
        return Statement("VRF343", None, notes=("no segment claims one",))
    off = [_off(show, *move) for move in moves]
    worst = int(np.argmax(off))
    segment = moves[worst][0]
    closest = segment.message.certificate.closest
    return Statement(
        "VRF343",
        off[worst] <= DISTANCE_TOLERANCE,
        off[worst],
        DISTANCE_TOLERANCE,
        "m",
        (closest.drone_a, closest.drone_b),
        segment.message.name,
        segment.start + closest.time,
        (f"{len(moves)} encounters",),
    )


def _off(show: LoggedShow, segment: Segment, nearest: Encounter) -> float:
    """How far a claimed distance is off the closest, and off the one then [m]."""
    closest = segment.message.certificate.closest
    pair = np.array([closest.drone_a, closest.drone_b])
    if (
        pair[0] == pair[1]
        or pair.max() >= show.drones
        or not 0.0 <= closest.time <= segment.duration + 1e-9
    ):
        return np.inf
    time = np.full(2, segment.start + closest.time)
    tracks = Tracks.of(segment)
    place = tracks.between(tracks.at(pair, time), time, time)[:, 0]
    distance = min(
        float(measure(measure.space(place[1] - place[0])))
        for measure in measures(show.rules.separation)
    )
    claimed = closest.distance
    gap = max(abs(distance - claimed), abs(nearest.upper - claimed))
    return gap if gap >= 0.0 else np.inf
