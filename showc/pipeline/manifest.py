"""The manifest: what was compiled from what, by what, and how good it is."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from showc._version import __version__

if TYPE_CHECKING:
    from collections.abc import Mapping

    from showc.flight import Certificate, Flight

FORMAT_VERSION = 1
"""Version of the manifest's format."""

_LIBRARIES = ("casadi", "mcap", "numpy", "protobuf", "scipy", "zstandard")


def sha256(content: bytes) -> str:
    """Hexadecimal SHA-256 of ``content``."""
    return hashlib.sha256(content).hexdigest()


def versions() -> dict[str, str]:
    """Versions of showc and of the libraries that its results depend on."""
    return {
        "showc": __version__,
        **{name: importlib.metadata.version(name) for name in _LIBRARIES},
    }


def log_token(flight: Flight) -> str:
    """Return a word for a compile without missions: SHA-256 of what was solved."""
    digest = hashlib.sha256(flight.itinerary.show.source.content)
    for leg in flight.legs:
        for trajectory in leg.trajectories:
            digest.update(trajectory.state.coefficients.tobytes())
    return digest.hexdigest()


def build_manifest(
    flight: Flight,
    *,
    token: str,
    missions: Mapping[str, Any],
    files: Mapping[str, bytes],
) -> bytes:
    """JSON of the manifest, the same bytes for the same flight.

    Parameters
    ----------
    flight
        What was solved.
    token
        One word that all files of one compile share, and no two compiles share.
    missions
        What the mission stage says of its files: autopilot, start, prediction.
    files
        Content of the output folder by relative path, without the manifest.
    """
    show = flight.itinerary.show
    legs = []
    for start, leg_flight in zip(flight.starts, flight.legs, strict=True):
        leg = leg_flight.leg
        legs.append(
            {
                "index": leg.index,
                "name": leg.name,
                "kind": leg.kind,
                "start": round(float(start), 3),
                "duration": leg_flight.duration,
                "from": leg.from_formation,
                "to": leg.to_formation,
                "assignment": leg.assignment,
                "certificate": _certificate(leg_flight.certificate),
            }
        )
    manifest = {
        "format_version": FORMAT_VERSION,
        "fleet": token,
        "versions": versions(),
        "show": {
            "name": show.name,
            "script": PurePath(show.source.path).name,
            "sha256": sha256(show.source.content),
            "inputs": {
                name: sha256(content)
                for name, content in sorted(show.source.inputs.items())
            },
            "epoch": show.epoch.isoformat(),
        },
        "drones": show.drones,
        "duration": round(flight.duration, 3),
        "greatest_height": round(_greatest_height(flight), 3),
        "segments": legs,
        "missions": {
            **missions,
            "files": {name: sha256(content) for name, content in sorted(files.items())},
        },
    }
    return (json.dumps(manifest, indent=1, ensure_ascii=False) + "\n").encode()


def _certificate(certificate: Certificate) -> dict[str, Any]:
    closest, witness = certificate.closest, certificate.witness
    return {
        "single_drone_minimum": certificate.single_drone_minimum,
        "gap": certificate.gap,
        "dual_bound": certificate.dual_bound,
        "witness": witness
        and {
            "drone": witness.drone + 1,
            "time": witness.time,
            "beta": witness.beta,
            "knots": witness.knots,
            "multipliers": witness.multipliers,
        },
        "closest": closest
        and {
            "drones": [closest.drone_a + 1, closest.drone_b + 1],
            "time": closest.time,
            "distance": closest.distance,
        },
        "method": certificate.method,
        "statistics": dict(sorted(certificate.statistics.items())),
    }


def _greatest_height(flight: Flight) -> float:
    """Upper bound on the height of any drone at any instant, show frame [m]."""
    return max(
        float(trajectory.state.coefficients[:, :, 2].max())
        for leg in flight.legs
        for trajectory in leg.trajectories
    )
