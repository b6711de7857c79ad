"""What a trajectory log holds, as the writers of other formats need it."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot
from typing import TYPE_CHECKING

import numpy as np

from showc.geodesy import SiteFrame
from showc.light.colour import drive_bytes, linear_light
from showc.log.showc_pb2 import Separation
from showc.trajectory import PiecewisePolynomial, concatenate

if TYPE_CHECKING:
    from showc.arrays import ByteArray, FloatArray
    from showc.log.reader import LoggedShow
    from showc.log.showc_pb2 import Limits, Rules
    from showc.script.show import Show


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """One leg of the show, by name."""

    name: str
    """Of the leg."""
    kind: str
    """``launch``, ``transition``, ``approach``, ``land`` or ``hold``."""
    start: float
    """Show time [s]."""
    end: float
    """Show time [s]."""


@dataclass(frozen=True, slots=True)
class Speeds:
    """Greatest speeds that any leg allows."""

    horizontal: float
    """In any direction: of the limits per axis the diagonal [m/s]."""
    up: float
    """[m/s]"""
    down: float
    """[m/s]"""


@dataclass(frozen=True, slots=True, eq=False)
class SolvedShow:
    """A solved show: exact flights, sampled lights, rules and site."""

    rules: Rules
    """What the flight keeps, and what flies."""
    frame: SiteFrame
    """Where the show frame lies on the globe."""
    flights: tuple[PiecewisePolynomial, ...]
    """x, y, z [m] and yaw [rad] of each drone over the whole show; time is that of the
    show, and ``early``."""
    light_times: FloatArray
    """When lights were sampled, shape (T,) [s]."""
    lights: ByteArray
    """Linear light, 0 to 255, shape (T, drones, 3)."""
    stages: tuple[Stage, ...]
    """Legs in order of their start."""
    launches: tuple[PiecewisePolynomial, ...] = ()
    """The launch alone of each drone that has one, as solved."""
    early: float = 0.0
    """How long before the show's clock the flights begin [s]."""
    left: float | None = None
    """Separation that must be left once drones stray, by the script [m]; None: that of
    the paths."""

    @property
    def separation(self) -> Separation:
        """What drones keep that stray as far as the script says."""
        kept = Separation()
        kept.CopyFrom(self.rules.separation)
        if self.left is not None:
            kept.distance = self.left
        return kept

    @property
    def drones(self) -> int:
        """Size of the fleet."""
        return len(self.flights)

    @property
    def duration(self) -> float:
        """Length of the show [s]."""
        return float(self.rules.duration)

    @property
    def speeds(self) -> Speeds:
        """Greatest speeds that the limits of any leg allow."""

        def reach(limits: Limits, axis: str) -> float:
            low, high = limits.velocity_min, limits.velocity_max
            return float(max(abs(getattr(low, axis)), abs(getattr(high, axis))))

        limits = self.rules.limits
        return Speeds(
            max(hypot(reach(one, "x"), reach(one, "y")) for one in limits),
            max(one.velocity_max.z for one in limits),
            max(-one.velocity_min.z for one in limits),
        )

    @property
    def phases(self) -> dict[str, tuple[float, float]]:
        """Take-off, show and landing: when each begins and ends [s]."""
        launched = max(
            (stage.end for stage in self.stages if stage.kind == "launch"), default=0.0
        )
        landing = min(
            (stage.start for stage in self.stages if stage.kind == "land"),
            default=self.duration,
        )
        return {
            "takeoff": (-self.early, launched),
            "show": (launched, landing),
            "landing": (landing, self.duration),
        }

    @property
    def fence(self) -> FloatArray:
        """Corners of the fence, the site's walls where it has none, (n, 2) [m]."""
        corners = np.array(self.rules.site.fence).reshape(-1, 2)
        if corners.size:
            return np.asarray(corners)
        low, high = self.rules.site.volume_min, self.rules.site.volume_max
        return np.array(
            [[low.x, low.y], [high.x, low.y], [high.x, high.y], [low.x, high.y]]
        )


def solved_show(log: LoggedShow, script: Show | None = None) -> SolvedShow:
    """Take from a log what other formats can carry.

    Of the ``script``, where it is known, is the separation that must be left.
    """
    site = log.rules.site
    pieces: list[list[PiecewisePolynomial]] = [[] for _ in range(log.drones)]
    launches: dict[int, PiecewisePolynomial] = {}
    for segment in log.segments:
        for position, drone in enumerate(segment.drones):
            state = segment.trajectory(position).state.select([0, 1, 2, 8])
            pieces[drone].append(state.shifted(segment.start))
            if segment.kind == "launch":
                launches[drone] = pieces[drone][-1]
    # A screen's byte stands for one value of linear light.
    linear = drive_bytes(linear_light(np.arange(256, dtype=np.uint8)))
    lights = np.stack(
        [linear[log.samples[name]] for name in ("red", "green", "blue")], axis=-1
    )
    return SolvedShow(
        log.rules,
        SiteFrame(site.latitude, site.longitude, site.altitude, site.heading),
        tuple(concatenate(parts) for parts in pieces),
        log.times,
        lights,
        tuple(
            Stage(
                segment.message.name,
                segment.kind,
                segment.start,
                segment.start + segment.duration,
            )
            for segment in log.segments
        ),
        tuple(launches[drone] for drone in sorted(launches)),
        left=None if script is None else script.kept,
    )
