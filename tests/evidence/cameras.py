"""Cameras and payload: pictures of a flight read by other programs, other programs' stations, and a busy writer."""

import asyncio
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from math import cos, degrees, radians, sin
from pathlib import Path
from typing import Any

import cv2
import exifread
import msgspec
import numpy as np
from tests.evidence.page import Bar, Figure, Progress
from tests.evidence.suites import suite

from gloc3.log.reader import LogReader
from gloc3.messages.frames import Quaternion, interpolate, multiply, rotate, slerp
from gloc3.messages.topics import TopicTable
from gloc3.messages.vehicle import Image, ImageRecorded
from gloc3_onboard.components.drivers.image_recorder import RecordedPicture
from gloc3_onboard.process.storage import PictureFolder
from gloc3_sitl.flight.messages import SimTruth
from gloc3_sitl.world.rig import CAMERAS
from gloc3_sitl.world.world import World

GLOC3 = str(Path(sys.executable).with_name("gloc3"))
CAMERA = "front_left"
WALL = "2,13,4.5 10,13,4.5 10,13,1.5 2,13,1.5"
MISSION = """\
mission: colour of the port side
frame: hold
geofence: {polygon_m: [[-2, -2], [20, -2], [20, 12], [-2, 12]], ceiling_m: 8}
on_failure: land
tasks:
  inspect:
    actions:
      climb: {take_off: {height_m: 2}}
      out: {follow_waypoints: {waypoints_m: [[2, 8, 3], [10, 8, 3]], speed_m_s: 0.5, heading: -90}, after: [climb]}
      photos: {record_images: {camera: front_left, every_m: 0.5}, after: [climb], until: out}
      home: {go_to: {position_m: [0, 0, 3]}, after: [out]}
      down: {land: {}, after: [home]}
"""
TESTS = [
    "tests/common/camera/test_picture_file.py",
    "tests/sitl/world/test_colours.py",
    "tests/onboard/process/test_storage.py",
    "tests/onboard/components/drivers/test_image_recorder.py",
    "tests/onboard/components/drivers/test_payload.py",
    "tests/onboard/payload/test_outputs_and_pins.py",
    "tests/flight/test_payload_in_flight.py",
    "tests/flight/test_cameras_of_others.py",
    "tests/onboard/companion/test_cameras_through_the_onboard_process.py",
    "tests/onboard/payload/test_gimbal_link.py",
    "tests/flight/test_gimbal_in_flight.py",
    "tests/onboard/companion/test_gimbal_through_the_onboard_process.py",
    "tests/onboard/video/test_video_streams.py",
    "tests/onboard/video/test_video_poses.py",
    "tests/onboard/video/test_video_through_the_onboard_process.py",
]
MEGAPIXELS = (4000, 3000)
POSITION_M, ANGLE_DEG, TIME_MS, RETURN_MS = 0.2, 1.5, 1.0, 20.0
FRAMES, GREY_LEVELS = 40, 6.0


def flown() -> dict[str, Any]:
    """Flies along a rusty wall and reads its pictures with other programs, against the simulator's truth."""
    with tempfile.TemporaryDirectory() as name:
        out, mission = Path(name) / "run", Path(name) / "mission.yaml"
        mission.write_text(MISSION)
        fly = [GLOC3, "fly", str(mission), "--platform", "pelican", "--out", str(out), "--quiet"]
        subprocess.run(fly, check=True, capture_output=True)
        subprocess.run([GLOC3, "log", "report", str(out), "--wall", WALL], check=True, capture_output=True)
        report = msgspec.json.decode((out / "report/report.json").read_bytes())
        found = against_truth(out)
        files = sorted((out / "images").glob("*.jpg"))
        return {**found, "coverage": report["coverage"], "rust": rust_share(files), "exiftool": exiftool(files)}


