"""AD: has the autopilot fly a way by itself, as a plan that is uploaded, read back, started and followed."""

from typing import ClassVar

from gloc3.component.component import ActuatorDriver
from gloc3.mission.model.arguments import FollowWaypointsOrder
from gloc3_onboard.components.drivers.plan_flier import PlanFlier, PlanSettings


class AutopilotPlan(PlanFlier[PlanSettings], ActuatorDriver[PlanSettings]):
    """Flies `fly_plan`: ways of tasks that say `flown_by: autopilot`."""

    performs: ClassVar = {"fly_plan": FollowWaypointsOrder}
    loggable = ("uploads", "waypoint")
