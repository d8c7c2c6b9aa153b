"""Everything of the world that an onboard process in the simulator's own process senses besides the autopilot."""

from asyncio import AbstractEventLoop
from collections.abc import Callable
from typing import Final

from gloc3.camera_model import CameraModel
from gloc3_sitl.sim_devices import SimCamera, SimLaser, SimStereoCamera, Trigger
from gloc3_sitl.truth import Truth
from gloc3_sitl.world import World, rig
from gloc3_sitl.world.camera import Camera

SIM_DEVICES: Final = ("ground_camera", "stereo_camera", "laser")
"""Names of the devices, as platforms call them."""


class SimRig:
    """The devices of a vehicle; each looks at the world only while it is open.

    Args:
        world: what there is to see.
        loop: whose time the devices go by.
        truth: what the vehicle does now.
        seed: of all noise.
    """

    def __init__(self, world: World, loop: AbstractEventLoop, truth: Callable[[], Truth], seed: int) -> None:
        def trigger(rate_hz: float) -> Trigger:
            return Trigger(loop, truth, rate_hz)

        ground = SimCamera(world, rig.GROUND, rig.GROUND_IMAGER, trigger(rig.GROUND_IMAGER.rate_hz), seed)
        self._models = {name: model for name, (model, _) in rig.CAMERAS.items()}
        left, right = (Camera(world, *rig.CAMERAS[name], seed) for name in ("front_left", "front_right"))
        stereo = SimStereoCamera(left, right, trigger(rig.FRONT_LEFT_IMAGER.rate_hz))
        laser = SimLaser(world, rig.LASER, trigger(rig.LASER.rate_hz), seed)
        self.devices: Final = dict(zip(SIM_DEVICES, (ground, stereo, laser), strict=True))
        """By name."""

    def model(self, camera: str) -> CameraModel | None:
        """The camera of that name, as it is truly calibrated; None where there is none."""
        return self._models.get(camera)
