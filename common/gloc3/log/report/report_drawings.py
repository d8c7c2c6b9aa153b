"""Drawings of an inspection report: the wall with its coverage, and a map of the pictures' positions."""

import base64
import math
from collections.abc import Sequence
from typing import Final

from gloc3.camera.model import CameraModel
from gloc3.camera.wall_coverage import Coverage, Wall, WallView, footprint, optical_axis
from gloc3.log.report.contact_sheet import SHADES, coverage_map
from gloc3.log.report.recording import PictureRecording, TakenPicture
from gloc3.messages.frames import Vector3

_WIDTH_PX: Final = 900.0
_MARGIN_PX: Final = 46.0
_TALLEST_PX: Final = 620.0
_LEGEND_PX: Final = 560.0


def view_of(picture: TakenPicture) -> WallView:
    """A picture as geometry sees it."""
    return WallView(picture.camera, picture.position_ned_m, picture.ned_from_frd)


def draw_wall(coverage: Coverage, recording: PictureRecording, cameras: dict[str, CameraModel]) -> str:
    """Front view of the wall: how often each part was covered, and the outlines of the pictures (SVG)."""
    width_m, height_m = coverage.wall.size_m
    scale = min((_WIDTH_PX - 2 * _MARGIN_PX) / width_m, _TALLEST_PX / height_m)
    width, height = width_m * scale, height_m * scale
    data = base64.b64encode(coverage_map(coverage)).decode()
    parts = [
        (
            f'<image x="0" y="0" width="{width:.1f}" height="{height:.1f}" preserveAspectRatio="none" '
            f'style="image-rendering:pixelated" href="data:image/png;base64,{data}"/>'
        )
    ]
    for is_used, picture in zip(coverage.used, recording.pictures, strict=True):
        corners = footprint(coverage.wall, view_of(picture), cameras[picture.camera]) if is_used else None
        if corners is not None:
            points = " ".join(f"{x * scale:.1f},{y * scale:.1f}" for x, y in corners)
            parts.append(f'<polygon points="{points}" fill="none" stroke="#222" stroke-opacity="0.25"/>')
    clip = f'<clipPath id="wall"><rect width="{width:.1f}" height="{height:.1f}"/></clipPath>'
    frame = f'<rect width="{width:.1f}" height="{height:.1f}" fill="none" stroke="#222"/>'
    inside = f'{clip}<g clip-path="url(#wall)">{"".join(parts)}</g>{frame}'
    step = _step(max(width_m, height_m))
    ticks = [_tick(x * scale, height + 16, f"{x:g}", "middle") for x in _ticks(width_m, step)]
    ticks += [_tick(-6, height - y * scale + 4, f"{y:g}", "end") for y in _ticks(height_m, step)]
    ticks.append(_tick(width / 2, height + 34, "metres along the wall, and up from its lower edge", "middle"))
    legend = "".join(
        f'<rect x="{i * 92:.0f}" y="{height + 46:.0f}" width="14" height="14" fill="{shade}" stroke="#222"/>'
        + _tick(i * 92 + 20, height + 57, text, "start")
        for i, (shade, text) in enumerate(
            zip(SHADES, ("not seen", "once", "twice", "3 times", "4 times", "5 or more"), strict=True)
        )
    )
    return _svg(max(width, _LEGEND_PX) + 2 * _MARGIN_PX, height + 46 + 30, inside + "".join(ticks) + legend)


