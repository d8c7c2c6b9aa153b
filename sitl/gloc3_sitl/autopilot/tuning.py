"""Tuning common to both styles: figures in SI units and failsafe actions, set by the parameters."""

from dataclasses import dataclass, field
from enum import IntEnum
from math import nan

from gloc3_sitl.autopilot.control.drive_gains import DriveGains
from gloc3_sitl.autopilot.control.position import PositionGains
from gloc3_sitl.autopilot.control.trajectory import TrajectoryLimits
from gloc3_sitl.autopilot.control.vtol_form import VtolGains
from gloc3_sitl.autopilot.control.wing_gains import WingGains


class FailsafeAction(IntEnum):
    """Failsafe actions by increasing severity."""

    NONE = 0
    WARN = 1
    HOLD = 2
    BRAKE = 3
    POSITION = 4
    """Hand over to the pilot, in position mode."""
    RETURN = 5
    LAND = 6
    DISARM = 7
    TERMINATE = 8


@dataclass(slots=True, kw_only=True)
class Tuning:
    """All tunable figures; comments state their purpose, the style's table names the parameters."""

    gains: PositionGains = field(default_factory=PositionGains)
    limits: TrajectoryLimits = field(default_factory=TrajectoryLimits)
    drive: DriveGains = field(default_factory=DriveGains)
    wings: WingGains = field(default_factory=WingGains)
    vtol: VtolGains = field(default_factory=VtolGains)
    attitude_p_roll: float = 6.5
    attitude_p_pitch: float = 6.5
    attitude_p_yaw: float = 3.0
    yaw_rate_rad_s: float = 0.8
    """Largest turn rate in autonomous modes, rad/s."""
    hover_thrust: float = 0.46

    # Take-off, landing, return
    takeoff_height_m: float = 2.5
    takeoff_speed_m_s: float = 1.5
    land_speed_m_s: float = 0.6
    land_slow_height_m: float = 4.0
    """Below this height above the ground the landing goes at `land_speed_m_s`."""
    land_fast_speed_m_s: float = 1.0
    disarm_after_landing_s: float = 2.0
    """Delay from touchdown to disarming after a landing, s; negative for never."""
    disarm_idle_s: float = 2.0
    """Delay from touchdown to disarming in any other mode, s; negative for never."""
    disarm_unflown_s: float = 10.0
    """Motors off when nothing took off within this time after arming; never when 0 or negative."""
    return_height_m: float = 15.0
    """Least height over home while flying back."""
    return_near_m: float = 10.0
    """Closer to home than this the vehicle does not climb first."""
    return_descend_m: float = 10.0
    """Height over home to which it comes down before it waits."""
    return_wait_s: float = 0.0

    orbit_radius_m: float = 1000.0
    """Largest circle."""
    follow_height_m: float = 8.0
    follow_distance_m: float = 8.0
    follow_bearing_deg: float = 180.0
    """Place beside the target, clockwise from its course; 180 is behind."""
    follow_height_over: int = 0
    """What the height counts from: 0 home, 1 ground, 2 target."""

    # Mission
    acceptance_radius_m: float = 2.0
    """Horizontal distance at which a waypoint counts as reached, where the item says none."""

    mission_uses_item_yaw: bool = True
    mission_faces_course: bool = True
    """Turns towards the next waypoint, where the item says no heading."""

    mission_requires: int = 0
    """What a mission must have, numbered as PX4's MIS_TKO_LAND_REQ: 0 nothing, 2 a landing."""

    # Streamed setpoints
    stream_timeout_s: float = 1.0
    """Setpoints older than this are lost."""
    stream_lost_action: FailsafeAction = FailsafeAction.HOLD
    stream_needed_hz: float = 2.0
    """Setpoint rate below which offboard control is refused, Hz; 0 for no limit."""

    # Links, battery, pilot, position, fence
    station_timeout_s: float = 10.0
    station_lost_action: FailsafeAction = FailsafeAction.NONE
    station_lost_exempt: int = 0
    """Bits as `Exempt`."""
    station_system: int = 0
    """Only heartbeats of this system count as the station's; 0 takes any ground station."""
    action_delay_s: float = 5.0
    """Hold before a failsafe that moves."""
    battery_low: float = 0.15
    battery_critical: float = 0.07
    battery_emergency: float = 0.05
    battery_low_v: float = 0.0
    """Volts below which the battery is low, after `battery_wait_s`; 0 for no limit."""
    battery_critical_v: float = 0.0
    battery_wait_s: float = 10.0
    battery_low_action: FailsafeAction = FailsafeAction.WARN
    battery_critical_action: FailsafeAction = FailsafeAction.RETURN
    battery_emergency_action: FailsafeAction = FailsafeAction.LAND
    pilot_timeout_s: float = 0.5
    pilot_lost_action: FailsafeAction = FailsafeAction.RETURN
    pilot_lost_exempt: int = 0
    pilot_required: bool = False
    """Whether arming needs a pilot's transmitter."""
    pilot_override: int = 1
    """Bit 0: moved sticks override autonomous modes; bit 1: offboard control too."""
    pilot_override_stick: float = 0.3
    transition_action: FailsafeAction = FailsafeAction.RETURN
    """After a transition to wings that has failed, on rotors again."""
    crash_action: FailsafeAction = FailsafeAction.NONE
    """When it lies on its side."""
    leak_action: FailsafeAction = FailsafeAction.NONE
    position_lost_action: FailsafeAction = FailsafeAction.LAND
    position_lost_s: float = 1.0
    fence_is_on: bool = True
    fence_action: FailsafeAction = FailsafeAction.HOLD
    fence_radius_m: float = 0.0
    """Farthest from home; 0 is no limit."""
    fence_height_m: float = 0.0
    """Highest over home; 0 is no limit."""
    fence_depth_m: float = 0.0
    """Deepest below home; 0 is no limit."""
    fence_has_polygons: bool = True
    """Whether uploaded polygons and circles count."""
    fence_margin_m: float = 0.0
    check_mask: int = -1
    """Arming checks that are made, bits as `Check`."""
    needs_position_to_arm: bool = True
    floats_at_m: float = nan
    """Depth reading of a diving vehicle at the surface, m; depth is its only height. NaN for others."""


class Exempt(IntEnum):
    """Bits of the modes in which a lost link changes nothing."""

    MISSION = 1
    HOLD = 2
    STREAMED = 4
    LANDING = 8
    PILOT = 16
