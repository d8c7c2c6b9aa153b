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
    """Number of starts."""
    ran_s: float = 0.0
    """How long it was running, pauses left out."""
    progress: float = 0.0
    is_settled: bool = False
    """Failed, and continued nevertheless."""
    paused_by: str = ""
    """Level whose pause it is in."""
    waited_s: float = 0.0
    """How long it has been waiting for its guard."""
    is_planned: bool = False
    """Of an action that the autopilot flies as a plan, in a mode that continues without the companion."""
    repetition: int = 0
    """Of a task that is repeated: the time for which it is being done."""
    joined: list[str] = []
    """Of a mission: the other platforms that were seen in it before its end there, since it was loaded."""
    blemish: str = ""
    """Of a task that continues after a failure: why it will end as failed."""


class ProgramSnapshot(msgspec.Struct, frozen=True, kw_only=True):
    """A mission, or a single task or action."""

    name: str
    """`mission`, `contingency`, or `command NAME` of a single command; earlier processes wrote its `NAME` alone."""
    text: str
    """The file's content."""
    own: ItemSnapshot
    items: dict[str, ItemSnapshot]
    """By `TASK` and `TASK.ACTION`."""


class PlannedSilence(msgspec.Struct, frozen=True, kw_only=True):
    """A planned silence of the mission that has begun."""

    target: str
    """The `TASK` or `TASK.ACTION` that states it."""
    began_s: float
    until_s: float
    """When contact is due, in platform time."""


class Snapshot(msgspec.Struct, frozen=True, kw_only=True):
    """The executor at one moment."""

    count: int
    """Number of action ids assigned so far: they are never reused."""
    programs: list[ProgramSnapshot]
    policy: Policy | None = None
    """The policy that is being carried out."""
    cause: str = ""
    """Why."""
    land_at_s: float | None = None
    """With `hold`: when it ends in a landing, by the clock of the process that saved it; None for a hold requested by
    an operator, who ends it."""
    has_pilot: bool = False
    """A pilot has control, and no operator has resumed since."""
    lost: dict[str, tuple[Policy, str]] = {}
    """Components lost for good since then: the policy of their row, and the reason."""
    silence: PlannedSilence | None = None
    """The planned silence under way; its times are those of the process that saved it."""
    contingency: Contingency | None = None
    """The active contingency; `policy` is its follow-up."""
    kept_s: float = 0.0
    """When this was kept, by the clock of the process that kept it."""

    def of_earlier_start(self) -> "Snapshot":
        """The snapshot after a restart of the computer, whose clock starts at 0: remaining times are kept.

        So repeated restarts of the computer do not postpone due times.
        """
        silence, land_at_s = self.silence, self.land_at_s
        if silence is not None:
            began_s, until_s = silence.began_s - self.kept_s, silence.until_s - self.kept_s
            silence = replace(silence, began_s=began_s, until_s=until_s)
        return replace(
            self, silence=silence, land_at_s=None if land_at_s is None else land_at_s - self.kept_s, kept_s=0.0
        )
