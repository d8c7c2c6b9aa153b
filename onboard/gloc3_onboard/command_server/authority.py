"""Permissions: the holder of control, the requests that each station may make, and the timing of manual velocities.

A late velocity is what an operator wanted before the link stalled. The clocks of station and vehicle are unrelated, so
lateness is the additional delay over the fastest message of the session.
"""

from collections import OrderedDict, deque
from collections.abc import Sequence
from typing import Final

from gloc3.component.ports import Inbox, Input, Keep, Output, PortGroup
from gloc3.errors import Refused
from gloc3.messages.command_interface import (
    OURSELVES,
    QUERIES,
    CiRequest,
    Control,
    ControlVerb,
    Emergency,
    Hello,
    StationRole,
)
from gloc3.messages.envelope import Envelope, Severity
from gloc3.messages.software import Software
from gloc3.messages.summaries import ControlState, EventReport, StationHeard
from gloc3.messages.teleoperation import EXPIRES_S, VelocityDemand
from gloc3.network.rights import Rights
from gloc3.network.rights_file import Right

ANSWER_S: Final = 10.0
"""Time for the holder to answer a request, s; without an answer it is granted if the holder is lost, else refused."""

EXPIRES_AFTER_S: Final = 5.0
"""Time without a message after which a holder is lost, s (DESIGN §6, link loss)."""
MOST_HEARD: Final = 32
"""Number of stations whose last contact is remembered."""
THERE_S: Final = 30.0
"""Time without a message after which a station counts as absent, s."""
MOST_STATIONS: Final = 32
"""Stations and lives that are remembered."""
MOST_LATE: Final = 2
"""So many requests of a life that is over may come late."""
DOUBLED_AGAIN_S: Final = 60.0
DEMANDS_AGAIN_S: Final = 10.0
"""Period at which the reason for ignoring a station's demands is repeated, s."""
DRIFT: Final = 1e-3
"""Two clocks run apart by less than this share of the time."""
MOST_SENDERS: Final = 16
MOST_PAST: Final = 64
"""Number of ended sessions remembered; late messages of these are ignored."""


class AuthorityPorts(PortGroup):
    """Inputs and outputs of the permissions."""

    heard = Input(StationHeard, Keep.ALL)
    velocity_demand = Input(VelocityDemand, Keep.ALL)

    control = Output(ControlState)
    motion_demand = Output(VelocityDemand)


