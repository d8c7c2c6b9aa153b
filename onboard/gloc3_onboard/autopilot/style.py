"""Differences between PX4 and ArduPilot: mode numbers, and how arming, take-off and setpoints are requested."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final, NamedTuple, Protocol

from gloc3.mavlink.codec import Address, MavlinkMessage, message
from gloc3.mavlink.services.interval import SET_MESSAGE_INTERVAL
from gloc3.messages.vehicle import FlightMode, Style, VehicleClass, VtolForm
from gloc3_onboard.sensors.devices import AutopilotBehaviour, CommandAnswer

Modes = Mapping[int, tuple[FlightMode, str]]
"""What a heartbeat's `custom_mode` means to us, and the autopilot's word for it."""


class Form(StrEnum):
    """Forms of setpoints."""

    POSITION = "position"
    """SET_POSITION_TARGET_LOCAL_NED with position, feed-forward velocity, and yaw, as far as given."""
    ACCELERATED = "accelerated"
    """The same, with the acceleration of what moves beside its velocity: a multirotor leans before it has to."""
    MOVING = "moving"
    """The same, always with a velocity: each position alone restarts the path, so that a stream of them does not
    progress."""
    VELOCITY = "velocity"
    """The same with a velocity only, which leads to the position: for what steers by a heading and a speed."""
    REPOSITION = "reposition"
    """DO_REPOSITION to a place ahead, once a second: for what cannot stop."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ClassProperties:
    """Properties of one autopilot family and vehicle class."""

    vehicle: VehicleClass
    modes: Modes
    commanded: Mapping[FlightMode, int]
    """The requested `custom_mode`."""
    behaviour: AutopilotBehaviour
    form: Form = Form.POSITION
    reports_landed: bool = True
    """Whether EXTENDED_SYS_STATE reports landed or in air; otherwise an armed vehicle counts as under way."""
    hold_on_rotors: int | None = None
    """The `custom_mode` that is asked for to hold on rotors, where it is another than on wings."""
    hold_unplaced: int | None = None
    """The `custom_mode` that stops the vehicle where its hold is refused, as without a position."""
    timeout_s: float
    """Time after the last setpoint at which the autopilot acts on its own, s."""
    why_no_take_off: str = field(default="")
    """Reason for refusing a take-off that the vehicle cannot make."""


COPTERS: Final = (2, 3, 4, 13, 14, 15, 29, 35)
PLANES: Final = (1, 16)
VTOLS: Final = tuple(range(19, 26))
CLASSES: Final[Mapping[int, VehicleClass]] = {
    **dict.fromkeys(COPTERS, VehicleClass.COPTER),
    **dict.fromkeys(PLANES, VehicleClass.PLANE),
    **dict.fromkeys(VTOLS, VehicleClass.VTOL),
    10: VehicleClass.ROVER,
    11: VehicleClass.BOAT,
    12: VehicleClass.SUB,
}
"""By MAV_TYPE."""


class MavCommand(NamedTuple):
    """A MAVLink command with its parameters."""

    number: int
    parameters: tuple[float, float, float, float, float, float, float]
    is_repeatable: bool = True
    """Whether it may be sent again if its answer stays away."""
    instead: "MavCommand | None" = None
    """Sent where the autopilot refuses this one."""


class MessageStream(NamedTuple):
    """A message that the autopilot is requested to stream."""

    message_id: int
    rate_hz: float

    def request(self, target: Address, more_us: int = 0) -> MavlinkMessage:
        """The command that requests it.

        Args:
            target: the autopilot.
            more_us: extension of the interval, which distinguishes the command from the previous one, so that it is
                executed.
        """
        return message(
            "COMMAND_LONG",
            target_system=target.system,
            target_component=target.component,
            command=SET_MESSAGE_INTERVAL,
            param1=float(self.message_id),
            param2=round(1e6 / self.rate_hz) + more_us,
        )


class AutopilotStyle(Protocol):
    """One family of autopilots."""

    @property
    def style(self) -> Style:
        """Which family it is."""

    @property
    def class_properties(self) -> ClassProperties:
        """What is known of its vehicle."""

    @property
    def fence_on_command(self) -> MavCommand | None:
        """Command that enables the fence; None where only a parameter does."""

    @property
    def streams(self) -> Sequence[MessageStream]:
        """The messages that we need."""

    @property
    def odometry_frame(self) -> int:
        """MAV_FRAME in which it believes the heading of an ODOMETRY message."""

    def flight_mode(self, custom_mode: int) -> FlightMode:
        """What a heartbeat's `custom_mode` means to us."""

    def mode_name(self, custom_mode: int) -> str:
        """A mode in the autopilot's own words."""

    def mode_command(self, mode: FlightMode, form: VtolForm | None) -> MavCommand | CommandAnswer:
        """The command that asks for a mode, or why there is none; a VTOL's hold may depend on what carries it."""

    def take_off_command(self, height_m: float, ground_altitude_m: float) -> MavCommand | CommandAnswer:
        """Take-off command, or the reason why there is none.

        Args:
            height_m: height above the vehicle's position on the ground.
            ground_altitude_m: altitude of that position above mean sea level.
        """


NAN = math.nan
LOCAL_NED, LOCAL_FRD = 1, 20
"""MAV_FRAME."""

HEARTBEAT, SYS_STATUS, ATTITUDE_QUATERNION, LOCAL_POSITION_NED = 0, 1, 31, 32
GPS_GLOBAL_ORIGIN, DISTANCE_SENSOR, EXTENDED_SYS_STATE, GLOBAL_POSITION_INT = 49, 132, 245, 33
HOME_POSITION, EKF_STATUS_REPORT, ESTIMATOR_STATUS = 242, 193, 230
SET_MODE, NAV_LAND, NAV_TAKEOFF, NAV_RETURN, ARM_DISARM = 176, 21, 22, 20, 400
DO_SET_HOME, SET_EKF_SOURCE_SET, DO_FENCE_ENABLE, MISSION_START = 179, 42007, 207, 300

COMMON_STREAMS = (
    MessageStream(ATTITUDE_QUATERNION, 20.0),
    MessageStream(LOCAL_POSITION_NED, 20.0),
    MessageStream(SYS_STATUS, 2.0),
    MessageStream(EXTENDED_SYS_STATE, 5.0),
    MessageStream(DISTANCE_SENSOR, 20.0),
    MessageStream(GLOBAL_POSITION_INT, 2.0),
    MessageStream(HOME_POSITION, 0.5),
)
"""Without HEARTBEAT, whose rate PX4 does not allow to change."""

PROGRESS = MessageStream(42, 2.0)
"""MISSION_CURRENT, requested with the first plan."""


def mode_by_number(numbers: Mapping[int, tuple[FlightMode, str]], number: int) -> tuple[FlightMode, str]:
    """A mode from a table, or *other*."""
    return numbers.get(number, (FlightMode.OTHER, f"mode {number}"))
