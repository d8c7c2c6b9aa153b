"""Converts plans that other ground stations upload into missions of ours, and our missions into plans.

Both sides share the loaded mission: an upload loads one through the command interface server, with the usual checks; a
download returns a mission loaded by one of our stations, as far as a plan can express it.
"""

import math
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from gloc3.errors import Gloc3Error, Refused
from gloc3.mavlink.message import Address
from gloc3.mavlink.services.mission_server import MissionDialect, MissionServer
from gloc3.mavlink.services.mission_transfers import PlanOffered, SetCurrentRequested
from gloc3.mavlink.services.plan import FRAME_MISSION, PlanItem, PlanResult, PlanType
from gloc3.mavlink.services.plan import Plan as Items
from gloc3.messages.command_interface import (
    OURSELVES,
    AnyBody,
    CiReply,
    LoadMission,
    Outcome,
    ReadMission,
    Steer,
    Verb,
)
from gloc3.mission.formats import from_mission, to_mission
from gloc3.mission.formats.items import FenceArea, ForeignPlan, MavItem, PlanEntry
from gloc3.mission.formats.to_mission import CONVERTED, LEFT_OUT
from gloc3.mission.model.model import digest_of
from gloc3.mission.model.states import ActionState
from gloc3.mission.reading.reader import MissionReferences, read_mission
from gloc3.plan_wire import from_wire, to_wire
from gloc3.platform.platform import Platform
from gloc3_onboard.companion.pending_requests import PendingRequests

TIMEOUT_S: Final = 5.0
"""So long the command interface may take to load a mission."""
MOST_WARNINGS: Final = 3
_MISSION_STATES: Final = {
    "": 1,
    ActionState.RUNNING: 3,
    ActionState.PAUSED: 4,
    ActionState.DONE: 5,
}
"""MISSION_STATE: none, active, paused, complete; 2 is not started."""


class _Deciding(NamedTuple):
    """A plan whose loading or clearing has been requested from the command server."""

    offered: PlanOffered
    digest: str
    """Of the mission that is loaded when it is done; empty where none is."""
    before: str
    """Of the mission that was loaded before."""
    until_s: float


