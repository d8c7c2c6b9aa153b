"""Mission: the contents of its file, and the partial order of tasks and actions built from it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from hashlib import blake2s
from typing import Annotated, Any, Final, Literal

import msgspec
from msgspec import structs

from gloc3.documents.document import Document, Where
from gloc3.documents.format_version import FormatVersion
from gloc3.mission.model.arguments import Arguments, Latitude, Longitude, Metres, Seconds
from gloc3.mission.model.conditions import Condition
from gloc3.mission.model.fence import Fence
from gloc3.mission.model.placement import HeightAbove
from gloc3.mission.model.policy import Policy

GEO: Final = "geo"
"""The name of the frame in which positions are latitude, longitude and height."""

Name = Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,31}$")]
Retries = Annotated[int, msgspec.Meta(ge=0, le=100)]
ConditionPolicy = Literal["continue", "hold", "return", "land", "abort"]
PlatformLossPolicy = Literal["continue", "skip", "hold", "return", "land", "abort"]
PlatformName = Annotated[str, msgspec.Meta(pattern=r"^[a-z][a-z0-9_]{0,31}$")]
ANY: Final = "any"
"""In place of a platform: one of those that fly the mission, which the assignment chooses."""
EACH: Final = "each"
"""In place of a platform: every platform that has a task performs it, for itself."""
Candidates = Annotated[tuple[PlatformName, ...], msgspec.Meta(min_length=1, max_length=64)]
RestartPolicy = Literal["continue", "hold", "land"]
FlownBy = Literal["companion", "autopilot"]
FLY_PLAN: Final = "fly_plan"
FLY_FILE: Final = "fly_file"
"""Capability of a platform whose autopilot can fly a path as a plan."""
FIND_WAY: Final = "find_way"
"""Capability of a platform that finds a way around obstacles."""
Corners = Annotated[tuple[tuple[Metres, Metres], ...], msgspec.Meta(min_length=3, max_length=200)]
GeoCorners = Annotated[tuple[tuple[Latitude, Longitude], ...], msgspec.Meta(min_length=3, max_length=200)]
Radius = Annotated[float, msgspec.Meta(gt=0.0, le=100_000.0)]


class _Part(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """The base of the parts of a mission file."""


class Circle(_Part, frozen=True, kw_only=True):
    """A circle in a local frame."""

    center_m: tuple[Metres, Metres]
    """`[x, y]`."""
    radius_m: Radius


class GeoCircle(_Part, frozen=True, kw_only=True):
    """A circle in frame geo."""

    center: tuple[Latitude, Longitude]
    radius_m: Radius


class AreaFile(_Part, frozen=True, kw_only=True):
    """A horizontal area as written: one of the four, in the form that the mission's frame takes."""

    polygon_m: Corners | None = None
    """Corners `[x, y]` in a local frame."""
    polygon: GeoCorners | None = None
    """Corners `[latitude, longitude]` in frame geo."""
    circle_m: Circle | None = None
    circle: GeoCircle | None = None


class GeofenceFile(AreaFile, frozen=True, kw_only=True):
    """Where the vehicle may be, as written."""

    ceiling_m: Annotated[float, msgspec.Meta(gt=-11_000.0, le=20_000.0)] | None = None
    """Greatest height, counted like the heights of the positions."""
    keep_out: Annotated[tuple[AreaFile, ...], msgspec.Meta(max_length=100)] = ()
    """Areas where it may not be."""


class Contingency(_Part, frozen=True, kw_only=True):
    """Response to a condition by a task from `contingencies`."""

    task: Name
    then: Literal["resume", "hold", "return", "land"] = "hold"
    """Follow-up: `resume` continues the mission where it was paused, or holds if the task has failed."""

    def __str__(self) -> str:
        return f"{self.task} then {self.then}"


def answer(wanted: "str | Contingency") -> Policy:
    """The policy that an answer to a condition is, or ends in."""
    if isinstance(wanted, Contingency):
        return Policy.HOLD if wanted.then == "resume" else Policy(wanted.then)
    return Policy(wanted)


