"""`gloc3 calibrate magnetometer`, from tables, logs and a link to the rig file; what is not trustworthy or wrong."""

import socket
import struct
import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from tests.common.log.samples import LogInMemory
from tests.common.network.yard import free_port
from tests.onboard.algorithms.calibration.fields import FIELD, OFFSET, readings
from tests.sitl.sensors.test_dvl_model import over

from gloc3.cli.program import run
from gloc3.mavlink import codec
from gloc3.mavlink.codec import Encoder
from gloc3.messages.frames import GeoPoint
from gloc3_groundstation.services.parameter_files import load_parameter_file
from gloc3_onboard.calibrating import field_readings
from gloc3_onboard.calibration.rig_file import read_sections
from gloc3_sitl.sensors.magnetometer import Magnetometer

Field = NDArray[np.float64]
PLACE = GeoPoint(47.4, 8.5, 400.0)
TURNS_DEG = {0: (0.0, 0.0, 0.0), 10: (90.0, 0.0, 180.0), 38: (293.0, 68.0, 90.0)}
"""Yaw, pitch, roll of MAV_SENSOR_ORIENTATION's numbers, by its document."""


def table(path: Path, seed: int = 0, tilt_rad: float = np.pi, unit: float = 1.0) -> Path:
    rows = unit * readings(seed, tilt_rad=tilt_rad)
    path.write_text("time,x,y,z\n" + "".join(f"{n},{x:.6f},{y:.6f},{z:.6f}\n" for n, (x, y, z) in enumerate(rows)))
    return path


def highres(reading: "np.ndarray[tuple[int, ...], np.dtype[np.float64]]") -> bytes:
    x, y, z = reading.tolist()
    return Encoder(1, 1).encode(codec.message("HIGHRES_IMU", time_usec=1, xmag=x, ymag=y, zmag=z))


def log_of_ours(path: Path) -> Path:
    log = LogInMemory()
    for number, reading in enumerate(readings(0)):
        log.recorder.record_mavlink("autopilot", "in", highres(reading), 0.01 * number)
        log.recorder.record_mavlink("autopilot", "out", highres(0.0 * reading + 0.1), 0.01 * number)
    path.write_bytes(log.close())
    return path


