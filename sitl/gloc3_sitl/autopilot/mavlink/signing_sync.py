"""Signing of the autopilot's links: SETUP_SIGNING, and the rules for signing, accepting and dropping frames.

PX4: docs.px4.io, "MAVLink Message Signing" (from 1.17 on); ArduPilot: `GCS_Signing.cpp`.
"""

from typing import Final

from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.parser import Frame
from gloc3.mavlink.signing import Signing, SigningVerdict, Streams
from gloc3_sitl.autopilot.mavlink.links import AutopilotPort

_NEVER_SIGNED: Final = {"px4": frozenset({0, 109, 246, 247}), "ardupilot": frozenset({109, 166})}
"""Taken without a signature: PX4 heartbeats, radios, other aircraft and collisions; ArduPilot radios."""


class SigningSync:
    """Signs and verifies the frames of all links of an autopilot with a key.

    Its time is that of the key or of the latest frame, as on an autopilot without a fix.

    Args:
        own: the autopilot.
        style: `px4` or `ardupilot`.
    """

    def __init__(self, own: Address, style: str) -> None:
        self._own, self._style = own, style
        self._key: bytes | None = None
        self._begins_at = 0
        self._streams = Streams()
        self._links: list[AutopilotPort] = []
        self.dropped = 0
        """Frames that were not signed with the key, or were repeated."""

    def load(self, before: "SigningSync") -> None:
        """Keeps the key over a reboot, with the latest time that it has seen."""
        self._key, self._begins_at, self._streams = before._key, before._latest(), before._streams

    def equip(self, link: AutopilotPort) -> None:
        """Takes a link in; in ArduPilot's style the first serial or TCP one takes unsigned frames, as its USB port does."""
        link.is_trusted = (
            self._style == "ardupilot" and not link.is_datagram and not any(other.is_trusted for other in self._links)
        )
        self._links.append(link)
        self._sign(link, len(self._links) - 1)

    def passes(self, frame: Frame, link: AutopilotPort) -> bool:
        """Whether a frame is accepted and forwarded."""
        signing = link.encoder.signing
        if signing is None:
            return True
        signing.advance(signing.timestamp)
        verdict = signing.verify(frame)
        if verdict.is_good or (link.is_trusted and verdict is not SigningVerdict.REPEATED):
            return True
        self.dropped += 1
        return False

    def set_up(self, message: MavlinkMessage, *, is_armed: bool) -> str:
        """SETUP_SIGNING: sets a key, or deletes it if all zero; returns the reason for a refusal."""
        if message.target_system not in (0, self._own.system) or message.target_component not in (
            0,
            self._own.component,
        ):
            return ""
        if is_armed:
            return "the signing key cannot be changed while armed"
        key, self._begins_at = bytes(message.secret_key), message.initial_timestamp
        self._key = key if any(key) or self._begins_at else None
        self._streams = Streams()
        for number, link in enumerate(self._links):
            self._sign(link, number)
        return ""

    def _sign(self, link: AutopilotPort, number: int) -> None:
        link.encoder.signing = (
            None
            if self._key is None
            else Signing(
                self._key,
                link_id=number & 0xFF,
                now=self._begins_at,
                unsigned_ids=_NEVER_SIGNED[self._style],
                streams=self._streams,
                most_ahead=None,
            )
        )

    def _latest(self) -> int:
        return max((link.encoder.signing.timestamp for link in self._links if link.encoder.signing), default=0)
