"""The vehicle's cameras as MAVLink components 100 to 105, by the camera protocol v2: information, capture, storage."""

from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from math import inf, isfinite, nan
from typing import Any, Final, NamedTuple

from msgspec.structs import replace

from gloc3 import __version__
from gloc3.camera.model import CameraModel
from gloc3.camera.picture_file import PhotoTags, camera_position
from gloc3.errors import Refused
from gloc3.exchange.base import Exchange
from gloc3.mavlink import codec
from gloc3.mavlink.codec import enum_name
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.node import MavlinkComponent
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_server import MavCommandRequest, MavCommandServer
from gloc3.mavlink.services.heartbeat import Heartbeat
from gloc3.mavlink.services.interval import REQUEST_MESSAGE, STREAM_COMMANDS, StreamScheduler
from gloc3.messages.command_interface import AnyBody, CiReply, Outcome, RequestAction, Steer, Verb
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import Quaternion, multiply
from gloc3.messages.vehicle import Home, ImageRecorded, Pose
from gloc3.mission.model.messages import ActionStatus
from gloc3.mission.model.states import ActionState
from gloc3.platform.platform import Platform
from gloc3_onboard.companion.pending_requests import PendingRequests
from gloc3_onboard.process.vitals import Vitals

LAST_COMPONENT: Final = 105
"""MAV_COMP_ID_CAMERA6; the first is 100."""
IMAGE_START, IMAGE_STOP, IMAGE_AGAIN = 2000, 2001, 2002
SET_MODE: Final = 530
_TYPE: Final = 30
"""MAV_TYPE_CAMERA."""
_CAN_CAPTURE, _HAS_STREAM = 2, 256
"""CAMERA_CAP_FLAGS."""
_RUNNING: Final = 1
"""VIDEO_STREAM_STATUS_FLAGS."""
_LEGACY: Final[Mapping[int, str]] = {
    521: "CAMERA_INFORMATION",
    522: "CAMERA_SETTINGS",
    525: "STORAGE_INFORMATION",
    527: "CAMERA_CAPTURE_STATUS",
    2504: "VIDEO_STREAM_INFORMATION",
    2505: "VIDEO_STREAM_STATUS",
}
"""Requests for a message by a command of its own, which QGroundControl still sends."""
HANDLED: Final = frozenset({IMAGE_START, IMAGE_STOP, IMAGE_AGAIN, SET_MODE, *_LEGACY, *STREAM_COMMANDS})
"""Numbers of the commands that are carried out; others are answered as unsupported."""
_NEVER: Final[Mapping[int, str]] = {
    526: "the disk of the onboard computer is not formatted over MAVLink",
    529: "settings are those of the platform file",
    531: "it has no zoom",
    532: "its focus is fixed",
    2500: "it takes pictures only",
    2501: "it takes pictures only",
}
_READY, _UNKNOWN = 2, 3
"""STORAGE_STATUS."""
_PHOTOS: Final = 2
"""STORAGE_USAGE_FLAG_PHOTO."""
_IDLE, _INTERVAL = 0, 2
"""Status of CAMERA_CAPTURE_STATUS."""
_DEFAULT_INTERVAL_S: Final = 1.0
_SHORTEST_S: Final = 0.02
MOST_PICTURES: Final = 100_000
"""Number of pictures of an order without end: single actions must end."""
KEPT: Final = 1000
"""Captures that a station can request again."""
_RDF_FROM_FRD: Final[Quaternion] = (0.5, -0.5, -0.5, -0.5)


class CameraEntry(NamedTuple):
    """One camera."""

    component: int
    """Of MAVLink."""
    name: str
    capability: str
    """By which pictures of it are recorded."""
    model: CameraModel | None = None
    """The calibration; None if unknown."""
    stream_url: str = ""
    """Where its video can be had, such as that of a network camera; empty for none."""


