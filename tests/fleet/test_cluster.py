"""A Dask cluster: real scheduler, real workers on the loopback address."""

import gc
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import trustme
from fleet.handmade import Listening, make_itinerary, make_leg, make_options

from showc.errors import UsageError
from showc.fleet import solve_itinerary
from showc.fleet.execution import pool
from showc.fleet.execution.pool import Cluster
from showc.progress import Silent

dask = pytest.importorskip("dask")
distributed = pytest.importorskip("distributed")


def wait_for(client, workers):
    for _ in range(600):
        if len(client.scheduler_info(n_workers=-1)["workers"]) == workers:
            return
        time.sleep(0.1)
    pytest.fail(f"{workers} workers did not come")


LEGS = [
    make_leg(
        np.array([[0.0, 0.0, 10.0], [9.0, 0.2, 10.0]]),
        np.array([[0.0, 5.0, 12.0], [9.0, 5.2, 12.0]]),
        duration=5.0,
    )
]


def same_flights(one, other):
    for here, there in zip(one.legs, other.legs, strict=True):
        for a, b in zip(here.trajectories, there.trajectories, strict=True):
            assert np.array_equal(a.state.coefficients, b.state.coefficients)


@pytest.fixture(scope="module")
def certify(tmp_path_factory):
    """A new authority, and a certificate of it for all on this machine."""

    def made(name):
        folder = tmp_path_factory.mktemp(name)
        authority = trustme.CA()
        issued = authority.issue_cert("127.0.0.1", "localhost")
        authority.cert_pem.write_to_path(folder / "ca.pem")
        issued.cert_chain_pems[0].write_to_path(folder / "client.pem")
        issued.private_key_pem.write_to_path(folder / "client-key.pem")
        return folder

    return made


@pytest.fixture(scope="module")
def certificates(certify):
    return certify("certificates")


GROWING = """
import sys
from distributed import LocalCluster, Security

if __name__ == "__main__":
    with LocalCluster(
        n_workers=0, threads_per_worker=1, host="127.0.0.1", protocol="tls://",
        security=Security(), dashboard_address="127.0.0.1:0",
    ) as cluster:
        cluster.adapt(minimum=0, maximum=2, interval="100ms")
        print(cluster.scheduler_address, flush=True)
        sys.stdin.read()
"""


@pytest.fixture
def growing(certificates, tmp_path):
    """A cluster behind TLS, a process of its own, with workers while there is work."""
    script = tmp_path / "growing.py"
    script.write_text(GROWING)
    tls = "DASK_DISTRIBUTED__COMM__TLS"
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(sys.path),
        "DASK_DISTRIBUTED__COMM__REQUIRE_ENCRYPTION": "True",
        f"{tls}__CA_FILE": str(certificates / "ca.pem"),
    }
    for role in ("CLIENT", "SCHEDULER", "WORKER"):
        environment[f"{tls}__{role}__CERT"] = str(certificates / "client.pem")
        environment[f"{tls}__{role}__KEY"] = str(certificates / "client-key.pem")
    process = subprocess.Popen(
        [sys.executable, script],
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        with client_of(certificates, certificates):
            yield process.stdout.readline().strip()
        process.stdin.close()
        process.wait(20)
    finally:
        process.kill()
        process.stdout.close()


def client_of(authority, owner):
    """Dask's configuration of a client, as security.md gives it."""
    return dask.config.set(
        {
            "distributed.comm.require-encryption": True,
            "distributed.comm.tls.ca-file": str(authority / "ca.pem"),
            "distributed.comm.tls.client": {
                "cert": owner and str(owner / "client.pem"),
                "key": owner and str(owner / "client-key.pem"),
            },
        }
    )


@pytest.mark.slow
def test_adaptive_workers_behind_tls_give_what_one_process_gives(growing):
    assert growing.startswith("tls://127.0.0.1:")
    listening = Listening()
    options = make_options(cluster=growing)
    there = solve_itinerary(make_itinerary(LEGS), options, listening)
    assert not [note for note in listening.notes if "TLS" in note]
    same_flights(there, solve_itinerary(make_itinerary(LEGS), make_options(), Silent()))


@pytest.mark.slow
def test_no_client_without_a_certificate_of_the_clusters_authority(
    growing, certificates, certify, monkeypatch
):
    monkeypatch.setattr(pool, "PATIENCE", "2s")
    for owner, said in (
        (certify("another"), "no Dask scheduler answers"),
        (None, "configuration does not fit"),
    ):
        with client_of(certificates, owner), pytest.raises(UsageError, match=said):
            Cluster(growing)
    # Clients that came to nothing end here. Collected while another one starts, they
    # wait for the lock that it holds (distributed.utils.LoopRunner).
    gc.collect()


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
    assert ("solving 2 legs in parallel", 2) in listening.stages
    assert sum("without TLS" in note for note in listening.notes) == 1
    here = solve_itinerary(make_itinerary(legs), make_options(), Silent())
    for one, other in zip(there.legs, here.legs, strict=True):
        for a, b in zip(one.trajectories, other.trajectories, strict=True):
            assert np.array_equal(a.state.coefficients, b.state.coefficients)
    kept = [path.suffix for path in tmp_path.rglob("*") if path.is_file()]
    assert kept == [".leg", ".leg"]
    assert not any(path.suffix == ".parts" for path in tmp_path.rglob("*"))