class Policies(_Part, frozen=True, kw_only=True):
    """Reactions to failures and conditions."""

    on_failure: Policy = Policy.HOLD
    """When a task fails that says nothing itself."""
    on_link_loss: ConditionPolicy | Contingency = "hold"
    """When no message from the holder of control was received for `link_loss_after_s`."""
    link_loss_after_s: Annotated[float, msgspec.Meta(ge=0.5, le=86_400.0)] = 5.0
    on_overdue: ConditionPolicy | Contingency | None = None
    """When a planned silence has lasted longer than stated; None: `on_link_loss`."""
    on_low_battery: ConditionPolicy | Contingency = "return"
    on_pose_lost: ConditionPolicy | Contingency = "land"
    on_obstacle: ConditionPolicy | Contingency = "continue"
    """When an obstacle has been in the way of an action for `obstacle_after_s`."""
    obstacle_after_s: Annotated[float, msgspec.Meta(ge=0.0, le=3_600.0)] = 5.0
    on_component_fault: ConditionPolicy | Contingency = "continue"
    """When a component whose row has a policy is lost for good; the more severe of both applies, and `land` overrides
    any task."""
    on_platform_loss: PlatformLossPolicy = "hold"
    """When another platform on whose tasks this one waits is silent or has given up the mission. `continue`: keep
    waiting; `skip`: its tasks count as skipped, and the tasks after them run."""
    platform_loss_after_s: Annotated[float, msgspec.Meta(ge=1.0, le=86_400.0)] = 10.0
    on_restart: RestartPolicy = "hold"
    """When the onboard process came back in flight."""
    hold_s: Annotated[float, msgspec.Meta(ge=0.0, le=86_400.0)] = 60.0
    """How long a policy's hold waits for an operator before it lands."""


class Silence(_Part, frozen=True, kw_only=True):
    """A time without contact that is planned, such as a dive's."""

    expected_s: Annotated[float, msgspec.Meta(gt=0.0, le=864_000.0)]
    """From the start of the task or action until contact is due."""


class ItemFile(_Part, frozen=True, kw_only=True):
    """What tasks and actions both take."""

    after: tuple[Name, ...] = ()
    """Siblings that must have ended before it starts."""
    deadline_s: Annotated[float, msgspec.Meta(gt=0.0, le=86_400.0)] | None = None
    """It fails when it runs longer; pauses are not counted."""
    on_failure: Policy | None = None
    """None: the next level's."""
    silence: Silence | None = None
    """From its start a lost link is no fault until the stated time has passed; then it is overdue: `on_overdue`."""
    retries: Retries = 0
    """Attempts after the first before `on_failure` applies; `on_failure: retry` alone means one."""
    when: Condition | None = None
    """It starts only if this holds when its turn has come."""
    otherwise: Literal["skip", "wait", "fail"] = "skip"
    """Where `when` does not hold: `wait` until it does, but no longer than `deadline_s`, which then counts from its turn."""


class RepeatFile(_Part, frozen=True, kw_only=True):
    """How often a task is done."""

    times: Annotated[int, msgspec.Meta(ge=1, le=1_000)]
    """At most."""
    until: Condition | None = None
    """Looked at after each time: no further one where it holds."""


class ActionFile(ItemFile, frozen=True, kw_only=True):
    """What an action takes beside its capability."""

    until: Name | None = None
    """A sibling; when it has ended, this action is ended as done."""


class TaskOptions(ItemFile, frozen=True, kw_only=True):
    """What a task takes beside its actions."""

    platform: PlatformName | Candidates | None = None
    """The platform that performs it; in a mission for several platforms each task names one. `any`, or a list of
    platforms: the one to which it is assigned; `each`: every platform that has another task."""
    repeat: RepeatFile | None = None
    """Done several times, all its actions each time."""
    flown_by: FlownBy = "companion"
    """What controls the vehicle on its paths; with `autopilot` each path is uploaded as a plan that needs no
    companion."""
    plan: str | dict[str, str] | None = None
    """In place of actions, with `flown_by: autopilot`: another program's plan, relative to this file, whose items the
    autopilot flies unchanged; a mission that is sent contains its content."""

    @property
    def performer(self) -> str:
        """The platform that performs it; empty while none is known."""
        return self.platform if isinstance(self.platform, str) and self.platform not in (ANY, EACH) else ""

    @property
    def is_unassigned(self) -> bool:
        """Whether several platforms may perform it, and none has been chosen."""
        return self.platform == ANY or isinstance(self.platform, tuple)

    def is_for(self, platform: str) -> bool:
        """Whether a platform performs it, or may."""
        return platform in self.platform if isinstance(self.platform, tuple) else self.platform in (ANY, EACH, platform)


