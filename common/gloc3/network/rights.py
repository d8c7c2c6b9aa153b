"""Rights of members, by vehicle, group and capability: roles as a table, and the decision about each request."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from hashlib import blake2s
from typing import Final, NamedTuple

import msgspec

from gloc3.cli.counting import listed
from gloc3.clock import utc_text
from gloc3.errors import Refused, nearest
from gloc3.messages.command_interface import (
    QUERIES,
    AnyBody,
    CallFunction,
    CommandComponent,
    ConfirmLog,
    Control,
    ControlVerb,
    CutLog,
    Elsewhere,
    Emergency,
    EmergencyVerb,
    LoadMission,
    RequestAction,
    RequestTask,
    Steer,
    Verb,
)
from gloc3.network.rights_file import ALL, Right, RightsEntry, RightsFile, Role

ROLES: Final[Mapping[Role, frozenset[Right]]] = {
    Role.OBSERVER: frozenset(),
    Role.OPERATOR: frozenset({Right.CONTROL, Right.FLY, Right.TERMINATE, Right.LOGS, Right.FENCE_OFF}),
    Role.COMMANDER: frozenset(set(Right) - {Right.MAINTAIN}),
    Role.MAINTAINER: frozenset({Right.CONTROL, Right.MAINTAIN, Right.LOGS}),
}
"""What each role may do, besides looking."""
MEANINGS: Final[Mapping[Right, str]] = {
    Right.CONTROL: "holding control",
    Right.FLY: "flying and steering",
    Right.LOGS: "ending and deleting logs",
    Right.OVERRULE: "overruling (take-over, force, red checks)",
    Right.APPOINT: "giving and taking back roles",
    Right.MAINTAIN: "changing parameters and settings",
    Right.TERMINATE: "disarming in flight",
    Right.FENCE_OFF: "flying without a geofence",
}
"""In words, as the subject of a refusal."""
GIVEN: Final = (Role.OPERATOR, Role.MAINTAINER, Role.OBSERVER)
"""Roles that a commander may give for some time; observer takes all others away meanwhile."""
LONGEST_S: Final = 86_400.0
"""So long a role may be given, s."""
MOST_GIVEN: Final = 64
"""Given roles, and first ones of two persons, that are remembered."""
SECOND_S: Final = 30.0
"""So long the first of two persons waits for the second, s."""
UNLIMITED: Final = frozenset({Right.FLY, Right.TERMINATE, Right.FENCE_OFF})
"""What a station needs that commands the autopilot itself, where no request is checked."""
ITSELF: Final = "*"
"""In place of a member, whose name it can never be: the vehicle's own processes, which have all rights."""
SAFE_VERBS: Final = (
    ControlVerb.REQUEST,
    ControlVerb.RELEASE,
    ControlVerb.GRANT,
    ControlVerb.REFUSE,
    EmergencyVerb.HOLD,
    EmergencyVerb.LAND,
    Verb.PAUSE,
    Verb.ABORT,
)
"""What stations may still do while nobody knows who is revoked, so that no vehicle in flight is lost by it."""
SAFE_ACTIONS: Final = ("hold", "land", "return_home")
"""And these actions."""
SAFE_RIGHTS: Final = (Right.CONTROL, Right.FLY)
"""What these requests need."""
TELEOPERATE: Final = "teleoperate"
"""Capability of manual control."""
IDENTITIES: Final = ("author", "override", "version", "protocol")
"""Fields in which the requests of two persons may differ."""


FLIGHTS: Final = (LoadMission, RequestTask, RequestAction)
"""Requests that may lead to flying without a geofence."""


def rights_for(body: AnyBody) -> frozenset[Right]:
    """What a request needs; nothing for one that only reads."""
    found = set[Right]()
    match body:
        case Emergency():
            found.add(Right.TERMINATE if body.verb is EmergencyVerb.DISARM else Right.FLY)
        case Control(verb=ControlVerb.TAKE_OVER):
            found.add(Right.OVERRULE)
        case Control(verb=ControlVerb.APPOINT | ControlVerb.DISMISS):
            found.add(Right.APPOINT)
        case Control(verb=ControlVerb.OPERATED):
            found.add(Right.FLY)
        case Control() | Elsewhere():
            found.add(Right.CONTROL)
        case CallFunction():
            found.add(Right.MAINTAIN)
        case CommandComponent():
            found.add(Right.FLY if body.settings is None else Right.MAINTAIN)
            found |= {Right.OVERRULE} if body.is_forced else set()
        case Steer() | RequestTask() | RequestAction():
            found |= {Right.FLY, Right.OVERRULE} if body.override else {Right.FLY}
        case CutLog() | ConfirmLog():
            found.add(Right.LOGS)
        case _ if not isinstance(body, QUERIES):
            found.add(Right.FLY)
    return frozenset(found)


