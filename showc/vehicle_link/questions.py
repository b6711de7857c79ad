"""Questions to a vehicle over a link that loses and delays: put until answered."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from showc.vehicle_link.network import Address

PATIENCE = 2.0
"""Time without an answer after which a question is put again [s]: twice as long as a
link with half a second of delay each way needs."""

IMPATIENCE = 1.5
"""Factor by which patience grows with every repetition."""

LONGEST_PATIENCE = 8.0
"""Where it ends [s]: reached at the fourth repetition."""

ATTEMPTS = 6
"""How often a question is put before the vehicle counts as silent: 32 s in all."""

AT_A_TIME = 8
"""Questions that ArduPilot is asked before it answers the first: it answers each one by
itself, and queues 20. Other autopilots are asked one by one."""


class Questions:
    """Questions put until each is answered, some at a time.

    Parameters
    ----------
    keys
        What is asked for.
    ask
        Message that asks for a key.
    at_a_time
        How many may be open.
    """

    def __init__(
        self,
        keys: Sequence[Any],
        ask: Callable[[Any], Any],
        at_a_time: int = AT_A_TIME,
    ) -> None:
        self.open = list(keys)
        """What has not been answered."""
        self.exhausted: Any = None
        """What was asked for too often; None: nothing."""
        self._ask, self._at_a_time = ask, at_a_time
        self._asked: dict[Any, tuple[int, float]] = {}

    def answered(self, key: object) -> None:
        """Close a question."""
        self.open.remove(key)

    def due(self, now: float) -> list[Any]:
        """Return what is to be asked now; notes a key that was asked too often."""
        out = []
        for key in self.open[: self._at_a_time]:
            times, when = self._asked.get(key, (0, now))
            if now < when:
                continue
            if times >= ATTEMPTS:
                self.exhausted = key
                return []
            patience = min(PATIENCE * IMPATIENCE**times, LONGEST_PATIENCE)
            self._asked[key] = times + 1, now + patience
            out.append(self._ask(key))
        return out


def set_parameter(vehicle: Address, name: str, value: float) -> Any:  # noqa: ANN401
    """Return the message that gives the parameter ``name`` a value."""
    kind = dialect.MAV_PARAM_TYPE_REAL32
    return dialect.MAVLink_param_set_message(*vehicle, name.encode(), value, kind)


def read_parameter(vehicle: Address, name: str) -> Any:  # noqa: ANN401
    """Return the message that asks for the parameter ``name``."""
    return dialect.MAVLink_param_request_read_message(*vehicle, name.encode(), -1)


def result_name(enumeration: str, value: int) -> str:
    """Return the name of a result such as ``MAV_MISSION_RESULT`` 3, known or not."""
    entry = dialect.enums[enumeration].get(value)
    return f"unknown {enumeration} {value}" if entry is None else str(entry.name)
