"""The onboard computer's parameters, files and metadata, over MAVLink alone."""

import json
from pathlib import Path

import pytest
from tests.flight.card import ONE_STYLE, Card
from tests.flight.tool import COMPANION, GEO_HOP, Tool

from gloc3.mavlink.services.files.ftp import FtpError, Operation, Payload, checksum
from gloc3.mavlink.services.files.ftp_server import MOST_CLIENTS, MOST_SESSIONS, FtpServer
from gloc3.mavlink.services.parameter import ParameterType
from gloc3.mavlink.services.parameter_client import ParameterResult
from gloc3.messages.command_interface import CallFunction, CommandComponent, Control, ControlVerb, Outcome
from gloc3_onboard.companion.files import LARGEST_MISSION_BYTES, MOST_MISSIONS, shared_files

pytestmark = [ONE_STYLE]


def begun(flight: Card) -> Tool:
    """A station of others beside one of ours, which has given up control."""
    flight.begin(GEO_HOP, is_started=False)
    assert flight.request(Control(verb=ControlVerb.RELEASE)).outcome is Outcome.ACCEPTED
    flight.wait(1.1)
    return Tool(flight)


def put(tool: Tool, name: str, value: float) -> ParameterResult:
    result = tool.wait_for(tool.parameters.set(COMPANION, name, value, ParameterType.REAL32, now_s=tool.now_s))
    assert isinstance(result, ParameterResult)
    return result


def value_of(tool: Tool, name: str) -> float:
    call = tool.parameters.read(COMPANION, name, now_s=tool.now_s)
    assert tool.wait_for(call) is ParameterResult.DONE
    assert call.value is not None
    return call.value.value


def reasons(flight: Card) -> list[str]:
    return [event.payload.text for event in flight.received.get("components/companion/event", [])]


def test_every_rate_and_setting_is_listed_and_a_rate_changes_while_working(flight: Card) -> None:
    tool = begun(flight)
    fetch = tool.parameters.fetch(COMPANION, now_s=tool.now_s)
    assert tool.wait_for(fetch) is ParameterResult.DONE
    names = {row.name for row in flight.flight.process.vehicle.companion.parameters._rows.values()}
    assert set(fetch.parameters) == names
    assert all(len(name) <= 16 for name in names)
    assert len(names) > 60
    assert put(tool, "HEIGHT_RATE_HZ", 10.0) is ParameterResult.DONE
    flight.wait(2.5)
    assert flight.last("components/height/status").nominal_rate_hz == 10.0
    assert flight.last("ci/control").holder == "250", "a change needs control, and nobody had it"


def test_a_setting_is_changed_in_standby_only_and_by_whoever_holds_control_only(flight: Card) -> None:
    tool = begun(flight)
    before = value_of(tool, "HEIGHT_MAX_M")
    assert put(tool, "HEIGHT_MAX_M", 30.0) is ParameterResult.REFUSED
    assert "HEIGHT_MAX_M of station 250 refused: initialize is not accepted in working" in reasons(flight)[-1]
    assert value_of(tool, "HEIGHT_MAX_M") == before
    assert put(tool, "HEIGHT_MAX_M", 5000.0) is ParameterResult.REFUSED
    assert reasons(flight)[-1] == "parameter refused: HEIGHT_MAX_M must be from 0.1 to 1000, not 5000"
    assert put(Tool(flight, system=249), "HEIGHT_MAX_M", 30.0) is ParameterResult.REFUSED
    assert "station 250 holds control" in reasons(flight)[-1]
    assert tool.reported("PARAM_ERROR")

    flight.request(Control(verb=ControlVerb.TAKE_OVER))
    assert flight.component("height", "stop").outcome is Outcome.ACCEPTED
    flight.request(Control(verb=ControlVerb.RELEASE))
    flight.wait(1.1)
    assert put(tool, "HEIGHT_MAX_M", 30.0) is ParameterResult.DONE
    assert put(tool, "HEIGHT_MIN_M", 0.1) is ParameterResult.DONE, "and what was set before stays"
    onboard = flight.flight.process.onboard
    assert onboard is not None
    commands = [one.payload.settings for one in flight.received["components/height/command"]]
    assert commands[-1] == {"max_m": 30.0, "min_m": 0.1}
    assert value_of(tool, "HEIGHT_MAX_M") == 30.0


