"""Another program's ground station on a link of its own to the onboard computer, speaking plain MAVLink."""

from collections.abc import Callable
from random import Random
from typing import Any

from tests.flight.card import Card
from tests.node_runner import NodeRunner

from gloc3.mavlink.codec import Encoder, MavlinkMessage, Parser, message
from gloc3.mavlink.message import Address
from gloc3.mavlink.node import MavlinkComponent
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_client import CommandCall, MavCommandClient
from gloc3.mavlink.services.files.ftp_client import FtpClient
from gloc3.mavlink.services.heartbeat import Heartbeat
from gloc3.mavlink.services.mission_client import MissionClient
from gloc3.mavlink.services.parameter import ParameterEncoding
from gloc3.mavlink.services.parameter_client import ParameterClient
from gloc3.mavlink.services.plan import PlanItem
from gloc3.mavlink.transport.memory import Conditions, MemoryLink

COMPANION = Address(1, 191)
CAMERAS = range(100, 106)
"""Components of cameras."""
PLACE = (39.5528, 2.6285)
"""Where the vehicle stands in the open world of `GEO_HOP`."""
GEO_HOP = """
mission: hop on Earth
frame: geo
tasks:
  hop:
    actions:
      up: {take_off: {height_m: 3}}
      over: {follow_waypoints: {waypoints: [[39.55283, 2.6285, 3], [39.5528, 2.6285, 3]], speed_m_s: 2}, after: [up]}
      down: {land: {}, after: [over]}
"""


class Tool:
    """A station made of our clients, which are those of the protocols and know nothing of us."""

    def __init__(self, card: Card, system: int = 250, conditions: Conditions | None = None, member: str = "") -> None:
        self.card = card
        self.received: list[MavlinkMessage] = []
        own = Address(system, 190)
        loop, flight = card.flight.loop, card.flight
        self.commands, self.missions, self.files = MavCommandClient(own), MissionClient(own), FtpClient(own)
        self.parameters = ParameterClient(own, ParameterEncoding.CAST)
        self.heartbeat = Heartbeat(own, vehicle_type=6)
        self.link = MemoryLink(loop, Random(system), conditions or Conditions(latency_s=0.02))
        services = (self.commands, self.missions, self.files, self.parameters, self.heartbeat)
        self.runner = NodeRunner(MavlinkComponent(own, services), loop, self.link.a.send)
        self.link.a.on_data = self._take
        self._parser, theirs = Parser(is_datagram=True), Parser(is_datagram=True)
        encoders = {component: Encoder(COMPANION.system, component) for component in (COMPANION.component, *CAMERAS)}
        self.senders: list[tuple[int, str]] = []
        """Component and name of everything that came."""
        receive = flight.process.vehicle.companion.attach(
            lambda reported, component: self.link.b.send(encoders[component].encode(reported)), member=member
        )

        def handle(data: bytes) -> None:
            receive(theirs.receive(data))

        self.link.b.on_data = handle
        self.runner.settle()

    @property
    def now_s(self) -> float:
        return self.card.flight.loop.time()

    def until(self, is_done: Callable[[], bool], within_s: float = 20.0, what: str = "an answer") -> None:
        """Lets time pass until something is so."""
        self.runner.settle()
        self.card.until(is_done, within_s, what)

    def command(self, number: int, *params: float, target: Address = COMPANION) -> CommandResult | None:
        """Sends a COMMAND_LONG and waits for what became of it."""
        call = self.begin(number, *params, target=target)
        self.until(lambda: call.result is not None)
        return call.result

    def begin(self, number: int, *params: float, target: Address = COMPANION) -> CommandCall:
        """Sends a COMMAND_LONG."""
        call = self.commands.send_long(target, number, params, now_s=self.now_s)
        self.runner.settle()
        return call

    def wait_for(self, work: Any) -> Any:
        """Waits for the end of an upload, download, fetch...; gives its result."""
        self.until(lambda: work.result is not None)
        return work.result

    def send(self, name: str, **fields: Any) -> None:
        """Sends one message to the companion."""
        reported = message(name, target_system=COMPANION.system, target_component=COMPANION.component, **fields)
        self.link.a.send(self.runner.encoder.encode(reported))

    def send_to(self, name: str, **fields: Any) -> None:
        """Sends one message to whom its fields say."""
        self.link.a.send(self.runner.encoder.encode(message(name, **fields)))

    def as_strangers(self, count: int) -> list[Callable[..., None]]:
        """Ways to send messages as so many systems and components, on this link."""

        def sender(number: int) -> Callable[..., None]:
            encoder = Encoder(number % 200 + 20, number // 200 + 1)

            def send(name: str, **fields: Any) -> None:
                reported = message(name, target_system=COMPANION.system, target_component=COMPANION.component, **fields)
                self.link.a.send(encoder.encode(reported))

            return send

        return [sender(number) for number in range(count)]

    def reported(self, name: str) -> list[MavlinkMessage]:
        """All messages of a name that came."""
        return [one for one in self.received if one.name == name]

    def _take(self, data: bytes) -> None:
        for frame in self._parser.receive(data):
            reported = frame.decode()
            if reported is not None:
                self.received.append(reported)
                self.senders.append((frame.component, reported.name))
        self.runner.on_data(data)


def item(command: int, north_m: float = 0.0, height_m: float = 3.0, **fields: Any) -> PlanItem:
    """An item over a place north of where the vehicle stands, its height above home."""
    values: dict[str, Any] = {"frame": 3, "param4": float("nan")}
    values |= {"x": round((PLACE[0] + north_m / 111_180.0) * 1e7), "y": round(PLACE[1] * 1e7), "z": height_m}
    return PlanItem(command=command, **{**values, **fields})


HOP = (item(22), item(16, 4.0), item(16, 0.0), item(21, x=0, y=0, height_m=0.0))
"""Take-off, there and back, landing."""
