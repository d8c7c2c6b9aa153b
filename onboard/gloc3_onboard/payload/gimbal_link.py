"""A gimbal on the autopilot's network, by the gimbal protocol v2: this process is its manager, or a client of another.

A gimbal device is a component of its own (154, 171…) that reports its attitude and is sent GIMBAL_DEVICE_SET_ATTITUDE.
Where the autopilot is the gimbal manager (PX4's `MNT_MODE_OUT`, ArduPilot's `MNT1_TYPE`), nobody else may command the
device: control is requested from that manager, and targets go there.
"""

from collections.abc import Callable
from contextlib import suppress
from math import isfinite, nan, pi
from typing import Any, Final, Never

from gloc3.errors import Refused
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.service import Microservice
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_client import CommandCall, MavCommandClient
from gloc3.mavlink.services.interval import REQUEST_MESSAGE, SET_MESSAGE_INTERVAL
from gloc3.messages.frames import from_euler, to_euler
from gloc3_onboard.payload.pointing import GimbalAttitude, GimbalProperties, GimbalTarget

CONFIGURE: Final = 1001
"""MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE."""
RETRY_S: Final = 2.0
MANAGER_ATTEMPTS: Final = 3
"""Requests to an autopilot for its gimbal manager; one without does not answer or refuses."""
_GIMBAL: Final = 26
"""MAV_TYPE_GIMBAL."""
_MANAGER_INFORMATION, _MANAGER_STATUS, _DEVICE_INFORMATION, _DEVICE_ATTITUDE = 280, 281, 283, 285
ATTITUDE_HZ: Final = 10.0
STATUS_HZ: Final = 2.0
_NEUTRAL, _LEVEL, _YAW_LOCK, _IN_VEHICLE, _FROM_NORTH = 2, 4 | 8, 16, 32, 64
"""GIMBAL_DEVICE_FLAGS: roll and pitch are always measured from the horizon."""
_OWN_NUMBERS: Final = range(1, 7)
"""Numbers of gimbals that are no MAVLink components."""


