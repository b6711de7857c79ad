"""Where the repository lies, its shows, and what its test processes share."""

import fcntl
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[1]
SHOWS = sorted((ROOT / "shows").glob("*.yaml"))
WITH_MISSIONS = [path for path in SHOWS if "wanted: false" not in path.read_text()]
"""Those that an autopilot's missions can carry."""


@contextmanager
def alone(path):
    """Hold a file's lock: what is done within, one process does at a time."""
    with path.open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def running(word):
    """Numbers of the processes that carry a word in their environment."""
    found = set()
    for folder in Path("/proc").iterdir():
        if not folder.name.isdigit():
            continue
        try:
            state = (folder / "stat").read_text().rpartition(")")[2].split()[0]
            if state != "Z" and word in (folder / "environ").read_bytes():
                found.add(int(folder.name))
        except OSError:
            continue
    return found
