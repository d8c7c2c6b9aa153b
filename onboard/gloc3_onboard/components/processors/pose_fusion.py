"""DP: the platform's pose, fused from its own sensors, without satellites (paper §VI)."""

from collections.abc import Sequence
from math import dist
from typing import TYPE_CHECKING, Annotated, Final

import msgspec

from gloc3.component.component import DataProcessor
from gloc3.component.ports import Inbox, Input, Keep, Output, Result
from gloc3.component.settings import Bounds
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import IDENTITY
from gloc3.messages.perception import FusionState, ImuSample, Odometry, PositionFix
from gloc3.messages.vehicle import AutopilotPose, AutopilotState, HeightAboveGround, LandedState, Pose
from gloc3_onboard.algorithms.fusion.settings import FusionSettings
from gloc3_onboard.sensors.checks.recent import in_time_order

if TYPE_CHECKING:
    from gloc3_onboard.algorithms.fusion.pose_fusion import PoseFusion

STATE_PERIOD_S: Final = 0.5
YOUNG_S: Final = 0.3
"""Age below which another source's pose is followed or used as a start, s."""
_AIRBORNE: Final = (LandedState.IN_AIR, LandedState.TAKING_OFF, LandedState.LANDING)
_IN_FLIGHT_STD: Final = (0.3, 0.05)
"""Standard deviations of position (m) and heading (rad) when starting at another's pose."""


_NOWHERE: Final = Pose(
    position_ned_m=(0.0, 0.0, 0.0),
    velocity_ned_m_s=(0.0, 0.0, 0.0),
    ned_from_frd=IDENTITY,
    is_valid=False,
    quality=0.0,
)


class PoseFusionSettings(FusionSettings, frozen=True):
    """Settings of the pose fusion as a component."""

    origin_geo: tuple[float, float, float] | None = None
    """Origin of the local frame: latitude and longitude in degrees, altitude above mean sea level in metres."""
    takeover_jump_m: Annotated[float, Bounds(0.0, 10.0)] = 0.03
    """Difference from the primary's pose above which a standby counts a jump at its take-over, in metres."""
    await_autopilot_s: Annotated[float, Bounds(0.0, 60.0)] = 2.0
    """Time to wait for the autopilot's report that the vehicle stands before it is assumed, in seconds."""


