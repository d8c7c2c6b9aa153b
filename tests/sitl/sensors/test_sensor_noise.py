"""Each sensor's noise, bias and drift against what its file states."""

from collections.abc import Callable
from itertools import pairwise
from math import atan2, cos, degrees, hypot, sqrt
from statistics import fmean, stdev

import pytest

from gloc3.messages.frames import GeoPoint, TangentPlane, from_euler, rotate
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.sensors import barometer, battery, fix, imu, magnetometer, range_finder
from gloc3_sitl.sensors.magnetic_field import declination_deg, field_ned_tesla
from gloc3_sitl.sensors.readings import FixKind
from gloc3_sitl.vehicles import PELICAN

pytestmark = pytest.mark.thorough

Still = Callable[..., Truth]
SEEDS = range(60)


def test_the_imu_has_white_noise_of_its_density_and_a_constant_bias(still: Still) -> None:
    sensor, truth = imu.SimulatedImu(1), still()
    samples = [sensor.measure(truth, i / 200) for i in range(3000)]
    for axis, at_rest in enumerate((0.0, 0.0, -9.8)):
        forces = [sample.specific_force_frd_m_s2[axis] - at_rest for sample in samples]
        rates = [sample.rate_frd_rad_s[axis] for sample in samples]
        assert stdev(forces) == pytest.approx(imu.ACCELEROMETER_DENSITY_M_S2_RTHZ * sqrt(100), rel=0.06)
        assert stdev(rates) == pytest.approx(imu.GYRO_DENSITY_RAD_S_RTHZ * sqrt(100), rel=0.06)
        assert fmean(forces) == pytest.approx(sensor.force_bias_m_s2[axis], abs=0.003)
        assert fmean(rates) == pytest.approx(sensor.rate_bias_rad_s[axis], abs=1e-4)


def test_imu_biases_of_many_units_scatter_as_stated() -> None:
    units = [imu.SimulatedImu(seed) for seed in SEEDS]
    forces = [bias for unit in units for bias in unit.force_bias_m_s2]
    rates = [bias for unit in units for bias in unit.rate_bias_rad_s]
    assert stdev(forces) == pytest.approx(imu.ACCELEROMETER_BIAS_M_S2, rel=0.2)
    assert stdev(rates) == pytest.approx(imu.GYRO_BIAS_RAD_S, rel=0.2)


def test_the_barometer_tells_altitude_within_its_noise_drift_and_weather(still: Still) -> None:
    sensor, truth = barometer.Barometer(3), still()
    samples = [sensor.measure(truth, i / 25) for i in range(2000)]
    steps = [b.pressure_pa - a.pressure_pa for a, b in pairwise(samples)]
    assert stdev(steps) / sqrt(2) == pytest.approx(barometer.NOISE_PA, rel=0.1)
    higher = sensor.measure(still(altitude_m=truth.altitude_m + 50.0), 80.0)
    assert higher.altitude_m - samples[-1].altitude_m == pytest.approx(50.0, abs=1.5)
    firsts = [barometer.Barometer(seed).measure(truth, 0.0).pressure_pa for seed in SEEDS]
    assert stdev(firsts) == pytest.approx(barometer.WEATHER_PA, rel=0.3)
    assert barometer.pressure_altitude_m(barometer.pressure_pa(1234.5)) == pytest.approx(1234.5)
    assert barometer.pressure_pa(0.0) == 101325.0
    assert barometer.pressure_pa(1000.0) == pytest.approx(89874.6, abs=5.0), "ISO 2533"


@pytest.mark.parametrize(
    ("place", "field_nt"),
    [
        (GeoPoint(80.0, 0.0, 0.0), (6570.4, -146.3, 54606.0)),
        (GeoPoint(0.0, 120.0, 0.0), (39624.3, 109.9, -10932.5)),
        (GeoPoint(-80.0, 240.0, 0.0), (5940.6, 15772.1, -52480.8)),
        (GeoPoint(80.0, 0.0, 100e3), (6261.8, -185.5, 52429.1)),
    ],
)
def test_the_magnetic_field_is_that_of_the_test_values_of_wmm2020(
    place: GeoPoint, field_nt: tuple[float, float, float]
) -> None:
    assert [1e9 * axis for axis in field_ned_tesla(place)] == pytest.approx(field_nt, abs=0.1)


def test_the_field_in_zurich_points_a_little_east_and_steeply_down() -> None:
    assert declination_deg(GeoPoint(47.4, 8.5, 400.0)) == pytest.approx(2.8, abs=0.3)
    north, east, down = field_ned_tesla(GeoPoint(47.4, 8.5, 400.0))
    assert degrees(atan2(down, hypot(north, east))) == pytest.approx(63.3, abs=0.8)


def test_the_magnetometer_sees_the_field_in_body_axes(still: Still, home: GeoPoint) -> None:
    attitude = from_euler(0.2, -0.1, 1.2)
    sensor = magnetometer.Magnetometer(5, home)
    fields = [sensor.measure(still(attitude_wxyz=attitude), i / 25).field_frd_tesla for i in range(1500)]
    mean = (fmean(f[0] for f in fields), fmean(f[1] for f in fields), fmean(f[2] for f in fields))
    assert stdev([f[0] for f in fields]) == pytest.approx(magnetometer.NOISE_TESLA, rel=0.1)
    north, east, _ = rotate(attitude, mean)
    assert degrees(atan2(east, north)) == pytest.approx(declination_deg(home), abs=3.0)


