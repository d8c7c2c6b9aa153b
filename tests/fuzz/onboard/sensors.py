"""Targets of sensors: what comes over a line, the URLs that name them, and calibration files."""

from contextlib import suppress
from math import hypot, isfinite
from typing import Final

import numpy as np
from tests.fuzz.target import as_file, fuzz_target, pieces, refuses

from gloc3.errors import Gloc3Error
from gloc3_onboard.calibration.reader import read_calibration
from gloc3_onboard.sensors.camera_sources.raw_frames import RawFrameReader
from gloc3_onboard.sensors.lidar_sources.velodyne import TurnAssembler, packet_of
from gloc3_onboard.sensors.registry import parse_source, source_kinds
from gloc3_onboard.sensors.sources.doppler import A50Decoder, Pd6Decoder
from gloc3_onboard.sensors.sources.estimator_wire import JsonDecoder, OdometryDecoder
from gloc3_onboard.sensors.sources.laser import mounted_scan
from gloc3_onboard.sensors.sources.probe import LineDecoder
from gloc3_onboard.sensors.sources.ranger_wire import LwnxReader, RangeDecoder
from gloc3_onboard.sensors.sources.rplidar import scan_of
from gloc3_onboard.sensors.sources.scip import ScipError, ScipReader, measure, parameters_of, turn_of

DEVICES: Final = (
    "ground_camera",
    "laser",
    "imu",
    "stereo_camera",
    "depth_camera",
    "lidar",
    "dvl",
    "estimator",
    "height",
    "co2_probe",
    "x",
)
SCHEMES: Final = tuple(sorted(source_kinds()))


@fuzz_target("gloc3_onboard.sensors.sources.scip")
def scip_scanner(data: bytes) -> None:
    """Bytes of a Hokuyo are turns of as many distances as were asked for, or are refused; what is waited for is bounded."""
    reader = ScipReader()
    with suppress(ScipError):
        for piece in pieces(data, 67):
            for reply in reader.receive(piece):
                with suppress(ScipError):
                    assert measure(parameters_of(reply))
                for count in (1, 3, 11):
                    with suppress(ScipError):
                        assert len(turn_of(reply, count).ranges_mm) == count


@fuzz_target("gloc3_onboard.sensors.sources.doppler")
def doppler_log(data: bytes) -> None:
    """Lines of a DVL of either kind are velocities of finite numbers, or are counted as damaged."""
    for decoder in (A50Decoder(30.0), Pd6Decoder(30.0)):
        for piece in pieces(data, 53):
            for report in decoder.receive(piece):
                velocity = report.bottom
                assert all(map(isfinite, velocity.velocity_frd_m_s))
                assert isfinite(velocity.std_m_s)
                assert isfinite(velocity.altitude_m)
                assert velocity.altitude_m >= 0.0
                assert report.stamp_us is None or report.stamp_us > 0


