"""A mission that is open at the station: its text, findings, and file. Immutable."""

from pathlib import Path
from typing import Final

import msgspec

from gloc3.documents.format_version import KEY, VERSION
from gloc3.errors import Finding, InputError, Refused
from gloc3.mission.checking.checker import Circumstances, check_text
from gloc3.mission.examples import example_missions, find_mission
from gloc3.mission.formats import MISSION_SUFFIXES, exported, is_plan_file, mission_text, written_text
from gloc3.mission.reading.library import bundled
from gloc3.mission.reading.reader import MissionReferences, read_mission
from gloc3.platform.platform import Platform
from gloc3.store import replace_file
from gloc3.terrain import Terrain
from gloc3_groundstation.missions.outline import Outline, outline_of
from gloc3_groundstation.missions.plans import CheckedPlan, known_platform

SHOWN_MAX: Final = 200_000
"""Characters of a file that is no mission at all that are shown."""
NEW_NAME: Final = "new mission"
"""What one that was never saved is called."""
NEW: Final = f"""{KEY}: {VERSION}
mission: new mission
frame: geo
tasks:
  fly:
    actions:
      up: {{take_off: {{height_m: 2}}}}
      down: {{land: {{}}, after: [up]}}
"""


class Draft(msgspec.Struct, frozen=True, kw_only=True):
    """One open mission."""

    name: str
    """How it is called: the file's name."""
    text: str
    path: str = ""
    """File that it is saved in; empty until it has a name."""
    kept_text: str = ""
    """What that file holds."""
    made_of: str = ""
    """The other program's file that it was made of."""
    is_fixed: bool = False
    """The text is that of a file which is no mission; it is shown and cannot be edited."""
    left_out: tuple[Finding, ...] = ()
    """What the conversion has left out or changed."""
    findings: tuple[Finding, ...] = ()
    """Of the last check, in order of place."""
    outline: Outline | None = None
    """None where no order can be drawn."""
    carried: str = ""
    """The text as it is streamed: with the libraries that it includes."""
    platform: str = ""
    """Checked for; empty where the platform's file is not installed here."""

    @property
    def is_changed(self) -> bool:
        """Whether something in it is not saved."""
        return not self.is_fixed and self.text != self.kept_text

    @property
    def errors(self) -> int:
        """How many findings keep it from flying."""
        return sum(not finding.is_warning for finding in self.findings)

    @property
    def first_error(self) -> int:
        """Which finding of `requested` is the first error; 0 where none is."""
        return next((number for number, finding in enumerate(self.requested) if not finding.is_warning), 0)

    @property
    def is_ok(self) -> bool:
        """Whether it may fly."""
        return self.outline is not None and not self.errors

    @property
    def requested(self) -> tuple[Finding, ...]:
        """Findings for the operator: those of the check, then the parts that a conversion left out."""
        return (*self.findings, *self.left_out)

    def plan(self) -> CheckedPlan | None:
        """What is streamed; None while it may not fly, or its tasks are not assigned."""
        if self.outline is None or not self.is_ok or self.outline.unassigned:
            return None
        untouched = self.made_of if self.text == self.kept_text else ""
        warnings = [msgspec.structs.replace(finding, is_warning=False) for finding in self.requested]
        return CheckedPlan(
            name=self.name,
            title=self.outline.title,
            text=self.carried,
            converted_from=untouched,
            platforms=self.outline.platforms,
            warnings=tuple(str(warning) for warning in warnings),
        )


def new_draft(platform: Platform | None) -> Draft:
    """A short mission to begin with."""
    frame = next(iter(platform.frames), "geo") if platform is not None else "geo"
    text = NEW.replace("frame: geo", f"frame: {frame}")
    return checked(Draft(name=NEW_NAME, text=text, kept_text=text), platform)


