"""Dialogue for teleoperation by keys or gamepad; shows whether the vehicle follows.

A terminal reports that a key is pressed and repeated, never that it is released. So `enter` is the dead-man's key and
counts as held for `KEPT_S`, which its repetition renews; over a stalled connection no keys arrive, and the vehicle
stops. The other keys set the speed in steps, and renew the hold only while `enter` is held. A gamepad reports both
press and release.
"""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import ClassVar, Final

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.screen import ModalScreen

from gloc3.errors import Gloc3Error, Refused
from gloc3.messages.command_interface import Verb
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.desk.gamepad import Gamepad, GamepadState
from gloc3_groundstation.desk.teleoperation import FullSpeed, HandControl, StickDemand
from gloc3_groundstation.tui.dialogues.questions import choices
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.views.teleoperation import TeleoperationView, helm_lines
from gloc3_groundstation.tui.widgets.panel import Panel

KEPT_S: Final = 0.6
"""Keyboards repeat a key after half a second at the latest, as they are set by default, and then often."""
PAD_KEPT_S: Final = 0.3
POLL_S: Final = 0.1
STEP: Final = 0.25


class TeleoperateDialogue(ModalScreen[None]):
    """Steers the vehicle in view."""

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
        Binding("escape", "leave", "Leave"),
    ]

    def __init__(
        self, desk: Desk, platform: str, capability: str, moment: Callable[[], StationView], gamepad: str
    ) -> None:
        """Creates the dialogue.

        Args:
            desk: sends requests to the vehicle.
            platform: the vehicle.
            capability: its capability for teleoperation.
            moment: returns the current view.
            gamepad: its device; empty for none.
        """
        super().__init__()
        self._desk, self._platform, self._capability, self._moment = desk, platform, capability, moment
        known = desk.missions.platform(platform)
        limits = known.limits if known is not None else None
        self._full = FullSpeed() if limits is None else FullSpeed(limits.speed_m_s, limits.climb_m_s)
        self._hand: HandControl | None = None
        """None until the dialogue is shown."""
        self._device = gamepad
        self._pad: Gamepad | None = None
        self._is_pad_held = False
        self._begun = ""
        """The vehicle's name for the started action; empty before."""
        self._is_requesting = self._has_left = False
        self._problem = ""

    def compose(self) -> ComposeResult:
        """How it goes, and the keys."""
        with Vertical(classes="question helm"):
            yield Panel(id="helm", classes="plain", can_focus=False)
            yield choices(
                ("enter", "starts; then HOLD to move, release to stop"),
                ("w s a d", "ahead, back, left, right: one step"),
                ("↑ ↓ ← →", "up, down, turn: one step"),
                ("z", "centre all sticks"),
                ("space", "HOLD at once, as on all screens"),
                ("esc", "ends it: the vehicle holds position"),
            )

    def on_mount(self) -> None:
        """Opens the gamepad, and starts updates at 10 Hz."""
        loop = asyncio.get_running_loop()
        self._hand = HandControl(self._desk.station.client, loop, self._platform, self._full)
        if self._device:
            try:
                self._pad = Gamepad(Path(self._device).expanduser(), loop, self._pad_moved)
            except Refused as refusal:
                self._problem = str(refusal)
        self.query_one(Vertical).border_title = f"{self._platform} by hand"
        self.set_interval(POLL_S, self._poll)
        self.call_after_refresh(self._poll)

    def on_unmount(self) -> None:
        """Releases control and the gamepad, however it is closed."""
        if self._hand is not None:
            self._hand.close()
        if self._pad is not None:
            self._pad.close()

    # --- keys ---

    def action_go(self) -> None:
        """Asks the vehicle for it; then this is the dead-man's key."""
        assert self._hand is not None
        if self._begun:
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
        """Lets go and ends the action."""
        if self._hand is not None:
            self._hand.close()
        if self._begun:
            self.app.run_worker(self._desk.missions.steer(self._platform, Verb.ABORT, self._begun), exit_on_error=True)
        self._has_left = True
        self.dismiss()

    async def _begin(self) -> None:
        """Requests teleoperation; control granted after the operator has left is given back."""
        missions = self._desk.missions
        try:
            self._begun = await missions.request(self._platform, self._capability, {})
        except Gloc3Error as error:
            self._problem = str(error)
        finally:
            self._is_requesting = False
        if self._has_left and self._begun:
            await missions.steer(self._platform, Verb.ABORT, self._begun)

    # --- the gamepad ---

    def _pad_moved(self, state: GamepadState) -> None:
        """Sticks count only while they are held by the dead-man's button, so that keys work beside a pad at rest."""
        assert self._hand is not None
        if self._pad is not None and self._pad.problem:
            self._problem = self._pad.problem
        was_held, self._is_pad_held = self._is_pad_held, state.is_held
        if state.is_held:
            self._hand.move(state.sticks)
            self._keep_for_pad()
        elif was_held:
            self._hand.move(StickDemand())
            self._hand.release()

    def _keep_for_pad(self) -> None:
        if self._begun and self._is_pad_held and self._hand is not None:
            self._hand.hold_key(PAD_KEPT_S)

    # --- what is shown ---

    def _poll(self) -> None:
        hand = self._hand
        if hand is None or not self.is_mounted:
            return
        self._keep_for_pad()
        view = self._moment()
        platform = view.fleet.get(self._platform)
        self._end_session(platform.mission.value.tasks.get(self._begun) if platform and platform.mission else None)
        helm = TeleoperationView(bool(self._begun), hand.is_kept, hand.sticks, self._full, hand.session, self._problem)
        round_trip_s = self._desk.station.round_trip_s(self._platform)
        self.query_one("#helm", Panel).show(helm_lines(platform, helm, round_trip_s, view.now_s))

    def _end_session(self, state: str | None) -> None:
        """The vehicle has ended it: by a policy, by its pilot, by the emergency key."""
        if self._begun and state in ("aborted", "failed", "done", "skipped"):
            assert self._hand is not None
            self._hand.release()
            self._problem = f"ended ({state}); enter requests it again"
            self._begun = ""
