"""Uploaded mission, fence and rally points, and their checks."""

from dataclasses import dataclass, field
from enum import IntEnum
from math import isfinite, nan
from typing import Final

from gloc3.mavlink.services.plan import FRAME_MISSION, PlanResult
from gloc3.messages.frames import GeoPoint


class MissionCommand(IntEnum):
    """The MAV_CMDs allowed in an uploaded list."""

    WAYPOINT = 16
    LOITER_UNLIMITED = 17
    LOITER_TURNS = 18
    LOITER_TIME = 19
    RETURN = 20
    LAND = 21
    TAKE_OFF = 22
    CHANGE_HEIGHT = 30
    LOITER_TO_HEIGHT = 31
    SPLINE_WAYPOINT = 82
    VTOL_TAKE_OFF = 84
    VTOL_LAND = 85
    GUIDED_ENABLE = 92
    DELAY = 93
    PAYLOAD_PLACE = 94
    CONDITION_DELAY = 112
    CONDITION_DISTANCE = 114
    CONDITION_YAW = 115
    SET_MODE = 176
    JUMP = 177
    CHANGE_SPEED = 178
    SET_HOME = 179
    SET_RELAY = 181
    REPEAT_RELAY = 182
    SET_SERVO = 183
    REPEAT_SERVO = 184
    SET_ACTUATOR = 187
    LAND_START = 189
    SET_ROI_LOCATION = 195
    SET_ROI_NONE = 197
    CONTROL_VIDEO = 200
    DIGICAM_CONFIGURE = 202
    DIGICAM_CONTROL = 203
    MOUNT_CONFIGURE = 204
    MOUNT_CONTROL = 205
    CAM_TRIGG_DIST = 206
    FENCE_ENABLE = 207
    PARACHUTE = 208
    INVERTED_FLIGHT = 210
    GRIPPER = 211
    AUTOTUNE_ENABLE = 212
    CAM_TRIGG_INTERVAL = 214
    RESUME_REPEAT_DIST = 215
    SPRAYER = 216
    SEND_SCRIPT_MESSAGE = 217
    AUX_FUNCTION = 218
    GUIDED_LIMITS = 222
    ENGINE_CONTROL = 223
    SET_CAMERA_MODE = 530
    SET_CAMERA_ZOOM = 531
    SET_CAMERA_FOCUS = 532
    JUMP_TAG = 600
    DO_JUMP_TAG = 601
    IMAGE_START_CAPTURE = 2000
    IMAGE_STOP_CAPTURE = 2001
    VTOL_TRANSITION = 3000
    VIDEO_START_CAPTURE = 2500
    VIDEO_STOP_CAPTURE = 2501
    GIMBAL_MANAGER_PITCHYAW = 1000
    SET_ROI = 201
    TRIGGER_CONTROL = 2003
    FENCE_RETURN_POINT = 5000
    FENCE_POLYGON_INCLUSION = 5001
    FENCE_POLYGON_EXCLUSION = 5002
    FENCE_CIRCLE_INCLUSION = 5003
    FENCE_CIRCLE_EXCLUSION = 5004
    RALLY_POINT = 5100
    WINCH = 42600


POSITIONED: Final = frozenset(
    {
        MissionCommand.WAYPOINT,
        MissionCommand.SPLINE_WAYPOINT,
        MissionCommand.LOITER_UNLIMITED,
        MissionCommand.LOITER_TURNS,
        MissionCommand.LOITER_TIME,
        MissionCommand.LOITER_TO_HEIGHT,
        MissionCommand.PAYLOAD_PLACE,
        MissionCommand.LAND,
        MissionCommand.TAKE_OFF,
    }
)
"""Items at which the vehicle goes somewhere."""

TAKE_OFFS: Final = frozenset({MissionCommand.TAKE_OFF, MissionCommand.VTOL_TAKE_OFF})
LANDINGS: Final = frozenset({MissionCommand.LAND, MissionCommand.VTOL_LAND})

