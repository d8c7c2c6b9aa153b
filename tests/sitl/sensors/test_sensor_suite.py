"""The suite: rates, latencies, seeds, faults by name, and what it costs."""

from collections import Counter
from collections.abc import Callable
from statistics import mean
from typing import TypeVar

import pytest

from gloc3.errors import Misuse
from gloc3.messages.frames import GeoPoint, TangentPlane, Vector3
from gloc3_sitl.physics.jsbsim_body import Quadrotor
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.sensors.battery import Battery
from gloc3_sitl.sensors.readings import (
    BarometerReading,
    BatteryReading,
    FixKind,
    FixReading,
    ImuReading,
    MagnetometerReading,
    RangeReading,
    Reading,
)
from gloc3_sitl.sensors.suite import SensorSuite
from gloc3_sitl.vehicles import PELICAN

pytestmark = pytest.mark.thorough

Still = Callable[..., Truth]


def run(suite: SensorSuite, truth: Truth, seconds: float, start_s: float = 0.0) -> list[Reading]:
    first = round(start_s * 200)
    return [r for i in range(first, first + round(seconds * 200)) for r in suite.sample(truth, i / 200)]


R = TypeVar("R", bound=Reading)


def only(kind: type[R], readings: list[Reading]) -> list[R]:
    return [reading for reading in readings if isinstance(reading, kind)]


def test_each_sensor_reports_at_its_rate(still: Still, home: GeoPoint) -> None:
    counts = Counter(type(reading) for reading in run(SensorSuite(1, home), still(), 10.0))
    assert counts == {
        ImuReading: 2000,
        BarometerReading: 250,
        MagnetometerReading: 250,
        RangeReading: 200,
        FixReading: 99,
        BatteryReading: 50,
    }


def test_a_fix_arrives_a_tenth_of_a_second_after_it_was_true(still: Still, home: GeoPoint) -> None:
    suite = SensorSuite(1, home)
    for i in range(400):
        for reading in suite.sample(still(), i / 200):
            age_s = i / 200 - reading.t_s
            assert age_s == pytest.approx(0.1 if isinstance(reading, FixReading) else 0.0, abs=1e-9)


def test_a_moving_vehicle_and_its_truth_give_the_same_readings(home: GeoPoint) -> None:
    vehicle = Quadrotor("pelican", home)
    lazy, eager = SensorSuite(7, home), SensorSuite(7, home)
    for _ in range(100):
        vehicle.step((0.6, 0.6, 0.6, 0.6))
        assert lazy.sample(vehicle, vehicle.now_s) == eager.sample(vehicle.truth(), vehicle.now_s)


def test_a_seed_gives_the_same_noise_and_another_seed_another(still: Still, home: GeoPoint) -> None:
    first, again, other = (run(SensorSuite(seed, home), still(), 1.0) for seed in (1, 1, 2))
    assert first == again
    assert first != other


def test_one_sensor_s_fault_leaves_the_noise_of_the_others_alone(still: Still, home: GeoPoint) -> None:
    sound, faulty = SensorSuite(1, home), SensorSuite(1, home)
    faulty.fail("fix", "noisy")
    a, b = run(sound, still(), 2.0), run(faulty, still(), 2.0)
    assert only(BarometerReading, a) == only(BarometerReading, b)
    assert only(ImuReading, a) == only(ImuReading, b)
    assert only(FixReading, a) != only(FixReading, b)


def place(reading: FixReading, home: GeoPoint) -> Vector3:
    return TangentPlane(home).ned_from_geo(reading.latitude_deg, reading.longitude_deg, reading.altitude_m)


def test_a_lost_fix_says_so_and_comes_back_when_repaired(still: Still, home: GeoPoint) -> None:
    suite = SensorSuite(1, home)
    suite.fail("fix", "lost")
    lost = only(FixReading, run(suite, still(), 1.0))
    assert {reading.kind for reading in lost} == {FixKind.NONE}
    assert lost[0].satellites == 0
    suite.repair("fix")
    back = only(FixReading, run(suite, still(), 1.0, start_s=1.0))
    assert back[-1].kind is FixKind.RTK_FIXED


def test_a_stuck_fix_repeats_one_place_with_new_times(still: Still, home: GeoPoint) -> None:
    suite = SensorSuite(1, home)
    run(suite, still(), 1.0)
    suite.fail("fix", "stuck")
    stuck = only(FixReading, run(suite, still(), 2.0, start_s=1.0))[1:]
    assert len({place(reading, home) for reading in stuck}) == 1
    assert len({reading.t_s for reading in stuck}) == len(stuck)


