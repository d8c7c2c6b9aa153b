"""The mapping dialogue by keys and real event bytes: it asks, shows what moves, keeps the mapping, and resets it."""

import asyncio
import os
import struct
from pathlib import Path

import pytest
from tests.groundstation.station_scene import Scene, scene

from gloc3_groundstation.joysticks.detection import REST_S
from gloc3_groundstation.joysticks.linux_reader import FULL
from gloc3_groundstation.joysticks.mapping import JoystickButton, StickAxis
from gloc3_groundstation.store.configuration import Configuration
from gloc3_groundstation.tui.dialogues.map_joystick import MapJoystickDialogue
from gloc3_groundstation.tui.dialogues.teleoperate import TeleoperateDialogue
from gloc3_groundstation.tui.widgets.lines import text_of
from gloc3_groundstation.tui.widgets.panel import Panel

pytestmark = pytest.mark.thorough


def shown(here: Scene) -> str:
    panels = here.app.screen.query("#joystick").results(Panel)
    return "\n".join(text_of(line) for panel in panels for line in panel.lines)


async def shows(here: Scene, text: str) -> None:
    try:
        await here.wait(lambda: text in shown(here).replace("\n", " "))
    except AssertionError:
        raise AssertionError(f"never {text!r}:\n{shown(here)}") from None


async def test_a_joystick_is_mapped_by_what_is_asked_for_kept_at_once_and_reset(tmp_path: Path) -> None:
    fifo = tmp_path / "js0"
    os.mkfifo(fifo)
    kept: list[Configuration] = []
    async with scene(configuration=Configuration(gamepad=str(fifo))) as here:

        def keep() -> bool:
            kept.append(here.app.configuration())
            return True

        here.app.desk.keep = keep
        here.platform.speak()
        await here.go("5")
        await here.wait(lambda: here.app.platform is not None)
        here.app.show_fleet()
        await here.press("t")
        await here.shows(TeleoperateDialogue)
        await here.press("j")
        await here.shows(MapJoystickDialogue)
        await shows(here, "default mapping")
        pad = os.open(fifo, os.O_WRONLY)

        def event(kind: int, number: int, value: float) -> None:
            os.write(pad, struct.pack("<IhBB", 0, round(value), kind, number))

        async def push(axis: int, position: float) -> None:
            event(2, axis, FULL * position)
            await here.pilot.pause(0.05)
            event(2, axis, 0)

        for axis in range(3):
            event(2, axis, 0)
        await shows(here, "axis 2")
        await here.press("n")
        await shows(here, "1/18  let go of everything")
        await asyncio.sleep(REST_S)
        await shows(here, "FORWARD")
        event(2, 2, FULL * 0.7)
        await shows(here, "+0.70")
        event(2, 2, 0)
        await shows(here, "the other way: BACK")
        await push(1, 1.0)
        await shows(here, "that is another stick")
        await push(2, -1.0)
        await shows(here, "RIGHT")
        for _ in range(3):
            await here.press("enter")
        await shows(here, "DEAD-MAN'S KEY")
        event(1, 9, 1)
        await shows(here, "pressed  9")
        event(1, 9, 0)
        await shows(here, "for HOLD")
        for _ in range(8):
            await here.press("enter")
        await shows(here, "done: try it")
        assert not kept
        event(2, 2, FULL * 0.7)
        await shows(here, "+100% surge")
        await here.press("enter")
        await shows(here, "the mapping is kept")
        (mapping,) = kept[-1].joysticks.values()
        assert mapping.buttons == {JoystickButton.DEAD_MAN: ("button 9",)}
        surge = mapping.axes[StickAxis.SURGE]
        assert (surge.axis, surge.low, surge.centre) == (2, -1.0, 0.0)
        assert surge.high == pytest.approx(0.7, abs=0.001)
        await here.press("r")
        await shows(here, "reset to the default mapping")
        assert kept[-1].joysticks == {}
        os.close(pad)
        await shows(here, "it is disconnected")
        await here.press("escape")
        await here.shows(TeleoperateDialogue)
