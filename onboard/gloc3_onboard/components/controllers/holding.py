"""Base of controllers that keep the vehicle in place: the action `hold`, and motion that nobody else owns."""

from typing import ClassVar, Final

from gloc3.component.action import ActionPerformer
from gloc3.messages.envelope import Envelope
from gloc3.messages.vehicle import MotionGrant
from gloc3.mission.model.arguments import Hold
from gloc3.mission.model.states import ActionState

HOLD_ACTION: Final = "hold"
"""The id under which such a controller owns motion when no action does."""


class Holding(ActionPerformer):
    """Mix this into a controller that performs `hold`."""

    performs: ClassVar = {"hold": Hold}
    _last_action = ""
    """Until motion is taken from an action that has ended, it is kept."""
    _duration_s: float | None = None
    _until_s = 0.0

    def begin_action(self, capability: str, arguments: Hold, now_s: float) -> None:
        """Holds here for a time, or until cancelled."""
        self._duration_s = arguments.duration_s
        self._until_s = now_s + (arguments.duration_s or 0.0) * (1.0 - self.earlier_progress)

    def pause_action(self, now_s: float) -> None:
        """Stops the remaining time."""
        self._until_s -= now_s

    def resume_action(self, now_s: float) -> None:
        """The time that is left runs again."""
        self._until_s += now_s

    def owner(self, grant: Envelope[MotionGrant] | None) -> str:
        """Id under which this controller owns motion; empty if another does."""
        owner = grant.payload.action_id if grant is not None else ""
        self._last_action = self.action_id or self._last_action
        return owner if owner and owner in (HOLD_ACTION, self._last_action) else ""

    def report_progress(self, now_s: float) -> None:
        """Reports the action's progress; it ends with its time."""
        if self.is_running and self._duration_s is not None:
            left_s = self._until_s - now_s
            progress = 1.0 - left_s / self._duration_s if self._duration_s > 0.0 else 1.0
            self.advance(now_s, progress, ActionState.DONE if left_s <= 0.0 else ActionState.RUNNING)
