"""The two vehicles of the paper's section VI: their sensors, who looks at which pictures, and the pose that has a double."""

import pytest

from gloc3.component.component import DataProcessor
from gloc3.component.deployment import Begin, ComponentRow, OnFault
from gloc3.messages.frames import GeoPoint
from gloc3.messages.vehicle import Image
from gloc3.platform.platform import Platform
from gloc3.platform.reader import load_platform
from gloc3_sitl.physics.jsbsim_body import Quadrotor
from gloc3_sitl.sensors.range_finder import HeightSensor
from gloc3_sitl.vehicles.table import vehicle_of
from gloc3_sitl.world.world import World

SENSORS = {"imu", "height", "front_cameras", "ground_camera", "tracker_camera"}
SOURCES = {"odometry/stereo", "odometry/ground", "position_fix/tracker"}
PLATFORMS = {
    "pelican": (SENSORS | {"laser"}, SOURCES | {"odometry/laser"}),
    "hummingbird": (SENSORS, SOURCES),
}


@pytest.fixture(params=PLATFORMS)
def platform(request: pytest.FixtureRequest) -> Platform:
    return load_platform(str(request.param))


def processors(platform: Platform) -> list[ComponentRow]:
    return [row for row in platform.components if issubclass(row.load_class(), DataProcessor)]


def test_only_the_pelican_has_a_laser(platform: Platform) -> None:
    sensors, _ = PLATFORMS[platform.platform]
    assert {row.name for row in platform.components} & (SENSORS | {"laser"}) == sensors
    assert ("odometry/laser" in platform.topics()) == ("laser" in sensors)


def test_what_is_to_be_found_in_a_picture_is_looked_for_by_one_processor(platform: Platform) -> None:
    looking: dict[str, list[str]] = {}
    for row in processors(platform):
        for port, given in row.load_class().inputs.items():
            for topic in row.topics(port) if given.message is Image else []:
                looking.setdefault(topic, []).append(row.name)
    assert looking == {
        "camera/front_left": ["features"],
        "camera/front_right": ["features"],
        "camera/ground": ["ground_odometry"],
        "camera/tracker": ["optical_follower"],
    }


def test_the_pose_has_a_quiet_double_that_hears_and_believes_the_same(platform: Platform) -> None:
    pose, double = (platform.component(name) for name in ("pose", "pose_standby"))
    assert pose is not None
    assert double is not None
    assert (double.standby_for, double.begin) == ("pose", Begin.QUIET)
    assert isinstance(pose.on_fault, OnFault)
    assert pose.on_fault.standby == "pose_standby"
    assert (double.class_name, double.rate_hz, double.settings) == (pose.class_name, pose.rate_hz, pose.settings)
    for row in (pose, double):
        assert {*row.topics("odometry"), *row.topics("position_fix")} == PLATFORMS[platform.platform][1]


def test_the_tracker_is_where_it_stands_in_the_hold_seen_from_how_high_the_vehicle_stands(platform: Platform) -> None:
    follower, tracker = platform.component("optical_follower"), World.load("hold").file.tracker
    assert follower is not None
    assert tracker is not None
    standing_m = Quadrotor(vehicle_of(platform), GeoPoint(39.5528, 2.6285, 2.0)).standing_height_m
    x, y, height_m = tracker.position_m
    assert follower.settings["position_ned_m"] == pytest.approx([x, -y, standing_m - height_m], abs=1e-3)
    assert follower.settings["floor_height_m"] == pytest.approx(-standing_m, abs=1e-3)


def test_the_ground_odometry_knows_where_the_simulated_vehicle_has_its_height_sensor(platform: Platform) -> None:
    """A centimetre is 0.7 % of a height of 1.5 m, and so of all motion."""
    odometry = platform.component("ground_odometry")
    assert odometry is not None
    standing_m = Quadrotor(vehicle_of(platform), GeoPoint(39.5528, 2.6285, 2.0)).standing_height_m
    _, _, below_m = odometry.settings["sensor_frd_m"]
    assert below_m == pytest.approx(standing_m - HeightSensor.mount_height_m, abs=2e-3)
