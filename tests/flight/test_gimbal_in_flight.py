"""A mission that points the gimbal, and stations that steer it by hand: one owner, limits, and what the camera sees."""

from math import atan2, degrees, hypot
from pathlib import Path

import cv2
import numpy as np
import pytest
from tests.flight.card import ONE_STYLE, Card
from tests.flight.tool import COMPANION, Tool

from gloc3.mavlink.codec import Encoder, Parser, message
from gloc3.mavlink.services.command import CommandResult
from gloc3.messages.command_interface import Control, ControlVerb, Outcome
from gloc3.messages.frames import to_euler
from gloc3.messages.vehicle import GimbalState

pytestmark = [ONE_STYLE]

PLATFORM = """
platform: looker
extends: pelican_rtk
cameras:
  gimbal: {width: 640, height: 480, focal_px: [500, 500], center_px: [319.5, 239.5]}
capabilities:
  point_camera: {arguments: point_camera, performed_by: gimbal, claims: [gimbal], needs: [autopilot]}
components:
  - {name: gimbal, class: "gloc3_onboard.components.drivers.gimbal:GimbalDriver", rate_hz: 10, devices: {device: gimbal}, ports: {action_status: action_status/gimbal}}
"""
WITH_PICTURES = PLATFORM.replace(
    "components:\n",
    """  shoot: {arguments: record_images, performed_as: record_images, performed_by: ground_recorder, claims: [recorder], needs: [pose], options: {camera: [gimbal]}}
components:
  - {name: gimbal_camera, class: "gloc3_onboard.components.samplers.camera:CameraSampler", rate_hz: 2, devices: {device: gimbal_camera}, ports: {image: camera/gimbal}}
  - {name: ground_recorder, ports: {image: camera/gimbal}, settings: {on_gimbal: [gimbal]}}
""",
)
MISSION = """
mission: look around
frame: hold
tasks:
  out:
    actions:
      down: {point_camera: {pitch_deg: -90}}
      up: {take_off: {height_m: 2.0}, after: [down]}
      aside: {point_camera: {pitch_deg: -20, heading_deg: 90}, after: [up]}
      to: {go_to: {position_m: [4, 0, 2], heading: 0}, after: [aside]}
      mark: {point_camera: {look_at_m: [2, 5, 0], keep: true}, after: [aside], until: to}
      back: {go_to: {position_m: [0, 0, 2], heading: 180}, after: [to]}
      land: {land: {}, after: [back]}
"""
CONFIGURE, PITCH_YAW, POINT_AT, NOWHERE, REQUEST = 1001, 1000, 195, 197, 512
EARTH, VEHICLE = 4 | 8 | 16 | 64, 4 | 8 | 32


def looks(flight: Card) -> tuple[float, float]:
    """Pitch and yaw of the gimbal itself, in degrees."""
    gimbal = flight.flight.gimbal
    assert gimbal is not None
    return degrees(gimbal.motion.pitch_rad), degrees(gimbal.motion.yaw_rad)


def state(flight: Card) -> GimbalState:
    found: GimbalState = flight.last("gimbal")
    return found


def ready(flight: Card) -> None:
    flight.until(lambda: bool(flight.received.get("gimbal")) and not state(flight).reason, 15.0, "the gimbal is found")


def begun(flight: Card) -> Tool:
    """A station of others beside one of ours, which has given up control."""
    flight.begin(MISSION, is_started=False, platform=PLATFORM)
    assert flight.request(Control(verb=ControlVerb.RELEASE)).outcome is Outcome.ACCEPTED
    ready(flight)
    flight.wait(1.1)
    return Tool(flight)


def take(tool: Tool, system: int = 250) -> CommandResult | None:
    return tool.command(CONFIGURE, float(system), 190.0, -1.0, -1.0, 0.0, 0.0, 154.0)


def refusals(flight: Card) -> list[str]:
    return [event.payload.text for event in flight.received.get("components/companion/event", [])]


