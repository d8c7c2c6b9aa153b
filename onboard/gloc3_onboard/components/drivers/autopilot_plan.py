"""AD: has the autopilot fly a path as a plan: uploaded, read back, started and tracked."""

from typing import ClassVar

from gloc3.component.component import ActuatorDriver
from gloc3.mission.formats.as_it_is import FlyFileOrder
from gloc3.mission.model.arguments import FollowWaypointsOrder
from gloc3.mission.model.model import FLY_FILE
from gloc3_onboard.components.drivers.plan_flier import PlanFlier, PlanSettings


class AutopilotPlan(PlanFlier[PlanSettings], ActuatorDriver[PlanSettings]):
    """Performs `fly_plan`: paths and plans of tasks with `flown_by: autopilot`."""

    performs: ClassVar = {"fly_plan": FollowWaypointsOrder, FLY_FILE: FlyFileOrder}
    loggable = ("uploads", "waypoint")
