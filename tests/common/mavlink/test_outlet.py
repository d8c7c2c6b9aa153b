"""The way out of a slow link: rate, shares, what is latest, what finds no room."""

from collections import Counter
from typing import Any

import pytest

from gloc3.mavlink.codec import Encoder, Frame, Parser, message
from gloc3.mavlink.outlet import BURST_S, SHARES, LinkOutlet, TrafficKind

pytestmark = pytest.mark.thorough

RADIO_BYTE_S = 5760.0


class Line:
    """An outlet and what it has sent, in virtual time."""

    def __init__(self, rate_byte_s: float | None = RADIO_BYTE_S) -> None:
        self.sent: list[tuple[float, Frame]] = []
        self.now_s = 0.0
        self.outlet = LinkOutlet(self._send, rate_byte_s)
        self._encoder = Encoder(1, 1)

    def _send(self, raw: bytes) -> None:
        self.sent.extend((self.now_s, frame) for frame in Parser(is_datagram=True).receive(raw))

    def put(self, what: str, **fields: Any) -> None:
        for frame in Parser(is_datagram=True).receive(self._encoder.encode(message(what, **fields))):
            self.outlet.put(frame, self.now_s)

    def run_to(self, until_s: float) -> None:
        while (next_s := self.outlet.next_s()) is not None and next_s <= until_s:
            self.now_s = max(self.now_s, next_s)
            self.outlet.pump(self.now_s)
        self.now_s = until_s

    def names(self) -> list[str]:
        return [frame.shape.name for _, frame in self.sent if frame.shape is not None]

    def bytes_of(self, what: str) -> int:
        return sum(len(frame.raw) for _, frame in self.sent if frame.shape is not None and frame.shape.name == what)


def test_a_network_sends_at_once() -> None:
    line = Line(None)
    for number in range(1000):
        line.put("ATTITUDE", time_boot_ms=number)
    assert len(line.sent) == 1000
    assert line.outlet.next_s() is None


def test_a_line_is_never_given_more_than_it_carries_and_is_kept_busy() -> None:
    line = Line()
    for step in range(1000):
        line.put("LOG_DATA", ofs=step * 90, count=90, data=bytes(range(1, 91)))
        line.put("ATTITUDE", time_boot_ms=step + 1, roll=0.1, pitch=0.2, yaw=0.3)
        line.run_to((step + 1) * 0.01)
    total = sum(len(frame.raw) for _, frame in line.sent)
    assert total <= RADIO_BYTE_S * (10.0 + BURST_S) + 280
    assert total >= 0.97 * RADIO_BYTE_S * 10.0
    for second in range(10):
        within = sum(len(frame.raw) for t_s, frame in line.sent if second <= t_s < second + 1)
        assert within <= RADIO_BYTE_S * (1.0 + BURST_S) + 280


@pytest.mark.parametrize("flood", ["COMMAND_ACK", "PARAM_VALUE", "FILE_TRANSFER_PROTOCOL"])
def test_nothing_starves(flood: str) -> None:
    line = Line()
    for step in range(4000):
        for number in range(4):
            line.put(flood, **({"payload": bytes(range(1, 200))} if flood.startswith("FILE") else {}))
            line.put("RAW_IMU", id_=number, xacc=step % 100 + 1)
        line.put("PARAM_VALUE", param_id=f"P{step}", param_value=1)
        line.put("LOG_DATA", ofs=step, count=90, data=bytes(range(1, 91)))
        line.put("HEARTBEAT", type=2)
        line.run_to((step + 1) * 0.0025)
    whole = RADIO_BYTE_S * 10.0
    assert line.bytes_of("RAW_IMU") > 0.15 * whole
    assert line.bytes_of("PARAM_VALUE") > 0.15 * whole
    assert line.bytes_of("LOG_DATA") + line.bytes_of("FILE_TRANSFER_PROTOCOL") > 0.03 * whole
    assert line.bytes_of("HEARTBEAT") + line.bytes_of("COMMAND_ACK") > 0.3 * whole


def test_a_command_overtakes_what_waits_and_leaves_within_a_tenth_of_a_second() -> None:
    line = Line()
    for number in range(60):
        line.put("FILE_TRANSFER_PROTOCOL", target_network=number % 3, payload=bytes(range(1, 240)))
        line.put("PARAM_VALUE", param_id=f"P{number}", param_value=1)
        line.put("NAMED_VALUE_FLOAT", name_=f"v{number}", value=1.0)
    line.run_to(0.5)
    line.put("COMMAND_LONG", command=400)
    line.run_to(1.0)
    (left_s,) = [t_s for t_s, frame in line.sent if frame.shape is not None and frame.shape.name == "COMMAND_LONG"]
    assert left_s - 0.5 < 0.16


def test_of_telemetry_the_latest_waits_of_each_sender_and_instance() -> None:
    line = Line(1000.0)
    for round_ in range(50):
        line.put("ATTITUDE", time_boot_ms=round_ + 1)
        for battery in range(3):
            line.put("BATTERY_STATUS", id_=battery, current_consumed=round_ + 1)
    line.run_to(1.0)
    last = [frame.decode() for _, frame in line.sent]
    batteries = [each for each in last if each is not None and each.name == "BATTERY_STATUS"]
    assert {each.id_ for each in batteries} == {0, 1, 2}
    assert [each.current_consumed for each in batteries[-3:]] == [50, 50, 50]
    assert line.outlet.waiting == 0
    assert line.outlet.overtaken + len(line.sent) == 200


@pytest.mark.parametrize(
    ("what", "number"),
    [
        ("SERIAL_CONTROL", "baudrate"),
        ("COMMAND_CANCEL", "command"),
        ("EVENT", "sequence"),
        ("PARAM_EXT_VALUE", "param_index"),
        ("CAMERA_IMAGE_CAPTURED", "image_index"),
        ("ADSB_VEHICLE", "ICAO_address"),
        ("DEVICE_OP_READ", "request_id"),
    ],
)
def test_messages_that_belong_together_all_leave_in_order(what: str, number: str) -> None:
    line = Line()
    for each in range(1, 31):
        line.put(what, **{number: each})
    line.run_to(60.0)
    sent = [getattr(frame.decode(), number) for _, frame in line.sent]
    assert sent == list(range(1, 31))


def test_messages_that_the_dialect_does_not_define_all_leave_in_order() -> None:
    line = Line()
    for mode in range(1, 31):
        raw = bytes((0xFD, 1, 0, 0, mode, 1, 1, 435 & 0xFF, 435 >> 8, 0, mode, 0, 0))
        line.outlet.put(Frame(raw, 1, 1, mode, 435, 0, 10, 1, None), 0.0)
    line.run_to(60.0)
    assert [frame.payload[0] for _, frame in line.sent] == list(range(1, 31))


def test_missions_and_files_wait_in_order_and_what_finds_no_room_is_counted() -> None:
    line = Line()
    for seq in range(SHARES[TrafficKind.TRANSFER].most + 50):
        line.put("MISSION_ITEM_INT", seq=seq, x=1)
    line.run_to(60.0)
    seqs = [message.seq for _, frame in line.sent if (message := frame.decode()) is not None]
    assert seqs == sorted(seqs)
    assert line.outlet.dropped[TrafficKind.TRANSFER] + len(seqs) == SHARES[TrafficKind.TRANSFER].most + 50
    assert line.outlet.dropped[TrafficKind.TRANSFER] > 0
    assert Counter(line.names())["MISSION_ITEM_INT"] == len(seqs)
