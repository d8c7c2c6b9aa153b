"""Rights at the command interface server: each request by its member's role, given roles, two persons, capabilities."""

from pathlib import Path

import msgspec
import pytest
from tests.common.network.test_rights import FILE, STATIONS
from tests.common.network.test_rights import Yard as RightsOf
from tests.onboard.command_server.test_request_handler import HOP, Desk

from gloc3.messages.command_interface import (
    AnyBody,
    CiReply,
    CiRequest,
    Control,
    ControlVerb,
    Emergency,
    EmergencyVerb,
    Hello,
    LoadMission,
    Outcome,
    RequestAction,
    Steer,
    Verb,
)
from gloc3.network.rights import MemberRights

FENCELESS = LoadMission(name="hop.yaml", text=HOP)


class Ward(Desk):
    """A vehicle whose members have rights."""

    def __init__(self, folder: Path, text: str = FILE) -> None:
        super().__init__()
        self.rights.adopt(RightsOf.read(folder, text), STATIONS)
        self.sequences = dict.fromkeys((*STATIONS, ""), 0)

    def ask(self, member: str, body: AnyBody, objection: str = "") -> CiReply:
        self.sequences[member] += 1
        request = CiRequest(
            sender=member or "255",
            member=member,
            boot=7,
            sequence=self.sequences[member],
            body=body,
            objection=objection,
        )
        reply = self.handler.handle(request, 0.0)
        assert reply is not None
        return reply

    def refusal(self, member: str, body: AnyBody) -> str:
        reply = self.ask(member, body)
        assert (reply.outcome is Outcome.REFUSED) is (reply.reason != "" and reply.outcome is not Outcome.ACCEPTED)
        return reply.reason if reply.outcome is Outcome.REFUSED else ""


@pytest.fixture
def ward(tmp_path: Path) -> Ward:
    return Ward(tmp_path)


def test_a_request_is_judged_by_the_members_role_before_control(ward: Ward) -> None:
    assert "dora is observer" in ward.refusal("dora", Control(verb=ControlVerb.REQUEST))
    assert ward.refusal("alice", Control(verb=ControlVerb.REQUEST)) == ""
    assert "needs the role commander of pelican: erin is operator" in ward.refusal(
        "erin", Control(verb=ControlVerb.TAKE_OVER)
    )
    assert ward.authority.holder == "alice"
    assert ward.refusal("carol", Control(verb=ControlVerb.TAKE_OVER)) == ""
    assert ward.authority.holder == "carol"
    assert "this link stands for no member" in ward.refusal("", Emergency(verb=EmergencyVerb.HOLD))
    assert ward.refusal("alice", Emergency(verb=EmergencyVerb.HOLD)) == ""


def test_an_objection_of_the_link_is_the_refusal(ward: Ward) -> None:
    reply = ward.ask("alice", Control(verb=ControlVerb.REQUEST), "it came 2.0 s after its time limit")
    assert (reply.outcome, reply.reason) == (Outcome.REFUSED, "it came 2.0 s after its time limit")
    assert ward.authority.holder == ""


def test_the_answer_to_a_greeting_says_what_the_member_may(ward: Ward) -> None:
    for is_about_rights in (False, True):
        rights = msgspec.convert(ward.ask("mike", Hello(is_about_rights=is_about_rights)).result, MemberRights)
        assert [str(one) for one in rights.roles] == ["maintainer"]
        assert "fly" in rights.refusals
        assert ward.handler.wants_everything is not is_about_rights
        ward.handler.wants_everything = False


def test_capabilities_of_a_mission_and_of_a_start_are_those_of_the_member(ward: Ward) -> None:
    assert ward.refusal("erin", Control(verb=ControlVerb.REQUEST)) == ""
    assert ward.refusal("erin", RequestAction(capability="go_to")) == (
        "erin may not use go_to of pelican, only land and take_off"
    )
    longer = HOP.replace("down: {land: {}, after: [up]}", "back: {return_home: {}, after: [up]}")
    assert ward.refusal("erin", LoadMission(name="x", text=longer)) == (
        "erin may not use return_home of pelican, only land and take_off"
    )
    assert ward.refusal("erin", FENCELESS) == ""
    assert ward.refusal("carol", Control(verb=ControlVerb.TAKE_OVER)) == ""
    assert ward.refusal("carol", LoadMission(name="x", text=longer)) == ""
    assert ward.refusal("carol", Control(verb=ControlVerb.RELEASE)) == ""
    assert ward.refusal("erin", Control(verb=ControlVerb.REQUEST)) == ""
    assert "erin may not use return_home" in ward.refusal("erin", Steer(verb=Verb.START))


def test_a_role_that_is_taken_from_the_holder_takes_control_from_it(ward: Ward) -> None:
    appoint = Control(verb=ControlVerb.APPOINT, station="dora", role="operator", for_s=60.0)
    assert "needs the role commander" in ward.refusal("alice", appoint)
    assert ward.ask("carol", appoint).reason == "dora is operator of pelican until 1970-01-01 00:01 UTC"
    assert ward.refusal("dora", Control(verb=ControlVerb.REQUEST)) == ""
    assert ward.authority.holder == "dora"
    assert ward.ask("carol", Control(verb=ControlVerb.DISMISS, station="dora")).reason == (
        "dora is observer of pelican again"
    )
    assert "carol: dora is observer of pelican again" in ward.said


def test_two_persons_disarm_and_load_a_mission_without_a_fence(tmp_path: Path) -> None:
    ward = Ward(tmp_path, FILE.replace("[terminate]", "[terminate, fence_off]"))
    disarm = Emergency(verb=EmergencyVerb.DISARM, confirmation="pelican")
    assert "needs two persons: noted for alice" in ward.refusal("alice", disarm)
    assert "noted for alice" in ward.refusal("alice", disarm)
    assert not ward.handler.missions.disarms
    assert ward.refusal("carol", disarm) == ""
    assert len(ward.handler.missions.disarms) == 1
    assert "two persons have requested Emergency: alice and carol" in ward.said
    assert ward.refusal("alice", Control(verb=ControlVerb.REQUEST)) == ""
    assert "flying without a geofence needs two persons" in ward.refusal("alice", FENCELESS)
    assert "no station holds" not in ward.refusal("carol", FENCELESS)
    assert ward.handler.missions.executor.mission is None
    assert ward.refusal("alice", FENCELESS) == ""  # carol, who does not hold control, has asked for the same
    assert "two persons have requested LoadMission: carol and alice" in ward.said
    assert "noted for alice" in ward.refusal(
        "alice", RequestAction(capability="go_to", arguments={"position_m": [1, 1, 2]})
    )
    assert ward.refusal("carol", Control(verb=ControlVerb.TAKE_OVER)) == ""
    fenced = HOP.replace("frame: hold", "frame: hold\ngeofence: {polygon_m: [[-2, -2], [9, -2], [9, 9], [-2, 9]]}")
    request = CiRequest(sender="carol", member="carol", boot=8, sequence=0, body=LoadMission(name="x", text=fenced))
    assert ward.handler.handle(request, 0.0) is None  # it waits for its fence in the autopilot, not for a person
