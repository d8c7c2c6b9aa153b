"""`gloc3 log why` and `gloc3 log fork`, on the log of a flight with faults."""

import re
from importlib.resources import files
from pathlib import Path

import pytest

from gloc3.cli.program import run as run_command
from gloc3.errors import Refused
from gloc3.log.causes import Happening, causes_of, find_happening, read_happenings, render_causes
from gloc3.log.reader import LogReader, find_log
from gloc3.messages.summaries import AUTOPILOT_SAYS
from gloc3.messages.topics import TopicTable
from gloc3_sitl.proof.fork import Changed, fork

pytestmark = pytest.mark.flight

FLOWN = ("--fault", "link_loss@6..14", "--fault", "crash:pose@8..8.4", "--wind", "2", "--quiet")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flown")
    assert run_command(["fly", "hop", "--platform", "pelican_rtk", *FLOWN, "--out", str(folder)]) == 1, "it fails"
    return folder


def why(run: Path, what: str) -> list[str]:
    with LogReader(find_log(run), TopicTable.installed().types) as reader:
        happenings = read_happenings(reader)
    return [f"{one.subject}: {one.text}" for one in causes_of(happenings, find_happening(happenings, what))]


def test_a_policy_goes_back_to_the_fault_that_cut_the_link(run: Path) -> None:
    chain = why(run, "policy land")
    assert chain[0] == "mission: policy land: link lost"
    assert chain[-1] == "injected: fault link_loss@6..14"


def test_one_word_is_enough_where_a_component_has_it_in_its_name(run: Path) -> None:
    chain = why(run, "land")
    assert chain[0] == "mission: link lost: no message for 5 s; policy: land"
    assert chain[-1] == "injected: fault link_loss@6..14"


def test_a_mode_of_the_autopilot_is_no_cause_of_the_next(run: Path) -> None:
    assert why(run, "mode land")[1:] == []
    assert why(run, "landing: initialize")[0].startswith("landing: initialize")


def test_what_the_autopilot_does_by_itself_goes_back_to_the_fault_that_it_names(tmp_path: Path) -> None:
    flown = ("--platform", "copter", "--fault", "battery=0.05@16", "--quiet", "--out", str(tmp_path))
    assert run_command(["fly", "survey", *flown]) == 1
    chain = why(tmp_path, "mission aborted")
    assert chain[0] == "mission: mission aborted: ended by the autopilot's failsafe"
    assert chain[-2].startswith("autopilot_link: the autopilot says: Failsafe: battery ")
    assert chain[-1] == "injected: fault battery=0.05@16"


def test_a_component_that_fails_goes_back_to_its_own_fault(run: Path) -> None:
    assert why(run, "pose: working -> faulty")[-1] == "injected: fault crash:pose@8..8.4"


def test_a_start_goes_back_to_the_operators_command(run: Path) -> None:
    assert why(run, "mission running")[-1].startswith("station 255: Steer start")


def test_each_cause_is_shown_with_its_source_and_number(run: Path) -> None:
    with LogReader(find_log(run), TopicTable.installed().types) as reader:
        happenings = read_happenings(reader)
    text = render_causes(causes_of(happenings, find_happening(happenings, "11.5")))
    assert "because\n" in text
    assert "(sim/fault 0 of simulator)" in text
    with pytest.raises(Refused, match="nothing in the log says 'a whale'"):
        find_happening(happenings, "a whale")
    with pytest.raises(Refused, match=r"nothing is told in the log until 0\.1 s"):
        find_happening(happenings, "0.1")


def test_a_flight_is_the_recorded_one_until_it_is_changed(run: Path, tmp_path: Path) -> None:
    forked = fork(run, Changed(at_s=9.0, faults=("pilot:land",)), tmp_path)
    assert forked.apart_s is not None
    assert 9.0 <= forked.apart_s < 9.5
    assert forked.most_apart_m > 0.5
    assert forked.state == "paused"
    assert (tmp_path / "fork.svg").is_file()
    assert (tmp_path / "log.mcap").is_file()


def test_nothing_changed_is_the_same_flight(run: Path, tmp_path: Path) -> None:
    forked = fork(run, Changed(at_s=9.0), tmp_path)
    assert (forked.apart_s, forked.most_apart_m) == (None, 0.0)


