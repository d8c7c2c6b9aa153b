"""AD: writes pictures to disk, by distance or by time, each with the pose that it was taken from."""

import math
from collections import deque
from collections.abc import Callable, Container, Sequence
from enum import StrEnum
from typing import Annotated, ClassVar, Final, NamedTuple, Protocol

from msgspec.structs import replace

from gloc3.camera.picture_file import JPEG, PNG
from gloc3.component.action import ActionPerformer
from gloc3.component.component import ActuatorDriver
from gloc3.component.ports import Actuation, Inbox, Input, Keep, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.errors import Refused
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import Quaternion, Vector3, interpolate, slerp
from gloc3.messages.vehicle import GimbalState, Image, ImageRecorded, Pose
from gloc3.mission.model.payload import RecordImages
from gloc3.mission.model.states import ActionState


class RecordedPicture(NamedTuple):
    """A picture to write."""

    file: str
    """Its name; the suffix `.jpg` or `.png` is its format."""
    t_s: float
    image: Image
    position_ned_m: Vector3
    ned_from_frd: Quaternion
    origin_geo: tuple[float, float, float] | None = None
    """Origin of the position, where it is on Earth."""
    position_std_m: Vector3 = (0.0, 0.0, 0.0)
    """Standard deviation of the position."""
    quality: int = 95
    """Of JPEG, 1 to 100."""
    action_id: str = ""
    """The action that it was taken for."""


class PictureStore(Protocol):
    """A folder for pictures, which are written in another thread, or at once in virtual time."""

    def highest(self, camera: str) -> int:
        """The greatest number of a camera's picture that is there already; 0 for none."""

    def write(self, picture: RecordedPicture) -> None:
        """Begins to write a picture with its pose."""

    def written(self, cameras: Container[str]) -> list[RecordedPicture]:
        """The pictures of some cameras that have been written since the last call, in their order.

        Raises:
            OSError: a picture could not be written.
        """

    def on_written(self, ready: Callable[[], None]) -> Callable[[], None]:
        """Has `ready` called, from any thread, when a picture has been written; returns a function that ends this."""


class PictureFormat(StrEnum):
    """Format of picture files."""

    JPEG = "jpeg"
    PNG = "png"


class RecorderSettings(Settings, frozen=True):
    """Settings of the recorder."""

    format: PictureFormat = PictureFormat.JPEG
    """`jpeg`, which photogrammetry programs read with its tags, or `png`, which loses nothing and is five times larger."""
    quality: Annotated[int, Bounds(50, 100)] = 95
    """Quality of JPEG."""
    on_gimbal: tuple[str, ...] = ()
    """Cameras on the gimbal, whose pictures get its attitude in place of the vehicle's."""


MOST_WAITING: Final = 16
"""Pictures that may wait to be written; while there are so many, no further ones are taken."""


POSE_GAP_S: Final = 0.25
"""A picture is tagged only with poses that are no farther from its time, and no farther apart."""


SILENT_S: Final = 2.0
"""Time without a picture after which this is reported, s."""