def log_of_ardupilot(path: Path) -> Path:
    def described(identifier: int, length: int, name: bytes, form: bytes, columns: bytes) -> bytes:
        return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", identifier, length, name, form, columns)

    data = described(0x80, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")
    data += described(10, 3 + 8 + 1 + 6, b"MAG", b"QBhhh", b"TimeUS,I,MagX,MagY,MagZ")
    for number, reading in enumerate(readings(0)):
        data += b"\xa3\x95\x0a" + struct.pack("<QBhhh", 10_000 * number, 0, *np.round(1000.0 * reading).astype(int))
    path.write_bytes(data)
    return path


@pytest.mark.parametrize(
    ("make", "name"), [(table, "turn.csv"), (log_of_ours, "log.mcap"), (log_of_ardupilot, "1.bin")]
)
def test_the_result_is_written_and_drawn(
    make: Callable[[Path], Path], name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig, report = tmp_path / "rig.yaml", tmp_path / "report.svg"
    rig.write_text("cam0: {intrinsics: [1, 1, 1, 1]}\n")
    source = make(tmp_path / name)
    assert run(["calibrate", "magnetometer", str(source), "--rig", str(rig), "--report", str(report)]) == 0
    sections = read_sections(rig)
    assert sections["cam0"] == {"intrinsics": [1, 1, 1, 1]}
    assert sections["magnetometer"]["offset_gauss"] == pytest.approx(OFFSET, abs=1.5e-3)
    about = sections["magnetometer"]["calibration"]
    assert about["field_gauss"] == pytest.approx(np.linalg.norm(FIELD), rel=0.02)
    assert about["after"] < 0.01 < 0.1 < about["before"]
    said = capsys.readouterr().out
    assert f"CAL_MAG0_XOFF={about and sections['magnetometer']['offset_gauss'][0]:.4f}" in said
    assert "COMPASS_OFS_X=-" in said
    assert report.read_text().count("<g transform") == 4


def turned_unit(iron_tesla: tuple[float, float, float]) -> tuple[Field, Field]:
    """Readings of the simulated magnetometer on a vehicle with hard iron that is turned, and the true field; in gauss."""
    unit, true = Magnetometer(3, PLACE), Magnetometer(3, PLACE, noise_tesla=0.0, bias_tesla=0.0)
    read, field = [], []
    random = np.random.default_rng(4)
    for attitude in random.normal(size=(600, 4)):
        w, x, y, z = attitude / np.linalg.norm(attitude)
        truth = over(10.0, (w, x, y, z))
        read.append(unit.shift(unit.measure(truth, 0.0), iron_tesla).field_frd_tesla)
        field.append(true.measure(truth, 0.0).field_frd_tesla)
    return 1e4 * np.array(read), 1e4 * np.array(field)


def matrix_of(value: Callable[[str], float], diagonal: str, others: str) -> Field:
    (xx, yy, zz), (xy, xz, yz) = ([value(name.format(axis)) for axis in "XYZ"] for name in (diagonal, others))
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


@pytest.mark.parametrize("name", ["compass.params", "compass.param", "compass.parm"])
@pytest.mark.parametrize("rotation", [0, 10, 38])
def test_an_autopilot_with_the_written_parameters_measures_the_field(name: str, rotation: int, tmp_path: Path) -> None:
    """The autopilots' own formulas (sensor_calibration::Magnetometer, AP_Compass_Backend) on a simulated unit's readings."""
    body, field = turned_unit((2e-5, -1e-5, 3e-5))
    np.savetxt(tmp_path / "turn.csv", body, delimiter=",")
    file, is_px4 = tmp_path / name, name.endswith(".params")
    options = ["--parameters", str(file), *(["--rotation", str(rotation)] if is_px4 else [])]
    assert (
        run(["calibrate", "magnetometer", str(tmp_path / "turn.csv"), "--rig", f"{tmp_path}/rig.yaml", *options]) == 0
    )
    found = {one.name: one.value for one in load_parameter_file(file).parameters}
    assert len(found) == 9

    def of(template: str) -> Field:
        return np.array([found[template.format(axis)] for axis in "XYZ"])

    if is_px4:
        turn = Rotation.from_euler("ZYX", TURNS_DEG[rotation], degrees=True)
        scale = matrix_of(found.__getitem__, "CAL_MAG0_{}SCALE", "CAL_MAG0_{}ODIAG")
        measured = turn.apply((turn.inv().apply(body) - of("CAL_MAG0_{}OFF")) @ scale)
    else:
        scale = matrix_of(found.__getitem__, "COMPASS_DIA_{}", "COMPASS_ODI_{}")
        measured = 1e-3 * ((1e3 * body + of("COMPASS_OFS_{}")) @ scale)
    error = np.abs(measured - field).mean(axis=0)
    assert error.max() < 0.01 < 0.09 < np.abs(body - field).mean(axis=0).min()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--parameters", "compass.txt"], "name a file that ends in .params for PX4"),
        (["--parameters", "none/compass.params"], "there is no folder none"),
        (["--parameters", "compass.params", "--rotation", "41"], "must be from 0 to 40"),
        (["--parameters", "compass.parm", "--rotation", "2"], "--rotation is of PX4"),
        (["--rotation", "2"], "--parameters FILE.params"),
    ],
)
def test_files_of_parameters_that_cannot_be_written_are_refused_before_the_turn(
    options: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(["calibrate", "magnetometer", str(table(tmp_path / "turn.csv")), *options]) == 2
    assert said in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "rig.yaml").exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"tilt_rad": 0.5}, "of all sides, 70% is the least: point its "),
        ({"unit": 100.0}, "the Earth's 0.2 to 0.7: is it in gauss?"),
    ],
)
def test_what_is_not_trustworthy_is_not_written(
    options: dict[str, float], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = table(tmp_path / "turn.csv", **options)  # type: ignore[arg-type] # only numbers are given here
    arguments = ["calibrate", "magnetometer", str(source), "--rig", str(tmp_path / "rig.yaml")]
    arguments += ["--parameters", str(tmp_path / "compass.params")]
    assert run(arguments) == 1
    assert said in capsys.readouterr().err
    assert not (tmp_path / "rig.yaml").exists()
    assert not (tmp_path / "compass.params").exists()
    assert run([*arguments, "--force"]) == 0


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("turn.csv", "x,y,z\n0.1,0.2\n", "turn.csv:2:1: '0.1,0.2' is no reading (a row is x,y,z or time,x,y,z"),
        ("turn.csv", "x,y,z\n0.1,0.2,0.3\n", "1 readings of the magnetometer are too few"),
        ("turn.csv", f"x,y,z\n{'1' * 200_000},2,3\n", "turn.csv: this is no table: field larger than field limit"),
        ("turn.kml", "", "turn.kml: this is no log of a magnetometer"),
        ("turn.ulg", "ULog no more", "turn.ulg: "),
    ],
)
def test_bad_sources_are_refused_with_their_place(
    name: str, content: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).write_text(content)
    assert run(["calibrate", "magnetometer", str(tmp_path / name), "--rig", str(tmp_path / "rig.yaml")]) == 2
    assert said in capsys.readouterr().err


