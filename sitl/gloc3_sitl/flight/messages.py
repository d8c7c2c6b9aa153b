"""Messages of simulated flights only: ground truth and injected faults."""

from collections.abc import Mapping
from typing import Final

from gloc3.messages.envelope import Message
from gloc3.messages.frames import Quaternion, Vector3
from gloc3.messages.topics import TopicRow


class SimTruth(Message, frozen=True):
    """True pose of the simulated vehicle, in the NED frame of the platform's pose."""

    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    ned_from_frd: Quaternion
    wind_ned_m_s: Vector3


class SimFault(Message, frozen=True):
    """A fault starts or ends."""

    fault: str
    """Text of the request."""
    is_present: bool


TOPICS: Final[Mapping[str, TopicRow]] = {"sim/truth": TopicRow(SimTruth, 10.0), "sim/fault": TopicRow(SimFault)}