def test_what_our_own_station_changes_is_told_to_others(flight: Card) -> None:
    tool = begun(flight)
    flight.request(Control(verb=ControlVerb.REQUEST))
    tool.received.clear()
    requested = CallFunction(component="height", function="set_rate", arguments={"rate_hz": 7.0})
    assert flight.request(requested).outcome is Outcome.ACCEPTED
    flight.wait(0.2)
    assert [one.param_id for one in tool.reported("PARAM_VALUE")] == ["HEIGHT_RATE_HZ"]
    assert flight.component("height", "stop").outcome is Outcome.ACCEPTED
    settings = {"max_m": 12.0}
    assert (
        flight.request(CommandComponent(component="height", command="initialize", settings=settings)).outcome
        is Outcome.ACCEPTED
    )
    flight.wait(0.2)
    assert value_of(tool, "HEIGHT_MAX_M") == 12.0
    assert flight.component("height", "initialize").outcome is Outcome.ACCEPTED
    flight.wait(0.2)
    assert value_of(tool, "HEIGHT_MAX_M") == 40.0, "without settings those of the platform file hold again"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    top = tmp_path / "run"
    top.mkdir()
    (top / "log.mcap").write_bytes(bytes(range(256)) * 100)
    (top / "log.tlog").write_bytes(b"frames")
    (top / "requests.journal").write_bytes(b"secret")
    (top / "images").mkdir()
    (top / "images" / "front-1.png").write_bytes(b"picture")
    (tmp_path / "secret").write_text("secret")
    (top / "log-2.mcap").symlink_to(tmp_path / "secret")
    return top


def test_logs_are_read_and_nothing_else_of_the_folder_is_there(flight: Card, folder: Path) -> None:
    tool = begun(flight)
    flight.flight.process.vehicle.companion.share(shared_files(folder, folder, {}))
    (folder / "missions" / "out.yaml").symlink_to(folder / "requests.journal")
    listed = tool.files.list(COMPANION, "/", now_s=tool.now_s)
    assert tool.wait_for(listed) is FtpError.NONE
    assert [entry.name for entry in listed.entries] == ["logs", "metadata", "missions"]
    listed = tool.files.list(COMPANION, "/@MAV_LOG", now_s=tool.now_s)
    assert tool.wait_for(listed) is FtpError.NONE
    assert [entry.name for entry in listed.entries] == ["images", "log.mcap", "log.tlog"]
    for uses_burst in (True, False):
        read = tool.files.read(COMPANION, "/logs/log.mcap", uses_burst=uses_burst, now_s=tool.now_s)
        assert tool.wait_for(read) is FtpError.NONE
        assert bytes(read.data) == (folder / "log.mcap").read_bytes()
    check = tool.files.calculate_checksum(COMPANION, "/logs/log.mcap", now_s=tool.now_s)
    assert tool.wait_for(check) is FtpError.NONE
    assert check.checksum == checksum([(folder / "log.mcap").read_bytes()])
    for path, expected in (
        ("/logs/requests.journal", FtpError.FILE_NOT_FOUND),
        ("/requests.journal", FtpError.FILE_NOT_FOUND),
        ("/logs/../requests.journal", FtpError.FILE_PROTECTED),
        ("/../secret", FtpError.FILE_PROTECTED),
        ("/logs/images/../../../secret", FtpError.FILE_PROTECTED),
        ("/logs/log-2.mcap", FtpError.FILE_PROTECTED),
        ("/missions/out.yaml", FtpError.FILE_PROTECTED),
        ("/missions/../requests.journal", FtpError.FILE_PROTECTED),
        ("/", FtpError.FILE_PROTECTED),
    ):
        assert tool.wait_for(tool.files.read(COMPANION, path, now_s=tool.now_s)) is expected, path


