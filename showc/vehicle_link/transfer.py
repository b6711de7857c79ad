"""Parameters and a mission onto one vehicle and read back, without sockets.

A transfer is fed with the messages of one vehicle and with the time, and hands out the
messages to send. It ends with what the vehicle holds equal to what was sent, or with
the reason why not.

Links lose and delay. What the vehicle is asked is repeated until it answers. The items
of a mission are never repeated on our own account: the vehicle asks for each, and asks
again after a second. A copy that crosses such a repetition is answered with
``MAV_MISSION_INVALID_SEQUENCE``, one of the last item with ``MAV_MISSION_ERROR``;
neither does harm.
"""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from showc.vehicle_link.questions import (
    AT_A_TIME,
    Questions,
    read_parameter,
    result_name,
    set_parameter,
)
from showc.vehicle_link.wire import WireItem, difference, single

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from showc.vehicle_link.network import Address

ASKS_AGAIN = 3.0
"""ArduPilot asks for a missing item again after 1 s; none for this long [s] after the
last item means that it has them all, and that its word of it was lost."""

GIVES_UP = 9.0
"""ArduPilot gives an upload up after 8 s without an item [s]."""

RUNS = 3
"""How often a transfer is begun before it has failed."""

ASKED_TOO_OFTEN = 40
"""How often a vehicle may ask for one item in a run: ArduPilot asks 8 times at most."""

PAUSE = 2.0
"""Time without a message before it is begun again [s]: what the former run still has
under way has come by then."""

HARMLESS = {dialect.MAV_MISSION_INVALID_SEQUENCE}
"""Answers that say nothing: a second copy of an item came."""

PASSING = {
    dialect.MAV_MISSION_OPERATION_CANCELLED,
    dialect.MAV_MISSION_DENIED,
    dialect.MAV_MISSION_ERROR,
}
"""Answers after which a new beginning may help: the vehicle gave up, is busy with
another upload, or had not started up yet."""


class State(Enum):
    """What a transfer is doing."""

    WAITING = "waiting"
    PAUSING = "pausing before a new beginning"
    WRITING = "writing parameters"
    CHECKING = "reading parameters back"
    SENDING = "sending the mission"
    COUNTING = "asking how many items there are"
    READING = "reading the mission back"
    DONE = "holds its mission"
    FAILED = "failed"


