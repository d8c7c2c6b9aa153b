"""An operator changes a parameter of the simulated vehicle, which has no companion, over UDP: the whole way by keys."""

import asyncio
import re
import subprocess
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from tests.groundstation.scripted_platform import ScriptedPlatform
from tests.groundstation.station_scene import Scene
from textual.widgets import Input

from gloc3.mavlink.codec import message
from gloc3_groundstation.assembly import GroundStation, StationSetup
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.tui.app import StationApp
from gloc3_groundstation.tui.widgets.entry import TextEntry

pytestmark = [pytest.mark.sockets, pytest.mark.flight]

PROGRAM = "import sys; from gloc3_sitl.cli.sitl import app; sys.exit(app(sys.argv[1:], result_action='return_value'))"
VEHICLES = {"px4": ("px4-1", "NAV_DLL_ACT", "PX4"), "ardupilot": ("ardupilot-1", "FS_GCS_ENABLE", "ArduPilot")}


@asynccontextmanager
async def terminal(style: str, folder: Path, *options: str) -> AsyncIterator[Scene]:
    """The station's terminal and the simulated vehicle, as `gloc3 station` and `gloc3 sitl` bring them up."""
    process = subprocess.Popen(
        [
            *(sys.executable, "-c", PROGRAM, "--world", "open", "--home", "47.3977,8.5456,488.0,0"),
            *("--autopilot", style, "--link", "station=udpin://127.0.0.1:0", *options),
        ],
        stderr=subprocess.PIPE,
        text=True,
    )
    ground = GroundStation(StationSetup(boot=11, downloads=folder))
    station, exchange = ground.station, ground.exchange
    try:
        assert process.stderr is not None
        port = next(int(found[1]) for line in process.stderr if (found := re.search(r"port (\d+)", line)))
        await ground.open([f"udpout://127.0.0.1:{port}"])
        app = StationApp(Desk(station, services=ground.services))
        async with app.run_test(size=(100, 30)) as pilot:
            yield Patient(app, pilot, ScriptedPlatform(exchange), station, exchange)
    finally:
        await ground.close()
        process.terminate()
        process.communicate(timeout=60)


class Patient(Scene):
    """A scene that waits in wall time for a vehicle."""

    async def wait(self, is_so: object) -> None:
        try:
            async with asyncio.timeout(60.0):
                while not is_so():  # type: ignore[operator]
                    await self.pilot.pause(0.05)
        except TimeoutError:
            raise AssertionError("it never came to that") from None


@pytest.mark.parametrize("style", sorted(VEHICLES))
async def test_a_parameter_of_a_vehicle_without_a_companion_is_changed_by_keys(style: str, tmp_path: Path) -> None:
    name, parameter, firmware = VEHICLES[style]
    async with terminal(style, tmp_path) as here:
        await here.until("title", name)
        await here.until("title", "autopilot only")
        await here.until("facts", "autopilot only: ctrl+p")
        await here.until("title", "bat 100 %")
        await here.go("6")
        await here.until("services", f"{firmware} ")
        await here.press("f")
        await here.until("job", " parameters")
        await here.press("slash")
        await here.types(parameter.lower())
        await here.wait(lambda: here.shown("parameters_list").count("\n") == 0)
        await here.enter()
        await here.press("e")
        await here.wait(lambda: isinstance(here.app.screen, TextEntry) and isinstance(here.app.focused, Input))
        here.app.screen.query_one(Input).value = "2"
        await here.press("enter")
        await here.until("job", f"✓ {parameter} is 2 now")
        await here.press("e")
        await here.wait(lambda: isinstance(here.app.screen, TextEntry) and isinstance(here.app.focused, Input))
        here.app.screen.query_one(Input).value = "77"
        await here.press("enter")
        await here.until("job", f"✗ {parameter} was not set")
        await here.press("s")
        await here.wait(lambda: isinstance(here.app.screen, TextEntry) and isinstance(here.app.focused, Input))
        await here.press("enter")
        await here.until("job", "parameters are in")
        (saved,) = tmp_path.iterdir()
        assert re.search(rf"{parameter}\s+2", saved.read_text())
        await here.press("tab", "f")
        await here.until("job", "✓ on the vehicle: 0 items")
        await here.press("tab", "tab", "f")
        await here.until("job", "file")


