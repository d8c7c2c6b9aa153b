"""The world's cameras, scanner and probes as devices: their rates, their common exposure, their cost while nobody looks."""

import asyncio
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gloc3.clock import run_virtual
from gloc3.messages.perception import PointCloud
from gloc3_sitl.faults.device_faults import DeviceFault
from gloc3_sitl.flight.sim_devices import NoDevice, SimCamera, SimLaser, SimLidar, SimProbe, SimStereoCamera
from gloc3_sitl.flight.sim_rig import SIM_DEVICES, SimRig
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.vehicles.simulator import Simulator, SimulatorSettings
from gloc3_sitl.world import World, rig
from gloc3_sitl.world.camera import SimulatedCamera
from gloc3_sitl.world.imager import Photo

pytestmark = pytest.mark.thorough


def run(test: Callable[[SimRig, Simulator], Coroutine[Any, Any, None]], world: str = "hold", seed: int = 3) -> None:
    """Runs a test beside a simulator in virtual time."""

    async def main() -> None:
        loop = asyncio.get_running_loop()
        simulator = Simulator(World.load(world), SimulatorSettings(seed=seed))
        simulator.start(loop)
        await test(SimRig(simulator.world, loop, simulator.truth, seed), simulator)
        simulator.stop()

    run_virtual(main())


def test_a_stereo_pair_comes_at_15_hz_from_one_instant() -> None:
    async def test(sims: SimRig, simulator: Simulator) -> None:
        stereo = sims.devices["stereo_camera"]
        assert isinstance(stereo, SimStereoCamera)
        reports: list[float] = []
        unwatch = stereo.on_new_data(lambda: reports.append(asyncio.get_running_loop().time()))
        stereo.open()
        assert stereo.pair() is None
        times = []
        for _ in range(6):
            count = len(reports)
            while len(reports) == count:
                await asyncio.sleep(0.005)
            pair = stereo.pair()
            assert pair is not None
            assert stereo.pair() is pair, "asked again, it does not look again"
            assert (pair.left.camera, pair.right.camera) == ("front_left", "front_right")
            assert len(pair.left.data) == len(pair.right.data) == 640 * 480
            times.append(pair.t_s)
        unwatch()
        stereo.close()
        steps = np.diff(times)
        assert steps.mean() == pytest.approx(1.0 / 15.0, abs=0.005)
        assert reports[1] - reports[0] == pytest.approx(1.0 / 15.0, abs=1e-6)
        assert max(abs(steps - 1.0 / 15.0)) <= 0.02 + 1e-6, "the physics moves on in steps of 20 ms"
        count = len(reports)
        await asyncio.sleep(1.0)
        assert len(reports) == count

    run(test)


def test_all_devices_give_what_they_are_named_for() -> None:
    async def test(sims: SimRig, simulator: Simulator) -> None:
        assert tuple(sims.devices) == SIM_DEVICES
        laser, ground, tracker = (sims.devices[name] for name in ("laser", "ground_camera", "tracker_camera"))
        assert isinstance(laser, SimLaser)
        assert isinstance(ground, SimCamera)
        assert isinstance(tracker, SimCamera)
        reports = {"laser": 0, "ground": 0, "tracker": 0}

        def counter(name: str) -> Callable[[], None]:
            def count() -> None:
                reports[name] += 1

            return count

        for device, name in ((laser, "laser"), (ground, "ground"), (tracker, "tracker")):
            device.on_new_data(counter(name))
            device.open()
        await asyncio.sleep(0.35)
        turn, frame, seen = laser.scan(), ground.frame(), tracker.frame()
        assert turn is not None
        assert frame is not None
        assert seen is not None
        assert turn.t_s == pytest.approx(0.3, abs=0.021)
        assert frame.t_s == pytest.approx(5.0 / 15.0, abs=0.021)
        assert (turn.scan.scanner, frame.image.camera, seen.image.camera) == ("laser", "ground", "tracker")
        assert max(seen.image.data) > 200, "the light of the vehicle"
        assert sims.model("front_left") == rig.FRONT_LEFT
        assert sims.model("nose") is None
        await asyncio.sleep(0.67)
        assert reports == {"laser": 10, "ground": 15, "tracker": 15}, "in 1.02 s"

    run(test)


def test_nothing_is_drawn_before_somebody_opens_a_device_and_asks(monkeypatch: pytest.MonkeyPatch) -> None:
    used: list[str] = []
    capture = SimulatedCamera.capture

    def note(camera: SimulatedCamera, truth: Truth) -> Photo:
        used.append(camera.imager.name)
        return capture(camera, truth)

    monkeypatch.setattr(SimulatedCamera, "capture", note)

    async def test(sims: SimRig, simulator: Simulator) -> None:
        stereo, ground = sims.devices["stereo_camera"], sims.devices["ground_camera"]
        assert isinstance(stereo, SimStereoCamera)
        assert isinstance(ground, SimCamera)
        await asyncio.sleep(1.0)
        assert stereo.pair() is None
        assert ground.frame() is None
        stereo.open()
        await asyncio.sleep(1.0)
        assert used == [], "open, but not asked"
        stereo.pair()
        assert used == ["front_left", "front_right"]

    run(test)


