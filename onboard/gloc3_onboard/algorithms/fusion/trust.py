"""Trust in one source: its gate, its record and its readmission."""

from collections import deque
from typing import Final

from gloc3.messages.perception import SourceState
from gloc3_onboard.algorithms.fusion.measurements import CHI2_999

DISAGREES: Final = "it does not agree with the estimate"
_MISSES, _STRAY_MISSES = 5, 7
"""Measurements in a row that fail the gate before the source is turned down; the second, where most are strays: by
chance alone, one of five that is a stray makes that once in 80,000 reports."""
_COARSE: Final = 4.0
"""So many times the gate is coarse."""
_SLIPS: Final = 2
"""Misses in a row that do not end a probation."""
_SMOOTHING: Final = 0.05
"""Share of a new innovation in the smoothed one."""
SOUND: Final = 1.5
"""Smoothed innovations of one that can be believed are below that;"""
_SOUND_AGAIN: Final = 1.0
"""and of one that can be believed again below that."""
_WIDEST: Final = 6.0
"""Largest factor of widening of a source's covariance: up to it, a source with large innovations is still used."""
_SAME: Final = 4
"""Equal reports in a row, while the body moves, that show a frozen sensor."""


class Trust:
    """The record of one source.

    A source is *used* until it is rejected: by its gate, by being frozen or silent, or by the vote of the others. A
    rejected source is still evaluated, and used again after it has agreed without interruption for the probation time;
    one that was voted out also needs the vote of the others.
    """

    def __init__(self, name: str, probation_s: float) -> None:
        self.name: Final = name
        self.reason = ""
        """Why it is not used; empty while it is."""
        self.is_voted_out = self.is_alone = False
        self.is_coarse = False
        """It was turned down for innovations far beyond its gate: not for what any estimate may have been dragged to."""
        self.accepted = self.rejected = 0
        self.valid_s = float("-inf")
        """Time of validity of the last measurement."""
        self.received_s = float("-inf")
        """Arrival of the last message of any kind."""
        self.used_s = float("-inf")
        """Time of the last accepted measurement."""
        self.missed_s = float("-inf")
        """Time of the first of the measurements in a row that fail the gate."""
        self.down_s = float("-inf")
        """When it was last turned down for not agreeing with the estimate."""
        self.innovation = 1.0
        """Normalised innovation squared over its degrees of freedom, smoothed."""
        self._unconfirmed: deque[float] = deque(maxlen=_MISSES)
        """Innovations of strays since the last measurement that was none."""
        self._probation_s = probation_s
        self._misses, self._missed_by, self._strays = 0, 0.0, 0
        self._has_stepped_back = False
        self._is_unusable = False
        """It was turned down for messages that could not be used, such as by their time, and nothing else."""
        self._good_since_s: float | None = None
        self.is_stray = False
        """The last measurement has missed the gate, and is not where the ones before it lead to: no evidence yet."""
        self._last: tuple[float, ...] = ()
        self._same = 0
        self._same_since: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def is_used(self) -> bool:
        """Whether its measurements are used."""
        return not self.reason

    @property
    def is_turned_down(self) -> bool:
        """Whether it is not used for what it has told, not for silence or for messages that could not be used."""
        return not self.is_used and not self._has_stepped_back and not self._is_unusable

    @property
    def is_out_of_step(self) -> bool:
        """Whether it is not used, and its last measurement has failed the gate."""
        return not self.is_used and self._good_since_s is None

    @property
    def is_failing(self) -> bool:
        """Whether its measurements do not pass the gate, one after the other."""
        return self.reason == DISAGREES or (self.is_used and self._misses > _SLIPS)

    @property
    def may_vote(self) -> bool:
        """Whether it may vote: used, or rejected by the estimate alone, which may be wrong itself."""
        return self.is_used or ((self.reason == DISAGREES or self.is_alone) and not self.is_voted_out)

    @property
    def widening(self) -> float:
        """Factor on its covariance, where its innovations are larger than it claims."""
        return min(max(self.innovation / SOUND, 1.0), _WIDEST)

    def judge(self, innovation: float, degrees: int, t_s: float, *, is_steady: bool = True) -> bool:
        """Gates a measurement by its normalised innovation squared; true if it is to be used.

        Args:
            innovation: with the covariance as widened.
            degrees: of freedom.
            t_s: time of validity.
            is_steady: it is where the ones before it lead to.
        """
        # Gate: chi-square at 99.9 %; below, a low-pass of the innovation per degree of freedom, 1 where R is honest.
        passes = innovation <= CHI2_999[degrees]
        self.is_stray = not passes and not is_steady
        self._smooth(innovation, degrees)
        if not passes:
            self.rejected += 1
            self.missed_s = self.missed_s if self._misses else t_s
            self._misses += 1
            self._strays += self.is_stray
            self._missed_by += innovation / CHI2_999[degrees]
            if self._misses > _SLIPS:
                self._good_since_s = None
            limit = _STRAY_MISSES if 2 * self._strays > self._misses else _MISSES
            if self._misses >= limit and self.is_used:
                self.turn_down(DISAGREES)
                self.down_s = t_s
                self.is_coarse = self._missed_by > _COARSE * self._misses
            return False
        self._misses, self._missed_by, self._strays = 0, 0.0, 0
        if self._has_stepped_back:
            self.let_in()
        if not self.is_used:
            if self._good_since_s is None:
                self._good_since_s = t_s
            # Readmit after the probation without a miss, unless voted out or still unsound.
            is_sound = self.innovation < _SOUND_AGAIN or not self.is_alone
            if t_s - self._good_since_s < self._probation_s or self.is_voted_out or not is_sound:
                return False
            self.let_in()
        self.accepted += 1
        self.used_s = t_s
        return True

    def _smooth(self, innovation: float, degrees: int) -> None:
        """Follows the innovation; one that no widening explains counts once it is confirmed as no stray."""
        share = min(innovation / degrees, 4.0) * self.widening
        if self.is_stray and innovation * self.widening > _WIDEST * CHI2_999[degrees]:
            self._unconfirmed.append(share)
            return
        if innovation > CHI2_999[degrees]:
            for before in self._unconfirmed:
                self.innovation += _SMOOTHING * (before - self.innovation)
        self._unconfirmed.clear()
        self.innovation += _SMOOTHING * (share - self.innovation)

    def refuse(self, reason: str) -> None:
        """Records an unusable message."""
        self.rejected += 1
        self._good_since_s = None
        self._misses += 1
        if self._misses >= _MISSES or not self.is_used:
            is_blameless = not self.is_turned_down
            self.turn_down(reason)
            self._is_unusable = is_blameless

    def step_back(self, reason: str) -> None:
        """Suspends a silent or invalid source until its first good measurement."""
        if self.is_used:
            self._has_stepped_back = True
            self.reason = reason

    def turn_down(self, reason: str, *, is_voted_out: bool = False, is_alone: bool = False) -> None:
        """Stops using it; with `is_alone` until its innovations are sound again."""
        self.is_alone = self.is_alone or is_alone
        self._has_stepped_back = self._is_unusable = False
        self.reason = reason
        self.is_voted_out = self.is_voted_out or is_voted_out
        self._good_since_s = None

    def let_in(self) -> None:
        """Readmits it."""
        self.reason = ""
        self.is_voted_out = self.is_alone = False
        self._has_stepped_back = self._is_unusable = self.is_coarse = False
        self._misses, self._missed_by, self._strays = 0, 0.0, 0
        self.innovation = 1.0
        self._good_since_s = None

    def is_frozen(
        self,
        numbers: tuple[float, ...],
        position: tuple[float, float, float],
        is_moving: bool,
        least_m: float = 0.015,
    ) -> bool:
        """Whether it repeats the same numbers although the body has moved.

        Args:
            numbers: the present report.
            position: estimated position of the body.
            is_moving: whether the inertial unit measures motion.
            least_m: over a longer way it cannot but report other numbers.
        """
        if numbers != self._last:
            self._last, self._same, self._same_since = numbers, 1, position
            return False
        self._same += 1
        if self._same < _SAME:
            return False
        moved_m2 = sum((a - b) ** 2 for a, b in zip(position, self._same_since, strict=True))
        return moved_m2 > least_m**2 or (is_moving and self._same >= 5 * _SAME)

    @property
    def is_repeating(self) -> bool:
        """Whether it has told the same numbers several times in a row, as a frozen sensor does and one at rest."""
        return self._same >= _SAME

    def state(self) -> SourceState:
        """Its state, as a message."""
        return SourceState(
            source=self.name,
            is_used=self.is_used,
            reason=self.reason,
            accepted=self.accepted,
            rejected=self.rejected,
            innovation=self.innovation,
        )
