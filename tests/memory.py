"""Memory of a process, apart from that of the process that started it."""

import re
import resource
import sys
from pathlib import Path

_STATUS = Path("/proc/self/status")


def peak():
    """Largest resident memory of this process [bytes].

    ``getrusage`` hands on what the starting process took before the new program began;
    Linux's status does not.
    """
    if _STATUS.exists():
        return 1024 * int(re.search(r"VmHWM:\s+(\d+) kB", _STATUS.read_text())[1])
    unit = 1 if sys.platform == "darwin" else 1024
    return unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
