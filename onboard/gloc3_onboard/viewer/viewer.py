"""CI: sends stations any topic of the platform on demand, sampled at the requested rate."""

from collections import deque
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, Final

from gloc3.camera.opencv import load_opencv
from gloc3.component.component import CommandInterface, function
from gloc3.component.ports import Inbox, Output, PortReport, Result
from gloc3.component.settings import NoSettings
from gloc3.errors import Refused
from gloc3.messages.envelope import Envelope, Message
from gloc3.messages.vehicle import Image
from gloc3.messages.watch import LEASE_S, Preview, Sample, TopicActivity, TopicEntry, Want, pack
from gloc3_onboard.sensors.devices import Tap, Taps
from gloc3_onboard.sensors.pictures import pixels_for_people
from gloc3_onboard.viewer.catalogue import Catalogue
from gloc3_onboard.viewer.leases import Demand, Leases

SMALL: Final = 700
"""Bytes of a sample that may be sent without making sure that every frame of it arrives."""
ACTIVITY_PERIOD_S: Final = 1.0
_EARLY_S: Final = 1e-6


class WatchRequest(Message, frozen=True):
    """A station's complete list of wanted topics."""

    station: str
    """Its id, such as `255`."""
    wants: list[Want] = []
    is_listing: bool = False
    """Whether the list of topics is wanted, too."""


class WatchReply(Message, frozen=True):
    """Reply to a request to watch topics."""

    lease_s: float
    """Duration of the lease, s; the station renews it."""
    refused: dict[str, str] = {}
    """Refused topics and the reasons."""


class TopicsRequest(Message, frozen=True):
    """Requests the viewable topics."""


class TopicsReply(Message, frozen=True):
    """The viewable topics."""

    topics: list[TopicEntry]


class _Watched:
    """A topic under watch."""

    __slots__ = ("demand", "due_s", "meter", "sent", "tap")

    def __init__(self, tap: Tap, demand: Demand, now_s: float) -> None:
        self.tap = tap
        self.demand = demand
        self.due_s = now_s
        self.sent = 0
        """The tap's count when the last sample was taken."""
        self.meter = RateMeter(now_s)


