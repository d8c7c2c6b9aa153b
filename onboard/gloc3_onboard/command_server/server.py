"""CI: the platform's command interface server: the one path from stations to components, and the mission's executor."""

from collections.abc import Sequence

from gloc3.component.component import CommandInterface
from gloc3.component.ports import Inbox, Result
from gloc3.messages.envelope import CommandReply, CommandRequest, FunctionReply
from gloc3_onboard.command_server.authority import Authority, AuthorityPorts
from gloc3_onboard.command_server.component_requests import ComponentRequests
from gloc3_onboard.command_server.contacts import Contacts
from gloc3_onboard.command_server.mission_commands import MissionCommands
from gloc3_onboard.command_server.mission_host import MissionHost, MissionPorts, was_running
from gloc3_onboard.command_server.observing import Observing, ObservingPorts
from gloc3_onboard.command_server.reporting import EventQueue, Reporting, ReportingPorts
from gloc3_onboard.command_server.requests import RequestHandler, RequestPorts
from gloc3_onboard.command_server.site import ServerSettings, Site


class CommandServer(CommandInterface[ServerSettings]):
    """Checks authority, claims and states; runs missions; supervises; summarises. Each part does one of these."""

    loggable = ("holder", "policy")

    requested = RequestPorts
    stations = AuthorityPorts
    observed = ObservingPorts
    missions = MissionPorts
    reported = ReportingPorts

    def __init__(self, site: Site) -> None:
        self.holder = self.policy = ""
        self._site = site

    def start(self) -> None:
        """Reads what the process before has left; it is taken up when the autopilot has told its state."""
        site = self._site
        snapshot, home = site.load()
        self._events = EventQueue(site)
        report = self._events.report
        contacts = Contacts(site.reports)
        self._observing = Observing(site.platform, home, self._events.report_supervision, site.process)
        self._authority = Authority(site.holder if was_running(snapshot) else "", report)
        self._mission = MissionHost(site, self._observing, self._authority.control, self.settings, report)
        commands = MissionCommands(site, self._observing, self._authority, self._mission, report)
        components = ComponentRequests(self._observing, report)
        self._requests = RequestHandler(site, self._authority, commands, components, contacts)
        self._reporting = Reporting(site, self.settings, self._events, contacts)

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Takes everything in, decides, and says what follows."""
        self._events.now_s = now_s
        self._observing.observe(now_s, inbox)
        self._authority.observe(now_s, inbox)
        self._reporting.observe(now_s, inbox)
        results: list[Result] = [*self._observing.supervise(now_s, inbox)]
        # what is asked for now is judged by what is known now
        results += self._mission.observe(now_s, inbox, is_urgent=self._requests.is_urgent)
        for request in inbox.new(RequestPorts.request):
            answer = self._requests.handle(request.payload, now_s)
            results += [] if answer is None else [answer]
        results += self._authority.demands.newest(inbox.new(AuthorityPorts.velocity_demand), now_s)
        results += self._receive_replies(now_s, inbox)
        results += [*self._requests.expire(now_s), *self._site.log_store.collect()]
        wanted = self._mission.take(now_s)
        for one in wanted:
            results += self._mission.carry_out(one)
        results += self._outgoing()
        self._authority.control.tick(now_s)
        self._keep()
        if self._requests.wants_everything:
            self._requests.wants_everything = False
            self._reporting.repeat_all()
        is_eventful = bool(wanted or inbox.new(RequestPorts.request))
        results += self._reporting.report(
            now_s, self._observing, self._authority.control, self._mission, is_eventful=is_eventful
        )
        return self._reporting.release(results, now_s)

    def _receive_replies(self, now_s: float, inbox: Inbox) -> list[Result]:
        replies: list[CommandReply | FunctionReply] = [reply.payload for reply in inbox.new(ObservingPorts.reply)]
        replies += [reply.payload for reply in inbox.new(RequestPorts.function_reply)]
        results: list[Result] = []
        for reply in replies:
            if not self._mission.receive_reply(reply, now_s):
                answer = self._requests.replied(reply)
                results += [] if answer is None else [answer]
        return results

    def _outgoing(self) -> list[Result]:
        """What requests of stations have for components, the driver and whoever reads the autopilot's setup."""
        results: list[Result] = []
        for component, message in self._requests.components.messages:
            if isinstance(message, CommandRequest):
                results.append(ObservingPorts.command.report(message, key=component))
            else:
                results.append(MissionPorts.function.report(message, key=component))
        self._requests.components.messages.clear()
        commands = self._requests.missions
        results += [*commands.disarms, *commands.gate.collect()]
        commands.disarms.clear()
        return results

    def _keep(self) -> None:
        """Has the disk keep home and the holder of control where they have changed."""
        snapshot = self._observing.snapshot
        if snapshot.is_home_new and snapshot.home is not None:
            snapshot.is_home_new = False
            self._site.keep_home(snapshot.home)
        self.holder, self.policy = self._authority.control.holder, self._mission.policy
        if self.holder != self._site.holder:
            self._site.keep_holder(self.holder)
