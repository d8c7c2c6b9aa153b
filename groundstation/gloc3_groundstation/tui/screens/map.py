"""The map of the vehicle in view and the others around it, with a profile of heights below."""

from typing import ClassVar, Final

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical

from gloc3.messages.watch import Want
from gloc3_groundstation.mapping.ground import Ground, position_of
from gloc3_groundstation.mapping.progress import PathProgress
from gloc3_groundstation.mapping.projection import Projection
from gloc3_groundstation.mapping.requested import Requested, requested
from gloc3_groundstation.missions.plans import MissionTexts
from gloc3_groundstation.tui.keys import MISSION_KEYS
from gloc3_groundstation.tui.screens.map_keys import EditableMap
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.views.mission.map import (
    Chart,
    cursor_line,
    extent,
    is_within,
    legend_lines,
    map_lines,
    map_title,
    own_place,
    tone_of_vehicle,
    vehicle_lines,
)
from gloc3_groundstation.tui.views.mission.profile import along_lines, time_lines
from gloc3_groundstation.tui.widgets.canvas import CELL
from gloc3_groundstation.tui.widgets.canvas_panel import CanvasPanel
from gloc3_groundstation.tui.widgets.panel import Panel

VIEWER: Final = "map"
WATCHED: Final = (Want("obstacles", 2.0), Want("map", 0.5))
EYES_S: Final = 2.0
"""Time without a redraw after which a map counts as hidden, s."""
STEP: Final = 0.125
"""Of the map's width or height, that a key moves it by."""
CALM: Final = 0.3
"""Distance of the vehicle from the centre, as a share of the map, within which a following map does not move."""


