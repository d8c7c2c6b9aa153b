"""CC: has a winged vehicle wait in its autopilot's circles while this controller owns motion."""

import math
from collections.abc import Sequence
from typing import Annotated

from gloc3.component.component import Controller
from gloc3.component.ports import Inbox, Input, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.messages.standard_topics import AUTOPILOT_SILENT_S
from gloc3.messages.vehicle import AutopilotState, FlightMode, LandedState, Manoeuvre, ManoeuvreKind, MotionGrant
from gloc3_onboard.components.controllers.holding import Holding


class CircleSettings(Settings, frozen=True):
    """Settings of the controller for circles."""

    repeat_s: Annotated[float, Bounds(0.2, 60.0)] = 2.0
    """Period at which circling is requested again until the autopilot circles, in seconds."""


class CircleController(Holding, Controller[CircleSettings]):
    """Asks the autopilot for its circling mode in the air while it owns motion; performs the action `hold` too."""

    grant = Input(MotionGrant)
    autopilot = Input(AutopilotState)
    manoeuvre_wanted = Output(Manoeuvre)

    def __init__(self) -> None:
        self._requested: tuple[str, float] = ("", -math.inf)
        """Under which id, and when."""

    def stop(self) -> None:
        """Forgets the action."""
        self.drop_action()

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Asks while motion is this controller's and the autopilot does something else in the air."""
        owner, state = self.owner(inbox.latest(self.grant)), inbox.latest(self.autopilot)
        results: list[Result] = []
        if owner and state is not None and inbox.is_fresh(self.autopilot, now_s, AUTOPILOT_SILENT_S):
            results += self._request(owner, state.payload, now_s)
        self.report_progress(now_s)
        return [*results, *self.action_reports(now_s)]

    def _request(self, owner: str, autopilot: AutopilotState, now_s: float) -> list[Manoeuvre]:
        requested, requested_s = self._requested
        is_requested = requested == owner and now_s - requested_s < self.settings.repeat_s
        is_flying = autopilot.is_armed and autopilot.landed is not LandedState.ON_GROUND
        if is_requested or not is_flying or autopilot.mode is FlightMode.HOLD:
            return []
        self._requested = (owner, now_s)
        return [Manoeuvre(action_id=owner, kind=ManoeuvreKind.HOLD)]
