"""Stages for the components that fly plans on wings: an autopilot that takes every plan, and a vehicle in the air."""

from typing import Any

from tests.onboard.messages import pose
from tests.onboard.stage import Stage

from gloc3.messages.vehicle import AutopilotPose, AutopilotState, Home
from gloc3.mission.formats.as_it_is import FlyFileOrder
from gloc3_onboard.sensors.devices import CommandAnswer, FileProgress, GeoPath


class Plans:
    """Takes every plan."""

    def __init__(self) -> None:
        self.routes: list[GeoPath] = []
        self.places_reached = 0
        self.file_progress = FileProgress()

    def command_file(self, order: FlyFileOrder, *, continue_at: int) -> int:
        raise AssertionError("no plan of another program is flown here")

    def command_plan(self, way: GeoPath) -> int:
        self.routes.append(way)
        return len(self.routes)

    def answer(self, ticket: int) -> CommandAnswer | None:
        return CommandAnswer(True, "")


def see(found: Stage, state: AutopilotState, height_m: float = 60.0, **more: Any) -> None:
    """Runs a cycle of a component that receives a state of the autopilot, 1 m north and 2 m east of home."""
    here = pose(1.0, 2.0, height_m)
    own = AutopilotPose(
        position_ned_m=here.position_ned_m,
        velocity_ned_m_s=(0.0, 0.0, 0.0),
        ned_from_frd=here.ned_from_frd,
        rate_frd_rad_s=(0.0, 0.0, 0.0),
        origin_geo=(47.0, 8.0, 500.0),
    )
    found.step(pose=here, autopilot_pose=own, autopilot=state, home=Home(position_ned_m=(0.0, 0.0, 0.0)), **more)
