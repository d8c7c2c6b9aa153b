"""What the autopilot says of itself in AUTOPILOT_VERSION."""

from typing import Final

from gloc3.mavlink.services.version import Capability, Version, version_number
from gloc3_sitl.autopilot.modes import Style

_COMMON: Final = (
    Capability.MISSION_INT
    | Capability.COMMAND_INT
    | Capability.FTP
    | Capability.SET_ATTITUDE_TARGET
    | Capability.SET_POSITION_TARGET_LOCAL_NED
    | Capability.SET_POSITION_TARGET_GLOBAL_INT
    | Capability.FLIGHT_TERMINATION
    | Capability.MAVLINK2
    | Capability.MISSION_FENCE
    | Capability.MISSION_RALLY
)


def version_of(style: Style) -> Version:
    """The version of the firmware whose manners are followed; the vendor and product ids are nobody's."""
    bytewise = style.name == "px4"
    return Version(
        capabilities=_COMMON | (Capability.PARAM_ENCODE_BYTEWISE if bytewise else Capability.PARAM_ENCODE_C_CAST),
        flight_software=version_number(*style.version),
        middleware_software=version_number(*style.version),
        os_software=version_number(1, 0, 0),
        board=1,
        uid=0x676C_6F63_33,
    )
