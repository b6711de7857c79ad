"""The clocks of a flight: the wall's, and the one that all its vehicles share."""

from __future__ import annotations

import select
import time
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import socket
    from collections.abc import Sequence


class Clock(Protocol):
    """Time, and waiting for datagrams; a rehearsal may bring its own."""

    def now(self) -> float:
        """Return the present time [s]; only differences mean something."""

    def wait(
        self, sockets: Sequence[socket.socket], span: float
    ) -> Sequence[socket.socket]:
        """Wait up to ``span`` [s] for datagrams; return the sockets that have some."""


class WallClock:
    """The wall's clock."""

    def now(self) -> float:
        """Return the time since the machine started [s]."""
        return time.monotonic()

    def wait(
        self, sockets: Sequence[socket.socket], span: float
    ) -> Sequence[socket.socket]:
        """Wait up to ``span`` [s] for datagrams; return the sockets that have some."""
        return select.select(sockets, [], [], max(span, 0.0))[0]
