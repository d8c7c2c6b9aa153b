"""Supervision of components that turn faulty or stop reporting, as a pure state machine (DESIGN §7).

Its inputs are statuses, replies and the time. Its outputs are commands for components' LCIs, and verdicts: failure
policies for the mission. Components that share outputs, a primary and its standbys, form a group with one of them in
charge: the one that is not quiet.
"""

from collections.abc import Iterator, Mapping, Sequence
from math import inf
from typing import Final, NamedTuple

from gloc3.component.deployment import ComponentRow, FaultPolicy, OnFault, Reinitialize
from gloc3.component.lci import OPERATING, Command, State, transition
from gloc3.errors import Refused
from gloc3.messages.envelope import CommandReply, CommandRequest, ComponentStatus
from gloc3.messages.summaries import Health, health_of

SILENT_PERIODS: Final = 3.0
"""Status periods without a report after which a component counts as absent."""
SILENT: Final = f"no status for {SILENT_PERIODS:g} periods"
STABLE_S: Final = 30.0
"""Time up after which a component's restart attempts are restored, s."""
KEEP_TRYING_S: Final = 5.0
"""So long after its last attempt a required component is tried once more, as long as the vehicle is under way."""
RESUME_LIMIT_S: Final = 1.0
"""A standby that has not taken over by then is passed over."""
MARGIN_S: Final = 1.0
"""How much longer than the methods may take a reply may take."""

WORST_FIRST: Final = (Health.FAULTY, Health.ABSENT, Health.IDLE, Health.STANDBY, Health.QUIET, Health.WORKING)

HEARTBEAT_STATE: Final[Mapping[Health, int]] = {
    Health.IDLE: 0,
    Health.STANDBY: 3,
    Health.WORKING: 4,
    Health.QUIET: 4,
    Health.ABSENT: 5,
    Health.FAULTY: 5,
}
"""MAV_STATE of the onboard computer's heartbeat: uninit, standby, active, critical. Quiet is active with a flag."""

UP: Final = (Command.INITIALIZE, Command.START)
UP_QUIETLY: Final = (*UP, Command.GOQUIET)


class LciRequest(NamedTuple):
    """A request for a component's LCI."""

    component: str
    request: CommandRequest
    reason: str


class SupervisionVerdict(NamedTuple):
    """A component's function is lost: what its row says is to be done."""

    component: str
    policy: FaultPolicy
    reason: str


Step = LciRequest | SupervisionVerdict


SETTLED_S: Final = 0.5
"""Time after which a working standby takes charge if its primary never came up, s."""


class _Pending(NamedTuple):
    """An order that has not been answered."""

    request_id: str
    is_resume: bool
    until_s: float


class _Watched:
    """What is known of one component."""

    def __init__(self, row: ComponentRow) -> None:
        self.row: Final = row
        policy = row.on_fault
        self.on_fault: Final = policy if isinstance(policy, OnFault) else OnFault(then=policy)
        self.state: State | None = None
        """None: no status yet, left, or silent."""
        self.received_s: float | None = None
        """None while no status is expected."""
        self.reason = ""
        """Why it fails; empty while it does not."""
        self.attempts = 0
        self.due_s: float | None = None
        """When it is re-initialized."""
        self.up_since_s: float | None = None
        self.has_been_up = False
        """Whether it was ever seen working or quiet, or has failed: until then it is still coming."""
        self.pending: _Pending | None = None
        self.left_in: State | None = None
        """The state in which our last order has left it, until it is seen in another one."""
        self.is_passed_over = False
        """Whether it has not taken over when it was told to."""

    @property
    def silent_at_s(self) -> float | None:
        """Time at which it counts as silent unless a status arrives before."""
        return None if self.received_s is None else self.received_s + SILENT_PERIODS * self.row.status_period_s


