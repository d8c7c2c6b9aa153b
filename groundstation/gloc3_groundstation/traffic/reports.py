"""Reports of traffic in MAVLink messages: ADSB_VEHICLE, and Remote ID (OPEN_DRONE_ID_*, ASTM F3411) alone or in packs."""

from collections.abc import Iterator
from math import cos, isfinite, radians, sin
from struct import Struct
from typing import Final, NamedTuple

from gloc3.mavlink.codec import shape
from gloc3.mavlink.message import MavlinkMessage

MESSAGES: Final = frozenset(
    shape(name).id
    for name in ("ADSB_VEHICLE", "OPEN_DRONE_ID_BASIC_ID", "OPEN_DRONE_ID_LOCATION", "OPEN_DRONE_ID_MESSAGE_PACK")
)
"""Ids of the messages that may report traffic."""
MOST_NAME: Final = 20
MOST_SPEED_M_S: Final = 1000.0
MOST_ALTITUDE_M: Final = 30_000.0
_COORDINATES, _ALTITUDE, _HEADING, _VELOCITY, _CALLSIGN = 1, 2, 4, 8, 16
"""ADSB_FLAGS."""
_UNKNOWN_DIRECTION, _UNKNOWN_SPEED, _UNKNOWN_ALTITUDE_M = 36_100, 25_500, -1000.0
_PACKED_BYTES: Final = 25
_MOST_PACKED: Final = 9
_PACKED_LOCATION: Final = Struct("<BBBBbiiHHH")
_PACKED_BASIC: Final = Struct("<BB20s")


class TrafficReport(NamedTuple):
    """What one message says of one aircraft or drone; None for what it does not say."""

    key: str
    """Identity, such as `adsb 4B1234`."""
    name: str = ""
    """Callsign or serial number."""
    place: tuple[float, float] | None = None
    """Latitude and longitude, degrees."""
    altitude_m: float | None = None
    velocity_ne_m_s: tuple[float, float] | None = None
    age_s: float = 0.0
    """Of the position, when the message was sent."""


def read_reports(message: MavlinkMessage) -> Iterator[TrafficReport]:
    """The reports in a message; none of the vehicle's own Remote ID, whose sender has no address."""
    if message.name == "ADSB_VEHICLE":
        yield _adsb(message)
        return
    address = bytes(message.id_or_mac)
    if not any(address):
        return
    key = f"rid {address.hex()}"
    match message.name:
        case "OPEN_DRONE_ID_BASIC_ID":
            yield TrafficReport(key, plain(bytes(message.uas_id).decode("ascii", "replace")))
        case "OPEN_DRONE_ID_LOCATION":
            yield _location(key, message)
        case "OPEN_DRONE_ID_MESSAGE_PACK":
            if message.single_message_size == _PACKED_BYTES:
                data = bytes(message.messages)
                for number in range(min(message.msg_pack_size, _MOST_PACKED)):
                    yield from _packed(key, data[number * _PACKED_BYTES : (number + 1) * _PACKED_BYTES])


def plain(text: str) -> str:
    """A name without what a terminal would not show as it is."""
    return "".join(one for one in text.partition("\0")[0] if " " <= one <= "~").strip()[:MOST_NAME]


def _adsb(message: MavlinkMessage) -> TrafficReport:
    flags = message.flags
    has_motion = flags & _VELOCITY and flags & _HEADING
    return TrafficReport(
        f"adsb {message.ICAO_address & 0xFFFFFF:06X}",
        plain(message.callsign) if flags & _CALLSIGN else "",
        _place(message.lat, message.lon) if flags & _COORDINATES else None,
        _altitude(message.altitude / 1e3) if flags & _ALTITUDE else None,
        _velocity(message.heading / 100.0, message.hor_velocity / 100.0) if has_motion else None,
        float(message.tslc),
    )


def _location(key: str, message: MavlinkMessage) -> TrafficReport:
    has_motion = message.direction < _UNKNOWN_DIRECTION and message.speed_horizontal < _UNKNOWN_SPEED
    return TrafficReport(
        key,
        place=_place(message.latitude, message.longitude),
        altitude_m=_altitude(message.altitude_geodetic),
        velocity_ne_m_s=_velocity(message.direction / 100.0, message.speed_horizontal / 100.0) if has_motion else None,
    )


def _packed(key: str, data: bytes) -> Iterator[TrafficReport]:
    """A message of ASTM F3411, as it is broadcast."""
    if len(data) < _PACKED_BYTES:
        return
    match data[0] >> 4:
        case 0:
            yield TrafficReport(key, plain(_PACKED_BASIC.unpack_from(data)[2].decode("ascii", "replace")))
        case 1:
            _, flags, direction, speed, _, latitude, longitude, _, altitude, _ = _PACKED_LOCATION.unpack_from(data)
            track_deg = direction + (180.0 if flags & 2 else 0.0)
            speed_m_s = speed * 0.75 + 63.75 if flags & 1 else speed * 0.25
            has_motion = direction < 180 and speed < 255
            yield TrafficReport(
                key,
                place=_place(latitude, longitude),
                altitude_m=_altitude(altitude * 0.5 - 1000.0),
                velocity_ne_m_s=_velocity(track_deg, speed_m_s) if has_motion else None,
            )


def _place(latitude_deg_e7: int, longitude_deg_e7: int) -> tuple[float, float] | None:
    latitude, longitude = latitude_deg_e7 / 1e7, longitude_deg_e7 / 1e7
    is_there = (latitude_deg_e7, longitude_deg_e7) != (0, 0) and abs(latitude) < 90.0 and abs(longitude) <= 180.0
    return (latitude, longitude) if is_there else None


def _altitude(altitude_m: float) -> float | None:
    is_known = isfinite(altitude_m) and _UNKNOWN_ALTITUDE_M < altitude_m < MOST_ALTITUDE_M
    return altitude_m if is_known else None


def _velocity(track_deg: float, speed_m_s: float) -> tuple[float, float] | None:
    if not 0.0 <= speed_m_s < MOST_SPEED_M_S:
        return None
    return speed_m_s * cos(radians(track_deg)), speed_m_s * sin(radians(track_deg))
