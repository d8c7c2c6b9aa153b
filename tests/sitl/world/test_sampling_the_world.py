"""The samplers on the world's devices: what they show is valid, even in a dusty, dark hold."""

from functools import partial

import pytest

from gloc3.component.deployment import ComponentRow
from gloc3.component.test_bench import Bench
from gloc3_onboard.components.samplers.camera import CameraSampler
from gloc3_onboard.components.samplers.laser import LaserSampler
from gloc3_onboard.components.samplers.stereo_camera import StereoCameraSampler
from gloc3_sitl.flight.sim_rig import SimRig
from gloc3_sitl.vehicles.simulator import Simulator
from gloc3_sitl.world import World

pytestmark = pytest.mark.thorough

CREATE = {
    "ground_camera": CameraSampler,
    "stereo_camera": StereoCameraSampler,
    "tracker_camera": CameraSampler,
    "laser": LaserSampler,
}


def test_everything_that_a_dark_and_dusty_world_shows_is_valid_to_the_samplers() -> None:
    with Bench() as bench:
        simulator = Simulator(World.load("hold_hard"))
        rig = SimRig(simulator.world, bench.loop, simulator.truth, seed=0)
        simulator.start(bench.loop)
        for name, create in CREATE.items():
            extra = {} if create is LaserSampler else {"rig": rig}
            row = ComponentRow(name=name, class_name="x:Y", rate_hz=15.0)
            bench.host(row, partial(create, rig.devices[name], **extra))
        bench.run(0.4)
        simulator.stop()
        for topic, least in (("image", 8), ("left", 5), ("right", 5), ("laser", 3)):
            found = bench.all(topic)
            assert len(found) >= least, topic
            assert {message.reason for message in found} == {""}, topic
