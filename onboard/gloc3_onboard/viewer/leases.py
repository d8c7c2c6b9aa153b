"""Leases of watched topics by station: wants expire, so that a lost station costs nothing."""

from collections.abc import Sequence
from typing import Final, NamedTuple

from gloc3.messages.watch import LEASE_S, Want

MOST_STATIONS: Final = 8
MOST_WANTS: Final = 64
"""Of one station."""
SLOWEST_HZ: Final = 0.05
FASTEST_HZ: Final = 20.0
SMALLEST: Final = 8
"""Pixels of a preview, across and down."""
LARGEST: Final = (640, 480)


class Demand(NamedTuple):
    """Combined demand of all stations for a topic: the most that any of them wants."""

    rate_hz: float
    width: int
    height: int
    quality: int
    stations: tuple[str, ...]


class _Lease(NamedTuple):
    wants: tuple[Want, ...]
    is_listing: bool
    until_s: float


class Leases:
    """The wants of each station."""

    def __init__(self) -> None:
        self._leases: dict[str, _Lease] = {}

    @property
    def until_s(self) -> float:
        """End of the next lease; infinite without leases."""
        return min((lease.until_s for lease in self._leases.values()), default=float("inf"))

    def grant(self, station: str, wants: Sequence[Want], now_s: float, *, is_listing: bool = False) -> None:
        """Replaces a station's wants; an empty list removes the station.

        Beyond the greatest number of stations, the one whose lease ends first is removed.
        """
        self._leases.pop(station, None)
        if wants or is_listing:
            self._leases[station] = _Lease(tuple(map(sensible, wants[:MOST_WANTS])), is_listing, now_s + LEASE_S)
        if len(self._leases) > MOST_STATIONS:
            del self._leases[min(self._leases, key=lambda name: self._leases[name].until_s)]

    def expire(self, now_s: float) -> None:
        """Removes stations whose lease has expired."""
        for station in [name for name, lease in self._leases.items() if now_s >= lease.until_s]:
            del self._leases[station]

    @property
    def listing(self) -> tuple[str, ...]:
        """Stations that watch the list of topics."""
        return tuple(station for station, lease in self._leases.items() if lease.is_listing)

    def demands(self) -> dict[str, Demand]:
        """Demand for each topic."""
        found: dict[str, Demand] = {}
        for station, lease in self._leases.items():
            for want in lease.wants:
                wanted = Demand(want.rate_hz, want.width, want.height, want.quality, (station,))
                other = found.get(want.topic)
                if other is not None:
                    wanted = Demand(
                        max(wanted.rate_hz, other.rate_hz),
                        max(wanted.width, other.width),
                        max(wanted.height, other.height),
                        max(wanted.quality, other.quality),
                        tuple(dict.fromkeys((*other.stations, station))),
                    )
                found[want.topic] = wanted
        return found


def sensible(want: Want) -> Want:
    """The want, limited to what can be served."""
    return Want(
        want.topic,
        max(SLOWEST_HZ, min(FASTEST_HZ, want.rate_hz)),
        max(SMALLEST, min(LARGEST[0], want.width)),
        max(SMALLEST, min(LARGEST[1], want.height)),
        max(1, min(100, want.quality)),
    )