class PlanServer:
    """Serves missions and fences; missions have no rally points.

    Args:
        own: MAVLink address of the server.
        requesting: requests to the command interface server.
        platform: the platform file.
        serves: whether a sender is served.
        report: called with messages for people, including reasons of refusals.
    """

    def __init__(
        self,
        own: Address,
        requesting: PendingRequests,
        platform: Platform,
        serves: Callable[[Address], bool],
        report: Callable[[str], None],
    ) -> None:
        self.refused = 0
        """Plans that were turned down."""
        self._requesting, self._platform, self._report = requesting, platform, report
        self.server: Final = MissionServer(
            own,
            check=self._check,
            serves=serves,
            admits=self._admits,
            dialect=MissionDialect(tells_current=False, tells_ids=True),
        )
        self._waiting: dict[PlanType, PlanOffered] = {}
        """Plans whose turn has not come: mission and fence are loaded together, so one is decided after the other."""
        self._deciding: dict[PlanType, _Deciding] = {}
        self._fence: tuple[FenceArea, ...] = ()
        self._seen: str | None = ""
        """Last seen digest; None to check again."""
        self._followed = ""
        """Digest of the mission that the plans represent."""
        self._is_uploaded = False
        """Whether that mission was made of an uploaded plan."""

    def tick(self, now_s: float) -> None:
        """Decides on uploads, and updates the plans from the loaded mission."""
        for event in self.server.events():
            match event:
                case PlanOffered():
                    self._waiting.pop(event.kind, None)
                    self._waiting[event.kind] = event
                case SetCurrentRequested(sender=sender):
                    self._report(f"station {sender.system}: a mission cannot start at an item; skip tasks instead")
        for deciding in list(self._deciding.values()):
            if deciding.digest and deciding.before != self._requesting.mission.digest == deciding.digest:
                self._conclude(deciding, PlanResult.ACCEPTED)  # loaded; its fence may be on its way to the autopilot
            elif now_s >= deciding.until_s:
                self._refuse(deciding, PlanResult.ERROR, "it is not known yet whether the mission was loaded")
        while self._waiting and not self._deciding:
            offered = self._waiting.pop(next(iter(self._waiting)))
            if self.server.is_pending(offered):
                self._decide(offered, now_s)
        if not self._deciding:
            self._follow()
        state = self._requesting.mission.state
        self.server.mission_state = _MISSION_STATES.get(state, 2)

    def next_tick_s(self) -> float | None:
        """When a decision is overdue."""
        return min((deciding.until_s for deciding in self._deciding.values()), default=None)

    def _admits(self, sender: Address) -> bool:
        """Whether a sender may change the plans now."""
        mission = self._requesting.mission
        try:
            self._requesting.require(sender.system)
            if mission.state in (ActionState.RUNNING, ActionState.PAUSED):
                raise Refused(f"the mission {mission.name!r} is {mission.state}; abort it first")
        except Refused as refusal:
            self.refused += 1
            self._report(f"plan of station {sender.system} refused: {refusal}")
            return False
        return True

    def _check(self, kind: PlanType, items: Items) -> PlanResult | None:
        """Local verdict on a plan, without requests."""
        verdict: Verdict | None = None
        match kind:
            case PlanType.MISSION:
                verdict = judge(items)
            case PlanType.FENCE:
                areas = fence_of(items)
                verdict = areas if isinstance(areas, Verdict) else None
            case PlanType.RALLY if items:
                verdict = Verdict(PlanResult.UNSUPPORTED, "a mission has no rally points: it returns to its home")
            case PlanType.RALLY:
                return PlanResult.ACCEPTED
        if verdict is None:
            return None
        self.refused += 1
        self._report(f"{kind.name.lower()} refused: {verdict.reason}")
        return verdict.result

    # --- uploads ---

    def _decide(self, offered: PlanOffered, now_s: float) -> None:
        deciding = _Deciding(offered, "", self._requesting.mission.digest, now_s + TIMEOUT_S)
        try:
            self._requesting.require(offered.sender.system)
            match offered.kind:
                case PlanType.MISSION if offered.items:
                    self._load(offered, offered.items, self._fence, now_s)
                case PlanType.MISSION if self._requesting.mission.digest:
                    self._request(deciding, Steer(verb=Verb.CLEAR))
                case PlanType.FENCE:
                    self._accept_fence(deciding, now_s)
                case _:
                    self._conclude(deciding, PlanResult.ACCEPTED)
        except Refused as refusal:
            self._refuse(deciding, PlanResult.DENIED, str(refusal))
        except Gloc3Error as error:
            self._refuse(deciding, PlanResult.INVALID, _first_line(str(error)))

    def _accept_fence(self, deciding: _Deciding, now_s: float) -> None:
        """Handles an uploaded fence, which belongs to the mission: a loaded mission is reloaded with it."""
        offered = deciding.offered
        areas = fence_of(offered.items)
        assert not isinstance(areas, Verdict)  # it has been checked
        items = self.server.plans[PlanType.MISSION]
        is_ours = self._is_uploaded and self._requesting.mission.digest == self._followed and bool(items)
        if is_ours and areas != self._fence:
            self._load(offered, items, areas, now_s)
        else:
            self._conclude(deciding, PlanResult.ACCEPTED)

    def _load(self, offered: PlanOffered, items: Items, fence: tuple[FenceArea, ...], now_s: float) -> None:
        name = f"plan of station {offered.sender.system}"
        text, warnings = to_mission(plan_of(items, fence), name, name, self._platform)
        for warning in warnings[:MOST_WARNINGS]:
            self._report(str(warning))
        deciding = _Deciding(offered, digest_of(text), self._requesting.mission.digest, now_s + TIMEOUT_S)
        self._request(deciding, LoadMission(name=f"{name}.yaml", text=text))

    def _request(self, deciding: _Deciding, body: AnyBody) -> None:
        self._deciding[deciding.offered.kind] = deciding

        def ended(reply: CiReply) -> None:
            is_open, is_accepted = self._is_open(deciding), reply.outcome is Outcome.ACCEPTED
            if is_open and is_accepted:
                self._conclude(deciding, PlanResult.ACCEPTED)
            elif is_open:
                is_wrong = bool(reply.text) and reply.outcome is Outcome.REFUSED
                reason = f"{reply.reason}: {_first_line(reply.text)}" if is_wrong else reply.reason
                self._refuse(deciding, PlanResult.INVALID if is_wrong else PlanResult.DENIED, reason)
            elif not is_accepted:
                self._report(f"the plan of station {deciding.offered.sender.system}: {reply.reason}")

        try:
            self._requesting.act(deciding.offered.sender, body, ended)
        except Refused:
            self._deciding.pop(deciding.offered.kind, None)
            raise

    def _is_open(self, deciding: _Deciding) -> bool:
        return self._deciding.get(deciding.offered.kind) is deciding

    def _conclude(self, deciding: _Deciding, result: PlanResult) -> None:
        offered = deciding.offered
        if self._is_open(deciding):
            del self._deciding[offered.kind]
        if result is PlanResult.ACCEPTED:
            if offered.kind is PlanType.FENCE:
                areas = fence_of(offered.items)
                self._fence = () if isinstance(areas, Verdict) else areas
            if deciding.digest:
                self._followed, self._is_uploaded = deciding.digest, True
        self.server.conclude(offered, result, self._requesting.now_s())
        if result is PlanResult.ACCEPTED and deciding.digest and self.server.plans[offered.kind] is not offered.items:
            self._seen, self._followed = None, ""  # loaded, although its sender has changed his mind meanwhile

    def _refuse(self, deciding: _Deciding, result: PlanResult, reason: str) -> None:
        self.refused += 1
        offered = deciding.offered
        self._report(f"{offered.kind.name.lower()} of station {offered.sender.system} refused: {reason}")
        fence = self._waiting.get(PlanType.FENCE)
        if offered.kind is PlanType.MISSION and not offered.items and fence is not None and not fence.items:
            del self._waiting[PlanType.FENCE]  # a mission that cannot be cleared keeps its fence
            self.server.conclude(fence, result, self._requesting.now_s())
        self._conclude(deciding, result)

    # --- the mission that somebody else has loaded ---

    def _follow(self) -> None:
        digest = self._requesting.mission.digest
        if digest == self._seen:
            return
        self._seen = digest
        if digest == self._followed:
            return
        self._followed, self._is_uploaded = digest, False
        if not digest:
            self.server.set_plan(PlanType.MISSION, ())
            return
        try:
            self._requesting.request(OURSELVES, ReadMission(), self._read)
        except Refused:
            self._seen = None  # tried again

    def _read(self, reply: CiReply) -> None:
        items: Items = ()
        fence: Items = ()
        self._fence = ()
        try:
            mission = read_mission(
                reply.text, "loaded mission", MissionReferences.of(self._platform, is_ground_level=True)
            )
            plan, _ = from_mission(mission, "loaded mission")
            items, fence = items_of(plan.items), items_of(plan.fence_items())
        except Gloc3Error:
            pass  # it is in a frame of its own, or does what no plan can tell: there is nothing to download
        else:
            self._fence = plan.fence
        self.server.set_plan(PlanType.MISSION, items)
        self.server.set_plan(PlanType.FENCE, fence)


