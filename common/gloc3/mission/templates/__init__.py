"""Mission templates: each is valid for its platform, and meant to be changed."""

from pathlib import Path
from typing import Final

from gloc3.documents.format_version import KEY, VERSION
from gloc3.errors import Refused, nearest
from gloc3.mission.model.abilities import chooses_heading
from gloc3.platform.platform import Platform

FRAME: Final = "FRAME"
CAMERA: Final = "CAMERA"
SPACING: Final = "SPACING"
CLOSE_M: Final = 60.0
"""Spacing of lines that vehicles with a turn radius up to `CLOSE_TURN_M` can fly, by leaving lines out in turn."""
CLOSE_TURN_M: Final = 80.0
ALONG_WALL: Final = "inspection"
WIDE: Final = "mapping"
"""The template with room for vehicles that cannot turn on the spot."""


def templates() -> dict[str, str]:
    """Purpose of each template, by name: its first comment."""
    found = {}
    for path in sorted(Path(__file__).parent.glob("*.yaml")):
        found[path.stem] = path.read_text(encoding="utf-8").partition("\n")[0].removeprefix("# ")
    return found


def mission_from(template: str, platform: Platform, schema: str) -> str:
    """Creates a mission file for a platform.

    Args:
        template: its name.
        platform: provides frame and camera.
        schema: the schema's file, relative to the mission's, for editors.

    Raises:
        Refused: there is no such template, or the platform lacks something that it needs.
    """
    if template not in templates():
        raise Refused(f"there is no template {template!r} ({nearest(template, list(templates()))})")
    text = (Path(__file__).parent / f"{template}.yaml").read_text(encoding="utf-8")
    if not platform.frames:
        raise Refused(f"{platform.platform} declares no local frame; add one to its file under frames")
    depth_m = platform.limits.survey_height_m
    if template == "dive" and (depth_m is None or depth_m >= 0.0):
        raise Refused(f"{platform.platform} does not dive: its limits.survey_height_m is not below 0")
    if template == ALONG_WALL and not _faces_walls(platform):
        raise Refused(f"{platform.platform} steers by its heading: it cannot face a wall that it goes along")
    if platform.limits.turn_radius_m and template != WIDE:
        raise Refused(f"{platform.platform} needs more room to turn than {template} has: begin with {WIDE}")
    if template == WIDE and not platform.limits.turn_radius_m:
        raise Refused(f"{platform.platform} turns on the spot, or nearly: begin with survey")
    radius_m = platform.limits.turn_radius_m
    spacing_m = CLOSE_M if radius_m <= CLOSE_TURN_M else 2.2 * radius_m  # room to turn between two lines
    lines = text.replace(FRAME, next(iter(platform.frames))).replace(SPACING, f"{spacing_m:g}").splitlines()
    if (camera := _camera(platform)) is None:
        lines = [line for line in lines if CAMERA not in line]
    first = next(number for number, line in enumerate(lines) if line.startswith("mission:"))
    lines.insert(first, f"{KEY}: {VERSION}")
    made = "\n".join(lines).replace(CAMERA, camera or "") + "\n"
    return f"# yaml-language-server: $schema={schema}\n{made}"


def _faces_walls(platform: Platform) -> bool:
    ability = platform.capabilities.get("follow_waypoints")
    rows = (row for row in platform.components if ability is not None and row.name == ability.performed_by)
    return all(chooses_heading(row) for row in rows)


def _camera(platform: Platform) -> str | None:
    """The first camera that the platform records with; None where it records none."""
    rows = (row for row in platform.capabilities.values() if row.arguments == "record_images")
    return next((camera for row in rows for camera in row.options.get("camera", ())), None)
