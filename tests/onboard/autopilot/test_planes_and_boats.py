"""The onboard process leads planes of both families as far as waypoints, and a boat, by their public interface."""

import math
from functools import partial
from itertools import pairwise
from pathlib import Path

import pytest
from tests.onboard.components.drivers.test_driving_and_diving import WELL, begun, drive
from tests.onboard.plane_peer import ArduPlane, PlanePeer, Px4Plane
from tests.onboard.vehicle_peer import BoatPeer, VehiclePeer
from tests.onboard.vehicle_stack import VehicleStack

from gloc3.messages.command_interface import Verb
from gloc3.platform.reader import whole_text

pytestmark = pytest.mark.thorough

WAY = ((300.0, 0.0), (300.0, 300.0))
SORTIE = """\
mission: round the field
frame: site
on_failure: return
on_link_loss: continue
on_low_battery: return
on_pose_lost: land
tasks:
  depart: {actions: {up: {take_off: {height_m: 50}}}}
  box:
    after: [depart]
    actions:
      way: {follow_waypoints: {waypoints_m: [[300, 0, 50], [300, -300, 50]], speed_m_s: 15, acceptance_m: 10}}
  recover: {after: [box], actions: {home: {return_home: {}}, down: {land: {}, after: [home]}}}
"""


PLANE = {
    "type: quadrotor": "type: aircraft",
    "speed_m_s: 4.0": "speed_m_s: 16.0",
    "climb_m_s: 1.0": "climb_m_s: 3.0",
    "height_max_m: 60.0": "height_max_m: 120.0",
    "acceleration_m_s2: 1.2": "acceleration_m_s2: 1.2, settle_s: 60, comes_within_m: 80, return_speed_m_s: 15",
}


def changed(folder: Path, platform: str, changes: dict[str, str]) -> str:
    """A platform file of ours for another vehicle."""
    text = whole_text(platform)
    for before, after in changes.items():
        assert before in text
        text = text.replace(before, after)
    file = folder / "vehicle.yaml"
    file.write_text(text)
    return str(file)


@pytest.mark.parametrize("kind", [ArduPlane, Px4Plane])
def test_a_plane_takes_off_flies_its_waypoints_waits_in_circles_comes_home_and_lands(
    kind: type[PlanePeer], tmp_path: Path
) -> None:
    stack: VehicleStack[PlanePeer] = VehicleStack(
        changed(tmp_path, "copter", PLANE), kind, {**WELL, "BATT_FS_LOW_ACT": 1}
    )
    peer = stack.peer
    try:
        stack.wait(8.0)
        stack.upload(SORTIE)
        stack.steer(Verb.START)
        for north, east in WAY:
            stack.until(partial(near, peer, north, east), 120.0, f"it comes to {north}, {east}")
            assert peer.position[2] == pytest.approx(-50.0, abs=5.0)
        stack.steer(Verb.PAUSE)
        held = tuple(peer.position)
        stack.wait(30.0)
        assert math.dist(held, peer.position) < 300.0
        stack.steer(Verb.RESUME)
        stack.until(lambda: stack.mission == "done", 200.0, "it has landed")
        assert not peer.is_armed
        assert math.dist(peer.position, (0.0, 0.0, 0.0)) < 200.0
        assert peer.refused == []
        assert (peer.modes[0], peer.modes[-1]) == (kind.take_off, kind.land)
        assert kind.guided in peer.modes
        if kind is ArduPlane:
            assert min(b - a for a, b in pairwise(peer.requested_s)) > 0.9, "no more than once a second"
    finally:
        stack.close()


def near(peer: PlanePeer, north: float, east: float) -> bool:
    """Whether it passes a waypoint."""
    return math.dist(peer.position[:2], (north, east)) < 100.0


def test_a_boat_is_led_as_a_rover_and_held_by_loiter(tmp_path: Path) -> None:
    boat = changed(tmp_path, "rover", {"type: rover": "type: boat"})
    stack: VehicleStack[VehiclePeer] = VehicleStack(boat, BoatPeer, {**WELL, "FS_ACTION": 2})
    try:
        begun(stack, drive())
        stack.until(lambda: stack.mission == "done", 90.0, "it arrives")
        assert math.dist(stack.peer.position, (12.0, -12.0, 0.0)) < 3.0
        assert not stack.peer.is_armed
        assert stack.peer.refused == []
    finally:
        stack.close()
