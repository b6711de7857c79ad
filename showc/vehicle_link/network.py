"""Datagrams to and from vehicles: many links, many vehicles on each.

A vehicle is the address at which its system id was first heard. What comes from another
address under that id is never taken for the vehicle's word, and the id is noted as one
that two claim.
"""

from __future__ import annotations

import socket
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from pymavlink.dialects.v20 import ardupilotmega as dialect

from showc.errors import UsageError
from showc.vehicle_link.clock import WallClock
from showc.vehicle_link.frames import Codec, Framer

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from types import TracebackType

    from showc.vehicle_link.clock import Clock

LAST_SYSTEM = 250
"""Greatest system id of a vehicle; the rest is for ground stations."""

AUTOPILOT_COMPONENT = 1
"""Component id of an autopilot: MAV_COMP_ID_AUTOPILOT1."""

LISTENING = 1.5
"""Time for which a vehicle is listened to before it is written to, or armed [s]: longer
than the second between heartbeats, so that a second one with its id is noticed."""

LARGEST_DATAGRAM = 2048
"""Bytes read of a datagram: vehicles send no more than fits an Ethernet frame."""

AT_A_TIME = 64
"""Datagrams that are read before the caller has its turn again."""

STRANGERS = 64
"""Addresses that are listened to without being a vehicle's; the oldest is dropped."""

HEARTBEAT_PERIOD = 1.0
"""Time between the ground station's own heartbeats [s]."""

RECEIVE_BUFFER = 1 << 22
"""Bytes that may wait in a socket, as far as the system allows it."""

Origin = tuple[str, int]
"""Host and port."""


class Address(NamedTuple):
    """Which system and component is spoken to."""

    system: int
    component: int


@dataclass(frozen=True, slots=True)
class Received:
    """A message, and which system and component sent it."""

    sender: Address
    message: Any


class _Link:
    """One UDP socket: bound and answering (``udpin``), or calling (``udpout``)."""

    def __init__(self, text: str) -> None:
        kind, host, port = _parsed(text)
        self.text = text
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setblocking(False)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        self.called: Origin | None = None
        try:
            if kind == "udpin":
                self.socket.bind((host, port))
            else:
                self.called = (socket.gethostbyname(host), port)
        except OSError as error:
            self.socket.close()
            raise UsageError(
                f"connection {text!r} cannot be opened ({error.strerror}); is another "
                "ground station using the port?"
            ) from None

    def receive(self) -> tuple[bytes, Origin] | None:
        """Return the next datagram and where it came from."""
        try:
            return self.socket.recvfrom(LARGEST_DATAGRAM)
        except OSError:
            return None

    def send(self, data: bytes, target: Origin) -> None:
        """Send a datagram."""
        try:
            self.socket.sendto(data, target)
        except OSError:
            # A vehicle that is off shows as silent: time decides, not the socket.
            return


@dataclass(frozen=True, slots=True)
class _Home:
    """Where a vehicle is reached."""

    link: _Link
    origin: Origin


def ids_of(drones: Sequence[int], systems: Mapping[int, int] | None) -> list[int]:
    """Return the system id of each of some ``drones``; by default, their numbers.

    Raises
    ------
    UsageError
        If ``systems`` are those of other drones.
    """
    if systems is None:
        return list(drones)
    if set(drones) != set(systems):
        raise UsageError(
            f"--systems has {len(systems)} ids for {len(drones)} drones; give one for "
            "each, or name the drones, such as --drones 251-500 --systems 1-250"
        )
    return [systems[drone] for drone in drones]


def _sound(systems: Sequence[int]) -> frozenset[int]:
    """Return the ids of vehicles, each in range and its own."""
    if len(set(systems)) < len(systems):
        raise UsageError("two drones have the same system id; give every drone its own")
    beyond = [system for system in systems if not 1 <= system <= LAST_SYSTEM]
    if beyond:
        raise UsageError(
            f"system id {beyond[0]} is out of range; wanted 1 to {LAST_SYSTEM}: a "
            "large fleet is reached network by network, such as with --drones 251-500 "
            "--systems 1-250"
        )
    return frozenset(systems)


