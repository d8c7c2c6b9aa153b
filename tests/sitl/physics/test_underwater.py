"""The physics of underwater vehicles against published figures and first principles."""

from math import cos, hypot, pi, radians, sqrt, tau

import numpy as np
import pytest
from msgspec.structs import replace

from gloc3.errors import Misuse
from gloc3.messages.frames import GRAVITY_M_S2, GeoPoint, Vector3, from_euler, to_euler
from gloc3_sitl.physics.sea import Sea
from gloc3_sitl.physics.underwater import UnderwaterVehicle, mass_matrix
from gloc3_sitl.physics.water import Water, Waves
from gloc3_sitl.vehicles.auv import AUV
from gloc3_sitl.vehicles.rov import ROV
from gloc3_sitl.vehicles.underwater import UnderwaterModel, steady_thrust_n

HOME = GeoPoint(41.0, -70.0, 0.0)
DEEP = Water(floor_m=-300.0)
PROPELLER_AT_TRIM = sqrt(3.86 / 10.8) * 0.97 + 0.03
"""The command at which the AUV's propeller gives the 3.86 N of the thesis."""


def dived(model: UnderwaterModel, water: Water = DEEP, depth_m: float = 50.0) -> UnderwaterVehicle:
    """A vehicle at rest, far from surface and floor."""
    vehicle = UnderwaterVehicle(model, HOME, water)
    vehicle.place((0.0, 0.0, depth_m))
    return vehicle


def neutral(model: UnderwaterModel) -> UnderwaterModel:
    """The same, weighing nothing in water, so that motion along one axis stays there."""
    return replace(model, buoyancy_n=model.mass_kg * GRAVITY_M_S2)


def straight() -> UnderwaterModel:
    """The AUV without its propeller's torque: free to turn it is unstable on its course, as the coefficients say."""
    return replace(neutral(AUV), thrusters=tuple(replace(thruster, torque_m=0.0) for thruster in AUV.thrusters))


def stiff(model: UnderwaterModel) -> UnderwaterModel:
    """The same, held level by a high centre of buoyancy in place of a controller."""
    return replace(neutral(model), center_of_buoyancy_frd_m=(0.0, 0.0, -1.0))


def run(vehicle: UnderwaterVehicle, outputs: tuple[float, ...], seconds: float) -> None:
    """Steps for so long."""
    for _ in range(round(seconds * vehicle.rate_hz)):
        vehicle.step(outputs)


def test_remus_in_trim_goes_as_fast_as_the_thesis_says() -> None:
    vehicle = dived(stiff(straight()))
    run(vehicle, (PROPELLER_AT_TRIM,), 60.0)
    assert hypot(*vehicle.water_velocity_frd_m_s) == pytest.approx(1.54, abs=0.02)


def test_remus_at_full_power_goes_the_five_knots_of_its_data_sheet() -> None:
    vehicle = dived(stiff(straight()))
    run(vehicle, (1.0,), 60.0)
    assert hypot(*vehicle.water_velocity_frd_m_s) == pytest.approx(2.57, abs=0.06)


def test_the_rov_settles_where_its_identified_drag_meets_the_thrust() -> None:
    vehicle = dived(stiff(ROV))
    ahead = (-0.5, -0.5, 0.5, 0.5, 0.0, 0.0, 0.0, 0.0)
    run(vehicle, ahead, 10.0)
    thrust = sum(abs(steady_thrust_n(ROV, 51.5, 40.2, command)) for command in ahead) * cos(pi / 4)
    speed = vehicle.water_velocity_frd_m_s[0]
    assert 13.7 * speed + 141.0 * speed**2 == pytest.approx(thrust, rel=0.03)


def test_slow_heave_of_the_rov_fades_with_the_time_constant_of_its_mass_and_drag() -> None:
    vehicle = dived(neutral(ROV))
    vehicle.place((0.0, 0.0, 50.0), velocity_ned_m_s=(0.0, 0.0, 0.005))
    run(vehicle, (), (13.5 + 18.68) / 33.0)
    assert vehicle.truth().velocity_ned_m_s[2] == pytest.approx(0.005 / np.e, rel=0.05)


