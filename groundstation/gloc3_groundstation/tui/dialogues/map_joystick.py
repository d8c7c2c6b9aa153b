"""Dialogue that maps a joystick: asks for each stick and button in turn, shows them live, and keeps the mapping."""

import asyncio
from typing import ClassVar, Final

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.screen import ModalScreen

from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.joysticks.defaults import default_mapping
from gloc3_groundstation.joysticks.detection import STEPS, Detection
from gloc3_groundstation.joysticks.device import JoystickDevice, JoystickReading
from gloc3_groundstation.joysticks.listener import JoystickReader
from gloc3_groundstation.joysticks.mapping import JoystickMapping
from gloc3_groundstation.joysticks.reader import open_reader
from gloc3_groundstation.tui.dialogues.questions import choices
from gloc3_groundstation.tui.views.joystick import JoystickView, joystick_lines
from gloc3_groundstation.tui.widgets.panel import Panel

POLL_S: Final = 0.1


class MapJoystickDialogue(ModalScreen[None]):
    """Maps a joystick; nothing is steered meanwhile.

    Args:
        desk: keeps the mappings.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("n", "detect", "Map anew"),
        Binding("enter", "go_on", "Skip, keep", priority=True),
        Binding("r", "reset", "Reset"),
        Binding("tab", "next_device", "Next joystick", priority=True),
        Binding("escape", "leave", "Leave"),
    ]

    def __init__(self, desk: Desk) -> None:
        super().__init__()
        self._desk = desk
        self._reader: JoystickReader | None = None
        self._devices: dict[int, JoystickDevice] = {}
        self._readings: dict[int, JoystickReading] = {}
        self._shown: int | None = None
        self._detection: Detection | None = None
        self._note = self._failure = ""

    def compose(self) -> ComposeResult:
        """The joystick, and the keys."""
        with Vertical(classes="question helm"):
            yield Panel(id="joystick", classes="plain", can_focus=False)
            yield choices(
                ("n", "map it: every stick and button in turn"),
                ("enter", "skip what is asked for; keep the mapping at the end"),
                ("r", "reset to the default mapping"),
                ("tab", "the next joystick"),
                ("esc", "leave; what was not kept is discarded"),
            )

    def on_mount(self) -> None:
        """Opens the joysticks."""
        self.query_one(Vertical).border_title = "Joystick"
        self._reader = open_reader(self._desk.gamepad, self)
        self.set_interval(POLL_S, self._draw)
        self.call_after_refresh(self._draw)

    async def on_unmount(self) -> None:
        """Closes them."""
        if self._reader is not None:
            await self._reader.close()

    # --- what the reader reports ---

    def connected(self, number: int, device: JoystickDevice) -> None:
        """A joystick is found; the first is shown."""
        self._devices[number] = device
        if self._note == self._failure:
            self._note = ""
        if self._shown is None:
            self._shown = number

    def disconnected(self, number: int, reason: str) -> None:
        """A joystick is gone: what was detected of it is discarded."""
        device = self._devices.pop(number)
        self._readings.pop(number, None)
        self._note = f"{device.name}: {reason}"
        if number == self._shown:
            self._shown, self._detection = next(iter(self._devices), None), None

    def moved(self, number: int, reading: JoystickReading) -> None:
        """Positions of a joystick."""
        self._readings[number] = reading
        if number == self._shown and self._detection is not None:
            self._detection.take(reading, asyncio.get_running_loop().time())

    def failed(self, reason: str) -> None:
        """No joystick can be read."""
        self._note = self._failure = reason

    # --- keys ---

    def action_detect(self) -> None:
        """Begins with the first stick."""
        if self._shown is not None:
            self._detection, self._note = Detection(self._devices[self._shown]), ""

    def action_go_on(self) -> None:
        """Skips a step; after the last, keeps the mapping."""
        detection, shown = self._detection, self._shown
        if detection is None or shown is None:
            return
        if detection.step is not None:
            detection.skip()
            return
        mapping = detection.mapping
        if mapping.problem:
            self._note = f"it is not kept: {mapping.problem}"
            return
        self._desk.joysticks[self._devices[shown].key] = mapping
        self._detection, self._note = None, self._kept("the mapping is kept")

    def action_reset(self) -> None:
        """Removes the mapping."""
        self._detection = None
        if self._shown is not None and self._desk.joysticks.pop(self._devices[self._shown].key, None) is not None:
            self._note = self._kept("reset to the default mapping")

    def action_next_device(self) -> None:
        """Shows another joystick."""
        if self._shown is not None and self._detection is None:
            numbers = list(self._devices)
            self._shown = numbers[(numbers.index(self._shown) + 1) % len(numbers)]

    def action_leave(self) -> None:
        """Closes it."""
        self.dismiss()

    def _kept(self, done: str) -> str:
        return done if self._desk.keep() else f"{done} until the station ends: the configuration file cannot be written"

    # --- what is shown ---

    @property
    def _mapping(self) -> JoystickMapping | None:
        if self._detection is not None:
            return self._detection.mapping
        if self._shown is None:
            return None
        device = self._devices[self._shown]
        return self._desk.joysticks.get(device.key) or default_mapping(device)

    def _draw(self) -> None:
        if not self.is_mounted:
            return
        detection, shown = self._detection, self._shown
        device = self._devices[shown] if shown is not None else None
        step = detection.step if detection is not None else None
        view = JoystickView(
            name=device.name if device is not None else "",
            is_own=device is not None and device.key in self._desk.joysticks,
            connected=len(self._devices),
            reading=self._readings.get(shown, JoystickReading()) if shown is not None else JoystickReading(),
            mapping=self._mapping,
            step="" if detection is None else step.text if step is not None else "done: try it; enter keeps it",
            place=(STEPS.index(step) + 1, len(STEPS)) if step is not None else (0, 0),
            problem=detection.problem if detection is not None and detection.problem else self._note,
        )
        self.query_one("#joystick", Panel).show(joystick_lines(view))
