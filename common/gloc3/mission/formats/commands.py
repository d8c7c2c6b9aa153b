"""MAVLink's mission commands: their names, and which of them move the vehicle."""

from typing import Final, NamedTuple


class MissionCommand(NamedTuple):
    """One command of an uploaded mission."""

    name: str
    """Without `MAV_CMD_`."""
    goes_to: bool = False
    """Whether the vehicle goes to its position."""
    has_position: bool = False
    """Whether parameters 5 and 6 are a latitude and a longitude."""


def _goes(name: str) -> MissionCommand:
    return MissionCommand(name, goes_to=True, has_position=True)


def _place(name: str) -> MissionCommand:
    return MissionCommand(name, has_position=True)


WAYPOINT, LOITER_UNLIMITED, LOITER_TURNS, LOITER_TIME, RETURN, LAND, TAKE_OFF = 16, 17, 18, 19, 20, 21, 22
LOITER_TO_HEIGHT, SPLINE, VTOL_TAKE_OFF, VTOL_LAND, DELAY = 31, 82, 84, 85, 93
JUMP, CHANGE_SPEED, JUMP_TAG, DO_JUMP_TAG = 177, 178, 600, 601
RETURN_POINT, POLYGON_IN, POLYGON_OUT, CIRCLE_IN, CIRCLE_OUT, RALLY = 5000, 5001, 5002, 5003, 5004, 5100

