"""Compact summaries for the stations: the mission and its cost, the vehicle, its motion, and its frame."""

import math
from functools import lru_cache
from math import degrees, dist, isfinite
from typing import Final

from gloc3.messages.frames import GeoPoint, LocalFrame, TangentPlane, Vector3, to_euler, yaw_of
from gloc3.messages.motion import MotionSummary, SiteSummary, Whole3
from gloc3.messages.summaries import MissionSummary, VehicleSummary
from gloc3.messages.vehicle import (
    AutopilotState,
    GeoArea,
    GeoFence,
    LandedState,
    MotionLimits,
    Pose,
    VehicleClass,
    mode_in_words,
)
from gloc3.mission.executing.executor import MissionExecutor
from gloc3.mission.executing.items import MissionProgram
from gloc3.mission.formats.from_mission import fence_on_earth
from gloc3.mission.model.model import digest_of
from gloc3.mission.model.states import ENDED, ActionState
from gloc3.platform.platform import Platform
from gloc3_onboard.command_server.vehicle_state import VehicleState

NOT_FLYING: Final = (VehicleClass.ROVER, VehicleClass.BOAT, VehicleClass.SUB)
REASONS_MAX: Final = 6
"""Greatest number of tasks and actions reported with a reason."""
REASON_MAX: Final = 120
"""Greatest reported length of a reason."""
SETPOINT_STALE_S: Final = 0.5
"""A setpoint that is older is no longer flown: the driver has stopped."""
LARGEST: Final = 2**31 - 1
"""Greatest reported whole number, some 21,000 km in cm."""
UNPLACED: Final = LocalFrame(GeoPoint(0.0, 0.0, 0.0))
"""North, west, height: the frame reported where no frame of the platform starts at the origin of NED."""


class RequestCounts:
    """Follows the loaded mission from its start to its end; what began before this process did is not known."""

    def __init__(self, program: MissionProgram | None = None) -> None:
        self.took_s = self.took_m = self.took_battery = -1.0
        """Once the mission has ended: seconds (pauses left out), metres, and the share of the battery; -1: not known."""
        self.program = program
        """The mission that it is of."""
        self._has_begun = False
        self._at: Vector3 | None = None
        self._distance_m = 0.0
        self._battery = -1.0

    def update(self, at: Vector3 | None, battery: float, now_s: float) -> None:
        """Handles the vehicle's position and battery charge.

        Args:
            at: its position in NED, in metres; None if unknown.
            battery: remaining share; negative if unknown.
            now_s: the time.
        """
        program = self.program
        if program is None:
            return
        if program.is_open:
            if not self._has_begun:
                self._has_begun, self._at, self._battery = True, at, battery
            if at is not None and self._at is not None and (step_m := dist(at, self._at)) >= STEP_M:
                self._distance_m, self._at = self._distance_m + step_m, at
            self._at = self._at or at
        elif program.state in ENDED and self.took_s < 0.0:
            self.took_s = round(program.ran_s(now_s), 1)
            if self._has_begun:
                self.took_m = round(self._distance_m, 1)
                is_known = battery >= 0.0 and self._battery >= 0.0
                self.took_battery = round(max(0.0, self._battery - battery), 4) if is_known else -1.0


def mission_summary(executor: MissionExecutor | None, counts: RequestCounts) -> MissionSummary:
    """The loaded mission and how far it is."""
    if executor is None:
        return MissionSummary(name="", digest="", state="")
    states = {target: str(state) for target, state in executor.states().items()}
    progress = {target: round(share, 2) for target, share in executor.progress().items()}
    reasons = _reasons(executor)
    program, planned = executor.mission, executor.board.silence
    silence, until_s = ("", 0.0) if planned is None else (planned.target, round(planned.until_s, 3))
    if program is None:
        return MissionSummary(
            name="",
            digest="",
            state="",
            tasks=states,
            progress=progress,
            policy=executor.policy,
            reasons=reasons,
            silence=silence,
            silent_until_s=until_s,
        )
    return MissionSummary(
        name=program.mission.name,
        digest=digest_of(program.mission.text),
        state=str(program.state),
        reason=program.reason,
        tasks=states,
        progress=progress,
        policy=executor.policy,
        reasons=reasons,
        took_s=counts.took_s,
        took_m=counts.took_m,
        took_battery=counts.took_battery,
        repetitions={
            task.target: (task.repetition, task.repeat.times)
            for task in program.tasks.values()
            if task.repeat is not None and task.repetition
        },
        elsewhere={task.target: task.elsewhere for task in program.tasks.values() if task.elsewhere},
        silence=silence,
        silent_until_s=until_s,
    )


