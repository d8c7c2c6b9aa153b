"""A signed link behind the router, and somebody without the key who tries everything: nothing of it gets through or stays."""

import asyncio
import gc
import tracemalloc
from collections import deque
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

import msgspec

from gloc3.clock import Clock, run_virtual
from gloc3.exchange import LocalExchange, Publisher
from gloc3.mavlink.codec import Encoder, Frame, MavlinkMessage, Parser, message
from gloc3.mavlink.message import Address
from gloc3.mavlink.parser import SIGNED
from gloc3.mavlink.router import MOST_ADDRESSES, Router
from gloc3.mavlink.signing import MAY_BE_OFF, TICKS_PER_S, Signing, is_signed_with, timestamp
from gloc3.mavlink.transport.memory import MemoryLink
from gloc3.messages.command_interface import CiRequest, Hello
from gloc3.messages.envelope import Envelope, Event
from gloc3.messages.topics import TopicTable
from gloc3_groundstation.links.link import LinkContext, LinkSettings, StationLinkCore
from gloc3_onboard.autopilot.link import AutopilotLink
from gloc3_onboard.companion.routing import RoutedLink
from gloc3_onboard.companion.station_link import StationLink, StationLinkSettings
from gloc3_onboard.process.process_storage import SigningMemory

KEY, OTHER = bytes(range(32)), bytes(range(1, 33))
STATION_AGAIN = Encoder(255, 190)
ARM = message("COMMAND_LONG", target_system=1, target_component=1, command=400, param1=1.0)
TAKE_OVER = message("CHANGE_OPERATOR_CONTROL", target_system=1, control_request=0, passkey="please")
UNKNOWN_ID = 54_321
YEAR_S = 365 * 86_400.0


class Figures(msgspec.Struct, kw_only=True):
    """What one run showed."""

    attacks: int = 0
    """Frames that were sent without the key, on the signed link."""
    refused: dict[str, int] = {}
    """By reason, what the link counted."""
    reached_autopilot: int = 0
    """Frames of the attacker that the autopilot was given; of the commands of a second station, too."""
    reached_companion: int = 0
    """Requests of theirs that reached the command interface."""
    told: int = 0
    """Events about it: each reason at most once a minute."""
    still_served: bool = False
    """Whether the true station is heard as before, afterwards, by autopilot and companion."""
    from_future: int = 0
    """Frames of somebody with the key whose clock is a year fast, all sent to the signed link."""
    from_future_refused: int = 0
    moved_s: float = 0.0
    """How far they have moved the link's own signing time."""
    replayed: int = 0
    """Frames of the true station, of the minute before the onboard process was killed, sent again to the next one."""
    taken_again: int = 0
    invented: int = 0
    """Frames of foreign systems on a link without a key."""
    senders: int = 0
    """Those that the router remembers of them."""
    flood_still_served: bool = False
    """Whether a true station on that link reaches the autopilot through it all."""
    growth_bytes: int = 0
    """Memory that is held after the last two rounds of everything, and was not before."""


