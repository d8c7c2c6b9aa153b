"""The operator's side of missions with tasks for any platform: assigns them, and asks when a vehicle drops out."""

import asyncio
from collections.abc import Mapping
from typing import Final

from gloc3.errors import Gloc3Error, InputError
from gloc3.messages.envelope import Severity
from gloc3.mission.assigning.assignment import with_assigned
from gloc3_groundstation.desk.flights import Follower
from gloc3_groundstation.desk.mission_desk import MissionDesk
from gloc3_groundstation.missions.plans import CheckedPlan
from gloc3_groundstation.shared_missions.assigning import assigned
from gloc3_groundstation.shared_missions.shared_flight import CrewOptions, Replacement, SharedFlight
from gloc3_groundstation.station.station import Station

QUESTION: Final = "the key v of the mission screen assigns these tasks to the others, or leaves them undone"


class CrewDesk:
    """Assigns the open mission's tasks, and follows a shared mission that was started; refusals become events."""

    def __init__(self, station: Station, missions: MissionDesk) -> None:
        self.options = CrewOptions()
        self.question: Replacement | None = None
        """What the operator is asked: whether others do the tasks of a vehicle that has dropped out."""
        self._station, self._missions = station, missions
        self._answer: asyncio.Future[bool] | None = None
        self._follow: asyncio.Task[None] | None = None

    @property
    def has_unassigned(self) -> bool:
        """Whether the open mission has tasks to assign."""
        draft = self._missions.draft
        return draft is not None and draft.outline is not None and bool(draft.outline.unassigned)

    async def assign(self, name: str | None) -> None:
        """Assigns the open mission's tasks to the vehicles in contact, and writes that into its text.

        Args:
            name: the vehicle for which the text is then checked.
        """
        draft, station = self._missions.draft, self._station
        if draft is None or draft.outline is None:
            return
        now_s = station.now_s()
        names = self.options.names or tuple(
            one.name for one in station.fleet if one.has_companion and one.is_known and not one.is_quiet_link(now_s)
        )
        plan = CheckedPlan(name=draft.name, title=draft.outline.title, text=draft.carried)
        try:
            _, found = await asyncio.to_thread(assigned, station, plan, names, self.options.files)
        except InputError as error:
            for finding in error.findings:
                if not finding.is_warning:
                    station.note("", Severity.ERROR, f"assign: {finding}")
            return
        except Gloc3Error as error:
            station.note("", Severity.ERROR, f"assign: {error}")
            return
        for share in found.shares:
            station.note(share.platform, Severity.INFO, f"assigned to {share}")
        self._missions.edit(with_assigned(draft.text, found.assigned))
        await self._missions.check(name)

    def watch(self, plan: CheckedPlan | None, followers: Mapping[str, Follower]) -> None:
        """Follows a mission that was started, if vehicles share it."""
        flight = SharedFlight(self._station, plan, self.options.files) if plan is not None else None
        if flight is None or not flight.is_shared or not followers:
            return
        flight.begin(followers)
        self.close()
        self._follow = asyncio.get_running_loop().create_task(self._followed(flight))

    async def request_answer(self, found: Replacement) -> bool:
        """Asks the operator, and waits for the answer."""
        self.question, self._answer = found, asyncio.get_running_loop().create_future()
        self._station.note(found.lost, Severity.WARNING, QUESTION)
        return await self._answer

    def answer(self, *, is_agreed: bool) -> None:
        """The operator's answer to the question."""
        self.question = None
        if self._answer is not None and not self._answer.done():
            self._answer.set_result(is_agreed)

    def close(self) -> None:
        """Follows nothing more."""
        if self._follow is not None:
            self._follow.cancel()
        self.question = self._answer = None

    async def _followed(self, flight: SharedFlight) -> None:
        end = await flight.follow(self.request_answer)
        severity = Severity.INFO if end.is_done else Severity.ERROR
        self._station.note("", severity, f"the shared mission is {end.state}" + f": {end.reason}" * bool(end.reason))
