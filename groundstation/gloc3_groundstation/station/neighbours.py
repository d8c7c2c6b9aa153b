"""Passes the places of vehicles on to each other, so that each one's limiter can keep the separation."""

from collections.abc import Callable, Iterator
from math import dist
from typing import Final

from gloc3.messages.command_interface import Elsewhere, NearbyVehicle
from gloc3.messages.frames import GeoPoint, LocalFrame, TangentPlane
from gloc3_groundstation.station.command_client import CommandClient
from gloc3_groundstation.station.snapshots import Fleet, PlatformSnapshot, TrafficContact

NEAR_M: Final = 300.0
"""Distance within which vehicles are told of each other, m."""
OLD_S: Final = 4.0
"""Older positions are not passed on, s."""
LATENCY_S: Final = 0.1
"""Of a link, one way, where it is not measured."""
RoundTrip = Callable[[str], float | None]


class NeighbourRelay:
    """Passes on each position of a vehicle, as soon as it comes, to the vehicles near it that this station controls.

    Args:
        client: sends.
    """

    def __init__(self, client: CommandClient) -> None:
        self._client = client

    def pass_on(self, name: str, fleet: Fleet, now_s: float, round_trip_s: RoundTrip) -> None:
        """Sends everything near it to each vehicle near `name`, whose position has just come, and traffic to itself.

        Args:
            name: the platform.
            fleet: the present snapshot.
            now_s: the time.
            round_trip_s: round-trip time to a platform; None where it is not known.
        """
        moved = fleet.get(name)
        if moved is None or not moved.is_flying:
            return
        for other in fleet:
            if other.is_flying and self._is_ours(other):
                near = list(self._near(other, fleet, now_s, round_trip_s))
                if any(one.is_traffic if other.name == name else one.name == name for one in near):
                    self._client.send(other.name, Elsewhere(platform="", digest="", state="", vehicles=near))

    def _is_ours(self, platform: PlatformSnapshot) -> bool:
        return platform.control is not None and platform.control.value.holder == self._client.station

    def _near(
        self, platform: PlatformSnapshot, fleet: Fleet, now_s: float, round_trip_s: RoundTrip
    ) -> Iterator[NearbyVehicle]:
        own = _place(platform)
        if own is None:
            return
        plane = TangentPlane(own)
        to_s = _latency_s(round_trip_s(platform.name))
        for other in fleet:
            place = _place(other) if other.name != platform.name and other.is_flying else None
            motion, site = other.motion, other.site
            if place is None or motion is None or site is None or motion.age_s(now_s) > OLD_S:
                continue
            if dist(plane.ned_from_geo(*place), (0.0, 0.0, 0.0)) > NEAR_M:
                continue
            frame = LocalFrame(GeoPoint(0.0, 0.0, 0.0), site.value.x_axis_bearing_deg)
            x, y, height = (part / 100.0 for part in motion.value.velocity_cm_s)
            age_s = motion.age_s(now_s) + _latency_s(round_trip_s(other.name)) + to_s
            yield NearbyVehicle(
                name=other.name,
                geo=(place.latitude_deg, place.longitude_deg, place.altitude_m),
                velocity_ned_m_s=frame.to_ned((x, y, height)),
                age_s=round(age_s, 2),
            )
        for contact in fleet.traffic:
            if (one := _contact(contact, plane, now_s, to_s)) is not None:
                yield one


def _latency_s(round_trip_s: float | None) -> float:
    return LATENCY_S if round_trip_s is None else 0.5 * round_trip_s


def _contact(contact: TrafficContact, plane: TangentPlane, now_s: float, latency_s: float) -> NearbyVehicle | None:
    """Traffic near a vehicle; of unknown height it counts as being at the vehicle's."""
    altitude_m = plane.origin.altitude_m if contact.altitude_m is None else contact.altitude_m
    geo, age_s = (*contact.place, altitude_m), now_s - contact.received_s
    if age_s > OLD_S or dist(plane.ned_from_geo(*geo), (0.0, 0.0, 0.0)) > NEAR_M:
        return None
    north, east = contact.velocity_ne_m_s or (0.0, 0.0)
    return NearbyVehicle(
        name=contact.label,
        geo=geo,
        velocity_ned_m_s=(north, east, 0.0),
        age_s=round(age_s + latency_s, 2),
        is_traffic=True,
    )


def _place(platform: PlatformSnapshot) -> GeoPoint | None:
    motion, site = platform.motion, platform.site
    if motion is None or site is None or site.value.origin_geo is None or not motion.value.is_pose_valid:
        return None
    x, y, height = (part / 100.0 for part in motion.value.position_cm)
    return LocalFrame(GeoPoint(*site.value.origin_geo), site.value.x_axis_bearing_deg).to_geo((x, y, height))
