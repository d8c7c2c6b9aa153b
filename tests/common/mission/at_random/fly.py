"""Flies a mission in virtual time: the executor, components that do what they are asked or fail, and what befalls them.

Everything that can be seen from outside goes into a log: what the executor asks for, puts on disk and tells, and what
it is told. The log is all that an observer gets.
"""

from collections.abc import Callable
from heapq import heappop, heappush
from itertools import count
from random import Random
from typing import Any, Literal, NamedTuple

import msgspec

from gloc3.errors import Refused
from gloc3.mission.executing.board import PolicyCondition
from gloc3.mission.executing.executor import MissionExecutor
from gloc3.mission.executing.requests import Cancel, Grant, MissionEvent, Pause, Persist, Request, Resume, Start
from gloc3.mission.executing.restore import restore
from gloc3.mission.executing.snapshot import Snapshot
from gloc3.mission.model.messages import ActionStatus
from gloc3.mission.model.model import Mission
from gloc3.mission.model.policy import Policy
from gloc3.mission.model.states import ActionState
from gloc3.platform.platform import Platform

VERBS = ("pause", "resume", "skip", "abort", "retry", "start")
CONDITIONS = (PolicyCondition.LINK_LOST, PolicyCondition.LOW_BATTERY, PolicyCondition.POSE_LOST)
LIMIT_S = 3000.0
SENSED_EVERY_S = 2.0
MOST_AT_ONCE = 50
"""An executor that is woken so often at one time would be woken for ever."""


class Entry(NamedTuple):
    """Something that was seen."""

    t_s: float
    kind: str
    """Such as `start`, `told` or `command`."""
    what: str = ""
    data: Any = None


class Weather(NamedTuple):
    """What befalls a flight, each as a probability or as a mean time between."""

    failures: float = 0.0
    """Share of the actions that fail, are refused, or fall silent."""
    slow: float = 0.0
    """Share of the actions that take twenty times as long."""
    obstacles: float = 0.0
    """Share of the actions in whose way an obstacle is for a while."""
    commands_s: float = 0.0
    """Time between commands of operators at random; 0 for none."""
    troubles_s: float = 0.0
    """Time between conditions, faults, losses and pilots."""
    restarts_s: float = 0.0
    """Time between ends of the process, with whatever it was about to do left undone."""


CALM = Weather()
FAILING = Weather(failures=0.1, slow=0.1)
RESTARTS = Weather(restarts_s=10.0, slow=0.03)
TROUBLED = Weather(slow=0.03, obstacles=0.1, troubles_s=15.0)
STORM = Weather(failures=0.08, slow=0.03, obstacles=0.1, commands_s=6.0, troubles_s=12.0, restarts_s=20.0)


class Command(NamedTuple):
    """What an operator does at one step of a flight."""

    step: int
    verb: str
    target: str


class _Work:
    """An action in the hands of a component."""

    def __init__(self, start: Start, duration_s: float, end: ActionState | None) -> None:
        self.start = start
        self.left_s = duration_s
        self.duration_s = duration_s
        self.end = end
        """None: nothing more is ever heard of it."""
        self.since_s: float | None = None
        """When it began or went on; None while it rests."""
        self.blocked_until_s = 0.0
        """An obstacle is in its way."""

    def progress(self, now_s: float) -> float:
        ran_s = now_s - self.since_s if self.since_s is not None else 0.0
        return min(1.0, 1.0 - (self.left_s - ran_s) / self.duration_s)


