"""Invariants of a flight's course: transitions of the mission, that it goes on, and that it ends."""

import re
from typing import Any, Final

from gloc3.component.deployment import OnFault
from gloc3.messages.envelope import Envelope
from gloc3.messages.summaries import CiEvent, MissionSummary
from gloc3.messages.vehicle import DriverState
from gloc3.mission.model.states import TABLE, ActionState
from gloc3.platform.platform import Platform
from gloc3_sitl.faults.faults import TimedFault
from gloc3_sitl.proof.invariant import DIVING, FlightFacts, FlownMission, Invariant, TrueMoment

_MOVE: Final = re.compile(
    r"(mission|[\w-]+(?:\.[\w-]+)?) (waiting|running|paused|done|failed|skipped|aborted)(?:: .*)?"
)
_REPEATED: Final = re.compile(r"([\w-]+): \d+ of \d+")
BY_OPERATOR: Final = "by an operator"
"""The reason of a mission that an operator has paused or ended."""
EMERGENCY: Final = "emergency hold by "
SURFACED_M: Final = 1.0
SLOW_M_S: Final = 1.0


class OnlyTableTransitions(Invariant):
    """The states that the mission is told to be in, against the table of transitions."""

    name = "only_table_transitions"
    sentence = "Mission, tasks and actions change their states only as the table of transitions says."
    topics = ("ci/event",)

    def __init__(self, facts: FlightFacts) -> None:
        super().__init__(facts)
        self._states: dict[str, ActionState] = {}
        self._boot: int | None = None
        self._is_corrupted = facts.has_corrupted("ci/event")

    def receive(self, topic: str, envelope: Envelope[Any], now_s: float) -> None:
        """Judges one event."""
        event: CiEvent = envelope.payload
        if envelope.source.boot != self._boot:  # what happened in between is on its disk
            self._boot = envelope.source.boot
            self._states.clear()
        if event.source != "mission" or self._is_corrupted:
            return
        repeated = _REPEATED.match(event.text)
        if repeated is not None:
            self._states = {key: state for key, state in self._states.items() if key.partition(".")[0] != repeated[1]}
        move = _MOVE.fullmatch(event.text)
        if move is None:
            return
        target, to = move[1], ActionState(move[2])
        if target == "mission" and to is ActionState.RUNNING and "by an operator" in event.text:
            self._states.clear()
        before = self._states.get(target)
        if before is not None and before is not to and to not in TABLE[before].values():
            self.break_at(now_s, f"{target} went from {before} to {to}")
        self._states[target] = to


class PersonInControl:
    """Whether a pilot or an operator who is there has the vehicle: it need not end by itself then."""

    def __init__(self, facts: FlightFacts) -> None:
        self._facts = facts
        self._driver: DriverState | None = None
        self.mission: MissionSummary | None = None
        """As it was last told."""

    def receive(self, payload: Any) -> None:
        """Keeps what driver and mission say."""
        if isinstance(payload, DriverState):
            self._driver = payload
        elif isinstance(payload, MissionSummary):
            self.mission = payload

    def has_one(self, moment: TrueMoment) -> bool:
        """Whether somebody has it."""
        if moment.has_transmitter and self._driver is not None and self._driver.has_pilot_control:
            return True
        return not self._facts.has_fault(moment.t_s, "link_loss", for_s=10.0) and self._is_an_operators(moment.t_s)

    def _is_an_operators(self, t_s: float) -> bool:
        """Whether an operator has paused, ended or skipped the mission or a part of it, or has pressed the emergency key.

        So has he if he took it back from a pilot when no mission or policy was left to go on.
        """
        mission = self.mission
        if mission is None or mission.policy == "pilot":
            return False
        if mission.state == "running":
            return "paused" in mission.tasks.values()
        faults = self._facts.faults
        commands = {one.given.target: one for one in faults if one.kind == "operator" and (one.begin_s or 0.0) <= t_s}
        if "resume" in commands and not mission.policy and mission.state in ("aborted", "failed"):
            resumed_s = commands["resume"].begin_s or 0.0
            if any(one.kind == "pilot" and (one.begin_s or 0.0) < resumed_s for one in faults):
                return True
        if mission.state == "done":
            ended = [commands[verb].given.word for verb in ("skip", "abort") if verb in commands]
            return any("." in word for word in ended) or ("skipped" in mission.tasks.values() and "skip" in commands)
        if mission.policy == "hold" and "hold" in commands:
            return True  # the emergency key, which goes before any policy
        is_by_operator = mission.reason == BY_OPERATOR or mission.reason.startswith(EMERGENCY)
        return is_by_operator and mission.state in ("paused", "skipped", "aborted")


