"""Other programs' stations and the vehicle's cameras, by MAVLink's camera protocol alone."""

import pytest
from tests.flight.card import ONE_STYLE, Card
from tests.flight.tool import GEO_HOP, Tool

from gloc3.mavlink.codec import MavlinkMessage
from gloc3.mavlink.message import Address
from gloc3.mavlink.services.command import CommandResult
from gloc3.messages.command_interface import Control, ControlVerb, Outcome

pytestmark = [ONE_STYLE]

CAMERA = Address(1, 100)
REQUEST, START, STOP, AGAIN, MODE = 512, 2000, 2001, 2002, 530
PICTURES = """
mission: pictures on Earth
frame: geo
tasks:
  hop:
    actions:
      up: {take_off: {height_m: 3}}
      over: {follow_waypoints: {waypoints: [[39.5528, 2.6285, 3], [39.5530, 2.6285, 3]], speed_m_s: 2}, after: [up]}
      photos: {record_images: {camera: ground, every_s: 1}, after: [up], until: over}
      down: {land: {}, after: [over]}
"""


def begun(flight: Card, mission: str = PICTURES) -> Tool:
    """A station of others beside one of ours, which has given up control."""
    flight.begin(mission, is_started=False)
    assert flight.request(Control(verb=ControlVerb.RELEASE)).outcome is Outcome.ACCEPTED
    flight.wait(1.1)
    return Tool(flight)


def requested(tool: Tool, name: str, number: int) -> MavlinkMessage:
    """A message that the camera sends on request."""
    tool.received.clear()
    assert tool.command(REQUEST, float(number), target=CAMERA) is CommandResult.ACCEPTED
    tool.until(lambda: bool(tool.reported(name)), 2.0, name)
    (found,) = tool.reported(name)
    return found


def reasons(flight: Card) -> list[str]:
    return [event.payload.text for event in flight.received.get("components/companion/event", [])]


def test_a_camera_says_what_it_is_and_beats_once_a_second(flight: Card) -> None:
    tool = begun(flight)
    tool.senders.clear()
    flight.wait(5.0)
    assert tool.senders.count((100, "HEARTBEAT")) == 5
    assert not [sender for sender in tool.senders if sender[0] in range(101, 106)], "there is one camera"
    information = requested(tool, "CAMERA_INFORMATION", 259)
    assert bytes(information.model_name).rstrip(b"\0") == b"ground"
    assert (information.resolution_h, information.resolution_v, information.flags) == (640, 480, 2)
    assert requested(tool, "CAMERA_SETTINGS", 260).mode_id == 0
    assert requested(tool, "STORAGE_INFORMATION", 261).storage_count == 1
    status = requested(tool, "CAMERA_CAPTURE_STATUS", 262)
    assert (status.image_status, status.image_count) == (0, 0)
    for command, name in ((521, "CAMERA_INFORMATION"), (522, "CAMERA_SETTINGS"), (527, "CAMERA_CAPTURE_STATUS")):
        tool.received.clear()
        assert tool.command(command, 1.0, target=CAMERA) is CommandResult.ACCEPTED
        tool.until(lambda name=name: bool(tool.reported(name)), 2.0, name)  # type: ignore[misc]
    assert tool.command(REQUEST, 269.0, target=CAMERA) is not CommandResult.ACCEPTED, "it has no stream"
    assert tool.command(MODE, 0.0, 0.0, target=CAMERA) is CommandResult.ACCEPTED
    assert tool.command(MODE, 0.0, 1.0, target=CAMERA) is CommandResult.DENIED


def test_one_picture_and_pictures_at_an_interval_until_they_are_stopped(flight: Card) -> None:
    tool = begun(flight)
    assert tool.command(START, 0.0, 0.0, 1.0, 1.0, target=CAMERA) is CommandResult.ACCEPTED
    tool.until(lambda: bool(tool.reported("CAMERA_IMAGE_CAPTURED")), 5.0, "the picture")
    (first,) = tool.reported("CAMERA_IMAGE_CAPTURED")
    assert (first.image_index, first.capture_result, first.file_url) == (1, 1, "ground-00001.jpg")
    assert first.lat == pytest.approx(395528000, abs=100)
    assert first.lon == pytest.approx(26285000, abs=100)
    assert first.q[2] == pytest.approx(-0.7071, abs=0.02), "it looks down"
    assert first.time_utc > 1_700_000_000_000_000
    flight.wait(1.0)
    assert requested(tool, "CAMERA_CAPTURE_STATUS", 262).image_status == 0

    assert tool.command(START, 0.0, 0.5, 0.0, target=CAMERA) is CommandResult.ACCEPTED, reasons(flight)
    flight.wait(3.0)
    status = requested(tool, "CAMERA_CAPTURE_STATUS", 262)
    assert (status.image_status, status.image_interval) == (2, 0.5)
    assert tool.command(START, 0.0, 1.0, 0.0, target=CAMERA) is CommandResult.DENIED
    assert "are being taken; stop them first" in reasons(flight)[-1]
    assert Tool(flight, system=249).command(STOP, target=CAMERA) is CommandResult.DENIED
    assert "refused: station 250 holds control" in reasons(flight)[-1]
    assert tool.command(STOP, target=CAMERA) is CommandResult.ACCEPTED
    flight.wait(1.0)
    count = requested(tool, "CAMERA_CAPTURE_STATUS", 262).image_count
    assert 6 <= count <= 9
    tool.received.clear()
    assert tool.command(AGAIN, 2.0, target=CAMERA) is CommandResult.ACCEPTED
    tool.until(lambda: bool(tool.reported("CAMERA_IMAGE_CAPTURED")), 2.0, "the second again")
    assert tool.reported("CAMERA_IMAGE_CAPTURED")[0].image_index == 2
    assert tool.command(AGAIN, 200.0, target=CAMERA) is CommandResult.DENIED
    assert tool.command(STOP, target=CAMERA) is CommandResult.DENIED


@pytest.mark.parametrize("params", [(0.0, 0.0, 0.0), (0.0, -1.0, 1.0), (0.0, float("nan"), 1.0), (0.0, 1.0, 1.5)])
def test_an_impossible_order_is_denied_with_the_reason(flight: Card, params: tuple[float, ...]) -> None:
    tool = begun(flight)
    assert tool.command(START, *params, target=CAMERA) is CommandResult.DENIED
    assert "IMAGE_START_CAPTURE of station 250 to camera ground refused" in reasons(flight)[-1]
    assert tool.command(2500, target=CAMERA) is CommandResult.UNSUPPORTED


def test_pictures_of_a_mission_are_reported_and_not_stopped_by_a_station(flight: Card) -> None:
    tool = begun(flight)
    assert tool.command(300) is CommandResult.ACCEPTED
    flight.await_state("hop.photos", "running", 30.0)
    tool.until(lambda: len(tool.reported("CAMERA_IMAGE_CAPTURED")) >= 2, 10.0, "two pictures")
    assert tool.command(STOP, target=CAMERA) is CommandResult.DENIED
    assert "those of a mission end with it" in reasons(flight)[-1]
    assert tool.reported("CAMERA_IMAGE_CAPTURED")[-1].relative_alt == pytest.approx(3000, abs=400)


def test_a_mission_without_a_camera_has_a_camera_all_the_same(flight: Card) -> None:
    tool = begun(flight, GEO_HOP)
    assert bytes(requested(tool, "CAMERA_INFORMATION", 259).vendor_name).rstrip(b"\0") == b"GLOC3"