class ControlAuthority:
    """Holder of control, and its last contact."""

    def __init__(self) -> None:
        self.holder = ""
        self.is_entitled = True
        """Whether the holder may still hold control; one that may not counts as lost."""
        self.requested_by = ""
        self._requested_s = 0.0
        self._received_s: dict[str, float] = {}
        self._left_s: float | None = None
        """When there was a holder last, or the vehicle was on the ground."""

    def state(self) -> ControlState:
        """For the stations."""
        return ControlState(holder=self.holder, requested_by=self.requested_by)

    def restore(self, holder: str, now_s: float) -> None:
        """Restores the holder of control after a restart; it counts as in contact now, and must be heard again."""
        self.holder = holder
        self._received_s.setdefault(holder, now_s)

    def note_contact(self, station: str, now_s: float) -> None:
        """Registers contact with a station, by its heartbeat or a request."""
        self._received_s.pop(station, None)
        self._received_s[station] = now_s
        if len(self._received_s) > MOST_HEARD:
            del self._received_s[next(one for one in self._received_s if one != self.holder)]

    def is_in_contact(self, station: str, now_s: float, within_s: float) -> bool:
        """Whether a station was heard recently."""
        return now_s - self._received_s.get(station, float("-inf")) <= within_s

    def others_received_s(self) -> float:
        """When a station other than the holder, which may be a pilot's, was heard last; minus infinity for never."""
        others = self._received_s.keys() - {self.holder, OURSELVES}
        return max((self._received_s[name] for name in others), default=float("-inf"))

    def silent_s(self, now_s: float) -> float:
        """Time since the holder was last heard, s; 0 without a holder."""
        return now_s - self._received_s.get(self.holder, now_s) if self.holder else 0.0

    def unattended_s(self, now_s: float, *, is_airborne: bool) -> float:
        """Time since whoever is in charge was last heard, s: the holder, or else any station while the vehicle is in the air."""
        if self.holder or not is_airborne or self._left_s is None:
            self._left_s = now_s
        if self.holder or not is_airborne:
            return self.silent_s(now_s)
        return now_s - max(self.others_received_s(), self._left_s)

    def require(self, station: str) -> None:
        """Refuses a station that does not hold control."""
        if station != self.holder:
            held = f"station {self.holder} holds control" if self.holder else "no station holds control"
            raise Refused(f"{held}; request control first")

    def handle(self, station: str, body: Control, expires_after_s: float, now_s: float) -> str:
        """Handles a request about control; returns the answer for the station.

        Raises:
            Refused: with the reason.
        """
        match body.verb:
            case ControlVerb.REQUEST:
                return self._request(station, expires_after_s, now_s)
            case ControlVerb.RELEASE:
                self.require(station)
                self.holder, self.requested_by = self.requested_by, ""
                return "released"
            case ControlVerb.GRANT:
                self.require(station)
                if not self.requested_by or body.station not in ("", self.requested_by):
                    raise Refused(f"station {body.station or '?'} has not requested control")
                self.holder, self.requested_by = self.requested_by, ""
                return f"granted to station {self.holder}"
            case ControlVerb.REFUSE:
                self.require(station)
                self.requested_by = ""
                return "refused"
            case ControlVerb.TAKE_OVER:
                was, self.holder, self.requested_by = self.holder, station, ""
                return f"taken over from station {was}" if was and was != station else "taken"
            case _:
                raise Refused(f"{body.verb} is about roles, not about control")

    def _request(self, station: str, expires_after_s: float, now_s: float) -> str:
        if self.holder in ("", station):
            self.holder = station
            return "granted"
        if self._is_lost(now_s, expires_after_s):
            was, self.holder, self.requested_by = self.holder, station, ""
            return f"granted: station {was} is lost"
        if self.requested_by not in ("", station):
            raise Refused(f"station {self.requested_by} has already requested control and waits for the answer")
        self.requested_by, self._requested_s = station, now_s
        return f"station {self.holder} has been asked"

    def tick(self, now_s: float, expires_after_s: float = EXPIRES_AFTER_S) -> bool:
        """Ends an unanswered request; returns whether anything has changed."""
        if not self.requested_by or now_s - self._requested_s <= ANSWER_S:
            return False
        if self._is_lost(now_s, expires_after_s):
            self.holder = self.requested_by
        self.requested_by = ""
        return True

    def _is_lost(self, now_s: float, expires_after_s: float) -> bool:
        return not self.is_entitled or self.silent_s(now_s) > expires_after_s


