"""What a flight says beside its samples: rules, segments, exact trajectories."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from showc.log import showc_pb2 as pb
from showc.log.facts import rules_of
from showc.log.schema import message_of

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.flight import Certificate, Flight, LegFlight, Trajectory
    from showc.script.show import Show
    from showc.vehicle import Limits

KINDS = {
    "launch": pb.Segment.LAUNCH,
    "transition": pb.Segment.TRANSITION,
    "approach": pb.Segment.APPROACH,
    "land": pb.Segment.LAND,
    "hold": pb.Segment.HOLD,
    "motion": pb.Segment.MOTION,
}


def limits_in_use(flight: Flight) -> list[Limits]:
    """Return each set of limits of the flight once, in the order of first use."""
    return list(dict.fromkeys(flown.leg.limits for flown in flight.legs))


def rules_message(flight: Flight) -> pb.Rules:
    """Say what the flight must keep, and what flies."""
    show = flight.itinerary.show
    formations = {name: one.points for name, one in show.formations.items()}
    return rules_of(show, formations, limits_in_use(flight), flight.duration)


def segment_message(flight: Flight, number: int) -> pb.Segment:
    """Return the leg at position ``number`` of the flight, with its certificate."""
    flown = flight.legs[number]
    message = leg_message(
        flown,
        number,
        float(flight.starts[number]),
        limits_in_use(flight).index(flown.leg.limits),
    )
    show = flight.itinerary.show
    message.certificate.CopyFrom(_certificate_message(flown.certificate))
    message.moves.extend(_move_message(part, show) for part in flown.parts)
    return message


def leg_message(flown: LegFlight, number: int, start: float, limits: int) -> pb.Segment:
    """Return a leg that starts at ``start`` [s], without its certificate.

    ``number`` is its own, ``limits`` that of its limits.
    """
    leg = flown.leg
    return pb.Segment(
        index=number,
        name=leg.name,
        kind=KINDS[leg.kind],
        start=start,
        duration=flown.duration,
        limits=limits,
        from_formation=leg.from_formation,
        to_formation=leg.to_formation,
        drones=leg.drones.tolist(),
        places=leg.places.tolist(),
        goals=leg.goal.ravel().tolist(),
    )


def _move_message(flown: LegFlight, show: Show) -> pb.Move:
    """Return the move of a group that has times of its own."""
    leg = flown.leg
    return pb.Move(
        name=leg.name,
        group=show.transitions[leg.transition or 0].group or "",
        to_formation=leg.to_formation,
        start=leg.depart or 0.0,
        duration=flown.duration,
        kind=KINDS[leg.kind],
        # What comes near a group is said of the whole leg.
        certificate=_certificate_message(replace(flown.certificate, closest=None)),
    )


def trajectory_message(flown: LegFlight, number: int, position: int) -> pb.Trajectory:
    """Exact flight of the drone at ``position`` of the leg's drones."""
    trajectory: Trajectory = flown.trajectories[position]
    message = pb.Trajectory(
        segment=number,
        drone=int(flown.leg.drones[position]),
        state_degree=trajectory.state.degree,
        control_degree=trajectory.control.degree,
        meshes=[message_of(pb.Mesh, mesh) for mesh in trajectory.meshes],
    )
    # As they lie in memory: number by number takes many times as long.
    message.MergeFromString(
        _doubles(pb.Trajectory.BREAKS_FIELD_NUMBER, trajectory.state.breaks)
        + _doubles(pb.Trajectory.STATE_FIELD_NUMBER, trajectory.state.coefficients)
        + _doubles(pb.Trajectory.CONTROL_FIELD_NUMBER, trajectory.control.coefficients)
    )
    return message


def _doubles(number: int, values: FloatArray) -> bytes:
    """Encode a field of doubles as Protocol Buffers do: tag, length, all of them."""
    content = values.astype("<f8").tobytes()
    head = [number << 3 | 2]
    length = len(content)
    while length > 0x7F:
        head.append(length & 0x7F | 0x80)
        length >>= 7
    return bytes([*head, length]) + content


def _certificate_message(certificate: Certificate) -> pb.Certificate:
    message = pb.Certificate(
        single_drone_minimum=certificate.single_drone_minimum,
        dual_bound=certificate.dual_bound,
        method=certificate.method,
        statistics={key: float(v) for key, v in certificate.statistics.items()},
    )
    if certificate.witness is not None:
        witness = certificate.witness
        multipliers = [x for knot in witness.multipliers for x in knot]
        message.witness.CopyFrom(
            message_of(pb.Witness, witness, multipliers=multipliers)
        )
    if certificate.closest is not None:
        message.closest.CopyFrom(message_of(pb.Encounter, certificate.closest))
    return message
