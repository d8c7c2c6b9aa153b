"""Logs of the vehicle: list, and download with progress; an interrupted download resumes."""

from typing import ClassVar

from textual.binding import Binding, BindingType

from gloc3_groundstation.desk.service_jobs import ServiceKind
from gloc3_groundstation.desk.vehicle_desk import VehicleDesk
from gloc3_groundstation.tui.services.pane import ServicePane
from gloc3_groundstation.tui.views.services.frame import hint_lines
from gloc3_groundstation.tui.views.services.lists import log_line, logs_header, logs_title
from gloc3_groundstation.tui.widgets.panel import Row


class LogsPane(ServicePane):
    """The pane of logs."""

    service = ServiceKind.LOGS
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("f", "fetch", "List", tooltip="asks the vehicle which logs it has"),
        Binding("d", "download", "Download", tooltip="the log under the cursor; enter does the same"),
        Binding("o", "pull", "Onboard", tooltip="fetches the onboard computer's logs, then deletes them there"),
        Binding("delete", "erase", "Erase all", tooltip="erases all logs of the vehicle; asks first"),
    ]

    def fill(self, vehicle: VehicleDesk) -> None:
        """The list."""
        width, logs = self.list.width, vehicle.logs
        rows = [Row(log_line(log, width), str(log.entry.number)) for log in logs or ()]
        hint = "f lists the logs of the vehicle." if logs is None else "The vehicle has no logs."
        rows = rows or [Row(line) for line in hint_lines(hint)]
        self.show(logs_header(width), rows, logs_title(logs))

    def choose(self, key: str) -> None:
        """Downloads a log."""
        vehicle = self.vehicle
        for log in (vehicle.logs or ()) if vehicle is not None else ():
            if vehicle is not None and str(log.entry.number) == key:
                vehicle.download_log(log)

    def action_fetch(self) -> None:
        """Lists them."""
        if self.vehicle is not None:
            self.vehicle.list_logs()

    def action_download(self) -> None:
        """Downloads the one under the cursor."""
        self.choose(self.list.chosen)

    def action_pull(self) -> None:
        """Fetches the onboard computer's logs, after a question: they are deleted there."""
        if self.vehicle is not None:
            name = self.vehicle.name
            question = (
                f"Fetch all logs of the onboard computer of {name}?\nEach is deleted there when its digest is equal."
            )
            self.confirm(question, "fetch them", self.vehicle.pull_logs)

    def action_erase(self) -> None:
        """Erases all, after a question."""
        if self.vehicle is not None:
            self.confirm(f"Erase ALL logs of {self.vehicle.name}?", "erase them", self.vehicle.erase_logs)
