"""The map in plan view: requested paths, vehicles with their trails, and obstacles."""

from collections.abc import Callable, Iterable, Iterator
from math import atan2, cos, degrees, hypot, radians, sin, sqrt
from typing import Final, NamedTuple

import numpy as np

from gloc3.mission.model.states import ENDED, ActionState
from gloc3_groundstation.mapping.ground import CIRCLE, Ground, MapPlacement, Plane, heading_deg_of, outline, position_of
from gloc3_groundstation.mapping.occupied import occupied_of
from gloc3_groundstation.mapping.projection import Projection, length_text, round_length
from gloc3_groundstation.mapping.requested import ActionPath, Requested
from gloc3_groundstation.station import wording
from gloc3_groundstation.station.snapshots import PlatformSnapshot
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.views.mission.traffic import TRAFFIC_SIGN, draw_traffic
from gloc3_groundstation.tui.widgets.canvas import CELL, CellCanvas
from gloc3_groundstation.tui.widgets.lines import ONE_OF_MANY, Line, Span, Tone

SURE: Final = sqrt(5.991)
"""Half axes of the ellipse in which a position is with 95 %, in standard deviations (chi square of two degrees)."""
ARROW: Final = ((4.5, 0.0), (-3.0, 3.0), (-1.5, 0.0), (-3.0, -3.0))
"""A vehicle in dots: forward and to the right."""
AHEAD: Final = 9.0
"""Length of the line that shows the heading of the selected vehicle."""
NEAR: Final = 8.0
"""Distance in dots below which a mark cannot be distinguished from the vehicle: its setpoint, the edge of its
ellipse."""
RALLY_SIGN: Final = "R"
SAME_HOME_M: Final = 1.0
"""Distance from the vehicle's home within which its autopilot's is the same."""
ARROWS: Final = "↑↗→↘↓↙←↖"


class Chart(NamedTuple):
    """Contents of the map, and the visible part."""

    view: StationView
    ground: Ground
    projection: Projection
    request: Requested | None = None
    """What the vehicle in view is to fly."""
    is_loaded: bool = False
    """Whether it has that loaded."""
    has_cross: bool = True
    """Whether the middle is marked."""
    rally: tuple[tuple[float, float, float], ...] | None = None
    """Rally points of the vehicle in view: latitude and longitude in degrees, height; None where they are not shown."""
    overlay: "Callable[[CellCanvas, Chart], None] | None" = None
    """Draws over everything else, such as what is edited."""

    @property
    def placed(self) -> Iterator[tuple[int, PlatformSnapshot, MapPlacement]]:
        """Vehicles on this map with their numbers, the selected one last."""
        found = []
        for number, platform in enumerate(self.view.fleet):
            place = self.ground.place(platform)
            if place is not None:
                found.append((number, platform, place))
        in_view = self.view.platform.name if self.view.platform is not None else ""
        yield from sorted(found, key=lambda each: each[1].name == in_view)


def tone_of_vehicle(number: int) -> Tone:
    """Tone of a vehicle by its number, counted from 0 in the order of first contact."""
    return ONE_OF_MANY[number % len(ONE_OF_MANY)]


def map_lines(chart: Chart, width: int, height: int) -> list[Line]:
    """Lines of the map at this size."""
    canvas = CellCanvas(width, height)
    own = own_place(chart)
    if chart.request is not None:
        _draw_fence(canvas, chart, chart.request, own)
        _draw_paths(canvas, chart, chart.request, own)
    _draw_map(canvas, chart)
    _draw_obstacles(canvas, chart)
    for number, platform, place in chart.placed:
        _draw_trail(canvas, chart, number, platform, place)
    if chart.request is not None:
        _draw_waypoints(canvas, chart, chart.request, own)
    _draw_home(canvas, chart, own)
    _draw_rally(canvas, chart)
    draw_traffic(canvas, chart.view, chart.ground, chart.projection)
    for number, platform, place in chart.placed:
        _draw_vehicle(canvas, chart, number, platform, place)
    _draw_frame(canvas, chart)
    if chart.overlay is not None:
        chart.overlay(canvas, chart)
    return canvas.lines()


