"""General optimal control: hp-adaptive Legendre-Gauss pseudospectral collocation.

Knows no drones. State a problem with :class:`Problem`; solve it on a mesh of your
own with :class:`Transcription`, or let :func:`solve` find the mesh.
"""

from showc.ocp.agent import Agent
from showc.ocp.agents import AgentsOptions, AgentsSolution, solve_agents
from showc.ocp.coupling import Imposed
from showc.ocp.graded import GradedOptions, solve_graded
from showc.ocp.guess import Guess
from showc.ocp.history import Decision, IntervalRecord, MeshRecord, PhaseRecord, Step
from showc.ocp.lazily import solve
from showc.ocp.limits import Overrides
from showc.ocp.margins import Margin, margins
from showc.ocp.mesh import Mesh, PhaseMesh
from showc.ocp.options import Options
from showc.ocp.problem import Phase, Problem
from showc.ocp.quantity import HalfSpaces
from showc.ocp.solution import (
    ErrorEstimate,
    Multipliers,
    PhaseSolution,
    Result,
    Solution,
)
from showc.ocp.solver import SolverMissingError, SolverOptions
from showc.ocp.transcription import Transcription

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
