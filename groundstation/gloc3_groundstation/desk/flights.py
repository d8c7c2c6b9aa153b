"""A mission from the station's side: wait for the platform, take control, stream, start, follow to the end."""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Final

import msgspec

from gloc3.clock import passed
from gloc3.errors import Gloc3Error, Refused
from gloc3.messages.command_interface import Verb
from gloc3.messages.envelope import Severity
from gloc3.messages.summaries import WELL, MissionSummary
from gloc3.mission.model.states import ENDED, ENDED_BY_FAILSAFE, RESTART, ActionState
from gloc3_groundstation.missions.first_waypoint import far_away
from gloc3_groundstation.missions.plans import CheckedPlan, recheck
from gloc3_groundstation.station.command_client import Declined
from gloc3_groundstation.station.snapshots import PlatformSnapshot
from gloc3_groundstation.station.station import Station

READY_WITHIN_S: Final = 90.0
"""Time for an autopilot to become ready, s: after power-up it takes up to a minute for satellites and estimator."""
GRANTED_WITHIN_S: Final = 12.0
"""Time for a grant of control, s: its holder has 10 s to answer."""
SETTLED_AFTER_S: Final = 3.0
"""An end that is reported sooner after the start, with nothing running in between, is that of the flight before."""
POLL_PERIOD_S: Final = 0.5
SETTLES_PERIOD_S: Final = 2.0
"""A start that is refused for checks that may settle is requested again after this time."""
LANDED_S: Final = 5.0
"""Time disarmed on the ground after which a flight counts as ended that a pilot took over, or a restart paused, s."""
OTHERS_S: Final = 1.5
"""Time after the first contact in which other platforms are heard, too, s: each sends once a second."""
TAKEN_OVER: Final = {"pilot": "a pilot", "failsafe": "the autopilot's failsafe", "operator": "an operator"}
"""Who may end a flight in place of its mission, by the word with which the mission's policy or reason says so."""


class FarAway(Refused):
    """The first waypoint of a mission is kilometres from the vehicle."""


class End(msgspec.Struct, frozen=True, kw_only=True):
    """End of a mission."""

    state: str
    """An `ActionState`, or `lost` where the platform no longer holds the mission."""
    reason: str = ""
    by: str = ""
    """Who ended the flight in place of the mission, in words; empty where the mission did."""

    @property
    def exit_code(self) -> int:
        """Of a station without a screen: 0 done, 1 not done, 3 ended by a pilot or by a failsafe."""
        return 3 if self.by else int(not self.is_done)

    @property
    def is_done(self) -> bool:
        """Whether everything was completed as requested."""
        return self.state == ActionState.DONE


def missing(platform: PlatformSnapshot, now_s: float) -> list[str]:
    """Conditions for a start that a platform does not meet yet; empty when it is ready."""
    missing = []
    vehicle, summary = platform.vehicle, platform.summary
    if vehicle is None or vehicle.is_stale(now_s):
        missing.append("the vehicle's state")
    elif not vehicle.value.is_autopilot_connected:
        missing.append("the autopilot")
    elif not vehicle.value.is_pose_valid:
        missing.append("a valid position")
    elif vehicle.value.geo is None:
        missing.append("the origin of its local frame")
    elif not vehicle.value.is_armable:
        missing.append("readiness to arm")
    if summary is None or summary.is_stale(now_s):
        missing.append("the components' state")
    elif summary.value.health not in WELL:
        unhealthy = [c.name for c in platform.components(now_s) if c.is_required and c.health not in WELL]
        missing.append(", ".join(unhealthy) or "a required component")
    return missing


def addressed(plan: CheckedPlan, platform: str | None) -> tuple[str | None, ...]:
    """Platforms that a mission goes to: its tasks' ones, else `platform`, else its header's; None: the only one."""
    return plan.platforms or (platform or plan.written_for or None,)


async def await_platform(station: Station, name: str | None) -> str:
    """Waits for contact with the platform `name`, or with the only one. Vehicles without a companion are ignored.

    Raises:
        Refused: several are in contact, and none is named.
    """
    found: list[str] = []

    def is_in_contact() -> bool:
        found[:] = [
            platform.name
            for platform in station.fleet
            if platform.has_companion and platform.is_known and name in (None, platform.name)
        ]
        return bool(found)

    await until(station, is_in_contact)
    if name is None:
        with suppress(TimeoutError):
            async with asyncio.timeout(OTHERS_S):
                await until(station, lambda: is_in_contact() and len(found) > 1)
    if len(found) > 1:
        raise Refused(f"several platforms are in contact ({', '.join(found)}): name one with --platform")
    return found[0]


async def await_platforms(station: Station) -> list[str]:
    """Waits for contact with platforms: the first one, and those that are heard within `OTHERS_S` of it."""

    def in_contact() -> list[str]:
        return [platform.name for platform in station.fleet if platform.has_companion and platform.is_known]

    await until(station, lambda: bool(in_contact()))
    await passed(OTHERS_S)
    return in_contact()


