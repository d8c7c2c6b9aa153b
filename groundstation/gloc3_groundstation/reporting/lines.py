"""Lines of a report: a sentence for people, and the same as data for programs, by kind.

Within a version of the schema, fields keep their names and meanings; kinds and fields may be added.
"""

from collections.abc import Mapping
from typing import Final, Literal

import msgspec

from gloc3.clock import utc_text
from gloc3.errors import Finding
from gloc3.messages.summaries import MissionSummary, VehicleSummary

SCHEMA: Final = 1
"""Version of the lines' schema; it counts up when a field changes or goes."""


class EventData(msgspec.Struct, frozen=True, kw_only=True):
    """An event of a vehicle's component, or of the station."""

    severity: str
    """From `emergency` to `debug`, as in syslog."""
    source: str
    """The component; empty for an event of the station itself."""
    text: str


class HealthData(msgspec.Struct, frozen=True, kw_only=True):
    """Everything that matters at the first contact with a vehicle, or after its restart."""

    health: str
    """`working`, `quiet`, `standby`, `idle`, `absent` or `faulty`, of the required components; empty without a companion."""
    components: int
    """Number of components; 0 without a companion."""
    troubled: dict[str, str]
    """Components that are not at work, each with its health."""
    mission: MissionSummary | None
    """None without a companion."""
    vehicle: VehicleSummary | None
    """None while it is not known."""
    holder: str
    """The station in control; empty for none."""


class ComponentData(msgspec.Struct, frozen=True, kw_only=True):
    """Another health of a component."""

    name: str
    state: str
    """`working`, `quiet`, `standby`, `idle`, `absent` or `faulty`."""
    cause: str
    """Its last error."""


class MissionData(msgspec.Struct, frozen=True, kw_only=True):
    """Another state of the mission."""

    name: str
    state: str
    """`waiting`, `running`, `paused`, `done`, `failed`, `skipped` or `aborted`; empty without a mission."""
    policy: str
    """The policy that is being carried out; empty in normal flight."""
    reason: str


class ItemData(msgspec.Struct, frozen=True, kw_only=True):
    """Another state of a task or an action."""

    target: str
    """`TASK` or `TASK.ACTION`."""
    state: str
    """As of a mission."""


class ProgressData(msgspec.Struct, frozen=True, kw_only=True):
    """The present state of a vehicle in flight, every 5 s."""

    vehicle: VehicleSummary | None
    age_s: float | None
    """Age of the vehicle's state; null while it is not known."""
    mission: MissionSummary | None


class CommandData(msgspec.Struct, frozen=True, kw_only=True):
    """The outcome of a command of the script."""

    verb: str
    target: str
    """`TASK` or `TASK.ACTION`; empty for the mission."""
    is_accepted: bool
    reason: str
    """Why it was refused."""


class OrderData(msgspec.Struct, frozen=True, kw_only=True):
    """What has become of a command of `--do`."""

    command: str
    """As `take off 5`."""
    outcome: str
    """`done`, `failed`, `refused` or `not_heard`."""
    reason: str
    """Why it is not done."""


class ResultData(msgspec.Struct, frozen=True, kw_only=True):
    """The end of the mission."""

    mission: str
    state: str
    """As of a mission; `lost` where the vehicle no longer holds the mission."""
    reason: str


class NoData(msgspec.Struct, frozen=True, kw_only=True):
    """Nothing more than the line's own fields."""


KINDS: Final[Mapping[str, type[msgspec.Struct]]] = {
    "event": EventData,
    "health": HealthData,
    "vehicle": VehicleSummary,
    "component": ComponentData,
    "mission": MissionData,
    "task": ItemData,
    "action": ItemData,
    "progress": ProgressData,
    "command": CommandData,
    "order": OrderData,
    "finding": Finding,
    "result": ResultData,
    "end": NoData,
}
"""What the data of each kind of line are."""


class NarrationLine(msgspec.Struct, frozen=True, kw_only=True):
    """One line of a report."""

    schema: int = SCHEMA
    """Version of the schema."""
    utc: str
    """The time, ISO 8601 in UTC: `2026-01-01T00:00:03.200Z`."""
    t_s: float
    """Seconds since the station's start."""
    platform: str
    """The vehicle; empty for a line of the station or of the whole run."""
    kind: str
    """One of `KINDS`."""
    text: str
    """The line for people."""
    data: msgspec.Struct = NoData()
    """The same for programs, by kind."""

    def __str__(self) -> str:
        who = f"{self.platform}  " if self.platform else ""
        return f"{self.t_s:7.1f} s  {who}{self.text}"


class EndLine(NarrationLine, frozen=True, kw_only=True):
    """The last line of a run."""

    event: Literal["end"] = "end"
    outcome: str
    """`done`, `failed`, `wrong_use`, `taken_over`, `refused`, `not_heard` or `interrupted`."""
    exit_code: int


def utc_time(utc_s: float) -> str:
    """ISO 8601 of a time in seconds since 1970, in UTC with milliseconds."""
    return utc_text(utc_s, "%Y-%m-%dT%H:%M:%S.%f")[:-3] + "Z"