def _reasons(executor: MissionExecutor) -> dict[str, str]:
    """Why tasks and actions failed, or wait for something else than their turn; short, since all of it goes by radio."""
    items = [item for program in executor.board.programs.values() for item in program.items() if item.reason]
    reported = [item for item in items if item.state in (ActionState.FAILED, ActionState.WAITING)]
    return {item.target: item.reason[:REASON_MAX] for item in reported[:REASONS_MAX]}


def geofence_of(platform: Platform, executor: MissionExecutor | None) -> GeoFence:
    """The loaded mission's fence on Earth; without areas for none, and without a digest without a mission."""
    mission = executor.mission.mission if executor is not None and executor.mission is not None else None
    if mission is None:
        return GeoFence(digest="")
    areas = [
        GeoArea(area.is_inclusion, list(area.polygon), area.center, area.radius_m)
        for area in fence_on_earth(mission, platform.frames)
    ]
    return GeoFence(digest=digest_of(mission.text), areas=areas)


def _position(autopilot: AutopilotState) -> str:
    """Whether it is in the air; other vehicles are under way, on the ground or under water."""
    is_running = autopilot.landed is LandedState.IN_AIR and autopilot.vehicle in NOT_FLYING
    return "under_way" if is_running else str(autopilot.landed)


def _would_arm(autopilot: AutopilotState) -> bool:
    """Whether a start makes sense: the autopilot's checks have passed, and its sensors and estimator are healthy."""
    return autopilot.is_armed or (autopilot.is_armable and not autopilot.doubts)


def vehicle_summary(
    platform: Platform, snapshot: VehicleState, now_s: float, *, is_operators: bool = False
) -> VehicleSummary:
    """The vehicle at a glance; whose control it is in, if not the mission's, knows the executor alone."""
    autopilot, pose, driver = snapshot.autopilot, snapshot.pose, snapshot.driver
    position, geo, frame, speed_m_s, heading_deg = (0.0, 0.0, 0.0), None, "", 0.0, 0
    if pose is not None:
        frame, local = local_frame(platform, pose)
        x, y, height = local.from_ned(pose.position_ned_m)
        position = round(x, 2), round(y, 2), round(height, 2)
        if snapshot.origin is not None:
            place = TangentPlane(snapshot.origin).geo_from_ned(pose.position_ned_m)
            geo = (round(place.latitude_deg, 7), round(place.longitude_deg, 7), round(place.altitude_m, 2))
        speed_m_s = round(math.hypot(*pose.velocity_ned_m_s), 2)
        heading_deg = round(math.degrees(yaw_of(pose.ned_from_frd))) % 360
    return VehicleSummary(
        t_s=round(now_s, 3),
        mode=mode_in_words(autopilot.mode_name, autopilot.form) if autopilot is not None else "",
        is_armed=autopilot.is_armed if autopilot is not None else False,
        landed=_position(autopilot) if autopilot is not None and snapshot.is_autopilot_known else "unknown",
        battery_percent=round(100.0 * autopilot.battery_remaining)
        if autopilot is not None and autopilot.battery_remaining >= 0.0
        else -1,
        position_m=position,
        speed_m_s=speed_m_s,
        heading_deg=heading_deg,
        is_pose_valid=snapshot.is_pose_fresh(now_s),
        has_pilot_control=driver.has_pilot_control if driver is not None else False,
        is_autopilot_connected=snapshot.is_connected,
        frame=frame,
        geo=geo,
        pose_sources=list(pose.sources) if pose is not None else [],
        pose_quality_percent=round(100.0 * pose.quality) if pose is not None else -1,
        is_failsafe=driver is not None and driver.has_pilot_control and driver.is_failsafe,
        is_operators=driver is not None and driver.has_pilot_control and is_operators,
        is_armable=snapshot.is_autopilot_known and autopilot is not None and _would_arm(autopilot),
    )


def motion_limits(platform: Platform, snapshot: VehicleState, executor: MissionExecutor | None) -> MotionLimits:
    """What the limiter keeps to: the platform's limits, and the fence of the mission that is flown."""
    limits = platform.limits
    fence = executor.mission.mission.fence if executor is not None and executor.mission is not None else None
    return MotionLimits(
        speed_m_s=limits.speed_m_s,
        climb_m_s=limits.climb_m_s,
        acceleration_m_s2=limits.acceleration_m_s2,
        height_min_m=limits.height_min_m,
        height_max_m=limits.height_max_m,
        fence=fence,
        fence_margin_m=limits.margin_m,
        home_ned_m=snapshot.home_ned_m,
        separation_m=limits.separation_m,
        separation_height_m=limits.separation_up_m,
    )


