"""An operator flies a simulated multirotor without a companion by joystick, over UDP, and pulls the plug."""

import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from tests.groundstation.station_scene import Scene

from gloc3_groundstation.joysticks.linux_reader import FULL
from gloc3_groundstation.services.actions import Action
from gloc3_groundstation.tui.dialogues.fly_by_sticks import FlyBySticksDialogue
from gloc3_groundstation.tui.widgets.lines import text_of
from gloc3_groundstation.tui.widgets.panel import Panel

from .test_bare_vehicle_journey import has_begun, seen
from .test_services_journey import terminal

pytestmark = [pytest.mark.sockets, pytest.mark.flight]

SURGE, KEY = 4, 4
"""Numbers of an Xbox pad."""


class Pad:
    """A joystick on Linux's interface: a FIFO."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: int | None = None
        os.mkfifo(path)

    def plug(self) -> None:
        self._file = os.open(self._path, os.O_WRONLY)
        self.axis(0, 0.0)

    def unplug(self) -> None:
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def axis(self, number: int, position: float) -> None:
        self._write(round(FULL * position), 2, number)

    def button(self, number: int, *, is_pressed: bool) -> None:
        self._write(int(is_pressed), 1, number)

    def _write(self, value: int, kind: int, number: int) -> None:
        assert self._file is not None
        os.write(self._file, struct.pack("<IhBB", 0, value, kind, number))


@contextmanager
def pad_for(here: Scene, folder: Path) -> Iterator[Pad]:
    pad = Pad(folder / "js0")
    here.app.desk.gamepad = str(folder / "js0")
    try:
        yield pad
    finally:
        pad.unplug()


def helm(here: Scene) -> str:
    panels = here.app.screen.query("#helm").results(Panel)
    return "\n".join(text_of(line) for panel in panels for line in panel.lines)


async def shows(here: Scene, text: str) -> None:
    try:
        await here.wait(lambda: text in helm(here))
    except AssertionError:
        raise AssertionError(f"never {text!r}:\n{helm(here)}") from None


async def armed(here: Scene, name: str, action: Action, typed: str = "") -> None:
    for _ in range(60):
        if await here.app.desk.autopilots.act(name, action, typed):
            return
        await here.pilot.pause(1.0)
    raise AssertionError(f"{action} was never accepted")


async def open_dialogue(here: Scene) -> None:
    await here.go("5")
    await here.press("t")
    await here.shows(FlyBySticksDialogue)


async def test_a_multirotor_is_flown_by_a_joystick_and_stops_when_its_key_is_released(tmp_path: Path) -> None:
    async with terminal("px4", tmp_path, "--param", "COM_RC_LOSS_T=3") as here:
        name = "px4-1"
        await here.until("title", name)
        await here.wait(lambda: has_begun(here, name))
        await armed(here, name, Action.TAKE_OFF, "4")
        await here.wait(lambda: seen(here, name).position_m[2] > 3.0)
        with pad_for(here, tmp_path) as pad:
            await open_dialogue(here)
            await shows(here, "NOT BEGUN")
            pad.plug()
            pad.axis(SURGE, -0.6)
            pad.button(KEY, is_pressed=True)
            await here.pilot.pause(1.0)
            assert seen(here, name).speed_m_s < 0.5, "nothing moves before it has begun"
            pad.button(KEY, is_pressed=False)
            await here.press("enter")
            await shows(here, "AT REST  Position")
            await shows(here, "NAV_RCL_ACT is 2")
            assert seen(here, name).speed_m_s < 0.5, "nor without the key"
            pad.button(KEY, is_pressed=True)
            await shows(here, "LIVE  Position")
            await here.wait(lambda: seen(here, name).speed_m_s > 1.5)
            pad.button(KEY, is_pressed=False)
            await shows(here, "AT REST")
            await here.wait(lambda: seen(here, name).speed_m_s < 0.3)
            assert seen(here, name).mode == "POSCTL"

            pad.button(KEY, is_pressed=True)
            await here.wait(lambda: seen(here, name).speed_m_s > 1.5)
            pad.unplug()
            await shows(here, "it is disconnected")
            await here.wait(lambda: seen(here, name).speed_m_s < 0.3)
            assert seen(here, name).mode == "POSCTL", "centred sticks go on: no failsafe takes it for a lost pilot"

            await here.press("escape")
            await here.wait(lambda: seen(here, name).mode == "AUTO.LOITER")
