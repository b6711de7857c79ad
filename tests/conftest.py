"""What all tests share: the shows compiled once, in a cache of the session's own."""

import os
import signal
import subprocess
import sys
from dataclasses import dataclass

import pytest
from hypothesis import settings
from repository import ROOT, alone

os.environ.setdefault("OMP_NUM_THREADS", "1")
# Same code, same verdict, however busy the machine; HYPOTHESIS_PROFILE=explore looks
# for examples that nobody has seen.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.register_profile("explore", deadline=None, print_blob=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "repeatable"))
# A shell that runs the suite in its background has interrupts ignored, and processes
# hand that on: those that tests interrupt would never hear of it.
signal.signal(signal.SIGINT, signal.default_int_handler)
# Some hundred processes of showc start in one run. Without bytecode on disk, each of
# them compiles all that it imports, and takes nearly twice as long to start.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config):
    """Return one more than there are cores: some tests wait for vehicles and timers."""
    del config
    return (os.cpu_count() or 1) + 1


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
    """Compile a show of ``shows/`` once, for all processes; return its log's path.

    What lies there is read only: other tests have the same files.
    """
    base = tmp_path_factory.getbasetemp()
    shows = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "compiled"
    shows.mkdir(exist_ok=True)

    def compile_(name):
        log = shows / name / f"{name}.mcap"
        with alone(shows / f"{name}.lock"):
            if not log.exists():
                log.parent.mkdir(exist_ok=True)
                run = run_showc("compile", ROOT / "shows" / f"{name}.yaml", "-o", log)
                assert run.code == 0, run.err
        return log

    return compile_
