"""The class of each behaviour."""

from gloc3.errors import Misuse
from gloc3_sitl.autopilot.behaviours.base import Activity
from gloc3_sitl.autopilot.behaviours.climb import ClimbToHeight
from gloc3_sitl.autopilot.behaviours.follow import Follow
from gloc3_sitl.autopilot.behaviours.hold import Brake, HoldPosition
from gloc3_sitl.autopilot.behaviours.land import LandInPlace
from gloc3_sitl.autopilot.behaviours.mission import MissionFlight
from gloc3_sitl.autopilot.behaviours.orbit import Orbit
from gloc3_sitl.autopilot.behaviours.piloted import Altitude, Position, Stabilize
from gloc3_sitl.autopilot.behaviours.return_home import ReturnFlight
from gloc3_sitl.autopilot.behaviours.streamed import Guided, Offboard, StreamedAttitude
from gloc3_sitl.autopilot.control.setpoint import LANDED, Setpoint
from gloc3_sitl.autopilot.control.vtol_form import VtolForm
from gloc3_sitl.autopilot.craft import Craft
from gloc3_sitl.autopilot.modes import Behaviour, StyleTables


class Terminated(Activity):
    """Motors permanently stopped in flight."""

    __slots__ = ()

    def update(self) -> Setpoint:
        """Nothing."""
        return LANDED


def activity_for(behaviour: Behaviour, craft: Craft, takeoff_down_m: float, style: StyleTables) -> Activity:
    """Starts a behaviour: the style's own activity, or the one of multirotors.

    Args:
        behaviour: what to do.
        craft: the vehicle.
        takeoff_down_m: end of a take-off, as NED down; NaN for the default height above here.
        style: the autopilot's style.
    """
    if behaviour in style.activities:
        return style.activities[behaviour](craft)
    match behaviour:
        case Behaviour.STABILIZE:
            return Stabilize(craft)
        case Behaviour.ALTITUDE:
            return Altitude(craft)
        case Behaviour.POSITION:
            return Position(craft)
        case Behaviour.HOLD:
            return HoldPosition(craft)
        case Behaviour.BRAKE:
            return Brake(craft)
        case Behaviour.TAKE_OFF if craft.vtol is not None and craft.vtol.form is not VtolForm.ROTORS:
            return style.activities[Behaviour.HOLD](craft)
        case Behaviour.TAKE_OFF:
            usual = craft.estimator.inertial.position_ned_m[2] - craft.tuning.takeoff_height_m
            return ClimbToHeight(craft, takeoff_down_m if takeoff_down_m == takeoff_down_m else usual)
        case Behaviour.LAND:
            return LandInPlace(craft)
        case Behaviour.RETURN:
            return ReturnFlight(craft)
        case Behaviour.MISSION:
            return MissionFlight(craft)
        case Behaviour.ORBIT:
            return Orbit(craft)
        case Behaviour.FOLLOW:
            return Follow(craft)
        case Behaviour.STREAMED:
            return Guided(craft) if style.takeoff_in_streamed else Offboard(craft)
        case Behaviour.STREAMED_ATTITUDE:
            return StreamedAttitude(craft)
        case Behaviour.TERMINATED:
            return Terminated(craft)
        case _:
            raise Misuse(f"a multirotor does not support {behaviour}")
