"""The paper's Fig. 6: the path that was flown against the path that was requested, in plan view and height."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from gloc3.log.report.figure import drawing, thin
from gloc3.log.report.flight_path import FlightPath, distances_along
from gloc3.messages.frames import Vector3
from gloc3.mission.model.fence import Area, Fence

if TYPE_CHECKING:
    from matplotlib.axes import Axes

REQUESTED: Final = {"color": "#e02020", "linestyle": (0, (1.0, 2.2)), "linewidth": 1.7, "zorder": 3}
FLOWN: Final = {"color": "#1f4fd8", "linestyle": "-", "linewidth": 1.4}
FENCE: Final = {"edgecolor": "#555555", "linestyle": (0, (6, 3)), "linewidth": 1.0, "fill": False}
KEEP_OUT: Final = {"edgecolor": "#555555", "facecolor": "#dddddd", "hatch": "///", "linewidth": 0.8}
WIDTH_IN: Final = 8.0
HEIGHT_VIEW_IN: Final = 2.4
TOP_IN, BETWEEN_IN, BOTTOM_IN, LEFT_IN = 0.6, 0.75, 0.85, 0.6
MARGIN_M: Final = 1.0
NUMBERED_MAX: Final = 30
"""So many waypoints still get a number."""


def plot_path(
    flown: Sequence[Vector3],
    requested: Sequence[Vector3],
    file: Path,
    *,
    home: Vector3 | None = None,
    fence: Fence | None = None,
    waypoints: Sequence[Vector3] | None = None,
    title: str = "",
) -> None:
    """Draws a flight; all positions in metres north, east and down.

    Args:
        flown: positions of the vehicle, in order.
        requested: the corners of the requested path; empty without one.
        file: the picture; its suffix (.svg, .png, .pdf) is the format.
        home: position at arming.
        fence: the permitted area.
        waypoints: the points to mark and number; None: the corners of the requested path.
        title: above the picture.

    Raises:
        Gloc3Error: matplotlib is not installed, or the file cannot be written.
    """
    flown = flown[:: thin(len(flown))]
    marks = requested if waypoints is None else waypoints
    places = [*flown, *requested, *marks, *([home] if home else []), *_corners(fence)]
    north = _span([place[0] for place in places])
    east = _span([place[1] for place in places])
    plan_in = min(max((north[1] - north[0]) / (east[1] - east[0]) * (WIDTH_IN - 1.0), 2.5), 6.0)
    height_in = TOP_IN + plan_in + BETWEEN_IN + HEIGHT_VIEW_IN + BOTTOM_IN
    with drawing(file, WIDTH_IN, height_in, is_fitted=False) as figure:
        plan, height = figure.subplots(2, 1, height_ratios=[plan_in, HEIGHT_VIEW_IN])
        figure.subplots_adjust(
            left=LEFT_IN / WIDTH_IN,
            right=1.0 - 0.15 / WIDTH_IN,
            top=1.0 - TOP_IN / height_in,
            bottom=BOTTOM_IN / height_in,
            hspace=2.0 * BETWEEN_IN / (plan_in + HEIGHT_VIEW_IN),
        )
        plan.set(xlim=east, ylim=north, aspect="equal", xlabel="east, m", ylabel="north, m", title="plan view")
        _draw_fence(plan, fence)
        _line(plan, [p[1] for p in requested], [p[0] for p in requested], REQUESTED, "requested")
        _line(plan, [p[1] for p in flown], [p[0] for p in flown], FLOWN, "flown")
        _draw_waypoints(plan, marks)
        if home is not None:
            plan.plot([home[1]], [home[0]], "s", color="black", markersize=6, zorder=5, label="home", gid="home")
        _draw_height(height, flown, requested, home, fence)
        figure.legend(*plan.get_legend_handles_labels(), loc="lower center", ncols=6)
        if title:
            figure.suptitle(title, x=0.02, y=1.0 - 0.1 / height_in, ha="left", fontweight="bold")


def plot_flight(path: FlightPath, file: Path) -> None:
    """Draws the flight of a log."""
    name = f"{path.mission}: " if path.mission else ""
    plot_path(
        path.flown,
        path.requested,
        file,
        home=path.home,
        fence=path.fence,
        title=f"{name}path flown ({path.source}) against path requested",
    )


def _span(values: Sequence[float]) -> tuple[float, float]:
    """The limits of an axis that shows all values with a margin."""
    low, high = (min(values), max(values)) if values else (0.0, 0.0)
    margin = max(MARGIN_M, 0.05 * (high - low))
    return low - margin, high + margin


def _line(axes: "Axes", x: Sequence[float], y: Sequence[float], style: dict[str, object], name: str) -> None:
    if x:
        axes.plot(x, y, label=name, gid=name, **style)  # type: ignore[arg-type]


def _draw_waypoints(axes: "Axes", waypoints: Sequence[Vector3]) -> None:
    if not waypoints:
        return
    axes.plot(
        [p[1] for p in waypoints],
        [p[0] for p in waypoints],
        "o",
        color="#d62728",
        markerfacecolor="white",
        markersize=5,
        zorder=4,
        label="waypoints",
        gid="waypoints",
    )
    if len(waypoints) <= NUMBERED_MAX:
        numbers: dict[tuple[float, float], list[str]] = {}
        for number, (north, east, _) in enumerate(waypoints, 1):
            numbers.setdefault((round(east, 1), round(north, 1)), []).append(str(number))
        for place, texts in numbers.items():
            axes.annotate(", ".join(texts), place, xytext=(5, 4), textcoords="offset points", color="#a01818")


def _draw_height(
    axes: "Axes",
    flown: Sequence[Vector3],
    requested: Sequence[Vector3],
    home: Vector3 | None,
    fence: Fence | None,
) -> None:
    along = "distance along the requested path, m" if len(requested) > 1 else "distance flown, m"
    axes.set(xlabel=along, ylabel="height, m", title="height")
    _line(axes, distances_along(requested, ()), [-p[2] for p in requested], REQUESTED, "requested height")
    _line(axes, distances_along(flown, requested), [-p[2] for p in flown], FLOWN, "flown height")
    if home is not None:
        axes.axhline(-home[2], color="black", linewidth=0.7)
    if fence is not None and fence.ceiling_m is not None:
        axes.axhline(fence.ceiling_m, color="#555555", linestyle=(0, (6, 3)), linewidth=1.0, gid="ceiling")


def _areas(fence: Fence | None) -> list[tuple[Area, dict[str, object]]]:
    if fence is None:
        return []
    inside = [(fence.area, FENCE)] if fence.area is not None else []
    return [*inside, *((area, KEEP_OUT) for area in fence.keep_out)]


def _corners(fence: Fence | None) -> list[Vector3]:
    """Places that show how far the fence reaches."""
    found: list[Vector3] = []
    for area, _ in _areas(fence):
        north, east, radius = *area.center_ne_m, area.radius_m
        circle = [(north + radius, east + radius), (north - radius, east - radius)]
        found += [(n, e, 0.0) for n, e in area.polygon_ne_m or circle]
    return found


def _draw_fence(axes: "Axes", fence: Fence | None) -> None:
    from matplotlib.patches import Circle, Polygon

    for area, style in _areas(fence):
        name = "fence" if style is FENCE else "keep-out"
        if area.polygon_ne_m:
            corners = [(east, north) for north, east in area.polygon_ne_m]
            axes.add_patch(Polygon(corners, label=name, gid=name, **style))  # type: ignore[arg-type]
        else:
            north, east = area.center_ne_m
            axes.add_patch(Circle((east, north), area.radius_m, label=name, gid=name, **style))
