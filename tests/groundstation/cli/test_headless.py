"""The headless station flies a mission on a scripted platform and narrates it; the narration is golden."""

import asyncio
import json
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
from jsonschema import Draft202012Validator, FormatChecker
from tests.groundstation.scripted_platform import ScriptedPlatform, refused, reply_to

from gloc3.clock import run_virtual
from gloc3.errors import Finding, Gloc3Error, InputError, Refused
from gloc3.exchange import LocalExchange
from gloc3.messages.command_interface import CiReply, Control, ControlVerb, LoadMission, Outcome, ReadReports, Steer
from gloc3.messages.envelope import Severity
from gloc3.messages.summaries import CiEvent, ContactSummary, ControlState, Health, MissionSummary
from gloc3_groundstation.cli.headless import Headless
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.desk.flights import End
from gloc3_groundstation.desk.vehicle_commands import VehicleCommand
from gloc3_groundstation.missions.plans import CheckedPlan
from gloc3_groundstation.reporting.lines import HealthData, ItemData, NarrationLine, ProgressData, ResultData
from gloc3_groundstation.reporting.outcomes import RunOutcome, findings_of, outcome_of
from gloc3_groundstation.services.actions import Action
from gloc3_groundstation.station.command_client import CheckFailed, Declined, NotDelivered, Unanswered
from gloc3_groundstation.station.fleet import with_platform
from gloc3_groundstation.station.snapshots import AutopilotSnapshot, Fleet
from gloc3_groundstation.station.station import Station

PLAN = CheckedPlan(name="hold.yaml", title="cargo hold", text="mission: cargo hold\n")
SCHEMA = Path(__file__).parents[3] / "docs" / "schema" / "station-lines.schema.json"
GOLDEN = Path(__file__).parents[1] / "golden" / "narration.txt"


def script(platform: ScriptedPlatform) -> None:
    """What the platform does from 10 s on, when the mission has been started."""
    later = platform.loop.call_later
    later(3.0, lambda: platform.advance(depart="running", depart__climb="running"))
    later(3.0, lambda: platform.fly(is_armed=True, mode="TAKEOFF", landed="taking_off"))
    later(6.0, lambda: platform.fly(landed="in_air", mode="OFFBOARD", position_m=(0.0, 0.0, 1.5), speed_m_s=0.5))
    later(6.0, lambda: platform.advance(depart="done", depart__climb="done", sweep="running", sweep__wall="running"))
    later(6.0, lambda: platform.advance("running", {"sweep.wall": 0.1}, sweep__photos="running"))
    later(8.0, lambda: platform.event("gust of 7 m/s", Severity.NOTICE, "pose"))
    later(8.5, lambda: platform.event("cycle 400", Severity.INFO, "pose"))
    later(9.0, lambda: platform.problem("ground_camera", "no frame for 1.0 s"))
    later(10.0, setattr, platform, "is_deaf", True)
    later(15.0, setattr, platform, "is_deaf", False)
    later(18.0, lambda: platform.states.update(ground_camera=Health.WORKING))
    later(20.0, lambda: platform.advance(sweep="done", sweep__wall="done", sweep__photos="done", recover="running"))
    later(24.0, lambda: platform.fly(is_armed=False, landed="on_ground", mode="HOLD", position_m=(0.1, 0.0, 0.0)))
    later(24.5, lambda: platform.advance("done", recover="done", recover__home="done", recover__down="done"))


def nothing_more(_: ScriptedPlatform) -> None:
    """The script alone."""


def fly(
    platform_setup: list[str],
    reported: list[NarrationLine],
    refusal: str = "",
    more: Callable[[ScriptedPlatform], None] = nothing_more,
) -> str:
    async def main() -> str:
        exchange = LocalExchange()
        platform = ScriptedPlatform(exchange)
        station = Station(exchange, platform.loop, "255", 11)
        if "silent" not in platform_setup:
            platform.loop.call_later(1.2, platform.speak_every, 0.5)
            script(platform)
            more(platform)
        if refusal == "check":
            platform.answer_next(LoadMission, refused("does not fit", "hold.yaml:1:1: no tasks"))
        if refusal == "start":
            platform.answer_next(Steer, refused("battery is at 12 %"))
        run = Headless(station, reported.append, platform="heron")
        try:
            return (await run.fly(PLAN, wait_s=20.0)).state
        finally:
            station.close()

    return run_virtual(main())


