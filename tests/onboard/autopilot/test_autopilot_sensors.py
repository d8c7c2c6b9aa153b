"""Sensors that are wired to the autopilot come over real MAVLink bytes, asked for once somebody uses them."""

import asyncio
import math
from random import Random
from typing import Any

import numpy as np
import pytest
from tests.direct_link import wire
from tests.onboard.fake_autopilot import FakeAutopilot

from gloc3.clock import Clock, VirtualLoop
from gloc3.component.deployment import ComponentRow
from gloc3.component.test_bench import Bench
from gloc3.mavlink import codec
from gloc3.mavlink.transport.memory import Conditions, MemoryLink
from gloc3.messages.perception import LaserScan
from gloc3_onboard.autopilot.link import AutopilotLink
from gloc3_onboard.autopilot.sensors import AutopilotSensors
from gloc3_onboard.components.samplers.imu import ImuSampler
from gloc3_onboard.components.samplers.laser import LaserSampler
from gloc3_onboard.sensors.sources.autopilot import AutopilotImu, DistanceSensors, ObstacleDistance
from gloc3_sitl.vehicles.simulator import LinkKind, Simulator, SimulatorSettings
from gloc3_sitl.world import World

STYLES = pytest.mark.parametrize("style", ["px4", "ardupilot"])
UNKNOWN = 0xFFFF


class FixedTime:
    """Time is what the autopilot says, and a heading that is known or not."""

    def __init__(self, yaw_rad: float | None = None) -> None:
        self.yaw_rad = yaw_rad

    def t_s(self, boot_ms: float, now_s: float) -> float:
        return min(boot_ms * 1e-3, now_s)


def handle(name: str, yaw_rad: float | None = None, **fields: Any) -> AutopilotSensors:
    """The sensors after one message, as its bytes say it."""
    sensors = AutopilotSensors()
    data = codec.Encoder(1, 1).encode(codec.message(name, **fields))
    (frame,) = codec.Parser(is_datagram=True).receive(data)
    message = frame.decode()
    assert message is not None
    sensors.receive(message, 100.0, FixedTime(yaw_rad))
    return sensors


def obstacles(yaw_rad: float | None = None, **fields: Any) -> LaserScan:
    given = {"time_usec": 5_000_000, "min_distance": 20, "max_distance": 1000, "increment": 5, "frame": 12}
    found = handle("OBSTACLE_DISTANCE", yaw_rad, **{**given, **fields}).obstacles
    assert found is not None
    assert found.t_s == pytest.approx(5.0)
    return found.scan


def toward(scan: LaserScan, angle_deg: float) -> float:
    """The range in a direction, counter-clockwise from ahead."""
    ranges = np.frombuffer(scan.ranges_m, "<f4")
    index = (math.radians(angle_deg) - scan.angle_min_rad) / scan.angle_step_rad % (math.tau / scan.angle_step_rad)
    return float(ranges[round(index) % len(ranges)])


def test_obstacles_are_turned_into_a_scan_that_counts_the_other_way_round() -> None:
    distances = [UNKNOWN] * 72
    distances[0], distances[18], distances[60], distances[36] = 300, 400, 500, 1001
    scan = obstacles(distances=distances)
    assert (scan.range_min_m, scan.range_max_m) == (0.2, 10.0)
    assert scan.angle_step_rad == pytest.approx(math.radians(5.0))
    assert toward(scan, 0.0) == 3.0
    assert toward(scan, -90.0) == 4.0, "MAVLink counts clockwise: 90 degrees are to the right"
    assert toward(scan, 60.0) == 5.0
    assert toward(scan, 180.0) == math.inf, "past the maximum: nothing seen"
    assert toward(scan, 45.0) == 0.0, "no reading"


