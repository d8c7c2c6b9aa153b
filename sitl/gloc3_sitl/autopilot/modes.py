"""Flight modes, and the type of each style's mode table."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum, StrEnum
from typing import TYPE_CHECKING, Final

from gloc3_sitl.autopilot.logs.records import LogFormat
from gloc3_sitl.autopilot.parameters import AutopilotParameter
from gloc3_sitl.autopilot.tuning import Tuning

if TYPE_CHECKING:
    from gloc3_sitl.autopilot.behaviours.base import Activity
    from gloc3_sitl.autopilot.craft import Craft


NAVIGATION_STATES: Final[Mapping[str, int]] = {
    "Manual": 0,
    "Altitude": 1,
    "Position": 2,
    "Mission": 3,
    "Hold": 4,
    "Return": 5,
    "Offboard": 14,
    "Stabilized": 15,
    "Takeoff": 17,
    "Land": 18,
    "Follow": 19,
    "Orbit": 21,
}
"""PX4's numbers of its navigation states, by the names of its modes: `nav_state` in logs, and bits of mode groups."""


class Behaviour(StrEnum):
    """Behaviours of the vehicle; several modes may share one."""

    STABILIZE = "stabilize"
    ALTITUDE = "altitude"
    POSITION = "position"
    HOLD = "hold"
    BRAKE = "brake"
    TAKE_OFF = "take off"
    LAND = "land"
    RETURN = "return"
    MISSION = "mission"
    ORBIT = "orbit"
    FOLLOW = "follow"
    STREAMED = "streamed"
    """Setpoints from outside: PX4's Offboard, ArduPilot's Guided."""
    STREAMED_ATTITUDE = "streamed attitude"
    TERMINATED = "terminated"
    DIRECT = "direct"
    """The pilot's sticks go to the motors as they are: Manual of what drives or dives."""
    STEER = "steer"
    """The pilot's sticks are speed and turn rate."""
    STOP = "stop"
    """Stopped, wherever that is."""
    RETRACE = "retrace"
    """Return along the flown path."""
    Q_STABILIZE = "stabilize on rotors"
    Q_ALTITUDE = "altitude on rotors"
    Q_RETURN = "return on rotors"
    """What a quadplane does on its rotors, where it does the same in another mode on its wings."""


PILOTED: Final = frozenset(
    {
        Behaviour.STABILIZE,
        Behaviour.ALTITUDE,
        Behaviour.POSITION,
        Behaviour.DIRECT,
        Behaviour.STEER,
        Behaviour.Q_STABILIZE,
        Behaviour.Q_ALTITUDE,
    }
)
"""Flown by the pilot's sticks."""

POSITIONED: Final = frozenset(Behaviour) - {
    Behaviour.STABILIZE,
    Behaviour.ALTITUDE,
    Behaviour.STREAMED_ATTITUDE,
    Behaviour.TERMINATED,
    Behaviour.LAND,
    Behaviour.DIRECT,
    Behaviour.STEER,
    Behaviour.STOP,
    Behaviour.Q_STABILIZE,
    Behaviour.Q_ALTITUDE,
}
"""Impossible without a position estimate."""


class Landed(IntEnum):
    """States between ground and air, numbered as MAV_LANDED_STATE."""

    ON_GROUND = 1
    IN_AIR = 2
    TAKING_OFF = 3
    LANDING = 4


class Result(IntEnum):
    """Results of a request, numbered as MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Mode:
    """One row of a style's table of modes."""

    name: str
    """As people and ground stations call it."""
    custom_mode: int
    """As in HEARTBEAT.custom_mode."""
    base_mode: int
    """Flags of MAV_MODE_FLAG beside armed and custom."""
    behaviour: Behaviour
    can_arm: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class StyleTables:
    """All differences between the styles, as data."""

    name: str
    autopilot: int
    """MAV_AUTOPILOT."""
    modes: Sequence[Mode]
    boot_mode: int
    """Custom mode after start."""
    goes_on: Mapping[Behaviour, int]
    """Custom mode that follows when a behaviour is done."""
    keeps_intention: bool
    """Whether any mode may be chosen while disarmed, and disarming leads back to the last one that can arm."""
    fence_is_critical: bool
    """Whether the heartbeat reports a critical state when the fence acts; ArduPilot sends FENCE_STATUS at once instead."""
    hold_mode: int
    brake_mode: int
    takeoff_mode: int
    land_mode: int
    return_mode: int
    mission_mode: int
    streamed_mode: int
    position_mode: int
    altitude_mode: int
    parameters: Sequence[AutopilotParameter]
    derive: Callable[[Callable[[str], float], Tuning], None]
    """Updates tuning that depends on several parameters at once; called after each change."""
    refused: Result
    """Result of a request that the present state forbids (arming while unhealthy, take-off while disarmed)."""
    unknown_mode: Result
    """Result of a request for a mode that does not exist."""
    arming_prefix: str
    """Before each reason why arming is refused, in STATUSTEXT."""
    reports_by_event: bool
    """Whether the reasons against arming are EVENTs; otherwise they are texts."""
    streamed_needs_stream: bool
    """Whether streamed control is only entered while setpoints come in."""
    streamed_shapes_positions: bool
    """Whether a single far position is approached by a smooth trajectory."""
    log_folder: str
    """Folder of the flight logs on the memory card."""
    make_log: Callable[[], LogFormat]
    """Makes the format of a flight log."""
    mission_keeps_home: bool
    """Whether item 0 of a mission is home."""
    pilot_disarms_in_air: bool
    """Whether the arming switch stops the motors in flight."""
    takeoff_in_streamed: bool
    """Whether NAV_TAKEOFF is flown inside streamed control, and refused elsewhere."""
    version: tuple[int, int, int]
    """Version of the emulated firmware."""
    on_earth: frozenset[Behaviour] = frozenset()
    """Behaviours that need a position on Earth: an origin, and a heading relative to north."""
    orbit_mode: int | None = None
    """Where there is one."""
    activities: Mapping[Behaviour, Callable[["Craft"], "Activity"]] = field(default_factory=dict)
    """Behaviours that differ from those of multirotors, and their factories."""
    unsupported: frozenset[int] = frozenset()
    """MAV_CMDs that are for other classes of vehicles."""
    joystick_throttle_low: float = 0.0
    """`z` of MANUAL_CONTROL for the lowest throttle; the highest is 1000."""
    disarms_in_motion: bool = False
    """Whether the vehicle may be disarmed in motion, because it stops when its motors do."""

    def mode(self, custom_mode: int) -> Mode | None:
        """The row with this number."""
        return next((mode for mode in self.modes if mode.custom_mode == custom_mode), None)

    def mode_named(self, name: str) -> Mode | None:
        """The row with this name, letter case aside."""
        return next((mode for mode in self.modes if mode.name.lower() == name.lower()), None)
