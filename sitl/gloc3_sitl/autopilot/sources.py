"""Which sources the estimator uses (bits of `Source`), as the parameters of each style say."""

from collections.abc import Callable, Mapping
from typing import Final

from gloc3_sitl.autopilot.estimator.sources import Source

Ask = Callable[[str], float]


def px4_sources(ask: Ask) -> int:
    """By EKF2_GPS_CTRL, EKF2_EV_CTRL, EKF2_BARO_CTRL, EKF2_MAG_TYPE and EKF2_HGT_REF."""
    sources = 0
    if int(ask("EKF2_GPS_CTRL")) & 1:
        sources |= Source.FIX
    vision = int(ask("EKF2_EV_CTRL"))
    for bit, source in (
        (1, Source.EXTERNAL_POSITION),
        (2, Source.EXTERNAL_HEIGHT),
        (4, Source.EXTERNAL_VELOCITY),
        (8, Source.EXTERNAL_YAW),
    ):
        if vision & bit:
            sources |= source
    if ask("EKF2_BARO_CTRL"):
        sources |= Source.BAROMETER
    if ask("EKF2_MAG_TYPE") != _NO_MAGNETOMETER:
        sources |= Source.MAGNETOMETER
    if ask("EKF2_HGT_REF") == _RANGE_REFERENCE:
        sources |= Source.RANGE_HEIGHT
    return sources


def ardupilot_sources(ask: Ask, number: int) -> int:
    """By the source set with this number, EK3_SRCn_..."""
    sources: int = Source.BAROMETER
    prefix = f"EK3_SRC{number}_"
    position, velocity = ask(prefix + "POSXY"), ask(prefix + "VELXY")
    height, yaw = ask(prefix + "POSZ"), ask(prefix + "YAW")
    if position == _GPS or velocity == _GPS:
        sources |= Source.FIX
    if position == _EXTERNAL:
        sources |= Source.EXTERNAL_POSITION
    if velocity == _EXTERNAL:
        sources |= Source.EXTERNAL_VELOCITY
    if height == _EXTERNAL:
        sources |= Source.EXTERNAL_HEIGHT
    elif height == _RANGE:
        sources |= Source.RANGE_HEIGHT
    if yaw == _EXTERNAL:
        sources |= Source.EXTERNAL_YAW
    elif yaw == _COMPASS:
        sources |= Source.MAGNETOMETER
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
