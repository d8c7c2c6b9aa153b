"""The velocities that a station asks for by hand: taken from the holder of control alone, in order, and while they are new.

A demand that is late says what an operator wanted before the link stood still. The clocks of a station and of the
vehicle have nothing in common, so its lateness is what it was longer on its way than the quickest one of its session.
"""

from collections import OrderedDict, deque
from collections.abc import Sequence
from typing import Final

from gloc3.errors import Refused
from gloc3.messages.command_interface import StationRole
from gloc3.messages.envelope import Envelope, Severity
from gloc3.messages.teleoperation import EXPIRES_S, VelocityDemand
from gloc3_onboard.command_server.component_requests import Say
from gloc3_onboard.command_server.control import MOST_HEARD, ControlAuthority

AGAIN_S: Final = 10.0
"""Why demands of a station are not taken is told so often."""
DRIFT: Final = 1e-3
"""Two clocks run apart by less than this share of the time."""
MOST_SENDERS: Final = 16
MOST_PAST: Final = 64
"""Sessions that are over and remembered: what comes of them late, by a slower way, counts no more."""


class _Session:
    """What came of one time at the keys."""

    def __init__(self, number: int, way_s: float) -> None:
        self.number: Final = number
        self.sequence = -1
        self.quickest_s = way_s
        """The difference of the clocks and the shortest way."""
        self.heard_s = 0.0


class Demands:
    """Judges demands.

    Args:
        authority: knows the holder of control.
        say: tells stations what is wrong.
    """

    def __init__(self, authority: ControlAuthority, say: Say) -> None:
        self._authority, self._say = authority, say
        self._sessions: OrderedDict[str, _Session] = OrderedDict()
        """By sender: the one that goes on."""
        self._past: deque[tuple[str, int]] = deque(maxlen=MOST_PAST)
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
        way_s = now_s - envelope.t_s
        session = self._session_of(demand, way_s)
        if session is None or demand.sequence <= session.sequence:
            return False
        session.sequence = demand.sequence
        session.quickest_s = min(way_s, session.quickest_s + DRIFT * (now_s - session.heard_s))
        session.heard_s = now_s
        late_s = way_s - session.quickest_s
        if not late_s <= EXPIRES_S:
            raise Refused(f"they come {late_s:.1f} s late; take to the keys anew if the link stays so slow")
        return True

    def _session_of(self, demand: VelocityDemand, way_s: float) -> _Session | None:
        """The session of a demand; None where its sender has begun another since."""
        session = self._sessions.get(demand.sender)
        if session is not None and session.number == demand.session:
            return session
        if (demand.sender, demand.session) in self._past:
            return None
        if session is not None:
            self._past.append((demand.sender, session.number))
        session = self._sessions[demand.sender] = _Session(demand.session, way_s)
        self._sessions.move_to_end(demand.sender)
        if len(self._sessions) > MOST_SENDERS:
            self._sessions.popitem(last=False)
        return session

    def _tell(self, sender: str, text: str, now_s: float) -> None:
        if now_s - self._told_s.get(sender, float("-inf")) < AGAIN_S:
            return
        if len(self._told_s) > MOST_HEARD:
            self._told_s.clear()
        self._told_s[sender] = now_s
        self._say(Severity.WARNING, f"velocities of station {sender} are not taken: {text}")
