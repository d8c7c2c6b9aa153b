"""Invariants of command: who moves the vehicle, who arms it, and how often a command is carried out."""

import re
from collections import deque
from math import inf
from typing import Any, Final

from gloc3.messages.command_interface import (
    CiReply,
    CiRequest,
    Emergency,
    Outcome,
    RequestAction,
    RequestTask,
    Steer,
    Verb,
)
from gloc3.messages.envelope import Envelope
from gloc3.messages.summaries import CiEvent, MissionSummary
from gloc3.messages.vehicle import DriverState, ManoeuvreState
from gloc3_sitl.autopilot.modes import Behaviour
from gloc3_sitl.autopilot.verdict import Author
from gloc3_sitl.proof.invariant import FlightFacts, Invariant, TrueMoment

GAP_S: Final = 0.5
TAKEN_S: Final = 0.7
"""So long a hold that is commanded may take until the autopilot is in it."""
DRIVER: Final = "autopilot_driver"
_GOING_ON: Final = (Verb.START, Verb.RESUME, Verb.RETRY)
_IN_CONTROL: Final = ("", "pilot", "operator", "failsafe")
"""No policy: nothing is wrong, or another one has control."""
HELD_S: Final = 3.0
"""So long a hold may take to end a landing."""
SILENT_S: Final = 2.0
"""A command server that has told nothing of the mission for so long does not command."""
_CUT: Final = ("cable_loss", "cable_slow", "restart")
SWITCHES: Final = 4
WITHIN_S: Final = 1.0
GIVEN_BACK_S: Final = 1.0
"""So long a command on its way may still arrive after a pilot has taken over."""


class SetpointOrHold(Invariant):
    """The age of the newest setpoint at the autopilot while it follows them."""

    name = "setpoint_or_hold"
    sentence = (
        f"While the autopilot follows setpoints, none stays away for more than {GAP_S:g} s without a hold that is commanded; "
        "cut off from the companion it is left to its own time-out."
    )
    topics = ("driver",)

    def __init__(self, facts: FlightFacts) -> None:
        super().__init__(facts)
        self._is_manoeuvre = False
        self._since_s: float | None = None

    def receive(self, topic: str, envelope: Envelope[Any], now_s: float) -> None:
        """Keeps whether the autopilot flies a manoeuvre of its own."""
        state: DriverState = envelope.payload
        self._is_manoeuvre = state.manoeuvre_state is ManoeuvreState.RUNNING

    def observe(self, moment: TrueMoment) -> None:
        """Judges one moment."""
        facts, now_s = self.facts, moment.t_s
        is_meant = (
            moment.is_under_way
            and moment.behaviour is Behaviour.STREAMED
            and moment.mode_author == Author.COMMAND
            and not self._is_manoeuvre
            and not facts.has_fault(now_s, *_CUT, for_s=5.0)
            and not facts.has_fault(now_s, "hang", "slow", "leak", target=DRIVER, for_s=5.0)
        )
        if not is_meant:
            self._since_s = None
            return
        self._since_s = now_s if self._since_s is None else self._since_s
        gap_s = min(moment.setpoint_age_s, now_s - self._since_s)
        if gap_s > GAP_S + TAKEN_S:
            self.break_at(now_s, f"no setpoint for {gap_s:.1f} s, and the autopilot is still in {moment.mode_name}")


class MotionHasOneOwner(Invariant):
    """Who streams setpoints, and what is done after a pilot has taken over."""

    name = "motion_has_one_owner"
    sentence = (
        "One component streams setpoints at a time; after a pilot has taken over nothing of ours changes the mode until an "
        "operator says resume, or nobody has been heard for so long that a safety policy acts. A hold that a pilot chooses "
        "during the autopilot's own climb is left out: nothing that it sends tells it from the hold in which the climb ends."
    )
    topics = ("setpoint", "ci/request", "ci/mission")

    def __init__(self, facts: FlightFacts) -> None:
        super().__init__(facts)
        self._senders: deque[tuple[float, tuple[str, int]]] = deque()
        self._pilot_s: float | None = None
        self._resumed_s = -1e9
        self._is_policy = False
        self._author: Author = Author.SELF
        self._behaviour: Behaviour | None = None
        self._is_ambiguous = False
        self._is_corrupted = facts.has_corrupted("setpoint")

    def receive(self, topic: str, envelope: Envelope[Any], now_s: float) -> None:
        """Keeps who streams, and what operators say."""
        payload = envelope.payload
        if isinstance(payload, CiRequest):
            body = payload.body
            is_going_on = isinstance(body, Steer) and body.verb in _GOING_ON
            if is_going_on or isinstance(body, RequestTask | RequestAction | Emergency):
                self._resumed_s = now_s
        elif isinstance(payload, MissionSummary):
            self._is_policy = payload.policy not in _IN_CONTROL
        elif not self._is_corrupted:
            self._stream(now_s, (envelope.source.component, envelope.source.boot))

    def _stream(self, now_s: float, sender: tuple[str, int]) -> None:
        senders = self._senders
        if not senders or senders[-1][1] != sender:
            senders.append((now_s, sender))
        while senders and senders[0][0] < now_s - WITHIN_S:
            senders.popleft()
        if len(senders) > SWITCHES:
            names = sorted({name for _, (name, _) in senders})
            self.break_at(
                now_s, f"{' and '.join(names)} stream setpoints by turns, {len(senders)} times in {WITHIN_S:g} s"
            )

    def observe(self, moment: TrueMoment) -> None:
        """Judges one moment."""
        author = moment.mode_author
        if author == Author.PILOT and self._author != Author.PILOT:
            self._pilot_s = moment.t_s
            was_there = self._behaviour in (Behaviour.TAKE_OFF, Behaviour.HOLD)  # nobody sees that it was chosen
            self._is_ambiguous = was_there and moment.behaviour is Behaviour.HOLD
        self._behaviour = moment.behaviour
        is_taken_back = author == Author.COMMAND and self._author == Author.PILOT and not self._is_ambiguous
        if is_taken_back and moment.is_under_way:
            since_s = 0.0 if self._pilot_s is None else moment.t_s - self._pilot_s
            is_allowed = self._resumed_s >= (self._pilot_s or 0.0) or since_s < GIVEN_BACK_S or self._is_policy
            is_alone = not moment.has_transmitter
            if not is_allowed and not is_alone:
                self.break_at(
                    moment.t_s,
                    f"{moment.mode_name} was commanded {since_s:.1f} s after a pilot has taken over, and nobody said resume",
                )
        self._author = author