def local_frame(platform: Platform, pose: Pose) -> tuple[str, LocalFrame]:
    """The platform's frame whose origin is that of NED; without a name if there is none."""
    for name, row in platform.frames.items():
        if row.origin.geo == pose.origin_geo:
            return name, _frame(*row.origin.geo, row.x_axis_bearing_deg)
    return "", UNPLACED


def motion_summary(platform: Platform, snapshot: VehicleState, now_s: float) -> MotionSummary | None:
    """How the vehicle moves; None while there is no pose."""
    pose = snapshot.pose
    if pose is None:
        return None
    _, frame = local_frame(platform, pose)
    roll, pitch, yaw = to_euler(pose.ned_from_frd)
    setpoint = snapshot.setpoint if now_s - snapshot.setpoint_s <= SETPOINT_STALE_S else None
    position, velocity, heading = None, None, None
    if setpoint is not None:
        position = None if setpoint.position_ned_m is None else _hundredths(frame, setpoint.position_ned_m)
        velocity = None if setpoint.velocity_ned_m_s is None else _hundredths(frame, setpoint.velocity_ned_m_s)
        heading = None if setpoint.yaw_rad is None else _cdeg(setpoint.yaw_rad) % 36000
    autopilot = snapshot.autopilot
    return MotionSummary(
        t_s=round(now_s, 3),
        attitude_cdeg=(_cdeg(roll), _cdeg(pitch), _cdeg(yaw) % 36000),
        position_cm=_hundredths(frame, pose.position_ned_m),
        velocity_cm_s=_hundredths(frame, pose.velocity_ned_m_s),
        is_pose_valid=snapshot.is_pose_fresh(now_s),
        setpoint_cm=position,
        setpoint_velocity_cm_s=velocity,
        setpoint_heading_cdeg=heading,
        covariance_cm2=_covariance_cm2(frame, pose.position_std_m),
        height_std_cm=_whole(100.0 * pose.position_std_m[2]),
        battery_cv=_whole(100.0 * autopilot.battery_v) if autopilot is not None else 0,
        battery_ca=_whole(100.0 * autopilot.battery_a) if autopilot is not None else 0,
    )


def site_summary(platform: Platform, snapshot: VehicleState) -> SiteSummary | None:
    """Where the frame lies; None while there is no pose."""
    if snapshot.pose is None:
        return None
    name, frame = local_frame(platform, snapshot.pose)
    home = None
    if snapshot.home_ned_m is not None:
        x, y, height = frame.from_ned(snapshot.home_ned_m)
        home = round(x, 2), round(y, 2), round(height, 2)
    return SiteSummary(
        frame=name, x_axis_bearing_deg=frame.x_axis_bearing_deg, origin_geo=snapshot.pose.origin_geo, home_m=home
    )


@lru_cache(maxsize=16)
def _frame(latitude_deg: float, longitude_deg: float, altitude_m: float, bearing_deg: float) -> LocalFrame:
    return LocalFrame(GeoPoint(latitude_deg, longitude_deg, altitude_m), bearing_deg)


def _hundredths(frame: LocalFrame, vector_ned: Vector3) -> Whole3:
    x, y, height = frame.from_ned(vector_ned)
    return _whole(100.0 * x), _whole(100.0 * y), _whole(100.0 * height)


def _cdeg(angle_rad: float) -> int:
    return _whole(100.0 * degrees(angle_rad))


def _whole(value: float) -> int:
    """The nearest reportable whole number; 0 for not-a-number."""
    return round(min(max(value, -LARGEST), LARGEST)) if isfinite(value) else 0


def _covariance_cm2(frame: LocalFrame, std_ned_m: Vector3) -> Whole3 | None:
    """Standard deviations north and east as the covariance of x and y; None where they are not known."""
    if std_ned_m[0] <= 0.0 and std_ned_m[1] <= 0.0:
        return None
    cosine, sine, _ = frame.from_ned((1.0, 0.0, 0.0))
    north, east = 1e4 * std_ned_m[0] * std_ned_m[0], 1e4 * std_ned_m[1] * std_ned_m[1]
    xx, yy = cosine**2 * north + sine**2 * east, sine**2 * north + cosine**2 * east
    return _whole(xx), _whole(cosine * sine * (north - east)), _whole(yy)


STEP_M = 0.2
"""Step at which the travelled distance is summed, m, so that pose noise adds nothing."""
