"""The mission screen, driven by keys: opening, mending, saving, steering items, and single actions."""

from pathlib import Path

import pytest
from tests.groundstation.scripted_platform import ScriptedPlatform, refused, reply_to
from tests.groundstation.station_scene import Scene, scene
from textual.widgets import Input

from gloc3.messages.command_interface import LoadMission, ReadMission, RequestAction, Steer, Verb
from gloc3.messages.summaries import MissionSummary
from gloc3.mission.examples import find_mission
from gloc3.mission.model.model import digest_of
from gloc3_groundstation.desk.mission_desk import MissionDesk
from gloc3_groundstation.shared_missions.shared_flight import CrewOptions, Replacement
from gloc3_groundstation.store.configuration import Configuration, LastSession
from gloc3_groundstation.tui.dialogues.mission_files import OpenMission, SaveMission, UnsavedQuestion
from gloc3_groundstation.tui.dialogues.questions import YesNoQuestion
from gloc3_groundstation.tui.dialogues.single_action import SingleAction
from gloc3_groundstation.tui.screens.mission import MissionScreen
from gloc3_groundstation.tui.widgets.lines import text_of
from gloc3_groundstation.tui.widgets.mission_text import MissionEditor
from gloc3_groundstation.tui.widgets.panel import ListPanel, Panel

pytestmark = pytest.mark.sockets

INSPECTION = find_mission("inspection").read_text()
TASKS = ("depart", "depart.climb", "sweep", "sweep.wall", "sweep.photos", "recover", "recover.home", "recover.down")


def missions(here: Scene) -> MissionDesk:
    return here.app.desk.missions


def editor(here: Scene) -> MissionEditor:
    return here.app.screen.query_one(MissionEditor)


async def open_typed(here: Scene, file: str) -> None:
    """Opens a file as an operator does: o, its path, enter."""
    await here.press("o")
    await here.wait(lambda: isinstance(here.app.screen, OpenMission) and isinstance(here.app.focused, Input))
    here.app.screen.query_one(Input).value = file
    await here.pilot.pause()
    await here.press("enter")
    await here.wait(lambda: not isinstance(here.app.screen, OpenMission))


def fly(here: Scene, **states: str) -> None:
    """Has the platform hold the inspection, and say some states."""
    tasks = dict.fromkeys(TASKS, "waiting")
    here.platform.mission = MissionSummary(
        name="cargo hold inspection", digest=digest_of(INSPECTION), state="running", tasks=tasks
    )
    here.platform.advance("running", {}, **states)
    here.platform.speak()
    here.app.show_fleet()


async def test_a_file_is_found_by_typing_and_folders_are_gone_through_by_keys(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "other.yaml").write_text(INSPECTION)
    async with scene(None) as here:
        await here.go("3")
        assert "o opens one" in here.shown("graph")
        await here.press("o")
        await here.wait(lambda: isinstance(here.app.screen, OpenMission) and isinstance(here.app.focused, Input))
        typed = here.app.screen.query_one(Input)

        def listed() -> str:
            return "\n".join(text_of(line) for line in here.app.screen.query_one(ListPanel).lines)

        await here.wait(lambda: "inspection" in listed())
        typed.value = f"{tmp_path}/"
        await here.wait(lambda: "sub/" in listed())
        await here.press("down", "enter")
        await here.wait(lambda: "other.yaml" in listed())
        await here.press("backspace")
        await here.wait(lambda: "sub/" in listed())
        typed.value = "inspec"
        await here.wait(lambda: "patrol" not in listed() and "inspection" in listed())
        await here.press("enter")
        await here.until("position", "open: inspection.yaml")
        assert "╭ ○ sweep" in here.shown("graph")
        assert missions(here).recent == ("inspection",)
        await open_typed(here, "/none/such.yaml")
        await here.wait(lambda: any("open: there is no file" in one.text for one in here.station.fleet.events))
        await here.until("position", "open: inspection.yaml")
        assert not here.requested(LoadMission), "opening streams nothing"


