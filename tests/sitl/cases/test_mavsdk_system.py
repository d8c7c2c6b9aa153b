"""The cases of MAVSDK's own system tests that apply to a vehicle, with mavsdk 4 as the client of the simulated one.

There MAVSDK talks to itself; here its client side talks to `gloc3 sitl`, on a link that loses one datagram in ten where the
case says so.
"""

import socket
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from mavsdk import ComponentType, Configuration, ConnectionResult, Mavsdk
from mavsdk.plugins.ftp import Ftp
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkMessage
from mavsdk.plugins.mission_raw import MissionItem
from mavsdk.plugins.param import Param
from tests.sitl.mavsdk_client import Client, client_at, item, outcome, simulated_vehicle
from tests.sitl.relay import relay

from gloc3.mavlink.codec import Encoder, Parser, message
from gloc3.mavlink.message import Address

pytestmark = [pytest.mark.sockets, pytest.mark.flight]

WAYPOINT, TAKE_OFF = 16, 22
LOSS = 0.1
BIG = bytes(range(256)) * 200


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    with simulated_vehicle(speed=10.0) as port:
        yield port


@pytest.fixture(scope="module")
def client(port: int) -> Iterator[Client]:
    with client_at(port) as client:
        client.await_armable()
        yield client


@pytest.fixture(scope="module")
def lossy(port: int) -> Iterator[Client]:
    with relay(port, loss=LOSS, seed=3) as link, client_at(link.port) as client:
        yield client


@pytest.fixture(params=["clean", "lossy"])
def either(request: pytest.FixtureRequest) -> Client:
    name = "client" if request.param == "clean" else "lossy"
    found: Client = request.getfixturevalue(name)
    return found


# -- action, telemetry --------------------------------------------------------------------------------------------------


def test_action_arm_disarm(client: Client) -> None:
    client.action.arm()
    client.await_telemetry("armed", bool)
    client.action.disarm()
    client.await_disarmed()


def test_telemetry_subscription_and_its_end(client: Client) -> None:
    reported: list[Any] = []
    handle = client.telemetry.subscribe_position(lambda value, _: reported.append(value))
    client.await_telemetry("position", lambda _: len(reported) > 3)
    client.telemetry.unsubscribe_position(handle)
    client.await_telemetry("heading", lambda _: True)
    count = len(reported)
    client.await_telemetry("velocity_ned", lambda _: True)
    assert len(reported) <= count + 1


def test_telemetry_altitude_and_ground_truth_carry_growing_times(client: Client) -> None:
    for kind in ("altitude", "ground_truth"):
        getattr(client.telemetry, f"set_rate_{kind}")(10.0)
        times: list[int] = []
        handle = getattr(client.telemetry, f"subscribe_{kind}")(lambda value, _: times.append(value.timestamp_us))  # noqa: B023
        client.await_telemetry(kind, lambda _: len(times) > 3)  # noqa: B023
        getattr(client.telemetry, f"unsubscribe_{kind}")(handle)
        assert 0 < times[0] < times[-1]


def test_telemetry_home_position_has_all_its_fields(client: Client) -> None:
    home = client.await_telemetry("home", lambda home: home.timestamp_us > 0)
    assert abs(home.local_down_m) < 1.0
    assert home.q.w**2 + home.q.z**2 == pytest.approx(1.0, abs=1e-3)


# -- parameters ---------------------------------------------------------------------------------------------------------


def test_param_set_and_get(either: Client) -> None:
    param = either.plugin(Param)
    for value in (1, 2, 0):
        param.set_param_int("NAV_DLL_ACT", value)
        assert param.get_param_int("NAV_DLL_ACT") == value
    for real in (12.5, 30.0):
        param.set_param_float("RTL_RETURN_ALT", real)
        assert param.get_param_float("RTL_RETURN_ALT") == real


def test_param_get_all(either: Client) -> None:
    everything = either.plugin(Param).get_all_params()
    names = {row.name for row in (*everything.int_params, *everything.float_params)}
    assert {"NAV_DLL_ACT", "RTL_RETURN_ALT", "SYS_FAILURE_EN"} <= names
    assert len(names) > 85


def test_a_change_by_one_client_is_told_to_the_other(port: int, client: Client) -> None:
    with client_at(port) as other:
        there, here = other.plugin(Param), client.plugin(Param)
        assert here.get_param_float("RTL_LAND_DELAY") == 0.0
        there.set_param_float("RTL_LAND_DELAY", 2.5)
        assert here.get_param_float("RTL_LAND_DELAY") == 2.5
        there.set_param_float("RTL_LAND_DELAY", 0.0)


