"""The mission executor: a pure state machine that gets events and the time, and returns requests.

Events are passed in by method, each with the time `now_s` in seconds; `take()` then returns the requests that the
caller has to execute, in order. There is one executor per platform, inside its command interface server. Missions,
single tasks and single actions are checked before they are passed in (see `checker`).
"""

from collections.abc import Iterable, Mapping
from math import inf
from typing import Final, Literal

from gloc3.errors import Refused
from gloc3.messages.envelope import Severity
from gloc3.messages.frames import Vector3
from gloc3.messages.summaries import Cause, component_cause
from gloc3.mission.executing import amending, elsewhere, flow, manoeuvres, reactions, steering, takeovers
from gloc3.mission.executing.assignments import MOTION, Assignment
from gloc3.mission.executing.board import BY_OPERATOR, Board, PolicyCondition
from gloc3.mission.executing.items import COMMAND, MISSION, ActionRun, MissionProgram, TaskRun
from gloc3.mission.executing.requests import Grant, Persist, ReclaimMotion, Request
from gloc3.mission.executing.snapshot import Snapshot
from gloc3.mission.model.conditions import Readings
from gloc3.mission.model.messages import ActionStatus
from gloc3.mission.model.model import Mission
from gloc3.mission.model.policy import Policy
from gloc3.mission.model.states import OURS, ActionState, StateTrigger
from gloc3.platform.platform import Platform

PROGRESS_STEP: Final = 0.05
"""Progress of an action after which it is written to disk; also written on each achievement."""

RECLAIM_S: Final = 2.0
"""So long after it was told to take control back a driver may still report the pilot."""

Verb = Literal["start", "pause", "resume", "cancel"]