def opened(name: str, platform: Platform | None, terrain: Terrain | None = None) -> Draft:
    """Opens a mission file, an example, or another program's plan; never raises for errors in it.

    Raises:
        Refused: the file does not exist or cannot be read.
    """
    try:
        path = find_mission(name).expanduser()
        is_file = path.is_file()
    except InputError as error:
        raise Refused(str(error)) from None
    except (OSError, ValueError) as error:
        raise Refused(f"{name}: {error}") from None
    if not is_file:
        raise Refused(f"there is no file {name}" if not path.is_dir() else f"{name} is a folder")
    is_plan = is_plan_file(path)
    is_example = path in example_missions().values()
    try:
        left_out: list[Finding] = []
        if is_plan:
            _, text, left_out = mission_text(str(path), platform)
        else:
            text = written_text(path)
    except InputError as error:
        return Draft(name=path.name, text=_shown(path), is_fixed=True, findings=_own(error.findings, path.name))
    draft = Draft(
        name=path.name,
        text=text,
        kept_text=text,
        path="" if is_plan or is_example else str(path.absolute()),
        made_of=str(path) if is_plan else "",
        left_out=_own(left_out, path.name),
    )
    return checked(draft, platform, terrain)


def checked(draft: Draft, platform: Platform | None, terrain: Terrain | None = None) -> Draft:
    """The same, checked again; costs milliseconds, for a mission of thousands of waypoints seconds."""
    if draft.is_fixed:
        return draft
    circumstances = Circumstances(platform=platform, known=known_platform, terrain=terrain, is_assigned_later=True)
    try:
        carried = bundled(draft.text, Path(draft.path or draft.name))
    except InputError as error:
        return msgspec.structs.replace(draft, findings=_own(error.findings, draft.name), outline=None)
    report = check_text(carried, draft.name, circumstances)
    findings = report.findings
    if platform is None:
        findings = tuple(finding for finding in findings if not finding.is_warning)
    return msgspec.structs.replace(
        draft,
        findings=findings,
        outline=outline_of(report, circumstances.capabilities()),
        carried=carried,
        platform=platform.platform if platform is not None else "",
    )


def edited(draft: Draft, text: str) -> Draft:
    """The same with another text, not checked yet: nothing is known of it."""
    return draft if draft.is_fixed else msgspec.structs.replace(draft, text=text, carried=text)


def is_mission_file(path: Path) -> bool:
    """Whether a file of that name is a GLOC3 mission."""
    return path.suffix in MISSION_SUFFIXES


def written_as(draft: Draft, path: Path, platform: Platform | None) -> tuple[str, tuple[Finding, ...]]:
    """What a file of that name would hold, and what of the mission it cannot carry.

    Raises:
        InputError: the mission cannot be expressed there; with the reasons.
    """
    if is_mission_file(path):
        return draft.text, ()
    mission = read_mission(draft.carried, draft.name, MissionReferences.of(platform, is_ground_level=True))
    text, lost = exported(mission, path.suffix, draft.name)
    return text, tuple(lost)


def objection(draft: Draft, path: Path) -> str:
    """Why a file should not be written without another word; empty where nothing would be lost."""
    if not path.exists():
        return ""
    if str(path.absolute()) != draft.path:
        return f"{path.name} is there already"
    try:
        held = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError):
        return f"{path.name} has changed since it was opened"
    return "" if held == draft.kept_text else f"{path.name} was changed by another program since it was opened"


def saved(draft: Draft, path: Path, platform: Platform | None) -> Draft:
    """Writes a file; returns the saved draft, or the unchanged one after an export.

    Raises:
        InputError: the mission cannot be expressed in such a file.
        Refused: it cannot be written.
    """
    text, _ = written_as(draft, path, platform)
    write_file(path, text)
    if not is_mission_file(path):
        return draft
    return msgspec.structs.replace(
        draft, path=str(path.absolute()), name=path.name, kept_text=text, made_of="", left_out=()
    )


def write_file(path: Path, text: str) -> None:
    """Writes a file atomically, or leaves the previous one.

    Raises:
        Refused: it cannot be written; with the reason.
    """
    try:
        replace_file(path, text.encode())
    except (OSError, ValueError) as error:
        reason = (getattr(error, "strerror", None) or str(error)).lower()
        raise Refused(f"{path} cannot be written: {reason}") from None


def _shown(path: Path) -> str:
    """A file that is not a mission, as text, so that findings can be shown in place."""
    try:
        with path.open("rb") as file:
            raw = file.read(SHOWN_MAX)
    except OSError:
        return ""
    text = raw.decode("utf-8-sig", errors="replace")
    return "".join(
        letter if letter.isprintable() or letter in "\n\t" else "\N{REPLACEMENT CHARACTER}" for letter in text
    )


def _own(findings: "list[Finding] | tuple[Finding, ...]", name: str) -> tuple[Finding, ...]:
    return tuple(msgspec.structs.replace(finding, file=name) for finding in findings)
