"""Components that do what the executor asks, and an eye on what it must never do."""

from gloc3.messages.frames import GeoPoint, LocalFrame
from gloc3.mission.executing.board import PolicyCondition
from gloc3.mission.executing.executor import MissionExecutor
from gloc3.mission.executing.requests import Cancel, Grant, MissionEvent, Pause, Persist, ReclaimMotion, Resume, Start
from gloc3.mission.executing.restore import restore
from gloc3.mission.executing.snapshot import Snapshot
from gloc3.mission.model.messages import ActionStatus
from gloc3.mission.model.model import Mission
from gloc3.mission.model.states import TABLE, ActionState
from gloc3.mission.reading.reader import MissionReferences, read_mission
from gloc3.platform.platform import Platform

FRAMES = {"hold": LocalFrame(GeoPoint(39.5, 2.6, 5.0))}


class Rig:
    """An executor with scripted components; every request is answered at once unless told otherwise."""

    def __init__(self, platform: Platform, text: str = "", executor: MissionExecutor | None = None) -> None:
        self.platform = platform
        self.surroundings = MissionReferences.of(platform, frames=FRAMES)
        self.executor = executor or MissionExecutor(platform)
        self.now_s = 0.0
        self.under_way: dict[str, str] = {}
        """Action id to `running` or `paused`, as the components see it."""
        self.components: dict[str, str] = {}
        self.grant = Grant(action_id="", component="")
        self.kept: Snapshot | None = None
        self.log: list[str] = []
        self.started: list[Start] = []
        self.refusing: dict[str, str] = {}
        self.deaf: set[str] = set()
        self.taken_back = 0
        self.seen: dict[str, ActionState] = {}
        if text:
            self.executor.load(self.read(text), 0.0)
            self.settle()

    def read(self, text: str) -> Mission:
        return read_mission(text, "test", self.surroundings)

    # what the tests do

    def start(self) -> None:
        self.steer("start")

    def steer(self, verb: str, target: str = "") -> None:
        self.executor.steer(verb, target, self.now_s)
        self.settle()

    def pass_s(self, seconds: float) -> None:
        """Lets time pass as a caller would: by the executor's own timers, with reports once a second."""
        end_s = self.now_s + seconds
        while self.now_s < end_s:
            due_s = self.executor.next_tick_s()
            assert due_s is None or due_s >= self.now_s - 1e-9, "the executor would be woken for ever"
            self.now_s = min(end_s, self.now_s + 1.0, max(self.now_s, due_s) if due_s is not None else end_s)
            self.executor.tick(self.now_s)
            self.settle()
            for action_id in list(self.under_way):
                if self.components[action_id] not in self.deaf:
                    self.report(action_id, ActionState(self.under_way[action_id]))
            if due_s is not None and due_s <= self.now_s and self.executor.next_tick_s() == due_s:
                raise AssertionError("the executor did nothing at its own time")

    def id_of(self, target: str) -> str:
        """The action id under which a target is under way."""
        return next(action_id for action_id in self.under_way if action_id.startswith(target + "#"))

    def report(
        self, action_id: str, state: ActionState, reason: str = "", progress: float = 0.0, achieved: int = 0
    ) -> None:
        status = ActionStatus(action_id=action_id, state=state, reason=reason, progress=progress, achieved=achieved)
        if state not in (ActionState.RUNNING, ActionState.PAUSED):
            self.under_way.pop(action_id, None)
        self.executor.reported(status, self.now_s)
        self.settle()

    def done(self, target: str) -> None:
        self.report(self.id_of(target), ActionState.DONE)

    def failed(self, target: str, reason: str = "no luck") -> None:
        self.report(self.id_of(target), ActionState.FAILED, reason)

    def fly(self, is_airborne: bool = True) -> None:
        self.executor.vehicle(is_airborne, self.now_s)
        self.settle()

    def arise(self, condition: PolicyCondition, is_on: bool = True) -> None:
        self.executor.condition(condition, is_on, "", self.now_s)
        self.settle()

    def restart(self, is_airborne: bool) -> "Rig":
        """The process ends and comes back; the components have forgotten everything."""
        assert self.kept is not None
        executor = restore(self.platform, self.kept, self.read, is_airborne, self.now_s)
        rig = Rig(self.platform, executor=executor)
        rig.now_s = self.now_s
        rig.seen = {}
        rig.settle()
        return rig

    # what the tests look at

    def state(self, target: str = "") -> str:
        if not target:
            assert self.executor.mission is not None
            return str(self.executor.mission.state)
        return str(self.executor.states()[target])

    def running(self) -> list[str]:
        return sorted(action_id.partition("#")[0] for action_id, state in self.under_way.items() if state == "running")

    # the components

    def settle(self) -> None:
        """Carries out what the executor wants, until it wants nothing more."""
        while requests := self.executor.collect(self.now_s):
            for request in requests:
                match request:
                    case Persist(snapshot=snapshot):
                        self.kept = snapshot
                    case Grant():
                        self.grant = request
                    case Start() | Pause() | Resume() | Cancel():
                        self._answer(request)
                    case ReclaimMotion():
                        self.taken_back += 1
                    case MissionEvent(text=text):
                        self.log.append(text)
            self._watch()
        self._watch()

    def _answer(self, request: Start | Pause | Resume | Cancel) -> None:
        action_id, verb = request.action_id, type(request).__name__.lower()
        self.log.append(f"{verb} {action_id.partition('#')[0]}")
        if isinstance(request, Start):
            self._check_start(request)
            self.started.append(request)
        if request.component in self.deaf:
            return
        reason = self.refusing.get(request.component, "") if verb != "cancel" else ""
        if not isinstance(request, Start) and action_id not in self.under_way:
            reason = "it does not know that action"
        if not reason:
            self.components[action_id] = request.component
            if verb == "cancel":
                del self.under_way[action_id]
            else:
                self.under_way[action_id] = "paused" if verb == "pause" else "running"
        self.executor.replied(action_id, verb, not reason, reason, self.now_s)  # type: ignore[arg-type]

    def _check_start(self, request: Start) -> None:
        """Progress and plan are on disk before; motion is granted before; the component has nothing else to do."""
        target = request.action_id.partition("#")[0]
        assert self.kept is not None
        kept = {name: item.state for program in self.kept.programs for name, item in program.items.items()}
        assert target.startswith("policy.") or kept[target] is ActionState.RUNNING
        assert self.kept.count >= int(request.action_id.partition("#")[2])
        if "motion" in self.platform.capabilities[request.capability].claims:
            assert self.grant.action_id == request.action_id
        assert request.action_id not in self.components, "an action id was used twice"
        busy = [one for one, component in self.components.items() if component == request.component]
        assert not any(self.under_way.get(one) for one in busy) or request.component in self.deaf

    def _watch(self) -> None:
        """The rules that hold at every moment."""
        board = self.executor.board
        for program in board.programs.values():
            for item in (program, *program.items()):
                key = f"{program.name}/{item.level}/{item.target}"
                before = self.seen.get(key, ActionState.WAITING)
                assert item.state is before or item.state in _reachable(before), f"{item}: {before} -> {item.state}"
                self.seen[key] = item.state
            for run in program.actions():
                if run.state is ActionState.RUNNING and not board.has_pilot:
                    after = [run.task.actions[name] for name in run.options.after]
                    earlier = [program.tasks[name] for name in run.task.options.after]
                    assert all(one.has_ended for one in (*after, *earlier)), f"{run} runs too early"
        claimed: dict[str, str] = {}
        for action_id, state in self.under_way.items():
            assignment = board.assignments.by_id.get(action_id)
            if assignment is None or state != "running" or assignment.phase == "paused":
                continue
            for resource in assignment.claims:
                assert resource not in claimed, f"{action_id} and {claimed[resource]} both claim {resource}"
                claimed[resource] = action_id


def _reachable(state: ActionState) -> set[ActionState]:
    """The states that follow by any number of transitions: several may happen in one step."""
    found: set[ActionState] = set()
    waiting = [state]
    while waiting:
        for to in TABLE[waiting.pop()].values():
            if to not in found:
                found.add(to)
                waiting.append(to)
    return found


MISSION = """\
mission: test
frame: hold
on_failure: hold
on_link_loss: hold
on_low_battery: return
on_pose_lost: land
hold_s: 30
tasks:
  depart:
    actions:
      climb:  {take_off: {height_m: 1.5}}
  sweep:
    after: [depart]
    actions:
      wall:   {follow_waypoints: {waypoints_m: [[2, 1, 2], [16, 1, 2]]}}
      photos: {record_images: {camera: ground, every_m: 0.5}, until: wall}
  recover:
    after: [sweep]
    actions:
      home:   {return_home: {}}
      down:   {land: {}, after: [home]}
"""


def flying(platform: Platform, text: str = MISSION) -> Rig:
    """In the middle of the sweep."""
    rig = Rig(platform, text)
    rig.start()
    rig.fly()
    rig.done("depart.climb")
    return rig
