"""Rights of a network's members in flight: a role that ends, other programs on a link, and the vehicle's own requests."""

from pathlib import Path

from tests.common.network.test_rights import MEMBERS, STATIONS
from tests.flight.card import ONE_STYLE, Card
from tests.flight.missions import mission
from tests.flight.test_ending_as_a_service import Ending
from tests.flight.test_parameters_and_files_of_the_companion import put, reasons
from tests.flight.tool import Tool

from gloc3.clock import VIRTUAL_EPOCH_S, utc_text
from gloc3.exchange.base import Publisher
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.parameter_client import ParameterResult
from gloc3.messages.command_interface import (
    AnyBody,
    CiReply,
    CiRequest,
    Control,
    ControlVerb,
    Emergency,
    EmergencyVerb,
    Outcome,
    Steer,
    Verb,
)
from gloc3.network.rights_file import RIGHTS_FILE, read_rights
from gloc3_onboard.companion.commands import MISSION_START

ROLES = """\
rights:
  - {member: carol, role: commander, of: [all]}
  - {member: alice, role: operator, of: [all]UNTIL}
  - {member: mike, role: maintainer, of: [all]}
"""


class Member:
    """A member who requests something over a link that stands for it, past the middleware."""

    def __init__(self, flight: Card, name: str, station: str = "") -> None:
        self._card, self._name, self._station = flight, name, station or name
        exchange = flight.flight.exchange
        self._publisher, self._sequence = Publisher(exchange, name, "client", 3), 0
        self._replies: list[CiReply] = []
        exchange.subscribe(f"{flight.flight.name}/ci/reply", lambda one: self._replies.append(one.payload))

    def request(self, body: AnyBody) -> CiReply:
        self._sequence += 1
        request = CiRequest(sender=self._station, boot=3, sequence=self._sequence, body=body, member=self._name)
        self._publisher.publish(f"{self._card.flight.name}/ci/request", request, self._card.now_s)
        key = (self._station, 3, self._sequence)
        self._card.until(
            lambda: any((one.sender, one.boot, one.sequence) == key for one in self._replies), 5.0, "reply"
        )
        return self._replies[-1]


def adopt(flight: Card, folder: Path, ends_at_s: float | None = None) -> None:
    """The vehicle has a rights file from now on, in which alice's role ends at a time."""
    until = "" if ends_at_s is None else f', until: "{utc_text(VIRTUAL_EPOCH_S + ends_at_s, "%Y-%m-%dT%H:%M:%S")}"'
    (folder / RIGHTS_FILE).write_text(ROLES.replace("UNTIL", until))
    flight.flight.process.rights.adopt(read_rights(folder / RIGHTS_FILE, MEMBERS).file, STATIONS)


@ONE_STYLE
def test_a_role_that_ends_in_flight_takes_control_and_the_mission_goes_by_its_policy(
    flight: Card, tmp_path: Path
) -> None:
    flight.begin(mission(on_link_loss="land"), member="alice")
    flight.await_state("sweep", "running")
    adopt(flight, tmp_path, flight.now_s + 4.0)
    flight.command("pause")
    flight.command("resume")
    flight.wait(5.0)
    assert flight.was_told("alice may not hold control any more, and counts as lost")
    assert "alice is observer" in flight.refused(Steer(verb=Verb.PAUSE))
    assert "alice is observer" in flight.refused(Emergency(verb=EmergencyVerb.HOLD))
    flight.await_policy("land", 6.0)
    carol = Member(flight, "carol")
    reply = carol.request(Control(verb=ControlVerb.REQUEST))
    assert (reply.outcome, reply.reason) == (Outcome.ACCEPTED, "granted: station 255 is lost")
    flight.await_landed()


@ONE_STYLE
def test_nobody_else_speaks_in_the_name_of_the_station_that_holds_control(flight: Card, tmp_path: Path) -> None:
    flight.begin(mission(), member="alice")
    adopt(flight, tmp_path)
    flight.await_state("sweep", "running")
    flight.command("pause")
    flight.command("resume")
    other = Member(flight, "carol", "255")
    assert other.request(Steer(verb=Verb.ABORT)).reason == (
        "station 255 holds control for alice, and this request is of carol"
    )
    assert flight.state("mission") == "running"
    assert other.request(Emergency(verb=EmergencyVerb.HOLD)).outcome is Outcome.ACCEPTED
    flight.await_policy("hold", 2.0)


@ONE_STYLE
def test_programs_of_others_have_the_rights_of_their_link(flight: Card, tmp_path: Path) -> None:
    flight.begin(mission(), is_started=False, member="alice")
    flight.request(Control(verb=ControlVerb.RELEASE))
    adopt(flight, tmp_path)
    flight.wait(1.1)
    tools = {name: Tool(flight, system, member=name) for name, system in (("", 251), ("mike", 252), ("alice", 250))}
    severity = {name: put(tool, "TEXT_SEVERITY", float(len(name))) for name, tool in tools.items()}
    assert severity == {
        "": ParameterResult.REFUSED,
        "mike": ParameterResult.DONE,
        "alice": ParameterResult.REFUSED,
    }
    started = {name: tools[name].command(MISSION_START) for name in ("", "alice")}
    assert started == {"": CommandResult.DENIED, "alice": CommandResult.ACCEPTED}
    assert any("this link stands for no member" in text for text in reasons(flight)), reasons(flight)


@ONE_STYLE
def test_the_vehicle_lands_before_its_service_ends_whatever_rights_members_have(flight: Card, tmp_path: Path) -> None:
    flight.begin(mission(), member="alice")
    flight.await_state("sweep", "running")
    adopt(flight, tmp_path)
    ending = Ending(flight, "land")
    flight.run(ending.departure.land(ending.hurried))
    assert flight.height_m < 0.2
    assert not flight.autopilot.is_armed
