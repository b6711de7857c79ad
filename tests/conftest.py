"""What all tests share: the shows compiled once, in a cache of the session's own."""

import os
import signal
import subprocess
import sys
from dataclasses import dataclass

import pytest
from hypothesis import settings
from repository import ROOT

os.environ.setdefault("OMP_NUM_THREADS", "1")
# Same code, same verdict, however busy the machine; HYPOTHESIS_PROFILE=explore looks
# for examples that nobody has seen.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.register_profile("explore", deadline=None, print_blob=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "repeatable"))
# A shell that runs the suite in its background has interrupts ignored, and processes
# hand that on: those that tests interrupt would never hear of it.
signal.signal(signal.SIGINT, signal.default_int_handler)


@dataclass(frozen=True)
class Run:
    """What a command did."""

    code: int
    out: str
    err: str


@pytest.fixture(scope="session")
def cache(tmp_path_factory):
    """Cache folder shared by the whole session, over all worker processes."""
    return tmp_path_factory.getbasetemp().parent / "showc-test-cache"


@pytest.fixture(scope="session")
def run_showc(cache):
    """Run the command line in a process of its own."""

    def run(*arguments, cwd=None, env=None, timeout=600):
        environment = {**os.environ, "XDG_CACHE_HOME": str(cache), **(env or {})}
        done = subprocess.run(
            [sys.executable, "-m", "showc", *map(str, arguments)],
            cwd=cwd,
            env=environment,
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
        )
        return Run(done.returncode, done.stdout, done.stderr)

    return run


@pytest.fixture(scope="session")
def compiled(run_showc, tmp_path_factory):
    """Compile a show of ``shows/`` once; return the path of its log."""
    logs = {}

    def compile_(name):
        if name not in logs:
            folder = tmp_path_factory.mktemp(name)
            log = folder / f"{name}.mcap"
            run = run_showc("compile", ROOT / "shows" / f"{name}.yaml", "-o", log)
            assert run.code == 0, run.err
            logs[name] = log
        return logs[name]

    return compile_