async def test_an_error_is_shown_at_its_line_mended_saved_and_what_is_not_saved_is_asked_about(tmp_path: Path) -> None:
    file = tmp_path / "m.yaml"
    wrong = INSPECTION.replace("after: [depart]", "after: [depart, nowhere]").replace("0.5}", "none}")
    first, second = (
        next(n for n, line in enumerate(wrong.splitlines()) if part in line) for part in ("nowhere", "none}")
    )
    file.write_text(wrong)
    async with scene(None) as here:
        here.platform.speak()
        await here.go("3")
        await open_typed(here, str(file))
        await here.until("findings", f"✗ {first + 1}:21   no task 'nowhere' here")
        await here.wait(lambda: editor(here).cursor_location == (first, 20))
        await here.until("keys", "^space HOLD")
        await here.press("ctrl+n")
        await here.wait(lambda: editor(here).cursor_location[0] == second)
        await here.press("ctrl+n")
        await here.wait(lambda: editor(here).cursor_location == (first, 20))
        strips = [editor(here).render_line(y).text for y in range(editor(here).size.height)]
        assert any(strip.startswith(f"{first + 1}✗ ") for strip in strips)
        assert missions(here).plan is None
        for previous, new in (("[depart, nowhere]", "[depart]"), ("none}", "0.5}")):
            editor(here).load_text(editor(here).text.replace(previous, new))
        await here.until("findings", "no findings")
        assert "not saved" in here.shown("position")
        assert missions(here).plan is not None
        await here.press("escape")
        await here.until("position", "open: m.yaml")
        await here.press("o")
        await here.shows(UnsavedQuestion)
        await here.press("escape")
        await here.shows(MissionScreen)
        await here.press("q")
        await here.shows(YesNoQuestion)
        await here.press("n")
        await here.shows(MissionScreen)
        await here.press("e")
        await here.wait(lambda: here.app.focused is editor(here))
        await here.press("ctrl+s")
        await here.wait(lambda: not missions(here).has_unsaved)
        assert file.read_text() == INSPECTION
        await here.press("escape")
        assert here.app.configuration().session.missions == (str(file),)


async def test_while_the_mission_at_hand_has_errors_a_start_says_that_it_is_the_one_aboard(tmp_path: Path) -> None:
    file = tmp_path / "m.yaml"
    file.write_text(INSPECTION.replace("after: [depart]", "after: [nowhere]"))
    async with scene(None) as here:
        here.platform.mission = MissionSummary(name="cargo hold inspection", digest="0", state="waiting")
        here.platform.speak()
        await here.go("3")
        await open_typed(here, str(file))
        await here.until("findings", "no task 'nowhere' here")
        await here.wait(lambda: (known := here.app.platform) is not None and known.mission is not None)
        await here.press("escape")
        await here.wait(lambda: here.app.focused is not editor(here))
        await here.press("s")
        await here.shows(YesNoQuestion)
        requested = here.app.screen
        assert isinstance(requested, YesNoQuestion)
        assert "as loaded onboard (the open one has errors), on heron?" in requested._question


async def test_a_file_that_another_program_changed_is_overwritten_only_with_another_word(tmp_path: Path) -> None:
    file = tmp_path / "m.yaml"
    file.write_text(INSPECTION)
    async with scene(None) as here:
        await here.go("3")
        await open_typed(here, str(file))
        await here.until("position", "m.yaml")
        await here.press("e")
        await here.wait(lambda: here.app.focused is editor(here))
        editor(here).load_text(INSPECTION + "# mine\n")
        await here.wait(lambda: missions(here).has_unsaved)
        file.write_text("theirs")
        await here.press("ctrl+s")
        await here.shows(SaveMission)

        def text() -> str:
            return " ".join(text_of(line) for line in here.app.screen.query_one("#said", Panel).lines)

        await here.wait(lambda: "changed by another program" in text())
        await here.press("enter")
        await here.wait(lambda: "enter again overwrites it" in text())
        assert file.read_text() == "theirs"
        await here.press("enter")
        await here.wait(lambda: not missions(here).has_unsaved)
        assert file.read_text().endswith("# mine\n")


async def test_an_export_tells_what_such_a_file_cannot_carry(tmp_path: Path) -> None:
    async with scene(None) as here:
        await here.go("3")
        await open_typed(here, "inspection")
        await here.until("position", "inspection.yaml")
        await here.press("w")
        await here.shows(SaveMission)
        typed = here.app.screen.query_one(Input)

        def text() -> str:
            return " ".join(text_of(line) for line in here.app.screen.query_one("#said", Panel).lines)

        typed.value = str(tmp_path / "x.plan")
        await here.wait(lambda: "no place on Earth" in text())
        typed.value = str(tmp_path / "x.doc")
        await here.wait(lambda: "the file type follows the suffix" in text())
        typed.value = str(tmp_path / "x.yaml")
        await here.wait(lambda: "written as: mission" in text())
        await here.press("enter")
        await here.wait((tmp_path / "x.yaml").is_file)
        assert (tmp_path / "x.yaml").read_text() == INSPECTION


