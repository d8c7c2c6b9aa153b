"""Compares what recorded images show with what the truth says that they must show."""

import bisect
import json
from pathlib import Path
from typing import Any

import cv2
import msgspec

from gloc3.log.reader import LogReader
from gloc3.messages.frames import interpolate, slerp
from gloc3_sitl.flight.messages import SimTruth
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.world import World
from gloc3_sitl.world.camera import SimulatedCamera
from gloc3_sitl.world.rig import GROUND, GROUND_IMAGER

MUST_MARGIN_PX = 8.0
"""A marker that lies so far inside the image by the truth must be found."""
NEVER_MARGIN_PX = -80.0
"""A marker that lies so far outside, by half its side, cannot be found; with its rim cut off the detector still reads it."""


def compare(out: Path) -> dict[str, int]:
    """Counts images that must show the marker, that do, and that show it though it is out of view."""
    world = World.load("hold")
    camera = SimulatedCamera(world, GROUND, GROUND_IMAGER)
    with LogReader(_truth_log(out)) as reader:
        truths = [
            (entry.envelope.t_s, entry.envelope.payload)
            for entry in reader.entries("sim/truth")
            if isinstance(entry.envelope.payload, SimTruth)
        ]
    times = [t_s for t_s, _ in truths]
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    counts = {"must": 0, "shown": 0, "false": 0, "images": 0}
    for line in (out / "images" / "poses.jsonl").read_text().splitlines():
        tag = json.loads(line)
        index = min(max(bisect.bisect_left(times, tag["t_s"]), 1), len(truths) - 1)
        (before_s, before), (after_s, after) = truths[index - 1 : index + 1]
        share = min(1.0, (tag["t_s"] - before_s) / (after_s - before_s))
        truth = _as_truth(_between(before, after, share), world)
        image = cv2.imread(str(out / "images" / tag["file"]), cv2.IMREAD_GRAYSCALE)
        assert image is not None
        _, ids, _ = detector.detectMarkers(image)
        is_seen = ids is not None and world.marker is not None and world.marker.id in ids
        counts["images"] += 1
        if camera.marker_in_view(truth, MUST_MARGIN_PX):
            counts["must"] += 1
            counts["shown"] += bool(is_seen)
        elif is_seen and not camera.marker_in_view(truth, NEVER_MARGIN_PX):
            counts["false"] += 1
    return counts


def _truth_log(out: Path) -> Path:
    """Three processes keep the truth in a log of its own, one process in its only one."""
    return out / "truth.mcap" if (out / "truth.mcap").exists() else out / "log.mcap"


def _between(a: SimTruth, b: SimTruth, share: float) -> SimTruth:
    """Where the vehicle was between two lines of the log, which are 0.1 s apart: at 1.5 m/s that is 30 pixels."""
    return msgspec.structs.replace(
        a,
        position_ned_m=interpolate(a.position_ned_m, b.position_ned_m, share),
        ned_from_frd=slerp(a.ned_from_frd, b.ned_from_frd, share),
    )


def _as_truth(message: SimTruth, world: World) -> Truth:
    place = world.frame.plane.geo_from_ned(message.position_ned_m)
    fields: dict[str, Any] = dict.fromkeys(("t_s", "height_above_ground_m", "power_w"), 0.0)
    return Truth(
        **fields,
        position_ned_m=message.position_ned_m,
        velocity_ned_m_s=message.velocity_ned_m_s,
        attitude_wxyz=message.ned_from_frd,
        rate_frd_rad_s=(0.0, 0.0, 0.0),
        specific_force_frd_m_s2=(0.0, 0.0, 0.0),
        latitude_deg=place.latitude_deg,
        longitude_deg=place.longitude_deg,
        altitude_m=place.altitude_m,
        is_on_ground=False,
        wind_ned_m_s=(0.0, 0.0, 0.0),
        standing_height_m=0.0973,
    )
