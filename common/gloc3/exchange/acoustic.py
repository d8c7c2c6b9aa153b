"""Messages over an acoustic modem: a summary of at most 32 bytes, a command, a receipt; all big-endian.

Each frame: version and kind (4 bits each), the platform (1 byte), sequence (2), its fields, and a tag of 4 bytes: the
begin of an HMAC-SHA256 with the link's key, or a CRC-32 where there is none.
"""

import hashlib
import hmac
import struct
import zlib
from collections.abc import Sequence
from enum import IntEnum
from typing import Final

import msgspec

from gloc3.messages.envelope import Message
from gloc3.messages.summaries import Health, MissionSummary, VehicleSummary
from gloc3.mission.model.policy import Policy
from gloc3.mission.model.states import ActionState

VERSION: Final = 1
MOST_BYTES: Final = 32
_HEAD: Final = struct.Struct(">BBH")
_SUMMARY: Final = struct.Struct(">IiiiBBBBBBBB")
_ORDER: Final = struct.Struct(">IB")
_RECEIPT: Final = struct.Struct(">IB")
_TAG_BYTES: Final = 4
_NOTHING: Final = 255
_STATES: Final = ("", *(str(state) for state in ActionState))
_POLICIES: Final = ("", "pilot", *(str(policy) for policy in Policy), "failsafe", "operator")
_HEALTHS: Final = tuple(Health)


class AcousticFrameKind(IntEnum):
    """What a frame is."""

    SUMMARY = 1
    ORDER = 2
    RECEIPT = 3


class AcousticVerb(IntEnum):
    """What can be ordered."""

    HOLD = 1
    SURFACE = 2
    """Give the mission up and come up, or land, here."""


class AcousticSummary(Message, frozen=True):
    """State of the vehicle, as sent over the acoustic link."""

    t_s: float
    """On the platform's clock, to a tenth of a second."""
    position_m: tuple[float, float, float]
    """x, y, height in the platform's local frame, to a tenth of a metre; below the surface the height is negative."""
    heading_deg: int
    speed_m_s: float
    battery_percent: int
    """-1 where it is not known."""
    state: str
    """Of the mission; empty where none is loaded."""
    health: Health
    is_pose_valid: bool
    is_armed: bool
    policy: str
    doing: int
    """First action under way: its index among the mission's tasks and actions; -1 for none."""
    mission: int
    """First byte of the mission's digest, with which a station checks that it has the same mission."""
    worst: int
    """Severity of the worst event not yet sent to a station; 7 for none."""


class AcousticOrder(msgspec.Struct, frozen=True):
    """What the station wants done."""

    number: int
    """Grows with every order: an older one is not taken."""
    verb: AcousticVerb


class Receipt(msgspec.Struct, frozen=True):
    """An order has come."""

    number: int
    is_accepted: bool


AcousticFrame = AcousticSummary | AcousticOrder | Receipt


class AcousticCode:
    """Frames of one platform.

    Args:
        platform: its name.
        key: of the link; None for none.
    """

    def __init__(self, platform: str, key: bytes | None = None) -> None:
        self._platform = zlib.crc32(platform.encode()) & 0xFF
        self._key = key
        self._sequence = 0
        self.refused = 0
        """Frames that were damaged, of another platform or version, or not tagged with our key."""

    def encode(self, frame: AcousticFrame) -> bytes:
        """The bytes of a frame."""
        match frame:
            case AcousticSummary():
                kind, body = AcousticFrameKind.SUMMARY, _pack(frame)
            case AcousticOrder(number=number, verb=verb):
                kind, body = AcousticFrameKind.ORDER, _ORDER.pack(number, verb)
            case Receipt(number=number, is_accepted=is_accepted):
                kind, body = AcousticFrameKind.RECEIPT, _RECEIPT.pack(number, is_accepted)
        self._sequence = self._sequence + 1 & 0xFFFF
        data = _HEAD.pack(VERSION << 4 | kind, self._platform, self._sequence) + body
        return data + self._tag(data)

    def decode(self, data: bytes) -> AcousticFrame | None:
        """Decodes a frame; None, and counted, if it is invalid or of another platform."""
        frame = self._decoded(data)
        self.refused += frame is None
        return frame

    def _decoded(self, data: bytes) -> AcousticFrame | None:
        if not _HEAD.size + _TAG_BYTES < len(data) <= MOST_BYTES:
            return None
        begin, tag = data[:-_TAG_BYTES], data[-_TAG_BYTES:]
        first, platform, _ = _HEAD.unpack_from(begin)
        if platform != self._platform or first >> 4 != VERSION or not hmac.compare_digest(tag, self._tag(begin)):
            return None
        body = begin[_HEAD.size :]
        try:
            match first & 0x0F:
                case AcousticFrameKind.SUMMARY:
                    return _unpack(body)
                case AcousticFrameKind.ORDER:
                    number, verb = _ORDER.unpack(body)
                    return AcousticOrder(number, AcousticVerb(verb))
                case AcousticFrameKind.RECEIPT:
                    number, is_accepted = _RECEIPT.unpack(body)
                    return Receipt(number, bool(is_accepted))
        except (struct.error, ValueError, IndexError):
            return None
        return None

    def _tag(self, data: bytes) -> bytes:
        if self._key is None:
            return zlib.crc32(data).to_bytes(_TAG_BYTES, "big")
        return hmac.digest(self._key, data, hashlib.sha256)[:_TAG_BYTES]