class HeldRole(NamedTuple):
    """A role of a member for a platform."""

    role: Role
    until_s: float | None = None
    """UTC; None for no end."""
    may: tuple[str, ...] = ()
    """Capabilities that it is limited to; empty for all."""
    by: str = ""
    """Commander that has given it; empty for the file."""

    def __str__(self) -> str:
        only = f" (only {listed(self.may, 'and')})" if self.may else ""
        end = f" until {utc_text(self.until_s)} UTC" if self.until_s is not None else ""
        return f"{self.role}{only}{end}{f' by {self.by}' if self.by else ''}"


class ListValidity(NamedTuple):
    """Until when the list of revoked members counts as up to date."""

    number: int
    end_s: float
    """UTC."""


def is_safe(body: AnyBody) -> bool:
    """Whether a request stays permitted while nobody knows who is revoked."""
    if isinstance(body, QUERIES):
        return True
    if isinstance(body, RequestAction):
        return body.capability in SAFE_ACTIONS and not body.override
    return isinstance(body, Control | Emergency | Steer) and body.verb in SAFE_VERBS


class MemberRights(msgspec.Struct, frozen=True):
    """What a member may do with a platform."""

    roles: list[HeldRole] = []
    """Empty where there is no rights file: what the link permits."""
    refusals: dict[str, str] = {}
    """By right: why not."""
    two_persons: list[str] = []
    """Rights that need a second person."""


class _Given(NamedTuple):
    held: HeldRole
    end_s: float
    """By the monotonic clock, which nobody sets."""


class _First(NamedTuple):
    member: str
    end_s: float


def _no_time() -> float:
    return 0.0


