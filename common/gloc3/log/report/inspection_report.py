"""The report of an inspection: one HTML file that needs nothing else, with the drawings and the contact sheet beside it."""

import base64
import math
from datetime import UTC, datetime
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import Final

import msgspec

from gloc3.camera.model import CameraModel
from gloc3.camera.wall_coverage import Coverage, CoverageLimits, Wall, cover
from gloc3.log.report.contact_sheet import MOST, contact_sheet
from gloc3.log.report.recording import PictureRecording, TakenPicture
from gloc3.log.report.report_drawings import draw_places, draw_wall, view_of
from gloc3.messages.frames import Vector3, yaw_of

PAGE: Final = "report.html"
WALL_DRAWING: Final = "coverage.svg"
PLACES_DRAWING: Final = "places.svg"
SHEET: Final = "contact.png"
FIGURES: Final = "report.json"
_STYLE: Final = (
    "body{font-family:sans-serif;max-width:960px;margin:2em auto;padding:0 1em;color:#222;background:#fff}"
    "table{border-collapse:collapse}td,th{padding:.2em .8em .2em 0;text-align:left;vertical-align:top}"
    "tbody tr:nth-child(odd){background:#f4f6f8}img,svg{max-width:100%;height:auto}h2{margin-top:2em}"
)


class ReportFigures(msgspec.Struct, frozen=True):
    """Figures of the report."""

    pictures: int
    flown_m: float
    """Length of the path flown; 0 without a log."""
    coverage: float | None = None
    """Share of the wall that was seen; None without a wall."""
    coverage_twice: float | None = None
    pixel_mm: float | None = None
    """Median pixel size on the covered part of the wall."""
    wall_m: tuple[float, float] | None = None
    """Width and height."""


def write_report(
    recording: PictureRecording, cameras: dict[str, CameraModel], wall: Wall | None, limits: CoverageLimits, out: Path
) -> ReportFigures:
    """Writes the report into a folder.

    Args:
        recording: the pictures.
        cameras: the models of the cameras; all those that took pictures, where there is a wall.
        wall: the inspected wall.
        limits: what counts as covered.
        out: the folder; created if it does not exist.

    Raises:
        Refused: the coverage cannot be computed.
    """
    views = [view_of(picture) for picture in recording.pictures]
    coverage = cover(wall, views, cameras, limits) if wall is not None else None
    figures = _figures(recording, coverage)
    places = draw_places(recording, cameras, wall)
    drawing = draw_wall(coverage, recording, cameras) if coverage is not None else ""
    sheet = contact_sheet(recording)
    out.mkdir(parents=True, exist_ok=True)
    for name, text in ((PLACES_DRAWING, places), (WALL_DRAWING, drawing)):
        if text:
            (out / name).write_text(text)
    if sheet is not None:
        (out / SHEET).write_bytes(sheet)
    (out / FIGURES).write_bytes(msgspec.json.format(msgspec.json.encode(figures)) + b"\n")
    (out / PAGE).write_text(_page(recording, figures, limits, drawing, places, sheet))
    return figures


def summary(figures: ReportFigures) -> str:
    """The report in a line."""
    text = f"{figures.pictures} pictures"
    if figures.coverage is not None and figures.coverage_twice is not None:
        once, twice = 100.0 * figures.coverage, 100.0 * figures.coverage_twice
        text += f", {once:.1f} % of the wall seen, {twice:.1f} % at least twice"
    return text


def _figures(recording: PictureRecording, coverage: Coverage | None) -> ReportFigures:
    flown = recording.path.flown if recording.path is not None else []
    flown_m = round(sum(math.dist(a, b) for a, b in pairwise(flown)), 3)
    if coverage is None:
        return ReportFigures(len(recording.pictures), flown_m)
    return ReportFigures(
        pictures=len(recording.pictures),
        flown_m=flown_m,
        coverage=round(coverage.share, 6),
        coverage_twice=round(coverage.share_twice, 6),
        pixel_mm=round(coverage.median_mm, 3) if coverage.share > 0.0 else None,
        wall_m=coverage.wall.size_m,
    )


