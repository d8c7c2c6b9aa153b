"""Distinguishes a human pilot, the autopilot's failsafe and a gap of ours (DESIGN §7: the pilot wins)."""

import math
from collections.abc import Mapping
from typing import Final

from gloc3.mavlink.flight_modes import mode_words
from gloc3.messages.envelope import Envelope
from gloc3.messages.vehicle import AutopilotPose, AutopilotState, FlightMode, LandedState

FOLLOWS: Final[Mapping[FlightMode, frozenset[FlightMode]]] = {
    FlightMode.TAKE_OFF: frozenset({FlightMode.TAKE_OFF, FlightMode.GUIDED}),
    FlightMode.GUIDED: frozenset({FlightMode.GUIDED}),
    FlightMode.HOLD: frozenset({FlightMode.HOLD}),
    FlightMode.LAND: frozenset({FlightMode.LAND}),
    FlightMode.MISSION: frozenset({FlightMode.MISSION}),
    FlightMode.RETURN: frozenset({FlightMode.RETURN}),
}
"""Modes that may follow from our commands, by commanded mode."""
OURS: Final = frozenset(FOLLOWS) - {FlightMode.RETURN}
"""The modes that are taken for ours when nothing is known of who commanded them: a return is more often a pilot's."""

_COMING_DOWN: Final = frozenset({FlightMode.RETURN, FlightMode.LAND})
"""Modes in which an autopilot flies the last item of its mission."""

_ANSWERS: Final = frozenset({FlightMode.RETURN, FlightMode.LAND, FlightMode.HOLD})
"""Modes in which an autopilot answers a breach of its fence."""
REASON_LATE_S: Final = 1.0
"""So long after such a mode the autopilot may still report that it was its failsafe, s: ArduPilot sends its mode first."""

ANSWER_S: Final = 5.0
"""Time after our command (repetitions included) in which its mode is attributed to us, s."""
BLIND_S: Final = 5.0
"""Interruption of the driver after which earlier mode changes cannot be attributed, s."""
GAP_S: Final = 0.5
"""Silence after which the autopilot has not received our setpoints either, s; PX4 leaves offboard mode after 1 s."""
GAP_REPORTED_S: Final = 2.5
"""So long after a gap a hold of the failsafe is taken for its consequence: the heartbeat that shows it comes once a second."""


