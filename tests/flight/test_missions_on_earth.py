"""DESIGN §6: in frame geo the fence is also given to the autopilot and read back before the mission starts."""

from math import dist
from pathlib import Path
from typing import Any

import pytest
from tests.data_folders import OWN
from tests.flight.card import ONE_STYLE, Card
from tests.flight.missions import mission

from gloc3.errors import Refused
from gloc3.messages.command_interface import Outcome, Steer, Verb
from gloc3.platform.reader import load_platform
from gloc3_sitl.flight.mission_file import read_mission_file

LATITUDE, LONGITUDE = 47.0, 8.0
EAST = 8.00008
"""Six metres east."""
MISSION = f"""mission: on Earth
frame: geo
geofence: {{polygon: [[46.9995, 7.9995], [47.0005, 7.9995], [47.0005, 8.0005], [46.9995, 8.0005]], ceiling_m: 20}}
on_failure: land
on_link_loss: continue
tasks:
  depart: {{actions: {{climb: {{take_off: {{height_m: 1.5}}}}}}}}
  sweep:
    after: [depart]
    actions:
      out: {{follow_waypoints: {{waypoints: [[{LATITUDE}, {LONGITUDE}, 2], [{LATITUDE}, {EAST}, 2]], speed_m_s: 1.0}}}}
  recover: {{after: [sweep], actions: {{down: {{land: {{}}}}}}}}
"""


def held_fence(flight: Card) -> list[Any]:
    """What the autopilot holds as its fence."""
    return list(flight.flight.simulator.autopilot.plans.fence)


def test_a_mission_on_earth_is_flown_with_its_fence_in_the_autopilot(flight: Card) -> None:
    flight.begin(MISSION)
    assert len(held_fence(flight)) == 4
    flight.await_state("mission", "done", 60.0)
    truth = flight.flight.simulator.truth()
    assert truth.longitude_deg == pytest.approx(EAST, abs=6e-6)
    assert truth.latitude_deg == pytest.approx(LATITUDE, abs=4e-6)


def test_a_mission_in_a_local_frame_has_its_fence_in_the_autopilot_too(flight: Card) -> None:
    fence = "{polygon_m: [[-2, -2], [12, -2], [12, 3], [-2, 3]], ceiling_m: 8, keep_out: [{circle_m: {center_m: [6, 2.5], radius_m: 0.4}}]}"
    flight.begin(mission(fence=fence), is_started=False)
    held = held_fence(flight)
    frame = flight.flight.platform.local_frames()["hold"]
    places = [frame.from_geo(item.latitude_deg, item.longitude_deg, frame.origin.altitude_m)[:2] for item in held]
    wanted = [(-2.0, -2.0), (12.0, -2.0), (12.0, 3.0), (-2.0, 3.0), (6.0, 2.5)]
    assert [dist(place, one) for place, one in zip(places, wanted, strict=True)] == pytest.approx([0.0] * 5, abs=0.02)
    assert flight.last("autopilot_fence").progress == "confirmed"


@ONE_STYLE
def test_a_vehicle_that_is_led_out_of_a_fence_in_a_local_frame_is_brought_back_by_its_autopilot(flight: Card) -> None:
    fence = "{polygon_m: [[-2, -2], [12, -2], [12, 3], [-2, 3]], ceiling_m: 8}"
    flight.begin(mission(fence=fence), parameters={"GF_ACTION": 3})
    flight.await_state("sweep.out", "running")
    flight.fault("pilot:position")
    simulator = flight.flight.simulator
    simulator.pilot.sticks(pitch=-1.0)
    flight.until(lambda: flight.position_m[0] > 11.5, 30.0, "it is near the fence")
    simulator.pilot.sticks()
    flight.until(lambda: any("outside the fence" in text for _, _, text in simulator.texts), 5.0, "the fence")
    flight.always(lambda: flight.position_m[0] < 22.0, 15.0, "it does not go on")
    flight.await_landed(60.0)
    assert dist(flight.position_m[:2], (0.0, 0.0)) < 1.0


def test_without_the_fence_in_the_autopilot_no_mission_on_earth_starts(flight: Card) -> None:
    with pytest.raises(Refused, match="the autopilot does not hold the mission's fence"):
        flight.begin(MISSION, faults=["topic:motion/geofence=lost"])
    assert not held_fence(flight)


