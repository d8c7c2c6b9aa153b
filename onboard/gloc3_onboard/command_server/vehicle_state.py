"""Vehicle state in the server: home, in flight or not, and active policy conditions."""

from collections.abc import Iterator
from math import hypot, isfinite
from typing import Final

import msgspec

from gloc3.amounts import beside, excess
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import GeoPoint, Vector3
from gloc3.messages.standard_topics import AUTOPILOT_SILENT_S, POSE_LATE_S, POSE_LOST_S
from gloc3.messages.vehicle import (
    AutopilotState,
    DriverState,
    FenceState,
    HeightAboveGround,
    LandedState,
    Pose,
    Setpoint,
)
from gloc3.mission.executing.board import PolicyCondition
from gloc3.mission.model.fence import Fence
from gloc3.platform.platform import Platform
from gloc3_onboard.algorithms.paths.motion_limits import is_finite

POSE_SILENT_S: Final = POSE_LATE_S + 0.05
"""A pose that is older counts as late here: it may wait for the next cycle of the server."""
POSE_REPORTED_S: Final = 0.4
"""A pose that is late by so much is told."""
POSE_LATE_MOST_S: Final = 10.0
"""Poses that keep coming, each less than `POSE_LOST_S` late, are waited for this long in a hold; then they count as lost."""
POSE_INVALID_S: Final = 0.4
"""Time after which a pose marked invalid counts as lost, s; its source has already waited."""
HEIGHT_SILENT_S: Final = 0.5
"""A distance to the ground that is older is not known any more."""
AIRBORNE: Final = (LandedState.IN_AIR, LandedState.TAKING_OFF, LandedState.LANDING)


class KeptHome(msgspec.Struct, frozen=True, array_like=True):
    """The place where the vehicle was armed, as kept on disk."""

    position_ned_m: Vector3
    origin_geo: tuple[float, float, float] | None


