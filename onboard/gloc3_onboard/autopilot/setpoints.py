"""Setpoints in the form accepted by a vehicle: a moving position, a velocity towards it, or a distant target.

Masks: MAVLink, POSITION_TARGET_TYPEMASK. An ArduPilot rover interprets a velocity as heading and speed; with a yaw, it
turns to
that yaw.
"""

import math
from typing import Final

from gloc3.amounts import beside
from gloc3.mavlink import codec
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.messages.frames import GeoPoint, TangentPlane, Vector3, yaw_of
from gloc3.messages.vehicle import AutopilotPose, FlightMode, VehicleClass
from gloc3_onboard.autopilot.style import ClassProperties, Form
from gloc3_onboard.autopilot.telemetry import Telemetry
from gloc3_onboard.sensors.devices import AutopilotSetpoint

LOCAL_NED: Final = 1
GLOBAL: Final = 0
DO_REPOSITION: Final = 192
IGNORE_POSITION: Final = 0b0000_0000_0000_0111
IGNORE_VELOCITY: Final = 0b0000_0000_0011_1000
IGNORE_ACCELERATION: Final = 0b0000_0001_1100_0000
IGNORE_YAW: Final = 0b0000_0100_0000_0000
IGNORE_YAW_RATE: Final = 0b0000_1000_0000_0000

PER_S: Final = 0.8
"""How fast a distance is made good, by a vehicle that is led by velocities: m/s a metre."""
MOST_M_S: Final = 2.0
"""No faster than that beyond the feed-forward."""
NEAR_M: Final = 0.5
"""A vehicle that is led by velocities stops so near to a place that does not move: it cannot go sideways to it."""
BEHIND_M: Final = 1.5
"""The same of a place that it has passed: it would have to drive round in a circle to come back."""
STANDING_M_S: Final = 0.05
AHEAD_M: Final = 200.0
"""So far ahead lies the place to which a vehicle is led that cannot stop."""


def setpoint_message(
    setpoint: AutopilotSetpoint, form: Form, target: Address, boot_ms: int, pose: AutopilotPose | None
) -> MavlinkMessage | None:
    """The setpoint message; None if it needs a pose and there is none.

    Args:
        setpoint: the setpoint.
        form: the vehicle's form of setpoints.
        target: the autopilot.
        boot_ms: its time since boot.
        pose: its own estimate of its pose.
    """
    if form is Form.REPOSITION:
        return _reposition(setpoint, target, pose)
    if form is Form.VELOCITY and setpoint.position_ned_m is not None:
        if pose is None:
            return None
        setpoint = uses_velocity(setpoint.position_ned_m, setpoint.velocity_ned_m_s, pose)
    elif form is Form.MOVING and setpoint.velocity_ned_m_s is None:
        setpoint = setpoint._replace(velocity_ned_m_s=(0.0, 0.0, 0.0))
    elif form is Form.VELOCITY and pose is not None and math.hypot(*setpoint.velocity_ned_m_s or (0.0,)) < STANDING_M_S:
        setpoint = AutopilotSetpoint(
            None, (0.0, 0.0, 0.0), yaw_of(pose.ned_from_frd) if setpoint.yaw_rad is None else setpoint.yaw_rad
        )
    acceleration = setpoint.acceleration_ned_m_s2 if form is Form.ACCELERATED else None
    mask = IGNORE_YAW_RATE
    mask |= IGNORE_ACCELERATION if acceleration is None else 0
    mask |= IGNORE_POSITION if setpoint.position_ned_m is None else 0
    mask |= IGNORE_VELOCITY if setpoint.velocity_ned_m_s is None else 0
    mask |= IGNORE_YAW if setpoint.yaw_rad is None else 0
    x, y, z = setpoint.position_ned_m or (0.0, 0.0, 0.0)
    vx, vy, vz = setpoint.velocity_ned_m_s or (0.0, 0.0, 0.0)
    afx, afy, afz = acceleration or (0.0, 0.0, 0.0)
    return codec.message(
        "SET_POSITION_TARGET_LOCAL_NED",
        time_boot_ms=boot_ms,
        target_system=target.system,
        target_component=target.component,
        coordinate_frame=LOCAL_NED,
        type_mask=mask,
        x=x,
        y=y,
        z=z,
        vx=vx,
        vy=vy,
        vz=vz,
        afx=afx,
        afy=afy,
        afz=afz,
        yaw=setpoint.yaw_rad or 0.0,
    )


