"""A link of the onboard process: listened to, routed, and paced on a serial line."""

import asyncio

import pytest
from tests.onboard.autopilot.test_autopilot_link import Rig

from gloc3.clock import run_virtual
from gloc3.mavlink import codec
from gloc3.mavlink.codec import Encoder, Frame, Parser, message
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.parser import FrameParser
from gloc3.mavlink.router import Router
from gloc3.mavlink.signing import SignedOnly, Signing
from gloc3_onboard.companion.routing import RoutedLink
from gloc3_onboard.sensors.devices import AutopilotSetpoint

AUTOPILOT, STATION, OWN, FORGER = Encoder(1, 1), Encoder(255, 190), Encoder(1, 191), Encoder(77, 190)


class Wire:
    """An endpoint that keeps what it is given, with the time."""

    is_datagram = False
    intruder = origin = ""
    url, problem, local_port = "wire", "", None
    is_connected = True
    bytes_received = bytes_sent = dropped = 0

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self.sent: list[tuple[float, Frame]] = []
        self.pieces: list[bytes] = []

    def send(self, data: bytes) -> None:
        self.pieces.append(data)
        self.sent += [(self._loop.time(), frame) for frame in Parser(is_datagram=True).receive(data)]

    async def close(self) -> None:
        """Nothing is open."""

    def names(self) -> list[str]:
        return [frame.shape.name for _, frame in self.sent if frame.shape is not None]


KEY = bytes(range(32))


def links(
    loop: asyncio.AbstractEventLoop, *urls: str, signing: Signing | None = None
) -> tuple[list[RoutedLink], list[Wire], list[list[Frame]]]:
    """Links with wires; the first has a key, if one is given."""
    router = Router(Address(1, 191))
    received: list[list[Frame]] = [[] for _ in urls]
    gate = None if signing is None else SignedOnly(signing, lambda _: None)
    routed = [
        RoutedLink(url, router, loop, [into.extend], signed_only=None if number else gate)
        for number, (url, into) in enumerate(zip(urls, received, strict=True))
    ]
    wires = [Wire(loop) for _ in urls]
    for link, wire in zip(routed, wires, strict=True):
        link.open(wire)
    return routed, wires, received


def test_pieces_of_a_stream_are_heard_and_passed_on_as_whole_frames() -> None:
    async def work() -> None:
        (autopilot, station), wires, received = links(
            asyncio.get_running_loop(), "serial:///dev/ttyACM0:921600", "udpin://0.0.0.0:14550"
        )
        raw = b"".join(AUTOPILOT.encode(message("ATTITUDE", time_boot_ms=number + 1)) for number in range(10))
        for start in range(0, len(raw), 7):
            autopilot.receive(b"\x00" + raw[start : start + 7] if start == 0 else raw[start : start + 7])
        assert len(received[0]) == 10
        assert b"".join(frame.raw for _, frame in wires[1].sent) == raw
        assert wires[0].sent == []
        assert station.routed.counts.frames_out == 10

    run_virtual(work())


def test_what_is_passed_on_is_never_decoded(monkeypatch: pytest.MonkeyPatch) -> None:
    decoded: list[str] = []
    decode = Frame.decode

    def seen(frame: Frame) -> MavlinkMessage | None:
        decoded.append("decoded")
        return decode(frame)

    async def work() -> None:
        (autopilot, station), wires, received = links(
            asyncio.get_running_loop(), "udpin://0.0.0.0:14540", "serial:///dev/ttyUSB0:57600"
        )
        monkeypatch.setattr(Frame, "decode", seen)
        for number in range(30):
            autopilot.receive(AUTOPILOT.encode(message("SYSTEM_TIME", time_boot_ms=number)))
            station.receive(STATION.encode(message("COMMAND_LONG", target_system=1, target_component=1)))
            await asyncio.sleep(0.1)
        monkeypatch.setattr(Frame, "decode", decode)
        assert [len(wire.sent) for wire in wires] == [30, 30]
        assert (decoded, received[0][0].decode()) == ([], message("SYSTEM_TIME"))

    run_virtual(work())


def test_a_setpoint_becomes_bytes_without_being_parsed(monkeypatch: pytest.MonkeyPatch) -> None:
    with Rig() as rig:
        rig.run(4.0)
        sent: list[bytes] = []
        monkeypatch.setattr(rig.wire.a, "send", sent.append)
        monkeypatch.setattr(FrameParser, "receive", fail)
        rig.device.send_setpoint(AutopilotSetpoint((1.0, 2.0, -3.0), None, None))
        monkeypatch.undo()
        assert [frame.message_id for frame in Parser().receive(b"".join(sent))] == [
            codec.shape("SET_POSITION_TARGET_LOCAL_NED").id
        ]


def fail(*_: object) -> list[Frame]:
    raise AssertionError("a frame of our own is parsed")


