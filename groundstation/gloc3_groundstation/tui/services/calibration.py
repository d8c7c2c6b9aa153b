"""Calibration of sensors, transmitter and ESCs: start, follow step by step, confirm, cancel."""

from typing import ClassVar

from textual.binding import Binding, BindingType

from gloc3_groundstation.desk.service_jobs import ServiceKind
from gloc3_groundstation.desk.vehicle_desk import CalibrationKind, CalibrationPhase, VehicleDesk
from gloc3_groundstation.tui.services.pane import ServicePane
from gloc3_groundstation.tui.views.services.calibration import calibration_lines, esc_warning, kind_line
from gloc3_groundstation.tui.widgets.lines import Span, Tone
from gloc3_groundstation.tui.widgets.panel import Row


class CalibrationPane(ServicePane):
    """The pane of the calibration."""

    service = ServiceKind.CALIBRATION
    detail_lines = 1
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("b", "begin", "Begin", tooltip="calibrates what is under the cursor; also enter"),
        Binding("y", "measure", "Confirm", tooltip="the vehicle lies, or the sticks are, as instructed"),
    ]

    def fill(self, vehicle: VehicleDesk) -> None:
        """What can be calibrated, and how far it is."""
        state = vehicle.calibration
        rows = [Row(kind_line(kind, state), kind.value) for kind in CalibrationKind]
        self.show((Span(" what            state            what you do", Tone.DIM),), rows, "calibration")
        self.show_detail(lambda width: calibration_lines(state, width), state.kind.value if state is not None else "")

    def style_class(self, vehicle: VehicleDesk) -> object:
        """One key is there only while the vehicle waits for it."""
        return vehicle.calibration.phase if vehicle.calibration is not None else None

    def choose(self, key: str) -> None:
        """Begins; the ESCs after a typed confirmation."""
        vehicle = self.vehicle
        if vehicle is None or not key:
            return
        kind = CalibrationKind(key)
        if kind is not CalibrationKind.ESC or vehicle.motors.is_confirmed:
            vehicle.calibrate(kind)
            self.show_again()
            return
        self.prompt(
            f"calibrate the ESCs of {vehicle.name}?",
            lambda _: vehicle.calibrate(kind),
            lines=esc_warning,
            hint=f"type {vehicle.name} or props off",
            check=lambda text: vehicle.motors.confirm(text, vehicle.name),
        )

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Offers to measure only where the vehicle waits for that."""
        if action == "measure":
            state = self.vehicle.calibration if self.vehicle is not None else None
            return state is not None and state.phase is CalibrationPhase.WAITING
        return super().check_action(action, parameters)

    def action_begin(self) -> None:
        """Starts the calibration under the cursor."""
        self.choose(self.list.chosen)

    def action_measure(self) -> None:
        """Confirms."""
        if self.vehicle is not None:
            self.vehicle.confirm_calibration()
