"""Describes an autopilot's health bits and its estimator's flags in words.

MAVLink: MAV_SYS_STATUS_SENSOR, ESTIMATOR_STATUS_FLAGS (PX4), EKF_STATUS_FLAGS (ArduPilot). The first ten bits of the
last two are the same.
"""

from collections.abc import Iterator, Mapping
from typing import Final

from gloc3.mavlink.codec import MavlinkMessage

SENSORS: Final[Mapping[int, str]] = {
    1: "gyroscope",
    2: "accelerometer",
    4: "compass",
    8: "barometer",
    16: "differential pressure",
    32: "GPS",
    64: "optical flow",
    128: "vision position",
    256: "range finder",
    512: "external ground truth",
    1 << 21: "attitude estimate",
    1 << 25: "battery monitor",
}
"""MAV_SYS_STATUS_SENSOR bits whose failure prevents a start."""
FENCE_BIT: Final = 1 << 20
"""MAV_SYS_STATUS_GEOFENCE; ArduPilot sets it while the fence is enabled and enforced rather than only reported."""
ATTITUDE, HEIGHT, CONSTANT = 0x01, 0x20 | 0x40, 0x80
POSITION: Final = 0x08 | 0x10
PREDICTED: Final = 0x100 | 0x200
"""Bits that ArduPilot predicts before arming, for when it moves."""
PX4_GLITCH, PX4_ACCELERATION = 0x400, 0x800
ARDUPILOT_NOT_BEGUN, ARDUPILOT_GLITCH = 0x400, 0x8000
UNHEALTHY: Final = "not well: "
"""Start of a sentence about unhealthy sensors."""
MOST: Final = 1.0
"""Estimator test ratio or variance above which a source is rejected."""
_RATIOS: Final = {
    "ESTIMATOR_STATUS": {
        "vel_ratio": "velocity",
        "pos_horiz_ratio": "horizontal position",
        "pos_vert_ratio": "height",
        "mag_ratio": "compass",
    },
    "EKF_STATUS_REPORT": {
        "velocity_variance": "velocity",
        "pos_horiz_variance": "horizontal position",
        "pos_vert_variance": "height",
        "compass_variance": "compass",
    },
}


def unhealthy(present: int, enabled: int, health: int) -> list[str]:
    """The sensors that are present, enabled, and unhealthy."""
    return [name for bit, name in SENSORS.items() if present & enabled & bit and not health & bit]


def estimator_problems(message: MavlinkMessage) -> list[str]:
    """Problems in ESTIMATOR_STATUS or EKF_STATUS_REPORT that prevent a start."""
    return list(_flags(message)) + [
        f"the estimator rejects the {what} (test ratio {ratio:.1f}, limit 1)"
        for field, what in _RATIOS[message.name].items()
        if (ratio := getattr(message, field)) >= MOST
    ]


def _flags(message: MavlinkMessage) -> Iterator[str]:
    flags, is_px4 = message.flags, message.name == "ESTIMATOR_STATUS"
    if not is_px4 and flags & ARDUPILOT_NOT_BEGUN:
        yield "the estimator has not started"
        return
    if not flags & ATTITUDE:
        yield "the estimator has no attitude"
    if not flags & (POSITION | PREDICTED):
        still = ": it assumes that the vehicle stands still" if flags & CONSTANT else ""
        yield f"the estimator has no horizontal position{still}"
    if not flags & HEIGHT:
        yield "the estimator has no height"
    if flags & (PX4_GLITCH if is_px4 else ARDUPILOT_GLITCH):
        yield "GPS glitches"
    if is_px4 and flags & PX4_ACCELERATION:
        yield "the estimator reports an accelerometer error"
