"""Where the repository lies, and its shows."""

from pathlib import Path

ROOT = Path(__file__).parents[1]
SHOWS = sorted((ROOT / "shows").glob("*.yaml"))
WITH_MISSIONS = [path for path in SHOWS if "wanted: false" not in path.read_text()]
"""Those that an autopilot's missions can carry."""
