"""The states of actions, tasks and missions: one enum for all three levels (DESIGN §6)."""

from enum import StrEnum


class ActionState(StrEnum):
    """How far an action, a task or a mission is."""

    WAITING = "waiting"
    RUNNING = "running"
    PAUSED = "paused"
    DONE = "done"
    FAILED = "failed"
    SKIPPED = "skipped"
    ABORTED = "aborted"
