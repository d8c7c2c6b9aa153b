"""Send queue of a slow link: traffic classes share it, so that commands hardly wait and none starves.

While all classes have something to send, each has the share of the line given by its weight; alone, it has the whole
line (deficit round robin, Shreedhar and Varghese 1996). Of each telemetry message only the latest waits: a slow line
carries it less often, never late. All others wait in order, also those that are unknown. Frames without room in the
queue are dropped and counted.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Hashable
from enum import StrEnum
from functools import cache
from itertools import count
from typing import Final

import msgspec

from gloc3.mavlink import codec
from gloc3.mavlink.parser import Frame

BURST_S: Final = 0.05
"""Amount that a line accepts at once, as time at its rate: the buffer of a UART."""
QUANTUM_BYTES: Final = 64
"""Bytes that a class of weight 1 may send per turn."""


class TrafficKind(StrEnum):
    """Purposes of frames."""

    COMMAND = "command"
    """Commands, answers, heartbeats, setpoints, texts, and our own command interface."""
    TRANSFER = "transfer"
    """Missions, parameters, a shell's lines, and whatever else is addressed."""
    TELEMETRY = "telemetry"
    """Periodic messages."""
    BULK = "bulk"
    """Files and logs, and messages that the dialect does not define."""


class Share(msgspec.Struct, frozen=True):
    """Share of a line for a class of frames."""

    weight: int
    most: int
    """Frames that may wait."""


SHARES: Final = {
    TrafficKind.COMMAND: Share(8, 64),
    TrafficKind.TRANSFER: Share(4, 128),
    TrafficKind.TELEMETRY: Share(4, 128),
    TrafficKind.BULK: Share(1, 64),
}

_NAMES: Final = {
    TrafficKind.COMMAND: (
        "HEARTBEAT COMMAND_LONG COMMAND_INT COMMAND_ACK COMMAND_CANCEL SET_MODE STATUSTEXT TUNNEL PING TIMESYNC SYSTEM_TIME "
        "MANUAL_CONTROL RC_CHANNELS_OVERRIDE SET_POSITION_TARGET_LOCAL_NED SET_POSITION_TARGET_GLOBAL_INT "
        "SET_ATTITUDE_TARGET CHANGE_OPERATOR_CONTROL CHANGE_OPERATOR_CONTROL_ACK SETUP_SIGNING MISSION_SET_CURRENT "
        "MISSION_ITEM_REACHED EVENT REQUEST_EVENT RESPONSE_EVENT_ERROR"
    ),
    TrafficKind.TRANSFER: (
        "MISSION_REQUEST_LIST MISSION_COUNT MISSION_REQUEST MISSION_REQUEST_INT MISSION_ITEM MISSION_ITEM_INT "
        "MISSION_ACK MISSION_CLEAR_ALL MISSION_REQUEST_PARTIAL_LIST MISSION_WRITE_PARTIAL_LIST PARAM_REQUEST_READ "
        "PARAM_REQUEST_LIST PARAM_VALUE PARAM_SET AUTOPILOT_VERSION MESSAGE_INTERVAL REQUEST_DATA_STREAM "
        "FENCE_POINT FENCE_FETCH_POINT RALLY_POINT RALLY_FETCH_POINT PARAM_EXT_VALUE PARAM_EXT_ACK CAMERA_IMAGE_CAPTURED"
    ),
    TrafficKind.BULK: (
        "FILE_TRANSFER_PROTOCOL LOG_REQUEST_LIST LOG_ENTRY LOG_REQUEST_DATA LOG_DATA LOG_ERASE LOG_REQUEST_END "
        "ENCAPSULATED_DATA DATA_TRANSMISSION_HANDSHAKE TERRAIN_DATA TERRAIN_REQUEST REMOTE_LOG_DATA_BLOCK "
        "REMOTE_LOG_BLOCK_STATUS GPS_RTCM_DATA GPS_INJECT_DATA LOGGING_DATA LOGGING_DATA_ACKED LOGGING_ACK CAN_FRAME "
        "CANFD_FRAME"
    ),
    TrafficKind.TELEMETRY: (
        "GIMBAL_DEVICE_ATTITUDE_STATUS GIMBAL_DEVICE_SET_ATTITUDE GIMBAL_MANAGER_SET_ATTITUDE GIMBAL_MANAGER_SET_PITCHYAW "
        "GIMBAL_MANAGER_SET_MANUAL_CONTROL AUTOPILOT_STATE_FOR_GIMBAL_DEVICE MOUNT_STATUS SET_ACTUATOR_CONTROL_TARGET "
        "GLOBAL_POSITION_SENSOR"
    ),
}
"""Of telemetry only what is addressed, and yet sent periodically."""


