"""What must hold in every flight: the base of the invariants, what they receive, and how a broken one is reported."""

from collections.abc import Sequence
from math import inf
from typing import Any, ClassVar, Final, NamedTuple

import msgspec

from gloc3.errors import Gloc3Error
from gloc3.evaluation.requested_path import RequestedFlight
from gloc3.installed import installed_points
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import Vector3
from gloc3.mission.model.model import Mission
from gloc3.platform.platform import Platform
from gloc3_sitl.autopilot.modes import Behaviour
from gloc3_sitl.autopilot.verdict import Author
from gloc3_sitl.faults.faults import TimedFault

INVARIANTS: Final = "gloc3.invariants"
"""Entry points of invariants that packages bring: a name to `package.module:Class`."""
ON_ROTORS: Final = ("quadrotor", "hexarotor", "vtol")
"""Types of vehicles that fall over without an inertial unit."""
DIVING: Final = ("auv", "rov")
"""Types of vehicles that know below the surface what their companion tells them."""
GONE: Final = ("lost", "stuck", "late", "old")
"""What an inertial unit, or the satellites, may do that leaves nothing to fly by."""
BLIND_S: Final = 0.3
"""So long they stay upright without it."""
ALONE_S: Final = 5.0
"""So long a diver without its companion stays about where it was."""
RECOVERS_S: Final = 8.0
"""So long after that their autopilot needs to find level, and back."""


class BrokenInvariant(msgspec.Struct, frozen=True, kw_only=True):
    """An invariant that did not hold."""

    invariant: str
    t_s: float
    """On the flight's clock."""
    text: str
    """What was so, with the values and the limit."""

    def __str__(self) -> str:
        return f"{self.t_s:8.2f} s  {self.invariant}: {self.text}"


class TrueMoment(NamedTuple):
    """What is truly so at one moment: of the vehicle and of its autopilot, ten times a second."""

    t_s: float
    position_ned_m: Vector3
    """In the frame of the pose."""
    velocity_ned_m_s: Vector3
    height_above_ground_m: float
    is_on_ground: bool
    is_armed: bool
    is_landed: bool
    """As the autopilot believes."""
    behaviour: Behaviour
    mode_name: str
    mode_author: Author
    """Who chose the mode."""
    setpoint_age_s: float
    """Since a setpoint has last reached the autopilot."""
    has_transmitter: bool
    """Whether a pilot's transmitter is switched on."""

    @property
    def is_under_way(self) -> bool:
        """Whether it is armed and off the ground."""
        return self.is_armed and not self.is_landed

    @property
    def speed_m_s(self) -> float:
        """Over ground."""
        north, east, down = self.velocity_ned_m_s
        return float((north * north + east * east + down * down) ** 0.5)


def is_cut_off(fault: TimedFault) -> bool:
    """Whether a fault takes the companion from the autopilot for good."""
    return fault.kind == "cable_loss" and fault.given.number >= 1.0 and fault.lasts_s == inf