def test_a_whole_mission_is_narrated_calmly() -> None:
    reported: list[NarrationLine] = []
    assert fly([], reported) == "done"
    assert "\n".join(str(line) for line in reported) + "\n" == GOLDEN.read_text()


@pytest.mark.parametrize(("is_failsafe", "who"), [(False, "the pilot"), (True, "the autopilot's failsafe")])
def test_who_has_control_is_named_and_who_hands_back(is_failsafe: bool, who: str) -> None:
    reported: list[NarrationLine] = []

    def script_of(platform: ScriptedPlatform) -> None:
        platform.loop.call_later(12.0, lambda: platform.fly(has_pilot_control=True, is_failsafe=is_failsafe))
        platform.loop.call_later(14.0, lambda: platform.fly(has_pilot_control=False, is_failsafe=False))

    fly([], reported, more=script_of)
    told = [
        line.text for line in reported if (line.kind == "vehicle" and "control" in line.text) or "handed" in line.text
    ]
    assert told == [f"{who} has control", f"{who} has handed back"]


def test_what_is_told_is_also_data() -> None:
    reported: list[NarrationLine] = []
    fly([], reported)
    result = reported[-1]
    assert (result.kind, result.data) == ("result", ResultData(mission="cargo hold", state="done", reason=""))
    progress = next(line.data for line in reported if isinstance(line.data, ProgressData))
    assert progress.vehicle is not None
    assert progress.vehicle.is_armed
    assert ItemData(target="sweep.wall", state="running") in [line.data for line in reported if line.kind == "action"]


def test_each_line_has_its_time_in_utc_and_fits_the_published_schema() -> None:
    reported: list[NarrationLine] = []
    fly([], reported)
    validator = Draft202012Validator(json.loads(SCHEMA.read_text()), format_checker=FormatChecker())
    for line in reported:
        assert [error.message for error in validator.iter_errors(json.loads(msgspec.json.encode(line)))] == []
    assert {line.kind for line in reported} >= {"event", "health", "vehicle", "task", "action", "progress", "result"}
    started = next(line for line in reported if line.text == "task depart: running")
    assert (started.t_s, started.utc) == (3.0, "2026-01-01T00:00:03.000Z")


def test_a_station_that_joins_late_first_tells_the_vehicle_s_health() -> None:
    reported: list[NarrationLine] = []

    async def main() -> None:
        exchange = LocalExchange()
        platform = ScriptedPlatform(exchange)
        platform.mission = MissionSummary(name="other", digest="x", state="running", tasks={"a": "running"})
        platform.fly(is_armed=True, landed="in_air", mode="OFFBOARD")
        platform.control = ControlState(holder="254")
        for name in ("pose", "height", "limiter"):
            platform.states[name] = Health.FAULTY
        platform.speak_every(0.5)
        station = Station(exchange, platform.loop, "255", 11)
        watching = asyncio.ensure_future(Headless(station, reported.append).watch())
        platform.loop.call_later(3.0, watching.cancel)
        with pytest.raises(asyncio.CancelledError):
            await watching
        station.close()

    run_virtual(main())
    own = [line for line in reported if line.platform == "heron" and line.text != "is heard"]
    assert own[0].text == (
        "3 components faulty: height, pose, limiter; mission 'other': running; mode Offboard; armed, in air; "
        "battery 97 %; station 254 in control"
    )
    assert isinstance(own[0].data, HealthData)
    assert own[0].data.troubled == dict.fromkeys(("height", "pose", "limiter"), "faulty")
    assert [line.kind for line in own].count("health") == 1
    assert {line.kind for line in own} == {"health", "progress"}, "nothing of it is told twice"


