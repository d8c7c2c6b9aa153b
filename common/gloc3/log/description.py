"""Description of a run that each of its log files holds: files, frames and calibrations; and the layout beside them."""

from collections.abc import Iterator, Mapping
from math import radians
from pathlib import Path
from typing import Any, Final

import msgspec

from gloc3.camera.model import CameraModel
from gloc3.log.foxglove.layout import LAYOUT_FILE, SCENE_TOPICS, layout
from gloc3.log.foxglove.scene import CALIBRATION_SCHEMA, calibration
from gloc3.log.foxglove.schemas import NED_FRAME, body_frame, transform
from gloc3.log.record import CAMERAS_FILE, PLATFORM_FILE, Recorder
from gloc3.log.selection import period_s
from gloc3.messages.frames import Quaternion, Vector3, from_euler, multiply
from gloc3.messages.topics import TopicTable
from gloc3.platform.platform import Platform

FRD_FROM_SCAN: Final[Quaternion] = (0.0, 1.0, 0.0, 0.0)
"""A scanner's own axes are forward, left, up."""


class RunDescription:
    """What is known of a run before it begins.

    Args:
        platform: the platform file.
        text: its text, with all that it extends.
        cameras: the models of the cameras, as the components have them.
        others: further files for the log, by name.
    """

    def __init__(
        self,
        platform: Platform,
        text: str,
        cameras: Mapping[str, CameraModel],
        others: Mapping[str, bytes] | None = None,
    ) -> None:
        self._platform, self._cameras = platform, cameras
        self._files = {PLATFORM_FILE: text.encode(), CAMERAS_FILE: msgspec.json.encode(cameras), **(others or {})}
        self.chosen: Final = platform.log
        """Topics that are recorded differently from their rows."""

    def write(self, recorder: Recorder) -> None:
        """Writes it into a log that begins."""
        for name, data in self._files.items():
            recorder.attach_file(name, data)
        recorder.write_transforms(list(self._transforms()))
        for name, model in self._cameras.items():
            recorder.show(f"calibration/{name}", CALIBRATION_SCHEMA, calibration(name, model))

    def write_layout(self, folder: Path, topics: TopicTable) -> None:
        """Writes the layout for Foxglove beside the logs.

        Raises:
            OSError: the folder cannot be written.
        """
        platform = self._platform

        def is_recorded(topic: str) -> bool:
            return period_s(topic, topics.row(f"{platform.platform}/{topic}"), platform.log) is not None

        published = {
            topic for row in platform.components for port in row.load_class().outputs for topic in row.topics(port)
        }
        cameras = [name for name in self._cameras if is_recorded(f"camera/{name}")]
        clouds = sorted(topic for topic in published if topic.startswith("cloud/"))
        scene = [topic for topic in (*SCENE_TOPICS, *clouds) if topic in published and is_recorded(topic)]
        (folder / LAYOUT_FILE).write_bytes(layout(platform.platform, cameras, scene))

    def _transforms(self) -> Iterator[dict[str, Any]]:
        """Where cameras and scanners are: on the body, or where a follower says that its camera stands."""
        body = body_frame(self._platform.platform)
        standing = dict(self._standing())
        for name, model in self._cameras.items():
            if name in standing:
                position, rotation = standing[name]
                yield transform(NED_FRAME, name, position, multiply(rotation, model.frd_from_rdf))
            else:
                yield transform(body, name, model.position_frd_m, model.frd_from_rdf)
        for row in self._platform.components:
            mount = row.settings.get("mount_frd_m")
            if mount is not None and any("laser" in row.topics(port) for port in row.triggers):
                yield transform(body, "laser", tuple(mount), FRD_FROM_SCAN)
                break

    def _standing(self) -> Iterator[tuple[str, tuple[Vector3, Quaternion]]]:
        """Cameras that do not fly: where their component's settings have them."""
        for row in self._platform.components:
            position, euler_deg = row.settings.get("position_ned_m"), row.settings.get("euler_deg")
            if position is not None and euler_deg is not None:
                roll, pitch, yaw = map(radians, euler_deg)
                for topic in (each for port in row.ports for each in row.topics(port)):
                    name = topic.removeprefix("camera/")
                    if name != topic:
                        yield name, (tuple(position), from_euler(roll, pitch, yaw))
