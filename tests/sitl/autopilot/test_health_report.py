"""PX4's health and arming report: EVENTs as libevents packs and numbers them, and their metadata."""

import json
import lzma
from struct import unpack_from
from typing import Any

import pytest

from gloc3.mavlink.codec import message
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.services.files.ftp import checksum
from gloc3_sitl.autopilot.mavlink.events import EventKind, EventLevel, EventSender
from gloc3_sitl.autopilot.mavlink.metadata import GENERAL
from gloc3_sitl.autopilot.modes import Result

from .bench import ARM, Bench

pytestmark = pytest.mark.flight

RUN_CHECKS, REQUEST, METADATA = 401, 512, 397
HOLD, MISSION, OFFBOARD = 1 << 4, 1 << 3, 1 << 14
SUMMARY, END = 1 << 24 | 11047904, 1 << 24 | 1914663
NO_OFFBOARD_SIGNAL, LOW_BATTERY, NOT_IN_THIS_MODE = 1 << 24 | 3087815, 1 << 24 | 5049764, 1 << 24 | 1871713
REFUSED = 1 << 24 | 133277
"""Numbers in the metadata of PX4 1.16."""


def events(bench: Bench) -> list[MavlinkMessage]:
    return [received for received in bench.received if received.name == "EVENT"]


def newest_report(bench: Bench) -> dict[int, bytes]:
    """Arguments by number, of the newest whole report."""
    found = events(bench)
    end = max(place for place, event in enumerate(found) if event.id_ == END)
    begin = max(place for place, event in enumerate(found[:end]) if event.id_ == SUMMARY)
    return {event.id_: bytes(event.arguments) for event in found[begin : end + 1]}


def can_arm(report: dict[int, bytes]) -> int:
    return int(unpack_from("<BIIII", report[SUMMARY])[3])


@pytest.mark.parametrize(
    ("name", "number"),
    [
        ("commander_arming_check_summary", 11047904),
        ("commander_health_summary", 1914663),
        ("check_modes_offboard_signal", 3087815),
        ("check_modes_global_pos", 10011251),
    ],
)
def test_numbers_are_the_hash_of_the_name_under_component_1(name: str, number: int) -> None:
    assert EventKind(name, EventLevel.INFO, "").number == 1 << 24 | number


def test_a_ready_vehicle_can_be_armed_in_hold_and_not_in_offboard_without_setpoints() -> None:
    bench = Bench()
    bench.get_ready()
    bench.run(3.0)
    report = newest_report(bench)
    assert can_arm(report) & HOLD
    assert not can_arm(report) & OFFBOARD
    assert unpack_from("<IB", report[NO_OFFBOARD_SIGNAL]) == (OFFBOARD, 20)


def test_a_refused_arming_is_explained_by_events_and_not_by_a_text() -> None:
    bench = Bench(battery_remaining=0.12)
    bench.run(5.0)
    assert bench.command(ARM, 1) is Result.TEMPORARILY_REJECTED
    bench.run(0.1)
    assert REFUSED in [event.id_ for event in events(bench)]
    report = newest_report(bench)
    assert not can_arm(report) & HOLD
    assert unpack_from("<IB", report[LOW_BATTERY]) == (0xFFFFFFFF, 11)
    assert not any("battery" in text for text in bench.texts)


def test_the_checks_on_request_answer_with_an_ack_and_the_report_and_no_text() -> None:
    bench = Bench(battery_remaining=0.12)
    bench.run(5.0)
    texts, seen = len(bench.texts), len(events(bench))
    assert bench.command(RUN_CHECKS) is Result.ACCEPTED
    bench.run(0.1)
    again = events(bench)[seen:]
    assert (again[0].id_, again[-1].id_) == (SUMMARY, END)
    assert len(bench.texts) == texts


def test_a_mode_that_cannot_be_armed_in_is_a_reason_only_while_it_is_the_current_one() -> None:
    bench = Bench()
    bench.get_ready()
    bench.command(RUN_CHECKS)
    bench.run(0.1)
    assert NOT_IN_THIS_MODE not in newest_report(bench)
    assert bench.set_mode("Land") is Result.ACCEPTED
    bench.command(RUN_CHECKS)
    bench.run(0.1)
    assert NOT_IN_THIS_MODE in newest_report(bench)


def test_what_has_no_event_is_a_reason_all_the_same() -> None:
    bench = Bench()
    bench.get_ready()
    bench.autopilot.craft.fault = "a motor is missing"
    bench.command(RUN_CHECKS)
    bench.run(0.1)
    assert can_arm(newest_report(bench)) == 0


def test_reports_come_on_change_only() -> None:
    bench = Bench()
    bench.get_ready()
    bench.run(4.0)
    before = bench.counts["EVENT"]
    bench.run(20.0)
    assert bench.counts["EVENT"] == before
    assert bench.counts["CURRENT_EVENT_SEQUENCE"] >= 8


def test_ardupilot_explains_by_texts_and_sends_no_events() -> None:
    bench = Bench("ardupilot", battery_remaining=0.05)
    bench.run(5.0)
    bench.command(RUN_CHECKS)
    bench.run(0.1)
    assert any("battery low" in text for text in bench.texts)
    assert bench.counts["EVENT"] == bench.counts["CURRENT_EVENT_SEQUENCE"] == 0


def test_missed_events_are_sent_again_on_request_and_those_that_are_gone_are_named() -> None:
    sender, station = EventSender(Address(1, 1)), Address(255, 190)
    kind = EventKind("check_modes_attitude", EventLevel.CRITICAL, "")
    for _ in range(30):
        sender.send(kind, 1.0)
    sent = [out for out in sender.outgoing() if out.name == "EVENT"]
    assert [event.sequence for event in sent[9:13]] == [65535, 0, 1, 2]
    request = message("REQUEST_EVENT", target_system=1, target_component=1, first_sequence=65535, last_sequence=1)
    sender.receive(request, station, 2.0)
    answers = sender.outgoing()
    assert [(answer.name, answer.sequence) for answer in answers] == [
        ("RESPONSE_EVENT_ERROR", 65535),
        ("EVENT", 0),
        ("EVENT", 1),
    ]
    assert answers[0].sequence_oldest_available == 0


def test_the_metadata_names_every_event_and_the_modes_of_each_bit() -> None:
    bench = Bench()
    bench.get_ready()
    bench.run(3.0)
    assert bench.command(REQUEST, METADATA) is Result.ACCEPTED
    told = bench.last("COMPONENT_METADATA")
    assert told.uri == f"mftp://{GENERAL}"
    general = unpacked(bench, told.uri, told.file_crc)
    rows = {row["type"]: row for row in general["metadataTypes"]}
    parameters = unpacked(bench, rows[1]["uri"], rows[1]["fileCrc"])["parameters"]
    assert {row["name"] for row in parameters} == set(bench.sim.autopilot.parameters)
    described = unpacked(bench, rows[4]["uri"], rows[4]["fileCrc"])["components"]["1"]
    numbers = {int(number) for group in described["event_groups"].values() for number in group["events"]}
    assert {event.id_ & 0xFFFFFF for event in events(bench)} <= numbers
    assert described["navigation_mode_groups"]["groups"]["4"] == [4 << 16 | 3 << 24]
    assert described["enums"]["health_component_t"]["entries"]["2048"]["name"] == "battery"


def unpacked(bench: Bench, uri: str, crc: int) -> Any:
    path = uri.removeprefix("mftp://")
    files = bench.sim.front.files
    data = files.read(path, 0, files.size(path))
    assert checksum([data]) == crc
    return json.loads(lzma.decompress(data))
