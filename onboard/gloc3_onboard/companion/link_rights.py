"""Rights on a MAVLink link: which frames of its stations are passed on to the autopilot and to other links.

What a station sends to the autopilot itself, no command interface checks. So flying by it needs every right that flying
has, alone and unlimited, and whatever is not known to be harmless counts as flying.
"""

from collections.abc import Set
from enum import StrEnum
from functools import cache
from typing import Final

from gloc3.mavlink.codec import Frame, shape
from gloc3.network.rights import UNLIMITED, Rights
from gloc3.network.rights_file import Right

_READ: Final = (
    "AUTOPILOT_VERSION_REQUEST",
    "LOG_REQUEST_DATA",
    "LOG_REQUEST_END",
    "LOG_REQUEST_LIST",
    "MISSION_ACK",
    "MISSION_REQUEST",
    "MISSION_REQUEST_INT",
    "MISSION_REQUEST_LIST",
    "PARAM_EXT_REQUEST_LIST",
    "PARAM_EXT_REQUEST_READ",
    "PARAM_REQUEST_LIST",
    "PARAM_REQUEST_READ",
    "PING",
    "REQUEST_DATA_STREAM",
    "REQUEST_EVENT",
    "TIMESYNC",
)
_MAINTAIN: Final = (
    "FILE_TRANSFER_PROTOCOL",
    "LOG_ERASE",
    "PARAM_EXT_SET",
    "PARAM_SET",
    "SERIAL_CONTROL",
    "SETUP_SIGNING",
)
_COMMANDS: Final = ("COMMAND_INT", "COMMAND_LONG")
_READ_COMMANDS: Final = frozenset({510, 511, 512, 519, 520, 521, 522, 525, 527, 2504})
"""Message intervals, single messages, and what a component is capable of."""
_MAINTAIN_COMMANDS: Final = frozenset({241, 242, 243, 245, 246, 526, 42424, 42425, 42426})
"""Calibration, stored settings and storage media, and restarts."""


class FrameUse(StrEnum):
    """What a station's frame is for."""

    READ = "read"
    MAINTAIN = "maintain"
    FLY = "fly"


def use_of(frame: Frame) -> FrameUse:
    """What a frame is for; what is not known is for flying."""
    number = frame.message_id
    if number in _ids(_READ):
        return FrameUse.READ
    if number in _ids(_MAINTAIN):
        return FrameUse.MAINTAIN
    message = frame.decode() if number in _ids(_COMMANDS) else None
    if message is not None and message.command in _READ_COMMANDS:
        return FrameUse.READ
    return FrameUse.MAINTAIN if message is not None and message.command in _MAINTAIN_COMMANDS else FrameUse.FLY


class LinkRights:
    """What the stations of one link may send past the command interface.

    Args:
        rights: of the network's members.
        member: for whom the link's key stands; empty for nobody.
    """

    def __init__(self, rights: Rights, member: str) -> None:
        self._rights, self._member = rights, member

    @property
    def may_command(self) -> bool:
        """Whether its stations may do more than look."""
        return self._rights.may(self._member, Right.CONTROL)

    def withholds(self, frame: Frame) -> bool:
        """Whether a frame is not passed on."""
        if self._rights.is_open and self._rights.may_alone(self._member, UNLIMITED):
            return False
        match use_of(frame):
            case FrameUse.READ:
                return not self.may_command
            case FrameUse.MAINTAIN:
                return not self._rights.may_alone(self._member, {Right.MAINTAIN})
            case FrameUse.FLY:
                return not self._rights.may_alone(self._member, UNLIMITED)


@cache
def _ids(names: tuple[str, ...]) -> Set[int]:
    """Numbers of messages, looked up when the first frame is judged: the dialect takes long to import."""
    return frozenset(shape(name).id for name in names)