def cameras_of(
    platform: Platform,
    model: Callable[[str], CameraModel | None],
    urls: Mapping[str, str],
    video_url: Callable[[str], str] = lambda _camera: "",
) -> list[CameraEntry]:
    """The cameras whose pictures can be recorded, in the order of the platform file, as far as there are components.

    Args:
        platform: the platform file.
        model: the calibration of a camera.
        urls: sources by device.
        video_url: where this process serves a camera's video; empty for nowhere.
    """
    found: dict[str, CameraEntry] = {}
    first = platform.first_camera_component
    for capability, row in platform.capabilities.items():
        for name in row.options.get("camera", ()) if row.arguments == "record_images" else ():
            url = urls.get(f"{name}_camera", "")
            stream_url = url.partition("?")[0] if url.startswith("rtsp://") else video_url(name)
            found.setdefault(name, CameraEntry(first + len(found), name, capability, model(name), stream_url))
    return [entry for entry in found.values() if first and entry.component <= LAST_COMPONENT]


class Cameras:
    """All cameras of the vehicle.

    Args:
        system: of the vehicle.
        entries: the cameras.
        platform: the platform's name.
        exchange: the platform's middleware.
        requesting: requests to the command interface server.
        context: what all have in common.
    """

    def __init__(
        self,
        system: int,
        entries: Sequence[CameraEntry],
        platform: str,
        exchange: Exchange,
        requesting: PendingRequests,
        context: "CameraContext",
    ) -> None:
        self._places = _Places()
        self._by_component: Final = {
            entry.component: MavlinkCamera(Address(system, entry.component), entry, requesting, context, self._places)
            for entry in entries
        }
        self._unsubscribes = [
            exchange.subscribe(f"{platform}/image_recorded", self._receive_image),
            exchange.subscribe(f"{platform}/action_status/*", self._receive_status),
            exchange.subscribe(f"{platform}/pose", self._receive_pose),
            exchange.subscribe(f"{platform}/motion/home", self._receive_home),
        ]
        self._changed = context.changed

    @property
    def components(self) -> list["MavlinkCamera"]:
        """Each camera."""
        return list(self._by_component.values())

    def addressed(self, component: int) -> list["MavlinkCamera"]:
        """The cameras that a message to a component is for; those to component 0 are for all."""
        if component == 0:
            return self.components
        camera = self._by_component.get(component)
        return [] if camera is None else [camera]

    def tick(self, now_s: float) -> None:
        """Runs what is due."""
        for camera in self._by_component.values():
            camera.tick(now_s)

    def next_tick_s(self) -> float | None:
        """When the next heartbeat is due."""
        return min((camera.next_tick_s() for camera in self._by_component.values()), default=None)

    def outgoing(self) -> Iterator[tuple[int, MavlinkMessage]]:
        """Component and message of everything to be sent."""
        for component, camera in self._by_component.items():
            for message in camera.outgoing():
                yield component, message

    def close(self) -> None:
        """Receives nothing any more."""
        for unsubscribe in self._unsubscribes:
            unsubscribe()

    def _receive_image(self, envelope: Envelope[ImageRecorded]) -> None:
        for camera in self._by_component.values():
            if camera.entry.name == envelope.payload.camera:
                camera.recorded(envelope.payload, envelope.t_s)
        self._changed()

    def _receive_status(self, envelope: Envelope[ActionStatus]) -> None:
        for camera in self._by_component.values():
            camera.ended(envelope.payload)

    def _receive_pose(self, envelope: Envelope[Pose]) -> None:
        if envelope.payload.is_sound():
            self._places.pose = envelope.payload

    def _receive_home(self, envelope: Envelope[Home]) -> None:
        self._places.home_down_m = envelope.payload.position_ned_m[2]


class _Places:
    """Where the vehicle's frame and home are."""

    pose: Pose | None = None
    home_down_m: float | None = None


class CameraContext(NamedTuple):
    """What the cameras have in common."""

    inspect: Callable[[], Vitals]
    """Reads the computer's disk."""
    boot_ms: Callable[[float], int]
    """Milliseconds since boot at a time."""
    utc_offset_s: Callable[[], float | None]
    """From the platform's time to seconds since 1970."""
    serves: Callable[[Address], bool]
    """Whether a sender is served."""
    report: Callable[[str], None]
    """Called with the reason of each refusal."""
    changed: Callable[[], None]
    """Called when there is something to send."""


