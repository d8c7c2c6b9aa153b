"""A scripted platform's viewer: it shows a pose, a height, a scan and a camera to whoever looks."""

import math
from typing import Any

import cv2
import numpy as np

from gloc3.exchange import LocalExchange, Publisher
from gloc3.messages.envelope import Envelope, Message, Source
from gloc3.messages.frames import from_euler
from gloc3.messages.vehicle import HeightAboveGround, Pose
from gloc3.messages.watch import Preview, TopicActivity, TopicEntry, pack
from gloc3.messages.wire import type_name

from .scripted_platform import ScriptedPlatform

TOPICS = [
    TopicEntry("autopilot", "AutopilotState", 5.0, "autopilot_state"),
    TopicEntry("height", "HeightAboveGround", 20.0, "height"),
    TopicEntry("camera/ground", "Image", 2.0, "ground_camera"),
    TopicEntry("pose", "Pose", 20.0, "pose"),
    TopicEntry("components/pose/internal", "InternalState", 20.0, "pose"),
    TopicEntry("setpoint_wanted/waypoints", "Setpoint", 20.0, "waypoints"),
    TopicEntry("action_status/waypoints", "ActionStatus", 0.0, "waypoints"),
    TopicEntry("setpoint", "Setpoint", 20.0, "limiter"),
    TopicEntry("driver", "DriverState", 5.0, "autopilot_driver"),
]


class Viewer:
    """What `ScriptedPlatform` shows."""

    def __init__(self, exchange: LocalExchange, platform: ScriptedPlatform) -> None:
        platform.topics = TOPICS
        self.platform = platform
        self.publisher = Publisher(exchange, platform.name, "viewer", 9)
        self.count = 0

    def show(self, topic: str, message: Message, t_s: float, rate_hz: float = 20.0) -> None:
        name = self.platform.name
        envelope: Envelope[Any] = Envelope(
            f"{name}/{topic}", Source(name, "somebody", 3), self.count, t_s, "ned", type_name(type(message)), message
        )
        self.count += 1
        way = "large" if isinstance(message, Preview) else "sample"
        sample = pack(envelope, message, rate_hz, ("255",))
        self.publisher.publish(f"{name}/watch/{way}/{topic}", sample, t_s)

    def tell_activity(self) -> None:
        rates = [50, 200, 20, 200, 200, 0, 0, 200, 50]
        ages = [1, 0, 3, 0, 0, 62, -1, 0, 1]
        activity = TopicActivity(rates=rates, ages=ages)
        self.publisher.publish(f"{self.platform.name}/watch/activity", activity, 0.0)

    def fly(self, seconds: float, rate_hz: float = 5.0) -> None:
        """A circle, as far as it is looked at."""
        wanted = {want.topic for want in self.platform.watched.wants}
        for step in range(round(seconds * rate_hz)):
            t_s = step / rate_hz
            if "pose" in wanted:
                self.show("pose", pose(t_s), t_s)
            if "height" in wanted:
                height_m = 2.0 + 0.3 * math.sin(0.7 * t_s)
                self.show("height", HeightAboveGround(height_m=height_m, is_valid=True), t_s)
            if "camera/ground" in wanted and step % rate_hz == 0:
                self.show("camera/ground", preview(t_s), t_s, 2.0)


def pose(t_s: float) -> Pose:
    angle = 0.3 * t_s
    return Pose(
        position_ned_m=(4.0 * math.cos(angle), 4.0 * math.sin(angle), -2.0 - 0.2 * math.sin(2.0 * angle)),
        velocity_ned_m_s=(-1.2 * math.sin(angle), 1.2 * math.cos(angle), 0.0),
        ned_from_frd=from_euler(0.0, 0.0, angle),
        position_std_m=(0.05, 0.05, 0.08),
        sources=["autopilot", "stereo"],
        origin_geo=(39.5528, 2.6285, 2.0),
    )


def preview(t_s: float = 0.0, width: int = 64, height: int = 48) -> Preview:
    """Rivets on plates, and a stain."""
    y, x = np.mgrid[0:height, 0:width]
    grey = 110 + 40 * ((x // 16 + y // 12) % 2) + 20 * np.sin((x + 4.0 * t_s) / 9.0)
    grey = np.where((x - 40) ** 2 + (y - 20) ** 2 < 60, 30, grey)
    grey = np.where((x % 8 == 2) & (y % 12 == 5), 245, grey)
    _, data = cv2.imencode(".webp", grey.astype(np.uint8), [cv2.IMWRITE_WEBP_QUALITY, 60])
    return Preview(camera="ground", width=width, height=height, full_width=640, full_height=480, data=data.tobytes())
