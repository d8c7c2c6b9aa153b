"""Detects a vehicle on wings that circles at the end of a return which its autopilot has begun."""

from math import atan2, hypot, inf, tau
from typing import Final

from gloc3.messages.frames import wrap_pi
from gloc3.messages.vehicle import AutopilotState, FlightMode, Pose, VehicleClass, VtolForm

TURNS: Final = 3.0
"""After so many level turns in one direction it has arrived, and circles without end."""
LEVEL_M: Final = 10.0
"""A circle in which it climbs or descends by more leads somewhere: to a height, or to a landing."""
MOVES_M_S: Final = 3.0
"""Slower motion over the ground has no course, in m/s."""


class CirclingWatch:
    """Counts the level turns of one return."""

    __slots__ = ("_course_rad", "_height_m", "_turned_rad")

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """It does not return, or nothing is known of its path."""
        self._course_rad: float | None = None
        self._turned_rad, self._height_m = 0.0, inf

    @property
    def is_circling(self) -> bool:
        """Whether it has arrived and circles."""
        return abs(self._turned_rad) >= TURNS * tau

    def update(self, autopilot: AutopilotState, pose: Pose | None) -> None:
        """Follows the path.

        Args:
            autopilot: its state.
            pose: the present pose; None where none is known.
        """
        is_on_wings = autopilot.vehicle is VehicleClass.PLANE or autopilot.form is VtolForm.WINGS
        if pose is None or not is_on_wings or autopilot.mode is not FlightMode.RETURN:
            self.clear()
            return
        height_m, (north_m_s, east_m_s, _) = -pose.position_ned_m[2], pose.velocity_ned_m_s
        if abs(height_m - self._height_m) > LEVEL_M:
            self._turned_rad, self._height_m = 0.0, height_m
        if hypot(north_m_s, east_m_s) < MOVES_M_S:
            return
        course_rad = atan2(east_m_s, north_m_s)
        if self._course_rad is not None:
            self._turned_rad += wrap_pi(course_rad - self._course_rad)
        self._course_rad = course_rad