INSTANT: Final = frozenset(
    {
        MissionCommand.SET_SERVO,
        MissionCommand.SET_HOME,
        MissionCommand.LAND_START,
        MissionCommand.SET_ROI,
        MissionCommand.SET_ROI_LOCATION,
        MissionCommand.SET_ROI_NONE,
        MissionCommand.DIGICAM_CONFIGURE,
        MissionCommand.DIGICAM_CONTROL,
        MissionCommand.MOUNT_CONTROL,
        MissionCommand.CAM_TRIGG_DIST,
        MissionCommand.FENCE_ENABLE,
        MissionCommand.SET_CAMERA_MODE,
        MissionCommand.SET_CAMERA_ZOOM,
        MissionCommand.IMAGE_START_CAPTURE,
        MissionCommand.IMAGE_STOP_CAPTURE,
        MissionCommand.VIDEO_START_CAPTURE,
        MissionCommand.VIDEO_STOP_CAPTURE,
        MissionCommand.GIMBAL_MANAGER_PITCHYAW,
        MissionCommand.TRIGGER_CONTROL,
        MissionCommand.CONDITION_DISTANCE,
        MissionCommand.SET_MODE,
        MissionCommand.CHANGE_HEIGHT,
        MissionCommand.GUIDED_ENABLE,
        MissionCommand.SET_RELAY,
        MissionCommand.REPEAT_RELAY,
        MissionCommand.REPEAT_SERVO,
        MissionCommand.SET_ACTUATOR,
        MissionCommand.CONTROL_VIDEO,
        MissionCommand.MOUNT_CONFIGURE,
        MissionCommand.PARACHUTE,
        MissionCommand.INVERTED_FLIGHT,
        MissionCommand.GRIPPER,
        MissionCommand.AUTOTUNE_ENABLE,
        MissionCommand.CAM_TRIGG_INTERVAL,
        MissionCommand.RESUME_REPEAT_DIST,
        MissionCommand.SPRAYER,
        MissionCommand.SEND_SCRIPT_MESSAGE,
        MissionCommand.AUX_FUNCTION,
        MissionCommand.GUIDED_LIMITS,
        MissionCommand.ENGINE_CONTROL,
        MissionCommand.SET_CAMERA_FOCUS,
        MissionCommand.JUMP_TAG,
        MissionCommand.WINCH,
    }
)
"""Items that are taken and done at once; there is no camera, gimbal or servo here that they could move."""

OTHER_MISSION: Final = frozenset(
    {
        MissionCommand.RETURN,
        MissionCommand.DELAY,
        MissionCommand.CONDITION_DELAY,
        MissionCommand.CONDITION_YAW,
        MissionCommand.JUMP,
        MissionCommand.DO_JUMP_TAG,
        MissionCommand.CHANGE_SPEED,
    }
)
ARDUPILOT_ONLY: Final = frozenset(
    {
        MissionCommand.SPLINE_WAYPOINT,
        MissionCommand.CONDITION_YAW,
        MissionCommand.SET_MODE,
        MissionCommand.SET_SERVO,
        MissionCommand.DIGICAM_CONFIGURE,
        MissionCommand.FENCE_ENABLE,
        MissionCommand.LOITER_TURNS,
        MissionCommand.CHANGE_HEIGHT,
        MissionCommand.GUIDED_ENABLE,
        MissionCommand.PAYLOAD_PLACE,
        MissionCommand.SET_RELAY,
        MissionCommand.REPEAT_RELAY,
        MissionCommand.REPEAT_SERVO,
        MissionCommand.PARACHUTE,
        MissionCommand.INVERTED_FLIGHT,
        MissionCommand.AUTOTUNE_ENABLE,
        MissionCommand.RESUME_REPEAT_DIST,
        MissionCommand.SPRAYER,
        MissionCommand.SEND_SCRIPT_MESSAGE,
        MissionCommand.AUX_FUNCTION,
        MissionCommand.GUIDED_LIMITS,
        MissionCommand.ENGINE_CONTROL,
        MissionCommand.JUMP_TAG,
        MissionCommand.DO_JUMP_TAG,
    }
)
"""Items that PX4's mission knows nothing of (its module `mavlink`, mavlink_mission.cpp)."""

