"""A mission from the station's side: readiness, streaming, and telling its end from everything that is none."""

from collections.abc import Awaitable, Callable
from contextlib import nullcontext
from typing import TypeVar

import msgspec
import pytest
from tests.groundstation.scripted_platform import VEHICLE, Answer, ScriptedPlatform, reply_to

from gloc3.clock import run_virtual
from gloc3.errors import Refused
from gloc3.exchange import LocalExchange
from gloc3.messages.command_interface import Control, Outcome, Steer
from gloc3.messages.summaries import ControlState, Health, MissionSummary
from gloc3.mission.model.states import ENDED_BY_FAILSAFE, RESTART
from gloc3_groundstation.desk import flights
from gloc3_groundstation.desk.flights import End, FarAway, Follower
from gloc3_groundstation.missions.plans import CheckedPlan
from gloc3_groundstation.station.command_client import Declined
from gloc3_groundstation.station.snapshots import PlatformSnapshot, Timed
from gloc3_groundstation.station.station import Station

T = TypeVar("T")
PLAN = CheckedPlan(name="hold.yaml", title="cargo hold", text="mission: cargo hold\n")


def with_station(play: Callable[[Station, ScriptedPlatform], Awaitable[T]]) -> T:
    async def main() -> T:
        exchange = LocalExchange()
        platform = ScriptedPlatform(exchange)
        station = Station(exchange, platform.loop, "255", 11)
        platform.loop.call_later(0.1, platform.speak_every, 0.5)
        try:
            return await play(station, platform)
        finally:
            station.close()

    return run_virtual(main())


def snapshot(
    state: str,
    *,
    received_s: float = 10.0,
    digest: str = "d",
    policy: str = "",
    armed: bool = True,
    reason: str = "because",
) -> PlatformSnapshot:
    vehicle = msgspec.structs.replace(VEHICLE, is_armed=armed)
    mission = MissionSummary(name="m", digest=digest, state=state, policy=policy, reason=reason)
    return PlatformSnapshot(
        name="heron",
        boot=1,
        first_received_s=0.0,
        received_s=received_s,
        vehicle=Timed(vehicle, received_s),
        mission=Timed(mission, received_s),
    )


def test_a_station_asks_a_new_platform_for_its_full_state() -> None:
    async def play(station: Station, platform: ScriptedPlatform) -> None:
        await flights.await_platform(station, None)
        await flights.stream(station, "heron", PLAN)
        known = station.fleet.get("heron")
        assert known is not None
        assert len(known.components(station.now_s())) == 13

    with_station(play)


def test_a_start_waits_for_what_is_missing_and_names_it() -> None:
    async def play(station: Station, platform: ScriptedPlatform) -> None:
        platform.states["pose"] = Health.FAULTY
        platform.vehicle = msgspec.structs.replace(VEHICLE, is_pose_valid=False)
        await flights.await_platform(station, "heron")
        assert await flights.await_ready(station, "heron", 5.0) == ["a valid position", "pose"]
        assert station.now_s() == pytest.approx(5.0, abs=0.6)

    with_station(play)


def test_a_start_waits_until_the_origin_is_known_which_px4_tells_only_when_it_is_requested() -> None:
    async def play(station: Station, platform: ScriptedPlatform) -> None:
        platform.vehicle = msgspec.structs.replace(VEHICLE, geo=None)
        await flights.await_platform(station, "heron")
        platform.loop.call_later(2.0, setattr, platform, "vehicle", VEHICLE)
        assert not await flights.await_ready(station, "heron", 10.0)
        assert 2.0 < station.now_s() < 4.0

    with_station(play)


FAR = """mission: survey
frame: geo
tasks:
  all: {actions: {up: {take_off: {height_m: 9}}, go: {go_to: {position: [43.2, 9.2, 9]}, after: [up]}}}
"""


