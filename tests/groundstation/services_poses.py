"""The vehicle services with something in them, in turn."""

import tempfile
from collections.abc import AsyncGenerator
from contextlib import aclosing
from pathlib import Path

from tests.groundstation.services.scripted_vehicle import Logs
from tests.groundstation.services.test_services_with_sitl import PLAN
from textual.widgets import Input

from gloc3.mavlink.transport.memory import Conditions
from gloc3.mission.formats import write_plan
from gloc3_groundstation.store.configuration import Configuration, ThemeName
from gloc3_groundstation.tui.help import HelpScreen
from gloc3_groundstation.tui.widgets.entry import TextEntry

from .services_scene import INFOS, NAME, ServicesScene, services_scene

CONDITIONS = Conditions(latency_s=0.005, bandwidth_bit_s=2e6)
NEW = "MPC_XY_VEL_MAX 8\nNAV_DLL_ACT 2\nRTL_RETURN_ALT 2000\nOLD_ONE 1\nMPC_Z_VEL_MAX_UP 3\n"


async def services(size: tuple[int, int], theme: ThemeName = "dark") -> AsyncGenerator[tuple[str, ServicesScene], None]:
    """The services screen of a vehicle without a companion."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "vehicle" / "log").mkdir(parents=True)
        (folder / "vehicle" / "params").write_bytes(bytes(2000))
        (folder / "infos.json").write_text(INFOS)
        (folder / "new.parm").write_text(NEW)
        (folder / "round.plan").write_text(write_plan(PLAN))
        async with services_scene(
            size,
            Configuration(theme=theme),
            logs=Logs(bytes(400), bytes(600_000)),
            folder=folder / "vehicle",
            downloads=folder,
            conditions=CONDITIONS,
        ) as here:
            for group in (_parameters, _others):
                async with aclosing(group(here, folder)) as names:
                    async for each in names:
                        yield f"services_{each}", here


async def _parameters(here: ServicesScene, folder: Path) -> AsyncGenerator[str, None]:
    """Fetched, searched, edited, changed, compared with a file."""
    desk = here.services.vehicle(NAME)
    yield "empty"
    await here.press("f")
    await here.until("job", "36 parameters")
    desk.parameters.describe(folder / "infos.json")
    await here.until("job", "are described")
    await here.press("slash")
    await here.wait(lambda: isinstance(here.app.focused, Input))
    await here.types("max")
    await here.wait(lambda: "CAL_ACC" not in here.shown("parameters_list"))
    await here.enter()
    yield "search"
    await here.press("e")
    await here.wait(lambda: isinstance(here.app.screen, TextEntry) and isinstance(here.app.focused, Input))
    here.app.screen.query_one(Input).value = "25"
    await here.press("enter")
    yield "edit"
    await here.press("escape")
    await here.wait(lambda: here.app.screen is here.app.base)
    desk.parameters.set("MPC_XY_VEL_MAX", 8.5)
    await here.until("job", "is 8.5")
    await here.press("escape")
    yield "changed"
    desk.parameters.compare(folder / "new.parm")
    await here.until("job", "different")
    yield "compare"
    await here.press("escape")


async def _others(here: ServicesScene, folder: Path) -> AsyncGenerator[str, None]:
    """Plans, logs, files, calibration, rates, and the help."""
    desk = here.services.vehicle(NAME)
    await here.tab("Plans")
    desk.plans.open(folder / "round.plan")
    await here.until("job", "round.plan")
    yield "plans"
    await here.tab("Logs")
    await here.press("f")
    await here.until("job", "2 logs")
    await here.press("enter")
    await here.until("job", " 1")
    yield "logs"
    await here.tab("Files")
    await here.press("f")
    await here.until("job", "1 folder")
    yield "files"
    await here.tab("Calibration")
    await here.press("enter")
    await here.until("job", "gyro")
    yield "calibration"
    await here.tab("Rates")
    await here.until("rates_list", "HEARTBEAT")
    yield "rates"
    await here.press("question_mark")
    await here.shows(HelpScreen)
    yield "help"
