"""File transfer: whole files over lossy links, and nothing outside the folder."""

import random
import struct
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gloc3.errors import Refused
from gloc3.mavlink.codec import message
from gloc3.mavlink.message import Address
from gloc3.mavlink.services.files.ftp import (
    FolderEntry,
    FtpError,
    Operation,
    Payload,
    checksum,
    read_entries,
    read_payload,
)
from gloc3.mavlink.services.files.ftp_client import FtpCall, FtpClient
from gloc3.mavlink.services.files.ftp_files import FolderFiles
from gloc3.mavlink.services.files.ftp_server import CHECK_PAUSE_S, CHECKED_BYTES, IDLE_S, MOST_SESSIONS, FtpServer
from gloc3.mavlink.transport.memory import Conditions

from .pair import STATION, VEHICLE, Pair

pytestmark = pytest.mark.thorough

CONTENT = random.Random(1).randbytes(30_000)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    top = tmp_path / "shared"
    (top / "logs").mkdir(parents=True)
    (top / "logs" / "flight.mcap").write_bytes(CONTENT)
    (top / "empty").write_bytes(b"")
    (tmp_path / "secret").write_text("secret")
    (top / "way-out").symlink_to(tmp_path)
    (top / "secret-link").symlink_to(tmp_path / "secret")
    (top / "inner-link").symlink_to(top / "logs" / "flight.mcap")
    return top


def wired(
    folder: Path, conditions: Conditions | None = None, *, is_writable: bool = True
) -> tuple[Pair, FtpServer, FtpClient]:
    pair = Pair(1, conditions or Conditions(latency_s=0.01))
    server, client = FtpServer(VEHICLE, FolderFiles(folder, is_writable=is_writable)), FtpClient(STATION)
    pair.add([server], [client])
    return pair, server, client


def finish(pair: Pair, call: FtpCall) -> FtpError | None:
    pair.run(300.0, lambda: call.result is not None)
    return call.result


@pytest.mark.parametrize("uses_burst", [True, False])
@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_a_file_is_read_whole(folder: Path, loss: float, uses_burst: bool) -> None:
    pair, server, client = wired(folder, Conditions(latency_s=0.01, loss=loss, duplicate=loss / 2))
    call = client.read(VEHICLE, "/logs/flight.mcap", uses_burst=uses_burst, now_s=0.0)
    assert finish(pair, call) is FtpError.NONE
    assert call.data == CONTENT
    assert call.progress == 1.0
    assert finish(pair, empty := client.read(VEHICLE, "empty", now_s=pair.now_s)) is FtpError.NONE
    assert empty.data == b""
    pair.run(1.0)
    assert server.sessions == 0


def test_a_burst_is_much_faster_than_single_questions(folder: Path) -> None:
    times_s = []
    for uses_burst in (True, False):
        pair, _, client = wired(folder, Conditions(latency_s=0.1))
        finish(pair, client.read(VEHICLE, "logs/flight.mcap", uses_burst=uses_burst, now_s=0.0))
        times_s.append(pair.now_s)
    assert times_s[0] < times_s[1] / 10


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_a_file_is_written_whole_and_checked(folder: Path, loss: float) -> None:
    pair, _, client = wired(folder, Conditions(latency_s=0.01, loss=loss, duplicate=loss / 2))
    assert finish(pair, client.write(VEHICLE, "new.bin", CONTENT[:5000], now_s=0.0)) is FtpError.NONE
    assert (folder / "new.bin").read_bytes() == CONTENT[:5000]
    call = client.calculate_checksum(VEHICLE, "new.bin", now_s=pair.now_s)
    assert finish(pair, call) is FtpError.NONE
    assert call.checksum == checksum([CONTENT[:5000]])
    assert finish(pair, client.write(VEHICLE, "new.bin", b"", now_s=pair.now_s)) is FtpError.NONE
    assert (folder / "new.bin").read_bytes() == b""


def test_the_checksum_is_the_protocols() -> None:
    assert checksum([b""]) == 0
    assert checksum([b"\x01"]) == 0x77073096, "the first entry of the usual table"
    assert checksum([b"ab", b"cd"]) == checksum([b"abcd"])


