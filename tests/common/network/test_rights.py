"""Rights: the table of roles, groups and ends of roles, given roles, two persons, and files with mistakes."""

from datetime import UTC, datetime
from pathlib import Path

import pytest

from gloc3.errors import InputError, Refused
from gloc3.messages.command_interface import (
    AnyBody,
    CallFunction,
    CommandComponent,
    Control,
    ControlVerb,
    CutLog,
    Emergency,
    EmergencyVerb,
    Hello,
    LoadMission,
    RequestAction,
    Steer,
    Verb,
)
from gloc3.network.access import MemberRole
from gloc3.network.rights import ITSELF, UNLIMITED, MemberRights, Rights
from gloc3.network.rights_file import RIGHTS_FILE, Right, RightsFile, read_rights

FILE = """\
groups: {coast: [pelican, heron]}
rights:
  - {member: carol, role: commander, of: [all]}
  - {member: alice, role: operator, of: [coast]}
  - {member: erin, role: operator, of: [pelican], may: [take_off, land], until: 2026-12-01}
  - {member: mike, role: maintainer, of: [pelican]}
two_persons: [terminate]
"""
STATIONS = ("alice", "carol", "erin", "mike", "dora")
MEMBERS = {
    **dict.fromkeys(STATIONS, MemberRole.OPERATOR),
    "bob": MemberRole.OBSERVER,
    "pelican.main": MemberRole.PLATFORM,
    "heron.main": MemberRole.PLATFORM,
    "shag.main": MemberRole.PLATFORM,
}
BODIES: dict[str, AnyBody] = {
    "look": Hello(),
    "control": Control(verb=ControlVerb.REQUEST),
    "take over": Control(verb=ControlVerb.TAKE_OVER),
    "load": LoadMission(name="x", text="x"),
    "start": Steer(verb=Verb.START),
    "start on red": Steer(verb=Verb.START, override="it must"),
    "hold": Emergency(verb=EmergencyVerb.HOLD),
    "disarm": Emergency(verb=EmergencyVerb.DISARM),
    "stop a component": CommandComponent(component="x", command="stop"),
    "force": CommandComponent(component="x", command="stop", is_forced=True),
    "set": CommandComponent(component="x", command="initialize", settings={}),
    "function": CallFunction(component="x", function="set"),
    "logs": CutLog(),
    "appoint": Control(verb=ControlVerb.APPOINT, station="dora", role="operator", for_s=60.0),
}
FLYING = {"control", "load", "start", "hold", "disarm", "stop a component", "logs"}
ALLOWED = {
    "alice": FLYING,
    "carol": FLYING | {"take over", "start on red", "force", "appoint"},
    "mike": {"control", "set", "function", "logs"},
    "dora": set(),
    "": set(),
}


class Yard:
    """A platform's rights, at a time that is set."""

    def __init__(self, folder: Path, text: str = FILE, platform: str = "pelican") -> None:
        self.utc_s = datetime(2026, 11, 28, 12, tzinfo=UTC).timestamp()
        self.now_s = 1000.0
        self.file = self.read(folder, text)
        self.rights = Rights(platform, lambda: self.utc_s, lambda: self.now_s, self.file, STATIONS)

    @staticmethod
    def read(folder: Path, text: str) -> RightsFile:
        (folder / RIGHTS_FILE).write_text(text)
        found = read_rights(folder / RIGHTS_FILE, MEMBERS)
        assert found.file is not None
        if found.warnings:
            raise InputError(found.warnings)
        return found.file

    def refusal(self, member: str, body: AnyBody) -> str:
        try:
            self.rights.check(member, body)
        except Refused as refusal:
            return str(refusal)
        return ""


def test_each_role_may_what_its_row_says(tmp_path: Path) -> None:
    yard = Yard(tmp_path)
    found = {who: {what for what, body in BODIES.items() if not yard.refusal(who, body)} for who in ALLOWED}
    assert found == {who: {"look", *allowed} for who, allowed in ALLOWED.items()}