PX4_WITH_PLACE: Final = POSITIONED | TAKE_OFFS | LANDINGS | {MissionCommand.SET_ROI, MissionCommand.SET_ROI_LOCATION}
"""Items that PX4 takes in a frame of places; all others it takes in MAV_FRAME_MISSION alone."""

VTOL_COMMANDS: Final = frozenset(
    {MissionCommand.VTOL_TAKE_OFF, MissionCommand.VTOL_LAND, MissionCommand.VTOL_TRANSITION}
)
"""Items of vehicles with rotors and wings."""
MISSION_COMMANDS: Final = POSITIONED | INSTANT | OTHER_MISSION
FENCE_COMMANDS: Final = frozenset(command for command in MissionCommand if 5000 <= command <= 5004)

_RELATIVE: Final = frozenset({3, 6, 10, 11})
_ABSOLUTE: Final = frozenset({0, 5})
_ABOVE_TERRAIN: Final = frozenset({10, 11})


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredItem:
    """One uploaded item, in plain units."""

    command: int
    frame: int
    parameters: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    latitude_deg: float = 0.0
    longitude_deg: float = 0.0
    height_m: float = 0.0
    """Above the frame's zero."""

    @property
    def has_place(self) -> bool:
        """Whether it has a position; zero and zero mean the current one."""
        return isfinite(self.latitude_deg) and (self.latitude_deg != 0.0 or self.longitude_deg != 0.0)

    @property
    def is_relative(self) -> bool:
        """Whether its height counts from home."""
        return self.frame in _RELATIVE


def check_fence_item(item: StoredItem) -> tuple[PlanResult, str]:
    """Returns why a fence item is invalid; empty if it is valid."""
    if item.command not in FENCE_COMMANDS:
        return PlanResult.UNSUPPORTED, f"command {item.command} is not a fence item"
    if item.frame not in _RELATIVE | _ABSOLUTE:
        return PlanResult.UNSUPPORTED_FRAME, f"frame {item.frame} is not supported"
    is_round = item.command in (MissionCommand.FENCE_CIRCLE_INCLUSION, MissionCommand.FENCE_CIRCLE_EXCLUSION)
    if is_round and not 0.0 < item.parameters[0] < 1e6:
        return PlanResult.INVALID_PARAM1, "a circle needs a radius"
    return _check_place(item)


def check_rally_item(item: StoredItem) -> tuple[PlanResult, str]:
    """Returns why a rally point is invalid; empty if it is valid."""
    if item.command != MissionCommand.RALLY_POINT:
        return PlanResult.UNSUPPORTED, f"command {item.command} is not a rally point"
    return _check_place(item)


def _check_place(item: StoredItem) -> tuple[PlanResult, str]:
    if not abs(item.latitude_deg) <= 90.0:
        return PlanResult.INVALID_PARAM5_X, "latitude out of range"
    if not abs(item.longitude_deg) <= 180.0:
        return PlanResult.INVALID_PARAM6_Y, "longitude out of range"
    return PlanResult.ACCEPTED, ""


def check_mission_item(
    item: StoredItem, count: int, *, is_vtol: bool = False, is_px4: bool = False
) -> tuple[PlanResult, str]:
    """Judges an item of a mission of `count` items, for a vehicle with rotors and wings or another."""
    if is_px4 and item.command in ARDUPILOT_ONLY:
        return PlanResult.UNSUPPORTED, f"command {item.command} is not supported"
    if item.command not in MISSION_COMMANDS and not (is_vtol and item.command in VTOL_COMMANDS):
        return PlanResult.UNSUPPORTED, f"command {item.command} is not supported"
    if is_px4 and item.command not in PX4_WITH_PLACE and item.frame != FRAME_MISSION:
        return PlanResult.UNSUPPORTED, f"command {item.command} is not supported in frame {item.frame}"
    if item.command in POSITIONED | TAKE_OFFS | LANDINGS:
        if item.frame not in _RELATIVE | _ABSOLUTE or (is_px4 and item.frame in _ABOVE_TERRAIN):
            return PlanResult.UNSUPPORTED_FRAME, f"frame {item.frame} is not supported"
        result, reason = _check_place(item)
        if result is not PlanResult.ACCEPTED:
            return result, reason
        if not abs(item.height_m) < 100_000.0:
            return PlanResult.INVALID_PARAM7_Z, "height is not a number"
    if item.command == MissionCommand.JUMP and not (isfinite(item.parameters[0]) and 0 <= item.parameters[0] < count):
        return PlanResult.INVALID_PARAM1, f"jump to item {item.parameters[0]:g}, which does not exist"
    if item.command == MissionCommand.CHANGE_SPEED and not item.parameters[1] > 0.0 and item.parameters[1] != -1.0:
        return PlanResult.INVALID_PARAM2, "speed must be positive"
    return PlanResult.ACCEPTED, ""


