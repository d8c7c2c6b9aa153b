"""Arguments of an exploration: an area, a height and a time."""

from typing import Annotated

import msgspec

from gloc3.errors import Refused
from gloc3.messages.frames import Vector3
from gloc3.mission.model.arguments import DEFAULT_SPEED_M_S, Arguments
from gloc3.mission.model.fence import polygon_problem
from gloc3.mission.model.legs import Budget, FlightLeg
from gloc3.mission.model.patterns import AtSurveyHeight, GeoArea, LocalArea
from gloc3.mission.model.placement import Placement, Point, written_for

Duration = Annotated[float, msgspec.Meta(ge=1.0, le=86_400.0)]


class ExploreOrder(Arguments, frozen=True, kw_only=True):
    """Look at everything that can be seen in an area."""

    moves = True

    area_ne_m: tuple[Point, ...] = ()
    """Corners, north and east; empty for all that is inside the fence."""
    down_m: float
    """Height to fly at, as NED."""
    speed_m_s: float
    duration_s: float

    def legs(self, start_ned_m: Vector3, budget: Budget) -> tuple[FlightLeg, ...]:
        """To the height; where it goes then is not known before, and is counted as staying there."""
        at = (start_ned_m[0], start_ned_m[1], self.down_m)
        climb_s = abs(self.down_m - start_ned_m[2]) / budget.climb_m_s
        return (
            FlightLeg(start=start_ned_m, end=at, duration_s=climb_s),
            FlightLeg(start=at, end=at, duration_s=self.duration_s),
        )


class Explore(AtSurveyHeight, frozen=True, kw_only=True):
    """Fly to where the map ends until everything in an area that can be seen has been seen, at one height."""

    example = "{area_m: [[0, 0], [18, 0], [18, 10], [0, 10]], height_m: 1.5}"

    area_m: LocalArea | None = None
    """Corners `[x, y]`, in a local frame; without them, all that is inside the mission's fence."""
    area: GeoArea | None = None
    """Corners `[latitude, longitude]`, in frame geo."""
    duration_s: Duration = 300.0
    """It ends, as done, after so long at the latest; the estimate counts all of it."""

    def order(self, placement: Placement) -> ExploreOrder:
        """The area in NED."""
        area = written_for(placement, self.area_m, self.area, "area")
        places = [placement.ned_from((*corner, 0.0)) for corner in area or ()]
        corners = tuple((north, east) for north, east, _ in places)
        if corners and (problem := polygon_problem(corners)):
            raise Refused(problem)
        return ExploreOrder(
            area_ne_m=corners,
            down_m=-placement.height_from(self.height_m or 0.0),
            speed_m_s=self.speed_m_s or DEFAULT_SPEED_M_S,
            duration_s=self.duration_s,
        )
