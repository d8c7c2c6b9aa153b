"""The input of the checks: a snapshot of everything that is known."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from gloc3.messages.frames import Vector3
from gloc3.messages.hosts import HostPresence
from gloc3.messages.readiness import AutopilotSetup, ComputerState
from gloc3.messages.software import Software
from gloc3.messages.summaries import Health
from gloc3.messages.vehicle import AutopilotState, HeightAboveGround, Pose
from gloc3.mission.model.model import Mission
from gloc3.platform.platform import Platform


@dataclass(frozen=True, kw_only=True, slots=True)
class ComponentCondition:
    """A component as the command interface sees it."""

    name: str
    health: Health
    is_required: bool
    is_standby: bool
    cause: str = ""
    """Its last error."""
    substitute: str = ""
    """The working component that is in charge of its outputs in its place."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Readings:
    """A snapshot; values that are unknown or do not exist are None."""

    platform: Platform
    now_s: float
    autopilot: AutopilotState | None = None
    setup: AutopilotSetup | None = None
    is_setup_fresh: bool = True
    """Whether the autopilot's setup was read again for this list."""
    computer: ComputerState | None = None
    pose: Pose | None = None
    is_pose_fresh: bool = False
    height: HeightAboveGround | None = None
    components: Sequence[ComponentCondition] | None = None
    """None where no component runs, as for `gloc3 doctor`."""
    mission: Mission | None = None
    home_ned_m: Vector3 | None = None
    """Home position: where the vehicle stands, or was armed."""
    fence_problem: str = ""
    """Why the autopilot does not hold the mission's fence."""
    stations: Mapping[str, Software] = field(default_factory=dict)
    """What the stations have that are there, by their names."""
    hosts: Mapping[str, HostPresence] = field(default_factory=dict)
    """The other hosts of the platform that have been here, by their names."""
    pilot_reason: str = ""
    """Why a pilot has control; empty while none has."""
