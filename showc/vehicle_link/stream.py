"""Fly the solved trajectories themselves: timed setpoints to a fleet on one clock."""

from __future__ import annotations

import signal
import threading
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal

from showc.errors import UsageError
from showc.log.reader import read_log
from showc.progress import Silent
from showc.vehicle_link.conductor import Conductor
from showc.vehicle_link.flown import FlownLog
from showc.vehicle_link.network import Network, ids_of
from showc.vehicle_link.setpoints import stream_plan

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from showc.progress import Progress
    from showc.vehicle_link.clock import Clock

__all__ = ["StreamOptions", "StreamReport", "VehicleFlight", "stream_show"]

SILENT = Silent()

LEAST_RATE = 10.0
"""Fewest setpoints a second that a vehicle is sent [Hz]."""

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""What may end this program from outside while vehicles fly."""


AfterStop = Literal["hold", "land", "return"]


@dataclass(frozen=True, slots=True)
class StreamOptions:
    """How a show is streamed."""

    rate: float = 20.0
    """Setpoints a second for each vehicle [Hz]; at least 10."""
    corridor: float = 3.0
    """Farthest a vehicle may be from its trajectory [m]."""
    link_timeout: float = 1.0
    """Greatest age of a vehicle's position [s]."""
    ready_timeout: float = 60.0
    """Time in which all vehicles must be ready [s]."""
    lead: float = 0.0
    """How much earlier than its moment a setpoint leaves [s]: ArduCopter followed
    position, velocity and acceleration within 0.02 s; a link's delay is to be added."""
    after_stop: AfterStop = "hold"
    """What a stopped fleet does: hover, land where it is, or fly back the way it came
    and land on its pads."""
    set_parameters: bool = False
    """Whether parameters of ArduCopter that are too small for the show are raised."""
    set_gains: bool = False
    """Whether ArduCopter flies with the gains that the envelope was measured with:
    those of a simulated quadrotor."""
    systems: Mapping[int, int] | None = None
    """MAVLink system id of each drone (counting from 1); None: its number."""
    key: bytes | None = None
    """Signing key of 32 bytes; None: messages are not signed."""

    def system(self, drone: int) -> int:
        """Return the system id of ``drone``, counting from 0."""
        return (self.systems or {}).get(drone + 1, drone + 1)


class Stop:
    """A wish to stop that comes from outside: a signal."""

    def __init__(self) -> None:
        self.reason = ""
        self.count = 0

    def __call__(self, reason: str) -> None:
        """Wish it."""
        self.reason = self.reason or reason
        self.count += 1


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
    """Greatest distance between where it was and where it was to be [m]."""


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
    unrecorded: str
    """Why there is no log of what was flown, where one was wanted; empty: there is."""

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

    Every vehicle is placed and its parameters are read; when all are fit they are put
    into the mode that follows setpoints, armed, and (ArduPilot) sent up to where they
    join the show; then the clock starts for all. When a vehicle falls silent, leaves
    its corridor or its mode, when this program fails, or on SIGINT, SIGTERM and SIGHUP,
    the common clock is brought to rest, which keeps every separation; then the fleet
    hovers, lands, or flies back. Before the clock has started, all land.

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
        Rate, corridor, patience, what follows a stop.
    progress
        Notified of every second of the show.
    clock
        The wall's, if None.

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
    systems = ids_of([drone + 1 for drone in plan.drones], options.systems)
    stop = Stop()
    with Network(connections, systems, key=options.key, clock=clock) as network:
        conductor = Conductor(plan, network, options, progress, stop)
        if flown is None:
            with _signals(stop):
                reason = conductor.run(None)
            return _report(conductor, reason, "")
        with FlownLog(flown, plan.drones, epoch) as record, _signals(stop):
            reason = conductor.run(record)
    return _report(conductor, reason, record.fault)


def _report(conductor: Conductor, reason: str, unrecorded: str) -> StreamReport:
    rounds = conductor.rounds
    return StreamReport(
        not reason,
        reason,
        round(conductor.shown, 3),
        round(rounds.rate, 2),
        round(rounds.longest_gap, 3),
        round(rounds.longest_hold_up, 3),
        tuple(
            VehicleFlight(
                pilot.drone + 1,
                pilot.vehicle.system,
                pilot.phase.value,
                pilot.reason,
                pilot.setpoints,
                round(float(deviation), 3),
            )
            for pilot, deviation in zip(
                conductor.pilots, conductor.deviation, strict=True
            )
        ),
        unrecorded,
    )


@contextmanager
def _signals(stop: Stop) -> Iterator[None]:
    """Take signals as a wish to stop, where this thread may."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def take(number: int, _frame: object) -> None:
        stop(f"stopped by {signal.Signals(number).name}")

    former = {number: signal.signal(number, take) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
