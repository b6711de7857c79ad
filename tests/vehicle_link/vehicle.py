"""Small vehicles of the tests' own: MAVLink over real datagrams, in their own time.

A vehicle keeps parameters and a mission as ArduPilot does (its own home, truncated
centimetres, frame 0 for items without a position; it asks again after a second, gives
an upload up after eight), arms, changes modes, takes off, follows setpoints with a
little lag, and tells where it is when it is asked to. :class:`Faults` says what it does
wrong. A :class:`World` moves its actors on whenever showc waits, so that nothing
depends on how busy the machine is; a vehicle used with ``with`` runs in a thread on the
wall's clock instead.
"""

from __future__ import annotations

import hashlib
import math
import random
import select
import socket
import threading
import time
from dataclasses import dataclass, field

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as m

LAG = 0.08
"""Time constant with which setpoints are followed [s]."""

TICK = 0.01
"""Step of a world's time [s]."""

GUIDED, LOITER, LAND, BRAKE = 4, 5, 9, 17


def free_port():
    """A port below those that the system gives to sockets without a wish."""
    while True:
        port = random.SystemRandom().randrange(20_000, 32_000)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
        return port


class World:
    """A clock that moves on, and its actors with it, while showc waits."""

    def __init__(self) -> None:
        self.time = 0.0
        self.actors: list = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for actor in self.actors:
            actor.close()

    def add(self, actor):
        self.actors.append(actor)
        return actor

    def now(self) -> float:
        return self.time

    def wait(self, sockets, span):
        # Time moves on however short the wait is, as the wall's does.
        end = self.time + (max(span, 1e-6) if span > 0.0 else 0.0)
        while True:
            for actor in self.actors:
                actor.advance(self.time)
            ready = select.select(sockets, [], [], 0.0)[0]
            if ready or self.time >= end:
                return ready
            self.time = min(end, self.time + TICK)


@dataclass
class Faults:
    """What goes wrong; times are the vehicle's own [s]."""

    refuse_item: int | None = None
    change_item: int | None = None
    acknowledge_with: int | None = None
    """Result of every mission, whatever comes."""
    forget: str = ""
    """Parameter that does not take its value."""
    lacks: str = ""
    """Parameter that it has not."""
    silent_at: float = math.inf
    positions_stop_at: float = math.inf
    positions_freeze_at: float = math.inf
    """The last position is repeated, with its old time."""
    not_a_number_at: float = math.inf
    heartbeats_stop_at: float = math.inf
    restart_at: float = math.inf
    """Its boot clock begins again."""
    drift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    drift_at: float = math.inf
    command_result: dict[int, int] = field(default_factory=dict)
    """Result of a command, which is then not obeyed."""
    taken_over_at: float = math.inf
    """When a pilot takes it over with the sticks: mode LOITER."""
    second_takeoff_fails: bool = True


@dataclass
class Flown:
    """What a vehicle remembers for the tests."""

    commands: list[int] = field(default_factory=list)
    modes: list[int] = field(default_factory=list)
    setpoints: list[tuple[float, int]] = field(default_factory=list)
    """Time, type mask."""
    targets: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = field(
        default_factory=list
    )
    """Position, velocity, acceleration of each setpoint; north, east, down."""
    stamps: list[float] = field(default_factory=list)
    places: list[tuple[float, np.ndarray]] = field(default_factory=list)


