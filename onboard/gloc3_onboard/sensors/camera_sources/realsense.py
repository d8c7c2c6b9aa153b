"""Intel's RealSense cameras, and recordings of them, by the library that comes with `pip install gloc3[realsense]`."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from gloc3.camera.opencv import load_opencv
from gloc3.errors import Gloc3Error
from gloc3.messages.perception import DepthImage
from gloc3_onboard.autopilot.telemetry import BootClock
from gloc3_onboard.sensors.camera_sources.camera import CAMERA, image_of
from gloc3_onboard.sensors.camera_sources.depth import DEPTH
from gloc3_onboard.sensors.camera_sources.shared import (
    EVERY,
    SILENT_S,
    STREAMS,
    SharedDevice,
    picture_names,
    sensor_of_device,
)
from gloc3_onboard.sensors.camera_sources.stereo import STEREO
from gloc3_onboard.sensors.devices import StampedDepth, StampedImage, StampedPair
from gloc3_onboard.sensors.registry import SourceKind, SourceRequest, library_problem
from gloc3_onboard.sensors.source_url import FAR_M, NEAR_M, SourceUrl

ANY: Final = "any"
WAIT_MS: Final = 300
_problem = library_problem("pyrealsense2", "realsense")


class RealSense(SharedDevice):
    """A camera on USB, or a recording, which is played at its pace.

    Args:
        place: serial number of the camera, or `any`; or the name of the recording.
        recording: the recording; None for a camera.
        now_s: our time.
    """

    def __init__(self, place: str, recording: Path | None, now_s: Callable[[], float]) -> None:
        super().__init__(f"realsense {place}", now_s)
        self._place, self._recording = place, recording

    @contextmanager
    def connect(self) -> Iterator[Iterator[Mapping[str, Any] | None]]:
        """Starts the streams that are wanted."""
        if problem := _problem():
            raise Gloc3Error(f"{self.name}: {problem}")
        import pyrealsense2 as rs

        device = self._device(rs)
        pipeline = rs.pipeline()
        try:
            pipeline.start(self._config(rs))
        except RuntimeError as error:
            raise Gloc3Error(f"{self.name}: {error}; {_offers(device)}") from error
        try:
            yield self._pictures(rs, pipeline)
        finally:
            pipeline.stop()

    def _config(self, rs: Any) -> Any:
        config = rs.config()
        if self._recording is not None:
            config.enable_device_from_file(str(self._recording), False)
        elif self._place != ANY:
            config.enable_device(self._place)
        for kind, (_, url) in self.wanted.items():
            for stream, index, form in _streams(rs, kind):
                size = [int(url.number(option, 0)) for option in ("width", "height")]
                config.enable_stream(stream, index, *size, form, round(url.number("rate_hz", 0)))
        return config

    def _device(self, rs: Any) -> Any:
        """The library's device; to wait for one that is not connected takes it 15 s."""
        if self._recording is not None:
            if not self._recording.is_file():
                raise Gloc3Error(f"{self.name}: {self._recording} is not there")
            return rs.context().load_device(str(self._recording))
        found = {one.get_info(rs.camera_info.serial_number): one for one in rs.context().query_devices()}
        if not found or self._place not in (ANY, *found):
            raise Gloc3Error(f"{self.name} is not connected; connected cameras: {', '.join(sorted(found)) or 'none'}")
        return found.get(self._place, next(iter(found.values())))

    def _pictures(self, rs: Any, pipeline: Any) -> Iterator[Mapping[str, Any] | None]:
        clock, came_s = BootClock(), self.now_s()
        found: dict[str, Any] = {}
        while True:
            try:
                is_there, frames = pipeline.try_wait_for_frames(WAIT_MS)
            except RuntimeError as error:
                raise Gloc3Error(f"{self.name}: {error}") from error
            now_s = self.now_s()
            if not is_there:
                if self._recording is None and now_s - came_s > SILENT_S:
                    raise Gloc3Error(f"{self.name}: no picture for {SILENT_S:g} s; is it plugged in?")
                yield None
                continue
            came_s, new = now_s, {}
            for kind, (device, url) in self.wanted.items():
                parts = _FRAMES[kind](frames)
                if all(parts):
                    t_s = clock.t_s(parts[0].get_timestamp(), now_s)
                    new[kind] = _TAKEN[kind](t_s, parts, picture_names(kind, device), url)
            found = {**found, **new}
            yield found


def _offers(device: Any) -> str:
    """What a device has in place of what was asked for."""
    profiles = [one for sensor in device.query_sensors() for one in sensor.profiles if one.is_video_stream_profile()]
    videos = [one.as_video_stream_profile() for one in profiles]
    sizes = {f"{one.stream_name()} {one.width()} x {one.height()} at {one.fps()} Hz" for one in videos}
    return f"it has {', '.join(sorted(sizes)) or 'no pictures'}"


def _colour(t_s: float, parts: Sequence[Any], names: Sequence[str], url: SourceUrl) -> StampedImage:
    image = image_of(load_opencv(), _pixels(parts[0]), names[0], keeps_colours=not url.is_grey)
    return StampedImage(t_s, image)


def _infrared(t_s: float, parts: Sequence[Any], names: Sequence[str], url: SourceUrl) -> StampedPair:
    del url
    left, right = (
        image_of(load_opencv(), _pixels(frame), name, keeps_colours=False)
        for frame, name in zip(parts, names, strict=True)
    )
    return StampedPair(t_s, left, right)


def _depth(t_s: float, parts: Sequence[Any], names: Sequence[str], url: SourceUrl) -> StampedDepth:
    (frame,) = parts
    depth = DepthImage(
        camera=names[0],
        width=frame.width,
        height=frame.height,
        data=_pixels(frame).tobytes(),
        scale_m=frame.get_units(),
        range_min_m=url.number("min_m", NEAR_M),
        range_max_m=url.number("max_m", FAR_M),
    )
    return StampedDepth(t_s, depth)


_FRAMES: Final[Mapping[str, Callable[[Any], Sequence[Any]]]] = {
    CAMERA: lambda frames: [frames.get_color_frame()],
    STEREO: lambda frames: [frames.get_infrared_frame(1), frames.get_infrared_frame(2)],
    DEPTH: lambda frames: [frames.get_depth_frame()],
}
_TAKEN: Final[Mapping[str, Callable[..., Any]]] = {CAMERA: _colour, STEREO: _infrared, DEPTH: _depth}


def _streams(rs: Any, kind: str) -> list[tuple[Any, int, Any]]:
    """The library's streams of a kind of sensor: type, number, format."""
    if kind == STEREO:
        return [(rs.stream.infrared, index, rs.format.y8) for index in (1, 2)]
    if kind == DEPTH:
        return [(rs.stream.depth, -1, rs.format.z16)]
    return [(rs.stream.color, -1, rs.format.bgr8)]


def _pixels(frame: Any) -> Any:
    import numpy as np

    return np.asanyarray(frame.get_data())


def _make(request: SourceRequest) -> Any:
    kind, place = request.url.scheme, request.url.place
    recording = request.path if kind == RECORDING else None
    device = request.shared.setdefault((kind, place), RealSense(place, recording, request.now_s))
    return sensor_of_device(request, device)


RECORDING: Final = "realsense-log"
SOURCES: Final = (
    SourceKind("realsense", EVERY, "realsense://any, or realsense://048122070681", _make, STREAMS, problem=_problem),
    SourceKind(RECORDING, EVERY, "realsense-log://flight.db3", _make, STREAMS, is_file=True, problem=_problem),
)
