"""The command interface server's requests: authority, at most once, checks, and what running actions need."""

import math
import time
from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from datetime import UTC, datetime
from threading import Event
from typing import Any

import msgspec
import pytest

from gloc3.component.lci import State
from gloc3.component.workers import ImmediateExecutor
from gloc3.messages.command_interface import (
    AnyBody,
    CallFunction,
    CiReply,
    CiRequest,
    CommandComponent,
    Control,
    ControlVerb,
    Emergency,
    EmergencyVerb,
    Hello,
    Inventory,
    ListTopics,
    LoadMission,
    Outcome,
    Query,
    ReadMission,
    RequestAction,
    StationRole,
    Steer,
    Verb,
    Watch,
)
from gloc3.messages.envelope import (
    CommandReply,
    ComponentStatus,
    Envelope,
    FunctionReply,
    FunctionRequest,
    Kind,
    Severity,
    Source,
)
from gloc3.messages.software import own_software
from gloc3.messages.vehicle import AutopilotState, LandedState, Pose
from gloc3.messages.watch import Want
from gloc3.mission.checking.checker import CheckReport, check_text
from gloc3.mission.executing.executor import MissionExecutor
from gloc3.network.rights import Rights
from gloc3.platform.platform import Platform
from gloc3.platform.reader import load_platform
from gloc3.store import MemoryRecords
from gloc3_onboard.command_server.authority import Authority
from gloc3_onboard.command_server.component_requests import ComponentRequests
from gloc3_onboard.command_server.contacts import Contacts
from gloc3_onboard.command_server.inventory import VehicleInventory
from gloc3_onboard.command_server.mission_commands import MOST_FINDINGS, MissionCommands
from gloc3_onboard.command_server.mission_host import MissionHost
from gloc3_onboard.command_server.neighbours import NeighbourReports
from gloc3_onboard.command_server.observing import Observing
from gloc3_onboard.command_server.server import RequestHandler
from gloc3_onboard.command_server.site import Background, ServerSettings, Site

HOP = """
mission: hop
frame: hold
tasks:
  hop:
    actions:
      up: {take_off: {height_m: 1.5}}
      down: {land: {}, after: [up]}
"""
ORIGIN = (39.5528, 2.6285, 2.0)


class Desk:
    """A handler with a vehicle on the ground and every component working."""

    def __init__(self, platform: Platform | None = None) -> None:
        self.platform: Platform = platform or load_platform("pelican_rtk")
        self.journal = MemoryRecords()
        self.said: list[str] = []
        self.sequence = -1
        self.executor = MissionExecutor(self.platform)
        self.worker: Executor = ImmediateExecutor()
        self.handler = self.begin()

    def begin(self) -> RequestHandler:
        observing = self.observing = Observing(self.platform, None, self.report)
        snapshot = observing.snapshot
        state = AutopilotState(is_connected=True, landed=LandedState.ON_GROUND, is_armable=True)
        snapshot.update_autopilot(
            Envelope("p/autopilot", Source("p", "autopilot", 1), 0, 0.0, "", "AutopilotState", state)
        )
        snapshot.expire(0.0)
        self.snapshot = snapshot
        pose = Pose(
            position_ned_m=(0.0, 0.0, 0.0),
            velocity_ned_m_s=(0.0, 0.0, 0.0),
            ned_from_frd=(1.0, 0.0, 0.0, 0.0),
            origin_geo=ORIGIN,
        )
        snapshot.update_pose(Envelope("p/pose", Source("p", "pose", 1), 0, 0.0, "ned", "Pose", pose))
        self.book = observing.book
        for row in self.platform.components:
            self.book.receive(ComponentStatus(name=row.name, kind=Kind.CONTROLLER, state=State.WORKING), 0.0)
        self.rights = Rights("pelican")
        authority = Authority("", self.report, self.rights)
        self.authority = authority.control
        site = Site(
            self.platform, self.journal, MemoryRecords(), MemoryRecords(), background=Background(worker=self.worker)
        )
        self.host = MissionHost(site, observing, self.authority, ServerSettings(), self.report)
        self.host.executor = self.executor
        missions = MissionCommands(site, observing, authority, self.host, self.report)
        components = ComponentRequests(observing, self.report)
        neighbours = NeighbourReports(self.platform.platform, self.report)
        contacts, inventory = Contacts(site.reports), VehicleInventory(site, observing)
        return RequestHandler(site, authority, missions, components, contacts, neighbours, inventory)

    def report(self, _: Severity, text: str, /, *, cause: str = "") -> None:
        self.said.append(text)

    def request(self, body: AnyBody, sender: str = "255", sequence: int | None = None, boot: int = 7) -> CiReply | None:
        if sequence is None:
            self.sequence += 1
            sequence = self.sequence
        return self.handler.handle(CiRequest(sender=sender, boot=boot, sequence=sequence, body=body), 0.0)

    def late(self, body: AnyBody, until_s: float, sequence: int, now_s: float = 100.0) -> CiReply | None:
        """What a request with a time limit is answered."""
        request = CiRequest(sender="255", boot=7, sequence=sequence, body=body, until_s=until_s)
        return self.handler.handle(request, now_s)

    def observed(self, body: AnyBody) -> CiReply | None:
        """What an observer is answered."""
        self.sequence += 1
        request = CiRequest(
            sender="bob", boot=7, sequence=self.sequence, body=body, role=StationRole.OBSERVER, way="udpin://:14551"
        )
        return self.handler.handle(request, 0.0)

    def reported(self, body: AnyBody, **kwargs: Any) -> CiReply:
        reply = self.request(body, **kwargs)
        assert reply is not None
        return reply


