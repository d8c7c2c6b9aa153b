"""Draws a mission as an SVG picture: its path in plan view, and its partial order over the estimated time."""

from collections.abc import Iterator, Sequence
from html import escape
from math import dist
from typing import Final

from gloc3.messages.frames import Vector3
from gloc3.mission.checking.checker import CheckReport
from gloc3.mission.checking.estimate import MissionEstimate, about
from gloc3.mission.model.arguments import FollowWaypointsOrder
from gloc3.mission.model.fence import Area, Fence
from gloc3.mission.model.model import Mission
from gloc3.mission.showing.show import answers, summary, terms

WIDTH: Final = 1000
_PLAN: Final = 460
_LEFT: Final = 20
_TOP: Final = 64
_ORDER_LEFT: Final = _PLAN + 2 * _LEFT + 20
_BARS_LEFT: Final = _ORDER_LEFT + 190
_ROW: Final = 22
_COLOURS: Final = ("#1f4fd8", "#d97706", "#15803d", "#a21caf", "#0e7490", "#b91c1c")
_READY: Final = 'fill="none" stroke="#555555" stroke-width="1.6" stroke-dasharray="2 4"'
_NUMBERED_MAX: Final = 40


def picture(report: CheckReport) -> str:
    """The picture of a checked mission.

    Args:
        report: of the mission; it must hold one that may fly.
    """
    mission = report.flyable()
    figures = report.estimate
    rows = [(name, "") for name in mission.tasks] if figures is None else _rows(mission)
    height = _TOP + max(_PLAN, _ROW * (len(rows) + 2)) + 30
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" font-family="sans-serif" font-size="12">',
        f'<rect width="{WIDTH}" height="{height}" fill="#ffffff"/>',
        _text(_LEFT, 24, mission.name, 'font-size="16" font-weight="bold"'),
        _text(_LEFT, 44, ", ".join(answers(mission.policies)), 'fill="#555555"'),
    ]
    colours = {name: _COLOURS[index % len(_COLOURS)] for index, name in enumerate(mission.tasks)}
    if figures is not None:
        lines += _plan(mission, figures, colours)
        lines += _order(mission, figures, rows, colours)
    return "\n".join([*lines, "</svg>"]) + "\n"


def _rows(mission: Mission) -> list[tuple[str, str]]:
    """Each task, followed by its actions."""
    return [(task.name, name) for task in mission.tasks.values() for name in ("", *task.actions)]


def _plan(mission: Mission, figures: MissionEstimate, colours: dict[str, str]) -> Iterator[str]:
    """Plan view of the path, north up, with the fence, home and the waypoints."""
    routes = {
        target: _path(part.legs[0].start, [leg.end for leg in part.legs])
        for target, part in figures.actions.items()
        if part.legs
    }
    fence, ready = list(_fence_points(mission.fence)), list(_ready(mission))
    known = [*routes.values(), *(path for _, path in ready)]
    places = [*(point for path in known for point in path), *fence, (0.0, 0.0, 0.0)]
    north, east = [place[0] for place in places], [place[1] for place in places]
    span = max(max(north) - min(north), max(east) - min(east), 1.0)
    scale = (_PLAN - 40) / span

    def at(place: Sequence[float]) -> tuple[float, float]:
        x = _LEFT + 20 + (place[1] - min(east)) * scale
        return round(x, 1), round(_TOP + _PLAN - 20 - (place[0] - min(north)) * scale, 1)

    yield f'<rect x="{_LEFT}" y="{_TOP}" width="{_PLAN}" height="{_PLAN}" fill="#fafafa" stroke="#cccccc"/>'
    for area, style in _areas(mission.fence):
        if area.polygon_ne_m:
            points = " ".join(f"{x},{y}" for x, y in map(at, area.polygon_ne_m))
            yield f'<polygon points="{points}" {style}/>'
        else:
            x, y = at(area.center_ne_m)
            yield f'<circle cx="{x}" cy="{y}" r="{area.radius_m * scale:.1f}" {style}/>'
    number = 0
    for target, path in routes.items():
        colour = colours[target.partition(".")[0]]
        points = " ".join(f"{x},{y}" for x, y in map(at, path))
        yield f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.6"><title>{escape(target)}</title></polyline>'
        for point in path[1:]:
            number += 1
            x, y = at(point)
            yield f'<circle cx="{x}" cy="{y}" r="2.5" fill="#ffffff" stroke="{colour}"/>'
            if number <= _NUMBERED_MAX:
                yield _text(x + 4, y - 4, str(number), f'fill="{colour}" font-size="10"')
    for target, path in ready:
        points = " ".join(f"{x},{y}" for x, y in map(at, path))
        yield f'<polyline points="{points}" {_READY}><title>{escape(target)}</title></polyline>'
        for x, y in map(at, path):
            yield f'<circle cx="{x}" cy="{y}" r="2.5" fill="#ffffff" stroke="#555555"/>'
        x, y = at(path[0])
        yield _text(x + 4, y + 12, target.partition(".")[0], 'fill="#555555" font-size="10"')
    x, y = at((0.0, 0.0))
    yield f'<path d="M{x - 6},{y} h12 M{x},{y - 6} v12" stroke="#000000"/>' + _text(x + 7, y + 12, "home", "")
    bar_m = _round(span / 4.0)
    x, y = _LEFT + 12, _TOP + _PLAN - 8
    yield f'<path d="M{x},{y} h{bar_m * scale:.1f}" stroke="#000000"/>' + _text(x, y - 4, f"{bar_m:g} m", "")
    yield _text(_LEFT + _PLAN - 24, _TOP + 18, "N ↑", "")


