"""What one vehicle is ordered and what it answers, from its pad to its landing.

A pilot has no sockets and no clock: it is fed with the vehicle's messages and with the
time, and hands out the messages to send. An order is given once; it is repeated only
while no answer comes, and what counts then is what the vehicle tells of itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from showc.vehicle_link.questions import result_name
from showc.vehicle_link.telemetry import Telemetry
from showc.vehicle_link.tuning import Tuning

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.geodesy import SiteFrame
    from showc.vehicle_link.network import Address
    from showc.vehicle_link.tuning import ParameterWishes


POSITION_VELOCITY_ACCELERATION = 0x0C00
"""Type mask of a setpoint: everything but yaw and yaw rate."""

POSITION_VELOCITY = 0x0DC0
"""The same without acceleration."""

RETRY = 1.5
"""Time without an answer after which an order is given again [s]."""

ATTEMPTS = 10
"""How often an order is given without an answer."""

AT_HEIGHT = 0.5
"""A vehicle has taken off when it is this near its height [m]."""

LIFTED = 0.2
"""Height above its pad at which a vehicle has left the ground [m]."""

LIFT_OFF_TIME = 5.0
"""Time after a refused take-off in which a vehicle may be seen to rise [s]: ArduCopter
spools up for 2 s, and answers a second order with a refusal once it has risen."""

POSITION_INTERVALS = {
    dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 0.1,
    dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 0.2,
    dialect.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
}
"""Messages that are needed, and their period [s]."""

GUIDED, BRAKE = 4, 17
"""Modes of ArduCopter."""

PX4_OFFBOARD, PX4_HOLD = (6, 0), (4, 3)
"""Main and sub modes of PX4."""


class Phase(Enum):
    """Where a vehicle is in the course of a show."""

    UNHEARD = "not heard"
    UNPLACED = "tells no position"
    CHECKING = "reading parameters"
    WRITING = "writing parameters"
    UNREADY = "does not allow arming yet"
    WAITING = "waits for the others"
    CHANGING_MODE = "changing mode"
    ARMING = "arming"
    CLIMBING = "taking off"
    READY = "ready"
    FLYING = "flying"
    LANDING = "landing"
    LANDED = "landed"
    HOLDING = "holding"
    FAILED = "failed"


DOWN = frozenset({Phase.LANDING, Phase.LANDED, Phase.HOLDING, Phase.FAILED})
"""Phases of a show that is over for a vehicle."""


@dataclass(slots=True)
class _Order:
    """A command, and what has become of it."""

    parameters: tuple[float, ...]
    due: float
    tries: int = 0
    over: bool = False


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
    reach
        How far beside its pad it may stand, and rise [m].
    wishes
        What its parameters must be.
    """

    def __init__(
        self,
        drone: int,
        vehicle: Address,
        frame: SiteFrame,
        *,
        start: FloatArray,
        pad: FloatArray,
        reach: float,
        wishes: ParameterWishes,
    ) -> None:
        self.drone = drone
        self.vehicle = vehicle
        self.frame = frame
        self.start, self.pad, self.reach = start, pad, reach
        self.tuning = Tuning(vehicle, wishes)
        self.phase = Phase.UNHEARD
        self.reason = ""
        self.tells = Telemetry(frame)
        self.setpoints = 0
        self._orders: dict[int, _Order] = {}
        self._asked_for = list(POSITION_INTERVALS)
        self._takeoff_refused: float | None = None

    def handle(self, message: Any, now: float) -> None:  # noqa: ANN401
        """Take a message of the vehicle."""
        self.tells.handle(message, now)
        kind = message.get_type()
        if kind == "HEARTBEAT" and self.phase is Phase.UNHEARD:
            self.phase = Phase.UNPLACED
        elif kind == "PARAM_VALUE":
            unsettled = {Phase.CHECKING, Phase.WRITING, *DOWN}
            self.tuning.handle(message, now, heed=self.phase not in unsettled)
        elif kind == "COMMAND_ACK":
            self._acknowledged(int(message.command), int(message.result), now)

    # --- towards the show -----------------------------------------------------------

    def prepare(self, now: float, *, arm: bool) -> list[Any]:
        """Advance towards READY; return the messages to send.

        Parameters
        ----------
        now
            The time [s].
        arm
            Whether all vehicles are waiting to be armed.
        """
        out: list[Any] = []
        if self.phase is Phase.UNPLACED:
            out += self._ask_for_positions(now)
            self._find_place()
        if self.phase in {Phase.CHECKING, Phase.WRITING}:
            out += self._look_at_parameters(now)
        if self.phase is Phase.UNREADY and self.tells.arming_allowed:
            self.phase = Phase.WAITING
        if self.phase is Phase.WAITING and arm:
            self.phase = Phase.CHANGING_MODE
        if self.phase is Phase.CHANGING_MODE and self.tells.mode == self._guided():
            self.phase = Phase.ARMING
        if self.phase is Phase.ARMING and self.tells.armed:
            self.phase = Phase.CLIMBING if self.tells.ardupilot else Phase.READY
        if self.phase is Phase.CLIMBING:
            self._climbed(now)
        return [*out, *self._offboard(), *self._orders_of_phase(now)]

    def _ask_for_positions(self, now: float) -> list[Any]:
        """Ask for the messages that are needed, one after the other."""
        if not self._asked_for:
            return []
        number = self._asked_for[0]
        period = 1e6 * POSITION_INTERVALS[number]
        return self._order(
            dialect.MAV_CMD_SET_MESSAGE_INTERVAL, now, float(number), period
        )

    def _find_place(self) -> None:
        """See where the vehicle stands."""
        tells = self.tells
        if self._asked_for or not tells.locatable or tells.ground is None:
            return
        off = float(np.linalg.norm((tells.ground - self.pad)[:2]))
        if off > self.reach:
            self.fail(
                f"stands {off:.1f} m from its pad; wanted at most {self.reach:.1f} m: "
                "the corridor, and half the way to the next pad"
            )
            return
        if tells.armed:
            self.fail("is armed; a show begins with vehicles that are disarmed")
            return
        tells.anchor(self.pad)
        if self.tells.ardupilot and self.tuning.needs:
            self.phase = Phase.CHECKING
            self.tuning.read()
        else:
            self.phase = Phase.UNREADY

    def _look_at_parameters(self, now: float) -> list[Any]:
        """Read the parameters that matter; change those with which it cannot follow."""
        out = self.tuning.look(now)
        if self.tuning.fault:
            self.fail(self.tuning.fault)
        elif self.tuning.settled:
            self.phase = Phase.UNREADY
        elif self.tuning.raised:
            self.phase = Phase.WRITING
        return out

    def landed(self) -> None:
        """Note that the vehicle has landed and disarmed."""
        self.phase = Phase.LANDED
        self.tuning.give_back()

    def restore(self, now: float) -> list[Any]:
        """Give raised parameters their former values; return the messages to send."""
        return [] if self.restored else self.tuning.due(now)

    @property
    def restored(self) -> bool:
        """Whether no parameter is left raised, or nothing can be done about it."""
        return self.phase is not Phase.LANDED or self.tuning.over

    def _climbed(self, now: float) -> None:
        """See whether a vehicle that takes off is where it joins the show."""
        place = self.tells.place
        if place is None:
            return
        height = abs(float(place.position[2] - self.start[2]))
        slow = float(np.linalg.norm(place.velocity)) < AT_HEIGHT
        if height < AT_HEIGHT and slow:
            self.phase = Phase.READY
        refused = self._takeoff_refused
        if (
            refused is not None
            and now - refused > LIFT_OFF_TIME
            and float(place.position[2] - self.pad[2]) < LIFTED
        ):
            self.fail(f"refuses to take off{self._words()}")

    def _offboard(self) -> list[Any]:
        """Setpoints that PX4 must receive before it goes offboard."""
        waiting = {Phase.CHANGING_MODE, Phase.ARMING, Phase.READY}
        if self.tells.ardupilot or self.phase not in waiting or not self.tells.anchored:
            return []
        return [self.setpoint(self.pad, np.zeros(3), None, 0)]

    def _orders_of_phase(self, now: float) -> list[Any]:
        """Orders of the present phase."""
        if self.phase is Phase.CHANGING_MODE:
            mode = (GUIDED, 0) if self.tells.ardupilot else PX4_OFFBOARD
            return self._set_mode(now, *mode)
        if self.phase is Phase.ARMING:
            return self._order(dialect.MAV_CMD_COMPONENT_ARM_DISARM, now, 1.0)
        if self.phase is Phase.CLIMBING and self._takeoff_refused is None:
            height = float(self.start[2] - self.pad[2])
            return self._order(
                dialect.MAV_CMD_NAV_TAKEOFF, now, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, height
            )
        return []

    # --- in the show ----------------------------------------------------------------

    def setpoint(
        self,
        position: FloatArray,
        velocity: FloatArray,
        acceleration: FloatArray | None,
        milliseconds: int,
    ) -> Any:  # noqa: ANN401
        """Return the setpoint for a place, speed and acceleration in the show frame."""
        mask = POSITION_VELOCITY_ACCELERATION
        if acceleration is None:
            mask, acceleration = POSITION_VELOCITY, np.zeros(3)
        self.setpoints += 1
        return dialect.MAVLink_set_position_target_local_ned_message(
            milliseconds & 0xFFFFFFFF,
            *self.vehicle,
            dialect.MAV_FRAME_LOCAL_NED,
            mask,
            *(float(value) for value in self.tells.local(position)),
            *(float(value) for value in self.tells.to_ned(velocity)),
            *(float(value) for value in self.tells.to_ned(acceleration)),
            0.0,
            0.0,
        )

    def off_mode(self) -> bool:
        """Return whether the vehicle has left the mode or disarmed by itself."""
        return self.tells.mode != self._guided() or not self.tells.armed

    def unfit(self) -> str:
        """Say what is wrong with a vehicle on its way to the show; empty: nothing."""
        if self.phase in {Phase.UNHEARD, Phase.UNPLACED}:
            return ""
        ordered = {Phase.ARMING, Phase.CLIMBING, Phase.READY}
        left = self.phase in ordered and self.tells.mode != self._guided()
        if left or (self.phase is Phase.READY and not self.tells.armed):
            return "left its mode or disarmed"
        place = self.tells.place
        if place is not None:
            off = float(np.linalg.norm((place.position - self.pad)[:2]))
            if off > 2.0 * self.reach:
                return f"has moved {off:.1f} m from its pad"
        return self.tells.fault or self.tuning.changed

    def trouble(self, now: float, link_timeout: float) -> str:
        """Say what is wrong with a vehicle in flight; empty: nothing."""
        if self.off_mode() and not self.tells.fault:
            return "left its mode or disarmed"
        if self.tuning.changed:
            return self.tuning.changed
        return self.tells.trouble(now, link_timeout)

    def hold(self, now: float) -> list[Any]:
        """Return the order to stop and hover on the spot, if it is due."""
        self.phase = Phase.HOLDING
        if self.tells.mode != self._guided():
            return []
        if self.tells.ardupilot:
            return self._set_mode(now, BRAKE, 0)
        return self._set_mode(now, *PX4_HOLD)

    @property
    def held(self) -> bool:
        """Whether the vehicle is in the mode that holds."""
        main, sub = PX4_HOLD
        return self.tells.mode == (
            BRAKE if self.tells.ardupilot else main << 16 | sub << 24
        )

    def land(self, now: float) -> list[Any]:
        """Return the order to land on the spot, if it is due."""
        self.phase = Phase.LANDING
        if self.tells.mode != self._guided():
            # It obeys already, or is in other hands.
            return []
        return self._order(dialect.MAV_CMD_NAV_LAND, now)

    def fail(self, reason: str) -> None:
        """End the show for this vehicle."""
        if self.phase is not Phase.FAILED:
            self.phase, self.reason = Phase.FAILED, reason

    # --- orders ---------------------------------------------------------------------

    def _guided(self) -> int:
        """Return the custom mode in which setpoints are followed."""
        return GUIDED if self.tells.ardupilot else PX4_OFFBOARD[0] << 16

    def _words(self) -> str:
        return f" ({self.tells.text!r})" if self.tells.text else ""

    def _set_mode(self, now: float, main: int, sub: int) -> list[Any]:
        custom = float(dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
        mode = dialect.MAV_CMD_DO_SET_MODE
        return self._order(mode, now, custom, float(main), float(sub))

    def _order(self, command: int, now: float, *parameters: float) -> list[Any]:
        """Return the message of an order if it is due: once, unless no answer comes."""
        order = self._orders.get(command)
        if order is None or order.parameters != parameters:
            order = self._orders[command] = _Order(parameters, now)
        if order.over or now < order.due:
            return []
        if order.tries >= ATTEMPTS:
            order.over = True
            self._unanswered(command)
            return []
        order.due, order.tries = now + RETRY, order.tries + 1
        padded = (*parameters, *[0.0] * 7)[:7]
        return [
            dialect.MAVLink_command_long_message(
                *self.vehicle, command, order.tries - 1, *padded
            )
        ]

    def _unanswered(self, command: int) -> None:
        if command == dialect.MAV_CMD_SET_MESSAGE_INTERVAL:
            self._asked_for.pop(0)
        elif self.phase not in {Phase.LANDING, Phase.HOLDING}:
            self.fail(f"does not answer {result_name('MAV_CMD', command)}")

    def _acknowledged(self, command: int, result: int, now: float) -> None:
        order = self._orders.get(command)
        if order is None or order.over:
            return
        if self.phase in {Phase.LANDING, Phase.HOLDING}:
            # Whatever it says: asked again until it leaves the mode of setpoints.
            order.due = now + RETRY
            return
        if result == dialect.MAV_RESULT_IN_PROGRESS:
            order.due = np.inf
            return
        if result == dialect.MAV_RESULT_TEMPORARILY_REJECTED:
            order.due, order.tries = now + RETRY, 0
            return
        order.over = True
        if command == dialect.MAV_CMD_SET_MESSAGE_INTERVAL:
            # Refused or not: what it sends is what counts.
            self._asked_for.pop(0)
        elif result == dialect.MAV_RESULT_ACCEPTED:
            return
        elif command == dialect.MAV_CMD_NAV_TAKEOFF:
            self._takeoff_refused = now
        elif self.phase is not Phase.FLYING:
            self.fail(
                f"answers {result_name('MAV_CMD', command)} with "
                f"{result_name('MAV_RESULT', result)}{self._words()}"
            )