class VehicleState:
    """The latest messages of the vehicle, and the state derived from them.

    Unknown states are treated as unsafe: a vehicle that was armed when the autopilot fell silent counts as in the air,
    and nothing is armed or started before the state is known again.
    """

    def __init__(self, platform: Platform, home: KeptHome | None) -> None:
        self.autopilot: AutopilotState | None = None
        """Latest state, however stale; see `is_autopilot_known`."""
        self.is_autopilot_known = False
        """Whether the autopilot's state is recent enough for decisions."""
        self.driver: DriverState | None = None
        self.driver_s = float("-inf")
        """When it has reported last."""
        self.fence: FenceState | None = None
        self.pose: Pose | None = None
        self.setpoint: Setpoint | None = None
        self.setpoint_s = float("-inf")
        """When the setpoint was valid."""
        self.home = home
        self.is_home_new = False
        """Whether home was just set and has to be stored."""
        self._reserve: Final = platform.power.reserve if platform.power is not None else 0.0
        self._pose_s = self._autopilot_s = float("-inf")
        self._posed_s: float | None = None
        """Time of the last usable pose; None before the first check."""
        self._pose_gap_s = 0.0
        """How long after the one before it the last late pose was valid."""
        self._is_late_reported = False
        self._was_armed: bool | None = None
        self._height_m: float | None = None
        self._height_s = float("-inf")

    @property
    def is_connected(self) -> bool:
        """Whether the autopilot answers, as far as is known."""
        return self.known_autopilot is not None and self.known_autopilot.is_connected

    @property
    def known_autopilot(self) -> AutopilotState | None:
        """The autopilot's state; None while it is not known."""
        return self.autopilot if self.is_autopilot_known else None

    @property
    def autopilot_problem(self) -> str:
        """Why nothing may be started; empty where the autopilot answers."""
        if self.is_connected:
            return ""
        is_silent = self.autopilot is not None and not self.is_autopilot_known
        return "no state is received from the autopilot" if is_silent else "the autopilot does not answer"

    @property
    def is_airborne(self) -> bool:
        """Whether the vehicle is, or may be, in the air: climbing or descending included, or armed when last heard."""
        autopilot = self.autopilot
        if autopilot is None or not autopilot.is_armed:
            return False
        return autopilot.landed in AIRBORNE or not self.is_autopilot_known

    @property
    def is_flight_known(self) -> bool:
        """Whether it is known if the vehicle is in the air."""
        autopilot = self.known_autopilot
        return autopilot is not None and (not autopilot.is_armed or autopilot.landed is not LandedState.UNKNOWN)

    @property
    def origin(self) -> GeoPoint | None:
        """The origin of NED."""
        origin = self.pose.origin_geo if self.pose is not None else None
        return GeoPoint(*origin) if origin is not None else None

    @property
    def home_ned_m(self) -> Vector3 | None:
        """Home position: where the vehicle was armed, or stands."""
        return self.home.position_ned_m if self.home is not None else None

    @property
    def home_altitude_m(self) -> float | None:
        """Of home, above mean sea level."""
        origin, home = self.origin, self.home_ned_m
        return None if origin is None or home is None else origin.altitude_m - home[2]

    def is_pose_fresh(self, now_s: float) -> bool:
        """Whether there is a valid and recent pose."""
        return self.pose is not None and self.pose.is_valid and now_s - self._pose_s <= POSE_SILENT_S

    def is_pose_late(self, now_s: float) -> bool:
        """Whether the last valid pose is late, but not lost yet: the next one is awaited."""
        age_s = now_s - self._pose_s
        return self.pose is not None and self.pose.is_valid and POSE_SILENT_S < age_s <= POSE_LOST_S

    def late_pose_report(self, now_s: float) -> str:
        """What is to be told in flight of a pose that is late, or that is back; empty for nothing."""
        age_s = now_s - self._pose_s
        if self._is_late_reported and self.is_pose_fresh(now_s):
            self._is_late_reported = False
            return f"pose is back after {self._pose_gap_s:.1f} s: going on"
        self._is_late_reported &= age_s <= POSE_LOST_S
        if self._is_late_reported or not self.is_airborne or not self.is_pose_late(now_s) or age_s < POSE_REPORTED_S:
            return ""
        self._is_late_reported = True
        holding = "holding, " if self.driver is not None and self.driver.is_streaming else ""
        return f"pose is late by {age_s:.1f} s: {holding}waiting up to {POSE_LOST_S:g} s"

    def update_pose(self, envelope: Envelope[Pose]) -> None:
        """Handles a pose; until the vehicle is armed, home follows it. Non-finite ones are ignored."""
        pose = envelope.payload
        if not isfinite(sum((*pose.position_ned_m, *pose.velocity_ned_m_s, *pose.ned_from_frd, pose.quality))):
            return
        gap_s = envelope.t_s - self._pose_s
        self._pose_gap_s = gap_s if gap_s > POSE_LATE_S else self._pose_gap_s
        self.pose, self._pose_s = pose, envelope.t_s
        is_known = envelope.t_s - self._autopilot_s < AUTOPILOT_SILENT_S
        if self.pose.is_valid and self._was_armed is False and is_known:
            self.home = KeptHome(self.pose.position_ned_m, self.pose.origin_geo)

    def update_setpoint(self, envelope: Envelope[Setpoint]) -> None:
        """Handles a setpoint to the driver; non-finite ones are ignored."""
        if is_finite(envelope.payload):
            self.setpoint, self.setpoint_s = envelope.payload, envelope.t_s

    def update_height(self, envelope: Envelope[HeightAboveGround]) -> None:
        """Takes in how far the ground is below."""
        height = envelope.payload
        self._height_m = height.height_m if height.is_valid and isfinite(height.height_m) else None
        self._height_s = envelope.t_s

    def stalled(self, by_s: float) -> None:
        """The process stood still for so long: that is no lateness of the poses."""
        if self._posed_s is not None:
            self._posed_s += by_s

    def expire(self, now_s: float) -> None:
        """Expires stale state."""
        self.is_autopilot_known = now_s - self._autopilot_s < AUTOPILOT_SILENT_S
        if self._posed_s is None or self.is_pose_fresh(now_s):
            self._posed_s = now_s

    def update_autopilot(self, envelope: Envelope[AutopilotState]) -> None:
        """Takes the autopilot's state in; arming fixes home."""
        state = self.autopilot = envelope.payload
        self._autopilot_s = envelope.t_s
        if not state.is_connected:
            return
        if state.is_armed and self._was_armed is False:
            self.is_home_new = True
        self._was_armed = state.is_armed

    def readings(self, now_s: float) -> dict[str, float]:
        """What conditions of missions ask for, as far as it is known now; see `gloc3.mission.model.conditions.QUANTITIES`."""
        found: dict[str, float] = {}
        autopilot, pose, home = self.known_autopilot, self.pose, self.home_ned_m
        if autopilot is not None and autopilot.battery_remaining >= 0.0:
            found["battery"] = autopilot.battery_remaining
        if self._height_m is not None and now_s - self._height_s <= HEIGHT_SILENT_S:
            found["altitude_m"] = self._height_m
        if pose is None or not self.is_pose_fresh(now_s):
            return found
        north, east, down = pose.position_ned_m
        found["pose_quality"] = pose.quality
        found["position_std_m"] = hypot(*pose.position_std_m[:2])
        found["speed_m_s"] = hypot(*pose.velocity_ned_m_s)
        if home is not None:
            found |= {"height_m": home[2] - down, "depth_m": down - home[2]}
            found["home_distance_m"] = hypot(north - home[0], east - home[1])
        return found

    def conditions(self, fence: Fence | None, now_s: float) -> Iterator[tuple[PolicyCondition, bool, str]]:
        """All conditions with a known state, whether they hold, and why."""
        is_airborne, is_fresh = self.is_airborne, self.is_pose_fresh(now_s)
        is_invalid = self.pose is not None and not self.pose.is_valid
        age_s = now_s - self._pose_s
        wait_s = POSE_INVALID_S if is_invalid else POSE_LOST_S if age_s >= POSE_LOST_S else POSE_LATE_MOST_S
        if is_fresh or not is_airborne:
            yield PolicyCondition.POSE_LOST, False, ""
        elif self._posed_s is not None and now_s - self._posed_s >= wait_s:  # until then it stays as it was
            reason = f"no pose for {POSE_LOST_S:g} s" if age_s >= POSE_LOST_S else f"poses are {age_s:.1f} s late"
            yield PolicyCondition.POSE_LOST, True, self.pose.reason if self.pose is not None and is_invalid else reason
        if self.known_autopilot is not None:  # else it stays as it was
            left = self.known_autopilot.battery_remaining
            is_low = 0.0 <= left < self._reserve
            yield (
                PolicyCondition.LOW_BATTERY,
                is_low,
                f"{beside(100.0 * left, 100.0 * self._reserve, 0)} % is left" if is_low else "",
            )
        by_m = 0.0
        if fence is not None and self.pose is not None and is_airborne and is_fresh:
            by_m = -fence.clearance_m(self.pose.position_ned_m)
        is_out = by_m > 0.0
        yield PolicyCondition.FENCE_BREACHED, is_out, f"{excess(by_m)} m outside" if is_out else ""
