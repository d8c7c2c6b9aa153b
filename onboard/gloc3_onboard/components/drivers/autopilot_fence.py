"""AD: keeps the autopilot's own geofence like that of the loaded mission: uploaded, read back, switched on."""

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

from gloc3.component.component import ActuatorDriver
from gloc3.component.ports import Actuation, Inbox, Input, Output, Result
from gloc3.component.settings import NoSettings
from gloc3.messages.vehicle import AutopilotState, FenceProgress, FenceState, GeoFence
from gloc3.mission.formats.items import FenceArea
from gloc3_onboard.sensors.devices import CommandAnswer

REPORT_PERIOD_S = 1.0
RETRY_S = 5.0
ON_S = 3.0
"""Time after enabling within which the autopilot must report its fence as enabled, s."""


class FenceControl(Protocol):
    """Interface for giving an autopilot a fence. Nothing blocks."""

    def command_fence(self, areas: Sequence[FenceArea]) -> int:
        """Uploads areas, replacing earlier ones, reads them back and enables the fence; none clear it."""

    @property
    def fence_problem(self) -> str:
        """Reason why the autopilot does not enforce its fence; empty if it does, or does not report it."""

    def state(self) -> AutopilotState:
        """The latest mode and arming state."""

    def answer(self, ticket: int) -> CommandAnswer | None:
        """The answer to a command; None while there is none."""


class SendFence(NamedTuple):
    """Write: the areas to upload."""

    areas: tuple[FenceArea, ...]


class AutopilotFence(ActuatorDriver[NoSettings]):
    """Uploads a fence when it changes; retries after a failure, or when the fence is off before a start.

    It does not touch a fence that it has not set, and keeps its own after the mission: a mission without a fence
    removes it.
    """

    geofence = Input(GeoFence)
    fence_state = Output(FenceState)

    def __init__(self, device: FenceControl) -> None:
        self._control = device
        self._clear()

    def _clear(self) -> None:
        self._digest = ""
        self._wanted: GeoFence | None = None
        """That of the loaded mission; None without a mission."""
        self._is_ours = False
        """Whether the autopilot may hold a fence from here."""
        self._ticket: int | None = None
        self._sent_s = self._answered_s = float("-inf")
        self._state = FenceState(digest="", progress=FenceProgress.NONE)
        self._reported: tuple[FenceState, float] | None = None

    def start(self) -> None:
        """Waits for a fence."""
        self._clear()

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Sends changes, and tracks their result."""
        results: list[Result] = []
        latest = inbox.latest(self.geofence)
        if latest is not None and latest.payload.digest != self._digest:
            self._digest = latest.payload.digest
            self._wanted = latest.payload if self._digest else None
            if self._wanted is not None and (self._wanted.areas or self._is_ours):
                self._set(FenceProgress.UPLOADING)
                results.append(self._send(self._wanted, now_s))
        elif self._state.progress is FenceProgress.UPLOADING and self._ticket is not None:
            self._follow(self._control.answer(self._ticket), now_s)
        elif self._state.progress is FenceProgress.CONFIRMED and not self._control.state().is_armed:
            if self._problem:  # in flight a pilot may have switched it off
                self._set(FenceProgress.FAILED, self._problem)
        elif self._state.progress is FenceProgress.FAILED and now_s - self._sent_s >= RETRY_S and self._wanted:
            self._set(FenceProgress.UPLOADING, self._state.reason)
            results.append(self._send(self._wanted, now_s))
        return [*results, *self._report(now_s)]

    def _send(self, fence: GeoFence, now_s: float) -> Actuation:
        self._sent_s, self._ticket, self._answered_s = now_s, None, float("inf")
        self._is_ours = True
        areas = [
            FenceArea(
                is_inclusion=area.is_inclusion,
                polygon=tuple(area.polygon),
                center=area.center,
                radius_m=area.radius_m,
            )
            for area in fence.areas
        ]
        return Actuation(SendFence(tuple(areas)))

    def _follow(self, answer: CommandAnswer | None, now_s: float) -> None:
        if answer is None:
            return
        self._answered_s = min(self._answered_s, now_s)
        if not answer.is_accepted:
            self._set(FenceProgress.FAILED, "; ".join(filter(None, (answer.reason, self._problem))))
        elif not self._problem:
            self._is_ours = self._wanted is None or bool(self._wanted.areas)
            self._set(FenceProgress.CONFIRMED)
        elif now_s - self._answered_s >= ON_S:
            self._set(FenceProgress.FAILED, self._problem)

    @property
    def _problem(self) -> str:
        """Why the mission's fence is not kept, although the autopilot holds it."""
        return self._control.fence_problem if self._wanted is not None and self._wanted.areas else ""

    def _set(self, progress: FenceProgress, reason: str = "") -> None:
        digest = self._wanted.digest if self._wanted is not None else ""
        self._state = FenceState(digest=digest, progress=progress, reason=reason)

    def _report(self, now_s: float) -> list[FenceState]:
        if self._reported is not None:
            state, reported_s = self._reported
            if state == self._state and now_s - reported_s < REPORT_PERIOD_S - 1e-9:
                return []
        self._reported = (self._state, now_s)
        return [self._state]

    def actuate(self, write: Any) -> None:
        """Begins an upload."""
        self._ticket = self._control.command_fence(write.areas)

    def make_safe(self) -> None:
        """Does nothing: an existing fence is safe."""
