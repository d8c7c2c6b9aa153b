"""ArduPilot's style for rovers and boats: the modes and refusals of Rover, and its Guided mode."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from gloc3_sitl.autopilot.behaviours.driving import (
    DriveHome,
    DriveLoiter,
    GuidedDrive,
    ManualDrive,
    MissionDrive,
    Retrace,
    SteeredBySticks,
    Stop,
)
from gloc3_sitl.autopilot.modes import Behaviour, Mode, StyleTables
from gloc3_sitl.autopilot.styles.ardupilot import ARDUPILOT
from gloc3_sitl.autopilot.styles.rover_parameters import derive, with_defaults

_STICKS: Final = 64
_STEADIED: Final = 64 | 16
_ITSELF: Final = 16 | 8

_MANUAL, _ACRO, _STEERING, _HOLD, _LOITER = 0, 1, 3, 4, 5
_AUTO, _RTL, _SMART_RTL, _GUIDED = 10, 11, 12, 15
_LAND_START, _LAND, _TAKE_OFF, _ORBIT, _TURN_NOSE = 189, 21, 22, 34, 115


def rover_style(defaults: Mapping[str, float], *, hold_mode: int) -> StyleTables:
    """Rover 4.7 for one vehicle.

    Args:
        defaults: vehicle-specific parameters.
        hold_mode: mode that keeps the position: HOLD, or LOITER for a vehicle that drifts.
    """
    return replace(
        ARDUPILOT,
        modes=(
            Mode(name="MANUAL", custom_mode=_MANUAL, base_mode=_STICKS, behaviour=Behaviour.DIRECT),
            Mode(name="ACRO", custom_mode=_ACRO, base_mode=_STEADIED, behaviour=Behaviour.STEER),
            Mode(name="STEERING", custom_mode=_STEERING, base_mode=_STEADIED, behaviour=Behaviour.STEER),
            Mode(name="HOLD", custom_mode=_HOLD, base_mode=_STICKS, behaviour=Behaviour.STOP),
            Mode(name="LOITER", custom_mode=_LOITER, base_mode=_ITSELF, behaviour=Behaviour.HOLD),
            Mode(name="AUTO", custom_mode=_AUTO, base_mode=_ITSELF | 4, behaviour=Behaviour.MISSION),
            Mode(name="RTL", custom_mode=_RTL, base_mode=_ITSELF | 4, behaviour=Behaviour.RETURN, can_arm=False),
            Mode(
                name="SMART_RTL",
                custom_mode=_SMART_RTL,
                base_mode=_ITSELF | 4,
                behaviour=Behaviour.RETRACE,
                can_arm=False,
            ),
            Mode(name="GUIDED", custom_mode=_GUIDED, base_mode=_ITSELF, behaviour=Behaviour.STREAMED),
        ),
        boot_mode=_MANUAL,
        joystick_throttle_low=-1000.0,
        hold_mode=hold_mode,
        brake_mode=_HOLD,
        takeoff_mode=_GUIDED,
        land_mode=_HOLD,
        return_mode=_RTL,
        mission_mode=_AUTO,
        streamed_mode=_GUIDED,
        position_mode=_LOITER,
        altitude_mode=_MANUAL,
        parameters=with_defaults(defaults),
        derive=derive,
        activities={
            Behaviour.DIRECT: ManualDrive,
            Behaviour.STEER: SteeredBySticks,
            Behaviour.STOP: Stop,
            Behaviour.HOLD: DriveLoiter,
            Behaviour.MISSION: MissionDrive,
            Behaviour.RETURN: DriveHome,
            Behaviour.RETRACE: Retrace,
            Behaviour.STREAMED: GuidedDrive,
        },
        unsupported=frozenset({_LAND, _TAKE_OFF, _ORBIT, _TURN_NOSE}),
        disarms_in_motion=True,
    )


ROVER: Final = rover_style(
    {
        "CRUISE_SPEED": 1.5,
        "CRUISE_THROTTLE": 76,
        "WP_SPEED": 1.5,
        "WP_RADIUS": 0.5,
        "ATC_SPEED_P": 0.3,
        "ATC_STR_RAT_FF": 0.14,
        "ATC_STR_RAT_P": 0.05,
        "ATC_STR_RAT_I": 0.10,
        "PSC_POS_P": 0.8,
        "WENC_TYPE": 1,
        "VISO_TYPE": 1,
        "EK3_SRC2_POSXY": 6,
        "EK3_SRC2_VELXY": 6,
        "EK3_SRC2_YAW": 1,
        "BATT_CAPACITY": 10400,
        "BATT_LOW_MAH": 1040.0,
        "BATT_CRT_MAH": 520.0,
    },
    hold_mode=_HOLD,
)
"""The Jackal."""

BOAT: Final = rover_style(
    {
        "FRAME_CLASS": 2,
        "CRUISE_SPEED": 1.5,
        "CRUISE_THROTTLE": 49,
        "WP_SPEED": 1.5,
        "WP_RADIUS": 2.0,
        "WP_PIVOT_ANGLE": 0,
        "ATC_ACCEL_MAX": 0.5,
        "ATC_SPEED_P": 0.4,
        "ATC_SPEED_I": 0.1,
        "ATC_STR_ANG_P": 1.0,
        "ATC_STR_RAT_P": 1.0,
        "ATC_STR_RAT_I": 0.3,
        "ATC_STR_RAT_FF": 1.5,
        "ATC_STR_RAT_MAX": 25.0,
        "ATC_STR_ACC_MAX": 20.0,
        "MOT_THST_EXPO": 1.0,
        "MOT_THST_ASYM": 1.8,
        "PSC_POS_P": 0.3,
        "BATT_CAPACITY": 141000,
        "BATT_LOW_MAH": 14100.0,
        "BATT_CRT_MAH": 7050.0,
    },
    hold_mode=_LOITER,
)
"""The Otter."""