class FlightFacts(NamedTuple):
    """What an invariant may know of a flight before it begins."""

    platform: Platform
    mission: Mission
    faults: Sequence[TimedFault]
    floor_height_m: float = -inf
    """Height of the floor of the water in the frame of the pose; minus infinite where there is none."""
    is_calm: bool = True
    """Without wind, waves or a current at the beginning."""

    def has_fault(self, now_s: float, *kinds: str, target: str | None = None, for_s: float = 0.0) -> bool:
        """Whether a fault of such a kind is present now, or was within the last `for_s`."""
        for fault in self.faults:
            if fault.kind not in kinds or (target is not None and fault.given.target != target):
                continue
            begin_s = fault.begin_s or 0.0
            if begin_s <= now_s <= begin_s + (fault.lasts_s or 0.0) + for_s:
                return True
        return False

    def is_out_of_control(self, now_s: float) -> bool:
        """Whether nobody can steer it.

        That is what flies on rotors while its only inertial unit is gone or late, or was so before; and what dives while it is
        without its companion, since nothing else tells it where it is.
        """
        if self.platform.vehicle.type in DIVING:
            return any(is_cut_off(fault) and now_s > (fault.begin_s or 0.0) + BLIND_S for fault in self.faults)
        return self.platform.vehicle.type in ON_ROTORS and self._is_gone("imu", now_s)

    def drifts(self, now_s: float) -> bool:
        """Whether nothing holds it in its place, or nothing did a moment ago.

        The wind carries away what flies on rotors, whose satellites are gone or late. What dives drifts while it is without its
        companion, and has its speed still when that is back.
        """
        if self.platform.vehicle.type in DIVING:
            return any(
                fault.kind == "cable_loss"
                and fault.given.number >= 1.0
                and ALONE_S < now_s - (fault.begin_s or 0.0) <= (fault.lasts_s or 0.0) + RECOVERS_S
                and (fault.lasts_s or 0.0) > ALONE_S
                for fault in self.faults
            )
        return not self.is_calm and self.platform.vehicle.type in ON_ROTORS and self._is_gone("fix", now_s)

    def _is_gone(self, sensor: str, now_s: float) -> bool:
        for fault in self.faults:
            if fault.kind == "sensor" and fault.given.target == sensor and fault.given.word in GONE:
                begin_s, lasts_s = fault.begin_s or 0.0, fault.lasts_s or 0.0
                if lasts_s > BLIND_S and begin_s + BLIND_S <= now_s <= begin_s + lasts_s + RECOVERS_S:
                    return True
        return False

    def has_corrupted(self, topic: str) -> bool:
        """Whether a fault corrupts this topic at any time."""
        return any(fault.kind == "topic" and fault.given.target == topic for fault in self.faults)


class FlownMission(NamedTuple):
    """How a flight has ended."""

    t_s: float
    state: str
    """Of the mission."""
    reason: str
    last: TrueMoment | None
    """The last moment; None where the vehicle never had a position."""
    given_s: float
    """How long it was given to end."""
    requested: Sequence[RequestedFlight] = ()
    failures: Sequence[str] = ()
    """Errors that nobody handled, in words."""
    log_problem: str = ""
    """Why the log is not whole; empty where it is, or was not written."""


class Invariant:
    """Something that must hold in every flight. One object judges one flight."""

    name: ClassVar[str]
    sentence: ClassVar[str]
    """What must hold, for people."""
    topics: ClassVar[tuple[str, ...]] = ()
    """Patterns of the topics, below the platform's name, whose messages it is told."""

    def __init__(self, facts: FlightFacts) -> None:
        self.facts: Final = facts
        self.broken: BrokenInvariant | None = None
        """The first time that it did not hold."""

    def receive(self, topic: str, envelope: Envelope[Any], now_s: float) -> None:
        """Handles a message on one of its topics."""

    def observe(self, moment: TrueMoment) -> None:
        """Handles what is truly so, ten times a second."""

    def end(self, flown: FlownMission) -> None:
        """Handles the end of the flight."""

    def break_at(self, t_s: float, text: str) -> None:
        """Reports that it does not hold; the first time counts."""
        if self.broken is None:
            self.broken = BrokenInvariant(invariant=self.name, t_s=round(t_s, 3), text=text)


def load_invariants(own: Sequence[type[Invariant]]) -> tuple[type[Invariant], ...]:
    """Returns the stack's own invariants and those of installed packages.

    Raises:
        Gloc3Error: a package names something that is no invariant.
    """
    found = list(own)
    for point in installed_points(INVARIANTS):
        loaded = point.load()
        if not (isinstance(loaded, type) and issubclass(loaded, Invariant)):
            raise Gloc3Error(f"entry point {point.name!r} of {INVARIANTS} is no invariant: {point.value}")
        found.append(loaded)
    return tuple(found)
