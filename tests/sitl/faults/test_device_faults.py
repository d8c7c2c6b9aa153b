"""Faults of cameras and scanners: what becomes of their data, in a fault's text and in the devices."""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

import numpy as np
import pytest

from gloc3.clock import run_virtual
from gloc3.errors import Refused
from gloc3.messages.frames import IDENTITY, GeoPoint, TangentPlane, Vector3
from gloc3.messages.perception import ImuSample, LaserScan
from gloc3.messages.vehicle import Image
from gloc3_sitl.faults.device_faults import (
    CAMERA,
    LASER,
    DeviceFault,
    FaultyFrame,
    FaultyScan,
    PairExposure,
    corrupted,
    seen_from,
)
from gloc3_sitl.faults.faults import read_fault, schedule_faults
from gloc3_sitl.flight.flight import Flight
from gloc3_sitl.flight.plan import FlightPlan
from gloc3_sitl.flight.sim_devices import SimCamera, SimLaser, SimStereoCamera
from gloc3_sitl.flight.sim_imu import SimImu
from gloc3_sitl.physics.truth import Truth

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
    return corrupted(FaultyFrame(1.0, IMAGE), DeviceFault(word)).image


def ranges(word: str, size: float | None = None) -> Any:
    return np.frombuffer(corrupted(FaultyScan(1.0, SCAN), DeviceFault(word, size)).scan.ranges_m, "<f4")


def test_pictures_become_black_white_torn_small_or_garbage() -> None:
    assert set(picture("black").data) == {0}
    assert set(picture("white").data) == {255}
    assert len(picture("torn").data) == 32 < 48
    small = picture("small")
    assert (small.width, small.height, len(small.data)) == (4, 3, 12)
    assert picture("garbage").data not in (PIXELS, b"")
    assert picture("garbage") == picture("garbage"), "the same at the same time"
    assert picture("garbage") != corrupted(FaultyFrame(1.1, IMAGE), DeviceFault("garbage")).image


def test_both_sides_of_a_pair_are_spoilt_and_what_is_well_stays() -> None:
    pair = PairExposure(1.0, IMAGE, IMAGE)
    black = corrupted(pair, DeviceFault("black"))
    assert set(black.left.data) == set(black.right.data) == {0}
    assert corrupted(pair, None) is pair
    assert corrupted(pair, DeviceFault("late")) is pair


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
        ("device:laser=black", "'black' is not a fault of laser"),
        ("device:ground_camera=nan", "'nan' is not a fault of ground_camera"),
        ("device:ground_camera=dark", "'dark' is not a fault of ground_camera"),
        ("device:lazer=lost", "did you mean 'laser'"),
        ("device:laser=broken", "'broken' is unknown"),
        ("device:laser=lost/3", "/3 is not expected"),
        ("device:laser=late/-1", "negative"),
        ("device:imu=black", "'black' is not a fault of imu"),
        ("sensor:fix=scaled", "only the height and the wheel encoders can be scaled"),
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


def test_what_is_scaled_or_makes_a_step_looks_from_elsewhere() -> None:
    begin, now = level_truth((0.0, 0.0, 0.0)), level_truth((4.0, 2.0, -1.0))
    plane = TangentPlane(GeoPoint(begin.latitude_deg, begin.longitude_deg, begin.altitude_m))

    def seen(word: str, size: float | None = None) -> Vector3:
        truth = seen_from(now, DeviceFault(word, size), begin)
        return plane.ned_from_geo(truth.latitude_deg, truth.longitude_deg, truth.altitude_m)

    assert seen("scaled") == pytest.approx((4.2, 2.1, -1.05), abs=1e-4)
    assert seen("scaled", -0.5) == pytest.approx((2.0, 1.0, -0.5), abs=1e-4)
    assert seen("step", 0.3) == pytest.approx((4.3, 2.0, -1.0), abs=1e-4)
    assert seen_from(now, DeviceFault("lost"), begin) is now


def level_truth(position_ned_m: Vector3) -> Truth:
    """At rest over the sea."""
    geo = TangentPlane(GeoPoint(39.5, 2.6, 0.0)).geo_from_ned(position_ned_m)
    return Truth(
        t_s=1.0,
        position_ned_m=position_ned_m,
        velocity_ned_m_s=(0.0, 0.0, 0.0),
        attitude_wxyz=IDENTITY,
        rate_frd_rad_s=(0.0, 0.0, 0.0),
        specific_force_frd_m_s2=(0.0, 0.0, -9.8),
        latitude_deg=geo[0],
        longitude_deg=geo[1],
        altitude_m=geo[2],
        height_above_ground_m=0.0,
        standing_height_m=0.1,
        is_on_ground=False,
        power_w=0.0,
        wind_ned_m_s=(0.0, 0.0, 0.0),
    )


class Unit:
    """An inertial unit that feels how late it is."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop

    def open(self) -> None: ...
    def close(self) -> None: ...

    def on_new_data(self, ready: Callable[[], None]) -> Callable[[], None]:
        return ready

    def samples(self, after_s: float) -> list[tuple[float, ImuSample]]:
        times = [index / 100.0 for index in range(round(self._loop.time() * 100.0) + 1)]
        return [
            (t_s, ImuSample(rate_frd_rad_s=(t_s, 0.0, 0.0), specific_force_frd_m_s2=(0.0, 0.0, -10.0)))
            for t_s in times
            if t_s > after_s
        ]


def test_the_inertial_unit_fails_on_its_way_to_the_onboard_process() -> None:
    async def measured(word: str) -> tuple[float, ImuSample] | None:
        loop = asyncio.get_running_loop()
        imu = SimImu(loop, 1)
        imu.wire(Unit(loop))
        await asyncio.sleep(1.0)
        begin_s = round(loop.time(), 2)
        assert imu.samples(-1.0)[-1].t_s == pytest.approx(begin_s)
        imu.fault = DeviceFault(word)
        await asyncio.sleep(1.0)
        found = imu.samples(begin_s + 0.5)
        return (found[-1].t_s - begin_s, found[-1].sample) if found else None

    def rate(word: str) -> tuple[float, float]:
        found = run_virtual(measured(word))
        assert found is not None
        return round(found[0], 2), found[1].rate_frd_rad_s[0]

    assert run_virtual(measured("lost")) is None
    assert rate("stuck") == pytest.approx((1.0, 1.0))
    assert rate("late") == pytest.approx((0.8, 1.8))
    assert rate("old") == pytest.approx((1.0, 1.8))
    assert rate("scaled") == pytest.approx((1.0, 2.1))
    assert rate("step") == pytest.approx((1.0, 2.02))
    assert rate("garbage")[1] != pytest.approx(2.0, abs=1e-3)


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

        async def scan_after(seconds: float) -> FaultyScan:
            await asyncio.sleep(seconds)
            turn = laser.scan()
            assert turn is not None
            return turn

        schedule_faults(
            flight,
            (
                "device:laser=lost@1..2",
                "device:laser=late/0.25@3..4",
                "device:laser=old/0.5@5..6",
                "device:stereo_camera=stuck@1..2",
            ),
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
        assert (await scan_after(1.0)).t_s == pytest.approx(5.4, abs=0.03), "old, with a new time"

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