def draw_places(recording: PictureRecording, cameras: dict[str, CameraModel], wall: Wall | None) -> str:
    """Map, north up: the path flown, the wall, and the position and direction of each picture (SVG)."""
    flown = _thinned(recording.path.flown, 2000) if recording.path is not None else []
    outline = _outline(wall) if wall is not None else []
    places = [*flown, *outline, *(picture.position_ned_m for picture in recording.pictures)]
    if not places:
        return ""
    east = [place[1] for place in places]
    north = [place[0] for place in places]
    width_m, height_m = max(max(east) - min(east), 1.0) + 1.0, max(max(north) - min(north), 1.0) + 1.0
    scale = min((_WIDTH_PX - 2 * _MARGIN_PX) / width_m, _TALLEST_PX / height_m)
    left, top = (min(east) + max(east) - width_m) / 2.0, (min(north) + max(north) + height_m) / 2.0

    def at(place: Vector3) -> str:
        return f"{(place[1] - left) * scale:.1f},{(top - place[0]) * scale:.1f}"

    parts = []
    if len(flown) > 1:
        parts.append(f'<polyline points="{" ".join(map(at, flown))}" fill="none" stroke="#5c9fd4" stroke-width="1.5"/>')
    if outline:
        parts.append(
            f'<polygon points="{" ".join(map(at, outline))}" fill="#a33" fill-opacity="0.08" stroke="#a33" stroke-width="3"/>'
        )
    for number, picture in enumerate(recording.pictures, start=1):
        x, y = map(float, at(picture.position_ned_m).split(","))
        arrow = _arrow(picture, cameras, x, y)
        title = f"<title>{number}: {picture.file}, {recording.time_of(picture, 1)}</title>"
        label = _tick(x + 6, y - 5, str(number), "start") if is_labelled(number, len(recording.pictures)) else ""
        parts.append(f'<g>{title}{arrow}<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="#124a84"/>{label}</g>')
    width, height = width_m * scale, height_m * scale
    step = _step(max(width_m, height_m))
    ticks = [
        _tick((x - left) * scale, height + 16, f"{x:g}", "middle") for x in _multiples(left, left + width_m, step)
    ] + [_tick(-6, (top - y) * scale + 4, f"{y:g}", "end") for y in _multiples(top - height_m, top, step)]
    ticks.append(_tick(width / 2, height + 34, "metres east, and north upwards, in the frame of the pose", "middle"))
    frame = f'<rect width="{width:.1f}" height="{height:.1f}" fill="none" stroke="#888"/>'
    return _svg(width + 2 * _MARGIN_PX, height + 60, frame + "".join(parts) + "".join(ticks))


def is_labelled(number: int, count: int) -> bool:
    """Whether a picture's number is drawn beside its position: all numbers of a few pictures, some of many."""
    every = max(1, round(count / 20))
    return number == 1 or number % every == 0


def _arrow(picture: TakenPicture, cameras: dict[str, CameraModel], x: float, y: float) -> str:
    """Line in the camera's direction, with the length of its horizontal component."""
    if picture.camera not in cameras:
        return ""
    _, axis = optical_axis(view_of(picture), cameras[picture.camera])
    return f'<line x1="{x:.1f}" y1="{y:.1f}" x2="{x + 18 * axis[1]:.1f}" y2="{y - 18 * axis[0]:.1f}" stroke="#124a84"/>'


def _outline(wall: Wall) -> list[Vector3]:
    """Its corners."""
    (n, e, d), (an, ae, ad), (dn, de, dd) = wall
    return [
        (n, e, d),
        (n + an, e + ae, d + ad),
        (n + an + dn, e + ae + de, d + ad + dd),
        (n + dn, e + de, d + dd),
    ]


def _thinned(path: Sequence[Vector3], most: int) -> list[Vector3]:
    step = max(1, math.ceil(len(path) / most))
    return list(path[::step])


def _step(length_m: float) -> float:
    """A round distance between ticks."""
    for step in (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0):
        if length_m / step <= 12.0:
            return step
    return 1000.0


def _ticks(length_m: float, step: float) -> list[float]:
    return [round(i * step, 6) for i in range(int(length_m / step + 1e-9) + 1)]


def _multiples(low: float, high: float, step: float) -> list[float]:
    return [round(i * step, 6) for i in range(math.ceil(low / step), math.floor(high / step) + 1)]


def _tick(x: float, y: float, text: str, anchor: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" font-size="12" fill="#333">{text}</text>'


def _svg(width: float, height: float, inside: str) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
        f'viewBox="{-_MARGIN_PX:.0f} -10 {width:.0f} {height + 10:.0f}" font-family="sans-serif">'
        f'<rect x="{-_MARGIN_PX:.0f}" y="-10" width="{width:.0f}" height="{height + 10:.0f}" fill="#fff"/>{inside}</svg>'
    )
