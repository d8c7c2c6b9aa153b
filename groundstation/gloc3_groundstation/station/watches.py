"""Topic subscriptions of the station's viewers, the requests to platforms they cause, and the data.

A state machine without I/O. A viewer's (a screen's, Foxglove's) subscription lasts until it changes it or its time is
up. The sum of all subscriptions is requested from each platform at once, again before the lease ends, and once more,
empty, after the last viewer has left.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

from gloc3.messages.command_interface import Watch
from gloc3.messages.envelope import Envelope
from gloc3.messages.watch import ACTIVITY, RENEW_S, Preview, Sample, TopicActivity, TopicEntry, Want, topic_of, unpack
from gloc3.messages.wire import TypeRegistry, WireError
from gloc3_groundstation.station.message_fields import numbers_of
from gloc3_groundstation.station.preview_size import PreviewSize

HISTORY: Final = 600
"""Samples of a topic that are kept for plots."""
BURST_S: Final = 0.1
"""Samples that come closer together say nothing of a rate."""
TOPICS_KEPT: Final = 12
"""Topics of a platform that are remembered without a viewer."""


class Sight(NamedTuple):
    """State of a watched topic."""

    topic: str
    """Below the platform's name."""
    envelope: Envelope[Any] | None
    """The last message, as it was published; None before the first."""
    received_s: float
    """Time of reception, on the station's clock."""
    rate_hz: float
    """At which samples arrive."""
    source_rate_hz: float
    """Rate of the topic, as measured on the platform."""
    problem: str
    """Why nothing is seen, or not the last message."""


class _View(NamedTuple):
    wants: tuple[Want, ...]
    is_listing: bool
    until_s: float


class _Track:
    """What has come of a topic."""

    def __init__(self) -> None:
        self.envelope: Envelope[Any] | None = None
        self.received_s = float("-inf")
        self.source_rate_hz = 0.0
        self.problem = ""
        self.arrivals_s: deque[tuple[float, float]] = deque(maxlen=20)
        """When samples came, and their own time."""
        self.numbers: deque[tuple[float, Mapping[str, tuple[float, ...]]]] = deque(maxlen=HISTORY)
        self.preview_size = PreviewSize()

    def receive(self, envelope: Envelope[Any], source_rate_hz: float, now_s: float) -> None:
        """A message has come."""
        self.envelope, self.received_s, self.source_rate_hz, self.problem = envelope, now_s, source_rate_hz, ""
        self.arrivals_s.append((now_s, envelope.t_s))
        if isinstance(envelope.payload, Preview):
            self.preview_size.came(now_s)
            return
        if self.numbers and envelope.t_s < self.numbers[-1][0]:
            self.numbers.clear()  # the platform has begun to count its time anew
        self.numbers.append((envelope.t_s, numbers_of(envelope.payload)))

    def rate_hz(self, now_s: float) -> float:
        """Recent arrivals per second; messages that a link delivers in a burst count over the time that they cover."""
        times = self.arrivals_s
        if len(times) < 2:
            return 0.0
        (first_s, first_t_s), (last_s, last_t_s) = times[0], times[-1]
        return (len(times) - 1) / max(BURST_S, last_s - first_s, last_t_s - first_t_s, now_s - first_s - 2.0)


class _Platform:
    def __init__(self) -> None:
        self.views: dict[str, _View] = {}
        self.requested = Watch()
        self.requested_s = float("-inf")
        self.refused: Mapping[str, str] = {}
        self.entries: tuple[TopicEntry, ...] = ()
        self.activity: TopicActivity | None = None
        self.problem = ""
        self.tracks: dict[str, _Track] = {}
        self.last: dict[str, tuple[int, int]] = {}
        """Of each topic of samples: the viewer's boot, and the last sequence."""

    def is_new(self, envelope: Envelope[Any]) -> bool:
        """Whether a sample has not come already, by another link."""
        boot, sequence = self.last.get(envelope.topic, (0, -1))
        if envelope.source.boot == boot and envelope.sequence <= sequence:
            return False
        self.last[envelope.topic] = envelope.source.boot, envelope.sequence
        return True

    def wanted(self) -> Watch:
        """What all viewers want together."""
        found: dict[str, Want] = {}
        for poll in self.views.values():
            for want in poll.wants:
                other = found.get(want.topic)
                if other is not None:
                    want = Want(
                        want.topic,
                        max(want.rate_hz, other.rate_hz),
                        max(want.width, other.width),
                        max(want.height, other.height),
                        max(want.quality, other.quality),
                    )
                found[want.topic] = want
        is_listing = any(poll.is_listing for poll in self.views.values())
        return Watch(wants=sorted(found.values(), key=lambda want: want.topic), is_listing=is_listing)


