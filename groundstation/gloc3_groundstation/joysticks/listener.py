"""Reader and listener of joysticks: what passes between them."""

from typing import Final, Protocol

from gloc3_groundstation.joysticks.device import JoystickDevice, JoystickReading

ALIVE_S: Final = 0.1
"""Longest time between two readings of a connected joystick, s."""


class JoystickListener(Protocol):
    """Receives what a reader finds; a number names a device for as long as it is connected."""

    def connected(self, number: int, device: JoystickDevice) -> None:
        """A joystick is found."""

    def disconnected(self, number: int, reason: str) -> None:
        """A joystick is gone."""

    def moved(self, number: int, reading: JoystickReading) -> None:
        """Positions of a joystick: after each change, and repeated at least every `ALIVE_S`."""

    def failed(self, reason: str) -> None:
        """No joystick can be read; it is tried again."""


class JoystickReader(Protocol):
    """Reads all joysticks, and finds those that are plugged in later."""

    async def close(self) -> None:
        """Reads no more."""
