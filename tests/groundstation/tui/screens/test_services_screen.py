"""The services screen, driven by keys: journeys of an operator with a vehicle without our companion."""

import random
from pathlib import Path
from unittest.mock import patch

import pytest
from tests.groundstation.services.scripted_vehicle import ARDUPILOT, Logs
from tests.groundstation.services_scene import INFOS, NAME, ServicesScene, services_scene
from tests.groundstation.station_scene import scene
from textual.widgets import Input, Static

from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.transport.memory import Conditions
from gloc3.messages.command_interface import StationRole
from gloc3.mission.formats.items import FenceArea, ForeignPlan, MavItem, PlanEntry
from gloc3_groundstation.desk.service_jobs import ServiceKind
from gloc3_groundstation.tui.dialogues.questions import YesNoQuestion
from gloc3_groundstation.tui.widgets.entry import TextEntry
from gloc3_groundstation.tui.widgets.lines import text_of
from gloc3_groundstation.tui.widgets.panel import Panel

pytestmark = pytest.mark.sockets

CONTENT = random.Random(6).randbytes(60_000)
WAYPOINTS = "QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t47\t8\t500\t1\n1\t0\t3\t22\t0\t0\t0\t0\t47\t8\t10\t1\n"
SLOW = Conditions(latency_s=0.002, bandwidth_bit_s=400_000)


async def dialogue(here: ServicesScene, kind: type) -> None:
    """Waits until a dialogue is there and takes keys."""
    await here.shows(kind)
    if kind is TextEntry:
        await here.wait(lambda: isinstance(here.app.focused, Input))


async def enter(here: ServicesScene, text: str, *, is_wrong: bool = False) -> None:
    """Puts a text into the dialogue that asks for one, and takes it."""
    await dialogue(here, TextEntry)
    requesting = here.app.screen
    requesting.query_one(Input).value = text
    await here.press("enter")
    if not is_wrong:
        await here.wait(lambda: here.app.screen is not requesting)


def text_of_entry(here: ServicesScene) -> str:
    return "\n".join(text_of(line) for line in here.app.screen.query_one("#entry_lines", Panel).lines)


def wrong_of_entry(here: ServicesScene) -> str:
    return str(here.app.screen.query_one("#entry_wrong", Static).content)


async def test_an_observer_changes_nothing_and_reads_everything() -> None:
    async with services_scene() as here:
        here.station.client.role = StationRole.OBSERVER
        vehicle = here.app.desk.services.vehicle(NAME)
        vehicle.parameters.set("MPC_XY_VEL_MAX", 8.5)
        vehicle.plans.clear()
        vehicle.erase_logs()
        vehicle.remove_file("/fs/a.txt", is_folder=False)
        vehicle.console.open()
        refused = (
            ServiceKind.PARAMETERS,
            ServiceKind.PLANS,
            ServiceKind.LOGS,
            ServiceKind.FILES,
            ServiceKind.CONSOLE,
        )
        await here.wait(lambda: set(refused) <= vehicle.jobs.outcomes.keys())
        for one in refused:
            assert "may look and not command" in vehicle.jobs.outcomes[one].text, one
        vehicle.parameters.fetch()
        await here.wait(lambda: vehicle.jobs.outcomes.get(ServiceKind.PARAMETERS) is not None)
        await here.wait(lambda: "36 parameters" in vehicle.jobs.outcomes[ServiceKind.PARAMETERS].text)


async def test_a_parameter_is_searched_edited_within_its_bounds_and_marked(tmp_path: Path) -> None:
    (tmp_path / "infos.json").write_text(INFOS)
    async with services_scene(downloads=tmp_path) as here:
        assert "f fetches the parameters" in here.shown("parameters_list")
        await here.press("f")
        await here.until("job", "✓ 36 parameters")
        await here.press("i")
        await enter(here, "infos.json")
        await here.until("job", "4 of 36 parameters are described")
        await here.press("slash")
        await here.types("xy_vel")
        await here.until("parameters_header", "value")
        await here.wait(lambda: here.shown("parameters_list").count("\n") == 0)
        await here.enter()
        await here.press("enter")
        await dialogue(here, TextEntry)
        await here.wait(lambda: "from 0 to 20 m/s" in text_of_entry(here))
        await enter(here, "99", is_wrong=True)
        await here.wait(lambda: "must be at most 20 m/s" in wrong_of_entry(here))
        await enter(here, "8.5")
        await here.until("job", "✓ MPC_XY_VEL_MAX is 8.5 now (was 12)")
        await here.until("parameters_list", "●  MPC_XY_VEL_MAX")
        assert here.vehicle.parameters["MPC_XY_VEL_MAX"] == 8.5
        assert any("is 8.5 now" in event.text for event in here.station.fleet.events)
        await here.press("escape")
        await here.until("parameters_list", "CAL_ACC0_ID")
        with patch("gloc3_groundstation.tui.services.parameters.parameter_line") as made:
            here.app.show_fleet()
            assert not made.called, "nothing has changed, so no line is made anew"
        await here.press("m")
        await here.wait(lambda: here.shown("parameters_list").count("\n") == 0)