class Watches:
    """All topics that this station watches."""

    def __init__(self, types: TypeRegistry) -> None:
        self._types = types
        self._platforms: dict[str, _Platform] = {}

    # --- who looks ---

    def watch(
        self,
        viewer: str,
        platform: str,
        wants: Sequence[Want],
        now_s: float,
        *,
        is_listing: bool = False,
        for_s: float = float("inf"),
    ) -> None:
        """Replaces a viewer's subscription to a platform; without topics it ends.

        Args:
            viewer: name of the viewer, such as a screen.
            platform: by name.
            wants: the wanted topics.
            now_s: the time.
            is_listing: whether it shows the list of topics.
            for_s: duration, unless it is renewed.
        """
        known = self._platforms.setdefault(platform, _Platform())
        if wants or is_listing:
            known.views[viewer] = _View(tuple(wants), is_listing, now_s + for_s)
        else:
            known.views.pop(viewer, None)

    def unwatch(self, viewer: str, except_from: str = "") -> None:
        """Ends all subscriptions of a viewer, except those to one platform."""
        for name, platform in self._platforms.items():
            if name != except_from:
                platform.views.pop(viewer, None)

    # --- what is asked for ---

    def due(self, now_s: float) -> list[tuple[str, Watch]]:
        """Requests that are due, with their platforms."""
        found = []
        for name, platform in self._platforms.items():
            for viewer in [who for who, poll in platform.views.items() if now_s >= poll.until_s]:
                del platform.views[viewer]
            wanted = platform.wanted()
            is_renewal = bool(wanted.wants or wanted.is_listing) and now_s - platform.requested_s >= RENEW_S
            if wanted != platform.requested or is_renewal:
                if not wanted.is_listing:
                    platform.activity = None
                self._drop_oldest(platform, wanted)
                platform.requested, platform.requested_s = wanted, now_s
                found.append((name, wanted))
        return found

    def lists_due(self) -> list[str]:
        """Platforms whose topics have to be listed."""
        return [
            name
            for name, platform in self._platforms.items()
            if not platform.entries and any(poll.is_listing for poll in platform.views.values())
        ]

    def next_s(self) -> float | None:
        """When a request is due; None without viewers."""
        times_s = [
            min(platform.requested_s + RENEW_S, *(poll.until_s for poll in platform.views.values()))
            for platform in self._platforms.values()
            if platform.views
        ]
        return min(times_s, default=None)

    # --- what comes back ---

    def answered(self, platform: str, refused: Mapping[str, str], problem: str = "") -> None:
        """Handles a platform's answer, or its absence.

        Args:
            platform: its name.
            refused: topics that cannot be watched, with the reasons.
            problem: why none can be watched; empty if they can.
        """
        known = self._platforms[platform]
        known.refused, known.problem = refused, problem

    def listed(self, platform: str, entries: Sequence[TopicEntry]) -> None:
        """Handles a platform's list of topics."""
        self._platforms.setdefault(platform, _Platform()).entries = tuple(entries)

    def receive(self, envelope: Envelope[Any], now_s: float) -> Envelope[Any] | None:
        """Handles a message on a topic `PLATFORM/watch/...`; returns the watched message, if it contains one."""
        name, _, topic = envelope.topic.partition("/")
        platform = self._platforms.get(name)
        if platform is None or not platform.is_new(envelope):
            return None
        if topic == ACTIVITY:
            platform.activity = envelope.payload
            return None
        sample: Sample = envelope.payload
        watched = topic_of(topic)
        if all(want.topic != watched for want in platform.requested.wants):
            return None  # somebody else looks at it
        track = platform.tracks.setdefault(watched, _Track())
        try:
            message = unpack(envelope, self._types)
        except WireError as error:
            track.problem, track.source_rate_hz = str(error), sample.rate_hz
            return None
        track.receive(message, sample.rate_hz, now_s)
        return message

    # --- what is known ---

    def entries(self, platform: str) -> tuple[TopicEntry, ...]:
        """The topics of a platform; empty while they are not known."""
        known = self._platforms.get(platform)
        return known.entries if known is not None else ()

    def activity(self, platform: str) -> TopicActivity | None:
        """Activity of the topics; None while it is unknown."""
        known = self._platforms.get(platform)
        return known.activity if known is not None else None

    def problem(self, platform: str) -> str:
        """Why no topic of a platform can be watched."""
        known = self._platforms.get(platform)
        return known.problem if known is not None else ""

    def sight(self, platform: str, topic: str, now_s: float) -> Sight:
        """What is known of a topic."""
        known = self._platforms.get(platform)
        track = known.tracks.get(topic) if known is not None else None
        refused = known.refused.get(topic, known.problem) if known is not None else ""
        if track is None:
            return Sight(topic, None, float("-inf"), 0.0, 0.0, refused)
        return Sight(
            topic,
            track.envelope,
            track.received_s,
            track.rate_hz(now_s),
            track.source_rate_hz,
            refused or track.problem,
        )

    def series(self, platform: str, topic: str, field: str) -> list[tuple[float, tuple[float, ...]]]:
        """The times of validity and the numbers of a field, oldest first."""
        known = self._platforms.get(platform)
        track = known.tracks.get(topic) if known is not None else None
        return [(t_s, numbers[field]) for t_s, numbers in track.numbers if field in numbers] if track else []

    def preview_size(self, platform: str, topic: str, room: tuple[int, int]) -> tuple[int, int]:
        """The size of a preview that the link affords and that can be shown."""
        known = self._platforms.get(platform)
        track = known.tracks.get(topic) if known is not None else None
        return (track.preview_size if track is not None else PreviewSize()).size(room)

    @staticmethod
    def _drop_oldest(platform: _Platform, wanted: Watch) -> None:
        """Drops the topic that has been without a viewer for longest."""
        topics = {want.topic for want in wanted.wants}
        for topic, track in platform.tracks.items():
            if topic not in topics:
                track.preview_size.pause()
        previous = [topic for topic in platform.tracks if topic not in topics]
        for topic in previous[: max(0, len(platform.tracks) - TOPICS_KEPT)]:
            del platform.tracks[topic]
