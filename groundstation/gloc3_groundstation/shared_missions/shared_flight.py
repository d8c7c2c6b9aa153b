"""A mission across vehicles in flight: what a vehicle that drops out has not done is assigned to the others."""

from collections.abc import Awaitable, Callable, Mapping, Sequence
from functools import partial
from typing import Final

import msgspec

from gloc3.errors import Gloc3Error, InputError
from gloc3.messages.command_interface import Verb
from gloc3.messages.envelope import Severity
from gloc3.mission.assigning.assignment import written_assignment
from gloc3.mission.model.model import digest_of
from gloc3.mission.model.policy import Policy
from gloc3.mission.model.states import ActionState
from gloc3_groundstation.desk import flights
from gloc3_groundstation.desk.flights import End, Follower
from gloc3_groundstation.missions.plans import CheckedPlan
from gloc3_groundstation.shared_missions.assigning import assigned
from gloc3_groundstation.station.snapshots import PlatformSnapshot
from gloc3_groundstation.station.station import Station

LOST_AFTER_S: Final = 10.0
"""Silence after which a vehicle has dropped out, s."""
OPEN: Final = (ActionState.RUNNING, ActionState.PAUSED)
OVER: Final = (ActionState.DONE, ActionState.SKIPPED)
"""States of a task that nobody has to do any more."""
GIVING_UP: Final = (Policy.RETURN, Policy.LAND)
"""Policies that end a vehicle's part."""


class CrewOptions(msgspec.Struct, frozen=True, kw_only=True):
    """Vehicles for a mission with open tasks."""

    names: tuple[str, ...] = ()
    """Those that take part; empty for all in contact."""
    files: tuple[str, ...] = ()
    """Platform files beside those that are installed."""
    is_reassigning: bool = False
    """Whether the tasks of a vehicle that drops out go to the others without a question."""


class Replacement(msgspec.Struct, frozen=True, kw_only=True):
    """Who does what a vehicle that has dropped out has left."""

    lost: str
    """The vehicle."""
    reason: str
    tasks: tuple[str, ...]
    """That it has left."""
    plan: CheckedPlan | None = None
    """The mission with the new assignment; None where the others cannot do them all."""
    assigned: Mapping[str, tuple[str, ...]] = {}
    """Platform to its tasks in their order."""
    shares: tuple[str, ...] = ()
    """The same with each vehicle's estimate from now, in words."""
    problem: str = ""
    """Why the others cannot."""

    def __str__(self) -> str:
        left = f"{self.lost} has dropped out ({self.reason}) and leaves {', '.join(self.tasks)}"
        return f"{left}: {self.problem or '; '.join(self.shares)}"


Decide = Callable[[Replacement], Awaitable[bool]]
"""Whether the mission goes on like this."""


