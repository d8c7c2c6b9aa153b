"""A link of the onboard process: listened to, routed, and paced on a serial line."""

import asyncio
from collections.abc import Callable

from gloc3.clock import run_virtual
from gloc3.link.codec import Encoder, Frame, Parser, message
from gloc3.link.message import Address
from gloc3.link.router import Router
from gloc3_onboard.routing import RoutedLink

AUTOPILOT, STATION, OWN, FORGER = Encoder(1, 1), Encoder(255, 190), Encoder(1, 191), Encoder(77, 190)


class Wire:
    """An endpoint that keeps what it is given, with the time."""

    is_datagram = False
    url, problem, local_port = "wire", "", None
    is_connected = True
    bytes_received = bytes_sent = dropped = 0

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self.sent: list[tuple[float, Frame]] = []

    def send(self, data: bytes) -> None:
        self.sent += [(self._loop.time(), frame) for frame in Parser(is_datagram=True).receive(data)]

    async def close(self) -> None:
        """Nothing is open."""

    def names(self) -> list[str]:
        return [frame.shape.name for _, frame in self.sent if frame.shape is not None]


def links(loop: asyncio.AbstractEventLoop, *urls: str) -> tuple[list[RoutedLink], list[Wire], list[list[Frame]]]:
    router = Router(Address(1, 191))
    heard: list[list[Frame]] = [[] for _ in urls]

    def listener(into: list[Frame]) -> Callable[[list[Frame]], list[Frame]]:
        def listen(frames: list[Frame]) -> list[Frame]:
            into.extend(frames)
            return [frame for frame in frames if frame.system != FORGER.address.system]

        return listen

    routed = [RoutedLink(url, router, loop, listener(into)) for url, into in zip(urls, heard, strict=True)]
    wires = [Wire(loop) for _ in urls]
    for link, wire in zip(routed, wires, strict=True):
        link.open(wire)
    return routed, wires, heard


def test_pieces_of_a_stream_are_heard_and_passed_on_as_whole_frames() -> None:
    async def work() -> None:
        (autopilot, station), wires, heard = links(
            asyncio.get_running_loop(), "serial:///dev/ttyACM0:921600", "udpin://0.0.0.0:14550"
        )
        raw = b"".join(AUTOPILOT.encode(message("ATTITUDE", time_boot_ms=number + 1)) for number in range(10))
        for start in range(0, len(raw), 7):
            autopilot.receive(b"\x00" + raw[start : start + 7] if start == 0 else raw[start : start + 7])
        assert len(heard[0]) == 10
        assert b"".join(frame.raw for _, frame in wires[1].sent) == raw
        assert wires[0].sent == []
        assert station.routed.counts.frames_out == 10

    run_virtual(work())


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
                radio.send(OWN.encode(message("HEARTBEAT", type=18)))
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


def test_what_the_listener_takes_for_forged_is_not_passed_on() -> None:
    async def work() -> None:
        (station, _), wires, heard = links(asyncio.get_running_loop(), "udpin://0.0.0.0:14550", "udpin://0.0.0.0:14540")
        station.receive(FORGER.encode(message("COMMAND_LONG", command=400)) + STATION.encode(message("HEARTBEAT")))
        assert len(heard[0]) == 2
        assert wires[1].names() == ["HEARTBEAT"]

    run_virtual(work())


def test_a_closed_link_leaves_no_timer_and_sends_nothing() -> None:
    async def work() -> None:
        loop = asyncio.get_running_loop()
        (radio,), (wire,), _ = links(loop, "serial:///dev/ttyUSB0:57600")
        for number in range(100):
            radio.send(OWN.encode(message("PARAM_VALUE", param_id=f"P{number}", param_value=1)))
        radio.close()
        sent = len(wire.sent)
        await asyncio.sleep(5.0)
        assert len(wire.sent) == sent < 100

    run_virtual(work())