def test_missions_are_written_under_names_of_missions_by_whoever_may(flight: Card, folder: Path) -> None:
    tool = begun(flight)
    flight.flight.process.vehicle.companion.share(shared_files(folder, folder, {}))
    text = GEO_HOP.encode()
    assert tool.wait_for(tool.files.write(COMPANION, "/missions/hop.yaml", text, now_s=tool.now_s)) is FtpError.NONE
    assert (folder / "missions" / "hop.yaml").read_bytes() == text
    for path in (
        *("/missions/hop.py", "/missions/.hidden.yaml", "/missions/sub/hop.yaml", "/missions/a\nb.yaml"),
        *("/missions/é.yaml", f"/missions/{'x' * 70}.yaml", "/logs/log.mcap", "/logs/log-9.mcap", "/metadata/x.json"),
        *("/x.yaml", "/missions/../log.yaml", "/missions/.."),
    ):
        result = tool.wait_for(tool.files.write(COMPANION, path, b"x", now_s=tool.now_s))
        assert result in (FtpError.FILE_PROTECTED, FtpError.FILE_NOT_FOUND), path
    for call in (
        tool.files.rename(COMPANION, "/missions/hop.yaml", "/missions/hop.sh", now_s=tool.now_s),
        tool.files.rename(COMPANION, "/missions/hop.yaml", "/logs/log-8.mcap", now_s=tool.now_s),
        tool.files.remove(COMPANION, "/logs/log.mcap", now_s=tool.now_s),
        tool.files.make_folder(COMPANION, "/missions/sub", now_s=tool.now_s),
        tool.files.truncate(COMPANION, "/missions/hop.yaml", LARGEST_MISSION_BYTES + 1, now_s=tool.now_s),
    ):
        assert tool.wait_for(call) is FtpError.FILE_PROTECTED
    for number in range(MOST_MISSIONS):
        (folder / "missions" / f"{number}.plan").touch()
    more = tool.files.write(COMPANION, "/missions/more.yaml", b"x", now_s=tool.now_s)
    assert tool.wait_for(more) is FtpError.FILE_PROTECTED
    flight.request(Control(verb=ControlVerb.REQUEST))
    flight.wait(1.1)
    again = tool.files.write(COMPANION, "/missions/hop.yaml", b"x", now_s=tool.now_s)
    assert tool.wait_for(again) is FtpError.FILE_PROTECTED, "somebody else holds control"
    assert {path.name for path in folder.rglob("*") if path.suffix in (".py", ".sh", ".json")} == set()


def test_metadata_name_files_whose_checksums_are_right(flight: Card, folder: Path) -> None:
    tool = begun(flight)
    companion = flight.flight.process.vehicle.companion
    companion.share(shared_files(folder, folder, companion.metadata.files))
    tool.command(512, 397)
    flight.wait(0.1)
    (reported,) = tool.reported("COMPONENT_METADATA")
    texts = {}
    uri, crc = reported.uri, reported.file_crc
    for _ in range(2):
        head, path = uri.split("]")
        assert head == "mftp://[;comp=191"
        read = tool.files.read(COMPANION, path, now_s=tool.now_s)
        assert tool.wait_for(read) is FtpError.NONE
        assert checksum([bytes(read.data)]) == crc
        texts[path] = json.loads(bytes(read.data))
        if len(texts) == 1:
            (kind,) = texts[path]["metadataTypes"]
            uri, crc = kind["uri"], kind["fileCrc"]
            assert kind["type"] == 1
    rows = {row["name"]: row for row in texts["/metadata/parameters.json"]["parameters"]}
    assert set(rows) == set(companion.parameters._rows)
    assert rows["HEIGHT_MAX_M"]["shortDesc"] == "height: max_m"
    assert (rows["HEIGHT_MAX_M"]["min"], rows["HEIGHT_MAX_M"]["max"], rows["HEIGHT_MAX_M"]["units"]) == (
        0.1,
        1000.0,
        "m",
    )
    allowed = {"name", "type", "shortDesc", "longDesc", "units", "default", "min", "max", "group", "decimalPlaces"}
    assert all(set(row) <= allowed | {"increment"} for row in rows.values())


def test_files_opened_by_thousands_are_no_more_than_a_few(flight: Card, folder: Path) -> None:
    tool = begun(flight)
    flight.flight.process.vehicle.companion.share(shared_files(folder, folder, {}))
    opened = Payload(operation=Operation.OPEN_FILE_READ_ONLY, size=14, data=b"/logs/log.mcap").encode()
    for encode in Tool(flight, system=200).as_strangers(2000):
        encode("FILE_TRANSFER_PROTOCOL", payload=opened)
    flight.wait(1.0)
    (server,) = [one for one in flight.flight.process.vehicle.companion._node._services if isinstance(one, FtpServer)]
    assert server.sessions == MOST_SESSIONS, "and they make room a minute after they were used last"
    assert len(server._answered) <= MOST_CLIENTS
    refused = tool.files.read(COMPANION, "/logs/log.tlog", now_s=tool.now_s)
    assert tool.wait_for(refused) is FtpError.NO_SESSIONS_AVAILABLE
