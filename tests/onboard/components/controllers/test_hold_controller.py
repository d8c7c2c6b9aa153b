"""The hold controller: the place where the vehicle comes to rest is kept, and not given up for a jump of the estimate."""

import itertools
import math
from typing import Any

import pytest
from msgspec.structs import replace
from tests.onboard.messages import grant, pose
from tests.onboard.stage import Stage

from gloc3.messages.frames import Vector3, from_yaw
from gloc3.messages.vehicle import Setpoint
from gloc3_onboard.components.controllers.hold import HoldController


def place(stage: Stage) -> Vector3:
    setpoint = stage.last(Setpoint)
    assert setpoint.position_ned_m is not None
    found: Vector3 = setpoint.position_ned_m
    return found


def holding(**fields: Any) -> Stage:
    stage = Stage(HoldController())
    stage.step(grant=grant("hold", "hold"), pose=pose(1.0, 2.0, 3.0, **fields))
    return stage


def test_the_present_place_is_kept_whatever_the_vehicle_does() -> None:
    stage = holding(ned_from_frd=from_yaw(0.7))
    for step in range(100):
        stage.step(pose=pose(1.0 + 0.01 * step, 2.0, 3.0), grant=grant("hold", "hold"))
    assert place(stage) == (1.0, 2.0, -3.0)
    assert stage.last(Setpoint).yaw_rad == pytest.approx(0.7)
    assert {setpoint.action_id for setpoint in stage.all(Setpoint)} == {"hold"}


def test_at_speed_the_place_moves_on_until_it_rests() -> None:
    stage = holding(velocity_ned_m_s=(1.2, 0.0, -0.5))
    places = [place(stage)]
    speeds = [1.3]
    for _ in range(60):
        stage.step(pose=pose(1.0, 2.0, 3.0, velocity_ned_m_s=(9.0, 9.0, 9.0)))
        places.append(place(stage))
        speeds.append(math.hypot(*stage.last(Setpoint).velocity_ned_m_s))
    assert math.dist(places[0], (1.0, 2.0, -3.0)) < 0.1
    assert math.dist(places[-1], (1.0, 2.0, -3.0)) == pytest.approx(1.3**2 / 3.5, abs=0.05)
    assert speeds[-1] == 0.0
    assert max(a - b for a, b in itertools.pairwise(speeds)) <= 1.75 * 0.1 + 1e-9
    assert max(math.dist(a, b) for a, b in itertools.pairwise(places)) <= 1.3 * 0.05 + 1e-9


def test_it_is_silent_while_motion_is_somebody_elses_and_takes_a_new_place_afterwards() -> None:
    stage = holding()
    stage.step(grant=grant("go"), pose=pose(1.0, 2.0, 3.0))
    count = len(stage.all(Setpoint))
    stage.step(pose=pose(5.0, 2.0, 3.0))
    assert len(stage.all(Setpoint)) == count
    stage.step(grant=grant("hold", "hold"), pose=pose(6.0, 2.0, 3.0))
    assert place(stage) == (6.0, 2.0, -3.0)
    stage.step(grant=grant(""), pose=pose(6.0, 2.0, 3.0))
    assert len(stage.all(Setpoint)) == count + 1


def test_without_a_valid_pose_it_is_silent_and_after_a_long_gap_the_place_is_where_the_vehicle_is() -> None:
    stage = holding()
    count = len(stage.all(Setpoint))
    stage.step(0.2)
    stage.step(pose=replace(pose(4.0), is_valid=False))
    assert len(stage.all(Setpoint)) == count
    stage.step(pose=pose(1.3, 2.0, 3.0))
    assert place(stage) == (1.0, 2.0, -3.0), "a short gap changes nothing"
    stage.step(2.0)
    stage.step(pose=pose(4.0, 2.0, 3.0))
    assert place(stage) == (4.0, 2.0, -3.0)


def test_a_jump_of_the_estimate_moves_the_place_with_it() -> None:
    stage = holding()
    stage.step(pose=pose(1.0, 2.0, 3.0))
    stage.step(pose=pose(1.8, 2.0, 2.5, reset_counter=1))
    assert place(stage) == pytest.approx((1.8, 2.0, -2.5))
    stage.step(pose=pose(1.9, 2.0, 2.5, reset_counter=1))
    assert place(stage) == pytest.approx((1.8, 2.0, -2.5))


def test_the_action_hold_ends_after_its_time_and_a_pause_stops_the_clock() -> None:
    stage = holding()
    stage.begin("hold", "stay", duration_s=2.0)
    stage.step(grant=grant("stay", "hold"), pose=pose(1.0, 2.0, 3.0))
    assert stage.last(Setpoint).action_id == "stay"
    stage.step(1.0, pose=pose())
    assert stage.status.progress == pytest.approx(0.525)
    stage.call("action.pause", action_id="stay")
    stage.step(30.0, pose=pose())
    stage.call("action.resume", action_id="stay")
    stage.step(0.9, pose=pose())
    assert stage.status.state == "running"
    stage.step(0.1, pose=pose())
    assert (stage.status.state, stage.status.progress) == ("done", 1.0)


def test_between_its_action_and_its_own_ownership_the_place_is_the_same() -> None:
    stage = holding()
    stage.begin("hold", "stay", duration_s=0.1)
    for owner in ("stay", "stay", "stay", "stay", "hold", "hold"):
        stage.step(grant=grant(owner, "hold"), pose=pose(1.02, 2.0, 3.0))
    assert stage.status.state == "done"
    assert {setpoint.position_ned_m for setpoint in stage.all(Setpoint)} == {(1.0, 2.0, -3.0)}
    assert len(stage.all(Setpoint)) == 7


def test_an_endless_hold_goes_on_until_it_is_cancelled_and_progress_of_a_restart_counts() -> None:
    stage = holding()
    stage.begin("hold", "stay")
    for _ in range(50):
        stage.step(1.0, pose=pose())
    assert stage.status.state == "running"
    stage.call("action.cancel", action_id="stay")
    stage.begin("hold", "again", progress=0.9, duration_s=10.0)
    stage.step(0.9, pose=pose())
    assert stage.status.state == "running"
    stage.step(0.2, pose=pose())
    assert stage.status.state == "done"


def test_a_stop_forgets_the_place() -> None:
    stage = holding()
    stage.component.stop()
    stage.component.start()
    stage.step(grant=grant("hold", "hold"), pose=pose(9.0, 2.0, 3.0))
    assert place(stage) == (9.0, 2.0, -3.0)
