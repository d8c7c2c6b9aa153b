"""mavsdk 4 as the client, unmodified, through our router: to the autopilot and to the onboard computer at once."""

import json
import queue
import time
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import pytest
from mavsdk.plugins.component_metadata import ComponentMetadata, MetadataType
from mavsdk.plugins.ftp import Ftp
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkMessage
from mavsdk.plugins.mission_raw import MissionItem, MissionRaw, MissionRawError, MissionRawResult
from mavsdk.plugins.param import Param, ParamError, ParamResult, ProtocolVersion
from mavsdk.plugins.telemetry import Telemetry
from tests.onboard.onboard_scene import LATITUDE_DEG, LONGITUDE_DEG, vehicle
from tests.sitl.mavsdk_client import Client

pytestmark = [pytest.mark.sockets, pytest.mark.flight]

COMPANION = 191
LAND, START, ABORT = 21, 300, 31010
ACCEPTED, DENIED = 0, 2
AUTOPILOTS = ("BAT_", "COM_", "EKF2_", "GF_", "MIS_", "MPC_", "NAV_", "RTL_")
"""How names of parameters begin that are the autopilot's."""


def item(seq: int, command: int, north_m: float = 0.0, height_m: float = 3.0) -> MissionItem:
    return MissionItem(
        seq=seq,
        frame=6,
        command=command,
        current=int(seq == 0),
        autocontinue=1,
        param4=float("nan"),
        x=round((LATITUDE_DEG + north_m / 111_180.0) * 1e7) if command != 21 else 0,
        y=round(LONGITUDE_DEG * 1e7) if command != 21 else 0,
        z=height_m if command != 21 else 0.0,
    )


PLAN = [item(0, 22), item(1, 16, 3.0), item(2, 16), item(3, 21)]


def listed(of_companion: Param) -> set[str]:
    """The names of the onboard computer's parameters.

    While it makes its list, MAVSDK counts in what another component answers to somebody else. The onboard process asks
    the autopilot for some of its parameters for as long as there are failsafes to compare.
    """
    for _ in range(10):
        names = {one.name for one in of_companion.get_all_params().float_params}
        if not any(name.startswith(AUTOPILOTS) for name in names):
            break
        time.sleep(1.0)
    return names


def upload_when_ready(raw: MissionRaw, plan: list[MissionItem]) -> None:
    """Uploads a plan, again while the onboard computer does not know its vehicle well enough to take one."""
    for _ in range(60):
        try:
            raw.upload_mission(plan)
        except MissionRawError as error:
            if error.result is not MissionRawResult.DENIED:
                raise
            time.sleep(0.5)
        else:
            return
    raw.upload_mission(plan)


def command(direct: MavlinkDirect, number: int, *params: float, component: int = COMPANION) -> int:
    """Sends a command; its result."""
    fields: dict[str, Any] = {f"param{index}": value for index, value in enumerate(params, start=1)}
    fields |= {"target_system": 1, "target_component": component, "command": number, "confirmation": 0}
    answer = direct.send_command(
        MavlinkMessage(
            "COMMAND_LONG", 245, 190, 1, component, json.dumps({**{f"param{n}": 0 for n in range(1, 8)}, **fields})
        )
    )
    return int(json.loads(answer.fields_json)["result"])


def finished(begin: Callable[..., Any]) -> str:
    """Waits for the end of a transfer; the name of its result."""
    reported: queue.SimpleQueue[str] = queue.SimpleQueue()
    begin(lambda result, *_: reported.put(result.name))
    while (name := reported.get(timeout=60.0)) == "NEXT":
        pass
    return name


def messages(direct: MavlinkDirect, name: str) -> queue.SimpleQueue[tuple[int, dict[str, Any]]]:
    """What comes of a message: from which component, and its fields."""
    received: queue.SimpleQueue[tuple[int, dict[str, Any]]] = queue.SimpleQueue()
    direct.subscribe_message(
        name, lambda reported, _: received.put((reported.component_id, json.loads(reported.fields_json)))
    )
    return received


