"""Simulated devices of an onboard process in the simulator's own process."""

from asyncio import AbstractEventLoop
from collections.abc import Callable, Collection
from typing import Final

import msgspec

from gloc3.camera.model import CameraModel
from gloc3.messages.vehicle import Image
from gloc3_sitl.flight.sim_devices import (
    CaptureTrigger,
    NoDevice,
    SimCamera,
    SimDepthCamera,
    SimDvl,
    SimEstimator,
    SimLaser,
    SimLidar,
    SimProbe,
    SimStereoCamera,
)
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.sensors import dvl, estimator
from gloc3_sitl.sensors.gimbal import SimulatedGimbal
from gloc3_sitl.world import World, field_probe, rig
from gloc3_sitl.world.camera import SimulatedCamera
from gloc3_sitl.world.depth_camera import SimulatedDepthCamera
from gloc3_sitl.world.tracker import TrackerCamera

SIM_DEVICES: Final = (
    "ground_camera",
    "stereo_camera",
    "tracker_camera",
    "gimbal_camera",
    "depth_camera",
    "laser",
    "lidar",
    "dvl",
    "estimator",
)
"""Names of the devices that every vehicle has, as platforms call them."""
PROBE: Final = "_probe"
"""End of the names of probes: `co2_probe` measures the field `co2` of the world."""

SimDevice = (
    SimCamera | SimStereoCamera | SimDepthCamera | SimLaser | SimLidar | SimDvl | SimProbe | SimEstimator | NoDevice
)


class SimRig:
    """The devices of a vehicle; each observes the world only while open.

    Args:
        world: scene.
        loop: event loop whose clock the devices use.
        truth: returns the vehicle's current state.
        seed: seed of all noise.
        gimbal: the vehicle's gimbal; None without one.
    """

    def __init__(
        self,
        world: World,
        loop: AbstractEventLoop,
        truth: Callable[[], Truth],
        seed: int,
        gimbal: SimulatedGimbal | None = None,
    ) -> None:
        def trigger(rate_hz: float) -> CaptureTrigger:
            return CaptureTrigger(loop, truth, rate_hz)

        ground, left, right = (
            SimulatedCamera(world, *rig.CAMERAS[name], seed) for name in ("ground", "front_left", "front_right")
        )
        on_gimbal = SimulatedCamera(world, rig.GIMBAL, rig.GIMBAL_IMAGER, seed)
        self._coloured: Final = (ground, left, right, on_gimbal)
        self.tracker: Final = _tracker(world, seed)
        """The external camera; None in a world without."""
        self._models = {name: model for name, (model, _) in rig.CAMERAS.items()} | {"tracker": rig.TRACKER}
        self._models[rig.DEPTH_IMAGER.name] = rig.DEPTH
        self._models |= {} if gimbal is None else {rig.GIMBAL_IMAGER.name: rig.GIMBAL}
        self.devices: Final[dict[str, SimDevice]] = {
            "ground_camera": SimCamera(ground, trigger(rig.GROUND_IMAGER.rate_hz)),
            "stereo_camera": SimStereoCamera(left, right, trigger(rig.FRONT_LEFT_IMAGER.rate_hz)),
            "tracker_camera": NoDevice(),
            "gimbal_camera": NoDevice(),
            "depth_camera": SimDepthCamera(
                SimulatedDepthCamera(world, rig.DEPTH, rig.DEPTH_IMAGER, seed), trigger(rig.DEPTH_IMAGER.rate_hz)
            ),
            "laser": SimLaser(world, rig.LASER, trigger(rig.LASER.rate_hz), seed),
            "lidar": SimLidar(world, rig.LIDAR, trigger(rig.LIDAR.rate_hz), seed),
            "dvl": SimDvl(trigger(dvl.RATE_HZ), seed),
            "estimator": SimEstimator(trigger(estimator.RATE_HZ), seed),
        }
        """By name, all of `SIM_DEVICES`, and a probe for each field of the world."""
        if gimbal is not None:
            seen = CaptureTrigger(loop, lambda: gimbal.carrying(truth()), rig.GIMBAL_IMAGER.rate_hz)
            self.devices["gimbal_camera"] = SimCamera(on_gimbal, seen)
        for field in world.file.fields:
            self.devices[field + PROBE] = SimProbe(world, field, trigger(field_probe.RATE_HZ), seed)
        if self.tracker is not None:
            self.devices["tracker_camera"] = SimCamera(self.tracker, trigger(rig.TRACKER_IMAGER.rate_hz))

    def use_colour(self, cameras: Collection[str]) -> None:
        """Has these cameras of the vehicle take pictures in colour, and the others in grey."""
        for camera in self._coloured:
            camera.is_coloured = camera.imager.name in cameras

    def coloured(self, image: Image) -> Image:
        """One of the last pictures of these cameras in colour; any other as it is."""
        for camera in self._coloured:
            if camera.imager.name == image.camera and not image.bgr:
                bgr = camera.coloured(image.data)
                return image if bgr is None else msgspec.structs.replace(image, bgr=bgr.tobytes())
        return image

    def model(self, camera: str) -> CameraModel | None:
        """The camera of that name, as it is truly calibrated; None where there is none."""
        return self._models.get(camera)


def _tracker(world: World, seed: int) -> TrackerCamera | None:
    """The tracker of a world that has one."""
    if world.file.tracker is None:
        return None
    return TrackerCamera(world, world.file.tracker, rig.TRACKER, rig.TRACKER_IMAGER, seed)