def test_the_auv_rolls_back_with_the_period_of_its_pendulum() -> None:
    vehicle = dived(AUV)
    vehicle.place((0.0, 0.0, 50.0), from_euler(radians(2.0), 0.0, 0.0))
    stiffness, inertia = 0.0196 * 299.0, 0.177 + 0.0704
    crossings: list[float] = []
    was = 1.0
    for _ in range(800):
        vehicle.step(())
        roll = to_euler(vehicle.truth().attitude_wxyz)[0]
        if roll * was < 0.0:
            crossings.append(vehicle.now_s)
        was = roll
    # The added mass of sway takes part through the centre of gravity below the origin, so the period is a little longer or shorter.
    assert 2.0 * (crossings[1] - crossings[0]) == pytest.approx(tau / sqrt(stiffness / inertia), rel=0.1)


def test_a_steady_turn_of_the_auv_balances_its_published_coefficients() -> None:
    vehicle = dived(neutral(AUV))
    run(vehicle, (PROPELLER_AT_TRIM, 0.0, 0.0, 0.0, 0.0, 0.5, 0.0), 60.0)
    u, v, _ = vehicle.water_velocity_frd_m_s
    r = vehicle.truth().rate_frd_rad_s[2]
    rudder = 0.5 * 0.2374
    # Prestero's sums of sway force and yaw moment, in his own coefficients, with nothing accelerating.
    mass = 299.0 / GRAVITY_M_S2
    sway = -131.0 * abs(v) * v + 0.632 * abs(r) * r - 28.6 * u * v + (5.22 - mass) * u * r - 9.64 * u * u * rudder
    yaw = -3.18 * abs(v) * v - 94.0 * abs(r) * r - 24.0 * u * v - 2.0 * u * r + 6.15 * u * u * rudder
    assert sway == pytest.approx(0.0, abs=0.4)
    assert yaw == pytest.approx(0.0, abs=0.15)
    assert r > 0.05
    assert v < 0.0
    assert 5.0 < hypot(u, v) / r < 25.0


def test_without_drag_a_tumbling_body_keeps_its_energy_in_still_water() -> None:
    nothing = (0.0,) * 6
    model = replace(
        neutral(AUV),
        linear_drag=nothing,
        quadratic_drag=nothing,
        cross_flow=None,
        lift=None,
        center_of_buoyancy_frd_m=AUV.center_of_gravity_frd_m,
    )
    vehicle = UnderwaterVehicle(model, HOME, DEEP, rate_hz=2000)
    vehicle.place((0.0, 0.0, 50.0), velocity_ned_m_s=(1.0, 0.3, -0.2))
    matrix = np.array(mass_matrix(model))

    def energy_j() -> float:
        state = np.array([*vehicle.water_velocity_frd_m_s, *vehicle.truth().rate_frd_rad_s])
        return float(0.5 * state @ matrix @ state)

    before = energy_j()
    run(vehicle, (), 5.0)
    assert abs(vehicle.truth().rate_frd_rad_s[2]) > 0.1, "Munk's moment should turn it"
    assert energy_j() == pytest.approx(before, rel=0.01)


def test_a_drifting_vehicle_goes_with_the_current() -> None:
    vehicle = dived(neutral(ROV), Water(floor_m=-300.0, current_ned_m_s=(0.3, -0.2, 0.0)))
    run(vehicle, (), 20.0)
    velocity = vehicle.truth().velocity_ned_m_s
    assert velocity == pytest.approx((0.3, -0.2, 0.0), abs=1e-2)


@pytest.mark.parametrize("model", [AUV, ROV], ids=lambda model: model.name)
def test_it_floats_at_the_surface_and_comes_back_up_from_below(model: UnderwaterModel) -> None:
    vehicle = UnderwaterVehicle(model, HOME)
    run(vehicle, (), 5.0)
    assert vehicle.truth().position_ned_m[2] == pytest.approx(vehicle.float_depth_m(), abs=0.01)
    vehicle.place((0.0, 0.0, 2.0))
    run(vehicle, (), 60.0)
    assert vehicle.truth().position_ned_m[2] == pytest.approx(vehicle.float_depth_m(), abs=0.05)


