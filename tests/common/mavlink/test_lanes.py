"""Lanes: what takes the short way through the router goes, and is counted, as what takes the long one."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from enum import StrEnum
from functools import cache, partial
from random import Random

import msgspec
import pytest

from gloc3.mavlink.codec import Encoder, Frame, Parser, message
from gloc3.mavlink.message import Address
from gloc3.mavlink.router import LOOK_AGAIN_S, MOVED_AFTER_S, Router, RouterLink
from gloc3.mavlink.services.compiling import can_compile, kept_at, load, prepare
from gloc3.mavlink.services.fast_line import FastLine, Loop, Outgoing
from gloc3.mavlink.services.lanes import Lanes

pytestmark = pytest.mark.thorough

NAMES = ("vehicle", "radio", "wifi")


def _put(out: list[bytes], frames: Sequence[Frame]) -> None:
    out.extend(frame.raw for frame in frames)


class Way(StrEnum):
    """How frames go through the router."""

    LONG = "by the router alone"
    LANES = "by lanes"
    COMPILED = "by lanes in a compiled loop, with sockets at both ends"


class Net:
    """Three links."""

    def __init__(self, way: Way) -> None:
        self.router = Router(Address(1, 191))
        self.out: dict[str, list[bytes]] = {name: [] for name in NAMES}
        self.links: dict[str, RouterLink] = {}
        self.short = self.sent = 0
        self.lanes: dict[str, Lanes] = {}
        self.lines: dict[str, Line] = {}
        for name in NAMES:
            out = self.out[name]
            link = self.links[name] = self.router.attach(name, partial(_put, out))
            link.post = out.append
            if way is not Way.LONG:
                self.lanes[name] = Lanes(self.router, link)
            if way is Way.COMPILED:
                line = self.lines[name] = Line()
                self.lanes[name].hasten(line.fast)
                link.outgoing = partial(self._outgoing, line)

    def hear(self, name: str, raw: bytes, now_s: float) -> None:
        lanes = self.lanes.get(name)
        if self.lines and self._passes(self.lines[name], raw):
            return
        if lanes is not None and lanes.pass_on(raw):
            self.short += not self.lines
            return
        frames = Parser(is_datagram=True).receive(raw)
        self.router.route(self.links[name], frames, now_s)
        if lanes is not None:
            lanes.learn(raw, now_s)

    def settle(self, now_s: float) -> None:
        self.router.turn(now_s)
        for lanes in self.lanes.values():
            lanes.settle(now_s)

    def close(self) -> None:
        for lanes in self.lanes.values():
            lanes.end()
        for line in self.lines.values():
            for each in line.sockets:
                each.close()

    def _passes(self, line: Line, raw: bytes) -> bool:
        line.far_in.send(raw)
        size = line.fast.serve(line.room)
        assert abs(size) == len(raw)
        assert line.room[: abs(size)] == raw
        for name, other in self.lines.items():
            with suppress(BlockingIOError):
                while True:
                    self.out[name].append(other.far_out.recv(65_535, socket.MSG_DONTWAIT))
        self.short += size < 0
        return size < 0

    def _outgoing(self, line: Line) -> list[Outgoing]:
        return [Outgoing(line.out.fileno(), self._sent)]

    def _sent(self, size: int, dropped: int, problem: str) -> None:
        assert (dropped, problem) == (0, "")
        self.sent += size


class Line:
    """What a compiled loop receives from and sends to, and the far ends."""

    def __init__(self) -> None:
        pair = partial(socket.socketpair, socket.AF_UNIX, socket.SOCK_DGRAM)
        (self.far_in, own), (self.out, self.far_out) = pair(), pair()
        self.sockets = (self.far_in, own, self.out, self.far_out)
        self.room = bytearray(65_535)
        order = memoryview(bytearray(16)).cast("q")
        self.fast = FastLine(loop(), own.fileno(), order, is_wanted=True, seed=7, flags=socket.MSG_DONTWAIT)


@cache
def loop() -> Loop:
    """What is compiled, as the process has it."""
    if not can_compile():
        pytest.skip("numba is not installed, or this is not Linux")
    prepare(kept_at())
    return load(kept_at())


@pytest.fixture
def nets() -> Iterator[Callable[[Way], Net]]:
    made: list[Net] = []

    def make(way: Way) -> Net:
        made.append(Net(way))
        return made[-1]

    yield make
    for net in made:
        net.close()


SHORT = (Way.LANES, Way.COMPILED)


@pytest.mark.parametrize(("way", "seed"), [(Way.LANES, 0), (Way.LANES, 1), (Way.COMPILED, 1), (Way.COMPILED, 2)])
def test_the_short_way_leads_where_the_long_one_does(
    seed: int, way: Way, nets: Callable[[Way], Net], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "gloc3.mavlink.router.LOOK_AGAIN_S", 0.0
    )  # otherwise either may be late by so much, and not by the same
    chance, now_s = Random(seed), 0.0
    short, long = nets(way), nets(Way.LONG)
    who = {"vehicle": [Encoder(1, 1), Encoder(1, 100)], "radio": [Encoder(255, 190)], "wifi": [Encoder(254, 190)]}
    said: list[tuple[str, bytes]] = []
    for step in range(3000):
        now_s += chance.choice([0.001, 0.01, 0.3, 3.0 if chance.random() < 0.05 else 0.001])
        name = chance.choice(NAMES)
        kind = chance.random()
        if kind < 0.7 or not said:
            what = chance.choice(["ATTITUDE", "HEARTBEAT", "COMMAND_LONG", "SYSTEM_TIME"])
            fields = {"target_system": chance.choice([0, 1, 255, 254, 9])} if what == "COMMAND_LONG" else {}
            fields |= {"time_boot_ms": round(now_s * 1000)} if what in ("ATTITUDE", "SYSTEM_TIME") else {}
            raw = chance.choice(who[name]).encode(message(what, **fields))
        elif kind < 0.8:
            _, raw = chance.choice(said[-20:])  # comes back, by any link
        elif kind < 0.9:
            raw = bytes([*said[-1][1][:-1], said[-1][1][-1] ^ 1])  # damaged
        elif kind < 0.95:
            some = [
                chance.choice(who[name]).encode(message("ATTITUDE", roll=step, pitch=number)) for number in range(4)
            ]
            raw = b"".join(some[: chance.randrange(2, 5)])
        else:
            raw = Encoder(chance.randrange(2, 6), 1).encode(message("ATTITUDE", roll=step))  # somebody new, or moved
        said.append((name, raw))
        for net in (short, long):
            net.settle(now_s)
            net.hear(name, raw, now_s)
            net.settle(now_s)
    for name in NAMES:
        assert b"".join(short.out[name]) == b"".join(long.out[name])
    assert any(len(Parser(is_datagram=True).receive(data)) > 1 for data in short.out["radio"]), "some left together"
    for name in NAMES:
        counted = [msgspec.structs.asdict(net.links[name].counts) for net in (short, long)]
        assert counted[0] == counted[1]
    assert short.short > 150


@pytest.mark.parametrize("way", SHORT)
def test_a_lane_ends_when_a_route_changes_and_after_a_while(way: Way, nets: Callable[[Way], Net]) -> None:
    net, vehicle = nets(way), Encoder(1, 1)
    net.hear("radio", Encoder(255, 190).encode(message("HEARTBEAT")), 0.0)
    for number in range(3):
        net.hear("vehicle", vehicle.encode(message("ATTITUDE", roll=number)), 0.0)
    assert net.short == 2
    net.hear("wifi", vehicle.encode(message("ATTITUDE", roll=7)), 0.1)
    assert len(net.out["wifi"]) == 4
    net.hear("vehicle", vehicle.encode(message("ATTITUDE", roll=8)), 0.2)
    assert len(net.out["wifi"]) == 4, "nobody hears itself"
    for number in range(12):
        net.settle(1.0 + number)
        net.hear("vehicle", vehicle.encode(message("ATTITUDE", roll=10 + number)), 1.0 + number)
    assert MOVED_AFTER_S + LOOK_AGAIN_S < 1.0 + 11.0
    assert len(net.out["wifi"]) > 4, "it is heard there no more"


def test_a_compiled_line_that_has_ended_is_missed_by_nobody(nets: Callable[[Way], Net]) -> None:
    net, vehicle = nets(Way.COMPILED), Encoder(1, 1)
    frames = [vehicle.encode(message("ATTITUDE", roll=number)) for number in range(5)]
    for raw in frames[:3]:
        net.hear("vehicle", raw, 0.0)
    assert net.short == 2
    net.lanes["vehicle"].end()
    net.hear("wifi", frames[2], 0.1)
    assert net.links["wifi"].counts.returned == 1, "what it has passed on is still known"
    for number in range(5):
        net.settle(1.0 + number)
    assert net.links["vehicle"].counts.frames_in == 3, "and counted"
    assert net.sent == 2 * len(frames[1] + frames[2])
    for raw in frames[3:]:
        net.hear("vehicle", raw, 6.0)
    assert net.out["wifi"] == frames
    net.hear("wifi", frames[2], 6.1)
    assert (1 << 8 | 1) in net.links["wifi"].senders, "so much later it is another one"


def test_what_a_compiled_line_has_passed_on_is_known_where_its_sender_is_heard_next(
    nets: Callable[[Way], Net],
) -> None:
    net, vehicle = nets(Way.COMPILED), Encoder(1, 1)
    frames = [vehicle.encode(message("ATTITUDE", roll=number)) for number in range(5)]
    for raw in frames[:3]:
        net.hear("vehicle", raw, 0.0)
    for raw in frames[3:]:
        net.hear("wifi", raw, 0.1)
    net.hear("wifi", frames[2], 0.1)
    assert net.links["wifi"].counts.returned == 1
    assert net.out["radio"] == frames


def test_what_came_by_another_link_before_a_restart_is_not_taken_by_a_compiled_line(
    nets: Callable[[Way], Net],
) -> None:
    net, vehicle = nets(Way.COMPILED), Encoder(1, 1)
    first, by_wifi, later = (vehicle.encode(message("ATTITUDE", roll=number)) for number in range(3))
    net.hear("vehicle", first, 0.0)
    net.hear("wifi", by_wifi, 0.0)
    for boot_ms in (600_000, 1_000):
        net.hear("vehicle", vehicle.encode(message("SYSTEM_TIME", time_boot_ms=boot_ms)), 0.1)
    net.hear("vehicle", later, 0.1)
    net.hear("vehicle", by_wifi, 0.1)
    assert net.links["vehicle"].counts.returned == 1
    assert net.out["radio"].count(by_wifi) == 1
