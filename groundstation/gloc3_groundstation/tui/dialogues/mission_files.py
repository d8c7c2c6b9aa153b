"""Opening and saving a mission, with dialogues so that unsaved changes are never lost silently."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from textual.app import App

from gloc3_groundstation.desk.mission_desk import MissionDesk
from gloc3_groundstation.missions.draft import Draft, objection
from gloc3_groundstation.tui.dialogues.open_mission import OpenMission
from gloc3_groundstation.tui.dialogues.save_mission import SaveMission
from gloc3_groundstation.tui.dialogues.unsaved import Unsaved, UnsavedQuestion

Then = Callable[[], None]


def _nothing() -> None:
    """What follows where nothing does."""


class MissionFileDialogue:
    """Asks the operator, and has the desk do it."""

    def __init__(self, app: App[Any], missions: MissionDesk, vehicle: Callable[[], str | None]) -> None:
        """A guide through the dialogues.

        Args:
            app: shows them.
            missions: reads and writes.
            vehicle: tells the name of the vehicle in view.
        """
        self._app: Final = app
        self._missions: Final = missions
        self._vehicle: Final = vehicle

    def choose(self, then: Callable[[str], None]) -> None:
        """Lets a file be chosen; what is not saved is asked about first."""

        def request() -> None:
            draft = self._missions.draft
            last = (draft.path or draft.made_of) if draft is not None else ""
            folder = Path(last).parent if last else Path.cwd()
            dialogue = OpenMission(self._missions.recent, folder.absolute())
            self._app.push_screen(dialogue, lambda file: then(file) if file is not None else None)

        self.when_saved(request)

    def when_saved(self, then: Then) -> None:
        """Goes on when nothing can be lost any more."""
        draft = self._missions.draft
        if draft is None or not draft.is_changed:
            then()
            return

        def answered(answer: Unsaved | None) -> None:
            if answer is Unsaved.SAVE:
                self.save(then)
            elif answer is Unsaved.DISCARD:
                then()

        self._app.push_screen(UnsavedQuestion(draft.name), answered)

    def save(self, then: Then = _nothing) -> None:
        """Saves in the file that it came from; asks for a name where there is none, or that file is another by now."""
        draft = self._missions.draft
        if draft is None or draft.is_fixed:
            return
        if not draft.path or objection(draft, Path(draft.path)):
            self.save_as(then)
        elif not self._missions.save(Path(draft.path), self._vehicle()):
            then()
        else:
            self.save_as(then)

    def save_as(self, then: Then = _nothing) -> None:
        """Saves under another name, or exports."""
        draft, missions = self._missions.draft, self._missions
        if draft is None or draft.is_fixed:
            return

        def write(path: Path) -> str:
            return missions.save(path, self._vehicle())

        dialogue = SaveMission(
            suggestion(draft),
            lambda path: missions.lost_in(path, self._vehicle()),
            lambda path: objection(draft, path),
            write,
        )
        self._app.push_screen(dialogue, lambda is_written: then() if is_written else None)


def suggestion(draft: Draft) -> Path:
    """The file that a mission would be saved in."""
    if draft.path:
        return Path(draft.path)
    if draft.made_of:
        return Path(draft.made_of).with_suffix(".yaml")
    return Path(Path(draft.name).stem.replace(" ", "_") + ".yaml")
