"""An optimal control problem as data: expressions that every peer can translate."""

from __future__ import annotations

import ast
import math
import operator
from dataclasses import asdict, dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

OPERATORS = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}
FUNCTIONS = ("sin", "cos", "exp", "sqrt")

NUMBERS = SimpleNamespace(**{name: getattr(math, name) for name in FUNCTIONS})
"""The functions for plain numbers."""


def evaluate(text: str | float, names: Mapping[str, Any], functions: Any = NUMBERS):
    """Value of an expression for the given ``names``.

    The names may stand for numbers, arrays or the symbols of a peer; ``functions``
    has sin, cos, exp and sqrt for them. Raises ``ValueError`` for anything but
    arithmetic, these functions and known names.
    """
    if isinstance(text, (int, float)):
        return text

    def value(node):
        if isinstance(node, ast.Constant) and isinstance(node.value, (int, float)):
            return node.value
        if isinstance(node, ast.Name):
            if node.id in names:
                return names[node.id]
            if node.id == "pi":
                return math.pi
            raise ValueError(f"unknown name {node.id!r} in {text!r}; wanted {[*names]}")
        if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
            return OPERATORS[type(node.op)](value(node.left), value(node.right))
        if isinstance(node, ast.UnaryOp) and type(node.op) in OPERATORS:
            return OPERATORS[type(node.op)](value(node.operand))
        if (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Name)
            and node.func.id in FUNCTIONS
            and len(node.args) == 1
        ):
            return getattr(functions, node.func.id)(value(node.args[0]))
        raise ValueError(f"{ast.unparse(node)!r} in {text!r} is no arithmetic")

    return value(ast.parse(text, mode="eval").body)


@dataclass(frozen=True, slots=True)
class State:
    """A state: its rate of change, values at the ends (None: free) and bounds."""

    name: str
    rate: str
    start: float
    end: float | None
    lower: float | None
    upper: float | None
    guess_end: float


@dataclass(frozen=True, slots=True)
class Control:
    """A control: bounds (None: free) and the constant to start from."""

    name: str
    lower: float | None
    upper: float | None
    guess: float


@dataclass(frozen=True, slots=True)
class Path:
    """An expression that is at least ``lower`` at every instant."""

    name: str
    expression: str
    lower: float


@dataclass(frozen=True, slots=True)
class Problem:
    """An optimal control problem of one phase that starts at time 0."""

    name: str
    states: tuple[State, ...]
    controls: tuple[Control, ...]
    duration: tuple[float, float]
    """Least and greatest duration; equal when it is fixed."""
    duration_guess: float
    objective: str
    """``final`` with the state's name (``t``: the time), or ``integral``."""
    integrand: str | None
    maximise: bool
    where: dict[str, str]
    """Names for parts of the rates."""
    paths: tuple[Path, ...]
    optimum: float | None
    accuracy: float
    source: str
    bang_bang: bool = False
    """Whether all controls are at a bound at all times: peers that must be told are."""

    @property
    def fixed_duration(self) -> bool:
        """Whether the duration is given."""
        return self.duration[0] == self.duration[1]

    def place_columns(self) -> list[tuple[int, ...]]:
        """Columns of x, y and z of each drone among the states; empty without."""
        columns = {state.name: column for column, state in enumerate(self.states)}
        return [
            tuple(columns[axis + name.removeprefix("vz")] for axis in "xyz")
            for name in columns
            if name.startswith("vz")
        ]

    def rates(self, states: list[Any], controls: list[Any], functions: Any) -> list:
        """Rates of change of all states, for numbers, arrays or symbols."""
        names = self.names(states, controls, functions)
        return [evaluate(state.rate, names, functions) for state in self.states]

    def cost_rate(self, states: list[Any], controls: list[Any], functions: Any):
        """Integrand of the objective, or None."""
        if self.integrand is None:
            return None
        names = self.names(states, controls, functions)
        return evaluate(self.integrand, names, functions)

    def path_values(self, states: list[Any], controls: list[Any], functions: Any):
        """Values of the path constraints' expressions."""
        names = self.names(states, controls, functions)
        return [evaluate(path.expression, names, functions) for path in self.paths]

    def names(self, states: list[Any], controls: list[Any], functions: Any) -> dict:
        """Values by name: states, controls, and the parts named in ``where``."""
        quantities = [*self.states, *self.controls]
        values = [*states, *controls]
        names = {q.name: v for q, v in zip(quantities, values, strict=True)}
        for name, text in self.where.items():
            names[name] = evaluate(text, names, functions)
        return names

    def state_guess(self, fraction: float) -> list[float]:
        """States on the straight line between the ends."""
        return [s.start + fraction * (s.guess_end - s.start) for s in self.states]

    def to_dict(self) -> dict[str, Any]:
        """Plain data, for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Problem:
        """Read what :meth:`to_dict` wrote."""
        return cls(
            **{
                **data,
                "states": tuple(State(**state) for state in data["states"]),
                "controls": tuple(Control(**control) for control in data["controls"]),
                "paths": tuple(Path(**path) for path in data["paths"]),
                "duration": tuple(data["duration"]),
            }
        )


def _number(value: object) -> float | None:
    return None if value is None else float(evaluate(value, {}))  # type: ignore[arg-type]


def parse(name: str, data: Mapping[str, Any]) -> Problem:
    """Read one problem as written in ``problems.yaml``."""
    states = []
    for label, entry in data["states"].items():
        start, end = _number(entry["start"]), _number(entry.get("end"))
        guess = _number(entry.get("guess_end", end if end is not None else start))
        lower, upper = _number(entry.get("lower")), _number(entry.get("upper"))
        states.append(State(label, entry["rate"], start, end, lower, upper, guess))
    controls = [
        Control(
            label,
            _number(entry.get("lower")),
            _number(entry.get("upper")),
            _number(entry.get("guess", 0.0)),
        )
        for label, entry in data["controls"].items()
    ]
    duration = data["duration"]
    if isinstance(duration, dict):
        bounds, guess = (duration["lower"], duration["upper"]), duration["guess"]
    else:
        bounds, guess = (duration, duration), duration
    objective = data.get("minimise") or data["maximise"]
    ((kind, text),) = objective.items()
    return Problem(
        name=name,
        states=tuple(states),
        controls=tuple(controls),
        duration=(float(bounds[0]), float(bounds[1])),
        duration_guess=float(guess),
        objective=text if kind == "final" else "integral",
        integrand=str(text) if kind == "integral" else None,
        maximise="maximise" in data,
        where=dict(data.get("where", {})),
        paths=tuple(Path(**path) for path in data.get("paths", ())),
        optimum=_number(data.get("optimum")),
        accuracy=float(data.get("accuracy", 0.0)),
        source=data.get("source", ""),
        bang_bang="bang-bang" in data["features"],
    )
