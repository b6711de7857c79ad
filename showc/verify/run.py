"""The verification of one log, from its first byte to the verdict."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from showc.progress import Progress, Silent
from showc.verify.mcap import open_log

if TYPE_CHECKING:
    from showc.verify.report import Verification


def verify_log(
    path: Path | str,
    *,
    missions: bool = True,
    jobs: int | None = 1,
    progress: Progress | None = None,
    script: Path | None = None,
) -> Verification:
    """Prove a compiled show again, from its bytes alone.

    Parameters
    ----------
    path
        The log, ``output.mcap``; beside it the folder ``output``.
    missions
        Whether to check the files in that folder too.
    jobs
        Processes to share the work; None: one for each core. The copies are made by
        ``fork``: a caller with threads of its own had better leave it at 1. What is
        found does not depend on it.
    progress
        Hears of the course of the work.
    script
        The script to hold the log against; None: the one attached to the log.

    Returns
    -------
    Verification
        What was proved, and what was not.

    Raises
    ------
    UsageError
        If the log cannot be read.
    DamagedFileError
        If it is cut, altered, or not a log of showc's; as
        :class:`showc.verify.records.DamagedLogError`, with the byte offset.
    """
    watch = progress or Silent()
    watch.stage("reading every byte")
    log = open_log(Path(path))
    from showc.verify.proofs import prove  # noqa: PLC0415 - heavy

    # What overflows is infinite or undefined, and no check passes with that.
    with log.reported(), np.errstate(all="ignore"):
        return prove(log, watch, missions=missions, jobs=jobs, script=script)