class Rights:
    """Who may do what with a platform; without a file everyone may do what the link permits.

    Args:
        platform: the platform's name.
        utc_s: returns UTC, s, for the roles' ends in the file.
        now_s: returns the monotonic time, s, for everything else.
        file: the rights; None for none.
        members: the members of the network that may send commands at all; None without a network.
        validity: of the list of revoked members; None where its end has no consequence.
    """

    def __init__(
        self,
        platform: str,
        utc_s: Callable[[], float] = _no_time,
        now_s: Callable[[], float] = _no_time,
        file: RightsFile | None = None,
        members: Iterable[str] | None = None,
        validity: ListValidity | None = None,
    ) -> None:
        self._platform, self._utc_s, self._now_s = platform, utc_s, now_s
        self._given: dict[str, _Given] = {}
        self._firsts: dict[bytes, _First] = {}
        self.adopt(file, members, validity)

    def adopt(
        self, file: RightsFile | None, members: Iterable[str] | None = None, validity: ListValidity | None = None
    ) -> None:
        """Replaces the file and the members; given roles remain as long as their givers are commanders."""
        self._file, self._validity = file, validity
        self._members = None if members is None else tuple(members)

    @property
    def is_open(self) -> bool:
        """Whether there is no file."""
        return self._file is None

    # --- roles ---

    def held(self, member: str) -> list[HeldRole]:
        """The roles that a member has now for the platform; observer alone where it has none."""
        if member == ITSELF:
            return [HeldRole(Role.COMMANDER), HeldRole(Role.MAINTAINER)]
        if not self._is_member(member):
            return [HeldRole(Role.OBSERVER)]
        given = self._given.get(member)
        if given is not None and (given.end_s <= self._now_s() or not self._is_commander(given.held.by)):
            del self._given[member]
            given = None
        if given is not None and given.held.role is Role.OBSERVER:
            return [given.held]
        return [*([] if given is None else [given.held]), *self._filed(member)] or [HeldRole(Role.OBSERVER)]

    def _filed(self, member: str) -> list[HeldRole]:
        """The roles in the file that have not ended."""
        found = [
            HeldRole(entry.role, entry.until_s, tuple(entry.may)) for entry in self._named() if entry.member == member
        ]
        return [held for held in found if held.until_s is None or held.until_s > self._utc_s()]

    def _is_commander(self, member: str) -> bool:
        return self._is_member(member) and any(Right.APPOINT in ROLES[held.role] for held in self._filed(member))

    def _is_member(self, member: str) -> bool:
        """Whether a member may command at all; one that was revoked may not, by a radio's key either."""
        return member in ("", ITSELF) or self._members is None or member in self._members

    def _unconfirmed(self, member: str) -> str:
        """Why a member is limited to what is safe; empty where it is not."""
        validity = self._validity
        if member in ("", ITSELF) or validity is None or validity.end_s > self._utc_s():
            return ""
        return (
            f"list {validity.number} of revoked members has ended on {utc_text(validity.end_s)} UTC, so that {member} may "
            "only look, hold, pause, abort, return and land: gloc3 network confirm, and push it"
        )

    def may(self, member: str, right: Right) -> bool:
        """Whether a member has a right now."""
        if right not in SAFE_RIGHTS and self._unconfirmed(member):
            return False
        if self.is_open:
            return self._is_member(member)
        return any(right in ROLES[held.role] for held in self.held(member))

    def may_alone(self, member: str, rights: Iterable[Right]) -> bool:
        """Whether a member has rights without a second person, and without limits to some capabilities."""
        if self._unconfirmed(member):
            return False
        if self._file is None:
            return self._is_member(member)
        wanted = frozenset(rights)
        is_alone = wanted.isdisjoint(self._file.two_persons) and all(self.may(member, right) for right in wanted)
        return is_alone and (Right.FLY not in wanted or self._capabilities(member) is None)

    def check(self, member: str, body: AnyBody) -> None:
        """Checks a request.

        Args:
            member: whose rights it has; empty for a link that stands for no member.
            body: the request.

        Raises:
            Refused: the member has no right to it; names the role that has.
        """
        if not is_safe(body) and (reason := self._unconfirmed(member)):
            raise Refused(reason)
        for right in sorted(rights_for(body)):
            self.require(member, right)
        if isinstance(body, RequestAction):
            self.check_capabilities(member, [body.capability])

    def check_demand(self, member: str) -> None:
        """Checks velocity demands.

        Raises:
            Refused: the member may not steer by hand.
        """
        if reason := self._unconfirmed(member):
            raise Refused(reason)
        self.require(member, Right.FLY)
        self.check_capabilities(member, [TELEOPERATE])

    def require(self, member: str, right: Right) -> None:
        """Checks a right.

        Raises:
            Refused: the member does not have it.
        """
        if self.may(member, right):
            return
        if not self._is_member(member):
            raise Refused(f"{member} is no operator of the network, or was revoked")
        if right not in SAFE_RIGHTS and (reason := self._unconfirmed(member)):
            raise Refused(reason)
        roles = [role for role in Role if right in ROLES[role]]
        needed = f"{MEANINGS[right]} needs the role {listed(roles, 'or')} of {self._platform}"
        if not member:
            raise Refused(
                f"{needed}, and this link stands for no member; name one for its key (members: in the platform file)"
            )
        own = self.held(member)
        holders = sorted({entry.member for entry in self._named() if right in ROLES[entry.role]} - {member})
        whose = f"; {listed(holders, 'and')} {'has' if len(holders) == 1 else 'have'} it" if holders else ""
        raise Refused(f"{needed}: {member} is {listed([str(one) for one in own], 'and')}{whose}")

    def check_capabilities(self, member: str, capabilities: Iterable[str]) -> None:
        """Checks the capabilities of actions.

        Raises:
            Refused: the member is limited to others.
        """
        allowed = self._capabilities(member)
        for capability in capabilities:
            if allowed is not None and capability not in allowed:
                raise Refused(
                    f"{member} may not use {capability} of {self._platform}, only {listed(sorted(allowed), 'and')}"
                )

    def _capabilities(self, member: str) -> set[str] | None:
        """What a member's flying is limited to; None where it is not, or where it may not fly."""
        flying = [held for held in self.held(member) if Right.FLY in ROLES[held.role]]
        if self.is_open or not flying or any(not held.may for held in flying):
            return None
        return {name for held in flying for name in held.may}

    def summary(self, member: str) -> MemberRights:
        """What a member may do, for its screen."""
        if self._file is None:
            return MemberRights()
        refusals = {}
        for right in Right:
            try:
                self.require(member, right)
            except Refused as refusal:
                refusals[right.value] = str(refusal)
        two = [right.value for right in self._file.two_persons]
        return MemberRights(self.held(member), refusals, two)

    # --- given roles ---

    def appoint(self, by: str, member: str, role: str, for_s: float) -> str:
        """Gives a member a role for some time; returns the answer.

        Raises:
            Refused: it cannot be given.
        """
        if self.is_open:
            raise Refused("this network has no rights.yaml, so everyone has all rights of the link; add one first")
        if role not in GIVEN:
            raise Refused(f"{role!r} cannot be given for a time; {nearest(role, list(GIVEN))}")
        members = list(self._members or ())
        if member not in members:
            raise Refused(f"{member!r} is no operator of the network; {nearest(member, members)}")
        if self._is_commander(member):
            raise Refused(f"{member} is commander of {self._platform}; only rights.yaml changes that")
        if not 0.0 < for_s <= LONGEST_S:
            raise Refused(f"a role is given for more than 0 s, at most {LONGEST_S:.0f} s")
        if len(self._given) >= MOST_GIVEN and member not in self._given:
            raise Refused(f"{MOST_GIVEN} roles are given already; take one back first")
        until_s = self._utc_s() + for_s
        self._given[member] = _Given(HeldRole(Role(role), until_s, by=by), self._now_s() + for_s)
        return f"{member} is {role} of {self._platform} until {utc_text(until_s)} UTC"

    def dismiss(self, member: str) -> str:
        """Takes a given role back; returns the answer.

        Raises:
            Refused: none is given.
        """
        if self._given.pop(member, None) is None:
            raise Refused(f"{member!r} has no given role; {nearest(member, list(self._given))}")
        return f"{member} is {listed([held.role for held in self.held(member)], 'and')} of {self._platform} again"

    # --- two persons ---

    def note(self, member: str, body: AnyBody) -> str:
        """Notes a request of a station that does not hold control as the first of two; returns what to answer.

        Empty where one person is enough, so that the request is none without control.
        """
        needed = self._two_persons(body, (Right.FENCE_OFF,) if isinstance(body, FLIGHTS) else ())
        if not needed:
            return ""
        self._first(self._digest(body), member)
        return (
            f"{MEANINGS[needed[0]]} needs two persons: noted for {member}; the station in control has to request the "
            f"same within {SECOND_S:.0f} s"
        )

    def second(self, member: str, body: AnyBody, extra: Iterable[Right] = ()) -> str:
        """Admits a request that needs two persons; returns who the first one was, empty if one is enough.

        Args:
            member: who requests it.
            body: the request.
            extra: rights that it needs besides.

        Raises:
            Refused: it is the first of two, or its sender is the first again.
        """
        needed = self._two_persons(body, extra)
        if not needed:
            return ""
        key = self._digest(body)
        first = self._firsts.get(key)
        is_other = first is not None and first.end_s > self._now_s() and first.member != member
        if first is not None and is_other and all(self.may(first.member, right) for right in needed):
            del self._firsts[key]
            return first.member
        self._first(key, member)
        raise Refused(
            f"{MEANINGS[needed[0]]} needs two persons: noted for {member}; a second one with the right has to request "
            f"the same within {SECOND_S:.0f} s"
        )

    def _first(self, key: bytes, member: str) -> None:
        now_s = self._now_s()
        self._firsts = {key: first for key, first in self._firsts.items() if first.end_s > now_s}
        self._firsts.pop(key, None)
        self._firsts[key] = _First(member, now_s + SECOND_S)
        if len(self._firsts) > MOST_GIVEN:
            del self._firsts[next(iter(self._firsts))]

    def _two_persons(self, body: AnyBody, extra: Iterable[Right]) -> list[Right]:
        """Which of the rights that a request needs need two persons."""
        two = () if self._file is None else self._file.two_persons
        return sorted({*rights_for(body), *extra}.intersection(two))

    @staticmethod
    def _digest(body: AnyBody) -> bytes:
        own = {name: "" for name in IDENTITIES if hasattr(body, name)}
        return blake2s(msgspec.msgpack.encode(msgspec.structs.replace(body, **own))).digest()

    def _concerns(self, of: Iterable[str]) -> bool:
        groups = self._file.groups if self._file is not None else {}
        return any(name in (ALL, self._platform) or self._platform in groups.get(name, ()) for name in of)

    def _named(self) -> list[RightsEntry]:
        return [entry for entry in self._file.rights if self._concerns(entry.of)] if self._file is not None else []