async def test_while_armed_a_write_is_asked_about_first(tmp_path: Path) -> None:
    (tmp_path / "way.waypoints").write_text(WAYPOINTS)
    async with services_scene(downloads=tmp_path) as here:
        await here.press("f")
        await here.until("job", "✓ 36 parameters")
        here.vehicle.heartbeat.base_mode = 128
        here.vehicle.heartbeat.send_now()
        here.vehicle.runner.settle()
        await here.wait(lambda: here.services.vehicle(NAME).is_armed)
        await here.press("e")
        await enter(here, "16777217")
        await dialogue(here, YesNoQuestion)
        question = here.app.screen
        assert isinstance(question, YesNoQuestion)
        assert "Set CAL_ACC0_ID to 16777217 in flight (it is 1310988)?" in question._question
        await here.press("n")
        await here.wait(lambda: not isinstance(here.app.screen, YesNoQuestion))
        assert here.services.vehicle(NAME).parameters.table["CAL_ACC0_ID"].value == 1310988
        await here.press("e")
        await enter(here, "7")
        await dialogue(here, YesNoQuestion)
        await here.press("y")
        await here.until("job", "✓ CAL_ACC0_ID is 7 now (was 1310988)")
        await here.tab("Plans")
        await here.press("o")
        await enter(here, "way.waypoints")
        await here.wait(lambda: here.services.vehicle(NAME).plans.file is not None)
        for key in ("u", "delete"):
            await here.press(key)
            await dialogue(here, YesNoQuestion)
            await here.press("n")
            await here.wait(lambda: not isinstance(here.app.screen, YesNoQuestion))
        assert not here.services.vehicle(NAME).jobs.running


async def test_a_file_is_compared_first_and_only_what_is_not_left_out_is_written(tmp_path: Path) -> None:
    (tmp_path / "new.parm").write_text("MPC_XY_VEL_MAX 8\nNAV_DLL_ACT 2\nOLD_ONE 1\nRTL_RETURN_ALT 60\n")
    (tmp_path / "bad.parm").write_text("MPC_XY_VEL_MAX eight\nNAV_DLL_ACT\n")
    async with services_scene(downloads=tmp_path) as here:
        await here.press("o")
        await enter(here, "bad.parm")
        await here.until("job", "bad.parm:1")
        await here.press("o")
        await enter(here, "new.parm")
        await here.until("job", "new.parm: 2 different, 1 same, 1 only in the file")
        assert "write  MPC_XY_VEL_MAX" in here.shown("parameters_list")
        table = here.services.vehicle(NAME).parameters.table
        assert table["MPC_XY_VEL_MAX"].value == 12, "nothing is written before the differences were seen"
        await here.press("down", "enter")
        await here.until("parameters_list", "leave  NAV_DLL_ACT")
        await here.press("w")
        await here.until("job", "new.parm: 1 parameter set and read back")
        table = here.services.vehicle(NAME).parameters.table
        assert (table["MPC_XY_VEL_MAX"].value, table["NAV_DLL_ACT"].value) == (8, 0)
        await here.press("s")
        await enter(here, "all.params")
        await here.until("job", "36 parameters are in")
        assert (tmp_path / "all.params").read_text().count("MPC_XY_VEL_MAX\t8") == 1


@pytest.mark.parametrize(("title", "saved"), [("Parameters", "all.params"), ("Plans", "all.plan")])
async def test_a_file_that_is_there_already_is_replaced_only_after_a_question(
    title: str, saved: str, tmp_path: Path
) -> None:
    file = tmp_path / saved
    file.write_text("# of another vehicle")
    async with services_scene(downloads=tmp_path) as here:
        await here.tab(title)
        await here.press("f")
        await here.until("job", "✓ ")
        for answer in ("n", "y"):
            await here.press("s")
            await enter(here, saved)
            await dialogue(here, YesNoQuestion)
            assert file.read_text() == "# of another vehicle"
            await here.press(answer)
            await here.wait(lambda: not isinstance(here.app.screen, YesNoQuestion))
        await here.wait(lambda: "another vehicle" not in file.read_text())


async def test_clearing_the_plan_leaves_no_mission_no_fence_and_no_rally_points() -> None:
    async with services_scene() as here:
        entry = PlanEntry(items=(MavItem(command=16, frame=3, x=47.0, y=8.0, z=10.0),))
        area = FenceArea(is_inclusion=True, center=(47.0, 8.0), radius_m=50.0)
        plan = ForeignPlan(entries=(entry,), fence=(area,), rally=((47.0, 8.0, 30.0),))
        await here.services.vehicle(NAME).services.plans.upload(plan)
        await here.tab("Plans")
        await here.press("f")
        await here.until("job", "✓ on the vehicle: 1 item, 1 fence area, 1 rally point")
        await here.press("delete")
        await dialogue(here, YesNoQuestion)
        await here.press("y")
        await here.until("job", "✓ mission, fence and rally points are cleared")
        await here.press("f")
        await here.until("job", "✓ on the vehicle: 0 items, 0 fence areas, 0 rally points")


