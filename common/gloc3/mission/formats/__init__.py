"""Missions of other programs: `.plan` of QGroundControl, `QGC WPL 110`, and the formats of plug-ins.

`load_plan` reads any of them and `exported` writes them; `items` is the form that they have in common, and
`plan_format` what a format is.
"""

import os
from collections.abc import Mapping
from pathlib import Path

from gloc3.documents.document import dump, load_bytes
from gloc3.documents.format_version import STAMP
from gloc3.errors import Finding, InputError
from gloc3.messages.frames import LocalFrame
from gloc3.mission.examples import find_mission
from gloc3.mission.formats.from_mission import from_mission
from gloc3.mission.formats.items import ForeignPlan
from gloc3.mission.formats.on_earth import on_earth
from gloc3.mission.formats.plan import read_plan, write_plan
from gloc3.mission.formats.plan_format import (
    CONVERT_FIRST,
    MISSION_SUFFIXES,
    NEEDS_PLUG_IN,
    is_added,
    is_plan_file,
    load_plan,
    plan_formats,
    plan_text,
)
from gloc3.mission.formats.source_lines import in_source
from gloc3.mission.formats.to_mission import to_mission
from gloc3.mission.formats.wpl import read_wpl, write_wpl
from gloc3.mission.model.model import GEO, Mission
from gloc3.mission.reading.library import bundled
from gloc3.mission.reading.writer import write_mission
from gloc3.platform.platform import Platform


def written_text(path: Path) -> str:
    """The content of a mission file, as it is written.

    Raises:
        InputError: it cannot be read.
    """
    try:
        return load_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        finding = Finding(file=str(path), message="not UTF-8 text", hint="save the file as UTF-8")
        raise InputError([finding]) from error


def mission_text(name: str, platform: Platform | None = None) -> tuple[str, str, list[Finding]]:
    """Mission text of an example by name, a mission file with its libraries, or a converted plan.

    Args:
        name: a path, or the name of an example.
        platform: that flies it, as far as it is known; plans are converted for it.

    Returns:
        The file's name, the YAML, and warnings about parts that a conversion left out.

    Raises:
        InputError: it cannot be read or converted; with the reasons.
    """
    path = find_mission(name)
    if not is_plan_file(path):
        return str(path), bundled(written_text(path), path), []
    text, warnings = to_mission(load_plan(path), path.stem, str(path), platform)
    return str(path), text, warnings


def as_it_is_text(path: Path, beside: Path) -> str:
    """A mission whose one task has the autopilot fly a plan as it is.

    Args:
        path: the plan.
        beside: the mission's file, to which the name of the plan is relative.

    Raises:
        InputError: the plan cannot be read, or has no items.
    """
    if is_added(path.suffix):
        raise InputError([Finding(file=str(path), message=NEEDS_PLUG_IN, hint=CONVERT_FIRST)])
    if not load_plan(path).items:
        hint = "its fence and rally points go to the autopilot: upload it there"
        raise InputError([Finding(file=str(path), message="it has no mission items", hint=hint)])
    relative = os.path.relpath(path.absolute(), beside.absolute().parent)
    return dump(
        {
            **STAMP,
            "mission": path.stem,
            "frame": GEO,
            "tasks": {"fly": {"flown_by": "autopilot", "plan": Path(relative).as_posix()}},
        }
    )


def exported(
    mission: Mission, suffix: str, file: str, frames: Mapping[str, LocalFrame] | None = None
) -> tuple[str, list[Finding]]:
    """Exports a mission to another file format.

    Args:
        mission: the mission.
        suffix: of the output file.
        file: name of the mission in findings.
        frames: local frames with a known origin on Earth; a mission in another frame cannot become a plan.

    Returns:
        The text, and warnings about parts that the output format cannot express.

    Raises:
        InputError: it cannot be expressed there; with the reasons.
    """
    if suffix in MISSION_SUFFIXES:
        return write_mission(mission), []
    formats = plan_formats()
    if suffix not in formats.by_suffix:
        hint = formats.hint(*MISSION_SUFFIXES, is_written=True)
        raise InputError([Finding(file=file, message=f"unknown kind of file {suffix!r}", hint=hint)])
    if frames is not None and mission.frame in frames:
        mission = on_earth(mission, frames[mission.frame])
    plan, warnings = from_mission(mission, file)
    text, lost = plan_text(plan, suffix, file)
    return text, [*warnings, *lost]


__all__ = [
    "MISSION_SUFFIXES",
    "ForeignPlan",
    "as_it_is",
    "as_it_is_text",
    "commands",
    "exported",
    "from_mission",
    "in_source",
    "is_plan_file",
    "items",
    "load_plan",
    "mission_text",
    "plan_format",
    "plan_formats",
    "plan_text",
    "read_plan",
    "read_wpl",
    "to_mission",
    "write_plan",
    "write_wpl",
    "written_text",
]
