"""The form of a VTOL, rotors or wings: when it changes, and the figures of the change."""

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

_SEEMS_S: Final = 0.2


class VtolForm(IntEnum):
    """What carries the vehicle, numbered as MAV_VTOL_STATE."""

    TO_WINGS = 1
    TO_ROTORS = 2
    ROTORS = 3
    WINGS = 4


@dataclass(slots=True, kw_only=True)
class VtolGains:
    """Figures of the transitions; written by the parameters of each style."""

    blend_m_s: float = 13.0
    """Air speed above which the rotors give way to the wings."""
    wings_m_s: float = 20.0
    """Air speed at which the wings carry it alone."""
    wings_least_s: float = 2.0
    """A transition to wings takes no less."""
    wings_most_s: float = 15.0
    """A transition to wings that takes longer has failed; never where 0."""
    pusher_per_s: float = 0.33
    """How fast the throttle grows in it."""
    rotors_most_s: float = 15.0
    """The rotors have it after so long, however fast it still is."""
    rotors_m_s: float = 6.0
    """Speed over ground below which the rotors have it."""
    braking_m_s2: float = 3.0
    """Mean deceleration of a transition to rotors, by which its place is chosen."""
    wings_height_m: float = 0.0
    """Lower than this over home it does not stay on wings; 0 for no limit."""
    gives_up: bool = True
    """A transition that has failed ends on the rotors; else it is told of, and gone on with."""
    guided_hovers: bool = True
    """ArduPilot: Guided is flown on rotors."""
    return_lands: bool = True
    """A return on wings ends in a landing on rotors, and not in a circle."""

    def stopping_m(self, speed_m_s: float) -> float:
        """Way from wings at a speed over ground to a hover."""
        return speed_m_s * speed_m_s / (2.0 * self.braking_m_s2)


@dataclass(slots=True)
class VtolState:
    """Where a VTOL is between rotors and wings."""

    form: VtolForm = VtolForm.ROTORS
    wants_wings: bool = False
    since_s: float = 0.0
    """When the form began."""
    problem: str = ""
    """Why it went back to its rotors by itself, until a transition is asked for again."""

    _seems_until_s: float = -math.inf

    def seem_to_leave_rotors(self, now_s: float) -> None:
        """Begins to hover in Guided: ArduPilot reports a transition to wings for a moment, and then rotors again."""
        self._seems_until_s = now_s + _SEEMS_S if self.form is VtolForm.ROTORS else -math.inf

    def reported(self, now_s: float) -> VtolForm:
        """The form that it reports."""
        is_other = self.form is VtolForm.ROTORS and now_s < self._seems_until_s
        return VtolForm.TO_WINGS if is_other else self.form

    def want(self, *, wings: bool) -> None:
        """Asks for a form."""
        if wings and not self.wants_wings:
            self.problem = ""
        self.wants_wings = wings

    @property
    def is_settled(self) -> bool:
        """Whether it flies as it is asked to."""
        return self.form is (VtolForm.WINGS if self.wants_wings else VtolForm.ROTORS)

    def begin(self, form: VtolForm, now_s: float) -> None:
        """Goes over to another form."""
        self.form, self.since_s = form, now_s

    def fail(self, problem: str, now_s: float) -> None:
        """Back to the rotors at once."""
        self.problem, self.wants_wings = problem, False
        self.begin(VtolForm.ROTORS, now_s)
