"""A whole crowd apart at once: changes of all its flights together.

Where they lead there, the gentlest changes are taken, about the flights as they are.
Which way round each other drones go is then decided by where those begin; where that
leads nowhere, ways are found through a fourth dimension, from several beginnings.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.deconfliction.elastic import Elastic
from showc.fleet.deconfliction.neighbours import near_pairs
from showc.fleet.deconfliction.programs import Programs

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.fleet.deconfliction.changes import Untangled
    from showc.fleet.deconfliction.crowd import Crowd


_AROUND = 2.0
"""Distance within which drones make way for some that come too near, in separations:
those about these stay as they are."""
_MANY = 200
"""Drones from which on there is one beginning."""
_STARTS = 3
"""Beginnings of a way through a fourth dimension."""
_HOPELESS = 0.35
"""Wrong for each drone, from which on no other beginning is tried: the time is too
short."""
_NEARLY, _HARDLY = 0.1, 3.0
"""Wrong for each drone, and at most, at which another search would not pay: what little
is lacking is made good in flight."""


def untangle(
    crowd: Crowd, known: FloatArray | None = None, *, anew: bool = True
) -> Untangled:
    """Change flights of a crowd until all pairs keep apart, as gently as can be.

    Parameters
    ----------
    crowd
        What each would fly alone.
    known
        Changes at the crowd's instants to begin with, shape (n, m, 3) [m]: those of
        the same crowd at another pace.
    """
    best, work = None, 0.0
    enough = min(_NEARLY * crowd.places.shape[0], _HARDLY)
    for search in _searches(crowd, known, anew=anew):
        found = search.run()
        work += found.work
        # About others that fly already, what asks for too much tangles them anew.
        better = best is None or (
            found.wrong < best.wrong if anew else found.strain < best.strain
        )
        best = found if better else best
        if found.wrong <= (enough if anew else 0.0):
            break
    assert best is not None  # noqa: S101 - there is a search
    return replace(best, work=work)


def _searches(
    crowd: Crowd, known: FloatArray | None, *, anew: bool
) -> Iterator[Programs | Elastic]:
    """Yield what is run until it parts the crowd."""
    many = crowd.places.shape[0] >= _MANY
    first = Programs(_staying(crowd), limited=many, gently=not anew)
    if known is not None and many:
        first.change[:] = known
    elif known is not None:
        yield Elastic(crowd, known=known)
    yield first
    if crowd.hovers.any():
        yield Programs(crowd, limited=False, gently=not anew)
    if many:
        return
    if not anew:
        yield Elastic(crowd, known=np.zeros_like(crowd.places))
        return
    for seed in range(_STARTS):
        ways = Elastic(crowd, seed)
        yield ways
        if ways.lacking > _HOPELESS * crowd.places.shape[0]:
            return


def untangle_near(crowd: Crowd, rows: IntArray) -> Untangled:
    """Change flights of some drones, and of those about them, around all others.

    Parameters
    ----------
    rows
        Drones that come too near others, all else being well.
    """
    reach = _AROUND * crowd.separation.distance
    scaled = crowd.places * np.asarray(crowd.separation.metric_scale)
    pairs = [near_pairs(scaled[:, k], reach, 2.0) for k in range(scaled.shape[1])]
    drones = scaled.shape[0]
    first = np.concatenate([pair[0] for pair in pairs])
    second = np.concatenate([pair[1] for pair in pairs])

    def about(some: BoolArray) -> BoolArray:
        found = some.copy()
        found[first[some[second]]] = True
        found[second[some[first]]] = True
        return found

    wrong = np.zeros(drones, dtype=bool)
    wrong[rows] = True
    free = about(wrong)
    chosen = np.nonzero(about(free))[0]
    found = untangle(crowd.part(chosen, free[chosen]), anew=False)
    return found.among(chosen, drones)


def _staying(crowd: Crowd) -> Crowd:
    """Return the same crowd, in which those that hover cannot move."""
    still = crowd.hovers[:, None, None]
    return replace(crowd, give=np.where(still, 0.0, crowd.give))
