"""Plans that ground stations of others upload to the onboard computer, as missions of ours; and ours as such plans.

The loaded mission is the one thing that both sides see: an upload loads one, through the command interface server, which
checks it as any other; a mission that a station of ours has loaded is given to who downloads, where it can be expressed.
"""

from collections.abc import Callable
from typing import Final, NamedTuple

from gloc3.errors import Gloc3Error, Refused
from gloc3.mavlink.message import Address
from gloc3.mavlink.services.mission_server import MissionDialect, MissionServer
from gloc3.mavlink.services.mission_transfers import PlanOffered, SetCurrentRequested
from gloc3.mavlink.services.plan import Plan as Items
from gloc3.mavlink.services.plan import PlanResult, PlanType
from gloc3.messages.command_interface import AnyBody, CiReply, LoadMission, Outcome, ReadMission, Steer, Verb
from gloc3.mission.formats import from_mission, to_mission
from gloc3.mission.formats.items import FenceArea
from gloc3.mission.model.model import digest_of
from gloc3.mission.model.states import ActionState
from gloc3.mission.reading.reader import Surroundings, read_mission
from gloc3.platform.platform import Platform
from gloc3_onboard.companion.asking import Asking
from gloc3_onboard.companion.plan_items import Verdict, fence_of, items_of, judge, plan_of

PATIENCE_S: Final = 5.0
"""So long the command interface may take to load a mission."""
MOST_WARNINGS: Final = 3
READER: Final = "onboard"
"""As whom the loaded mission is read."""
_MISSION_STATES: Final = {
    "": 1,
    ActionState.RUNNING: 3,
    ActionState.PAUSED: 4,
    ActionState.DONE: 5,
}
"""MISSION_STATE: none, active, paused, complete; 2 is not started."""


class _Deciding(NamedTuple):
    """A plan that the server of commands has been asked to load or to forget."""

    offered: PlanOffered
    digest: str
    """Of the mission that is loaded when it is done; empty where none is."""
    before: str
    """Of the mission that was loaded before."""
    until_s: float