class MapScreen(EditableMap):
    """Plan view and height profile."""

    HELP = f"""The requested path (dashed), the vehicles and their trails (each in its colour, with its name), the
    fence, home, obstacles, what the vehicle's own map shows as occupied (dim), and the 95 % ellipse of the position. The cross marks the setpoint.

    The + in the middle is the cursor, and so is the mouse: its coordinates are below the map, with distance and
    bearing from the vehicle in view. The map fits everything until you move it; z fits it again.

    {EditableMap.EDIT_HELP}"""
    BINDINGS: ClassVar[list[BindingType]] = [
        *EditableMap.EDIT_BINDINGS,
        Binding("f", "follow", "Follow", tooltip="keep the vehicle in view on the map"),
        Binding("z", "fit", "Fit", tooltip="show everything"),
        Binding("plus,equals_sign", "zoom(1)", "Zoom", key_display="+ -", tooltip="in and out"),
        Binding("minus,underscore", "zoom(-1)", "Zoom out", show=False),
        Binding("left,h", "pan(-1, 0)", "Move", show=False, key_display="← ↓ ↑ →", tooltip="the map; also h j k l"),
        Binding("right,l", "pan(1, 0)", "Right", show=False),
        Binding("up,k", "pan(0, 1)", "Up", show=False),
        Binding("down,j", "pan(0, -1)", "Down", show=False),
        Binding("d", "profile", "Heights", tooltip="height profile: along the path, over time, none"),
        Binding("o", "turn", "Turn", tooltip="turn the map by 90 degrees"),
        *MISSION_KEYS,
    ]
    AUTO_FOCUS = "#map"
    _profile: int | None = None
    """0 along the path, 1 over time, 2 none; None until the operator has chosen: along the path where there is room."""
    _progress: tuple[tuple[object, ...], PathProgress] | None = None
    _texts: MissionTexts | None = None

    def body(self) -> ComposeResult:
        """The map with what belongs to it below, and the vehicles beside it."""
        with Horizontal():
            with Vertical(id="chart"):
                yield CanvasPanel(id="map")
                yield Panel(id="cursor", classes="plain line", can_focus=False)
                yield CanvasPanel(id="profile", can_focus=False)
            with Vertical(id="around"):
                yield Panel(id="vehicles", can_focus=False)
                yield Panel(id="signs", can_focus=False)

    def on_screen_suspend(self) -> None:
        """Asks for obstacles and map no more."""
        self.desk.station.monitor.unwatch(VIEWER)

    def show_view(self, view: StationView) -> None:
        """Asks for obstacles and map, and draws it."""
        self._watch(view)
        panel, profile = self.query_one("#map", CanvasPanel), self.query_one("#profile", CanvasPanel)
        width, height = panel.width, panel.size.height
        if width <= 0 or height <= 0:
            return
        chart = self._chart(view, width, height)
        follows = f", following {view.platform.name}" if self._is_following and view.platform is not None else ""
        panel.show(
            map_lines(chart, width, height), f"{'edit' if self.edit.is_on else 'map'}: {map_title(chart)}{follows}"
        )
        place = (chart.projection.north_m, chart.projection.east_m)
        if self._pointed is not None:
            place = self.cursor_place()
        cursor = cursor_line(chart, place, self.panel("cursor").width)
        self.panel("cursor").show([cursor, *self.state_lines(chart)])
        self._show_profile(chart, profile)
        if not self.show_open_mission():
            self.panel("vehicles").show(vehicle_lines(chart), "vehicles")
        self.panel("signs").show(legend_lines(chart), "signs")

    # --- keys ---

    def action_follow(self) -> None:
        """Toggles following the vehicle."""
        self._is_following, self._is_fitting = not self._is_following, False
        self.show_again()

    def action_fit(self) -> None:
        """Shows everything."""
        self._is_fitting, self._is_following = True, False
        self._fitted = None
        self.show_again()

    def action_zoom(self, steps: int) -> None:
        """Comes nearer, or goes away."""
        self._is_fitting = False
        self._projection = self._projection.zoomed(steps)
        self.show_again()

    def action_pan(self, right: int, up: int) -> None:
        """Moves the map; in the edit mode the crosshair."""
        if self.edit.is_on:
            self.move_cursor(right, up)
            return
        self._is_fitting = self._is_following = False
        self._pointed = None
        self._projection = self._projection.moved(STEP * right, STEP * up)
        self.show_again()

    def action_turn(self) -> None:
        """Turns the map."""
        self._projection = self._projection._replace(up_deg=(self._projection.up_deg + 270.0) % 360.0)
        self._fitted = None
        self.show_again()

    def action_profile(self) -> None:
        """The next kind of profile."""
        self._profile = (self._profile_kind + 1) % 3
        self.show_again()

    # --- what is seen ---

    def _watch(self, view: StationView) -> None:
        """Watches the scanner hits and the map of the selected vehicle, if it has a scanner."""
        monitor, platform = self.desk.station.monitor, view.platform
        if platform is None or not platform.has_companion:
            monitor.unwatch(VIEWER)
            return
        monitor.unwatch(VIEWER, except_from=platform.name)
        monitor.list_topics(platform.name)
        there = {entry.name for entry in monitor.watches.entries(platform.name)}
        if wanted := [want for want in WATCHED if want.topic in there]:
            monitor.watch(VIEWER, platform.name, wanted, for_s=EYES_S)

    def _chart(self, view: StationView, width: int, height: int) -> Chart:
        if self._texts is None:
            self._texts = MissionTexts(self.desk.station)
        ground = Ground(view.platform)
        text, is_loaded = self._texts.text_of(view.platform, view.plan)
        if self.is_mission_edited and self.desk.missions.draft is not None:
            text, is_loaded = self.desk.missions.draft.carried or self.desk.missions.draft.text, False
        if view.platform is not None and self._texts.missing(view.platform, view.now_s):
            self.do(self._texts.fetch(view.platform))
        request = requested(text, ground.site, self.desk.station.terrain) if text else None
        projection = self._projection.sized(width * CELL[0], height * CELL[1])
        chart = Chart(view, ground, projection, request, is_loaded, not self._pointed, self.rally_points())
        projection = self._framed(chart)
        self._projection = projection
        return self.edited(chart._replace(projection=projection))

    def _framed(self, chart: Chart) -> Projection:
        """The part of the map that is to be seen."""
        projection, platform = chart.projection, chart.view.platform
        name = platform.name if platform is not None else ""
        parts = extent(chart)
        seen = name, len(parts), projection.width, projection.height
        if self._is_fitting and (seen != self._fitted or not is_within(parts, projection)):
            self._fitted = seen
            return projection.fitted(parts)
        position = position_of(platform) if platform is not None else None
        if self._is_following and position is not None:
            north, east, _ = own_place(chart).point(position)
            x, y = projection.dot(north, east)
            if (
                abs(x - projection.width / 2.0) > CALM * projection.width
                or abs(y - projection.height / 2.0) > CALM * projection.height
            ):
                return projection._replace(north_m=north, east_m=east)
        return projection

    @property
    def _profile_kind(self) -> int:
        return self._profile if self._profile is not None else 0 if self.has_class("-tall") else 2

    def _show_profile(self, chart: Chart, panel: CanvasPanel) -> None:
        kind, platform = self._profile_kind, chart.view.platform
        panel.display = kind != 2
        width, height = panel.width, panel.size.height
        if kind == 2 or width < 20 or height < 3 or platform is None:
            return
        tone = tone_of_vehicle(chart.view.number - 1)
        if kind == 0 and chart.request is not None and len(chart.request.path_ned_m) > 1:
            progress = self._followed(chart, chart.request)
            panel.show(along_lines(chart.request, progress, tone, width, height), "height m, along the path")
        else:
            lines = time_lines(chart.view.tracks, platform.name, tone, chart.view.now_s, width, height)
            panel.show(lines, "height m, over time")

    def _followed(self, chart: Chart, request: Requested) -> PathProgress | None:
        """How far the vehicle in view has come since its mission was started."""
        platform = chart.view.platform
        track = chart.view.tracks.get(platform.name) if platform is not None else None
        if platform is None or track is None or track.started_s is None or not chart.is_loaded:
            return None
        key = platform.name, request.path_ned_m, track.started_s
        if self._progress is None or self._progress[0] != key:
            self._progress = key, PathProgress(request.path_ned_m)
            self._progress[1].until_s = track.started_s
        progress = self._progress[1]
        points = track.trail.points
        points = points[points[:, 3] > progress.until_s]
        if len(points):
            place = own_place(chart)
            plane = place.plane(points[:, :2])
            rows = points.copy()
            rows[:, :2], rows[:, 2] = plane, -points[:, 2]
            progress.advance(rows, self._begun_m(chart, request))
        return progress

    def _begun_m(self, chart: Chart, request: Requested) -> float:
        """Position on the path at which the current action begins."""
        mission = chart.view.platform.mission if chart.view.platform is not None else None
        running = mission.value.tasks if mission is not None else {}
        return next((path.starts_m for path in request.paths if running.get(path.target) == "running"), 0.0)