class SharedFlight:
    """Follows the vehicles of a mission whose tasks were assigned, and replaces those that drop out.

    A vehicle drops out when it is silent for `LOST_AFTER_S`, when its mission ends without being done, or when it returns or
    lands by a policy. Its open tasks go to the others that are still under way; the tasks of these stay where they are. A
    vehicle that has landed is not started again. One that is heard again after its tasks went to others is aborted.

    Args:
        station: in control of all.
        plan: the mission with its assignment.
        files: platform files beside those that are installed.
    """

    def __init__(self, station: Station, plan: CheckedPlan, files: Sequence[str] = ()) -> None:
        self.plan = plan
        self._station, self._files = station, files
        self._shares, self._left_open = written_assignment(plan.text)
        self._followers: dict[str, Follower] = {}
        self._ends: dict[str, End] = {}
        self._done: dict[str, tuple[str, ...]] = {}
        """Platform to its tasks that are over, of those that are under way no more."""
        self._lost: dict[str, str] = {}
        """Vehicles that have dropped out, with the reason."""
        self._undone: dict[str, str] = {}
        """Tasks that nobody does, with the vehicle that has left them."""
        self._replaced: set[str] = set()
        """Lost vehicles whose tasks others have taken, and that have not been aborted."""

    @property
    def is_shared(self) -> bool:
        """Whether it has tasks that others may take over."""
        return bool(self._left_open)

    def begin(self, followers: Mapping[str, Follower]) -> None:
        """Follows a mission that was started."""
        self._followers = dict(followers)

    async def follow(self, decide: Decide) -> End:
        """Follows all vehicles to their ends.

        Args:
            decide: asked for each vehicle that drops out and leaves something that others can do.
        """
        while not self._is_over():
            found: list[str] = []
            await flights.until(self._station, partial(self._has_changed, found))
            for name in found:
                await self._replace(name, decide)
            for name in self._returned():
                await self._abort(name)
        return self._end()

    # --- who is under way ---

    def _has_changed(self, found: list[str]) -> bool:
        """Whether something is to be done; adds the vehicles that have dropped out."""
        found += self._new_losses()
        return bool(found) or self._is_over() or bool(self._returned())

    def _new_losses(self) -> list[str]:
        """The vehicles that have dropped out since the last call; also notes those that are done."""
        now_s, found = self._station.now_s(), []
        for name, follower in self._followers.items():
            known = self._station.fleet.get(name)
            if known is None or name in self._ends or name in self._lost:
                continue
            end = follower.end(known, now_s)
            if end is not None and end.is_done:
                self._ends[name], self._done[name] = end, self._over(known)
            elif reason := _loss(known, end, now_s):
                self._lost[name] = reason
                self._done[name] = self._over(known)
                found.append(name)
        return found

    def _over(self, known: PlatformSnapshot) -> tuple[str, ...]:
        states = known.mission.value.tasks if known.mission is not None else {}
        return tuple(task for task in self._shares.get(known.name, ()) if states.get(task) in OVER)

    def _is_over(self) -> bool:
        return all(name in self._ends or name in self._lost for name in self._followers)

    def _under_way(self) -> list[str]:
        """The vehicles that may take further tasks."""
        found = []
        for name in self._followers:
            known = self._station.fleet.get(name)
            mission = known.mission.value if known is not None and known.mission is not None else None
            if name not in self._ends and name not in self._lost and mission is not None:
                found += [name] if mission.state in OPEN and not mission.policy else []
        return found

    # --- who drops out ---

    async def _replace(self, name: str, decide: Decide) -> None:
        left = [task for task in self._shares.get(name, ()) if task not in self._done[name]]
        self._undone |= dict.fromkeys(left, name)
        free = tuple(task for task in self._undone if task in self._left_open)
        if not free:
            self._station.note(
                name, Severity.WARNING, f"it has dropped out ({self._lost[name]}) and leaves nothing to others"
            )
            return
        found = self._proposed(name, free)
        if found.plan is None:
            self._station.note(name, Severity.ERROR, str(found))
            return
        self._station.note(name, Severity.WARNING, str(found))
        if not await decide(found):
            self._station.note(name, Severity.WARNING, f"{', '.join(free)}: left undone")
            return
        found = self._proposed(name, free)  # the answer may have taken a while
        if found.plan is None:
            self._station.note(name, Severity.ERROR, str(found))
            return
        await self._amend(found, found.plan)

    def _proposed(self, name: str, free: tuple[str, ...]) -> Replacement:
        crew = self._under_way()
        base = Replacement(lost=name, reason=self._lost[name], tasks=free)
        if not crew:
            return msgspec.structs.replace(base, problem="no other vehicle is under way")
        try:
            plan, found = assigned(self._station, self.plan, crew, self._files, self._done, self._shares)
        except InputError as error:
            problem = "; ".join(one.message for one in error.findings if not one.is_warning)
            return msgspec.structs.replace(base, problem=problem)
        except Gloc3Error as error:
            return msgspec.structs.replace(base, problem=str(error))
        return msgspec.structs.replace(base, plan=plan, assigned=found.assigned, shares=tuple(map(str, found.shares)))

    async def _amend(self, found: Replacement, plan: CheckedPlan) -> None:
        """Brings the new text to all that are under way; a vehicle that refuses it goes on by the old one."""
        station, before = self._station, digest_of(self.plan.text)
        self._replaced.add(found.lost)
        for one in self._under_way():
            tasks = found.assigned.get(one, ())
            more = [task for task in tasks if task in found.tasks]
            try:
                await station.client.upload(one, plan.name, plan.text, amends=before)
            except Gloc3Error as error:
                severity = Severity.ERROR if more else Severity.WARNING
                station.note(one, severity, f"it keeps its mission without {', '.join(more) or 'a change'}: {error}")
                continue
            for task in more:
                self._undone.pop(task, None)
            self._shares[one] = tasks
            if more:
                station.note(one, Severity.NOTICE, f"it takes over {', '.join(more)} from {found.lost}")
        self.plan = plan

    def _returned(self) -> list[str]:
        """Lost vehicles that are heard again in the mission whose tasks others do."""
        now_s, found = self._station.now_s(), []
        for name in sorted(self._replaced):
            known = self._station.fleet.get(name)
            is_heard = known is not None and not known.is_quiet_link(now_s)
            if known is not None and is_heard and known.mission is not None and known.mission.value.state in OPEN:
                found.append(name)
        return found

    async def _abort(self, name: str) -> None:
        """Ends the mission of a vehicle that is back, which would do again what others do."""
        self._replaced.discard(name)
        try:
            await self._station.client.steer(name, Verb.ABORT)
        except Gloc3Error as error:
            self._station.note(name, Severity.ERROR, f"it is back, and its mission could not be aborted: {error}")
            return
        self._station.note(name, Severity.WARNING, "it is back, and others do its tasks: its mission is aborted")

    def _end(self) -> End:
        lost = ", ".join(f"{name} dropped out: {reason}" for name, reason in self._lost.items())
        if self._undone:
            tasks = ", ".join(f"{task} of {name}" for task, name in self._undone.items())
            return End(state=ActionState.FAILED, reason=f"not done: {tasks} ({lost})")
        return End(state=ActionState.DONE, reason=lost and f"{lost}; others did its tasks")


def _loss(known: PlatformSnapshot, end: End | None, now_s: float) -> str:
    """Why a vehicle counts as dropped out; empty while it does not."""
    if end is not None:
        return f"its mission is {end.state}" + (f": {end.reason}" if end.reason else "")
    if known.age_s(now_s) >= LOST_AFTER_S and not known.is_silent_as_planned(now_s):
        return f"no message for {LOST_AFTER_S:g} s"
    mission = known.mission.value if known.mission is not None else None
    if mission is not None and mission.policy in GIVING_UP:
        return f"its policy is {mission.policy}"
    return ""
