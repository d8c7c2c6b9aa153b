"""The whole onboard process of a platform in virtual time, with any peer at the autopilot's end of the cable."""

import asyncio
from collections.abc import Callable, Coroutine
from pathlib import Path
from random import Random
from typing import Any, Generic, TypeVar

from tests.direct_link import wire

from gloc3.clock import Clock, VirtualLoop
from gloc3.exchange import LocalExchange
from gloc3.mavlink.transport.memory import Conditions, MemoryEnd, MemoryLink
from gloc3.messages.command_interface import CiReply, Outcome, Steer, Verb
from gloc3.messages.envelope import Envelope
from gloc3.messages.summaries import CiEvent
from gloc3.messages.topics import TopicTable
from gloc3.platform.reader import load_platform
from gloc3.store import MemoryRecords
from gloc3_groundstation.station.command_client import CommandClient
from gloc3_onboard.autopilot.device import AutopilotDevice
from gloc3_onboard.autopilot.link import AutopilotLink
from gloc3_onboard.autopilot.link_reports import LinkReports
from gloc3_onboard.command_server.site import Site
from gloc3_onboard.process.computer import SimulatedComputer
from gloc3_onboard.process.memory import RecordMemory
from gloc3_onboard.process.runner import Onboard
from gloc3_onboard.process.storage import NoPictures
from gloc3_onboard.process.taps import ExchangeTaps
from gloc3_onboard.sensors.rig import PlatformRig
from gloc3_onboard.viewer.catalogue import Catalogue
from gloc3_sitl.flight.sim_devices import NoDevice

T = TypeVar("T")
PeerT_co = TypeVar("PeerT_co", covariant=True)
MakePeer = Callable[[VirtualLoop, MemoryEnd, tuple[float, float, float], dict[str, int]], PeerT_co]
"""Of the loop, the autopilot's end of the cable, the place on Earth, and parameters that differ from the defaults."""
STATION = "255"


class VehicleStack(Generic[PeerT_co]):
    """A platform by name, and a vehicle of the given kind."""

    def __init__(self, platform: str, kind: MakePeer[PeerT_co], parameters: dict[str, int]) -> None:
        self.runner = asyncio.Runner(loop_factory=VirtualLoop)
        loop = self.runner.get_loop()
        assert isinstance(loop, VirtualLoop)
        self.loop, self.exchange = loop, LocalExchange()
        self.platform = load_platform(platform)
        self.received: dict[str, Envelope[Any]] = {}
        self.events: list[str] = []
        name = self.platform.platform
        self.exchange.subscribe(f"{name}/**", self._receive)
        cable = MemoryLink(loop, Random(1), Conditions(latency_s=0.01))
        origin = next(iter(self.platform.frames.values())).origin.geo
        self.peer = kind(loop, cable.b, origin, parameters)
        clock, topics = Clock(loop), TopicTable.installed()
        self.link = AutopilotLink(loop, clock, report=LinkReports(self.exchange, name, 3, loop.time).report)
        self.device = AutopilotDevice(self.link)
        devices = {
            "autopilot": self.device,
            "computer": SimulatedComputer(clock, list),
            "rig": PlatformRig(self.platform, Path()),
            "ground_camera": NoDevice(),
            "memory": RecordMemory(MemoryRecords(), ""),
            "pictures": NoPictures(),
            "site": Site(self.platform, MemoryRecords(), MemoryRecords(), MemoryRecords()),
            "taps": ExchangeTaps(self.exchange, loop, name),
            "catalogue": Catalogue(self.platform, topics),
        }
        self.onboard = Onboard.of(self.platform, loop, self.exchange, topics, Random(2), devices)
        wire(self.link, cable.a, loop)
        self.onboard.begin()
        self.client = CommandClient(self.exchange, loop, STATION, boot=1)

    def _receive(self, envelope: Envelope[Any]) -> None:
        self.received[envelope.topic.partition("/")[2]] = envelope
        if isinstance(envelope.payload, CiEvent):
            self.events.append(f"{envelope.t_s:7.2f} {envelope.payload.source}: {envelope.payload.text}")

    def run(self, steps: Coroutine[Any, Any, T]) -> T:
        return self.runner.run(steps)

    def last(self, topic: str) -> Any:
        return self.received[topic].payload

    def wait(self, seconds: float) -> None:
        self.run(asyncio.sleep(seconds))

    def until(self, condition: Callable[[], bool], within_s: float, what: str) -> None:
        end_s = self.loop.time() + within_s
        while not condition():
            assert self.loop.time() < end_s, "\n".join([f"not within {within_s:g} s: {what}", *self.events[-20:]])
            self.wait(0.05)

    def request(self, body: Any) -> CiReply:
        return self.run(self.client.request(self.platform.platform, body))

    def steer(self, verb: Verb) -> None:
        reply = self.request(Steer(verb=verb))
        assert reply.outcome is Outcome.ACCEPTED, reply.reason

    def upload(self, text: str) -> None:
        self.run(self.client.request_control(self.platform.platform))
        self.run(self.client.upload(self.platform.platform, "mission.yaml", text))

    @property
    def mission(self) -> str:
        return str(self.last("ci/mission").state)

    def close(self) -> None:
        self.onboard.close()
        self.link.close()
        self.client.close()
        failures = self.loop.failures
        self.runner.close()
        assert failures == []