class Network:
    """All links of a fleet.

    Parameters
    ----------
    connections
        ``udpin:HOST:PORT`` (or ``udp:``) waits for vehicles, ``udpout:HOST:PORT`` calls
        one. Any number of vehicles may share a link; they differ in system id.
    systems
        System ids of the vehicles; others are not listened to.
    key
        Signing key of 32 bytes; None: messages are not signed.
    clock
        The wall's, if None.

    Raises
    ------
    UsageError
        If a connection is not worded so, or cannot be opened, or an id is none that
        a vehicle may have, or is given twice.
    """

    def __init__(
        self,
        connections: Sequence[str],
        systems: Sequence[int],
        *,
        key: bytes | None = None,
        clock: Clock | None = None,
    ) -> None:
        if not connections:
            raise UsageError(
                "no connection; give one, for instance udpin:0.0.0.0:14550"
            )
        self.clock = clock or WallClock()
        self.claims: dict[int, tuple[Origin, Origin]] = {}
        """Ids that two addresses claim: the vehicle's and the other's."""
        self.untrusted: set[int] = set()
        """Ids that were heard without the signature that is asked for."""
        self._systems = _sound(systems)
        self._codec = Codec(key)
        self._links: list[_Link] = []
        self._homes: dict[int, _Home] = {}
        self._framers: dict[tuple[_Link, Origin], Framer] = {}
        self._sealed = False
        self._spoke = -HEARTBEAT_PERIOD
        try:
            for text in connections:
                self._links.append(_Link(text))
        except UsageError:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close all sockets."""
        for link in self._links:
            link.socket.close()

    def seal(self) -> None:
        """Listen to the vehicles' addresses alone from now on."""
        self._sealed = True
        known = {(home.link, home.origin) for home in self._homes.values()}
        self._framers = {
            place: framer for place, framer in self._framers.items() if place in known
        }

    def poll(self, span: float) -> list[Received]:
        """Wait up to ``span`` [s] for messages; keep the own heartbeat going.

        Reads a bounded number of datagrams, so that a flood takes no turn.
        """
        now = self.clock.now()
        if now - self._spoke >= HEARTBEAT_PERIOD:
            self._spoke = now
            self._beat()
        by_socket = {link.socket: link for link in self._links}
        found: list[Received] = []
        for readable in self.clock.wait(list(by_socket), span):
            link = by_socket[readable]
            for _ in range(AT_A_TIME):
                datagram = link.receive()
                if datagram is None:
                    break
                found.extend(self._messages(link, *datagram))
        return found

    def send(self, message: Any, system: int) -> None:  # noqa: ANN401
        """Send ``message`` to the vehicle ``system``; to nothing but it."""
        home = self._homes.get(system)
        if home is not None:
            home.link.send(self._codec.pack(message), home.origin)

    def claim(self, system: int) -> str:
        """Say which two addresses claim the id ``system``; empty: not two."""
        if system not in self.claims:
            return ""
        first, second = (f"{host}:{port}" for host, port in self.claims[system])
        return (
            f"two vehicles speak as system {system}, {first} and {second}: give each "
            "its own number, and one link only"
        )

    def _beat(self) -> None:
        """Send the own heartbeat to every vehicle, and to what waits for a call."""
        data = self._codec.pack(
            dialect.MAVLink_heartbeat_message(
                dialect.MAV_TYPE_GCS,
                dialect.MAV_AUTOPILOT_INVALID,
                0,
                0,
                dialect.MAV_STATE_ACTIVE,
                3,
            )
        )
        targets = {(home.link, home.origin) for home in self._homes.values()}
        targets |= {(link, link.called) for link in self._links if link.called}
        for link, origin in targets:
            link.send(data, origin)

    def _messages(self, link: _Link, data: bytes, origin: Origin) -> list[Received]:
        """Messages of the vehicles in a datagram."""
        framer = self._framers.get((link, origin))
        if framer is None:
            if self._sealed or (link.called and origin[0] != link.called[0]):
                return []
            framer = self._listened(link, origin)
        found = []
        for message, frame in framer.feed(data):
            sender = Address(message.get_srcSystem(), message.get_srcComponent())
            if sender.system not in self._systems:
                continue
            if not self._codec.trusted(frame):
                self.untrusted.add(sender.system)
            elif self._at_home(sender, link, origin):
                found.append(Received(sender, message))
        return found

    def _listened(self, link: _Link, origin: Origin) -> Framer:
        """Listen to an address that is new."""
        homes = {(home.link, home.origin) for home in self._homes.values()}
        strangers = [place for place in self._framers if place not in homes]
        if len(strangers) >= STRANGERS:
            del self._framers[strangers[0]]
        framer = self._framers[link, origin] = Framer(self._codec)
        return framer

    def _at_home(self, sender: Address, link: _Link, origin: Origin) -> bool:
        """Return whether the vehicle's own address sent a message."""
        here = _Home(link, origin)
        home = self._homes.get(sender.system)
        if home is None and sender.component == AUTOPILOT_COMPONENT:
            home = self._homes[sender.system] = here
        if home is None or home == here:
            return home is not None
        if sender.component == AUTOPILOT_COMPONENT:
            self.claims.setdefault(sender.system, (home.origin, origin))
        return False


def _parsed(text: str) -> tuple[str, str, int]:
    """Kind, host and port of a connection's text."""
    parts = text.replace("://", ":").split(":")
    kinds = {"udp": "udpin", "udpin": "udpin", "udpout": "udpout"}
    try:
        kind, host, port = parts
        return kinds[kind], host or "0.0.0.0", int(port)  # noqa: S104
    except (KeyError, ValueError):
        raise UsageError(
            f"connection {text!r} is not understood; wanted udpin:HOST:PORT or "
            "udpout:HOST:PORT, for instance udpin:0.0.0.0:14550"
        ) from None
