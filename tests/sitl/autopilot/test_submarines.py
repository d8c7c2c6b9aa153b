"""Submarines in ArduSub's modes: they dive, hold, go where they are told and come up."""

from math import degrees, hypot, nan

import pytest
from msgspec.structs import replace

from gloc3.errors import Misuse
from gloc3.messages.frames import Vector3, to_euler, wrap_pi
from gloc3_sitl.autopilot.control.setpoint import MotionSetpoint
from gloc3_sitl.autopilot.estimator.sources import ExternalOdometry
from gloc3_sitl.autopilot.verdict import Author
from gloc3_sitl.physics.water import rough
from gloc3_sitl.vehicles.simulator import Simulator, SimulatorSettings
from gloc3_sitl.world import World

GUIDED, SURFACE, ALT_HOLD, POSHOLD, MANUAL = 4, 9, 2, 16, 19


class Dive:
    """A submarine in the bay, told its place as a companion would: by the truth, with the climb that it has told itself."""

    def __init__(self, vehicle: str, current_ned_m_s: Vector3 = (0.0, 0.0, 0.0), waves_m: float = 0.0) -> None:
        world = World.load("bay")
        world.water = rough(replace(world.water, current_ned_m_s=current_ned_m_s), waves_m=waves_m)
        self.simulator = Simulator(world, SimulatorSettings(vehicle=vehicle, seed=4))
        self.autopilot = self.simulator.autopilot
        # Where it is moved about, the level is found from what it does for many seconds.
        self.simulator.advance(30.0 if waves_m or any(current_ned_m_s) else 12.0)
        self.autopilot.source_set = 2
        self.autopilot.choose_sources()
        self.run(1.0)

    def run(self, seconds: float) -> None:
        """Goes on, with a pose ten times a second."""
        simulator = self.simulator
        end_s = simulator.now_s + seconds
        while simulator.now_s < end_s - 1e-6:
            simulator.advance(simulator.now_s + 0.1)
            truth, climb = simulator.truth(), self.autopilot.estimator.velocity_ned_m_s[2]
            pose = ExternalOdometry(
                t_s=simulator.now_s,
                position_ned_m=truth.position_ned_m,
                velocity_ned_m_s=(*truth.velocity_ned_m_s[:2], climb),
                yaw_rad=None,
                position_deviation_m=0.1,
                velocity_deviation_m_s=0.05,
                reset_counter=0,
            )
            self.autopilot.estimator.use_external(pose, simulator.now_s)

    def arm(self, mode: int = GUIDED) -> None:
        """Arms in a mode."""
        commander = self.autopilot.commander
        assert commander.set_mode(mode, Author.COMMAND).is_accepted
        assert commander.arm(Author.COMMAND).is_accepted
        self.run(0.5)

    def go_to(self, place: Vector3, seconds: float) -> float:
        """Goes to a place; gives how far from it the vehicle is then."""
        assert self.autopilot.commander.go_to(place, nan, nan).is_accepted
        self.run(seconds)
        at = self.simulator.truth().position_ned_m
        return hypot(*(here - there for here, there in zip(at, place, strict=True)))


@pytest.mark.parametrize("vehicle", ["auv", "rov"])
def test_it_dives_to_a_place_and_stays_there(vehicle: str) -> None:
    dive = Dive(vehicle)
    dive.arm()
    assert dive.go_to((12.0, 0.0, 4.0), 60.0) < 0.3
    roll, pitch, _ = (abs(degrees(angle)) for angle in to_euler(dive.simulator.truth().attitude_wxyz))
    assert max(roll, pitch) < 6.0


@pytest.mark.parametrize("vehicle", ["auv", "rov"])
def test_it_keeps_its_place_in_a_current_from_the_side(vehicle: str) -> None:
    dive = Dive(vehicle, (0.0, 0.08, 0.0))
    dive.arm()
    assert dive.go_to((10.0, 0.0, 3.0), 70.0) < 0.5


def test_a_start_in_waves_does_not_lead_it_astray_in_heading_or_depth() -> None:
    dive = Dive("rov", waves_m=0.3)
    yaw_rad = to_euler(dive.simulator.truth().attitude_wxyz)[2]
    assert abs(degrees(wrap_pi(dive.autopilot.estimator.yaw_rad - yaw_rad))) < 6.0, "rocking is no bias of the gyros"
    dive.arm()
    dive.go_to((2.0, 0.0, 5.0), 10.0)
    off_m = []
    for _ in range(25):
        dive.run(1.0)
        off_m.append(dive.simulator.truth().position_ned_m[2] - dive.autopilot.estimator.position_ned_m[2])
    assert max(off_m) - min(off_m) < 0.1, "its pressure sensor knows the depth to centimetres"


