"""Messages of ROS 2 in CDR, as they travel; mcap-ros2-support encodes them by their definitions."""

import struct
from collections.abc import Callable
from functools import cache
from typing import Any

from mcap_ros2._dynamic import generate_dynamic, serialize_dynamic

from gloc3.errors import Refused
from gloc3.ros2.definitions import definition
from gloc3.ros2.messages import RosMessage
from gloc3.ros2.type_hash import full_name


@cache
def encoder(kind: str) -> Callable[[RosMessage], bytes]:
    """What encodes messages of a type, such as `nav_msgs/Odometry`; fields that are left out are zero."""
    name = full_name(kind)
    return serialize_dynamic(name, definition(kind))[name]


@cache
def decoder(kind: str) -> Callable[[bytes], Any]:
    """What decodes messages of a type: their fields are attributes. It raises `Refused` for bytes that are none."""
    name = full_name(kind)
    decode = generate_dynamic(name, definition(kind))[name]

    def decoded(data: bytes) -> Any:
        try:
            return decode(data)
        except (ValueError, LookupError, OverflowError, MemoryError, struct.error) as error:
            raise Refused(f"{len(data)} bytes are no {kind}: {error}") from error

    return decoded
