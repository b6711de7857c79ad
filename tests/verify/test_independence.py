"""Verify shares no code with what plans, solves and writes."""

import subprocess
import sys
from pathlib import Path

FORBIDDEN = (
    *("casadi", "mcap", "pymap3d", "pymavlink", "ruckig"),
    *(
        f"showc.{part}"
        for part in (
            *("trajectory", "plan", "ocp", "solve", "flight"),
            *("mission", "pipeline", "view", "log.writer", "log.reader", "log.content"),
        )
    ),
)


def test_importing_and_running_verify_loads_nothing_of_the_compiler(log_path):
    code = (
        "import sys\n"
        "from showc.verify import verify_log\n"
        f"assert verify_log({str(log_path)!r}, missions=False).passed\n"
        "print('\\n'.join(sys.modules))"
    )
    run = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).parents[2],
    )
    modules = run.stdout.split()
    assert {"showc.log.container", "showc.verify.proofs"} <= set(modules)
    loaded = [
        name
        for name in modules
        if any(name == part or name.startswith(f"{part}.") for part in FORBIDDEN)
    ]
    assert loaded == []
