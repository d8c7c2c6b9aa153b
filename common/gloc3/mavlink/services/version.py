"""AUTOPILOT_VERSION: version and capabilities of a component, sent on request and requested."""

from __future__ import annotations

from enum import IntFlag
from typing import Final

import msgspec

from gloc3.mavlink.codec import message as make
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.service import Microservice
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_server import MavCommandRequest
from gloc3.mavlink.services.interval import REQUEST_MESSAGE

AUTOPILOT_VERSION: Final = 148
REQUEST_AUTOPILOT_CAPABILITIES: Final = 520
RETRY_S: Final = 1.0


class ProtocolCapability(IntFlag):
    """MAV_PROTOCOL_CAPABILITY."""

    MISSION_FLOAT = 1
    PARAM_FLOAT = 2
    MISSION_INT = 4
    COMMAND_INT = 8
    PARAM_ENCODE_BYTEWISE = 16
    FTP = 32
    SET_ATTITUDE_TARGET = 64
    SET_POSITION_TARGET_LOCAL_NED = 128
    SET_POSITION_TARGET_GLOBAL_INT = 256
    TERRAIN = 512
    RESERVED3 = 1024
    FLIGHT_TERMINATION = 2048
    COMPASS_CALIBRATION = 4096
    MAVLINK2 = 8192
    MISSION_FENCE = 16384
    MISSION_RALLY = 32768
    RESERVED2 = 65536
    PARAM_ENCODE_C_CAST = 131072
    COMPONENT_IMPLEMENTS_GIMBAL_MANAGER = 262144
    COMPONENT_ACCEPTS_GCS_CONTROL = 524288
    GRIPPER = 1048576


def version_number(major: int, minor: int, patch: int, release: int = 255) -> int:
    """A version in one number, as AUTOPILOT_VERSION has it; release 0 development, 64 alpha, 128 beta, 255 official."""
    return major << 24 | minor << 16 | patch << 8 | release


class Version(msgspec.Struct, frozen=True, kw_only=True):
    """Version and capabilities that a component reports."""

    capabilities: ProtocolCapability
    flight_software: int = 0
    """As encoded by `version_number`."""
    middleware_software: int = 0
    os_software: int = 0
    board: int = 0
    vendor_id: int = 0
    product_id: int = 0
    uid: int = 0
    """The hardware's own number; 0 if it has none."""

    def message(self) -> MavlinkMessage:
        """AUTOPILOT_VERSION."""
        return make(
            "AUTOPILOT_VERSION",
            capabilities=int(self.capabilities),
            flight_sw_version=self.flight_software,
            middleware_sw_version=self.middleware_software,
            os_sw_version=self.os_software,
            board_version=self.board,
            vendor_id=self.vendor_id,
            product_id=self.product_id,
            uid=self.uid,
        )

    @property
    def words(self) -> str:
        """The flight software's version for a person, as "1.15.4"."""
        number = self.flight_software
        return f"{number >> 24 & 0xFF}.{number >> 16 & 0xFF}.{number >> 8 & 0xFF}"


def read_version(message: MavlinkMessage) -> Version:
    """What an AUTOPILOT_VERSION says."""
    return Version(
        capabilities=ProtocolCapability(message.capabilities),
        flight_software=message.flight_sw_version,
        middleware_software=message.middleware_sw_version,
        os_software=message.os_sw_version,
        board=message.board_version,
        vendor_id=message.vendor_id,
        product_id=message.product_id,
        uid=message.uid,
    )


class VersionServer(Microservice[Version]):
    """Sends our version when a command requests it."""

    def __init__(self, own: Address, version: Version) -> None:
        super().__init__(own)
        self.version = version

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Does nothing: the version is requested by command."""

    def command(self, request: MavCommandRequest) -> CommandResult | None:
        """Executes a command that requests the version, and returns its result; None for any other command."""
        is_request = request.command == REQUEST_MESSAGE and request.params[0] == AUTOPILOT_VERSION
        if not is_request and request.command != REQUEST_AUTOPILOT_CAPABILITIES:
            return None
        self._outgoing.append(self.version.message())
        return CommandResult.ACCEPTED
