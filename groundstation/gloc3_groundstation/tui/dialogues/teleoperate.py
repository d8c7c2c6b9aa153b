"""Dialogue for teleoperation of a vehicle with a companion; shows whether the vehicle follows."""

import asyncio
from collections.abc import Callable

from gloc3.messages.command_interface import Verb
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.desk.teleoperation import FullSpeed, Hand, HandControl
from gloc3_groundstation.tui.dialogues.by_hand import ByHandDialogue
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.views.teleoperation import TeleoperationView, helm_lines
from gloc3_groundstation.tui.widgets.lines import Line


class TeleoperateDialogue(ByHandDialogue):
    """Steers the vehicle in view by the velocities that it takes from this station."""

    def __init__(self, desk: Desk, platform: str, capability: str, moment: Callable[[], StationView]) -> None:
        """Creates the dialogue.

        Args:
            desk: sends requests to the vehicle.
            platform: the vehicle.
            capability: its capability for teleoperation.
            moment: returns the current view.
        """
        super().__init__(desk, platform, moment)
        self._capability = capability
        known = desk.missions.platform(platform)
        limits = known.limits if known is not None else None
        self._full = FullSpeed() if limits is None else FullSpeed(limits.speed_m_s, limits.climb_m_s)
        self._begun = ""
        """The vehicle's name for the started action; empty before."""
        self._session = 0

    @property
    def is_begun(self) -> bool:
        """Whether the action is under way."""
        return bool(self._begun)

    def keys(self) -> tuple[tuple[str, str], ...]:
        """What the keys do."""
        return (
            ("enter", "starts; then HOLD to move, release to stop"),
            *self.KEYS,
            ("esc", "ends it: the vehicle holds position"),
        )

    def new_hand(self, loop: asyncio.AbstractEventLoop) -> Hand:
        """Creates what sends velocities."""
        hand = HandControl(self._desk.station.client, loop, self._platform, self._full)
        self._session = hand.session
        return hand

    async def begin(self) -> None:
        """Requests teleoperation."""
        self._begun = await self._desk.missions.request(self._platform, self._capability, {})

    def end(self) -> None:
        """Ends the action."""
        steering = self._desk.missions.steer(self._platform, Verb.ABORT, self._begun)
        self.app.run_worker(steering, exit_on_error=True)

    def helm(self, view: StationView, hand: Hand) -> tuple[Line, ...]:
        """Whether the vehicle follows, and the speeds."""
        platform = view.fleet.get(self._platform)
        self._end_session(platform.mission.value.tasks.get(self._begun) if platform and platform.mission else None)
        helm = TeleoperationView(bool(self._begun), hand.is_kept, hand.sticks, self._full, self._session)
        return helm_lines(platform, helm, self._desk.station.round_trip_s(self._platform), view.now_s)

    def _end_session(self, state: str | None) -> None:
        """The vehicle has ended it: by a policy, by its pilot, by the emergency key."""
        if self._begun and state in ("aborted", "failed", "done", "skipped"):
            assert self._hand is not None
            self._hand.release()
            self._problem = f"ended ({state}); enter requests it again"
            self._begun = ""
