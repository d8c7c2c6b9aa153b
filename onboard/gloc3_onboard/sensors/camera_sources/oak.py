"""Luxonis' OAK cameras, by the library DepthAI that comes with `pip install gloc3[oak]`."""

import threading
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from datetime import timedelta
from typing import Any, Final

from gloc3.camera.opencv import load_opencv
from gloc3.errors import Gloc3Error
from gloc3.messages.perception import DepthImage
from gloc3_onboard.sensors.camera_sources.camera import BELIEVED_S, CAMERA, image_of
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
POLL_S: Final = 0.004
BOOT_S: Final = 20.0
"""So long a camera may take to its first picture: its program is loaded first."""
UNIT_M: Final = 0.001
QUEUED: Final = 2
"""Pictures that wait; older ones are dropped."""
SIZE: Final = (640, 400)
"""Of pictures, unless the URL says so."""
RATE_HZ: Final = 20.0
Queues = Mapping[str, Sequence[Any]]
"""By kind of sensor: the library's queues, two for a pair."""
_problem = library_problem("depthai", "oak")


class Oak(SharedDevice):
    """A camera on USB or Ethernet.

    Args:
        place: its serial number or address, or `any`.
        now_s: our time, monotonic.
    """

    def __init__(self, place: str, now_s: Callable[[], float]) -> None:
        super().__init__(f"oak {place}", now_s)
        self._place = place

    @contextmanager
    def connect(self) -> Iterator[Iterator[Mapping[str, Any] | None]]:
        """Finds the camera; it is started by the reading thread, since that takes seconds."""
        if problem := _problem():
            raise Gloc3Error(f"{self.name}: {problem}")
        import depthai

        self._require(depthai)
        with closing(self._pictures(depthai)) as pictures:
            yield pictures

    def _require(self, depthai: Any) -> None:
        """A camera on USB is there at once; one with an address is tried."""
        if "." in self._place:
            return
        found = sorted(info.getDeviceId() for info in depthai.Device.getAllAvailableDevices())
        if not found or self._place not in (ANY, *found):
            raise Gloc3Error(f"{self.name} is not connected; connected cameras: {', '.join(found) or 'none'}")

    @contextmanager
    def pipeline(self, depthai: Any) -> Iterator[tuple[Any, Queues]]:
        """The library's pipeline for what is wanted, and the queues of its pictures."""
        device = depthai.Device() if self._place == ANY else depthai.Device(depthai.DeviceInfo(self._place))
        with depthai.Pipeline(device) as pipeline:
            cameras: dict[Any, Any] = {}
            yield (
                pipeline,
                {kind: _queues(depthai, pipeline, cameras, kind, url) for kind, (_, url) in self.wanted.items()},
            )

    def _pictures(self, depthai: Any) -> Generator[Mapping[str, Any] | None, None, None]:
        pause, came_s, limit_s = threading.Event(), self.now_s(), BOOT_S
        found: dict[str, Any] = {}
        try:
            with self.pipeline(depthai) as (pipeline, queues):
                pipeline.start()
                pairs: dict[str, list[Any]] = {kind: [None] * len(all_of) for kind, all_of in queues.items()}
                while True:
                    now_s, new = self.now_s(), {}
                    for kind, all_of in queues.items():
                        parts = [queue.tryGet() or part for queue, part in zip(all_of, pairs[kind], strict=True)]
                        is_new, pairs[kind] = parts != pairs[kind], parts
                        if is_new and None not in parts and len({part.getSequenceNum() for part in parts}) == 1:
                            device, url = self.wanted[kind]
                            new[kind] = _TAKEN[kind](_stamp_s(parts[0], now_s), parts, picture_names(kind, device), url)
                    if new:
                        found, came_s, limit_s = {**found, **new}, now_s, SILENT_S
                        yield found
                    elif now_s - came_s > limit_s:
                        raise Gloc3Error(f"{self.name}: no picture for {limit_s:g} s; is it plugged in?")
                    else:
                        pause.wait(POLL_S)
                        yield None
        except RuntimeError as error:
            raise Gloc3Error(f"{self.name}: {error}") from error


def _queues(depthai: Any, pipeline: Any, cameras: dict[Any, Any], kind: str, url: SourceUrl) -> Sequence[Any]:
    """The queues of a kind of sensor; `cameras` are those that exist already, by socket."""
    sockets, is_colour = depthai.CameraBoardSocket, kind == CAMERA
    frame_type = depthai.ImgFrame.Type.BGR888i if is_colour else depthai.ImgFrame.Type.GRAY8
    size = (int(url.number("width", SIZE[0])), int(url.number("height", SIZE[1])))
    outputs = []
    for socket in (sockets.CAM_A,) if is_colour else (sockets.CAM_B, sockets.CAM_C):
        if socket not in cameras:
            cameras[socket] = pipeline.create(depthai.node.Camera).build(socket)
        outputs.append(cameras[socket].requestOutput(size, frame_type, fps=url.number("rate_hz", RATE_HZ)))
    if kind == DEPTH:
        outputs = [pipeline.create(depthai.node.StereoDepth).build(*outputs).depth]
    return [output.createOutputQueue(QUEUED, False) for output in outputs]


def _stamp_s(frame: Any, now_s: float) -> float:
    """The library's time of a picture, which is monotonic as ours; that of arrival if it is another clock's."""
    stamp: timedelta = frame.getTimestamp()
    stamp_s = stamp.total_seconds()
    return stamp_s if 0.0 <= now_s - stamp_s < BELIEVED_S else now_s


def _colour(t_s: float, parts: Sequence[Any], names: Sequence[str], url: SourceUrl) -> StampedImage:
    return StampedImage(t_s, image_of(load_opencv(), parts[0].getCvFrame(), names[0], keeps_colours=not url.is_grey))


def _pair(t_s: float, parts: Sequence[Any], names: Sequence[str], url: SourceUrl) -> StampedPair:
    del url
    left, right = (
        image_of(load_opencv(), part.getCvFrame(), name, keeps_colours=False)
        for part, name in zip(parts, names, strict=True)
    )
    return StampedPair(t_s, left, right)


def _depth(t_s: float, parts: Sequence[Any], names: Sequence[str], url: SourceUrl) -> StampedDepth:
    pixels = parts[0].getCvFrame()
    height, width = pixels.shape
    depth = DepthImage(
        camera=names[0],
        width=width,
        height=height,
        data=pixels.astype("<u2").tobytes(),
        scale_m=UNIT_M,
        range_min_m=url.number("min_m", NEAR_M),
        range_max_m=url.number("max_m", FAR_M),
    )
    return StampedDepth(t_s, depth)


_TAKEN: Final[Mapping[str, Callable[..., Any]]] = {CAMERA: _colour, STEREO: _pair, DEPTH: _depth}


def _make(request: SourceRequest) -> Any:
    place = request.url.place
    return sensor_of_device(request, request.shared.setdefault(("oak", place), Oak(place, request.now_s)))


SOURCES: Final = (SourceKind("oak", EVERY, "oak://any, or oak://192.168.1.222", _make, STREAMS, problem=_problem),)
