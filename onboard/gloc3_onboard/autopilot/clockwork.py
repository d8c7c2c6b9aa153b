"""How the autopilot's clock lies to ours: by the stamps of its messages, set right by TIMESYNC's round trips."""

from typing import Final

from gloc3.mavlink.message import Address
from gloc3.mavlink.services.timesync import TimeSync
from gloc3_onboard.autopilot.telemetry import Telemetry

CLOCKS_AGREE_S: Final = 0.25
"""A clock that is told by round trips and differs by more from the stamps of the messages is another one."""


class Clockwork:
    """Sees a restart in the clock alone, and a clock that has stood still.

    Args:
        own: as whom it asks.
        telemetry: keeps the clock by stamps.
    """

    def __init__(self, own: Address, telemetry: Telemetry) -> None:
        self.service: Final = TimeSync(own, tell_s=telemetry.boot_s)
        """Driven by its owner."""
        self._telemetry = telemetry
        self._restarts = 0

    def look(self, now_s: float) -> None:
        """Tells the telemetry of what the round trips show."""
        service = self.service
        if (
            service.restarts != self._restarts
        ):  # an autopilot that sends nothing unasked shows a restart by its clock alone
            self._restarts = service.restarts
            self._telemetry.restarted()
        for sample in service.events():  # it answered after it was asked: a bound that no delay on the way can break
            self._telemetry.correct_clock(-sample.offset_s - 0.5 * sample.round_trip_s)

    def boot_s(self, t_s: float) -> float:
        """The autopilot's own time of ours: by round trips, where they agree with its stamps; 0 while it is not known."""
        stamped_s = self._telemetry.boot_s(t_s)
        if stamped_s is None:
            return 0.0
        exact_s = self.service.to_peer_s(t_s) if self.service.is_converged else None
        return exact_s if exact_s is not None and abs(exact_s - stamped_s) < CLOCKS_AGREE_S else stamped_s