Actions = Annotated[dict[Name, dict[str, Any]], msgspec.Meta(min_length=1)]
"""By name: each holds one capability with its arguments, and `ActionFile`'s keys."""


class TaskFile(TaskOptions, frozen=True, kw_only=True):
    """A task as written: its actions, or the use of a definition that has them."""

    actions: Actions | None = None
    use: Name | None = None
    """A definition of this file, or of a library that it includes; what else the task says goes before that."""
    with_: dict[Name, Any] = msgspec.field(name="with", default={})
    """With `use`: the values of the definition's parameters."""


class ParameterFile(_Part, frozen=True, kw_only=True):
    """A parameter of a definition: `$NAME` there is replaced by its value, as a whole value."""

    kind: Literal["number", "whole", "text", "flag", "choice", "point", "points", "any"]
    default: Any = None
    """Where a use says nothing; without one it must."""
    unit: str = ""
    about: str = ""
    at_least: float | None = None
    at_most: float | None = None
    of: tuple[str | int | float, ...] = ()
    """With `choice`: the permitted values."""

    def __post_init__(self) -> None:
        if (self.kind == "choice") != bool(self.of):
            raise ValueError("'of' lists what is possible, and goes with kind: choice")

    @property
    def wanted(self) -> str:
        """What is expected, in words."""
        words = {
            "number": "a number",
            "whole": "a whole number",
            "flag": "true or false",
            "choice": "one of " + ", ".join(str(one) for one in self.of),
            "point": "a point: [x, y] or [x, y, height]",
            "points": "a list of points",
            "any": "a value",
        }
        return words.get(self.kind, "text") + (f" in {self.unit}" if self.unit else "")


Open = Annotated[str, msgspec.Meta(pattern=r"^\$")]
"""A parameter in place of a value."""


class DefinitionFile(_Part, frozen=True, kw_only=True):
    """A task that is defined once and used often."""

    about: str = ""
    parameters: dict[Name, ParameterFile] = {}
    actions: Actions
    deadline_s: float | Open | None = None
    on_failure: str | None = None
    silence: dict[str, Any] | None = None
    retries: int | Open = 0
    when: dict[str, Any] | None = None
    otherwise: str | None = None
    repeat: dict[str, Any] | None = None
    flown_by: FlownBy | None = None
    platform: PlatformName | Candidates | None = None


class LibraryFile(_Part, frozen=True, kw_only=True):
    """A file of definitions, for missions to include."""

    format_version: FormatVersion = msgspec.field(default=1, name="gloc3")
    """Version of the file's format; a newer one than this version of GLOC3 reads is refused."""
    about: str = ""
    define: dict[Name, DefinitionFile]


