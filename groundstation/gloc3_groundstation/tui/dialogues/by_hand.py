"""Base of the dialogues that steer a vehicle by hand, by keys or joystick.

A terminal reports that a key is pressed and repeated, never that it is released. So `enter` is the dead-man's key and
counts as held for `KEPT_S`, which its repetition renews; over a stalled connection no keys arrive, and the vehicle
stops. The other keys set the speed in steps, and renew the hold only while `enter` is held. A joystick reports both
press and release.
"""

import asyncio
from collections.abc import Callable
from typing import ClassVar, Final

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.screen import ModalScreen

from gloc3.errors import Gloc3Error
from gloc3.messages.command_interface import EmergencyVerb
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.desk.teleoperation import Hand
from gloc3_groundstation.joysticks.device import StickDemand
from gloc3_groundstation.joysticks.hand_on_joystick import HandOnJoystick
from gloc3_groundstation.joysticks.listener import JoystickReader
from gloc3_groundstation.joysticks.mapping import JoystickButton
from gloc3_groundstation.joysticks.reader import open_reader
from gloc3_groundstation.tui.dialogues.map_joystick import MapJoystickDialogue
from gloc3_groundstation.tui.dialogues.questions import choices
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.widgets.lines import Line, Span, Tone, wrapped
from gloc3_groundstation.tui.widgets.panel import Panel

KEPT_S: Final = 0.6
"""Keyboards repeat a key after half a second at the latest, as they are set by default, and then often."""
POLL_S: Final = 0.1
STEP: Final = 0.25
WIDTH: Final = 58
"""Of the dialogue's text."""


