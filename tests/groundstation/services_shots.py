"""Pictures of the services screen in every size, to be looked at: `python -m tests.groundstation.services_shots OUT`."""

import asyncio
import sys
import tempfile
from pathlib import Path

from gloc3.link.memory import Conditions
from gloc3.mission.formats import write_plan

from .services.scripted_vehicle import Logs
from .services.test_services_with_sitl import PLAN
from .services_scene import INFOS, NAME, ServicesScene, services_scene
from .station_scene import shoot
from .station_shots import SIZES

CONDITIONS = Conditions(latency_s=0.005, bandwidth_bit_s=2e6)
NEW = "MPC_XY_VEL_MAX 8\nNAV_DLL_ACT 2\nRTL_RETURN_ALT 2000\nOLD_ONE 1\nMPC_Z_VEL_MAX_UP 3\n"


async def shots(out: Path, size: tuple[int, int], here: ServicesScene, folder: Path) -> None:
    """Each service with something in it."""

    async def shot(name: str) -> None:
        for _ in range(2):
            here.app.look()
            await here.pilot.pause(0.1)
        shoot(here.app, out / f"{size[0]}x{size[1]}_services_{name}")

    desk = here.services.vehicle(NAME)
    await shot("empty")
    await here.press("f")
    await here.until("job", "36 parameters")
    desk.parameters.describe(folder / "infos.json")
    await here.until("job", "are described")
    await here.press("slash")
    await here.type("max")
    await here.press("enter")
    await shot("search")
    await here.press("e")
    await here.pilot.pause(0.1)
    await here.press("2", "5", "enter")
    await shot("edit")
    await here.press("escape")
    desk.parameters.set("MPC_XY_VEL_MAX", 8.5)
    await here.until("job", "is 8.5")
    await here.press("escape")
    await shot("changed")
    desk.parameters.compare(folder / "new.parm")
    await here.until("job", "different")
    await shot("compare")
    await here.press("escape")
    await here.tab("Plans")
    desk.plans.open(folder / "round.plan")
    await here.until("job", "round.plan")
    await shot("plans")
    await here.tab("Logs")
    await here.press("f")
    await here.until("job", "2 logs")
    await here.press("enter")
    await here.until("job", " 1")
    await shot("logs")
    await here.tab("Files")
    await here.press("f")
    await here.until("job", "1 folder")
    await shot("files")
    await here.tab("Calibration")
    await here.press("enter")
    await here.until("job", "gyro")
    await shot("calibration")
    await here.tab("Rates")
    await shot("rates")
    await here.press("question_mark")
    await shot("help")


async def main(out: Path) -> None:
    """All sizes."""
    out.mkdir(parents=True, exist_ok=True)
    for size in SIZES:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            (folder / "vehicle" / "log").mkdir(parents=True)
            (folder / "vehicle" / "params").write_bytes(bytes(2000))
            (folder / "infos.json").write_text(INFOS)
            (folder / "new.parm").write_text(NEW)
            (folder / "round.plan").write_text(write_plan(PLAN))
            logs = Logs(bytes(400), bytes(600_000))
            async with services_scene(
                size, logs=logs, folder=folder / "vehicle", downloads=folder, conditions=CONDITIONS
            ) as here:
                await shots(out, size, here, folder)


if __name__ == "__main__":
    asyncio.run(main(Path(sys.argv[1])))