async def await_vehicle(station: Station, wanted: str | None) -> str:
    """Waits for contact with a vehicle, with or without a companion.

    Args:
        station: the station.
        wanted: its name, or the MAVLink system of its autopilot; None for the first one.

    Raises:
        Refused: several vehicles have that system.
    """
    found: list[str] = []

    def is_in_contact() -> bool:
        found[:] = [platform.name for platform in station.fleet if platform.is_known and _is_called(platform, wanted)]
        return bool(found)

    await until(station, is_in_contact)
    if wanted is not None and len(found) > 1:
        raise Refused(f"several vehicles have system {wanted}: {', '.join(found)}; name one")
    return found[0]


async def settled_vehicles(station: Station) -> list[str]:
    """The names of all vehicles that are heard, once no further one has come for `OTHERS_S`."""

    def heard() -> list[str]:
        return [platform.name for platform in station.fleet if platform.is_known and _is_called(platform, None)]

    found = heard()
    while True:
        await passed(OTHERS_S)
        found, before = heard(), found
        if found == before:
            return found


def _is_called(platform: PlatformSnapshot, wanted: str | None) -> bool:
    system = platform.autopilot.system if platform.autopilot is not None else 0
    return wanted in (None, platform.name, str(system)) and platform.vehicle is not None


async def await_ready(station: Station, platform: str, within_s: float = READY_WITHIN_S) -> list[str]:
    """Waits until a platform is ready for a start; returns the conditions that it does not meet at the timeout."""
    lacks: list[str] = []

    def is_ready() -> bool:
        known = station.fleet.get(platform)
        lacks[:] = missing(known, station.now_s()) if known else ["a message from it"]
        return not lacks

    if not is_ready():
        station.note(platform, Severity.INFO, f"waiting for {', '.join(lacks)}")
    try:
        async with asyncio.timeout(within_s):
            await until(station, is_ready)
    except TimeoutError:
        return lacks
    return []


async def request_control(station: Station, platform: str) -> None:
    """Asks for control and waits until it is here; the station that has it may have to grant it first.

    Raises:
        Refused: the holder keeps it; otherwise as `CommandClient.carry_out`.
    """
    if _holder(station, platform) == station.id:
        return
    reply = await station.client.request_control(platform)
    try:
        async with asyncio.timeout(GRANTED_WITHIN_S):
            await until(station, lambda: _holder(station, platform) == station.id)
    except TimeoutError:
        holder = _holder(station, platform)
        whose = f"station {holder} keeps it" if holder else reply.reason or "the platform gave no reason"
        raise Refused(f"control of {platform} was requested and not granted: {whose}") from None
    station.note(platform, Severity.INFO, "this station has control")


async def take_over(station: Station, platform: str) -> str:
    """Takes control without asking its holder, and waits until it is here.

    Returns:
        The station that had it; empty where no other had.

    Raises:
        Refused: the platform refuses it; otherwise as `CommandClient.carry_out`.
    """
    holder = _holder(station, platform)
    if holder in ("", station.id):
        await request_control(station, platform)
        return ""
    await station.client.request_control(platform, is_take_over=True)
    await request_control(station, platform)
    station.note(platform, Severity.WARNING, f"control is taken over from station {holder}")
    return holder


def _holder(station: Station, platform: str) -> str:
    known = station.fleet.get(platform)
    return known.control.value.holder if known is not None and known.control is not None else ""


async def stream(station: Station, platform: str, plan: CheckedPlan, *, is_far_ok: bool = False) -> None:
    """Checks the mission for its platform, takes control, and brings it over, read back and compared.

    Args:
        station: commands the platform.
        platform: its name.
        plan: the mission.
        is_far_ok: whether its first waypoint may be kilometres from the vehicle.

    Raises:
        InputError: it may not fly there; otherwise as `CommandClient.upload`.
        FarAway: its first waypoint is kilometres away.
    """
    received = station.fleet.get(platform)
    if received is not None:
        plan = recheck(plan, platform, received.component_names, received.platform_digest, station.terrain)
    else:
        plan = recheck(plan, platform, terrain=station.terrain)
    for warning in plan.warnings:
        station.note(platform, Severity.WARNING, warning)
    if distance := far_away(plan.text, plan.title, received):
        if not is_far_ok:
            raise FarAway(distance)
        station.note(platform, Severity.WARNING, distance)
    await request_control(station, platform)
    started_s = station.now_s()
    await station.client.upload(platform, plan.name, plan.text)
    size = len(plan.text.encode())
    elapsed_s = station.now_s() - started_s
    station.note(platform, Severity.INFO, f"{plan.title!r} is loaded and read back ({size} bytes in {elapsed_s:.1f} s)")


async def stream_to_all(
    station: Station, platforms: Sequence[str], plan: CheckedPlan, *, is_far_ok: bool = False
) -> None:
    """Brings a mission to all platforms that have a part in it; arguments and errors as of `stream`."""
    for platform in platforms:
        await stream(station, platform, plan, is_far_ok=is_far_ok)