class Plans:
    """Serves missions and fences; rally points have no place in a mission.

    Args:
        own: as whom it speaks.
        asking: reaches the command interface server.
        platform: whose missions.
        serves: whom it serves.
        say: takes what people should know, with the reason of each refusal.
    """

    def __init__(
        self,
        own: Address,
        asking: Asking,
        platform: Platform,
        serves: Callable[[Address], bool],
        say: Callable[[str], None],
    ) -> None:
        self.refused = 0
        """Plans that were turned down."""
        self._asking, self._platform, self._say = asking, platform, say
        self.server: Final = MissionServer(
            own,
            check=self._check,
            serves=serves,
            admits=self._admits,
            dialect=MissionDialect(tells_current=False, tells_ids=True),
        )
        self._deciding: dict[PlanType, _Deciding] = {}
        self._fence: tuple[FenceArea, ...] = ()
        self._seen: str | None = ""
        """The digest that was told last; None where it is to be looked at anew."""
        self._followed = ""
        """The digest of the mission that the plans stand for."""
        self._is_uploaded = False
        """Whether that mission was made of an uploaded plan."""

    def tick(self, now_s: float) -> None:
        """Decides on what was uploaded, and keeps the plans in step with the loaded mission."""
        for event in self.server.events():
            match event:
                case PlanOffered():
                    self._decide(event, now_s)
                case SetCurrentRequested(sender=sender):
                    self._say(f"station {sender.system}: a mission cannot be begun at an item; skip tasks instead")
        for deciding in list(self._deciding.values()):
            if deciding.digest and deciding.before != self._asking.mission.digest == deciding.digest:
                self._conclude(deciding, PlanResult.ACCEPTED)  # loaded; its fence may be on its way to the autopilot
            elif now_s >= deciding.until_s:
                self._refuse(deciding, PlanResult.ERROR, "it is not known yet whether the mission was loaded")
        if not self._deciding:
            self._follow()
        state = self._asking.mission.state
        self.server.mission_state = _MISSION_STATES.get(state, 2)

    def next_tick_s(self) -> float | None:
        """When a decision is overdue."""
        return min((deciding.until_s for deciding in self._deciding.values()), default=None)

    def _admits(self, sender: Address) -> bool:
        """Whether somebody may change the plans now."""
        mission = self._asking.mission
        try:
            self._asking.require(sender.system)
            if mission.state in (ActionState.RUNNING, ActionState.PAUSED):
                raise Refused(f"the mission {mission.name!r} is {mission.state}; abort it first")
        except Refused as refusal:
            self.refused += 1
            self._say(f"plan of station {sender.system} refused: {refusal}")
            return False
        return True

    def _check(self, kind: PlanType, items: Items) -> PlanResult | None:
        """What can be said of a plan without asking anybody."""
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
        self._say(f"{kind.name.lower()} refused: {verdict.reason}")
        return verdict.result

    # --- uploads ---

    def _decide(self, offered: PlanOffered, now_s: float) -> None:
        deciding = _Deciding(offered, "", self._asking.mission.digest, now_s + PATIENCE_S)
        try:
            self._asking.require(offered.sender.system)
            match offered.kind:
                case PlanType.MISSION if offered.items:
                    self._load(offered, offered.items, self._fence, now_s)
                case PlanType.MISSION if self._asking.mission.digest:
                    self._ask(deciding, Steer(verb=Verb.CLEAR))
                case PlanType.FENCE:
                    self._take_fence(deciding, now_s)
                case _:
                    self._conclude(deciding, PlanResult.ACCEPTED)
        except Refused as refusal:
            self._refuse(deciding, PlanResult.DENIED, str(refusal))
        except Gloc3Error as error:
            self._refuse(deciding, PlanResult.INVALID, _first_line(str(error)))

    def _take_fence(self, deciding: _Deciding, now_s: float) -> None:
        """A fence belongs to the mission: one that is loaded already is loaded anew, with it."""
        offered = deciding.offered
        areas = fence_of(offered.items)
        assert not isinstance(areas, Verdict)  # it has been checked
        items = self.server.plans[PlanType.MISSION]
        is_ours = self._is_uploaded and self._asking.mission.digest == self._followed and bool(items)
        if is_ours and areas != self._fence:
            self._load(offered, items, areas, now_s)
        else:
            self._conclude(deciding, PlanResult.ACCEPTED)

    def _load(self, offered: PlanOffered, items: Items, fence: tuple[FenceArea, ...], now_s: float) -> None:
        name = f"plan of station {offered.sender.system}"
        limit_m_s = self._platform.limits.speed_m_s
        text, warnings = to_mission(plan_of(items, fence), name, name, limit_m_s)
        for warning in warnings[:MOST_WARNINGS]:
            self._say(str(warning))
        deciding = _Deciding(offered, digest_of(text), self._asking.mission.digest, now_s + PATIENCE_S)
        self._ask(deciding, LoadMission(name=f"{name}.yaml", text=text))

    def _ask(self, deciding: _Deciding, body: AnyBody) -> None:
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
                self._say(f"the plan of station {deciding.offered.sender.system}: {reply.reason}")

        try:
            self._asking.act(deciding.offered.sender, body, ended)
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
        self.server.conclude(offered, result, self._asking.now_s())
        if result is PlanResult.ACCEPTED and deciding.digest and self.server.plans[offered.kind] is not offered.items:
            self._seen, self._followed = None, ""  # loaded, although its sender has changed his mind meanwhile

    def _refuse(self, deciding: _Deciding, result: PlanResult, reason: str) -> None:
        self.refused += 1
        offered = deciding.offered
        self._say(f"{offered.kind.name.lower()} of station {offered.sender.system} refused: {reason}")
        self._conclude(deciding, result)

    # --- the mission that somebody else has loaded ---

    def _follow(self) -> None:
        digest = self._asking.mission.digest
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
            self._asking.ask(READER, ReadMission(), self._read)
        except Refused:
            self._seen = None  # tried again

    def _read(self, reply: CiReply) -> None:
        items: Items = ()
        fence: Items = ()
        self._fence = ()
        try:
            mission = read_mission(reply.text, "loaded mission", Surroundings.of(self._platform))
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