class HoldIsObeyed(Invariant):
    """Whether a landing goes on that an operator's hold has ended."""

    name = "hold_is_obeyed"
    sentence = (
        f"Where the policy is to hold, no landing and no return that we have commanded goes on for more than {HELD_S:g} s; "
        "cut off from the companion it does."
    )
    topics = ("ci/mission",)

    def __init__(self, facts: FlightFacts) -> None:
        super().__init__(facts)
        self._received_s = self._since_s = -inf
        self._is_hold = False

    def receive(self, topic: str, envelope: Envelope[Any], now_s: float) -> None:
        """Keeps since when the policy is to hold."""
        is_hold = envelope.payload.policy == "hold"
        if is_hold and not self._is_hold:
            self._since_s = now_s
        self._is_hold, self._received_s = is_hold, now_s

    def observe(self, moment: TrueMoment) -> None:
        """Judges one moment."""
        now_s = moment.t_s
        is_ours = moment.behaviour in (Behaviour.LAND, Behaviour.RETURN) and moment.mode_author == Author.COMMAND
        is_reached = not (
            self.facts.has_fault(now_s, *_CUT, for_s=HELD_S)
            or self.facts.has_fault(now_s, "hang", "slow", "leak", target=DRIVER, for_s=HELD_S)
            or now_s - self._received_s > SILENT_S
        )
        if not (moment.is_under_way and is_ours and self._is_hold and is_reached):
            self._since_s = max(self._since_s, now_s)
        elif now_s - self._since_s > HELD_S:
            self.break_at(now_s, f"the policy has been to hold for {HELD_S:g} s, and {moment.mode_name} goes on")


class NothingArmsByItself(Invariant):
    """What arms the vehicle."""

    name = "nothing_arms_by_itself"
    sentence = (
        "The vehicle is armed by a pilot, or for a mission or an action that an operator has started and that runs; a restart "
        "never arms."
    )
    topics = ("ci/mission", "ci/request")

    def __init__(self, facts: FlightFacts) -> None:
        super().__init__(facts)
        self._is_armed: bool | None = None
        self._state = ""
        self._policy = ""
        self._asked_s = -1e9

    def receive(self, topic: str, envelope: Envelope[Any], now_s: float) -> None:
        """Keeps what runs, and what operators ask for."""
        payload = envelope.payload
        if isinstance(payload, MissionSummary):
            self._state, self._policy = payload.state, payload.policy
        elif isinstance(payload, CiRequest) and type(payload.body).__name__ in (
            "Steer",
            "RequestAction",
            "RequestTask",
        ):
            self._asked_s = now_s

    def observe(self, moment: TrueMoment) -> None:
        """Judges one moment."""
        is_begun = moment.is_armed and self._is_armed is False
        self._is_armed = moment.is_armed
        if not is_begun or self.facts.has_fault(moment.t_s, "pilot", target="arm", for_s=1.0):
            return
        is_running = self._state == "running" and not self._policy
        if not is_running and moment.t_s - self._asked_s > 2.0:
            self.break_at(
                moment.t_s, f"armed while the mission is {self._state or 'not loaded'}, policy {self._policy or 'none'}"
            )


_STARTED: Final = re.compile(r"mission running: by an operator")


class CommandsAtMostOnce(Invariant):
    """Requests of stations, their replies, and what they led to."""

    name = "commands_at_most_once"
    sentence = "A request is carried out at most once, and a repeat is given the same reply."
    topics = ("ci/request", "ci/reply", "ci/event")

    def __init__(self, facts: FlightFacts) -> None:
        super().__init__(facts)
        self._asked: set[tuple[str, int, int]] = set()
        self._replies: dict[tuple[str, int, int], tuple[str, str]] = {}
        self._started = 0

    def receive(self, topic: str, envelope: Envelope[Any], now_s: float) -> None:
        """Compares a reply with the one before, and starts with what was asked for."""
        payload = envelope.payload
        if isinstance(payload, CiRequest):
            if isinstance(payload.body, Steer) and payload.body.verb in (Verb.START, Verb.RESUME, Verb.RETRY):
                self._asked.add((payload.sender, payload.boot, payload.sequence))
        elif isinstance(payload, CiReply):
            key = (payload.sender, payload.boot, payload.sequence)
            found = (str(payload.outcome), payload.reason)
            before = self._replies.setdefault(key, found)
            if before[0] != found[0] and Outcome.UNKNOWN not in (before[0], found[0]):
                self.break_at(now_s, f"request {key[2]} of {key[0]} was answered {before[0]}, then {found[0]}")
        elif isinstance(payload, CiEvent) and _STARTED.fullmatch(payload.text):
            self._started += 1
            if self._started > len(self._asked):
                self.break_at(
                    now_s, f"the mission was started {self._started} times, asked for {len(self._asked)} times"
                )