def summary_of(vehicle: VehicleSummary, mission: MissionSummary | None, health: Health, worst: int) -> AcousticSummary:
    """Builds the acoustic summary from the messages that stations receive on other links."""
    tasks = list(mission.tasks.items()) if mission is not None else []
    doing = [index for index, (target, state) in enumerate(tasks) if "." in target and state == "running"]
    digest = mission.digest if mission is not None else ""
    x_m, y_m, height_m = vehicle.position_m
    return AcousticSummary(
        t_s=round(vehicle.t_s, 1),
        position_m=(round(x_m, 1), round(y_m, 1), round(height_m, 1)),
        heading_deg=vehicle.heading_deg % 360,
        speed_m_s=vehicle.speed_m_s,
        battery_percent=vehicle.battery_percent,
        state=mission.state if mission is not None else "",
        health=health,
        is_pose_valid=vehicle.is_pose_valid,
        is_armed=vehicle.is_armed,
        policy=mission.policy if mission is not None else "",
        doing=doing[0] if doing and doing[0] < _NOTHING else -1,
        mission=int(digest[:2] or "0", 16),
        worst=worst,
    )


def action_of(summary: AcousticSummary, mission: MissionSummary | None) -> str:
    """Name of the action under way, if the station has the mission; else empty."""
    if mission is None or int(mission.digest[:2] or "0", 16) != summary.mission:
        return ""
    names = list(mission.tasks)
    return names[summary.doing] if 0 <= summary.doing < len(names) else ""


def _pack(summary: AcousticSummary) -> bytes:
    x, y, height = (max(-(2**31), min(2**31 - 1, round(10.0 * value))) for value in summary.position_m)
    health = _HEALTHS.index(summary.health)
    flags = _index(_STATES, summary.state) << 4 | summary.is_pose_valid << 3 | summary.is_armed << 2
    return _SUMMARY.pack(
        round(10.0 * summary.t_s) & 0xFFFF_FFFF,
        x,
        y,
        height,
        round(summary.heading_deg * 256.0 / 360.0) & 0xFF,
        min(255, round(20.0 * summary.speed_m_s)),
        summary.battery_percent if summary.battery_percent >= 0 else _NOTHING,
        flags,
        _index(_POLICIES, summary.policy) << 4 | health,
        summary.doing if summary.doing >= 0 else _NOTHING,
        summary.mission,
        summary.worst,
    )


def _unpack(body: bytes) -> AcousticSummary:
    t, x, y, height, heading, speed, battery, flags, more, doing, mission, worst = _SUMMARY.unpack(body)
    return AcousticSummary(
        t_s=t / 10.0,
        position_m=(x / 10.0, y / 10.0, height / 10.0),
        heading_deg=round(heading * 360.0 / 256.0) % 360,
        speed_m_s=speed / 20.0,
        battery_percent=-1 if battery == _NOTHING else battery,
        state=_STATES[flags >> 4],
        health=_HEALTHS[more & 0x0F],
        is_pose_valid=bool(flags & 8),
        is_armed=bool(flags & 4),
        policy=_POLICIES[more >> 4],
        doing=-1 if doing == _NOTHING else doing,
        mission=mission,
        worst=worst,
    )


def _index(names: Sequence[str], name: str) -> int:
    return names.index(name) if name in names else 0
