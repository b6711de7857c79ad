"""What one vehicle tells of itself: that it lives, where it is, by which clock."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.geodesy import SiteFrame


HEARTBEATS = 2.5
"""How much longer than a position a heartbeat may be missing [s]: vehicles send one a
second, and two may be lost."""

CLOCK_TOLERANCE = 0.5
"""How far a vehicle's clock may run ahead or jump back against ours [s]."""

CLOCK_KNOWN = 10.0
"""Time of positions after which the least delay of the link is known [s]: the first
ones may have waited for the link."""

CLOCK_DRIFT = 8e-4
"""How much slower than ours a vehicle's clock may run: a simulated one lost 0.12 s in
250 s on a busy computer; crystals lose 5e-5."""

ARDUPILOT = 3
"""MAV_AUTOPILOT of ArduPilot."""


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """Where a vehicle says it is, in the show frame."""

    position: FloatArray
    """Shape (3,) [m]."""
    velocity: FloatArray
    """Shape (3,) [m/s]."""
    moment: float
    """When, on our clock [s]."""


class Telemetry:
    """The last word of a vehicle on everything that matters.

    Parameters
    ----------
    frame
        The show frame on the globe.
    """

    def __init__(self, frame: SiteFrame) -> None:
        self.frame = frame
        self.first_heard: float | None = None
        """When it was first heard [s]; None: not yet."""
        self.beat = -np.inf
        """When its last heartbeat came [s]."""
        self.autopilot = 0
        """MAV_AUTOPILOT."""
        self.armed = False
        self.mode = -1
        """Custom mode."""
        self.arming_allowed = True
        """Whether it would let itself be armed, as far as it tells."""
        self.text = ""
        """Its last warning in words."""
        self.fault = ""
        """What is wrong with what it tells."""
        self.ground: FloatArray | None = None
        """Where its global position lies in the show frame, shape (3,), but for its
        height [m]."""
        self.place: Place | None = None
        """Where it is; None before it was anchored."""
        self._local: FloatArray | None = None
        self._anchor: FloatArray | None = None
        self._boot = self._since = -np.inf
        self._offset = np.inf
        self._handlers = {
            "HEARTBEAT": self._beaten,
            "LOCAL_POSITION_NED": self._placed,
            "GLOBAL_POSITION_INT": self._grounded,
            "SYS_STATUS": self._checked,
            "STATUSTEXT": self._spoken,
        }

    @property
    def ardupilot(self) -> bool:
        """Whether the vehicle runs ArduPilot."""
        return self.autopilot == ARDUPILOT

    def handle(self, message: Any, now: float) -> None:  # noqa: ANN401
        """Take a message of the vehicle that came at ``now`` [s]."""
        if self.first_heard is None:
            self.first_heard = now
        handler = self._handlers.get(message.get_type())
        if handler is not None:
            handler(message, now)

    def anchor(self, pad: FloatArray) -> None:
        """Tie the vehicle's local frame to the show frame, in which it is on ``pad``.

        Along the ground by its global position; upwards by the pad it stands on, for
        absolute heights differ by metres.
        """
        assert self._local is not None  # noqa: S101 - see locatable
        assert self.ground is not None  # noqa: S101
        # What it said before it could be placed does not count.
        self.fault = ""
        self._anchor = self.ground - self.from_ned(self._local)
        self._anchor[2] = pad[2] + self._local[2]

    @property
    def locatable(self) -> bool:
        """Whether both its local and its global position are known."""
        return self._local is not None and self.ground is not None

    @property
    def anchored(self) -> bool:
        """Whether its local frame is tied to the show frame."""
        return self._anchor is not None

    def trouble(self, now: float, link_timeout: float) -> str:
        """Say what is wrong with what a flying vehicle tells; empty: nothing.

        Parameters
        ----------
        now
            The time [s].
        link_timeout
            Greatest age of its position [s]; heartbeats may be ``HEARTBEATS`` older.
        """
        if self.fault:
            return self.fault
        if now - self.beat > link_timeout + HEARTBEATS:
            return f"has sent no heartbeat for {now - self.beat:.1f} s"
        age = np.inf if self.place is None else now - self.place.moment
        if age > link_timeout:
            return f"has sent no new position for {age:.1f} s"
        return ""

    def local(self, position: FloatArray) -> FloatArray:
        """Return a show-frame position (3,) in the vehicle's local frame [m]."""
        return self.to_ned(position - (0.0 if self._anchor is None else self._anchor))

    def to_ned(self, vector: FloatArray) -> FloatArray:
        """Return a show-frame vector (3,) as north, east, down."""
        east, north, up = self.frame.to_enu(vector)
        return np.array([north, east, -up])

    def from_ned(self, vector: FloatArray) -> FloatArray:
        """Return a vector north, east, down in the show frame, shape (3,)."""
        north, east, down = vector
        return self.frame.from_enu([east, north, -down])

    def _beaten(self, message: Any, now: float) -> None:  # noqa: ANN401
        self.beat = now
        self.autopilot = int(message.autopilot)
        self.mode = int(message.custom_mode)
        self.armed = bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)

    def _grounded(self, message: Any, _now: float) -> None:  # noqa: ANN401
        # Without a fix ArduPilot tells of zero degrees.
        if message.lat or message.lon:
            self.ground = self.frame.from_geodetic(
                [message.lat * 1e-7, message.lon * 1e-7, self.frame.altitude]
            )

    def _checked(self, message: Any, _now: float) -> None:  # noqa: ANN401
        check = dialect.MAV_SYS_STATUS_PREARM_CHECK
        checked = message.onboard_control_sensors_present & check
        passed = message.onboard_control_sensors_health & check
        self.arming_allowed = bool(passed) or not checked

    def _spoken(self, message: Any, _now: float) -> None:  # noqa: ANN401
        if message.severity <= dialect.MAV_SEVERITY_WARNING:
            self.text = str(message.text)

    def _placed(self, message: Any, now: float) -> None:  # noqa: ANN401
        """Take a position, unless it is no number or an old one."""
        values = np.array(
            [message.x, message.y, message.z, message.vx, message.vy, message.vz],
            dtype=np.float64,
        )
        if not np.isfinite(values).all():
            self.fault = "tells a position that is not a number"
            return
        boot = message.time_boot_ms / 1000.0
        if boot < self._boot - CLOCK_TOLERANCE:
            self.fault = (
                f"has a clock that went back by {self._boot - boot:.1f} s: it started "
                "again, or two vehicles have its number"
            )
            return
        if boot <= self._boot:
            return
        offset = now - boot
        if not np.isfinite(self._boot):
            self._since = boot
        known = boot - self._since > CLOCK_KNOWN
        if known and offset < self._offset - CLOCK_TOLERANCE:
            self.fault = (
                f"has a clock that ran ahead by {self._offset - offset:.1f} s: it, or "
                "this program, stood still"
            )
        drift = CLOCK_DRIFT * (boot - self._boot) if np.isfinite(self._boot) else 0.0
        # The least delayed message tells how the two clocks lie.
        self._offset = min(self._offset + drift, offset)
        self._boot = boot
        self._local = values[:3]
        if self._anchor is not None:
            self.place = Place(
                self.from_ned(values[:3]) + self._anchor,
                self.from_ned(values[3:]),
                boot + self._offset,
            )
