"""The onboard log and the memory card: what is written in flight, and how it is fetched."""

from collections.abc import Callable
from contextlib import suppress
from errno import EEXIST, ENOENT, ENOSPC, ENOTEMPTY, EPERM
from functools import cache
from itertools import groupby
from pathlib import Path
from struct import calcsize, unpack_from
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.DFReader import DFReader_binary
from pyulog import ULog

from gloc3.mavlink.message import Address
from gloc3.mavlink.services.files.ftp import FtpError
from gloc3.mavlink.services.files.ftp_client import FtpCall, FtpClient
from gloc3.mavlink.services.files.log_client import LogClient, LogResult
from gloc3_sitl.autopilot.onboard_files import OnboardFiles

from .bench import LAND, VEHICLE, Bench

pytestmark = pytest.mark.thorough


@cache
def flown(style: str = "px4") -> Bench:
    bench = Bench(style)
    bench.take_off()
    bench.command(LAND)
    bench.run_until(lambda: not bench.is_armed, 15.0)
    bench.run(0.2)
    return bench


def finish(bench: Bench, client: FtpClient, call: FtpCall) -> FtpCall:
    drive(bench, client, lambda: call.result is not None)
    return call


def drive(bench: Bench, client: FtpClient | LogClient, is_over: Callable[[], bool]) -> None:
    """Lets a client talk with the vehicle until it has what it wants."""
    seen = len(bench.received)
    while not is_over():
        for out in client.outgoing():
            bench.send_message(out)
        for received in bench.received[seen:]:
            if received.name in client.handles:
                client.receive(received, VEHICLE, bench.sim.now_s)
        seen = len(bench.received)
        bench.run(0.02)
        client.tick(bench.sim.now_s)


def read_over_ftp(style: str, folder: str, name: str, file: Path) -> Path:
    """Fetches the log of the flight into a file."""
    bench = flown(style)
    client = FtpClient(Address(1, 191))
    listed = finish(bench, client, client.list(VEHICLE, folder, now_s=bench.sim.now_s))
    assert [entry.name for entry in listed.entries] == [name]
    read = finish(bench, client, client.read(VEHICLE, f"{folder}/{name}", now_s=bench.sim.now_s))
    assert read.result is FtpError.NONE
    file.write_bytes(bytes(read.data))
    return file


@pytest.mark.flight
def test_px4s_log_is_a_ulog_that_pyulog_reads(tmp_path: Path) -> None:
    ulog = ULog(str(read_over_ftp("px4", "/fs/microsd/log", "flight_001.ulg", tmp_path / "flight.ulg")))
    assert not ulog.file_corruption
    assert ulog.get_version_info() == (1, 16, 0, 255)
    assert len(ulog.initial_parameters) > 40
    assert isinstance(ulog.initial_parameters["NAV_RCL_ACT"], int)
    position = ulog.get_dataset("vehicle_local_position").data
    seconds = (position["timestamp"] - position["timestamp"][0]) * 1e-6
    assert seconds[-1] > 8.0
    assert len(seconds) == pytest.approx(10.0 * seconds[-1], abs=3)
    assert position["z"].min() < -2.3
    states = ulog.get_dataset("vehicle_status").data
    assert list(dict.fromkeys(states["nav_state"])) == [4, 17, 18]
    assert list(dict.fromkeys(states["arming_state"])) == [2, 1]
    assert [key for key, _ in groupby(ulog.get_dataset("vehicle_land_detected").data["landed"])] == [1, 0, 1]
    outputs = ulog.get_dataset("actuator_outputs").data
    assert 1000.0 < outputs["output[0]"].max() < 2000.0
    assert outputs["output[4]"].max() == 0.0
    assert "Disarmed by self" in [text.message for text in ulog.logged_messages]