class PoseFusionProcessor(DataProcessor[PoseFusionSettings]):
    """Fuses inertial samples, odometers, external positions and heights into one pose, and reports its sources.

    A second row of it with `begin: quiet` and `standby_for` is a hot standby: it has the same inputs and the same
    estimate. `primary` is bound to the topic `pose` in both rows: the quiet one follows the other's pose, to continue
    its reset count at a take-over, and to start from it in flight.
    """

    loggable = ("reset_counter", "quality", "reason", "witnesses")

    imu = Input(ImuSample, Keep.ALL)
    odometry = Input(Odometry, Keep.ALL)
    position_fix = Input(PositionFix, Keep.ALL)
    height = Input(HeightAboveGround, Keep.ALL)
    autopilot = Input(AutopilotState)
    autopilot_pose = Input(AutopilotPose, Keep.ALL)
    autopilot_attitude = Input(AutopilotPose, Keep.ALL)
    primary = Input(Pose)
    pose = Output(Pose, frame="ned")
    fusion = Output(FusionState)

    def __init__(self) -> None:
        self.reset_counter = 0
        self.quality = 0.0
        self.reason = ""
        self.witnesses = ""
        """The sources that hold the position, in a word."""
        self._fusion: PoseFusion | None = None
        self._followed: Envelope[Pose] | None = None
        self._shown: tuple[float, Pose] | None = None
        self._is_quiet = False
        self._jumps = 0
        """Offset to the fusion's own reset count that continues the primary's."""
        self._begun_s: float | None = None
        self._reported_s = float("-inf")

    # --- the local command interface ---

    def initialize(self, settings: PoseFusionSettings) -> None:
        """Adopts the settings and loads the filter."""
        self.settings = settings
        self.start()

    def start(self) -> None:
        """Begins without a past."""
        from gloc3_onboard.algorithms.fusion.pose_fusion import PoseFusion

        self._fusion = PoseFusion(self.settings)
        self._is_quiet = False
        self._followed = self._shown = self._begun_s = None
        self._jumps = 0
        self._reported_s = float("-inf")

    def goquiet(self) -> None:
        """Follows the other row's pose from now on."""
        self._is_quiet = True

    def resume(self) -> None:
        """Takes over: continues the primary's reset count, plus one if the poses differ."""
        self._is_quiet = False
        if self._followed is None or self._shown is None or self._fusion is None:
            return
        (t_s, own), primary = self._shown, self._followed.payload
        late_s = t_s - self._followed.t_s
        expected = [p + v * late_s for p, v in zip(primary.position_ned_m, primary.velocity_ned_m_s, strict=True)]
        is_jump = dist(expected, own.position_ned_m) > self.settings.takeover_jump_m
        self._jumps = primary.reset_counter + is_jump - self._fusion.estimate.reset_counter

    # --- the cycle ---

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Takes in everything that has come, and says where the platform is."""
        fusion = self._fusion
        assert fusion is not None  # its host starts it first
        if self._is_quiet or not fusion.is_aligned:
            self._followed = inbox.latest(self.primary)
        if not fusion.is_aligned and not self._prepare(fusion, now_s, inbox):
            return [msgspec.structs.replace(_NOWHERE, reason=self.reason)]
        for sample in inbox.new(self.imu):
            if sample.payload.is_valid:
                fusion.imu(sample.payload.rate_frd_rad_s, sample.payload.specific_force_frd_m_s2, sample.t_s)
        # An autopilot that has had no position yet may still be aligning: where down is, it does not know better.
        is_aligned = inbox.latest(self.autopilot_pose) is not None
        attitudes = inbox.new(self.autopilot_attitude) if is_aligned else ()
        for reported in in_time_order(inbox.new(self.autopilot_pose), attitudes):
            fusion.attitude(reported.payload, reported.t_s)
        for report in inbox.new(self.odometry):
            fusion.odometry(report.payload, report.t_s)
        for fix in inbox.new(self.position_fix):
            fusion.fix(fix.payload, fix.t_s)
        for height in inbox.new(self.height):
            fusion.height(height.payload, height.t_s)
        fusion.tick(now_s)
        return [*self._report(fusion, now_s)]

    def _prepare(self, fusion: "PoseFusion", now_s: float, inbox: Inbox) -> bool:
        """Initializes the fusion once it is known whether the vehicle stands or flies; false until then."""
        if self._begun_s is None:
            self._begun_s = now_s
        state = inbox.latest(self.autopilot)
        if state is None or not state.payload.is_connected:
            self.reason = "the autopilot has not reported whether the vehicle stands"
            return now_s - self._begun_s >= self.settings.await_autopilot_s
        is_flying = state.payload.is_armed and state.payload.landed in _AIRBORNE
        self._begin_at(fusion, inbox, now_s, is_flying=is_flying)
        if is_flying and not fusion.is_prepared_in_flight:
            self.reason = "in flight there is no pose to start from"
            return False
        return True

    def _begin_at(self, fusion: "PoseFusion", inbox: Inbox, now_s: float, *, is_flying: bool) -> None:
        from gloc3_onboard.algorithms.fusion.inertial import InertialState

        reported = inbox.latest(self.autopilot_pose)
        settings = self.settings
        if is_flying:
            primary = self._followed
            if primary is not None and primary.payload.is_valid and now_s - primary.t_s < YOUNG_S:
                given: Pose | AutopilotPose = primary.payload
            elif reported is not None and now_s - reported.t_s < YOUNG_S:
                given = reported.payload
            else:
                return
            state = InertialState(now_s, given.position_ned_m, given.velocity_ned_m_s, given.ned_from_frd)
            std_m, std_rad = _IN_FLIGHT_STD
            fusion.align_by(state, position_std_m=std_m, heading_std_rad=std_rad, is_moving=True)
        elif reported is not None and (settings.start_ned_m is None or settings.start_heading_deg is None):
            fusion.align_by(
                InertialState(
                    now_s,
                    settings.start_ned_m or reported.payload.position_ned_m,
                    (0.0, 0.0, 0.0),
                    reported.payload.ned_from_frd,
                ),
                position_std_m=None if settings.start_ned_m is not None else _IN_FLIGHT_STD[0],
                heading_std_rad=_IN_FLIGHT_STD[1],
            )

    def _report(self, fusion: "PoseFusion", now_s: float) -> Sequence[Result]:
        pose = fusion.pose()
        self.reset_counter = pose.reset_counter + self._jumps
        self.quality, self.reason = pose.quality, pose.reason
        self.witnesses = " ".join(fusion.witnesses)
        pose = msgspec.structs.replace(pose, reset_counter=self.reset_counter, origin_geo=self.settings.origin_geo)
        t_s = fusion.estimate.t_s if fusion.is_aligned else now_s
        self._shown = (t_s, pose)
        results: list[Result] = [self.pose.report(pose, t_s=t_s)]
        if now_s - self._reported_s >= STATE_PERIOD_S - 1e-6:
            self._reported_s = now_s
            results.append(fusion.state())
        return results
