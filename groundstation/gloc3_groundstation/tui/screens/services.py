"""The vehicle services: parameters, plans, logs, files, calibration, rates, console and motors of the vehicle in view."""

from collections.abc import Iterable
from functools import partial
from typing import ClassVar, Final

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.events import ScreenResume
from textual.widgets import ContentSwitcher, Input

from gloc3_groundstation.desk.service_jobs import ServiceKind
from gloc3_groundstation.desk.services_desk import reached
from gloc3_groundstation.tui.screen import Offer, PaletteCommand, StationScreen, offers
from gloc3_groundstation.tui.services.calibration import CalibrationPane
from gloc3_groundstation.tui.services.console import ConsolePane
from gloc3_groundstation.tui.services.files import FilesPane
from gloc3_groundstation.tui.services.logs import LogsPane
from gloc3_groundstation.tui.services.motors import MotorsPane
from gloc3_groundstation.tui.services.pane import ServicePane
from gloc3_groundstation.tui.services.parameters import ParametersPane
from gloc3_groundstation.tui.services.plans import PlansPane
from gloc3_groundstation.tui.services.rates import RatesPane
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.views.services.frame import job_lines, services_line, unreachable_lines
from gloc3_groundstation.tui.widgets.panel import Panel

PANES: Final[tuple[type[ServicePane], ...]] = (
    ParametersPane,
    PlansPane,
    LogsPane,
    FilesPane,
    CalibrationPane,
    RatesPane,
    ConsolePane,
    MotorsPane,
)


class ServicesScreen(StationScreen):
    """One pane per service; running jobs continue while another pane is shown."""

    HELP = """The services of the autopilot in view: PX4 and ArduPilot, with or without a GLOC3 companion.
    Tab, or the left and right arrow keys, choose a service.

    Nothing is requested from the vehicle until you press a key. A running job shows its progress below and continues
    while you use other screens; esc cancels it. Writing asks for confirmation while the vehicle is armed. A parameter
    file is compared with the vehicle first. ● changed since the list was fetched, ≠ not the firmware's default. An
    interrupted download resumes."""
    AUTO_FOCUS = "#parameters_list"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding(
            "tab",
            "service(1)",
            "Service",
            priority=True,
            tooltip="the next service; → does the same, shift+tab and ← go back",
        ),
        Binding("right", "service(1)", "Next service", show=False, priority=True),
        Binding("shift+tab,left", "service(-1)", "Previous service", show=False, priority=True),
        Binding("escape", "back", "Cancel", show=False, tooltip="the running job, else closes search or comparison"),
    ]

    _style_class: object = None
    """State on which the displayed keys depend."""

    def body(self) -> ComposeResult:
        """Line of services, the panes, and the running job."""
        yield Panel(id="services", classes="plain line", can_focus=False)
        yield Panel(id="unreachable", classes="plain", can_focus=False)
        with ContentSwitcher(initial=ServicePane.name_of(ServiceKind.PARAMETERS), id="service_panes"):
            for pane in PANES:
                yield pane()
        yield Panel(id="job", classes="plain", can_focus=False)

    def show_view(self, view: StationView) -> None:
        """Fills the pane that is shown."""
        pane = self.pane
        name = view.platform.name if view.platform is not None else ""
        vehicle, reason = reached(self.desk.services, name)
        for each in self.query(ServicePane):
            each.vehicle = vehicle
        services, job = self.panel("services"), self.panel("job")
        running = vehicle.jobs.running if vehicle is not None else {}
        title = vehicle.snapshot.title if vehicle is not None else ""
        services.show([services_line(pane.service, running, title, services.width)])
        unreachable = self.panel("unreachable")
        unreachable.display = vehicle is None
        pane.display = vehicle is not None
        if vehicle is None:
            unreachable.show(unreachable_lines(reason, unreachable.width))
            job.show([])
            return
        pane.fill(vehicle)
        style_class = pane.style_class(vehicle)
        if style_class != self._style_class:
            self._style_class = style_class
            self.refresh_bindings()
        if self.focused is None and self.is_current:
            pane.list.focus()
        lines = job_lines(running.get(pane.service), vehicle.jobs.outcomes.get(pane.service), job.width)
        job.styles.height = len(lines)
        job.show(lines)

    def commands(self) -> Iterable[PaletteCommand]:
        """The keys of the pane that is shown, then those of the others."""
        yield from self.pane.commands()
        for offer in self.offers(self.row.title):
            if offer.part and offer.part != self.pane.service:
                yield PaletteCommand(offer.title, offer.help, partial(self.show_vehicle_on_screen, offer))

    @classmethod
    def offers(cls, title: str) -> Iterable[Offer]:
        """Its own keys, and those of its panes."""
        yield from offers(title, cls.BINDINGS)
        for pane in PANES:
            yield from offers(pane.service, pane.BINDINGS, pane.service)

    async def show_vehicle_on_screen(self, offer: Offer) -> None:
        """Performs the offered action, in its pane."""
        if not offer.part:
            await super().show_vehicle_on_screen(offer)
            return
        self._turn_to(ServiceKind(offer.part))
        await self.pane.run_action(offer.action)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Leaves the arrows to a line that is being typed."""
        if action == "service" and isinstance(self.focused, Input):
            return False
        return super().check_action(action, parameters)

    @property
    def pane(self) -> ServicePane:
        """The pane that is shown."""
        return self.query_one(f"#{self.query_one(ContentSwitcher).current}", ServicePane)

    def action_service(self, step: int) -> None:
        """Looks at the next service."""
        order = list(ServiceKind)
        self._turn_to(order[(order.index(self.pane.service) + step) % len(order)])

    def _turn_to(self, service: ServiceKind) -> None:
        self.query_one(ContentSwitcher).current = ServicePane.name_of(service)
        self.show_again()
        self.pane.list.focus()

    def action_back(self) -> None:
        """Cancels the running job, else leaves the pane's open item."""
        pane = self.pane
        if isinstance(self.focused, Input):
            pane.list.focus()
            pane.leave()
        elif pane.vehicle is None or not pane.vehicle.jobs.cancel(pane.service):
            pane.leave()
        self.show_again()

    def on_screen_resume(self, event: ScreenResume) -> None:
        """Shows what happened meanwhile, with the keys of the pane that is shown."""
        super().on_screen_resume(event)
        self.pane.list.focus()