def test_the_auv_meets_a_current_across_its_way_with_a_crab_angle() -> None:
    dive = Dive("auv", (0.0, 0.25, 0.0))
    dive.arm()
    east_m = dive.simulator.truth().position_ned_m[1]
    dive.autopilot.commander.go_to((80.0, east_m, 4.0), nan, nan)
    dive.run(60.0)
    truth = dive.simulator.truth()
    assert abs(truth.position_ned_m[1] - east_m) < 1.5
    assert -25.0 < degrees(to_euler(truth.attitude_wxyz)[2]) < -8.0, "about asin(0.25 / 1.0) into the current"


def test_surface_mode_brings_it_up_and_it_may_be_disarmed_anywhere() -> None:
    dive = Dive("rov")
    dive.arm()
    dive.go_to((0.0, 0.0, 4.0), 25.0)
    assert dive.autopilot.commander.set_mode(SURFACE, Author.COMMAND).is_accepted
    dive.run(15.0)
    assert dive.simulator.truth().position_ned_m[2] < 0.35
    assert dive.autopilot.commander.disarm(Author.COMMAND).is_accepted


def test_sticks_move_it_and_the_depth_is_held_in_alt_hold() -> None:
    dive = Dive("rov")
    dive.arm()
    dive.go_to((0.0, 0.0, 3.0), 20.0)
    pilot = dive.simulator.pilot
    pilot.switch_on()
    dive.run(0.5)
    assert dive.autopilot.commander.set_mode(ALT_HOLD, Author.PILOT).is_accepted
    pilot.pitch, pilot.throttle = -0.6, 0.5
    dive.run(10.0)
    n, _, d = dive.simulator.truth().position_ned_m
    assert n > 2.0
    assert d == pytest.approx(3.0, abs=0.3)


def test_satellites_are_lost_under_water_and_found_a_stated_time_after_surfacing() -> None:
    dive = Dive("rov")
    estimator = dive.autopilot.estimator
    dive.arm()
    dive.go_to((0.0, 0.0, 2.0), 15.0)
    assert estimator.fix is not None
    assert estimator.fix.fix_type == 1
    dive.autopilot.commander.set_mode(SURFACE, Author.COMMAND)
    up_s = None
    while estimator.fix.fix_type == 1:
        dive.run(0.5)
        if up_s is None and dive.simulator.truth().position_ned_m[2] < 0.25:
            up_s = dive.simulator.now_s
        assert dive.simulator.now_s < 60.0
    assert up_s is not None
    assert 7.0 < dive.simulator.now_s - up_s < 9.5


def test_its_depth_is_that_below_the_surface() -> None:
    dive = Dive("auv")
    dive.arm()
    dive.go_to((0.0, 0.0, 5.0), 30.0)
    believed = dive.autopilot.estimator.inertial.position_ned_m[2]
    assert believed == pytest.approx(dive.simulator.truth().position_ned_m[2], abs=0.15)


def test_a_velocity_that_is_not_renewed_ends_in_a_hold() -> None:
    dive = Dive("rov")
    dive.arm()
    dive.go_to((0.0, 0.0, 3.0), 20.0)
    for _ in range(20):
        setpoint = MotionSetpoint(velocity_ned_m_s=(0.4, 0.0, 0.0))
        dive.autopilot.craft.stream.put(setpoint, dive.simulator.now_s)
        dive.run(0.25)
    assert dive.simulator.truth().velocity_ned_m_s[0] == pytest.approx(0.4, abs=0.08)
    dive.run(12.0)
    assert hypot(*dive.simulator.truth().velocity_ned_m_s) < 0.05


def test_a_leak_brings_it_up_and_keeps_it_from_arming_again() -> None:
    dive = Dive("rov")
    dive.arm()
    dive.go_to((0.0, 0.0, 3.0), 20.0)
    dive.simulator.sensors.fail("leak", "biased")
    dive.run(12.0)
    assert dive.autopilot.commander.mode.name == "ALT_HOLD", "SURFACE is over there"
    assert dive.simulator.truth().position_ned_m[2] < 0.5
    assert "Failsafe: Leak Detected" in [text for _, _, text in dive.simulator.texts]
    dive.autopilot.commander.disarm(Author.COMMAND)
    assert "leak detected" in dive.autopilot.commander.problems()


def test_the_fence_has_a_depth() -> None:
    dive = Dive("rov")
    dive.autopilot.parameters.set("FENCE_ENABLE", 1)
    dive.autopilot.parameters.set("FENCE_ALT_MIN", -3.0)
    dive.arm()
    dive.go_to((0.0, 0.0, 6.0), 20.0)
    assert "Failsafe: below the fence depth of 3 m" in [text for _, _, text in dive.simulator.texts]
    assert dive.simulator.truth().position_ned_m[2] < 4.0


def test_other_autopilots_do_not_steer_submarines() -> None:
    with pytest.raises(Misuse, match="use ardupilot"):
        Simulator(World.load("bay"), SimulatorSettings(vehicle="auv", style="px4"))
