"""Missions on the desk: the open one, those onboard vehicles, and commands to their tasks and actions."""

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from gloc3.errors import Gloc3Error, InputError, Refused
from gloc3.messages.command_interface import ReadMission, RequestAction, Verb
from gloc3.messages.envelope import Severity
from gloc3.messages.summaries import MissionSummary
from gloc3.mission.checking.checker import Circumstances, check_text
from gloc3.mission.model.abilities import ARMING
from gloc3.mission.model.model import GEO, Policies, digest_of
from gloc3.mission.model.states import ActionState
from gloc3.platform.platform import Capability, Platform
from gloc3_groundstation.desk import flights
from gloc3_groundstation.missions import draft as drafts
from gloc3_groundstation.missions import forms
from gloc3_groundstation.missions.draft import Draft
from gloc3_groundstation.missions.outline import COMMANDS, Outline, outline_of, received_outline
from gloc3_groundstation.missions.plans import CheckedPlan, known_platform
from gloc3_groundstation.station import wording
from gloc3_groundstation.station.snapshots import PlatformSnapshot
from gloc3_groundstation.station.station import Station
from gloc3_groundstation.store.configuration import with_recent

OUTLINES_KEPT: Final = 8
REQUESTED_AGAIN_S: Final = 10.0
"""Interval between attempts to read back a mission, s."""