def extent(chart: Chart) -> list[Plane]:
    """Everything that should be seen when the map is fitted."""
    own = own_place(chart)
    parts: list[Plane] = []
    if chart.request is not None:
        fence = chart.request.fence
        if fence is not None and fence.area is not None:
            parts.append(own.plane_of_ne(outline(fence.area)))
        parts += [own.from_ned(np.array(path.points_ned_m)) for path in chart.request.paths]
    site = chart.ground.site
    if site is not None and site.home_m is not None:
        parts.append(np.array([own.point(site.home_m)[:2]]))
    home = autopilot_home(chart)
    parts += [np.array([place]) for place in (*([home] if home is not None else []), *_rally_places(chart))]
    for _, platform, place in chart.placed:
        position = position_of(platform)
        if position is not None:
            parts.append(np.array([place.point(position)[:2]]))
    return parts


def is_within(parts: Iterable[Plane], projection: Projection) -> bool:
    """Whether all points are on the screen."""
    for part in parts:
        dots = projection.dots(part)
        if (dots < 0).any() or (dots > (projection.width, projection.height)).any():
            return False
    return True


# --- the parts ---


def own_place(chart: Chart) -> MapPlacement:
    """Where the frame of the vehicle in view lies."""
    platform = chart.view.platform
    return (chart.ground.place(platform) if platform is not None else None) or MapPlacement()


def _draw_fence(canvas: CellCanvas, chart: Chart, request: Requested, own: MapPlacement) -> None:
    if request.fence is None:
        return
    for area in request.fence.keep_out:
        edge = chart.projection.dots(own.plane_of_ne(outline(area)))
        canvas.area(edge, Tone.BAD, hatch=4)
        canvas.line(edge, Tone.BAD)
    if request.fence.area is not None:
        canvas.line(chart.projection.dots(own.plane_of_ne(outline(request.fence.area))), Tone.WARN)


def _draw_paths(canvas: CellCanvas, chart: Chart, request: Requested, own: MapPlacement) -> None:
    for path in sorted(request.paths, key=lambda path: not _is_over(chart, path)):
        dots = chart.projection.dots(own.from_ned(np.array(path.points_ned_m)))
        if _is_over(chart, path) or not chart.is_loaded:
            canvas.line(dots, Tone.DIM, on=1, off=3)
        else:
            canvas.line(dots, Tone.TEXT, on=3, off=2)


def _is_over(chart: Chart, path: ActionPath) -> bool:
    mission = chart.view.platform.mission if chart.view.platform is not None else None
    if mission is None or not chart.is_loaded:
        return False
    state = mission.value.tasks.get(path.target, "")
    return state in list(ActionState) and ActionState(state) in ENDED


def _draw_waypoints(canvas: CellCanvas, chart: Chart, request: Requested, own: MapPlacement) -> None:
    """A number at each, the first and how many more where several are at one place."""
    over = {path.target for path in request.paths if _is_over(chart, path)}
    cells: dict[tuple[int, int], list[tuple[int, bool]]] = {}
    for waypoint in request.waypoints:
        north, east = own.from_ned(np.array([waypoint.position_ned_m]))[0]
        cell = cell_of(chart.projection.dot(north, east))
        cells.setdefault(cell, []).append((waypoint.number, waypoint.target in over))
    for (column, row), found in cells.items():
        open_numbers = [number for number, is_over in found if not is_over]
        shown = open_numbers or [number for number, _ in found]
        text = f"{shown[0]}{'+' if len(shown) > 1 else ''}"
        if canvas.is_free(column, row, len(text)):
            canvas.text(column, row, text, Tone.STRONG if open_numbers and chart.is_loaded else Tone.DIM)


def _draw_home(canvas: CellCanvas, chart: Chart, own: MapPlacement) -> None:
    site = chart.ground.site
    if site is not None and site.home_m is not None:
        north, east, _ = own.point(site.home_m)
        canvas.text(*cell_of(chart.projection.dot(north, east)), "⌂", Tone.GOOD)
    other = autopilot_home(chart)
    if other is not None:
        canvas.text(*cell_of(chart.projection.dot(*other)), "⌂", Tone.WARN if _has_home(chart) else Tone.GOOD)