def test_folders_are_listed_made_renamed_and_removed(folder: Path) -> None:
    pair, _, client = wired(folder, Conditions(latency_s=0.01, loss=0.2))
    call = client.list(VEHICLE, "/", now_s=0.0)
    assert finish(pair, call) is FtpError.NONE
    assert call.entries == [
        FolderEntry("empty", False, 0),
        FolderEntry("inner-link", False, 30_000),
        FolderEntry("logs", True),
    ]
    for wanted in (
        client.make_folder(VEHICLE, "/a", now_s=0.0),
        client.write(VEHICLE, "/a/x", b"12345", now_s=0.0),
        client.truncate(VEHICLE, "/a/x", 3, now_s=0.0),
        client.rename(VEHICLE, "/a/x", "/b", now_s=0.0),
        client.remove_folder(VEHICLE, "/a", now_s=0.0),
    ):
        assert finish(pair, wanted) is FtpError.NONE
    assert (folder / "b").read_bytes() == b"123"
    assert not (folder / "a").exists()
    assert finish(pair, client.remove(VEHICLE, "/b", now_s=pair.now_s)) is FtpError.NONE
    assert not (folder / "b").exists()


def test_a_long_folder_is_listed_in_several_answers(folder: Path) -> None:
    for number in range(100):
        (folder / "logs" / f"a-log-with-a-long-name-{number:03d}.bin").write_bytes(bytes(number))
    pair, _, client = wired(folder, Conditions(loss=0.1))
    call = client.list(VEHICLE, "logs", now_s=0.0)
    assert finish(pair, call) is FtpError.NONE
    assert len(call.entries) == 101
    assert call.entries[42].size == 42


@pytest.mark.parametrize(
    "path",
    [
        "../secret",
        "/../secret",
        "logs/../../secret",
        "way-out/secret",
        "secret-link",
        "way-out",
        "a\\..\\b",
        "/logs/..",
    ],
)
def test_nothing_outside_the_folder_can_be_reached(folder: Path, path: str) -> None:
    pair, _, client = wired(folder)
    for call in (
        client.read(VEHICLE, path, now_s=0.0),
        client.list(VEHICLE, path, now_s=0.0),
        client.write(VEHICLE, path, b"x", now_s=0.0),
        client.remove(VEHICLE, path, now_s=0.0),
        client.make_folder(VEHICLE, f"{path}/new", now_s=0.0),
        client.remove_folder(VEHICLE, path, now_s=0.0),
        client.truncate(VEHICLE, path, 0, now_s=0.0),
        client.rename(VEHICLE, "empty", f"{path}/new", now_s=0.0),
        client.rename(VEHICLE, path, "inside", now_s=0.0),
        client.calculate_checksum(VEHICLE, path, now_s=0.0),
    ):
        assert finish(pair, call) is FtpError.FILE_PROTECTED
    assert (folder.parent / "secret").read_text() == "secret"
    assert sorted(child.name for child in folder.parent.iterdir()) == ["secret", "shared"]


def test_what_cannot_be_is_refused_with_the_reason(folder: Path) -> None:
    pair, _, client = wired(folder)
    for call, expected in (
        (client.read(VEHICLE, "none", now_s=0.0), FtpError.FILE_NOT_FOUND),
        (client.read(VEHICLE, "logs", now_s=0.0), FtpError.FILE_PROTECTED),
        (client.list(VEHICLE, "none", now_s=0.0), FtpError.FILE_NOT_FOUND),
        (client.make_folder(VEHICLE, "logs", now_s=0.0), FtpError.FILE_EXISTS),
        (client.remove_folder(VEHICLE, "/", now_s=0.0), FtpError.FILE_PROTECTED),
        (client.remove_folder(VEHICLE, "logs", now_s=0.0), FtpError.FAILED_WITH_NUMBER),
        (client.rename(VEHICLE, "empty", "logs", now_s=0.0), FtpError.FILE_EXISTS),
        (client.rename(VEHICLE, "/", "top", now_s=0.0), FtpError.FILE_PROTECTED),
        (client.truncate(VEHICLE, "empty", 2**31, now_s=0.0), FtpError.FILE_PROTECTED),
    ):
        assert finish(pair, call) is expected
    with pytest.raises(Refused, match="too long"):
        client.read(VEHICLE, "x" * 240, now_s=0.0)
    assert all(error.words for error in FtpError)


def test_a_checksum_of_a_large_file_holds_nothing_up_and_survives_being_asked_again(folder: Path) -> None:
    pieces = 400
    with (folder / "huge").open("wb") as file:
        file.truncate(pieces * CHECKED_BYTES)
    pair, server, client = wired(folder)
    call = client.calculate_checksum(VEHICLE, "huge", now_s=0.0)
    read: list[int] = []
    files = server._files.read
    server._files.read = lambda *wanted: read.append(wanted[2]) or files(*wanted)  # type: ignore[method-assign,func-returns-value]
    assert finish(pair, call) is FtpError.NONE
    assert call.checksum == checksum(bytes(CHECKED_BYTES) for _ in range(pieces))
    assert len(read) == pieces + 1, "each piece once, although the client has asked more than once"
    assert pair.now_s > pieces * CHECK_PAUSE_S