@fuzz_target("gloc3_onboard.sensors.camera_sources.raw_frames")
def raw_frames(data: bytes) -> None:
    """A program's output is frames of as many bytes as their size says, or is refused."""
    for reader in (RawFrameReader(), RawFrameReader((4, 2))):
        with suppress(Gloc3Error):
            for piece in pieces(data, 53):
                for frame in reader.receive(piece):
                    pixels = frame.width * frame.height
                    assert len(frame.data) == (pixels if frame.is_grey else pixels * 3 // 2)


@fuzz_target("gloc3_onboard.sensors.sources.ranger_wire")
def range_finder(data: bytes) -> None:
    """Bytes of range finders of either kind are distances above 0 or none, and packets that are whole."""
    decoder, reader = RangeDecoder(), LwnxReader()
    for piece in pieces(data, 53):
        assert all(distance is None or 0.0 < distance < 656.0 for distance in decoder.receive(piece))
        assert all(len(packet.data) < 40 for packet in reader.receive(piece))


@fuzz_target("gloc3_onboard.sensors.sources.probe")
def probe_line(data: bytes) -> None:
    """Lines of a probe, with and without a name before the value, are finite numbers, or are counted as unread."""
    for decoder in (LineDecoder("co2"), LineDecoder("")):
        for piece in pieces(data, 53):
            assert all(map(isfinite, decoder.receive(piece)))
        assert decoder.unread <= data.count(b"\n")


@fuzz_target("gloc3_onboard.sensors.sources.estimator_wire")
def estimator_poses(data: bytes) -> None:
    """Datagrams of an estimator are poses of finite numbers whose attitude is a rotation, or are counted as damaged."""
    for decoder in (JsonDecoder(), OdometryDecoder()):
        for report in decoder.receive(data):
            pose = report.pose
            assert all(map(isfinite, (*pose.position_m, *pose.covariance)))
            assert abs(hypot(*pose.world_from_body) - 1.0) < 1e-6
            assert 0.0 <= pose.quality <= 1.0
            assert report.stamp_s is None or isfinite(report.stamp_s)


@fuzz_target("gloc3_onboard.sensors.lidar_sources.velodyne")
def velodyne_packets(data: bytes) -> None:
    """Datagrams of a 3D scanner are turns of finite points within its range, or are refused; what is kept is bounded."""
    turns, head = TurnAssembler(0.5, 100.0), 4
    for number in range(3):
        block = b"\xff\xee" + data[head * number : head * number + 2].ljust(2, b"\0") + data[16:].ljust(96, b"\0")[:96]
        for datagram in (data, 12 * block + data[12:16].ljust(4, b"\0") + b"\x37\x22"):
            with suppress(ValueError):
                found = turns.add(packet_of(datagram))
                if found is not None:
                    assert np.isfinite(found.points).all()
                    assert (np.linalg.norm(found.points, axis=1) < 100.1).all()
                    assert len(found.ages_s) in (0, len(found.points))
                    assert ((found.ages_s >= 0.0) & (found.ages_s <= 0.5)).all()


@fuzz_target("gloc3_onboard.sensors.sources.rplidar", "gloc3_onboard.sensors.sources.laser")
def rplidar_turn(data: bytes) -> None:
    """The points of an RPLIDAR's turn, whatever they are, become a scan of 360 beams within its range."""
    numbers = np.frombuffer(data[: len(data) // 4 * 4], "<u2").astype(float).reshape(-1, 2)
    points = [(angle / 64.0, distance / 4.0) for angle, distance in numbers]
    scan = scan_of("laser", points, 0.1, 12.0)
    assert len(scan.ranges_m) == 4 * 360
    found = np.frombuffer(scan.ranges_m, np.float32)
    assert np.isfinite(found).all()
    assert (found >= 0.0).all()
    mounted_scan(0.0, scan, parse_source("laser", "rplidar:///dev/null?yaw_deg=30"))


@fuzz_target("gloc3_onboard.sensors")
def source_url(data: bytes) -> None:
    """Any text is a source with a place that its kind takes, or is refused with a reason."""
    if not data:
        return
    text = data[1:].decode("utf-8", "replace")
    for device in DEVICES:
        for url in (text, f"{SCHEMES[data[0] % len(SCHEMES)]}://{text}"):
            refuses(lambda device=device, url=url: parse_source(device, url))  # type: ignore[misc]


@fuzz_target("gloc3_onboard.calibration", "gloc3.documents")
def calibration_file(data: bytes) -> None:
    """A calibration of any form gives cameras that can be used, or is refused with findings and places."""

    def whole() -> None:
        found = read_calibration(as_file(data), size=(640, 480))
        assert found.cameras
        for model in found.cameras.values():
            assert min(model.focal_px) > 0.0
            assert min(model.width, model.height) > 0
            assert np.isfinite([*model.focal_px, *model.center_px]).all()

    refuses(whole)