class _Group:
    """A primary and its standbys."""

    def __init__(self, primary: _Watched, members: list[_Watched]) -> None:
        self.primary: Final = primary
        self.members: Final = members
        self.in_charge = primary
        self.is_lost = False
        """Whether the verdict about the loss of their function has been issued."""

    @property
    def is_handing_over(self) -> bool:
        """Whether a member has been told to take over and has not answered."""
        return any(member.pending is not None and member.pending.is_resume for member in self.members)

    def recover(self, member: _Watched) -> None:
        """A member does not fail any more."""
        member.reason = ""
        if self.in_charge is member:
            self.is_lost = False

    def successor(self, failed: _Watched) -> _Watched | None:
        """The quiet member that takes over, the one that the primary's row names first."""
        wanted = self.primary.on_fault.standby
        if wanted is None:
            return None
        quiet = [member for member in self.members if member.state is State.QUIET and member is not failed]
        ready = [member for member in quiet if member.pending is None and not member.is_passed_over]
        return min(ready, key=lambda member: member.row.name != wanted, default=None)


def _groups_of(everyone: Sequence[_Watched]) -> dict[str, _Group]:
    """Each component's group, by its name; most are alone."""
    groups = {watched.row.name: _Group(watched, [watched]) for watched in everyone}
    for watched in everyone:
        primary = watched.row.standby_for
        if primary in groups and primary != watched.row.name:
            groups[primary].members.append(watched)
            groups[watched.row.name] = groups[primary]
    return groups