def test_a_log_without_readings_is_refused_with_what_it_lacks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = LogInMemory()
    log.recorder.record_mavlink("autopilot", "in", b"\xfd\x00", 0.5)
    (tmp_path / "log.mcap").write_bytes(log.close())
    assert run(["calibrate", "magnetometer", str(tmp_path / "log.mcap")]) == 2
    assert (
        "log.mcap: it has no readings of a magnetometer (they are in the MAVLink messages HIGHRES_IMU"
        in capsys.readouterr().err
    )


@pytest.mark.sockets
def test_a_live_turn_ends_when_enough_has_been_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(field_readings, "REPEAT_S", 0.1)
    monkeypatch.setattr(field_readings, "SHOWN_S", 0.2)
    port, ended = free_port(), threading.Event()

    def turn() -> None:
        encoder = Encoder(1, 1)
        heartbeat = codec.message("HEARTBEAT", type=2, autopilot=12, mavlink_version=3)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
            while not ended.is_set():
                for number, (x, y, z) in enumerate(readings(0).tolist()):
                    frame = codec.message("HIGHRES_IMU", time_usec=number, xmag=x, ymag=y, zmag=z)
                    line.sendto(encoder.encode(frame if number % 50 else heartbeat), ("127.0.0.1", port))
                    if ended.wait(0.002):
                        return

    thread = threading.Thread(target=turn)
    thread.start()
    try:
        code = run(["calibrate", "magnetometer", f"udpin://127.0.0.1:{port}", "--rig", str(tmp_path / "rig.yaml")])
    finally:
        ended.set()
        thread.join()
    said = capsys.readouterr().err
    assert code == 0, said
    assert "turn the vehicle" in said
    assert read_sections(tmp_path / "rig.yaml")["magnetometer"]["offset_gauss"] == pytest.approx(OFFSET, abs=5e-3)


@pytest.mark.sockets
def test_a_device_that_is_not_there_is_named_and_nobody_is_told_to_turn_the_vehicle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(field_readings, "REPEAT_S", 0.1)
    monkeypatch.setattr(field_readings, "LISTEN_S", 0.3)
    link = f"serial://{tmp_path}/nosuch:57600"
    assert run(["calibrate", "magnetometer", link, "--rig", str(tmp_path / "rig.yaml")]) == 2
    said = capsys.readouterr().err
    assert f"{link}: no such file or directory" in said
    assert "turn the vehicle" not in said