@pytest.mark.flight
def test_ardupilots_log_is_a_dataflash_log_that_its_own_reader_reads(tmp_path: Path) -> None:
    file = read_over_ftp("ardupilot", "/APM/LOGS", "flight_001.BIN", tmp_path / "flight.BIN")
    reader, found = DFReader_binary(str(file)), dict[str, list[Any]]()
    while (message := reader.recv_msg()) is not None:
        found.setdefault(message.get_type(), []).append(message)
    reader.data_map.close()
    reader.filehandle.close()
    assert reader.mav_type == 2
    assert len(reader.params) > 40
    assert [mode.ModeNum for mode in found["MODE"]] == [4, 9]
    assert [event.Id for event in found["EV"]] == [10, 28, 18, 11], "armed, took off, landed, disarmed"
    assert min(row.PD for row in found["XKF1"]) < -2.3
    assert (found["XKF1"][-1].TimeUS - found["XKF1"][0].TimeUS) * 1e-6 > 8.0
    assert abs(found["ATT"][-1].Roll) < 2.0
    assert 1000 < max(row.C1 for row in found["RCOU"]) < 2000
    assert found["MSG"][0].Message == "ArduCopter V4.7.0 (GLOC3 SITL)"
    assert 90 <= found["BAT"][-1].RemPct <= 100


def test_the_log_of_a_flight_is_listed_and_read_by_the_log_protocol_too() -> None:
    bench = flown()
    client = LogClient(Address(1, 191))
    listing = client.list(VEHICLE, now_s=bench.sim.now_s)
    drive(bench, client, lambda: listing.result is not None)
    entry = listing.entries[1]
    assert entry.utc_s > 1_700_000_000
    download = client.read(VEHICLE, entry, now_s=bench.sim.now_s)
    drive(bench, client, lambda: download.result is not None)
    assert download.result is LogResult.DONE
    assert bytes(download.data) == bytes(bench.autopilot.logger.logs[0].data)


@pytest.mark.flight
def test_logs_can_be_erased_and_none_is_listed_then() -> None:
    bench = Bench()
    bench.take_off()
    bench.command(400, 0, 21196)
    bench.run(0.2)
    assert len(bench.autopilot.logger.entries()) == 1
    bench.send("LOG_ERASE", target_system=1, target_component=1)
    bench.send("LOG_REQUEST_LIST", target_system=1, target_component=1, start=0, end=0xFFFF)
    bench.run(0.1)
    assert bench.last("LOG_ENTRY").num_logs == 0


def test_a_file_is_written_and_read_back_over_ftp() -> None:
    bench = Bench()
    client = FtpClient(Address(1, 191))
    data = bytes(range(256)) * 5
    written = finish(bench, client, client.write(VEHICLE, "/fs/microsd/note.bin", data, now_s=bench.sim.now_s))
    assert written.result is FtpError.NONE
    read = finish(bench, client, client.read(VEHICLE, "/fs/microsd/note.bin", now_s=bench.sim.now_s))
    assert bytes(read.data) == data


@pytest.mark.parametrize(
    ("method", "arguments", "number"),
    [
        ("size", ("/none",), ENOENT),
        ("read", ("/fs", 0, 10), EPERM),
        ("entries", ("/none",), ENOENT),
        ("entries", ("/../etc",), EPERM),
        ("create", ("/none/file",), ENOENT),
        ("create", ("/fs/microsd/log/mine",), EPERM),
        ("write", ("/fs/microsd/log/flight_001.ulg", 0, b"x"), EPERM),
        ("truncate", ("/none", 3), ENOENT),
        ("make_folder", ("/fs",), EEXIST),
        ("make_folder", ("/a/b",), ENOENT),
        ("remove", ("/none",), ENOENT),
        ("remove_folder", ("/fs/microsd",), EPERM),
        ("remove_folder", ("/full",), ENOTEMPTY),
        ("rename", ("/full/file", "/full/file"), EEXIST),
        ("rename", ("/none", "/other"), ENOENT),
        ("write", ("/full/file", 5_000_000, b"x"), ENOSPC),
    ],
)
def test_what_the_card_cannot_do_is_an_error_of_the_system(
    method: str, arguments: tuple[Any, ...], number: int
) -> None:
    files = OnboardFiles(flown().autopilot.logger, "/fs/microsd/log")
    files.make_folder("/full")
    files.create("/full/file")
    with pytest.raises(OSError) as failed:  # noqa: PT011 # the number is looked at
        getattr(files, method)(*arguments)
    assert failed.value.errno == number


def test_the_card_keeps_cuts_moves_and_removes() -> None:
    files = OnboardFiles(flown().autopilot.logger, "/log")
    files.create("/a")
    files.write("/a", 3, b"xyz")
    assert files.read("/a", 0, 10) == b"\0\0\0xyz"
    files.truncate("/a", 4)
    files.rename("/a", "/b")
    assert [(entry.name, entry.is_folder) for entry in files.entries("/")] == [("b", False), ("log", True)]
    assert files.size("/b") == 4
    files.remove("/b")
    assert len(files.entries("/")) == 1