class Supervision:
    """Supervises the components of a deployment.

    Args:
        rows: the deployment.
        name: prefix of the requests' ids; unique to a life of the process.
    """

    def __init__(self, rows: Sequence[ComponentRow], name: str = "supervision") -> None:
        self._watched: Final = {row.name: _Watched(row) for row in rows}
        self._groups: Final = _groups_of(list(self._watched.values()))
        self.is_under_way = False
        """Whether the vehicle is in the air: then what is required is tried again and again."""
        self._name = name
        self._orders = 0
        self._next_s = -inf
        """Before that there is nothing to do."""

    # --- what is known ---

    def state(self, component: str) -> State | None:
        """State of a component; None where it has left, is silent, or has never reported."""
        return self._watched[component].state

    def in_charge(self, component: str) -> str:
        """Which of the components that share a component's outputs is the one that is not quiet."""
        return self._groups[component].in_charge.row.name

    @property
    def is_bringing_up(self) -> bool:
        """Whether some component is being brought up again, or will be."""
        return any(watched.due_s is not None or watched.pending is not None for watched in self._watched.values())

    def health(self) -> Health:
        """Health of the platform: the worst of its required components; a quiet one with a substitute is healthy."""
        found = {Health.WORKING}
        for watched in self._watched.values():
            charge = self._groups[watched.row.name].in_charge
            is_standby = watched.state is State.QUIET and charge is not watched and charge.state is State.WORKING
            if watched.row.required and not is_standby:
                found.add(health_of(watched.state))
        return min(found, key=WORST_FIRST.index)

    def check(self, component: str, commands: Sequence[Command]) -> None:
        """Checks commands that another client wants to send.

        Raises:
            Refused: two components with the same outputs would both be active (not quiet).
        """
        watched, state = self._watched[component], self._watched[component].state
        for command in commands:
            if state is not None:
                state = transition(state, command).to
        if state is State.WORKING:
            for other in self._groups[component].members:
                if other is not watched and other.state is State.WORKING:
                    raise Refused(f"{other.row.name} is working and has the same outputs; tell it to go quiet first")

    # --- what happens ---

    def receive_status(self, status: ComponentStatus, now_s: float) -> list[Step]:
        """Handles a component's status; ignores components outside the deployment."""
        watched = self._watched.get(status.name)
        if watched is None:
            return []
        group = self._groups[status.name]
        watched.is_passed_over = watched.is_passed_over and group.is_handing_over
        if watched.received_s is None:  # it comes, or comes back
            self._next_s = -inf
            if watched.pending is None:
                group.recover(watched)
        watched.state = status.state
        watched.received_s = None if status.state is None else now_s
        if watched.pending is not None:  # what we have asked for is under way: its reply decides
            return []
        return list(self._judge(watched, status.cause, now_s))

    def lose(self, component: str, reason: str, now_s: float) -> list[Step]:
        """Marks a component as unreachable; pending commands to it will not be answered."""
        watched = self._watched.get(component)
        if watched is None:
            return []
        steps = list(self._fell_silent(watched, now_s, reason))
        watched.pending = None
        return steps

    def receive_reply(self, reply: CommandReply, now_s: float) -> list[Step]:
        """Handles the reply to one of the supervisor's commands; ignores other replies."""
        watched = self._watched.get(reply.component)
        pending = watched.pending if watched is not None else None
        if watched is None or pending is None or pending.request_id != reply.request_id:
            return []
        self._next_s = -inf
        watched.pending = None
        watched.state = reply.state
        watched.received_s = None if reply.state is None else now_s
        if reply.is_accepted:
            watched.left_in = reply.state
            return list(self._judge(watched, "", now_s))
        return list(self._not_done(watched, pending, reply.reason, now_s))

    def tick(self, now_s: float) -> list[Step]:
        """Runs what is due: attempts, commands without reply, silent components."""
        if now_s < self._next_s:
            return []
        steps: list[Step] = []
        for watched in self._watched.values():
            pending = watched.pending
            if pending is not None and now_s >= pending.until_s:
                watched.pending = None
                steps += self._not_done(watched, pending, "it does not answer", now_s)
            if watched.silent_at_s is not None and now_s >= watched.silent_at_s:
                steps += self._fell_silent(watched, now_s)
            if watched.due_s is not None and now_s >= watched.due_s:
                watched.due_s = None
                watched.attempts += 1
                is_in_charge = self._groups[watched.row.name].in_charge is watched
                steps.append(self._order(watched, UP if is_in_charge else UP_QUIETLY, watched.reason, now_s))
        next_s = self.next_tick_s()
        self._next_s = inf if next_s is None else next_s
        return steps

    def next_tick_s(self) -> float | None:
        """When `tick()` has something to do."""
        times = [
            at_s
            for watched in self._watched.values()
            for at_s in (watched.due_s, watched.silent_at_s, watched.pending.until_s if watched.pending else None)
            if at_s is not None
        ]
        return min(times, default=None)

    # --- what follows ---

    def _judge(self, watched: _Watched, cause: str, now_s: float) -> Iterator[Step]:
        """What follows from a component's state."""
        watched.has_been_up |= watched.state is State.FAULTY or watched.state in OPERATING
        left_in, watched.left_in = watched.left_in, None
        if watched.state is State.FAULTY:
            if not watched.reason or left_in is State.QUIET:
                yield from self._fail(watched, cause or "faulty", now_s)
            return
        group = self._groups[watched.row.name]
        if watched.reason and watched.state is left_in:
            if left_in not in OPERATING:  # it waits for the next attempt
                watched.left_in = left_in
                return
            if left_in is State.QUIET and group.in_charge is watched:  # nobody else has taken over
                yield self._order(watched, (Command.RESUME,), watched.reason, now_s, limit_s=RESUME_LIMIT_S)
                return
        watched.due_s = None
        group.recover(watched)
        if watched.state not in OPERATING:  # somebody took it down, or brings it up
            watched.up_since_s = None
            watched.attempts = 0
            return
        if watched.up_since_s is None:
            watched.up_since_s = now_s
        if watched.state is State.WORKING:
            yield from self._keep_one_publisher(watched, now_s)
        elif group.in_charge.reason and group.in_charge.pending is None:
            yield from self._hand_over(group.in_charge, now_s)

    def _keep_one_publisher(self, watched: _Watched, now_s: float) -> Iterator[Step]:
        """Keeps at most one of a group active: commands the second one to go quiet.

        A standby between its start and going quiet, before the primary is up, is not in charge.
        """
        group = self._groups[watched.row.name]
        if group.in_charge is watched:
            return
        if group.in_charge.state is State.WORKING:
            reason = f"{group.in_charge.row.name} is in charge of the same outputs"
            yield self._order(watched, (Command.GOQUIET,), reason, now_s)
            return
        assert watched.up_since_s is not None
        is_meant = group.in_charge.has_been_up or now_s - watched.up_since_s >= SETTLED_S
        if group.in_charge.pending is None and is_meant:
            group.in_charge = watched

    def _fail(self, watched: _Watched, reason: str, now_s: float) -> Iterator[Step]:
        """A component has failed: a standby takes over, it is re-initialized, or its function is lost; in this order."""
        if watched.up_since_s is not None and now_s - watched.up_since_s >= STABLE_S:
            watched.attempts = 0
        watched.up_since_s = None
        watched.reason = reason
        yield from self._replace(watched, now_s)

    def _replace(self, watched: _Watched, now_s: float) -> Iterator[Step]:
        """What follows as long as a component fails."""
        if self._groups[watched.row.name].in_charge is watched:
            yield from self._hand_over(watched, now_s)
        yield from self._schedule(watched, now_s)

    def _hand_over(self, failed: _Watched, now_s: float) -> Iterator[LciRequest]:
        group = self._groups[failed.row.name]
        successor = group.successor(failed)
        if successor is not None:
            group.in_charge = successor
            reason = f"{failed.row.name}: {failed.reason}"
            yield self._order(successor, (Command.RESUME,), reason, now_s, limit_s=RESUME_LIMIT_S)

    def _schedule(self, watched: _Watched, now_s: float) -> Iterator[SupervisionVerdict]:
        plan: Reinitialize | None = watched.on_fault.reinitialize
        is_left_down = watched.left_in is not None and watched.left_in not in OPERATING
        is_down = watched.state is State.FAULTY or is_left_down
        if is_down and plan is not None and watched.attempts < plan.times:
            watched.due_s = now_s + plan.back_off_s * 2.0**watched.attempts
            self._next_s = -inf
            return
        group = self._groups[watched.row.name]
        if is_down and self.is_under_way and (watched.row.required or group.primary.row.required):
            watched.due_s = now_s + KEEP_TRYING_S
            self._next_s = -inf
        policy = group.primary.on_fault.then
        is_reported = group.is_lost or watched.attempts > (0 if plan is None else plan.times)
        if group.in_charge is watched and policy is not FaultPolicy.IGNORE and not is_reported:
            group.is_lost = True
            yield SupervisionVerdict(watched.row.name, policy, watched.reason)

    def _not_done(self, watched: _Watched, pending: _Pending, reason: str, now_s: float) -> Iterator[Step]:
        """Handles a supervisor's command that was refused, failed, or not answered."""
        group = self._groups[watched.row.name]
        is_taken_down = pending.is_resume and watched.state is not State.QUIET  # by somebody else
        watched.left_in = None if is_taken_down else watched.state
        has_nobody = False
        if pending.is_resume and group.in_charge is watched and watched.state is not State.WORKING:
            watched.is_passed_over = True
            failed = next((member for member in group.members if member is not watched and member.reason), None)
            has_nobody = failed is None
            if failed is not None:
                group.in_charge = failed
                yield from self._hand_over(failed, now_s)
                if group.in_charge is failed and failed.due_s is None and failed.pending is None:
                    yield from self._schedule(failed, now_s)
        is_left_down = watched.reason and watched.left_in not in (None, *OPERATING)
        if watched.state is State.FAULTY or is_left_down or has_nobody:
            if watched.reason:
                yield from self._replace(watched, now_s)
            else:
                yield from self._fail(watched, reason, now_s)

    def _fell_silent(self, watched: _Watched, now_s: float, reason: str = SILENT) -> Iterator[Step]:
        was, watched.state = watched.state, None
        watched.received_s = watched.due_s = watched.left_in = None
        if was in OPERATING or (not watched.reason and (was is State.FAULTY or watched.pending is not None)):
            yield from self._fail(watched, reason, now_s)
        elif watched.reason:
            yield from self._replace(watched, now_s)

    def _order(
        self,
        watched: _Watched,
        commands: Sequence[Command],
        reason: str,
        now_s: float,
        limit_s: float | None = None,
    ) -> LciRequest:
        self._orders += 1
        self._next_s = -inf
        request_id = f"{self._name}-{self._orders}"
        timeout_s = watched.row.timeout_s * len(commands) + MARGIN_S if limit_s is None else limit_s
        is_resume = commands[0] is Command.RESUME
        watched.pending = _Pending(request_id, is_resume, now_s + timeout_s)
        request = CommandRequest(request_id=request_id, command=commands[0], then=tuple(commands[1:]))
        return LciRequest(watched.row.name, request, reason)