class Vehicle(threading.Thread):
    """One vehicle."""

    def __init__(
        self,
        port: int,
        system: int = 1,
        *,
        autopilot: int = m.MAV_AUTOPILOT_ARDUPILOTMEGA,
        origin: tuple[float, float, float] = (48.1374, 11.5755, 520.0),
        stands: tuple[float, float, float] = (0.0, 0.0, 0.0),
        tells: bool = False,
        key: bytes | None = None,
        faults: Faults | None = None,
        parameters: dict[str, float] | None = None,
    ) -> None:
        super().__init__(daemon=True)
        self.system, self.autopilot = system, autopilot
        self.faults = faults or Faults()
        self.flown = Flown()
        self.codec = m.MAVLink(None, system, 1)
        self.codec.robust_parsing = True
        self.key = key
        if key is not None:
            self.codec.signing.secret_key = key
            self.codec.signing.sign_outgoing = True
            self.codec.signing.timestamp = int((time.time() - 1420070400) * 1e5)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setblocking(False)
        self.socket.bind(("127.0.0.1", 0))
        self.station = ("127.0.0.1", port)
        self.origin = origin
        # Local frame: north, east, down of where it was switched on.
        self.stands = np.array(stands)
        self.position = np.zeros(3)
        self.velocity = np.zeros(3)
        self.target = None
        self.climb: tuple[float, float] | None = None
        self.armed = False
        self.mode = 0
        self.items: list = []
        self.incoming: list = []
        self.expected = 0
        self.receiving = False
        self.asked = self.received = 0.0
        self.parameters = dict(parameters or {})
        self.intervals = {32: 0.05, 33: 0.05} if tells else {}
        self.sent: dict[int, float] = {}
        self.before = 0.0
        self.boot = 0.0
        self.ending = threading.Event()

    # --- time -----------------------------------------------------------------------

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_):
        self.ending.set()
        self.join(5.0)
        self.close()

    def close(self) -> None:
        self.socket.close()

    def run(self) -> None:
        begun = time.monotonic()
        while not self.ending.is_set():
            select.select([self.socket], [], [], 0.004)
            self.advance(time.monotonic() - begun)

    def advance(self, now: float) -> None:
        """Live up to ``now`` [s]."""
        self.step(now - self.before, now)
        self.before = now
        if now >= self.faults.restart_at:
            self.boot, self.faults.restart_at = now, math.inf
        self.listen(now)
        if self.receiving and now - self.received > 8.0:
            self.receiving = False
            self.acknowledge(m.MAV_MISSION_OPERATION_CANCELLED)
        if self.receiving and now - self.asked > 1.0:
            self.ask(now)
        beating = now < self.faults.heartbeats_stop_at
        if beating and now - self.sent.get(0, -math.inf) >= 1.0:
            self.sent[0] = now
            self.send(self.heartbeat())
        if now < self.faults.positions_stop_at:
            for kind, interval in self.intervals.items():
                if now - self.sent.get(kind, -math.inf) >= interval - 1e-9:
                    self.sent[kind] = now
                    self.report(kind, now)

    def listen(self, now: float) -> None:
        while True:
            try:
                data, _ = self.socket.recvfrom(65536)
            except OSError:
                return
            for message in self.codec.parse_buffer(data) or []:
                self.handle(message, now)

    def send(self, message) -> None:
        if self.before < self.faults.silent_at:
            self.socket.sendto(self.packed(message), self.station)

    def packed(self, message) -> bytes:
        data = message.pack(self.codec)
        self.codec.seq = (self.codec.seq + 1) % 256
        return data

    def heartbeat(self):
        flags = m.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        if self.armed:
            flags |= m.MAV_MODE_FLAG_SAFETY_ARMED
        return m.MAVLink_heartbeat_message(
            m.MAV_TYPE_QUADROTOR, self.autopilot, flags, self.mode, 4, 3
        )

    def report(self, kind: int, now: float) -> None:
        boot = round((now - self.boot) * 1000.0)
        if now > self.faults.positions_freeze_at:
            boot = round(self.faults.positions_freeze_at * 1000.0)
        if kind == 32:
            place = self.position
            if now > self.faults.not_a_number_at:
                place = np.full(3, math.nan)
            self.send(
                m.MAVLink_local_position_ned_message(boot, *place, *self.velocity)
            )
            return
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

    # --- motion ---------------------------------------------------------------------

    def step(self, dt: float, now: float) -> None:
        """Follow the target."""
        if now > self.faults.taken_over_at and self.mode == GUIDED:
            self.mode, self.target = LOITER, None
            self.faults.taken_over_at = math.inf
        if not self.armed or dt <= 0.0:
            return
        before = self.position.copy()
        if self.mode == LAND:
            self.position = before + np.array([0.0, 0.0, 1.5 * dt])
        elif self.climb is not None and now >= self.climb[0]:
            up = before[2] - 2.0 * dt
            self.position = np.array([*before[:2], max(up, self.climb[1])])
        elif self.target is not None:
            goal, speed, stamp = self.target
            goal = goal + speed * min(now - stamp, 0.5)
            if now > self.faults.drift_at:
                goal = goal + np.array(self.faults.drift) * (now - self.faults.drift_at)
            # Feed-forward of the commanded speed keeps the lag in position small.
            self.position = before + speed * dt
            self.position += (goal - self.position) * (1.0 - np.exp(-dt / LAG))
        self.position[2] = min(self.position[2], 0.0)
        self.velocity = (self.position - before) / dt
        self.flown.places.append((now, self.position + self.stands))
        if self.mode == LAND and self.position[2] >= 0.0:
            self.armed = False

    def handle(self, message, now: float) -> None:
        name = message.get_type()
        if getattr(message, "target_system", self.system) not in {0, self.system}:
            return
        handler = getattr(self, f"on_{name.lower()}", None)
        if handler is not None:
            handler(message, now)

    # --- parameters -----------------------------------------------------------------

    def on_param_set(self, message, _) -> None:
        name = message.param_id
        if name in {self.faults.lacks, self.faults.forget}:
            self.tell_parameter(name)
            return
        self.parameters[name] = message.param_value
        self.tell_parameter(name)

    def on_param_request_read(self, message, _) -> None:
        self.tell_parameter(message.param_id)

    def tell_parameter(self, name: str) -> None:
        if name == self.faults.lacks:
            return
        value = self.parameters.get(name, 0.0)
        self.send(m.MAVLink_param_value_message(name.encode(), value, 9, 900, 65535))

    # --- missions -------------------------------------------------------------------

    def on_mission_count(self, message, now: float) -> None:
        self.expected, self.incoming, self.receiving = message.count, [], True
        self.received = now
        self.ask(now)

    def ask(self, now: float) -> None:
        self.asked = now
        self.send(m.MAVLink_mission_request_message(255, 190, len(self.incoming), 0))

    def acknowledge(self, result: int) -> None:
        if self.faults.acknowledge_with is not None:
            result = self.faults.acknowledge_with
        self.send(m.MAVLink_mission_ack_message(255, 190, result, 0))

    def on_mission_item_int(self, message, now: float) -> None:
        if not self.receiving:
            # A second copy of the last item, too.
            self.acknowledge(m.MAV_MISSION_ERROR)
            return
        if message.seq != len(self.incoming):
            self.acknowledge(m.MAV_MISSION_INVALID_SEQUENCE)
            return
        if message.seq == self.faults.refuse_item:
            self.receiving = False
            self.acknowledge(m.MAV_MISSION_UNSUPPORTED)
            return
        self.incoming.append(message)
        self.received = now
        if len(self.incoming) < self.expected:
            self.ask(now)
        else:
            self.receiving = False
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
        if self.receiving:
            self.acknowledge(m.MAV_MISSION_DENIED)
        else:
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
        command = message.command
        self.flown.commands.append(command)
        result = self.faults.command_result.get(command)
        if result is None:
            result = self.obey(message, now)
        self.send(m.MAVLink_command_ack_message(command, result))
        if now < self.faults.heartbeats_stop_at:
            self.send(self.heartbeat())

    def obey(self, message, now: float) -> int:
        command = message.command
        if command == m.MAV_CMD_SET_MESSAGE_INTERVAL:
            self.intervals[int(message.param1)] = message.param2 * 1e-6
        elif command == m.MAV_CMD_COMPONENT_ARM_DISARM:
            self.armed = bool(message.param1)
        elif command == m.MAV_CMD_DO_SET_MODE:
            self.mode = int(message.param2)
            if self.autopilot == m.MAV_AUTOPILOT_PX4:
                self.mode = int(message.param2) << 16 | int(message.param3) << 24
            self.flown.modes.append(self.mode)
            self.target = (self.position.copy(), np.zeros(3), now)
        elif command == m.MAV_CMD_NAV_TAKEOFF:
            airborne = self.position[2] < -0.05
            if airborne and self.faults.second_takeoff_fails:
                return m.MAV_RESULT_FAILED
            # ArduCopter spools up for two seconds.
            self.climb = (now + 2.0, self.position[2] - message.param7)
        elif command == m.MAV_CMD_NAV_LAND:
            self.mode, self.climb = LAND, None
        return m.MAV_RESULT_ACCEPTED

    def on_set_position_target_local_ned(self, message, now: float) -> None:
        self.flown.setpoints.append((now, message.type_mask))
        self.flown.stamps.append(message.time_boot_ms / 1000.0)
        place = np.array([message.x, message.y, message.z])
        speed = np.array([message.vx, message.vy, message.vz])
        push = np.array([message.afx, message.afy, message.afz])
        self.flown.targets.append((place + self.stands, speed, push))
        guided = 4 if self.autopilot == m.MAV_AUTOPILOT_ARDUPILOTMEGA else 6 << 16
        if self.mode == guided:
            self.climb, self.target = None, (place, speed, now)


