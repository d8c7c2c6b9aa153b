"""The function messages by which actions are started, paused, resumed and cancelled, and the report on them."""

from typing import Any

from gloc3.messages.envelope import Message
from gloc3.mission.model.states import ActionState


class ActionStart(Message, frozen=True):
    """`action.start`: begin an action."""

    action_id: str
    capability: str
    arguments: dict[str, Any] = {}
    """The order: the arguments with positions in NED, by the kind that the capability's row names."""
    progress: float = 0.0
    """How far an earlier attempt had come (0 to 1), after a restart: the component may go on from there."""


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
    """Progress of an action; reported on change and at 1 Hz."""

    action_id: str
    state: ActionState
    progress: float = 0.0
    """0 to 1."""
    reason: str = ""
    achieved: int = 0
    """What is not to be done again after a restart: waypoints passed, pictures taken. With each of them progress is put on
    disk."""
    is_blocked: bool = False
    """An obstacle is in the way."""