class ImageRecorder(ActionPerformer, ActuatorDriver[RecorderSettings]):
    """Performs `record_images` for its cameras, one picture at a time.

    A picture is reported, and counts, once it is on the disk.
    """

    performs: ClassVar = {"record_images": RecordImages}
    loggable = ("recorded", "waiting")

    image = Input(Image, Keep.ALL)
    pose = Input(Pose, Keep.ALL)
    gimbal = Input(GimbalState, Keep.ALL, is_optional=True)
    image_recorded = Output(ImageRecorded)

    def __init__(self, device: PictureStore) -> None:
        self.recorded = 0
        """Number of the last picture."""
        self.waiting = 0
        """Pictures taken that are not written yet."""
        self._store = device
        self._order: RecordImages | None = None
        self._taken = self._in_action = 0
        """Pictures of this action: taken, and written."""
        self._unwatch: Callable[[], None] = lambda: None
        self._last_s = -math.inf
        self._last_ned_m: Vector3 | None = None
        self._numbers: dict[str, int] = {}
        """Of the last picture of each camera that is known."""
        self._came_s = 0.0
        self._poses: deque[Envelope[Pose]] = deque(maxlen=32)
        self._gimbal: deque[Envelope[GimbalState]] = deque(maxlen=32)

    def start(self) -> None:
        """Begins without poses of before."""
        self._poses.clear()
        self._gimbal.clear()
        self.waiting = 0
        self._unwatch()
        self._unwatch = self._store.on_written(self.request_cycle)

    def stop(self) -> None:
        """Forgets the action; pictures that wait are still written."""
        self._unwatch()
        self.drop_action()

    def begin_action(self, capability: str, arguments: RecordImages, now_s: float) -> None:
        """The first picture is taken at once; those of an earlier attempt count."""
        if self._numbers and arguments.camera not in self._numbers:
            names = ", ".join(map(repr, sorted(self._numbers)))
            raise Refused(f"this recorder has camera {names}, not {arguments.camera!r}")
        self._order, self._came_s = arguments, now_s
        count = arguments.count or 0
        self._in_action = self._taken = min(int(self.earlier_progress * count + 1e-6), max(count - 1, 0))
        self._last_s, self._last_ned_m = -math.inf, None

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Takes a picture if one is due."""
        results: list[Result] = self._reports(now_s)
        self._poses.extend(envelope for envelope in inbox.new(self.pose) if envelope.payload.is_valid)
        self._gimbal.extend(envelope for envelope in inbox.new(self.gimbal) if envelope.payload.is_attitude_valid)
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

    def _reports(self, now_s: float) -> list[Result]:
        """Reports what has been written, and counts it for its action."""
        results: list[Result] = []
        for picture in self._store.written(self._numbers):
            self.waiting = max(0, self.waiting - 1)
            camera, _, number = picture.file.partition(".")[0].rpartition("-")
            recorded = ImageRecorded(
                action_id=picture.action_id,
                camera=camera,
                file=picture.file,
                index=int(number),
                position_ned_m=picture.position_ned_m,
                ned_from_frd=picture.ned_from_frd,
            )
            results.append(self.image_recorded.report(recorded, t_s=picture.t_s))
            self._in_action += picture.action_id == self.action_id
        if results and self.is_running and self._order is not None:
            self._count(self._order, now_s)
        return results

    def _count(self, order: RecordImages, now_s: float) -> None:
        """Reports how many pictures of the action have been written; the last one ends it."""
        is_done = order.count is not None and self._in_action >= order.count
        state = ActionState.DONE if is_done else ActionState.RUNNING
        self.advance(now_s, self._progress(order), state, achieved=self._in_action if order.count else None)

    def _record(self, order: RecordImages, envelope: Envelope[Image], now_s: float) -> list[Result]:
        progress = self._progress(order)
        if order.count is not None and self._taken >= order.count:
            self._count(order, now_s)
            return []
        pose = self._pose_at(envelope.t_s)
        if pose is None:
            self.advance(now_s, progress, reason="there is no valid pose at the time of the picture")
            return []
        attitude: Quaternion | None = pose.ned_from_frd
        if order.camera in self.settings.on_gimbal:
            attitude = self._gimbal_at(envelope.t_s)
        if attitude is None:
            self.advance(now_s, progress, reason="the gimbal's attitude at the time of the picture is not known")
            return []
        if not self._is_due(order, envelope.t_s, pose.position_ned_m):
            self.advance(now_s, progress)
            return []
        if self.waiting >= MOST_WAITING:
            self.advance(now_s, progress, reason=f"the disk is too slow: {self.waiting} pictures wait to be written")
            return []
        self.advance(now_s, progress)
        self._last_s, self._last_ned_m = envelope.t_s, pose.position_ned_m
        self.recorded = self._numbers[order.camera] = self._numbers[order.camera] + 1
        self._taken += 1
        self.waiting += 1
        suffix = JPEG if self.settings.format is PictureFormat.JPEG else PNG
        picture = RecordedPicture(
            file=f"{order.camera}-{self.recorded:05d}{suffix}",
            t_s=envelope.t_s,
            image=envelope.payload,
            position_ned_m=pose.position_ned_m,
            ned_from_frd=attitude,
            origin_geo=pose.origin_geo,
            position_std_m=pose.position_std_m,
            quality=self.settings.quality,
            action_id=self.action_id,
        )
        return [Actuation(picture)]

    def _pose_at(self, t_s: float) -> Pose | None:
        """The vehicle's pose at a time: between two poses, or a little after the last."""
        before = next((pose for pose in reversed(self._poses) if pose.t_s <= t_s), None)
        after = next((pose for pose in self._poses if pose.t_s >= t_s), None)
        if before is None or after is None:
            nearest = before or after
            if nearest is None or abs(t_s - nearest.t_s) > POSE_GAP_S:
                return None
            pose, ahead_s = nearest.payload, t_s - nearest.t_s
            return replace(pose, position_ned_m=_plus(pose.position_ned_m, pose.velocity_ned_m_s, ahead_s))
        gap_s = after.t_s - before.t_s
        if gap_s > POSE_GAP_S or before.payload.reset_counter != after.payload.reset_counter:
            near = before if t_s - before.t_s <= after.t_s - t_s else after
            return near.payload if abs(t_s - near.t_s) <= POSE_GAP_S else None
        share = (t_s - before.t_s) / gap_s if gap_s > 0.0 else 0.0
        a, b = before.payload, after.payload
        return replace(
            a,
            position_ned_m=interpolate(a.position_ned_m, b.position_ned_m, share),
            ned_from_frd=slerp(a.ned_from_frd, b.ned_from_frd, share),
        )

    def _gimbal_at(self, t_s: float) -> Quaternion | None:
        """Attitude of the gimbal at a time: between two reports, or that of a report shortly before or after."""
        before = next((state for state in reversed(self._gimbal) if state.t_s <= t_s), None)
        after = next((state for state in self._gimbal if state.t_s >= t_s), None)
        if before is not None and after is not None and 0.0 < after.t_s - before.t_s <= POSE_GAP_S:
            share = (t_s - before.t_s) / (after.t_s - before.t_s)
            return slerp(before.payload.ned_from_gimbal, after.payload.ned_from_gimbal, share)
        near = [state for state in (before, after) if state is not None and abs(state.t_s - t_s) <= POSE_GAP_S]
        return min(near, key=lambda state: abs(state.t_s - t_s)).payload.ned_from_gimbal if near else None

    def _is_due(self, order: RecordImages, t_s: float, position: Vector3) -> bool:
        if self._last_ned_m is None:
            return True
        if order.every_s is not None:
            return t_s - self._last_s >= order.every_s - 1e-6
        return math.dist(position, self._last_ned_m) >= (order.every_m or 0.0)

    def actuate(self, write: RecordedPicture) -> None:
        """Hands a picture to the writer."""
        self._store.write(write)

    def make_safe(self) -> None:
        """A folder is always safe."""


def _plus(a: Vector3, b: Vector3, share: float) -> Vector3:
    return (a[0] + b[0] * share, a[1] + b[1] * share, a[2] + b[2] * share)
