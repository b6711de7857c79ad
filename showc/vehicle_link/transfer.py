"""The MAVLink mission protocol, without sockets: put a mission on, read it back.

A transfer is fed with the messages of one vehicle and with the time, and hands out the
messages to send. It ends with what the vehicle holds equal to what was sent, or with
the reason why not.
"""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from showc.vehicle_link.wire import WireItem, difference

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.vehicle_link.network import Address

PATIENCE = 0.6
"""Time without an answer after which a message is sent again [s]."""

ATTEMPTS = 10
"""How often a message is sent before the vehicle counts as silent."""


class State(Enum):
    """What a transfer is doing."""

    WAITING = "waiting"
    SENDING = "sending"
    COUNTING = "asking how many items there are"
    READING = "reading back"
    DONE = "holds its mission"
    FAILED = "failed"


class Transfer:
    """Puts one mission onto one vehicle and reads it back.

    Parameters
    ----------
    vehicle
        System and component to talk to.
    items
        The mission, item 0 first.
    autopilot
        Whose dialect it is; decides what may read back differently.
    """

    def __init__(
        self, vehicle: Address, items: Sequence[WireItem], autopilot: str
    ) -> None:
        self.vehicle = vehicle
        self.items = tuple(items)
        self.autopilot = autopilot
        self.state = State.WAITING
        self.reason = ""
        self.sent = 0
        self.held: dict[int, WireItem] = {}
        self._outbox: list[Any] = []
        self._last: Any = None
        self._tries = 0
        self._heard = 0.0

    @property
    def over(self) -> bool:
        """Whether nothing is left to do."""
        return self.state in {State.DONE, State.FAILED}

    @property
    def busy(self) -> bool:
        """Whether it has begun and is not over."""
        return self.state is not State.WAITING and not self.over

    @property
    def progress(self) -> int:
        """Items sent and read back so far."""
        return self.sent + len(self.held)

    def start(self, now: float) -> None:
        """Announce the mission."""
        self.state = State.SENDING
        self._say(
            dialect.MAVLink_mission_count_message(
                *self.vehicle, len(self.items), dialect.MAV_MISSION_TYPE_MISSION
            ),
            now,
        )

    def give_up(self, reason: str) -> None:
        """End a transfer that has not begun."""
        if self.state is State.WAITING:
            self._fail(reason)

    def take_outbox(self) -> list[Any]:
        """Return the messages to send, once."""
        out, self._outbox = self._outbox, []
        return out

    def tick(self, now: float) -> None:
        """Send again what was not answered, and give up in the end."""
        if not self.busy:
            return
        if now - self._heard < PATIENCE:
            return
        if self._tries >= ATTEMPTS:
            self._fail(f"no answer while {self.state.value}")
            return
        self._tries += 1
        self._heard = now
        self._outbox.append(self._last)

    def handle(self, message: Any, now: float) -> None:  # noqa: ANN401
        """Take a message of the vehicle."""
        kind = message.get_type()
        if getattr(message, "mission_type", 0) != dialect.MAV_MISSION_TYPE_MISSION:
            return
        if self.state is State.SENDING:
            if kind in {"MISSION_REQUEST", "MISSION_REQUEST_INT"}:
                self._answer(int(message.seq), now)
            elif kind == "MISSION_ACK":
                self._acknowledged(int(message.type), now)
        elif self.state is State.COUNTING and kind == "MISSION_COUNT":
            self._counted(int(message.count), now)
        elif self.state is State.READING and kind == "MISSION_ITEM_INT":
            self._read(message, now)

    def _say(self, message: Any, now: float) -> None:  # noqa: ANN401
        self._outbox.append(message)
        self._last, self._tries, self._heard = message, 1, now

    def _fail(self, reason: str) -> None:
        self.state, self.reason = State.FAILED, reason

    def _answer(self, sequence: int, now: float) -> None:
        if not 0 <= sequence < len(self.items):
            self._fail(f"asked for item {sequence} of {len(self.items)}")
            return
        self.sent = max(self.sent, sequence + 1)
        item = self.items[sequence]
        self._say(
            dialect.MAVLink_mission_item_int_message(
                *self.vehicle,
                item.sequence,
                item.frame,
                item.command,
                int(sequence == 0),
                1,
                *item.parameters,
                item.x,
                item.y,
                item.z,
                dialect.MAV_MISSION_TYPE_MISSION,
            ),
            now,
        )

    def _acknowledged(self, result: int, now: float) -> None:
        if result != dialect.MAV_MISSION_ACCEPTED:
            names = dialect.enums["MAV_MISSION_RESULT"]
            name = names[result].name if result in names else str(result)
            self._fail(f"refused: {name} at item {max(self.sent - 1, 0)}")
            return
        if self.sent < len(self.items):
            # An answer to an earlier transfer, or to nothing.
            return
        self.state = State.COUNTING
        self._say(
            dialect.MAVLink_mission_request_list_message(
                *self.vehicle, dialect.MAV_MISSION_TYPE_MISSION
            ),
            now,
        )

    def _counted(self, count: int, now: float) -> None:
        if count != len(self.items):
            self._fail(f"holds {count} items instead of {len(self.items)}")
            return
        self.state = State.READING
        self._ask(0, now)

    def _ask(self, sequence: int, now: float) -> None:
        self._say(
            dialect.MAVLink_mission_request_int_message(
                *self.vehicle, sequence, dialect.MAV_MISSION_TYPE_MISSION
            ),
            now,
        )

    def _read(self, message: Any, now: float) -> None:  # noqa: ANN401
        sequence = int(message.seq)
        if sequence != len(self.held):
            return
        self.held[sequence] = WireItem(
            sequence,
            int(message.frame),
            int(message.command),
            (message.param1, message.param2, message.param3, message.param4),
            int(message.x),
            int(message.y),
            float(message.z),
        )
        found = difference(self.items[sequence], self.held[sequence], self.autopilot)
        if found:
            self._fail(f"item {sequence} reads back with {found}")
        elif len(self.held) < len(self.items):
            self._ask(len(self.held), now)
        else:
            self.state = State.DONE
            self._outbox.append(
                dialect.MAVLink_mission_ack_message(
                    *self.vehicle,
                    dialect.MAV_MISSION_ACCEPTED,
                    dialect.MAV_MISSION_TYPE_MISSION,
                )
            )