def test_custom_parameters_are_not_declared(client: Client) -> None:
    assert outcome(client.plugin(Param).get_param_custom, "NAV_DLL_ACT") == "TIMEOUT"


# -- missions -----------------------------------------------------------------------------------------------------------


def long_mission(count: int) -> list[MissionItem]:
    return [item(number, WAYPOINT if number else TAKE_OFF, north_m=float(number % 30)) for number in range(count)]


def places(items: list[MissionItem]) -> list[tuple[int, int, int, float]]:
    return [(row.command, row.x, row.y, row.z) for row in items]


def test_mission_raw_upload_and_transfer_lossy(either: Client) -> None:
    items = long_mission(30)
    either.mission.upload_mission(items)
    assert places(either.mission.download_mission()) == places(items)


def test_mission_raw_upload_empty(client: Client) -> None:
    assert outcome(client.mission.upload_mission, []) == "NO_MISSION_AVAILABLE"


def test_mission_changed_is_told(port: int, client: Client) -> None:
    reported: list[bool] = []
    handle = client.mission.subscribe_mission_changed(lambda changed, _: reported.append(changed))
    client.mission.upload_mission(long_mission(2))
    client.await_telemetry("position", lambda _: bool(reported))
    client.mission.unsubscribe_mission_changed(handle)


def test_a_cancelled_upload_leaves_the_old_mission_and_a_new_one_works(port: int, client: Client) -> None:
    client.mission.upload_mission(long_mission(3))
    with relay(port, delay_s=0.02) as link, client_at(link.port) as slow:
        reported: list[Any] = []
        slow.mission.upload_mission_async(long_mission(200), lambda *values: reported.append(values))
        time.sleep(0.3)
        slow.mission.cancel_mission_upload()
        slow.await_telemetry("position", lambda _: bool(reported))
        assert reported[-1][0].name == "TRANSFER_CANCELLED"
        assert len(slow.mission.download_mission()) == 3
        slow.mission.upload_mission(long_mission(4))
        assert len(client.mission.download_mission()) == 4


def test_a_cancelled_download(port: int, client: Client) -> None:
    client.mission.upload_mission(long_mission(200))
    with relay(port, delay_s=0.02) as link, client_at(link.port) as slow:
        reported: list[Any] = []
        slow.mission.download_mission_async(lambda *values: reported.append(values))
        time.sleep(0.3)
        slow.mission.cancel_mission_download()
        slow.await_telemetry("position", lambda _: bool(reported))
        assert reported[-1][0].name == "TRANSFER_CANCELLED"
    # what is asked for twice and comes twice, MAVSDK counts twice
    assert {one.seq for one in client.mission.download_mission()} == set(range(200))


# -- files --------------------------------------------------------------------------------------------------------------


def fresh(client: Client, *names: str) -> Ftp:
    """The files plugin, with a folder of these files and nothing else."""
    files = client.plugin(Ftp)
    if outcome(files.create_directory, "/case") != "SUCCESS":
        for entry in files.list_directory("/case").entries:
            files.remove_file(f"/case/{entry.name}")
    del names
    return files


def put(client: Client, files: Ftp, tmp_path: Path, name: str, data: bytes) -> Path:
    source = tmp_path / name
    source.write_bytes(data)
    assert client.reported(files.upload_async, str(source), "/case", within_s=60.0)[-1][0].name == "SUCCESS"
    return source


def check_big_file(client: Client, tmp_path: Path, data: bytes) -> None:
    """Up, compared, and down both ways."""
    files = fresh(client)
    source = put(client, files, tmp_path, "big.bin", data)
    assert files.are_files_identical(str(source), "/case/big.bin")
    for is_burst in (False, True):
        folder = tmp_path / str(is_burst)
        folder.mkdir()
        rows = client.reported(files.download_async, "/case/big.bin", str(folder), is_burst, within_s=60.0)
        assert rows[-1][0].name == "SUCCESS"
        assert (folder / "big.bin").read_bytes() == data


def test_ftp_upload_and_download_of_a_big_file(client: Client, tmp_path: Path) -> None:
    check_big_file(client, tmp_path, BIG)


def test_ftp_compare_files(client: Client, tmp_path: Path) -> None:
    files = fresh(client)
    put(client, files, tmp_path, "a.txt", b"one")
    other = tmp_path / "b.txt"
    other.write_bytes(b"two")
    assert not files.are_files_identical(str(other), "/case/a.txt")