def _has_home(chart: Chart) -> bool:
    """Whether missions have a home of their own."""
    return chart.ground.site is not None and chart.ground.site.home_m is not None


def autopilot_home(chart: Chart) -> tuple[float, float] | None:
    """North and east of the autopilot's home; None where it is unknown, or the vehicle's own is there."""
    autopilot = chart.view.platform.autopilot if chart.view.platform is not None else None
    plane, site = chart.ground.plane, chart.ground.site
    if autopilot is None or autopilot.home_geo is None or plane is None:
        return None
    north, east, _ = plane.ned_from_geo(*autopilot.home_geo)
    if site is not None and site.home_m is not None:
        own_north, own_east, _ = own_place(chart).point(site.home_m)
        if hypot(north - own_north, east - own_east) <= SAME_HOME_M:
            return None
    return north, east


def _draw_rally(canvas: CellCanvas, chart: Chart) -> None:
    for place in _rally_places(chart):
        canvas.text(*cell_of(chart.projection.dot(*place)), RALLY_SIGN, Tone.WARN)


def _rally_places(chart: Chart) -> list[tuple[float, float]]:
    plane = chart.ground.plane
    if plane is None:
        return []
    return [
        plane.ned_from_geo(latitude, longitude, plane.origin.altitude_m)[:2]
        for latitude, longitude, _ in chart.rally or ()
    ]


def _draw_map(canvas: CellCanvas, chart: Chart) -> None:
    """What each vehicle's own map shows as occupied at its height."""
    for _, platform, place in chart.placed:
        if platform.map is not None:
            canvas.points(chart.projection.dots(place.plane_of_ne(occupied_of(platform.map.value))), Tone.DIM)


def _draw_obstacles(canvas: CellCanvas, chart: Chart) -> None:
    for _, platform, place in chart.placed:
        if platform.obstacles is None or not platform.obstacles.value.is_valid:
            continue
        points = platform.obstacles.value.points_ne_m
        if points:
            tone = Tone.STALE if platform.obstacles.is_stale(chart.view.now_s) else Tone.STRONG
            canvas.points(chart.projection.dots(place.plane_of_ne(np.array(points))), tone)


def _draw_trail(canvas: CellCanvas, chart: Chart, number: int, platform: PlatformSnapshot, place: MapPlacement) -> None:
    track = chart.view.tracks.get(platform.name)
    if track is not None and len(track.trail):
        canvas.line(chart.projection.dots(place.plane(track.trail.points[:, :2])), tone_of_vehicle(number))


def _draw_vehicle(
    canvas: CellCanvas, chart: Chart, number: int, platform: PlatformSnapshot, place: MapPlacement
) -> None:
    position = position_of(platform)
    if position is None or platform.vehicle is None:
        return
    is_in_view = chart.view.platform is not None and platform.name == chart.view.platform.name
    is_stale = platform.vehicle.is_stale(chart.view.now_s)
    tone = Tone.STALE if is_stale else tone_of_vehicle(number)
    north, east, _ = place.point(position)
    if is_in_view and not is_stale:
        _draw_ellipse(canvas, chart, platform, place, (position[0], position[1]))
    x, y = chart.projection.dot(north, east)
    turn = radians(heading_deg_of(platform) - chart.projection.up_deg)
    size, sign = (1.0, Tone.STRONG) if is_in_view and not is_stale else (0.7, tone)
    corners = [
        (x + size * (a * sin(turn) + b * cos(turn)), y - size * (a * cos(turn) - b * sin(turn))) for a, b in ARROW
    ]
    if is_in_view and not is_stale:
        _draw_setpoint(canvas, chart, platform, place, (x, y))
    canvas.area(corners, sign)
    ahead = AHEAD if is_in_view else AHEAD / 2.0
    canvas.line([(x, y), (x + ahead * sin(turn), y - ahead * cos(turn))], sign)
    name = f" {platform.name} " if is_in_view else f" {platform.name}"
    column, row = cell_of((x, y))
    for at, line in ((column + 3, row), (column + 3, row - 1), (column - 3 - len(name), row), (column, row + 2)):
        if canvas.is_free(at, line, len(name)):
            canvas.text(at, line, name, Tone.CHOSEN if is_in_view and not is_stale else tone)
            break


