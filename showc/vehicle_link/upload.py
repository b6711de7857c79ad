"""Put the missions of a fleet onto its vehicles, and keep a record of who has what."""

from __future__ import annotations

import json
import time
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from showc.errors import UsageError
from showc.progress import Silent
from showc.vehicle_link.folder import read_fleet
from showc.vehicle_link.network import Address, Network
from showc.vehicle_link.transfer import State, Transfer

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from showc.progress import Progress
    from showc.vehicle_link.folder import FleetFolder, FleetMission

SILENT = Silent()

AUTOPILOT_COMPONENT = 1
"""Component id of an autopilot."""

LAST_SYSTEM = 250
"""Greatest system id of a vehicle; the rest is for ground stations."""

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
    holds: bool
    """Whether the vehicle read back exactly what was sent."""
    reason: str
    """Why not."""


@dataclass(frozen=True, slots=True)
class UploadReport:
    """Who has which file."""

    fleet: str
    """The compile that the missions belong to."""
    time: str
    """UTC at the end, ISO 8601."""
    vehicles: tuple[VehicleRecord, ...]
    """By drone."""

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
            "vehicles": [asdict(vehicle) for vehicle in self.vehicles],
        }


def upload_missions(
    folder: Path,
    *,
    connections: Sequence[str],
    drones: Sequence[int] | None = None,
    systems: Mapping[int, int] | None = None,
    audit: Path | None = None,
    timeout: float = 30.0,
    progress: Progress = SILENT,
    clock: Callable[[], datetime] = lambda: datetime.now(UTC),
) -> UploadReport:
    """Upload the missions in ``folder``, read them back and compare.

    Parameters
    ----------
    folder
        What ``showc compile`` wrote: ``manifest.json`` and ``missions/``.
    connections
        Links to the vehicles, see :class:`showc.vehicle_link.network.Network`.
    drones
        Which drones, counting from 1; None: all.
    systems
        MAVLink system id of a drone where it is not the drone's number.
    audit
        File that keeps the record of this and all former uploads; None: no record.
    timeout
        Time in which a vehicle must show up first [s].
    progress
        Told of every item.
    clock
        UTC for the record.

    Raises
    ------
    UsageError
        If the folder is not one compile's, a drone is not in it, a connection cannot
        be opened, or the record cannot be written. Vehicles that fail are in the
        report, not raised.
    """
    fleet = read_fleet(folder)
    chosen = _chosen(fleet, drones)
    vehicles = _systems(chosen, systems or {})
    former = [] if audit is None else _former(audit)
    transfers = {
        mission: Transfer(
            Address(system, AUTOPILOT_COMPONENT), mission.items, fleet.autopilot
        )
        for mission, system in zip(chosen, vehicles, strict=True)
    }
    with Network(connections) as network:
        _run(network, list(transfers.values()), timeout, progress)
    report = UploadReport(
        fleet.token,
        clock().astimezone(UTC).isoformat(timespec="seconds"),
        tuple(_record(mission, transfer) for mission, transfer in transfers.items()),
    )
    if audit is not None:
        _write(audit, {"uploads": [*former, report.to_json()]})
    return report


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


def _systems(chosen: list[FleetMission], systems: Mapping[int, int]) -> list[int]:
    """System id of each chosen drone's vehicle."""
    found = [systems.get(mission.drone, mission.drone) for mission in chosen]
    if len(set(found)) < len(found):
        raise UsageError("two drones have the same system id; give every drone its own")
    beyond = [system for system in found if not 1 <= system <= LAST_SYSTEM]
    if beyond:
        raise UsageError(
            f"system id {beyond[0]} is out of range; wanted 1 to {LAST_SYSTEM}: upload "
            "a large fleet network by network, with system ids of its own on each"
        )
    return found


def _run(
    network: Network, transfers: list[Transfer], timeout: float, progress: Progress
) -> None:
    """Pump messages until every transfer is over."""
    progress.stage("upload", 2 * sum(len(transfer.items) for transfer in transfers))
    by_system = {transfer.vehicle.system: transfer for transfer in transfers}
    begun = time.monotonic()
    done = 0
    while not all(transfer.over for transfer in transfers):
        now = time.monotonic()
        for received in network.poll(now, 0.02):
            transfer = by_system.get(received.sender.system)
            if transfer is None or received.sender.component != AUTOPILOT_COMPONENT:
                continue
            if transfer.state is not State.WAITING:
                transfer.handle(received.message, now)
            elif sum(other.busy for other in transfers) < AT_ONCE:
                transfer.start(now)
        if now - begun > timeout and not any(other.busy for other in transfers):
            for transfer in transfers:
                transfer.give_up(f"not heard within {timeout:g} s")
        for transfer in transfers:
            transfer.tick(now)
            for message in transfer.take_outbox():
                network.send(message, transfer.vehicle.system)
        count = sum(transfer.progress for transfer in transfers)
        progress.advance(count - done)
        done = count


def _record(mission: FleetMission, transfer: Transfer) -> VehicleRecord:
    return VehicleRecord(
        mission.drone,
        transfer.vehicle.system,
        mission.name,
        mission.digest,
        len(mission.items),
        transfer.state is State.DONE,
        transfer.reason,
    )


def _former(audit: Path) -> list[Any]:
    """Return the uploads already on record."""
    if not audit.exists():
        return []
    try:
        return list(json.loads(audit.read_bytes())["uploads"])
    except (OSError, ValueError, KeyError, TypeError):
        raise UsageError(
            f"{audit}: is not a record of uploads; move it away, or give another file"
        ) from None


def _write(audit: Path, record: dict[str, Any]) -> None:
    """Replace the record as a whole."""
    partial = audit.with_name(audit.name + ".part")
    try:
        partial.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
        partial.replace(audit)
    except OSError as error:
        raise UsageError(f"{audit}: cannot be written ({error.strerror})") from None
