"""Data sets that are written: what is in their files agrees with what is in their pictures and scans."""

from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from gloc3.errors import Refused
from gloc3_onboard.cli.odometry_ground import ground as odometry
from gloc3_onboard.cli.odometry_report import ReportOptions
from gloc3_sitl.cli.record import DataSetFormat, lap, record
from gloc3_sitl.sequences.carmen import write_carmen
from gloc3_sitl.sequences.euroc import write_euroc
from gloc3_sitl.sequences.kitti import write_kitti
from gloc3_sitl.sequences.smooth_flight import SmoothFlight
from gloc3_sitl.world import World

pytestmark = pytest.mark.thorough

Floats = NDArray[np.float64]
HOLD = World.load("hold")
TO_THE_TAG = SmoothFlight(HOLD, [(5.5, 1.6, 1.6), (7.5, 1.2, 1.3)], 0.8, yaw_rad=-0.05)
TAG = np.array([[10.4, 1.4, 0.0], [10.4, 0.6, 0.0], [9.6, 0.6, 0.0], [9.6, 1.4, 0.0]])
"""Corners of the tag's black square in the world, in the order of OpenCV."""


def found_tag(path: Path) -> Floats:
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert picture is not None
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), parameters)
    corners, ids, _ = detector.detectMarkers(picture)
    assert ids is not None, path.name
    return np.asarray(corners[ids.ravel().tolist().index(7)], float).reshape(4, 2)


def test_kitti_poses_and_calibration_put_the_tag_where_both_pictures_show_it(tmp_path: Path) -> None:
    times = [0.4 * number for number in range(6)]
    assert write_kitti(tmp_path, HOLD, map(TO_THE_TAG.truth, times)) == 6
    assert np.loadtxt(tmp_path / "times.txt") == pytest.approx(times)
    poses = np.loadtxt(tmp_path / "poses.txt").reshape(-1, 3, 4)
    assert poses[0] == pytest.approx(np.eye(4)[:3], abs=1e-9)
    lines = dict(line.split(": ", 1) for line in (tmp_path / "calib.txt").read_text().splitlines())
    projections = {side: np.array(lines[f"P{side}"].split(), float).reshape(3, 4) for side in (0, 1)}
    first = cv2.solvePnP(TAG, found_tag(tmp_path / "image_0" / "000000.png"), projections[0][:, :3], np.zeros(4))
    turn, _ = cv2.Rodrigues(first[1])
    in_first = TAG @ turn.T + first[2].ravel()
    for number, pose in enumerate(poses):
        in_camera = (in_first - pose[:, 3]) @ pose[:, :3]
        for side, projection in projections.items():
            seen = np.column_stack([in_camera, np.ones(4)]) @ projection.T
            found = found_tag(tmp_path / f"image_{side}" / f"{number:06d}.png")
            assert np.abs(seen[:, :2] / seen[:, 2:] - found).max() < 1.5, (number, side)