@pytest.fixture
def desk() -> Desk:
    made = Desk()
    assert made.reported(Control(verb=ControlVerb.REQUEST)).outcome is Outcome.ACCEPTED
    return made


def test_a_station_without_control_is_refused_and_told_who_holds_it(desk: Desk) -> None:
    reply = desk.reported(LoadMission(name="hop", text=HOP), sender="254")
    assert reply.outcome is Outcome.REFUSED
    assert "station 255 holds control" in reply.reason


def test_what_an_observer_asks_under_the_name_of_the_holder_is_no_contact_with_it(desk: Desk) -> None:
    control = desk.handler._authority.control
    for role, silent_s in ((StationRole.OBSERVER, 60.0), (StationRole.OPERATOR, 0.0)):
        asked = CiRequest(sender="255", boot=8, sequence=1, body=Hello(), role=role)
        desk.handler.handle(asked, 60.0)
        assert control.silent_s(60.0) == silent_s


def test_an_observer_gets_the_inventory(desk: Desk) -> None:
    reply = desk.observed(Hello(is_about_inventory=True))
    assert reply is not None
    found = msgspec.convert(reply.result["inventory"], Inventory)
    assert (found.version, found.protocol) == own_software()
    assert found.platform_digest == desk.platform.digest()
    assert found.components == len(desk.platform.components)


@pytest.mark.parametrize(
    "body",
    [
        LoadMission(name="hop", text=HOP),
        Steer(verb=Verb.START),
        Control(verb=ControlVerb.TAKE_OVER),
        Emergency(verb=EmergencyVerb.HOLD),
        CommandComponent(component="hold", command="stop"),
        CallFunction(component="hold", function="set_rate", arguments={"rate_hz": 5.0}),
        RequestAction(capability="land"),
    ],
    ids=lambda body: type(body).__name__,
)
def test_an_observer_may_look_and_not_command(desk: Desk, body: AnyBody) -> None:
    reply = desk.observed(body)
    assert reply is not None
    assert reply.outcome is Outcome.REFUSED
    assert reply.reason == "station bob may look and not command: it is an observer"
    assert desk.authority.holder == "255"
    assert desk.handler.components.messages == []
    checked = desk.observed(Hello())
    assert checked is not None
    assert checked.outcome is Outcome.ACCEPTED


@pytest.mark.parametrize(
    "body",
    [
        LoadMission(name="hop", text=HOP),
        Control(verb=ControlVerb.RELEASE),
        Emergency(verb=EmergencyVerb.LAND),
        CommandComponent(component="hold", command="stop"),
    ],
    ids=lambda body: type(body).__name__,
)
def test_what_was_held_back_on_the_way_is_not_carried_out_when_it_comes(desk: Desk, body: AnyBody) -> None:
    for sequence in (50, 50):
        reply = desk.late(body, until_s=60.0, sequence=sequence)
        assert reply is not None
        assert reply.outcome is Outcome.REFUSED
        assert reply.reason == "it came 40.0 s after its time limit; send it again if it is still wanted"
    assert desk.executor.mission is None
    assert desk.authority.holder == "255"
    assert desk.handler.components.messages == []
    in_time = desk.late(body, until_s=101.0, sequence=51)
    assert in_time is None or "time limit" not in in_time.reason