def test_a_platform_that_is_not_heard_is_said_after_the_wait() -> None:
    with pytest.raises(Gloc3Error, match="heron did not respond within 20 s; is it running") as ended:
        fly(["silent"], [])
    assert outcome_of(ended.value) is RunOutcome.NOT_HEARD


def test_a_mission_that_does_not_pass_onboard_is_not_started_and_has_failed_the_check() -> None:
    with pytest.raises(CheckFailed, match=r"does not fit\nhold\.yaml:1:1: no tasks") as ended:
        fly([], [], refusal="check")
    assert outcome_of(ended.value) is RunOutcome.FAILED
    assert findings_of(ended.value) == (Finding(file="hold.yaml", line=1, column=1, message="no tasks"),)


def test_a_refused_start_is_told() -> None:
    with pytest.raises(Declined, match="battery is at 12 %") as ended:
        fly([], [], refusal="start")
    assert (outcome_of(ended.value), findings_of(ended.value)) == (RunOutcome.REFUSED, ())


@pytest.mark.parametrize(
    ("end", "code"),
    [
        (End(state="done"), 0),
        (End(state="failed", reason="pose lost"), 1),
        (End(state="lost"), 1),
        (End(state="paused", by="a pilot"), 3),
        (InputError([Finding(file="hold.yaml", message="too far")]), 1),
        (Refused("station 254 keeps it"), 4),
        (NotDelivered(CiReply(sender="255", boot=1, sequence=0, outcome=Outcome.REFUSED, reason="no link")), 5),
        (Unanswered("heron has not answered for 16 s"), 5),
    ],
)
def test_the_exit_code_tells_what_has_happened(end: End | Gloc3Error, code: int) -> None:
    assert outcome_of(end).exit_code == code


def test_control_is_taken_over_from_another_station_only_where_that_is_requested() -> None:
    reported: list[NarrationLine] = []

    async def main(*, is_taking_over: bool) -> list[Control]:
        exchange = LocalExchange()
        platform = ScriptedPlatform(exchange)
        platform.control = ControlState(holder="254")
        station = Station(exchange, platform.loop, "255", 11)
        platform.loop.call_later(1.2, platform.speak_every, 0.5)
        platform.loop.call_later(30.0, platform.advance, "done")
        try:
            await Headless(station, reported.append, is_taking_over=is_taking_over).fly(PLAN, wait_s=20.0)
        finally:
            station.close()
        return [body for body in platform.requests if isinstance(body, Control)]

    assert [body.verb for body in run_virtual(main(is_taking_over=True))] == [ControlVerb.TAKE_OVER]
    assert "warning: control is taken over from station 254" in [line.text for line in reported]
    reported.clear()
    assert [body.verb for body in run_virtual(main(is_taking_over=False))] == [ControlVerb.REQUEST]
    assert not any("taken over" in line.text for line in reported)


def test_without_a_mission_it_narrates_until_it_is_stopped() -> None:
    reported: list[NarrationLine] = []

    async def main() -> None:
        exchange = LocalExchange()
        platform = ScriptedPlatform(exchange)
        station = Station(exchange, platform.loop, "255", 11)
        platform.speak_every(0.5)
        platform.mission = MissionSummary(name="other", digest="x", state="running", tasks={"a": "running"})
        watching = asyncio.ensure_future(Headless(station, reported.append).watch())
        platform.loop.call_later(2.0, watching.cancel)
        with pytest.raises(asyncio.CancelledError):
            await watching
        station.close()

    run_virtual(main())
    assert any("mission 'other': running" in line.text for line in reported)


CONTACT = ContactSummary(
    station="255",
    t_s=41.0,
    silent_s=20.0,
    health=Health.WORKING,
    mission="cargo hold",
    state="done",
    doing="",
    policy="",
    landed="on_ground",
    battery_percent=80,
    position_m=(1.0, 2.0, 0.0),
    geo=None,
    conditions=[],
    store=5,
    last=2,
    delivered=0,
)


