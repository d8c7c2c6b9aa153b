"""Base of components that perform the actions of a platform's capabilities.

The command interface server sends function messages (`action.start`, `action.pause`, `action.resume`,
`action.cancel`); the component replies at once and reports `ActionStatus` on every change and at 1 Hz (DESIGN §6).
"""

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, Final

import msgspec

from gloc3.component.component import function
from gloc3.component.ports import Output
from gloc3.errors import Refused
from gloc3.mission.model.messages import (
    ActionAccepted,
    ActionCancel,
    ActionPause,
    ActionResume,
    ActionStart,
    ActionStatus,
)
from gloc3.mission.model.states import ActionState

REPORT_PERIOD_S: Final = 1.0
_RUNNING: Final = (ActionState.RUNNING, ActionState.PAUSED)


class ActionPerformer:
    """Mix-in for a component that performs actions, one at a time.

    The component overrides the four hooks, calls `advance()` while it works on an action, and ends its `work()` with
    `return [*results, *self.action_reports(now_s)]`. It calls `drop_action()` in its `stop()`.
    """

    performs: ClassVar[Mapping[str, type[msgspec.Struct]]]
    """Capability to the type of its arguments."""

    action_status = Output(ActionStatus)

    earlier_progress: float = 0.0
    """Progress that an earlier attempt at the same action had reached (0 to 1); more than 0 after a restart in
    flight."""
    _action: ActionStatus | None = None
    _is_changed: bool = False
    _reported_s: float = float("-inf")

    @abstractmethod
    def begin_action(self, capability: str, arguments: Any, now_s: float) -> None:
        """Starts an action with checked arguments, or resumes it at `earlier_progress`.

        Raises:
            Refused: the action cannot be performed now.
        """

    def pause_action(self, now_s: float) -> None:
        """Pauses the action; what has been achieved is kept."""

    def resume_action(self, now_s: float) -> None:
        """Resumes the action after a pause."""

    def end_action(self, now_s: float) -> None:
        """Clears the action, however it ended."""

    @property
    def action_id(self) -> str:
        """Id of the action under way; empty when there is none."""
        return self._action.action_id if self._action is not None and self._action.state in _RUNNING else ""

    @property
    def is_running(self) -> bool:
        """Whether an action is under way and not paused."""
        return self._action is not None and self._action.state is ActionState.RUNNING

    def advance(
        self,
        now_s: float,
        progress: float,
        state: ActionState = ActionState.RUNNING,
        reason: str = "",
        *,
        achieved: int | None = None,
        is_blocked: bool = False,
    ) -> None:
        """Reports the progress of the action; the states `done` and `failed` end it.

        Args:
            now_s: the time.
            progress: 0 to 1.
            state: of the action.
            reason: why it is in that state, or does not progress.
            achieved: waypoints passed or pictures taken: reported at once, so that a restart does not repeat them; None
                if unchanged.
            is_blocked: whether an obstacle blocks the path.
        """
        before = self._action
        assert before is not None
        achieved = before.achieved if achieved is None else achieved
        if state is not before.state or reason != before.reason or achieved != before.achieved:
            self._is_changed = True
        if is_blocked != before.is_blocked:
            self._is_changed = True
        self._action = ActionStatus(
            action_id=before.action_id,
            state=state,
            progress=min(max(progress, 0.0), 1.0),
            reason=reason,
            achieved=achieved,
            is_blocked=is_blocked,
        )
        if state not in _RUNNING:
            self.end_action(now_s)

    def action_reports(self, now_s: float) -> list[ActionStatus]:
        """Status messages to publish in this cycle: on change, and at 1 Hz while an action is under way."""
        if self._action is None:
            return []
        is_due = self._action.state in _RUNNING and now_s - self._reported_s >= REPORT_PERIOD_S - 1e-9
        if not (self._is_changed or is_due):
            return []
        self._is_changed = False
        self._reported_s = now_s
        return [self._action]

    def drop_action(self) -> None:
        """Forgets the action without a report, as at a stop of the component."""
        self._action = None
        self._is_changed = False

    @function("action.start")
    def _start_action(self, request: ActionStart, now_s: float) -> ActionAccepted:
        """Begins an action that this component performs."""
        if self.action_id:
            raise Refused(f"it is busy with action {self.action_id}")
        arguments_type = self.performs.get(request.capability)
        if arguments_type is None:
            raise Refused(f"it does not perform {request.capability!r}; it performs: {', '.join(self.performs)}")
        try:
            arguments = msgspec.convert(request.arguments, arguments_type)
        except msgspec.ValidationError as error:
            raise Refused(f"{request.capability}: {error}") from error
        self.earlier_progress = min(max(request.progress, 0.0), 1.0)
        self.begin_action(request.capability, arguments, now_s)
        self._action = ActionStatus(action_id=request.action_id, state=ActionState.RUNNING)
        self._is_changed = True
        return ActionAccepted(action_id=request.action_id)

    @function("action.pause")
    def _pause_action(self, request: ActionPause, now_s: float) -> ActionAccepted:
        """Pauses the action under way."""
        action = self._require(request.action_id, ActionState.RUNNING)
        self.pause_action(now_s)
        self.advance(now_s, action.progress, ActionState.PAUSED)
        return ActionAccepted(action_id=request.action_id)

    @function("action.resume")
    def _resume_action(self, request: ActionResume, now_s: float) -> ActionAccepted:
        """Resumes a paused action."""
        action = self._require(request.action_id, ActionState.PAUSED)
        self.resume_action(now_s)
        self.advance(now_s, action.progress, ActionState.RUNNING)
        return ActionAccepted(action_id=request.action_id)

    @function("action.cancel")
    def _cancel_action(self, request: ActionCancel, now_s: float) -> ActionAccepted:
        """Cancels an action."""
        action = self._require(request.action_id, *_RUNNING)
        self.advance(now_s, action.progress, ActionState.ABORTED, "cancelled")
        return ActionAccepted(action_id=request.action_id)

    def _require(self, action_id: str, *states: ActionState) -> ActionStatus:
        if self._action is None or self._action.action_id != action_id:
            raise Refused(f"it does not know action {action_id}")
        if self._action.state not in states:
            raise Refused(f"action {action_id} is {self._action.state}")
        return self._action
