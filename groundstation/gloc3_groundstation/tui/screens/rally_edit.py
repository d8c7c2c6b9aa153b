"""The map's editing of a vehicle's rally points: read from the vehicle, edited here, uploaded and read back."""

from functools import partial
from typing import Final

from gloc3.messages.frames import GeoPoint
from gloc3_groundstation.desk.plan_desk import RallyPoint
from gloc3_groundstation.desk.service_jobs import ServiceKind
from gloc3_groundstation.desk.services_desk import ServicesDesk, reached
from gloc3_groundstation.desk.vehicle_desk import VehicleDesk
from gloc3_groundstation.mapping.ground import Ground
from gloc3_groundstation.mapping.handles import Handle, HandleKind, MissionPlaces, Point
from gloc3_groundstation.missions.place_edits import EditHistory
from gloc3_groundstation.tui.screens.place_edit import PlaceEdit
from gloc3_groundstation.tui.views.mission.map import Chart
from gloc3_groundstation.tui.views.mission.map_edit import EditState, draw_edit, rally_line, rally_lines
from gloc3_groundstation.tui.widgets.lines import Line

Points = tuple[RallyPoint, ...]
DEFAULT_HEIGHT_M: Final = 20.0
"""Height above home of the first rally point."""


class RallyEdit(PlaceEdit):
    """Edits the rally points of one vehicle at a time; what is not uploaded is kept for it.

    Args:
        services: reach the vehicles.
    """

    TITLE = "rally points"
    NOTHING_NEAR = "no rally point is near: i adds one here"

    def __init__(self, services: ServicesDesk) -> None:
        super().__init__()
        self._services = services
        self._name = ""
        self._drafts: dict[str, Points] = {}
        self._histories: dict[str, EditHistory[Points]] = {}
        self._ground = Ground(None)

    # --- what is edited ---

    @property
    def vehicle(self) -> VehicleDesk | None:
        """Desk of the vehicle; None where no link leads to it."""
        return reached(self._services, self._name)[0]

    @property
    def points(self) -> Points | None:
        """The rally points as edited; None until they were read from the vehicle."""
        vehicle = self.vehicle
        return self._drafts.get(self._name, vehicle.plans.rally if vehicle is not None else None)

    @property
    def is_changed(self) -> bool:
        """Whether the vehicle is not known to have the points as edited."""
        vehicle = self.vehicle
        return self._name in self._drafts and (vehicle is None or vehicle.plans.rally != self._drafts[self._name])

    def begin(self, vehicle: str | None) -> str:
        """Reads the rally points of a vehicle, unless edited ones are left; returns why not, or an empty text."""
        desk, problem = reached(self._services, vehicle or "")
        if desk is None:
            return problem
        self._name, self.is_on, self.state = vehicle or "", True, EditState()
        if not self.is_changed:
            self._drafts.pop(self._name, None)
            desk.plans.read_rally()
        return ""

    def drawn(self, chart: Chart, cursor: tuple[int, int], place: Point) -> Chart:
        """The chart with the points as handles."""
        platform = chart.view.platform
        if platform is None or platform.name != self._name:
            self.is_on = False
            return chart
        self._ground = chart.ground
        places = self._places()
        chosen = places.find(self.state.chosen.where) if places is not None and self.state.chosen is not None else None
        self.state = self.state._replace(places=places, chosen=chosen, cursor=cursor)
        self.state = self.state._replace(target_ne_m=self.carried(place))
        return chart._replace(rally=None, has_cross=False, overlay=partial(draw_edit, state=self.state))

    def status(self, chart: Chart, place: Point, width: int) -> Line:
        """What is done, or what became of the last request."""
        jobs = self.vehicle.jobs if self.vehicle is not None else None
        job = jobs.running.get(ServiceKind.PLANS) if jobs is not None else None
        outcome = jobs.outcomes.get(ServiceKind.PLANS) if jobs is not None else None
        refusal = outcome.text if outcome is not None and not outcome.is_good else ""
        busy = job.what if job is not None else ""
        return rally_line(self.state, self.outside_m(chart, place), busy=busy, refusal=refusal, width=width)

    def beside(self, width: int) -> list[Line]:
        """The points of the vehicle."""
        return rally_lines(self.state, self._name, is_changed=self.is_changed, width=width)

    # --- changes ---

    def move(self, handle: Handle, to: Point) -> None:
        """Places one elsewhere, at the same height."""
        geo = self._geo(to)
        if geo is not None:
            self._replace(handle, (geo.latitude_deg, geo.longitude_deg, handle.height_m or 0.0))

    def add(self, place: Point) -> None:
        """Adds a point after the chosen one, else at the end."""
        points, geo = self.points, self._geo(place)
        if points is None or geo is None:
            return
        after = _number(self.state.chosen) if self.state.chosen is not None else len(points) - 1
        height_m = points[after][2] if points else DEFAULT_HEIGHT_M
        point = (geo.latitude_deg, geo.longitude_deg, height_m)
        self._edit((*points[: after + 1], point, *points[after + 1 :]))
        self._set(chosen=Handle(("rally", after + 1), HandleKind.RALLY, "", place))  # found again by its number

    def remove(self) -> None:
        """Leaves out the chosen point."""
        points, chosen = self.points, self.state.chosen
        if points is not None and chosen is not None:
            self._edit((*points[: _number(chosen)], *points[_number(chosen) + 1 :]))
            self._set(chosen=None, target_ne_m=None)

    def raise_to(self, height_m: float) -> None:
        """Gives the chosen point another height above home."""
        points, chosen = self.points, self.state.chosen
        if points is not None and chosen is not None:
            latitude, longitude, _ = points[_number(chosen)]
            self._replace(chosen, (latitude, longitude, height_m))

    def undo(self, *, again: bool = False) -> None:
        """Takes the last change back, or makes it again."""
        history, now = self._histories.get(self._name, EditHistory()), self.points or ()
        points = history.redo(now) if again else history.undo(now)
        self._set(message="" if points is not None else "there is nothing to " + ("redo" if again else "undo"))
        if points is not None:
            self._drafts[self._name] = points
            self._set(chosen=None, target_ne_m=None)  # it may not be there

    def upload(self) -> None:
        """Replaces the vehicle's rally points by these."""
        vehicle, points = self.vehicle, self.points
        if vehicle is not None and points is not None:
            self._drafts[self._name] = points
            vehicle.plans.upload_rally(points)

    def _replace(self, handle: Handle, point: RallyPoint) -> None:
        points = self.points
        if points is not None:
            self._edit((*points[: _number(handle)], point, *points[_number(handle) + 1 :]))

    def _edit(self, points: Points) -> None:
        self._histories.setdefault(self._name, EditHistory()).changed(self.points or ())
        self._drafts[self._name] = points
        self._set()

    def _places(self) -> MissionPlaces | None:
        """The points on the map; None while they are not known, or the map has no place on Earth."""
        points, plane = self.points, self._ground.plane
        if points is None or plane is None:
            return None
        handles = []
        for number, (latitude, longitude, height_m) in enumerate(points):
            north, east, _ = plane.ned_from_geo(latitude, longitude, plane.origin.altitude_m)
            label = f"rally point {number + 1}"
            handles.append(Handle(("rally", number), HandleKind.RALLY, label, (north, east), height_m, len(points)))
        return MissionPlaces(tuple(handles), True, lambda place: place)

    def _geo(self, place: Point) -> GeoPoint | None:
        geo = self._ground.geo(*place)
        if geo is None:
            self._set(message="the map has no place on Earth, and rally points need one")
        return geo


def _number(handle: Handle) -> int:
    """Number of a point, from 0."""
    number = handle.where[-1]
    assert isinstance(number, int)
    return number