@dataclass(slots=True)
class FenceCircle:
    """A round part of a fence."""

    centre: GeoPoint
    radius_m: float
    is_inclusion: bool


@dataclass(slots=True)
class Polygon:
    """A part of a fence with corners."""

    corners: list[GeoPoint]
    is_inclusion: bool


@dataclass(slots=True)
class StoredPlans:
    """Everything that was uploaded."""

    mission: tuple[StoredItem, ...] = ()
    fence: tuple[StoredItem, ...] = ()
    rally: tuple[StoredItem, ...] = ()
    polygons: list[Polygon] = field(default_factory=list)
    circles: list[FenceCircle] = field(default_factory=list)
    mission_count: int = 0
    """How often a mission was uploaded."""

    def set_mission(self, items: tuple[StoredItem, ...]) -> None:
        """Replaces the mission."""
        self.mission = items
        self.mission_count += 1

    def lacks(self, required: int, *, is_landed: bool) -> str:
        """Returns which of take-off and landing the mission lacks, where MIS_TKO_LAND_REQ requires them; empty if neither."""
        has = {item.command for item in self.mission}
        missing = [word for word, commands in (("take-off", TAKE_OFFS), ("landing", LANDINGS)) if not has & commands]
        match required:
            case 1 | 2:
                wanted = ["take-off" if required == 1 else "landing"]
            case 5 if not is_landed:
                wanted = ["landing"]
            case 3:
                wanted = missing
            case 4 | 5:
                wanted = missing if len(missing) == 1 else []
            case _:
                wanted = []
        return " and ".join(word for word in missing if word in wanted)

    def set_fence(self, items: tuple[StoredItem, ...]) -> None:
        """Replaces the fence.

        Raises:
            ValueError: the corners of a polygon are not complete.
        """
        polygons: list[Polygon] = []
        circles: list[FenceCircle] = []
        wanted = 0
        for item in items:
            place = GeoPoint(item.latitude_deg, item.longitude_deg, nan)
            is_inclusion = item.command in (
                MissionCommand.FENCE_POLYGON_INCLUSION,
                MissionCommand.FENCE_CIRCLE_INCLUSION,
            )
            if item.command in (MissionCommand.FENCE_POLYGON_INCLUSION, MissionCommand.FENCE_POLYGON_EXCLUSION):
                if wanted == 0:
                    wanted = int(item.parameters[0])
                    if wanted < 3:
                        raise ValueError("a polygon needs three corners")
                    polygons.append(Polygon([], is_inclusion))
                if polygons[-1].is_inclusion is not is_inclusion:
                    raise ValueError("a polygon ends before its last corner")
                polygons[-1].corners.append(place)
                wanted -= 1
            elif wanted:
                raise ValueError("a polygon ends before its last corner")
            elif item.command in (MissionCommand.FENCE_CIRCLE_INCLUSION, MissionCommand.FENCE_CIRCLE_EXCLUSION):
                circles.append(FenceCircle(place, item.parameters[0], is_inclusion))
        if wanted:
            raise ValueError("a polygon ends before its last corner")
        self.fence, self.polygons, self.circles = items, polygons, circles

    def set_rally(self, items: tuple[StoredItem, ...]) -> None:
        """Replaces the rally points."""
        self.rally = items
