"""Sources that the estimator uses (bits of `Source`), from the parameters of each style."""

from collections.abc import Callable, Mapping
from typing import Final

from gloc3_sitl.autopilot.estimator.sources import AidingSource

RequestParameter = Callable[[str], float]


def px4_sources(request: RequestParameter) -> int:
    """By EKF2_GPS_CTRL, EKF2_EV_CTRL, EKF2_BARO_CTRL, EKF2_MAG_TYPE and EKF2_HGT_REF."""
    sources = 0
    if int(request("EKF2_GPS_CTRL")) & 1:
        sources |= AidingSource.FIX
    vision = int(request("EKF2_EV_CTRL"))
    for bit, source in (
        (1, AidingSource.EXTERNAL_POSITION),
        (2, AidingSource.EXTERNAL_HEIGHT),
        (4, AidingSource.EXTERNAL_VELOCITY),
        (8, AidingSource.EXTERNAL_YAW),
    ):
        if vision & bit:
            sources |= source
    if request("EKF2_BARO_CTRL"):
        sources |= AidingSource.BAROMETER
    if request("EKF2_MAG_TYPE") != _NO_MAGNETOMETER:
        sources |= AidingSource.MAGNETOMETER
    if request("EKF2_HGT_REF") == _RANGE_REFERENCE:
        sources |= AidingSource.RANGE_HEIGHT
    return sources


def ardupilot_sources(request: RequestParameter, number: int) -> int:
    """By the source set with this number, EK3_SRCn_..."""
    sources: int = AidingSource.BAROMETER
    prefix = f"EK3_SRC{number}_"
    position, velocity = request(prefix + "POSXY"), request(prefix + "VELXY")
    height, yaw = request(prefix + "POSZ"), request(prefix + "YAW")
    if position == _GPS or velocity == _GPS:
        sources |= AidingSource.FIX
    if position == _EXTERNAL:
        sources |= AidingSource.EXTERNAL_POSITION
    if velocity == _EXTERNAL:
        sources |= AidingSource.EXTERNAL_VELOCITY
    if height == _EXTERNAL:
        sources |= AidingSource.EXTERNAL_HEIGHT
    elif height == _RANGE:
        sources |= AidingSource.RANGE_HEIGHT
    if yaw == _EXTERNAL:
        sources |= AidingSource.EXTERNAL_YAW
    elif yaw == _COMPASS:
        sources |= AidingSource.MAGNETOMETER
    return sources


WITHOUT_SATELLITES: Final[Mapping[str, Mapping[str, float]]] = {
    "px4": {"EKF2_GPS_CTRL": 0, "EKF2_EV_CTRL": 15, "EKF2_HGT_REF": 3, "EKF2_MAG_TYPE": 5},
    "ardupilot": {
        "VISO_TYPE": 1,
        "EK3_SRC1_POSXY": 6,
        "EK3_SRC1_VELXY": 6,
        "EK3_SRC1_POSZ": 6,
        "EK3_SRC1_YAW": 6,
    },
}
"""What has each style fly by odometry alone: position, velocity, height and heading."""

_NO_MAGNETOMETER: Final = 5
_RANGE_REFERENCE: Final = 2
_COMPASS, _RANGE, _GPS, _EXTERNAL = 1, 2, 3, 6