class _Scene:
    def __init__(self, folder: Path) -> None:
        loop = asyncio.get_running_loop()
        self.loop, topics = loop, TopicTable.installed()
        self.clock = Clock(loop)
        self.here, self.there = LocalExchange(), LocalExchange()
        self.requests: list[Envelope[CiRequest]] = []
        self.events: list[str] = []
        self.here.subscribe("heron/ci/request", self.requests.append)
        self.here.subscribe("heron/components/station_link/event", self._event)
        router = Router(Address(1, 191))
        self.memory, self.cable = MemoryLink(loop, Random(1)), MemoryLink(loop, Random(2))
        self.folder = folder
        self.ours = self.remembered()
        self.platform = StationLink("heron", 1, loop, self.here, topics, 7, StationLinkSettings(signing=self.ours))
        self.autopilot = AutopilotLink(loop, self.clock)
        vehicle = RoutedLink("udpin://:14540", router, loop, [self.autopilot.receive_frames])
        self.radio = RoutedLink(
            "serial:///dev/ttyUSB0:57600",
            router,
            loop,
            [self.platform.receive_frames],
            signed_only=self.platform.signed_only,
        )
        self.open = RoutedLink("udpin://:14560", router, loop)
        self.sink = MemoryLink(loop, Random(3))
        for routed, end in ((vehicle, self.cable.a), (self.radio, self.memory.b), (self.open, self.sink.a)):
            end.on_data = routed.receive
            routed.open(end)
        self.platform.open(self.radio)
        self.autopilot.open(vehicle)
        self.at_autopilot: list[bytes] = []
        self.cable.b.on_data = self.at_autopilot.append
        self.reported: list[str] = []
        self.station = StationLinkCore(
            self._station_sends,
            LinkContext(loop=loop, exchange=self.there, topics=topics, boot=8, report=self.reported.append),
            LinkSettings(key=KEY),
        )
        self.memory.a.on_data = self.station.receive
        self.recorded: list[bytes] = []
        self.latest: deque[bytes] = deque(maxlen=200)
        self._pilot = Encoder(1, 1)

    def signing(self, key: bytes, link_id: int, offset_s: float = 0.0) -> Signing:
        return Signing(key, link_id=link_id, now=timestamp(self.clock.utc_s() + offset_s))

    def remembered(self) -> Signing:
        """The onboard process's end of the signed link, as it begins after whatever was before."""
        return SigningMemory(self.folder, self.clock, self.events.append).signing(KEY, 1)

    def _event(self, envelope: Envelope[Event]) -> None:
        self.events.append(envelope.payload.text)

    def _station_sends(self, data: bytes) -> None:
        if len(self.recorded) < 200:
            self.recorded.append(data)
        self.latest.append(data)
        self.memory.a.send(data)

    async def is_served(self, sequence: int) -> bool:
        """Whether the true station reaches the autopilot and the companion."""
        before, received = len(self.requests), len(self.at_autopilot)
        self.cable.b.send(self._pilot.encode(message("HEARTBEAT", type=2, autopilot=12, mavlink_version=3)))
        await asyncio.sleep(1.0)
        self.station.send(ARM)
        request = CiRequest(sender="255", boot=8, sequence=sequence, body=Hello())
        Publisher(self.there, "station", "client", 8).publish("heron/ci/request", request, self.loop.time())
        await asyncio.sleep(4.0)
        commands = [
            frame
            for frame in _frames(self.at_autopilot[received:])
            if frame.system == 255 and frame.message_id == ARM.id
        ]
        return len(self.requests) == before + 1 and len(commands) == 1 and commands[0].is_signed

    def attacks(self, count: int, seed: int) -> list[bytes]:
        """Frames of somebody who has heard all and has no key, `count` of each kind."""
        chance, forger = Random(seed), Encoder(255, 190, self.signing(OTHER, 2))
        future = Encoder(255, 190, Signing(OTHER, link_id=2, now=(1 << 48) - 2 - 2 * count))
        late = Encoder(255, 190, self.signing(KEY, 77, offset_s=-3600.0))
        wanted: list[MavlinkMessage] = [ARM, TAKE_OVER, message("HEARTBEAT", type=6)]
        frames = []
        for number in range(count):
            what = wanted[number % len(wanted)]
            frames += [
                STATION_AGAIN.encode(what),  # a second station in its name
                Encoder(chance.randrange(1, 255), chance.randrange(1, 255)).encode(what),
                Encoder(1, 1).encode(
                    message("HEARTBEAT", type=2, autopilot=12)
                ),  # it would like the autopilot's routes
                forger.encode(what),
                future.encode(what),
                late.encode(what),  # recorded an hour ago, on a link that is new
                chance.choice(self.recorded),
                _unknown(chance),
            ]
        return frames

    def close(self) -> None:
        self.station.close()
        self.platform.close()
        self.autopilot.close()


def _unknown(chance: Random) -> bytes:
    """A message that nobody knows, with a signature that is none: pymavlink lets it through before it looks."""
    body = bytes([4, SIGNED, 0, chance.randrange(256), 255, 190]) + UNKNOWN_ID.to_bytes(3, "little")
    return b"\xfd" + body + chance.randbytes(4) + chance.randbytes(2) + b"\x02" + b"\xff" * 6 + chance.randbytes(6)


def _frames(pieces: list[bytes]) -> list[Frame]:
    parser = Parser(is_datagram=True)
    return [frame for piece in pieces for frame in parser.receive(piece)]