def test_directions_that_count_from_north_are_turned_by_the_heading_or_not_valid_without_one() -> None:
    distances = [300] + [UNKNOWN] * 71
    assert toward(obstacles(math.radians(90.0), distances=distances, frame=0), 90.0) == 3.0, "north is to the left"
    assert "heading" in obstacles(None, distances=distances, frame=0).reason
    assert obstacles(None, distances=distances, increment=0).reason.startswith("the scanner does not report")


def test_fine_steps_an_offset_and_a_scan_to_the_other_side_are_understood() -> None:
    distances = [100, 200, 300] + [UNKNOWN] * 69
    scan = obstacles(distances=distances, increment=0, increment_f=2.5, angle_offset=-45.0)
    assert [toward(scan, angle) for angle in (45.0, 42.5, 40.0)] == [1.0, 2.0, 3.0]
    scan = obstacles(distances=distances, increment=0, increment_f=-2.5, angle_offset=-45.0)
    assert [toward(scan, angle) for angle in (45.0, 47.5, 50.0)] == [1.0, 2.0, 3.0]


def test_level_range_finders_make_a_scan_of_eight_beams_and_old_ones_are_forgotten() -> None:
    sensors, time = AutopilotSensors(), FixedTime()
    limits = {"min_distance": 20, "max_distance": 800}
    for now_s, orientation, distance in ((1.0, 0, 100), (1.0, 2, 200), (1.5, 6, 900), (2.1, 25, 50)):
        fields = {"time_boot_ms": int(now_s * 1e3), "orientation": orientation, "current_distance": distance}
        sensors.receive(codec.message("DISTANCE_SENSOR", **fields, **limits), now_s, time)
    assert sensors.ranges is not None
    scan = sensors.ranges.scan
    assert [toward(scan, angle) for angle in (0.0, -90.0, 90.0, 45.0)] == [1.0, 2.0, math.inf, 0.0]
    sensors.receive(codec.message("DISTANCE_SENSOR", orientation=4, current_distance=400, **limits), 2.2, time)
    scan = sensors.ranges.scan
    assert [toward(scan, angle) for angle in (0.0, 90.0, 180.0)] == [0.0, math.inf, 4.0]


@pytest.mark.parametrize(
    ("name", "fields"),
    [
        ("HIGHRES_IMU", {"time_usec": 7_000_000, "xgyro": 0.1, "zacc": -9.80665}),
        ("SCALED_IMU", {"time_boot_ms": 7_000, "xgyro": 100, "zacc": -1000}),
        ("RAW_IMU", {"time_usec": 7_000_000, "xgyro": 100, "zacc": -1000}),
    ],
)
def test_an_inertial_unit_is_told_in_si_units_whatever_the_message(name: str, fields: dict[str, Any]) -> None:
    (stamped,) = handle(name, **fields).samples(-math.inf)
    assert stamped.t_s == pytest.approx(7.0)
    assert stamped.sample.rate_frd_rad_s == pytest.approx((0.1, 0.0, 0.0))
    assert stamped.sample.specific_force_frd_m_s2 == pytest.approx((0.0, 0.0, -9.80665), rel=1e-6)


def test_of_two_kinds_of_messages_one_is_taken_until_it_falls_silent() -> None:
    sensors, time = AutopilotSensors(), FixedTime()
    for step in range(10):
        sensors.receive(codec.message("SCALED_IMU", time_boot_ms=1000 + 10 * step), 1.0 + 0.01 * step, time)
        sensors.receive(codec.message("RAW_IMU", time_usec=1_005_000), 1.0 + 0.01 * step, time)
    assert len(sensors.samples(-math.inf)) == 10
    sensors.receive(codec.message("RAW_IMU", time_usec=3_000_000), 3.0, time)
    assert [stamped.t_s for stamped in sensors.samples(1.085)] == pytest.approx([1.09, 3.0])


