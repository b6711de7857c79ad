"""Where the repository lies, and its shows."""

from pathlib import Path

ROOT = Path(__file__).parents[1]
SHOWS = sorted((ROOT / "shows").glob("*.yaml"))
