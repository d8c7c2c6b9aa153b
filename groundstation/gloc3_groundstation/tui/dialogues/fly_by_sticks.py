"""Dialogue for manual flight of a vehicle without a companion: its autopilot takes the sticks."""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any, ClassVar

from textual.binding import Binding, BindingType

from gloc3.errors import Refused
from gloc3_groundstation.desk.autopilot_desk import OFFERS
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.desk.stick_flight import StickFlight
from gloc3_groundstation.desk.teleoperation import Hand
from gloc3_groundstation.joysticks.mapping import JoystickButton
from gloc3_groundstation.services.actions import Action
from gloc3_groundstation.tui.dialogues.by_hand import ByHandDialogue
from gloc3_groundstation.tui.dialogues.questions import YesNoQuestion
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.views.stick_flight import StickFlightView, stick_flight_lines
from gloc3_groundstation.tui.widgets.lines import Line


class FlyBySticksDialogue(ByHandDialogue):
    """Flies the vehicle in view by sticks, in a mode of its autopilot that takes them."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("m", "next_mode", "Mode"),
        Binding("o", "arm", "Arm, disarm"),
    ]

    def __init__(self, desk: Desk, platform: str, moment: Callable[[], StationView]) -> None:
        super().__init__(desk, platform, moment)
        self._flight: StickFlight | None = None
        """None until the dialogue is shown."""
        self._is_ending = False

    @property
    def is_begun(self) -> bool:
        """Whether the autopilot is in a mode that takes this station's sticks."""
        return self._flight is not None and self._flight.takes_sticks

    def keys(self) -> tuple[tuple[str, str], ...]:
        """What the keys do."""
        return (
            ("enter", "takes the sticks; then HOLD to move, release to stop"),
            *self.KEYS,
            ("m o", "next mode that takes sticks; arm or disarm"),
            ("esc", "ends it: the autopilot's hold"),
        )

    def new_hand(self, loop: asyncio.AbstractEventLoop) -> Hand:
        """Creates what sends the sticks."""
        desk = self._desk
        self._flight = StickFlight(desk.station, desk.autopilots, desk.services, self._platform, loop)
        self._flight.held_buttons = lambda: self._joystick.held_buttons if self._joystick is not None else ()
        return self._flight.hand

    async def begin(self) -> None:
        """Takes the sticks."""
        assert self._flight is not None
        await self._flight.begin()

    def let_go(self) -> None:
        """Centres the sticks, has the autopilot hold, and then sends no more."""
        if self._flight is not None and self._flight.is_open and not self._is_ending:
            self._is_ending = True
            self.app.run_worker(self._flight.end(), exit_on_error=True)

    def end(self) -> None:
        """Ends what was begun after the operator had left."""
        self.let_go()

    def joystick_button(self, button: JoystickButton) -> None:
        """Arms with the dead-man's key held; disarms, holds and changes the mode without."""
        match button:
            case JoystickButton.MODE:
                self.action_next_mode()
            case JoystickButton.DISARM:
                self._do(self._act(Action.DISARM))
            case JoystickButton.ARM if self._joystick is not None and self._joystick.is_held:
                self._do(self._act(Action.ARM))
            case JoystickButton.ARM:
                self._problem = "arm: hold the dead-man's key, too"
            case _:
                super().joystick_button(button)

    def action_next_mode(self) -> None:
        """Sets the next mode that takes sticks."""
        assert self._flight is not None
        self._do(self._flight.next_mode())

    def action_arm(self) -> None:
        """Asks, and arms or disarms."""
        platform = self._desk.station.fleet.get(self._platform)
        action = Action.DISARM if platform is not None and platform.is_armed else Action.ARM

        def answer(is_sure: bool | None) -> None:
            if is_sure:
                self._do(self._act(action))

        question = YesNoQuestion(OFFERS[action].question.format(self._platform), OFFERS[action].title.lower())
        self.app.push_screen(question, answer)

    def helm(self, view: StationView, hand: Hand) -> tuple[Line, ...]:
        """Mode, sticks, and what the vehicle does."""
        flight = self._flight
        assert flight is not None
        is_in_view = view.platform is not None and view.platform.name == self._platform
        if not is_in_view and self.is_current and not self._has_left:
            self.action_leave()
        shown = StickFlightView(
            is_open=flight.is_open,
            takes_sticks=flight.takes_sticks,
            is_kept=hand.is_kept,
            sticks=hand.sticks,
            note=flight.note,
            warnings=flight.warnings,
            problem=flight.problem,
        )
        round_trip_s = self._desk.station.round_trip_s(self._platform)
        return stick_flight_lines(view.fleet.get(self._platform), shown, round_trip_s, view.now_s)

    async def _act(self, action: Action) -> None:
        await self._desk.autopilots.command(self._platform, action)

    def _do(self, work: Coroutine[Any, Any, None]) -> None:
        async def attempt() -> None:
            try:
                await work
            except Refused as refusal:
                self._problem = str(refusal)

        self._problem = ""
        self.app.run_worker(attempt(), exit_on_error=True)