def _first_line(text: str) -> str:
    return text.strip().partition("\n")[0]


UNITS_PER_DEGREE: Final = 1e7
RETURN_POINT, POLYGON_IN, POLYGON_OUT, CIRCLE_IN, CIRCLE_OUT = range(5000, 5005)
_FRAMES: Final = frozenset({0, 2, 3, 5, 6, 10, 11})
"""Global ones, and that of items without a place."""
_PLACED: Final = frozenset({16, 19, 21, 22, 195, 201})


class Verdict(NamedTuple):
    """Result of a plan's check."""

    result: PlanResult
    reason: str


def judge(items: Items) -> Verdict | None:
    """Problem of the first item that cannot be flown; None if there is none."""
    for number, item in enumerate(items):
        found = _judge_item(item)
        if found is not None:
            return Verdict(found.result, f"item {number}: {found.reason}")
    return None


def _judge_item(item: PlanItem) -> Verdict | None:
    if item.command not in CONVERTED and item.command not in LEFT_OUT:
        return Verdict(PlanResult.UNSUPPORTED, f"command {item.command} cannot be expressed in a mission")
    if item.frame not in _FRAMES:
        return Verdict(PlanResult.UNSUPPORTED_FRAME, f"frame {item.frame} is not supported")
    params = (item.param1, item.param2, item.param3, item.param4)
    for number, value in enumerate(params):
        if math.isinf(value):
            return Verdict(PlanResult(PlanResult.INVALID_PARAM1 + number), f"param{number + 1} is infinite")
    if item.command not in _PLACED or item.frame == FRAME_MISSION:
        return None
    if abs(item.x) > 90 * UNITS_PER_DEGREE:
        return Verdict(PlanResult.INVALID_PARAM5_X, f"latitude {item.x / UNITS_PER_DEGREE:g} is not on Earth")
    if abs(item.y) > 180 * UNITS_PER_DEGREE:
        return Verdict(PlanResult.INVALID_PARAM6_Y, f"longitude {item.y / UNITS_PER_DEGREE:g} is not on Earth")
    if not math.isfinite(item.z):
        return Verdict(PlanResult.INVALID_PARAM7_Z, "its height is not a number")
    return None


