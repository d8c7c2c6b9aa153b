"""mavsdk 4 as the client, unmodified, over UDP: the core of a flight in ArduPilot's style."""

import pytest
from mavsdk.plugins.action import ActionError, ActionResult
from mavsdk.plugins.mission_raw import MissionRawError, MissionRawResult
from tests.sitl.mavsdk_client import ALTITUDE_M, LONGITUDE_DEG, client_of, degrees_north, item

pytestmark = [pytest.mark.sockets, pytest.mark.flight]

STREAMS = (
    "--autopilot",
    "ardupilot",
    "--param",
    "MAV1_EXT_STAT=2",
    "--param",
    "MAV1_POSITION=5",
    "--param",
    "MAV1_EXTRA3=2",
)
WAYPOINT, RETURN, TAKE_OFF = 16, 20, 22


def test_it_connects_arms_in_guided_takes_off_goes_to_a_place_and_lands() -> None:
    with client_of(*STREAMS) as client:
        client.await_armable()
        client.action.arm()
        client.action.set_takeoff_altitude(3.0)
        client.action.takeoff()
        client.await_mode("OFFBOARD")
        client.await_height(2.7)
        client.action.goto_location(degrees_north(8.0), LONGITUDE_DEG, ALTITUDE_M + 4.0, 90.0)
        client.await_near(8.0, 0.0)
        client.action.land()
        client.await_mode("LAND")
        client.await_disarmed()


def test_it_flies_an_uploaded_mission_with_home_as_its_first_item() -> None:
    items = [
        item(0, WAYPOINT, height_m=0.0, frame=0),
        item(1, TAKE_OFF),
        item(2, WAYPOINT, north_m=6.0, height_m=4.0, param1=1.0),
        item(3, RETURN),
    ]
    with client_of(*STREAMS, "--param", "RTL_ALT_M=4", "--param", "RTL_LOIT_TIME=0") as client:
        client.await_armable()
        client.mission.upload_mission(items)
        assert abs(client.mission.download_mission()[0].x - round(degrees_north(0.0) * 1e7)) < 100
        client.action.arm()
        client.mission.start_mission()
        client.await_near(6.0, 0.0)
        client.await_disarmed()


def test_take_off_while_disarmed_fails() -> None:
    with client_of(*STREAMS) as client:
        client.await_armable()
        with pytest.raises(ActionError) as denied:
            client.action.takeoff()
        assert denied.value.result is ActionResult.FAILED


def test_arming_before_there_is_a_position_fails() -> None:
    with client_of(*STREAMS, "--param", "EK3_SRC1_POSXY=0", "--param", "EK3_SRC1_VELXY=0") as client:
        with pytest.raises(ActionError) as denied:
            client.action.arm()
        assert denied.value.result is ActionResult.FAILED


def test_a_mission_with_an_item_that_nobody_knows_is_unsupported() -> None:
    with client_of(*STREAMS) as client:
        with pytest.raises(MissionRawError) as refused:
            client.mission.upload_mission([item(0, WAYPOINT, height_m=0.0), item(1, 31999)])
        assert refused.value.result is MissionRawResult.UNSUPPORTED