@pytest.mark.parametrize("model", [AUV, ROV], ids=lambda model: model.name)
def test_a_flooded_vehicle_sinks_to_the_floor_and_lies_still_there(model: UnderwaterModel) -> None:
    vehicle = UnderwaterVehicle(model, HOME, Water(floor_m=-4.0))
    vehicle.place((0.0, 0.0, 2.0), velocity_ned_m_s=(0.5, 0.0, 0.0))
    vehicle.is_flooded = True
    run(vehicle, (), 40.0)
    truth = vehicle.truth()
    assert truth.is_on_ground
    assert truth.height_above_ground_m == pytest.approx(0.5 * model.height_m, abs=0.02)
    assert hypot(*truth.velocity_ned_m_s) < 0.01


def test_what_the_imu_feels_adds_up_to_the_velocity() -> None:
    vehicle = dived(stiff(ROV))
    assert vehicle.imu()[0] == pytest.approx((0.0, 0.0, -GRAVITY_M_S2))
    speed = 0.0
    for _ in range(200):
        vehicle.step((-0.6, -0.6, 0.6, 0.6))
        pitch = to_euler(vehicle.truth().attitude_wxyz)[1]
        forward, _, down = vehicle.imu()[0]
        speed += (forward * cos(pitch) + down * np.sin(pitch)) / vehicle.rate_hz
    assert speed == pytest.approx(vehicle.truth().velocity_ned_m_s[0], abs=1e-3)


def test_half_the_step_gives_the_same_way() -> None:
    ends: list[Vector3] = []
    for rate_hz in (200, 400):
        vehicle = UnderwaterVehicle(AUV, HOME, DEEP, rate_hz=rate_hz)
        vehicle.place((0.0, 0.0, 50.0))
        run(vehicle, (0.7, 0.0, 0.0, 0.0, 0.0, 0.3, -0.1), 20.0)
        ends.append(vehicle.truth().position_ned_m)
    assert ends[0] == pytest.approx(ends[1], abs=0.1)


def test_the_same_commands_give_the_same_trajectory_bit_for_bit() -> None:
    truths = []
    for _ in range(2):
        vehicle = UnderwaterVehicle(ROV, HOME, Water(waves=Waves(height_m=0.5)), seed=3)
        run(vehicle, (0.3, -0.2, 0.4, 0.1, -0.5, 0.5, 0.5, -0.5), 3.0)
        truths.append(vehicle.truth())
    assert truths[0] == truths[1]


def test_small_commands_turn_nothing_and_nonsense_is_clipped() -> None:
    vehicle = dived(ROV)
    run(vehicle, (0.06,) * 8, 1.0)
    assert not any(vehicle.thrusts_n)
    run(vehicle, (float("nan"), 7.0), 2.0)
    assert vehicle.thrusts_n[:2] == pytest.approx((0.0, 5.25 * GRAVITY_M_S2), rel=1e-3)


def test_too_coarse_a_step_is_refused() -> None:
    with pytest.raises(Misuse, match="at least 100"):
        UnderwaterVehicle(ROV, HOME, rate_hz=50)


def test_the_surface_of_a_sea_has_its_significant_height_and_fades_below() -> None:
    sea = Sea(Waves(height_m=1.0, period_s=5.0, from_deg=90.0), seed=1)
    surface = np.array([sea.elevation_m(0.0, 0.0, 0.5 * i) for i in range(4000)])
    assert 4.0 * surface.std() == pytest.approx(1.0, rel=0.1)
    above, below = (
        np.array([sea.velocity_ned_m_s(0.0, 0.0, depth, 0.5 * i) for i in range(1000)]).std(axis=0)
        for depth in (0.0, 10.0)
    )
    assert above[0] < 1e-9 < above[1], "waves from the east move the water east and west"
    assert below[1] < 0.35 * above[1]


def test_waves_move_a_vehicle_near_the_surface_more_than_deep_down() -> None:
    spreads = []
    for depth_m in (1.5, 25.0):
        vehicle = dived(neutral(ROV), Water(floor_m=-300.0, waves=Waves(height_m=0.6, period_s=4.0)), depth_m)
        norths = []
        for _ in range(20):
            run(vehicle, (), 0.5)
            norths.append(vehicle.truth().velocity_ned_m_s[0])
        spreads.append(float(np.std(norths)))
    assert spreads[0] > 0.05 > 5.0 * spreads[1]