def test_a_plan_of_qgroundcontrol_with_a_fence_is_checked_uploaded_and_flown_to_its_end(
    flight: Card, tmp_path: Path
) -> None:
    plan = OWN / "missions" / "box_and_return_in_a_fence.plan"
    mission = read_mission_file(plan, load_platform("pelican_rtk"), tmp_path)
    flight.begin(mission.file, platform="pelican_rtk", home=mission.home, is_started=False)
    assert len(held_fence(flight)) == 5
    assert "its own return" in flight.refused_steer("start"), "straight home leads through the plan's keep-out area"
    override = Steer(verb=Verb.START, override="the return is watched by a pilot", author="a test")
    assert flight.request(override).outcome is Outcome.ACCEPTED
    flight.await_state("mission", "done", 120.0)
    truth = flight.flight.truth.samples[-1]
    assert dist(truth.position_ned_m[:2], (0.0, 0.0)) < 0.5
    assert not flight.was_told("fence breached")
    fence = flight.flight.mission.fence
    assert fence is not None
    assert fence.clearance_m((0.0, 0.0, 0.0)) == pytest.approx(9.0, abs=0.1), "it is drawn where it is"


ARDUPILOT = pytest.mark.parametrize("style", ["ardupilot"], indirect=True)


def is_fence_on(flight: Card) -> bool:
    """Whether the autopilot keeps its fence."""
    autopilot = flight.flight.simulator.autopilot
    return autopilot.commander.fence.is_kept(autopilot.craft)


@ARDUPILOT
def test_ardupilot_s_fence_is_switched_on_with_the_mission_and_again_on_the_ground_but_not_in_flight(
    flight: Card,
) -> None:
    flight.begin(MISSION, is_started=False)
    assert is_fence_on(flight)
    parameters = flight.flight.simulator.autopilot.parameters
    assert parameters["FENCE_ENABLE"] == 0, "what is set for good is left alone"
    parameters.set("FENCE_ENABLE", 0)  # as after a restart
    assert not is_fence_on(flight)
    flight.until(lambda: is_fence_on(flight), 8.0, "the fence is on again")
    flight.until(lambda: flight.last("autopilot_fence").progress == "confirmed", 2.0, "which is told")
    flight.command("start")
    flight.await_state("sweep.out", "running", 20.0)
    parameters.set("FENCE_ENABLE", 0)  # by a pilot
    flight.await_state("mission", "done", 60.0)
    assert not is_fence_on(flight)
    assert len(held_fence(flight)) == 4


@ARDUPILOT
@pytest.mark.parametrize(
    ("parameters", "reason"),
    [
        ({"FENCE_TYPE": 0}, "the autopilot does not hold the mission's fence: failed"),
        ({"FENCE_ACTION": 0}, "the autopilot does not hold the mission's fence: its fence is switched off"),
    ],
)
def test_a_fence_that_cannot_be_switched_on_keeps_the_mission_from_being_loaded(
    flight: Card, parameters: dict[str, float], reason: str
) -> None:
    with pytest.raises(Refused, match=reason):
        flight.begin(MISSION, parameters=parameters)


@pytest.mark.parametrize("style", ["px4"], indirect=True)
@pytest.mark.parametrize(
    ("parameters", "reason"),
    [
        ({"GF_ACTION": 1}, "GF_ACTION 1"),
        ({"GF_MAX_HOR_DIST": 5}, "6.1 m away from home, with a margin of 0.86 m; the autopilot's limit is 5 m"),
    ],
)
def test_a_px4_whose_fence_does_not_act_or_is_nearer_than_the_mission_does_not_start(
    flight: Card, parameters: dict[str, float], reason: str
) -> None:
    flight.begin(MISSION, is_started=False, parameters=parameters)
    assert reason in flight.refused_steer("start")


@pytest.mark.both_styles
def test_an_onboard_process_that_comes_late_flies_a_mission_on_earth(flight: Card) -> None:
    flight.begin(MISSION, is_started=False)
    flight.fault("restart", for_s=5.0)
    flight.wait(15.0)
    assert flight.last("pose").origin_geo is not None
    flight.run(flight.flight.upload_and_start())
    flight.await_state("mission", "done", 60.0)
    truth = flight.flight.simulator.truth()
    assert truth.longitude_deg == pytest.approx(EAST, abs=6e-6)
