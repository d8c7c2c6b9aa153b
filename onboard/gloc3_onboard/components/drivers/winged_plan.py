"""AD: has a winged vehicle take off, fly its paths and come home by plans of its autopilot."""

from gloc3.component.component import ActuatorDriver
from gloc3_onboard.components.drivers.winged_flier import WingedFlier, WingedPlanSettings


class WingedPlan(WingedFlier[WingedPlanSettings], ActuatorDriver[WingedPlanSettings]):
    """Performs `take_off`, `return_home` and all that follows waypoints for planes; at the end it circles."""

    loggable = ("uploads", "waypoint")
