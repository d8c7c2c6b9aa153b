"""Writes a flight in the form of the EuRoC data sets: two cameras with distortion, an inertial unit, the truth."""

from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from gloc3.camera.geometry import matrix
from gloc3.camera.model import CameraModel, Lens
from gloc3.camera.opencv import load_opencv
from gloc3.messages.frames import Quaternion, multiply, normalize, rotate_back
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.sensors import imu
from gloc3_sitl.world import World, rig
from gloc3_sitl.world.camera import SimulatedCamera
from gloc3_sitl.world.geometry import Floats
from gloc3_sitl.world.placing import Placing

IMU_HZ: Final = 200.0
BEGIN_NS: Final = 1_700_000_000_000_000_000
"""The stamp of time 0: such data sets have those of the epoch."""
FRD_FROM_URF: Final[Quaternion] = (0.5**0.5, 0.0, 0.5**0.5, 0.0)
"""EuRoC's body is that of its inertial unit: x up, y right, z forward."""
_DISTORTION: Final = {
    Lens.PINHOLE: "radial-tangential",
    Lens.RADTAN: "radial-tangential",
    Lens.EQUIDISTANT: "equidistant",
}


def write_euroc(
    folder: Path,
    world: World,
    truth: Callable[[float], Truth],
    duration_s: float,
    *,
    rate_hz: float = 15.0,
    seed: int = 0,
) -> int:
    """Writes a data set.

    Args:
        folder: gets `mav0` with `cam0`, `cam1`, `imu0` and `state_groundtruth_estimate0`.
        world: scene.
        truth: vehicle state at a time.
        duration_s: length from time 0.
        rate_hz: of the pictures.
        seed: of all noise.

    Returns:
        The number of stereo pairs.
    """
    top = folder / "mav0"
    for name, (model, imager) in (("cam0", rig.CAMERAS["front_left"]), ("cam1", rig.CAMERAS["front_right"])):
        camera = SimulatedCamera(world, model, imager, seed)
        moments = [truth(number / rate_hz) for number in range(int(duration_s * rate_hz) + 1)]
        write_pictures(top / name, camera, moments)
        write_lines(top / name / "sensor.yaml", [camera_yaml(name, model, rate_hz)])
    moments = [truth(number / IMU_HZ) for number in range(int(duration_s * IMU_HZ) + 1)]
    _write_imu(top / "imu0", moments, seed)
    _write_truth(top / "state_groundtruth_estimate0", world, moments)
    return int(duration_s * rate_hz) + 1


def stamp_ns(t_s: float) -> int:
    """A time as such data sets write it."""
    return BEGIN_NS + round(t_s * 1e9)


def write_pictures(folder: Path, camera: SimulatedCamera, truths: list[Truth]) -> None:
    """Writes a camera's image at each moment, and their index."""
    cv2 = load_opencv()
    (folder / "data").mkdir(parents=True, exist_ok=True)
    rows = ["#timestamp [ns],filename"]
    for moment in truths:
        name = f"{stamp_ns(moment.t_s)}.png"
        pixels = camera.capture(moment).pixels
        cv2.imwrite(str(folder / "data" / name), pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        rows.append(f"{stamp_ns(moment.t_s)},{name}")
    write_lines(folder / "data.csv", rows)


def _write_imu(folder: Path, truths: list[Truth], seed: int) -> None:
    unit = imu.SimulatedImu(seed, IMU_HZ)
    rows = [
        "#timestamp [ns],"
        + ",".join(f"w_RS_S_{a} [rad s^-1]" for a in "xyz")
        + ","
        + ",".join(f"a_RS_S_{a} [m s^-2]" for a in "xyz")
    ]
    for moment in truths:
        reading = unit.measure(moment, moment.t_s)
        measured = [
            rotate_back(FRD_FROM_URF, part) for part in (reading.rate_frd_rad_s, reading.specific_force_frd_m_s2)
        ]
        rows.append(f"{stamp_ns(moment.t_s)},{_numbers([*measured[0], *measured[1]])}")
    write_lines(folder / "data.csv", rows)
    lines = [
        "sensor_type: imu",
        "T_BS:",
        _matrix_yaml(np.eye(4)),
        f"rate_hz: {IMU_HZ:g}",
        f"gyroscope_noise_density: {imu.GYRO_DENSITY_RAD_S_RTHZ:.6e}",
        "gyroscope_random_walk: 0.0",
        f"accelerometer_noise_density: {imu.ACCELEROMETER_DENSITY_M_S2_RTHZ:.6e}",
        "accelerometer_random_walk: 0.0",
    ]
    write_lines(folder / "sensor.yaml", ["%YAML:1.0", *lines])


def _write_truth(folder: Path, world: World, truths: list[Truth]) -> None:
    placing = Placing(world)
    columns = "p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []"
    biases = ",".join(
        f"b_{kind}_RS_S_{axis} [{unit}]" for kind, unit in (("w", "rad s^-1"), ("a", "m s^-2")) for axis in "xyz"
    )
    speeds = ",".join(f"v_RS_R_{axis} [m s^-1]" for axis in "xyz")
    rows = [f"#timestamp,{columns},{speeds},{biases}"]
    for moment in truths:
        body = placing.body(moment)
        turned = normalize(multiply(body.local_from_here, FRD_FROM_URF))
        speed = world.frame.from_ned(moment.velocity_ned_m_s)
        rows.append(f"{stamp_ns(moment.t_s)},{_numbers([*body.position_m, *turned, *speed, *(0.0,) * 6])}")
    write_lines(folder / "data.csv", rows)
    write_lines(folder / "sensor.yaml", ["%YAML:1.0", "sensor_type: visual-inertial", "T_BS:", _matrix_yaml(np.eye(4))])


def camera_yaml(name: str, model: CameraModel, rate_hz: float, frd_from_body: Quaternion = FRD_FROM_URF) -> str:
    """The calibration of a camera relative to a body whose axes may differ from FRD."""
    body_from_frd = matrix(frd_from_body).T
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = body_from_frd @ matrix(model.frd_from_rdf), body_from_frd @ model.position_frd_m
    distortion = (*model.distortion, *(0.0,) * 4)[: max(4, len(model.distortion))]
    lines = [
        "%YAML:1.0",
        "sensor_type: camera",
        f"comment: rendered {name}",
        "T_BS:",
        _matrix_yaml(pose),
        f"rate_hz: {rate_hz:g}",
        f"resolution: [{model.width}, {model.height}]",
        "camera_model: pinhole",
        f"intrinsics: [{', '.join(f'{value:.9g}' for value in (*model.focal_px, *model.center_px))}]",
        f"distortion_model: {_DISTORTION[model.lens]}",
        f"distortion_coefficients: [{', '.join(f'{value:.9g}' for value in distortion)}]",
    ]
    return "\n".join(lines)


def _matrix_yaml(pose: Floats) -> str:
    return f"  cols: 4\n  rows: 4\n  data: [{', '.join(f'{value:.12g}' for value in pose.ravel())}]"


def _numbers(values: list[float]) -> str:
    return ",".join(f"{value:.12g}" for value in values)


def write_lines(path: Path, lines: list[str]) -> None:
    """Writes a text file, and its folder where there is none."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
