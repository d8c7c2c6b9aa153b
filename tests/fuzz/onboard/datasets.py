"""Targets of recorded data sets: laser logs, and folders of EuRoC's and KITTI's kinds."""

import numpy as np
from tests.fuzz.target import as_file, as_folder, fuzz_target, refuses

from gloc3_onboard.datasets.breezy import read_breezy
from gloc3_onboard.datasets.ground_folder import read_ground_folder
from gloc3_onboard.datasets.laser_log import LaserLog
from gloc3_onboard.datasets.laser_logs import read_carmen, read_gfs, read_laser_log
from gloc3_onboard.datasets.stereo_set import read_mono_set, read_stereo_set
from gloc3_onboard.sensors.sources.euroc import imu_records


@fuzz_target("gloc3_onboard.datasets")
def laser_log(data: bytes) -> None:
    """A log of CARMEN's, GMapping's or BreezySLAM's form gives scans in the order of time, or is refused with a place."""
    for read, name in ((read_carmen, "x.log"), (read_gfs, "x.gfs"), (read_breezy, "x.dat"), (read_laser_log, "y.log")):
        path = as_file(data, name)

        def whole(read: object = read, path: object = path) -> None:
            found: LaserLog = read(path)  # type: ignore[operator]
            assert found.scans
            assert np.isfinite(found.times_s).all()

        refuses(whole)


@fuzz_target("gloc3_onboard.sensors.sources.euroc", "gloc3_onboard.datasets", "gloc3_onboard.calibration")
def euroc_folder(data: bytes) -> None:
    """A folder of EuRoC's kind gives pairs, samples and pictures with finite times, or is refused with a place."""
    names = ("cam0/sensor.yaml", "cam0/data.csv", "cam1/sensor.yaml", "cam1/data.csv", "imu0/data.csv")
    folder = as_folder(data, *names, "attitude.csv", "height.csv")
    refuses(lambda: read_stereo_set(folder))
    refuses(lambda: read_mono_set(folder))
    refuses(lambda: [record.load() for record in imu_records(folder, "imu0")])
    refuses(lambda: read_ground_folder(folder, "cam0"))


@fuzz_target("gloc3_onboard.sensors.sources.kitti", "gloc3_onboard.datasets", "gloc3_onboard.calibration")
def kitti_folder(data: bytes) -> None:
    """A folder of KITTI's kind gives pairs and pictures with growing times, or is refused with a place."""
    names = ("calib.txt", "times.txt", "image_0/000000.png", "image_1/000000.png")
    folder = as_folder(data, *names)
    refuses(lambda: read_stereo_set(folder))
    refuses(lambda: read_mono_set(folder))
