"""Put the missions of a fleet onto its vehicles, and keep a record of what each has."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from showc.autopilot.timing import ARMED_IN_TIME
from showc.errors import UsageError
from showc.files import UnreadableFileError, read_file, write_file
from showc.progress import Silent
from showc.vehicle_link.clock import WallClock
from showc.vehicle_link.folder import read_fleet
from showc.vehicle_link.network import (
    AUTOPILOT_COMPONENT,
    LISTENING,
    Address,
    Network,
    ids_of,
)
from showc.vehicle_link.transfer import RUNS, State, Transfer

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from showc.progress import Progress
    from showc.vehicle_link.clock import Clock
    from showc.vehicle_link.folder import FleetFolder, FleetMission

SILENT = Silent()
_RECORD_BYTES = 100_000_000
"""Largest record of uploads that is read [bytes]."""

AT_ONCE = 20
"""Vehicles that are written to at the same time."""


@dataclass(frozen=True, slots=True)
class VehicleRecord:
    """What became of one vehicle."""

    drone: int
    """Counting from 1."""
    system: int
    """MAVLink system id."""
    file: str
    """Its mission."""
    sha256: str
    """Hash of that file."""
    items: int
    """Items of the mission."""
    parameters: int
    """Parameters that were written and read back."""
    holds: bool
    """Whether it read back exactly what was sent, parameters and mission."""
    reason: str
    """Why not."""


@dataclass(frozen=True, slots=True)
class UploadReport:
    """Which vehicle has which file."""

    fleet: str
    """The compile that the missions belong to."""
    time: str
    """UTC at the end, ISO 8601."""
    vehicles: tuple[VehicleRecord, ...]
    """By drone."""
    advice: str = ""
    """What the operator must do next; empty: nothing that is known."""

    @property
    def complete(self) -> bool:
        """Whether every vehicle holds its mission."""
        return all(vehicle.holds for vehicle in self.vehicles)

    def to_json(self) -> dict[str, Any]:
        """Return the report as JSON-able data."""
        return {
            "fleet": self.fleet,
            "time": self.time,
            "complete": self.complete,
            "advice": self.advice,
            "vehicles": [asdict(vehicle) for vehicle in self.vehicles],
        }


@dataclass(frozen=True, slots=True)
class UploadOptions:
    """How missions are loaded."""

    timeout: float = 30.0
    """Time in which a vehicle must show up [s]."""
    systems: Mapping[int, int] | None = None
    """MAVLink system id of each drone (counting from 1); None: its number."""
    parameters: bool = True
    """Whether the parameters beside the missions are written and read back too."""
    missing: bool = False
    """Only vehicles that do not hold their mission by the record."""
    key: bytes | None = None
    """Signing key of 32 bytes; None: messages are not signed."""


def upload_missions(
    folder: Path,
    *,
    connections: Sequence[str],
    drones: Sequence[int] | None = None,
    audit: Path | None = None,
    options: UploadOptions | None = None,
    progress: Progress = SILENT,
    clock: Clock | None = None,
) -> UploadReport:
    """Load missions and parameters in ``folder``, read them back and compare.

    A vehicle is the address at which its system id is first heard. An id that is heard
    from two addresses is refused.

    Parameters
    ----------
    folder
        What ``showc compile`` wrote: ``manifest.json`` and ``missions/``.
    connections
        Links to the vehicles, see :class:`showc.vehicle_link.network.Network`.
    drones
        Which drones, counting from 1; None: all.
    audit
        File that keeps the record of this and all former uploads; None: no record.
    options
        Patience, system ids, signing key.
    progress
        Notified of every answer of a vehicle.
    clock
        The wall's, if None.

    Raises
    ------
    UsageError
        If the folder is not one compile's, a drone is not in it, a connection cannot
        be opened, or the record cannot be written. Vehicles that fail are in the
        report, not raised.
    """
    options = options or UploadOptions()
    fleet = read_fleet(folder)
    former = [] if audit is None else _former(audit)
    chosen = _chosen(fleet, drones)
    numbers = [mission.drone for mission in chosen]
    ids = dict(zip(numbers, ids_of(numbers, options.systems), strict=True))
    if options.missing:
        holding = _holding(fleet, former)
        chosen = [mission for mission in chosen if mission.drone not in holding]
    vehicles = [ids[mission.drone] for mission in chosen]
    transfers = {
        mission: Transfer(
            Address(system, AUTOPILOT_COMPONENT),
            mission.items,
            fleet.autopilot,
            fleet.parameters if options.parameters else {},
        )
        for mission, system in zip(chosen, vehicles, strict=True)
    }
    with Network(
        connections, vehicles, key=options.key, clock=clock or WallClock()
    ) as network:
        _run(network, list(transfers.values()), options.timeout, progress)
    report = UploadReport(
        fleet.token,
        datetime.now(UTC).isoformat(timespec="seconds"),
        tuple(_record(mission, transfer) for mission, transfer in transfers.items()),
        ARMED_IN_TIME if fleet.autopilot == "ardupilot" else "",
    )
    if audit is not None:
        _write(audit, {"uploads": [*former, report.to_json()]})
    return report


def _holding(fleet: FleetFolder, former: Sequence[Any]) -> set[int]:
    """Drones that hold their mission of this compile by the record's last word."""
    holds: dict[int, bool] = {}
    for upload in former:
        for vehicle in upload["vehicles"]:
            same = upload["fleet"] == fleet.token
            holds[int(vehicle["drone"])] = bool(same and vehicle["holds"])
    return {drone for drone, held in holds.items() if held}


