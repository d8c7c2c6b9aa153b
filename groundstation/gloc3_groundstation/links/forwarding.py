"""Forwards the vehicles' frames to other stations; what comes from there reaches the vehicles only where it is allowed.

The rules are those of the onboard router: an addressed frame goes only where its target is received, nothing goes back
to where its sender is received, and a frame that comes a second time within seconds has come in a loop and is dropped.
Frames pass byte for byte. This station's own frames, and keys (SETUP_SIGNING), are not forwarded.
"""

from collections.abc import Callable
from typing import Final, Generic, Protocol, TypeVar

from gloc3.errors import Refused
from gloc3.mavlink.codec import Frame, Parser
from gloc3.mavlink.message import Address
from gloc3.mavlink.tlog import SETUP_SIGNING
from gloc3.mavlink.transport.endpoints import SERIAL_SCHEMES, Endpoint, parse_url

REPEAT_S: Final = 2.0
"""A frame that comes again within this time has come in a loop, s."""
MOST_RECENT: Final = 20_000
MOST_SENDERS: Final = 256
SENDER_LOST_S: Final = 60.0
"""Silence after which a sender is not behind a link any more, s."""

Place = TypeVar("Place")


class RawLink(Protocol):
    """A link to vehicles."""

    def forward(self, raw: bytes) -> None:
        """Sends a frame of another station as it is."""


class RecentFrames:
    """Frames that were forwarded within the last seconds, in bounded memory."""

    def __init__(self) -> None:
        self._now: dict[bytes, float] = {}
        self._before: dict[bytes, float] = {}
        self._began_s = float("-inf")

    def is_new(self, raw: bytes, now_s: float) -> bool:
        """Whether a frame has not come lately; notes it."""
        if now_s - self._began_s > REPEAT_S or len(self._now) >= MOST_RECENT:
            self._before, self._now, self._began_s = self._now, {}, now_s
        seen_s = self._now.get(raw, self._before.get(raw))
        self._now[raw] = now_s
        return seen_s is None or now_s - seen_s > REPEAT_S


class Senders(Generic[Place]):
    """Where each sender was received last."""

    def __init__(self) -> None:
        self._known: dict[Address, tuple[Place, float]] = {}
        """In the order in which they were received last."""

    def receive(self, sender: Address, place: Place, now_s: float) -> None:
        """Notes a sender; without room for a new one, the one that was received longest ago makes room if it is lost."""
        if self._known.pop(sender, None) is None and len(self._known) >= MOST_SENDERS:
            oldest = next(iter(self._known))
            if self.has(oldest, now_s):
                return
            del self._known[oldest]
        self._known[sender] = place, now_s

    def has(self, sender: Address, now_s: float) -> bool:
        """Whether a sender is received."""
        seen = self._known.get(sender)
        return seen is not None and now_s - seen[1] < SENDER_LOST_S

    def places(self, system: int, now_s: float) -> set[Place]:
        """Where a system is received."""
        return {
            place
            for known, (place, seen_s) in self._known.items()
            if known.system == system and now_s - seen_s < SENDER_LOST_S
        }


class ForwardLink:
    """A link to another station.

    Args:
        is_both: whether frames from there are passed to the vehicles.
    """

    def __init__(self, *, is_both: bool) -> None:
        self.is_both: Final = is_both
        self.endpoint: Endpoint
        """Set when it is open."""
        self.parser: Final = Parser()
        self.senders: Final = Senders[int]()
        self.sent = 0
        self.withheld = 0
        """Frames from there that were not passed to the vehicles, since that is not allowed."""
        self.has_reported = False

    def describe(self) -> str:
        """Text for people: which frames pass."""
        if self.is_both:
            return "to a station, its commands pass"
        withheld = f", {self.withheld:,} frames withheld" if self.withheld else ""
        return f"to a station, one way{withheld}"

    def send(self, raw: bytes) -> None:
        """Sends a frame as it is."""
        self.sent += 1
        self.endpoint.send(raw)


def check_forward(url: str) -> None:
    """Checks the URL of a link to another station.

    Raises:
        Refused: it is wrong, or one of a serial line or a signed link.
    """
    wanted = parse_url(url)
    wanted.check_unkeyed("forwarding")
    if wanted.scheme in SERIAL_SCHEMES or wanted.rate_bit_s is not None:
        raise Refused(
            f"forward {url!r}: frames are forwarded over a network, with udpout://, udpin://, tcpout:// or tcpin://"
        )


def target_of(frame: Frame) -> int:
    """System to which a frame is addressed; 0 for a broadcast and for unknown messages."""
    shape = frame.shape
    return frame.target_system if shape is not None and shape.target_system_at >= 0 else 0


class Forwarding:
    """Between the links of vehicles and those to other stations.

    Args:
        own: address of this station.
        vehicles: returns the links of vehicles.
        report: called with text for users.
    """

    def __init__(self, own: Address, vehicles: Callable[[], list[RawLink]], report: Callable[[str], None]) -> None:
        self.links: Final[list[ForwardLink]] = []
        self.looped = 0
        """Frames that had come before, or claim to be of a vehicle and come from another station."""
        self._own, self._vehicles, self._report = own, vehicles, report
        self._recent = RecentFrames()
        self._senders = Senders[RawLink]()

    def from_vehicle(self, link: RawLink, frame: Frame, now_s: float) -> None:
        """Handles a frame that a link of vehicles has received."""
        if not self.links or frame.sender == self._own or frame.message_id == SETUP_SIGNING:
            return
        behind = [one for one in self.links if one.senders.has(frame.sender, now_s)]
        if not behind:  # else it is another station, which is connected to the vehicle in another way, too
            self._senders.receive(frame.sender, link, now_s)
        if not self._recent.is_new(frame.raw, now_s):
            self.looped += 1
            return
        target = target_of(frame)
        for one in self.links:
            if one in behind:
                continue
            if not target or (target != self._own.system and one.senders.places(target, now_s)):
                one.send(frame.raw)

    def from_station(self, link: ForwardLink, data: bytes, now_s: float) -> None:
        """Handles bytes from another station."""
        for frame in link.parser.receive(data):
            if frame.sender == self._own or self._senders.has(frame.sender, now_s):
                self.looped += 1
                continue
            link.senders.receive(frame.sender, 0, now_s)
            if not link.is_both:
                self._withhold(link, frame)
            elif frame.message_id != SETUP_SIGNING:
                self._pass_on(frame, now_s)

    def _withhold(self, link: ForwardLink, frame: Frame) -> None:
        link.withheld += 1
        if target_of(frame) and not link.has_reported:
            link.has_reported = True
            who = f"{frame.system}/{frame.component}"
            self._report(
                f"{who} behind {link.endpoint.url} sends commands, which are not passed to the vehicles; "
                "--forward-both lets them pass"
            )

    def _pass_on(self, frame: Frame, now_s: float) -> None:
        """Sends a frame of another station to the vehicles."""
        target = target_of(frame)
        if target == self._own.system or not self._recent.is_new(frame.raw, now_s):
            self.looped += target != self._own.system
            return
        present = self._vehicles()
        links = [one for one in present if one in self._senders.places(target, now_s)] if target else present
        for one in links:
            one.forward(frame.raw)