def test_stamps_in_utc_are_mapped_too() -> None:
    sensors = AutopilotSensors()
    for step in range(3):
        utc_us = 1_760_000_000_000_000 + 10_000 * step
        sensors.receive(codec.message("HIGHRES_IMU", time_usec=utc_us), 50.0 + 0.01 * step, FixedTime())
    assert [stamped.t_s for stamped in sensors.samples(0.0)] == pytest.approx([50.0, 50.01, 50.02], abs=1e-4)


@STYLES
def test_messages_are_asked_for_when_a_sampler_starts_and_its_samples_come_from_the_link(style: str) -> None:
    loop = VirtualLoop()
    cable = MemoryLink(loop, Random(3), Conditions(latency_s=0.02))
    link = AutopilotLink(loop, Clock(loop))
    autopilot = FakeAutopilot(loop, cable.b, style)
    wire(link, cable.a, loop)
    imu, laser, level = AutopilotImu(link.sensors), ObstacleDistance(link.sensors), DistanceSensors(link.sensors)
    loop.run_until_complete(asyncio.sleep(3.0))
    name = "HIGHRES_IMU" if style == "px4" else "SCALED_IMU"
    assert autopilot.rate_hz(name) == 0.0, "nobody uses it"
    for device in (imu, laser, level):
        device.open()
    loop.run_until_complete(asyncio.sleep(2.0))
    assert autopilot.rate_hz(name) == 100.0
    assert autopilot.rate_hz("OBSTACLE_DISTANCE") == 10.0
    rung: list[None] = []
    unwatch = [device.on_new_data(lambda: rung.append(None)) for device in (imu, laser, level)]
    autopilot.send(
        "OBSTACLE_DISTANCE", time_usec=5_000_000, increment=5, frame=12, max_distance=900, distances=[300] * 72
    )
    autopilot.send(name, **({"time_usec": 5_000_000} if style == "px4" else {"time_boot_ms": 5_000}))
    loop.run_until_complete(asyncio.sleep(0.1))
    assert len(rung) == 2
    assert len(imu.samples(-math.inf)) == 1
    found = laser.scan()
    assert found is not None
    assert found.scan.is_valid
    assert level.scan() is None
    for end in unwatch:
        end()
    for device in (imu, laser, level):
        device.close()
    link.close()
    loop.close()


@pytest.mark.thorough
@STYLES
def test_the_simulated_autopilot_tells_its_inertial_unit_to_the_sampler(style: str) -> None:
    with Bench() as bench:
        simulator = Simulator(World.load("hold"), SimulatorSettings(style=style, seed=4))
        cable = MemoryLink(bench.loop, Random(1), Conditions(latency_s=0.002))
        cable.a.on_data = simulator.attach(cable.a.send, LinkKind.COMPANION)
        said: list[str] = []
        link = AutopilotLink(bench.loop, Clock(bench.loop), report=lambda _, text, /, *, cause="": said.append(text))
        wire(link, cable.b, bench.loop)
        simulator.start(bench.loop)
        bench.host(
            ComponentRow(name="imu", class_name="x:Y", rate_hz=100.0), lambda: ImuSampler(AutopilotImu(link.sensors))
        )
        bench.host(
            ComponentRow(name="laser", class_name="x:Y", rate_hz=10.0),
            lambda: LaserSampler(DistanceSensors(link.sensors)),
        )
        bench.run(3.0)
        bench.envelopes.clear()
        bench.run(3.0)
        samples = [envelope for envelope in bench.envelopes if envelope.topic == "bench/imu"]
        simulator.stop()
        link.close()
    assert [text for text in said if "refuses" in text] == [], "it is asked for nothing that it never gives"
    assert len(samples) >= 290
    assert all(envelope.payload.is_valid for envelope in samples), {envelope.payload.reason for envelope in samples}
    forces = np.array([envelope.payload.specific_force_frd_m_s2 for envelope in samples])
    assert forces.mean(axis=0) == pytest.approx((0.0, 0.0, -9.81), abs=0.15)
    assert bench.last("laser").reason.startswith("no scan"), "it has no range finder that looks level"
