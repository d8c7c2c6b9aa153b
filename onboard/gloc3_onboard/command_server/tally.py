"""What a mission has taken: time, way and battery, to be compared with its estimate when it has ended."""

from math import dist

from gloc3.messages.frames import Vector3
from gloc3.mission.executing.items import Program
from gloc3.mission.model.states import ENDED

STEP_M = 0.2
"""The way is summed up in steps of this length, so that the noise of the pose adds nothing."""


class Tally:
    """Follows the loaded mission from its start to its end; what began before this process did is not known."""

    def __init__(self, program: Program | None = None) -> None:
        self.took_s = self.took_m = self.took_battery = -1.0
        """Once the mission has ended: seconds (pauses left out), metres, and the share of the battery; -1: not known."""
        self.program = program
        """The mission that it is of."""
        self._has_begun = False
        self._at: Vector3 | None = None
        self._way_m = 0.0
        self._battery = -1.0

    def look(self, at: Vector3 | None, battery: float, now_s: float) -> None:
        """Takes in where the vehicle is and what is left in its battery.

        Args:
            at: its position in NED, in metres; None where that is not known.
            battery: the share that is left; negative where it is not known.
            now_s: the time.
        """
        program = self.program
        if program is None:
            return
        if program.is_open:
            if not self._has_begun:
                self._has_begun, self._at, self._battery = True, at, battery
            if at is not None and self._at is not None and (step_m := dist(at, self._at)) >= STEP_M:
                self._way_m, self._at = self._way_m + step_m, at
            self._at = self._at or at
        elif program.state in ENDED and self.took_s < 0.0:
            self.took_s = round(program.ran_s(now_s), 1)
            if self._has_begun:
                self.took_m = round(self._way_m, 1)
                is_known = battery >= 0.0 and self._battery >= 0.0
                self.took_battery = round(max(0.0, self._battery - battery), 4) if is_known else -1.0
