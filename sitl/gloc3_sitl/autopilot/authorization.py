"""PX4's arm authorization: another system must permit arming (mavlink.io, "Arm Authorization")."""

from collections.abc import Callable
from enum import Enum, auto
from typing import Final

from gloc3.messages.envelope import Severity
from gloc3_sitl.autopilot.craft import Craft
from gloc3_sitl.autopilot.modes import Result

_TWO_STEPS: Final = 1
"""COM_ARM_AUTH_MET: the first attempt to arm asks only, the second arms."""
_REASON_COMES_FROM_AUTHORIZER: Final = 1
_REASONS: Final = {
    2: "a mission item is not allowed",
    3: "the authorizer had no time to check",
    4: "the airspace is in use",
    5: "the weather is bad",
}
"""MAV_ARM_AUTH_DENIED_REASON."""


class ArmPermission(Enum):
    """Whether the motors may start."""

    GIVEN = auto()
    AWAITED = auto()
    """The answer comes within COM_ARM_AUTH_TO."""
    REFUSED = auto()


class Authorization:
    """Requests authorization, waits for it, and keeps its validity.

    Args:
        craft: whose time it is, and who says what comes of it.
        ask_parameter: the value of a COM_ARM_AUTH parameter; None where the style has none of this.
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
        """Returns whether the vehicle may be armed now; requests authorization if that is unknown."""
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
