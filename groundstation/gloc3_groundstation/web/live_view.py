"""Live view for Foxglove: serves vehicles' topics on loopback, read-only.

The channels are those of the logs, with the same names and schemas. Topics without a subscriber are not requested.
"""

import asyncio
from typing import Any, Final, Protocol

from msgspec.structs import replace

from gloc3.errors import Gloc3Error, Refused
from gloc3.exchange.base import Exchange, Unsubscribe
from gloc3.log.foxglove.schemas import MAP_FRAME, MAP_FROM_NED, NED_FRAME, TRANSFORM_SCHEMA, timestamp, transform
from gloc3.log.payloads import PayloadEncoder
from gloc3.messages.envelope import Envelope, Message
from gloc3.messages.topics import TopicTable
from gloc3.messages.vehicle import Image
from gloc3.messages.watch import Preview, Want
from gloc3.messages.wire import type_name
from gloc3_groundstation.station import pictures
from gloc3_groundstation.station.fleet import CONTACT_TOPICS
from gloc3_groundstation.station.station import Station

PORT: Final = 8765
"""Foxglove's default port."""
HOST: Final = "127.0.0.1"
POLL_PERIOD_S: Final = 1.0
RATE_HZ: Final = 10.0
IMAGE_RATE_HZ: Final = 1.0
LARGEST: Final = (320, 240)
VIEWER: Final = "foxglove"
FRAMES: Final = "frames"


class LiveChannel(Protocol):
    """A channel of the server."""

    def log(self, msg: bytes | dict[str, Any], *, log_time: int | None = None) -> None:
        """Sends a message to its subscribers."""

    def close(self) -> None:
        """Takes the channel back."""


class _Live:
    """A topic that is offered."""

    def __init__(self, channel: LiveChannel, encoder: PayloadEncoder, is_image: bool) -> None:
        self.channel = channel
        self.encoder = encoder
        self.is_image = is_image
        self.clients: set[tuple[int, int]] = set()


