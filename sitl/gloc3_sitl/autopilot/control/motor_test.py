"""A motor test: one motor turns by itself for a short time, while the vehicle is disarmed."""

from gloc3_sitl.autopilot.control.control import Outputs


class MotorTest:
    """The motor that is tested, if any."""

    def __init__(self) -> None:
        self._motor = 0
        self._share = 0.0
        self._end_s = 0.0

    def begin(self, motor: int, share: float, end_s: float) -> None:
        """Turns a motor, from 1, with a share of full throttle; another test ends."""
        self._motor, self._share, self._end_s = motor, share, end_s

    def stop(self) -> None:
        """Ends the test."""
        self._motor = 0

    def outputs(self, stopped: Outputs, now_s: float) -> Outputs:
        """The outputs of a disarmed vehicle."""
        if not self._motor or now_s >= self._end_s:
            return stopped
        return tuple(self._share if number == self._motor else output for number, output in enumerate(stopped, start=1))
