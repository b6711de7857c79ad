"""Logs and shows for the tests of verify: exact flights, and ways to spoil them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from synthetic import decoded, vertical_flight, vertical_formations

from showc.log import showc_pb2 as pb
from showc.log.container import open_log
from showc.log.writer import write_log
from showc.pipeline.compile import build_manifest
from showc.script import read_show as read_script
from showc.verify.kernel.show import LoggedShow, PieceTable, Segment

SCRIPT = """\
showc: 1
name: Proved
log_rate: 5
site:
  origin: {{latitude: 48.1374, longitude: 11.5755, altitude: 520}}
  heading: 30
  volume: {{min: [-40, -40, -0.5], max: [40, 40, 60]}}
  fence: [[-40, -40], [40, -40], [45, 0], [40, 40], [-40, 40]]
vehicle: formation-625g
separation: 1
pads: {{type: points, points: {pads}}}
drones: {drones}
launch: {{altitude: 6, climb_speed: 3, hold: 1}}
formations:
  steps:
    type: points
    points: {steps}
    colour: "#ff8800"
    effect: {{kind: pulse, period: 1}}
  level: {{type: points, points: {level}, colour: {{each: [white, dodgerblue]}}}}
transitions:
  - to: steps
    hold: 1.5
    assignment: fixed
    fade: end
    lights: [{{after: 0.5, colour: red, fade: end}}, {{after: 1, colour: "#ff8800"}}]
  - {{to: level, hold: 1, assignment: fixed}}
landing: {{altitude: 6, descent_speed: 3, hold: 1, assignment: fixed}}
"""


def script_of(drones=4):
    """Script of a show that only climbs and descends."""
    pads, steps, level = (
        [[float(x) for x in point] for point in formation.points]
        for formation in vertical_formations(drones)
    )
    return SCRIPT.format(pads=pads, steps=steps, level=level, drones=drones).encode()


def proved_flight(drones=4, script=None):
    """Flight that is exact, of a script, and claims nothing it cannot prove."""
    result = read_script(script or script_of(drones), path="proved.yaml")
    assert result.show is not None, result.diagnostics
    flight = vertical_flight(drones, show=result.show)
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


def manifest_of(flight, missions=None, files=None):
    """The manifest that a compile of the flight writes."""
    nothing = {"autopilot": None, "start": None, "warnings": [], "prediction": {}}
    return build_manifest(
        flight, token="0" * 64, missions=missions or nothing, files=files or {}
    )


def written(flight, path, manifest=None):
    manifest = manifest_of(flight) if manifest is None else manifest
    write_log(flight, path, manifest=manifest)
    return path


def loaded(path):
    log = open_log(path)
    return log, decoded(log)


def with_table(show: LoggedShow, number: int, **changes) -> LoggedShow:
    """Return the same show with the table of one segment changed."""
    segment = show.segments[number]
    segments = list(show.segments)
    segments[number] = replace(segment, table=replace(segment.table, **changes))
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
    """Show of one segment for each table of a fleet; only what separation needs."""
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
            drones=range(drones),
        )
        segments.append(Segment(message, table, np.zeros((drones, 3))))
    rules = pb.Rules(
        drones=drones,
        duration=max(segment.end for segment in segments),
        separation=pb.Separation(
            distance=distance, shape=shape, vertical_stretch=stretch
        ),
    )
    return LoggedShow(rules, tuple(segments), 0)


def strays(demands):
    """What the looks at formations in motion say, one after the other."""
    return [text for look in demands.motions for text in look()]
