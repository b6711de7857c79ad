"""What one vehicle is told and what it answers, from its pad to its landing.

A pilot has no sockets and no clock: it is fed with the vehicle's messages and with the
time, and hands out the messages to send.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.mission.geodesy import SiteFrame
    from showc.vehicle_link.network import Address

    FloatArray = NDArray[np.float64]

POSITION_VELOCITY_ACCELERATION = 0x0C00
"""Type mask of a setpoint: everything but yaw and yaw rate."""

POSITION_VELOCITY = 0x0DC0
"""The same without acceleration."""

RETRY = 1.0
"""Time after which a command is given again [s]."""

AT_HEIGHT = 0.5
"""A vehicle has taken off when it is this near its height [m]."""

ARDUPILOT = 3
"""MAV_AUTOPILOT of ArduPilot."""

GUIDED, BRAKE = 4, 17
"""Modes of ArduCopter."""

PX4_OFFBOARD = (6, 0)
PX4_HOLD = (4, 3)
"""Main and sub modes of PX4."""


class Phase(Enum):
    """Where a vehicle is in the course of a show."""

    UNHEARD = "not heard"
    UNPLACED = "tells no position"
    CHANGING_MODE = "changing mode"
    ARMING = "arming"
    CLIMBING = "taking off"
    READY = "ready"
    FLYING = "flying"
    LANDING = "landing"
    LANDED = "landed"
    FAILED = "failed"


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """Where a vehicle says it is, in the show frame."""

    position: FloatArray
    """Shape (3,) [m]."""
    velocity: FloatArray
    """Shape (3,) [m/s]."""


class Pilot:
    """Takes one vehicle through a show.

    Parameters
    ----------
    drone
        Counting from 0.
    vehicle
        System and component to talk to.
    frame
        The show frame on the globe.
    start
        Where the drone joins the show, shape (3,), show frame [m].
    pad
        Where it stands before, likewise.
    corridor
        How far from its pad it may stand [m].
    """

    def __init__(
        self,
        drone: int,
        vehicle: Address,
        frame: SiteFrame,
        *,
        start: FloatArray,
        pad: FloatArray,
        corridor: float,
    ) -> None:
        self.drone = drone
        self.vehicle = vehicle
        self.frame = frame
        self.start, self.pad, self.corridor = start, pad, corridor
        self.phase = Phase.UNHEARD
        self.reason = ""
        self.heard = -np.inf
        self.place: Place | None = None
        self.autopilot = 0
        self.armed = False
        self.mode = -1
        self.setpoints = 0
        self._local: FloatArray | None = None
        self._ground: FloatArray | None = None
        self._anchor: FloatArray | None = None
        self._asked = -np.inf

    @property
    def ardupilot(self) -> bool:
        """Whether the vehicle runs ArduPilot."""
        return self.autopilot == ARDUPILOT

    def handle(self, message: Any, now: float) -> None:  # noqa: ANN401
        """Take a message of the vehicle."""
        self.heard = now
        kind = message.get_type()
        if kind == "HEARTBEAT":
            self.autopilot = int(message.autopilot)
            self.mode = int(message.custom_mode)
            self.armed = bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
            if self.phase is Phase.UNHEARD:
                self.phase = Phase.UNPLACED
        elif kind == "LOCAL_POSITION_NED":
            self._local = np.array([message.x, message.y, message.z])
            speed = np.array([message.vx, message.vy, message.vz])
            if self._anchor is not None:
                self.place = Place(
                    self._from_ned(self._local) + self._anchor, self._from_ned(speed)
                )
        elif kind == "GLOBAL_POSITION_INT":
            self._ground = self.frame.from_geodetic(
                [message.lat * 1e-7, message.lon * 1e-7, self.frame.altitude]
            )
        elif kind == "COMMAND_ACK":
            self._acknowledged(int(message.command), int(message.result))

    def prepare(self, now: float) -> list[Any]:
        """Advance towards READY; return the messages to send."""
        if self.phase is Phase.UNPLACED:
            self._find_place()
        if self.phase is Phase.CHANGING_MODE and self.mode == self._guided():
            self.phase, self._asked = Phase.ARMING, -np.inf
        if self.phase is Phase.ARMING and self.armed:
            self.phase = Phase.CLIMBING if self.ardupilot else Phase.READY
            self._asked = -np.inf
        if self.phase is Phase.CLIMBING and self.place is not None:
            height = abs(float(self.place.position[2] - self.start[2]))
            slow = float(np.linalg.norm(self.place.velocity)) < AT_HEIGHT
            if height < AT_HEIGHT and slow:
                self.phase = Phase.READY
        return [*self._offboard(), *self._commands(now)]

    def setpoint(
        self,
        position: FloatArray,
        velocity: FloatArray,
        acceleration: FloatArray | None,
        milliseconds: int,
    ) -> Any:  # noqa: ANN401
        """Return the setpoint for a place, speed and acceleration in the show frame."""
        anchor = np.zeros(3) if self._anchor is None else self._anchor
        mask = POSITION_VELOCITY_ACCELERATION
        if acceleration is None:
            mask, acceleration = POSITION_VELOCITY, np.zeros(3)
        self.setpoints += 1
        return dialect.MAVLink_set_position_target_local_ned_message(
            milliseconds & 0xFFFFFFFF,
            *self.vehicle,
            dialect.MAV_FRAME_LOCAL_NED,
            mask,
            *(float(value) for value in self._to_ned(position - anchor)),
            *(float(value) for value in self._to_ned(velocity)),
            *(float(value) for value in self._to_ned(acceleration)),
            0.0,
            0.0,
        )

    def off_mode(self) -> bool:
        """Return whether the vehicle has left the mode or disarmed by itself."""
        return self.mode != self._guided() or not self.armed

    def hold(self) -> Any:  # noqa: ANN401
        """Return the command to stop and hover on the spot."""
        if self.ardupilot:
            return self._set_mode(BRAKE, 0)
        return self._set_mode(*PX4_HOLD)

    def land(self) -> Any:  # noqa: ANN401
        """Return the command to land on the spot."""
        return self._command(dialect.MAV_CMD_NAV_LAND)

    def fail(self, reason: str) -> None:
        """End the show for this vehicle."""
        if self.phase is not Phase.FAILED:
            self.phase, self.reason = Phase.FAILED, reason

    def _guided(self) -> int:
        """Return the custom mode in which setpoints are followed."""
        return GUIDED if self.ardupilot else PX4_OFFBOARD[0] << 16

    def _find_place(self) -> None:
        """Tie the vehicle's local frame to the show frame.

        Along the ground by its global position; upwards by the pad it stands on, for
        absolute heights differ by metres.
        """
        if self._local is None or self._ground is None:
            return
        off = float(np.linalg.norm((self._ground - self.pad)[:2]))
        if off > self.corridor:
            self.fail(f"stands {off:.1f} m from its pad")
            return
        self._anchor = self._ground - self._from_ned(self._local)
        self._anchor[2] = self.pad[2] + self._local[2]
        self.phase = Phase.CHANGING_MODE

    def _offboard(self) -> list[Any]:
        """Setpoints that PX4 must receive before it goes offboard."""
        waiting = {Phase.CHANGING_MODE, Phase.ARMING, Phase.READY}
        if self.ardupilot or self.phase not in waiting or self._anchor is None:
            return []
        return [self.setpoint(self.pad, np.zeros(3), None, 0)]

    def _commands(self, now: float) -> list[Any]:
        """Commands of the present phase, again after a while."""
        if now - self._asked < RETRY:
            return []
        self._asked = now
        if self.phase is Phase.CHANGING_MODE:
            mode = (GUIDED, 0) if self.ardupilot else PX4_OFFBOARD
            return [self._set_mode(*mode)]
        if self.phase is Phase.ARMING:
            return [self._command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)]
        if self.phase is Phase.CLIMBING and self._on_ground():
            height = float(self.start[2] - self.pad[2])
            return [
                self._command(
                    dialect.MAV_CMD_NAV_TAKEOFF, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, height
                )
            ]
        return []

    def _on_ground(self) -> bool:
        return self.place is not None and bool(
            self.place.position[2] - self.pad[2] < AT_HEIGHT
        )

    def _acknowledged(self, command: int, result: int) -> None:
        accepted = {
            dialect.MAV_RESULT_ACCEPTED,
            dialect.MAV_RESULT_IN_PROGRESS,
            dialect.MAV_RESULT_TEMPORARILY_REJECTED,
        }
        if result in accepted or self.phase in {Phase.FLYING, Phase.LANDING}:
            return
        names = dialect.enums["MAV_CMD"]
        name = names[command].name if command in names else str(command)
        outcome = dialect.enums["MAV_RESULT"][result].name
        self.fail(f"answers {name} with {outcome}")

    def _set_mode(self, main: int, sub: int) -> Any:  # noqa: ANN401
        return self._command(
            dialect.MAV_CMD_DO_SET_MODE,
            float(dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED),
            float(main),
            float(sub),
        )

    def _command(self, command: int, *parameters: float) -> Any:  # noqa: ANN401
        padded = (*parameters, *[0.0] * 7)[:7]
        return dialect.MAVLink_command_long_message(*self.vehicle, command, 0, *padded)

    def _to_ned(self, vector: FloatArray) -> FloatArray:
        east, north, up = self.frame.to_enu(vector)
        return np.array([north, east, -up])

    def _from_ned(self, vector: FloatArray) -> FloatArray:
        north, east, down = vector
        return self.frame.from_enu([east, north, -down])
