"""The pose fusion as a component: when it begins, what it reports, and a standby that takes over."""

from collections.abc import Iterator
from heapq import heappop, heappush
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from tests.onboard.algorithms.fusion.flown import Sensor, inspection, sensors_of
from tests.onboard.messages import LIMITS, autopilot_pose, flying, pose, setpoint, standing
from tests.onboard.stage import Stage

from gloc3.component.deployment import Begin, ComponentRow
from gloc3.component.lci import State
from gloc3.component.test_bench import Bench
from gloc3.messages.frames import from_euler
from gloc3.messages.perception import FusionState, ImuSample, Odometry, PositionFix
from gloc3.messages.vehicle import LandedState, Pose
from gloc3_onboard.algorithms.paths.motion_limits import SetpointLimiter
from gloc3_onboard.components.processors.pose_fusion import PoseFusionProcessor, PoseFusionSettings

START = {"start_ned_m": (0.0, 0.0, 0.0), "start_heading_deg": 0.0, "origin_geo": (39.5, 2.6, 2.0)}
STILL = ImuSample(rate_frd_rad_s=(0.0, 0.0, 0.0), specific_force_frd_m_s2=(0.0, 0.0, -9.80665))
TOPICS: dict[str, str | list[str]] = {
    "odometry": ["odometry/stereo", "odometry/ground"],
    "position_fix": "position_fix/tracker",
    "primary": "pose",
}


def row(name: str, **fields: Any) -> ComponentRow:
    ports: dict[str, str | list[str]] = {**TOPICS, "fusion": f"fusion/{name}"}
    class_name = "gloc3_onboard.components.processors.pose_fusion:PoseFusionProcessor"
    return ComponentRow(name=name, class_name=class_name, rate_hz=25.0, settings=START, ports=ports, **fields)


def feed(sensors: list[Sensor], end_s: float) -> Iterator[list[tuple[str, Any, float]]]:
    """What is published every 0.01 s: topic, message and time of validity."""
    flight = inspection()
    rng = np.random.default_rng(7)
    arriving: list[tuple[float, int, float, str, Any]] = []
    count = 0
    for i, t in enumerate(flight.t_s):
        t_s = float(t)
        if t_s > end_s:
            return
        rate = tuple((flight.rate[i] + rng.normal(size=3) * 7e-4).tolist())
        force = tuple((flight.force[i] + rng.normal(size=3) * 0.03).tolist())
        text: list[tuple[str, Any, float]] = [
            ("imu", ImuSample(rate_frd_rad_s=rate, specific_force_frd_m_s2=force), t_s)
        ]
        for sensor in sensors:
            for arrives_s, valid_s, message in sensor.reports(flight, t_s):
                count += 1
                kind = "odometry/" if isinstance(message, Odometry) else ""
                kind = "position_fix/" if isinstance(message, PositionFix) else kind
                heappush(arriving, (arrives_s, count, valid_s, kind + sensor.name, message))
        while arriving and arriving[0][0] <= t_s:
            _, _, valid_s, topic, message = heappop(arriving)
            text.append((topic, message, valid_s))
        if i % 20 == 0:
            text.append(("autopilot", standing(), t_s))
        yield text


def run(bench: Bench, source: Iterator[list[tuple[str, Any, float]]], steps: int) -> None:
    for _ in range(steps):
        for topic, message, t_s in next(source):
            bench.send(topic, message, t_s=t_s)
        bench.run(0.01)


def test_it_reports_the_pose_at_its_rate_and_what_it_rests_on_twice_a_second() -> None:
    with Bench() as bench:
        bench.host(row("main"), PoseFusionProcessor)
        run(bench, feed(sensors_of("hummingbird", 0), 4.0), 300)
        poses: list[Pose] = bench.all("pose")
        last = poses[-1]
        assert len(poses) == pytest.approx(75, abs=2)
        assert last.is_valid
        assert last.position_ned_m == pytest.approx(tuple(inspection().position[298].tolist()), abs=0.03)
        assert last.origin_geo == (39.5, 2.6, 2.0)
        assert set(last.sources) == {"imu", "stereo", "ground", "tracker", "height"}
        reported: list[FusionState] = bench.all("fusion/main")
        assert len(reported) == pytest.approx(6, abs=1)
        assert all(source.is_used for source in reported[-1].sources)


def test_a_converged_standby_takes_over_with_the_same_pose_and_no_jump() -> None:
    with Bench() as bench:
        bench.host(row("main"), PoseFusionProcessor)
        bench.host(row("standby", begin=Begin.QUIET, standby_for="main"), PoseFusionProcessor)
        source = feed(sensors_of("hummingbird", 0), 6.0)
        run(bench, source, 400)
        before = bench.last("pose")
        assert bench.command("main", "stop").is_accepted
        assert bench.command("standby", "resume").is_accepted
        run(bench, source, 10)
        after = bench.last("pose")
        assert bench.state("standby") is State.WORKING
        assert after.is_valid
        assert after.reset_counter == before.reset_counter
        way = np.subtract(after.position_ned_m, before.position_ned_m) - np.multiply(before.velocity_ned_m_s, 0.1)
        assert np.linalg.norm(way) < 0.02


