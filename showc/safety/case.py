"""The case: volumes of a show on its site, distances that are left, findings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.errors import UsageError
from showc.safety.codes import codes
from showc.safety.energy import Energy, flight_energy
from showc.safety.failure import Failures, failures
from showc.safety.fall import Fall
from showc.safety.ground import (
    Footing,
    Place,
    Stopping,
    area,
    boxes_of,
    hull,
    least,
    outline,
    outside,
    widened,
    within,
)
from showc.safety.landing import FallTable
from showc.safety.pieces import flight_pieces
from showc.safety.stop import Stops, authority_within, stops
from showc.safety.volumes import Buffers, Flying, buffers

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.log.reader import LoggedShow
    from showc.safety.pieces import Pieces
    from showc.script.show import Risk, Show


STOP_STEP = 1.0
"""Time between the moments from which stops are worked out [s]."""


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that is missing."""

    code: str
    """``SAF`` and three digits."""
    severity: str
    """``error`` or ``warning``."""
    message: str
    """What is wrong: the value against what is wanted."""
    missing: float
    """Metres, or other units as the message says, that are missing."""
    place: Place | None = None
    """The drone and the second that decide; None: no one drone."""

    @property
    def title(self) -> str:
        """What is found, in a few words."""
        return codes()[self.code].title


@dataclass(frozen=True, slots=True)
class Distance:
    """A distance that is left, proved for every instant."""

    name: str
    """Between what."""
    left: float
    """At least so much is left; negative: it overlaps [m]."""
    wanted: float
    """[m]."""
    place: Place
    """The drone and the second that decide."""


@dataclass(frozen=True, slots=True, eq=False)
class Volume:
    """A volume over a convex polygon."""

    name: str
    """As authorities call it."""
    corners: FloatArray
    """Shape (n, 2), show frame [m]."""
    top: float
    """Height of its upper side [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class SafetyCase:
    """What is known of a show on its site."""

    show: Show
    """As the script in the log asks for it."""
    buffers: Buffers
    """By the LBA's formulas."""
    flying: Flying
    """What they were taken from."""
    geography: FloatArray
    """Hull of the flight, as a convex polygon, (n, 2) [m]."""
    contingency: FloatArray
    """With the contingency's width, (n, 2) [m]."""
    one_to_one: FloatArray
    """With the 1:1 buffer, (n, 2) [m]."""
    ballistic: FloatArray
    """With the ballistic buffer, (n, 2) [m]."""
    footprint: FloatArray
    """Hull of all places where a drone may hit the ground, (n, 2) [m]."""
    distances: tuple[Distance, ...]
    """What is left to what stands around."""
    impact_speed: float
    """Greatest speed of an impact [m/s]."""
    energy: Energy
    """How the batteries empty."""
    failures: Failures
    """Which drones may be met by one that falls."""
    stops: Stops
    """How long the fleet takes to stand still, by the moment of the stop."""
    findings: tuple[Finding, ...]

    @property
    def volumes(self) -> tuple[Volume, ...]:
        """Every volume, from the innermost; those on the ground have no height."""
        ground = self.show.site.risk.ground
        high, higher = self.flying.height + ground, self.buffers.height + ground
        return (
            Volume("Flight geography", self.geography, high),
            Volume("Contingency volume", self.contingency, higher),
            Volume("Impact footprint", self.footprint, ground),
            Volume("Ground risk buffer, ballistic", self.ballistic, ground),
            Volume("Ground risk buffer, 1:1", self.one_to_one, ground),
        )

    @property
    def impact_energy(self) -> float:
        """Greatest energy of an impact [J]."""
        return 0.5 * self.show.vehicle.mass * self.impact_speed**2

    @property
    def fence(self) -> FloatArray:
        """Corners of the fence; of the volume's walls where there is none (n, 2)."""
        return _fence(self.show)

    @property
    def errors(self) -> tuple[Finding, ...]:
        """The findings with which a show should not fly."""
        return tuple(item for item in self.findings if item.severity == "error")

    def to_json(self) -> dict[str, Any]:
        """Return the case as JSON-able data; drones count from 1."""
        return {
            "name": self.show.name,
            "findings": [
                {
                    "code": item.code,
                    "severity": item.severity,
                    "message": item.message,
                    "missing": round(item.missing, 3),
                    **_said(item.place),
                }
                for item in self.findings
            ],
            "distances": [
                {
                    "name": item.name,
                    "left": round(item.left, 3),
                    "wanted": round(item.wanted, 3),
                    **_said(item.place),
                }
                for item in self.distances
            ],
            "contingency_width": round(self.buffers.contingency, 3),
            "contingency_height": round(self.buffers.height, 3),
            "one_to_one": round(self.buffers.one_to_one, 3),
            "ballistic": round(self.buffers.ballistic, 3),
            "impact_speed": round(self.impact_speed, 2),
            "impact_energy": round(self.impact_energy, 1),
            "energy": {
                "charge_used": round(float(self.energy.used.max()), 4),
                "charge_of_abort": round(self.energy.abort, 4),
                "charge_allowed": round(self.show.battery.allowed, 4),
                "most_energy": round(float(self.energy.energy.max()), 1),
                "lowest_voltage": round(float(np.nanmin(self.energy.voltage)), 3),
                "hover_endurance": self.energy.hover_endurance,
            },
            "failures": {
                "share": round(self.failures.share, 4),
                "pairs": [
                    {
                        "time": float(self.failures.times[step]),
                        "drone": drone + 1,
                        "meets": other + 1,
                    }
                    for step, drone, other in self.failures.pairs.tolist()
                ],
            },
            "stops": {
                "times": self.stops.times.tolist(),
                "durations": np.round(self.stops.durations, 3).tolist(),
                "from_any_instant": round(self.stops.sure, 3),
            },
            "volumes": [
                {
                    "name": volume.name,
                    "top": round(volume.top, 2),
                    "area": round(area(volume.corners), 1),
                    "corners": np.round(volume.corners, 2).tolist(),
                }
                for volume in self.volumes
            ],
        }


