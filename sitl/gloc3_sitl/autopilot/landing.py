"""Tells ground from air, by what a vehicle without foot switches knows."""


class TouchdownDetector:
    """Landed after thrust, motion and wish have agreed for a while; in the air as soon as it climbs."""

    __slots__ = ("_since_s", "is_landed", "landed_s")

    SETTLE_S = 0.5
    """How long the signs of touchdown must last."""
    CERTAIN_S = 3.0
    """After so long without weight on the rotors and without motion it stands, whatever a range finder says."""

    def __init__(self) -> None:
        self.is_landed = True
        self.landed_s = 0.0
        """When it last came to the ground."""
        self._since_s: float | None = None

    def update(
        self,
        now_s: float,
        *,
        is_armed: bool,
        wants_down: bool,
        wants_up: bool,
        thrust_share: float,
        speed_down_m_s: float,
        height_m: float,
    ) -> None:
        """Looks at the state, 50 times a second.

        Args:
            now_s: the time.
            is_armed: motors are on.
            wants_down: the setpoint asks for a descent (or for nothing at all).
            wants_up: the setpoint asks for a climb.
            thrust_share: collective thrust over that of hover.
            speed_down_m_s: estimated vertical speed.
            height_m: over ground by the range finder, NaN where it is not known.
        """
        if not is_armed:
            self._become(True, now_s)
            self._since_s = None
            return
        if self.is_landed:
            if wants_up and thrust_share > 0.9 and (speed_down_m_s < -0.15 or height_m > 0.3):
                self._become(False, now_s)
            return
        is_down = wants_down and thrust_share < 0.6 and abs(speed_down_m_s) < 0.25
        if not is_down:
            self._since_s = None
        elif self._since_s is None:
            self._since_s = now_s
        elif now_s - self._since_s >= (self.CERTAIN_S if height_m > 0.5 else self.SETTLE_S):
            self._become(True, now_s)
            self._since_s = None

    def _become(self, is_landed: bool, now_s: float) -> None:
        if is_landed and not self.is_landed:
            self.landed_s = now_s
        self.is_landed = is_landed