def test_a_standby_that_believes_another_pose_counts_a_jump_and_the_setpoint_has_no_step_for_the_vehicle() -> None:
    stage = Stage(PoseFusionProcessor(), PoseFusionSettings(**START))  # type: ignore[arg-type]
    stage.component.goquiet()
    for _ in range(30):
        stage.step(0.04, imu=STILL, autopilot=standing(), primary=pose(0.5, 0.0, 0.0, reset_counter=3))
    stage.component.resume()
    used = stage.step(0.04, imu=STILL)[0]
    assert isinstance(used, Pose)
    assert used.reset_counter == 4
    limiter = SetpointLimiter(LIMITS)
    limiter.set_vehicle((0.5, 0.0, -2.0), (0.0, 0.0, 0.0), 1.0, 3)
    limiter.limit(setpoint((0.5, 0.0, -2.0)), 1.0)
    limiter.set_vehicle((0.0, 0.0, -2.0), (0.0, 0.0, 0.0), 1.05, 4)
    limited = limiter.limit(setpoint((0.0, 0.0, -2.0)), 1.05)
    assert limited.setpoint.position_ned_m == pytest.approx((0.0, 0.0, -2.0))


def test_before_it_knows_whether_the_vehicle_stands_the_pose_is_not_valid() -> None:
    stage = Stage(PoseFusionProcessor(), PoseFusionSettings(**START))  # type: ignore[arg-type]
    for _ in range(20):
        reported = stage.step(0.04, imu=STILL)[0]
    assert isinstance(reported, Pose)
    assert (reported.is_valid, reported.reason) == (False, "the autopilot has not reported whether the vehicle stands")
    for _ in range(60):
        reported = stage.step(0.04, imu=STILL)[0]
    assert isinstance(reported, Pose)
    assert reported.is_valid, reported.reason


def test_started_in_flight_it_begins_at_the_pose_of_the_other_one_or_of_the_autopilot() -> None:
    for others in ({"primary": pose(3.0, 1.0, 2.0)}, {"autopilot_pose": autopilot_pose(3.0, 1.0, 2.0)}):
        stage = Stage(PoseFusionProcessor(), PoseFusionSettings(**START))  # type: ignore[arg-type]
        state = flying(landed=LandedState.IN_AIR)
        assert stage.step(0.04, imu=STILL, autopilot=state)[0].reason == "in flight there is no pose to start from"  # type: ignore[attr-defined]
        for _ in range(3):
            reported = stage.step(0.04, imu=STILL, autopilot=state, **others)[0]
        assert isinstance(reported, Pose)
        assert reported.position_ned_m == pytest.approx((3.0, 1.0, -2.0), abs=1e-3)
        assert reported.is_valid


def test_without_a_declared_start_the_autopilot_gives_the_heading() -> None:
    stage = Stage(PoseFusionProcessor(), PoseFusionSettings())
    for _ in range(30):
        reported = stage.step(0.04, imu=STILL, autopilot=standing(), autopilot_pose=autopilot_pose(1.0, 2.0, 0.0))[0]
    assert isinstance(reported, Pose)
    assert reported.is_valid
    assert reported.position_ned_m == pytest.approx((1.0, 2.0, 0.0), abs=0.01)


@pytest.mark.parametrize(
    ("topic", "is_placed", "is_heard"),
    [("autopilot_pose", True, True), ("autopilot_attitude", True, True), ("autopilot_attitude", False, False)],
    ids=["with a position", "without one any more", "while it aligns"],
)
def test_an_autopilot_for_which_down_is_elsewhere_is_heard(topic: str, *, is_placed: bool, is_heard: bool) -> None:
    stage, random = Stage(PoseFusionProcessor(), PoseFusionSettings(**START)), np.random.default_rng(1)  # type: ignore[arg-type]

    def step(**messages: Any) -> None:
        force = tuple((np.array((0.0, 0.0, -9.80665)) + 0.01 * random.normal(size=3)).tolist())
        stage.step(0.04, imu=replace(STILL, specific_force_frd_m_s2=force), autopilot=standing(), **messages)

    for _ in range(30):
        step(**({"autopilot_pose": autopilot_pose()} if is_placed else {}))
    for _ in range(20):
        step(**{topic: autopilot_pose(ned_from_frd=from_euler(0.3, 0.0, 0.0))})
    imu = next(source for source in stage.last(FusionState).sources if source.source == "imu")
    assert imu.reason == ("the autopilot says that down is elsewhere" if is_heard else "")


def test_bad_samples_and_silence_are_no_fault() -> None:
    stage = Stage(PoseFusionProcessor(), PoseFusionSettings(**START))  # type: ignore[arg-type]
    for _ in range(30):
        stage.step(0.04, imu=STILL, autopilot=standing())
    bad = ImuSample(rate_frd_rad_s=(0.0, 0.0, 0.0), specific_force_frd_m_s2=(0.0, 0.0, 0.0), is_valid=False, reason="x")
    for _ in range(60):
        reported = stage.step(0.04, imu=bad)[0]
    assert isinstance(reported, Pose)
    assert not reported.is_valid
    assert "nothing has held the position" in reported.reason
