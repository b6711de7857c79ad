"""General optimal control: hp-adaptive Legendre-Gauss pseudospectral collocation.

Knows no drones. State a problem with :class:`Problem`; solve it on a mesh of your
own with :class:`Transcription`, or let :func:`solve` find the mesh.
"""

from showc.ocp.adaptive.constraint_generation import solve
from showc.ocp.adaptive.options import Options
from showc.ocp.agents.agent import Agent
from showc.ocp.agents.common_time import AgentsOptions, AgentsSolution, solve_agents
from showc.ocp.audit.margins import Margin, margins
from showc.ocp.collocation.limits import Overrides
from showc.ocp.collocation.solver import SolverMissingError, SolverOptions
from showc.ocp.collocation.transcription import Transcription
from showc.ocp.coupling import Imposed
from showc.ocp.graded.loop import GradedOptions, solve_graded
from showc.ocp.guess import Guess
from showc.ocp.history import Decision, IntervalRecord, MeshRecord, PhaseRecord, Step
from showc.ocp.mesh import Mesh, PhaseMesh
from showc.ocp.problem import Phase, Problem
from showc.ocp.quantity import HalfSpaces
from showc.ocp.solution import (
    ErrorEstimate,
    Multipliers,
    PhaseSolution,
    Result,
    Solution,
)

__all__ = [
    "Agent",
    "AgentsOptions",
    "AgentsSolution",
    "Decision",
    "ErrorEstimate",
    "GradedOptions",
    "Guess",
    "HalfSpaces",
    "Imposed",
    "IntervalRecord",
    "Margin",
    "Mesh",
    "MeshRecord",
    "Multipliers",
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
    "Step",
    "Transcription",
    "margins",
    "solve",
    "solve_agents",
    "solve_graded",
]
