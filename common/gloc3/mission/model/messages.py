"""Function messages that start, pause, resume and cancel actions, and the status report."""

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
    """Progress of an earlier attempt (0 to 1), after a restart: the component may continue from there."""


class ActionPause(Message, frozen=True):
    """`action.pause`: pause and keep what has been achieved; a motion action holds position."""

    action_id: str


class ActionResume(Message, frozen=True):
    """`action.resume`: continue after a pause."""

    action_id: str


class ActionCancel(Message, frozen=True):
    """`action.cancel`: end the action; a motion action holds position."""

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
    """Count of results that must not be repeated after a restart: waypoints passed, pictures taken. Progress is written
    to disk with each of them."""
    is_blocked: bool = False
    """An obstacle is in the way."""
