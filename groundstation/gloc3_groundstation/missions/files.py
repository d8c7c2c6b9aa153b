"""Folders and mission files, for choosing a mission to open."""

import re
from collections.abc import Iterator, Sequence
from enum import StrEnum
from pathlib import Path
from typing import Final

import msgspec

from gloc3.mission.examples import example_missions
from gloc3.mission.formats import MISSION_SUFFIXES, plan_formats
from gloc3.mission.formats.plan_format import WAYPOINTS

LISTED_MAX: Final = 2000
"""Entries of a folder that are listed."""
LISTED_MOST: Final = 1 << 16
"""Bytes at the start of a file that are examined for a mission."""
_BEGINS: Final = {
    **dict.fromkeys(
        MISSION_SUFFIXES,
        re.compile(rb"^(\xef\xbb\xbf)?(\{\s*)?[\"']?(mission|tasks)[\"']?\s*:", re.IGNORECASE | re.MULTILINE).search,
    ),
    **dict.fromkeys(
        {*WAYPOINTS.suffixes} - {".waypoints"}, re.compile(rb"(\xef\xbb\xbf)?\s*QGC\s+WPL", re.IGNORECASE).match
    ),
}


class FileGroup(StrEnum):
    """Origins of an entry."""

    RECENT = "recent"
    EXAMPLE = "examples"
    FOLDER = "folder"


class MissionEntry(msgspec.Struct, frozen=True, kw_only=True):
    """Something that can be opened."""

    group: FileGroup
    name: str
    path: str
    kind: str
    """For users; `folder` for one that can be opened."""
    size: int = 0
    """Bytes."""

    @property
    def is_folder(self) -> bool:
        """Whether opening it lists it."""
        return self.kind == "folder"


class Listing(msgspec.Struct, frozen=True, kw_only=True):
    """A folder's missions and folders."""

    folder: str
    entries: tuple[MissionEntry, ...] = ()
    problem: str = ""
    """Why it could not be listed."""


def listing(folder: Path) -> Listing:
    """The folders, then the files that can be opened, by name; the folder above comes first."""
    above = [MissionEntry(group=FileGroup.FOLDER, name="..", path=str(folder.parent), kind="folder")]
    if folder.parent == folder:
        above = []
    try:
        found = sorted(_entries(folder), key=lambda entry: (not entry.is_folder, entry.name.lower(), entry.name))
    except OSError as error:
        return Listing(folder=str(folder), entries=tuple(above), problem=(error.strerror or str(error)).lower())
    problem = f"only the first {LISTED_MAX} are listed" if len(found) > LISTED_MAX else ""
    return Listing(folder=str(folder), entries=(*above, *found[:LISTED_MAX]), problem=problem)


def start_entries(recent: Sequence[str]) -> tuple[MissionEntry, ...]:
    """Entries without browsing: recent missions that still exist, and the examples."""
    examples = example_missions()
    lately = [
        MissionEntry(
            group=FileGroup.RECENT, name=Path(name).name, path=name, kind=kinds().get(Path(name).suffix, "mission")
        )
        for name in recent
        if name not in examples and _is_file(Path(name))
    ]
    return (
        *lately,
        *(MissionEntry(group=FileGroup.EXAMPLE, name=name, path=name, kind="example") for name in examples),
    )


def matching(entries: Sequence[MissionEntry], typed: str) -> tuple[MissionEntry, ...]:
    """Entries whose name contains the typed text, those that begin with it first."""
    wanted = typed.strip().lower()
    if not wanted:
        return tuple(entries)
    kept = [entry for entry in entries if wanted in entry.name.lower() and entry.name != ".."]
    return tuple(
        sorted(kept, key=lambda entry: (entry.group is FileGroup.FOLDER, not entry.name.lower().startswith(wanted)))
    )


def kinds(*, is_written: bool = False) -> dict[str, str]:
    """What files of each suffix are, for users; all that can be read, or those that can be written."""
    formats = plan_formats().by_suffix.items()
    plans = {suffix: one.title for suffix, one in formats if one.write is not None or not is_written}
    return {**dict.fromkeys(MISSION_SUFFIXES, "mission"), **plans}


def _entries(folder: Path) -> Iterator[MissionEntry]:
    known = kinds()
    for path in folder.iterdir():
        if path.name.startswith("."):
            continue
        try:
            if path.is_dir():
                yield MissionEntry(group=FileGroup.FOLDER, name=path.name, path=str(path), kind="folder")
            elif path.suffix in known and path.is_file() and _may_be_mission(path):
                size = path.stat().st_size
                yield MissionEntry(
                    group=FileGroup.FOLDER, name=path.name, path=str(path), kind=known[path.suffix], size=size
                )
        except OSError:
            continue


def _may_be_mission(path: Path) -> bool:
    """False for what plainly is none: many a file has a suffix that a mission may have. Who types its path opens it."""
    begins = _BEGINS.get(path.suffix)
    if begins is None:
        return True
    try:
        with path.open("rb") as file:
            return begins(file.read(LISTED_MOST)) is not None
    except OSError:  # opening it says why
        return True


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False