class MissionDesk:
    """Holds the selected mission, and the outlines of loaded ones; refusals become events."""

    def __init__(self, station: Station, plan: CheckedPlan | None = None, recent: tuple[str, ...] = ()) -> None:
        """Creates a mission desk.

        Args:
            station: receives from and commands the platforms.
            plan: the selected mission, checked; None without one.
            recent: the files opened last, the last one first.
        """
        self.station: Final = station
        self.recent = recent
        self.draft: Draft | None = None
        self._plan = plan
        self._outlines: dict[str, Outline] = {}
        self._requested_s: dict[tuple[str, str], float] = {}
        self._platforms: dict[tuple[str, tuple[str, ...], str], Platform | None] = {}
        if plan is not None:
            self.draft = drafts.checked(
                Draft(
                    name=plan.name,
                    text=plan.text,
                    kept_text=plan.text,
                    path=plan.file,
                    made_of=plan.converted_from,
                ),
                None,
                station.terrain,
            )
            if self.draft.outline is not None:
                self._keep(self.draft.outline)

    # --- the mission at hand ---

    @property
    def plan(self) -> CheckedPlan | None:
        """The plan to send: the selected mission, if it may fly."""
        return self._plan

    @property
    def has_unsaved(self) -> bool:
        """Whether the selected mission has unsaved changes."""
        return self.draft is not None and self.draft.is_changed

    def begin(self, name: str | None) -> None:
        """Opens a new mission, for a vehicle of that name."""
        self._put(drafts.new_draft(self.platform(name)))

    async def open(self, file: str, name: str | None) -> bool:
        """Opens a file in place of the current mission, even if it has errors.

        Args:
            file: a mission, another program's plan, or the name of an example.
            name: the vehicle that it is checked for.
        """
        try:
            draft = await asyncio.to_thread(drafts.opened, file, self.platform(name), self.station.terrain)
        except Refused as refusal:
            self._note(name, Severity.ERROR, f"open: {refusal}")
            return False
        self._put(draft)
        self.recent = with_recent(self.recent, draft.path or draft.made_of or file)
        return True

    def edit(self, text: str) -> None:
        """Another text; until it is checked it cannot be uploaded."""
        if self.draft is not None and self.draft.text != text:
            self.draft = drafts.edited(self.draft, text)
            self._plan = None

    async def check(self, name: str | None) -> bool:
        """Checks the selected mission for a vehicle.

        Returns:
            Whether the selected mission is now checked; not if it was edited meanwhile.
        """
        draft = self.draft
        if draft is None:
            return True
        found = await asyncio.to_thread(drafts.checked, draft, self.platform(name), self.station.terrain)
        if self.draft is not draft:
            return False
        self._put(found)
        return True

    def is_checked_for(self, name: str | None) -> bool:
        """Whether the selected mission was checked for that vehicle, as far as it is known here."""
        platform = self.platform(name)
        wanted = platform.platform if platform is not None else ""
        return self.draft is None or self.draft.is_fixed or self.draft.platform == wanted

    def save(self, path: Path, name: str | None) -> str:
        """Saves the selected mission, or exports it, by the file's suffix; returns the error, or an empty text."""
        if self.draft is None:
            return "there is no mission"
        was_changed = self.draft.is_changed
        try:
            self.draft = drafts.saved(self.draft, path, self.platform(name))
        except InputError as error:
            return "; ".join(f"{one.message} ({one.hint})" if one.hint else one.message for one in error.findings)
        except Gloc3Error as error:
            return str(error)
        if drafts.is_mission_file(path):
            self.recent = with_recent(self.recent, self.draft.path)
            if was_changed and self._plan is not None:
                self._plan = self.draft.plan()
        self._note(name, Severity.INFO, f"{path} is written")
        return ""

    def lost_in(self, path: Path, name: str | None) -> tuple[str, ...]:
        """Parts of the selected mission that a file of that name cannot express.

        Raises:
            Refused: the mission cannot be expressed there.
        """
        if self.draft is None:
            return ()
        try:
            _, lost = drafts.written_as(self.draft, path, self.platform(name))
        except InputError as error:
            raise Refused("\n".join(finding.message for finding in error.findings)) from None
        return tuple(finding.message for finding in lost)

    def keep_unsaved(self, folder: Path) -> Path | None:
        """Puts unsaved changes where they are found again, when the station closes without a word."""
        if self.draft is None or not self.draft.is_changed:
            return None
        name = Path(self.draft.name).stem.replace(" ", "_")
        for number in range(1, 1000):
            path = folder / f"{name}.unsaved{'' if number == 1 else number}.yaml"
            if not path.exists():
                break
        try:
            folder.mkdir(parents=True, exist_ok=True)
            drafts.write_file(path, self.draft.text)
        except (OSError, Refused):
            return None
        return path

    def _put(self, draft: Draft) -> None:
        self.draft = draft
        self._plan = draft.plan()
        if draft.outline is not None:
            self._keep(draft.outline)

    # --- what platforms hold ---

    def platform(self, name: str | None) -> Platform | None:
        """The platform's file, if it is installed here and sound."""
        if name is None:
            return None
        received = self.station.fleet.get(name)
        key = (name, received.component_names, received.platform_digest) if received is not None else (name, (), "")
        if key not in self._platforms:
            try:
                self._platforms[key] = known_platform(*key)
            except InputError as error:
                self._platforms[key] = None
                self._note(name, Severity.WARNING, f"its platform file cannot be used here: {error.findings[0]}")
        return self._platforms[key]

    def outline(self, mission: MissionSummary) -> Outline:
        """Outline of the mission whose states a platform reports, as far as it is known."""
        return received_outline(mission, self._outlines.get(mission.digest) if mission.digest else None)

    def policies(self, platform: PlatformSnapshot) -> Policies | None:
        """The policies of the mission that a platform holds, as far as they are known."""
        return self.outline(platform.mission.value).policies if platform.mission is not None else None

    def after_abort(self, platform: PlatformSnapshot) -> str:
        """What follows when a platform's mission is aborted, in words."""
        return wording.after_abort(self.policies(platform))

    def is_at_hand(self, mission: MissionSummary | None) -> bool:
        """Whether a platform holds the selected mission."""
        return mission is not None and self.draft is not None and mission.digest == digest_of(self.draft.carried)

    def lacks_instruction(self, platform: PlatformSnapshot) -> bool:
        """Whether the outline of the mission that a platform holds is unknown and should be requested."""
        mission = platform.mission.value if platform.mission is not None else None
        if mission is None or not mission.digest or mission.digest in self._outlines:
            return False
        return self.station.now_s() >= self._requested_s.get((platform.name, mission.digest), 0.0)

    async def learn(self, name: str) -> None:
        """Reads back the mission that a platform holds, for its outline."""
        platform = self.station.fleet.get(name)
        if platform is None or platform.mission is None:
            return
        digest = platform.mission.value.digest
        self._requested_s[name, digest] = self.station.now_s() + REQUESTED_AGAIN_S
        try:
            reply = await self.station.client.carry_out(name, ReadMission())
        except Gloc3Error:
            return
        circumstances = Circumstances(platform=self.platform(name), terrain=self.station.terrain)
        report = await asyncio.to_thread(check_text, reply.text, platform.mission.value.name, circumstances)
        outline = outline_of(report, circumstances.capabilities())
        if outline is not None:
            self._keep(outline)

    def _keep(self, outline: Outline) -> None:
        self._outlines.pop(outline.digest, None)
        self._outlines[outline.digest] = outline
        while len(self._outlines) > OUTLINES_KEPT:
            del self._outlines[next(iter(self._outlines))]

    # --- what is asked of platforms ---

    async def steer(self, name: str, verb: Verb, target: str) -> bool:
        """Pauses, resumes, skips, aborts or retries the mission (empty), a task or an action."""
        try:
            await flights.request_control(self.station, name)
            await self.station.client.steer(name, verb, target)
        except Gloc3Error as error:
            self._note(name, Severity.ERROR, f"{verb} {target}: {error}".replace(" :", ":"))
            return False
        self._note(name, Severity.INFO, f"{verb} {target}".rstrip() + ": accepted")
        return True

    def capabilities(self, name: str) -> Mapping[str, Capability]:
        """Capabilities of a vehicle for single actions."""
        return forms.capabilities(self.platform(name))

    def form(self, name: str, capability: str) -> forms.CapabilityForm:
        """The form of a capability's arguments, in the frame that the vehicle's commands are in."""
        platform = self.platform(name)
        known = self.station.fleet.get(name)
        frame = known.vehicle.value.frame if known is not None and known.vehicle is not None else ""
        is_geo = not platform.frames if platform is not None else frame in ("", GEO)
        return forms.form_for(capability, self.capabilities(name)[capability], is_geo=is_geo)

    def arms(self, name: str, capability: str) -> bool:
        """Whether a single action would have a disarmed vehicle arm."""
        known = self.station.fleet.get(name)
        row = self.capabilities(name)[capability]
        return row.arguments in ARMING and known is not None and not known.is_armed

    def claimants(self, platform: PlatformSnapshot) -> dict[str, str]:
        """Resource to the action that holds it now, as far as the platform's states show."""
        mission = platform.mission.value if platform.mission is not None else None
        if mission is None:
            return {}
        rows = self.capabilities(platform.name)
        found: dict[str, str] = {}
        for stage in self.outline(mission).stages:
            for step in stage.steps:
                capability = step.capability or (step.name if stage.name.startswith(COMMANDS) else "")
                if mission.tasks.get(step.target) == ActionState.RUNNING and capability in rows:
                    found |= dict.fromkeys(rows[capability].claims, step.target)
        return found

    async def request(self, name: str, capability: str, arguments: dict[str, Any]) -> str:
        """Asks for a single action.

        Returns:
            The name of its task, under which it can be paused, resumed, skipped and aborted.

        Raises:
            Gloc3Error: it was refused, or nothing is known of it; with the reason, which is noted too.
        """
        try:
            await flights.request_control(self.station, name)
            body = RequestAction(capability=capability, arguments=arguments)
            reply = await self.station.client.carry_out(name, body)
        except Gloc3Error as error:
            self._note(name, Severity.ERROR, f"{capability}: {error}")
            raise
        self._note(name, Severity.INFO, f"{capability}: accepted as {reply.reason or 'a single action'}")
        return reply.reason

    def _note(self, name: str | None, severity: Severity, text: str) -> None:
        self.station.note(name or "", severity, text)
