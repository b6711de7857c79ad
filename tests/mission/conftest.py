"""What several mission tests share."""

import socket
import time
from contextlib import suppress

import pytest


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture(scope="session")
def link():
    """A ground station and a vehicle of MAVSDK's, joined over the loopback address."""
    mavsdk = pytest.importorskip("mavsdk")
    from mavsdk.plugins.info.info import Info, InfoError
    from mavsdk.plugins.mission_raw.mission_raw import MissionRaw
    from mavsdk.plugins.mission_raw_server import MissionRawServer

    def station(kind):
        configuration = mavsdk.Configuration.create_with_component_type(kind)
        return mavsdk.Mavsdk(configuration)

    ground = station(mavsdk.ComponentType.GROUND_STATION)
    vehicle = station(mavsdk.ComponentType.AUTOPILOT)
    port = free_port()
    ground.add_any_connection(f"udpin://127.0.0.1:{port}")
    vehicle.add_any_connection(f"udpout://127.0.0.1:{port}")
    server = MissionRawServer(vehicle.server_component())
    until = time.monotonic() + 10.0
    while not ground.get_systems() and time.monotonic() < until:
        time.sleep(0.02)
    about = Info(ground.get_systems()[0])
    while time.monotonic() < until:
        # Before it knows the vehicle's capabilities, a station refuses to upload.
        with suppress(InfoError):
            about.get_version()
            break
        time.sleep(0.02)
    yield MissionRaw(ground.get_systems()[0])
    del server
    ground.destroy()
    vehicle.destroy()