def test_it_reaches_the_autopilot_and_the_onboard_computer_each_by_its_id(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    (tmp_path / "station").mkdir()
    with vehicle(tmp_path) as scene, closing(Client(scene.port)) as client:
        client.await_armable()
        of_autopilot, of_companion = Param(client.system), Param(client.system)
        with suppress(ParamError):  # it selects, and says *unknown* all the same
            of_companion.select_component(COMPANION, ProtocolVersion.V1)
        assert of_autopilot.get_param_float("MIS_TAKEOFF_ALT") > 0.0
        ours = listed(of_companion)
        assert {"TEXT_SEVERITY", "FTP_WRITE", "HEIGHT_MAX_M"} <= ours
        assert "MIS_TAKEOFF_ALT" not in ours
        of_companion.set_param_float("TEXT_SEVERITY", 5.0)
        assert of_companion.get_param_float("TEXT_SEVERITY") == 5.0
        for name, value, expected in (
            ("TEXT_SEVERITY", 9.0, ParamResult.VALUE_OUT_OF_RANGE),
            ("HEIGHT_MAX_M", 30.0, ParamResult.PERMISSION_DENIED),
            ("NONE", 1.0, ParamResult.DOES_NOT_EXIST),
        ):
            with pytest.raises(ParamError) as refused:
                of_companion.set_param_float(name, value)
            assert refused.value.result is expected

        ftp = Ftp(client.system)
        ftp.set_target_compid(COMPANION)
        assert {one.name for one in ftp.list_directory("/").entries} == {"logs", "metadata", "missions"}
        station = tmp_path / "station"
        (station / "hop.plan").write_text("{}")
        (station / "hop.sh").write_text("#!")
        assert finished(lambda ended: ftp.upload_async(str(station / "hop.plan"), "/missions", ended)) == "SUCCESS"
        assert (scene.out / "missions" / "hop.plan").read_text() == "{}"
        assert finished(lambda ended: ftp.upload_async(str(station / "hop.sh"), "/missions", ended)) == "FILE_PROTECTED"
        path = "/metadata/parameters.json"
        for uses_burst in (False, True):
            assert finished(lambda ended: ftp.download_async(path, str(station), uses_burst, ended)) == "SUCCESS"  # noqa: B023
        rows = json.loads((station / "parameters.json").read_text())["parameters"]
        assert {row["name"] for row in rows} == ours
        reported: queue.SimpleQueue[bool] = queue.SimpleQueue()
        local = str(station / "hop.plan")
        ftp.are_files_identical_async(local, "/missions/hop.plan", lambda _result, same, _: reported.put(same))
        assert reported.get(timeout=60.0)

        metadata = ComponentMetadata(client.system)
        found: queue.SimpleQueue[Any] = queue.SimpleQueue()
        metadata.subscribe_metadata_available(lambda update, _: found.put(update))
        metadata.request_component(COMPANION)
        update = found.get(timeout=60.0)
        assert (update.compid, update.type) == (COMPANION, MetadataType.PARAMETER)
        assert {row["name"] for row in json.loads(update.json_metadata)["parameters"]} == ours

        direct = MavlinkDirect(client.system)
        versions = messages(direct, "AUTOPILOT_VERSION")
        for component in (1, COMPANION):
            assert command(direct, 512, 148.0, component=component) == ACCEPTED
        capabilities = dict((versions.get(timeout=60.0), versions.get(timeout=60.0)))
        assert set(capabilities) == {1, COMPANION}
        assert capabilities[COMPANION]["capabilities"] & 32, "FTP"
        assert not capabilities[COMPANION]["capabilities"] & 256, "setpoints are not for us"
        client.mission.upload_mission(PLAN)
        assert len(client.mission.download_mission()) == len(PLAN)
        assert command(direct, 512, 42.0) == ACCEPTED
        assert command(direct, START) == DENIED, "that plan went to the autopilot: we have no mission"


def test_plans_for_the_autopilot_are_missions_of_ours_where_that_is_asked_for(tmp_path: Path) -> None:
    with vehicle(tmp_path, "--take-plans") as scene, closing(Client(scene.port)) as client:
        client.await_armable()
        direct, telemetry = MavlinkDirect(client.system), Telemetry(client.system)
        texts: queue.SimpleQueue[str] = queue.SimpleQueue()
        telemetry.subscribe_status_text(lambda reported, _: texts.put(reported.text))
        raw = MissionRaw(client.system)
        with pytest.raises(MissionRawError) as refused:
            raw.upload_mission([PLAN[0], item(1, 82), item(2, 21)])
        assert refused.value.result is MissionRawResult.UNSUPPORTED
        text = ""
        while "command 82 cannot be expressed in a mission" not in text:
            text = texts.get(timeout=60.0)
        upload_when_ready(raw, PLAN)
        assert [(one.command, one.x, one.z) for one in raw.download_mission()] == [(p.command, p.x, p.z) for p in PLAN]
        assert command(direct, START) == ACCEPTED
        client.await_telemetry("armed", bool)
        client.await_height(2.0)
        with pytest.raises(MissionRawError) as refused:
            raw.upload_mission(PLAN)
        assert refused.value.result is MissionRawResult.DENIED
        assert command(direct, ABORT, 1.0) == ACCEPTED
        assert command(direct, LAND) == ACCEPTED
        client.await_telemetry("landed_state", lambda state: bool(state.name == "ON_GROUND"))
