"""The solvers of staged programs, set up."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import casadi

from showc.ocp.transcription.staged.guarded import AVAILABLE

if TYPE_CHECKING:
    from showc.ocp.transcription.staged.chain import Chain
    from showc.ocp.transcription.staged.solution import StagedOptions, StagedSolver


def make_staged_solver(
    chain: Chain, equal: list[bool], options: StagedOptions
) -> tuple[Any, bool]:
    """Make the solver of a program, and say whether it must run in a child process.

    Parameters
    ----------
    chain
        The program.
    equal
        Which of its rows are equations.
    """
    # Where no child can be forked, IPOPT does the work.
    forked = options.solver == "fatrop" and AVAILABLE
    common: dict[str, Any] = {
        "print_time": False,
        "calc_lam_p": False,
        "calc_multipliers": False,
        "error_on_fail": False,
        "show_eval_warnings": False,
    }
    if forked:
        common |= {
            "structure_detection": "auto",
            "equality": equal,
            "fatrop": {
                "print_level": 0,
                "tol": options.tolerance,
                "mu_init": options.barrier,
                "max_iter": options.iterations,
                **options.extra,
            },
        }
    else:
        common["ipopt"] = {
            "print_level": 0,
            "sb": "yes",
            "tol": options.tolerance,
            "mu_init": options.barrier,
            "max_iter": options.iterations,
            "bound_relax_factor": 0.0,
            "nlp_scaling_method": "none",
            # A guard: its restoration phase has been seen not to end.
            "max_cpu_time": options.seconds,
            **options.extra,
        }
    name: StagedSolver = "fatrop" if forked else "ipopt"
    common["cache"] = chain.derivatives(name)
    solver = casadi.nlpsol("staged", name, chain.program, common)
    return solver, forked