def _said(place: Place | None) -> dict[str, Any]:
    if place is None:
        return {}
    return {"drone": place.drone + 1, "time": round(place.time, 2)}


def show_of(logged: LoggedShow) -> Show:
    """Read the script that a log carries.

    Raises
    ------
    UsageError
        If it is no show, for example because another version wrote it.
    """
    result = logged.read_script()
    if result.show is None:
        said = "; ".join(f"{item.code}: {item.message}" for item in result.errors[:3])
        raise UsageError(
            f"{logged.source}: the script in the log is no show ({said}); compile it "
            "again with this version"
        )
    return result.show


def _fence(show: Show) -> FloatArray:
    if show.site.fence is not None:
        return show.site.fence
    low, high = show.site.volume_min, show.site.volume_max
    return np.array(
        [[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]]
    )


def safety_case(
    logged: LoggedShow, show: Show | None = None, abort: float | None = None
) -> SafetyCase:
    """Work out the case of a logged show.

    Parameters
    ----------
    logged
        The log.
    show
        Site, risk and aircraft to judge it by; None: what the log's script says.
    abort
        How long the longest abort takes that was planned [s]; None: the longest stop,
        and the descent from the greatest height.

    Raises
    ------
    UsageError
        If the log's script is no show.
    DamagedFileError
        If a trajectory of the log makes no polynomials.
    """
    show = show or show_of(logged)
    states = [logged.trajectory(drone).state for drone in range(logged.drones)]
    velocity = [state.select([3, 4, 5]) for state in states]
    stopping = stops(velocity, authority_within(show), STOP_STEP)
    fall = Fall(
        show.vehicle.mass,
        show.body.drag_area,
        show.site.risk.wind,
        show.vehicle.gravity,
    )
    failing = failures(states, fall, show.body.size, show.site.risk.ground)
    return _Assessment(show, flight_pieces(logged), stopping, failing, fall).case(abort)


