"""Logs and shows for the tests of verify: exact flights, and ways to spoil them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from synthetic import vertical_flight

from showc.log import showc_pb2 as pb
from showc.log.writer import write_log
from showc.verify.decode import read_show
from showc.verify.kernel.show import LoggedShow, PieceTable, Segment
from showc.verify.mcap import open_log


def proved_flight(drones=4):
    """Flight that is exact and claims nothing it cannot prove."""
    flight = vertical_flight(drones=drones)
    legs = tuple(
        replace(
            leg,
            certificate=replace(
                leg.certificate, dual_bound=0.0, witness=None, single_drone_minimum=0.0
            ),
        )
        for leg in flight.legs
    )
    return replace(flight, legs=legs)


def written(flight, path, manifest=b"{}"):
    write_log(flight, path, manifest=manifest)
    return path


def loaded(path):
    log = open_log(path)
    return log, read_show(log)


def with_table(show: LoggedShow, number: int, **changes) -> LoggedShow:
    """Return the same show with the first table of one segment changed."""
    segment = show.segments[number]
    tables = (replace(segment.tables[0], **changes), *segment.tables[1:])
    segments = list(show.segments)
    segments[number] = replace(segment, tables=tables)
    return replace(show, segments=tuple(segments))


def table_of(paths, breaks, degree_control=0) -> PieceTable:
    """Table of drones with positions alone.

    ``paths``: for each drone coefficients (K, degree + 1, 3); ``breaks``: for each
    drone (K + 1,).
    """
    counts = [len(path) for path in paths]
    position = np.concatenate(paths)
    state = np.zeros((*position.shape[:2], 12))
    state[:, :, :3] = position
    return PieceTable(
        drones=np.arange(len(paths)),
        first=np.concatenate([[0], np.cumsum(counts)]),
        start=np.concatenate([times[:-1] for times in breaks]),
        end=np.concatenate([times[1:] for times in breaks]),
        state=state,
        control=np.zeros((position.shape[0], degree_control + 1, 4)),
    )


def show_of(
    tables, starts=None, durations=None, *, distance=1.0, shape=0, stretch=1.0
) -> LoggedShow:
    """Show of one segment for each table; only what separation needs."""
    starts = starts or [0.0] * len(tables)
    drones = 1 + max(int(table.drones.max()) for table in tables)
    segments = []
    for number, (table, start) in enumerate(zip(tables, starts, strict=True)):
        duration = float(table.end.max()) if durations is None else durations[number]
        message = pb.Segment(
            index=number,
            name=f"leg {number}",
            kind=pb.Segment.TRANSITION,
            start=start,
            duration=duration,
            drones=table.drones.tolist(),
        )
        goals = np.zeros((table.drones.size, 3))
        segments.append(Segment(message, (table,), table.drones, goals))
    rules = pb.Rules(
        drones=drones,
        duration=max(segment.end for segment in segments),
        separation=pb.Separation(
            distance=distance, shape=shape, vertical_stretch=stretch
        ),
    )
    return LoggedShow(rules, tuple(segments), 0)