async def test_a_log_is_downloaded_cancelled_and_taken_up_again_while_another_service_is_looked_at(
    tmp_path: Path,
) -> None:
    async with services_scene(logs=Logs(b"0123456789", CONTENT), downloads=tmp_path, conditions=SLOW) as here:
        await here.tab("Logs")
        await here.press("f")
        await here.until("job", "✓ 2 logs")
        await here.press("enter")
        await here.until("job", "downloading log 2 ━")
        await here.tab("Rates")
        await here.until("services", "Logs ")
        await here.tab("Logs")
        await here.press("escape")
        await here.until("job", "✗ downloading log 2: cancelled")
        (part,) = tmp_path.iterdir()
        assert part.suffix == ".part"
        assert CONTENT.startswith(part.read_bytes())
        await here.press("d")
        await here.until("job", "✓ log 2 is in")
        (log,) = tmp_path.iterdir()
        assert log.stem == f"{NAME}_log_002_2023-11-14_22-13-20"
        assert log.read_bytes() == CONTENT
        await here.press("delete")
        await dialogue(here, YesNoQuestion)
        await here.press("n")
        await here.wait(lambda: not isinstance(here.app.screen, YesNoQuestion))
        assert not here.services.vehicle(NAME).jobs.running, "logs are erased only after a question"


async def test_files_are_walked_downloaded_and_removed_after_a_question(tmp_path: Path) -> None:
    folder, downloads = tmp_path / "vehicle", tmp_path / "here"
    (folder / "log").mkdir(parents=True)
    downloads.mkdir()
    (folder / "log" / "a.ulg").write_bytes(CONTENT)
    (downloads / "mine.txt").write_text("mine")
    async with services_scene(folder=folder, downloads=downloads) as here:
        await here.tab("Files")
        await here.press("f")
        await here.until("files_list", "log/")
        await here.press("enter")
        await here.until("files_list", "a.ulg")
        await here.press("down", "enter")
        await here.until("job", "✓ /log/a.ulg is in")
        assert (downloads / "a.ulg").read_bytes() == CONTENT
        await here.press("u")
        await enter(here, "mine.txt")
        await here.until("job", "✓ /log/mine.txt is on the vehicle, checked")
        await here.press("delete")
        await dialogue(here, YesNoQuestion)
        await here.press("y")
        await here.until("job", "✓ /log/a.ulg is removed")
        await here.press("backspace")
        await here.until("files_list", "log/")
        await here.press("u")
        await enter(here, "none.txt")
        await here.until("job", "cannot be read: No such file")


async def test_rates_calibration_and_what_is_refused_are_told_in_words() -> None:
    async with services_scene() as here:
        here.vehicle.answer = lambda request: CommandResult.DENIED if request.command == 241 else None
        await here.tab("Calibration")
        await here.press("enter")
        await here.until("job", "✗ gyro: failed")
        await here.tab("Rates")
        await here.until("rates_list", "HEARTBEAT")
        await here.press("n")
        await enter(here, "VFR_HUD")
        await enter(here, "5")
        await here.until("job", "✓ VFR_HUD: requested, 5 Hz")
        await here.press("n")
        await enter(here, "NONSENSE")
        await enter(here, "")
        await here.until("job", "✗")
        await here.tab("Logs")
        here.memory.set_conditions(Conditions(loss=1.0))
        await here.press("f")
        await here.until("job", "listing the logs")
        await here.press("f")
        await here.press("escape")
        await here.until("job", "✗ listing the logs: cancelled")


async def test_a_shell_that_is_refused_leaves_no_line_that_takes_the_keys() -> None:
    async with services_scene(autopilot=ARDUPILOT) as here:
        await here.tab("Console")
        await here.press("o")
        await here.until("job", "✗ ")
        await here.wait(lambda: not here.app.screen.query_one("#console_line").display)
        await here.press("1")
        await here.until("facts", "control")


async def test_without_a_link_to_the_autopilot_the_screen_says_so_and_the_palette_knows_its_keys() -> None:
    async with scene(None) as here:
        await here.go("6")
        assert "no vehicle is heard yet" in here.shown("unreachable")
        here.platform.speak()
        await here.until("unreachable", "this station has no link to heron")
        assert here.app.base is not None
        titles = [command.title for command in here.app.base.commands()]
        assert {"Parameters: Fetch", "Parameters: Load", "Parameters: Describe"} <= set(titles)


async def test_screens_that_a_vehicle_without_a_companion_cannot_fill_say_so_and_ask_nothing() -> None:
    async with services_scene() as here:
        for digit, panel, text in (
            ("2", "components", "no GLOC3 companion"),
            ("7", "topics", "its"),
            ("8", "checks", "doctor"),
        ):
            await here.go(digit)
            await here.until(panel, text)
        await here.go("1")
        await here.until("mission", "Its autopilot's plan: Services (6).")
        assert here.station.monitor.watches.lists_due() == []
        assert here.platform.requests == []
