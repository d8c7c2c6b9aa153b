"""A process that is many vehicles at once, as a station hears them: `python -m tests.benchmarks.fleet_load PORT N PARTS HZ`."""

import asyncio
import sys

from tests.direct_link import wire_url
from tests.groundstation.scripted_platform import TASKS, ScriptedPlatform

from gloc3.exchange import LocalExchange
from gloc3.exchange.tunnel.pacing import LinkBudget
from gloc3.messages.command_interface import CiRequest
from gloc3.messages.envelope import Envelope
from gloc3.messages.summaries import ComponentLine, ComponentTable, Health, MissionSummary, Summary, TableRow
from gloc3.messages.topics import TopicTable
from gloc3_onboard.companion.station_link import StationLink, StationLinkSettings

NETWORK = LinkBudget(rate_bit_s=10_000_000.0, bits_per_byte=8.0)
KINDS = ("SS", "SS", "DP", "CC", "AD")


class Vehicle(ScriptedPlatform):
    """Flies a mission, and tells of so many components."""

    def __init__(self, number: int, parts: int, topics: TopicTable) -> None:
        exchange = LocalExchange()
        super().__init__(exchange, f"vehicle_{number:03d}", 1000 + number)
        self.link = StationLink(
            self.name, 1 + number, self.loop, exchange, topics, 1000 + number, StationLinkSettings(NETWORK)
        )
        self.parts = parts
        self.step = number
        self.mission = MissionSummary(name="cargo hold", digest="d1", state="running", tasks=TASKS)
        exchange.subscribe(f"{self.name}/ci/request", self._introduce)

    async def open(self, port: int) -> None:
        """Begins to talk to a station."""
        await wire_url(self.link, f"udpout://127.0.0.1:{port}", self.loop)

    def _introduce(self, envelope: Envelope[CiRequest]) -> None:
        rows = [TableRow(f"part_{n}", KINDS[n * 5 // self.parts], 20.0, True, "") for n in range(self.parts)]
        self.loop.call_soon(self.report, "table", ComponentTable(table=1, rows=rows))

    def speak(self) -> None:
        """Everything changes a little each time."""
        self.step += 1
        place = (self.step % 100 / 10.0, 1.0, 2.0)
        self.fly(is_armed=True, mode="OFFBOARD", landed="in_air", position_m=place, heading_deg=self.step % 360)
        self.advance("running", {"sweep.wall": self.step % 100 / 100.0}, sweep="running")
        self.report("control", self.control)
        lines = [ComponentLine(n, 0, 95 + (self.step + n) % 10, 10 + self.step % 9, 0, 0) for n in range(self.parts)]
        self.report("summary", Summary(table=1, health=Health.WORKING, lines=lines))


async def main(port: int, count: int, parts: int, rate_hz: float) -> None:
    """Speaks until it is ended."""
    topics, loop = TopicTable.installed(), asyncio.get_running_loop()
    for number in range(count):
        vehicle = Vehicle(number, parts, topics)
        await vehicle.open(port)
        loop.call_later(number / count / rate_hz, vehicle.speak_every, 1.0 / rate_hz)
    await loop.create_future()


if __name__ == "__main__":
    asyncio.run(main(int(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), float(sys.argv[4])))