def _ready(mission: Mission) -> Iterator[tuple[str, list[Vector3]]]:
    """Paths of contingencies, each from its first waypoint: their start is not known in advance."""
    for name, task in mission.contingencies.items():
        for action in task.actions.values():
            if isinstance(action.order, FollowWaypointsOrder):
                yield f"{name}.{action.name}", list(action.order.waypoints_ned_m)


def _order(
    mission: Mission, figures: MissionEstimate, rows: Sequence[tuple[str, str]], colours: dict[str, str]
) -> Iterator[str]:
    """A row for each task and action, its bar from start to end, and a line from each predecessor."""
    room, total_s = WIDTH - _BARS_LEFT - _LEFT, max(figures.duration_s, 1e-3)
    line = {row: _TOP + _ROW * (index + 1) for index, row in enumerate(rows)}

    def x_of(time_s: float) -> float:
        return round(_BARS_LEFT + room * time_s / total_s, 1)

    yield _text(_ORDER_LEFT, _TOP, about(figures), 'font-weight="bold"')
    for task in mission.tasks.values():
        y = line[task.name, ""]
        yield _text(_ORDER_LEFT, y, task.name, 'font-weight="bold"', "; ".join(terms(task.options)))
        start_s, _ = figures.task_span(task)
        for name in task.options.after:
            _, end_s = figures.task_span(mission.tasks[name])
            last = max(line[one] for one in line if one[0] == name)
            yield _link(x_of(end_s), last, x_of(start_s), y)
        for action in task.actions.values():
            part, y = figures.actions.get(f"{task.name}.{action.name}"), line[task.name, action.name]
            reported = "; ".join([summary(action), *terms(action.options)])
            yield _text(_ORDER_LEFT + 12, y, action.name, "", reported)
            if part is None:
                continue
            x, width = x_of(part.start_s), max(2.0, x_of(part.end_s) - x_of(part.start_s))
            style = f'fill="{colours[task.name]}" opacity="{0.45 if action.options.until else 0.85}"'
            yield f'<rect x="{x}" y="{y - 10}" width="{width:.1f}" height="12" rx="2" {style}><title>{escape(reported)}</title></rect>'
            for name in action.options.after:
                before = figures.actions.get(f"{task.name}.{name}")
                if before is not None:
                    yield _link(x_of(before.end_s), line[task.name, name], x, y)


def _link(x0: float, y0: float, x1: float, y1: float) -> str:
    """From the end of one to the begin of another."""
    return f'<path d="M{x0},{y0 - 4} V{y1 - 4} H{x1}" fill="none" stroke="#888888" stroke-width="0.8"/>'


def _path(start: Vector3, ends: Sequence[Vector3]) -> list[Vector3]:
    path = [start]
    path += [end for index, end in enumerate(ends) if dist(end[:2], (ends[index - 1] if index else start)[:2]) > 1e-3]
    return path


def _areas(fence: Fence | None) -> Iterator[tuple[Area, str]]:
    if fence is not None and fence.area is not None:
        yield fence.area, 'fill="none" stroke="#555555" stroke-dasharray="6 3"'
    for area in fence.keep_out if fence is not None else ():
        yield area, 'fill="#dddddd" stroke="#555555"'


def _fence_points(fence: Fence | None) -> Iterator[Vector3]:
    for area, _ in _areas(fence):
        (north, east), radius = area.center_ne_m, area.radius_m
        corners = area.polygon_ne_m or ((north + radius, east + radius), (north - radius, east - radius))
        yield from ((*corner, 0.0) for corner in corners)


def _round(length_m: float) -> float:
    """A length to measure by: 1, 2 or 5 of a power of ten, no longer than this."""
    steps = [factor * 10.0**power for power in range(-1, 6) for factor in (1, 2, 5)]
    return max((step for step in steps if step <= length_m), default=steps[0])


def _text(x: float, y: float, text: str, style: str, title: str = "") -> str:
    hint = f"<title>{escape(title)}</title>" if title else ""
    return f'<text x="{x}" y="{y}" {style}>{hint}{escape(text)}</text>'
