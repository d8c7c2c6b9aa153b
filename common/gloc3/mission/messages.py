"""The function messages by which actions are started, paused, resumed and cancelled, and the report on them."""

from typing import Any

from gloc3.messages import Message
from gloc3.mission.states import ActionState


class ActionStart(Message, frozen=True):
    """`action.start`: begin an action."""

    action_id: str
    capability: str
    arguments: dict[str, Any] = {}


class ActionPause(Message, frozen=True):
    """`action.pause`: rest, keeping what has been achieved; a motion action holds position."""

    action_id: str


class ActionResume(Message, frozen=True):
    """`action.resume`: go on after a pause."""

    action_id: str


class ActionCancel(Message, frozen=True):
    """`action.cancel`: end it for good; a motion action holds position."""

    action_id: str


class ActionAccepted(Message, frozen=True):
    """The reply to all four: accepted. A refusal is the function reply's own."""

    action_id: str


class ActionStatus(Message, frozen=True):
    """How far an action is; reported on change and at 1 Hz."""

    action_id: str
    state: ActionState
    progress: float = 0.0
    """0 to 1."""
    reason: str = ""
