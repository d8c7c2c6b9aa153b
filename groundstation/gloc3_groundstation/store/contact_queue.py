"""Missions queued for the next contact with their platforms; each is sent once, whole and in order.

Nothing else is queued. Motion commands and emergencies are meant for the moment of the request: the link gives them up
after some seconds, so that they are never executed unexpectedly later.
"""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Final

import msgspec
from msgspec.structs import replace

from gloc3.clock import passed
from gloc3.errors import Gloc3Error, InputError, Refused
from gloc3.messages.envelope import Severity
from gloc3.mission.model.model import digest_of
from gloc3.mission.model.states import ActionState
from gloc3.store import DocumentFile
from gloc3_groundstation.desk import flights
from gloc3_groundstation.missions.plans import CheckedPlan
from gloc3_groundstation.station.command_client import Declined, NotDelivered, Unanswered
from gloc3_groundstation.station.snapshots import Fleet
from gloc3_groundstation.station.station import Station

SETTLE_S: Final = 1.0
"""After the begin of a contact, so that its summary and the platform's present state are here first."""
AGAIN_S: Final = 2.0
FILE: Final = "queue.json"


class Queued(msgspec.Struct, frozen=True, kw_only=True):
    """A mission that waits."""

    number: int
    """In the order in which they were queued, over all platforms."""
    platform: str
    plan: CheckedPlan


