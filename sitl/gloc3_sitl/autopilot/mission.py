"""Mission progress, kept when the mode changes so that a mission resumes where it stopped."""

from dataclasses import dataclass, field
from enum import IntEnum


class MissionState(IntEnum):
    """Numbered as MISSION_STATE."""

    UNKNOWN = 0
    NO_MISSION = 1
    NOT_STARTED = 2
    ACTIVE = 3
    PAUSED = 4
    COMPLETE = 5


@dataclass(slots=True)
class MissionProgress:
    """The current mission item, and the state that a repeat or a restart needs."""

    current: int = 0
    state: MissionState = MissionState.NO_MISSION
    jumps: dict[int, int] = field(default_factory=dict)
    """Repeats already made, by the index of the jump."""
    reached: list[int] = field(default_factory=list)
    """Items reached since the last read; drained by the MAVLink front end."""
    count: int = 0
    """Number of the upload that this progress belongs to."""
    is_paused: bool = False
    """Halted inside mission mode (DO_PAUSE_CONTINUE in ArduPilot's style)."""
    outdated: int | None = None
    """Item of the previous plan, clamped to the new length; PX4 reports it until an item is set."""

    @property
    def reported(self) -> int:
        """The item in MISSION_CURRENT."""
        return self.current if self.outdated is None else self.outdated

    def restart(self, first: int) -> None:
        """Back to the beginning."""
        self.current = first
        self.jumps.clear()
        self.state = MissionState.NOT_STARTED
        self.is_paused = False
        self.outdated = None

    def on_upload(self, upload: int, length: int, first: int, *, reports_old: bool = False) -> None:
        """Handles the replacement of the item list."""
        old = self.reported
        self.count = upload
        self.restart(first)
        if length <= first:
            self.state = MissionState.NO_MISSION
        elif reports_old:
            self.outdated = min(old, length - 1)