class Flight:
    """One flight of one mission, from its start until all is over."""

    def __init__(
        self,
        platform: Platform,
        mission: Mission,
        random: Random,
        weather: Weather,
        commands: tuple[Command, ...] = (),
    ) -> None:
        self._platform = platform
        self._mission = mission
        self._random = random
        self._weather = weather
        self._commands = commands
        self.log: list[Entry] = []
        self.steps = 0
        """Events so far, at each of which a command may come."""
        self._now_s = 0.0
        self._events: list[tuple[float, int, Callable[[], None]]] = []
        self._numbers = count()
        self._executor = MissionExecutor(platform)
        self._disk = b""
        self._work: dict[str, _Work] = {}
        self._is_airborne = False
        self._states: dict[str, str] = {}
        self._is_ending = False
        self._lasts_s = random.choice([100.0, 400.0, 3000.0])
        self._same = 0
        """How often the executor was woken at one time."""

    def run(self) -> list[Entry]:
        """The log of the flight; it ends where the executor refuses to take notice of something."""
        try:
            self._run()
        except Refused as refusal:
            self._see("breaks", str(refusal))
        return self.log

    def _run(self) -> None:
        self._call(lambda: self._executor.load(self._mission, self._now_s))
        self._sense()
        self._steer("start", "")
        for every_s, happen in (
            (self._weather.commands_s, self._command),
            (self._weather.troubles_s, self._problem),
            (self._weather.restarts_s, self._restart),
        ):
            if every_s:
                self._again(every_s, happen)
        while self._now_s < LIMIT_S and not self._is_over():
            if not self._step():
                break
        self._end()

    # --- time ---

    def _later(self, after_s: float, event: Callable[[], None]) -> None:
        heappush(self._events, (self._now_s + after_s, next(self._numbers), event))

    def _again(self, every_s: float, event: Callable[[], None]) -> None:
        def happen() -> None:
            if not self._is_ending:
                event()
                self._again(every_s, event)

        self._later(self._random.expovariate(1.0 / every_s), happen)

    def _step(self, until_s: float = LIMIT_S) -> bool:
        """Lets the next thing happen; false where nothing is left to happen."""
        due_s = self._executor.next_tick_s()
        next_s = self._events[0][0] if self._events else until_s
        if due_s is None and not self._events:
            return False
        if due_s is not None and due_s <= next_s:
            self._now_s = max(self._now_s, due_s)
            self._call(lambda: self._executor.tick(self._now_s))
            self._same = self._same + 1 if self._executor.next_tick_s() == due_s else 0
            if self._same >= MOST_AT_ONCE:
                self._see("spins")
                return False
        elif not self._events:
            return False
        else:
            self._now_s, _, event = heappop(self._events)
            event()
        self.steps += 1
        for command in self._commands:
            if command.step == self.steps:
                self._steer(command.verb, command.target)
        return True

    def _is_over(self) -> bool:
        mission = self._executor.mission
        return mission is not None and not mission.is_open and not self._executor.policy and not self._work

    # --- the executor ---

    def _call(self, report: Callable[[], Any], kind: str = "", what: str = "", data: Any = None) -> None:
        """Tells the executor something (which the log calls by its kind), and does what it asks for."""
        self._see("step")
        if kind:
            self._see(kind, what, data)
        report()
        requests = self._executor.collect(self._now_s)
        self._see_states()
        ends_at = None
        if (
            self._weather.restarts_s
            and self._disk
            and not self._is_ending
            and requests
            and self._random.random() < 0.02
        ):
            ends_at = self._random.randrange(len(requests) + 1)
        for index, request in enumerate(requests):
            if index == ends_at:
                break
            self._do(request)
        if ends_at is not None:
            self._restart()

    def _do(self, request: Request) -> None:
        match request:
            case Persist(snapshot=snapshot):
                self._disk = msgspec.json.encode(snapshot)
                self._see("persist", "", msgspec.to_builtins(snapshot))
            case Grant(action_id=action_id, component=component):
                self._see("grants", action_id, component)
            case MissionEvent(text=text):
                self._see("told", text)
            case Start():
                self._see("start", request.action_id, request)
                self._begin(request)
            case Pause() | Resume() | Cancel():
                self._see(type(request).__name__.lower(), request.action_id, request.component)
                self._change(request)

    def _see(self, kind: str, what: str = "", data: Any = None) -> None:
        self.log.append(Entry(self._now_s, kind, what, data))

    def _see_states(self) -> None:
        mission = self._executor.mission
        states = {target: str(state) for target, state in self._executor.states().items()}
        states[""] = str(mission.state) if mission is not None else ""
        if states != self._states:
            self._states = states
            self._see("states", "", states)

    def _sense(self) -> None:
        """The battery as it is: it lasts some minutes."""
        battery = max(0.1, 0.9 - self._now_s / self._lasts_s)
        readings = {"battery": battery, "height_m": 2.0}
        self._call(lambda: self._executor.sensed(readings, self._now_s), "battery is", "", battery)
        if not self._is_ending:
            self._later(SENSED_EVERY_S, self._sense)

    # --- the components ---

    def _begin(self, request: Start) -> None:
        random = self._random
        is_failing = random.random() < self._weather.failures and not self._is_ending
        kind = random.choice(["refuses", "is deaf", "fails", "aborts", "falls silent"]) if is_failing else ""
        if kind == "is deaf":
            return
        if kind == "refuses":
            self._later(0.02, lambda: self._reply(request.action_id, "start", "busy"))
            return
        duration_s = random.choice([0.3, 2.0, 7.0, 15.0]) * random.uniform(0.5, 1.5)
        duration_s *= 20.0 if random.random() < self._weather.slow and not self._is_ending else 1.0
        ends = {"fails": ActionState.FAILED, "aborts": ActionState.ABORTED, "falls silent": None}
        work = _Work(request, duration_s, ends.get(kind, ActionState.DONE))
        work.since_s = self._now_s
        if self._weather.obstacles and random.random() < self._weather.obstacles and not self._is_ending:
            work.blocked_until_s = self._now_s + random.choice([3.0, 9.0])
        self._work[request.action_id] = work
        self._see("works", request.action_id)
        self._later(random.uniform(0.0, 0.05), lambda: self._reply(request.action_id, "start", ""))
        if request.capability == "take_off":
            self._later(min(0.2, duration_s / 2), lambda: self._fly(True))
        self._expect_end(work)
        self._report(work)

    def _change(self, request: Pause | Resume | Cancel) -> None:
        action_id, work = request.action_id, self._work.get(request.action_id)
        reason = "" if work is not None else "it does not know that action"
        verb = type(request).__name__.lower()
        if work is not None:
            if isinstance(request, Pause) and work.since_s is not None:
                work.left_s -= self._now_s - work.since_s
                work.since_s = None
            elif isinstance(request, Resume):
                work.since_s = self._now_s
                self._expect_end(work)
                self._report(work)
            elif isinstance(request, Cancel):
                del self._work[action_id]
            self._see(
                "rests" if isinstance(request, Pause) else "works" if isinstance(request, Resume) else "ends", action_id
            )
        self._later(0.02, lambda: self._reply(action_id, verb, reason))

    def _expect_end(self, work: _Work) -> None:
        since_s, executor = work.since_s, self._executor
        if work.end is None or (self._is_endless(work.start) and work.end is ActionState.DONE):
            return

        def end() -> None:
            mine = self._work.get(work.start.action_id)
            if mine is work and work.since_s == since_s and executor is self._executor:
                self._finish(work)

        self._later(max(0.0, work.left_s), end)

    def _finish(self, work: _Work) -> None:
        assert work.end is not None
        action_id = work.start.action_id
        del self._work[action_id]
        self._see("ends", action_id)
        if work.start.capability == "land" and work.end is ActionState.DONE:
            self._see("touches down")
            self._later(self._random.choice([0.0, 0.3]), lambda: self._fly(False))
        status = ActionStatus(action_id=action_id, state=work.end, reason="because", progress=1.0)
        self._call(lambda: self._executor.reported(status, self._now_s))

    @staticmethod
    def _is_endless(start: Start) -> bool:
        arguments = start.arguments
        if start.capability == "hold":
            return arguments.get("duration_s") is None
        return start.capability == "record_images" and arguments.get("count") is None

    def _report(self, work: _Work) -> None:
        """At 1 Hz, while it works."""
        since_s = work.since_s

        def report() -> None:
            if self._work.get(work.start.action_id) is not work or work.since_s != since_s:
                return
            action_id, progress = work.start.action_id, work.progress(self._now_s)
            is_blocked = self._now_s < work.blocked_until_s
            status = ActionStatus(
                action_id=action_id, state=ActionState.RUNNING, progress=max(0.0, progress), is_blocked=is_blocked
            )
            self._call(lambda: self._executor.reported(status, self._now_s), "reported", action_id, status.progress)
            self._report(work)

        if work.end is not None:
            self._later(1.0, report)

    def _reply(self, action_id: str, verb: str, reason: str) -> None:
        requested: Any = verb
        self._call(lambda: self._executor.replied(action_id, requested, not reason, reason, self._now_s))

    def _fly(self, is_airborne: bool) -> None:
        self._is_airborne = is_airborne
        kind = "airborne" if is_airborne else "landed"
        self._call(lambda: self._executor.vehicle(is_airborne, self._now_s), kind)

    # --- what befalls it ---

    def _steer(self, verb: str, target: str) -> None:
        executor, before = self._executor, self._executor.snapshot(self._now_s)

        def steer() -> None:
            command = f"{verb} {target}".strip()
            try:
                executor.steer(verb, target, self._now_s, (0.0, 0.0, 0.0))
            except Refused as refusal:
                is_same = executor.snapshot(self._now_s) == before
                self._see("refused" if is_same else "refused and changed", command, str(refusal))
            else:
                self._see("command", command)

        self._call(steer)

    def _command(self) -> None:
        targets = ["", *self._executor.states()]
        self._steer(self._random.choice(VERBS), self._random.choice(targets))

    def _problem(self) -> None:
        random, executor, now_s = self._random, self._executor, self._now_s
        match random.randrange(7):
            case 0 | 1:
                condition, is_on = random.choice(CONDITIONS), random.random() < 0.5
                self._call(lambda: executor.condition(condition, is_on, "trouble", now_s), "condition", str(condition))
            case 2:
                component = random.choice(["flight", "waypoints", "images", "plans"])
                for action_id in [one for one, work in self._work.items() if work.start.component == component]:
                    del self._work[action_id]
                    self._see("ends", action_id)
                self._call(lambda: executor.component_failed(component, "faulty", now_s))
            case 3:
                names = random.sample(sorted(self._platform.capabilities), random.randint(0, 2))
                self._call(lambda: executor.available(dict.fromkeys(names, ("pose",)), now_s))
            case 4:
                has_control = random.random() < 0.4
                self._call(
                    lambda: executor.pilot(has_control, "sticks", now_s), "pilot", "on" if has_control else "off"
                )
            case 5:
                policy = random.choice([Policy.HOLD, Policy.RETURN, Policy.LAND])
                self._call(lambda: executor.component_lost("lamp", policy, "gone", now_s), "condition", "lamp lost")
            case _:
                kind: Literal["hold", "land"] = random.choice(["hold", "land"])
                self._call(lambda: executor.emergency(kind, "ann", now_s), "emergency", kind)

    def _restart(self) -> None:
        """The process ends, and comes back from what is on its disk; the components have forgotten everything."""
        for action_id in self._work:
            self._see("ends", action_id)
        self._work.clear()
        self._see("restarts", "airborne" if self._is_airborne else "on the ground")
        snapshot = msgspec.json.decode(self._disk, type=Snapshot)
        self._executor = restore(self._platform, snapshot, self._read, self._is_airborne, self._now_s)
        self._states = {}
        self._see("restarted")
        self._call(lambda: None)

    def _read(self, text: str) -> Mission:
        assert text == self._mission.text, "the mission on disk is another one"
        return self._mission

    def _end(self) -> None:
        """The weather clears; operators go on where they can, and abort where they cannot."""
        self._is_ending = True
        self._see("clears")
        for condition in CONDITIONS:
            self._call(lambda condition=condition: self._executor.condition(condition, False, "", self._now_s))  # type: ignore[misc]
        self._call(lambda: self._executor.available({}, self._now_s))
        self._call(lambda: self._executor.pilot(False, "", self._now_s), "pilot", "off")
        for attempt in range(12):
            mission = self._executor.mission
            assert mission is not None
            if mission.state is ActionState.WAITING:
                self._steer("start", "")
            if self._executor.policy == "pilot" or mission.state is ActionState.PAUSED:
                self._steer("resume", "")
            for target, state in self._executor.states().items():
                if state is ActionState.PAUSED and (mission.is_open or self._executor.policy):
                    self._steer("resume", target)
                elif state is ActionState.FAILED and mission.is_open:
                    self._steer("skip", target)
            if attempt > 7 and mission.is_open:
                self._steer("abort", "")
            until_s = self._now_s + 60.0
            while self._now_s < until_s and not self._is_over() and self._step(until_s):
                pass
            self._now_s = max(self._now_s, until_s if not self._is_over() else self._now_s)
            if self._is_over():
                break
        self._see("over", str(self._executor.policy), sorted(self._work))