def test_the_same_seed_gives_the_same_data_whoever_else_looks() -> None:
    found: list[tuple[bytes, bytes]] = []

    def collect(*names: str) -> Callable[[SimRig, Simulator], Coroutine[Any, Any, None]]:
        async def test(sims: SimRig, simulator: Simulator) -> None:
            stereo, laser = sims.devices["stereo_camera"], sims.devices["laser"]
            assert isinstance(stereo, SimStereoCamera)
            assert isinstance(laser, SimLaser)
            for name in names:
                sims.devices[name].open()
            for _ in range(4):
                await asyncio.sleep(0.1)
                for name in names:
                    device = sims.devices[name]
                    if isinstance(device, SimCamera):
                        device.frame()
            pair, turn = stereo.pair(), laser.scan()
            assert pair is not None
            assert turn is not None
            found.append((pair.right.data, turn.scan.ranges_m))

        return test

    run(collect("stereo_camera", "laser"))
    run(collect("ground_camera", "tracker_camera", "laser", "stereo_camera"))
    run(collect("stereo_camera", "laser"), seed=4)
    assert found[0] == found[1]
    assert found[0][0] != found[2][0]
    assert found[0][1] != found[2][1]


def test_a_world_without_a_tracker_has_none() -> None:
    async def test(sims: SimRig, simulator: Simulator) -> None:
        device = sims.devices["tracker_camera"]
        assert sims.tracker is None
        device.open()
        await asyncio.sleep(0.2)
        assert isinstance(device, SimCamera | NoDevice)
        assert device.frame() is None

    run(test, world="open")


def test_the_3d_scanner_gives_each_turn_once_and_can_fail() -> None:
    async def test(sims: SimRig, simulator: Simulator) -> None:
        lidar = sims.devices["lidar"]
        assert isinstance(lidar, SimLidar)
        lidar.open()
        await asyncio.sleep(0.35)
        first = lidar.cloud()
        assert first is not None
        assert lidar.cloud() is first
        ranges = [np.linalg.norm(_points(first.cloud) - first.cloud.origin_frd_m, axis=1)]
        for word in ("scaled", "lost"):
            lidar.fault = DeviceFault(word, 0.5 if word == "scaled" else None)
            await asyncio.sleep(0.2)
            found = lidar.cloud()
            assert found is not None
            ranges.append(np.linalg.norm(_points(found.cloud) - found.cloud.origin_frd_m, axis=1))
        assert np.median(ranges[1]) == pytest.approx(1.5 * np.median(ranges[0]), rel=0.02)
        assert np.array_equal(ranges[2], ranges[1]), "a lost scanner has its last turn"
        lidar.close()

    run(test)


def _points(cloud: PointCloud) -> "np.ndarray[tuple[int, ...], np.dtype[np.float32]]":
    return np.frombuffer(cloud.data, "<f4").reshape(-1, 3)


def test_each_field_of_a_world_has_a_probe_which_can_fail(tmp_path: Path) -> None:
    field = "{unit: ppm, background: 400, noise: 2}"
    (tmp_path / "leaky.yaml").write_text(f"world: leaky\nbased_on: hold\nfields: {{co2: {field}}}\n")

    async def test(sims: SimRig, simulator: Simulator) -> None:
        assert tuple(sims.devices) == (*SIM_DEVICES, "co2_probe")
        probe = sims.devices["co2_probe"]
        assert isinstance(probe, SimProbe)
        reports: list[float] = []

        def read() -> None:
            reading = probe.reading()
            assert reading is not None
            reports.append(reading.value)

        probe.on_new_data(read)
        probe.open()
        await asyncio.sleep(1.05)
        assert len(reports) == 5, "at 5 Hz"
        assert len(set(reports)) == 5
        assert reports == pytest.approx([400.0] * 5, abs=10.0)
        for fault, least, most in ((DeviceFault("scaled", 0.5), 590.0, 610.0), (DeviceFault("step"), 390.0, 410.0)):
            probe.fault = fault
            await asyncio.sleep(0.2)
            assert least < reports[-1] < most
        probe.fault = DeviceFault("stuck")
        await asyncio.sleep(0.4)
        assert reports[-1] == reports[-2] == reports[-3]
        probe.fault = DeviceFault("lost")
        count = len(reports)
        await asyncio.sleep(1.0)
        assert len(reports) == count
        probe.close()

    run(test, world=str(tmp_path / "leaky.yaml"))
