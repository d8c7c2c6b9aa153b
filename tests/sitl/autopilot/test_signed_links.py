"""An autopilot that is given a key, in each style as its firmware does it."""

from collections import Counter

import pytest

from gloc3.mavlink.codec import Encoder, Parser, message
from gloc3.mavlink.signing import Signing, is_signed_with, timestamp
from gloc3_sitl.autopilot.mavlink.links import LinkKind
from gloc3_sitl.vehicles.simulator import Simulator, SimulatorSettings
from gloc3_sitl.world import World

STYLES = pytest.mark.parametrize("style", ["px4", "ardupilot"])
KEY, OTHER = bytes(range(32)), bytes(range(1, 33))
NOW = timestamp(1_790_000_000.0)
UNKNOWN = 31010


class Somebody:
    """On a link of his own, with a key or without."""

    def __init__(self, sim: Simulator, system: int, key: bytes | None = None, *, is_datagram: bool = True) -> None:
        self.counts: Counter[tuple[str, bytes | None]] = Counter()
        self.senders: Counter[int] = Counter()
        self._parser = Parser(is_datagram=is_datagram)
        self.encoder = Encoder(system, 190)
        self.sign(key)
        self._receive = sim.attach(self._handle, LinkKind.BARE, is_datagram=is_datagram)

    def sign(self, key: bytes | None) -> None:
        self.encoder.signing = None if key is None else Signing(key, link_id=self.encoder.address.system, now=NOW)

    def _handle(self, data: bytes) -> None:
        for frame in self._parser.receive(data):
            key = next((key for key in (KEY, OTHER) if is_signed_with(key, frame)), None)
            self.senders[frame.system] += 1
            if frame.shape is not None and frame.system == 1:
                self.counts[frame.shape.name, key] += 1

    def report(self, name: str, **fields: object) -> None:
        self._receive(self.encoder.encode(message(name, **fields)))

    def set_up(self, key: bytes, time: int = NOW) -> None:
        self.report("SETUP_SIGNING", target_system=1, target_component=1, secret_key=key, initial_timestamp=time)

    def is_served(self) -> bool:
        """Whether a command is answered, signed as this one signs."""
        before = self.counts.total()
        self.report("COMMAND_LONG", target_system=1, target_component=1, command=UNKNOWN)
        return self.counts.total() > before


def simulator(style: str) -> Simulator:
    sim = Simulator(World.load("open"), SimulatorSettings(style=style, seed=1))
    sim.advance(2.0)
    return sim


@STYLES
def test_who_has_not_the_key_is_neither_heard_nor_passed_on_from_then_on(style: str) -> None:
    sim = simulator(style)
    knows, stranger, wrong = Somebody(sim, 255), Somebody(sim, 254), Somebody(sim, 253, OTHER)
    assert knows.is_served()
    stranger.report("COMMAND_LONG", target_system=255, target_component=190, command=UNKNOWN)
    assert knows.senders[254] == 1
    knows.report("SETUP_SIGNING", secret_key=KEY, initial_timestamp=NOW)
    assert stranger.senders[255] == 0, "a key is passed on to nobody"
    knows.sign(KEY)
    assert knows.is_served()
    assert knows.counts["COMMAND_ACK", KEY] == 1
    assert not stranger.is_served()
    assert not wrong.is_served()
    stranger.report("COMMAND_LONG", target_system=255, target_component=190, command=UNKNOWN)
    assert knows.senders[254] == 1, "as before"
    assert sim.front.context.signing.dropped == 3
    heartbeats = stranger.counts["HEARTBEAT", KEY]
    sim.advance(5.0)
    assert stranger.counts["HEARTBEAT", KEY] > heartbeats, "all that it sends is signed, for whoever listens"


@STYLES
def test_a_key_is_changed_and_forgotten_only_by_who_has_it_and_on_the_ground(style: str) -> None:
    sim = simulator(style)
    knows, stranger = Somebody(sim, 255), Somebody(sim, 254)
    knows.set_up(KEY)
    stranger.set_up(bytes(32), 0)
    assert not stranger.is_served()
    knows.sign(KEY)
    sim.autopilot.craft.is_armed = True
    knows.set_up(OTHER)
    assert sim.texts[-1][2] == "the signing key cannot be changed while armed"
    sim.autopilot.craft.is_armed = False
    assert knows.is_served()
    knows.set_up(OTHER)
    knows.sign(OTHER)
    assert knows.is_served()
    knows.set_up(bytes(32), 0)
    knows.sign(None)
    assert knows.is_served()
    assert knows.counts["COMMAND_ACK", None] == 1
    assert stranger.is_served()


@STYLES
def test_a_key_outlives_a_reboot_and_what_was_said_before_it_is_not_taken_again(style: str) -> None:
    sim = simulator(style)
    knows = Somebody(sim, 255)
    knows.set_up(KEY)
    knows.sign(KEY)
    reboot = knows.encoder.encode(message("COMMAND_LONG", target_system=1, target_component=1, command=246, param1=1.0))
    knows._receive(reboot)
    sim.advance(10.0)
    before = knows.counts.total()
    knows._receive(reboot)
    assert knows.counts.total() == before
    assert knows.is_served()
    assert not Somebody(sim, 254).is_served()


def test_px4_takes_heartbeats_unsigned_and_ardupilot_all_on_its_first_serial_port() -> None:
    for style in ("px4", "ardupilot"):
        sim = simulator(style)
        knows, cable = Somebody(sim, 255), Somebody(sim, 254, is_datagram=False)
        knows.set_up(KEY)
        dropped = sim.front.context.signing.dropped
        Somebody(sim, 253).report("HEARTBEAT", type=6, autopilot=8)
        assert sim.front.context.signing.dropped - dropped == (style == "ardupilot")
        assert cable.is_served() is (style == "ardupilot")
