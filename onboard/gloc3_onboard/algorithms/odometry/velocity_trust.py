"""Plausibility check of wheel velocity: failed encoders continue to report wheels at rest."""

from typing import Final

CONTRADICTIONS: Final = 3
"""So many satellite fixes in a row that do not fit mean that the wheels are wrong."""
AGREEMENTS: Final = 20
"""So many velocities in a row that fit what satellites say have the wheels believed again."""
AT_REST_M_S: Final = 0.02
COMMANDED_M_S: Final = 0.2
STANDS_S: Final = 2.0
"""How long the wheels may stand still against a command of at least that speed, without satellites to check, s."""
STOPS_FROM_M_S: Final = 0.5
"""Wheels that turned faster than this, and stand at the next reading, do not brake: their encoders have failed."""

_STAND: Final = "the wheels stand although motion is asked for"


class VelocityTrust:
    """Checks wheel velocities against satellite fixes and commands."""

    def __init__(self) -> None:
        self._is_distrusted = False
        self._agreements = 0
        self._contradictions = 0
        self._stands_since_s: float | None = None
        self._speed_m_s = 0.0
        """The last measured speed."""
        self._has_stopped = False
        """Whether they stand from one reading to the next, although motion is asked for."""

    @property
    def is_doubted(self) -> bool:
        """Whether the last fix has contradicted the wheels, and not often enough yet to distrust them."""
        return self._contradictions > 0

    def fix(self, *, fits: bool) -> bool:
        """Handles a satellite fix; true if it makes the wheels distrusted."""
        self._contradictions = 0 if fits else self._contradictions + 1
        if self._contradictions < CONTRADICTIONS:
            return False
        self._is_distrusted, self._agreements, self._contradictions = True, 0, 0
        return True

    def why_not(
        self, speed_m_s: float, commanded_m_s: float, off_m_s: float, t_s: float, *, has_satellites: bool
    ) -> str:
        """Why a velocity is rejected; empty if it is not.

        Args:
            speed_m_s: the measured speed.
            commanded_m_s: the commanded speed.
            off_m_s: difference from the velocity known without the wheels, while they are distrusted.
            t_s: its time.
            has_satellites: whether satellites are available.
        """
        if self._is_distrusted and has_satellites:
            self._agreements = (
                self._agreements + 1 if off_m_s < 0.1 + 0.1 * speed_m_s and speed_m_s > COMMANDED_M_S else 0
            )
            self._is_distrusted = self._agreements < AGREEMENTS
        if self._is_distrusted:
            return "the wheels contradict the satellites"
        before_m_s, self._speed_m_s = self._speed_m_s, speed_m_s
        stands = speed_m_s <= AT_REST_M_S and commanded_m_s >= COMMANDED_M_S
        self._has_stopped = stands and (self._has_stopped or before_m_s > STOPS_FROM_M_S)
        if self._has_stopped:
            return _STAND
        since_s = self._stands_since_s
        is_reported = since_s is not None and t_s - since_s > STANDS_S
        if has_satellites or speed_m_s > AT_REST_M_S or (commanded_m_s < COMMANDED_M_S and not is_reported):
            self._stands_since_s = None
            return ""
        self._stands_since_s = t_s if since_s is None else since_s
        return _STAND if is_reported else ""
