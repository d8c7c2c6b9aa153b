"""Reads and checks a mission file, as far as the platform is known here."""

from collections.abc import Collection, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final

import msgspec

from gloc3.documents.document import load_bytes
from gloc3.errors import InputError, Refused
from gloc3.messages.command_interface import Outcome, ReadMission
from gloc3.mission.checking.checker import CheckReport, Circumstances, check_text
from gloc3.mission.checking.plan_check import check_plan
from gloc3.mission.examples import example_missions, find_mission
from gloc3.mission.formats import is_plan_file, mission_text
from gloc3.mission.model.model import digest_of
from gloc3.platform.bases import platform_files
from gloc3.platform.platform import Platform
from gloc3.platform.reader import find_platform, load_platform, named_platform
from gloc3.terrain import Terrain
from gloc3_groundstation.station.snapshots import PlatformSnapshot
from gloc3_groundstation.station.station import Station

REQUESTED_AGAIN_S: Final = 10.0
"""Interval between requests for a text that has not arrived, s."""
KEPT: Final = 32
OTHER_FILE: Final = "the platform file of {0} differs from {1}: only {0} itself checks the mission"


class CheckedPlan(msgspec.Struct, frozen=True, kw_only=True):
    """A mission that was read and checked, ready to be uploaded."""

    name: str
    """The file's name."""
    title: str
    """What the mission calls itself."""
    text: str
    file: str = ""
    """File that it is saved in; empty for an example, and for a converted plan."""
    converted_from: str = ""
    """The other program's file that it was made of; empty for a mission file."""
    platforms: tuple[str, ...] = ()
    """Those that its tasks name, where it is for several; it is uploaded to all of them."""
    unassigned: tuple[str, ...] = ()
    """Tasks for which no platform is chosen yet; it cannot be uploaded until they are assigned."""
    written_for: str = ""
    """The platform that its header stands for; empty without one."""
    warnings: tuple[str, ...] = ()
    """Found against the platform's file; nothing where that is not installed here."""
    platform_file: str = ""
    """The file of the platform that was named for the check; empty where none was, or an installed one by its name."""


def read_plan(
    name: str, platform: str | None = None, components: Collection[str] = (), terrain: Terrain | None = None
) -> CheckedPlan:
    """Reads and checks a mission.

    Args:
        name: a mission file, a `.plan` or a file of waypoints (these are converted), or the name of an example.
        platform: the platform's name, or its file; where a file of that name is installed here too the check is as
            strict as onboard.
        components: that it has, where that is known.
        terrain: heights of the ground; None without tiles.

    Raises:
        Refused: there is no such file.
        InputError: it may not fly; with everything that is wrong.
    """
    path = find_mission(name)
    if not path.is_file():
        raise Refused(f"there is no mission file {name!r}")
    known = known_platform(platform, components)
    circumstances = Circumstances(platform=known, known=known_platform, terrain=terrain, is_assigned_later=True)
    is_foreign = is_plan_file(path)
    if is_foreign:
        plan = _plan(check_plan(path, circumstances).report)
    else:
        file, text, _ = mission_text(str(path), known)
        plan = _plan(check_text(text, file, circumstances))
    if is_foreign:
        plan = msgspec.structs.replace(plan, converted_from=str(path))
    elif path not in example_missions().values():
        plan = msgspec.structs.replace(plan, file=str(path.absolute()))
    if known is None:
        return msgspec.structs.replace(plan, warnings=())
    is_file = platform is not None and Path(platform).is_file()
    return msgspec.structs.replace(plan, platform_file=str(platform)) if is_file else plan


def recheck(
    plan: CheckedPlan,
    platform: str,
    components: Collection[str] = (),
    digest: str = "",
    terrain: Terrain | None = None,
) -> CheckedPlan:
    """Checks a mission again for the platform that it goes to, if that one's file is here.

    A plan of another program is converted again, at the platform's speed.

    Args:
        plan: the mission.
        platform: the platform's name.
        components: that it has, where that is known.
        digest: of its file, where it tells that: no other file counts then, whatever its name.
        terrain: heights of the ground; None without tiles.

    Raises:
        InputError: it may not fly there; with everything that is wrong.
    """
    known = known_platform(platform, components, digest, plan.platform_file)
    if known is None:
        is_other = known_platform(platform, components, "", plan.platform_file) is not None
        text = OTHER_FILE.format(platform, plan.platform_file or "the one installed here")
        return msgspec.structs.replace(plan, warnings=(text,) if is_other else ())
    if plan.converted_from:
        circumstances = Circumstances(platform=known, known=known_platform, terrain=terrain)
        made = _plan(check_plan(Path(plan.converted_from), circumstances).report)
    else:
        made = _plan(check_text(plan.text, plan.name, Circumstances(platform=known, terrain=terrain)))
    return msgspec.structs.replace(made, converted_from=plan.converted_from, platform_file=plan.platform_file)


