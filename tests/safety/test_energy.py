"""Power against measured tables, charge against sums, and what is too little."""

from dataclasses import replace

import numpy as np
import pytest

from showc.log import showc_pb2 as pb
from showc.log.reader import read_log
from showc.log.schema import ABORT_NAME
from showc.safety.assessment import safety_case, show_of
from showc.safety.energy import Draw, current, flight_energy, hover_endurance
from showc.safety.pieces import flown_legs
from showc.vehicle import PRESETS
from showc.vehicle.power import Power, air_density, rotor_thrusts
from showc.view import render_safety

# Bitcraze wiki, misc:investigations:thrust: current [A], thrust [g], voltage [V].
MEASURED = np.array(
    [
        (1.83, 24.4, 3.71),
        (2.11, 28.6, 3.67),
        (2.39, 32.8, 3.65),
    ]
)
CRAZYFLIE = PRESETS["crazyflie-28g"]


@pytest.fixture(scope="module")
def logged(compiled):
    return read_log(compiled("swap"))


def hovering(preset, grams):
    model = Power.of(preset.battery, preset.vehicle)
    thrust = np.full((1, 4), grams * 1e-3 * preset.vehicle.gravity / 4.0)
    return float(model(thrust, np.zeros(1))[0])


def test_power_about_hover_is_the_measured_one():
    power = MEASURED[:, 0] * MEASURED[:, 2]
    at_weight = np.interp(28.0, MEASURED[:, 1], power)
    assert hovering(CRAZYFLIE, 28.0) == pytest.approx(at_weight, rel=0.02)
    for grams, measured in zip(MEASURED[:, 1], power, strict=True):
        assert hovering(CRAZYFLIE, grams) == pytest.approx(measured, rel=0.05)


def test_the_crazyflie_hovers_as_long_as_published():
    battery = CRAZYFLIE.battery
    found = hover_endurance(battery, battery.hover_power)
    assert found == pytest.approx(7 * 60.0, rel=0.10)


def test_climbing_costs_more_and_descending_no_less_than_hovering():
    model = Power.of(CRAZYFLIE.battery, CRAZYFLIE.vehicle)
    thrust = np.full((3, 4), CRAZYFLIE.vehicle.hover_thrust / 4.0)
    climb, level, descent = model(thrust, np.array([1.0, 0.0, -1.0]))
    assert climb > level == descent
    # At least the weight's work over the efficiency.
    assert climb - level > 0.4 * CRAZYFLIE.vehicle.hover_thrust / model.efficiency


def test_thin_air_takes_the_power_of_momentum_theory():
    # ISO 2533: 0.9569 kg/m³ at 2,500 m. The ideal power goes with one over its root.
    assert air_density(2500.0) == pytest.approx(0.9569, rel=1e-3)
    assert air_density(0.0) == pytest.approx(1.225, rel=1e-6)
    low, high = (
        Power.of(CRAZYFLIE.battery, CRAZYFLIE.vehicle, altitude)
        for altitude in (0.0, 2500.0)
    )
    idle, vehicle = CRAZYFLIE.battery.idle_power, CRAZYFLIE.vehicle
    assert low.hover(vehicle) == pytest.approx(CRAZYFLIE.battery.hover_power)
    assert (high.hover(vehicle) - idle) / (low.hover(vehicle) - idle) == pytest.approx(
        (1.225 / 0.9569) ** 0.5, rel=1e-3
    )


def test_rotors_share_the_thrust():
    vehicle = CRAZYFLIE.vehicle
    thrusts = rotor_thrusts(vehicle, vehicle.hover_control())
    assert thrusts == pytest.approx(np.full(4, vehicle.hover_thrust / 4.0))


def test_the_voltage_under_load_gives_the_power():
    battery = CRAZYFLIE.battery
    drawn = float(current(battery, np.array(1.0), np.array(7.6)))
    assert drawn * (battery.voltage - battery.resistance * drawn) == pytest.approx(7.6)
    assert np.isnan(current(battery, np.array(1.0), np.array(1e3)))