def test_a_mission_points_down_aside_and_at_a_mark_that_it_passes(flight: Card) -> None:
    flight.begin(MISSION, is_started=False, platform=PLATFORM)
    ready(flight)
    flight.command("start")
    took_s = flight.await_state("out.down", "done", 10.0)
    assert 1.3 < took_s < 2.2, "90 deg at 60 deg/s"
    assert looks(flight) == pytest.approx((-90.0, 0.0), abs=2.0)
    flight.await_state("out.aside", "done", 20.0)
    assert looks(flight) == pytest.approx((-20.0, 90.0), abs=2.5)
    flight.await_state("out.mark", "running", 5.0)
    flight.wait(0.2)
    assert state(flight).owner.startswith("out.mark#")
    flight.wait(2.5)
    for _ in range(3):
        flight.wait(0.5)
        truth = flight.flight.simulator.truth()
        x, y, height = flight.flight.simulator.world.local(truth.latitude_deg, truth.longitude_deg, truth.altitude_m)
        mark = -atan2(5.0 - y, 2.0 - x), atan2(-height, hypot(5.0 - y, 2.0 - x))  # y is to the left of north
        _, pitch, yaw = to_euler(flight.flight.gimbal.carrying(truth).attitude_wxyz)  # type: ignore[union-attr]
        assert (degrees(yaw), degrees(pitch)) == pytest.approx((degrees(mark[0]), degrees(mark[1])), abs=5.0)
    flight.await_state("mission", "done", 60.0)
    assert state(flight).owner == ""


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ({"pitch_deg": 80.0}, "pitch 80 deg is outside the gimbal's -90 to 30 deg"),
        ({"pitch_deg": 0.0, "yaw_deg": 170.0}, "yaw 170 deg is outside the gimbal's -160 to 160 deg"),
        ({"look_at_m": [0.0, 0.0, 9.0]}, "pitch"),
    ],
)
def test_a_direction_outside_the_limits_is_refused(flight: Card, arguments: dict[str, object], reason: str) -> None:
    flight.begin(MISSION, is_started=False, platform=PLATFORM)
    ready(flight)
    before = looks(flight)
    flight.action("point_camera", **arguments)
    status = flight.until(lambda: flight.was_told(reason), 3.0, "the reason")
    assert looks(flight) == before, status


def test_a_gimbal_that_is_stuck_or_silent_fails_the_action_with_the_reason(flight: Card) -> None:
    flight.begin(MISSION, is_started=False, platform=PLATFORM)
    ready(flight)
    gimbal = flight.flight.gimbal
    assert gimbal is not None
    gimbal.motion.is_stuck = True
    assert flight.action("point_camera", pitch_deg=-45.0).outcome == "accepted"
    status = flight.expect("action_status/gimbal", lambda one: one.state == "failed", 17.0)
    assert status.reason == "the gimbal looks at pitch 0, yaw 0 deg after 15 s, not at pitch -45, yaw 0 deg"
    gimbal.motion.is_stuck = False
    assert flight.action("point_camera", pitch_deg=-80.0).outcome == "accepted"
    flight.wait(0.5)
    gimbal.stop()
    status = flight.expect("action_status/gimbal", lambda one: one.state == "failed", 4.0)
    assert status.reason == "the gimbal has not reported its attitude for 2 s"
    assert flight.lci("gimbal") == "working"


def test_a_station_finds_the_gimbal_takes_it_and_steers_it_by_hand(flight: Card) -> None:
    tool = begun(flight)
    assert tool.command(REQUEST, 280.0) is CommandResult.ACCEPTED
    tool.until(lambda: bool(tool.reported("GIMBAL_MANAGER_INFORMATION")), 2.0)
    about = tool.reported("GIMBAL_MANAGER_INFORMATION")[-1]
    assert (about.gimbal_device_id, round(degrees(about.pitch_min)), round(degrees(about.yaw_max))) == (154, -90, 160)
    assert tool.command(PITCH_YAW, -30.0, 0.0, target=COMPANION) is CommandResult.DENIED
    assert "take it first" in refusals(flight)[-1]
    assert take(tool, 249) is CommandResult.DENIED, "for itself only"
    assert take(tool) is CommandResult.ACCEPTED
    flight.until(lambda: state(flight).owner == "station 250/190", 1.0, "the owner")
    nan = float("nan")
    assert tool.command(PITCH_YAW, -30.0, 20.0, nan, nan, VEHICLE, 0.0, 154.0) is CommandResult.ACCEPTED
    flight.wait(2.0)
    assert looks(flight) == pytest.approx((-30.0, 20.0), abs=0.1)
    assert tool.command(PITCH_YAW, 80.0, 20.0, nan, nan, VEHICLE, 0.0, 154.0) is CommandResult.ACCEPTED
    flight.wait(2.5)
    assert looks(flight) == pytest.approx((30.0, 20.0), abs=0.1), "as far as it can"
    tool.send("GIMBAL_MANAGER_SET_PITCHYAW", flags=VEHICLE, pitch=nan, yaw=nan, pitch_rate=-0.3, yaw_rate=0.0)
    flight.wait(5.0)
    assert looks(flight)[0] == pytest.approx(30.0 - degrees(0.3) * 2.0, abs=4.0), "a rate expires after 2 s"
    tool.send("GIMBAL_MANAGER_SET_ATTITUDE", flags=EARTH, q=(1.0, 0.0, 0.0, 0.0), angular_velocity_x=nan)
    flight.wait(2.5)
    heading = degrees(to_euler(flight.flight.simulator.truth().attitude_wxyz)[2])
    assert looks(flight) == pytest.approx((0.0, -heading), abs=1.0)
    latitude, longitude = 39.5528, 2.6285 + 0.001
    place = (0.0, 0.0, 0.0, 0.0, latitude, longitude, 2.0)
    assert tool.command(POINT_AT, *place) is CommandResult.ACCEPTED
    flight.wait(3.0)
    assert looks(flight)[1] + heading == pytest.approx(90.0, abs=1.0), "east"
    assert tool.command(NOWHERE) is CommandResult.ACCEPTED
    flight.wait(2.5)
    assert looks(flight) == pytest.approx((0.0, 0.0), abs=0.1)
    status = tool.reported("GIMBAL_MANAGER_STATUS")[-1]
    assert (status.primary_control_sysid, status.primary_control_compid) == (250, 190)
    assert Tool(flight, system=249).command(PITCH_YAW, 0.0, 0.0) is CommandResult.DENIED
    assert tool.command(CONFIGURE, -3.0, -3.0, -1.0, -1.0, nan, nan, 154.0) is CommandResult.ACCEPTED
    flight.until(lambda: state(flight).owner == "", 1.0, "nobody")


