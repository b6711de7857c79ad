"""What a solve gives back: polynomials, multipliers, and how it ended."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from showc.arrays import FloatArray
    from showc.ocp.export import Drawing
    from showc.ocp.history import MeshRecord
    from showc.ocp.mesh import Mesh, PhaseMesh
    from showc.ocp.nodes import Scheme
    from showc.ocp.outcome import ErrorEstimate, Result
    from showc.trajectory import PiecewisePolynomial


ROWS = 201
"""Instants of a phase by default."""


@dataclass(frozen=True, slots=True, eq=False)
class PhaseSolution:
    """The trajectory of one phase."""

    name: str
    mesh: PhaseMesh
    arc_durations: FloatArray
    """Duration of each arc of the mesh, shape (arcs,)."""
    state_names: tuple[str, ...]
    control_names: tuple[str, ...]
    states: PiecewisePolynomial
    """All states, components in the order of ``state_names``."""
    controls: PiecewisePolynomial
    """All controls, components in the order of ``control_names``."""
    costate_times: FloatArray
    """Times of the collocation points, shape (points,)."""
    costates: FloatArray
    """Costates at those times, shape (points, states): derivative of the least
    objective with respect to the state, for an objective that is minimised."""
    scheme: Scheme = "gauss"
    """Collocation points of the mesh."""
    path_multipliers: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    """Multipliers of the path constraints at those times, per unit of time, shape
    (points, constraints); positive at the upper bound."""
    inner_multipliers: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    """Those without what presses at the ends of intervals, where costates may jump."""
    bound_gaps: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    """What the objective could gain where a state's bound is kept by its Bernstein
    coefficients and not touched by the state itself, shape (K, states)."""
    integral_prices: FloatArray = field(default_factory=lambda: np.zeros(0))
    """Derivative of the least objective by each integral of the phase, in the order of
    their statement, for an objective that is minimised."""

    @property
    def start(self) -> float:
        """Time at the start of the phase."""
        return self.states.start

    @property
    def end(self) -> float:
        """Time at the end of the phase."""
        return self.states.end

    @property
    def duration(self) -> float:
        """Duration of the phase."""
        return self.states.end - self.states.start

    @property
    def widths(self) -> FloatArray:
        """Widths of the mesh intervals, shape (K,)."""
        return self.mesh.widths(self.arc_durations)

    def state(self, name: str) -> PiecewisePolynomial:
        """Return the polynomial of the state ``name``; of a vector, all."""
        return self.states.select(_numbers(name, self.state_names))

    def control(self, name: str) -> PiecewisePolynomial:
        """Return the polynomial of the control ``name``; of a vector, all."""
        return self.controls.select(_numbers(name, self.control_names))


def _numbers(name: str, names: tuple[str, ...]) -> list[int]:
    """Places of a quantity, or of all elements of a vector or matrix, in ``names``."""
    found = [
        i
        for i, known in enumerate(names)
        if known == name or known.startswith(f"{name}[")
    ]
    if not found:
        raise KeyError(f"no {name!r}; there is {', '.join(names) or 'nothing'}")
    return found


@dataclass(frozen=True, slots=True, eq=False)
class Multipliers:
    """The primal-dual point of the scaled program, for a warm start."""

    unknowns: FloatArray
    of_bounds: FloatArray
    of_constraints: FloatArray
    objective_scale: float = 1.0
    """What the objective was divided by, in its own unit."""


@dataclass(frozen=True, slots=True)
class Optimum:
    """One of several optima that different starts led to."""

    objective: float
    result: Result | None
    """How its refinement ended; ``None``: it was not refined, and its objective is that
    of a first mesh."""
    starts: tuple[int, ...]
    """Numbers of the starts that led to it; 0 is the given or usual one."""


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Result of one solve, or of a refined sequence of solves."""

    result: Result
    message: str
    """Result in a sentence; on failure also which constraint is violated, where."""
    objective: float
    phases: tuple[PhaseSolution, ...]
    statics: dict[str, float]
    multipliers: Multipliers
    iterations: int
    mesh: Mesh
    parameters: dict[str, float] = field(default_factory=dict)
    error: ErrorEstimate | None = None
    history: tuple[MeshRecord, ...] = ()
    """Every mesh that was solved on the way, with what was done to each of its
    intervals and why; empty for a solve on a mesh of the caller's own."""
    slack: float = 0.0
    """What the solver's tolerance leaves open, in units of the objective: multipliers
    times the distances to the bounds and equations they belong to, summed."""
    blur: float = 0.0
    """Change of the objective if every state were off by a millionth of its range: an
    objective below it, as of a perfect fit, is all but zero."""
    optima: tuple[Optimum, ...] = ()
    """All optima that the starts led to, the best first; empty for a single start."""

    sensitivities: Mapping[str, float] = field(default_factory=dict)
    """Derivative of the optimum by each parameter of the problem, from the multipliers
    (Fiacco 1983); as exact as the mesh. Empty for a solve on a mesh of the caller's."""

    @property
    def duration(self) -> float:
        """Time from the start of the first phase to the end of the last."""
        return self.phases[-1].end - self.phases[0].start

    def arrays(self, rows: int = ROWS) -> dict[str, dict[str, FloatArray]]:
        """Sample every phase: time, states and controls by name, each (rows,)."""
        from showc.ocp.export import arrays  # noqa: PLC0415 - flights do without

        return arrays(self, rows)

    def to_csv(self, path: str | Path, rows: int = ROWS) -> None:
        """Write time, states and controls of all phases as a table."""
        from showc.ocp.export import table  # noqa: PLC0415 - as above

        Path(path).write_text(table(self, rows), encoding="utf-8")

    def to_frame(self, rows: int = ROWS) -> Any:  # noqa: ANN401 - of pandas
        """Return the same table as a ``pandas.DataFrame``."""
        from showc.ocp.export import frame  # noqa: PLC0415 - as above

        return frame(self, rows)

    def plot(self, *names: str) -> Drawing:
        """Draw states and controls over time, all or those named."""
        from showc.ocp.export import drawing  # noqa: PLC0415 - as above

        return drawing(self, names)

    def phase(self, name: str) -> PhaseSolution:
        """Return the phase of that name."""
        for phase in self.phases:
            if phase.name == name:
                return phase
        raise KeyError(
            f"no phase {name!r}; there is {', '.join(p.name for p in self.phases)}"
        )