def scenario(count: int, rounds: int = 4) -> Figures:
    """Everything, `count` times, and some rounds more, in virtual time."""
    with TemporaryDirectory() as folder:
        return run_virtual(_run(count, rounds, Path(folder)))


async def _run(count: int, rounds: int, folder: Path) -> Figures:
    scene, figures = _Scene(folder), Figures()
    assert await scene.is_served(0)
    received, requests = len(scene.at_autopilot), len(scene.requests)
    figures.attacks = await _attack(scene, count, 1)
    figures.refused = scene.platform.signed_only.refused() if scene.platform.signed_only else {}
    strange = [frame for frame in _frames(scene.at_autopilot[received:]) if frame.system != 1]
    figures.reached_autopilot = sum(not _is_genuine(frame) for frame in strange)
    figures.reached_companion = len(scene.requests) - requests
    figures.told = len(scene.events)
    figures.still_served = await scene.is_served(1)
    _wrong_clock(scene, count, figures)
    await _flood(scene, count, figures)
    tracemalloc.start()
    held = [await _held(scene, count, 2 + round_) for round_ in range(rounds)]
    tracemalloc.stop()
    figures.growth_bytes = held[-1] - held[-3]
    figures.still_served = figures.still_served and await scene.is_served(2)
    scene.close()
    await asyncio.sleep(1.0)
    next_one = scene.remembered()
    frames = [frame for frame in _frames(list(scene.latest)) if next_one.timestamp - _time(frame) < MAY_BE_OFF]
    figures.replayed = len(frames)
    figures.taken_again = sum(next_one.verify(frame).is_good for frame in frames)
    return figures


def _wrong_clock(scene: _Scene, count: int, figures: Figures) -> None:
    """Somebody with the key whose clock is a year fast."""
    sender, refused, time = (
        Encoder(250, 190, scene.signing(KEY, 5, offset_s=YEAR_S)),
        scene.ours.refused,
        scene.ours.timestamp,
    )
    for _ in range(count):
        scene.radio.receive(sender.encode(ARM))
    figures.from_future, figures.from_future_refused = count, scene.ours.refused - refused
    figures.moved_s = (scene.ours.timestamp - time) / TICKS_PER_S


def _time(frame: Frame) -> int:
    return int.from_bytes(frame.raw[-12:-6], "little")


async def _held(scene: _Scene, count: int, seed: int) -> int:
    """What is held after everything once more."""
    await _attack(scene, count, seed)
    await _flood(scene, count, Figures())
    await asyncio.sleep(10.0)
    scene.at_autopilot.clear()
    gc.collect()
    return tracemalloc.get_traced_memory()[0]


async def _attack(scene: _Scene, count: int, seed: int) -> int:
    """A hundred at a time, so that the true ones come in between."""
    frames = scene.attacks(count, seed)
    for start in range(0, len(frames), 100):
        for frame in frames[start : start + 100]:
            scene.radio.receive(frame)
        await asyncio.sleep(0.01)
    return len(frames)


async def _flood(scene: _Scene, count: int, figures: Figures) -> None:
    """Foreign systems by the thousand on a link without a key, behind a station that was there before."""
    station, chance = Encoder(254, 190), Random(count)
    scene.open.receive(station.encode(message("HEARTBEAT", type=6)))
    for number in range(count):
        who = Encoder(2 + number // 250 % 250, 1 + number % 250)
        scene.open.receive(who.encode(message("HEARTBEAT", type=chance.randrange(30), autopilot=8)))
        if number % 100 == 0:
            scene.open.receive(chance.randbytes(300))
            await asyncio.sleep(0.001)
    received = len(scene.at_autopilot)
    scene.open.receive(station.encode(ARM))
    await asyncio.sleep(0.1)
    figures.invented, figures.senders = count, len(scene.open.routed.senders)
    figures.flood_still_served = any(
        frame.system == 254 and frame.message_id == ARM.id for frame in _frames(scene.at_autopilot[received:])
    )
    assert figures.senders <= MOST_ADDRESSES


def _is_genuine(frame: Frame) -> bool:
    return is_signed_with(KEY, frame)