class PilotWatch:
    """Compares the autopilot's modes and arming with what we commanded.

    A quiet driver is a shadow: it does not know its primary's commands, so only modes that we never command are
    attributed to others.
    """

    def __init__(self) -> None:
        self.has_control = False
        self.reason = ""
        self.is_failsafe = False
        """Whether the autopilot's failsafe has control, not a human."""
        self.held_after_gap_s = 0.0
        """How long the last gap was for which the autopilot went over to its hold; 0 while there was none."""
        self.lands_into: tuple[str, ...] = ()
        """Modes, in the autopilot's names, that it enters automatically after our landing."""
        self.restores_guided = False
        """Whether setpoints of ours that arrive late bring it back from a failsafe to guided mode, as PX4's do."""
        self._expected: FlightMode | None = None
        self._commanded: dict[FlightMode, float] = {}
        """Modes that we have commanded and not seen yet, oldest first, with the time until which they may come."""
        self._arm_until_s = self._disarm_until_s = float("-inf")
        self._seen: AutopilotState | None = None
        self._polled_s = self._gap_until_s = float("-inf")
        self._gap_s = 0.0
        """Length of the last gap, which explains a hold until `_gap_until_s`."""
        self._received_s: float | None = None
        self._lost_s = -math.inf
        """When somebody else took control."""
        self._begins = True
        self._is_guided_left = False
        """The failsafe that has control took the vehicle out of our guided mode."""
        self._is_left_alone = False
        """The driver was stopped during a take-off of ours, which the autopilot ends in its hold."""

    # --- what we do ---

    def command(self, mode: FlightMode, now_s: float) -> None:
        """We have commanded a mode."""
        self._commanded.pop(mode, None)
        self._commanded[mode] = now_s + ANSWER_S

    def extend(self, mode: FlightMode, now_s: float) -> None:
        """A mode that we commanded may still come: its command is not answered, or its answer has just come."""
        if mode in self._commanded:
            self._commanded[mode] = now_s + ANSWER_S

    def command_arm(self, now_s: float) -> None:
        """We have commanded arming, or the command is not answered yet."""
        self._arm_until_s = now_s + ANSWER_S

    def command_disarm(self, now_s: float) -> None:
        """We have commanded disarming, or the command is not answered yet."""
        self._disarm_until_s = now_s + ANSWER_S

    def interrupt(self, now_s: float) -> None:
        """Notes a possible gap in our setpoints; a failsafe hold then follows from it."""
        self._gap_until_s = now_s + GAP_REPORTED_S

    def yield_back(self) -> None:
        """Returns control to us on an operator's request; the present mode counts as ours."""
        self.has_control, self.reason, self.is_failsafe = False, "", False
        self._expected = self._seen.mode if self._seen is not None else None
        self._commanded.clear()

    def step_in(self, now_s: float) -> None:
        """Takes over from a lost primary; its mode and the hold that it left are ours now."""
        seen = self._seen
        if seen is not None:
            self._expected = seen.mode
            if seen.is_armed and seen.mode not in OURS:
                self.lose(self._chosen(seen), is_failsafe=seen.is_failsafe)
        self.command(FlightMode.HOLD, now_s)

    def lose(self, reason: str, *, is_failsafe: bool = False) -> None:
        """Somebody else has control; the first reason stays."""
        if not self.has_control:
            self.has_control, self.reason, self.is_failsafe = True, reason, is_failsafe
            self._lost_s = self._polled_s

    # --- what we see ---

    def begin(self) -> None:
        """Starts, possibly after a time without observation."""
        self._begins = True
        self._is_left_alone = self._expected is FlightMode.TAKE_OFF

    def received(self, pose: Envelope[AutopilotPose] | None, now_s: float) -> None:
        """Measures the gaps between the autopilot's poses, which come all the time; before `update`."""
        if pose is None:
            return
        since_s, self._received_s = self._received_s, pose.t_s
        gap_s = max(pose.t_s, now_s - GAP_S) - since_s if since_s is not None else 0.0
        if gap_s > GAP_S:
            self._gap_s, self._gap_until_s = gap_s, now_s + GAP_REPORTED_S

    def update(
        self,
        state: AutopilotState,
        now_s: float,
        *,
        is_shadow: bool = False,
        may_settle: bool = False,
        may_return: bool = False,
        comes_down: bool = False,
        is_low: bool = False,
    ) -> None:
        """Handles the autopilot's state.

        Args:
            state: the reported state.
            now_s: the time.
            is_shadow: another driver of ours commands the vehicle.
            may_settle: our take-off is high enough, or our plan close enough to its end, for the autopilot to change to
                hold.
            may_return: our stream restores guided mode.
            comes_down: our plan ends with a return or a landing of the autopilot, and its disarming.
            is_low: it is about as high as home: that it has disarmed may be reported before that it stands.
        """
        if self._begins and now_s - self._polled_s > BLIND_S:
            self._seen = None
        looked_s, self._polled_s, self._begins = self._polled_s, now_s, False
        if not state.is_connected:
            return
        before, self._seen = self._seen, state
        # What was commanded before the last look, or meanwhile, may have been carried out while nobody looked.
        for mode in [mode for mode, until_s in self._commanded.items() if looked_s > until_s]:
            del self._commanded[mode]
        if is_shadow:
            self._expected = state.mode
            if state.is_armed and state.mode not in OURS:
                self.lose(self._chosen(state), is_failsafe=state.is_failsafe)
        elif before is None:
            self._expected = state.mode
            if state.is_armed:
                reason = f"the vehicle was armed, in mode {mode_words(state.mode_name)}, before this driver started"
                self.lose(reason, is_failsafe=state.is_failsafe)
        else:
            may_come_down = comes_down and (may_settle or self._expected in _COMING_DOWN)
            self._compare(
                before,
                state,
                now_s,
                looked_s,
                may_settle=may_settle,
                may_return=may_return,
                may_come_down=may_come_down,
                may_disarm=comes_down and (is_low or before.landed is LandedState.ON_GROUND),
            )

    def _compare(
        self,
        before: AutopilotState,
        state: AutopilotState,
        now_s: float,
        looked_s: float,
        *,
        may_settle: bool,
        may_return: bool,
        may_come_down: bool,
        may_disarm: bool,
    ) -> None:
        if state.is_armed and not before.is_armed and looked_s > self._arm_until_s:
            self.lose("the vehicle was armed by another party")
        if before.is_armed and not state.is_armed:
            lands = self._expected in (FlightMode.LAND, FlightMode.RETURN) or FlightMode.LAND in self._commanded
            lands = lands or may_disarm
            if not lands and looked_s > self._disarm_until_s:
                self.lose(f"the vehicle was disarmed by {_who(state)}", is_failsafe=state.is_failsafe)
        if state.mode is before.mode:
            is_reported_late = state.is_failsafe and not before.is_failsafe and now_s - self._lost_s < REASON_LATE_S
            if self.has_control and is_reported_late and state.mode in _ANSWERS:
                self.reason, self.is_failsafe = self._chosen(state), True
            return
        ours = next((mode for mode in reversed(self._commanded) if state.mode in FOLLOWS[mode]), None)
        if ours is not None:
            while next(iter(self._commanded)) is not ours:  # those before it have been overtaken
                del self._commanded[next(iter(self._commanded))]
            del self._commanded[ours]
        elif state.is_armed:
            may_settle = (may_settle or self._is_left_alone) and self._expected in (
                FlightMode.TAKE_OFF,
                FlightMode.MISSION,
            )
            settles = may_settle and state.mode is FlightMode.HOLD
            lands = self._expected is FlightMode.LAND or FlightMode.LAND in self._commanded  # at once: it was not seen
            has_landed = lands and state.mode_name in self.lands_into
            returns = may_return and state.mode is FlightMode.GUIDED
            settles = settles or (may_come_down and state.mode in _COMING_DOWN and not state.is_failsafe)
            if self._holds_after_gap(before, state, now_s):
                self.held_after_gap_s = self._gap_s
            elif self.is_failsafe and not state.is_failsafe:
                if not (state.mode is FlightMode.GUIDED and self._is_guided_left and self.restores_guided):
                    self.reason, self.is_failsafe = self._chosen(state), False  # a human takes over from it
            elif not (settles or has_landed or returns):
                self._is_guided_left = state.is_failsafe and self._expected is FlightMode.GUIDED
                self.lose(self._chosen(state), is_failsafe=state.is_failsafe)
        self._expected = state.mode
        self._is_left_alone = False

    def _holds_after_gap(self, before: AutopilotState, state: AutopilotState, now_s: float) -> bool:
        """Whether the autopilot's failsafe has just started a hold after a gap in our setpoints."""
        is_new = state.is_failsafe and not before.is_failsafe and state.mode is FlightMode.HOLD
        return is_new and self._expected is FlightMode.GUIDED and now_s <= self._gap_until_s

    def _chosen(self, state: AutopilotState) -> str:
        return f"mode {mode_words(state.mode_name)} was chosen by {_who(state)}"


def _who(state: AutopilotState) -> str:
    """Who has done what the state shows, as far as it does."""
    return "the autopilot (failsafe)" if state.is_failsafe else "another party"
