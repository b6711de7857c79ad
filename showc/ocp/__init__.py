"""General optimal control: hp-adaptive Legendre-Gauss pseudospectral collocation.

Knows no drones. State a problem with :class:`Problem`; solve it on a mesh of your
own with :class:`Transcription`, or let :func:`solve` find the mesh.

Names are looked up when first used: a user of one part of the core does not wait for
all of them to load.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from showc.ocp.audit.margins import Margin, margins
    from showc.ocp.coupling import Imposed
    from showc.ocp.fault import StatementError
    from showc.ocp.guess import Data, Guess
    from showc.ocp.history import (
        Decision,
        IntervalRecord,
        MeshRecord,
        PhaseRecord,
        Step,
    )
    from showc.ocp.mesh import Mesh, PhaseMesh
    from showc.ocp.outcome import ErrorEstimate, Result
    from showc.ocp.phase import Phase
    from showc.ocp.problem import Problem
    from showc.ocp.quantity import HalfSpaces
    from showc.ocp.refinement.constraint_generation import solve
    from showc.ocp.refinement.options import Grading, Options
    from showc.ocp.solution import Multipliers, Optimum, PhaseSolution, Solution
    from showc.ocp.transcription.collocation.limits import Overrides
    from showc.ocp.transcription.collocation.transcription import Transcription
    from showc.ocp.transcription.solver import (
        SolverMissingError,
        SolverOptions,
    )

__all__ = [
    "Data",
    "Decision",
    "ErrorEstimate",
    "Grading",
    "Guess",
    "HalfSpaces",
    "Imposed",
    "IntervalRecord",
    "Margin",
    "Mesh",
    "MeshRecord",
    "Multipliers",
    "Optimum",
    "Options",
    "Overrides",
    "Phase",
    "PhaseMesh",
    "PhaseRecord",
    "PhaseSolution",
    "Problem",
    "Result",
    "Solution",
    "SolverMissingError",
    "SolverOptions",
    "StatementError",
    "Step",
    "Transcription",
    "margins",
    "solve",
]

_HOMES = {
    "solve": "refinement.constraint_generation",
    "Options": "refinement.options",
    "Margin": "audit.margins",
    "margins": "audit.margins",
    "Overrides": "transcription.collocation.limits",
    "SolverMissingError": "transcription.solver",
    "SolverOptions": "transcription.solver",
    "Transcription": "transcription.collocation.transcription",
    "Imposed": "coupling",
    "Grading": "refinement.options",
    "Data": "guess",
    "Guess": "guess",
    "StatementError": "fault",
    "Decision": "history",
    "IntervalRecord": "history",
    "MeshRecord": "history",
    "PhaseRecord": "history",
    "Step": "history",
    "Mesh": "mesh",
    "PhaseMesh": "mesh",
    "Phase": "phase",
    "Problem": "problem",
    "HalfSpaces": "quantity",
    "ErrorEstimate": "outcome",
    "Multipliers": "solution",
    "Optimum": "solution",
    "PhaseSolution": "solution",
    "Result": "outcome",
    "Solution": "solution",
}
"""Module of each public name."""


def __getattr__(name: str) -> Any:  # noqa: ANN401 - whatever bears the name
    """Return the public name, and keep it."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return all public names, used or not."""
    return sorted(__all__)