def test_the_height_sensor_measures_along_its_beam_and_only_within_its_range(still: Still) -> None:
    sensor = range_finder.HeightSensor(2)
    level = [sensor.measure(still(), i / 20) for i in range(1000)]
    assert all(reading.is_valid for reading in level)
    assert fmean(r.distance_m - r.mount_height_m for r in level) == pytest.approx(3.0, abs=3 * range_finder.BIAS_M)
    assert stdev([r.distance_m for r in level]) == pytest.approx(range_finder.NOISE_M, rel=0.1)
    tilted = sensor.measure(still(attitude_wxyz=from_euler(0.5, 0.0, 2.0)), 50.0)
    assert tilted.distance_m == pytest.approx(3.1 / cos(0.5), abs=0.06)
    for truth in (still(height_above_ground_m=60.0), still(attitude_wxyz=from_euler(1.3, 0.0, 0.0))):
        none = sensor.measure(truth, 51.0)
        assert not none.is_valid
        assert none.distance_m == 0.0
    standing = sensor.measure(still(height_above_ground_m=0.0), 52.0)
    assert standing.is_valid


@pytest.mark.parametrize(("receiver", "seeds"), [(fix.RTK, range(8)), (fix.PLAIN_GPS, range(60))])
def test_fixes_scatter_as_their_receiver_states(
    receiver: fix.Receiver, seeds: range, still: Still, home: GeoPoint
) -> None:
    truth, plane = still(), TangentPlane(home)
    errors, slow, speeds = [], [], []
    for seed in seeds:
        sensor = fix.FixSensor(seed, home, receiver)
        samples = [sensor.measure(truth, i / 10) for i in range(120)]
        places = [plane.ned_from_geo(s.latitude_deg, s.longitude_deg, s.altitude_m) for s in samples]
        errors += [(north, east, down + 3.0) for north, east, down in places]
        slow += [fmean(place[0] for place in places)]
        speeds += [s.velocity_ned_m_s for s in samples]
    horizontal = sqrt(receiver.noise_horizontal_m**2 + receiver.wander_horizontal_m**2)
    vertical = sqrt(receiver.noise_vertical_m**2 + receiver.wander_vertical_m**2)
    assert samples[0].horizontal_accuracy_m == pytest.approx(horizontal)
    assert stdev([e[0] for e in errors]) == pytest.approx(horizontal, rel=0.25)
    assert stdev([e[1] for e in errors]) == pytest.approx(horizontal, rel=0.25)
    assert stdev([e[2] for e in errors]) == pytest.approx(vertical, rel=0.25)
    assert stdev([v[0] for v in speeds]) == pytest.approx(receiver.speed_horizontal_m_s, rel=0.1)
    assert stdev([v[2] for v in speeds]) == pytest.approx(receiver.speed_vertical_m_s, rel=0.1)
    if receiver is fix.PLAIN_GPS:
        assert stdev(slow) > 0.7 * receiver.wander_horizontal_m, "the error is there for the whole of 12 s"
    assert samples[0].kind is receiver.kind


def test_an_rtk_fix_is_good_to_2_cm_and_plain_gps_to_metres() -> None:
    assert fix.RTK.kind is FixKind.RTK_FIXED
    assert 0.005 < sqrt(fix.RTK.noise_horizontal_m**2 + fix.RTK.wander_horizontal_m**2) < 0.02
    assert fix.PLAIN_GPS.wander_horizontal_m > 1.0


def test_the_battery_lasts_a_quarter_of_an_hour_in_hover(still: Still) -> None:
    sensor, truth, t_s = battery.Battery(1, PELICAN), still(), 0.0
    first = sensor.measure(truth, 0.0)
    while sensor.remaining > 0.05:
        t_s += 5.0
        last = sensor.measure(truth, t_s)
    assert t_s / 60.0 == pytest.approx(16.0, abs=1.5), "the data sheet's 16 minutes"
    assert 3 * 4.2 > first.voltage_v > last.voltage_v > 3 * 3.2
    assert first.current_a == pytest.approx(250.0 / first.voltage_v, rel=0.05)
    assert last.consumed_ah == pytest.approx(0.95 * PELICAN.capacity_ah, rel=0.02)
    assert battery.cell_voltage_v(-1.0) == 3.2
    assert battery.cell_voltage_v(2.0) == 4.2
    assert battery.cell_voltage_v(0.1) == pytest.approx(3.62)


def test_a_battery_that_is_asked_for_more_than_it_can_give_reports_without_failing(still: Still) -> None:
    sensor = battery.Battery(1, PELICAN, remaining=0.0)
    for i in range(3):
        reading = sensor.measure(still(power_w=1e5), i * 1.0)
    assert reading.remaining == 0.0
    assert 0.0 < reading.current_a < 1000.0