@given(st.text(max_size=20))
def test_any_path_is_served_or_an_error_of_the_system(path: str) -> None:
    files = OnboardFiles(flown().autopilot.logger, "/log")
    for method in (files.entries, files.size, files.create, files.remove, files.make_folder):
        with suppress(OSError):
            method(path)


# -- ArduPilot's virtual files ------------------------------------------------------------------------------------------


def read_all(bench: Bench, path: str) -> bytes:
    client = FtpClient(Address(1, 191))
    call = finish(bench, client, client.read(VEHICLE, path, now_s=bench.sim.now_s))
    assert call.result is FtpError.NONE
    return bytes(call.data)


def unpacked(packed: bytes) -> tuple[dict[str, float], dict[str, float], int]:
    """Parameters by name, the defaults that stand with them, and how many there are: as MAVProxy reads the file."""
    magic, count, total = unpack_from("<HHH", packed)
    assert magic in (0x671B, 0x671C)
    forms, name, at = {1: "<b", 2: "<h", 3: "<i", 4: "<f"}, "", 6
    found: dict[str, float] = {}
    defaults: dict[str, float] = {}
    while at < len(packed):
        if not packed[at]:
            at += 1
            continue
        form, flags = forms[packed[at] & 0x0F], packed[at] >> 4
        assert not flags or magic == 0x671C
        shared, rest = packed[at + 1] & 0x0F, (packed[at + 1] >> 4) + 1
        name = name[:shared] + packed[at + 2 : at + 2 + rest].decode()
        at += 2 + rest
        size = calcsize(form) * (1 + (flags & 1))
        assert at // 239 == (at + size - 1) // 239, "a value crosses a block"
        found[name] = unpack_from(form, packed, at)[0]
        if flags & 1:
            defaults[name] = unpack_from(form, packed, at + calcsize(form))[0]
        at += size
    assert len(found) == count
    return found, defaults, total


def test_ardupilot_packs_its_parameters_into_a_file() -> None:
    bench = Bench("ardupilot")
    bench.run(1.0)
    bench.set_parameter("WP_SPD", 3.5)
    found, defaults, total = unpacked(read_all(bench, "@PARAM/param.pck"))
    assert total == len(found)
    assert not defaults
    assert found == pytest.approx({name: bench.autopilot.parameters[name] for name in bench.autopilot.parameters})


def test_ardupilot_packs_the_part_of_its_parameters_that_is_asked_for_with_their_defaults() -> None:
    bench = Bench("ardupilot")
    bench.run(1.0)
    bench.set_parameter("WP_SPD", 3.5)
    names = list(bench.autopilot.parameters)
    found, defaults, total = unpacked(read_all(bench, "@PARAM/param.pck?start=3&count=5"))
    assert (list(found), defaults, total) == (names[3:8], {}, len(names))
    found, defaults, _ = unpacked(read_all(bench, "@PARAM/param.pck?withdefaults=1"))
    assert list(found) == names
    assert (found["WP_SPD"], defaults) == (3.5, {"WP_SPD": bench.autopilot.parameters.rows["WP_SPD"].default})
    found, _, _ = unpacked(read_all(bench, f"@PARAM/param.pck?start={len(names) - 1}"))
    assert list(found) == names[-1:]


def test_ardupilot_tells_its_links_in_a_file_whose_size_it_does_not_know() -> None:
    bench = Bench("ardupilot")
    bench.run(1.0)
    assert read_all(bench, "@SYS/uarts.txt").startswith(b"UARTV1\nSERIAL0")


def test_virtual_files_cannot_be_changed() -> None:
    files = Bench("ardupilot").sim.front.files
    with pytest.raises(OSError, match="not permitted"):
        files.create("@SYS/uarts.txt")
    with pytest.raises(OSError, match="not permitted"):
        files.write("@PARAM/param.pck", 0, b"x")


def test_px4_has_no_virtual_files() -> None:
    with pytest.raises(FileNotFoundError):
        Bench().sim.front.files.size("@PARAM/param.pck")
