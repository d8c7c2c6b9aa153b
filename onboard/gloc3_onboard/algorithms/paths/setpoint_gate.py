"""Setpoint gate: accepts finite, recent setpoints of the owner of motion (DESIGN §7), and counts the others."""

from collections.abc import Sequence
from typing import Final

from gloc3.messages.envelope import Envelope
from gloc3.messages.vehicle import Setpoint
from gloc3_onboard.algorithms.paths.motion_limits import is_finite

SETPOINT_AGE_S: Final = 0.25
"""An older setpoint is dropped."""
AHEAD_S: Final = 0.05
"""Largest lead of a setpoint's time over ours, s; later ones are dropped, since their age is unknown."""


class SetpointGate:
    """Drops setpoints that are not the owner's, not finite, stale or from the future."""

    def __init__(self) -> None:
        self.foreign = self.not_finite = self.stale = 0

    def newest(self, envelopes: Sequence[Envelope[Setpoint]], owner: str, now_s: float) -> Envelope[Setpoint] | None:
        """The newest of the acceptable setpoints; None if there is none."""
        found = None
        for envelope in envelopes:
            if not owner or envelope.payload.action_id != owner:
                self.foreign += 1
            elif not is_finite(envelope.payload):
                self.not_finite += 1
            elif not -AHEAD_S <= now_s - envelope.t_s <= SETPOINT_AGE_S:
                self.stale += 1
            else:
                found = envelope
        return found