class Authority:
    """Known stations and their permissions.

    Args:
        kept_holder: holder of control when the previous process ended in flight; empty for none.
        report: sends an event to the stations.
        rights: the members' rights.
    """

    def __init__(self, kept_holder: str, report: EventReport, rights: Rights) -> None:
        self.control: Final = ControlAuthority()
        self.rights: Final = rights
        self.demands: Final = Demands(self.control, report, rights)
        self._kept_holder, self._report = kept_holder, report
        self._senders = Senders()
        self._members: OrderedDict[str, str] = OrderedDict()
        """For whom each station spoke last."""
        self._software: dict[str, Software] = {}
        """Software of the stations that have identified themselves."""

    def observe(self, now_s: float, inbox: Inbox) -> None:
        """Handles station heartbeats, and the end of the holder's role."""
        if self._kept_holder:
            self.control.restore(self._kept_holder, now_s)
            self._kept_holder = ""
        for received in inbox.new(AuthorityPorts.heard):
            heard = received.payload
            self._note_contact(heard.station, heard.member, heard.role, now_s)
        control, holder = self.control, self.control.holder
        is_entitled = holder not in self._members or self.rights.may(self._members[holder], Right.CONTROL)
        if control.is_entitled and not is_entitled:
            member = self._members[holder]
            text = f"{member or holder} may not hold control any more, and counts as lost: another one can request it"
            self._report(Severity.WARNING, text)
        control.is_entitled = is_entitled

    def _note_contact(self, station: str, member: str, role: StationRole, now_s: float) -> None:
        """Registers contact, with the holder of control only where it may hold it: not as an observer that has its name."""
        if station == self.control.holder and role is StationRole.OBSERVER:
            return
        is_same = self._members.get(station, member) == member and self.rights.may(member, Right.CONTROL)
        if self.rights.is_open or station != self.control.holder or is_same:
            self.control.note_contact(station, now_s)

    def receive(self, request: CiRequest, now_s: float) -> str:
        """Registers a request; returns the reason for a general refusal, empty if there is none."""
        if request.objection:
            return request.objection
        try:
            self.rights.check(request.member, request.body)
        except Refused as refusal:
            return str(refusal)
        if request.role is StationRole.OBSERVER and not isinstance(request.body, QUERIES):
            return f"station {request.sender} may look and not command: it is an observer"
        is_query = isinstance(request.body, QUERIES)  # unsigned: where there are rights, anyone may send one
        if not is_query and not isinstance(request.body, Emergency) and (clash := self._identify(request)):
            return clash
        if not is_query or self.rights.is_open:
            self._note_contact(request.sender, request.member, request.role, now_s)
        if isinstance(request.body, Hello | Control):
            self._software.pop(request.sender, None)
            self._software[request.sender] = Software(request.body.version, request.body.protocol)
            if len(self._software) > MOST_STATIONS:
                del self._software[next(iter(self._software))]
        if doubled := self._senders.receive(request.sender, request.boot, now_s):
            self._report(Severity.WARNING, doubled)
        return ""

    def _identify(self, request: CiRequest) -> str:
        """Notes for whom a station speaks; returns a refusal where it has the holder's name and is another member's."""
        if self.rights.is_open:
            return ""
        station, member = request.sender, request.member
        known = self._members.get(station, member)
        if station == self.control.holder and known != member and self.rights.may(known, Right.CONTROL):
            return (
                f"station {station} holds control for {known or 'no member'}, and this request is of {member or 'none'}"
            )
        self._members.pop(station, None)
        self._members[station] = member
        if len(self._members) > MOST_STATIONS:
            del self._members[next(one for one in self._members if one != self.control.holder)]
        return ""

    def require(self, request: CiRequest) -> None:
        """Refuses a station that does not hold control; where two persons are needed, its request counts as the first.

        Raises:
            Refused: with the reason.
        """
        if request.sender != self.control.holder and (noted := self.rights.note(request.member, request.body)):
            raise Refused(noted)
        self.control.require(request.sender)

    def second(self, request: CiRequest, *extra: Right) -> None:
        """Admits a request for which one person is enough, and the second of two.

        Args:
            request: the request.
            extra: rights that it needs besides.

        Raises:
            Refused: it is the first of two.
        """
        if first := self.rights.second(request.member, request.body, extra):
            text = f"two persons have requested {type(request.body).__name__}: {first} and {request.member}"
            self._report(Severity.NOTICE, text)

    def handle(self, request: CiRequest, body: Control, expires_after_s: float, now_s: float) -> str:
        """Handles a request about control or roles; returns the answer for the station.

        Raises:
            Refused: with the reason.
        """
        if body.verb not in (ControlVerb.APPOINT, ControlVerb.DISMISS):
            return self.control.handle(request.sender, body, expires_after_s, now_s)
        if body.verb is ControlVerb.APPOINT:
            text = self.rights.appoint(request.member, body.station, body.role, body.for_s)
        else:
            text = self.rights.dismiss(body.station)
        self._report(Severity.NOTICE, f"{request.member}: {text}")
        return text

    def software(self, now_s: float) -> dict[str, Software]:
        """The software of the stations that are there."""
        return {name: one for name, one in self._software.items() if self.control.is_in_contact(name, now_s, THERE_S)}


