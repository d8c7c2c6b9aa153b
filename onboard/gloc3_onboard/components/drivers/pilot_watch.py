"""Tells whether a human pilot, or the autopilot by itself, has taken the vehicle over (DESIGN §7: the pilot wins)."""

from collections.abc import Mapping
from typing import Final

from gloc3.messages.vehicle import AutopilotState, FlightMode

FOLLOWS: Final[Mapping[FlightMode, frozenset[FlightMode]]] = {
    FlightMode.TAKE_OFF: frozenset({FlightMode.TAKE_OFF, FlightMode.GUIDED}),
    FlightMode.GUIDED: frozenset({FlightMode.GUIDED}),
    FlightMode.HOLD: frozenset({FlightMode.HOLD}),
    FlightMode.LAND: frozenset({FlightMode.LAND}),
    FlightMode.MISSION: frozenset({FlightMode.MISSION}),
}
"""The modes that a command of ours may lead to, by the mode that was commanded."""
OURS: Final = frozenset(FOLLOWS)
"""The modes that we ever command."""

ANSWER_S: Final = 5.0
"""So long after a command of ours (its repetitions included) what it asks for is taken for ours."""
BLIND_S: Final = 5.0
"""Who has not looked for longer does not know who has done what meanwhile."""


class PilotWatch:
    """Compares the autopilot's modes and arming with what we commanded.

    A quiet driver watches as a shadow: what its primary commands it cannot know, so that only modes which none of us
    ever commands are somebody else's.
    """

    def __init__(self) -> None:
        self.has_control = False
        self.reason = ""
        self.lands_into: tuple[str, ...] = ()
        """Modes, in the autopilot's words, that it enters by itself when a landing of ours is over."""
        self._expected: FlightMode | None = None
        self._commanded: dict[FlightMode, float] = {}
        """Modes that we have commanded and not seen yet, oldest first, with the time until which they may come."""
        self._arm_until_s = self._disarm_until_s = self._interrupted_until_s = float("-inf")
        self._seen: AutopilotState | None = None
        self._polled_s = float("-inf")

    # --- what we do ---

    def command(self, mode: FlightMode, now_s: float) -> None:
        """We have commanded a mode."""
        self._commanded.pop(mode, None)
        self._commanded[mode] = now_s + ANSWER_S

    def command_arm(self, now_s: float) -> None:
        """We have commanded arming."""
        self._arm_until_s = now_s + ANSWER_S

    def command_disarm(self, now_s: float) -> None:
        """We have commanded disarming."""
        self._disarm_until_s = now_s + ANSWER_S

    def interrupt(self, now_s: float) -> None:
        """Setpoints of ours may have been missed: a hold that the autopilot's failsafe chooses follows from that."""
        self._interrupted_until_s = now_s + ANSWER_S

    def yield_back(self) -> None:
        """An operator says that we may go on: what the autopilot does now is taken for ours."""
        self.has_control, self.reason = False, ""
        self._expected = self._seen.mode if self._seen is not None else None
        self._commanded.clear()

    def step_in(self, now_s: float) -> None:
        """The shadow's primary is gone: its mode is ours now, and so is the hold that it left behind."""
        seen = self._seen
        if seen is not None:
            self._expected = seen.mode
            if seen.is_armed and seen.mode not in OURS:
                self.lose(f"mode {seen.mode_name} was chosen by somebody else")
        self.command(FlightMode.HOLD, now_s)

    def lose(self, reason: str) -> None:
        """Somebody else has control; the first reason stays."""
        if not self.has_control:
            self.has_control, self.reason = True, reason

    # --- what we see ---

    def update(self, state: AutopilotState, now_s: float, *, is_shadow: bool = False, may_settle: bool = False) -> None:
        """Takes the autopilot's state in.

        Args:
            state: what it tells.
            now_s: the time.
            is_shadow: somebody else of ours commands the vehicle.
            may_settle: our take-off is high enough, or our plan near enough to its end, for the autopilot to go over to
                hold by itself.
        """
        if now_s - self._polled_s > BLIND_S:
            self._seen = None
        self._polled_s = now_s
        if not state.is_connected:
            return
        before, self._seen = self._seen, state
        for mode in [mode for mode, until_s in self._commanded.items() if now_s > until_s]:
            del self._commanded[mode]
        if is_shadow:
            self._expected = state.mode
            if state.is_armed and state.mode not in OURS:
                self.lose(self._chosen(state))
        elif before is None:
            self._expected = state.mode
            if state.is_armed:
                self.lose(f"the vehicle was armed, in mode {state.mode_name}, before this driver started")
        else:
            self._compare(before, state, now_s, may_settle=may_settle)

    def _compare(self, before: AutopilotState, state: AutopilotState, now_s: float, *, may_settle: bool) -> None:
        if state.is_armed and not before.is_armed and now_s > self._arm_until_s:
            self.lose("the vehicle was armed by somebody else")
        if before.is_armed and not state.is_armed:
            lands = self._expected is FlightMode.LAND or FlightMode.LAND in self._commanded
            if not lands and now_s > self._disarm_until_s:
                self.lose("the vehicle was disarmed by somebody else")
        if state.mode is before.mode:
            return
        ours = next((mode for mode in reversed(self._commanded) if state.mode in FOLLOWS[mode]), None)
        if ours is not None:
            while next(iter(self._commanded)) is not ours:  # those before it have been overtaken
                del self._commanded[next(iter(self._commanded))]
            del self._commanded[ours]
        elif state.is_armed:
            may_settle &= self._expected in (FlightMode.TAKE_OFF, FlightMode.MISSION)
            settles = may_settle and state.mode is FlightMode.HOLD
            is_failsafe_new = state.is_failsafe and not before.is_failsafe
            is_interrupted = (
                is_failsafe_new and self._expected is FlightMode.GUIDED and now_s <= self._interrupted_until_s
            )
            settles |= is_interrupted and state.mode is FlightMode.HOLD
            has_landed = self._expected is FlightMode.LAND and state.mode_name in self.lands_into
            if not (settles or has_landed):
                self.lose(self._chosen(state))
        self._expected = state.mode

    def _chosen(self, state: AutopilotState) -> str:
        who = "the autopilot (failsafe)" if state.is_failsafe else "somebody else"
        return f"mode {state.mode_name} was chosen by {who}"
