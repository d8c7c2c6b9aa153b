"""The executor's state that survives its process: the missions' texts and their progress."""

import msgspec
from msgspec.structs import replace

from gloc3.mission.model.model import Contingency
from gloc3.mission.model.policy import Policy
from gloc3.mission.model.states import ActionState


class ItemSnapshot(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A mission, task or action."""

    state: ActionState
    reason: str = ""
    starts: int = 0
    """How often it was begun."""
    ran_s: float = 0.0
    """How long it was running, pauses left out."""
    progress: float = 0.0
    is_settled: bool = False
    """Failed, and gone on with all the same."""
    paused_by: str = ""
    """The level whose pause it is in."""
    waited_s: float = 0.0
    """How long it has been waiting for its guard."""
    is_planned: bool = False
    """Of an action that the autopilot flies as a plan, in a mode that it goes on in by itself."""
    repetition: int = 0
    """Of a task that is repeated: the time for which it is being done."""


class ProgramSnapshot(msgspec.Struct, frozen=True, kw_only=True):
    """A mission, or a single task or action."""

    name: str
    """`mission`, or the name of the single command."""
    text: str
    """The file's content."""
    own: ItemSnapshot
    items: dict[str, ItemSnapshot]
    """By `TASK` and `TASK.ACTION`."""


class PlannedSilence(msgspec.Struct, frozen=True, kw_only=True):
    """A silence that the mission has announced, and that has begun."""

    target: str
    """The `TASK` or `TASK.ACTION` that states it."""
    began_s: float
    until_s: float
    """When contact is due, on the platform's clock."""


class Snapshot(msgspec.Struct, frozen=True, kw_only=True):
    """The executor at one moment."""

    count: int
    """Of the action ids given so far: they are never used twice."""
    programs: list[ProgramSnapshot]
    policy: Policy | None = None
    """The policy that is being carried out."""
    cause: str = ""
    """Why."""
    land_at_s: float | None = None
    """With `hold`: when it ends in a landing, by the clock of the process that kept it; None where an operator orders
    it, who decides."""
    has_pilot: bool = False
    """A pilot has control, and no operator has said resume since."""
    silence: PlannedSilence | None = None
    """The planned silence that had begun; its times are those of the process that kept it."""
    contingency: Contingency | None = None
    """The contingency that was under way; `policy` is what it ends in."""
    kept_s: float = 0.0
    """When this was kept, by the clock of the process that kept it."""

    def of_earlier_start(self) -> "Snapshot":
        """As it is after a restart of the computer, whose clock counts from then on: what was left is left still.

        So a computer that is started again and again does not put off what is due.
        """
        silence, land_at_s = self.silence, self.land_at_s
        if silence is not None:
            began_s, until_s = silence.began_s - self.kept_s, silence.until_s - self.kept_s
            silence = replace(silence, began_s=began_s, until_s=until_s)
        return replace(
            self, silence=silence, land_at_s=None if land_at_s is None else land_at_s - self.kept_s, kept_s=0.0
        )