def test_a_mission_that_begins_kilometres_away_is_uploaded_only_where_that_is_meant() -> None:
    plan = CheckedPlan(name="far.yaml", title="survey", text=FAR)

    async def play(station: Station, platform: ScriptedPlatform) -> None:
        await flights.await_platform(station, "heron")
        with pytest.raises(FarAway, match=r"the first waypoint of 'survey' is 11\.1 km from heron"):
            await flights.stream(station, "heron", plan)
        assert (platform.text, platform.control.holder) == ("", ""), "nothing was requested"
        await flights.stream(station, "heron", plan, is_far_ok=True)
        assert platform.text == FAR

    with_station(play)


def test_control_that_is_held_is_not_asked_for_again() -> None:
    async def play(station: Station, platform: ScriptedPlatform) -> None:
        platform.control = ControlState(holder="255")
        platform.report("control", platform.control)
        await flights.stream(station, "heron", PLAN)
        assert not any(isinstance(body, Control) for body in platform.requests)

    with_station(play)


def test_streaming_takes_control_first() -> None:
    async def play(station: Station, platform: ScriptedPlatform) -> None:
        await flights.stream(station, "heron", PLAN)
        assert platform.control.holder == "255"
        assert platform.text == PLAN.text

    with_station(play)


def test_a_mission_is_followed_to_its_end_through_silence() -> None:
    async def play(station: Station, platform: ScriptedPlatform) -> End:
        await flights.stream(station, "heron", PLAN)
        follower = await flights.start(station, "heron")
        platform.loop.call_later(2.0, setattr, platform, "is_deaf", True)
        platform.loop.call_later(300.0, setattr, platform, "is_deaf", False)
        platform.loop.call_later(299.0, lambda: platform.advance("done"))
        return await flights.follow(station, "heron", follower)

    assert with_station(play) == End(state="done")


def test_the_end_of_the_flight_before_is_not_the_end_of_this_one() -> None:
    follower = Follower(started_s=10.0)
    assert follower.end(snapshot("done", received_s=10.1), 10.1) is None
    assert follower.end(snapshot("running", received_s=10.6), 10.6) is None
    assert follower.end(snapshot("done", received_s=11.0), 11.0) == End(state="done", reason="because")


def test_an_end_right_after_the_start_is_believed_once_it_is_repeated() -> None:
    follower = Follower(started_s=10.0)
    assert follower.end(snapshot("failed", received_s=13.1), 13.1) == End(state="failed", reason="because")


def test_a_failed_mission_has_not_ended_while_its_policy_is_flown() -> None:
    follower = Follower(started_s=0.0)
    assert follower.end(snapshot("failed", policy="land"), 10.0) is None
    landed = follower.end(snapshot("failed", policy="land", armed=False), 10.0)
    assert landed is not None
    assert not landed.is_done


@pytest.mark.parametrize(("policy", "by"), [("pilot", "a pilot"), ("failsafe", "the autopilot's failsafe")])
def test_a_flight_that_somebody_else_has_landed_and_disarmed_has_ended(policy: str, by: str) -> None:
    follower = Follower(started_s=0.0)
    assert follower.end(snapshot("running"), 10.0) is None
    for now_s in (20.0, 40.0):
        assert follower.end(snapshot("paused", policy=policy, received_s=now_s), now_s) is None, "it flies"
    standing = [snapshot("paused", policy=policy, armed=False, received_s=now_s) for now_s in (50.0, 54.0, 56.0)]
    assert follower.end(standing[0], 50.0) is None
    assert follower.end(standing[1], 54.0) is None, "he may arm it again"
    end = follower.end(standing[2], 56.0)
    assert end == End(state="paused", reason="because", by=by)
    assert end.exit_code == 3


def test_a_pilot_who_arms_again_goes_on_with_the_flight() -> None:
    follower = Follower(started_s=0.0)
    for now_s, is_armed in ((10.0, False), (13.0, True), (16.0, False), (19.0, False)):
        found = snapshot("paused", policy="pilot", armed=is_armed, received_s=now_s)
        assert follower.end(found, now_s) is None


