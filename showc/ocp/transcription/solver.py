"""The nonlinear programming solvers CasADi brings, set up for both transcriptions."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, get_args

import casadi

from showc.errors import ShowError
from showc.ocp.fault import StatementError
from showc.ocp.outcome import Result

if TYPE_CHECKING:
    from collections.abc import Mapping

    from showc.ocp.transcription.collocation.nlp import Program
    from showc.ocp.transcription.condensed.chain import Chain

SolverName = Literal["ipopt", "snopt", "fatrop"]
"""``snopt`` takes collocated programs alone, ``fatrop`` condensed ones."""

LEAST_BARRIER = 1e-2
"""Least parameter of the barrier over the solver's tolerance: with 100 active bounds
they cost the tolerance."""


class SolverMissingError(ShowError):
    """The nonlinear programming solver asked for is not on this machine."""


@dataclass(frozen=True, slots=True)
class SolverOptions:
    """How the nonlinear program is solved."""

    solver: SolverName = "ipopt"
    tolerance: float = 1e-8
    """Scaled optimality error at which the solver stops."""
    iterations: int = 500
    """Greatest number of iterations."""
    seconds: float = 600.0
    """Greatest CPU time of one solve [s]; a guard, not a means of control."""
    barrier: float | None = None
    """First barrier parameter; ``None``: the solver's own."""
    extra: Mapping[str, object] = field(default_factory=dict)
    """Further options handed to the solver as they are."""

    def __post_init__(self) -> None:
        if self.solver not in get_args(SolverName):
            known = ", ".join(map(repr, get_args(SolverName)))
            raise StatementError(f"solver is {self.solver!r}; wanted one of {known}")


_IPOPT_RESULTS = {
    "Solve_Succeeded": Result.SOLVED,
    "Solved_To_Acceptable_Level": Result.ACCEPTABLE,
    "Feasible_Point_Found": Result.ACCEPTABLE,
    "Infeasible_Problem_Detected": Result.INFEASIBLE,
    "Restoration_Failed": Result.INFEASIBLE,
    "Maximum_Iterations_Exceeded": Result.ITERATION_LIMIT,
    "Maximum_CpuTime_Exceeded": Result.TIME_LIMIT,
    "Maximum_WallTime_Exceeded": Result.TIME_LIMIT,
    "Diverging_Iterates": Result.DIVERGED,
    "Invalid_Number_Detected": Result.INVALID_NUMBER,
    "Search_Direction_Becomes_Too_Small": Result.ACCEPTABLE,
}


def result_of(status: str) -> Result:
    """Translate the solver's own return status."""
    if status.startswith("Finished successfully"):
        return Result.SOLVED
    return _IPOPT_RESULTS.get(status, Result.FAILED)


def make_solver(program: Program, options: SolverOptions, *, warm: bool) -> Any:  # noqa: ANN401
    """Make a solver for ``program``; ``warm``: for a start with multipliers.

    Raises
    ------
    SolverMissingError
        If the solver is not installed or has no licence here.
    ValueError
        If the solver takes condensed programs alone.
    """
    if options.solver == "fatrop":
        raise ValueError("fatrop takes condensed programs; wanted 'ipopt' or 'snopt'")
    common: dict[str, Any] = {
        "print_time": False,
        "calc_lam_p": False,
        "calc_multipliers": False,
        "no_nlp_grad": True,
        "error_on_fail": False,
        "verbose_init": False,
        "show_eval_warnings": False,
        "grad_f": program.objective_gradient,
        "jac_g": program.constraint_jacobian,
    }
    if options.solver == "snopt":
        if not casadi.has_nlpsol("snopt"):
            raise SolverMissingError(
                "SNOPT is not available: CasADi finds no SNOPT library "
                "(libsnopt7). Put a licensed one on the library path, or use "
                "solver='ipopt', which needs no licence."
            )
        settings: dict[str, Any] = {
            "Major optimality tolerance": options.tolerance,
            "Major feasibility tolerance": options.tolerance,
            "Major iterations limit": options.iterations,
        }
        try:
            return casadi.nlpsol(
                "ocp",
                "snopt",
                program.oracle,
                {**common, "snopt": settings | dict(options.extra)},
            )
        except RuntimeError as fault:
            raise SolverMissingError(
                f"SNOPT is present but cannot start: {fault}. Check its licence, or "
                "use solver='ipopt'."
            ) from fault
    settings = {
        "print_level": 0,
        "sb": "yes",
        "tol": options.tolerance,
        "max_iter": options.iterations,
        "max_cpu_time": options.seconds,
        # Rows and unknowns are scaled from bounds already; a scale from the
        # gradient at the guess is useless where the guess is flat.
        "nlp_scaling_method": "none",
        # Bounds are relaxed before, where the model does not end at them.
        "bound_relax_factor": 0.0,
        # Less would ask for more than the tolerance, and an ill-conditioned system.
        "mu_min": LEAST_BARRIER * options.tolerance,
        "mu_strategy": "adaptive",
        "acceptable_iter": 0,
        "honor_original_bounds": "no",
    }
    if warm:
        settings |= {
            "warm_start_init_point": "yes",
            "warm_start_bound_push": 1e-3,
            "warm_start_bound_frac": 1e-3,
            "warm_start_slack_bound_push": 1e-3,
            "warm_start_slack_bound_frac": 1e-3,
            "warm_start_mult_bound_push": 1e-3,
        }
    settings |= _barrier(options) | dict(options.extra)
    common |= {"hess_lag": program.lagrangian_hessian, "ipopt": settings}
    try:
        return casadi.nlpsol("ocp", "ipopt", program.oracle, common)
    except RuntimeError as fault:
        if not options.extra:
            raise
        words = str(fault).strip().splitlines()[-1].split(": ", 1)[-1]
        raise StatementError(f"extra options of the solver: {words}") from fault


def make_condensed_solver(
    chain: Chain, equal: list[bool], options: SolverOptions, *, forked: bool
) -> Any:  # noqa: ANN401 - a CasADi function
    """Make the solver of a condensed program.

    Parameters
    ----------
    chain
        The program.
    equal
        Which of its rows are equations.
    forked
        Whether it will run in a child process, as fatrop must; else IPOPT does it.
    """
    common: dict[str, Any] = {
        "print_time": False,
        "calc_lam_p": False,
        "calc_multipliers": False,
        "error_on_fail": False,
        "show_eval_warnings": False,
    }
    settings: dict[str, Any] = {
        "print_level": 0,
        "tol": options.tolerance,
        "max_iter": options.iterations,
    } | _barrier(options)
    name: SolverName = "fatrop" if forked else "ipopt"
    if forked:
        common |= {"structure_detection": "auto", "equality": equal}
    else:
        settings |= {
            "sb": "yes",
            "bound_relax_factor": 0.0,
            "nlp_scaling_method": "none",
            # A guard: its restoration phase has been seen not to end.
            "max_cpu_time": options.seconds,
        }
    common[name] = settings | dict(options.extra)
    common["cache"] = chain.derivatives(name)
    return casadi.nlpsol("condensed", name, chain.program, common)


def _barrier(options: SolverOptions) -> dict[str, Any]:
    return {} if options.barrier is None else {"mu_init": options.barrier}
