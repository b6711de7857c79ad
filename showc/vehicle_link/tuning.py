"""Parameters of a vehicle on a link: read, raised for a show, given back after it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from showc.vehicle_link.questions import Questions, read_parameter, set_parameter
from showc.vehicle_link.wire import single

if TYPE_CHECKING:
    from collections.abc import Mapping

    from showc.vehicle_link.network import Address


STALE = 10.0
"""How late an answer may come that was given before a parameter was written [s]."""


@dataclass(frozen=True, slots=True)
class ParameterWishes:
    """What the parameters of a vehicle must be for the show."""

    needs: Mapping[str, float]
    """Least values that following the show needs, by name."""
    writes: bool = False
    """Whether parameters that are less may be raised, until the vehicle has landed."""
    gains: Mapping[str, float] = field(default_factory=dict)
    """Parameters that are given these values for as long, whatever they were."""


class Tuning:
    """What becomes of one vehicle's parameters over a show.

    Parameters
    ----------
    vehicle
        System and component to talk to.
    wishes
        What its parameters must be.
    """

    def __init__(self, vehicle: Address, wishes: ParameterWishes) -> None:
        self.vehicle = vehicle
        self.needs, self.writes = dict(wishes.needs), wishes.writes
        self.gains = {
            name: max(value, self.needs.get(name, value))
            for name, value in wishes.gains.items()
        }
        self.parameters: dict[str, float] = {}
        """What it says of the parameters that matter."""
        self.raised: dict[str, float] = {}
        """Former values of parameters that were changed."""
        self.changed = ""
        """Which parameter was changed that the show is flown with."""
        self.fault = ""
        """Why the show cannot be flown; empty: nothing hinders it."""
        self.settled = False
        """Whether all parameters are as the show needs them."""
        self._settled_at = 0.0
        self._written: Mapping[str, float] | None = None
        self._questions: Questions | None = None

    def flown(self, name: str) -> float:
        """Return the value with which the show is flown, of a changed parameter."""
        return single(self.gains.get(name, self.needs.get(name, 0.0)))

    @property
    def flown_with(self) -> dict[str, float]:
        """Its parameters, those that were changed at what they were changed to."""
        return self.parameters | {name: self.flown(name) for name in self.raised}

    def _short(self, name: str, value: float) -> bool:
        """Whether the show cannot be followed with this value."""
        return name in self.needs and not value >= single(self.needs[name])

    def _other(self, name: str, value: float) -> bool:
        """Whether a gain has another value than the show is flown with."""
        return name in self.gains and value != self.flown(name)

    def handle(self, message: Any, now: float, *, heed: bool) -> None:  # noqa: ANN401
        """Take the value of a parameter.

        ``heed``: whether a value counts that another station has set.
        """
        name, value = str(message.param_id), float(message.param_value)
        questions, written = self._questions, self._written
        if questions is None or name not in questions.open:
            # A late answer, from before it was written, says nothing.
            late = value == self.raised.get(name) and now - self._settled_at < STALE
            wrong = self._short(name, value) or self._other(name, value)
            if heed and wrong and not late:
                self.changed = f"was given {name} {value:g} by another; it flies with "
                self.changed += f"{self.flown(name):g}"
            return
        self.parameters[name] = value
        if written is None or value == written[name]:
            questions.answered(name)
            self._settled_at = now

    def read(self) -> None:
        """Begin to ask for the parameters that matter."""
        self._questions = Questions(
            list(self.needs | self.gains),
            lambda name: read_parameter(self.vehicle, name),
        )

    def _write(self, values: Mapping[str, float]) -> None:
        self._written = values
        self._questions = Questions(
            list(values), lambda name: set_parameter(self.vehicle, name, values[name])
        )

    def due(self, now: float) -> list[Any]:
        """Return the questions and orders to send now."""
        return [] if self._questions is None else self._questions.due(now)

    def look(self, now: float) -> list[Any]:
        """Read, then change what the show cannot be followed with; return messages."""
        questions = self._questions
        assert questions is not None  # noqa: S101 - made when reading began
        if questions.open:
            out = questions.due(now)
            if questions.exhausted is not None:
                self.fault = (
                    f"does not answer for parameter {questions.exhausted}; wanted "
                    f"at least {self.flown(questions.exhausted):g}"
                )
            return out
        held = self.parameters.items()
        short = {name: value for name, value in held if self._short(name, value)}
        other = {name: value for name, value in held if self._other(name, value)}
        if not short and not other:
            self.settled = True
        elif not self.writes and short.keys() - other.keys():
            found = ", ".join(
                f"{name} {value:g} (wanted {self.needs[name]:g})"
                for name, value in short.items()
            )
            self.fault = (
                f"cannot follow the show: {found}; set them, or give --set-parameters"
            )
        else:
            self.raised = short | other
            self._write({name: self.flown(name) for name in self.raised})
        return []

    def give_back(self) -> None:
        """Begin to give changed parameters their former values."""
        self._write(self.raised)

    @property
    def over(self) -> bool:
        """Whether nothing is left to be written, or the vehicle does not answer."""
        questions = self._questions
        return (
            questions is None or not questions.open or questions.exhausted is not None
        )