def test_without_a_file_everyone_has_all_rights_and_nobody_gives_roles() -> None:
    rights = Rights("pelican")
    for body in BODIES.values():
        rights.check("", body)
        assert rights.second("", body) == ""
    assert rights.summary("alice") == MemberRights()
    with pytest.raises(Refused, match=r"no rights.yaml"):
        rights.appoint("carol", "dora", "operator", 60.0)


def test_a_refusal_names_the_role_that_may_and_who_has_it(tmp_path: Path) -> None:
    yard = Yard(tmp_path)
    assert yard.refusal("alice", BODIES["take over"]) == (
        "overruling (take-over, force, red checks) needs the role commander of pelican: alice is operator; carol has it"
    )
    assert yard.refusal("dora", BODIES["start"]) == (
        "flying and steering needs the role operator or commander of pelican: dora is observer; "
        "alice, carol and erin have it"
    )
    assert "this link stands for no member" in yard.refusal("", BODIES["hold"])


def test_roles_are_of_named_vehicles_or_groups(tmp_path: Path) -> None:
    for platform, may in (("heron", True), ("shag", False)):
        yard = Yard(tmp_path, platform=platform)
        assert (yard.refusal("alice", BODIES["start"]) == "") is may
        assert yard.refusal("carol", BODIES["start"]) == ""


def test_a_role_may_be_limited_to_capabilities_and_ends(tmp_path: Path) -> None:
    yard = Yard(tmp_path)
    assert yard.refusal("erin", RequestAction(capability="land")) == ""
    assert yard.refusal("erin", RequestAction(capability="go_to")) == (
        "erin may not use go_to of pelican, only land and take_off"
    )
    with pytest.raises(Refused, match="may not use follow_waypoints"):
        yard.rights.check_capabilities("erin", ["land", "follow_waypoints"])
    yard.rights.check_capabilities("alice", ["follow_waypoints"])
    yard.utc_s = datetime(2026, 12, 1, 23, 59, tzinfo=UTC).timestamp()
    assert yard.refusal("erin", BODIES["start"]) == ""
    yard.utc_s += 61.0
    assert "erin is observer" in yard.refusal("erin", BODIES["start"])


def test_a_commander_gives_a_role_for_a_time_and_takes_it_back(tmp_path: Path) -> None:
    yard = Yard(tmp_path)
    rights = yard.rights
    assert (
        rights.appoint("carol", "dora", "operator", 600.0) == "dora is operator of pelican until 2026-11-28 12:10 UTC"
    )
    assert yard.refusal("dora", BODIES["start"]) == ""
    yard.utc_s += 86_400.0  # somebody sets the clock
    assert yard.refusal("dora", BODIES["start"]) == ""
    yard.utc_s -= 86_400.0
    yard.now_s += 600.0
    assert "dora is observer" in yard.refusal("dora", BODIES["start"])
    rights.appoint("carol", "dora", "operator", 600.0)
    assert rights.dismiss("dora") == "dora is observer of pelican again"
    assert yard.refusal("dora", BODIES["start"])
    rights.appoint("carol", "alice", "observer", 600.0)
    assert "alice is observer until 2026-11-28 12:10 UTC by carol" in yard.refusal("alice", BODIES["start"])
    rights.dismiss("alice")
    assert yard.refusal("alice", BODIES["start"]) == ""
    for member, role, for_s, why in (
        ("carol", "observer", 60.0, "carol is commander of pelican; only rights.yaml changes that"),
        ("bob", "operator", 60.0, "'bob' is no operator of the network"),
        ("dora", "commander", 60.0, "'commander' cannot be given for a time"),
        ("dora", "operator", 0.0, "for more than 0 s"),
        ("dora", "operator", float("nan"), "for more than 0 s"),
    ):
        with pytest.raises(Refused, match=why):
            rights.appoint("carol", member, role, for_s)
    with pytest.raises(Refused, match="'dora' has no given role"):
        rights.dismiss("dora")


