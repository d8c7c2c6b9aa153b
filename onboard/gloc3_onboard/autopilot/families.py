"""Chooses the adapter for an autopilot by its heartbeat."""

from typing import Final

from gloc3.mavlink.message import MavlinkMessage
from gloc3_onboard.autopilot import ardupilot, px4
from gloc3_onboard.autopilot.ardupilot import ArduPilot
from gloc3_onboard.autopilot.px4 import Px4
from gloc3_onboard.autopilot.style import CLASSES, AutopilotStyle

ARDUPILOT, PX4 = 3, 12
"""MAV_AUTOPILOT."""
NOT_SUPPORTED: Final = "an unsupported autopilot"


def style_of(heartbeat: MavlinkMessage) -> AutopilotStyle | None:
    """The adapter of an autopilot; None for an unsupported one."""
    vehicle = CLASSES.get(heartbeat.type)
    if vehicle is None:
        return None
    if heartbeat.autopilot == ARDUPILOT and vehicle in ardupilot.CLASSES:
        return ArduPilot(vehicle)
    if heartbeat.autopilot == PX4 and vehicle in px4.CLASSES:
        return Px4(vehicle)
    return None
