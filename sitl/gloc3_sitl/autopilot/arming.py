"""Arming: the checks, each in words and by the PX4 event that reports it, and PX4's arm authorization by another system.

The authorization follows mavlink.io, "Arm Authorization".
"""

from collections.abc import Callable, Iterator
from enum import Enum, IntFlag, auto
from math import degrees, hypot
from typing import Final, NamedTuple

from gloc3.messages.envelope import Severity
from gloc3_sitl.autopilot.craft import Craft
from gloc3_sitl.autopilot.modes import POSITIONED, Behaviour, Result

_TWO_STEPS: Final = 1
"""COM_ARM_AUTH_MET: the first attempt to arm only requests authorization, the second arms."""
_REASON_COMES_FROM_AUTHORIZER: Final = 1
_REASONS: Final = {
    2: "a mission item is not allowed",
    3: "the authorizer had no time to check",
    4: "the airspace is in use",
    5: "the weather is bad",
}
"""MAV_ARM_AUTH_DENIED_REASON."""


class Check(IntFlag):
    """Groups of pre-arm checks that can be disabled."""

    ATTITUDE = 1
    HEADING = 2
    HEIGHT = 4
    POSITION = 8
    BATTERY = 16
    PILOT = 32
    FENCE = 64
    HEALTH = 128
    MODE = 256


class ArmingProblem(NamedTuple):
    """A reason against arming."""

    check: Check
    text: str
    event: str = ""
    """Name of PX4's event; empty where PX4 has none."""


def vehicle_problems(craft: Craft, behaviour: Behaviour, battery_share: float) -> Iterator[ArmingProblem]:
    """Yields the reasons against arming in a mode, worst first."""
    estimator, now_s = craft.estimator, craft.now_s
    if not estimator.is_aligned:
        yield ArmingProblem(Check.ATTITUDE, "attitude is still aligning", "check_modes_attitude")
        return
    roll, pitch, _ = estimator.euler_rad
    if hypot(roll, pitch) > 0.4:
        text = f"tilted by {degrees(hypot(roll, pitch)):.0f} degrees"
        yield ArmingProblem(Check.ATTITUDE, text, "check_failure_detector_roll")
    if not estimator.is_height_good(now_s):
        yield ArmingProblem(Check.HEIGHT, "no height: barometer failed", "check_modes_local_alt")
    if not estimator.is_heading_good(now_s):
        yield ArmingProblem(Check.HEADING, "no heading: compass failed", "check_estimator_heading_not_stable")
    needs_position = craft.tuning.needs_position_to_arm or behaviour in POSITIONED
    if needs_position and not estimator.is_position_good(now_s):
        yield ArmingProblem(Check.POSITION, "no position: waiting for a fix or odometry", "check_modes_local_pos")
    if needs_position and estimator.origin is None:
        yield ArmingProblem(Check.POSITION, "no global origin", "check_modes_global_pos")
    if battery_share < craft.tuning.battery_low:
        yield ArmingProblem(Check.BATTERY, f"battery low: {100.0 * battery_share:.0f} %", "check_battery_low")
    if craft.tuning.pilot_required and now_s - craft.pilot.last_seen_s > craft.tuning.pilot_timeout_s:
        yield ArmingProblem(Check.PILOT, "no transmitter", "check_modes_manual_control")
    if craft.is_leaking:
        yield ArmingProblem(Check.HEALTH, "leak detected")
    if craft.fault:
        yield ArmingProblem(Check.HEALTH, craft.fault)


class ArmPermission(Enum):
    """Permission to start the motors."""

    GIVEN = auto()
    AWAITED = auto()
    """The answer comes within COM_ARM_AUTH_TO."""
    REFUSED = auto()


class Authorization:
    """Requests authorization, waits for it, and keeps its validity.

    Args:
        craft: the vehicle, with clock and status texts.
        request_parameter: reads a COM_ARM_AUTH parameter; None for styles without them.
    """

    def __init__(self, craft: Craft, request_parameter: Callable[[str], float] | None) -> None:
        self._craft, self._request = craft, request_parameter
        self._waits_until_s: float | None = None
        self._holds_until_s = 0.0
        self.send: Callable[[int], None] = lambda _: None
        """Requests authorization from the system of this id; its answer goes to `answered`."""

    @property
    def is_given(self) -> bool:
        """Whether an authorization is still valid."""
        return self._craft.now_s < self._holds_until_s

    @property
    def is_awaited(self) -> bool:
        """Whether an answer is pending."""
        return self._waits_until_s is not None

    def leave(self) -> ArmPermission:
        """Whether the vehicle may be armed now; requests authorization if unknown."""
        if self._request is None or not self._request("COM_ARM_AUTH_REQ") or self.is_given:
            return ArmPermission.GIVEN
        if self.is_awaited:
            return ArmPermission.REFUSED
        self._waits_until_s = self._craft.now_s + self._request("COM_ARM_AUTH_TO")
        self.send(int(self._request("COM_ARM_AUTH_ID")))
        if self._request("COM_ARM_AUTH_MET") == _TWO_STEPS:
            self._craft.send_text(Severity.INFO, "Arming: authorization requested; arm again then")
            return ArmPermission.REFUSED
        return ArmPermission.AWAITED

    def answered(self, result: int, reason: int, extra: int) -> None:
        """Handles the authorizer's answer.

        Args:
            result: MAV_RESULT.
            reason: `result_param1`, MAV_ARM_AUTH_DENIED_REASON.
            extra: `result_param2`: for how many seconds the authorization is valid.
        """
        if not self.is_awaited or result == Result.IN_PROGRESS:
            return
        self._waits_until_s = None
        if result == Result.ACCEPTED:
            self._holds_until_s = self._craft.now_s + extra
            self._craft.send_text(Severity.INFO, f"Arming: authorized for {extra} s")
        elif result == Result.TEMPORARILY_REJECTED:
            self._craft.send_text(Severity.CRITICAL, "Arming: authorization refused for now")
        elif reason != _REASON_COMES_FROM_AUTHORIZER:
            because = f": {_REASONS[reason]}" if reason in _REASONS else ""
            self._craft.send_text(Severity.CRITICAL, f"Arming: authorization refused{because}")

    def tick(self) -> None:
        """Gives up waiting after the timeout."""
        if self._waits_until_s is not None and self._craft.now_s > self._waits_until_s:
            self._waits_until_s = None
            self._craft.send_text(Severity.CRITICAL, "Arming: no answer from the authorizer")
