"""Readers of joysticks: real event bytes through a FIFO, and SDL's own process with its virtual pad."""

import asyncio
import os
import struct
from collections.abc import Callable
from pathlib import Path

import pytest

from gloc3_groundstation.joysticks.defaults import default_mapping
from gloc3_groundstation.joysticks.device import JoystickDevice, JoystickReading
from gloc3_groundstation.joysticks.linux_reader import FULL, EventState, LinuxReader
from gloc3_groundstation.joysticks.sdl_reader import SdlReader

pytestmark = pytest.mark.thorough

AXIS, BUTTON, INITIAL = 2, 1, 0x80
WITHIN_S = 20.0


def event(kind: int, number: int, value: int) -> bytes:
    return struct.pack("<IhBB", 0, value, kind, number)


class Listener:
    """Keeps what a reader reports."""

    def __init__(self) -> None:
        self.devices: dict[int, JoystickDevice] = {}
        self.readings: list[JoystickReading] = []
        self.said: list[str] = []

    def connected(self, number: int, device: JoystickDevice) -> None:
        self.devices[number] = device

    def disconnected(self, number: int, reason: str) -> None:
        del self.devices[number]
        self.said.append(reason)

    def moved(self, number: int, reading: JoystickReading) -> None:
        assert number in self.devices
        self.readings.append(reading)

    def failed(self, reason: str) -> None:
        self.said.append(reason)

    async def until(self, is_so: Callable[[], bool]) -> None:
        async with asyncio.timeout(WITHIN_S):
            while not is_so():
                await asyncio.sleep(0.01)


def test_events_may_be_cut_anywhere_and_a_button_held_at_the_begin_was_not_pressed() -> None:
    state = EventState()
    data = event(BUTTON | INITIAL, 4, 1) + event(AXIS | INITIAL, 1, -32768) + event(AXIS, 3, FULL) + event(BUTTON, 2, 1)
    for cut in range(0, len(data), 5):
        state.feed(data[cut : cut + 5])
    assert state.reading == JoystickReading((0.0, -1.0, 0.0, 1.0), frozenset({2}))


async def test_linuxs_interface_is_read_repeated_and_opened_again_when_it_is_back(tmp_path: Path) -> None:
    fifo, heard = tmp_path / "js0", Listener()
    reader = LinuxReader(asyncio.get_running_loop(), heard, fifo)
    try:
        assert "No such file" in heard.said[0]
        os.mkfifo(fifo)
        await heard.until(lambda: bool(heard.devices))
        pad = os.open(fifo, os.O_WRONLY)
        os.write(pad, event(AXIS, 1, FULL))
        await heard.until(lambda: len(heard.readings) > 3)
        assert set(heard.readings) == {JoystickReading((0.0, 1.0))}, "a held stick is repeated without events"
        os.close(pad)
        await heard.until(lambda: "it is disconnected" in heard.said)
        await heard.until(lambda: bool(heard.devices))
        (device,) = heard.devices.values()
        assert default_mapping(device) is not None, "a FIFO has no name, and counts as an Xbox pad"
    finally:
        await reader.close()


async def test_sdl_finds_a_pad_reports_it_and_finds_it_again_and_a_process_that_ends_is_begun_again(
    tmp_path: Path,
) -> None:
    pytest.importorskip("sdl2", reason="the extra `joystick` is not installed")
    commands, heard = tmp_path / "commands", Listener()
    commands.touch()

    def obey(line: str) -> None:
        with commands.open("a") as file:
            file.write(f"{line}\n")

    program = ("-W", "ignore", "-m", "tests.groundstation.joysticks.virtual_pad", str(commands))
    reader = SdlReader(asyncio.get_running_loop(), heard, program)
    try:
        await heard.until(lambda: bool(heard.readings))
        ((number, device),) = heard.devices.items()
        assert len(device.key) == 32
        mapping = default_mapping(device)
        assert mapping is not None, "SDL knows it, and so it needs no mapping"
        obey("axis 3 -32768")
        obey("button 9 1")
        await heard.until(lambda: mapping.sticks(heard.readings[-1]).surge == 1.0)
        await heard.until(lambda: "dead_man" in mapping.pressed(heard.readings[-1]))
        before = len(heard.readings)
        await heard.until(lambda: len(heard.readings) > before + 2)  # repeated without a change
        obey("unplug")
        await heard.until(lambda: heard.said == ["it is disconnected"])
        obey("plug")
        await heard.until(lambda: bool(heard.devices) and number not in heard.devices)
        assert heard.devices[max(heard.devices)].key == device.key
        assert reader.process is not None
        reader.process.kill()
        await heard.until(lambda: any(text.startswith("SDL has ended") for text in heard.said))
        assert not heard.devices
        await heard.until(lambda: bool(heard.devices))
    finally:
        await reader.close()


async def test_a_program_that_is_not_sdls_is_told(tmp_path: Path) -> None:
    heard = Listener()
    reader = SdlReader(asyncio.get_running_loop(), heard, ("-c", "print('hello'); input()"))
    try:
        await heard.until(lambda: bool(heard.said))
        assert heard.said == ["SDL has ended: it does not speak as agreed"]
    finally:
        await reader.close()
