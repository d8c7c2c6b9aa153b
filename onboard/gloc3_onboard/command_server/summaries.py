"""The vehicle and the mission at a glance, for the stations."""

import math
from typing import Final

from gloc3.messages.frames import TangentPlane, yaw_of
from gloc3.messages.summaries import MissionSummary, VehicleSummary
from gloc3.messages.vehicle import AutopilotState, GeoArea, GeoFence, LandedState, MotionLimits, VehicleClass
from gloc3.mission.executing.executor import MissionExecutor
from gloc3.mission.formats.from_mission import fence_areas
from gloc3.mission.model.model import GEO, digest_of
from gloc3.mission.model.states import ActionState
from gloc3.platform.platform import Platform
from gloc3_onboard.command_server.facts import VehicleFacts
from gloc3_onboard.command_server.motion import local_frame
from gloc3_onboard.command_server.tally import Tally

NOT_FLYING: Final = (VehicleClass.ROVER, VehicleClass.BOAT, VehicleClass.SUB)
REASONS_MAX: Final = 6
"""Tasks and actions whose reason is told at most."""
REASON_MAX: Final = 120
"""Characters of a reason that are told."""


def mission_summary(executor: MissionExecutor | None, tally: Tally) -> MissionSummary:
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
        took_s=tally.took_s,
        took_m=tally.took_m,
        took_battery=tally.took_battery,
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
    told = [item for item in items if item.state in (ActionState.FAILED, ActionState.WAITING)]
    return {item.target: item.reason[:REASON_MAX] for item in told[:REASONS_MAX]}


def geofence_of(executor: MissionExecutor | None) -> GeoFence:
    """The loaded mission's fence on Earth; without areas where it has none, or no mission is loaded."""
    mission = executor.mission.mission if executor is not None and executor.mission is not None else None
    if mission is None or mission.frame != GEO or mission.geofence is None:
        return GeoFence(digest="")
    areas = [
        GeoArea(area.is_inclusion, list(area.polygon), area.center, area.radius_m)
        for area in fence_areas(mission.geofence)
    ]
    return GeoFence(digest=digest_of(mission.text), areas=areas)


def _whereabouts(autopilot: AutopilotState) -> str:
    """Whether it is in the air; what does not fly is under way instead, on the ground or under water."""
    is_under_way = autopilot.landed is LandedState.IN_AIR and autopilot.vehicle in NOT_FLYING
    return "under_way" if is_under_way else str(autopilot.landed)


def _would_arm(autopilot: AutopilotState) -> bool:
    """Whether a start makes sense: its own checks have passed, and neither its sensors nor its estimator speak against it."""
    return autopilot.is_armed or (autopilot.is_armable and not autopilot.doubts)


def vehicle_summary(platform: Platform, facts: VehicleFacts, now_s: float) -> VehicleSummary:
    """The vehicle at a glance."""
    autopilot, pose, driver = facts.autopilot, facts.pose, facts.driver
    position, geo, frame, speed_m_s, heading_deg = (0.0, 0.0, 0.0), None, "", 0.0, 0
    if pose is not None:
        frame, local = local_frame(platform, pose)
        x, y, height = local.from_ned(pose.position_ned_m)
        position = round(x, 2), round(y, 2), round(height, 2)
        if facts.origin is not None:
            place = TangentPlane(facts.origin).geo_from_ned(pose.position_ned_m)
            geo = (round(place.latitude_deg, 7), round(place.longitude_deg, 7), round(place.altitude_m, 2))
        speed_m_s = round(math.hypot(*pose.velocity_ned_m_s), 2)
        heading_deg = round(math.degrees(yaw_of(pose.ned_from_frd))) % 360
    return VehicleSummary(
        t_s=round(now_s, 3),
        mode=autopilot.mode_name if autopilot is not None else "",
        is_armed=autopilot.is_armed if autopilot is not None else False,
        landed=_whereabouts(autopilot) if autopilot is not None and facts.is_autopilot_known else "unknown",
        battery_percent=round(100.0 * autopilot.battery_remaining)
        if autopilot is not None and autopilot.battery_remaining >= 0.0
        else -1,
        position_m=position,
        speed_m_s=speed_m_s,
        heading_deg=heading_deg,
        is_pose_valid=facts.is_pose_fresh(now_s),
        has_pilot_control=driver.has_pilot_control if driver is not None else False,
        is_autopilot_connected=facts.is_connected,
        frame=frame,
        geo=geo,
        pose_sources=list(pose.sources) if pose is not None else [],
        pose_quality_percent=round(100.0 * pose.quality) if pose is not None else -1,
        is_armable=facts.is_autopilot_known and autopilot is not None and _would_arm(autopilot),
    )


def motion_limits(platform: Platform, facts: VehicleFacts, executor: MissionExecutor | None) -> MotionLimits:
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
        fence_margin_m=limits.fence_margin_m,
        home_ned_m=facts.home_ned_m,
    )