def plan_of(items: Items, fence: Sequence[FenceArea]) -> ForeignPlan:
    """Plan for the items of a mission and a fence."""
    return ForeignPlan(entries=tuple(PlanEntry(items=(from_wire(item),)) for item in items), fence=tuple(fence))


def fence_of(items: Items) -> tuple[FenceArea, ...] | Verdict:
    """Areas for the items of a fence, or the problem with them."""
    areas: list[FenceArea] = []
    corners: list[tuple[float, float]] = []
    for number, item in enumerate(items):
        place = (item.x / UNITS_PER_DEGREE, item.y / UNITS_PER_DEGREE)
        if item.frame not in _FRAMES:
            return Verdict(PlanResult.UNSUPPORTED_FRAME, f"item {number}: frame {item.frame} is not supported")
        if item.command in (CIRCLE_IN, CIRCLE_OUT):
            if not (math.isfinite(item.param1) and item.param1 > 0.0):
                return Verdict(PlanResult.INVALID_PARAM1, f"item {number}: a circle without a radius")
            areas.append(FenceArea(is_inclusion=item.command == CIRCLE_IN, center=place, radius_m=item.param1))
        elif item.command in (POLYGON_IN, POLYGON_OUT):
            corners.append(place)
            follows = number + 1 < len(items) and items[number + 1].command == item.command
            if not (math.isfinite(item.param1) and item.param1 >= 3 and len(corners) <= item.param1):
                return Verdict(PlanResult.INVALID_PARAM1, f"item {number}: a polygon of {item.param1:g} corners")
            if len(corners) == item.param1:
                areas.append(FenceArea(is_inclusion=item.command == POLYGON_IN, polygon=tuple(corners)))
                corners = []
            elif not follows:
                return Verdict(PlanResult.INVALID, f"item {number}: a polygon lacks corners")
        elif item.command != RETURN_POINT:
            return Verdict(PlanResult.UNSUPPORTED, f"item {number}: command {item.command} does not belong in a fence")
    return tuple(areas)


def items_of(found: Sequence[MavItem]) -> Items:
    """Items as they are sent.

    Raises:
        Refused: one does not fit the wire.
    """
    return tuple(to_wire(item, f"item {number}") for number, item in enumerate(found))
