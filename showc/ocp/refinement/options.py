"""How a solve is steered, and the rules of thumb that refinement follows."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf
from typing import TYPE_CHECKING, Any, get_args

from showc.ocp.fault import StatementError, check_type
from showc.ocp.mesh import Mesh
from showc.ocp.nodes import Scheme
from showc.ocp.transcription.solver import SolverOptions

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from showc.ocp.coupling import Imposed
    from showc.ocp.history import MeshRecord

INNER_DEGREE = 3
"""Degree, between its bounds, of a control that enters the Hamiltonian linearly: it is
badly determined there, and a high degree would only oscillate."""
FIRST_DEGREE = 1
"""The same on a first mesh, three less than its points: with as many coefficients as
points a control oscillates on singular arcs, and finer meshes inherit that."""
BOUNDARY_SHARE = 0.6
"""Share of an interval from which a path constraint counts as active all along."""
TOUCHED = 0.25
"""Share of an interval up to which a path constraint is touched, not followed."""
LITTLE_VIOLATION = 3e-4
"""Violation of a path constraint from which on it is tightened, not chased."""
CAUTION = 0.25
"""Share of the tolerance that the estimate of the objective's error may take."""
ROUGH = 1e-2
"""Error of the dynamics above which arcs and multipliers of a solution mean nothing."""
CHEAP = 1500
"""Unknowns up to which a program costs next to nothing: its mesh may grow as fast as
its errors suggest, and it is solved to the full tolerance at once."""
GROWTH = 2.0
"""Greatest growth of the points from mesh to mesh beyond that."""
LOOSE = 1e-6
"""Solver's tolerance on costly programs whose mesh is yet too coarse by far."""
OPEN = 0.1
"""Share of a mesh's error that a solver stopped early may have left open if arcs are to
be read off what it gave."""
CLOSE = 1e-7
"""Solver's tolerance on other costly programs: the last digits cost most iterations."""
TIGHTER = 0.1
"""Share of the solver's tolerance that is asked for where only what it leaves open
keeps a mesh from being the last."""
EFFORT = 1e6
"""Unknowns times iterations that one mesh may cost; at least a hundred iterations."""
TRIAL_EFFORT = 3e5
"""Unknowns times iterations after which arcs are taken for wrong; at least sixty
iterations, at most two hundred."""
VAGUE = 3e-2
"""Relative error of the objective above which a solution has not yet found its arcs."""
UNEVENNESS = (5e-2, 1.0)
"""Differences within a guessed control, over its range, that break a symmetry: slight
ones stay near the guess, full ones leave the optima about it."""
LOOSELY = 100.0
"""Scale of the objective in a program over the objective found, above which the program
is solved again: the solver's tolerance of 1e-8 means 1e-6 then."""
WEIGHINGS = 3
"""How often that is done."""
EVEN = (20, 40)
"""Intervals of meshes to try where the solver fails and nothing good is known."""
ELSEWHERE = 0.02
"""Share of the phase by which a border of arcs must be off to be placed once more."""
MOSTLY_PLAIN = 0.75
"""Share of the intervals that must have no switch for the others to tell whether a
solution is about right."""
LEAPS = 2
"""How often controls are put into lower valleys of the Hamiltonian in one solve: what
one start leaves, a second may mend."""
SWITCH_TRIALS = 4
"""How often switch times are placed anew in one solve."""


@dataclass(frozen=True, slots=True)
class Grading:
    """Refinement by grading: controls linear on each interval, to be flown as they are.

    A strategy for problems whose controls jump or whose states ride on their bounds;
    see :mod:`showc.ocp.refinement.graded`.
    """

    accuracy: float = 2e-5
    """Wanted error of the flown controls: the greatest distance between the states
    and one integration of the clipped controls, over each state's range (or a
    hundredth of its scale, if that is more); and wanted violation of path
    constraints between the points, over their scale."""
    intervals: tuple[int, ...] = (24, 44, 56, 72, 96, 112, 128)
    """Numbers of intervals, shared by the phases, that meshes may have: the first two,
    and of the others those that the error of the one before calls for."""
    points: int = 3
    """Collocation points of an interval; more where ``accuracy`` takes them."""
    margin: float = 1e-6
    """By how much, in their scale, path constraints are tightened, so that what the
    solver's tolerance leaves stays within."""


@dataclass(frozen=True, slots=True)
class Options:
    """How a problem is solved; the defaults are meant for every problem."""

    tolerance: float = 1e-6
    """Wanted relative error: of every state between the nodes over its range, of
    every path constraint over its scale, of the objective."""
    mesh: Mesh | None = None
    """First mesh; by default ten intervals of four points in each phase."""
    meshes: int = 20
    """Greatest number of meshes."""
    points: int = 1000
    """Greatest number of collocation points; refinement stops there."""
    effort: float = 1e6
    """Unknowns times iterations that refinement may cost, small programs not counted;
    no further mesh is begun beyond. A million are some seven seconds of CPU time;
    infinity: no limit."""
    scheme: Scheme = "gauss"
    """Collocation points."""
    switches: bool = True
    """Whether switch times may become unknowns."""
    grading: Grading | None = None
    """Refine by grading instead: ``tolerance`` is then the relative error of the
    objective, estimated from two meshes, that ends it. See :meth:`graded`."""
    scales: Mapping[str, float] = field(default_factory=dict)
    """Typical magnitudes by name, where bounds do not tell them."""
    couplings: tuple[Imposed, ...] = ()
    """Couplings that are imposed from the start; :func:`showc.ocp.solve` adds what
    its audits find violated."""
    solver: SolverOptions = field(default_factory=SolverOptions)
    """How each nonlinear program is solved."""
    progress: Callable[[MeshRecord], None] | None = None
    """Called after each mesh."""
    starts: int = 1
    """Number of different starts, each solved; the best solution counts, and
    :attr:`showc.ocp.Solution.optima` lists all that were found."""
    jobs: int = 1
    """Processes among which the starts are shared."""

    @classmethod
    def graded(
        cls,
        tolerance: float = 1e-3,
        *,
        grading: Grading | None = None,
        **more: Any,  # noqa: ANN401 - of each field its own
    ) -> Options:
        """Refine by grading: for what is to be flown, or where controls jump.

        Parameters
        ----------
        tolerance
            Relative error of the objective, estimated from two meshes, that ends
            refinement. Each program is solved to 0.3 % of it: what that
            leaves open is counted once for each of some hundred active bounds.
        grading
            Meshes and accuracy.
        more
            Other fields.
        """
        solver = SolverOptions(tolerance=3e-3 * tolerance, iterations=400)
        given = {"solver": solver, "effort": inf, **more}
        return cls(tolerance, grading=grading or Grading(), **given)

    def __post_init__(self) -> None:
        least = {"tolerance": 1e-15, "meshes": 1, "points": 1, "effort": 0.0}
        for name, low in (*least.items(), ("starts", 1), ("jobs", 1)):
            value = getattr(self, name)
            whole = name in {"meshes", "points", "starts", "jobs"}
            kinds = int if whole else (int, float)
            if not isinstance(value, kinds) or not value >= low:
                words = "a whole number of " if whole else ""
                raise StatementError(
                    f"{name} is {value!r}; wanted {words}at least {low:g}"
                )
        check_type(self.mesh, Mesh, "the mesh of the options")
        check_type(self.solver, SolverOptions, "the solver of the options")
        if self.scheme not in get_args(Scheme):
            wanted = ", ".join(map(repr, get_args(Scheme)))
            raise StatementError(f"scheme is {self.scheme!r}; wanted one of {wanted}")