def uses_velocity(place: Vector3, feed_forward: Vector3 | None, pose: AutopilotPose) -> AutopilotSetpoint:
    """The velocity that brings a vehicle to a moving place; standing, with its present heading, when it is there."""
    north, east = place[0] - pose.position_ned_m[0], place[1] - pose.position_ned_m[1]
    reported = feed_forward or (0.0, 0.0, 0.0)
    distance_m, is_moving = math.hypot(north, east), math.hypot(reported[0], reported[1]) > STANDING_M_S
    yaw_rad = yaw_of(pose.ned_from_frd)
    is_behind = north * math.cos(yaw_rad) + east * math.sin(yaw_rad) < 0.0
    if not is_moving and distance_m < (BEHIND_M if is_behind else NEAR_M):
        return AutopilotSetpoint(None, (0.0, 0.0, 0.0), yaw_rad)
    share = min(PER_S, MOST_M_S / distance_m) if distance_m > 0.0 else 0.0
    velocity = (reported[0] + share * north, reported[1] + share * east, 0.0)
    if math.hypot(velocity[0], velocity[1]) < STANDING_M_S:
        return AutopilotSetpoint(None, (0.0, 0.0, 0.0), yaw_rad)
    return AutopilotSetpoint(None, velocity, None)


def _reposition(setpoint: AutopilotSetpoint, target: Address, pose: AutopilotPose | None) -> MavlinkMessage | None:
    if pose is None or pose.origin_geo is None or setpoint.position_ned_m is None:
        return None
    (north, east, down), at = setpoint.position_ned_m, pose.position_ned_m
    offset_n, offset_e, _ = setpoint.velocity_ned_m_s or (north - at[0], east - at[1], 0.0)
    speed = math.hypot(offset_n, offset_e)
    if speed > STANDING_M_S:
        north, east = north + AHEAD_M * offset_n / speed, east + AHEAD_M * offset_e / speed
    latitude, longitude, altitude = TangentPlane(GeoPoint(*pose.origin_geo)).geo_from_ned((north, east, down))
    return codec.message(
        "COMMAND_INT",
        target_system=target.system,
        target_component=target.component,
        command=DO_REPOSITION,
        frame=GLOBAL,
        param1=-1.0,
        param4=math.nan,
        x=round(latitude * 1e7),
        y=round(longitude * 1e7),
        z=altitude,
    )


REPOSITION_S: Final = 1.0
FORGOTTEN_S: Final = 10.0
"""Gap after which a setpoint starts another stream, s."""
POSE_S: Final = 0.5
"""Age above which an estimate is not used for positions, s."""


class ControlLead:
    """The stream of setpoints to one autopilot.

    Args:
        telemetry: its telemetry.
    """

    def __init__(self, telemetry: Telemetry) -> None:
        self.gap = ""
        """Report of a late setpoint; cleared by its reader."""
        self._telemetry = telemetry
        self._sent_s = -math.inf

    def message(
        self, setpoint: AutopilotSetpoint, snapshot: ClassProperties, target: Address, now_s: float
    ) -> MavlinkMessage | None:
        """What is to be sent for a setpoint; None where nothing is now."""
        is_guided = self._telemetry.state.mode is FlightMode.GUIDED
        if snapshot.form is Form.REPOSITION and (not is_guided or now_s - self._sent_s < REPOSITION_S):
            return None  # in other modes it would be denied
        if snapshot.vehicle is VehicleClass.PLANE and setpoint.position_ned_m is None:
            return None  # it cannot be braked
        known = self._telemetry.pose
        pose = known.pose if known is not None and now_s - known.t_s < POSE_S else None
        message = setpoint_message(setpoint, snapshot.form, target, self._telemetry.boot_ms(now_s), pose)
        if message is not None:
            self._note_gap(now_s - self._sent_s, snapshot.timeout_s)
            self._sent_s = now_s
        return message

    def _note_gap(self, gap_s: float, limit_s: float) -> None:
        """Reports late setpoints, after which the autopilot has acted on its own."""
        state = self._telemetry.state
        if limit_s < gap_s < FORGOTTEN_S and state.is_armed and state.mode is FlightMode.GUIDED:
            self.gap = f"no setpoint for {beside(gap_s, limit_s)} s: the autopilot acts after {limit_s:g} s without one"