class MissionFile(Policies, frozen=True, kw_only=True):
    """A mission as written."""

    format_version: FormatVersion = msgspec.field(default=1, name="gloc3")
    """Version of the file's format; a newer one than this version of GLOC3 reads is refused."""
    mission: Annotated[str, msgspec.Meta(min_length=1, max_length=80)]
    """Its name."""
    frame: Annotated[str, msgspec.Meta(min_length=1, max_length=32)]
    """A local frame of the world or platform, or `geo`."""
    platform: Annotated[str, msgspec.Meta(min_length=1, max_length=200)] | None = None
    """The platform that it is written for, by name: the station sends it there, and simulation flies it there, where none
    is named; or a platform file, for simulation alone."""
    height_above: HeightAbove = HeightAbove.HOME
    """What heights are counted from in frame geo."""
    deadline_s: Seconds | None = None
    """It fails when it runs longer; pauses are not counted."""
    geofence: GeofenceFile | None = None
    include: tuple[str, ...] | dict[str, str] = ()
    """Libraries of definitions, relative to this file; a mission that is sent contains their content."""
    define: dict[Name, DefinitionFile] = {}
    """Tasks to be used by name."""
    tasks: Annotated[dict[Name, TaskFile], msgspec.Meta(min_length=1)]
    assigned: dict[PlatformName, tuple[Name, ...]] = {}
    """Platform to its tasks, each after the one before it: what was chosen for `platform: any` and lists."""
    contingencies: dict[Name, TaskFile] = {}
    """Tasks that policies name: `on_low_battery: {task: NAME, then: land}`."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Action:
    """A step of a task: a capability with its arguments."""

    name: str
    capability: str
    arguments: Arguments
    """As written."""
    filled: Arguments
    """With the platform's defaults filled in."""
    order: Arguments
    """As the component gets it: positions in NED."""
    options: ActionFile = field(default_factory=ActionFile)
    is_planned: bool = False
    """Whether the autopilot flies it as a plan."""
    is_routed: bool = False
    """Whether the platform finds a way around obstacles for it."""

    @property
    def ability(self) -> str:
        """The platform's capability by which it is done."""
        if self.is_routed:
            return FIND_WAY
        return FLY_PLAN if self.is_planned and self.capability != FLY_FILE else self.capability

    @property
    def attempts(self) -> int:
        """How often it is started at most."""
        return attempts(self.options)


@dataclass(frozen=True, kw_only=True, slots=True)
class Task:
    """A partially ordered set of actions."""

    name: str
    actions: Mapping[str, Action]
    """Empty for a task of another platform."""
    options: TaskOptions = field(default_factory=TaskOptions)
    is_elsewhere: bool = False
    """Another platform performs it: items after it wait for the state that is reported for it."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Mission:
    """A partially ordered set of tasks."""

    name: str
    frame: str
    platform: str | None = None
    height_above: HeightAbove = HeightAbove.HOME
    geofence: GeofenceFile | None = None
    """As written."""
    fence: Fence | None = None
    """In NED."""
    policies: Policies = field(default_factory=Policies)
    deadline_s: float | None = None
    tasks: Mapping[str, Task]
    contingencies: Mapping[str, Task] = field(default_factory=dict)
    text: str = field(default="", compare=False)
    """The file's content, from which the same mission can be read again."""
    document: Document | None = field(default=None, compare=False, repr=False)
    """Positions of all parts in the file."""

    def actions(self) -> dict[str, Action]:
        """All actions by `TASK.ACTION`, in the order of the file."""
        return {
            f"{task.name}.{action.name}": action for task in self.tasks.values() for action in task.actions.values()
        }

    @property
    def platforms(self) -> tuple[str, ...]:
        """The platforms that its tasks name, in the order of the file; empty for a mission of one."""
        named = (task.options.performer for task in self.tasks.values())
        return tuple(dict.fromkeys(filter(None, named)))

    @property
    def unassigned(self) -> tuple[str, ...]:
        """The tasks that wait for the choice of a platform, in the order of the file."""
        return tuple(name for name, task in self.tasks.items() if task.options.is_unassigned and not task.is_elsewhere)


def attempts(options: ItemFile) -> int:
    """How often an item is started at most: once, and its retries."""
    return 1 + (options.retries or (1 if options.on_failure is Policy.RETRY else 0))


@lru_cache(maxsize=16)
def digest_of(text: str) -> str:
    """A short digest of a mission's text, with which a station checks that the platform holds the same mission."""
    return blake2s(text.encode(), digest_size=6).hexdigest()


def where_of(target: str) -> Where:
    """The path in the mission file of the mission (empty), a `TASK`, or a `TASK.ACTION`."""
    task, _, action = target.partition(".")
    return ("tasks", task, "actions", action) if action else ("tasks", task) if task else ()


def part_of(mission: Mission, name: str) -> Mission:
    """One contingency of a mission as a mission of its own, in which a failure ends only the action."""
    task = mission.contingencies[name]
    return replace(
        mission,
        tasks={name: replace(task, options=structs.replace(task.options, after=()))},
        contingencies={},
        deadline_s=None,
        policies=structs.replace(mission.policies, on_failure=Policy.CONTINUE),
        document=mission.document.seen_as("tasks", "contingencies") if mission.document is not None else None,
    )
