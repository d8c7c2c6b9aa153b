"""The limiter in the chain: one owner passes, within the limits; without a pose or limits nobody does."""

import math
from itertools import pairwise

import pytest
from msgspec.structs import replace
from tests.onboard.messages import LIMITS, grant, pose, setpoint
from tests.onboard.stage import Stage

from gloc3.messages.vehicle import Manoeuvre, ManoeuvreKind, ObstacleScan, Setpoint
from gloc3.mission.model.fence import Fence
from gloc3_onboard.components.controllers.limiter import Limiter, LimiterSettings


def working(limits: object = LIMITS) -> tuple[Stage, Limiter]:
    limiter = Limiter()
    stage = Stage(limiter)
    stage.step(limits=limits, grant=grant("go"), pose=pose())  # type: ignore[arg-type]
    return stage, limiter


def test_the_owners_setpoint_passes_with_its_own_time() -> None:
    stage, _ = working()
    stage.step(pose=pose(), setpoint_wanted=setpoint())
    assert stage.all(Setpoint) == [setpoint()]


def test_setpoints_of_others_old_ones_and_odd_ones_are_dropped_and_counted() -> None:
    stage, limiter = working()
    stage.step(pose=pose(), setpoint_wanted=setpoint(owner="thief"))
    stage.step(pose=pose(), setpoint_wanted=setpoint((0.0, math.nan, -2.0)))
    for t_s in (stage.now_s - 0.3, stage.now_s + 10.0):
        stage.put(t_s, setpoint_wanted=setpoint())
    stage.step(pose=pose())
    assert (limiter.foreign, limiter.not_finite, limiter.stale) == (1, 1, 2)
    assert stage.all(Setpoint) == []


def test_without_an_owner_nothing_passes() -> None:
    stage, limiter = working()
    stage.step(grant=grant(""), pose=pose(), setpoint_wanted=setpoint(owner=""))
    stage.step(pose=pose(), manoeuvre_wanted=Manoeuvre(action_id="", kind=ManoeuvreKind.LAND))
    assert limiter.foreign == 2
    assert stage.all(Setpoint) == stage.all(Manoeuvre) == []


@pytest.mark.parametrize("is_old", [True, False])
def test_without_a_valid_pose_nothing_passes_and_the_reason_is_said(is_old: bool) -> None:
    stage, limiter = working()
    if not is_old:
        stage.put(pose=replace(pose(), is_valid=False))
    stage.step(0.2, setpoint_wanted=setpoint())
    assert stage.all(Setpoint) == []
    assert limiter.reason == "there is no valid pose to check the fence with"
    stage.step(pose=pose(), setpoint_wanted=setpoint())
    assert len(stage.all(Setpoint)) == 1


def led() -> tuple[Stage, Limiter]:
    """A limiter whose owner leads the vehicle north with 1 m/s, up to now."""
    stage, limiter = working()
    for step in range(40):
        north = 0.05 * step
        here = pose(north, velocity_ned_m_s=(1.0, 0.0, 0.0))
        stage.step(pose=here, setpoint_wanted=setpoint((north, 0.0, -2.0), (1.0, 0.0, 0.0)))
    stage.received.clear()
    return stage, limiter


def test_a_late_pose_brakes_whom_it_led_and_holds_him_for_two_seconds() -> None:
    stage, limiter = led()
    for _ in range(40):
        stage.step(0.1, setpoint_wanted=setpoint((9.0, 0.0, -2.0), (1.0, 0.0, 0.0)))
    sent = stage.all(Setpoint)
    assert len(sent) == 20, "the first is still led by the pose; the last comes two seconds after it"
    assert sent[0].position_ned_m is not None
    speeds = [math.hypot(*one.velocity_ned_m_s) for one in sent[1:]]
    assert all(one.position_ned_m is None and one.action_id == "go" for one in sent[1:])
    assert all(before >= after for before, after in pairwise(speeds))
    assert max(speeds[5:]) < 1e-9
    assert limiter.reason == "there is no valid pose to check the fence with"


def test_after_a_late_pose_it_goes_on_from_where_the_vehicle_has_come_to() -> None:
    stage, _ = led()
    for _ in range(10):
        stage.step(0.1)
    stage.step(pose=pose(2.6), setpoint_wanted=setpoint((5.0, 0.0, -2.0)))
    place = stage.last(Setpoint).position_ned_m
    assert place is not None
    assert 2.6 - 1e-6 <= place[0] < 2.7


@pytest.mark.parametrize("case", ["never led", "a manoeuvre since", "an invalid pose", "led long before", "no owner"])
def test_a_late_pose_begins_no_setpoints_where_there_were_none(case: str) -> None:
    stage, _ = working() if case == "never led" else led()
    if case == "a manoeuvre since":
        stage.step(manoeuvre_wanted=Manoeuvre(action_id="go", kind=ManoeuvreKind.LAND))
    if case == "an invalid pose":
        stage.step(pose=replace(pose(), is_valid=False))
    if case == "led long before":
        for _ in range(10):
            stage.step(pose=pose())
    if case == "no owner":
        stage.put(grant=grant(""))
    for _ in range(10):
        stage.step(0.1)
    assert stage.all(Setpoint) == []


def test_before_the_limits_are_known_nothing_passes() -> None:
    stage = Stage(Limiter())
    stage.step(grant=grant(), pose=pose(), setpoint_wanted=setpoint())
    assert stage.all(Setpoint) == []