async def start_all(
    station: Station, platforms: Sequence[str], override: str = "", author: str = "", settles_s: float = 0.0
) -> "dict[str, Follower]":
    """Starts the loaded mission on all platforms that take part in it, or on none; raises as `start`.

    Args:
        station: commands them.
        platforms: their names.
        override: reason to start although checks are red.
        author: who says so.
        settles_s: how long red checks that often pass by themselves are waited for, s; while no platform has started.
    """
    followers: dict[str, Follower] = {}
    try:
        for platform in platforms:
            waits_s = 0.0 if followers else settles_s
            followers[platform] = await start(station, platform, override, author, waits_s)
    except Gloc3Error:
        for platform in followers:
            station.note(platform, Severity.WARNING, "the mission does not start everywhere: it is aborted here")
            await station.client.steer(platform, Verb.ABORT)
        raise
    return followers


async def start(
    station: Station, platform: str, override: str = "", author: str = "", settles_s: float = 0.0
) -> "Follower":
    """Starts the loaded mission; raises as `CommandClient.carry_out`. Arguments as of `start_all`."""
    until_s, said = station.now_s() + settles_s, ""
    while True:
        try:
            await station.client.steer(platform, Verb.START, override=override, author=author)
            break
        except Declined as refusal:
            if station.now_s() >= until_s or not refusal.reply.result.get("may_settle", False):
                raise
            if refusal.reply.reason != said:
                said = refusal.reply.reason
                station.note(platform, Severity.INFO, f"waiting, since {said}")
        await passed(SETTLES_PERIOD_S)
    station.note(platform, Severity.INFO, "the mission is started")
    return Follower(station.now_s())


class Follower:
    """Detects the end of a started mission in the snapshots."""

    def __init__(self, started_s: float) -> None:
        self._settled_s = started_s + SETTLED_AFTER_S
        self._digest = ""
        self._has_run = False
        self._landed_s: float | None = None
        """Since when the vehicle is disarmed while its mission does not go on by itself."""

    def end(self, platform: PlatformSnapshot, now_s: float) -> End | None:
        """Result of the mission; None while it runs, or while a failure's policy is executed."""
        timed = platform.mission
        if timed is None:
            return None
        mission = timed.value
        if mission.state in (ActionState.RUNNING, ActionState.PAUSED):
            self._has_run, self._digest = True, mission.digest
            return self._left_paused(platform, mission, now_s)
        if self._has_run and mission.digest != self._digest:
            return self._lost()
        if mission.state not in ENDED or not (self._has_run or timed.received_s >= self._settled_s):
            return None
        if self._is_carrying_out_policy(platform, mission, now_s):
            return None
        by = TAKEN_OVER["failsafe"] if mission.reason == ENDED_BY_FAILSAFE else ""
        return End(state=mission.state, reason=mission.reason, by=by)

    def _left_paused(self, platform: PlatformSnapshot, mission: MissionSummary, now_s: float) -> End | None:
        """Result of a flight that another controller has landed, or that a restart left on the ground, still paused."""
        vehicle = platform.vehicle
        by = TAKEN_OVER.get(mission.policy, "")
        is_left = bool(by) or (mission.state == ActionState.PAUSED and mission.reason == RESTART)
        if not is_left or vehicle is None or vehicle.value.is_armed or vehicle.is_stale(now_s):
            self._landed_s = None
            return None
        self._landed_s = now_s if self._landed_s is None else self._landed_s
        if now_s - self._landed_s < LANDED_S:
            return None
        return End(state=mission.state, reason=mission.reason, by=by)

    @staticmethod
    def _lost() -> End:
        return End(state="lost", reason="the platform no longer holds the mission")

    @staticmethod
    def _is_carrying_out_policy(platform: PlatformSnapshot, mission: MissionSummary, now_s: float) -> bool:
        vehicle = platform.vehicle
        return bool(mission.policy) and vehicle is not None and vehicle.value.is_armed and not vehicle.is_stale(now_s)


async def follow(station: Station, platform: str, follower: Follower) -> End:
    """Waits for a mission's end; silence of the platform is no end."""
    ends: list[End] = []

    def has_ended() -> bool:
        known = station.fleet.get(platform)
        end = None if known is None else follower.end(known, station.now_s())
        if end is not None:
            ends.append(end)
        return bool(ends)

    await until(station, has_ended)
    return ends[0]


async def follow_all(station: Station, followers: "Mapping[str, Follower]") -> End:
    """Waits for the end on all platforms; returns the result of the first that did not complete its part, if any."""
    ends = await asyncio.gather(*(follow(station, platform, one) for platform, one in followers.items()))
    for platform, end in zip(followers, ends, strict=True):
        if not end.is_done:
            whose = f"{platform}: " if len(followers) > 1 else ""
            reason = f"{whose}{end.reason}" if end.reason else whose.removesuffix(": ")
            return End(state=end.state, reason=reason, by=end.by)
    return ends[0]


async def until(station: Station, is_so: Callable[[], bool]) -> None:
    """Waits until something is so, looking again at each change of the fleet, and now and then."""
    changed = asyncio.Event()
    unlisten = station.listen(lambda *_: changed.set())
    try:
        while not is_so():
            changed.clear()
            try:
                async with asyncio.timeout(POLL_PERIOD_S):
                    await changed.wait()
            except TimeoutError:
                continue
    finally:
        unlisten()
