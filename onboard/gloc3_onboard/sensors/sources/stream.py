"""Simulated cameras and scanners over TCP, as served by `gloc3 sitl`; read in a thread."""

import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Final

from gloc3.camera.frame_stream import (
    COLOUR,
    CameraFrame,
    DepthFrame,
    FrameError,
    FrameReader,
    ScanFrame,
    StreamRecord,
    encode_stream_request,
)
from gloc3.errors import Refused
from gloc3.messages.perception import DepthImage, LaserScan
from gloc3.messages.vehicle import Image
from gloc3_onboard.sensors.camera_sources.camera import EYES, camera_name
from gloc3_onboard.sensors.camera_sources.depth import DEPTH, depth_name
from gloc3_onboard.sensors.camera_sources.stereo import STEREO, pair_names
from gloc3_onboard.sensors.devices import Bell, StampedDepth, StampedImage, StampedPair, StampedScan, Unwatch
from gloc3_onboard.sensors.registry import SourceKind, SourceRequest
from gloc3_onboard.sensors.source_url import PIXELS

CONNECT_S = 2.0
RETRY_S = 0.5
SAME_US = 1000
"""Frames of a pair have stamps no further apart."""

MapTime = Callable[[float], float | None]
"""Maps the vehicle's time since boot, in seconds, to ours; None while that is not known."""


class StreamSource:
    """Base of sources over one connection, which is reopened indefinitely: the server may start later.

    Args:
        name: name of the thread.
        address: host and port.
        t_s_of: maps the vehicle's time to ours.
        request: requested sensors of the server.
    """

    def __init__(self, name: str, address: tuple[str, int], t_s_of: MapTime, request: tuple[str, ...]) -> None:
        self._name, self._address, self._t_s_of = name, address, t_s_of
        self._request = encode_stream_request(*request)
        self._bell = Bell()
        self._stop = threading.Event()

    def open(self) -> None:
        """Begins to take data."""
        self._stop = threading.Event()
        self.clear()
        threading.Thread(target=self._read, args=(self._stop,), name=self._name, daemon=True).start()

    def close(self) -> None:
        """Ends taking data."""
        self._stop.set()

    def on_new_data(self, ready: Callable[[], None]) -> Unwatch:
        """Has `ready` called when something has come."""
        return self._bell.listen(ready)

    def _read(self, stop: threading.Event) -> None:
        while not stop.is_set():
            with suppress(OSError, FrameError), socket.create_connection(self._address, CONNECT_S) as stream:
                stream.sendall(self._request)
                reader = FrameReader()
                while not stop.is_set():
                    data = stream.recv(1 << 20)
                    if not data:
                        break
                    for record in reader.receive(data):
                        t_s = self._t_s_of(record.boot_us * 1e-6)
                        if t_s is not None and self._accept(t_s, record):
                            self._bell.ring()
            stop.wait(RETRY_S)

    def clear(self) -> None:
        """Keeps nothing of an earlier opening."""
        raise NotImplementedError

    def _accept(self, t_s: float, record: StreamRecord) -> bool:
        """Keeps a record; returns whether it is new."""
        raise NotImplementedError


class StreamCamera(StreamSource):
    """A camera.

    Args:
        name: of the camera, whatever the stream calls it.
        address: host and port.
        t_s_of: maps the vehicle's time to ours.
        part: which camera of the stream; empty for the one that has this name there, too.
        pixels: `COLOUR`, or nothing for grey.
    """

    def __init__(
        self, name: str, address: tuple[str, int], t_s_of: MapTime, part: str = "", pixels: str = COLOUR
    ) -> None:
        super().__init__(name, address, t_s_of, ((part or name) + pixels,))
        self._part = part
        self._frame: StampedImage | None = None

    def frame(self) -> StampedImage | None:
        """The latest frame; None before the first."""
        return self._frame

    def clear(self) -> None:
        """Keeps nothing."""
        self._frame = None

    def _accept(self, t_s: float, record: StreamRecord) -> bool:
        if not isinstance(record, CameraFrame) or self._part not in ("", record.camera):
            return False
        self._frame = StampedImage(t_s, _image(record, self._name))
        return True


