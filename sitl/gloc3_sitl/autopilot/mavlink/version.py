"""AUTOPILOT_VERSION: version, capabilities and ids of the autopilot."""

from typing import Final

from gloc3.mavlink.services.version import ProtocolCapability, Version, version_number
from gloc3_sitl.autopilot.modes import StyleTables

_COMMON: Final = (
    ProtocolCapability.MISSION_INT
    | ProtocolCapability.COMMAND_INT
    | ProtocolCapability.FTP
    | ProtocolCapability.SET_ATTITUDE_TARGET
    | ProtocolCapability.SET_POSITION_TARGET_LOCAL_NED
    | ProtocolCapability.SET_POSITION_TARGET_GLOBAL_INT
    | ProtocolCapability.FLIGHT_TERMINATION
    | ProtocolCapability.MAVLINK2
    | ProtocolCapability.MISSION_FENCE
    | ProtocolCapability.MISSION_RALLY
)


def version_of(style: StyleTables) -> Version:
    """The version of the firmware whose manners are followed; the vendor and product ids are nobody's."""
    bytewise = style.name == "px4"
    return Version(
        capabilities=_COMMON
        | (ProtocolCapability.PARAM_ENCODE_BYTEWISE if bytewise else ProtocolCapability.PARAM_ENCODE_C_CAST),
        flight_software=version_number(*style.version),
        middleware_software=version_number(*style.version),
        os_software=version_number(1, 0, 0),
        board=1,
        uid=0x676C_6F63_33,
    )
