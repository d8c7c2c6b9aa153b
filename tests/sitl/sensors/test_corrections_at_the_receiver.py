"""The simulated plain receiver is a rover: with the base's position and fresh observations its fixes are RTK-grade."""

from collections.abc import Callable
from statistics import pstdev

from tests.common.rtcm_frames import base_position, observations

from gloc3.messages.frames import GeoPoint
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.sensors.fix import ACOUSTIC, CORRECTED_S, PLAIN_GPS, RTK, FixSensor
from gloc3_sitl.sensors.readings import FixKind

Still = Callable[..., Truth]


def test_corrections_make_fixes_rtk_grade_until_they_are_old(still: Still, home: GeoPoint) -> None:
    sensor, truth = FixSensor(3, home, PLAIN_GPS), still()
    assert sensor.measure(truth, 0.0).kind is FixKind.THREE_D
    sensor.correct(observations(), 0.0)
    assert sensor.measure(truth, 0.1).kind is FixKind.THREE_D, "the base's position is not known"
    sensor.correct(base_position(home), 0.0)
    damaged = bytearray(observations())
    damaged[9] ^= 4
    sensor.correct(bytes(damaged), 0.0)
    assert sensor.measure(truth, 0.2).kind is FixKind.THREE_D
    heights = []
    for tenth in range(3000):
        if tenth % 10 == 0:
            sensor.correct(observations(), tenth / 10.0)
        fix = sensor.measure(truth, tenth / 10.0)
        assert fix.kind is FixKind.RTK_FIXED
        heights.append(fix.altitude_m - truth.altitude_m)
    assert pstdev(heights) < 2.0 * RTK.wander_vertical_m + RTK.noise_vertical_m
    assert sensor.measure(truth, 299.0 + CORRECTED_S - 0.1).kind is FixKind.RTK_FIXED
    assert sensor.measure(truth, 299.0 + CORRECTED_S + 0.1).kind is FixKind.THREE_D


def test_acoustic_positions_have_no_corrections(still: Still, home: GeoPoint) -> None:
    sensor = FixSensor(3, home, ACOUSTIC)
    sensor.correct(base_position(home) + observations(), 0.0)
    assert sensor.measure(still(), 0.1).kind is FixKind.THREE_D