def test_what_is_configured_so_needs_two_persons(tmp_path: Path) -> None:
    yard = Yard(tmp_path)
    first, second = (Emergency(verb=EmergencyVerb.DISARM, author=f"station {who}") for who in ("alice", "carol"))
    assert yard.rights.second("alice", BODIES["hold"]) == ""
    for _ in range(2):  # the same person again is no second one
        with pytest.raises(Refused, match=r"needs two persons: noted for alice; .* within 30 s"):
            yard.rights.second("alice", first)
    assert yard.rights.second("carol", second) == "alice"
    with pytest.raises(Refused, match="noted for carol"):
        yard.rights.second("carol", second)
    yard.now_s += 30.0
    with pytest.raises(Refused, match="noted for alice"):
        yard.rights.second("alice", first)
    yard.rights.appoint("carol", "alice", "observer", 60.0)
    with pytest.raises(Refused, match="noted for carol"):  # alice has no right to it any more
        yard.rights.second("carol", second)


def test_one_person_can_always_stop_the_vehicle_and_no_limit_holds_the_vehicles_own_requests_up(tmp_path: Path) -> None:
    for right in ("fly", "control"):
        with pytest.raises(InputError, match=f"{right} cannot need two persons"):
            Yard(tmp_path, FILE.replace("[terminate]", f"[{right}]"))
    yard = Yard(tmp_path)
    for body in BODIES.values():
        assert yard.refusal(ITSELF, body) == ""


def test_a_given_role_ends_with_the_role_of_its_giver(tmp_path: Path) -> None:
    yard = Yard(tmp_path)
    yard.rights.appoint("carol", "dora", "operator", 600.0)
    yard.rights.adopt(yard.read(tmp_path, FILE.replace("carol, role: commander", "carol, role: operator")), STATIONS)
    assert "dora is observer" in yard.refusal("dora", BODIES["start"])


def test_the_autopilot_itself_is_for_those_whose_flying_has_no_limits(tmp_path: Path) -> None:
    yard = Yard(tmp_path)
    assert not any(yard.rights.may_alone(who, UNLIMITED) for who in STATIONS), "terminate needs two persons"
    yard = Yard(tmp_path, FILE.replace("[terminate]", "[maintain]"))
    free = {who for who in (*STATIONS, "") if yard.rights.may_alone(who, UNLIMITED)}
    assert free == {"alice", "carol"}, "erin is limited to some capabilities"
    assert not yard.rights.may_alone("mike", [Right.MAINTAIN])


def test_the_screen_gets_what_a_member_may_and_why_not(tmp_path: Path) -> None:
    found = Yard(tmp_path).rights.summary("erin")
    assert [(one.role, one.may) for one in found.roles] == [("operator", ("take_off", "land"))]
    assert set(found.refusals) == {"overrule", "appoint", "maintain"}
    assert (
        "needs the role maintainer of pelican: erin is operator (only take_off and land) until 2026-12-02 00:00 UTC; mike has it"
        in found.refusals["maintain"]
    )
    assert found.two_persons == ["terminate"]


@pytest.mark.parametrize(
    ("wrong", "line", "message"),
    [
        ("rights:\n  - {member: alise, role: operator, of: [all]}", 2, "no station 'alise'.*did you mean 'alice'"),
        ("rights:\n  - {member: alice, role: pilot, of: [all]}", 2, "pilot"),
        ("rights:\n  - {member: alice, role: operator, of: [pelikan]}", 2, "no platform or group 'pelikan'"),
        ("rights:\n  - {member: bob, role: operator, of: [all]}", 2, "bob is an observer of the network"),
        ("rights:\n  - {member: alice, role: operator, of: [all], until: 2026-13-01}", 2, "'2026-13-01' is no time"),
        ("groups: {pelican: [heron]}\nrights: []", 1, "already the name of platforms"),
        ("groups: {coast: [ship]}\nrights: []", 1, "no platform 'ship'"),
        ("rights: []\ntwo_persons: [fly_high]", 2, "fly_high"),
    ],
)
def test_a_file_with_mistakes_is_refused_with_line_and_hint(
    tmp_path: Path, wrong: str, line: int, message: str
) -> None:
    with pytest.raises(InputError, match=message) as caught:
        Yard.read(tmp_path, wrong)
    assert [finding.line for finding in caught.value.findings] == [line]
