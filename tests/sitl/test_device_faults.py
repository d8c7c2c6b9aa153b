"""Faults of cameras and scanners: what becomes of their data, in a fault's text and in the devices."""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

import numpy as np
import pytest

from gloc3.clock import run_virtual
from gloc3.errors import Refused
from gloc3.perception import LaserScan
from gloc3.vehicle import Image
from gloc3_sitl.device_faults import CAMERA, LASER, DeviceFault, Exposure, PairExposure, Turn, spoilt
from gloc3_sitl.faults import read_fault, schedule_faults
from gloc3_sitl.flight import Flight, FlightPlan
from gloc3_sitl.sim_devices import SimCamera, SimLaser, SimStereoCamera

PIXELS = np.arange(48, dtype=np.uint8).tobytes()
IMAGE = Image(camera="front_left", width=8, height=6, data=PIXELS)
RANGES = np.linspace(1.0, 20.0, 40).astype("<f4")
SCAN = LaserScan(
    scanner="laser",
    angle_min_rad=-1.0,
    angle_step_rad=0.05,
    range_min_m=0.1,
    range_max_m=20.0,
    ranges_m=RANGES.tobytes(),
)


def picture(word: str) -> Image:
    return spoilt(Exposure(1.0, IMAGE), DeviceFault(word)).image


def ranges(word: str, size: float | None = None) -> Any:
    return np.frombuffer(spoilt(Turn(1.0, SCAN), DeviceFault(word, size)).scan.ranges_m, "<f4")


def test_pictures_become_black_white_torn_small_or_garbage() -> None:
    assert set(picture("black").data) == {0}
    assert set(picture("white").data) == {255}
    assert len(picture("torn").data) == 32 < 48
    small = picture("small")
    assert (small.width, small.height, len(small.data)) == (4, 3, 12)
    assert picture("garbage").data not in (PIXELS, b"")
    assert picture("garbage") == picture("garbage"), "the same at the same time"
    assert picture("garbage") != spoilt(Exposure(1.1, IMAGE), DeviceFault("garbage")).image


def test_both_sides_of_a_pair_are_spoilt_and_what_is_well_stays() -> None:
    pair = PairExposure(1.0, IMAGE, IMAGE)
    black = spoilt(pair, DeviceFault("black"))
    assert set(black.left.data) == set(black.right.data) == {0}
    assert spoilt(pair, None) is pair
    assert spoilt(pair, DeviceFault("late")) is pair


def test_ranges_become_nothing_the_greatest_no_number_too_long_or_garbage() -> None:
    assert not ranges("zero").any()
    assert (ranges("far") == np.float32(20.0)).all()
    assert np.isnan(ranges("nan")).all()
    assert ranges("scaled")[:30] == pytest.approx(1.05 * RANGES[:30])
    assert ranges("scaled", 0.2)[-1] == np.float32(20.0)
    garbage = ranges("garbage")
    assert 0.0 <= garbage.min() < garbage.max() <= 20.0
    assert abs(np.corrcoef(garbage, RANGES)[0, 1]) < 0.5


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("device:laser=black", "'black' is none of laser's"),
        ("device:ground_camera=nan", "'nan' is none of ground_camera's"),
        ("device:ground_camera=dark", "'dark' is none of ground_camera's"),
        ("device:lazer=lost", "did you mean 'laser'"),
        ("device:laser=broken", "'broken' is unknown"),
        ("device:laser=lost/3", "/3 is not expected"),
        ("device:laser=late/-1", "negative"),
    ],
)
def test_what_does_not_fit_a_device_is_refused(text: str, says: str) -> None:
    async def main() -> None:
        with pytest.raises(Refused, match=says):
            schedule_faults(Flight(FlightPlan(mission="hop")), (text,))

    run_virtual(main())


def test_every_word_of_a_device_can_be_written() -> None:
    for word in (*CAMERA, "dark", "twin"):
        assert read_fault(f"device:tracker_camera={word}@3..5").given.word == word
    for word in LASER:
        assert read_fault(f"device:laser={word}").given.target == "laser"
    assert read_fault("device:laser=late/0.3").given.size == 0.3


def fly(test: Callable[[Flight], Coroutine[Any, Any, None]]) -> None:
    """A simulator with its devices, before anything takes off."""

    async def main() -> None:
        flight = Flight(FlightPlan(mission="hop"))
        flight.simulator.start(flight.loop)
        await test(flight)
        flight.simulator.stop()

    run_virtual(main())


@pytest.mark.thorough
def test_devices_fall_silent_get_stuck_come_late_and_recover() -> None:
    async def test(flight: Flight) -> None:
        laser, stereo = flight.rig.devices["laser"], flight.rig.devices["stereo_camera"]
        assert isinstance(laser, SimLaser)
        assert isinstance(stereo, SimStereoCamera)
        laser.open()
        stereo.open()

        async def scan_after(seconds: float) -> Turn:
            await asyncio.sleep(seconds)
            turn = laser.scan()
            assert turn is not None
            return turn

        schedule_faults(
            flight, ("device:laser=lost@1..2", "device:laser=late/0.25@3..4", "device:stereo_camera=stuck@1..2")
        )
        assert (await scan_after(0.95)).t_s == pytest.approx(0.9, abs=0.03)
        before = stereo.pair()
        assert (await scan_after(1.0)).t_s == pytest.approx(0.9, abs=0.03), "nothing new came"
        stuck = stereo.pair()
        assert before is not None
        assert stuck is not None
        assert stuck.left.data == before.left.data
        assert stuck.t_s > before.t_s + 0.9, "with a new time"
        assert (await scan_after(0.5)).t_s == pytest.approx(2.4, abs=0.03)
        well = stereo.pair()
        assert well is not None
        assert well.left.data != stuck.left.data
        assert (await scan_after(1.0)).t_s == pytest.approx(3.45 - 0.25 - 0.05, abs=0.08)
        assert (await scan_after(1.0)).t_s == pytest.approx(4.4, abs=0.03)

    fly(test)


@pytest.mark.thorough
def test_the_light_goes_off_and_another_one_comes() -> None:
    async def test(flight: Flight) -> None:
        device = flight.rig.devices["tracker_camera"]
        assert isinstance(device, SimCamera)
        device.open()
        schedule_faults(flight, ("device:tracker_camera=dark@1..2", "device:tracker_camera=twin@3..4"))
        counts: list[int] = []
        for _ in range(5):
            await asyncio.sleep(0.9 if not counts else 1.0)
            frame = device.frame()
            assert frame is not None
            pixels = np.frombuffer(frame.image.data, np.uint8).reshape(480, 640) > 200
            import cv2

            counts.append(cv2.connectedComponents(pixels.astype(np.uint8))[0] - 1)
        assert counts == [1, 0, 1, 2, 1]

    fly(test)
