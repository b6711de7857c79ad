"""The manifest: what was compiled from what, by what, and how good it is."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
from typing import TYPE_CHECKING, Any

from showc._version import __version__
from showc.log.content import segment_message
from showc.log.facts import manifest_of, sha256

if TYPE_CHECKING:
    from collections.abc import Mapping

    from showc.flight import Flight

FORMAT_VERSION = 1
"""Version of the manifest's format."""

_LIBRARIES = ("casadi", "mcap", "numpy", "protobuf", "scipy", "zstandard")


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
    legs = flight.legs
    facts = manifest_of(
        flight.itinerary.show,
        [segment_message(flight, number) for number in range(len(legs))],
        _greatest_height(flight),
        [one.leg.assignment for one in legs],
    )
    listed = {name: sha256(content) for name, content in sorted(files.items())}
    manifest = {
        "format_version": FORMAT_VERSION,
        "fleet": token,
        "versions": versions(),
        **facts,
        "missions": {**missions, "files": listed},
    }
    return (json.dumps(manifest, indent=1, ensure_ascii=False) + "\n").encode()


def _greatest_height(flight: Flight) -> float:
    """Upper bound on the height of any drone at any instant, show frame [m]."""
    return max(
        float(trajectory.state.coefficients[:, :, 2].max())
        for leg in flight.legs
        for trajectory in leg.trajectories
    )