def against_truth(out: Path) -> dict[str, Any]:
    """Largest errors of the tags of all pictures."""
    plane, model = World.load("hold").frame.plane, CAMERAS[CAMERA][0]
    truths: list[tuple[float, SimTruth]] = []
    images: list[tuple[float, ImageRecorded]] = []
    with LogReader(out / "log.mcap", TopicTable.installed().types) as reader:
        offset_s = reader.utc_offset_ns / 1e9
        for entry in reader.entries("sim/truth", "image_recorded"):
            payload, t_s = entry.envelope.payload, entry.envelope.t_s
            (images if isinstance(payload, ImageRecorded) else truths).append((t_s, payload))
    times = [t_s for t_s, _ in truths]
    errors: dict[str, list[float]] = {"position_m": [], "angle_deg": [], "time_ms": []}
    for t_s, image in images:
        after = min(max(1, int(np.searchsorted(times, t_s))), len(times) - 1)
        (a_s, a), (b_s, b) = truths[after - 1], truths[after]
        share = (t_s - a_s) / (b_s - a_s)
        attitude = slerp(a.ned_from_frd, b.ned_from_frd, share)
        lever = rotate(attitude, model.position_frd_m)
        true_ned = [x + y for x, y in zip(interpolate(a.position_ned_m, b.position_ned_m, share), lever, strict=True)]
        with (out / "images" / image.file).open("rb") as file:
            data = file.read()
            file.seek(0)
            tags = exifread.process_file(file, details=False)
        ned = plane.ned_from_geo(angle_of(tags, "Latitude"), angle_of(tags, "Longitude"), altitude_of(tags))
        errors["position_m"].append(float(np.linalg.norm(np.subtract(ned, true_ned))))
        errors["angle_deg"].append(angle_between(attitude, model.frd_from_rdf, angles_of(data)))
        text = f"{tags['EXIF DateTimeOriginal']}.{tags['EXIF SubSecTimeOriginal']}"
        moment = datetime.strptime(text, "%Y:%m:%d %H:%M:%S.%f").replace(tzinfo=UTC)
        errors["time_ms"].append(abs(moment.timestamp() - t_s - offset_s) * 1e3)
    return {"pictures": len(images), **{name: max(values) for name, values in errors.items()}}


def angle_of(tags: dict[str, Any], name: str) -> float:
    whole, minutes, seconds = map(float, tags[f"GPS GPS{name}"].values)
    sign = -1.0 if str(tags[f"GPS GPS{name}Ref"]) in "SW" else 1.0
    return sign * (whole + minutes / 60.0 + seconds / 3600.0)


def altitude_of(tags: dict[str, Any]) -> float:
    return float(tags["GPS GPSAltitude"].values[0])


def angles_of(data: bytes) -> list[float]:
    """Yaw, pitch and roll of the XMP."""
    return [float(data.split(f'Camera:{name}="'.encode())[1].split(b'"')[0]) for name in ("Yaw", "Pitch", "Roll")]


def angle_between(ned_from_frd: Quaternion, frd_from_rdf: Quaternion, angles_deg: list[float]) -> float:
    """Angle between the true attitude of the camera and that of the tags, by Pix4D's convention written out."""
    seen = multiply(ned_from_frd, frd_from_rdf)
    right, down, ahead = (np.array(rotate(seen, axis)) for axis in ((1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0)))
    true = np.column_stack([-down, right, ahead])
    (cy, sy), (cp, sp), (cr, sr) = ((cos(radians(angle)), sin(radians(angle))) for angle in angles_deg)
    yaw = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    pitch = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    roll = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    cosine = (np.trace(true.T @ yaw @ pitch @ roll) - 1.0) / 2.0
    return degrees(float(np.arccos(np.clip(cosine, -1.0, 1.0))))


def rust_share(files: list[Path]) -> float:
    """Share of the pixels that are redder than any paint of the hold, read by OpenCV."""
    shares = []
    for file in files:
        pixels = cv2.imread(str(file), cv2.IMREAD_COLOR)
        assert pixels is not None
        blue, _, red = (pixels[:, :, channel].astype(float) for channel in range(3))
        shares.append(float((red > 1.5 * np.maximum(blue, 1.0)).mean()))
    return sum(shares) / len(shares)


def exiftool(files: list[Path]) -> dict[str, Any]:
    """What ExifTool says of the pictures; empty where it is not installed."""
    if shutil.which("exiftool") is None:
        return {}
    command = [
        "exiftool",
        "-j",
        "-n",
        "-warning",
        "-error",
        "-GPSLatitude",
        "-FocalLengthIn35mmFormat",
        "-XMP-Camera:Yaw",
    ]
    rows = msgspec.json.decode(subprocess.run([*command, *map(str, files)], check=True, capture_output=True).stdout)
    version = subprocess.run(["exiftool", "-ver"], check=True, capture_output=True, text=True).stdout.strip()
    whole = [row for row in rows if {"GPSLatitude", "FocalLengthIn35mmFormat", "Yaw"} <= row.keys()]
    return {
        "version": version,
        "read": len(whole),
        "warnings": sum("Warning" in row or "Error" in row for row in rows),
    }


