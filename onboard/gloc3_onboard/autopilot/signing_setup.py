"""Sets the signing key of an autopilot, and checks that it signs with it."""

from __future__ import annotations

import asyncio
from collections import Counter
from enum import StrEnum
from typing import Final

from gloc3.mavlink import codec
from gloc3.mavlink.codec import Address, Encoder, Frame, MavlinkMessage, Parser
from gloc3.mavlink.services.heartbeat import ARMED, AUTOPILOT_INVALID, GROUND_STATION
from gloc3.mavlink.signing import KEY_BYTES, Signing, is_signed_with
from gloc3.mavlink.transport.endpoints import Endpoint

FAMILIES: Final = {3: "ArduPilot", 12: "PX4"}
SENT_TIMES: Final = 2
"""There is no answer to SETUP_SIGNING, so that it is sent again, as others do."""
HEARTBEAT_S: Final = 0.5
OWN: Final = Address(255, 190)
"""PX4 and ArduPilot listen to a ground station."""


class Signs(StrEnum):
    """Signing states of the autopilot's frames."""

    NOT = "not signed"
    OURS = "signed with this key"
    PRESENT = "signed with the present key"
    OTHER = "signed with another key"


class Setup:
    """Signing setup of one autopilot over a direct link.

    Args:
        endpoint: sends frames; its owner passes received data to `receive`.
        key: the autopilot's new or present key.
        present: its previous key, if known.
        now: returns the signing time.
    """

    def __init__(self, endpoint: Endpoint, key: bytes, present: bytes | None, now: int) -> None:
        self.autopilot: Address | None = None
        """Address of the autopilot, once heard."""
        self.family = ""
        self.is_armed = False
        self.signs: Counter[Signs] = Counter()
        """How its frames were signed since the last `reset`."""
        self._endpoint, self._now = endpoint, now
        self._parser = Parser(is_datagram=endpoint.is_datagram)
        self._keys = {Signs.OURS: key} | ({} if present is None else {Signs.PRESENT: present})
        self._signing: Signing | None = None
        self._encoder = Encoder(*OWN)

    def receive(self, data: bytes) -> None:
        """Handles data from the link."""
        for frame in self._parser.receive(data):
            message = frame.decode()
            if message is not None and message.name == "HEARTBEAT" and message.autopilot != AUTOPILOT_INVALID:
                if self.autopilot is None:
                    self.autopilot = frame.sender
                    self.family = FAMILIES.get(message.autopilot, "an autopilot of another kind")
                if frame.sender == self.autopilot:
                    self.is_armed = bool(message.base_mode & ARMED)
            if frame.sender == self.autopilot:
                self.signs[self._judge(frame)] += 1

    async def listen(self, for_s: float, until: Signs | None = None) -> None:
        """Listens and sends heartbeats: for a time, or until a frame of some kind has come."""
        loop = asyncio.get_running_loop()
        end_s = loop.time() + for_s
        while loop.time() < end_s and not (until is not None and self.signs[until]):
            self._send(codec.message("HEARTBEAT", type=GROUND_STATION, autopilot=AUTOPILOT_INVALID, mavlink_version=3))
            await asyncio.sleep(min(HEARTBEAT_S, max(0.0, end_s - loop.time())))

    def sign_with(self, which: Signs | None) -> None:
        """Selects the key that signs outgoing frames: the new or the present one; None stops signing."""
        key = None if which is None else self._keys[which]
        self._signing = None if key is None else Signing(key, link_id=0, now=self._now)
        self._encoder = Encoder(*OWN, self._signing)

    def reset(self) -> None:
        """Resets the counts."""
        self.signs.clear()

    def give(self) -> None:
        """Sends the key."""
        self._set(self._keys[Signs.OURS], self._now)

    def remove_key(self) -> None:
        """Switches signing off, which a key of zeros does."""
        self._set(bytes(KEY_BYTES), 0)

    def _set(self, key: bytes, initial_timestamp: int) -> None:
        assert self.autopilot is not None
        system, component = self.autopilot
        setup = codec.message(
            "SETUP_SIGNING",
            target_system=system,
            target_component=component,
            secret_key=key,
            initial_timestamp=initial_timestamp,
        )
        for _ in range(SENT_TIMES):
            self._send(setup)

    def _send(self, message: MavlinkMessage) -> None:
        self._endpoint.send(self._encoder.encode(message))

    def _judge(self, frame: Frame) -> Signs:
        """Only by the signature: what time the autopilot believes it to be is another question."""
        if not frame.is_signed:
            return Signs.NOT
        for which, key in self._keys.items():
            if is_signed_with(key, frame):
                return which
        return Signs.OTHER