def test_a_new_owner_goes_on_without_a_step() -> None:
    stage, _ = working()
    for step in range(40):
        stage.step(pose=pose(step * 0.025 - 0.3), setpoint_wanted=setpoint((step * 0.025, 0.0, -2.0), (0.5, 0.0, 0.0)))
    before = stage.last(Setpoint).position_ned_m
    stage.step(
        pose=pose(0.72, velocity_ned_m_s=(0.5, 0.0, 0.0)),
        grant=grant("hold", "hold"),
        setpoint_wanted=setpoint((0.9, 0.0, -2.0), owner="hold"),
    )
    after = stage.last(Setpoint)
    assert after.action_id == "hold"
    assert math.dist(before, after.position_ned_m) < 0.03


def test_a_standby_that_has_listened_gives_the_same_setpoint() -> None:
    stages = [working()[0] for _ in range(2)]
    for step in range(60):
        for stage in stages:
            stage.step(pose=pose(step * 0.02), setpoint_wanted=setpoint((9.0, 0.0, -2.0)))
    assert stages[0].last(Setpoint) == stages[1].last(Setpoint)


@pytest.mark.parametrize(
    ("ceiling_m", "home_down_m", "passed_m"), [(None, 0.0, 30.0), (8.0, 0.0, 7.5), (8.0, -2.0, 5.5), (8.0, 3.0, 10.5)]
)
def test_a_take_off_is_no_higher_than_the_limits_above_home(
    ceiling_m: float | None, home_down_m: float, passed_m: float
) -> None:
    limits = replace(LIMITS, fence=Fence(ceiling_m=ceiling_m), home_ned_m=(0.0, 0.0, home_down_m))
    stage, limiter = working(limits)
    wanted = Manoeuvre(action_id="go", kind=ManoeuvreKind.TAKE_OFF, height_m=40.0, may_arm=True)
    stage.step(manoeuvre_wanted=wanted)
    assert stage.last(Manoeuvre) == replace(wanted, height_m=passed_m)
    assert limiter.clamped == 1
    stage.step(manoeuvre_wanted=replace(wanted, height_m=1.5))
    assert stage.last(Manoeuvre).height_m == 1.5
    stage.step(manoeuvre_wanted=replace(wanted, action_id="thief"))
    assert len(stage.all(Manoeuvre)) == 2


def test_after_a_stop_the_limits_are_waited_for_again() -> None:
    stage, limiter = working()
    limiter.stop()
    limiter.start()
    stage.step(pose=pose(), setpoint_wanted=setpoint())
    assert stage.all(Setpoint) == []


def flown_m_s(quality: float, seen: ObstacleScan | None = None, **settings: float) -> tuple[float, Limiter]:
    """How fast the point moves towards a far target with a pose of a quality, once it has settled."""
    limiter = Limiter()
    stage = Stage(limiter, LimiterSettings(**settings))
    stage.step(limits=LIMITS, grant=grant("go"), pose=pose())
    at, speed = 0.0, 0.0
    for _ in range(60):
        if seen is not None:
            stage.put(obstacles=seen)
        stage.step(
            pose=pose(at, velocity_ned_m_s=(speed, 0.0, 0.0), quality=quality),
            setpoint_wanted=setpoint((20.0, 0.0, -2.0)),
        )
        before, at = at, stage.last(Setpoint).position_ned_m[0]
        speed = (at - before) / 0.05
    return speed, limiter


def test_with_a_pose_of_little_quality_it_slows_down_and_at_last_it_holds() -> None:
    assert flown_m_s(0.8)[0] == pytest.approx(3.0, abs=0.1)
    slow, limiter = flown_m_s(0.5)
    assert slow == pytest.approx(0.3, abs=0.02)
    assert limiter.reason == "the pose quality is too low (0.50): no more than 0.30 m/s"
    held, limiter = flown_m_s(0.25)
    assert held == pytest.approx(0.0, abs=1e-6)
    assert limiter.reason == "the pose quality is too low (0.25): it holds"


def test_it_slows_down_no_harder_than_the_platform_brakes() -> None:
    stage, _ = working()
    at, speeds = 0.0, []
    for step in range(120):
        stage.step(pose=pose(at, quality=1.0 if step < 60 else 0.2), setpoint_wanted=setpoint((40.0, 0.0, -2.0)))
        before, at = at, stage.last(Setpoint).position_ned_m[0]
        speeds.append((at - before) / 0.05)
    assert speeds[58] > 2.9
    assert speeds[-1] == pytest.approx(0.0, abs=1e-6)
    assert max(a - b for a, b in pairwise(speeds)) <= LIMITS.acceleration_m_s2 * 0.05 + 1e-6


def test_while_no_obstacles_are_reported_it_is_no_faster_than_may_be_flown_blind() -> None:
    nothing = ObstacleScan(points_ne_m=[])
    covered = replace(nothing, is_valid=False, reason="covered")
    assert flown_m_s(1.0, nothing, blind_m_s=0.0)[0] == pytest.approx(3.0, abs=0.1)
    held, limiter = flown_m_s(1.0, covered, blind_m_s=0.0)
    assert held == pytest.approx(0.0, abs=1e-6)
    assert limiter.reason == "no obstacles are reported: it holds"
    slow, limiter = flown_m_s(1.0, covered, blind_m_s=0.3)
    assert slow == pytest.approx(0.3, abs=0.02)
    assert limiter.reason == "no obstacles are reported: no more than 0.30 m/s"
    assert flown_m_s(0.25, covered, blind_m_s=0.3)[1].reason == "the pose quality is too low (0.25): it holds"
    assert flown_m_s(1.0, covered)[0] == pytest.approx(3.0, abs=0.1), "unless it is set"
