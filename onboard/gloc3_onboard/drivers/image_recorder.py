"""AD: writes pictures to disk, by distance or by time, each with the pose that it was taken from."""

import math
from collections.abc import Sequence
from typing import ClassVar, NamedTuple, Protocol

from gloc3.action import ActionPerformer
from gloc3.component import ActuatorDriver
from gloc3.errors import Refused
from gloc3.frames import Vector3
from gloc3.messages import Envelope
from gloc3.mission.arguments import RecordImages
from gloc3.mission.states import ActionState
from gloc3.ports import Actuation, Inbox, Input, Output, Result
from gloc3.settings import NoSettings
from gloc3.vehicle import Image, ImageRecorded, Pose


class Picture(NamedTuple):
    """A picture to write."""

    file: str
    t_s: float
    image: Image
    position_ned_m: Vector3
    ned_from_frd: tuple[float, float, float, float]


class PictureStore(Protocol):
    """Where pictures go: a folder."""

    def write(self, picture: Picture) -> None:
        """Writes a picture with its pose; raises `OSError` where that fails."""


class ImageRecorder(ActionPerformer, ActuatorDriver[NoSettings]):
    """Performs `record_images` for one camera."""

    performs: ClassVar = {"record_images": RecordImages}
    loggable = ("recorded",)

    image = Input(Image)
    pose = Input(Pose)
    image_recorded = Output(ImageRecorded)

    def __init__(self, device: PictureStore) -> None:
        self.recorded = 0
        self._store = device
        self._order: RecordImages | None = None
        self._in_action = 0
        self._last_s = -math.inf
        self._last_ned_m: Vector3 | None = None
        self._camera = ""

    def stop(self) -> None:
        """Forgets the action."""
        self.drop_action()

    def begin_action(self, capability: str, arguments: RecordImages, now_s: float) -> None:
        """The first picture is taken at once."""
        if self._camera and arguments.camera != self._camera:
            raise Refused(f"this recorder has camera {self._camera!r}, not {arguments.camera!r}")
        self._order = arguments
        self._in_action = 0
        self._last_s, self._last_ned_m = -math.inf, None

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Takes a picture if one is due."""
        results: list[Result] = []
        pose = inbox.latest(self.pose)
        for envelope in inbox.new(self.image):
            self._camera = envelope.payload.camera
            if self.is_running and self._order is not None and pose is not None and envelope.payload.is_valid:
                results += self._record(self._order, envelope, pose.payload, now_s)
        return [*results, *self.action_reports(now_s)]

    def _record(self, order: RecordImages, envelope: Envelope[Image], pose: Pose, now_s: float) -> list[Result]:
        if not pose.is_valid or not self._is_due(order, envelope.t_s, pose.position_ned_m):
            return []
        action_id = self.action_id
        self._last_s, self._last_ned_m = envelope.t_s, pose.position_ned_m
        self.recorded += 1
        self._in_action += 1
        file = f"{envelope.payload.camera}-{self.recorded:05d}.png"
        is_done = order.count is not None and self._in_action >= order.count
        progress = self._in_action / order.count if order.count else 0.0
        self.advance(now_s, progress, ActionState.DONE if is_done else ActionState.RUNNING)
        picture = Picture(file, envelope.t_s, envelope.payload, pose.position_ned_m, pose.ned_from_frd)
        recorded = ImageRecorded(
            action_id=action_id,
            camera=envelope.payload.camera,
            file=file,
            index=self.recorded,
            position_ned_m=pose.position_ned_m,
            ned_from_frd=pose.ned_from_frd,
        )
        return [Actuation(picture), self.image_recorded.report(recorded, t_s=envelope.t_s)]

    def _is_due(self, order: RecordImages, t_s: float, position: Vector3) -> bool:
        if self._last_ned_m is None:
            return True
        if order.every_s is not None:
            return t_s - self._last_s >= order.every_s - 1e-6
        return math.dist(position, self._last_ned_m) >= (order.every_m or 0.0)

    def actuate(self, write: Picture) -> None:
        """Writes a picture."""
        self._store.write(write)

    def make_safe(self) -> None:
        """A folder is always safe."""
