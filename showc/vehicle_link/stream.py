"""Fly the solved trajectories themselves: timed setpoints to a fleet on one clock."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.errors import UsageError
from showc.log.reader import read_log
from showc.progress import Silent
from showc.vehicle_link.flown import FlownLog
from showc.vehicle_link.network import Address, Network
from showc.vehicle_link.pace import Clock, Rounds
from showc.vehicle_link.pilot import Phase, Pilot
from showc.vehicle_link.setpoints import StreamPlan, stream_plan

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from showc.progress import Progress

    FloatArray = NDArray[np.float64]

SILENT = Silent()

LEAST_RATE = 10.0
"""Fewest setpoints a second that a vehicle is sent [Hz]."""

COUNTDOWN = 1.0
"""Time between everybody's readiness and the start of the clock [s]."""

LANDING_TIME = 60.0
"""Time in which vehicles must have landed after the show [s]."""


@dataclass(frozen=True, slots=True)
class StreamOptions:
    """How a show is streamed."""

    rate: float = 20.0
    """Setpoints a second for each vehicle [Hz]; at least 10."""
    corridor: float = 3.0
    """Farthest a vehicle may be from its trajectory [m]."""
    link_timeout: float = 2.0
    """Longest silence of a vehicle [s]."""
    ready_timeout: float = 60.0
    """Time in which all vehicles must be ready [s]."""
    systems: Mapping[int, int] | None = None
    """MAVLink system id of a drone (counting from 1) where it is not its number."""


@dataclass(frozen=True, slots=True)
class VehicleFlight:
    """How one vehicle flew."""

    drone: int
    """Counting from 1."""
    system: int
    """MAVLink system id."""
    phase: str
    """Where it was at the end."""
    reason: str
    """Why it failed."""
    setpoints: int
    """How many it was sent."""
    greatest_deviation: float
    """Greatest distance between what it told and what was planned then [m]."""


@dataclass(frozen=True, slots=True)
class StreamReport:
    """How a show was flown."""

    complete: bool
    """Whether all vehicles flew to the end and landed."""
    reason: str
    """Why not."""
    show_time: float
    """Show time reached [s]."""
    rate: float
    """Setpoints a second that each vehicle was sent, in the mean [Hz]."""
    longest_gap: float
    """Longest time between two setpoints to a vehicle [s]."""
    longest_hold_up: float
    """Longest time between the moment a setpoint is for and its sending [s]."""
    vehicles: tuple[VehicleFlight, ...]
    """By drone."""

    def to_json(self) -> dict[str, Any]:
        """Return the report as JSON-able data."""
        return asdict(self)


def stream_show(
    log: Path,
    *,
    connections: Sequence[str],
    drones: Sequence[int] | None = None,
    flown: Path | None = None,
    options: StreamOptions | None = None,
    progress: Progress = SILENT,
    clock: Clock | None = None,
) -> StreamReport:
    """Fly the show in ``log`` with the vehicles behind ``connections``.

    Every vehicle is put into the mode that follows setpoints, armed, and (ArduPilot)
    sent up to where it joins the show; then the clock starts for all. When a vehicle is
    not heard for a while, leaves its corridor or its mode, or the operator interrupts,
    all of them are told to hold where they are; before the clock has started, to land.

    Parameters
    ----------
    log
        Trajectory log that ``showc compile`` wrote.
    connections
        Links to the vehicles, see :class:`showc.vehicle_link.network.Network`.
    drones
        Which drones, counting from 1; None: all.
    flown
        Log to write of where the vehicles were; None: none.
    options
        Rate, corridor, patience.
    progress
        Told of every second of the show.
    clock
        For rehearsals that run faster than the wall's clock.

    Raises
    ------
    UsageError
        If a file cannot be read or written, or a connection not opened. What happens
        to vehicles is in the report, not raised.
    DamagedFileError
        If the log is damaged.
    """
    options = options or StreamOptions()
    if options.rate < LEAST_RATE:
        raise UsageError(
            f"rate {options.rate:g} Hz is too low; wanted at least {LEAST_RATE:g} Hz"
        )
    show = read_log(log)
    plan = stream_plan(show, drones)
    epoch = int(show.metadata.get("epoch_ns", "0"))
    systems = options.systems or {}
    numbers = [systems.get(drone + 1, drone + 1) for drone in plan.drones]
    with Network(connections, numbers) as network:
        conductor = _Conductor(plan, network, options, progress, clock or Clock())
        if flown is None:
            return conductor.run(None)
        with FlownLog(flown, plan.drones, epoch) as record:
            return conductor.run(record)