class MissionExecutor:
    """Runs the loaded mission, and single tasks and actions, on a platform."""

    def __init__(self, platform: Platform) -> None:
        self.board: Final = Board(platform)
        self._due_s = inf
        self._kept_progress: dict[str, float] = {}
        """Progress of each action on disk."""
        self._achieved: dict[str, int] = {}
        self._is_guard_waited_for = False
        """A guard or a loop depends on measured values."""
        self._reported = (False, False)
        """The driver's last report: whether the pilot or the autopilot has control, and whether it is the
        autopilot's failsafe."""
        self._pilot_reason = ""
        """Of the pilot who has control, or had it last."""
        self._reclaimed_s = -inf
        """When control was last taken back."""

    # what operators ask for

    def load(self, mission: Mission, now_s: float) -> None:
        """Stores a checked mission, replacing the previous one.

        Raises:
            Refused: the previous one is running.
        """
        self.refuse_running()
        flow.make_room(
            self.board, mission, [program for name, program in self.board.programs.items() if name != MISSION]
        )
        self.board.program(MISSION, mission)
        self.settle(now_s)

    def amend(self, mission: Mission, now_s: float) -> None:
        """Continues the running mission by another text; raises as `amending.amend`."""
        amending.amend(self.board, mission, now_s)
        self.settle(now_s)

    def refuse_running(self) -> None:
        """Refuses to replace a running mission."""
        loaded = self.board.mission
        if loaded is not None and loaded.is_open:
            raise Refused(f"the mission {loaded.mission.name!r} is {loaded.state}; abort it first")

    def clear(self, now_s: float) -> None:
        """Unloads the mission.

        Raises:
            Refused: it is running.
        """
        self.refuse_running()
        if self.board.programs.pop(MISSION, None) is not None:
            self.board.is_changed = True
        self.settle(now_s)

    def steer(self, verb: str, target: str, now_s: float, home_ned_m: Vector3 | None = None) -> None:
        """Starts, pauses, resumes, skips, aborts or retries the mission, a task or an action.

        Args:
            verb: `start`, `pause`, `resume`, `skip`, `abort` or `retry`.
            target: empty for the mission, `TASK`, or `TASK.ACTION`.
            now_s: the time.
            home_ned_m: position of a vehicle that stands; with `start` and `resume` it must be inside the fence.

        Raises:
            Refused: it is not possible now; nothing has changed.
        """
        commands = [str(t) for t in StateTrigger if t not in OURS]
        if verb not in commands:
            raise Refused(f"no command {verb!r}; known: {', '.join(commands)}")
        board, trigger = self.board, StateTrigger(verb)
        if trigger is StateTrigger.RESUME and not board.is_airborne:
            flow.refuse_outside(board.mission, home_ned_m)
        if trigger is StateTrigger.RESUME and not target and board.has_pilot:
            steering.take_back(board, now_s)
            self.settle(now_s)
            return
        item = board.find(target)
        if isinstance(item, TaskRun) and item.elsewhere and trigger is not StateTrigger.SKIP:
            raise Refused(f"{item.target} belongs to {item.elsewhere}; command it there, or skip it here")
        if trigger not in item.accepted:
            raise Refused(
                f"{trigger} is not accepted in {item.state}; accepted: {', '.join(item.accepted) or 'nothing'}"
            )
        match trigger:
            case StateTrigger.START:
                flow.start_mission(board, item, now_s, home_ned_m)
            case StateTrigger.PAUSE:
                manoeuvres.dismiss(board, now_s)
                board.halt(item, item.level, now_s, BY_OPERATOR)
            case StateTrigger.RESUME:
                steering.resume(board, item, now_s)
            case StateTrigger.SKIP | StateTrigger.ABORT:
                steering.end(board, item, trigger, now_s)
            case StateTrigger.RETRY:
                steering.try_again(board, item, now_s)
        self.settle(now_s)

    def command(self, mission: Mission, now_s: float) -> str:
        """Runs a single task or action, given as a checked mission, at once; the loaded mission is unchanged.

        A `go_to` takes the place of one that was commanded before.

        Returns:
            Its name, under which it can be steered: that of its first task.

        Raises:
            Refused: a resource that it needs is claimed or missing, or its tasks' names are in use.
        """
        board = self.board
        flow.refuse_while_unfit(board)
        flow.make_room(self.board, mission, list(board.programs.values()))
        before = flow.redirected(board, mission)
        flow.check_readiness(board, mission, replaced=before)
        manoeuvres.dismiss(board, now_s)
        name = next(iter(mission.tasks))
        if before is not None:
            board.end_all(before, StateTrigger.ABORT, now_s, f"redirected by {name}")
            board.move(before, StateTrigger.ABORT, now_s, f"redirected by {name}")
        program = board.program(COMMAND + name, mission)
        if board.mission is None or not board.mission.is_open:
            board.policies = mission.policies
        board.move(program, StateTrigger.START, now_s)
        self.settle(now_s)
        return name

    def emergency(self, kind: Literal["hold", "land"], author: str, now_s: float) -> None:
        """The emergency command: overrides any policy and any mission."""
        board, policy = self.board, Policy.HOLD if kind == "hold" else Policy.LAND
        with board.because(Cause.EMERGENCY):
            board.report(Severity.ALERT, f"emergency {kind} by {author}")
            if board.is_operator:
                takeovers.take_back(board)
            elif board.has_pilot:
                board.report(Severity.WARNING, f"{board.controller} has control: no action taken")
                return
            manoeuvres.apply(board, policy, f"emergency {kind} by {author}", now_s, StateTrigger.ABORT, is_ordered=True)
        self.settle(now_s)

    def free_name(self) -> str:
        """A name for a single command's task that is not taken."""
        self.board.assignments.count += 1
        return f"command-{self.board.assignments.count}"

    # facts

    def replied(self, action_id: str, verb: Verb, is_accepted: bool, reason: str, now_s: float) -> None:
        """Handles a component's reply to a function message."""
        assignment = self.board.assignments.by_id.get(action_id)
        if assignment is None or (verb != assignment.verb and is_accepted):
            return
        if is_accepted:
            assignment.requested_s = None
            assignment.received_s = now_s
            assignment.accept()
        else:
            what = f"{assignment.component} refused to {verb}: {reason}"
            flow.lose(self.board, assignment, what, now_s, is_over=verb in ("start", "resume"))
        self.settle(now_s)

    def reported(self, status: ActionStatus, now_s: float) -> None:
        """Handles a component's report on an action."""
        assignment = self.board.assignments.by_id.get(status.action_id)
        if assignment is None:
            return
        assignment.received_s = now_s
        if status.state in (ActionState.RUNNING, ActionState.PAUSED):
            if assignment.verb == "start" and assignment.requested_s is not None:
                assignment.requested_s = None
                assignment.accept()
            if assignment.run is not None and assignment.run.is_motion:
                self._receive_obstacle(status, now_s)
            if assignment.run is None or status.progress == assignment.run.progress:
                return
            self._note_progress(assignment.run, status)
        elif status.state is ActionState.DONE and assignment.run is not None:
            flow.finish_action(self.board, assignment.run, now_s)
        elif status.state in (ActionState.DONE, ActionState.FAILED, ActionState.ABORTED):
            self._ended(assignment, status, now_s)
        self.settle(now_s)

    def stalled(self, by_s: float) -> None:
        """Extends the timeouts after this process has stood still: no component could report in that time."""
        for assignment in self.board.assignments.by_id.values():
            assignment.stalled(by_s)

    def available(self, missing: Mapping[str, tuple[str, ...]], now_s: float) -> None:
        """Sets which capabilities are unavailable, with what each lacks; all others are available."""
        if missing == self.board.missing:
            return
        self.board.missing.replace(missing, now_s)
        self.settle(now_s)

    def needs_direct_landing(self, now_s: float) -> bool:
        """Whether the vehicle shall land, and who performs that has been missing for long: the autopilot can do it alone."""
        manoeuvre = self.board.manoeuvre
        if manoeuvre is None or manoeuvre.policy is not Policy.LAND or manoeuvre.program is not None:
            return False
        missing_s = now_s - self.board.missing.since_s.get("land", now_s)
        return manoeuvre.assignment is None and self.board.is_airborne and missing_s >= manoeuvres.DIRECT_S

    def component_failed(self, component: str, reason: str, now_s: float) -> None:
        """Handles a component that has turned faulty, has left, or is taken away: its actions fail.

        Its capabilities are unavailable until `available` reports them again, so that no retry is wasted on it.
        """
        lost = list(self.board.assignments.of(component))
        if not lost:
            return
        board = self.board
        performed = {name: (component,) for name, row in board.rows.items() if row.performed_by == component}
        board.missing.add({name: missing for name, missing in performed.items() if name not in board.missing}, now_s)
        with board.because(component_cause(component)):
            for assignment in lost:
                flow.lose(board, assignment, f"{component}: {reason}", now_s)
        self.settle(now_s)

    def motion_lost(self, component: str, provides: tuple[str, ...], reason: str, now_s: float) -> None:
        """Handles a component that an operator takes away by force: the actions that need it fail; see `in_use`."""
        self.component_failed(component, reason, now_s)
        with self.board.because(component_cause(component)):
            for assignment in self.board.users(component, provides):
                if assignment.action_id in self.board.assignments.by_id:
                    flow.lose(self.board, assignment, f"{component}: {reason}", now_s)
        self.settle(now_s)

    def component_lost(self, component: str, policy: Policy, reason: str, now_s: float) -> None:
        """Handles the final loss of a component's function: neither a standby nor another attempt is left.

        Args:
            component: its name.
            policy: policy of its row: `hold`, `return`, `land` or `abort`.
            reason: why it is lost.
            now_s: the time.
        """
        board = self.board
        with board.because(component_cause(component)):
            if board.has_pilot:
                board.lost[component], board.is_changed = (policy, reason), True
                board.report(Severity.ERROR, f"{component} is lost ({reason}); {board.controller} has control")
                return
            reactions.lose_component(board, component, policy, reason, now_s)
        self.settle(now_s)

    def restored(self, names: Iterable[str]) -> None:
        """Components that work: those lost while a pilot had control are not lost any more."""
        for name in self.board.lost.keys() & names:
            del self.board.lost[name]
            self.board.is_changed = True

    def vehicle(self, is_airborne: bool, now_s: float) -> None:
        """Whether the vehicle is in the air (also while it takes off or lands)."""
        air = self.board.air
        if not is_airborne and air.stays_down(is_moved=MOTION in self.board.assignments.claims, now_s=now_s):
            self.board.report(Severity.INFO, "the vehicle is still on the ground")
        elif is_airborne == air.is_reported and (is_airborne or not air.has_landed):
            return
        air.is_reported = is_airborne
        if is_airborne:
            if not air.is_taking_off:
                reactions.lifted_off(self.board, now_s)
            air.is_taking_off = False
        else:
            air.has_landed = False
        self.settle(now_s)

    def pilot(
        self, has_control: bool, reason: str, now_s: float, *, is_failsafe: bool = False, reported_s: float = inf
    ) -> None:
        """Whether a human pilot, or the autopilot's failsafe, has taken over, as the driver has reported it at a time."""
        board = self.board
        if (has_control, is_failsafe) == self._reported and not self._has_taken_again(reason, min(reported_s, now_s)):
            self._pilot_reason = reason if board.has_pilot else self._pilot_reason
            return
        self._reported, self._pilot_reason = (has_control, is_failsafe), reason
        if has_control:
            takeovers.begin(board, reason, now_s, is_failsafe=is_failsafe)
        self.settle(now_s)

    def _has_taken_again(self, reason: str, reported_s: float) -> bool:
        """Whether a pilot has control after it was taken back: for another reason, or since the driver has missed that."""
        since_s = reported_s - self._reclaimed_s
        is_pilot_s = self._reported[0] and not self.board.has_pilot
        return is_pilot_s and since_s > 0.0 and (reason != self._pilot_reason or since_s > RECLAIM_S)

    def operated(self, what: str, now_s: float) -> None:
        """An operator has commanded the autopilot itself, while this process was silent: `station 255 sent return`."""
        takeovers.operated(self.board, what, now_s)
        self.settle(now_s)

    def pilot_after_operator(self, reason: str, now_s: float) -> None:
        """A pilot has taken over from what an operator had commanded."""
        if self.board.is_operator:
            takeovers.begin(self.board, reason, now_s, is_failsafe=False)
            self.settle(now_s)

    def failsafe_holds(self, now_s: float) -> None:
        """Changes to the policy hold when the autopilot's failsafe holds the vehicle and no pilot has control."""
        if self.board.has_pilot and self.board.is_failsafe:
            takeovers.failsafe_holds(self.board, now_s)
            self.settle(now_s)

    def failsafe_landed(self, now_s: float) -> None:
        """Ends all programs after the autopilot's failsafe has landed and disarmed the vehicle."""
        if self.board.has_pilot and self.board.is_failsafe:
            takeovers.failsafe_landed(self.board, now_s)
            self.settle(now_s)

    def unattended(self, silent_s: float, now_s: float, *, is_held: bool = False) -> None:
        """Nobody is there who could fly; arguments as of `takeovers.unattended`."""
        takeovers.unattended(self.board, silent_s, now_s, is_held=is_held)
        self.settle(now_s)

    def condition(self, condition: PolicyCondition, is_on: bool, reason: str, now_s: float) -> None:
        """Whether a condition holds; its policy is carried out once, when it arises."""
        if is_on != (condition in self.board.conditions):
            reactions.set_condition(self.board, condition, is_on, reason, now_s)
            self.settle(now_s)

    def sensed(self, readings: Readings, now_s: float) -> None:
        """The measured values of the quantities in conditions; see `conditions.QUANTITIES`."""
        board = self.board
        board.readings = readings
        if self._is_guard_waited_for:
            self.settle(now_s)

    def link(self, silent_s: float, now_s: float) -> None:
        """Time since the last message from the station in control; see `reactions.watch_link`."""
        before = set(self.board.conditions)
        reactions.watch_link(self.board, silent_s, now_s)
        if set(self.board.conditions) != before:
            self.settle(now_s)

    def elsewhere(self, platform: str, state: ActionState, tasks: Mapping[str, ActionState], now_s: float) -> None:
        """Handles a report on another platform's part of the mission.

        Args:
            platform: the other one.
            state: of its mission.
            tasks: its tasks' states.
            now_s: the time.
        """
        elsewhere.reported(self.board, platform, state, tasks, now_s)
        self.settle(now_s)

    def tick(self, now_s: float) -> None:
        """Advances the time."""
        if now_s >= self._due_s:
            self.settle(now_s)

    # what follows

    def next_tick_s(self) -> float | None:
        """When `tick` is due; None if only events can cause a change."""
        return None if self._due_s == inf else self._due_s

    def collect(self, now_s: float) -> list[Request]:
        """The requests since the last call, in order."""
        board = self.board
        requests: list[Request] = []
        if board.is_changed:
            board.is_changed, board.kept_s = False, now_s
            requests.append(Persist(snapshot=board.snapshot(now_s)))
            runs = (run for program in board.programs.values() for run in program.actions())
            self._kept_progress = {run.target: run.progress for run in runs}
        if board.is_taking_back:
            board.is_taking_back = False
            self._reclaimed_s = now_s
            requests.append(ReclaimMotion())
        requests += board.assignments.collect(is_held=board.is_airborne and not board.has_pilot)
        requests += board.reported
        board.reported = []
        return requests

    # what is going on

    @property
    def mission(self) -> MissionProgram | None:
        """The loaded mission with its state."""
        return self.board.mission

    @property
    def policy(self) -> str:
        """The policy that is being carried out, `pilot`, `operator` or `failsafe` while one has control; empty in normal flight."""
        if self.board.has_pilot:
            return self.board.in_control
        manoeuvre = self.board.manoeuvre
        if manoeuvre is None:
            return ""
        return str(manoeuvre.policy) if manoeuvre.contingency is None else manoeuvre.contingency.task

    @property
    def granted(self) -> Grant:
        """The owner of motion, as of the last `collect()`."""
        return self.board.assignments.granted

    def states(self) -> dict[str, ActionState]:
        """The states of all tasks and actions, by `TASK` and `TASK.ACTION`, single commands included."""
        return {item.target: item.state for program in self.board.programs.values() for item in program.items()}

    def progress(self) -> dict[str, float]:
        """Progress of the running actions, 0 to 1, by `TASK.ACTION`."""
        runs = [run for program in self.board.programs.values() for run in program.actions()]
        return {run.target: run.progress for run in runs if run.is_open}

    def claims(self) -> dict[str, str]:
        """Resource to the `TASK.ACTION` that holds it."""
        return {name: assignment.label for name, assignment in self.board.assignments.claims.items()}

    def has_item(self, action_id: str) -> bool:
        """Whether a component performs an action on this executor's request."""
        return action_id in self.board.assignments.by_id

    def in_use(self, component: str, provides: tuple[str, ...] = ()) -> list[str]:
        """Running actions that need a component, including those of a policy.

        Args:
            component: its name.
            provides: the topics that only it publishes, and the component that it substitutes.
        """
        return [assignment.label for assignment in self.board.users(component, provides)]

    def settle(self, now_s: float) -> None:
        """Does everything that can be done now."""
        flow.advance(self.board, now_s)
        while reactions.has_contingency_ended(self.board):
            if reactions.end_contingency(self.board, now_s):
                steering.resume_mission(self.board, now_s)
            flow.advance(self.board, now_s)
        self._due_s = flow.due_s(self.board)
        self._is_guard_waited_for = flow.is_guard_waited_for(self.board)

    def _receive_obstacle(self, status: ActionStatus, now_s: float) -> None:
        """Records since when an obstacle blocks the path; `flow` applies the time limit."""
        board = self.board
        if status.is_blocked and board.blocked_since_s is None:
            board.blocked_since_s = now_s
            self.settle(now_s)
        elif not status.is_blocked and board.blocked_since_s is not None:
            board.blocked_since_s = None
            self.settle(now_s)

    def _note_progress(self, run: ActionRun, status: ActionStatus) -> None:
        run.progress = status.progress
        is_far = abs(status.progress - self._kept_progress.get(run.target, 0.0)) >= PROGRESS_STEP
        if is_far or status.achieved != self._achieved.get(run.target, 0):
            self._achieved[run.target] = status.achieved
            self.board.is_changed = True

    def _ended(self, assignment: Assignment, status: ActionStatus, now_s: float) -> None:
        if assignment.run is None:
            self.board.assignments.drop(assignment, is_over=True)
            manoeuvres.ended(self.board, assignment, status.state, status.reason, now_s)
        else:
            reason = status.reason or f"ended by {assignment.component}"
            flow.lose(self.board, assignment, reason, now_s, is_over=True)

    def snapshot(self, now_s: float) -> Snapshot:
        """What survives the process; `restore.restore` brings it back."""
        return self.board.snapshot(now_s)
