"""AD: writes pictures to disk, by distance or by time, each with the pose that it was taken from."""

import math
from collections import deque
from collections.abc import Sequence
from typing import ClassVar, Final, NamedTuple, Protocol

from gloc3.component.action import ActionPerformer
from gloc3.component.component import ActuatorDriver
from gloc3.component.ports import Actuation, Inbox, Input, Keep, Output, Result
from gloc3.component.settings import NoSettings
from gloc3.errors import Refused
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import Quaternion, Vector3, interpolate, slerp
from gloc3.messages.vehicle import Image, ImageRecorded, Pose
from gloc3.mission.model.arguments import RecordImages
from gloc3.mission.model.states import ActionState


class RecordedPicture(NamedTuple):
    """A picture to write."""

    file: str
    t_s: float
    image: Image
    position_ned_m: Vector3
    ned_from_frd: Quaternion


class PictureStore(Protocol):
    """A folder for pictures."""

    def highest(self, camera: str) -> int:
        """The greatest number of a camera's picture that is there already; 0 for none."""

    def write(self, picture: RecordedPicture) -> None:
        """Writes a picture with its pose; raises `OSError` where that fails."""


POSE_GAP_S: Final = 0.25
"""A picture is tagged only with poses that are no farther from its time, and no farther apart."""


SILENT_S: Final = 2.0
"""Time without a picture after which this is reported, s."""


class ImageRecorder(ActionPerformer, ActuatorDriver[NoSettings]):
    """Performs `record_images` for its cameras, one picture at a time."""

    performs: ClassVar = {"record_images": RecordImages}
    loggable = ("recorded",)

    image = Input(Image, Keep.ALL)
    pose = Input(Pose, Keep.ALL)
    image_recorded = Output(ImageRecorded)

    def __init__(self, device: PictureStore) -> None:
        self.recorded = 0
        """Number of the last picture."""
        self._store = device
        self._order: RecordImages | None = None
        self._in_action = 0
        self._last_s = -math.inf
        self._last_ned_m: Vector3 | None = None
        self._numbers: dict[str, int] = {}
        """Of the last picture of each camera that is known."""
        self._came_s = 0.0
        self._poses: deque[Envelope[Pose]] = deque(maxlen=32)

    def start(self) -> None:
        """Begins without poses of before."""
        self._poses.clear()

    def stop(self) -> None:
        """Forgets the action."""
        self.drop_action()

    def begin_action(self, capability: str, arguments: RecordImages, now_s: float) -> None:
        """The first picture is taken at once; those of an earlier attempt count."""
        if self._numbers and arguments.camera not in self._numbers:
            names = ", ".join(map(repr, sorted(self._numbers)))
            raise Refused(f"this recorder has camera {names}, not {arguments.camera!r}")
        self._order, self._came_s = arguments, now_s
        count = arguments.count or 0
        self._in_action = min(int(self.earlier_progress * count + 1e-6), max(count - 1, 0))
        self._last_s, self._last_ned_m = -math.inf, None

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Takes a picture if one is due."""
        results: list[Result] = []
        self._poses.extend(envelope for envelope in inbox.new(self.pose) if envelope.payload.is_valid)
        for envelope in inbox.new(self.image):
            if not envelope.payload.is_valid:
                continue
            self._add_calibration(envelope.payload.camera)
            order = self._order
            if self.is_running and order is not None and order.camera == envelope.payload.camera:
                self._came_s = now_s
                results += self._record(order, envelope, now_s)
        if self.is_running and self._order is not None and now_s - self._came_s > SILENT_S:
            self.advance(now_s, self._progress(self._order), reason=f"no picture of {self._order.camera} received")
        return [*results, *self.action_reports(now_s)]

    def _add_calibration(self, camera: str) -> None:
        """Continues the numbering of earlier runs; no picture is overwritten."""
        if camera not in self._numbers:
            self._numbers[camera] = self._store.highest(camera)

    def _progress(self, order: RecordImages) -> float:
        return self._in_action / order.count if order.count else 0.0

    def _record(self, order: RecordImages, envelope: Envelope[Image], now_s: float) -> list[Result]:
        progress = self._progress(order)
        place = self._place(envelope.t_s)
        if place is None:
            self.advance(now_s, progress, reason="there is no valid pose at the time of the picture")
            return []
        position, ned_from_frd = place
        if not self._is_due(order, envelope.t_s, position):
            self.advance(now_s, progress)
            return []
        action_id = self.action_id
        self._last_s, self._last_ned_m = envelope.t_s, position
        self.recorded = self._numbers[order.camera] = self._numbers[order.camera] + 1
        self._in_action += 1
        file = f"{order.camera}-{self.recorded:05d}.png"
        is_done = order.count is not None and self._in_action >= order.count
        progress = self._progress(order)
        state = ActionState.DONE if is_done else ActionState.RUNNING
        self.advance(now_s, progress, state, achieved=self._in_action if order.count else None)
        picture = RecordedPicture(file, envelope.t_s, envelope.payload, position, ned_from_frd)
        recorded = ImageRecorded(
            action_id=action_id,
            camera=order.camera,
            file=file,
            index=self.recorded,
            position_ned_m=position,
            ned_from_frd=ned_from_frd,
        )
        return [Actuation(picture), self.image_recorded.report(recorded, t_s=envelope.t_s)]

    def _place(self, t_s: float) -> tuple[Vector3, Quaternion] | None:
        """Where the camera's vehicle was at a time: between two poses, or a little after the last."""
        before = next((pose for pose in reversed(self._poses) if pose.t_s <= t_s), None)
        after = next((pose for pose in self._poses if pose.t_s >= t_s), None)
        if before is None or after is None:
            nearest = before or after
            if nearest is None or abs(t_s - nearest.t_s) > POSE_GAP_S:
                return None
            pose, ahead_s = nearest.payload, t_s - nearest.t_s
            return _plus(pose.position_ned_m, pose.velocity_ned_m_s, ahead_s), pose.ned_from_frd
        gap_s = after.t_s - before.t_s
        if gap_s > POSE_GAP_S or before.payload.reset_counter != after.payload.reset_counter:
            near = before if t_s - before.t_s <= after.t_s - t_s else after
            if abs(t_s - near.t_s) > POSE_GAP_S:
                return None
            return near.payload.position_ned_m, near.payload.ned_from_frd
        share = (t_s - before.t_s) / gap_s if gap_s > 0.0 else 0.0
        a, b = before.payload, after.payload
        return interpolate(a.position_ned_m, b.position_ned_m, share), slerp(a.ned_from_frd, b.ned_from_frd, share)

    def _is_due(self, order: RecordImages, t_s: float, position: Vector3) -> bool:
        if self._last_ned_m is None:
            return True
        if order.every_s is not None:
            return t_s - self._last_s >= order.every_s - 1e-6
        return math.dist(position, self._last_ned_m) >= (order.every_m or 0.0)

    def actuate(self, write: RecordedPicture) -> None:
        """Writes a picture."""
        self._store.write(write)

    def make_safe(self) -> None:
        """A folder is always safe."""


def _plus(a: Vector3, b: Vector3, share: float) -> Vector3:
    return (a[0] + b[0] * share, a[1] + b[1] * share, a[2] + b[2] * share)
