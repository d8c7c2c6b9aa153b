"""Actions assigned to components: held resources, requests, and pending replies."""

from collections.abc import Iterator
from enum import StrEnum
from typing import Any, Final

import msgspec

from gloc3.messages.standard_topics import POSE_LOST_S
from gloc3.mission.executing.items import ActionRun
from gloc3.mission.executing.requests import Cancel, Grant, Pause, Request, Resume, Start
from gloc3.mission.model.arguments import Arguments
from gloc3.platform.platform import Capability

MOTION: Final = "motion"
ANSWER_S: Final = POSE_LOST_S
"""A component that has not answered within this time is taken for one that cannot do it; a busy computer may be as late."""
SILENT_S: Final = 5.0
"""Time without a report after which a running action counts as failed, s."""


class AssignmentPhase(StrEnum):
    """Phases of an assignment."""

    STARTING = "starting"
    ACTIVE = "active"
    PAUSED = "paused"


class Assignment:
    """One start of an action at a component."""

    __slots__ = (
        "action_id",
        "capability",
        "claims",
        "component",
        "label",
        "phase",
        "received_s",
        "requested_s",
        "run",
        "verb",
    )

    def __init__(
        self, action_id: str, label: str, capability: str, row: Capability, run: ActionRun | None, now_s: float
    ) -> None:
        self.action_id = action_id
        self.label = label
        """What operators call it."""
        self.capability = capability
        self.component = row.performed_by
        self.claims = row.claims
        self.run = run
        """The action of a program; None for a policy's manoeuvre."""
        self.phase = AssignmentPhase.STARTING
        self.verb = "start"
        """Last request to the component."""
        self.requested_s: float | None = now_s
        """When; None once it is answered."""
        self.received_s = now_s

    def accept(self) -> None:
        """Handles the component's acceptance of the last request."""
        if self.verb in ("start", "resume"):
            self.phase = AssignmentPhase.ACTIVE

    def stalled(self, by_s: float) -> None:
        """Extends the timeouts by a time in which no component could reply or report."""
        self.received_s += by_s
        if self.requested_s is not None:
            self.requested_s += by_s

    def due_s(self) -> float | None:
        """When it counts as lost unless a reply or report arrives."""
        if self.requested_s is not None:
            return self.requested_s + ANSWER_S
        return self.received_s + SILENT_S if self.phase is AssignmentPhase.ACTIVE else None


class Assignments:
    """All assignments, and the requests that they lead to."""

    def __init__(self, hold: Capability | None) -> None:
        self.by_id: dict[str, Assignment] = {}
        self.claims: dict[str, Assignment] = {}
        """Resource to its holder."""
        self.count = 0
        self._hold = Grant(action_id="hold", component=hold.performed_by if hold is not None else "")
        self._granted = Grant(action_id="", component="")
        self._stops: list[Request] = []
        self._starts: list[Request] = []

    @property
    def granted(self) -> Grant:
        """Last announced owner of motion."""
        return self._granted

    def holder(self, row: Capability) -> Assignment | None:
        """Who holds a resource that a capability claims."""
        return next((self.claims[name] for name in row.claims if name in self.claims), None)

    def start(
        self, label: str, capability: str, row: Capability, order: Arguments, run: ActionRun | None, now_s: float
    ) -> Assignment:
        """Hands an action to its component; its resources must be free."""
        for other in [
            o for o in self.by_id.values() if o.component == row.performed_by and o.phase is AssignmentPhase.PAUSED
        ]:
            self.drop(other)
        self.count += 1
        assignment = Assignment(f"{label}#{self.count}", label, capability, row, run, now_s)
        self.by_id[assignment.action_id] = assignment
        self.claims |= dict.fromkeys(row.claims, assignment)
        arguments: dict[str, Any] = msgspec.to_builtins(order)
        self._starts.append(
            Start(
                action_id=assignment.action_id,
                component=assignment.component,
                capability=row.performed_as or capability,
                arguments=arguments,
                progress=run.progress if run is not None else 0.0,
            )
        )
        if run is not None:
            run.action_id = assignment.action_id
        return assignment

    def pause(self, assignment: Assignment, now_s: float) -> None:
        """Pauses the action at its component; its resources are free from now on."""
        self._release(assignment)
        request = self._queued(assignment.action_id)
        if isinstance(request, Start):
            self._drop(assignment)
            self._starts.remove(request)
            return
        assignment.phase, assignment.verb, assignment.requested_s = AssignmentPhase.PAUSED, "pause", now_s
        if request is not None:
            self._starts.remove(request)
            assignment.requested_s = None
        else:
            self._stops.append(Pause(action_id=assignment.action_id, component=assignment.component))

    def resume(self, assignment: Assignment, now_s: float) -> None:
        """Resumes the action at its component; its resources must be free."""
        self.claims |= dict.fromkeys(assignment.claims, assignment)
        assignment.phase, assignment.verb, assignment.requested_s = AssignmentPhase.ACTIVE, "resume", now_s
        assignment.received_s = now_s
        self._starts.append(Resume(action_id=assignment.action_id, component=assignment.component))

    def drop(self, assignment: Assignment, *, is_over: bool = False) -> None:
        """Ends it; the component is notified, unless it has reported the end itself."""
        self._release(assignment)
        self._drop(assignment)
        request = self._queued(assignment.action_id)
        if request is not None:
            self._starts.remove(request)
        if not is_over and not isinstance(request, Start):
            self._stops.append(Cancel(action_id=assignment.action_id, component=assignment.component))

    def of(self, component: str) -> Iterator[Assignment]:
        """Those of a component."""
        return iter([one for one in self.by_id.values() if one.component == component])

    def collect(self, *, is_held: bool) -> list[Request]:
        """Requests since the last call: stops, the new owner of motion, starts.

        Args:
            is_held: whether the hold controller owns motion when no action does.
        """
        owner = self.claims.get(MOTION)
        if owner is not None:
            grant = Grant(action_id=owner.action_id, component=owner.component)
        else:
            grant = self._hold if is_held else Grant(action_id="", component="")
        requests = self._stops
        if grant != self._granted:
            self._granted = grant
            requests.append(grant)
        requests += self._starts
        self._stops, self._starts = [], []
        return requests

    def _queued(self, action_id: str) -> Start | Resume | None:
        found = (r for r in self._starts if isinstance(r, Start | Resume) and r.action_id == action_id)
        return next(found, None)

    def _release(self, assignment: Assignment) -> None:
        for name in assignment.claims:
            if self.claims.get(name) is assignment:
                del self.claims[name]

    def _drop(self, assignment: Assignment) -> None:
        self.by_id.pop(assignment.action_id, None)
        if assignment.run is not None and assignment.run.action_id == assignment.action_id:
            assignment.run.action_id = ""
