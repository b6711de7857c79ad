"""Datagrams to and from vehicles: many links, many vehicles on each."""

from __future__ import annotations

import select
import socket
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from pymavlink.dialects.v20 import ardupilotmega as dialect

from showc.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import TracebackType

GROUND_SYSTEM = 255
"""System id of a ground station."""

LARGEST_DATAGRAM = 65536

HEARTBEAT_PERIOD = 1.0
"""Time between the ground station's own heartbeats [s]."""


class Address(NamedTuple):
    """Who is spoken to."""

    system: int
    component: int


@dataclass(frozen=True, slots=True)
class Received:
    """A message and who sent it."""

    sender: Address
    message: Any


class _Link:
    """One UDP socket: bound and answering (``udpin``), or calling (``udpout``)."""

    def __init__(self, text: str) -> None:
        kind, host, port = _parsed(text)
        self.text = text
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setblocking(False)
        self.peer: tuple[str, int] | None = None
        self.peers: dict[int, tuple[str, int]] = {}
        # The dialect is generated code without types.
        self.codec: Any = dialect.MAVLink(None, GROUND_SYSTEM, 190)
        self.codec.robust_parsing = True
        try:
            if kind == "udpin":
                self.socket.bind((host, port))
            else:
                self.peer = (socket.gethostbyname(host), port)
        except OSError as error:
            self.socket.close()
            raise UsageError(
                f"connection {text!r} cannot be opened ({error.strerror}); is another "
                "ground station using the port?"
            ) from None

    def receive(self) -> list[Received]:
        """Read everything that has arrived."""
        found: list[Received] = []
        while True:
            try:
                data, origin = self.socket.recvfrom(LARGEST_DATAGRAM)
            except (BlockingIOError, ConnectionRefusedError):
                return found
            for message in self.codec.parse_buffer(data) or []:
                if message.get_type() == "BAD_DATA":
                    continue
                system = message.get_srcSystem()
                self.peers[system] = origin
                sender = Address(system, message.get_srcComponent())
                found.append(Received(sender, message))

    def send(self, message: Any, system: int | None) -> None:  # noqa: ANN401
        """Send to the vehicle ``system``, or to everybody known."""
        data = message.pack(self.codec)
        if self.peer is not None:
            targets = {self.peers.get(system or 0, self.peer)}
        elif system in self.peers:
            targets = {self.peers[system]}
        else:
            targets = set(self.peers.values())
        for target in targets:
            try:
                self.socket.sendto(data, target)
            except OSError:
                # A vehicle that is off shows as silent: time decides, not the socket.
                continue


class Network:
    """All links of a fleet.

    Parameters
    ----------
    connections
        ``udpin:HOST:PORT`` (or ``udp:``) waits for vehicles, ``udpout:HOST:PORT`` calls
        one. Any number of vehicles may share a link; they differ in system id.

    Raises
    ------
    UsageError
        If a connection is not worded so, or cannot be opened.
    """

    def __init__(self, connections: Sequence[str]) -> None:
        if not connections:
            raise UsageError(
                "no connection; give one, for instance udpin:0.0.0.0:14550"
            )
        self._links: list[_Link] = []
        self._home: dict[int, _Link] = {}
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

    def poll(self, now: float, wait: float) -> list[Received]:
        """Wait up to ``wait`` [s] for messages; keep the own heartbeat going."""
        if now - self._spoke >= HEARTBEAT_PERIOD:
            self._spoke = now
            beat = dialect.MAVLink_heartbeat_message(
                dialect.MAV_TYPE_GCS,
                dialect.MAV_AUTOPILOT_INVALID,
                0,
                0,
                dialect.MAV_STATE_ACTIVE,
                3,
            )
            for link in self._links:
                link.send(beat, None)
        sockets = {link.socket: link for link in self._links}
        ready, _, _ = select.select(list(sockets), [], [], max(wait, 0.0))
        found = []
        for readable in ready:
            link = sockets[readable]
            for item in link.receive():
                self._home[item.sender.system] = link
                found.append(item)
        return found

    def send(self, message: Any, system: int) -> None:  # noqa: ANN401
        """Send ``message`` to the vehicle ``system``."""
        home = self._home.get(system)
        for link in self._links if home is None else [home]:
            link.send(message, system)


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
