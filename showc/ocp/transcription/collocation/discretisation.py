"""Direct collocation of a problem on a mesh: built once, solved many times.

Unknowns are Bernstein coefficients: of each state on each mesh interval (degree N
for N collocation points, neighbours share the border), of each control on each
interval (any degree), the durations of the arcs, start times and statics. With c
the coefficients of interval k of width h and f the dynamics, the defects are

    sum_j D_ij c_j - h f(x_i, u_i, t_i) = 0,   x_i = sum_j B_ij c_j,   i = 1 .. N,

D and B being derivative and value of the Bernstein basis at the points. Bounds of
states and controls are bounds of unknowns; by the hull property they hold at every
instant, not only at the points.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from showc.ocp.transcription.collocation.builder import Builder, Discretisation, Scales
from showc.ocp.transcription.collocation.end_rows import add_boundary
from showc.ocp.transcription.collocation.phase_rows import add_phase

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.ocp.coupling import Imposed
    from showc.ocp.mesh import Mesh
    from showc.ocp.nodes import Scheme
    from showc.ocp.problem import Problem


def discretise(
    problem: Problem,
    mesh: Mesh,
    scheme: Scheme,
    scales: Scales,
    couplings: Sequence[Imposed] = (),
) -> Discretisation:
    """Write ``problem`` on ``mesh`` as a program, with the ``couplings`` imposed.

    Raises
    ------
    ValueError
        If the problem is not completely stated or the mesh has other phases.
    """
    problem.check()
    if len(mesh.phases) != len(problem.phases):
        raise ValueError(
            f"mesh for {len(mesh.phases)} phases, problem {problem.name!r} has "
            f"{len(problem.phases)}"
        )
    builder = Builder(problem, mesh, scheme, scales, couplings)
    for index in range(len(problem.phases)):
        add_phase(builder, index)
    add_boundary(builder)
    return builder.finish()