def test_a_run_whose_mission_ended_out_of_contact_tells_the_summary_and_all_that_happened_before_it_ends() -> None:
    reported: list[NarrationLine] = []

    async def main() -> None:
        exchange = LocalExchange()
        platform = ScriptedPlatform(exchange)
        station, later = Station(exchange, platform.loop, "255", 11), platform.loop.call_later
        kept = [[number, int(Severity.WARNING), "depth", f"leak {number}", 15.0 * number] for number in (1, 2)]
        platform.answer_next(
            ReadReports, lambda request: reply_to(request, result={"store": 5, "last": 2, "reports": kept})
        )
        first = CiEvent(severity=Severity.WARNING, source="depth", text="leak 1", t_s=15.0, number=1, store=5)
        later(1.2, platform.speak_every, 0.5)
        later(13.0, lambda: platform.advance(depart="running"))
        later(15.0, lambda: platform.report("event", first))
        later(20.0, setattr, platform, "is_deaf", True)
        later(40.0, setattr, platform, "is_deaf", False)
        later(40.1, lambda: platform.advance("done"))
        later(41.0, lambda: platform.publisher.publish("heron/contact", CONTACT, platform.loop.time()))
        try:
            await Headless(station, reported.append, platform="heron").fly(PLAN, wait_s=20.0)
        finally:
            station.close()

    run_virtual(main())
    texts = [line.text for line in reported]
    assert texts[-1].startswith("'cargo hold': done after")
    summary = next(at for at, text in enumerate(texts) if text.startswith("contact after 20 s"))
    assert [text for text in texts if "leak" in text] == ["warning: depth: leak 1", "warning: depth: leak 2"]
    assert next(at for at, text in enumerate(texts) if "leak 2" in text) > summary


def test_a_vehicle_that_is_named_twice_is_commanded_once() -> None:
    lines: list[NarrationLine] = []

    async def main() -> RunOutcome:
        exchange = LocalExchange()
        platform = ScriptedPlatform(exchange)
        platform.speak_every(0.5)
        station = Station(exchange, platform.loop, "255", 11)
        autopilot = AutopilotSnapshot(link="udpin://0.0.0.0:14550", system=1, component=1, firmware="PX4")

        def known(fleet: Fleet, _: float) -> Fleet:
            return with_platform(fleet, msgspec.structs.replace(fleet.platforms["heron"], autopilot=autopilot))

        platform.loop.call_later(1.0, station.change, known)
        orders = [VehicleCommand(action=Action.ARM)]
        try:
            return await Headless(station, lines.append).do(
                Desk(station).commands, ["heron", "1"], orders, wait_s=5.0, within_s=5.0
            )
        finally:
            station.close()

    assert run_virtual(main()) is RunOutcome.REFUSED
    assert [line.platform for line in lines if line.kind == "order"] == ["heron"]


@pytest.mark.parametrize(
    ("named", "written_for", "flies"), [("", "egret", "egret"), ("heron", "egret", "heron"), ("", "", "")]
)
def test_with_several_platforms_a_mission_goes_where_it_is_told_to(named: str, written_for: str, flies: str) -> None:
    async def main() -> str:
        exchange = LocalExchange()
        platforms = [ScriptedPlatform(exchange), ScriptedPlatform(exchange, "egret")]
        station = Station(exchange, platforms[0].loop, "255", 11)
        for number, platform in enumerate(platforms):
            platform.loop.call_later(0.1 + 0.5 * number, platform.speak_every, 0.5)
            platform.loop.call_later(10.0, platform.advance, "done")
        plan = msgspec.structs.replace(PLAN, written_for=written_for)
        try:
            await Headless(station, lambda _: None, platform=named or None).fly(plan, wait_s=5.0)
        finally:
            station.close()
        return " ".join(platform.name for platform in platforms if platform.text)

    if flies:
        assert run_virtual(main()) == flies
    else:
        with pytest.raises(
            Refused, match=r"several platforms are in contact \(heron, egret\): name one with --platform"
        ):
            run_virtual(main())