class Senders:
    """The boots of the stations that send requests."""

    def __init__(self) -> None:
        self._lives: dict[str, dict[int, int]] = {}
        """Station to the boots that it has spoken with, the present one last, each with how often it came back."""
        self._reported_s: dict[str, float] = {}

    def receive(self, station: str, boot: int, now_s: float) -> str:
        """Registers a request; returns a warning about clashing stations, at most once a minute, else nothing."""
        lives = self._lives.pop(station, {})
        self._lives[station] = lives
        if len(self._lives) > MOST_STATIONS:
            oldest = next(iter(self._lives))
            del self._lives[oldest]
            self._reported_s.pop(oldest, None)
        if not lives or boot == next(reversed(lives)):
            lives.setdefault(boot, 0)
            return ""
        if boot not in lives:
            lives[boot] = 0
            if len(lives) > MOST_STATIONS:
                del lives[next(iter(lives))]
            return ""
        lives[boot] = lives.pop(boot) + 1
        if lives[boot] <= MOST_LATE or now_s < self._reported_s.get(station, float("-inf")) + DOUBLED_AGAIN_S:
            return ""
        self._reported_s[station] = now_s
        return f"two stations have the id {station}, and their commands are mixed: change one of them (--station-id)"


class _Session:
    """What came of one time at the keys."""

    def __init__(self, number: int, elapsed_s: float) -> None:
        self.number: Final = number
        self.sequence = -1
        self.quickest_s = elapsed_s
        """Smallest difference of the clocks: clock offset plus shortest delay."""
        self.received_s = 0.0


class Demands:
    """Accepts or ignores velocity demands.

    Args:
        authority: the holder of control.
        report: sends warnings to stations.
        rights: the members' rights.
    """

    def __init__(self, authority: ControlAuthority, report: EventReport, rights: Rights) -> None:
        self._authority, self._refuse_text, self._rights = authority, report, rights
        self._sessions: OrderedDict[str, _Session] = OrderedDict()
        """Current session of each sender."""
        self._past: deque[tuple[str, int]] = deque(maxlen=MOST_PAST)
        self._reported_s: dict[str, float] = {}

    def newest(self, demands: Sequence[Envelope[VelocityDemand]], now_s: float) -> list[VelocityDemand]:
        """The newest demand that counts, if there is one among those that have just come."""
        used: list[VelocityDemand] = []
        for envelope in demands:
            try:
                if self._counts(envelope, now_s):
                    used = [envelope.payload]
            except Refused as refusal:
                self._report(envelope.payload.sender, str(refusal), now_s)
        return used

    def _counts(self, envelope: Envelope[VelocityDemand], now_s: float) -> bool:
        """Whether a demand is to be carried out; False for one that has come before, or was overtaken.

        Raises:
            Refused: its sender may not, or it is late.
        """
        demand = envelope.payload
        if demand.role is not StationRole.OPERATOR:
            raise Refused("it is an observer")
        self._rights.check_demand(demand.member)
        self._authority.require(demand.sender)
        elapsed_s = now_s - envelope.t_s
        session = self._session_of(demand, elapsed_s)
        if session is None or demand.sequence <= session.sequence:
            return False
        session.sequence = demand.sequence
        session.quickest_s = min(elapsed_s, session.quickest_s + DRIFT * (now_s - session.received_s))
        session.received_s = now_s
        late_s = elapsed_s - session.quickest_s
        if not late_s <= EXPIRES_S:
            raise Refused(f"they are {late_s:.1f} s late; press the keys again if the link stays slow")
        return True

    def _session_of(self, demand: VelocityDemand, elapsed_s: float) -> _Session | None:
        """The session of a demand; None if its sender has started another one since."""
        session = self._sessions.get(demand.sender)
        if session is not None and session.number == demand.session:
            return session
        if (demand.sender, demand.session) in self._past:
            return None
        if session is not None:
            self._past.append((demand.sender, session.number))
        session = self._sessions[demand.sender] = _Session(demand.session, elapsed_s)
        self._sessions.move_to_end(demand.sender)
        if len(self._sessions) > MOST_SENDERS:
            self._sessions.popitem(last=False)
        return session

    def _report(self, sender: str, text: str, now_s: float) -> None:
        if now_s - self._reported_s.get(sender, float("-inf")) < DEMANDS_AGAIN_S:
            return
        if len(self._reported_s) > MOST_HEARD:
            self._reported_s.clear()
        self._reported_s[sender] = now_s
        self._refuse_text(Severity.WARNING, f"velocities of station {sender} are ignored: {text}")