def test_ftp_list_create_rename_remove_and_their_refusals(client: Client, tmp_path: Path) -> None:
    files = fresh(client)
    for number in range(30):
        put(client, files, tmp_path, f"file_{number:02d}.txt", b"x" * number)
    assert len(files.list_directory("/case").entries) == 30
    files.create_directory("/case/inner")
    assert [entry.name for entry in files.list_directory("/case").entries].count("inner") == 1
    assert outcome(files.create_directory, "/case/inner") == "FILE_EXISTS"
    files.remove_directory("/case/inner")
    files.rename("/case/file_00.txt", "/case/renamed.txt")
    assert outcome(files.rename, "/case/file_00.txt", "/case/again.txt") == "FILE_DOES_NOT_EXIST"
    assert outcome(files.rename, "/case/file_01.txt", "/case/renamed.txt") == "FILE_EXISTS"
    assert outcome(files.remove_directory, "/case") != "SUCCESS"
    assert outcome(files.remove_file, "/case/never.txt") == "FILE_DOES_NOT_EXIST"


def test_ftp_stays_inside_its_tree(client: Client, tmp_path: Path) -> None:
    files = fresh(client)
    for path in ("/../secret", "../secret"):
        assert outcome(files.remove_file, path) != "SUCCESS"
        assert client.reported(files.download_async, path, str(tmp_path), False)[-1][0].name != "SUCCESS"
    source = tmp_path / "a.txt"
    source.write_bytes(b"x")
    assert client.reported(files.upload_async, str(source), "/../outside")[-1][0].name != "SUCCESS"


# -- the link -----------------------------------------------------------------------------------------------------------


def test_mavlink_direct_both_ways(client: Client) -> None:
    direct = client.plugin(MavlinkDirect)
    reported: list[Any] = []
    handle = direct.subscribe_message("COMMAND_ACK", lambda received, _: reported.append(received))
    fields = '{"command":512,"param1":148,"param2":0,"param3":0,"param4":0,"param5":0,"param6":0,"param7":0,"confirmation":0}'
    direct.send_message(
        MavlinkMessage(
            message_name="COMMAND_LONG",
            system_id=245,
            component_id=190,
            target_system_id=1,
            target_component_id=1,
            fields_json=fields,
        )
    )
    client.await_telemetry("position", lambda _: bool(reported))
    assert '"result":0' in reported[0].fields_json.replace(" ", "")
    direct.unsubscribe_message(handle)


def test_messages_are_requested_rapidly_and_all_answered(client: Client) -> None:
    for _ in range(50):
        assert client.telemetry.get_gps_global_origin().latitude_deg == pytest.approx(47.3977, abs=1e-4)


def test_a_client_that_comes_back_is_served(port: int) -> None:
    for _ in range(3):
        with client_at(port) as client:
            client.await_telemetry("position", lambda _: True)


def test_a_link_that_was_cut_comes_back_by_itself(port: int) -> None:
    with relay(port) as link, client_at(link.port) as client:
        client.await_telemetry("position", lambda _: True)
        link.is_cut = True
        deadline = time.monotonic() + 15.0
        while client.system.is_connected():
            assert time.monotonic() < deadline
            time.sleep(0.05)
        link.is_cut = False
        client.await_telemetry("position", lambda _: bool(client.system.is_connected()))


def test_the_vehicles_frames_are_in_sequence(port: int) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.settimeout(5.0)
        encoder, parser = Encoder(250, 190), Parser(is_datagram=True)
        end.sendto(encoder.encode(message("HEARTBEAT", type=6, autopilot=8)), ("127.0.0.1", port))
        seen: list[int] = []
        while len(seen) < 300:
            frames = parser.receive(end.recv(2048))
            seen += [frame.sequence for frame in frames if frame.sender == Address(1, 1)]
    assert all((then + 1) % 256 == now for then, now in pairwise(seen))


def test_raw_bytes_are_a_link_like_any_other(port: int) -> None:
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.settimeout(2.0)
        end.connect(("127.0.0.1", port))
        assert mavsdk.add_any_connection("raw://") == ConnectionResult.SUCCESS
        handle = mavsdk.subscribe_raw_bytes_to_be_sent(lambda data, *_: end.send(data))
        end.send(Encoder(249, 190).encode(message("HEARTBEAT", type=6, autopilot=8)))
        deadline = time.monotonic() + 15.0
        while mavsdk.system_count() == 0 and time.monotonic() < deadline:
            mavsdk.pass_received_raw_bytes(end.recv(2048))
        assert mavsdk.system_count() >= 1
        mavsdk.unsubscribe_raw_bytes_to_be_sent(handle)
    mavsdk.destroy()
