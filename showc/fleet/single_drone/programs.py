"""Programs of the single drone: built once a process, solved many times."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

from showc.fleet.single_drone.model import (
    ENDS,
    SIGNALS,
    input_names,
    limit_bounds,
    single_problem,
    state_names,
)
from showc.flight import MeshTaken
from showc.vehicle import STATE_NAMES

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.fleet.single_drone.model import Aircraft
    from showc.ocp.guess import Guess
    from showc.ocp.solution import Solution
    from showc.ocp.transcription.condensed.stages import TimeKind
    from showc.ocp.transcription.condensed.transcription import CondensedTranscription
    from showc.ocp.transcription.solver import SolverName


FINE, ROUGH = 1e-6, 1e-5
"""Tolerance of a solve at a given time, and of the search for the least: there it
decides whether borders that hardly matter come to rest, and costs 1e-5 of the time."""


@lru_cache(maxsize=64)
def _built(
    aircraft: Aircraft,
    intervals: int,
    time: TimeKind,
    solver: SolverName,
) -> CondensedTranscription:
    # The core loads casadi, which checking a script must not.
    from showc.ocp.transcription.condensed.transcription import (  # noqa: PLC0415
        CondensedOptions,
        CondensedTranscription,
    )
    from showc.ocp.transcription.solver import SolverOptions  # noqa: PLC0415

    timed = time != "given"
    return CondensedTranscription(
        single_problem(aircraft, minimum_time=timed),
        intervals,
        time=time,
        signals=() if timed else SIGNALS,
        options=CondensedOptions(
            SolverOptions(
                solver,
                tolerance=ROUGH if time == "movable" else FINE,
                iterations=120 if solver == "fatrop" else 300,
                seconds=20.0,
                barrier=1e-4 if time == "movable" else 1e-2,
            ),
            inset=ROUGH if time == "movable" else FINE,
            width_range=(0.3, 1.8),
            width_weight=3e-3,
        ),
    )


class Programs:
    """Solves programs of one aircraft between two ends, and counts.

    Each end is a place (3,) [m] to hover at, or a state and thrust (13,).
    """

    def __init__(self, aircraft: Aircraft, start: FloatArray, goal: FloatArray) -> None:
        self.aircraft = aircraft
        self.bounds = limit_bounds(aircraft)
        ends = dict(zip(ENDS, map(aircraft.end, (start, goal)), strict=True))
        names = *STATE_NAMES, "thrust"
        self.ends = {
            f"{which}_{name}": float(end[names.index(name)])
            for which, end in ends.items()
            for name in state_names(aircraft)
        }
        # A hover may begin and end with any thrust, a formation in motion not.
        self.thrusts = {
            (which, "thrust"): float(end[-1])
            for which, end in ends.items()
            if end[-1] > 0.0 and "thrust" in input_names(aircraft)
        }
        self.iterations = 0
        self.solves = 0
        self.meshes: list[MeshTaken] = []
        """Meshes of all solves, and what came of them."""

    def leave(self, room: float) -> None:
        """Leave a share of the limits of acceleration unused from now on."""
        self.aircraft = replace(self.aircraft, room=room)
        self.bounds = limit_bounds(self.aircraft)

    def program(
        self,
        intervals: int,
        time: TimeKind,
        solver: SolverName = "fatrop",
    ) -> CondensedTranscription:
        """Return the program for ``intervals``, from the process's store."""
        return _built(self.aircraft.canonical(), intervals, time, solver)

    def solve(
        self,
        program: CondensedTranscription,
        widths: FloatArray,
        guess: Guess | Solution,
        parameters: dict[str, float],
        *,
        why: str,
        signals: FloatArray | None = None,
    ) -> Solution:
        """Solve once, with this aircraft's limits and hovers.

        ``why`` tells why on this mesh.
        """
        solution = program.solve(
            widths=widths,
            guess=guess,
            parameters=self.ends | parameters,
            signals=signals,
            bounds=self.bounds,
            control_ends=self.thrusts,
        )
        self.iterations += solution.iterations
        self.solves += 1
        part = solution.phases[0]
        breaks = tuple(part.states.breaks.tolist())
        found = solution.message
        self.meshes.append(
            MeshTaken(breaks, part.mesh.points, solution.iterations, why, found)
        )
        return solution

    def refined(self, solution: Solution, why: str) -> None:
        """Keep the meshes of a solve that finds its own; ``why`` tells why it does."""
        self.iterations += solution.iterations
        self.solves += len(solution.history)
        for number, record in enumerate(solution.history):
            intervals = record.phases[0].intervals
            borders = (*(one.start for one in intervals), intervals[-1].end)
            errors = [one.error for one in intervals if one.error is not None]
            self.meshes.append(
                MeshTaken(
                    borders,
                    tuple(one.points for one in intervals),
                    record.iterations,
                    why if number == 0 else solution.history[number - 1].action,
                    f"{record.objective:.6g} s",
                    tuple(errors),
                )
            )

    def found(self, words: str) -> None:
        """Tell what flying the latest solution again has shown."""
        self.meshes[-1] = replace(self.meshes[-1], found=words)
