"""What the caller of the solver may choose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path


@dataclass(frozen=True, slots=True)
class SolveOptions:
    """How to solve; nothing here changes what a flight must keep.

    The results depend on the first block only, never on where the work is done.
    """

    gap: float = 0.001
    """Time first allowed over the greatest single-drone minimum, as a fraction."""
    gap_limit: float = 4.0
    """Extra time, as a fraction, with which the search for a first flight gives up."""
    effort: int = 1
    """Work to spend where drones are crowded: a multiple of what ends the search for
    shorter times. With 0 it ends with the first flight, however long that takes."""
    repair_rounds: int = 40
    """Rounds of half-spaces tried at one common time."""

    jobs: int | None = None
    """Processes; None: one for every core the process may use."""
    cluster: str | None = None
    """Address of a Dask scheduler (``tcp://host:port``) to work on instead."""
    cache: Path | None = None
    """Folder of solved work; None: ``showc`` in the user's cache folder."""
    use_cache: bool = True
    """Whether to read and write the cache at all."""
    cache_limit: int = 2 * 1024**3
    """Greatest size of the cache [bytes]; least recently used entries go first."""