class Relay:
    """A link that loses and delays datagrams, between one vehicle and the station."""

    def __init__(self, port: int, *, loss: float, delay: float, seed: int) -> None:
        self.loss, self.delay = loss, delay
        self.random = random.Random(seed)
        self.inner = self._socket()
        self.outer = self._socket()
        self.port = self.inner.getsockname()[1]
        self.station = ("127.0.0.1", port)
        self.vehicle = None
        self.held: list[tuple[float, bool, bytes]] = []
        self.lost = 0

    @staticmethod
    def _socket():
        made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        made.setblocking(False)
        made.bind(("127.0.0.1", 0))
        return made

    def close(self) -> None:
        self.inner.close()
        self.outer.close()

    def advance(self, now: float) -> None:
        for outward, source in ((True, self.inner), (False, self.outer)):
            while True:
                try:
                    data, origin = source.recvfrom(65536)
                except OSError:
                    break
                if outward:
                    self.vehicle = origin
                if self.random.random() < self.loss:
                    self.lost += 1
                    continue
                self.held.append((now + self.delay, outward, data))
        due = [item for item in self.held if item[0] <= now]
        self.held = [item for item in self.held if item[0] > now]
        for _, outward, data in due:
            if outward:
                self.outer.sendto(data, self.station)
            elif self.vehicle is not None:
                self.inner.sendto(data, self.vehicle)


