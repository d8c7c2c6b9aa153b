"""A vehicle's self-description: firmware, type, arming, version, and its encoding of integer parameters."""

from contextlib import suppress
from enum import StrEnum
from typing import Final, Never

import msgspec

from gloc3.errors import Refused
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.service import Microservice
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_client import CommandCall, MavCommandClient
from gloc3.mavlink.services.heartbeat import ARMED
from gloc3.mavlink.services.interval import REQUEST_MESSAGE
from gloc3.mavlink.services.parameter import ParameterEncoding
from gloc3.mavlink.services.version import AUTOPILOT_VERSION, ProtocolCapability, Version, read_version
from gloc3_groundstation.services.machines import Machines

LEARN_S: Final = 5.0
"""Longest time for a vehicle to report its version; without it only the heartbeat is used."""
RETRY_S: Final = 60.0
"""Time before a vehicle that has not reported its version is asked again, s."""


class Firmware(StrEnum):
    """Firmware family of an autopilot."""

    PX4 = "PX4"
    ARDUPILOT = "ArduPilot"
    OTHER = "unknown firmware"


FIRMWARES: Final = {3: Firmware.ARDUPILOT, 12: Firmware.PX4}
"""By MAV_AUTOPILOT."""
_IN_AIR: Final = (2, 3, 4)
"""MAV_LANDED_STATE: in the air, taking off, landing."""


class ServicesSnapshot(msgspec.Struct, frozen=True, kw_only=True):
    """A vehicle's last known state."""

    address: Address
    firmware: Firmware = Firmware.OTHER
    vehicle_type: int = 0
    """MAV_TYPE."""
    is_armed: bool = False
    is_in_air: bool = False
    """As it last said in EXTENDED_SYS_STATE; false where it does not say."""
    received_s: float | None = None
    """Time of its last heartbeat, on the station's clock; None before the first."""
    version: Version | None = None
    """None until it was requested and received."""

    @property
    def title(self) -> str:
        """For a person, as "PX4 1.15.4, system 1"."""
        version = f" {self.version.words}" if self.version is not None and self.version.flight_software else ""
        return f"{self.firmware}{version}, system {self.address.system}"

    @property
    def encoding(self) -> ParameterEncoding:
        """How it puts integers into parameters: as it says, or else as its firmware does."""
        capabilities = ProtocolCapability(0) if self.version is None else self.version.capabilities
        if ProtocolCapability.PARAM_ENCODE_BYTEWISE in capabilities:
            return ParameterEncoding.BYTEWISE
        if ProtocolCapability.PARAM_ENCODE_C_CAST in capabilities:
            return ParameterEncoding.CAST
        return ParameterEncoding.BYTEWISE if self.firmware is Firmware.PX4 else ParameterEncoding.CAST


class SnapshotService(Microservice[Never]):
    """Keeps a vehicle's snapshot up to date."""

    handles = frozenset({"HEARTBEAT", "AUTOPILOT_VERSION", "EXTENDED_SYS_STATE"})

    def __init__(self, own: Address, target: Address, commands: MavCommandClient) -> None:
        super().__init__(own)
        self.snapshot = ServicesSnapshot(address=target)
        self._commands = commands
        self._retry_s = 0.0

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Handles the autopilot's messages about itself."""
        if sender != self.snapshot.address:
            return
        if message.name == "HEARTBEAT":
            self.snapshot = msgspec.structs.replace(
                self.snapshot,
                firmware=FIRMWARES.get(message.autopilot, Firmware.OTHER),
                vehicle_type=message.type,
                is_armed=bool(message.base_mode & ARMED),
                received_s=now_s,
            )
        elif message.name == "EXTENDED_SYS_STATE":
            is_in_air = message.landed_state in _IN_AIR
            self.snapshot = msgspec.structs.replace(self.snapshot, is_in_air=is_in_air)
        else:
            self.snapshot = msgspec.structs.replace(self.snapshot, version=read_version(message))

    async def learn(self, machines: Machines) -> ServicesSnapshot:
        """Waits for a heartbeat and the version, but not for long, nor often; what stays away stays unknown."""
        if self.snapshot.received_s is not None and (
            self.snapshot.version is not None or machines.now_s < self._retry_s
        ):
            return self.snapshot
        call: CommandCall | None = None
        with suppress(Refused):  # somebody else is asking just now
            target = self.snapshot.address
            call = self._commands.send_long(target, REQUEST_MESSAGE, (AUTOPILOT_VERSION,), now_s=machines.now_s)
        ends_s = machines.now_s + LEARN_S
        timer = machines.loop.call_at(ends_s, machines.settle)

        def is_over() -> bool:
            is_refused = call is not None and call.result not in (None, CommandResult.ACCEPTED)
            is_complete = self.snapshot.received_s is not None and (self.snapshot.version is not None or is_refused)
            return is_complete or machines.now_s >= ends_s

        try:
            await machines.until(is_over)
        finally:
            timer.cancel()
            if call is not None:
                self._commands.abandon(call)
        self._retry_s = machines.now_s + RETRY_S
        return self.snapshot