def test_a_biased_fix_is_off_by_what_was_asked(still: Still, home: GeoPoint) -> None:
    suite = SensorSuite(1, home)
    suite.fail("fix", "biased", 4.0, direction=(0.0, 1.0, -0.5))
    for reading in only(FixReading, run(suite, still(), 1.0)):
        assert place(reading, home) == pytest.approx((0.0, 4.0, -5.0), abs=0.1)


def test_a_late_fix_arrives_later(still: Still, home: GeoPoint) -> None:
    suite = SensorSuite(1, home)
    suite.fail("fix", "late", 0.4)
    ages = [
        i / 200 - reading.t_s
        for i in range(400)
        for reading in suite.sample(still(), i / 200)
        if isinstance(reading, FixReading)
    ]
    assert len(ages) == 15
    assert ages == pytest.approx([0.5] * 15, abs=1e-9)


def test_a_lost_height_sensor_has_no_echo_and_other_lost_sensors_are_silent(still: Still, home: GeoPoint) -> None:
    suite = SensorSuite(1, home)
    for name in ("height", "imu", "barometer", "magnetometer", "battery"):
        suite.fail(name, "lost")
    readings = run(suite, still(), 1.0)
    assert {type(reading) for reading in readings} == {RangeReading, FixReading}
    assert not any(reading.is_valid for reading in only(RangeReading, readings))


@pytest.mark.parametrize("name", ["imu", "barometer", "magnetometer", "height", "fix", "battery"])
@pytest.mark.parametrize("mode", ["stuck", "biased", "noisy", "late", "old"])
def test_every_fault_of_every_sensor_shows_and_can_be_repaired(
    name: str, mode: str, still: Still, home: GeoPoint
) -> None:
    kinds: dict[str, type[Reading]] = {
        "imu": ImuReading,
        "barometer": BarometerReading,
        "magnetometer": MagnetometerReading,
        "height": RangeReading,
        "fix": FixReading,
        "battery": BatteryReading,
    }
    sound, faulty = SensorSuite(1, home), SensorSuite(1, home)
    faulty.fail(name, mode)
    a, b = (only(kinds[name], run(suite, still(), 2.0)) for suite in (sound, faulty))
    assert b
    assert a != b
    faulty.repair(name)
    assert only(kinds[name], run(faulty, still(), 2.0, start_s=2.0))


def test_a_scaled_height_is_too_much_and_nothing_else_can_be_scaled(still: Still, home: GeoPoint) -> None:
    suite = SensorSuite(1, home)
    sound = only(RangeReading, run(suite, still(), 1.0))
    suite.fail("height", "scaled", 9.0)
    reported = only(RangeReading, run(suite, still(), 1.0, start_s=1.0))
    assert mean(reading.distance_m for reading in reported) == pytest.approx(
        10.0 * mean(reading.distance_m for reading in sound), rel=0.2
    )
    suite.fail("imu", "scaled")
    with pytest.raises(Misuse, match="the imu cannot be scaled"):
        run(suite, still(), 1.0, start_s=2.0)


def test_an_old_height_is_stamped_as_if_it_were_new(still: Still, home: GeoPoint) -> None:
    suite = SensorSuite(1, home)
    suite.fail("height", "old", 0.2)
    ages = [
        i / 200 - reading.t_s
        for i in range(100)
        for reading in suite.sample(still(), i / 200)
        if isinstance(reading, RangeReading)
    ]
    assert len(ages) == 6
    assert ages == pytest.approx([0.0] * 6, abs=1e-9)


def test_unknown_names_and_modes_are_refused(home: GeoPoint) -> None:
    suite = SensorSuite(1, home)
    with pytest.raises(Misuse, match="barometer"):
        suite.fail("baro", "lost")
    with pytest.raises(Misuse, match="stuck"):
        suite.fail("fix", "broken")
    with pytest.raises(Misuse, match="fix"):
        suite.repair("gps")


def test_a_pause_in_sampling_gives_one_reading_and_not_a_burst(still: Still, home: GeoPoint) -> None:
    suite = SensorSuite(1, home)
    suite.sample(still(), 0.0)
    counts = Counter(type(reading) for reading in suite.sample(still(), 5.0))
    assert counts[ImuReading] == counts[BarometerReading] == counts[RangeReading] == 1


def test_the_charge_of_the_battery_can_be_set(still: Still, home: GeoPoint) -> None:
    suite = SensorSuite(1, home, battery=Battery(1, PELICAN, 0.5))
    assert only(BatteryReading, suite.sample(still(), 0.0))[0].remaining == pytest.approx(0.5)
    suite.battery.remaining = 0.2
    assert only(BatteryReading, run(suite, still(), 1.0))[-1].remaining == pytest.approx(0.2, abs=0.001)
