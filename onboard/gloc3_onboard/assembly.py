"""The only wiring of a vehicle's onboard side: platform, links, devices, clock and storage in, named parts out.

The onboard process, another host, a child process and a flight in virtual time differ only in their inputs and in
`gloc3_onboard.parts.NOT_IN_FLIGHTS`.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from gloc3.cli.counting import counted
from gloc3.component.context import HostContext
from gloc3.component.workers import ImmediateExecutor
from gloc3.evaluation.requested_path import RequestedPath
from gloc3.exchange.tunnel.pacing import LinkBudget, budget_of
from gloc3.mavlink.codec import Frame, MavlinkMessage
from gloc3.mavlink.router import Router
from gloc3.mavlink.services.files.ftp_files import Files
from gloc3.mavlink.signing import SignedOnly
from gloc3.mavlink.transport.endpoints import Endpoint, parse_url
from gloc3.messages.command_interface import StationRole
from gloc3.messages.envelope import Severity
from gloc3.messages.readiness import LinkCondition
from gloc3.network.rights_file import Right
from gloc3.platform.platform import Platform
from gloc3_onboard.autopilot.arm_authority import ArmAuthority
from gloc3_onboard.autopilot.device import AutopilotDevice
from gloc3_onboard.autopilot.link import AutopilotLink
from gloc3_onboard.autopilot.link_reports import LinkReports
from gloc3_onboard.command_server.site import Background, Site
from gloc3_onboard.companion.acoustic_link import AcousticLink, ModemSettings
from gloc3_onboard.companion.autopilot_reporter import AutopilotReporter
from gloc3_onboard.companion.cameras import cameras_of
from gloc3_onboard.companion.companion import Companion
from gloc3_onboard.companion.landing_watchdog import LandingWatchdog
from gloc3_onboard.companion.link_rights import LinkRights
from gloc3_onboard.companion.link_watch import LinkWatch, RateWatch
from gloc3_onboard.companion.parameter_table import own_parameters
from gloc3_onboard.companion.routing import RoutedLink
from gloc3_onboard.companion.station_link import HeartbeatSource, StationLink, StationLinkSettings
from gloc3_onboard.inputs import Attachment, Hosting, Sensors, Storage, VehicleInputs
from gloc3_onboard.parts import Parts
from gloc3_onboard.process.event_narration import EventNarration
from gloc3_onboard.process.memory import RecordMemory
from gloc3_onboard.process.runner import Onboard
from gloc3_onboard.process.taps import ExchangeTaps
from gloc3_onboard.sensors.sensor_watch import SensorWatch
from gloc3_onboard.viewer.catalogue import Catalogue


def watch_sensors(parts: Parts, sensors: Sensors, now_s: Callable[[], float]) -> SensorWatch:
    """Watches the devices of a process that have a source."""
    watched = {name: sensors.devices[name] for name in sensors.urls}
    return parts.add("sensor watch", SensorWatch(sensors.urls, watched, sensors.rig, now_s))


def host_components(
    parts: Parts, platform: Platform, context: HostContext, devices: Mapping[str, Any], hosting: Hosting
) -> Onboard:
    """The components of a process, which accept commands from now on."""
    name = context.platform
    everything = {
        **devices,
        "taps": parts.add("taps", ExchangeTaps(context.exchange, context.loop, name)),
        "catalogue": parts.add("catalogue", Catalogue(platform, context.topics)),
    }
    onboard = Onboard(platform, context, everything, hosting.create, hosting.rows, hosting.placeholders)
    for component in onboard.hosts:
        parts.add(f"component {component}", onboard.hosts[component])
    return parts.add("components", onboard, onboard.close)


class VehicleSide:
    """The onboard side of a vehicle in the process with the autopilot's link.

    Attach the links, then `host` the components and `begin`.

    Args:
        inputs: inputs of the assembly.
        autopilot_url: URL of the autopilot's link.
    """

    def __init__(self, inputs: VehicleInputs, autopilot_url: str) -> None:
        self._inputs = inputs
        context, parts = inputs.context, Parts()
        exchange, loop, name = context.exchange, context.loop, context.platform
        self.parts: Final = parts
        self.stations: Final[list[StationLink]] = []
        self._ends: list[Endpoint] = []
        self._routed: list[RoutedLink] = []
        self._may_write = True
        self._autopilot_url = autopilot_url
        events = parts.add("autopilot events", LinkReports(exchange, name, self._boot(), loop.time))
        narration = EventNarration(exchange, name, ["*"], inputs.report, inputs.journal)
        parts.add("event narration", narration, narration.close)
        authority = ArmAuthority(exchange, name)
        parts.add("arm authority", authority, authority.close)

        def autopilot_reports(severity: Severity, text: str, /, *, cause: str = "") -> None:
            events.report(severity, text, cause=cause)
            if severity > Severity.WARNING:  # below, the event is narrated
                inputs.report(severity, text)

        self.autopilot: Final = AutopilotLink(
            loop,
            context.clock,
            inputs.system_id,
            autopilot_reports,
            inputs.sign(autopilot_url, 0),
            lambda: authority.why_not(loop.time()),
        )
        self.autopilot_device: Final = AutopilotDevice(self.autopilot)
        self._router = parts.add("router", Router(self.autopilot.own, self._system_restarted))
        self.path: Final = RequestedPath(exchange, name)
        parts.add("requested path", self.path, self.path.close)
        self._reporter = AutopilotReporter(exchange, name, self.autopilot.own, loop, self._send_to_stations)
        parts.add("reporter", self._reporter, self._reporter.close)
        self.companion: Final = self._add_companion()
        watchdog = LandingWatchdog(exchange, inputs.platform, self.autopilot_device, loop, autopilot_reports)
        parts.add("landing watchdog", watchdog, watchdog.close)
        self._link_watch = LinkWatch(loop, self._ends, inputs.report)
        parts.add("link watch", self._link_watch, self._link_watch.close)
        self.onboard: Onboard | None = None

    def _boot(self) -> int:
        """A random boot number."""
        return self._inputs.context.random.getrandbits(32)

    def _add_companion(self) -> Companion:
        inputs = self._inputs
        companion = Companion(
            self.autopilot.own,
            inputs.platform,
            inputs.context,
            self._inputs.rights,
            inputs.vitals,
            own_parameters(self._set_least_severity, self._allow_writing),
            accepts_plans=inputs.accepts_plans,
        )
        return self.parts.add("companion", companion, companion.close)

    def _set_least_severity(self, severity: Severity) -> None:
        self._reporter.least_severity = severity

    def _allow_writing(self, is_allowed: bool) -> None:
        self._may_write = is_allowed

    def _system_restarted(self, system: int) -> None:
        self._inputs.report(Severity.NOTICE, f"MAVLink system {system} has restarted: its routes are cleared")

    # --- links ---

    def attach_autopilot(self) -> Attachment:
        """The link to the autopilot."""
        link = self.autopilot
        listeners = (
            link.receive_frames,
            self.companion.attach(lambda message, _: link.send_message(message), is_to_stations=False),
        )
        routed = self._route(self._autopilot_url, listeners, link.signed_only, None)
        self.parts.add("autopilot link", link, link.close)
        return self._attachment(routed, link.open)

    def attach_station(self, url: str, budget: LinkBudget | None = None) -> Attachment:
        """Adds a link to stations.

        Args:
            url: its URL, with rate and role.
            budget: bandwidth of our own frames; None for the URL's.
        """
        context, wanted, number = self._inputs.context, parse_url(url), len(self.stations) + 1
        signing, role = self._inputs.sign(url, number), StationRole(wanted.role)
        member = self._inputs.member_of(url, number)
        link_rights = LinkRights(self._inputs.rights, member)
        if not link_rights.may_command:
            whose = f"{member}, whose key it has," if member else "its key stands for no member, so its stations"
            self._inputs.report(Severity.NOTICE, f"{wanted.address}: {whose} may only look")
        link = StationLink(
            context.platform,
            self._inputs.system_id,
            context.loop,
            context.exchange,
            context.topics,
            self._boot(),
            StationLinkSettings(
                budget or budget_of(url, is_signed=signing is not None), signing, role, wanted.address, member
            ),
        )
        self.stations.append(link)
        # What observers send reaches our own command interface alone, which tells looking from commanding.
        is_for_observers = role is StationRole.OBSERVER
        to_companion = () if is_for_observers else (self.companion.attach(link.send, member=member),)
        watch = RateWatch(self.autopilot.request_streams_again, context.loop.time)
        self.parts.add(f"rate watch {number}", watch)
        withholds = [lambda _: True] if is_for_observers else [link_rights.withholds]
        if self._inputs.accepts_plans:
            withholds.append(self.companion.keeps)

        def keeps(frame: Frame) -> bool:
            return any(one(frame) for one in withholds)

        routed = self._route(url, (link.receive_frames, *to_companion, watch.receive), link.signed_only, keeps)
        routed.routed.is_to_stations = True
        self.parts.add(f"station link {number}", link, link.close)
        return self._attachment(routed, link.open)

    def attach_modem(self, settings: ModemSettings) -> Attachment:
        """An acoustic modem, which carries nothing of the other links."""
        context, ends = self._inputs.context, list[Endpoint]()
        if not self._inputs.rights.may(settings.member, Right.FLY):
            text = f"acoustic modem: its key stands for {settings.member or 'no member'}, whose orders are not obeyed"
            self._inputs.report(Severity.WARNING, text)
        modem = AcousticLink(
            context.platform,
            context.exchange,
            context.loop,
            self._boot(),
            lambda data: ends[0].send(data) if ends else None,
            settings,
        )
        self.parts.add("acoustic link", modem, modem.close)

        def opened(end: Endpoint) -> None:
            ends.append(end)
            self._ends.append(end)

        return Attachment(modem.receive, opened)

    def _route(
        self,
        url: str,
        listeners: Sequence[Callable[[list[Frame]], object]],
        signed_only: SignedOnly | None,
        keeps: Callable[[Frame], bool] | None,
    ) -> RoutedLink:
        inputs, number = self._inputs, len(self._routed)
        routed = RoutedLink(url, self._router, inputs.context.loop, listeners, inputs.keep, signed_only, keeps)
        self._routed.append(routed)
        return self.parts.add(f"routed link {number}", routed, routed.close)

    def _attachment(self, routed: RoutedLink, opened: Callable[[RoutedLink], None]) -> Attachment:
        def open_both(end: Endpoint) -> None:
            self._ends.append(end)
            routed.open(end)
            opened(routed)

        return Attachment(routed.receive, open_both)

    def link_conditions(self) -> list[LinkCondition]:
        """How each routed link is."""
        return [routed.condition() for routed in self._routed]

    def _send_to_stations(self, message: MavlinkMessage) -> None:
        for station in self.stations:
            station.send(message)

    # --- components ---

    def share(self, files: Files) -> None:
        """Shares files over MAVLink FTP, which stations may write as long as the parameter says so."""
        self.companion.share(files, lambda: self._may_write)

    def host(self, sensors: Sensors, computer: Any, storage: Storage, hosting: Hosting) -> Onboard:
        """Creates the components, which accept commands from now on.

        Args:
            sensors: the devices that samplers read.
            computer: the device `computer`.
            storage: persistent storage.
            hosting: the components of this process.
        """
        inputs, parts, context = self._inputs, self.parts, self._inputs.context
        beats = HeartbeatSource(
            context.exchange,
            context.platform,
            lambda: [self.autopilot.send_message, *(station.send for station in self.stations)],
        )
        parts.add("heartbeat", beats, beats.close)
        site = Site(
            inputs.platform,
            storage.journal,
            storage.progress,
            storage.reports,
            context.random.getrandbits(31),
            storage.computer_start,
            Background(storage.log_store, storage.worker or ImmediateExecutor(), inputs.terrain, storage.usage),
        )
        cameras = cameras_of(inputs.platform, sensors.rig.model, sensors.urls, inputs.video_url)
        for address in self.companion.add_cameras(cameras, context.platform, context.exchange):
            self._router.add_own(address)
        if any(row.arguments == "point_camera" for row in inputs.platform.capabilities.values()):
            self.companion.add_gimbal(context.platform, context.exchange, self._boot())
        devices = {
            **sensors.devices,
            "rig": sensors.rig,
            "autopilot": self.autopilot_device,
            "gimbal": self.autopilot.gimbal,
            "computer": computer,
            "memory": RecordMemory(storage.memory, storage.computer_start),
            "pictures": storage.pictures,
            "site": parts.add("site", site),
        }
        site.rights = inputs.rights
        self.onboard = host_components(parts, inputs.platform, context, devices, hosting)
        return self.onboard

    def begin(self) -> None:
        """Brings the components up, and watches the links."""
        assert self.onboard is not None
        self.onboard.begin()
        self._link_watch.begin()

    def traffic(self) -> list[str]:
        """Traffic statistics, a line per link, with refused requests of other programs."""
        refused = self.companion.reasons.reported
        lines = [f"refused of other programs' stations: {counted(refused, 'request')}"] if refused else []
        return lines + [f"{routed.url}: {routed.condition().traffic.describe()}" for routed in self._routed]

    def close(self) -> None:
        """Ends without ceremony: nothing is sent or received any more."""
        self.parts.close()
