"""Plans on the autopilot: download, open a file, upload, verify, save and clear."""

from typing import ClassVar

from textual.binding import Binding, BindingType

from gloc3_groundstation.desk.service_jobs import ServiceKind
from gloc3_groundstation.desk.vehicle_desk import VehicleDesk
from gloc3_groundstation.tui.services.pane import ServicePane
from gloc3_groundstation.tui.views.services.frame import hint_lines
from gloc3_groundstation.tui.views.services.plans import plan_rows, plans_header, plans_title
from gloc3_groundstation.tui.widgets.panel import Row


class PlansPane(ServicePane):
    """The pane of plans."""

    service = ServiceKind.PLANS
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("f", "fetch", "Download", tooltip="mission, fence and rally points of the vehicle"),
        Binding("o", "open", "Open file", tooltip="a .plan or a file of waypoints"),
        Binding("u", "upload", "Upload", tooltip="the open file; it is read back and compared"),
        Binding("y", "verify", "Verify", tooltip="compares the vehicle's plan with the open file"),
        Binding("s", "save", "Save", tooltip="the vehicle's plan, to .plan or .waypoints"),
        Binding("delete", "clear", "Clear", tooltip="clears mission, fence and rally points; asks first"),
    ]

    def fill(self, vehicle: VehicleDesk) -> None:
        """The vehicle's plan and the open file."""
        width, plans = self.list.width, vehicle.plans
        rows = self.rows(
            lambda: [Row(line, key) for key, line in plan_rows(plans, width)],
            *(plans.found, plans.file, plans.differences, width),
        )
        hints = hint_lines("f downloads the plan of the vehicle.", "o opens a .plan or a file of waypoints.")
        self.show(plans_header(width), rows or [Row(line) for line in hints], plans_title(vehicle.plans))

    def style_class(self, vehicle: VehicleDesk) -> object:
        """Some keys require an open file."""
        return vehicle.plans.file is None

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Disables actions that require an open file."""
        if action in ("upload", "verify"):
            return True if self.vehicle is not None and self.vehicle.plans.file is not None else None
        return super().check_action(action, parameters)

    def action_fetch(self) -> None:
        """Downloads."""
        if self.vehicle is not None:
            self.vehicle.plans.download()

    def action_open(self) -> None:
        """Opens a file."""
        if self.vehicle is not None:
            self.choose_file("open a plan", self.vehicle.plans.open)

    def action_upload(self) -> None:
        """Uploads the open file."""
        plans = self.vehicle.plans if self.vehicle is not None else None
        if plans is not None and plans.file is not None:
            self.confirm_if_armed(f"Replace its plan by {plans.file.name}?", "upload it", plans.upload)

    def action_verify(self) -> None:
        """Compares with the open file."""
        if self.vehicle is not None:
            self.vehicle.plans.verify()

    def action_save(self) -> None:
        """Saves the vehicle's plan."""
        if self.vehicle is not None:
            self.choose_new_file("save the vehicle's plan as", self.vehicle.plans.save, f"{self.vehicle.name}.plan")

    def action_clear(self) -> None:
        """Clears, after confirmation: a plan that is only on the vehicle is lost."""
        if self.vehicle is not None:
            armed = " It is ARMED." if self.vehicle.is_armed else ""
            question = f"Clear mission, fence and rally points of {self.vehicle.name}?{armed}"
            self.confirm(question, "clear them", self.vehicle.plans.clear)
