"""The onboard process leads a rover and a submarine by their public interface, in virtual time."""

import math
from collections.abc import Iterator

import pytest
from tests.onboard.vehicle_peer import RoverPeer, SubPeer, VehiclePeer
from tests.onboard.vehicle_stack import VehicleStack

from gloc3.messages.command_interface import Outcome, Steer, Verb

pytestmark = pytest.mark.thorough

MISSION = """\
mission: a way with something beside it
frame: site
on_failure: land
on_link_loss: continue
on_low_battery: land
on_pose_lost: land
tasks:
  depart: {actions: {off: {START}}}
  box:
    after: [depart]
    actions:
      way: {follow_waypoints: {waypoints_m: WAY, speed_m_s: SPEED, acceptance_m: NEAR}}
      beside: {wait: {duration_s: 5}}
  recover: {after: [box], actions: {end: {land: {}}}}
"""
WELL = {
    "FS_GCS_TIMEOUT": 5, "FS_EKF_ACTION": 1, "BATT_FS_LOW_ACT": 2, "BATT_LOW_MAH": 330, "BATT_CAPACITY": 3300,
    "ARMING_CHECK": 1, "FS_GCS_ENABLE": 0,
}  # fmt: skip


def drive() -> str:
    way = "[[12, 0, 0], [12, 12, 0]]"
    return MISSION.replace("START", "drive_off: {}").replace("WAY", way).replace("SPEED", "2").replace("NEAR", "2")


def dive() -> str:
    way = "[[5, 0, -4], [5, 3, -6]]"
    text = MISSION.replace("START", "dive: {depth_m: 4}").replace("WAY", way)
    return text.replace("SPEED", "0.5").replace("NEAR", "0.6")


@pytest.fixture
def rover() -> Iterator[VehicleStack[VehiclePeer]]:
    stack = VehicleStack("rover", RoverPeer, {**WELL, "FS_ACTION": 2})
    yield stack
    stack.close()


@pytest.fixture
def submarine() -> Iterator[VehicleStack[VehiclePeer]]:
    stack = VehicleStack("submarine", SubPeer, {**WELL, "FS_EKF_ACTION": 0, "FS_PILOT_INPUT": 0, "BATT_FS_LOW_ACT": 3})
    yield stack
    stack.close()


def begun(stack: VehicleStack[VehiclePeer], text: str) -> None:
    stack.wait(6.0)
    stack.upload(text)
    stack.steer(Verb.START)
    stack.until(lambda: "box running" in "\n".join(stack.events), 40.0, "it is on its way")


def test_a_rover_drives_off_pauses_resumes_stops_and_is_disarmed(rover: VehicleStack[VehiclePeer]) -> None:
    begun(rover, drive())
    rover.wait(3.0)
    assert rover.last("ci/vehicle").landed == "under_way", "a rover is not in the air"
    rover.steer(Verb.PAUSE)
    rover.until(lambda: math.hypot(*rover.peer.velocity) < 0.05, 8.0, "it stands")
    held = list(rover.peer.position)
    rover.wait(5.0)
    assert math.dist(held, rover.peer.position) < 0.2
    rover.steer(Verb.RESUME)
    rover.until(lambda: rover.mission == "done", 90.0, "it arrives")
    assert math.dist(rover.peer.position, (12.0, -12.0, 0.0)) < 3.0
    assert not rover.peer.is_armed
    assert rover.peer.modes[-1] == RoverPeer.hold
    assert rover.peer.refused == []
    assert not rover.last("driver").has_pilot_control


def test_a_submarine_dives_pauses_resumes_surfaces_and_is_disarmed(submarine: VehicleStack[VehiclePeer]) -> None:
    begun(submarine, dive())
    assert submarine.peer.position[2] == pytest.approx(4.0, abs=0.3)
    submarine.wait(4.0)
    submarine.steer(Verb.PAUSE)
    submarine.until(lambda: math.hypot(*submarine.peer.velocity) < 0.05, 8.0, "it stands")
    submarine.steer(Verb.RESUME)
    submarine.until(lambda: submarine.peer.position[2] > 5.5, 60.0, "it goes deeper")
    submarine.until(lambda: submarine.mission == "done", 90.0, "it surfaces")
    assert submarine.peer.position[2] < 0.3
    assert not submarine.peer.is_armed
    assert submarine.peer.modes[-2:] == [9, 2], "SURFACE, and ALT_HOLD by itself"
    assert submarine.peer.refused == []
    assert not submarine.last("driver").has_pilot_control


@pytest.mark.parametrize(("parameters", "what"), [({"FS_GCS_ENABLE": 1}, "hold after 5 s (FS_GCS_ENABLE 1)")])
def test_a_mission_that_goes_on_without_a_link_is_refused_where_the_rover_stops(
    parameters: dict[str, int], what: str
) -> None:
    stack = VehicleStack("rover", RoverPeer, {**WELL, "FS_ACTION": 2, **parameters})
    try:
        stack.wait(6.0)
        stack.upload(drive())
        reply = stack.request(Steer(verb=Verb.START))
        assert reply.outcome is Outcome.REFUSED
        assert f"failsafes: link loss ({what}; the platform file says continue)" in reply.reason
        assert "set FS_GCS_ENABLE to 0" in reply.text
    finally:
        stack.close()


def test_the_platform_file_of_another_vehicle_is_refused_before_the_start() -> None:
    stack = VehicleStack("copter", RoverPeer, {**WELL, "FS_ACTION": 2})
    try:
        stack.wait(6.0)
        stack.upload(drive().replace("drive_off: {}", "take_off: {height_m: 2}").replace(", 0]", ", 2]"))
        reply = stack.request(Steer(verb=Verb.START))
        assert reply.outcome is Outcome.REFUSED
        assert "(the autopilot is set up for a rover; the platform file says quadrotor)" in reply.reason
    finally:
        stack.close()
