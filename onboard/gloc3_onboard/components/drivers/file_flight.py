"""Flies another program's plan as it is: upload, start and progress of its items, in steps of a driver's cycle.

The autopilot has the whole plan. After a pause, and after a restart of this computer in flight, the items that it holds are
read and compared, and it goes on at the item where it was.
"""

import math
from typing import Final, NamedTuple, Protocol

from gloc3.errors import Refused
from gloc3.messages.frames import Vector3
from gloc3.messages.vehicle import AutopilotState, DriverState, LandedState, Manoeuvre, ManoeuvreKind, ManoeuvreState
from gloc3.mission.formats.as_it_is import FlyFileOrder
from gloc3.mission.formats.commands import DO_JUMP_TAG, JUMP, command_name
from gloc3_onboard.sensors.devices import CommandAnswer, FileProgress

ON_THE_GROUND: Final = (LandedState.ON_GROUND, LandedState.UNKNOWN)


class FileControl(Protocol):
    """Interface for giving an autopilot the items of a plan. Nothing blocks."""

    def command_file(self, order: FlyFileOrder, *, continue_at: int) -> int:
        """Uploads the items; those that are there already are left when the plan is continued."""

    @property
    def file_progress(self) -> FileProgress:
        """What the autopilot reports of them."""

    def answer(self, ticket: int) -> CommandAnswer | None:
        """The answer to a command; None while there is none."""


class SendFile(NamedTuple):
    """Write: upload the items."""

    order: FlyFileOrder
    continue_at: int


class FileTimes(NamedTuple):
    """Limits of the upload and the start, s."""

    upload_s: float
    repeat_s: float
    start_s: float


class FileOutcome(NamedTuple):
    """What a cycle comes to."""

    progress: float
    reason: str = ""
    achieved: int = 0
    is_done: bool = False
    failure: str = ""
    """Why it has failed; empty while it has not."""
    upload: SendFile | None = None
    manoeuvre: Manoeuvre | None = None


class FileFlight:
    """One plan under way.

    Args:
        control: of the autopilot.
        order: the items.
        done: the last item that an earlier attempt has passed.
        now_s: the time.
        times: limits.
    """

    def __init__(self, control: FileControl, order: FlyFileOrder, done: int, now_s: float, times: FileTimes) -> None:
        self._control, self._order, self._times = control, order, times
        self._passed = done
        self._item = done + 1 if done else 0
        self._has_jumps = any(item.command in (JUMP, DO_JUMP_TAG) for item in order.items)
        self._last = order.last_item
        self._was_armed = done > 0
        self.ticket: int | None = None
        """Of the upload, once it was written."""
        self._is_sent = self._is_held = False
        self._since_s, self._requested_s = now_s, -math.inf

    def restart(self, now_s: float) -> None:
        """Goes on after a pause."""
        self.ticket, self._is_sent, self._is_held = None, False, False
        self._since_s, self._requested_s = now_s, -math.inf

    def update(
        self, action_id: str, autopilot: AutopilotState | None, driver: DriverState | None, now_s: float
    ) -> FileOutcome:
        """One cycle."""
        if autopilot is not None and self._has_come_down(autopilot):
            return self._outcome(is_done=True)
        if not self._is_held:
            return self._upload(now_s)
        return self._fly(action_id, autopilot, driver, now_s)

    def _has_come_down(self, autopilot: AutopilotState) -> bool:
        """Whether the flight has ended on the ground, as the plan has it."""
        was_armed, self._was_armed = self._was_armed, self._was_armed or autopilot.is_armed
        return was_armed and not autopilot.is_armed and self._order.comes_down and self._passed > 0

    def _upload(self, now_s: float) -> FileOutcome:
        answer = self._control.answer(self.ticket) if self.ticket is not None else None
        if answer is not None and answer.is_accepted:
            self._is_held, self._since_s = True, now_s
        elif answer is not None:
            return self._outcome(failure=answer.reason)
        elif now_s - self._since_s > self._times.upload_s:
            return self._outcome(failure=f"the plan was not accepted within {self._times.upload_s:g} s")
        elif not self._is_sent:
            self._is_sent = True
            return self._outcome("uploads the plan", upload=SendFile(self._order, self._item))
        return self._outcome("uploads the plan")

    def _fly(
        self, action_id: str, autopilot: AutopilotState | None, driver: DriverState | None, now_s: float
    ) -> FileOutcome:
        reported = self._control.file_progress
        self._item = reported.current or self._item
        self._passed = max(self._passed, reported.reached)
        is_ours = driver is not None and driver.manoeuvre_id == action_id and self._requested_s > -math.inf
        state = driver.manoeuvre_state if driver is not None and is_ours else None
        is_over = reported.is_complete or (reported.reached >= self._last > 0 and not self._has_jumps)
        if is_over and not self._order.comes_down:
            return self._outcome(is_done=True)
        if state is ManoeuvreState.RUNNING:
            self._since_s = now_s
            return self._outcome(self._words())
        if state is ManoeuvreState.DONE:
            if self._passed >= self._last:
                return self._outcome(is_done=True)
            return self._outcome(failure=f"the autopilot ended its plan after item {self._passed} of {self._last}")
        if now_s - self._since_s > self._times.start_s:
            why = driver.manoeuvre_reason if driver is not None and is_ours else ""
            return self._outcome(failure=f"the autopilot does not fly the plan{': ' + why if why else ''}")
        if now_s - self._requested_s < self._times.repeat_s:
            return self._outcome()
        self._requested_s = now_s
        on_ground = autopilot is not None and (not autopilot.is_armed or autopilot.landed in ON_THE_GROUND)
        may_arm = self._order.may_arm and on_ground and self._passed == 0 and self._order.sets_off
        manoeuvre = Manoeuvre(
            action_id=action_id,
            kind=ManoeuvreKind.PLAN,
            may_arm=may_arm,
            end_ned_m=self._end(),
            comes_down=self._order.comes_down,
        )
        return self._outcome(manoeuvre=manoeuvre)

    def _end(self) -> Vector3 | None:
        """The last place that is not home."""
        places = [place.position_ned_m for place in self._order.path if place.position_ned_m is not None]
        return places[-1] if places else None

    def _words(self) -> str:
        number = min(max(self._item, 1), len(self._order.items))
        return f"item {number} of {len(self._order.items)}, {command_name(self._order.items[number - 1].command)}"

    def _outcome(
        self,
        reason: str = "",
        *,
        is_done: bool = False,
        failure: str = "",
        upload: SendFile | None = None,
        manoeuvre: Manoeuvre | None = None,
    ) -> FileOutcome:
        share = min(1.0, self._passed / max(1, self._last))
        return FileOutcome(share, reason, self._passed, is_done, failure, upload, manoeuvre)


def refuse_unready(order: FlyFileOrder, autopilot: AutopilotState | None) -> None:
    """Refuses a plan that cannot begin where the vehicle is.

    Raises:
        Refused: with the reason.
    """
    if autopilot is None or not autopilot.is_connected:
        raise Refused("the autopilot does not answer")
    is_up = autopilot.is_armed and autopilot.landed not in ON_THE_GROUND
    if order.sets_off and not autopilot.is_armed and not order.may_arm:
        raise Refused("the vehicle is not armed, and the platform file does not allow arming")
    if order.sets_off and not autopilot.is_armed and not autopilot.is_armable:
        why = "; ".join([*autopilot.reasons, *autopilot.doubts]) or "it gives no reason"
        raise Refused(f"the autopilot would not arm: {why}")
    if not order.sets_off and not is_up:
        raise Refused("the plan does not take off, and the vehicle is on the ground")
