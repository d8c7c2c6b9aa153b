"""Properties of a vehicle class that the autopilot's parameters do not hold."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

from gloc3_sitl.autopilot.control.control import ControlLoops
from gloc3_sitl.autopilot.control.drive import DriveControl
from gloc3_sitl.autopilot.control.multirotor import MultirotorControl
from gloc3_sitl.autopilot.control.vtol import VtolControl
from gloc3_sitl.autopilot.control.wings import WingControl
from gloc3_sitl.autopilot.craft import Craft


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotClass:
    """A class of vehicles, as an autopilot sees it."""

    mav_type: int
    """MAV_TYPE, as in its HEARTBEAT."""
    control: Callable[[Craft], ControlLoops]
    """Makes its control loops."""
    reports_landed: bool = True
    """Whether EXTENDED_SYS_STATE reports landed or in air; otherwise undefined."""
    floats: bool = False
    """Whether it rocks on the water at rest."""
    output_numbers: tuple[int, ...] = (1, 2, 3, 4)
    """Number of the autopilot's output for each of the control's, from 1."""
    neutral_us: int = 1000
    """Pulse length of an output of 0."""
    span_us: int = 1000
    """Microseconds from there to an output of 1."""


ROVER: Final = AutopilotClass(
    mav_type=10, control=DriveControl, reports_landed=False, output_numbers=(1, 3), neutral_us=1500, span_us=500
)
"""A rover with left and right drives: ThrottleLeft and ThrottleRight on Rover's outputs."""
BOAT: Final = replace(ROVER, mav_type=11, floats=True)
"""A boat with a left and a right propeller."""
MULTIROTOR: Final = AutopilotClass(mav_type=2, control=MultirotorControl)
"""A quadrotor."""
PLANE: Final = AutopilotClass(mav_type=1, control=WingControl, neutral_us=1500, span_us=500)
"""A plane: ailerons, elevator, throttle (no drive at 1000 us), rudder."""
VTOL: Final = AutopilotClass(
    mav_type=22, control=VtolControl, output_numbers=tuple(range(1, 9)), neutral_us=1500, span_us=500
)
"""A plane with four lift rotors, MAV_TYPE_VTOL_FIXEDROTOR: the plane's outputs, then the rotors' (no drive at 1500 us)."""