class ByHandDialogue(ModalScreen[None]):
    """Steers the vehicle in view.

    Args:
        desk: sends to the vehicle.
        platform: the vehicle.
        moment: returns the current view.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("enter", "go", "Go", priority=True),
        Binding("w", "push('surge', 1)", "Ahead"),
        Binding("s", "push('surge', -1)", "Back"),
        Binding("d", "push('sway', 1)", "Right"),
        Binding("a", "push('sway', -1)", "Left"),
        Binding("up", "push('heave', 1)", "Up"),
        Binding("down", "push('heave', -1)", "Down"),
        Binding("right", "push('yaw', 1)", "Clockwise"),
        Binding("left", "push('yaw', -1)", "Anticlockwise"),
        Binding("z,0", "rest", "Rest"),
        Binding("j", "map_joystick", "Map joystick"),
        Binding("escape", "leave", "Leave"),
    ]
    KEYS: ClassVar[tuple[tuple[str, str], ...]] = (
        ("w s a d", "ahead, back, left, right: one step"),
        ("↑ ↓ ← →", "up, down, turn: one step"),
        ("z", "centre all sticks"),
        ("space", "HOLD at once, as on all screens"),
        ("j", "map a joystick"),
    )
    """What the keys do that all of them have in common."""

    def __init__(self, desk: Desk, platform: str, moment: Callable[[], StationView]) -> None:
        super().__init__()
        self._desk, self._platform, self._moment = desk, platform, moment
        self._hand: Hand | None = None
        """None until the dialogue is shown."""
        self._joystick: HandOnJoystick | None = None
        self._reader: JoystickReader | None = None
        self._is_requesting = self._has_left = False
        self._problem = ""

    # --- what differs ---

    @property
    def is_begun(self) -> bool:
        """Whether the vehicle takes demands."""
        raise NotImplementedError

    def new_hand(self, loop: asyncio.AbstractEventLoop) -> Hand:
        """Creates what sends the demands."""
        raise NotImplementedError

    async def begin(self) -> None:
        """Requests manual control.

        Raises:
            Gloc3Error: it is refused.
        """
        raise NotImplementedError

    def end(self) -> None:
        """Gives manual control back."""
        raise NotImplementedError

    def helm(self, view: StationView, hand: Hand) -> tuple[Line, ...]:
        """State and sticks, ten times a second."""
        raise NotImplementedError

    def keys(self) -> tuple[tuple[str, str], ...]:
        """What the keys do."""
        raise NotImplementedError

    def joystick_button(self, button: JoystickButton) -> None:
        """A button of the joystick was pressed."""
        if button is JoystickButton.HOLD:
            self.app.run_worker(self._desk.emergency(self._platform, EmergencyVerb.HOLD), exit_on_error=True)

    # --- the dialogue ---

    def compose(self) -> ComposeResult:
        """How it goes, and the keys."""
        with Vertical(classes="question helm"):
            yield Panel(id="helm", classes="plain", can_focus=False)
            yield choices(*self.keys())

    def on_mount(self) -> None:
        """Opens the joysticks, and starts updates at 10 Hz."""
        loop = asyncio.get_running_loop()
        self._hand = self.new_hand(loop)
        self._open_joysticks()
        self.query_one(Vertical).border_title = f"{self._platform} by hand"
        self.set_interval(POLL_S, self._poll)
        self.call_after_refresh(self._poll)

    async def on_unmount(self) -> None:
        """Releases control and the joysticks, however it is closed."""
        await self._close_joysticks()
        self.let_go()

    def let_go(self) -> None:
        """Releases control."""
        if self._hand is not None:
            self._hand.close()

    def _open_joysticks(self) -> None:
        """Listens to the joysticks."""
        assert self._hand is not None
        steered = _WhileBegun(self._hand, lambda: self.is_begun)
        loop = asyncio.get_running_loop()
        self._joystick = HandOnJoystick(loop, steered, self._desk.joysticks, self.joystick_button)
        self._reader = open_reader(self._desk.gamepad, self._joystick)

    async def _close_joysticks(self) -> None:
        """Releases the joysticks, and listens no more."""
        if self._joystick is not None:
            self._joystick.close()
            self._joystick = None
        reader, self._reader = self._reader, None
        if reader is not None:
            await reader.close()

    def action_go(self) -> None:
        """Asks the vehicle for it; then this is the dead-man's key."""
        assert self._hand is not None
        if self.is_begun:
            self._hand.hold_key(KEPT_S)
        elif not self._is_requesting:
            self._is_requesting, self._problem = True, ""
            self.app.run_worker(self._begin(), exit_on_error=True)

    def action_push(self, way: str, steps: int) -> None:
        """Moves a stick by a step."""
        assert self._hand is not None
        sticks = self._hand.sticks
        self._hand.move(sticks._replace(**{way: getattr(sticks, way) + steps * STEP}))
        if self._hand.is_kept:
            self._hand.hold_key(KEPT_S)

    def action_rest(self) -> None:
        """All sticks to the middle."""
        assert self._hand is not None
        self._hand.move(StickDemand())

    def action_leave(self) -> None:
        """Lets go and ends it."""
        if self._joystick is not None:
            self._joystick.close()
        self.let_go()
        if self.is_begun:
            self.end()
        self._has_left = True
        self.dismiss()

    async def action_map_joystick(self) -> None:
        """Maps a joystick; none steers meanwhile."""
        await self._close_joysticks()
        self.app.push_screen(MapJoystickDialogue(self._desk), lambda _: self._open_joysticks())

    async def _begin(self) -> None:
        """Requests manual control; what is granted after the operator has left is given back."""
        try:
            await self.begin()
        except Gloc3Error as error:
            self._problem = str(error)
        finally:
            self._is_requesting = False
        if self._has_left and self.is_begun:
            self.end()

    def _poll(self) -> None:
        hand = self._hand
        if hand is None or not self.is_mounted:
            return
        lines = [*self.helm(self._moment(), hand), *self._joystick_lines()]
        if self._problem:
            lines += [(Span(line, Tone.BAD),) for line in wrapped(self._problem, WIDTH)]
        self.query_one("#helm", Panel).show(tuple(lines))

    def _joystick_lines(self) -> list[Line]:
        joystick = self._joystick
        if joystick is None:
            return []
        text = joystick.problem or "; ".join(joystick.names)
        tone = Tone.BAD if joystick.problem and not joystick.names else Tone.DIM
        if joystick.problem and joystick.names:
            text, tone = f"{joystick.problem} ({', '.join(joystick.names)})", Tone.WARN
        return [(Span(line, tone),) for line in wrapped(text, WIDTH)] if text else []


class _WhileBegun:
    """The hand, whose key counts only while the vehicle takes demands."""

    def __init__(self, hand: Hand, is_begun: Callable[[], bool]) -> None:
        self._hand, self._is_begun = hand, is_begun

    def move(self, sticks: StickDemand) -> None:
        self._hand.move(sticks)

    def hold_key(self, for_s: float) -> None:
        if self._is_begun():
            self._hand.hold_key(for_s)

    def release(self) -> None:
        self._hand.release()