def test_a_failsafe_that_is_named_after_its_mode_ends_no_chain_in_a_circle() -> None:
    mode = Happening(10.0, "autopilot", "mode return", "autopilot", "autopilot_driver", 2)
    said = Happening(10.3, "link", f"{AUTOPILOT_SAYS}Failsafe activated: RTL", "ci/event", "command_server", 3)
    after = Happening(10.1, "mission", "failsafe: activated by the autopilot", "ci/event", "command_server", 4)
    assert causes_of([mode, said], mode) == [mode, said]
    assert causes_of([mode, after, said], mode) == [mode, said], "what comes after the mode is no cause of it"


def test_the_flight_of_a_plan_is_flown_again_from_the_home_that_was_planned(tmp_path: Path) -> None:
    plan = Path("tests/data/missions/box.plan")
    flown = ("--platform", "pelican_rtk", "--quiet", "--out", str(tmp_path / "flown"))
    assert run_command(["fly", str(plan), *flown]) == 0
    (tmp_path / "forked").mkdir()
    forked = fork(tmp_path / "flown", Changed(at_s=9.0), tmp_path / "forked")
    assert (forked.apart_s, forked.most_apart_m, forked.state) == (None, 0.0, "done")


def test_a_log_that_is_not_there_leaves_the_folder_of_the_last_one_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "log.mcap").write_text("a log", encoding="utf-8")
    missing = str(tmp_path / "elsewhere" / "nope.mcap")
    assert run_command(["log", "fork", missing, "--at", "9", "--fault", "pilot:land", "--out", str(tmp_path)]) == 2
    assert (tmp_path / "log.mcap").read_text(encoding="utf-8") == "a log"


def test_it_is_flown_again_in_its_own_world(tmp_path: Path) -> None:
    world = tmp_path / "turned.yaml"
    text = (files("gloc3_sitl.world") / "worlds" / "hold.yaml").read_text(encoding="utf-8")
    turned = re.sub(r"heading_deg: [0-9.]+", "heading_deg: 45", text, count=1)
    assert turned != text
    world.write_text(turned, encoding="utf-8")
    flown = ("--platform", "pelican_rtk", "--world", str(world), "--quiet", "--out", str(tmp_path / "flown"))
    assert run_command(["fly", "hop", *flown]) == 0
    world.unlink()
    (tmp_path / "forked").mkdir()
    forked = fork(tmp_path / "flown", Changed(at_s=9.0), tmp_path / "forked")
    assert (forked.apart_s, forked.most_apart_m) == (None, 0.0)


def test_a_component_is_made_anew_with_other_settings(run: Path, tmp_path: Path) -> None:
    forked = fork(run, Changed(at_s=9.0, settings={"viewer": {}}), tmp_path)
    assert any("shutdown viewer" in line for line in forked.story)
    assert any("start viewer" in line for line in forked.story)
    with pytest.raises(Refused, match="has no component 'viewr'; did you mean 'viewer'"):
        fork(run, Changed(at_s=9.0, settings={"viewr": {}}), tmp_path)


def test_a_change_that_cannot_come_is_refused(run: Path, tmp_path: Path) -> None:
    with pytest.raises(Refused, match="nothing can be changed at 9999 s"):
        fork(run, Changed(at_s=9999.0, settings={"viewer": {}}), tmp_path)
    for changed in (Changed(at_s=float("nan")), Changed(at_s=-1.0), Changed(at_s=9.0, faults=("pilot:land@3",))):
        with pytest.raises(Refused, match="faults without times"):
            fork(run, changed, tmp_path)
    with pytest.raises(Refused, match="the flight ended before viewer was exchanged"):
        fork(run, Changed(at_s=9.0, settings={"viewer": {}}, faults=("link_loss",)), tmp_path)


def test_an_action_that_an_exchange_ends_breaks_no_invariant(run: Path, tmp_path: Path) -> None:
    forked = fork(run, Changed(at_s=5.0, settings={"take_off": {"arm": True}}), tmp_path)
    assert forked.state == "failed"
    assert forked.broken == ()