def test_a_request_from_before_the_vehicle_s_clock_started_again_is_refused_and_a_question_is_answered(
    desk: Desk,
) -> None:
    reply = desk.late(Steer(verb=Verb.START), until_s=5_000.0, sequence=50)
    assert reply is not None
    assert reply.reason.startswith("its time limit is 4900 s ahead: the platform's clock has started again since")
    asked = desk.late(ReadMission(), until_s=60.0, sequence=51)
    assert asked is not None
    assert "time limit" not in asked.reason


def test_a_request_that_was_carried_out_in_time_gets_the_same_reply_later(desk: Desk) -> None:
    first = desk.late(LoadMission(name="hop", text=HOP), until_s=101.0, sequence=50)
    assert first is not None
    assert desk.late(LoadMission(name="hop", text=HOP), until_s=101.0, sequence=50, now_s=500.0) == first


def test_a_mission_is_loaded_and_read_back_as_it_was(desk: Desk) -> None:
    assert desk.reported(LoadMission(name="hop", text=HOP)).outcome is Outcome.ACCEPTED
    assert desk.reported(ReadMission(), sender="254").text == HOP


def test_a_mission_with_errors_is_refused_with_the_findings_and_the_one_before_stays(desk: Desk) -> None:
    desk.reported(LoadMission(name="hop", text=HOP))
    reply = desk.reported(LoadMission(name="bad", text=HOP.replace("take_off", "take_of")))
    assert reply.outcome is Outcome.REFUSED
    assert "bad:7:" in reply.text
    assert "take_off" in reply.text
    assert desk.reported(ReadMission()).text == HOP


def test_of_too_many_findings_the_first_are_told_and_a_mission_under_way_is_not_checked_against(desk: Desk) -> None:
    tasks = "".join(f"  t{number}: {{actions: {{up: {{take_off: {{height_m: 1}}}}}}}}\n" for number in range(30))
    reply = desk.reported(LoadMission(name="bad", text=f"mission: bad\nframe: hold\ntasks:\n{tasks}"))
    lines = reply.text.splitlines()
    assert len(lines) == MOST_FINDINGS + 1
    assert lines[-1].endswith(" more")
    desk.reported(LoadMission(name="hop", text=HOP))
    assert desk.executor.mission is not None
    desk.executor.steer("start", "", 0.0, (0.0, 0.0, 0.0))
    reply = desk.reported(LoadMission(name="bad", text="no mission"))
    assert reply.reason == "the mission 'hop' is running; abort it first"


def test_a_repeat_gets_the_same_reply_and_runs_nothing_twice(desk: Desk) -> None:
    assert desk.request(CommandComponent(component="height", command="stop"), sequence=50) is None
    assert desk.request(CommandComponent(component="height", command="stop"), sequence=50) is None
    assert len(desk.handler.components.messages) == 1
    message = desk.handler.components.messages[0].message
    reply = CommandReply(
        request_id=message.request_id, component="height", command="stop", is_accepted=True, state=State.STANDBY
    )
    answer = desk.handler.replied(reply)
    assert answer is not None
    assert desk.reported(CommandComponent(component="height", command="stop"), sequence=50) == answer


def test_what_was_under_way_when_the_process_ended_is_unknown(desk: Desk) -> None:
    desk.request(CommandComponent(component="height", command="stop"), sequence=60)
    desk.handler = desk.begin()
    reply = desk.reported(CommandComponent(component="height", command="stop"), sequence=60)
    assert reply.outcome is Outcome.UNKNOWN
    assert desk.reported(Query(boot=7, sequence=60)).outcome is Outcome.UNKNOWN
    assert not desk.handler.components.messages


def test_what_ended_before_a_restart_gets_the_same_reply_after_it(desk: Desk) -> None:
    before = desk.reported(LoadMission(name="hop", text=HOP), sequence=70)
    desk.handler = desk.begin()
    assert desk.reported(LoadMission(name="hop", text=HOP), sequence=70) == before