async def test_tasks_and_actions_are_steered_by_the_cursor_and_only_as_far_as_it_is_legal() -> None:
    async with scene(None, size=(120, 40)) as here:
        here.platform.text = INSPECTION
        fly(here, depart="done", depart__climb="done", sweep="running", sweep__wall="running", sweep__photos="failed")
        await here.go("3")
        await here.until("graph", "├──▶│")
        assert here.requested(ReadMission), "the order of a mission that this station has not streamed is read back"
        await here.press("k", "p")
        await here.wait(lambda: len(here.requested(Steer)) == 2)
        await here.press("down")
        await here.until("detail", "✓ done")
        await here.press("p", "r", "k")
        await here.wait(lambda: len(here.requested(Steer)) == 3)  # what is over cannot be paused: the mission is
        await here.press("right", "down", "down")
        await here.until("detail", "✗ failed   record_images ground every 0.5 m")
        await here.press("t")
        await here.wait(lambda: len(here.requested(Steer)) == 4)
        await here.press("up", "a")
        await here.shows(YesNoQuestion)
        await here.press("n", "a")
        await here.shows(YesNoQuestion)
        await here.press("y")
        await here.wait(lambda: len(here.requested(Steer)) == 5)
        assert here.requested(Steer) == [
            Steer(verb=Verb.SKIP),
            Steer(verb=Verb.PAUSE),
            Steer(verb=Verb.PAUSE),
            Steer(verb=Verb.RETRY, target="sweep.photos"),
            Steer(verb=Verb.ABORT, target="sweep.wall"),
        ]
        base = here.app.base
        assert base is not None
        keys = {key.label: key.is_enabled for key in base.keys()}  # noqa: SIM118 - keys of the keyboard
        assert (keys["Pause"], keys["Resume"], keys["Start"]) == (True, False, False)


async def test_a_single_action_is_asked_for_by_a_form_and_its_reply_is_shown() -> None:
    async with scene(None) as here:
        here.platform.answer_next(
            RequestAction,
            refused("motion is claimed by sweep.wall; pause or abort it first"),
            lambda request: reply_to(request, reason="command-7"),
        )
        fly(here, sweep="running", sweep__wall="running")
        await here.go("3")
        await here.press("d")
        await here.shows(SingleAction)

        def text(panel: str) -> str:
            return "\n".join(text_of(line) for line in here.app.screen.query_one(f"#{panel}", Panel).lines)

        await here.wait(lambda: "go_to" in text("capabilities"))
        here.app.screen.query_one(ListPanel).point_at("go_to")
        await here.press("enter")
        await here.wait(lambda: isinstance(here.app.focused, Input))
        await here.wait(lambda: "x, y, height" in text("hint"))
        await here.press("ctrl+s")
        await here.wait(lambda: "position must be given" in text("reply"))
        here.app.screen.query_one("#field_position_m", Input).value = "4, 1, 2"
        await here.press("ctrl+s")
        await here.wait(lambda: "refused: motion is claimed by sweep.wall" in text("reply"))
        await here.press("ctrl+s")
        await here.wait(lambda: "accepted: running as command-7" in text("reply"))
        sent = here.requested(RequestAction)
        assert sent[0] == sent[1]
        assert isinstance(sent[0], RequestAction)
        assert sent[0].arguments["position_m"] == [4.0, 1.0, 2.0]
        await here.press("escape")
        await here.wait(lambda: here.app.screen.query_one(ListPanel).has_focus)
        here.app.screen.query_one(ListPanel).point_at("take_off")
        await here.press("enter")
        await here.wait(lambda: isinstance(here.app.focused, Input))
        here.app.screen.query_one("#field_height_m", Input).value = "2"
        await here.press("ctrl+s")
        await here.shows(YesNoQuestion)
        await here.press("n")
        await here.shows(SingleAction)
        assert len(here.requested(RequestAction)) == 2, "what arms the vehicle is asked about first"
        await here.press("ctrl+s", "y")
        await here.wait(lambda: len(here.requested(RequestAction)) == 3)
        await here.press("escape")
        await here.wait(lambda: here.app.screen.query_one(ListPanel).has_focus)
        here.app.screen.query_one(ListPanel).point_at("depart")
        await here.press("enter", "ctrl+s")
        await here.shows(YesNoQuestion)
        await here.press("n", "escape")
        assert len(here.requested(RequestAction)) == 3, "however it sets off"
        await here.wait(lambda: here.app.screen.query_one(ListPanel).has_focus)
        await here.press("escape")
        await here.shows(MissionScreen)


