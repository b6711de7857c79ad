"""The assessment: what a logged show leaves to all that stands around it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.errors import UsageError
from showc.safety.case import Distance, Finding, SafetyCase, fence_of
from showc.safety.energy import Draw, Energy, flight_energy
from showc.safety.failure import Failures, failures
from showc.safety.fall import Fall
from showc.safety.ground import (
    ROUNDING,
    Footing,
    Stopping,
    boxes_of,
    hull,
    least,
    outline,
    outside,
    widened,
    within,
)
from showc.safety.landing import FallTable
from showc.safety.pieces import Place, flight_pieces, flown_legs
from showc.safety.stop import (
    Motion,
    Stops,
    authority_within,
    stops,
    time_to_rest,
)
from showc.safety.volumes import Flying, buffers
from showc.script.fence import polygons_meet
from showc.vehicle.power import SEA_LEVEL, Power, air_density

if TYPE_CHECKING:
    from showc.log.reader import LoggedShow
    from showc.safety.pieces import Pieces
    from showc.script.show import Risk, Show

STOP_STEP = 1.0
"""Time between the moments from which stops are worked out [s]."""


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


def safety_case(logged: LoggedShow, show: Show | None = None) -> SafetyCase:
    """Work out the case of a logged show.

    The battery must last for the longest abort of the table in the log; without one,
    for the longest stop, and the descent from the greatest height.

    Parameters
    ----------
    logged
        The log.
    show
        Site, risk and aircraft to judge it by; None: what the log's script says.

    Raises
    ------
    UsageError
        If the log's script is no show.
    DamagedFileError
        If a trajectory of the log makes no polynomials.
    """
    show = show or show_of(logged)
    model = Power.of(show.battery, show.vehicle, show.site.altitude)
    draw = Draw(show.vehicle, model, logged.drones, logged.duration)
    pieces = flight_pieces(draw.along(flown_legs(logged)))
    flights = pieces.flights()
    velocity = [flight.select([3, 4, 5]) for flight in flights]
    stopping = stops(Motion.of(velocity), authority_within(show), STOP_STEP)
    del velocity
    top = show.site.altitude + float(pieces.position[:, :, 2].max())
    fall = Fall(
        show.vehicle.mass,
        show.body.drag_area,
        show.site.risk.wind,
        show.vehicle.gravity,
        min(air_density(top), SEA_LEVEL),
    )
    failing = failures(flights, fall, show.body.size, show.site.risk.ground)
    del flights
    table = logged.aborts
    aborts = [time_to_rest(row, table.period) + row.duration for row in table.rows]
    return _Assessment(show, pieces, stopping, failing, fall).case(
        draw, max(aborts, default=None)
    )


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
        # Parts of pieces may leave their hull by rounding.
        self.highest = float(boxes.height_high.max()) + ROUNDING
        speed = float(boxes.speed_high.max()) + ROUNDING
        climbs = (
            float(boxes.climb_low.min()) - ROUNDING,
            float(boxes.climb_high.max()) + ROUNDING,
        )
        self.falls = FallTable.covering(fall, climbs, speed, self.highest)
        self.impact_speed = float(self.falls.impact_speed(boxes).max())
        self.flying = Flying(
            speed + self.risk.wind,
            self.highest,
            show.body.size,
            show.limits.tilt,
            show.vehicle.gravity,
        )
        self.leans = fall.lean(fall.wind), fall.lean(self.flying.speed)
        self.buffers = buffers(self.flying, self.risk)
        self.flight = Footing()
        self.impacts = Footing(self.falls, 0.5 * show.body.size, self.risk.ground)
        self.distances: list[Distance] = []
        self.findings: list[Finding] = []

    def case(self, draw: Draw, abort: float | None) -> SafetyCase:
        """Return the case.

        Parameters
        ----------
        draw
            What the flight takes of the batteries.
        abort
            How long the longest abort takes [s]; None: not known.
        """
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
            self.leans,
            self._energy(draw, abort),
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
        inside = within(fence_of(self.show))
        found = least(self.pieces, self.flight, inside)
        self._note(
            "SAF101",
            "flight to the fence (contingency)",
            found.bound,
            self.buffers.contingency,
            found.place,
            severity="warning",
        )
        found = least(self.pieces, self._misled(self.flight), inside)
        self._note(
            "SAF114",
            "flight to the fence, show turned and moved",
            found.bound,
            0.0,
            found.place,
        )

        own = Stopping(self.risk.reaction_time, self.stopping.authority.level)
        found = least(self.pieces, Footing(stop=own), inside)
        self._note(
            "SAF142",
            "drone that strays, braked at its own speed, to the fence",
            found.bound,
            self.risk.misplaced,
            found.place,
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
                    f"a falling drone may meet another; most here: "
                    f"{'drone' if len(met) == 1 else 'drones'} {named}",
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

    def _energy(self, draw: Draw, abort: float | None) -> Energy:
        show = self.show
        if abort is None:
            descent = self.highest / show.landing.descent_speed
            abort = self.stopping.sure + descent
        self._rotors(draw)
        found = flight_energy(draw, show.battery, abort)
        worst, allowed = found.worst, show.battery.allowed
        needed = float(found.used[worst]) + found.abort
        if needed > allowed:
            # From this second on an abort would take more than is allowed.
            late = 1.0 - found.left[:, worst] + found.abort > allowed
            second = float(found.times[int(late.argmax())])
            said = f"show and abort take {100.0 * needed:.0f} % of the battery"
            if found.empty is not None:
                said = (
                    f"a battery is empty {found.empty:.0f} s into the "
                    f"{found.times[-1]:.0f} s of the show"
                )
            self.findings.append(
                Finding(
                    "SAF131",
                    "error",
                    f"{said}, {100.0 * allowed:.0f} % may be taken (estimate)",
                    needed - allowed,
                    Place(worst, second),
                )
            )
        lowest = np.nan_to_num(found.voltage, nan=0.0)
        step, drone = np.unravel_index(int(lowest.argmin()), lowest.shape)
        least_voltage, wanted = float(lowest[step, drone]), show.battery.voltage_min
        if least_voltage < wanted:
            said = f"the voltage under load falls to {least_voltage:.2f} V"
            if np.isnan(found.voltage[step, drone]):
                power = found.power[step, drone]
                said = f"the battery cannot give {power:.1f} W, at any voltage"
            self.findings.append(
                Finding(
                    "SAF132",
                    "error",
                    f"{said}; at least {wanted:.2f} V is wanted (estimate)",
                    wanted - least_voltage,
                    Place(int(drone), float(found.times[step])),
                )
            )
        return found

    def _rotors(self, draw: Draw) -> None:
        """Look whether rotors give in the site's air what the flight asks for."""
        vehicle, altitude = self.show.vehicle, self.show.site.altitude
        share = min(air_density(altitude + self.highest) / SEA_LEVEL, 1.0)
        most = vehicle.thrust_coefficient * vehicle.rotor_speed_max**2
        missing = draw.thrust - share * most
        if missing > 0.0:
            self.findings.append(
                Finding(
                    "SAF133",
                    "warning",
                    f"a rotor is asked for {draw.thrust:.2f} N; in the air of "
                    f"{altitude:.0f} m, {100.0 * share:.0f} % as dense as at sea level,"
                    f" it gives {share * most:.2f} N",
                    missing,
                    draw.place,
                )
            )

    def _audience(self) -> None:
        site, risk = self.show.site, self.risk
        if risk.wind == 0.0:
            self.findings.append(
                Finding(
                    "SAF202",
                    "warning",
                    "the script states no wind: falls are judged in calm air",
                    0.0,
                )
            )
        lean = self.leans[0]
        if lean > self.show.limits.tilt:
            self.findings.append(
                Finding(
                    "SAF203",
                    "warning",
                    f"in a wind of {risk.wind:g} m/s a drone that stands still leans "
                    f"up to {np.degrees(lean):.0f}°, its greatest tilt is "
                    f"{np.degrees(self.show.limits.tilt):.0f}° (estimate)",
                    float(lean - self.show.limits.tilt),
                )
            )
        if not site.audience:
            self.findings.append(
                Finding(
                    "SAF201", "warning", "the script states no `site: audience:`", 0.0
                )
            )
        formula = {
            "ballistic": ("ballistic", self.buffers.ballistic),
            "one-to-one": ("1:1", self.buffers.one_to_one),
        }
        for people in site.audience:
            taken = outline(people.points, closed=people.area)
            if polygons_meet(taken, fence_of(self.show)):
                self.findings.append(
                    Finding(
                        "SAF115",
                        "warning",
                        f"{people.name}: people stand within the fence, where nothing "
                        "stops a drone that strays under power",
                        0.0,
                    )
                )
            away = outside(taken)
            found = least(self.pieces, self.impacts, away)
            self._note(
                "SAF111",
                f"falls to {people.name}",
                found.bound,
                risk.misplaced,
                found.place,
            )
            found = least(self.pieces, self._misled(self.impacts), away)
            self._note(
                "SAF113",
                f"falls to {people.name}, show turned and moved",
                found.bound,
                0.0,
                found.place,
            )
            if risk.method in formula:
                name, buffer = formula[risk.method]
                found = least(self.pieces, self.flight, away)
                self._note(
                    "SAF112",
                    f"flight to {people.name} (contingency and {name} buffer)",
                    found.bound,
                    self.buffers.contingency + buffer,
                    found.place,
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
                found.bound,
                self.buffers.contingency,
                found.place,
            )