def test_an_emergency_is_taken_from_anybody_and_named(desk: Desk) -> None:
    reply = desk.reported(Emergency(verb=EmergencyVerb.HOLD, author="ana"), sender="253")
    assert reply.outcome is Outcome.ACCEPTED
    assert "ana" in reply.reason


def test_what_was_asked_before_an_emergency_is_not_done_after_it(desk: Desk) -> None:
    desk.reported(LoadMission(name="hop", text=HOP))
    desk.reported(Emergency(verb=EmergencyVerb.HOLD), sequence=91)
    reply = desk.reported(Steer(verb=Verb.START), sequence=90)
    assert reply.outcome is Outcome.REFUSED
    assert "emergency" in reply.reason


def test_an_lci_command_is_held_against_the_state_table_before_it_goes_out(desk: Desk) -> None:
    reply = desk.reported(CommandComponent(component="height", command="start"))
    assert reply.outcome is Outcome.REFUSED
    assert "start is not accepted in working" in reply.reason
    assert not desk.handler.components.messages


def test_an_unknown_component_is_refused_with_those_that_there_are(desk: Desk) -> None:
    assert "limiter" in desk.reported(CommandComponent(component="hieght", command="stop")).reason


def test_a_component_that_does_not_answer_leaves_the_outcome_unknown(desk: Desk) -> None:
    desk.request(CallFunction(component="height", function="set_rate", arguments={"rate_hz": 5.0}))
    assert [reply.outcome for reply in desk.handler.expire(100.0)] == [Outcome.UNKNOWN]


def test_actions_are_not_started_behind_the_executors_back(desk: Desk) -> None:
    reply = desk.reported(CallFunction(component="waypoints", function="action.start"))
    assert reply.outcome is Outcome.REFUSED


def test_a_single_action_is_checked_like_a_mission(desk: Desk) -> None:
    reply = desk.reported(RequestAction(capability="go_to", arguments={"position_m": [1, 1, 500]}))
    assert reply.outcome is Outcome.REFUSED
    assert reply.text


@pytest.mark.parametrize(
    "odd", [b"1.5", {b"up": 1}, {"up": b"1"}, datetime(2026, 1, 1, tzinfo=UTC), math.nan, 1 << 63, "1" * 9_999]
)
def test_whatever_the_arguments_of_an_action_are_it_is_refused_and_the_server_goes_on(desk: Desk, odd: object) -> None:
    reply = desk.reported(RequestAction(capability="take_off", arguments={"height_m": odd}))
    assert reply.outcome is Outcome.REFUSED


def test_an_emergency_disarm_takes_the_platforms_typed_name(desk: Desk) -> None:
    refused = desk.reported(Emergency(verb=EmergencyVerb.DISARM, author="ana", confirmation="pelikan"), sender="254")
    assert refused.outcome is Outcome.REFUSED
    assert "pelican" in refused.reason
    assert not desk.handler.missions.disarms
    reply = desk.reported(Emergency(verb=EmergencyVerb.DISARM, author="ana", confirmation="pelican"), sender="254")
    assert reply.outcome is Outcome.ACCEPTED
    assert [disarm.author for disarm in desk.handler.missions.disarms] == ["ana"]
    assert any("ana" in text for text in desk.said)


def test_no_mission_starts_while_nothing_is_heard_of_the_autopilots_state(desk: Desk) -> None:
    desk.reported(LoadMission(name="hop", text=HOP))
    desk.snapshot.expire(60.0)
    reply = desk.reported(Steer(verb=Verb.START))
    assert reply.outcome is Outcome.REFUSED
    assert reply.reason == "no state is received from the autopilot"


def asked_of_viewer(desk: Desk) -> FunctionRequest:
    component, message = desk.handler.components.messages.pop()
    assert component == "viewer"
    assert isinstance(message, FunctionRequest)
    return message


def test_two_stations_with_one_id_are_told_of() -> None:
    desk = Desk()
    for boot in (7, 8) * 4:
        desk.reported(Control(verb=ControlVerb.REQUEST), boot=boot)
    assert [text for text in desk.said if "two stations have the id 255" in text]