class Speaker:
    """Sends the same datagrams over and over, from an address of its own."""

    def __init__(self, port: int, datagrams, period: float, start: float = 0.0) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        self.station = ("127.0.0.1", port)
        self.datagrams, self.period, self.due = datagrams, period, start
        self.heard: list[bytes] = []

    def close(self) -> None:
        self.socket.close()

    def advance(self, now: float) -> None:
        while True:
            try:
                self.heard.append(self.socket.recvfrom(65536)[0])
            except OSError:
                break
        if now >= self.due:
            self.due = now + self.period
            for data in self.datagrams:
                self.socket.sendto(data, self.station)


def heartbeat_of(system: int, *, armed: bool = False) -> bytes:
    """A heartbeat under a number that may be another's."""
    flags = m.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (128 if armed else 0)
    beat = m.MAVLink_heartbeat_message(2, 3, flags, 4, 4, 3)
    return beat.pack(m.MAVLink(None, system, 1))


def forged(system: int, message, stamp: int) -> bytes:
    """A message with a signature block whose signature is wrong."""
    codec = m.MAVLink(None, system, 1)
    codec.signing.secret_key = hashlib.sha256(b"another").digest()
    codec.signing.sign_outgoing = True
    codec.signing.timestamp = stamp
    return message.pack(codec)


__all__ = ["Faults", "Relay", "Speaker", "Vehicle", "World", "free_port"]