class StreamStereoCamera(StreamSource):
    """Two synchronous cameras.

    Args:
        names: names of the left and the right one, in the stream and here.
        address: host and port.
        t_s_of: maps the vehicle's time to ours.
        pixels: `COLOUR`, or nothing for grey.
    """

    def __init__(self, names: tuple[str, str], address: tuple[str, int], t_s_of: MapTime, pixels: str = COLOUR) -> None:
        super().__init__(names[0], address, t_s_of, (names[0] + pixels, names[1] + pixels))
        self._names = names
        self._sides: dict[str, CameraFrame] = {}
        self._pair: StampedPair | None = None

    def pair(self) -> StampedPair | None:
        """The latest two frames; None before the first."""
        return self._pair

    def clear(self) -> None:
        """Keeps nothing."""
        self._pair = None

    def _accept(self, t_s: float, record: StreamRecord) -> bool:
        if not isinstance(record, CameraFrame) or record.camera not in self._names:
            return False
        self._sides[record.camera] = record
        left, right = (self._sides.get(name) for name in self._names)
        if left is None or right is None or abs(left.boot_us - right.boot_us) > SAME_US:
            return False
        self._pair = StampedPair(t_s, _image(left, self._names[0]), _image(right, self._names[1]))
        return True


class StreamDepthCamera(StreamSource):
    """A depth camera.

    Args:
        name: of the camera, whatever the stream calls it.
        address: host and port.
        t_s_of: maps the vehicle's time to ours.
        part: which camera of the stream; empty for the one that has this name there, too.
    """

    def __init__(self, name: str, address: tuple[str, int], t_s_of: MapTime, part: str = "") -> None:
        super().__init__(name, address, t_s_of, (part or name,))
        self._part = part or name
        self._depth: StampedDepth | None = None

    def depth(self) -> StampedDepth | None:
        """The latest frame; None before the first."""
        return self._depth

    def clear(self) -> None:
        """Keeps nothing."""
        self._depth = None

    def _accept(self, t_s: float, record: StreamRecord) -> bool:
        if not isinstance(record, DepthFrame) or record.camera != self._part:
            return False
        depth = DepthImage(
            camera=self._name,
            width=record.width,
            height=record.height,
            data=record.data,
            scale_m=record.scale_m,
            range_min_m=record.range_min_m,
            range_max_m=record.range_max_m,
        )
        self._depth = StampedDepth(t_s, depth)
        return True


class StreamLaser(StreamSource):
    """A range scanner."""

    def __init__(self, name: str, address: tuple[str, int], t_s_of: MapTime, part: str = "") -> None:
        super().__init__(name, address, t_s_of, (part or name,))
        self._part = part
        self._scan: StampedScan | None = None

    def scan(self) -> StampedScan | None:
        """The latest turn; None before the first."""
        return self._scan

    def clear(self) -> None:
        """Keeps nothing."""
        self._scan = None

    def _accept(self, t_s: float, record: StreamRecord) -> bool:
        if not isinstance(record, ScanFrame) or self._part not in ("", record.scanner):
            return False
        scan = LaserScan(
            scanner=self._name,
            angle_min_rad=record.angle_min_rad,
            angle_step_rad=record.angle_step_rad,
            range_min_m=record.range_min_m,
            range_max_m=record.range_max_m,
            ranges_m=record.ranges_m,
            duration_s=record.duration_s,
        )
        self._scan = StampedScan(t_s, scan)
        return True


def _image(frame: CameraFrame, name: str) -> Image:
    return Image(camera=name, width=frame.width, height=frame.height, data=frame.data, bgr=frame.bgr)


def _make(request: SourceRequest) -> StreamSource:
    name, url, t_s_of = request.device, request.url, request.host.t_s_of_boot
    address, pixels = url.address(name), "" if url.is_grey else COLOUR
    if "pixels" in url.options and request.sensor.name not in EYES:
        raise Refused(f"{name}: pixels are of cameras, and this is a {request.sensor.name}")
    if request.sensor.name == DEPTH:
        return StreamDepthCamera(depth_name(name), address, t_s_of, url.part)
    if request.sensor.name == STEREO:
        return StreamStereoCamera(pair_names(name), address, t_s_of, pixels)
    if request.sensor.name == "laser":
        return StreamLaser(name, address, t_s_of, url.part)
    return StreamCamera(camera_name(name), address, t_s_of, url.part, pixels)


SOURCES: Final = (SourceKind("tcp", (*EYES, DEPTH, "laser"), "tcp://127.0.0.1:5600", _make, PIXELS, takes_part=True),)
