"""Stereo odometry with the inertial unit, in flight: it bridges pictures that fail, and the mission goes on."""

from tests.flight.card import ONE_STYLE, Card
from tests.flight.test_flying_on_our_own_pose import errors_m
from tests.flight.test_sources_that_fail import LARGEST_M, SWEEP

from gloc3.messages.perception import Odometry

WITH_GYROS = """
platform: heron
extends: pelican
components:
  - {name: features, ports: {inertial: imu}}
  - {name: stereo_odometry, ports: {inertial: imu}}
"""


@ONE_STYLE
def test_gyros_bridge_black_pictures_on_the_way_for_a_short_time(flight: Card) -> None:
    flight.begin(SWEEP, platform=WITH_GYROS)
    flight.await_state("sweep", "running")
    flight.wait(2.0)
    begin_s = flight.now_s
    flight.fault("device:stereo_camera=black", 0.15)
    flight.wait(1.0)
    reports: list[Odometry] = flight.since(begin_s, "odometry/stereo")
    held = [report for report in reports if report.reason.startswith("held by the gyros: ")]
    assert 1 <= len(held) <= 3
    assert all(report.is_valid for report in reports)
    begin_s = flight.now_s
    flight.fault("device:stereo_camera=black", 1.0)
    flight.wait(2.0)
    later: list[Odometry] = flight.since(begin_s, "odometry/stereo")
    assert sum(not report.is_valid for report in later) >= 8, "a second is too long"
    flight.await_state("mission", "done", 60.0)
    assert max(errors_m(flight)) < LARGEST_M