class _Conductor:
    """Keeps all vehicles on one clock."""

    def __init__(
        self,
        plan: StreamPlan,
        network: Network,
        options: StreamOptions,
        progress: Progress,
        clock: Clock,
    ) -> None:
        self.plan, self.network, self.options = plan, network, options
        self.progress, self.clock = progress, clock
        pads, joins = plan.pads(), plan.at(plan.launch_end)[0]
        systems = options.systems or {}
        self.pilots = [
            Pilot(
                drone,
                Address(systems.get(drone + 1, drone + 1), 1),
                plan.frame,
                start=joins[index],
                pad=pads[index],
                corridor=options.corridor,
            )
            for index, drone in enumerate(plan.drones)
        ]
        self.by_system = {pilot.vehicle.system: pilot for pilot in self.pilots}
        self.deviation = np.zeros(len(self.pilots))
        self.record: FlownLog | None = None
        self.begun: float | None = None
        self.join = 0.0
        self.shown = 0.0
        self.rounds = Rounds()

    def run(self, record: FlownLog | None) -> StreamReport:
        """Fly the show; return how it went."""
        self.record = record
        try:
            reason = self._prepare() or self._fly() or self._land()
        except KeyboardInterrupt:
            reason = "stopped by the operator"
        if reason:
            self._stop()
        return StreamReport(
            not reason,
            reason,
            round(self.shown, 3),
            round(self.rounds.rate, 2),
            round(self.rounds.longest_gap, 3),
            round(self.rounds.longest_hold_up, 3),
            tuple(
                VehicleFlight(
                    pilot.drone + 1,
                    pilot.vehicle.system,
                    pilot.phase.value,
                    pilot.reason,
                    pilot.setpoints,
                    round(float(deviation), 3),
                )
                for pilot, deviation in zip(self.pilots, self.deviation, strict=True)
            ),
        )

    def _prepare(self) -> str:
        """Bring all vehicles to READY; return why that failed."""
        self.progress.stage("vehicles ready", len(self.pilots))
        deadline = self.clock.now() + self.options.ready_timeout
        ready = 0
        while ready < len(self.pilots):
            now = self._listen(0.05)
            for pilot in self.pilots:
                self._send(pilot, pilot.prepare(now))
            failed = [pilot for pilot in self.pilots if pilot.phase is Phase.FAILED]
            if failed:
                return f"drone {failed[0].drone + 1} {failed[0].reason}"
            if now > deadline:
                late = next(p for p in self.pilots if p.phase is not Phase.READY)
                return (
                    f"drone {late.drone + 1} is not ready after "
                    f"{self.options.ready_timeout:g} s: {late.phase.value}"
                )
            count = sum(pilot.phase is Phase.READY for pilot in self.pilots)
            self.progress.advance(count - ready)
            ready = count
        return ""

    def _fly(self) -> str:
        """Send setpoints on the common clock to the end; return why it stopped."""
        ardupilot = any(pilot.ardupilot for pilot in self.pilots)
        self.join = join = self.plan.launch_end if ardupilot else 0.0
        self.progress.stage("show", max(1, round(self.plan.duration - join)))
        begun = self.clock.now() + COUNTDOWN
        self.begun = begun - join
        for pilot in self.pilots:
            pilot.phase = Phase.FLYING
        period = 1.0 / self.options.rate
        step, told = 0, 0
        while True:
            moment = begun - COUNTDOWN + step * period
            while self.clock.now() < moment:
                self._listen(moment - self.clock.now())
            # A late tick is not made up for: the setpoint is for now.
            now = self._listen(0.0)
            step = max(step + 1, int((now - begun + COUNTDOWN) / period) + 1)
            self.shown = max(now - self.begun, join)
            reason = self._watch(now)
            if reason:
                return reason
            if self.shown >= self.plan.duration:
                self.shown = self.plan.duration
                self.progress.advance(max(0, round(self.plan.duration - join) - told))
                return ""
            self._setpoints()
            seconds = int(self.shown - join)
            self.progress.advance(seconds - told)
            told = seconds

    def _setpoints(self) -> None:
        """Send every vehicle where it is to be now."""
        places, speeds, pushes = self.plan.at(self.shown)
        stamp = round(self.shown * 1000.0)
        for index, pilot in enumerate(self.pilots):
            message = pilot.setpoint(places[index], speeds[index], pushes[index], stamp)
            self.network.send(message, pilot.vehicle.system)
        self.rounds.note((self.begun or 0.0) + self.shown, self.clock.now())

    def _watch(self, now: float) -> str:
        """Return what is wrong with a vehicle in flight."""
        for index, pilot in enumerate(self.pilots):
            name = f"drone {pilot.drone + 1}"
            quiet = now - pilot.heard
            if quiet > self.options.link_timeout:
                pilot.fail(f"was not heard for {quiet:.1f} s")
            elif pilot.off_mode():
                pilot.fail("left its mode or disarmed")
            elif self.deviation[index] > self.options.corridor:
                pilot.fail(f"is {self.deviation[index]:.1f} m from its trajectory")
            if pilot.phase is Phase.FAILED:
                return f"{name} {pilot.reason}"
        return ""

    def _land(self) -> str:
        """Land all vehicles; return why that failed."""
        self.progress.stage("landing", len(self.pilots))
        asked = -np.inf
        deadline = self.clock.now() + LANDING_TIME
        for pilot in self.pilots:
            pilot.phase = Phase.LANDING
        while True:
            now = self._listen(0.05)
            for pilot in self.pilots:
                if pilot.phase is Phase.LANDING and not pilot.armed:
                    pilot.phase = Phase.LANDED
                    self.progress.advance()
            flying = [pilot for pilot in self.pilots if pilot.phase is Phase.LANDING]
            if not flying:
                return ""
            if now > deadline:
                return f"drone {flying[0].drone + 1} has not landed"
            if now - asked >= 1.0:
                asked = now
                for pilot in flying:
                    self._send(pilot, [pilot.land()])

    def _stop(self) -> None:
        """Tell everybody to hold, or to land again if the show has not begun.

        More than once: links lose messages. A vehicle that has left the mode of
        setpoints is in somebody else's hands, or holds already: it is left alone.
        """
        for _ in range(3):
            for pilot in self.pilots:
                if self.begun is not None:
                    if not pilot.off_mode():
                        self._send(pilot, [pilot.hold()])
                elif pilot.armed:
                    self._send(pilot, [pilot.land()])
            self._listen(0.1)

    def _listen(self, span: float) -> float:
        """Take messages for up to ``span`` [s]; return the time."""
        wait = self.clock.wall(max(span, 0.0))
        for received in self.network.poll(wait):
            pilot = self.by_system.get(received.sender.system)
            if pilot is None or received.sender.component != 1:
                continue
            now = self.clock.now()
            pilot.handle(received.message, now)
            if received.message.get_type() == "LOCAL_POSITION_NED":
                self._note(pilot, now)
        return self.clock.now()

    def _note(self, pilot: Pilot, now: float) -> None:
        """Log where a flying vehicle is, and how far that is from its plan."""
        if pilot.phase is not Phase.FLYING or pilot.place is None:
            return
        moment = now - (self.begun or now)
        started = moment >= self.join
        moment = max(moment, self.join)
        index = self.plan.drones.index(pilot.drone)
        planned = self.plan.position[index](moment)
        off = float(np.linalg.norm(pilot.place.position - planned))
        self.deviation[index] = max(self.deviation[index], off)
        if self.record is not None and started:
            self.record.add(
                pilot.drone, moment, pilot.place.position, pilot.place.velocity
            )

    def _send(self, pilot: Pilot, messages: list[Any]) -> None:
        for message in messages:
            self.network.send(message, pilot.vehicle.system)
