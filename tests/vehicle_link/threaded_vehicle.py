"""A small vehicle of the tests' own: MAVLink over UDP, in a thread.

It keeps a mission as ArduPilot does (its own home, truncated centimetres, frame 0 for
items without a position), arms, changes modes, takes off, follows setpoints with a
little lag, and tells where it is. It can lose datagrams, refuse an item, forget a
digit, fall silent, or drift away.
"""

from __future__ import annotations

import random
import socket
import threading
import time
from dataclasses import dataclass, field

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as m

LAG = 0.08
"""Time constant with which setpoints are followed [s]."""


@dataclass
class Faults:
    """What goes wrong."""

    loss: float = 0.0
    refuse_item: int | None = None
    change_item: int | None = None
    silent_at: float = np.inf
    drift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    drift_at: float = np.inf
    refuse_arming: bool = False
    taken_over_at: float = np.inf
    """When a pilot takes it over with the sticks: mode LOITER."""


@dataclass
class Flown:
    """What a vehicle remembers for the tests."""

    commands: list[int] = field(default_factory=list)
    modes: list[int] = field(default_factory=list)
    setpoints: list[tuple[float, int]] = field(default_factory=list)
    stamps: list[float] = field(default_factory=list)


class Vehicle(threading.Thread):
    """One vehicle; ``rate`` is how fast its time runs against the wall's."""

    def __init__(
        self,
        port: int,
        system: int = 1,
        *,
        autopilot: int = m.MAV_AUTOPILOT_ARDUPILOTMEGA,
        origin: tuple[float, float, float] = (48.1374, 11.5755, 520.0),
        stands: tuple[float, float, float] = (0.0, 0.0, 0.0),
        rate: float = 1.0,
        faults: Faults | None = None,
    ) -> None:
        super().__init__(daemon=True)
        self.system, self.autopilot, self.rate = system, autopilot, rate
        self.faults = faults or Faults()
        self.flown = Flown()
        self.random = random.Random(system)
        self.codec = m.MAVLink(None, system, 1)
        self.codec.robust_parsing = True
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.settimeout(0.004)
        self.station = ("127.0.0.1", port)
        self.origin = origin
        # Local frame: north, east, down of where it was switched on.
        self.stands = np.array(stands)
        self.position = np.zeros(3)
        self.velocity = np.zeros(3)
        self.target = None
        self.armed = False
        self.mode = 0
        self.items: list = []
        self.expected = 0
        self.incoming: list = []
        self.ending = threading.Event()
        self.begun = time.monotonic()

    def now(self) -> float:
        return (time.monotonic() - self.begun) * self.rate

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_):
        self.ending.set()
        self.join(5.0)
        self.socket.close()

    def run(self) -> None:
        beat = state = -1.0
        before = self.now()
        while not self.ending.is_set():
            now = self.now()
            self.step(now - before, now)
            before = now
            if now - beat >= 0.5:
                beat = now
                self.send(self.heartbeat())
            if now - state >= 0.05:
                state = now
                self.report(now)
            try:
                data, _ = self.socket.recvfrom(65536)
            except OSError:
                continue
            if self.random.random() < self.faults.loss:
                continue
            for message in self.codec.parse_buffer(data) or []:
                self.handle(message, now)

    def send(self, message) -> None:
        data = message.pack(self.codec)
        lost = self.random.random() < self.faults.loss
        if not lost and self.now() < self.faults.silent_at:
            self.socket.sendto(data, self.station)

    def heartbeat(self):
        flags = m.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        if self.armed:
            flags |= m.MAV_MODE_FLAG_SAFETY_ARMED
        return m.MAVLink_heartbeat_message(
            m.MAV_TYPE_QUADROTOR, self.autopilot, flags, self.mode, 4, 3
        )

    def report(self, now: float) -> None:
        boot = int(now * 1000.0)
        self.send(
            m.MAVLink_local_position_ned_message(boot, *self.position, *self.velocity)
        )
        latitude, longitude, altitude = self.origin
        north, east, down = self.position + self.stands
        # Metres a degree at this place on WGS 84, good to millimetres near by.
        phi = np.radians(latitude)
        e2 = 6.69437999014e-3
        w = 1.0 - e2 * np.sin(phi) ** 2
        meridian = np.radians(1.0) * 6378137.0 * (1.0 - e2) / w**1.5
        parallel = np.radians(1.0) * 6378137.0 / w**0.5 * np.cos(phi)
        self.send(
            m.MAVLink_global_position_int_message(
                boot,
                round((latitude + north / meridian) * 1e7),
                round((longitude + east / parallel) * 1e7),
                round((altitude - down) * 1000.0),
                round(-self.position[2] * 1000.0),
                0,
                0,
                0,
                65535,
            )
        )

    def step(self, dt: float, now: float) -> None:
        """Follow the target."""
        if now > self.faults.taken_over_at and self.mode == 4:
            self.mode, self.target = 5, None
            self.faults.taken_over_at = np.inf
        if not self.armed or self.target is None or dt <= 0.0:
            return
        goal, speed, stamp = self.target
        goal = goal + speed * min(now - stamp, 0.5)
        if now > self.faults.drift_at:
            goal = goal + np.array(self.faults.drift) * (now - self.faults.drift_at)
        before = self.position.copy()
        part = 1.0 - np.exp(-dt / LAG)
        # Feed-forward of the commanded speed keeps the lag in position small.
        self.position = before + speed * dt
        self.position += (goal - self.position) * part
        self.position[2] = min(self.position[2], 0.0)
        self.velocity = (self.position - before) / dt

    def handle(self, message, now: float) -> None:
        name = message.get_type()
        if getattr(message, "target_system", self.system) not in {0, self.system}:
            return
        handler = getattr(self, f"on_{name.lower()}", None)
        if handler is not None:
            handler(message, now)

    # --- missions -------------------------------------------------------------------

    def on_mission_count(self, message, _) -> None:
        self.expected, self.incoming = message.count, []
        self.ask()

    def ask(self) -> None:
        self.send(
            m.MAVLink_mission_request_int_message(255, 190, len(self.incoming), 0)
        )

    def acknowledge(self, result: int) -> None:
        self.send(m.MAVLink_mission_ack_message(255, 190, result, 0))

    def on_mission_item_int(self, message, _) -> None:
        if message.seq != len(self.incoming):
            if self.incoming and len(self.incoming) == self.expected:
                self.acknowledge(0)
            else:
                self.ask()
            return
        if message.seq == self.faults.refuse_item:
            self.acknowledge(m.MAV_MISSION_UNSUPPORTED)
            return
        self.incoming.append(message)
        if len(self.incoming) < self.expected:
            self.ask()
        else:
            self.items = [self.stored(item) for item in self.incoming]
            self.acknowledge(0)

    def stored(self, item):
        """What ArduPilot keeps; other autopilots keep everything."""
        frame, x, y, z = item.frame, item.x, item.y, item.z
        parameters = [item.param1, item.param2, item.param3, item.param4]
        if self.autopilot == m.MAV_AUTOPILOT_ARDUPILOTMEGA:
            z = float(np.trunc(np.float32(z) * np.float32(100.0))) / 100.0
            if item.seq == 0:
                frame, parameters = 0, [0.0] * 4
                x, y, z = 481374000, 115755000, 519.5
            elif item.command in {16, 21, 22}:
                parameters = [0.0, 0.0, 0.0, 1.0 if item.command == 21 else 0.0]
            else:
                frame, x, y, z = 0, 0, 0, 0.0
        if item.seq == self.faults.change_item:
            x += 1
            parameters[0] += 1.0
        return frame, item.command, parameters, x, y, z

    def on_mission_request_list(self, _, __) -> None:
        self.send(m.MAVLink_mission_count_message(255, 190, len(self.items), 0))

    def on_mission_request_int(self, message, _) -> None:
        frame, command, parameters, x, y, z = self.items[message.seq]
        self.send(
            m.MAVLink_mission_item_int_message(
                255, 190, message.seq, frame, command, 0, 1, *parameters, x, y, z, 0
            )
        )

    # --- flying ---------------------------------------------------------------------

    def on_command_long(self, message, now: float) -> None:
        self.flown.commands.append(message.command)
        result = m.MAV_RESULT_ACCEPTED
        if message.command == m.MAV_CMD_COMPONENT_ARM_DISARM:
            if self.faults.refuse_arming:
                result = m.MAV_RESULT_DENIED
            else:
                self.armed = bool(message.param1)
        elif message.command == m.MAV_CMD_DO_SET_MODE:
            self.mode = int(message.param2)
            if self.autopilot == m.MAV_AUTOPILOT_PX4:
                self.mode = int(message.param2) << 16 | int(message.param3) << 24
            self.flown.modes.append(self.mode)
            self.target = (self.position.copy(), np.zeros(3), now)
        elif message.command == m.MAV_CMD_NAV_TAKEOFF:
            up = self.position + np.array([0.0, 0.0, -message.param7])
            self.target = (up, np.zeros(3), now)
        elif message.command == m.MAV_CMD_NAV_LAND:
            ground = self.position * np.array([1.0, 1.0, 0.0])
            self.position, self.velocity = ground, np.zeros(3)
            self.armed = False
        self.send(m.MAVLink_command_ack_message(message.command, result))
        self.send(self.heartbeat())

    def on_set_position_target_local_ned(self, message, now: float) -> None:
        self.flown.setpoints.append((now, message.type_mask))
        self.flown.stamps.append(message.time_boot_ms / 1000.0)
        guided = 4 if self.autopilot == m.MAV_AUTOPILOT_ARDUPILOTMEGA else 6 << 16
        if self.mode == guided:
            self.target = (
                np.array([message.x, message.y, message.z]),
                np.array([message.vx, message.vy, message.vz]),
                now,
            )