class Viewer(CommandInterface[NoSettings]):
    """Subscribes only to topics under watch; a silent station's lease expires."""

    loggable = ("looked_at", "samples")

    sample = Output(Sample)
    large = Output(Sample)
    activity = Output(TopicActivity)

    def __init__(self, taps: Taps, catalogue: Catalogue) -> None:
        self.looked_at = 0
        """Topics."""
        self.samples = 0
        """Sent so far."""
        self._taps = taps
        self._catalogue = catalogue
        self._leases = Leases()
        self._watched: dict[str, _Watched] = {}
        self._listed: list[tuple[Tap, RateMeter]] = []
        self._listed_due_s = 0.0

    def stop(self) -> None:
        """Clears all leases; stations renew theirs."""
        self._leases = Leases()
        self._follow_demand(0.0)

    # --- what stations ask for, through the command interface server ---

    @function("topics")
    def topics(self, request: TopicsRequest, now_s: float) -> TopicsReply:
        """Lists the viewable topics."""
        return TopicsReply(topics=list(self._catalogue.entries))

    @function("watch")
    def watch(self, request: WatchRequest, now_s: float) -> WatchReply:
        """Replaces a station's wants."""
        wants, refused = [], {}
        for want in request.wants:
            try:
                self._catalogue.check(want.topic)
            except Refused as refusal:
                refused[want.topic] = str(refusal)
            else:
                wants.append(want)
                if self._catalogue.type_of(want.topic) is Image:
                    load_shrinker()  # takes a while, and a function may; a cycle may not
        self._leases.grant(request.station, wants, now_s, is_listing=request.is_listing)
        self._follow_demand(now_s)
        if refused and not wants and not request.is_listing:
            raise Refused("; ".join(refused.values()))
        return WatchReply(lease_s=LEASE_S, refused=refused)

    # --- the cycle ---

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Takes a sample of every topic that has spoken since the last one, if one is due."""
        if not self._watched and not self._listed:
            return ()
        if now_s >= self._leases.until_s:
            self._leases.expire(now_s)
            self._follow_demand(now_s)
        results: list[Result] = []
        for topic, watched in self._watched.items():
            envelope, count = watched.tap.latest, watched.tap.count
            if envelope is None or count == watched.sent or now_s < watched.due_s - _EARLY_S:
                continue
            watched.sent = count
            watched.due_s = max(watched.due_s + 1.0 / watched.demand.rate_hz, now_s)
            results.append(self._sample(topic, envelope, watched, now_s))
        self.samples += len(results)
        if self._listed and now_s >= self._listed_due_s - _EARLY_S:
            self._listed_due_s = now_s + ACTIVITY_PERIOD_S
            results.append(self._activity(now_s))
        return results

    def _sample(self, topic: str, envelope: Envelope[Any], watched: _Watched, now_s: float) -> PortReport:
        message: Message = envelope.payload
        demand = watched.demand
        if isinstance(message, Image):
            message = load_shrinker()(message, demand.width, demand.height, demand.quality)
        rate_hz = watched.meter.rate_hz(watched.sent, now_s)
        sample = pack(envelope, message, rate_hz, demand.stations)
        is_large = isinstance(message, Preview) or len(sample.payload) > SMALL
        port = self.large if is_large else self.sample
        return port.report(sample, t_s=envelope.t_s, key=topic)

    def _activity(self, now_s: float) -> TopicActivity:
        rates, ages = [], []
        for tap, meter in self._listed:
            rates.append(round(10.0 * meter.rate_hz(tap.count, now_s)))
            ages.append(round(10.0 * max(0.0, now_s - tap.latest.t_s)) if tap.latest is not None else -1)
        return TopicActivity(rates=rates, ages=ages, stations=self._leases.listing)

    def _follow_demand(self, now_s: float) -> None:
        """Subscribes to the wanted topics, and to no others."""
        demands = self._leases.demands()
        for topic in [topic for topic in self._watched if topic not in demands]:
            self._watched.pop(topic).tap.close()
        for topic, demand in demands.items():
            watched = self._watched.get(topic)
            if watched is None:
                self._watched[topic] = _Watched(self._taps.open(topic, self.request_cycle), demand, now_s)
            else:
                watched.demand = demand
                watched.due_s = min(watched.due_s, now_s + 1.0 / demand.rate_hz)
        if self._leases.listing and not self._listed:
            self._listed = [(self._taps.open(entry.name), RateMeter(now_s)) for entry in self._catalogue.entries]
            self._listed_due_s = now_s + ACTIVITY_PERIOD_S
        elif not self._leases.listing and self._listed:
            for tap, _ in self._listed:
                tap.close()
            self._listed = []
        self.looked_at = len(self._watched)


ENCODING: Final = ".webp"
"""A 64 × 48 picture needs two thirds of the bytes of JPEG, whose tables alone take 150."""

Shrink = Callable[[Image, int, int, int], Preview]
"""Makes a preview of an image that fits a width and a height, in a quality from 1 to 100."""


@cache
def load_shrinker() -> Shrink:
    """The function that makes previews; the first call loads OpenCV, which is slow."""
    cv2 = load_opencv()

    def shrink(image: Image, width: int, height: int, quality: int) -> Preview:
        size = fit((image.width, image.height), (width, height))
        data = b""
        if image.is_valid and image.width > 0 and len(image.data) == image.width * image.height:
            pixels: Any = pixels_for_people(image)
            if size != (image.width, image.height):
                pixels = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
            is_done, packed = cv2.imencode(ENCODING, pixels, [cv2.IMWRITE_WEBP_QUALITY, quality])
            data = packed.tobytes() if is_done else b""
        return Preview(
            camera=image.camera,
            width=size[0],
            height=size[1],
            full_width=image.width,
            full_height=image.height,
            data=data,
            is_valid=image.is_valid and bool(data),
            reason=image.reason or ("" if data else "the image is empty or damaged"),
        )

    return shrink


def fit(size: tuple[int, int], room: tuple[int, int]) -> tuple[int, int]:
    """The largest size of the same proportions that has room, never more than the size itself."""
    width, height = size
    if width <= 0 or height <= 0:
        return 0, 0
    scale = min(1.0, room[0] / width, room[1] / height)
    return max(1, round(width * scale)), max(1, round(height * scale))


WINDOW_S: Final = 5.0
STEP_S: Final = 0.45


class RateMeter:
    """Mean rate over the last five seconds, or since the start."""

    __slots__ = ("_polls",)

    def __init__(self, now_s: float) -> None:
        self._polls: deque[tuple[float, int]] = deque([(now_s, 0)])

    def rate_hz(self, count: int, now_s: float) -> float:
        """The rate, from the number of events since the start."""
        samples = self._polls
        while len(samples) > 1 and now_s - samples[1][0] >= WINDOW_S:
            samples.popleft()
        first_s, first = samples[0]
        if now_s - samples[-1][0] >= STEP_S:
            samples.append((now_s, count))
        return (count - first) / (now_s - first_s) if now_s > first_s else 0.0