def written() -> dict[str, float]:
    """How long the recorder's cycle is held by pictures of twelve megapixels, with the thread and without, ms."""
    width, height = MEGAPIXELS
    pixels = np.random.default_rng(1).integers(0, 255, (height // 8, width // 8, 3), np.uint8)
    bgr = cv2.resize(pixels, MEGAPIXELS, interpolation=cv2.INTER_CUBIC)
    grey = cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY)
    image = Image(camera="c", width=width, height=height, data=grey.tobytes(), bgr=bgr.tobytes())
    found: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as name, ThreadPoolExecutor(1) as worker:
        for kind, one in (("thread", worker), ("none", None)):
            folder = PictureFolder(Path(name) / kind, worker=one)
            held = []
            for number in range(1, 6):
                picture = RecordedPicture(f"c-{number:05d}.jpg", 1.0, image, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
                begin_s = time.perf_counter()
                folder.write(picture)
                held.append((time.perf_counter() - begin_s) * 1e3)
            found[kind] = max(held)
    return found


def streamed() -> dict[str, float]:
    """Pictures of a camera, streamed over RTSP and read by OpenCV: how far they differ from those taken."""
    from tests.onboard.video.test_video_streams import nearest, seen_by_opencv, serving

    async def watched() -> list[Any]:
        async with serving() as scene:
            return await asyncio.to_thread(seen_by_opencv, scene.url(), FRAMES)

    frames = asyncio.run(watched())
    return {"frames": len(frames), "difference": max(nearest(frame) for frame in frames)}


def run(progress: Progress) -> list[Figure]:
    """The bar."""
    flight, disk = progress.part("flight", flown), progress.part("disk", written)
    video = progress.part("video", streamed)
    other = flight["exiftool"]
    count = flight["pictures"]
    figures = [
        Figure("pictures of the flight, in colour, as JPEG", str(count), "> 15", count > 15),
        Figure(
            "largest error of the EXIF position, of the camera, against the simulator's truth",
            f"{flight['position_m']:.3f} m",
            f"< {POSITION_M:g} m",
            flight["position_m"] < POSITION_M,
        ),
        Figure(
            "largest error of the XMP attitude (Pix4D's yaw, pitch, roll), likewise",
            f"{flight['angle_deg']:.2f}°",
            f"< {ANGLE_DEG:g}°",
            flight["angle_deg"] < ANGLE_DEG,
        ),
        Figure(
            "largest error of the EXIF time",
            f"{flight['time_ms']:.3f} ms",
            f"< {TIME_MS:g} ms",
            flight["time_ms"] < TIME_MS,
        ),
        Figure(
            "pixels that are rust-coloured",
            f"{100 * flight['rust']:.0f} %",
            "5 to 50 %",
            0.05 < flight["rust"] < 0.5,
        ),
        Figure("wall seen, by the inspection report", f"{100 * flight['coverage']:.1f} %"),
        Figure(
            f"pictures that ExifTool {other.get('version', '')} reads with position, focal length and yaw",
            f"{other['read']} of {count}, {other['warnings']} with warnings" if other else "exiftool is not installed",
            "all, no warning",
            not other or (other["read"] == count and not other["warnings"]),
        ),
        Figure(
            "a picture of 12 megapixels holds the recorder's cycle, at most, with the writer's thread",
            f"{disk['thread']:.1f} ms",
            f"< {RETURN_MS:g} ms",
            disk["thread"] < RETURN_MS,
        ),
        Figure("without it", f"{disk['none']:.0f} ms"),
        Figure(
            f"largest mean difference of {video['frames']:.0f} frames, streamed over RTSP and read by OpenCV, from the "
            "camera's pictures",
            f"{video['difference']:.1f} of 255 levels",
            f"< {GREY_LEVELS:g}",
            video["difference"] < GREY_LEVELS,
        ),
    ]
    return figures + suite("cameras", TESTS)(progress)


BARS = (
    Bar(
        name="cameras",
        title="Pictures carry time, position and attitude, and other programs read them",
        claim="Pictures of a flight are in colour and carry time, position and attitude, which other programs read; "
        "MAVSDK and QGroundControl's sequence find and shoot the camera, and find and steer the gimbal; OpenCV reads the "
        "video, and FFmpeg the poses beside it; missions point the gimbal and move servos, grippers, relays and winches. Nothing of this was tried on "
        "hardware: no V4L2, GPIO or PWM device, no gripper or gimbal, and no photogrammetry program.",
        run=run,
    ),
)
