"""Publishes vehicles' topics in ROS 2 while somebody there subscribes to them, and the health of all components."""

import asyncio
from collections.abc import Callable, Mapping
from typing import Any, Final

from gloc3.errors import Refused
from gloc3.exchange.base import Unsubscribe
from gloc3.messages.envelope import Envelope
from gloc3.messages.summaries import Health
from gloc3.messages.watch import Want
from gloc3.ros2.messages import (
    ERROR,
    OK,
    STALE,
    WARN,
    RosMessage,
    announced,
    diagnostic_status,
    diagnostics,
    ros_records,
    stamp,
)
from gloc3.ros2.node import RosNode, RosPublisher
from gloc3.ros2.wire import SENSOR, STATE, Entity, EntityKind
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.ros2.missions import MissionServices
from gloc3_groundstation.station.snapshots import ComponentSnapshot, PlatformSnapshot

POLL_PERIOD_S: Final = 1.0
PICTURE_RATE_HZ: Final = 1.0
LARGEST: Final = (640, 480)
VIEWER: Final = "ros2"
WITHOUT_ROUTER_S: Final = 5.0
"""Time without a router after which that is reported, s."""
_LEVELS: Final[Mapping[Health | None, int]] = {
    Health.WORKING: OK,
    Health.QUIET: OK,
    Health.STANDBY: OK,
    Health.IDLE: WARN,
    Health.ABSENT: STALE,
    Health.FAULTY: ERROR,
    None: STALE,
}


class RosBridge:
    """The bridge of one station.

    Args:
        desk: reaches the vehicles.
        node: in the graph of ROS 2.
        utc_s: the computer's time, in seconds since 1970.
        rate_hz: at which topics are requested, at most.
        report: called with text for users.
        missions: offers services for missions; None for a bridge that commands nothing.
    """

    def __init__(
        self,
        desk: Desk,
        node: RosNode,
        utc_s: Callable[[], float],
        rate_hz: float,
        report: Callable[[str], None],
        missions: MissionServices | None,
    ) -> None:
        self._station, self._node = desk.station, node
        self._utc_s, self._rate_hz = utc_s, rate_hz
        self._report, self._missions = report, missions
        self._loop = asyncio.get_running_loop()
        self._publishers: dict[str, RosPublisher] = {}
        """By the topic of ROS."""
        self._offered: dict[str, dict[str, tuple[str, ...]]] = {}
        """Of each platform: its topics, each with those of ROS that it becomes."""
        self._pictures: set[str] = set()
        """Full names of topics of pictures."""
        self._subscribers: dict[str, set[Entity]] = {}
        """By the topic of ROS."""
        self._diagnosed = node.publisher("/diagnostics", "diagnostic_msgs/DiagnosticArray", STATE)
        self._offsets_s: dict[tuple[str, int], float] = {}
        """By the vehicle and its boot."""
        self._ends: list[Unsubscribe] = []
        self._timer: asyncio.TimerHandle | None = None
        self._begun_s = self._loop.time()
        self._problems: Mapping[str, int] = {}

    def open(self) -> None:
        """Begins to publish."""

        def changed(entity: Entity, is_there: bool) -> None:
            if not self._loop.is_closed():
                self._loop.call_soon_threadsafe(self._subscribed, entity, is_there)

        self._node.watch(changed)
        self._ends.append(self._station.monitor.listen(lambda _, envelope: self._show(envelope)))
        self._update()

    def close(self) -> None:
        """Requests and publishes nothing more."""
        for end in self._ends:
            end()
        if self._timer is not None:
            self._timer.cancel()
        self._station.monitor.unwatch(VIEWER)

    def _update(self) -> None:
        """Offers topics of new vehicles, updates the requests, and publishes what is periodic."""
        self._timer = self._loop.call_later(POLL_PERIOD_S, self._update)
        now_s = self._loop.time()
        for platform in self._station.fleet:
            self._station.monitor.list_topics(platform.name)
            for entry in self._station.monitor.watches.entries(platform.name):
                self._offer(platform.name, entry.name, entry.type)
            if self._missions is not None:
                self._missions.offer(platform)
            self._want(platform.name)
            statuses = [_status(platform, one) for one in platform.components(now_s)]
            if statuses:
                self._diagnosed.publish(diagnostics(statuses, stamp(round(self._utc_s() * 1e9))).message)
        self._report_problems(now_s)

    def _report_problems(self, now_s: float) -> None:
        if not self._node.is_connected and now_s - self._begun_s >= WITHOUT_ROUTER_S:
            self._begun_s = float("inf")
            self._report(f"no router of ROS 2 at {self._node.network.router}: start one, such as rmw_zenohd")
        problems = dict(self._node.problems)
        for reason in problems.keys() - self._problems.keys():
            self._report(f"ROS 2: {reason}")
        self._problems = problems

    def _offer(self, platform: str, topic: str, message: str) -> None:
        offered = self._offered.setdefault(platform, {})
        if topic in offered:
            return
        found = announced(platform, topic, message)
        offered[topic] = tuple(name for name, _ in found)
        if message == "Image":
            self._pictures.add(f"{platform}/{topic}")
        for name, kind in found:
            if name not in self._publishers:
                qos = SENSOR if kind.startswith("sensor_msgs/") else STATE
                try:
                    self._publishers[name] = self._node.publisher(name, kind, qos)
                except Refused as refusal:
                    self._report(str(refusal))

    def _subscribed(self, entity: Entity, is_there: bool) -> None:
        """A subscription has appeared or left."""
        if entity.kind is not EntityKind.SUBSCRIPTION or entity.endpoint is None:
            return
        subscribers = self._subscribers.setdefault(entity.endpoint.name, set())
        (subscribers.add if is_there else subscribers.discard)(entity)
        for platform in self._offered:
            self._want(platform)

    def _want(self, platform: str) -> None:
        """Requests the topics that somebody subscribes to."""
        monitor, wants = self._station.monitor, []
        for topic, names in self._offered.get(platform, {}).items():
            if any(self._subscribers.get(name) for name in names):
                width, height = monitor.watches.preview_size(platform, topic, LARGEST)
                is_picture = f"{platform}/{topic}" in self._pictures
                wants.append(Want(topic, PICTURE_RATE_HZ if is_picture else self._rate_hz, width, height))
        monitor.watch(VIEWER, platform, wants)

    def _show(self, envelope: Envelope[Any]) -> None:
        for record in ros_records(envelope, round(self._utc_offset_s(envelope) * 1e9)):
            publisher = self._publishers.get(record.topic)
            if publisher is not None and self._subscribers.get(record.topic):
                publisher.publish(record.message)

    def _utc_offset_s(self, envelope: Envelope[Any]) -> float:
        """From the vehicle's time to UTC: that of the message that came fastest."""
        platform = self._station.fleet.get(envelope.topic.partition("/")[0])
        key = (envelope.topic.partition("/")[0], 0 if platform is None else platform.boot)
        offset_s = min(self._utc_s() - envelope.t_s, self._offsets_s.get(key, float("inf")))
        self._offsets_s[key] = offset_s
        return offset_s


def _status(platform: PlatformSnapshot, component: ComponentSnapshot) -> RosMessage:
    level = STALE if component.is_stale else _LEVELS[component.health]
    state = str(component.health or "not heard yet")
    values = {name: float(value) for name, value in component.values.items() if value is not None}
    return diagnostic_status(platform.name, component.name, level, state, component.cause, values)