class _Order(NamedTuple):
    """Pictures that a station has requested."""

    name: str
    """Of the task that takes them."""
    interval_s: float
    """0 for a single one."""


class MavlinkCamera:
    """One camera.

    Args:
        own: its address.
        entry: what it is.
        requesting: requests to the command interface server.
        context: what all have in common.
        places: where frame and home are.
    """

    def __init__(
        self,
        own: Address,
        entry: CameraEntry,
        requesting: PendingRequests,
        context: CameraContext,
        places: _Places,
    ) -> None:
        self.own: Final = own
        self.entry: Final = entry
        self._requesting, self._context, self._places = requesting, context, places
        self._server = MavCommandServer(own, serves=lambda one: one.target == own and context.serves(one.sender))
        self._heartbeat = Heartbeat(own, vehicle_type=_TYPE)
        producers: dict[str, Callable[[], MavlinkMessage]] = {
            "CAMERA_INFORMATION": self._information,
            "CAMERA_SETTINGS": self._settings,
            "STORAGE_INFORMATION": self._storage,
            "CAMERA_CAPTURE_STATUS": self._capture_status,
        }
        if entry.stream_url:
            producers |= {"VIDEO_STREAM_INFORMATION": self._stream, "VIDEO_STREAM_STATUS": self._stream_status}
        self._producers = {codec.shape(name).id: make for name, make in producers.items()}
        self._streams = StreamScheduler(own, dict.fromkeys(producers, 0.0))
        self._node = MavlinkComponent(own, (self._server, self._heartbeat, self._streams))
        self._captured: OrderedDict[int, MavlinkMessage] = OrderedDict()
        self._sending: list[MavlinkMessage] = []
        self._count = 0
        self._order: _Order | None = None
        self._now_s = 0.0

    # --- driven by the companion ---

    def receive(self, frame: codec.Frame, now_s: float) -> bool:
        """Handles a frame; returns whether it was for a service of this camera."""
        return self._node.receive(frame, now_s)

    def tick(self, now_s: float) -> None:
        """Carries out commands, and sends the heartbeat and requested messages."""
        self._now_s = now_s
        for request in self._server.events():
            self._run(request, now_s)
        self._node.tick(now_s)
        self._sending += [self._producers[number]() for number in self._streams.due(now_s)]

    def next_tick_s(self) -> float:
        """When the next heartbeat is due."""
        return min(
            time_s for time_s in (self._heartbeat.next_tick_s(), self._streams.next_tick_s()) if time_s is not None
        )

    def outgoing(self) -> list[MavlinkMessage]:
        """What is to be sent; asking empties it."""
        waiting, self._sending = self._sending, []
        return [*self._node.outgoing(), *waiting]

    def recorded(self, image: ImageRecorded, t_s: float) -> None:
        """A picture of this camera is on the disk."""
        message = self._captured_message(image, t_s)
        self._count += 1
        self._captured[image.index] = message
        if len(self._captured) > KEPT:
            self._captured.popitem(last=False)
        self._sending.append(message)

    def ended(self, status: ActionStatus) -> None:
        """An action has changed its state."""
        order = self._order
        is_open = status.state in (ActionState.RUNNING, ActionState.PAUSED, ActionState.WAITING)
        if order is not None and not is_open and status.action_id.startswith(f"{order.name}."):
            self._order = None

    # --- commands ---

    def _run(self, request: MavCommandRequest, now_s: float) -> None:
        try:
            if request.command not in HANDLED:
                reason = _NEVER.get(request.command, "not supported by the camera")
                self._answer(request, CommandResult.UNSUPPORTED, reason)
            elif (found := self._queried(request, now_s)) is not None:
                self._answer(request, found, "it is not available")
            elif request.command == IMAGE_START:
                self._start(request)
            else:
                self._stop(request)
        except Refused as refusal:  # also without control: NOT_IN_CONTROL makes MAVSDK 4.1 abort
            self._answer(request, CommandResult.DENIED, str(refusal))

    def _queried(self, request: MavCommandRequest, now_s: float) -> CommandResult | None:
        """Answers what changes nothing; None for other commands."""
        first, second = request.params[:2]
        if request.command == SET_MODE:
            if second != 0.0:
                raise Refused("it takes pictures only")
            return CommandResult.ACCEPTED
        is_capture = request.command == REQUEST_MESSAGE and first == codec.shape("CAMERA_IMAGE_CAPTURED").id
        if request.command == IMAGE_AGAIN or is_capture:
            index = second if is_capture else first
            message = self._captured.get(int(index)) if isfinite(index) else None
            if message is None:
                raise Refused("that picture is not known")
            self._sending.append(message)
            return CommandResult.ACCEPTED
        if request.command in _LEGACY:
            number = float(codec.shape(_LEGACY[request.command]).id)
            again = (number, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            request = replace(request, command=REQUEST_MESSAGE, params=again)
        return self._streams.command(request, now_s)

    def _start(self, request: MavCommandRequest) -> None:
        interval_s, total = request.params[1], request.params[2]
        if not (0.0 <= total <= MOST_PICTURES and total == int(total)):
            raise Refused(f"the number of pictures must be a whole number from 0 to {MOST_PICTURES}")
        if not 0.0 <= interval_s < inf:
            raise Refused("the interval must be 0 s or more")
        if total == 0.0 and interval_s == 0.0:
            raise Refused("pictures without end need an interval")
        if self._order is not None:
            raise Refused("pictures at an interval are being taken; stop them first")
        arguments: dict[str, Any] = {
            "camera": self.entry.name,
            "every_s": max(interval_s, _SHORTEST_S) if interval_s else _DEFAULT_INTERVAL_S,
            "count": int(total) or MOST_PICTURES,
        }
        author = f"station {request.sender.system}"
        body = RequestAction(capability=self.entry.capability, arguments=arguments, author=author)

        def started(reply: CiReply) -> None:
            self._order = _Order(reply.reason, interval_s if total != 1.0 else 0.0)

        self._act(request, body, started)

    def _stop(self, request: MavCommandRequest) -> None:
        if self._order is None:
            raise Refused("no station's pictures are being taken; those of a mission end with it")

        def stopped(_: CiReply) -> None:
            self._order = None

        self._act(request, Steer(verb=Verb.ABORT, target=self._order.name), stopped)

    def _act(self, request: MavCommandRequest, body: AnyBody, accepted: Callable[[CiReply], None]) -> None:
        def ended(reply: CiReply) -> None:
            if reply.outcome is Outcome.ACCEPTED:
                accepted(reply)
                self._answer(request, CommandResult.ACCEPTED, "")
            else:
                is_refused = reply.outcome is Outcome.REFUSED
                self._answer(request, CommandResult.DENIED if is_refused else CommandResult.FAILED, reply.reason)

        self._requesting.act(request.sender, body, ended)

    def _answer(self, request: MavCommandRequest, result: CommandResult, reason: str) -> None:
        if result is not CommandResult.ACCEPTED:
            name = enum_name("MAV_CMD", request.command).removeprefix("MAV_CMD_")
            station = f"station {request.sender.system}"
            self._context.report(f"{name} of {station} to camera {self.entry.name} refused: {reason}")
        self._server.answer(request, result, now_s=self._now_s)

    # --- messages ---

    @property
    def _boot_ms(self) -> int:
        return self._context.boot_ms(self._now_s)

    def _information(self) -> MavlinkMessage:
        model = self.entry.model
        pixel_mm = model.pixel_um * 1e-3 if model is not None and model.pixel_um is not None else nan
        width, height = (model.width, model.height) if model is not None else (0, 0)
        major, minor, patch = (*(int(part) for part in __version__.split(".")[:3] if part.isdecimal()), 0, 0, 0)[:3]
        return codec.message(
            "CAMERA_INFORMATION",
            time_boot_ms=self._boot_ms,
            vendor_name=_padded((model.make if model is not None else "") or "GLOC3"),
            model_name=_padded((model.product if model is not None else "") or self.entry.name),
            firmware_version=major | minor << 8 | patch << 16,
            focal_length=model.focal_px[0] * pixel_mm if model is not None else nan,
            sensor_size_h=width * pixel_mm,
            sensor_size_v=height * pixel_mm,
            resolution_h=width,
            resolution_v=height,
            flags=_CAN_CAPTURE | (_HAS_STREAM if self.entry.stream_url else 0),
        )

    def _settings(self) -> MavlinkMessage:
        return codec.message("CAMERA_SETTINGS", time_boot_ms=self._boot_ms, zoomLevel=nan, focusLevel=nan)

    def _storage(self) -> MavlinkMessage:
        vitals = self._context.inspect()
        total, used = float(vitals.disk_total_mib), float(vitals.disk_used_mib)
        return codec.message(
            "STORAGE_INFORMATION",
            time_boot_ms=self._boot_ms,
            storage_id=1,
            storage_count=1,
            status=_READY if total else _UNKNOWN,
            total_capacity=total,
            used_capacity=used,
            available_capacity=max(0.0, total - used),
            read_speed=nan,
            write_speed=nan,
            storage_usage=_PHOTOS,
        )

    def _capture_status(self) -> MavlinkMessage:
        vitals, order = self._context.inspect(), self._order
        return codec.message(
            "CAMERA_CAPTURE_STATUS",
            time_boot_ms=self._boot_ms,
            image_status=_IDLE if order is None else _INTERVAL if order.interval_s else 1,
            image_interval=order.interval_s if order is not None else 0.0,
            available_capacity=float(max(0, vitals.disk_total_mib - vitals.disk_used_mib)),
            image_count=self._count,
        )

    def _captured_message(self, image: ImageRecorded, t_s: float) -> MavlinkMessage:
        pose, home_down_m, model = self._places.pose, self._places.home_down_m, self.entry.model
        origin = pose.origin_geo if pose is not None else None
        tags = PhotoTags(image.camera, image.ned_from_frd, image.position_ned_m, origin, model=model)
        place, offset_s = camera_position(tags), self._context.utc_offset_s()
        looking = image.ned_from_frd
        if model is not None:
            looking = multiply(multiply(looking, model.frd_from_rdf), _RDF_FROM_FRD)
        return codec.message(
            "CAMERA_IMAGE_CAPTURED",
            time_boot_ms=self._context.boot_ms(t_s),
            time_utc=0 if offset_s is None else round((t_s + offset_s) * 1e6),
            lat=round(place.latitude_deg * 1e7) if place is not None else 0,
            lon=round(place.longitude_deg * 1e7) if place is not None else 0,
            alt=round(place.altitude_m * 1e3) if place is not None else 0,
            relative_alt=0 if home_down_m is None else round((home_down_m - image.position_ned_m[2]) * 1e3),
            q=looking,
            image_index=image.index,
            capture_result=1,
            file_url=image.file,
        )

    def _stream(self) -> MavlinkMessage:
        return codec.message(
            "VIDEO_STREAM_INFORMATION",
            stream_id=1,
            count=1,
            type=0,  # RTSP
            name_=self.entry.name,
            uri=self.entry.stream_url,
            **self._video(),
        )

    def _stream_status(self) -> MavlinkMessage:
        return codec.message("VIDEO_STREAM_STATUS", stream_id=1, **self._video())

    def _video(self) -> dict[str, Any]:
        model = self.entry.model
        width, height = (model.width, model.height) if model is not None else (0, 0)
        return {"flags": _RUNNING, "resolution_h": width, "resolution_v": height}


def _padded(text: str) -> tuple[int, ...]:
    """A name as 32 bytes."""
    return tuple(text.encode()[:32].ljust(32, b"\0"))