class _Assessment:
    """Works out one case."""

    def __init__(
        self,
        show: Show,
        pieces: Pieces,
        stopping: Stops,
        failing: Failures,
        fall: Fall,
    ) -> None:
        self.show, self.pieces = show, pieces
        self.stopping, self.failing = stopping, failing
        self.risk: Risk = show.site.risk
        boxes = boxes_of(pieces, self.risk.ground)
        self.highest = float(boxes.height_high.max())
        speed = float(boxes.speed_high.max())
        climbs = float(boxes.climb_low.min()), float(boxes.climb_high.max())
        self.falls = FallTable.covering(fall, climbs, speed, self.highest)
        self.impact_speed = float(self.falls.impact_speed(boxes).max())
        self.flying = Flying(
            speed + self.risk.wind,
            self.highest,
            show.body.size,
            show.limits.tilt,
            show.vehicle.gravity,
        )
        self.buffers = buffers(self.flying, self.risk)
        self.flight = Footing()
        self.impacts = Footing(self.falls, 0.5 * show.body.size, self.risk.ground)
        self.distances: list[Distance] = []
        self.findings: list[Finding] = []

    def case(self, abort: float | None) -> SafetyCase:
        """Return the case; ``abort`` [s] is that of :func:`safety_case`."""
        geography = hull(self.pieces, self.flight)
        contingency = widened(geography, self.buffers.contingency)
        self._fence()
        self._ceiling()
        self._audience()
        self._buildings()
        return SafetyCase(
            self.show,
            self.buffers,
            self.flying,
            geography,
            contingency,
            widened(contingency, self.buffers.one_to_one),
            widened(contingency, self.buffers.ballistic),
            hull(self.pieces, self.impacts),
            tuple(self.distances),
            self.impact_speed,
            self._energy(abort),
            self._failures(),
            self.stopping,
            tuple(sorted(self.findings, key=lambda item: item.severity)),
        )

    def _note(
        self,
        code: str,
        name: str,
        left: float,
        wanted: float,
        place: Place,
        *,
        severity: str = "error",
    ) -> None:
        """Note a distance, and a finding if something of it is missing."""
        self.distances.append(Distance(name, left, wanted, place))
        if left < wanted:
            self.findings.append(
                Finding(
                    code,
                    severity,
                    f"{name}: {left:.1f} m is left, {wanted:.1f} m is wanted, "
                    f"{wanted - left:.1f} m is missing",
                    wanted - left,
                    place,
                )
            )

    def _misled(self, footing: Footing) -> Footing:
        """Return what a whole show turned and moved may reach."""
        return Footing(
            footing.table,
            footing.wider + self.risk.shift,
            footing.ground,
            self.risk.rotation,
        )

    def _fence(self) -> None:
        inside = within(_fence(self.show))
        found = least(self.pieces, self.flight, inside)
        self._note(
            "SAF101",
            "flight to the fence (contingency)",
            float(found.bound[0]),
            self.buffers.contingency,
            found.places[0],
            severity="warning",
        )
        found = least(self.pieces, self._misled(self.flight), inside)
        self._note(
            "SAF114",
            "flight to the fence, show turned and moved",
            float(found.bound[0]),
            0.0,
            found.places[0],
        )

        own = Stopping(self.risk.reaction_time, self.stopping.authority.level)
        found = least(self.pieces, Footing(stop=own), inside)
        self._note(
            "SAF142",
            "drone that strays, braked at its own speed, to the fence",
            float(found.bound[0]),
            self.risk.misplaced,
            found.places[0],
            severity="warning",
        )

    def _failures(self) -> Failures:
        step, drone = self.failing.worst
        met = self.failing.below(step, drone)
        if met:
            named = ", ".join(str(other + 1) for other in met[:8])
            if len(met) > 8:
                named += f" and {len(met) - 8} more"
            self.findings.append(
                Finding(
                    "SAF141",
                    "warning",
                    f"in {100.0 * self.failing.share:.0f} % of all drones and seconds "
                    f"a falling drone may meet another; most here: drones {named}",
                    float(len(met)),
                    Place(drone, float(self.failing.times[step])),
                )
            )
        return self.failing

    def _ceiling(self) -> None:
        ceiling = self.show.site.ceiling
        if ceiling is None:
            return
        top = self.pieces.position[:, :, 2].max(axis=1)
        first = int(top.argmax())
        middle = 0.5 * (self.pieces.start[first] + self.pieces.end[first])
        self._note(
            "SAF102",
            "greatest height to the ceiling",
            ceiling - float(top[first]),
            self.buffers.height - self.flying.height,
            Place(int(self.pieces.drone[first]), float(middle)),
        )

    def _energy(self, abort: float | None) -> Energy:
        show = self.show
        if abort is None:
            descent = self.highest / show.landing.descent_speed
            abort = self.stopping.sure + descent
        found = flight_energy(self.pieces, show.vehicle, show.battery, abort)
        worst, allowed = found.worst, show.battery.allowed
        needed = float(found.used[worst]) + found.abort
        if needed > allowed:
            self.findings.append(
                Finding(
                    "SAF131",
                    "error",
                    f"show and abort take {100.0 * needed:.0f} % of the battery, "
                    f"{100.0 * allowed:.0f} % may be taken (estimate)",
                    needed - allowed,
                    Place(worst, float(found.times[-1])),
                )
            )
        lowest = np.nan_to_num(found.voltage, nan=0.0)
        step, drone = np.unravel_index(int(lowest.argmin()), lowest.shape)
        least_voltage, wanted = float(lowest[step, drone]), show.battery.voltage_min
        if least_voltage < wanted:
            self.findings.append(
                Finding(
                    "SAF132",
                    "error",
                    f"the voltage under load falls to {least_voltage:.2f} V, at least "
                    f"{wanted:.2f} V is wanted (estimate)",
                    wanted - least_voltage,
                    Place(int(drone), float(found.times[step])),
                )
            )
        return found

    def _audience(self) -> None:
        site, risk = self.show.site, self.risk
        if not site.audience:
            self.findings.append(
                Finding(
                    "SAF201", "warning", "the script states no `site: audience:`", 0.0
                )
            )
        formula = {
            "ballistic": self.buffers.ballistic,
            "one-to-one": self.buffers.one_to_one,
        }
        for people in site.audience:
            away = outside(outline(people.points, closed=people.area))
            found = least(self.pieces, self.impacts, away)
            self._note(
                "SAF111",
                f"falls to {people.name}",
                float(found.bound[0]),
                risk.misplaced,
                found.places[0],
            )
            found = least(self.pieces, self._misled(self.impacts), away)
            self._note(
                "SAF113",
                f"falls to {people.name}, show turned and moved",
                float(found.bound[0]),
                0.0,
                found.places[0],
            )
            if risk.method in formula:
                found = least(self.pieces, self.flight, away)
                self._note(
                    "SAF112",
                    f"flight to {people.name} (contingency and {risk.method} buffer)",
                    float(found.bound[0]),
                    self.buffers.contingency + formula[risk.method],
                    found.places[0],
                )

    def _buildings(self) -> None:
        margin = self.risk.height_error + self.buffers.height_manoeuvre
        bottom = self.pieces.position[:, :, 2].min(axis=1)
        for building in self.show.site.buildings:
            low = self.pieces.select(bottom <= building.height + margin)
            if not len(low):
                continue
            found = least(low, self.flight, outside(building.corners))
            self._note(
                "SAF121",
                f"flight to {building.name}",
                float(found.bound[0]),
                self.buffers.contingency,
                found.places[0],
            )
