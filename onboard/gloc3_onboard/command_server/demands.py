"""The velocities that a station asks for by hand: taken from the holder of control alone, in order, and while they are new.

A demand that is late says what an operator wanted before the link stood still. The clocks of a station and of the
vehicle have nothing in common, so its lateness is what it was longer on its way than the quickest one of its session.
"""

from collections.abc import Sequence
from typing import Final

from gloc3.ci import StationRole
from gloc3.errors import Refused
from gloc3.messages import Envelope, Severity
from gloc3.teleoperation import EXPIRES_S, VelocityDemand
from gloc3_onboard.command_server.component_requests import Say
from gloc3_onboard.command_server.control import MOST_HEARD, ControlAuthority

AGAIN_S: Final = 10.0
"""Why demands of a station are not taken is told so often."""
DRIFT: Final = 1e-3
"""Two clocks run apart by less than this share of the time."""


class Demands:
    """Judges demands.

    Args:
        authority: knows the holder of control.
        say: tells stations what is wrong.
    """

    def __init__(self, authority: ControlAuthority, say: Say) -> None:
        self._authority, self._say = authority, say
        self._session = ("", -1)
        self._sequence = -1
        self._quickest_s = 0.0
        """The difference of the clocks and the shortest way."""
        self._heard_s = 0.0
        self._told_s: dict[str, float] = {}

    def take(self, demands: Sequence[Envelope[VelocityDemand]], now_s: float) -> list[VelocityDemand]:
        """The newest demand that counts, if there is one among those that have just come."""
        taken: list[VelocityDemand] = []
        for envelope in demands:
            try:
                if self._counts(envelope, now_s):
                    taken = [envelope.payload]
            except Refused as refusal:
                self._tell(envelope.payload.sender, str(refusal), now_s)
        return taken

    def _counts(self, envelope: Envelope[VelocityDemand], now_s: float) -> bool:
        """Whether a demand is to be carried out; False for one that has come before, or was overtaken.

        Raises:
            Refused: its sender may not, or it is late.
        """
        demand = envelope.payload
        if demand.role is not StationRole.OPERATOR:
            raise Refused("it is an observer")
        self._authority.require(demand.sender)
        session, way_s = (demand.sender, demand.session), now_s - envelope.t_s
        if session != self._session:
            self._session, self._sequence, self._quickest_s = session, -1, way_s
        elif demand.sequence <= self._sequence:
            return False
        self._sequence = demand.sequence
        self._quickest_s = min(way_s, self._quickest_s + DRIFT * (now_s - self._heard_s))
        self._heard_s = now_s
        late_s = way_s - self._quickest_s
        if late_s > EXPIRES_S:
            raise Refused(f"they come {late_s:.1f} s late; take to the keys anew if the link stays so slow")
        return True

    def _tell(self, sender: str, text: str, now_s: float) -> None:
        if now_s - self._told_s.get(sender, float("-inf")) < AGAIN_S:
            return
        if len(self._told_s) > MOST_HEARD:
            self._told_s.clear()
        self._told_s[sender] = now_s
        self._say(Severity.WARNING, f"velocities of station {sender} are not taken: {text}")