def _draw_setpoint(
    canvas: CellCanvas, chart: Chart, platform: PlatformSnapshot, place: MapPlacement, vehicle: tuple[float, float]
) -> None:
    """A cross where the vehicle should be, once that is not where it is."""
    wanted = platform.motion.value.setpoint_cm if platform.motion is not None else None
    if wanted is None:
        return
    north, east, _ = place.point((wanted[0] / 100.0, wanted[1] / 100.0, 0.0))
    x, y = chart.projection.dot(north, east)
    if hypot(x - vehicle[0], y - vehicle[1]) < NEAR:
        return
    canvas.line([(x - 2, y - 2), (x + 2, y + 2)], Tone.STRONG)
    canvas.line([(x - 2, y + 2), (x + 2, y - 2)], Tone.STRONG)


def _draw_ellipse(
    canvas: CellCanvas, chart: Chart, platform: PlatformSnapshot, place: MapPlacement, center_xy_m: tuple[float, float]
) -> None:
    covariance = platform.motion.value.covariance_cm2 if platform.motion is not None else None
    if (
        covariance is not None
        and SURE * sqrt(max(covariance[0], covariance[2])) / 100.0 > NEAR * chart.projection.m_per_dot
    ):
        edge = ellipse(covariance[0] / 1e4, covariance[1] / 1e4, covariance[2] / 1e4)
        canvas.line(chart.projection.dots(place.plane(edge + center_xy_m)), Tone.DIM)


def ellipse(xx_m2: float, xy_m2: float, yy_m2: float) -> Plane:
    """The ellipse in which a position is with 95 %, about the origin: rows of x and y in metres."""
    middle, half = (xx_m2 + yy_m2) / 2.0, hypot((xx_m2 - yy_m2) / 2.0, xy_m2)
    turn = 0.5 * atan2(2.0 * xy_m2, xx_m2 - yy_m2)
    long_m, short_m = SURE * sqrt(max(0.0, middle + half)), SURE * sqrt(max(0.0, middle - half))
    along, across = long_m * np.cos(CIRCLE), short_m * np.sin(CIRCLE)
    return np.column_stack((along * cos(turn) - across * sin(turn), along * sin(turn) + across * cos(turn)))