def test_what_is_forwarded_and_what_is_ours_share_a_radio_and_ours_hardly_waits() -> None:
    async def work() -> None:
        loop = asyncio.get_running_loop()
        (autopilot, radio), wires, _ = links(loop, "udpin://0.0.0.0:14540", "serial:///dev/ttyUSB0:57600")
        delays: list[float] = []
        for step in range(500):
            for instance in range(8):
                autopilot.receive(AUTOPILOT.encode(message("RAW_IMU", id_=instance, xacc=step + 1)))
            if step % 50 == 0:
                before = wires[1].names().count("HEARTBEAT")
                begin_s = loop.time()
                radio.send(OWN.frame(message("HEARTBEAT", type=18)))
                while wires[1].names().count("HEARTBEAT") == before:
                    await asyncio.sleep(0.001)
                delays.append(loop.time() - begin_s)
            await asyncio.sleep(0.01)
        carried = sum(len(frame.raw) for _, frame in wires[1].sent)
        assert 0.95 * 5760.0 * loop.time() < carried <= 5760.0 * (loop.time() + 0.06) + 280
        assert max(delays) < 0.15
        radio.close()
        autopilot.close()

    run_virtual(work())


def test_what_is_not_signed_on_a_signed_link_is_neither_heard_nor_passed_on_but_counted() -> None:
    async def work() -> None:
        signing = Signing(KEY, link_id=1, now=1)
        loop = asyncio.get_running_loop()
        (station, _), wires, received = links(loop, "udpin://0.0.0.0:14550", "udpin://0.0.0.0:14540", signing=signing)
        signer = Encoder(255, 190, Signing(KEY, link_id=2, now=1))
        good = signer.encode(message("HEARTBEAT"))
        station.receive(FORGER.encode(message("COMMAND_LONG", command=400)) + good + good)
        assert [frame.raw for frame in received[0]] == [good]
        assert wires[1].names() == ["HEARTBEAT"]
        traffic = station.condition().traffic
        assert (traffic.genuine, traffic.refused) == (1, {"not signed": 1, "a replayed frame": 1})

    run_virtual(work())


def test_frames_that_come_together_leave_a_network_together_and_never_too_large() -> None:
    async def work() -> None:
        (autopilot, *_), (_, network, line), _ = links(
            asyncio.get_running_loop(), "udpin://:14540", "udpin://:14550", "serial:///dev/ttyUSB0:57600"
        )
        raws = [AUTOPILOT.encode(message("RAW_IMU", id_=number, xacc=7)) for number in range(100)]
        autopilot.receive(b"".join(raws))
        assert b"".join(network.pieces) == b"".join(raws)
        assert len(network.pieces) == -(-sum(map(len, raws)) // 1400)
        assert max(map(len, network.pieces)) <= 1400
        assert all(piece in raws for piece in line.pieces), "a line gets frame by frame"
        autopilot.receive(raws[0])
        assert network.pieces[-1] == raws[0]

    run_virtual(work())


def test_a_radio_behind_a_network_gets_no_more_than_it_carries_and_the_rest_is_accounted_for() -> None:
    async def work() -> None:
        loop = asyncio.get_running_loop()
        (autopilot, radio), wires, _ = links(loop, "udpin://0.0.0.0:14540", "udpout://10.0.0.5:14550?rate=57600")
        for step in range(400):
            for instance in range(8):
                autopilot.receive(AUTOPILOT.encode(message("RAW_IMU", id_=instance, xacc=step + 1)))
            autopilot.receive(AUTOPILOT.encode(message("LOG_DATA", ofs=step, count=90, data=bytes(range(1, 91)))))
            if step % 100 == 0:
                radio.send(OWN.frame(message("HEARTBEAT", type=18)))
            await asyncio.sleep(0.01)
        carried = sum(map(len, wires[1].pieces))
        assert 0.95 * 5760.0 * loop.time() < carried <= 5760.0 * (loop.time() + 0.06) + 280
        assert wires[1].names().count("HEARTBEAT") == 4
        traffic = radio.condition().traffic
        assert radio.url == "udpout://10.0.0.5:14550"
        assert traffic.frames_out == len(wires[1].sent)
        assert traffic.dropped["bulk"] > 100
        assert traffic.overtaken > 100
        assert traffic.frames_out + traffic.overtaken + traffic.waiting + sum(traffic.dropped.values()) == 400 * 9 + 4
        assert "dropped" in traffic.describe()
        assert "overtaken" in traffic.describe()

    run_virtual(work())


def test_a_closed_link_leaves_no_timer_and_sends_nothing() -> None:
    async def work() -> None:
        loop = asyncio.get_running_loop()
        (radio,), (wire,), _ = links(loop, "serial:///dev/ttyUSB0:57600")
        for number in range(100):
            radio.send(OWN.frame(message("PARAM_VALUE", param_id=f"P{number}", param_value=1)))
        radio.close()
        sent = len(wire.sent)
        await asyncio.sleep(5.0)
        assert len(wire.sent) == sent < 100

    run_virtual(work())


def test_what_is_withheld_goes_to_the_listener_alone() -> None:
    async def work() -> None:
        loop = asyncio.get_running_loop()
        router, received = Router(Address(1, 191)), list[Frame]()
        withheld = message("MISSION_COUNT").id
        station = RoutedLink(
            "udpin://0.0.0.0:14550",
            router,
            loop,
            [received.extend],
            withheld=lambda frame: frame.message_id == withheld,
        )
        autopilot = RoutedLink("udpin://0.0.0.0:14540", router, loop)
        wire = Wire(loop)
        autopilot.open(wire)
        station.receive(STATION.encode(message("MISSION_COUNT")) + STATION.encode(message("HEARTBEAT")))
        assert len(received) == 2
        assert wire.names() == ["HEARTBEAT"]

    run_virtual(work())
