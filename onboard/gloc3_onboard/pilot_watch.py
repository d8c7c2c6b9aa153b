"""Tells whether a human pilot, or the autopilot by itself, has taken the vehicle over (DESIGN §7: the pilot wins)."""

from collections.abc import Mapping
from typing import Final

from gloc3.vehicle import AutopilotState, FlightMode

FOLLOWS: Final[Mapping[FlightMode, frozenset[FlightMode]]] = {
    FlightMode.TAKE_OFF: frozenset({FlightMode.TAKE_OFF, FlightMode.HOLD, FlightMode.GUIDED}),
    FlightMode.GUIDED: frozenset({FlightMode.GUIDED}),
    FlightMode.HOLD: frozenset({FlightMode.HOLD}),
    FlightMode.LAND: frozenset({FlightMode.LAND}),
}
"""The modes that a command of ours may lead to, by the mode that was commanded."""

ANSWER_S: Final = 3.0
"""A mode change within this time after our command for it is taken for ours."""


class PilotWatch:
    """Compares the autopilot's modes and arming with what we commanded."""

    def __init__(self) -> None:
        self.has_control = False
        self.reason = ""
        self._expected: FlightMode | None = None
        self._pending: FlightMode | None = None
        self._pending_until_s = 0.0
        self._may_arm = False
        self._seen: AutopilotState | None = None

    def command(self, mode: FlightMode, now_s: float) -> None:
        """We have commanded a mode."""
        self._pending, self._pending_until_s = mode, now_s + ANSWER_S

    def command_arm(self) -> None:
        """We have commanded arming."""
        self._may_arm = True

    def yield_back(self) -> None:
        """An operator says that we may go on: what the autopilot does now is taken for ours."""
        self.has_control, self.reason = False, ""
        self._expected = self._seen.mode if self._seen is not None else None
        self._pending = None

    def restart(self) -> None:
        """Looks afresh, as at a start of the driver."""
        self.__init__()  # type: ignore[misc] # the state of a new watch

    def see(self, state: AutopilotState, now_s: float) -> None:
        """Takes the autopilot's state in."""
        if not state.is_connected:
            return
        if now_s > self._pending_until_s:
            self._pending = None
        before, self._seen = self._seen, state
        if before is None:
            self._expected = state.mode
            if state.is_armed:
                self._lose(f"the vehicle was armed, in mode {state.mode_name}, before this process came")
            return
        if state.is_armed and not before.is_armed:
            if not self._may_arm:
                self._lose("the vehicle was armed by somebody else")
            self._may_arm = False
        if before.is_armed and not state.is_armed:
            if self._expected is not FlightMode.LAND and self._pending is not FlightMode.LAND:
                self._lose("the vehicle was disarmed by somebody else")
            self._expected, self._pending = state.mode, None
        if state.mode is before.mode:
            return
        if self._pending is not None and state.mode in FOLLOWS.get(self._pending, ()):
            self._expected, self._pending = self._pending, None
        elif self._expected is not None and state.mode in FOLLOWS.get(self._expected, ()):
            return
        elif state.is_armed:
            who = "the autopilot by itself (failsafe)" if state.is_failsafe else "somebody else"
            self._lose(f"mode {state.mode_name} was chosen by {who}")
        else:
            self._expected = state.mode

    def _lose(self, reason: str) -> None:
        self.has_control, self.reason = True, reason