def _draw_frame(canvas: CellCanvas, chart: Chart) -> None:
    """Scale bar, north arrow and the middle."""
    projection = chart.projection
    length_m = round_length(projection.m_per_dot * CELL[0] * min(24, canvas.width // 4))
    cells = max(1, round(length_m / projection.m_per_dot / CELL[0]))
    canvas.text(0, canvas.height - 1, f" ├{'─' * (cells - 1)}┤ {length_text(length_m)} ", Tone.TEXT)
    arrow = ARROWS[round(-projection.up_deg / 45.0) % 8]
    canvas.text(canvas.width - 5, 0, f" {arrow} {'N' if chart.ground.has_north else 'x'} ", Tone.KEY)
    if chart.has_cross and canvas.is_free(canvas.width // 2, canvas.height // 2, 1):
        canvas.text(canvas.width // 2, canvas.height // 2, "+", Tone.KEY)


def cell_of(dot: tuple[float, float]) -> tuple[int, int]:
    """The column and line of a dot; far away where it is."""
    x, y = (max(-1e6, min(1e6, value)) for value in dot)
    return int(x // CELL[0]), int(y // CELL[1])


def cursor_line(chart: Chart, place: tuple[float, float], width: int) -> Line:
    """Position of the cursor: in the frame of the selected vehicle, on Earth, and relative to the vehicle."""
    north, east = place
    ground, own = chart.ground, own_place(chart)
    decimals = 2 if chart.projection.m_per_dot < 0.05 else 1
    parts: list[Span] = [Span(" +", Tone.KEY)]
    if ground.frame or not ground.has_north:
        x, y = own.local(north, east)
        parts.append(Span(f"x {x + 0.0:.{decimals}f}  y {y + 0.0:.{decimals}f} m"))
    else:
        parts.append(Span(f"north {north + 0.0:.{decimals}f}  east {east + 0.0:.{decimals}f} m"))
    geo = ground.geo(north, east)
    if geo is not None:
        parts.append(Span(f"{geo.latitude_deg:.6f}°  {geo.longitude_deg:.6f}°", Tone.DIM))
    platform = chart.view.platform
    position = position_of(platform) if platform is not None else None
    if platform is not None and position is not None:
        here = own.point(position)
        away_m = hypot(north - here[0], east - here[1])
        bearing_deg = degrees(atan2(east - here[1], north - here[0])) % 360.0
        bearing = f" {wording.bearing(bearing_deg)}" if ground.has_north else ""
        parts.append(Span(f"{away_m:.{decimals}f} m{bearing} from {platform.name}", Tone.DIM))
    while len(parts) > 2 and sum(len(part.text) + 3 for part in parts) > width:
        parts.pop()
    spans: list[Span] = []
    for number, part in enumerate(parts):
        spans += [Span(" " if number == 1 else "   "), part] if number else [part]
    return tuple(spans)


def map_title(chart: Chart) -> str:
    """Summary of the map's contents."""
    ground = chart.ground
    where = f"frame {ground.frame}" if ground.frame else "north up" if ground.has_north else "frame not known"
    if chart.request is None:
        return f"{where}, no mission"
    return f"{where}, {chart.request.name}{'' if chart.is_loaded else ' (not loaded)'}"


def vehicle_lines(chart: Chart) -> list[Line]:
    """The vehicles with their colours and positions, those on the map first."""
    on_map = {platform.name: place for _, platform, place in chart.placed}
    lines: list[Line] = []
    for number, platform in enumerate(chart.view.fleet):
        is_in_view = chart.view.platform is not None and platform.name == chart.view.platform.name
        position, tone = position_of(platform), tone_of_vehicle(number)
        is_stale = platform.vehicle is None or platform.vehicle.is_stale(chart.view.now_s)
        lines.append((Span(" ► " if is_in_view else " ● ", tone), Span(platform.name, Tone.STRONG)))
        vehicle = platform.vehicle.value if platform.vehicle is not None else None
        if position is None or vehicle is None:
            lines.append((Span("   position unknown", Tone.BAD),))
        else:
            x, y, height = position
            text = f"   x {wording.tenths(x)}  y {wording.tenths(y)}  h {wording.tenths(height)} m"
            lines.append((Span(text, Tone.STALE if is_stale else Tone.TEXT),))
            motion = f"   {vehicle.speed_m_s:.1f} m/s, heading {wording.bearing(vehicle.heading_deg)}"
            lines.append((Span(motion, Tone.STALE if is_stale else Tone.DIM),))
            if is_stale and platform.vehicle is not None:
                ago = wording.duration(platform.vehicle.age_s(chart.view.now_s))
                lines.append((Span(f"   that was {ago} ago", Tone.BAD),))
        if platform.name not in on_map:
            lines.append((Span("   not on this map", Tone.WARN),))
        lines.append(())
    return lines


def legend_lines(chart: Chart) -> list[Line]:
    """What the signs mean."""
    request = chart.request
    rows: list[tuple[str, Tone, str]] = []
    if request is not None and request.paths:
        rows += [("⠒⠒⠒", Tone.TEXT, "requested"), ("⠒ ⠒", Tone.DIM, "flown, or not yet loaded")]
    rows.append(("⠤⠤⠤", Tone.FIRST, "trail"))
    if request is not None and request.fence is not None:
        rows.append(("⠉⠒⠤", Tone.WARN, "fence"))
        if request.fence.keep_out:
            rows.append(("⢌⢢⢌", Tone.BAD, "keep out"))
    rows.append((" ⌂ ", Tone.GOOD, "home"))
    if _has_home(chart) and autopilot_home(chart) is not None:
        rows.append((" ⌂ ", Tone.WARN, "the autopilot's home"))
    if chart.rally:
        rows.append((f" {RALLY_SIGN} ", Tone.WARN, "rally point"))
    rows += [(" × ", Tone.STRONG, "setpoint"), ("⠊⠒⠑", Tone.DIM, "95 % sure")]
    if chart.view.fleet.traffic:
        rows.append((f" {TRAFFIC_SIGN} ", Tone.WARN, "traffic"))
    return [(Span(f" {sign} ", tone), Span(text, Tone.DIM)) for sign, tone, text in rows]
