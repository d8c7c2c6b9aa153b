"""mavsdk 4 as the client, unmodified, over UDP: the whole list in PX4's style, and a refusal of each kind."""

from pathlib import Path

import pytest
from mavsdk.plugins.action import ActionError, ActionResult
from mavsdk.plugins.ftp import Ftp
from mavsdk.plugins.log_files import LogFiles
from mavsdk.plugins.mission_raw import MissionRawError, MissionRawResult
from mavsdk.plugins.offboard import Offboard, OffboardError, PositionNedYaw
from mavsdk.plugins.param import Param, ParamError
from pyulog import ULog
from tests.sitl.mavsdk_client import ALTITUDE_M, LONGITUDE_DEG, client_of, degrees_north, item

pytestmark = [pytest.mark.sockets, pytest.mark.flight]

WAYPOINT, RETURN, LAND, TAKE_OFF = 16, 20, 21, 22


def test_it_connects_arms_takes_off_goes_to_a_place_and_lands() -> None:
    with client_of() as client:
        client.await_armable()
        client.action.arm()
        client.await_telemetry("armed", bool)
        client.action.set_takeoff_altitude(3.0)
        client.action.takeoff()
        client.await_height(2.7)
        client.await_mode("HOLD")
        client.action.goto_location(degrees_north(8.0), LONGITUDE_DEG, ALTITUDE_M + 4.0, 90.0)
        client.await_near(8.0, 0.0)
        client.action.land()
        client.await_telemetry("landed_state", lambda state: bool(state.name == "ON_GROUND"))
        client.await_disarmed()


def test_it_flies_an_uploaded_mission_and_reads_it_back() -> None:
    items = [
        item(0, TAKE_OFF),
        item(1, WAYPOINT, north_m=6.0, param2=0.5),
        item(2, WAYPOINT, north_m=6.0, height_m=5.0, param1=1.0),
        item(3, LAND, north_m=0.0, height_m=0.0),
    ]
    with client_of() as client:
        client.await_armable()
        client.mission.upload_mission(items)
        read = client.mission.download_mission()
        assert [(row.command, row.x, row.y, row.z) for row in read] == [
            (row.command, row.x, row.y, row.z) for row in items
        ]
        client.action.arm()
        client.mission.start_mission()
        client.await_near(6.0, 0.0)
        client.await_height(4.5)
        client.await_disarmed()


def test_it_returns_home() -> None:
    with client_of("--param", "RTL_RETURN_ALT=5") as client:
        client.await_armable()
        client.action.arm()
        client.action.takeoff()
        client.await_mode("HOLD")
        client.action.goto_location(degrees_north(12.0), LONGITUDE_DEG, ALTITUDE_M + 3.0, 0.0)
        client.await_near(12.0, 0.0)
        client.action.return_to_launch()
        client.await_mode("RETURN_TO_LAUNCH")
        client.await_disarmed()
        client.await_near(0.0, 0.0)


def test_arming_while_unhealthy_is_denied() -> None:
    with client_of("--param", "EKF2_GPS_CTRL=0") as client:
        with pytest.raises(ActionError) as denied:
            client.action.arm()
        assert denied.value.result is ActionResult.COMMAND_DENIED


def test_take_off_while_disarmed_is_denied() -> None:
    with client_of() as client:
        client.await_armable()
        with pytest.raises(ActionError) as denied:
            client.action.takeoff()
        assert denied.value.result is ActionResult.COMMAND_DENIED


def test_a_mission_with_an_item_that_nobody_knows_is_unsupported_and_leaves_the_old_one() -> None:
    good = [item(0, TAKE_OFF), item(1, WAYPOINT, north_m=3.0)]
    bad = [item(0, TAKE_OFF), item(1, 31999)]
    with client_of() as client:
        client.await_armable()
        client.mission.upload_mission(good)
        with pytest.raises(MissionRawError) as refused:
            client.mission.upload_mission(bad)
        assert refused.value.result is MissionRawResult.UNSUPPORTED
        assert len(client.mission.download_mission()) == 2


def test_a_mission_with_a_place_that_is_not_on_earth_is_refused() -> None:
    bad = [item(0, TAKE_OFF), item(1, WAYPOINT, x=910_000_000)]
    with client_of() as client:
        client.await_armable()
        with pytest.raises(MissionRawError) as refused:
            client.mission.upload_mission(bad)
        assert refused.value.result is MissionRawResult.INVALID_ARGUMENT


def test_it_reads_and_sets_parameters_and_is_told_when_a_value_is_refused() -> None:
    with client_of() as client:
        plugin = Param(client.system)
        try:
            everything = plugin.get_all_params()
            assert len(everything.int_params) + len(everything.float_params) > 60
            plugin.set_param_int("NAV_DLL_ACT", 2)
            assert plugin.get_param_int("NAV_DLL_ACT") == 2
            plugin.set_param_float("RTL_RETURN_ALT", 7.5)
            assert plugin.get_param_float("RTL_RETURN_ALT") == 7.5
            with pytest.raises(ParamError):
                plugin.set_param_int("NAV_DLL_ACT", 77)
        finally:
            plugin.destroy()


def test_it_flies_offboard_and_fetches_the_log_of_the_flight(tmp_path: Path) -> None:
    with client_of() as client:
        offboard, logs, files = Offboard(client.system), LogFiles(client.system), Ftp(client.system)
        try:
            client.await_armable()
            client.action.arm()
            client.action.takeoff()
            client.await_mode("HOLD")
            with pytest.raises(OffboardError):
                offboard.start()
            offboard.set_position_ned(PositionNedYaw(4.0, 0.0, -3.0, 0.0))
            client.start_offboard(offboard)
            client.await_near(4.0, 0.0)
            offboard.stop()
            client.await_mode("HOLD")
            client.action.land()
            client.await_disarmed()
            entry = logs.get_entries()[0]
            assert [file.name for file in files.list_directory("/fs/microsd/log").entries] == ["flight_001.ulg"]
            client.download(logs, entry, tmp_path / "flight.ulg")
            assert len(ULog(str(tmp_path / "flight.ulg")).get_dataset("vehicle_local_position").data["x"]) > 50
        finally:
            for plugin in (offboard, logs, files):
                plugin.destroy()