def _page(
    recording: PictureRecording,
    figures: ReportFigures,
    limits: CoverageLimits,
    drawing: str,
    places: str,
    sheet: bytes | None,
) -> str:
    mission = recording.path.mission if recording.path is not None else ""
    title = escape(f"Inspection: {mission or recording.name}")
    body = [f"<h1>{title}</h1>", _figure_lines(recording, figures, limits)]
    if drawing:
        body += ["<h2>Wall coverage</h2>", drawing]
    if places:
        body += ["<h2>Camera positions</h2>", places]
    if sheet is not None:
        data = base64.b64encode(sheet).decode()
        thinned = f" ({MOST} of {figures.pictures}, evenly chosen)" if figures.pictures > MOST else ""
        body += [f"<h2>Contact sheet{thinned}</h2>", f'<img alt="contact sheet" src="data:image/png;base64,{data}">']
    body += ["<h2>Pictures</h2>", _table(recording)]
    head = f'<meta charset="utf-8"><title>{title}</title><style>{_STYLE}</style>'
    return f'<!doctype html>\n<html lang="en"><head>{head}</head><body>\n' + "\n".join(body) + "\n</body></html>\n"


def _figure_lines(recording: PictureRecording, figures: ReportFigures, limits: CoverageLimits) -> str:
    snapshot = [("Run", recording.name)]
    if recording.platform:
        snapshot.append(("Platform", recording.platform))
    if recording.utc_offset_s is not None and recording.pictures:
        begin = datetime.fromtimestamp(recording.pictures[0].t_s + recording.utc_offset_s, UTC)
        snapshot.append(("First picture", f"{begin:%Y-%m-%d %H:%M:%S} UTC"))
    if recording.frame is not None:
        snapshot.append(("Positions", f"in the frame {recording.frame[0]}"))
    snapshot.append(("Pictures", str(figures.pictures)))
    if figures.flown_m > 0.0:
        snapshot.append(("Path flown", f"{figures.flown_m:.1f} m"))
    if figures.coverage is not None and figures.coverage_twice is not None and figures.wall_m is not None:
        snapshot += [
            ("Wall", f"{figures.wall_m[0]:.2f} m wide, {figures.wall_m[1]:.2f} m high"),
            ("Seen", f"{100.0 * figures.coverage:.1f} %; at least twice {100.0 * figures.coverage_twice:.1f} %"),
            ("Pixel on the wall", f"{figures.pixel_mm:.1f} mm (median)" if figures.pixel_mm is not None else "none"),
            (
                "Counts as seen",
                (
                    f"in a picture from at most {limits.farthest_m:g} m and {limits.most_oblique_deg:g}° off the wall's "
                    f"normal, on cells of {1000 * limits.cell_m:.0f} mm; obstacles in front of the wall are not considered"
                ),
            ),
        ]
    rows = "".join(f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in snapshot)
    return f"<table>{rows}</table>"


def _table(recording: PictureRecording) -> str:
    places = ("north, m", "east, m") if recording.frame is None else ("x, m", "y, m")
    names = ["", "file", "UTC" if recording.utc_offset_s is not None else "time", *places, "height, m", "heading"]
    rows = []
    for number, picture in enumerate(recording.pictures, start=1):
        cells = (
            str(number),
            picture.file,
            recording.time_of(picture, decimals=2),
            *(f"{round(value, 2) + 0.0:.2f}" for value in _place(picture, recording)),
            f"{math.degrees(yaw_of(picture.ned_from_frd)) % 360.0:.0f}°",
        )
        rows.append("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + "</tr>")
    head = "".join(f"<th>{name}</th>" for name in names)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def _place(picture: TakenPicture, recording: PictureRecording) -> Vector3:
    """In the platform's local frame, or north, east and height."""
    north, east, down = picture.position_ned_m
    return recording.frame[1].from_ned(picture.position_ned_m) if recording.frame is not None else (north, east, -down)