class LiveView:
    """One server for all vehicles of a station."""

    def __init__(
        self,
        station: Station,
        exchange: Exchange,
        loop: asyncio.AbstractEventLoop,
        topics: TopicTable,
        utc_offset_s: float,
    ) -> None:
        """Creates a server that does not run yet.

        Args:
            station: source of the vehicles, and of watches on them.
            exchange: source of their messages.
            loop: the event loop, for time.
            topics: known topics and types.
            utc_offset_s: from the loop's time to UTC.
        """
        self._station = station
        self._exchange = exchange
        self._loop = loop
        self._topics = topics
        self._utc_offset_s = utc_offset_s
        self._live: dict[str, _Live] = {}
        """By the full topic."""
        self._server: Any = None
        self._context: Any = None
        self._ends: list[Unsubscribe] = []
        self._timer: asyncio.TimerHandle | None = None
        self._frames: LiveChannel | None = None

    def open(self, port: int = PORT) -> str:
        """Begins to serve; returns the URL.

        Raises:
            Gloc3Error: foxglove-sdk is not installed.
            Refused: the port cannot be had.
        """
        try:
            import foxglove
        except ImportError as error:
            raise Gloc3Error("--foxglove needs foxglove-sdk: pip install 'gloc3[groundstation]'") from error
        self._context = foxglove.Context()
        listener: Any = _Listener(self, self._loop)  # the library's own type has many more methods than are called
        try:
            self._server = foxglove.start_server(
                name="GLOC3 ground station",
                host=HOST,
                port=port,
                capabilities=[],
                server_listener=listener,
                context=self._context,
            )
        except (OSError, RuntimeError) as error:
            raise Refused(
                f"Foxglove cannot be served on port {port}: {error}; choose another with --foxglove-port"
            ) from error
        self._frames = foxglove.Channel(FRAMES, schema=dict(TRANSFORM_SCHEMA), context=self._context)
        self._ends = [
            self._station.monitor.listen(lambda _, envelope: self._show(envelope)),
            *(self._exchange.subscribe(f"*/{topic}", self._show) for topic in CONTACT_TOPICS),
        ]
        self._update()
        return f"ws://{HOST}:{self._server.port}"

    def close(self) -> None:
        """Serves nothing more."""
        for end in self._ends:
            end()
        self._ends.clear()
        if self._timer is not None:
            self._timer.cancel()
        if self._server is not None:
            self._station.monitor.unwatch(VIEWER)
            self._server.stop()
            self._server = None

    # --- what is offered ---

    def _update(self) -> None:
        """Advertises topics of new vehicles, and updates the watched topics."""
        self._timer = self._loop.call_later(POLL_PERIOD_S, self._update)
        if self._frames is not None:
            frame = transform(MAP_FRAME, NED_FRAME, (0.0, 0.0, 0.0), MAP_FROM_NED)
            self._frames.log({"timestamp": timestamp(self._now_ns()), **frame}, log_time=self._now_ns())
        for platform in self._station.fleet:
            self._station.monitor.list_topics(platform.name)
            for topic in CONTACT_TOPICS:
                self._offer(f"{platform.name}/{topic}")
            for entry in self._station.monitor.watches.entries(platform.name):
                self._offer(f"{platform.name}/{entry.name}")
            self._want(platform.name)

    def _offer(self, topic: str) -> None:
        row = self._topics.row(topic)
        if topic in self._live or row is None:
            return
        import foxglove

        encoder = PayloadEncoder(row.message)
        name, text = encoder.schema
        channel = foxglove.Channel(
            topic,
            message_encoding="json",
            schema=foxglove.Schema(name=name, encoding="jsonschema", data=text),
            context=self._context,
        )
        self._live[topic] = _Live(channel, encoder, issubclass(row.message, Image))

    def subscribed(self, topic: str, client: tuple[int, int], is_on: bool) -> None:
        """A client has subscribed to a topic, or does not want it any more."""
        live = self._live.get(topic)
        if live is not None and self._server is not None:
            (live.clients.add if is_on else live.clients.discard)(client)
            if live.is_image and is_on:
                pictures.load()
            self._want(topic.partition("/")[0])

    def _want(self, platform: str) -> None:
        monitor = self._station.monitor
        wants = []
        for topic, live in self._live.items():
            name, _, short = topic.partition("/")
            if name == platform and live.clients and short not in CONTACT_TOPICS:
                width, height = monitor.watches.preview_size(platform, short, LARGEST)
                wants.append(Want(short, IMAGE_RATE_HZ if live.is_image else RATE_HZ, width, height))
        monitor.watch(VIEWER, platform, wants)

    # --- what is shown ---

    def _show(self, envelope: Envelope[Any]) -> None:
        live = self._live.get(envelope.topic)
        if live is None or not live.clients:
            return
        shown = _unpacked(envelope) if isinstance(envelope.payload, Preview) else envelope
        if shown is not None:
            now_ns = self._now_ns()
            live.channel.log(live.encoder.encode(shown, now_ns), log_time=now_ns)

    def _now_ns(self) -> int:
        return round((self._loop.time() + self._utc_offset_s) * 1e9)


class _Listener:
    """Called by the server in its own thread; forwards to the loop's thread."""

    def __init__(self, view: LiveView, loop: asyncio.AbstractEventLoop) -> None:
        self._view = view
        self._loop = loop

    def on_subscribe(self, client: Any, channel: Any) -> None:
        """A client wants a channel."""
        self._notify(channel.topic, (client.id, channel.id), True)

    def on_unsubscribe(self, client: Any, channel: Any) -> None:
        """Handles a client's unsubscription or disconnection."""
        self._notify(channel.topic, (client.id, channel.id), False)

    def _notify(self, topic: str, client: tuple[int, int], is_on: bool) -> None:
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._view.subscribed, topic, client, is_on)


def _unpacked(envelope: Envelope[Preview]) -> Envelope[Any] | None:
    """Image message for a preview."""
    preview = envelope.payload
    picture = pictures.unpack_picture(preview)
    if picture is None:
        return None
    image: Message = Image(camera=preview.camera, width=picture.width, height=picture.height, data=picture.data)
    return replace(envelope, type=type_name(Image), payload=image)
