"""Pre-flight lists of the platforms: requested, kept with their age, completed with the station's checks."""

import asyncio
from collections.abc import Iterator
from typing import Final, NamedTuple

import msgspec

from gloc3.clock import Clock
from gloc3.errors import Gloc3Error
from gloc3.messages.command_interface import Preflight
from gloc3.messages.preflight import Check, Group, PreflightReport, Verdict, in_order
from gloc3.messages.software import Software, compared
from gloc3_groundstation.station.snapshots import PlatformSnapshot
from gloc3_groundstation.station.station import Station
from gloc3_groundstation.station.wording import duration

AGAIN_S: Final = 15.0
"""Age from which a displayed list is requested again, s."""
LITTLE_LOSS: Final = 0.1
MUCH_LOSS: Final = 0.4
SLOW_S: Final = 1.5
"""Round trip from which commands are noticeably delayed, s."""
CLOCKS_AGREE_S: Final = 2.0


class ReceivedList(NamedTuple):
    """A platform's list, as it came."""

    report: PreflightReport
    boot: int
    """The life of the platform that it is of."""
    received_s: float
    """On the station's clock."""
    utc_s: float
    """The station's UTC then."""


class CheckList(NamedTuple):
    """Readiness of a platform, as known now."""

    checks: tuple[Check, ...]
    """The platform's checks and the station's; empty until the platform has reported any."""
    age_s: float | None
    """Of the platform's; None while there are none."""
    is_requesting: bool
    problem: str
    """Why the last requested list did not arrive; empty if it did."""


class PreflightDesk:
    """One for a station."""

    def __init__(self, station: Station) -> None:
        self._station = station
        self._reported: dict[str, ReceivedList] = {}
        self._requested_s: dict[str, float] = {}
        self._requesting: set[str] = set()
        self._problems: dict[str, str] = {}

    async def refresh(self, name: str) -> bool:
        """Asks a platform for its list; a second time while the first has not come does nothing."""
        if name in self._requesting:
            return False
        station = self._station
        self._requesting.add(name)
        self._requested_s[name] = station.now_s()
        try:
            reply = await station.client.carry_out(name, Preflight())
            report = msgspec.convert(reply.result, PreflightReport)
        except Gloc3Error as error:
            self._problems[name] = str(error)
            return False
        except msgspec.ValidationError as error:
            self._problems[name] = f"its list cannot be read, versions differ: {error}"
            return False
        finally:
            self._requesting.discard(name)
        known = station.fleet.get(name)
        utc_s = Clock(asyncio.get_running_loop()).utc_s()
        self._reported[name] = ReceivedList(report, known.boot if known is not None else 0, station.now_s(), utc_s)
        self._problems.pop(name, None)
        return True

    def is_due(self, name: str) -> bool:
        """Whether a displayed list should be requested again."""
        return (
            name not in self._requesting
            and self._station.now_s() - self._requested_s.get(name, float("-inf")) >= AGAIN_S
        )

    def invalidate(self, name: str) -> None:
        """Forces a new request at the next display."""
        self._requested_s.pop(name, None)

    def list_of(self, platform: PlatformSnapshot) -> CheckList:
        """Everything that is known; a list of a former life of the platform counts no more."""
        station, name = self._station, platform.name
        reported, now_s = self._reported.get(name), station.now_s()
        if reported is not None and reported.boot != platform.boot:
            reported = None
        own = station_checks(platform, reported, station.round_trip_s(name), now_s)
        checks = in_order([*reported.report.checks, *own]) if reported is not None else []
        age_s = now_s - reported.received_s if reported is not None else None
        return CheckList(tuple(checks), age_s, name in self._requesting, self._problems.get(name, ""))


def station_checks(
    platform: PlatformSnapshot, reported: ReceivedList | None, round_trip_s: float | None, now_s: float
) -> Iterator[Check]:
    """Checks that only this end can do: link quality, and compatibility of both ends."""
    yield _loss(platform, now_s)
    if round_trip_s is None:
        yield Check(Group.LINK, "round trip", Verdict.UNKNOWN, "not measured yet")
    elif round_trip_s > SLOW_S:
        advice = "commands arrive late: take a faster link, or show less of the vehicle"
        yield Check(Group.LINK, "round trip", Verdict.WARNING, f"{round_trip_s:.1f} s", advice)
    else:
        yield Check(Group.LINK, "round trip", Verdict.OK, f"{1000.0 * round_trip_s:.0f} ms")
    if reported is None:
        return
    yield compared("versions", Software(reported.report.version, reported.report.protocol), "onboard")
    if reported.report.utc_s is None:
        yield Check(Group.LINK, "clocks", Verdict.UNKNOWN, "the platform has not reported its time")
        return
    offset_s = reported.report.utc_s + (round_trip_s or 0.0) / 2.0 - reported.utc_s
    if abs(offset_s) > CLOCKS_AGREE_S:
        finding = f"the platform's is {duration(abs(offset_s))} {'ahead' if offset_s > 0.0 else 'behind'}"
        advice = "set both by NTP or GPS, or logs cannot be compared"
        yield Check(Group.LINK, "clocks", Verdict.WARNING, finding, advice)
    else:
        yield Check(Group.LINK, "clocks", Verdict.OK, f"agree within {abs(offset_s):.1f} s")


def _loss(platform: PlatformSnapshot, now_s: float) -> Check:
    if platform.is_quiet_link(now_s):
        finding = f"nothing heard for {duration(platform.age_s(now_s))}"
        return Check(Group.LINK, "loss", Verdict.RED, finding, "find the cause before takeoff")
    loss = platform.link.loss
    finding = f"{100.0 * loss:.0f} % of the status is lost"
    if loss > MUCH_LOSS:
        advice = "move the antenna, or another station's transmitter"
        return Check(Group.LINK, "loss", Verdict.WARNING, finding, advice)
    if loss > LITTLE_LOSS:
        advice = "it gets worse with distance"
        return Check(Group.LINK, "loss", Verdict.WARNING, finding, advice)
    return Check(Group.LINK, "loss", Verdict.OK, finding)