COMMANDS: Final = {
    WAYPOINT: _goes("NAV_WAYPOINT"),
    LOITER_UNLIMITED: _goes("NAV_LOITER_UNLIM"),
    LOITER_TURNS: _goes("NAV_LOITER_TURNS"),
    LOITER_TIME: _goes("NAV_LOITER_TIME"),
    RETURN: MissionCommand("NAV_RETURN_TO_LAUNCH"),
    LAND: _goes("NAV_LAND"),
    TAKE_OFF: _goes("NAV_TAKEOFF"),
    30: MissionCommand("NAV_CONTINUE_AND_CHANGE_ALT"),
    LOITER_TO_HEIGHT: _goes("NAV_LOITER_TO_ALT"),
    36: _goes("NAV_ARC_WAYPOINT"),
    80: _place("NAV_ROI"),
    SPLINE: _goes("NAV_SPLINE_WAYPOINT"),
    83: MissionCommand("NAV_ALTITUDE_WAIT"),
    VTOL_TAKE_OFF: _goes("NAV_VTOL_TAKEOFF"),
    VTOL_LAND: _goes("NAV_VTOL_LAND"),
    92: MissionCommand("NAV_GUIDED_ENABLE"),
    DELAY: MissionCommand("NAV_DELAY"),
    94: _goes("NAV_PAYLOAD_PLACE"),
    112: MissionCommand("CONDITION_DELAY"),
    113: MissionCommand("CONDITION_CHANGE_ALT"),
    114: MissionCommand("CONDITION_DISTANCE"),
    115: MissionCommand("CONDITION_YAW"),
    176: MissionCommand("DO_SET_MODE"),
    JUMP: MissionCommand("DO_JUMP"),
    CHANGE_SPEED: MissionCommand("DO_CHANGE_SPEED"),
    179: _place("DO_SET_HOME"),
    180: MissionCommand("DO_SET_PARAMETER"),
    181: MissionCommand("DO_SET_RELAY"),
    182: MissionCommand("DO_REPEAT_RELAY"),
    183: MissionCommand("DO_SET_SERVO"),
    184: MissionCommand("DO_REPEAT_SERVO"),
    185: MissionCommand("DO_FLIGHTTERMINATION"),
    186: MissionCommand("DO_CHANGE_ALTITUDE"),
    187: MissionCommand("DO_SET_ACTUATOR"),
    188: _place("DO_RETURN_PATH_START"),
    189: _place("DO_LAND_START"),
    191: MissionCommand("DO_GO_AROUND"),
    192: _place("DO_REPOSITION"),
    193: MissionCommand("DO_PAUSE_CONTINUE"),
    194: MissionCommand("DO_SET_REVERSE"),
    195: _place("DO_SET_ROI_LOCATION"),
    196: MissionCommand("DO_SET_ROI_WPNEXT_OFFSET"),
    197: MissionCommand("DO_SET_ROI_NONE"),
    198: MissionCommand("DO_SET_ROI_SYSID"),
    200: MissionCommand("DO_CONTROL_VIDEO"),
    201: _place("DO_SET_ROI"),
    202: MissionCommand("DO_DIGICAM_CONFIGURE"),
    203: MissionCommand("DO_DIGICAM_CONTROL"),
    204: MissionCommand("DO_MOUNT_CONFIGURE"),
    205: MissionCommand("DO_MOUNT_CONTROL"),
    206: MissionCommand("DO_SET_CAM_TRIGG_DIST"),
    207: MissionCommand("DO_FENCE_ENABLE"),
    208: MissionCommand("DO_PARACHUTE"),
    210: MissionCommand("DO_INVERTED_FLIGHT"),
    211: MissionCommand("DO_GRIPPER"),
    212: MissionCommand("DO_AUTOTUNE_ENABLE"),
    213: MissionCommand("NAV_SET_YAW_SPEED"),
    214: MissionCommand("DO_SET_CAM_TRIGG_INTERVAL"),
    215: MissionCommand("DO_SET_RESUME_REPEAT_DIST"),
    216: MissionCommand("DO_SPRAYER"),
    217: MissionCommand("DO_SEND_SCRIPT_MESSAGE"),
    218: MissionCommand("DO_AUX_FUNCTION"),
    221: MissionCommand("DO_GUIDED_MASTER"),
    222: MissionCommand("DO_GUIDED_LIMITS"),
    223: MissionCommand("DO_ENGINE_CONTROL"),
    224: MissionCommand("DO_SET_MISSION_CURRENT"),
    530: MissionCommand("SET_CAMERA_MODE"),
    531: MissionCommand("SET_CAMERA_ZOOM"),
    532: MissionCommand("SET_CAMERA_FOCUS"),
    534: MissionCommand("SET_CAMERA_SOURCE"),
    JUMP_TAG: MissionCommand("JUMP_TAG"),
    DO_JUMP_TAG: MissionCommand("DO_JUMP_TAG"),
    1000: MissionCommand("DO_GIMBAL_MANAGER_PITCHYAW"),
    1001: MissionCommand("DO_GIMBAL_MANAGER_CONFIGURE"),
    2000: MissionCommand("IMAGE_START_CAPTURE"),
    2001: MissionCommand("IMAGE_STOP_CAPTURE"),
    2003: MissionCommand("DO_TRIGGER_CONTROL"),
    2500: MissionCommand("VIDEO_START_CAPTURE"),
    2501: MissionCommand("VIDEO_STOP_CAPTURE"),
    3000: MissionCommand("DO_VTOL_TRANSITION"),
    4501: _place("CONDITION_GATE"),
    RETURN_POINT: _place("NAV_FENCE_RETURN_POINT"),
    POLYGON_IN: _place("NAV_FENCE_POLYGON_VERTEX_INCLUSION"),
    POLYGON_OUT: _place("NAV_FENCE_POLYGON_VERTEX_EXCLUSION"),
    CIRCLE_IN: _place("NAV_FENCE_CIRCLE_INCLUSION"),
    CIRCLE_OUT: _place("NAV_FENCE_CIRCLE_EXCLUSION"),
    RALLY: _place("NAV_RALLY_POINT"),
    42600: MissionCommand("DO_WINCH"),
    42702: MissionCommand("NAV_SCRIPT_TIME"),
    42703: MissionCommand("NAV_ATTITUDE_TIME"),
}
"""By MAV_CMD; source: MAVLink's common and ardupilotmega definitions."""


def command_name(command: int) -> str:
    """Name of a command for people, as `DO_JUMP` or `command 4711`."""
    found = COMMANDS.get(command)
    return found.name if found is not None else f"command {command}"
