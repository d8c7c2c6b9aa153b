"""Metrics of the onboard process for Prometheus: states, rates, costs, losses, links and battery, over HTTP.

Each scrape shows the last messages that the components have published; a thread of its own serves it.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from ipaddress import ip_address
from typing import Any, Final
from urllib.parse import urlsplit

from prometheus_client import CollectorRegistry, GCCollector, ProcessCollector, start_http_server
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from gloc3 import __version__
from gloc3.component.lci import State
from gloc3.errors import Refused
from gloc3.exchange.base import Exchange
from gloc3.messages.envelope import ComponentStatus, Envelope
from gloc3.messages.link_traffic import LinkTraffic
from gloc3.messages.readiness import ComputerState
from gloc3.messages.summaries import Health, MissionSummary, Summary, VehicleSummary
from gloc3.messages.vehicle import AutopilotState
from gloc3.mission.model.states import ActionState

ABSENT: Final = "absent"
STATES: Final = (*(str(state) for state in State), ABSENT)

_COMPONENT: Final[Mapping[str, tuple[str, Callable[[ComponentStatus], float]]]] = {
    "required": ("Whether the platform needs it (1) or not (0).", lambda one: one.is_required),
    "rate_hertz": ("Cycles a second since its last report.", lambda one: one.rate_hz),
    "nominal_rate_hertz": ("Cycles a second while its inputs come; 0 without a rate.", lambda one: one.nominal_rate_hz),
    "cycle_mean_seconds": ("Mean cost of a cycle since its last report.", lambda one: one.cycle_mean_s),
    "cycle_max_seconds": ("Greatest cost of a cycle since its last report.", lambda one: one.cycle_max_s),
    "silent_topics": ("Topics on which it has reported nothing for too long.", lambda one: len(one.silent)),
    "cycles_total": ("Cycles since its start.", lambda one: one.cycles),
    "overruns_total": ("Cycles that were due while the one before had not ended.", lambda one: one.overruns),
    "errors_total": ("Errors since its start.", lambda one: one.errors),
    "dropped_total": ("Messages that did not fit its input queues.", lambda one: one.dropped),
}
"""Of each component, by the end of the metric's name; those on _total only increase."""
_LINK: Final[Mapping[str, tuple[str, Callable[[LinkTraffic], float]]]] = {
    "received_bytes_total": ("Bytes received.", lambda one: one.bytes_in),
    "sent_bytes_total": ("Bytes sent.", lambda one: one.bytes_out),
    "received_frames_total": ("Usable frames received.", lambda one: one.frames_in),
    "sent_frames_total": ("Frames sent.", lambda one: one.frames_out),
    "lost_frames_total": ("Frames that were lost before they came here.", lambda one: one.lost),
    "damaged_bytes_total": ("Bytes that belong to no good frame.", lambda one: one.damaged_bytes),
    "dropped_frames_total": ("Frames dropped for lack of room.", lambda one: sum(one.dropped.values())),
    "waiting_frames": ("Frames that wait for the line to be free.", lambda one: one.waiting),
}
_VEHICLE: Final[Mapping[str, tuple[str, Callable[[VehicleSummary], float]]]] = {
    "autopilot_connected": ("Whether the autopilot is heard.", lambda one: one.is_autopilot_connected),
    "armed": ("Whether the vehicle is armed.", lambda one: one.is_armed),
    "pilot_control": (
        "Whether a pilot, the autopilot or an operator has taken control.",
        lambda one: one.has_pilot_control,
    ),
    "pose_valid": ("Whether the position can be used.", lambda one: one.is_pose_valid),
    "speed_meters_per_second": ("Speed.", lambda one: one.speed_m_s),
}