async def test_changes_are_kept_when_the_station_closes_without_a_word(tmp_path: Path) -> None:
    configuration = Configuration(session=LastSession(missions=("/old.yaml",)))
    async with scene(None, configuration=configuration) as here:
        assert missions(here).recent == ("/old.yaml",)
        await here.go("3")
        await here.press("n")
        await here.wait(lambda: here.app.focused is editor(here))
        assert missions(here).keep_unsaved(tmp_path / "kept") is None, "nothing was typed yet"
        await here.press("4", "2")
        await here.wait(lambda: missions(here).has_unsaved)
        editor(here).move_cursor((5, 4))
        await here.press("end", "enter", "x")
        await here.wait(lambda: "    actions:\n      x\n" in editor(here).text)
        assert here.app.current_mode == "mission", "digits are typed"
        await here.press("ctrl+c")
        kept = missions(here).keep_unsaved(tmp_path / "kept")
        assert kept is not None
        assert kept.read_text().startswith("42gloc3: 1\n")
        assert missions(here).keep_unsaved(tmp_path / "kept") != kept, "nothing is overwritten"


async def test_a_mission_with_errors_that_the_station_was_started_with_is_open_at_the_first_of_them(
    tmp_path: Path,
) -> None:
    file = tmp_path / "bad.yaml"
    file.write_text(INSPECTION.replace("height_m: 1.5", "hieght_m: 1.5"))
    line = next(number for number, text in enumerate(file.read_text().splitlines()) if "hieght_m" in text)
    async with scene(plan=None, opens=str(file)) as here:
        await here.wait(lambda: here.app.current_mode == "mission" and here.app.focused is editor(here))
        await here.wait(lambda: editor(here).cursor_location[0] == line)
        here.platform.speak()
        await here.until("title", "heron")
        assert here.requested(LoadMission) == []


async def test_ctrl_c_copies_what_is_selected_in_the_editor_and_closes_without_a_selection(tmp_path: Path) -> None:
    async with scene() as here:
        await here.go("3")
        await here.press("e")
        await here.wait(lambda: here.app.focused is editor(here))
        await here.press("shift+right", "shift+right", "shift+right", "ctrl+c")
        await here.wait(lambda: here.app.clipboard == "mis")
        assert not here.app._exit
        await here.press("right", "ctrl+c")
        await here.wait(lambda: here.app._exit)
        assert here.app.return_code == 130


SHARED = """\
mission: two sides
frame: hold
on_failure: land
tasks:
  up: {platform: each, actions: {go: {take_off: {height_m: 2}}}}
  left: {platform: any, after: [up], actions: {go: {go_to: {position_m: [5, 3, 2]}}}}
  right: {platform: any, after: [up], actions: {go: {go_to: {position_m: [5, -3, 2]}}}}
  down: {platform: each, after: [left, right], actions: {end: {land: {}}}}
"""


async def test_tasks_for_any_platform_are_assigned_by_a_key_and_those_of_a_lost_vehicle_after_a_question(
    tmp_path: Path,
) -> None:
    files = []
    for name in ("heron", "gannet"):
        file = tmp_path / f"{name}.yaml"
        frames = "frames: {hold: {origin: {geo: [43.1, 9.2, 12.0]}}}"  # where the scripted vehicles stand
        file.write_text(f"extends: pelican_rtk\nplatform: {name}\n{frames}\n")
        files.append(str(file))
    mission = tmp_path / "shared.yaml"
    mission.write_text(SHARED)
    async with scene(None) as here:
        here.platform.speak()
        other = ScriptedPlatform(here.exchange, "gannet")
        other.speak()
        here.app.desk.crew.options = CrewOptions(files=tuple(files))
        await here.go("3")
        await open_typed(here, str(mission))
        await here.until("position", "2 tasks to assign: v")
        assert here.app.desk.plan is None
        here.platform.speak()
        other.speak()
        await here.press("v")
        await here.wait(lambda: here.app.desk.plan is not None)
        draft = missions(here).draft
        assert draft is not None
        assert draft.text.startswith(SHARED + "assigned: {heron: [")
        assert here.app.desk.plan is not None
        assert set(here.app.desk.plan.platforms) == {"heron", "gannet"}
        crew = here.app.desk.crew
        asked = here.platform.loop.create_task(
            crew.request_answer(
                Replacement(
                    lost="gannet", reason="no message for 10 s", tasks=("right",), shares=("heron: left, right",)
                )
            )
        )
        await here.until("position", "gannet has dropped out, v assigns its tasks")
        await here.press("v")
        await here.wait(lambda: isinstance(here.app.screen, YesNoQuestion))
        await here.press("y")
        assert await asked
        assert crew.question is None
