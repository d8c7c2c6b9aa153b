"""The console: PX4's shell over MAVLink, typed line by line."""

from typing import ClassVar, Final

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.message import Message
from textual.widgets import Input

from gloc3_groundstation.desk.service_jobs import ServiceKind
from gloc3_groundstation.desk.vehicle_desk import VehicleDesk
from gloc3_groundstation.services.console import LONGEST_LINE
from gloc3_groundstation.tui.services.pane import ServicePane
from gloc3_groundstation.tui.views.services.frame import hint_lines
from gloc3_groundstation.tui.widgets.lines import Span, Tone
from gloc3_groundstation.tui.widgets.panel import Row

HINTS: Final = (
    "o opens PX4's shell (MAVLink SERIAL_CONTROL). ArduPilot has none.",
    "What you type runs on the autopilot: some commands stop it.",
)
ARMED_QUESTION: Final = "A wrong command in its shell can make it crash."


class ShellLine(Input):
    """The line that is typed; up and down go through earlier ones."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up", "earlier(1)", "Earlier line", show=False),
        Binding("down", "earlier(-1)", "Later line", show=False),
    ]

    class Earlier(Message):
        """Another line of the history is wanted.

        Args:
            steps: back in time.
        """

        def __init__(self, steps: int) -> None:
            super().__init__()
            self.steps = steps

    def action_earlier(self, steps: int) -> None:
        """Asks for another line."""
        self.post_message(self.Earlier(steps))


class ConsolePane(ServicePane):
    """The pane of the console."""

    service = ServiceKind.CONSOLE
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("o", "open", "Type", tooltip="opens the shell, and types a line; enter does the same"),
        Binding("x", "interrupt", "Interrupt", tooltip="sends ctrl+c to the running command"),
    ]

    def __init__(self) -> None:
        super().__init__()
        self._back = 0
        """Lines back in the history; 0 for a new one."""
        self._last = ""
        """Key of the last row shown."""

    def compose(self) -> ComposeResult:
        """The line to type below the output."""
        yield from super().compose()
        yield ShellLine(
            id="console_line", placeholder="a line for the shell; ↑ ↓ earlier ones, esc leaves", max_length=LONGEST_LINE
        )

    def fill(self, vehicle: VehicleDesk) -> None:
        """The output; the cursor stays at its end unless it was moved up."""
        text = vehicle.console.text
        follows = self.list.chosen in ("", self._last)
        rows = [Row((Span(f" {line}"),), str(text.first + number)) for number, line in enumerate(text.lines)]
        if len(rows) == 1 and not text.current:
            rows = [Row(line) for line in hint_lines(*HINTS)]
        state = Span(" open", Tone.GOOD) if vehicle.console.is_open else Span(" not open", Tone.DIM)
        self.show((state,), rows, "shell of the autopilot")
        self._last = rows[-1].key
        if follows and self._last:
            self.list.point_at(self._last)
        line = self.query_one(ShellLine)
        if line.display and not vehicle.console.is_open and ServiceKind.CONSOLE not in vehicle.jobs.running:
            line.display = False  # the shell was refused: keys are commands again
            self.list.focus()

    def choose(self, key: str) -> None:
        """Types a line."""
        del key
        self.action_open()

    def leave(self) -> bool:
        """Puts the line away."""
        line = self.query_one(ShellLine)
        was_shown, line.display = line.display, False
        return bool(was_shown)

    def action_open(self) -> None:
        """Opens the shell, and shows the line to type."""
        vehicle = self.vehicle
        if vehicle is None:
            return
        is_armed = vehicle.is_armed

        def work() -> None:
            vehicle.console.open(while_armed=is_armed)
            line = self.query_one(ShellLine)
            line.display = True
            self.screen.set_focus(line)

        self.confirm_if_armed(ARMED_QUESTION, "open the shell", work)

    def action_interrupt(self) -> None:
        """Sends Ctrl-C."""
        if self.vehicle is not None:
            self.vehicle.console.interrupt()

    @on(Input.Submitted, "#console_line")
    def _submitted(self, event: Input.Submitted) -> None:
        vehicle, text = self.vehicle, event.value.strip()
        if vehicle is None or not text:
            return
        event.input.value, self._back = "", 0
        is_armed = vehicle.is_armed
        self.confirm_if_armed(
            f"{ARMED_QUESTION}\nType {text!r} into it?",
            "type it",
            lambda: vehicle.console.run(text, while_armed=is_armed),
        )

    @on(ShellLine.Earlier)
    def _earlier(self, event: ShellLine.Earlier) -> None:
        if self.vehicle is None:
            return
        history = self.vehicle.console.history
        self._back = max(0, min(len(history), self._back + event.steps))
        line = self.query_one(ShellLine)
        line.value = history[-self._back] if self._back else ""
        line.cursor_position = len(line.value)