class GimbalLink(Microservice[Never]):
    """The conversation with one gimbal; the first one that is heard is used.

    Args:
        own: this process's address.
        client: sends commands to the autopilot.
        post: calls in the loop's thread, from any thread.
        settle: has waiting messages sent.
    """

    handles = frozenset(
        {
            "HEARTBEAT",
            "GIMBAL_DEVICE_INFORMATION",
            "GIMBAL_DEVICE_ATTITUDE_STATUS",
            "GIMBAL_MANAGER_INFORMATION",
            "GIMBAL_MANAGER_STATUS",
        }
    )

    def __init__(
        self,
        own: Address,
        client: MavCommandClient,
        post: Callable[[Callable[[], None]], None],
        settle: Callable[[], None],
    ) -> None:
        super().__init__(own)
        self.autopilot: Address | None = None
        """The autopilot, which may be a gimbal manager."""
        self._client, self._post, self._settle = client, post, settle
        self._is_open = False
        self._device: Address | None = None
        self._manager: Address | None = None
        self._properties: GimbalProperties | None = None
        self._attitude: GimbalAttitude | None = None
        self._owner: tuple[int, int] | None = None
        """System and component that the manager obeys; None while unknown."""
        self._request_s = self._configured_s = float("-inf")
        self._attempts = 0
        self._requested: Address | None = None
        self._call: CommandCall | None = None
        """Request for the autopilot's gimbal manager."""
        self._now_s = 0.0

    # --- the device's face to the driver, from any thread ---

    def open(self) -> None:
        """Begins to look for a gimbal."""
        self._is_open = True

    def properties(self) -> GimbalProperties | None:
        """The gimbal; None while none has been found."""
        return self._properties

    def attitude(self) -> GimbalAttitude | None:
        """The latest attitude; None before the first."""
        return self._attitude

    def other_owner(self) -> str:
        """Who points it at the autopilot's manager; empty for nobody, or this process."""
        if self._manager is None or self._owner in (None, (0, 0), self.own, self._manager):
            return ""
        assert self._owner is not None
        return f"{self._owner[0]}/{self._owner[1]}"

    def point(self, target: GimbalTarget) -> None:
        """Sends a target to the gimbal, or to its manager, of which control is requested first."""

        def send() -> None:
            if self._properties is not None:
                self._send_target(target, self._properties)
                self._settle()

        self._post(send)

    # --- the loop's side ---

    def tick(self, now_s: float) -> None:
        """Asks for what is missing."""
        self._now_s = now_s
        if not self._is_open or self._properties is not None or now_s < self._request_s:
            return
        self._request_s = now_s + RETRY_S
        if self._device is not None:
            self._request(self._device, REQUEST_MESSAGE, _DEVICE_INFORMATION)
            self._request(self._device, SET_MESSAGE_INTERVAL, _DEVICE_ATTITUDE, 1e6 / ATTITUDE_HZ)
        if self.autopilot != self._requested:
            self._requested, self._attempts = self.autopilot, 0
        if self.autopilot is not None and self._attempts < MANAGER_ATTEMPTS:
            with suppress(Refused):  # the same command for another message is under way: the next time
                self._call = self._client.send_long(
                    self.autopilot, REQUEST_MESSAGE, (float(_MANAGER_INFORMATION),), now_s=now_s
                )
                self._attempts += 1

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Handles what gimbals, and an autopilot that manages one, report."""
        if not self._is_open or sender.system != self.own.system:
            return
        match message.name:
            case "HEARTBEAT":
                if message.type == _GIMBAL and self._device is None:
                    self._device, self._request_s = sender, now_s
            case "GIMBAL_DEVICE_INFORMATION":
                if sender == self._device and self._is_unmanaged:
                    self._properties = _properties_of(message, sender.component, 0)
            case "GIMBAL_MANAGER_INFORMATION":
                if sender == self.autopilot and message.gimbal_device_id:
                    self._adopt_manager(message, sender)
            case "GIMBAL_MANAGER_STATUS":
                if sender == self.autopilot and self._manager is None and message.gimbal_device_id:
                    self._properties, self._attempts, self._manager = (
                        None,
                        0,
                        sender,
                    )  # it says what it manages if asked
                if sender == self._manager:
                    self._owner = (message.primary_control_sysid, message.primary_control_compid)
            case _:
                self._receive_attitude(message, sender, now_s)

    @property
    def _is_unmanaged(self) -> bool:
        """Whether the autopilot is known to manage no gimbal: it refuses to say what it manages, or does not answer."""
        result = self._call.result if self._call is not None else None
        is_refused = result is not None and result not in (CommandResult.ACCEPTED, CommandResult.NO_ANSWER)
        return self._manager is None and (is_refused or self._attempts >= MANAGER_ATTEMPTS)

    def _adopt_manager(self, message: MavlinkMessage, sender: Address) -> None:
        self._manager = sender
        self._properties = _properties_of(message, message.gimbal_device_id, sender.component)
        self._request(sender, SET_MESSAGE_INTERVAL, _MANAGER_STATUS, 1e6 / STATUS_HZ)
        self._request(sender, SET_MESSAGE_INTERVAL, _DEVICE_ATTITUDE, 1e6 / ATTITUDE_HZ)

    def _receive_attitude(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        properties = self._properties
        number = message.gimbal_device_id or sender.component
        if properties is None or number != properties.device:
            return
        if not all(isfinite(part) for part in message.q):
            return
        roll, pitch, yaw = to_euler(tuple(message.q))
        flags = message.flags
        is_from_north = bool(flags & _FROM_NORTH) or (bool(flags & _YAW_LOCK) and not flags & _IN_VEHICLE)
        self._attitude = GimbalAttitude(now_s, roll, pitch, yaw, is_from_north, flags, message.failure_flags)

    def _send_target(self, target: GimbalTarget, properties: GimbalProperties) -> None:
        flags = _LEVEL | (_YAW_LOCK | _FROM_NORTH if target.is_from_north else _IN_VEHICLE)
        q, rates = (nan, nan, nan, nan), (nan, nan, nan)
        if target.is_neutral:
            flags |= _NEUTRAL
        elif target.is_rate:
            rates = (0.0, target.pitch_rad, target.yaw_rad)
        else:
            q = from_euler(0.0, target.pitch_rad, target.yaw_rad)
        fields: dict[str, Any] = dict(zip(("angular_velocity_x", "angular_velocity_y", "angular_velocity_z"), rates))  # noqa: B905
        if self._manager is None:
            device = Address(self.own.system, properties.device)
            self._send_to(device, "GIMBAL_DEVICE_SET_ATTITUDE", flags=flags, q=q, **fields)
            return
        if self._owner != self.own and self._now_s - self._configured_s >= RETRY_S:
            self._configured_s = self._now_s
            system, component, number = float(self.own.system), float(self.own.component), float(properties.device)
            parameters = (system, component, -1.0, -1.0, nan, nan, number)
            with suppress(Refused):  # it is under way
                self._client.send_long(self._manager, CONFIGURE, parameters, now_s=self._now_s)
        fields["gimbal_device_id"] = properties.device
        self._send_to(self._manager, "GIMBAL_MANAGER_SET_ATTITUDE", flags=flags, q=q, **fields)

    def _request(self, target: Address, command: int, *parameters: float) -> None:
        """Sends a command to the gimbal, whose answer is the message that it asks for."""
        values = {f"param{number}": float(value) for number, value in enumerate(parameters, start=1)}
        self._send_to(target, "COMMAND_LONG", command=command, **values)


def _properties_of(message: MavlinkMessage, device: int, manager: int) -> GimbalProperties:
    return GimbalProperties(
        device=device,
        pitch_limits_rad=_limits(message.pitch_min, message.pitch_max),
        yaw_limits_rad=_limits(message.yaw_min, message.yaw_max),
        capability_flags=message.cap_flags & 0xFFFF,
        manager=manager,
    )


def _limits(least: float, most: float) -> tuple[float, float]:
    """Limits of an angle; a missing or infinite one is that of a whole turn."""
    return (least if isfinite(least) else -pi, most if isfinite(most) else pi)
