"""What a flight says beside its samples: rules, segments, exact trajectories."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from showc.log import showc_pb2 as pb
from showc.log.schema import FORMAT_VERSION

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.flight import Certificate, Flight, LegFlight, Trajectory
    from showc.script.show import Show
    from showc.vehicle import Limits

SHAPES = {
    "sphere": pb.Separation.SPHERE,
    "ellipsoid": pb.Separation.ELLIPSOID,
    "any-axis": pb.Separation.ANY_AXIS,
    "all-axes": pb.Separation.ALL_AXES,
}
KINDS = {
    "launch": pb.Segment.LAUNCH,
    "transition": pb.Segment.TRANSITION,
    "approach": pb.Segment.APPROACH,
    "land": pb.Segment.LAND,
    "hold": pb.Segment.HOLD,
    "motion": pb.Segment.MOTION,
}


def vector(values: Sequence[float]) -> pb.Vector3:
    """Three numbers as a message."""
    x, y, z = (float(value) for value in values)
    return pb.Vector3(x=x, y=y, z=z)


def limits_in_use(flight: Flight) -> list[Limits]:
    """Return each set of limits of the flight once, in the order of first use."""
    return list(dict.fromkeys(flown.leg.limits for flown in flight.legs))


def rules_message(flight: Flight) -> pb.Rules:
    """Say what the flight must keep, and what flies."""
    show = flight.itinerary.show
    vehicle, site = show.vehicle, show.site
    fence = [] if site.fence is None else np.asarray(site.fence).ravel().tolist()
    return pb.Rules(
        format_version=FORMAT_VERSION,
        name=show.name,
        drones=show.drones,
        duration=flight.duration,
        site=pb.Site(
            latitude=site.latitude,
            longitude=site.longitude,
            altitude=site.altitude,
            heading=site.heading,
            volume_min=vector(site.volume_min),
            volume_max=vector(site.volume_max),
            fence=fence,
            fence_margin=site.fence_margin,
        ),
        vehicle=pb.Vehicle(
            name=vehicle.name,
            mass=vehicle.mass,
            arm_length=vehicle.arm_length,
            thrust_coefficient=vehicle.thrust_coefficient,
            torque_coefficient=vehicle.torque_coefficient,
            inertia=vector(vehicle.inertia),
            rotor_speed_max=vehicle.rotor_speed_max,
            gravity=vehicle.gravity,
            torque_factor=vehicle.torque_factor,
        ),
        separation=pb.Separation(
            distance=show.separation.distance,
            shape=SHAPES[show.separation.shape],
            vertical_stretch=show.separation.vertical_stretch,
        ),
        yaw_held=show.yaw == "held",
        heading=show.heading,
        log_rate=show.log_rate,
        formations=_formation_messages(show),
        limits=[_limits_message(limits) for limits in limits_in_use(flight)],
    )


def segment_message(flight: Flight, number: int) -> pb.Segment:
    """Return the leg at position ``number`` of the flight, with its certificate."""
    flown = flight.legs[number]
    leg = flown.leg
    return pb.Segment(
        index=number,
        name=leg.name,
        kind=KINDS[leg.kind],
        start=float(flight.starts[number]),
        duration=flown.duration,
        limits=limits_in_use(flight).index(leg.limits),
        from_formation=leg.from_formation,
        to_formation=leg.to_formation,
        drones=leg.drones.tolist(),
        places=leg.places.tolist(),
        goals=leg.goal.ravel().tolist(),
        certificate=_certificate_message(flown.certificate),
        moves=[_move_message(part, flight.itinerary.show) for part in flown.parts],
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
        # What comes near a group is said of the whole leg.
        certificate=_certificate_message(replace(flown.certificate, closest=None)),
    )


def trajectory_message(flown: LegFlight, number: int, position: int) -> pb.Trajectory:
    """Exact flight of the drone at ``position`` of the leg's drones."""
    trajectory: Trajectory = flown.trajectories[position]
    return pb.Trajectory(
        segment=number,
        drone=int(flown.leg.drones[position]),
        breaks=trajectory.state.breaks.tolist(),
        state_degree=trajectory.state.degree,
        state=trajectory.state.coefficients.ravel().tolist(),
        control_degree=trajectory.control.degree,
        control=trajectory.control.coefficients.ravel().tolist(),
        meshes=[
            pb.Mesh(
                breaks=mesh.breaks,
                points=mesh.points,
                iterations=mesh.iterations,
                why=mesh.why,
                found=mesh.found,
                errors=mesh.errors,
            )
            for mesh in trajectory.meshes
        ],
    )


def _formation_messages(show: Show) -> list[pb.Formation]:
    return [
        pb.Formation(name=formation.name, points=formation.points.ravel().tolist())
        for formation in show.formations.values()
    ]


def _limits_message(limits: Limits) -> pb.Limits:
    return pb.Limits(
        velocity_min=vector(limits.velocity_min),
        velocity_max=vector(limits.velocity_max),
        tilt=limits.tilt,
        body_rate=vector(limits.body_rate),
        thrust_min=limits.thrust_min,
        thrust_max=limits.thrust_max,
        torque_max=vector(limits.torque_max),
        position_min=vector(limits.position_min),
        position_max=vector(limits.position_max),
        level_speed=limits.level_speed,
        acceleration=limits.acceleration,
        acceleration_up=limits.acceleration_up,
        acceleration_down=limits.acceleration_down,
        jerk=limits.jerk,
    )


def _certificate_message(certificate: Certificate) -> pb.Certificate:
    message = pb.Certificate(
        single_drone_minimum=certificate.single_drone_minimum,
        dual_bound=certificate.dual_bound,
        method=certificate.method,
        statistics={key: float(v) for key, v in certificate.statistics.items()},
    )
    if certificate.witness is not None:
        witness = certificate.witness
        message.witness.CopyFrom(
            pb.Witness(
                drone=witness.drone,
                time=witness.time,
                beta=vector(witness.beta),
                knots=witness.knots,
                multipliers=[x for knot in witness.multipliers for x in knot],
            )
        )
    if certificate.closest is not None:
        closest = certificate.closest
        message.closest.CopyFrom(
            pb.Encounter(
                drone_a=closest.drone_a,
                drone_b=closest.drone_b,
                time=closest.time,
                distance=closest.distance,
            )
        )
    return message
