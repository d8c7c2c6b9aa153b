"""What only a simulated flight can tell: the truth."""

from collections.abc import Mapping
from typing import Final

from gloc3.frames import Quaternion, Vector3
from gloc3.messages import Message
from gloc3.topics import TopicRow


class SimTruth(Message, frozen=True):
    """Where the simulated vehicle really is, in the NED frame of the platform's pose."""

    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    ned_from_frd: Quaternion
    wind_ned_m_s: Vector3


TOPICS: Final[Mapping[str, TopicRow]] = {"sim/truth": TopicRow(SimTruth, 10.0)}