@cache
def kinds() -> dict[int, TrafficKind]:
    """Message id to kind, for every message whose form does not tell it."""
    return {codec.shape(name).id: kind for kind, names in _NAMES.items() for name in names.split()}


def _kind_of(frame: Frame) -> TrafficKind:
    """The kind of a message that is not listed: one that has no address is taken for periodic."""
    if frame.shape is None:
        return TrafficKind.BULK
    return TrafficKind.TELEMETRY if frame.shape.target_system_at < 0 else TrafficKind.TRANSFER


class LinkOutlet:
    """Send queue of one link, with its rate. It has no clock: the owner calls `pump` at `next_s`.

    Args:
        send: sends the bytes of a frame.
        rate_byte_s: rate of the line; None for a network, whose frames are sent at once.
    """

    def __init__(self, send: Callable[[bytes], None], rate_byte_s: float | None = None) -> None:
        self.dropped: Final = dict.fromkeys(TrafficKind, 0)
        """Frames that found no room."""
        self.overtaken = 0
        """Telemetry that a newer frame of its kind took the place of."""
        self.rate_byte_s = rate_byte_s
        """May be set once it is known, while nothing waits."""
        self._send = send
        self._kinds = kinds()
        self._waiting: dict[TrafficKind, dict[Hashable, bytes]] = {kind: {} for kind in TrafficKind}
        """Frames in the order of their coming: telemetry by sender, message and instance, all others by a number."""
        self._numbers = count()
        self._credit = dict.fromkeys(TrafficKind, 0)
        self._turns = deque(TrafficKind)
        self._free_s = 0.0
        """When the line will have sent all frames given to it."""

    @property
    def waiting(self) -> int:
        """Frames that wait."""
        return sum(map(len, self._waiting.values()))

    def put(self, frame: Frame, now_s: float) -> None:
        """Takes in a frame that is to leave."""
        if self.rate_byte_s is None:
            self._send(frame.raw)
            return
        kind = self._kinds.get(frame.message_id) or _kind_of(frame)
        waiting = self._waiting[kind]
        which: Hashable = next(self._numbers)
        if kind is TrafficKind.TELEMETRY:
            which = (frame.system, frame.component, frame.message_id, frame.instance)
        if which in waiting:
            self.overtaken += 1
        elif len(waiting) >= SHARES[kind].most:
            self.dropped[kind] += 1
            return
        waiting[which] = frame.raw
        self.pump(now_s)

    def next_s(self) -> float | None:
        """When `pump` has something to do; None while nothing waits."""
        return max(0.0, self._free_s - BURST_S) if self.waiting else None

    def pump(self, now_s: float) -> None:
        """Sends as much as the line has room for."""
        rate_byte_s = self.rate_byte_s
        assert rate_byte_s is not None
        while self._free_s - BURST_S <= now_s and (raw := self._choose()) is not None:
            self._free_s = max(self._free_s, now_s) + len(raw) / rate_byte_s
            self._send(raw)

    def _choose(self) -> bytes | None:
        """The next frame to leave."""
        if not self.waiting:
            return None
        while True:
            kind = self._turns[0]
            waiting = self._waiting[kind]
            first = next(iter(waiting), None)
            if first is not None and self._credit[kind] >= len(waiting[first]):
                self._credit[kind] -= len(waiting[first])
                return waiting.pop(first)
            self._turns.rotate(-1)
            self._credit[kind] = 0 if first is None else self._credit[kind] + QUANTUM_BYTES * SHARES[kind].weight
