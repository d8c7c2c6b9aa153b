"""Tells a driver that has come up anew in flight from a pilot who has taken the vehicle over (DESIGN §7).

A new driver finds an armed vehicle and cannot know whose it is. Who has seen the life before it can: where the mode is
still the one that the vehicle was in, or the hold in which a failing driver leaves it, nobody has taken over.
"""

from typing import Final

from gloc3.messages.envelope import Envelope
from gloc3.messages.vehicle import AutopilotState, DriverState, FlightMode

OURS: Final = (FlightMode.GUIDED, FlightMode.HOLD, FlightMode.TAKE_OFF, FlightMode.LAND)
"""Modes in which a vehicle that a former life of a driver, or of this process, flew may be taken up again."""
TAKE_OVER_S: Final = 2.0
"""How long a driver is asked to take it up again."""


class Handover:
    """Follows the driver through its lives."""

    def __init__(self) -> None:
        self._boot: int | None = None
        self._was_ours = False
        self._mode = FlightMode.OTHER
        self._until_s = float("-inf")

    def see(self, report: Envelope[DriverState], autopilot: AutopilotState | None, now_s: float) -> None:
        """Takes in what a driver reports, and in which mode the autopilot is."""
        boot = report.source.boot
        if boot != self._boot:
            is_new_life = self._boot is not None and self._was_ours
            self._until_s = now_s + TAKE_OVER_S if is_new_life else float("-inf")
            self._boot = boot
        if now_s >= self._until_s:
            self._was_ours = not report.payload.has_pilot_control
            self._mode = autopilot.mode if autopilot is not None else FlightMode.OTHER

    def is_ours(self, driver: DriverState, autopilot: AutopilotState | None, now_s: float) -> bool:
        """Whether what the new driver takes for a pilot's is what the one before it flew: it is to be told so."""
        if not driver.has_pilot_control or now_s >= self._until_s or autopilot is None or not autopilot.is_armed:
            return False
        modes = (*OURS, FlightMode.MISSION)  # of a plan that goes on by itself
        return autopilot.mode in modes and autopilot.mode in (self._mode, FlightMode.HOLD)
