"""`gloc3 onboard` flies a PX4 that lives by our physics in lock-step: bridge, peer and adapter in one loop.

PX4's side is played by the embedded autopilot behind a peer written from PX4's simulator interface, over TCP.
"""

import math
from collections.abc import Iterator

import pytest
from tests.onboard.vehicle_stack import VehicleStack
from tests.sitl.firmware.px4_in_step import Px4InStep

from gloc3.messages.command_interface import Outcome, Steer, Verb
from gloc3.messages.vehicle import FlightMode

pytestmark = pytest.mark.sockets

BOOT_S = 6.0
"""A real one is not quicker."""
WAY = ((4.0, 0.0, 3.0), (4.0, 4.0, 3.0))
MISSION = f"""\
mission: two places
frame: site
on_failure: land
on_link_loss: continue
on_pose_lost: land
tasks:
  depart: {{actions: {{off: {{take_off: {{height_m: 2}}}}}}}}
  there:
    after: [depart]
    actions:
      way: {{follow_waypoints: {{waypoints_m: {[list(place) for place in WAY]}, speed_m_s: 2}}}}
  recover: {{after: [there], actions: {{down: {{land: {{}}}}}}}}
"""

Stack = VehicleStack[Px4InStep]


@pytest.fixture
def stack() -> Iterator[Stack]:
    made = Stack("copter", Px4InStep, {})
    yield made
    made.close()
    made.peer.close()


def place_m(stack: Stack) -> tuple[float, float, float]:
    """Where the vehicle really is, `[x, y, height]` in the frame of the mission."""
    truth = stack.peer.body.truth()
    return stack.peer.body.world.local(truth.latitude_deg, truth.longitude_deg, truth.altitude_m)


def fly(stack: Stack) -> None:
    stack.wait(6.0)
    stack.upload(MISSION)
    stack.steer(Verb.START)
    stack.until(lambda: "there running" in "\n".join(stack.events), 40.0, "it is in the air")


def test_it_takes_off_flies_waypoints_and_lands_in_lock_step(stack: Stack) -> None:
    fly(stack)
    nearest = dict.fromkeys(WAY, math.inf)

    def is_over() -> bool:
        for place in WAY:
            nearest[place] = min(nearest[place], math.dist(place, place_m(stack)))
        return stack.mission == "done"

    stack.until(is_over, 60.0, "it is done")
    assert max(nearest.values()) < 0.4
    assert place_m(stack) == pytest.approx((*WAY[-1][:2], 0.0), abs=0.4)
    peer = stack.peer.peer
    assert not peer.is_armed
    assert peer.answered == stack.peer.bridge.answers == stack.peer.bridge.steps - 25


def test_a_start_waits_for_the_first_reading_of_parameters_of_which_px4_does_not_know_one() -> None:
    stack = Stack("copter", Px4InStep, {"COM_OBL_RC_ACT": 0})
    try:
        stack.peer.autopilot._front._parameters.server._values.pop("COM_DLL_EXCEPT")
        stack.until(lambda: "ci/vehicle" in stack.received, 5.0, "the vehicle is heard")
        stack.until(lambda: stack.last("ci/vehicle").is_armable, 10.0, "it would arm")
        stack.upload(MISSION)
        assert not stack.last("autopilot_setup").is_complete
        reply = stack.request(Steer(verb=Verb.START))
        assert reply.outcome is Outcome.REFUSED
        assert "COM_OBL_RC_ACT 0" in reply.reason
    finally:
        stack.close()
        stack.peer.close()


def test_a_px4_that_is_held_up_holds_up_the_time_and_the_flight_goes_on(stack: Stack) -> None:
    fly(stack)
    stack.wait(1.0)
    bridge = stack.peer.bridge
    stack.peer.is_held_up = True
    stack.wait(0.05)
    steps, place = bridge.steps, place_m(stack)
    stack.wait(0.4)
    assert bridge.steps == steps, "nothing moves that PX4 has not answered"
    assert place_m(stack) == place
    stack.peer.is_held_up = False
    stack.until(lambda: math.dist(place_m(stack), WAY[0]) < 0.4, 10.0, "it goes on to its first place")
    assert stack.mission == "running"


def test_a_px4_that_restarts_in_flight_is_noticed_and_can_be_flown_again(stack: Stack) -> None:
    fly(stack)
    stack.wait(1.0)
    before = stack.peer.autopilot
    stack.peer.switch_off()
    stack.until(lambda: stack.mission == "failed", 5.0, "the pose is lost, and with it the mission")
    stack.until(lambda: any("the autopilot has gone" in event for event in stack.events), 5.0, "it is said who is gone")
    stack.wait(BOOT_S)
    stack.peer.switch_on()
    stack.until(lambda: any("the autopilot has restarted" in event for event in stack.events), 5.0, "and who is back")
    assert stack.peer.bridge.now_s < 1.0
    assert stack.peer.autopilot is not before
    assert place_m(stack) == pytest.approx((0.0, 0.0, 0.0), abs=0.01)
    stack.wait(2.0)
    stack.device.command_mode(
        FlightMode.HOLD
    )  # told to land while it was not heard, it stands in a mode without arming
    stack.events.clear()
    fly(stack)
    assert place_m(stack)[2] > 1.5