def _chosen(fleet: FleetFolder, drones: Sequence[int] | None) -> list[FleetMission]:
    if drones is None:
        return list(fleet.missions)
    known = {mission.drone: mission for mission in fleet.missions}
    missing = [drone for drone in drones if drone not in known]
    if missing:
        raise UsageError(
            f"drone {missing[0]} is not in the fleet of {len(known)}; drones count "
            "from 1"
        )
    return [known[drone] for drone in sorted(set(drones))]


def _run(
    network: Network, transfers: list[Transfer], timeout: float, progress: Progress
) -> None:
    """Pump messages until every transfer is over."""
    progress.stage("uploading", sum(transfer.steps for transfer in transfers))
    by_system = {transfer.vehicle.system: transfer for transfer in transfers}
    heard: dict[int, float] = {}
    begun = network.clock.now()
    shown = 0
    while not all(transfer.over for transfer in transfers):
        received = network.poll(0.02)
        now = network.clock.now()
        for item in received:
            if item.sender.component == AUTOPILOT_COMPONENT:
                heard.setdefault(item.sender.system, now)
                by_system[item.sender.system].handle(item.message, now)
        for transfer in transfers:
            system = transfer.vehicle.system
            if network.claim(system):
                transfer.refuse(network.claim(system))
            elif system not in heard and now - begun > timeout:
                transfer.refuse(_unheard(network, system, timeout))
            elif (
                transfer.state is State.WAITING
                and now - heard.get(system, now) > LISTENING
                and sum(other.busy for other in transfers) < AT_ONCE
            ):
                transfer.start(now)
            runs = transfer.runs
            transfer.tick(now)
            if transfer.runs > max(runs, 1):
                progress.note(f"system {system}: run {transfer.runs} of {RUNS}")
            for message in transfer.take_outbox():
                network.send(message, system)
        count = sum(transfer.progress for transfer in transfers)
        progress.advance(max(count - shown, 0))
        shown = max(count, shown)


def _unheard(network: Network, system: int, timeout: float) -> str:
    if system in network.untrusted:
        return (
            "sends no right signature for this key; load the key onto the vehicle, or "
            "leave --signing-key out"
        )
    return f"not heard within {timeout:g} s"


def _record(mission: FleetMission, transfer: Transfer) -> VehicleRecord:
    return VehicleRecord(
        mission.drone,
        transfer.vehicle.system,
        mission.name,
        mission.digest,
        len(mission.items),
        len(transfer.parameters),
        transfer.state is State.DONE,
        transfer.reason,
    )


def _former(audit: Path) -> list[Any]:
    """Return the uploads already on record."""
    if not audit.exists():
        return []
    try:
        return list(json.loads(read_file(audit, _RECORD_BYTES))["uploads"])
    except (UnreadableFileError, ValueError, KeyError, TypeError, RecursionError):
        raise UsageError(
            f"{audit}: is not a record of uploads; move it away, or give another file"
        ) from None


def _write(audit: Path, record: dict[str, Any]) -> None:
    """Replace the record as a whole."""
    write_file(audit, (json.dumps(record, indent=1) + "\n").encode())