def test_looking_needs_no_control_and_goes_to_the_viewer(desk: Desk) -> None:
    assert desk.request(Watch(wants=[Want("pose", 2.0)]), sender="254") is None
    message = asked_of_viewer(desk)
    assert message.function == "watch"
    assert message.arguments == {"station": "254", "wants": [["pose", 2.0, 64, 48, 40]], "is_listing": False}
    reply = FunctionReply(
        request_id=message.request_id, component="viewer", function="watch", is_accepted=False, reason="no such topic"
    )
    answer = desk.handler.replied(reply)
    assert answer is not None
    assert (answer.sender, answer.outcome, answer.reason) == ("254", Outcome.REFUSED, "no such topic")
    assert desk.request(ListTopics(), sender="254") is None
    assert asked_of_viewer(desk).function == "topics"


def test_looking_leaves_nothing_on_disk_and_is_possible_before_the_autopilot_answers(desk: Desk) -> None:
    desk.host.executor = None
    before = len(desk.journal.load())
    desk.request(Watch(wants=[Want("pose")]))
    message = asked_of_viewer(desk)
    reply = FunctionReply(request_id=message.request_id, component="viewer", function="watch", is_accepted=True)
    assert desk.handler.replied(reply) is not None
    assert len(desk.journal.load()) == before


def test_an_older_want_does_not_come_after_a_newer_one(desk: Desk) -> None:
    desk.request(Watch(), sequence=31)
    asked_of_viewer(desk)
    late = desk.reported(Watch(wants=[Want("pose")]), sequence=30)
    assert late.outcome is Outcome.REFUSED
    assert "superseded" in late.reason
    assert desk.handler.components.messages == []
    assert desk.request(Watch(wants=[Want("pose")]), sequence=0, boot=8) is None, "a station that was started anew"


def test_a_viewer_that_does_not_answer_leaves_the_request_unknown(desk: Desk) -> None:
    before = len(desk.journal.load())
    desk.request(Watch(wants=[Want("pose")]))
    (answer,) = desk.handler.expire(100.0)
    assert answer.outcome is Outcome.UNKNOWN
    assert len(desk.journal.load()) == before


@pytest.fixture
def checking(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Desk, Event]]:
    """A handler that has missions checked in a thread, and what lets a check end."""
    may_end = Event()

    def check_slowly(*args: Any) -> CheckReport:
        assert may_end.wait(30.0)
        return check_text(*args)

    monkeypatch.setattr("gloc3_onboard.command_server.mission_commands.check_text", check_slowly)
    with ThreadPoolExecutor(1) as worker:
        made = Desk()
        made.worker = worker
        made.handler = made.begin()
        made.reported(Control(verb=ControlVerb.REQUEST))
        yield made, may_end
        may_end.set()


def answered(desk: Desk, count: int = 1) -> list[CiReply]:
    """The answers that come later."""
    end_s, replies = time.monotonic() + 30.0, list[CiReply]()
    while len(replies) < count and time.monotonic() < end_s:
        time.sleep(0.005)
        replies += desk.handler.expire(1.0)
    return replies


def test_while_a_mission_is_checked_everything_else_goes_on(checking: tuple[Desk, Event]) -> None:
    desk, may_end = checking
    assert desk.request(LoadMission(name="hop", text=HOP)) is None
    assert desk.handler.expire(0.5) == []
    assert desk.reported(Control(verb=ControlVerb.REQUEST)).outcome is Outcome.ACCEPTED
    assert desk.request(LoadMission(name="bad", text="mission: bad\n")) is None
    may_end.set()
    accepted, refused = answered(desk, 2)
    assert (accepted.outcome, refused.outcome) == (Outcome.ACCEPTED, Outcome.REFUSED)
    assert desk.executor.mission is not None
    assert "error(s)" in refused.reason
    assert desk.executor.mission.mission.text == HOP


def test_what_has_changed_while_a_mission_was_checked_counts(checking: tuple[Desk, Event]) -> None:
    desk, may_end = checking
    assert desk.request(LoadMission(name="hop", text=HOP)) is None
    assert desk.reported(Control(verb=ControlVerb.RELEASE)).outcome is Outcome.ACCEPTED
    may_end.set()
    (reply,) = answered(desk)
    assert (reply.outcome, desk.executor.mission) == (Outcome.REFUSED, None)
    assert "control" in reply.reason


def test_missions_beyond_what_can_wait_for_their_check_are_refused(checking: tuple[Desk, Event]) -> None:
    desk, _ = checking
    for _ in range(8):
        assert desk.request(LoadMission(name="hop", text=HOP)) is None
    assert "8 missions are being checked" in desk.reported(LoadMission(name="hop", text=HOP)).reason
