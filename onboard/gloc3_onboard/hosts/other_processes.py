"""Other processes, seen from the clock host: children, hosts, time, and network stations.

What serves a network alone, with all of its cryptography, is loaded by its members.
"""

import asyncio
import os
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

from gloc3.cli.counting import counted
from gloc3.errors import Gloc3Error, InputError, Refused
from gloc3.messages.envelope import Severity
from gloc3.messages.readiness import SensorCondition
from gloc3.platform.places import clock_host, host_names
from gloc3_onboard.assembly import VehicleSide
from gloc3_onboard.autopilot.link_reports import LinkReports
from gloc3_onboard.hosts.host_agent import HostAgent
from gloc3_onboard.hosts.host_clock import ClockServer
from gloc3_onboard.hosts.host_watch import HostWatch
from gloc3_onboard.hosts.pipe import ChildSetup
from gloc3_onboard.hosts.shared import SharedExchange, renew, report_strangers, reread
from gloc3_onboard.inputs import VehicleInputs
from gloc3_onboard.process.options import ProcessOptions
from gloc3_onboard.process.runner import HostMember

if TYPE_CHECKING:
    from gloc3.network.file import Membership
    from gloc3.network.spreading import RevocationSpreader
    from gloc3.network.stations import BridgeMembers, StationBridge


class OtherProcesses:
    """The other processes of a platform, as the clock host's main process sees them: children, hosts, stations.

    Args:
        options: the options of `gloc3 onboard`.
        inputs: inputs of the vehicle's assembly.
        shared: the exchange with the others.
        member: network membership; None for MAVLink only.
        vehicle: the vehicle's side, which lists these parts among its own.
        sensors: conditions of this process's sensors.
    """

    def __init__(
        self,
        options: ProcessOptions,
        inputs: VehicleInputs,
        shared: SharedExchange,
        member: "Membership | None",
        vehicle: VehicleSide,
        sensors: Callable[[], list[SensorCondition]],
    ) -> None:
        context, report, parts = inputs.context, inputs.report, vehicle.parts
        exchange, platform = context.exchange, inputs.platform
        self._options, self._inputs, self._shared = options, inputs, shared
        self._host = clock_host(platform)
        self._agent = parts.add(
            "host agent",
            HostAgent(
                platform,
                self._host,
                context,
                self._order,
                lambda text: report(Severity.WARNING, text),
                sensors=sensors,
                vehicle_boot_s=lambda: vehicle.autopilot.telemetry.t_s_of_boot(0.0),
            ),
        )
        self._bridge: StationBridge | None = None
        self._spreader: RevocationSpreader | None = None
        self._cuts: set[asyncio.Task[None]] = set()
        self._renewal = asyncio.Lock()
        if member is not None:
            self._join(member, vehicle)
        clock_server = ClockServer(exchange, context.platform, context.loop)
        parts.add("clock server", clock_server, clock_server.close)
        self._watch = HostWatch(context, self._host, host_names(platform), report)
        parts.add("host watch", self._watch, self._watch.close)

    def _join(self, member: "Membership", vehicle: VehicleSide) -> None:
        """Serves the stations of a network, and passes its list of revoked members on."""
        from gloc3.network.spreading import RevocationSpreader
        from gloc3.network.stations import BridgeContext, StationBridge

        context, parts = self._inputs.context, vehicle.parts
        exchange, boots = context.exchange, context.random
        self._events = LinkReports(exchange, context.platform, boots.getrandbits(32), context.loop.time, "network")
        report_strangers(exchange, self._events.report)
        bridged = BridgeContext(context.platform, context.loop, context.clock, context.topics)
        self._bridge = StationBridge(exchange, bridged, _members(member), boots.getrandbits(32), self._forged)
        parts.add("network events", self._events)
        parts.add("station bridge", self._bridge, self._bridge.close)
        self._spreader = RevocationSpreader(
            exchange, context.loop, boots, member, self._adopt_list, partial(self._events.report, Severity.WARNING)
        )
        parts.add("list of revoked members", self._spreader, self._spreader.close)

    @property
    def is_beginning(self) -> bool:
        """Whether a child has not been there yet."""
        return self._agent.is_beginning

    @property
    def placeholders(self) -> Sequence[HostMember]:
        """The components of child processes."""
        return self._agent.placeholders

    def begin(self) -> None:
        """Begins the child processes."""
        self._agent.begin()

    def give_up_beginning(self) -> None:
        """Waits for no child that is still beginning."""
        self._agent.give_up_beginning()

    async def end(self) -> None:
        """Ends the child processes after their components have left."""
        for cut in self._cuts:
            cut.cancel()
        await self._agent.end()

    def log_problems(self) -> list[str]:
        """Why logs of the other processes are not written any more, each in words."""
        return [*self._agent.log_problems(), *self._watch.log_problems()]

    def sensors(self) -> list[SensorCondition]:
        """How the sensors of the other processes are."""
        return [*self._agent.child_sensors(), *self._watch.sensors()]

    async def renew_network(self) -> None:
        """Reads the network file again; where it is wrong, everything stays as it is."""
        network, inputs, spreader = self._options.network, self._inputs, self._spreader
        if network is None or spreader is None:
            return
        try:
            member = await reread(inputs.platform, self._host, network, inputs.context.loop, spreader.newest)
        except (InputError, Refused) as error:
            inputs.report(Severity.ERROR, f"{error}: the network is unchanged")
            return
        if await self._reconnect(member):
            self._admit(member)
            spreader.renew(member)
            others = counted(len(member.file.others), "other member")
            inputs.report(Severity.NOTICE, f"{network} is reloaded: {others}")

    async def _reconnect(self, member: "Membership") -> bool:
        """Opens the connections to others again; returns False, and reports it, where they cannot be opened."""
        async with self._renewal:
            self._watch.expect_renewal()
            try:
                await renew(self._inputs.context.exchange, self._shared.endpoint, member)
            except Gloc3Error as error:
                self._inputs.report(Severity.ERROR, f"{error}: other hosts are not reachable")
                return False
        return True

    def _admit(self, member: "Membership") -> None:
        """Requests are judged by this membership from now on."""
        assert self._bridge is not None
        self._bridge.members = _members(member)
        self._inputs.rights.adopt(member.rights, member.commanding, member.validity)

    def _adopt_list(self, member: "Membership", *, is_anyone_out: bool) -> None:
        """Applies a newer list of revoked members: to their requests at once, to their connections a little later."""
        self._admit(member)
        if is_anyone_out:
            cut = self._inputs.context.loop.create_task(self._cut_off(member))
            self._cuts.add(cut)
            cut.add_done_callback(self._cuts.discard)

    async def _cut_off(self, member: "Membership") -> None:
        from gloc3.network.spreading import PASSED_ON_S

        await asyncio.sleep(PASSED_ON_S)
        await self._reconnect(member)

    def _forged(self, station: str, reason: str) -> None:
        self._events.report(Severity.WARNING, f"a request of {station} is refused: {reason}")

    def _order(self, process: str, lives: dict[str, str | None] | None) -> ChildSetup:
        """The setup sent to a child process."""
        options = self._options
        return ChildSetup(
            platform=options.platform,
            host=self._host,
            process=process,
            endpoint=self._shared.endpoint,
            logs=str(options.logs or options.folder(self._inputs.platform)),
            devices=options.devices,
            parent=os.getpid(),
            offset_s=0.0,
            log_limits=options.log_limits,
            lives=lives,
        )


def _members(member: "Membership") -> "BridgeMembers":
    from gloc3.network.stations import BridgeMembers

    return BridgeMembers(member.file.roles, member.verifier())
