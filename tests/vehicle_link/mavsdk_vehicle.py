"""A vehicle made of MAVSDK's own vehicle side: it goes where setpoints say."""

from __future__ import annotations

import json
import threading
import time

import mavsdk
from mavsdk.plugins.action_server import ActionServer, AllowableFlightModes
from mavsdk.plugins.mavlink_direct_server import MavlinkDirectServer
from mavsdk.plugins.telemetry_server import (
    Heading,
    Position,
    PositionNed,
    PositionVelocityNed,
    TelemetryServer,
    VelocityNed,
)


class MavsdkVehicle:
    """System 1 on a pad at ``latitude`` and ``longitude`` [deg]."""

    def __init__(self, port: int, latitude: float, longitude: float) -> None:
        configuration = mavsdk.Configuration.create_with_component_type(
            mavsdk.ComponentType.AUTOPILOT
        )
        self.vehicle = mavsdk.Mavsdk(configuration)
        self.vehicle.add_any_connection(f"udpout://127.0.0.1:{port}")
        component = self.vehicle.server_component()
        self.action = ActionServer(component)
        self.action.set_armable(True, True)
        self.action.set_disarmable(True, True)
        self.action.set_allow_takeoff(True)
        self.action.set_allowable_flight_modes(
            AllowableFlightModes(True, True, True, True, True, True, True)
        )
        self.modes, self.armings, self.landings = [], [], []
        self.action.subscribe_flight_mode_change(
            lambda *given: self.modes.append(given[1])
        )
        self.action.subscribe_arm_disarm(lambda *given: self.armings.append(given[1]))
        self.telemetry = TelemetryServer(component)
        self.direct = MavlinkDirectServer(component)
        self.setpoints = []
        self.direct.subscribe_message(
            "SET_POSITION_TARGET_LOCAL_NED",
            lambda message, _: self.setpoints.append(json.loads(message.fields_json)),
        )
        self.direct.subscribe_command(21, lambda *given: self.land(given[0]))
        self.place = latitude, longitude
        self.ending = threading.Event()
        self.thread = threading.Thread(target=self.tell, daemon=True)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.ending.set()
        self.thread.join(5.0)
        self.vehicle.destroy()

    def land(self, wanted) -> None:
        self.landings.append(wanted)
        self.action.set_armed_state(False)

    def tell(self) -> None:
        """Tell where the vehicle is: at its last setpoint."""
        latitude, longitude = self.place
        while not self.ending.is_set():
            last = self.setpoints[-1] if self.setpoints else {}
            at = [float(last.get(name, 0.0)) for name in ("x", "y", "z")]
            speed = [float(last.get(name, 0.0)) for name in ("vx", "vy", "vz")]
            self.telemetry.publish_position_velocity_ned(
                PositionVelocityNed(PositionNed(*at), VelocityNed(*speed))
            )
            self.telemetry.publish_position(
                Position(latitude, longitude, 520.0 - at[2], -at[2]),
                VelocityNed(*speed),
                Heading(0.0),
            )
            time.sleep(0.02)