class Transfer:
    """Puts parameters and a mission onto one vehicle and reads them back.

    Parameters
    ----------
    vehicle
        System and component to talk to.
    items
        The mission, item 0 first.
    autopilot
        Whose dialect it is; decides what may read back differently.
    parameters
        Value by name, written before the mission.
    """

    def __init__(
        self,
        vehicle: Address,
        items: Sequence[WireItem],
        autopilot: str,
        parameters: Mapping[str, float] | None = None,
    ) -> None:
        self.vehicle = vehicle
        self.items = tuple(items)
        self.autopilot = autopilot
        self.parameters = {
            name: single(value) for name, value in (parameters or {}).items()
        }
        self.state = State.WAITING
        self.reason = ""
        self.runs = 0
        self._heard = 0.0
        self._sent = 0
        self._outbox: list[Any] = []
        self._questions = Questions([], lambda key: key, 1)
        self._told: dict[str, float] = {}
        self._refusal = ""
        self._requests: list[int] = []

    @property
    def over(self) -> bool:
        """Whether nothing is left to do."""
        return self.state in {State.DONE, State.FAILED}

    @property
    def busy(self) -> bool:
        """Whether it has begun and is not over."""
        return self.state is not State.WAITING and not self.over

    @property
    def steps(self) -> int:
        """Answers that the vehicle has to give in all."""
        return 2 * (len(self.parameters) + len(self.items))

    @property
    def progress(self) -> int:
        """How many of them it has given in this run."""
        parameters, items = len(self.parameters), len(self.items)
        done = {
            State.CHECKING: parameters,
            State.SENDING: 2 * parameters + self._sent,
            State.COUNTING: 2 * parameters + items,
            State.READING: 2 * parameters + items,
            State.DONE: self.steps,
        }.get(self.state, 0)
        asking = {
            State.WRITING: parameters,
            State.CHECKING: parameters,
            State.READING: items,
        }.get(self.state)
        return done if asking is None else done + asking - len(self._questions.open)

    def start(self, now: float) -> None:
        """Begin, or begin again."""
        self.runs += 1
        self._sent, self._told, self._refusal = 0, {}, ""
        self._requests = [0] * len(self.items)
        self._heard = now
        if self.parameters:
            self.state = State.WRITING
            self._put(
                list(self.parameters),
                lambda name: set_parameter(self.vehicle, name, self.parameters[name]),
            )
        else:
            self._send_mission()

    def refuse(self, reason: str) -> None:
        """End the transfer for good."""
        if not self.over:
            self.state, self.reason = State.FAILED, reason

    def take_outbox(self) -> list[Any]:
        """Return the messages to send, once."""
        out, self._outbox = self._outbox, []
        return out

    def tick(self, now: float) -> None:
        """Ask, ask again, and give up in the end."""
        if not self.busy:
            return
        quiet = now - self._heard
        if self.state is State.PAUSING:
            if quiet >= PAUSE:
                self.start(now)
            return
        if self.state is State.SENDING and self._sent:
            if self._sent == len(self.items) and quiet > ASKS_AGAIN:
                self._count()
            elif quiet > GIVES_UP:
                self._again("stopped asking for items", now)
            return
        self._outbox += self._questions.due(now)
        if self._questions.exhausted is not None:
            self._again(self._unanswered(), now)

    def handle(self, message: Any, now: float) -> None:  # noqa: ANN401
        """Take a message of the vehicle."""
        kind = message.get_type()
        if kind == "HEARTBEAT":
            if message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED:
                self.refuse("is armed; missions are loaded on the ground, disarmed")
        elif kind == "PARAM_VALUE":
            self._parameter(message)
        elif getattr(message, "mission_type", 0) != dialect.MAV_MISSION_TYPE_MISSION:
            return
        elif kind in {"MISSION_REQUEST", "MISSION_REQUEST_INT"}:
            if self.state in {State.SENDING, State.COUNTING}:
                self._answer(int(message.seq), now)
        elif kind == "MISSION_ACK":
            self._acknowledged(int(message.type), now)
        elif kind == "MISSION_COUNT" and self.state is State.COUNTING:
            self._counted(int(message.count), now)
        elif kind == "MISSION_ITEM_INT" and self.state is State.READING:
            self._read(message)

    def _put(self, keys: list[Any], ask: Callable[[Any], Any]) -> None:
        at_a_time = AT_A_TIME if self.autopilot == "ardupilot" else 1
        self._questions = Questions(keys, ask, at_a_time)

    def _again(self, reason: str, now: float) -> None:
        """Begin again after a pause, or give up."""
        if self.runs >= RUNS:
            self.refuse(reason)
        else:
            self.state, self._heard = State.PAUSING, now

    def _unanswered(self) -> str:
        """Say what the vehicle did not answer."""
        key = self._questions.exhausted
        if self.state in {State.WRITING, State.CHECKING}:
            if key in self._told:
                wanted, held = self.parameters[key], self._told[key]
                return f"holds parameter {key} = {held:g} instead of {wanted:g}"
            return f"does not answer for parameter {key}: silent, or it has none such"
        return self._refusal or f"no answer while {self.state.value}"

    # --- parameters -----------------------------------------------------------------

    def _parameter(self, message: Any) -> None:  # noqa: ANN401
        name, value = str(message.param_id), float(message.param_value)
        writing = self.state is State.WRITING
        if name not in self._questions.open or not (
            writing or self.state is State.CHECKING
        ):
            return
        self._told[name] = value
        if value != self.parameters[name]:
            return
        self._questions.answered(name)
        if self._questions.open:
            return
        if writing:
            self.state, self._told = State.CHECKING, {}
            self._put(
                list(self.parameters),
                lambda name: read_parameter(self.vehicle, name),
            )
        else:
            self._send_mission()

    # --- the mission ----------------------------------------------------------------

    def _send_mission(self) -> None:
        self.state = State.SENDING
        self._put(
            ["count"],
            lambda _: dialect.MAVLink_mission_count_message(
                *self.vehicle, len(self.items), dialect.MAV_MISSION_TYPE_MISSION
            ),
        )

    def _answer(self, sequence: int, now: float) -> None:
        if not 0 <= sequence < len(self.items):
            self.refuse(f"asked for item {sequence} of {len(self.items)}")
            return
        self.state, self._heard = State.SENDING, now
        self._sent = max(self._sent, sequence + 1)
        self._requests[sequence] += 1
        if self._requests[sequence] > ASKED_TOO_OFTEN:
            self._again(f"asks for item {sequence} over and over", now)
            return
        item = self.items[sequence]
        self._outbox.append(
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
            )
        )

    def _acknowledged(self, result: int, now: float) -> None:
        if self.state not in {State.SENDING, State.COUNTING} or result in HARMLESS:
            return
        if result == dialect.MAV_MISSION_ACCEPTED:
            # With items missing it answers an earlier upload, or nothing.
            if self.state is State.SENDING and self._sent == len(self.items):
                self._count()
            return
        if result == dialect.MAV_MISSION_ERROR and self._sent == len(self.items):
            # It receives nothing any more: a second copy of the last item came, or it
            # has given up. What it holds tells.
            if self.state is State.SENDING:
                self._count()
            return
        name = result_name("MAV_MISSION_RESULT", result)
        refusal = f"refused: {name} at item {max(self._sent - 1, 0)}"
        if self.state is State.COUNTING and result == dialect.MAV_MISSION_DENIED:
            # It still waits for an item, and will ask for it.
            self._refusal = refusal
        elif result in PASSING or (
            result == dialect.MAV_MISSION_NO_SPACE and self._sent == 0
        ):
            self._again(refusal, now)
        else:
            self.refuse(refusal)

    def _count(self) -> None:
        self.state = State.COUNTING
        self._put(
            ["list"],
            lambda _: dialect.MAVLink_mission_request_list_message(
                *self.vehicle, dialect.MAV_MISSION_TYPE_MISSION
            ),
        )

    def _counted(self, count: int, now: float) -> None:
        if count != len(self.items):
            self._again(f"holds {count} items instead of {len(self.items)}", now)
            return
        self.state = State.READING
        self._put(
            list(range(count)),
            lambda sequence: dialect.MAVLink_mission_request_int_message(
                *self.vehicle, sequence, dialect.MAV_MISSION_TYPE_MISSION
            ),
        )

    def _read(self, message: Any) -> None:  # noqa: ANN401
        sequence = int(message.seq)
        if sequence not in self._questions.open:
            return
        held = WireItem(
            sequence,
            int(message.frame),
            int(message.command),
            (message.param1, message.param2, message.param3, message.param4),
            int(message.x),
            int(message.y),
            float(message.z),
        )
        found = difference(self.items[sequence], held, self.autopilot)
        if found:
            self.refuse(f"item {sequence} reads back with {found}")
            return
        self._questions.answered(sequence)
        if not self._questions.open:
            self.state = State.DONE
            self._outbox.append(
                dialect.MAVLink_mission_ack_message(
                    *self.vehicle,
                    dialect.MAV_MISSION_ACCEPTED,
                    dialect.MAV_MISSION_TYPE_MISSION,
                )
            )