def test_the_simulated_gimbal_answers_those_who_look_for_gimbals_as_px4_does(flight: Card) -> None:
    tool = begun(flight)
    answers: list[int] = []
    gimbal = flight.flight.gimbal
    assert gimbal is not None
    receive = flight.flight.simulator.attach(lambda data: answers.extend(f.message_id for f in Parser().receive(data)))
    encoder = Encoder(1, 100)
    for message_id in (259.0, 283.0):
        receive(encoder.encode(message("COMMAND_LONG", command=REQUEST, param1=message_id)))
        flight.wait(0.3)
    assert 283 in answers
    assert tool.command(REQUEST, 280.0) is CommandResult.ACCEPTED


def test_an_action_takes_the_gimbal_from_a_station_that_can_have_it_back_afterwards(flight: Card) -> None:
    tool = begun(flight)
    assert take(tool) is CommandResult.ACCEPTED
    assert tool.command(300) is CommandResult.ACCEPTED
    flight.await_state("out.down", "done", 15.0)
    assert looks(flight) == pytest.approx((-90.0, 0.0), abs=2.0)
    flight.await_state("out.mark", "running", 40.0)
    flight.wait(0.5)
    status = tool.reported("GIMBAL_MANAGER_STATUS")[-1]
    assert (status.primary_control_sysid, status.primary_control_compid) == (1, 191)
    assert tool.command(PITCH_YAW, 10.0, 0.0) is CommandResult.DENIED
    assert take(tool) is CommandResult.DENIED
    assert "the gimbal is claimed by out.mark; pause or abort it first" in refusals(flight)[-1]
    flight.await_state("out.mark", "done", 40.0)
    flight.wait(0.5)
    assert state(flight).owner == ""
    assert take(tool) is CommandResult.ACCEPTED


def test_pictures_of_the_camera_on_the_gimbal_have_its_attitude_and_show_the_ground(
    flight: Card, tmp_path: Path
) -> None:
    flight.begin(MISSION, is_started=False, platform=WITH_PICTURES, out=tmp_path)
    ready(flight)
    for pitch_deg in (-60.0, -10.0):
        assert flight.action("point_camera", pitch_deg=pitch_deg, yaw_deg=30.0).outcome == "accepted"
        flight.wait(2.5)
        reply = flight.action("shoot", camera="gimbal", every_s=1.0, count=1)
        assert reply.outcome == "accepted", reply.reason
        flight.expect("action_status/ground_recorder", lambda status: status.state == "done", 3.0)
        _, pitch, yaw = to_euler(flight.last("image_recorded").ned_from_frd)
        heading = degrees(to_euler(flight.flight.simulator.truth().attitude_wxyz)[2])
        assert (degrees(pitch), degrees(yaw)) == pytest.approx((pitch_deg, 30.0 + heading), abs=1.5)
    low, level = (cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) for file in sorted(tmp_path.rglob("gimbal-*.jpg")))
    assert low is not None
    assert level is not None
    assert np.abs(low.astype(float) - level.astype(float)).mean() > 5.0, "it has turned"


def test_two_actions_at_once_for_one_gimbal_are_a_finding_of_the_checker(flight: Card) -> None:
    twice = MISSION.replace("after: [down]}", "after: []}")
    with pytest.raises(Exception, match="gimbal"):
        flight.begin(twice.replace("keep: true}, after: [aside]", "keep: true}, after: [up]"), platform=PLATFORM)
