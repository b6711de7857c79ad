"""A Dask cluster: real scheduler, real workers on the loopback address."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from fleet.handmade import Listening, make_itinerary, make_leg, make_options

from showc.fleet import solve_itinerary
from showc.fleet.execution.pool import Cluster
from showc.progress import Silent

distributed = pytest.importorskip("distributed")


def wait_for(client, workers):
    for _ in range(600):
        if len(client.scheduler_info(n_workers=-1)["workers"]) == workers:
            return
        time.sleep(0.1)
    pytest.fail(f"{workers} workers did not come")


@pytest.fixture
def cluster():
    """A scheduler and two workers, each a process of its own."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    environment["PYTHONPATH"] = os.pathsep.join(sys.path)
    processes = []

    def start(module, *arguments, **options):
        process = subprocess.Popen(
            [sys.executable, "-m", module, *arguments],
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            **options,
        )
        processes.append(process)
        return process

    scheduler = start(
        "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0",
        "--no-dashboard",
    )  # fmt: skip
    address = ""
    for line in scheduler.stderr:
        if "Scheduler at:" in line:
            address = line.split()[-1]
            break
    crew = [
        start(
            "distributed.cli.dask_worker", address, "--nthreads", "1",
            "--no-nanny", "--no-dashboard", stdin=subprocess.DEVNULL,
        )
        for _ in range(2)
    ]  # fmt: skip
    with distributed.Client(address, set_as_default=False) as client:
        wait_for(client, 2)
    yield address, crew
    for process in processes:
        process.kill()
        process.wait()
        process.stderr.close()


def slowly(value):
    time.sleep(0.15)
    return value * 3


@pytest.mark.slow
def test_a_cluster_gives_what_one_process_gives_even_if_a_worker_dies(cluster):
    address, crew = cluster
    remote = Cluster(address)
    victims = []

    def kill_one(_steps):
        if not victims:
            victims.append(crew[0])
            crew[0].send_signal(signal.SIGKILL)

    try:
        tasks = [(value,) for value in range(24)]
        assert remote.run(slowly, tasks, kill_one) == [3 * v for v in range(24)]
    finally:
        remote.close()
    assert victims and victims[0].wait(10) == -signal.SIGKILL

    start = np.array([[0.0, 0.0, 10.0], [9.0, 0.2, 10.0], [4.0, 6.0, 10.0]])
    goal = start[[1, 0, 2]] + [0.0, 0.0, 2.0]
    legs = [make_leg(start, goal, duration=5.0)]
    there = solve_itinerary(
        make_itinerary(legs), make_options(cluster=address), Silent()
    )
    here = solve_itinerary(make_itinerary(legs), make_options(jobs=1), Silent())
    for a, b in zip(there.legs[0].trajectories, here.legs[0].trajectories, strict=True):
        assert np.array_equal(a.state.coefficients, b.state.coefficients)


@pytest.mark.slow
def test_whole_legs_go_to_the_cluster_and_leave_nothing_in_our_cache(cluster, tmp_path):
    address, _ = cluster
    start = np.array([[0.0, 0.0, 10.0], [9.0, 0.2, 10.0]])
    goal = start + [0.0, 5.0, 2.0]
    legs = [
        make_leg(start, goal, index=0, duration=5.0, name="out"),
        make_leg(goal, start, index=1, duration=5.5, name="back"),
    ]
    options = make_options(cluster=address, use_cache=True, cache=tmp_path)
    listening = Listening()
    there = solve_itinerary(make_itinerary(legs), options, listening)
    assert ("solve 2 legs side by side", 2) in listening.stages
    here = solve_itinerary(make_itinerary(legs), make_options(), Silent())
    for one, other in zip(there.legs, here.legs, strict=True):
        for a, b in zip(one.trajectories, other.trajectories, strict=True):
            assert np.array_equal(a.state.coefficients, b.state.coefficients)
    kept = [path.suffix for path in tmp_path.rglob("*") if path.is_file()]
    assert kept == [".leg", ".leg"]
    assert not any(path.suffix == ".parts" for path in tmp_path.rglob("*"))