def test_a_pause_of_an_operator_on_the_ground_is_no_end() -> None:
    follower = Follower(started_s=0.0)
    for now_s in (10.0, 30.0):
        assert follower.end(snapshot("paused", armed=False, received_s=now_s), now_s) is None


def test_a_mission_that_a_restart_has_paused_on_the_ground_has_ended() -> None:
    follower = Follower(started_s=0.0)
    assert follower.end(snapshot("running"), 10.0) is None
    for now_s, armed in ((20.0, True), (40.0, True), (50.0, False), (54.0, False)):
        found = snapshot("paused", reason=RESTART, armed=armed, received_s=now_s)
        assert follower.end(found, now_s) is None, "it flies, or an operator may resume it at once"
    end = follower.end(snapshot("paused", reason=RESTART, armed=False, received_s=56.0), 56.0)
    assert end == End(state="paused", reason="restart")
    assert end.exit_code == 1


def test_a_mission_that_is_resumed_after_a_restart_goes_on() -> None:
    follower = Follower(started_s=0.0)
    assert follower.end(snapshot("paused", reason=RESTART, armed=False, received_s=10.0), 10.0) is None
    assert follower.end(snapshot("running", armed=False, received_s=13.0), 13.0) is None
    assert follower.end(snapshot("paused", reason=RESTART, armed=False, received_s=16.0), 16.0) is None


def test_a_mission_that_the_failsafe_ended_says_so() -> None:
    follower = Follower(started_s=0.0)
    assert follower.end(snapshot("running"), 10.0) is None
    aborted = snapshot("aborted", armed=False)
    assert aborted.mission is not None
    told = msgspec.structs.replace(aborted.mission.value, reason=ENDED_BY_FAILSAFE)
    end = follower.end(msgspec.structs.replace(aborted, mission=Timed(told, 10.0)), 10.5)
    assert end is not None
    assert (end.exit_code, end.by) == (3, "the autopilot's failsafe")


def test_a_platform_that_forgot_the_mission_has_lost_it() -> None:
    follower = Follower(started_s=0.0)
    assert follower.end(snapshot("running"), 10.0) is None
    lost = follower.end(snapshot("", digest=""), 20.0)
    assert lost is not None
    assert lost.state == "lost"


def test_control_that_another_station_keeps_is_not_taken_for_granted() -> None:
    async def play(station: Station, platform: ScriptedPlatform) -> None:
        platform.control = ControlState(holder="254")
        platform.answer_next(Control, lambda request: reply_to(request, reason="station 254 has been asked"))
        await flights.stream(station, "heron", PLAN)

    with pytest.raises(Refused, match="control of heron was requested and not granted: station 254 keeps it"):
        with_station(play)


def declined(*, may_settle: bool) -> Answer:
    """Refuses as a vehicle does that has a red check."""
    result = {"may_settle": may_settle}
    return lambda request: reply_to(request, Outcome.REFUSED, "a check is red: GPS", result=result)


@pytest.mark.parametrize(
    ("may_settle", "times", "settles_s", "starts"),
    [(True, 3, 10.0, True), (True, 3, 0.0, False), (True, 30, 10.0, False), (False, 1, 10.0, False)],
)
def test_a_start_waits_for_checks_that_often_pass_by_themselves(
    *, may_settle: bool, times: int, settles_s: float, starts: bool
) -> None:
    async def play(station: Station, platform: ScriptedPlatform) -> None:
        await flights.stream(station, "heron", PLAN)
        for _ in range(times):
            platform.answer_next(Steer, declined(may_settle=may_settle))
        began_s = station.now_s()
        with nullcontext() if starts else pytest.raises(Declined, match="GPS"):
            await flights.start(station, "heron", settles_s=settles_s)
        assert station.now_s() - began_s <= settles_s + 3.0
        said = [event for event in station.fleet.events if "waiting, since a check is red" in event.text]
        assert len(said) == (may_settle and settles_s > 0.0), "it is said, and once"

    with_station(play)