def known_platform(
    name: str | None, components: Collection[str] = (), digest: str = "", file: str = ""
) -> Platform | None:
    """The platform of that name, if its file is here.

    Args:
        name: of the platform, or of its file.
        components: that it has, where that is known: two files may be of one vehicle, with other sensors.
        digest: of its file, where that is known: a copy of a file may keep the name and change the limits.
        file: a file of it beside those that are installed.

    Raises:
        InputError: its file has mistakes.
    """
    if name is None:
        return None
    if digest:
        return next((one for one in _called(name, file) if one.digest() == digest), None)
    if file and (given := load_platform(file)).platform == name:
        return given
    try:
        find_platform(name)
    except InputError:
        found = None
    else:
        found = load_platform(name)
    if not components or (found is not None and _has(found, components)):
        return found
    return next((other for other in _called(name) if _has(other, components)), found)


def _called(name: str, file: str = "") -> Iterator[Platform]:
    """The platforms of a name: of the file that is given, and of those that are installed and free of mistakes."""
    if file and (given := load_platform(file)).platform == name:
        yield given
    for installed in platform_files().values():
        with suppress(InputError):
            other = load_platform(str(installed)) if name.encode() in load_bytes(installed) else None
            if other is not None and other.platform == name:
                yield other


def _has(platform: Platform, components: Collection[str]) -> bool:
    return {row.name for row in platform.components} == set(components)


def _plan(report: CheckReport) -> CheckedPlan:
    mission = report.flyable()
    warnings = [msgspec.structs.replace(finding, is_warning=False) for finding in report.findings]
    return CheckedPlan(
        name=Path(report.file).name,
        title=mission.name,
        text=mission.text,
        platforms=mission.platforms,
        unassigned=mission.unassigned,
        written_for=named_platform(mission.platform),
        warnings=tuple(str(warning) for warning in warnings),
    )


class MissionTexts:
    """Mission texts by the digests that vehicles report for their loaded missions."""

    def __init__(self, station: Station) -> None:
        self._station = station
        self._texts: dict[str, str] = {}
        self._requested_s: dict[str, float] = {}

    def text_of(self, platform: PlatformSnapshot | None, plan: CheckedPlan | None) -> tuple[str, bool]:
        """The mission of a vehicle, and whether it is loaded there.

        Returns:
            The loaded one; while there is none, or its text is not known yet, the selected one. Empty without either.
        """
        digest = _digest(platform)
        if digest and digest not in self._texts and plan is not None and digest_of(plan.text) == digest:
            self._keep(digest, plan.text)
        if digest in self._texts:
            return self._texts[digest], True
        return ("", False) if plan is None or digest else (plan.text, False)

    def missing(self, platform: PlatformSnapshot | None, now_s: float) -> bool:
        """Whether the text of a vehicle's loaded mission should be requested now."""
        digest = _digest(platform)
        return bool(digest) and digest not in self._texts and now_s >= self._requested_s.get(digest, 0.0)

    async def fetch(self, platform: PlatformSnapshot) -> None:
        """Requests the text of a vehicle's loaded mission; without an answer it is requested again later."""
        digest, now_s = _digest(platform), self._station.now_s()
        self._requested_s[digest] = now_s + REQUESTED_AGAIN_S
        reply = await self._station.client.request(platform.name, ReadMission())
        if reply.outcome is Outcome.ACCEPTED and digest_of(reply.text) == digest:
            self._keep(digest, reply.text)

    def _keep(self, digest: str, text: str) -> None:
        if len(self._texts) >= KEPT:
            del self._texts[next(iter(self._texts))]
        self._texts[digest] = text


def _digest(platform: PlatformSnapshot | None) -> str:
    return platform.mission.value.digest if platform is not None and platform.mission is not None else ""
