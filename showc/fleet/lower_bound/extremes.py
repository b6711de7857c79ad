"""Which moves of a fleet can have the greatest bound: the corners of their hull.

The inequality that proves a bound is linear in the displacement d: ``beta . d`` on one
side, an integral without d on the other. If a move is a mixture of others, ``beta . d``
is a mixture of theirs, and the same multipliers prove as much for one of these. So the
greatest bound of all moves is that of a corner of their convex hull. Mirror images
count as moves where flights have such images, and so does the move of no length, which
every bound spares.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import highspy
import numpy as np

if TYPE_CHECKING:
    from showc.arrays import FloatArray, IntArray


_ROUNDING = 1e-10
"""The least tolerance that HiGHS takes."""
_OUTSIDE = 1e-9
"""How far a corner stands out at least, over the length of the longest move."""


def extreme_moves(displacement: FloatArray, wanted: IntArray) -> IntArray:
    """Return corners of the hull of all moves, among them all that are ``wanted``.

    A move is held against the corners found so far; while a plane parts it from them,
    the move that is the farthest beyond the plane is one more (Clarkson 1994, More
    output-sensitive geometric algorithms, section 2).

    Parameters
    ----------
    displacement
        Shape (n, 3) [m], at least one of them not zero.
    wanted
        Rows that are asked about.

    Returns
    -------
    ndarray
        Rows, increasing; of the wanted moves those that stand out of a mixture of
        these by less than rounding may be missing, and of equal ones all but the
        first.
    """
    points = displacement / np.linalg.norm(displacement, axis=1).max()
    corners: set[int] = set()
    planes = _PartingPlanes()
    for row in wanted.tolist():
        while row not in corners:
            normal = planes.beyond(points[row])
            if normal is None:
                break
            farthest = int(np.argmax(points @ normal))
            if farthest in corners:
                break
            corners.add(farthest)
            planes.add(points[farthest])
    return np.array(sorted(corners), dtype=np.int64)


class _PartingPlanes:
    """Planes that part a point from the origin and the points added.

    The greatest n . p - t over normals n in the unit box such that n . s <= t for all
    points s: a linear program in four unknowns.
    """

    def __init__(self) -> None:
        self._solver = highspy.Highs()  # type: ignore[no-untyped-call]
        for option, value in (
            ("output_flag", False),
            ("threads", 1),
            ("primal_feasibility_tolerance", _ROUNDING),
            ("dual_feasibility_tolerance", _ROUNDING),
        ):
            self._solver.setOptionValue(option, value)
        unbounded = highspy.kHighsInf
        self._solver.addVars(
            4, np.array([-1.0, -1.0, -1.0, 0.0]), np.array([1.0, 1.0, 1.0, unbounded])
        )

    def add(self, point: FloatArray) -> None:
        """Count one more point among those to be parted from."""
        self._solver.addRow(
            -highspy.kHighsInf, 0.0, 4, np.arange(4), np.append(point, -1.0)
        )

    def beyond(self, point: FloatArray) -> FloatArray | None:
        """Return the normal (3,) of a plane beyond which ``point`` lies, if any."""
        self._solver.changeColsCost(4, np.arange(4), np.append(-point, 1.0))
        self._solver.run()
        if -self._solver.getObjectiveValue() <= _OUTSIDE:
            return None
        return np.array(self._solver.getSolution().col_value[:3])