def test_euroc_truth_extrinsics_and_lenses_put_the_tag_where_both_pictures_show_it(tmp_path: Path) -> None:
    assert write_euroc(tmp_path, HOLD, TO_THE_TAG.truth, 2.0, rate_hz=2.0) == 5
    top = tmp_path / "mav0"
    truth = np.loadtxt(top / "state_groundtruth_estimate0" / "data.csv", delimiter=",", comments="#")
    measured = np.loadtxt(top / "imu0" / "data.csv", delimiter=",", comments="#")
    assert len(truth) == len(measured) == 401
    assert measured[0, 4] == pytest.approx(9.8, abs=0.15), "its x axis looks up"
    for name in ("cam0", "cam1"):
        text = (top / name / "sensor.yaml").read_text().replace("%YAML:1.0", "")
        sensor = yaml.safe_load(text)
        body_from_camera = np.array(sensor["T_BS"]["data"], float).reshape(4, 4)
        fu, fv, cu, cv = sensor["intrinsics"]
        intrinsics = np.array([[fu, 0, cu], [0, fv, cv], [0, 0, 1]])
        rows = (top / name / "data.csv").read_text().splitlines()[1:]
        for row in rows:
            stamp, file = row.split(",")
            at = truth[np.abs(truth[:, 0] - float(stamp)).argmin()]
            w, x, y, z = at[4:8]
            world_from_body = np.eye(4)
            world_from_body[:3, :3] = np.array(
                [
                    [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                    [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                    [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
                ]
            )
            world_from_body[:3, 3] = at[1:4]
            camera_from_world = np.linalg.inv(world_from_body @ body_from_camera)
            turn, _ = cv2.Rodrigues(camera_from_world[:3, :3])
            seen, _ = cv2.projectPoints(
                TAG, turn, camera_from_world[:3, 3], intrinsics, np.array(sensor["distortion_coefficients"])
            )
            assert np.abs(seen.reshape(4, 2) - found_tag(top / name / "data" / file)).max() < 1.0, file


def test_a_carmen_log_s_poses_put_its_points_on_the_walls(tmp_path: Path) -> None:
    flight = SmoothFlight(HOLD, [(3.0, 3.0, 4.0), (14.0, 3.0, 4.0), (14.0, 8.0, 4.0)], 0.3)
    log = tmp_path / "hold.log"
    assert write_carmen(log, HOLD, [flight.truth(float(t_s)) for t_s in np.arange(0.0, 54.0, 4.5)]) == 12
    for line in log.read_text().splitlines()[1:]:
        words = line.split()
        count = int(words[1])
        assert (words[0], count, len(words)) == ("FLASER", 361, 361 + 11)
        ranges, (x, y, theta) = np.array(words[2 : 2 + count], float), map(float, words[2 + count : 5 + count])
        angles = theta - np.pi / 2.0 + np.arange(count) * np.pi / 360.0
        px, py = (x + ranges * np.cos(angles))[ranges < 29.9], (y + ranges * np.sin(angles))[ranges < 29.9]
        off = np.abs(np.column_stack([px - 21.0, px + 3.0, py - 13.0, py + 3.0])).min(axis=1)
        assert np.median(off) < 0.02
        assert (off < 0.05).mean() > 0.95, "nearly all of them: it leans a little"


def test_the_ground_odometer_finds_the_way_of_a_ground_data_set(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "floor"
    way = ["5,1,1.5", "9,1,1.5"]
    assert record(DataSetFormat.GROUND, folder, way=way, speed=0.8, rate=8.0, seconds=5.0) == 0
    assert odometry(folder, options=ReportOptions(truth=folder / "truth.txt", json=True), slant=True) == 0
    found = msgspec.json.decode(capsys.readouterr().out)
    assert (found["run"]["inputs"], found["run"]["valid"]) == (41, 40)
    assert found["errors"]["poses"] == 41
    assert found["errors"]["path_m"] > 1.0
    assert found["errors"]["absolute_m"]["max"] < 0.03
    assert found["errors"]["absolute_deg"]["max"] < 0.5


def test_the_command_writes_each_form_and_refuses_what_makes_no_sense(tmp_path: Path) -> None:
    assert record(DataSetFormat.KITTI, tmp_path / "k", seconds=0.1) == 0
    assert record(DataSetFormat.EUROC, tmp_path / "e", seconds=0.1, world="tank") == 0
    assert record(DataSetFormat.CARMEN, tmp_path / "c.log", seconds=0.5, world="corridor") == 0
    assert len(list((tmp_path / "k" / "image_1").glob("*.png"))) == 2
    assert len(list((tmp_path / "e" / "mav0" / "cam1" / "data").glob("*.png"))) == 2
    with pytest.raises(Refused, match="already exists"):
        record(DataSetFormat.KITTI, tmp_path / "k", seconds=0.1)
    with pytest.raises(Refused, match="already exists"):
        record(DataSetFormat.CARMEN, tmp_path / "c.log", seconds=0.1)
    with pytest.raises(Refused, match=r"the path passes within 0.\d\d m of an obstacle"):
        record(DataSetFormat.KITTI, tmp_path / "x", way=["16,5,1.5", "16,12.5,1.5"])
    with pytest.raises(Refused, match=r"the path takes [0-9]+ s; limit it with --seconds"):
        record(DataSetFormat.KITTI, tmp_path / "x", way=["1,1,1.5", "18,9,1.5"], speed=0.005)
    with pytest.raises(Refused, match="must be X,Y,HEIGHT"):
        record(DataSetFormat.KITTI, tmp_path / "x", way=["16,5"])
    with pytest.raises(Refused, match="--speed"):
        record(DataSetFormat.KITTI, tmp_path / "x", speed=0.0)
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize("world", ["hold", "tank", "corridor", "hold_hard", "open"])
def test_the_default_lap_keeps_clear_of_everything(world: str) -> None:
    place = World.load(world)
    flight = SmoothFlight(place, lap(place, 1.5), 0.5)
    near_m = min(place.geometry.clearance_m(flight.place_m(t_s), t_s) for t_s in np.arange(0.0, flight.duration_s, 0.5))
    assert near_m >= 0.3