def test_a_file_that_goes_while_its_checksum_is_calculated_is_not_found(folder: Path) -> None:
    with (folder / "huge").open("wb") as file:
        file.truncate(100 * CHECKED_BYTES)
    pair, _, client = wired(folder)
    call = client.calculate_checksum(VEHICLE, "huge", now_s=0.0)
    pair.run(0.05)
    (folder / "huge").unlink()
    assert finish(pair, call) is FtpError.FILE_NOT_FOUND


def test_checksums_for_thousands_of_systems_are_not_calculated_at_once(folder: Path) -> None:
    with (folder / "huge").open("wb") as file:
        file.truncate(100 * CHECKED_BYTES)
    server = FtpServer(VEHICLE, FolderFiles(folder))
    request = Payload(operation=Operation.CALCULATE_CRC32, size=4, data=b"huge").encode()
    requested = message("FILE_TRANSFER_PROTOCOL", target_system=1, target_component=1, payload=request)
    for number in range(5000):
        server.receive(requested, Address(number % 250 + 1, number // 250 + 1), 0.0)
    answers = [read_payload(sent.payload) for sent in server.outgoing()]
    assert len(answers) == 5000 - MOST_SESSIONS
    assert {answer.data[0] for answer in answers if answer} == {FtpError.NO_SESSIONS_AVAILABLE}


def test_a_read_only_folder_is_not_changed(folder: Path) -> None:
    pair, _, client = wired(folder, is_writable=False)
    assert finish(pair, client.read(VEHICLE, "empty", now_s=0.0)) is FtpError.NONE
    for call in (
        client.write(VEHICLE, "new", b"x", now_s=0.0),
        client.remove(VEHICLE, "empty", now_s=0.0),
        client.make_folder(VEHICLE, "new", now_s=0.0),
    ):
        assert finish(pair, call) is FtpError.FILE_PROTECTED


def test_nobody_there_is_told_and_what_waits_may_be_cancelled(folder: Path) -> None:
    pair, _, client = wired(folder, Conditions(loss=1.0))
    first, second, third = (client.read(VEHICLE, "empty", now_s=0.0) for _ in range(3))
    client.cancel(third, 0.0)
    assert third.result is FtpError.CANCELLED
    assert finish(pair, first) is FtpError.NO_ANSWER
    assert pair.now_s < 6.0
    client.cancel(second, pair.now_s)
    assert second.result is FtpError.CANCELLED
    assert client.next_tick_s() is None


def test_a_cancelled_read_closes_its_session(folder: Path) -> None:
    pair, server, client = wired(folder, Conditions(latency_s=0.05))
    call = client.read(VEHICLE, "logs/flight.mcap", now_s=0.0)
    pair.run(0.25)
    assert server.sessions == 1
    assert 0.0 < call.progress < 1.0
    client.cancel(call, pair.now_s)
    pair.run(0.5)
    assert server.sessions == 0
    assert server.next_tick_s() is None


def request(server: FtpServer, sender: Address = STATION, now_s: float = 0.0, **fields: Any) -> list[Payload]:
    payload = Payload(**fields)
    server.receive(message("FILE_TRANSFER_PROTOCOL", target_system=1, payload=payload.encode()), sender, now_s)
    return [answer for m in server.outgoing() if (answer := read_payload(m.payload)) is not None]


def test_a_repeated_question_is_answered_again_and_not_done_again(folder: Path) -> None:
    server = FtpServer(VEHICLE, FolderFiles(folder))
    remove: dict[str, Any] = {"operation": Operation.REMOVE_FILE, "sequence": 7, "size": 5, "data": b"empty"}
    first, again = request(server, **remove), request(server, **remove)
    assert first == again
    assert first[0].operation == Operation.ACKNOWLEDGED
    (refused,) = request(server, **(remove | {"sequence": 8}))
    assert FtpError.read(refused.data) is FtpError.FILE_NOT_FOUND


def test_a_program_that_is_started_again_gets_answers_of_its_own(folder: Path) -> None:
    server = FtpServer(VEHICLE, FolderFiles(folder))
    check: dict[str, Any] = {"operation": Operation.CALCULATE_CRC32, "sequence": 2, "size": 5, "data": b"empty"}
    for start_s, content in ((0.0, b"one"), (10.0, b"two")):
        (folder / "empty").write_bytes(content)
        for now_s in (start_s, start_s + 4.9):
            (answer,) = request(server, now_s=now_s, **check)
            assert struct.unpack("<I", answer.data) == (checksum([content]),)
    remove = check | {"operation": Operation.REMOVE_FILE}
    for start_s in (20.0, 30.0):
        (folder / "empty").write_bytes(b"")
        for now_s in (start_s, start_s + 4.9):
            (answer,) = request(server, now_s=now_s, **remove)
            assert answer.operation == Operation.ACKNOWLEDGED
        assert not (folder / "empty").exists()


def test_a_download_that_broke_off_goes_on_at_any_place(folder: Path) -> None:
    server = FtpServer(VEHICLE, FolderFiles(folder))
    path = b"logs/flight.mcap"
    (opened,) = request(server, sequence=1, operation=Operation.OPEN_FILE_READ_ONLY, size=len(path), data=path)
    request(server, sequence=2, operation=Operation.READ_FILE, session=opened.session, offset=0, size=239)
    request(server, sequence=3, operation=Operation.RESET_SESSIONS)
    (opened,) = request(server, sequence=4, operation=Operation.OPEN_FILE_READ_ONLY, size=len(path), data=path)
    for number, offset in enumerate((12_345, 29_950, 239)):
        (part,) = request(
            server, sequence=5 + number, operation=Operation.READ_FILE, session=opened.session, offset=offset, size=239
        )
        assert part.data == CONTENT[offset : offset + 239]
    request(server, sequence=9, operation=Operation.BURST_READ_FILE, session=opened.session, offset=20_000, size=239)
    server.tick(1.0)
    begun = read_payload(next(iter(server.outgoing())).payload)
    assert begun is not None
    assert (begun.offset, begun.data) == (20_000, CONTENT[20_000:20_239])


def test_sessions_are_bounded_belong_to_their_owner_and_expire(folder: Path) -> None:
    server = FtpServer(VEHICLE, FolderFiles(folder))
    open_file: dict[str, Any] = {"operation": Operation.OPEN_FILE_READ_ONLY, "size": 5, "data": b"empty"}
    for number in range(MOST_SESSIONS):
        (opened,) = request(server, sequence=number, **open_file)
        assert opened.session == number
    (refused,) = request(server, sequence=50, **open_file)
    assert FtpError.read(refused.data) is FtpError.NO_SESSIONS_AVAILABLE
    stranger = Address(254, 190)
    (refused,) = request(server, stranger, sequence=1, operation=Operation.READ_FILE, session=0, size=10)
    assert FtpError.read(refused.data) is FtpError.INVALID_SESSION
    (refused,) = request(server, sequence=51, operation=Operation.WRITE_FILE, session=0, size=1, data=b"x")
    assert FtpError.read(refused.data) is FtpError.FILE_PROTECTED
    (opened,) = request(server, stranger, IDLE_S + 1, sequence=2, **open_file)
    assert opened.operation == Operation.ACKNOWLEDGED
    request(server, sequence=52, operation=Operation.RESET_SESSIONS)
    assert server.sessions == 1, "the stranger's"


@settings(max_examples=100)
@given(
    st.lists(
        st.tuples(
            st.integers(0, 20),
            st.integers(0, 255),
            st.integers(0, 3),
            st.integers(0, 2**32 - 1),
            st.binary(max_size=239),
        ),
        max_size=6,
    )
)
def test_any_questions_are_survived(questions: list[tuple[int, int, int, int, bytes]]) -> None:
    server = FtpServer(VEHICLE, NoFiles())
    client = FtpClient(STATION)
    client.list(VEHICLE, "/", now_s=0.0)
    for number, (operation, size, session, offset, data) in enumerate(questions):
        raw = struct.pack("<HBBBBBxI", number, session, operation, size, operation, 0, offset) + data
        server.receive(message("FILE_TRANSFER_PROTOCOL", target_system=1, payload=raw), STATION, number * 0.01)
        server.tick(number * 0.01)
        client.receive(message("FILE_TRANSFER_PROTOCOL", payload=raw), VEHICLE, number * 0.01)
    for answer in server.outgoing():
        assert read_payload(answer.payload) is not None


@given(st.binary(max_size=239))
def test_any_directory_entries_are_survived(data: bytes) -> None:
    entries, count = read_entries(data)
    assert len(entries) <= count


class NoFiles(FolderFiles):
    """A file system in which everything fails."""

    def __init__(self) -> None:
        pass

    def _find(self, path: str) -> Path:
        raise OSError(5, path)

    def _may_write(self, bytes_needed: int) -> None:
        pass
