"""The topics of GLOC3's own platforms, below the platform's name."""

from collections.abc import Mapping
from typing import Final

from gloc3.exchange.acoustic import AcousticSummary
from gloc3.messages.command_interface import CiReply, CiRequest, LogChunk
from gloc3.messages.envelope import Revocations, SignedMessage
from gloc3.messages.hosts import ClockAnswer, ClockQuestion, HostNames, HostPresence, HostStatus, HostSummary
from gloc3.messages.motion import MotionSummary, SiteSummary
from gloc3.messages.neighbours import Neighbours, SeparationState
from gloc3.messages.perception import (
    BottomVelocity,
    DepthImage,
    EstimatorPose,
    Features,
    FusionState,
    ImuSample,
    LaserScan,
    OccupancyMap,
    Odometry,
    PointCloud,
    PositionFix,
    SatelliteFix,
    WheelDistances,
)
from gloc3.messages.preflight import PreflightReport
from gloc3.messages.readiness import AutopilotSetup, ComputerState, ReadSetup
from gloc3.messages.summaries import (
    CiEvent,
    ComponentTable,
    ComponentTrouble,
    ContactSummary,
    ControlState,
    MissionSummary,
    RegionSummary,
    StationHeard,
    Summary,
    VehicleSummary,
)
from gloc3.messages.teleoperation import TeleoperationState, VelocityDemand
from gloc3.messages.topics import TopicRow, TopicService
from gloc3.messages.vehicle import (
    AutopilotPose,
    AutopilotState,
    DriverState,
    EmergencyDisarm,
    FenceState,
    GeoFence,
    GimbalDemand,
    GimbalState,
    HeightAboveGround,
    Home,
    Image,
    ImageRecorded,
    Manoeuvre,
    MotionGrant,
    MotionLimits,
    ObstacleScan,
    PlannedRoute,
    Pose,
    RouteWanted,
    Setpoint,
    TakeOver,
)
from gloc3.messages.watch import Sample, TopicActivity
from gloc3.mission.model.messages import ActionStatus