def test_energy_is_the_integral_of_power_over_the_flight(logged):
    show = show_of(logged)
    model = Power.of(show.battery, show.vehicle)
    draw = Draw(show.vehicle, model, logged.drones, logged.duration)
    for _ in draw.along(flown_legs(logged)):
        pass
    found = flight_energy(draw, show.battery, 0.0)
    flown = logged.trajectory(0)
    times = np.linspace(0.0, logged.duration, 20_001)
    thrusts = rotor_thrusts(show.vehicle, flown.control(times))
    # The rotors' axis is where the thrust pushes: acceleration less gravity.
    speed = flown.state.select([3, 4, 5])
    axis = speed.derivative()(times) + [0.0, 0.0, show.vehicle.gravity]
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    along = np.sum(axis * speed(times), axis=1)
    whole = np.trapezoid(model(thrusts, along), times)
    assert found.energy[0] == pytest.approx(whole, rel=1e-3)


def test_too_small_a_battery_is_found(logged):
    show = show_of(logged)
    small = replace(show, battery=replace(show.battery, capacity=60.0 * 3.6))
    codes = {item.code for item in safety_case(logged, small).errors}
    assert {"SAF131"} <= codes
    found = safety_case(logged, small)
    empty = next(item for item in found.errors if item.code == "SAF131")
    assert empty.place is not None
    drone, row = empty.place.drone, round(empty.place.time) - 1
    spent = 1.0 - found.energy.left[:, drone] + found.energy.abort
    assert spent[row] > small.battery.allowed
    assert row == 0 or spent[row - 1] <= small.battery.allowed
    # Below nothing no battery goes: a share would look like a near miss.
    flat = replace(show, battery=replace(show.battery, capacity=6.0 * 3.6))
    found = safety_case(logged, flat)
    early = next(item for item in found.errors if item.code == "SAF131")
    assert found.energy.empty is not None and "is empty" in early.message
    assert f"{found.energy.empty:.0f} s into" in early.message
    assert found.energy.left[found.energy.times < found.energy.empty].min() > 0.0
    weak = replace(show, battery=replace(show.battery, resistance=0.5))
    assert "SAF132" in {item.code for item in safety_case(logged, weak).errors}
    # Not even at half its voltage.
    dead = replace(show, battery=replace(show.battery, resistance=5.0))
    found = safety_case(logged, dead)
    low = next(item for item in found.errors if item.code == "SAF132")
    assert "cannot give" in low.message
    assert found.to_json()["energy"]["lowest_voltage"] is None
    assert ">none<" in render_safety(logged, found)
    assert "SAF131" not in {item.code for item in safety_case(logged, show).findings}


def taking(time):
    """Return an abort table whose longest row takes ``time`` [s]."""
    table = pb.AbortTable(period=0.5)
    table.rows.add(changes=[-1.0, -1.0], duration=time - 1.0)
    table.rows.add(duration=0.5)
    return table.SerializeToString()


def test_a_longer_abort_takes_more(logged):
    show = show_of(logged)
    short, long = (
        safety_case(replace(logged, added={ABORT_NAME: taking(abort)})).energy
        for abort in (10.0, 40.0)
    )
    assert long.abort == pytest.approx(4.0 * short.abort)
    # Hovering for 40 s: its power at the voltage of the pack.
    hover = Power.of(show.battery, show.vehicle, show.site.altitude)
    charge = 40.0 * hover.hover(show.vehicle) / show.battery.voltage
    assert long.abort > charge / show.battery.capacity


def test_a_last_step_with_nothing_in_it_has_the_voltage_without_load():
    """A show may end a moment after a whole second."""
    battery, vehicle = CRAZYFLIE.battery, CRAZYFLIE.vehicle
    draw = Draw(vehicle, Power.of(battery, vehicle), 1, 2.0 + 1e-9)
    draw.joules[:2] = draw.peak[:2] = battery.hover_power
    found = flight_energy(draw, battery, 0.0)
    assert np.isfinite(found.voltage).all()
    assert found.voltage[2] > found.voltage[1]