class ContactQueue:
    """Requests that wait for the next contact.

    Args:
        station: brings them over.
        path: the file that keeps what waits, over restarts of the station; None for none.
    """

    def __init__(self, station: Station, path: Path | None = None) -> None:
        self._station = station
        self._file = None if path is None else DocumentFile(path, list[Queued])
        self._waiting: list[Queued] = []
        self._count = 0
        self._tasks: dict[str, asyncio.Task[None]] = {}
        self._ended: dict[int, Gloc3Error | None] = {}
        self._listeners: list[Callable[[], None]] = []
        self._load()
        self._unlisten = station.listen(self._send_on_contact)

    def add(self, platform: str, plan: CheckedPlan) -> Queued:
        """Queues a mission for the next contact."""
        self._count += 1
        queued = Queued(number=self._count, platform=platform, plan=plan)
        self._waiting.append(queued)
        self._keep()
        turn = f", after {len(self.of(platform)) - 1} other(s)" if len(self.of(platform)) > 1 else ""
        self._note(
            platform, Severity.NOTICE, f"{plan.title!r} is queued for the next contact{turn}; it is not started then"
        )
        self._send_on_contact(self._station.fleet, self._station.fleet, self._station.now_s())
        return queued

    def of(self, platform: str) -> list[Queued]:
        """What waits for a platform, in its order; the one that is being sent is the first."""
        return [queued for queued in self._waiting if queued.platform == platform]

    def withdraw(self, platform: str) -> bool:
        """Withdraws the last mission queued for a platform; returns whether there was one that is not being sent."""
        waiting = self.of(platform)
        if not waiting or (len(waiting) == 1 and platform in self._tasks):
            return False
        self._end(waiting[-1], Refused("withdrawn"))
        self._note(platform, Severity.NOTICE, f"{waiting[-1].plan.title!r} is withdrawn: it is not sent")
        return True

    async def ended(self, queued: Queued) -> Gloc3Error | None:
        """Waits until one has been sent, refused or withdrawn; why it was not sent, or None."""
        changed = asyncio.Event()
        self._listeners.append(changed.set)
        try:
            while queued.number not in self._ended:
                changed.clear()
                await changed.wait()
        finally:
            self._listeners.remove(changed.set)
        return self._ended[queued.number]

    def close(self) -> None:
        """Sends nothing more; what waits is kept."""
        self._unlisten()
        for task in self._tasks.values():
            task.cancel()

    def _send_on_contact(self, _before: Fleet, after: Fleet, now_s: float) -> None:
        """Begins to send where there is contact."""
        for name in dict.fromkeys(queued.platform for queued in self._waiting):
            platform = after.get(name)
            if platform is None or platform.is_quiet_link(now_s) or name in self._tasks:
                continue
            task = self._tasks[name] = asyncio.get_running_loop().create_task(self._send_all(name))
            task.add_done_callback(lambda _, name=name: self._tasks.pop(name, None))  # type: ignore[misc]

    async def _send_all(self, name: str) -> None:
        """Sends what waits for a platform, one after the other, as long as there is contact."""
        await passed(SETTLE_S)
        while (waiting := self.of(name)) and not self._is_silent(name):
            queued = waiting[0]
            if self._is_sending(name):
                self._note(name, Severity.INFO, f"{queued.plan.title!r} waits for the end of the running mission")
                await flights.until(self._station, lambda: self._is_silent(name) or not self._is_sending(name))
                continue
            try:
                await self._bring(queued)
            except Unanswered as error:  # the contact is lost: it goes on at the next
                self._note(name, Severity.WARNING, f"{queued.plan.title!r} stays queued: {error}")
                await passed(AGAIN_S)
            except InputError as error:
                self._refuse(queued, error, str(error.findings[0]))
            except NotDelivered:
                await passed(AGAIN_S)
            except Declined as error:
                self._refuse(queued, error, str(error))
            except Gloc3Error as error:
                if self._is_silent(name):
                    await passed(AGAIN_S)
                else:
                    self._refuse(queued, error, str(error))
            else:
                self._end(queued, None)

    async def _bring(self, queued: Queued) -> None:
        """Sends one, unless the platform has it already from an attempt whose result was not received."""
        known = self._station.fleet.get(queued.platform)
        held = known.mission.value if known is not None and known.mission is not None else None
        if held is not None and held.digest == digest_of(queued.plan.text) and held.state == "waiting":
            self._note(queued.platform, Severity.INFO, f"{queued.plan.title!r} is there already")
            return
        await flights.stream(self._station, queued.platform, queued.plan, is_far_ok=True)  # it is not started

    def _is_sending(self, name: str) -> bool:
        """Whether a platform is busy with a mission that cannot be replaced."""
        platform = self._station.fleet.get(name)
        mission = platform.mission.value if platform is not None and platform.mission is not None else None
        return mission is not None and mission.state in (ActionState.RUNNING, ActionState.PAUSED)

    def _is_silent(self, name: str) -> bool:
        platform = self._station.fleet.get(name)
        return platform is None or platform.is_quiet_link(self._station.now_s())

    def _refuse(self, queued: Queued, error: Gloc3Error, reason: str) -> None:
        self._end(queued, error)
        self._note(
            queued.platform, Severity.ERROR, f"{queued.plan.title!r} was refused, and is no longer queued: {reason}"
        )

    def _end(self, queued: Queued, error: Gloc3Error | None) -> None:
        self._waiting = [one for one in self._waiting if one.number != queued.number]
        self._ended[queued.number] = error
        self._keep()
        for monitor in tuple(self._listeners):
            monitor()

    def _note(self, platform: str, severity: Severity, text: str) -> None:
        self._station.note(platform, severity, text)

    # --- the file ---

    def _load(self) -> None:
        kept = self._file.read() if self._file is not None else None
        self._report_problem()
        if kept is None:
            return
        self._waiting = [replace(queued, number=number) for number, queued in enumerate(kept, 1)]
        self._count = len(kept)
        for queued in self._waiting:
            self._note(queued.platform, Severity.NOTICE, f"{queued.plan.title!r} is queued from an earlier session")

    def _keep(self) -> None:
        if self._file is not None:
            self._file.write(self._waiting)
            self._report_problem()

    def _report_problem(self) -> None:
        if self._file is not None and self._file.problem:
            self._note("", Severity.WARNING, f"contact queue: {self._file.problem}")
