"""Leads the autopilot by setpoints: in the form that it takes, as often as it takes them, and tells of gaps."""

import math
from typing import Final

from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.messages.vehicle import FlightMode
from gloc3_onboard.autopilot.facts import ClassFacts, Form
from gloc3_onboard.autopilot.setpoints import setpoint_message
from gloc3_onboard.autopilot.telemetry import Telemetry
from gloc3_onboard.sensors.devices import AutopilotSetpoint

REPOSITION_S: Final = 1.0
FORGOTTEN_S: Final = 10.0
"""A setpoint after so long begins another stream."""
POSE_S: Final = 0.5
"""An older estimate leads nobody to a place."""


class Lead:
    """The stream of setpoints to one autopilot.

    Args:
        telemetry: what it tells.
    """

    def __init__(self, telemetry: Telemetry) -> None:
        self.gap = ""
        """What is to be told of a setpoint that came too late; its reader empties it."""
        self._telemetry = telemetry
        self._sent_s = -math.inf

    def message(
        self, setpoint: AutopilotSetpoint, facts: ClassFacts, target: Address, now_s: float
    ) -> MavlinkMessage | None:
        """What is to be sent for a setpoint; None where nothing is now."""
        is_guided = self._telemetry.state.mode is FlightMode.GUIDED
        if facts.form is Form.REPOSITION and (not is_guided or now_s - self._sent_s < REPOSITION_S):
            return None  # in other modes it would be denied
        known = self._telemetry.pose
        pose = known.pose if known is not None and now_s - known.t_s < POSE_S else None
        message = setpoint_message(setpoint, facts.form, target, self._telemetry.boot_ms(now_s), pose)
        if message is not None:
            self._see_gap(now_s - self._sent_s, facts.timeout_s)
            self._sent_s = now_s
        return message

    def _see_gap(self, gap_s: float, limit_s: float) -> None:
        """Setpoints that come too late are told: the autopilot has done something by itself meanwhile."""
        state = self._telemetry.state
        if limit_s < gap_s < FORGOTTEN_S and state.is_armed and state.mode is FlightMode.GUIDED:
            self.gap = f"no setpoint for {gap_s:.1f} s: after {limit_s:g} s the autopilot has acted by itself"
