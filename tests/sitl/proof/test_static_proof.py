"""The static proof: who takes over or which policy flies for every component and action, and what has no answer."""

import msgspec
import pytest
from tests.sitl.proof.test_search import HOP

from gloc3.errors import InputError
from gloc3.mission.examples import find_mission
from gloc3.mission.reading.reader import MissionReferences, load_mission
from gloc3.mission.templates import mission_from
from gloc3.platform.reader import check_platform, load_platform, read_document, whole_text
from gloc3_sitl.proof.case import FlightCase
from gloc3_sitl.proof.search import flying
from gloc3_sitl.proof.static_flights import distinct_cells, fly_cells, prove_case
from gloc3_sitl.proof.static_proof import StaticCell, StaticProof, prove_statically


def prove(change: tuple[str, str] = ("", ""), mission: str = "hop", platform: str = "pelican_rtk") -> StaticProof:
    """Proves an installed platform with one text of its file changed."""
    text = whole_text(platform)
    assert change[0] in text
    document = read_document(text.replace(*change) if change[0] else text, "platform.yaml")
    found = check_platform(document, is_loading_classes=True)
    return prove_statically(found, load_mission(str(find_mission(mission)), MissionReferences.of(found)), document)


def cell(proof: StaticProof, component: str, phase: str = "hop.stay") -> StaticCell:
    return next(one for one in proof.cells if (one.component, one.phase) == (component, phase))


def test_every_component_has_an_answer_in_every_action() -> None:
    proof = prove()
    assert {one.phase for one in proof.cells} == {"hop.up", "hop.stay", "hop.down"}
    assert len(proof.cells) % 3 == 0
    assert not [one for one in proof.cells if one.problem]
    assert not [one for one in proof.findings if not one.is_warning]


def test_a_standby_takes_over_and_a_policy_flies() -> None:
    proof = prove()
    assert cell(proof, "limiter").by == "limiter_standby"
    assert cell(proof, "pose").policy == "land"
    assert "brought up again 3 times" in cell(proof, "pose").answer
    assert not cell(proof, "viewer").policy
    assert "autopilot's own way down" in cell(proof, "autopilot_driver").answer


def test_what_only_feeds_a_position_that_has_other_sources_ends_nothing() -> None:
    proof = prove(mission="survey", platform="auv")
    found = cell(proof, "satellites", "area.lines")
    assert not found.policy
    assert "other sources" in found.answer


def test_a_component_without_an_answer_is_a_finding_with_its_line() -> None:
    row = next(line for line in whole_text("pelican_rtk").splitlines() if "name: autopilot_driver," in line)
    changed = row.replace("reinitialize: {times: 10, back_off_s: 0.2}, ", "")
    assert changed != row
    proof = prove((row, changed))
    assert cell(proof, "autopilot_driver").problem
    finding = next(one for one in proof.findings if not one.is_warning)
    assert (
        "if autopilot_driver dies during hop.up, hop.stay, hop.down: every way down needs it"
        in finding.message.replace("needs autopilot_driver", "needs it")
    )
    assert finding.line > 0
    assert "reinitialize" in finding.hint


def test_a_chain_that_only_an_input_wakes_is_a_finding() -> None:
    proof = prove()
    stops = [one for one in proof.findings if one.is_warning]
    assert all("stops permanently when" in one.message for one in stops)


def test_one_flight_shows_all_cells_of_a_component_a_capability_and_an_answer() -> None:
    cells = prove_case(msgspec.structs.replace(HOP, mission="patrol")).cells
    few = distinct_cells(cells)
    assert len(few) < len(cells)
    assert {one.signature for one in few} == {one.signature for one in cells}
    assert not distinct_cells(cells, [one.signature for one in cells])


def test_a_mission_that_is_given_as_text_is_proven() -> None:
    platform = load_platform("boat")
    text = mission_from("transit", platform, "boat.mission.schema.json")
    proof = prove_case(FlightCase(mission="transit.yaml", platform="boat", text=text))
    assert proof.mission == "transit"
    assert {"depart", "transit"} <= {one.capability for one in proof.cells}
    assert not [one for one in proof.cells if one.problem]


@pytest.mark.flight
@pytest.mark.thorough
def test_the_answers_are_what_happens() -> None:
    proof = prove_case(HOP)
    few = [cell(proof, name, "hop.stay") for name in ("limiter", "pose", "viewer")]
    with flying(1) as fly:
        flown = list(fly_cells(few, HOP, fly, lambda text: None))
    assert [one.problem for one in flown] == ["", "", ""]
    assert [one.state for one in flown] == ["done", "failed", "done"]


def test_a_standby_that_does_not_read_the_setpoints_of_its_primary_is_an_error_and_no_answer() -> None:
    text, wanted = whole_text("pelican_rtk"), "setpoint_wanted/waypoints, "
    row = next(line for line in text.splitlines() if "name: limiter_standby," in line)
    assert wanted in row
    text = text.replace(row, row.replace(wanted, ""))
    with pytest.raises(InputError) as refused:
        check_platform(read_document(text, "platform.yaml"), is_loading_classes=True)
    (finding,) = [one for one in refused.value.findings if not one.is_warning]
    assert text.splitlines()[finding.line - 1].lstrip().startswith("- {name: limiter_standby,")
    assert "limiter_standby does not read setpoint_wanted/waypoints, which limiter reads" in finding.message
    document = read_document(text, "platform.yaml")
    platform = check_platform(document, is_loading_classes=False)
    proof = prove_statically(platform, load_mission(str(find_mission("hop")), MissionReferences.of(platform)), document)
    assert not cell(proof, "limiter").by
    assert "takes over" not in cell(proof, "limiter").answer