class PlatformMetrics(Collector):
    """What a platform's last messages say, as metrics.

    Args:
        exchange: source of the messages.
        platform: the platform's name.
    """

    def __init__(self, exchange: Exchange, platform: str) -> None:
        self._platform = platform
        self._last: dict[type[Any], Any] = {}
        self._components: dict[str, ComponentStatus] = {}
        topics = ("ci/summary", "ci/vehicle", "ci/mission", "autopilot", "computer")
        self._unsubscribes = [exchange.subscribe(f"{platform}/{topic}", self._keep) for topic in topics]
        self._unsubscribes.append(exchange.subscribe(f"{platform}/components/*/status", self._keep_status))

    def close(self) -> None:
        """Follows the messages no more."""
        for unsubscribe in self._unsubscribes:
            unsubscribe()
        self._unsubscribes.clear()

    def _keep(self, envelope: Envelope[Any]) -> None:
        self._last[type(envelope.payload)] = envelope.payload

    def _keep_status(self, envelope: Envelope[ComponentStatus]) -> None:
        self._components[envelope.payload.name] = envelope.payload

    def collect(self) -> Iterator[Metric]:
        """The metrics of this moment; called in the thread that serves them."""
        yield _family("gloc3_info", "What runs.", ("platform", "version"), [((self._platform, __version__), 1.0)])
        yield from self._of_components(list(self._components.values()))
        if (summary := self._last.get(Summary)) is not None:
            yield _one_of("gloc3_health", "Condition of the required components.", "health", Health, summary.health)
        if (vehicle := self._last.get(VehicleSummary)) is not None:
            for name, (text, value) in _VEHICLE.items():
                yield _family(f"gloc3_vehicle_{name}", text, (), [((), value(vehicle))])
        if (mission := self._last.get(MissionSummary)) is not None:
            yield _one_of("gloc3_mission_state", "State of the loaded mission.", "state", ActionState, mission.state)
        if (autopilot := self._last.get(AutopilotState)) is not None:
            yield from _of_battery(autopilot)
        if (computer := self._last.get(ComputerState)) is not None:
            yield from _of_computer(computer)

    def _of_components(self, components: list[ComponentStatus]) -> Iterator[Metric]:
        rows = [
            ((one.name, str(one.kind), state), float(state == (ABSENT if one.state is None else one.state)))
            for one in components
            for state in STATES
        ]
        yield _family("gloc3_component_state", "1 for the state that it is in.", ("component", "kind", "state"), rows)
        for name, (text, value) in _COMPONENT.items():
            rows_of = [((one.name,), value(one)) for one in components]
            yield _family(f"gloc3_component_{name}", text, ("component",), rows_of)


def _of_battery(autopilot: AutopilotState) -> Iterator[Metric]:
    yield _family("gloc3_battery_volts", "Voltage of the battery.", (), [((), autopilot.battery_v)])
    yield _family("gloc3_battery_amperes", "Current from the battery.", (), [((), autopilot.battery_a)])
    if autopilot.battery_remaining >= 0.0:
        yield _family("gloc3_battery_ratio", "Charge left, 0 to 1.", (), [((), autopilot.battery_remaining)])


def _of_computer(computer: ComputerState) -> Iterator[Metric]:
    free, rate = computer.disk_free_mb * 1e6, computer.log_mb_per_min * 1e6 / 60.0
    yield _family("gloc3_log_disk_free_bytes", "Free on the disk of logs and pictures.", (), [((), free)])
    yield _family("gloc3_log_bytes_per_second", "How fast the log grows.", (), [((), rate)])
    fails = [((one.url,), float(bool(one.problem))) for one in computer.links]
    yield _family("gloc3_link_failing", "Whether the link leads nowhere.", ("link",), fails)
    for name, (text, value) in _LINK.items():
        rows = [((one.url,), value(one.traffic)) for one in computer.links]
        yield _family(f"gloc3_link_{name}", text, ("link",), rows)


def _one_of(name: str, text: str, label: str, values: Iterable[str], current: str) -> Metric:
    return _family(name, text, (label,), [((str(one),), float(one == current)) for one in values])


def _family(
    name: str, text: str, labels: tuple[str, ...], rows: Iterable[tuple[tuple[str, ...], float]]
) -> GaugeMetricFamily | CounterMetricFamily:
    family = (CounterMetricFamily if name.endswith("_total") else GaugeMetricFamily)(name, text, labels=labels)
    for values, value in rows:
        family.add_metric(values, float(value))
    return family


def parse_address(text: str) -> tuple[str, int]:
    """Host and port of an address such as 127.0.0.1:9100 or [::1]:9100.

    Raises:
        Refused: it is none.
    """
    try:
        parts = urlsplit(f"//{text}")
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if not host or port is None or parts.path:
        raise Refused(f"--metrics {text!r} is no address; give HOST:PORT, such as 127.0.0.1:9100")
    return host, port


def is_loopback(host: str) -> bool:
    """Whether a host is this computer alone."""
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


class MetricsServer:
    """Serves the metrics of a platform and of this process, at any path.

    Args:
        exchange: source of the messages.
        platform: the platform's name.
        address: HOST:PORT; port 0 is a free one.

    Raises:
        Refused: the address cannot be used.
    """

    def __init__(self, exchange: Exchange, platform: str, address: str) -> None:
        host, port = parse_address(address)
        registry = CollectorRegistry()
        ProcessCollector(registry=registry)
        GCCollector(registry=registry)
        self._metrics = PlatformMetrics(exchange, platform)
        registry.register(self._metrics)
        try:
            self._server, self._thread = start_http_server(port, host, registry)
        except OSError as error:
            self._metrics.close()
            raise Refused(f"--metrics {address}: {error.strerror or error}") from error
        self.port: Final = int(self._server.server_address[1])
        """Of its socket."""

    def close(self) -> None:
        """Serves no more."""
        self._metrics.close()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()