TOPICS: Final[Mapping[str, TopicRow]] = {
    # samplers
    "autopilot": TopicRow(AutopilotState, 5.0),
    "autopilot_pose": TopicRow(AutopilotPose, 20.0),
    "autopilot_attitude": TopicRow(AutopilotPose),
    "height": TopicRow(HeightAboveGround, 20.0),
    "autopilot_setup": TopicRow(AutopilotSetup, 0.2),
    "computer": TopicRow(ComputerState, 1.0),
    "obstacles": TopicRow(ObstacleScan, 5.0),
    "camera/*": TopicRow(Image, 15.0, is_logged=False, service=TopicService.BULK),
    "depth/*": TopicRow(DepthImage, 10.0, is_logged=False, service=TopicService.BULK, is_inner=True),
    "imu": TopicRow(ImuSample, 100.0, is_logged=False),
    "laser": TopicRow(LaserScan, 10.0, is_logged=False),
    "dvl": TopicRow(BottomVelocity, 8.0),
    "wheels": TopicRow(WheelDistances, 10.0),
    "estimator_pose": TopicRow(EstimatorPose, 30.0, is_inner=True),
    "satellites": TopicRow(SatelliteFix, 5.0),
    # processors
    "cloud/*": TopicRow(PointCloud, 10.0, is_logged=False, service=TopicService.BULK, is_inner=True),
    "features/*": TopicRow(Features, 15.0, is_logged=False),
    "odometry/*": TopicRow(Odometry, 10.0),
    "position_fix/*": TopicRow(PositionFix, 10.0),
    "fusion/*": TopicRow(FusionState, 2.0),
    "map": TopicRow(OccupancyMap, 1.0, is_inner=True),
    "pose": TopicRow(Pose, 20.0, silent_after=3.0, service=TopicService.CONTROL),
    # controllers: each has a topic of its own, the limiter takes them all
    "setpoint_wanted/*": TopicRow(Setpoint, 20.0, service=TopicService.CONTROL),
    "manoeuvre_wanted/*": TopicRow(Manoeuvre, service=TopicService.COMMAND),
    "setpoint": TopicRow(Setpoint, 20.0, service=TopicService.CONTROL),
    "manoeuvre": TopicRow(Manoeuvre, service=TopicService.COMMAND),
    "separation": TopicRow(SeparationState, is_inner=True),
    "route_wanted": TopicRow(RouteWanted, is_inner=True),
    "route": TopicRow(PlannedRoute, is_inner=True),
    "direct_landing": TopicRow(Manoeuvre, service=TopicService.COMMAND),
    "action_status/*": TopicRow(ActionStatus, service=TopicService.COMMAND),
    "image_recorded": TopicRow(ImageRecorded),
    # drivers
    "driver": TopicRow(DriverState, 5.0),
    "autopilot_fence": TopicRow(FenceState, 1.0),
    "gimbal": TopicRow(GimbalState, 5.0, is_inner=True),
    # the companion's gimbal manager, towards the driver, while a station points the gimbal by hand
    "gimbal_demand": TopicRow(GimbalDemand, service=TopicService.CONTROL, is_inner=True),
    # the command interface server, towards the components
    "motion/grant": TopicRow(MotionGrant, 5.0, service=TopicService.COMMAND),
    "motion_demand": TopicRow(VelocityDemand, service=TopicService.CONTROL),
    "motion/limits": TopicRow(MotionLimits, is_latched=True),
    "motion/home": TopicRow(Home, is_latched=True),
    "motion/geofence": TopicRow(GeoFence, is_latched=True),
    "neighbours": TopicRow(Neighbours, is_inner=True),
    "motion/emergency": TopicRow(EmergencyDisarm, service=TopicService.COMMAND),
    "motion/take_over": TopicRow(TakeOver, service=TopicService.COMMAND),
    "read_setup": TopicRow(ReadSetup),
    "preflight": TopicRow(PreflightReport),
    # the command interface server, towards the stations
    "ci/request": TopicRow(CiRequest, service=TopicService.COMMAND),
    "ci/request/*": TopicRow(SignedMessage, is_logged=False, service=TopicService.COMMAND, most_hz=50.0),
    "ci/ask/*": TopicRow(SignedMessage, is_logged=False, service=TopicService.COMMAND, most_hz=50.0),
    "ci/heard": TopicRow(StationHeard, is_logged=False),
    "ci/reply": TopicRow(CiReply, service=TopicService.COMMAND),
    "ci/summary": TopicRow(Summary, 2.0, downlink_every=1),
    "ci/table": TopicRow(ComponentTable, is_latched=True),
    "ci/trouble": TopicRow(ComponentTrouble),
    "ci/vehicle": TopicRow(VehicleSummary, 2.0, downlink_every=1),
    "ci/motion": TopicRow(MotionSummary, 2.0, downlink_every=1),
    "ci/site": TopicRow(SiteSummary, 0.5, downlink_every=1),
    "ci/mission": TopicRow(MissionSummary, 1.0, downlink_every=1, service=TopicService.REPORT),
    "ci/control": TopicRow(ControlState, 1.0, downlink_every=1, service=TopicService.REPORT),
    "ci/event": TopicRow(CiEvent),
    "ci/teleoperation": TopicRow(TeleoperationState, downlink_every=1, service=TopicService.STREAM),
    "contact": TopicRow(ContactSummary, service=TopicService.COMMAND),
    "acoustic": TopicRow(AcousticSummary),
    "log_chunk": TopicRow(LogChunk, is_logged=False, service=TopicService.BULK),
    # the stations, towards the command interface server, while somebody steers by hand
    "velocity_demand": TopicRow(VelocityDemand, service=TopicService.CONTROL),
    "demand/*": TopicRow(SignedMessage, is_logged=False, service=TopicService.CONTROL, most_hz=50.0),
    # the hosts, towards everyone
    "hosts/*": TopicRow(HostStatus, 1.0, service=TopicService.REPORT),
    "host_presence": TopicRow(HostPresence),
    "ci/hosts": TopicRow(HostSummary, 0.5, is_logged=False, downlink_every=1),
    "ci/host_names": TopicRow(HostNames, is_logged=False),
    "hosts/*/clock": TopicRow(ClockQuestion, is_logged=False, service=TopicService.CONTROL),
    "hosts/*/clock_answer": TopicRow(ClockAnswer, is_logged=False, service=TopicService.CONTROL),
    # the members of a network, towards each other; `members` is in place of the platform
    "*/revocations": TopicRow(Revocations, is_logged=False, is_inner=True, most_hz=5.0),
    # a router, towards the stations; `regions` is in place of the platform
    "*/health": TopicRow(RegionSummary, 1.0, is_logged=False, is_inner=True),
    # the viewer, towards the stations that look
    "watch/sample/**": TopicRow(Sample, is_logged=False, service=TopicService.BULK),
    "watch/large/**": TopicRow(Sample, is_logged=False, service=TopicService.BULK),
    "watch/activity": TopicRow(TopicActivity, is_logged=False),
}

AUTOPILOT_SILENT_S: Final = TOPICS["autopilot"].silent_s
"""Age beyond which an autopilot's state counts as stale, s."""
POSE_LATE_S: Final = TOPICS["pose"].silent_s
"""An older pose is late: no path is flown by it. The vehicle brakes, holds, and waits for the next one."""
POSE_LOST_S: Final = 2.0
"""An older pose is lost: `on_pose_lost` acts. A busy computer is back before; autopilots wait 1 to 3 s themselves."""