def is_at_rest(platform: Platform, moment: TrueMoment) -> bool:
    """Whether a vehicle is on the ground, or at the surface, where it may drift; what is disarmed under water floats up."""
    if platform.vehicle.type in DIVING:
        return moment.position_ned_m[2] < SURFACED_M
    return platform.vehicle.type == "boat" or (moment.is_on_ground and moment.speed_m_s < SLOW_M_S)


class ItEnds(Invariant):
    """What is so when the time that the flight was given is up."""

    name = "it_ends"
    sentence = (
        "Every flight ends: landed and disarmed, or surfaced and disarmed; or a pilot or an operator who is there has "
        "the vehicle."
    )
    topics = ("driver", "ci/mission")

    def __init__(self, facts: FlightFacts) -> None:
        super().__init__(facts)
        self._control = PersonInControl(facts)

    def receive(self, topic: str, envelope: Envelope[Any], now_s: float) -> None:
        """Keeps who has the vehicle."""
        self._control.receive(envelope.payload)

    def end(self, flown: FlownMission) -> None:
        """Judges the end."""
        last = flown.last
        if last is None or (not last.is_armed and is_at_rest(self.facts.platform, last)):
            return
        if last.is_armed and self._control.has_one(last):
            return
        mission = self._control.mission
        policy = mission.policy if mission is not None else ""
        how = (
            "armed"
            if last.is_armed
            else f"disarmed at {last.speed_m_s:.1f} m/s and a height of {-last.position_ned_m[2]:.1f} m"
        )
        state = f"mission {flown.state or 'not started'}" + (f" ({flown.reason})" if flown.reason else "")
        self.break_at(
            flown.t_s,
            f"still {how} in {last.mode_name} after {flown.given_s:.0f} s; {state}, policy {policy or 'none'}",
        )


SHORT_CUT_S: Final = 0.4
"""The autopilot's cable may be cut for so long without that it leaves our setpoints."""
SHORT_HANG_S: Final = 0.5
"""A component that stands still for so long is replaced by a new one before anything is lost."""
_HARMLESS: Final = ("disk_full", "clock_jump", "link_twice", "cable_twice")
_SERVER: Final = "command_server"


class GoesOn(Invariant):
    """The mission of a flight with troubles that the stack gets over, at most one of which takes something away."""

    name = "goes_on"
    sentence = (
        "In calm weather a mission is done although one component fails once, or stands still for "
        f"{SHORT_HANG_S:g} s, that is brought up again and performs none of its actions, or the cable is cut for less than {SHORT_CUT_S:g} s; although the radio is silent for less than the "
        "mission waits, messages come twice, the disk is full or the date jumps."
    )

    def __init__(self, facts: FlightFacts) -> None:
        super().__init__(facts)
        taken = [fault for fault in facts.faults if fault.kind not in _HARMLESS]
        self._is_judged = facts.is_calm and len(taken) <= 1 and all(map(self._is_covered, taken))

    def _is_covered(self, fault: TimedFault) -> bool:
        """Whether the mission has to go on although something is taken away."""
        platform, lasts_s = self.facts.platform, fault.lasts_s
        match fault.kind:
            case "link_loss":
                return lasts_s is not None and lasts_s < self.facts.mission.policies.link_loss_after_s - 0.5
            case "cable_loss":
                return lasts_s is not None and lasts_s < SHORT_CUT_S
            case "crash" | "hang":
                is_short = lasts_s is None or lasts_s <= SHORT_HANG_S
                performers = {row.performed_by for row in platform.capabilities.values()}
                row = next((row for row in platform.components if row.name == fault.given.target), None)
                is_mended = row is not None and isinstance(row.on_fault, OnFault)
                return is_short and is_mended and fault.given.target not in {*performers, _SERVER}
            case _:
                return False

    def end(self, flown: FlownMission) -> None:
        """Judges the state at the end of a mission that has begun."""
        if self._is_judged and flown.state not in ("", "waiting", "done"):
            self.break_at(flown.t_s, f"the mission is {flown.state}" + (f": {flown.reason}" if flown.reason else ""))