async def test_commands_are_typed_into_the_shell_of_px4_by_keys(tmp_path: Path) -> None:
    async with terminal("px4", tmp_path) as here:
        await here.until("title", "px4-1")
        await here.go("6")
        await here.press("shift+tab", "shift+tab")
        await here.until("console_list", "o opens PX4's shell")
        await here.press("o")
        await here.until("job", "✓ the shell answers")
        await here.types("ver all")
        await here.press("enter")
        await here.until("console_list", "HW arch: GLOC3_SITL")
        await here.until("job", "✓ shell: ver all")
        await here.types("nonsense")
        await here.press("enter")
        await here.until("console_list", "nsh: nonsense: command not found")
        await here.until("job", "✓ shell: nonsense")
        await here.press("up", "up")
        line = here.app.screen.query_one("#console_line", Input)
        await here.wait(lambda: line.value == "ver all")
        await here.press("down", "down")
        await here.wait(lambda: line.value == "")
        await here.press("escape")
        await here.wait(lambda: not line.display)
        assert any(event.text == "shell: ver all" for event in here.station.fleet.events)


async def test_a_motor_is_tested_by_keys_after_a_typed_confirmation(tmp_path: Path) -> None:
    async with terminal("px4", tmp_path) as here:
        await here.until("title", "px4-1")
        await here.go("6")
        await here.until("services", "PX4")
        await here.press("shift+tab")
        await here.until("motors_list", "motor 4")
        await here.press("t")
        await here.wait(lambda: isinstance(here.app.screen, TextEntry) and isinstance(here.app.focused, Input))
        here.app.screen.query_one(Input).value = "yes"
        await here.press("enter")
        await here.pilot.pause(0.3)
        assert isinstance(here.app.screen, TextEntry), "yes is no confirmation"
        here.app.screen.query_one(Input).value = "Props off"
        await here.press("enter")
        await here.until("job", "motor 1 turns with 10 %")
        await here.until("job", "✓ motor 1 was tested: 10 %, 2 s")
        await here.press("down", "t")
        await here.until("job", "motor 2 turns")
        await here.press("s")
        await here.until("job", "✗ testing motor 2: cancelled")
        await here.until("motors_list", "stopped")


async def test_a_transmitter_and_escs_are_calibrated_by_keys(tmp_path: Path) -> None:
    async with terminal("ardupilot", tmp_path) as here:
        await here.until("title", "ardupilot-1")
        await here.go("6")
        await here.until("services", "ArduPilot")
        await here.press("tab", "tab", "tab", "tab")
        await here.until("calibration_list", "move the sticks of the transmitter")
        await here.press("down", "down", "down", "down", "b")
        await here.until("job", "✗ radio: failed, no receiver is heard")
        services = here.app.desk.services.vehicle("ardupilot-1").services
        pulses = dict.fromkeys((1, 2, 3, 4), 1100)

        async def transmit() -> None:
            while True:
                fields = {f"chan{number}_raw": pulse for number, pulse in pulses.items()}
                services.send(message("RC_CHANNELS_OVERRIDE", target_system=1, target_component=1, **fields))
                await asyncio.sleep(0.05)

        transmitter = asyncio.ensure_future(transmit())
        await here.press("b")
        await here.until("calibration_detail", "move all sticks, knobs and switches to their ends")
        await here.until("calibration_detail", r"1100    – 1100 µs, now 1100")
        await here.press("y")
        await here.until("calibration_detail", "roll (channel 1) has moved by 0 µs only")
        pulses.update(dict.fromkeys(pulses, 1900))
        await here.until("calibration_detail", "1100    – 1900 µs, now 1900")
        pulses.update(dict.fromkeys(pulses, 1500) | {3: 1100})
        await here.until("calibration_detail", "now 1500")
        await here.press("y")
        await here.until("calibration_detail", "centre the sticks, the throttle down")
        await here.press("y")
        await here.until("calibration_detail", "confirm to write 12 parameters")
        await here.until("calibration_detail", "4 yaw")
        await here.press("y")
        await here.until("job", "✓ radio: calibrated; 12 parameters written and read back")
        transmitter.cancel()
        await here.press("down", "b")
        await here.wait(lambda: isinstance(here.app.screen, TextEntry) and isinstance(here.app.focused, Input))
        here.app.screen.query_one(Input).value = "props off"
        await here.press("enter")
        await here.until("calibration_detail", "Connect the battery: the motors get full throttle")
        await here.press("escape")
        await here.until("calibration_detail", "ESC_CALIBRATION is 0 again")
