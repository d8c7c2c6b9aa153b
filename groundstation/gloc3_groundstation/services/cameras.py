"""Cameras and gimbals of a vehicle: pictures, recordings and where the camera looks, by the camera and gimbal protocols.

A camera is a component of its own, or the autopilot speaks for it; so is the manager of a gimbal (MAVLink, *Camera Protocol
v2* and *Gimbal Protocol v2*).
"""

from math import nan
from typing import Final, NamedTuple

from gloc3.errors import Refused
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.service import Microservice
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_client import MavCommandClient
from gloc3_groundstation.services.machines import Machines

IMAGE_START_CAPTURE, VIDEO_START_CAPTURE, VIDEO_STOP_CAPTURE = 2000, 2500, 2501
DO_DIGICAM_CONTROL: Final = 203
GIMBAL_PITCH_YAW, GIMBAL_CONFIGURE = 1000, 1001
CAMERA_TYPE: Final = 30
"""MAV_TYPE_CAMERA."""
MANAGER: Final = frozenset({"GIMBAL_MANAGER_INFORMATION", "GIMBAL_MANAGER_STATUS"})
KEEP: Final = -1.0
"""Of DO_GIMBAL_MANAGER_CONFIGURE: who else controls it stays as it is."""


class CameraParts(NamedTuple):
    """Who speaks for the camera and the gimbal of a vehicle."""

    camera: Address | None = None
    manager: Address | None = None


class CameraReceiver(Microservice[CameraParts]):
    """Hears cameras and managers of gimbals; what is new is an event."""

    handles = frozenset({"HEARTBEAT", *MANAGER})

    def __init__(self, own: Address) -> None:
        super().__init__(own)
        self._known = CameraParts()

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Handles a heartbeat or a report of a manager; the first camera is taken."""
        del now_s
        known = self._known
        if message.name in MANAGER:
            known = known._replace(manager=sender)
        elif message.type == CAMERA_TYPE and known.camera is None:
            known = known._replace(camera=sender)
        if known != self._known:
            self._known = known
            self._events.append(known)


class CameraService:
    """Commands a vehicle's camera and gimbal.

    Args:
        machines: run the clients, a `CameraReceiver` among them.
        commands: sends the commands.
        target: the autopilot, which speaks for both where nobody else does.
    """

    def __init__(self, machines: Machines, commands: MavCommandClient, target: Address) -> None:
        self._machines, self._commands, self._target = machines, commands, target
        self._parts = CameraParts()
        self._pictures = 0
        machines.on_event(self._receive_event)

    async def take_picture(self) -> None:
        """Takes one picture.

        Raises:
            Refused: there is no camera, or it refuses or does not answer.
        """
        self._pictures += 1
        capture = (0.0, 0.0, 1.0, float(self._pictures), nan, nan, nan)
        result = await self._request(self._camera, IMAGE_START_CAPTURE, capture)
        if result is CommandResult.UNSUPPORTED and self._parts.camera is None:
            result = await self._request(self._target, DO_DIGICAM_CONTROL, (0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0))
        self._require(result)

    async def record(self, *, is_on: bool) -> None:
        """Begins or ends a recording.

        Raises:
            Refused: there is no camera, or it refuses or does not answer.
        """
        number, first = (VIDEO_START_CAPTURE, (0.0, 0.0)) if is_on else (VIDEO_STOP_CAPTURE, (0.0, nan))
        self._require(await self._request(self._camera, number, (*first, *[nan] * 5)))

    async def point(self, pitch_deg: float, yaw_deg: float) -> None:
        """Points the camera.

        Args:
            pitch_deg: above the horizon.
            yaw_deg: to the right of the vehicle's nose.

        Raises:
            Refused: there is no gimbal, or it refuses or does not answer.
        """
        manager, own = self._parts.manager or self._target, self._commands.own
        taken = (float(own.system), float(own.component), KEEP, KEEP, nan, nan, 0.0)
        result = await self._request(manager, GIMBAL_CONFIGURE, taken)
        if result is not CommandResult.UNSUPPORTED:  # a manager without control by one has none to give
            self._require(result, "gimbal")
        result = await self._request(manager, GIMBAL_PITCH_YAW, (pitch_deg, yaw_deg, nan, nan, 0.0, nan, 0.0))
        self._require(result, "gimbal")

    @property
    def _camera(self) -> Address:
        return self._parts.camera or self._target

    async def _request(self, owner: Address, number: int, parameters: tuple[float, ...]) -> CommandResult | None:
        machines = self._machines
        call = self._commands.send_long(owner, number, parameters, now_s=machines.now_s)
        try:
            await machines.until(lambda: call.result is not None)
        finally:
            self._commands.abandon(call)
        return call.result

    def _require(self, result: CommandResult | None, what: str = "camera") -> None:
        if result is CommandResult.UNSUPPORTED:
            raise Refused(f"it has no {what} that answers to MAVLink")
        if result is not CommandResult.ACCEPTED:
            raise Refused(f"its {what}: {result.words if result is not None else 'cancelled'}")

    def _receive_event(self, event: object) -> None:
        if isinstance(event, CameraParts):
            self._parts = event
