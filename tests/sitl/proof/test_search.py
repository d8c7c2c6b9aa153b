"""The search: the same flights for the same seed, in any order, and after an interruption; the shrinking of what it finds."""

from collections.abc import Iterator, Sequence
from importlib.resources import files
from pathlib import Path
from random import Random
from typing import Any

import msgspec
import pytest

from gloc3.errors import Refused
from gloc3.messages.envelope import Envelope
from gloc3.messages.summaries import MissionSummary
from gloc3.mission.examples import find_mission
from gloc3.platform.reader import whole_text
from gloc3_onboard.components.controllers.hold import HoldController
from gloc3_sitl.faults.fault_menu import PossibleFault, possible_faults
from gloc3_sitl.faults.fault_text import parse
from gloc3_sitl.proof.campaign import SearchLimits, SearchProgress, _count, run_search
from gloc3_sitl.proof.case import FlightCase, read_case
from gloc3_sitl.proof.course import ItEnds
from gloc3_sitl.proof.draw import AROUND_S, Course, Draw
from gloc3_sitl.proof.found import distinct, five_lines, replay, write_found
from gloc3_sitl.proof.invariant import BrokenInvariant, Invariant
from gloc3_sitl.proof.record import NoTraceback
from gloc3_sitl.proof.search import ROUND, STATE, Invariants, Search, flying
from gloc3_sitl.proof.shrink import Shrinker
from gloc3_sitl.proof.static_flights import prove_case
from gloc3_sitl.proof.trial import TrialResult, fly_case, fly_to_judge

HOP = FlightCase(mission="hop", platform="pelican_rtk")


class NeverPaused(Invariant):
    """Something that an operator's command breaks."""

    name = "never_paused"
    sentence = "The mission is never paused."
    topics = ("ci/mission",)

    def receive(self, topic: str, envelope: Envelope[Any], now_s: float) -> None:
        summary: MissionSummary = envelope.payload
        if summary.state == "paused":
            self.break_at(now_s, f"paused: {summary.reason}")


class NeverHindered(Invariant):
    """Something that many faults break."""

    name = "never_hindered"
    sentence = "No policy is carried out, and the mission runs to its end."
    topics = ("ci/mission",)

    def receive(self, topic: str, envelope: Envelope[Any], now_s: float) -> None:
        summary: MissionSummary = envelope.payload
        if summary.policy or summary.state in ("paused", "failed", "aborted", "skipped"):
            self.break_at(now_s, f"{summary.state}, policy {summary.policy}")


def pretend(cases: Sequence[FlightCase], kinds: Invariants) -> Iterator[TrialResult]:
    """What a flight reaches is said by its faults: nothing is flown."""
    for case in cases:
        words = [text.partition("@")[0] for text in case.faults]
        broken = (
            (BrokenInvariant(invariant="it_ends", t_s=1.0, text="x"),) if any("restart" in one for one in words) else ()
        )
        yield TrialResult(case=case, reached=tuple(words), broken=broken, state="done", ended_s=20.0)


@pytest.fixture(scope="module")
def first_flights(tmp_path_factory: pytest.TempPathFactory) -> tuple[Search, Path]:
    out = tmp_path_factory.mktemp("search")
    search = Search(HOP, pretend, (NeverPaused,), out)
    search.begin()
    for _ in range(3):
        search.round()
    return search, out


def test_the_same_seed_draws_the_same_flights(first_flights: tuple[Search, Path]) -> None:
    search, _ = first_flights
    again = Search(HOP, pretend, (NeverPaused,))
    again.begin()
    for _ in range(3):
        again.round()
    assert again.flights == search.flights
    assert len({one.case for one in search.flights}) > 0.9 * 3 * ROUND
    other = Search(msgspec.structs.replace(HOP, seed=5), pretend, (NeverPaused,))
    other.begin()
    assert other.round() != search.flights[:ROUND]


def test_an_interrupted_search_goes_on_with_what_it_has_flown(
    first_flights: tuple[Search, Path], tmp_path: Path
) -> None:
    search, out = first_flights
    lines = (out / STATE).read_bytes().splitlines(keepends=True)
    (tmp_path / STATE).write_bytes(b"".join(lines[: 2 * ROUND + 1]) + lines[2 * ROUND + 1][:40])
    flown: list[FlightCase] = []

    def count(cases: Sequence[FlightCase], kinds: Invariants) -> Iterator[TrialResult]:
        flown.extend(cases)
        return pretend(cases, kinds)

    again = Search(HOP, count, (NeverPaused,), tmp_path)
    again.begin()
    for _ in range(3):
        again.round()
    assert again.flights == search.flights
    assert len(flown) == ROUND, "the last round alone was flown again"


def test_a_search_that_was_killed_in_a_line_goes_on_from_there_every_time(
    first_flights: tuple[Search, Path], tmp_path: Path
) -> None:
    """What is flown again is not appended to the piece of a line."""
    _, out = first_flights
    left = (out / STATE).read_bytes()
    (tmp_path / STATE).write_bytes(left[:-200])
    for _ in range(2):
        again = Search(HOP, pretend, (NeverPaused,), tmp_path)
        again.begin()
        for _ in range(3):
            again.round()
        assert (tmp_path / STATE).read_bytes() == left


def test_a_folder_of_flights_that_were_judged_by_others_is_refused(first_flights: tuple[Search, Path]) -> None:
    _, out = first_flights
    other = Search(HOP, pretend, (NeverPaused, NoTraceback), out)
    with pytest.raises(Refused, match="invariants or version have changed"):
        other.begin()


def test_a_folder_of_a_search_in_a_world_that_has_changed_is_refused(tmp_path: Path) -> None:
    world = tmp_path / "w.yaml"
    text = (files("gloc3_sitl.world") / "worlds" / "hold.yaml").read_text(encoding="utf-8")
    world.write_text(text, encoding="utf-8")
    base = msgspec.structs.replace(HOP, world=str(world))
    Search(base, pretend, (NeverPaused,), tmp_path).begin()
    world.write_text(text + "# changed\n", encoding="utf-8")
    with pytest.raises(Refused, match="world, invariants or version have changed"):
        Search(base, pretend, (NeverPaused,), tmp_path).begin()


def test_a_folder_of_another_search_is_refused(first_flights: tuple[Search, Path]) -> None:
    _, out = first_flights
    other = Search(msgspec.structs.replace(HOP, seed=7), pretend, (NeverPaused,), out)
    with pytest.raises(Refused, match="belongs to another search"):
        other.begin()


def test_a_folder_whose_platform_file_has_changed_since_is_refused(tmp_path: Path) -> None:
    platform = tmp_path / "p.yaml"
    platform.write_text(whole_text("pelican_rtk"), encoding="utf-8")
    base = msgspec.structs.replace(HOP, platform=str(platform))
    Search(base, pretend, (NeverPaused,), tmp_path).begin()
    Search(base, pretend, (NeverPaused,), tmp_path).begin()
    platform.write_text(whole_text("pelican_rtk") + "# changed\n", encoding="utf-8")
    with pytest.raises(Refused, match="platform, world, invariants or version have changed"):
        Search(base, pretend, (NeverPaused,), tmp_path).begin()


@pytest.mark.parametrize(("left", "is_refused"), [("", False), ("garbage\n", True)])
def test_what_a_search_has_left_is_none_or_no_search(tmp_path: Path, left: str, is_refused: bool) -> None:
    (tmp_path / STATE).write_text(left, encoding="utf-8")
    search = Search(HOP, pretend, (NeverPaused,), tmp_path)
    if is_refused:
        with pytest.raises(Refused, match="belongs to another search"):
            search.begin()
    else:
        search.begin()
        assert (tmp_path / STATE).stat().st_size > 0


def test_at_first_every_other_flight_has_one_short_trouble_each_once(first_flights: tuple[Search, Path]) -> None:
    search, _ = first_flights
    singles = [one.case for one in search.flights[::2]]
    assert all(len(case.faults) == 1 and not case.wind_m_s for case in singles)
    drawn = {(one.possible.text, one.begin_s) for one in search._alone}
    assert len(drawn) == len(search._alone) > 3 * 40
    begins = {t_s for t_s, _ in search.course.phases}
    around = {t_s + AROUND_S[0] for t_s in search.course.changes_s if t_s >= search.course.started_s}
    assert len(around) > len(begins)
    assert {begin_s for what, begin_s in drawn if what == "crash:pose"} == begins | around
    kinds = {one.possible.text.partition(":")[0].partition("=")[0] for one in search._alone}
    assert kinds == {"crash", "hang", "link_loss", "cable_loss", "disk_full", "clock_jump", "link_twice", "cable_twice"}
    fault = parse(next(case.faults[0] for case in singles if case.faults[0].startswith("hang:")))
    assert fault.end_s is not None
    assert 0.25 < fault.end_s - fault.begin_s < 0.55


def test_more_than_a_quarter_of_the_flights_are_in_rough_weather() -> None:
    search = Search(HOP, pretend, (NeverPaused,))
    search.begin()
    for _ in range(7):
        search.round()
    assert 0.3 < sum(one.case.wind_m_s > 0.0 for one in search.flights) / len(search.flights) < 0.5


def test_what_reaches_something_new_is_varied(first_flights: tuple[Search, Path]) -> None:
    search, _ = first_flights
    faults = [set(one.case.faults) for one in search.flights]
    heirs = [at for at in range(ROUND, len(faults)) if any(faults[at] & before for before in faults[:at])]
    assert len(heirs) > ROUND // 8


def share_of_restarts(new: str) -> float:
    """The share of flights with a restart in a search where each of them reaches something new of a kind.

    All other flights reach another order of events each.
    """
    numbers = iter(range(10_000))

    def pretend_to_reach(cases: Sequence[FlightCase], kinds: Invariants) -> Iterator[TrialResult]:
        for case in cases:
            kind = new if any("restart" in fault for fault in case.faults) else "then"
            yield TrialResult(case=case, reached=(f"{kind} {next(numbers)}",), state="done", ended_s=20.0)

    search = Search(HOP, pretend_to_reach, (NeverPaused,))
    search.begin()
    search._alone.clear()  # only what is drawn
    for _ in range(20):
        search.round()
    return sum(any("restart" in fault for fault in one.case.faults) for one in search.flights) / len(search.flights)


def test_a_new_branch_of_the_executor_is_worth_more_tries_than_a_new_order_of_events() -> None:
    assert share_of_restarts("branch") > 2.0 * share_of_restarts("then")


def test_what_is_added_to_a_case_begins_where_something_changed_in_its_flight() -> None:
    """A policy's landing that begins at 40 s meets trouble of its own."""
    menu = [PossibleFault("link_loss", group="link"), PossibleFault("cable_loss", group="cable")]
    draw = Draw(HOP, menu, Course(3.0, 20.0, ()), swims=False)
    case = msgspec.structs.replace(HOP, faults=("battery=0.1@12",))

    def late(changes_s: tuple[float, ...]) -> int:
        random = Random(1)
        drawn = [draw.mutated(case, case, changes_s, random) for _ in range(400)]
        return sum(39.0 <= parse(fault).begin_s <= 45.0 for one in drawn for fault in one.faults)

    assert late((40.0,)) > 50
    assert late(()) == 0


def test_a_trouble_that_comes_alone_comes_in_each_phase_and_at_each_change() -> None:
    menu = [PossibleFault("hang:autopilot_driver", group="component"), PossibleFault("battery", group="battery")]
    course = Course(3.0, 20.0, ((3.0, "hop.up"), (12.0, "hop.down")), (1.8, 3.5, 17.7))
    draw = Draw(HOP, menu, course, swims=False)
    alone = draw.alone()
    assert {one.possible.text for one in alone} == {"hang:autopilot_driver"}
    begins = [parse(*draw.single(one, Random(1)).faults).begin_s for one in alone]
    bounds = [(3.0, 12.0), (12.0, 20.0), (3.2, 3.6), (17.4, 17.8)]
    assert len(begins) == len(bounds)
    assert all(first_s <= begin_s <= last_s for begin_s, (first_s, last_s) in zip(begins, bounds, strict=True))


@pytest.mark.flight
def test_a_flight_that_an_operator_holds_is_not_watched_until_its_time_is_up() -> None:
    held = fly_case(msgspec.structs.replace(HOP, faults=("operator:pause@9.3",)))
    assert not held.broken
    assert 9.3 + 60.0 < held.ended_s < 80.0
    assert held.changes_s[-1] < 12.0


@pytest.mark.flight
def test_a_vehicle_that_has_landed_without_its_command_server_has_ended_its_flight() -> None:
    """Its mission runs by the last that was told; so it was waited for until the time was up."""
    alone = fly_case(msgspec.structs.replace(HOP, faults=("crash:command_server@8..",)))
    assert not alone.broken
    assert alone.ended_s < 100.0


def test_a_flight_tells_which_branches_of_the_executor_it_has_taken() -> None:
    calm, paused = (
        {word for word in fly_case(case, kinds=()).reached if word.startswith("branch ")}
        for case in (HOP, msgspec.structs.replace(HOP, faults=("operator:pause@9.3", "operator:resume@9.8")))
    )
    assert len(calm) > 100
    assert len(paused - calm) > 5
    assert calm <= {word for word in fly_case(HOP, kinds=()).reached if word.startswith("branch ")}


def test_everything_that_is_drawn_fits_the_flight(first_flights: tuple[Search, Path]) -> None:
    search, _ = first_flights
    kinds = {one.text.partition(":")[0].partition("=")[0] for one in search._menu}
    assert {
        "link_loss",
        "cable_slow",
        "crash",
        "leak",
        "sensor",
        "pilot",
        "operator",
        "restart",
        "topic",
        "motor",
    } <= kinds
    assert "current" not in kinds, "it is not in the water"
    menu = []
    fly_case(HOP, kinds=(NeverPaused,), prepare=lambda flight: menu.extend(possible_faults(flight)))
    assert menu == search._menu
    random = Random(1)
    for _ in range(200):
        case = search._draw.fresh(random)
        assert 1 <= len(case.faults) <= 9


SOUGHT = ("link_twice=0.5@4..9", "operator:pause@9.3")


@pytest.mark.flight
@pytest.mark.thorough
def test_a_finding_is_shrunk_written_and_replayed(tmp_path: Path) -> None:
    case = msgspec.structs.replace(HOP, seed=3, faults=SOUGHT)
    with flying(1) as fly:
        shrunk = Shrinker(NeverPaused, fly, most=8).shrink(case)
    assert len(shrunk.case.faults) == 1
    assert shrunk.case.faults[0].startswith("operator:pause@")
    assert shrunk.case.seed == 0
    found = write_found(shrunk.case, NeverPaused, tmp_path / "found")
    assert found is not None
    assert found.broken.text == "paused: by an operator"
    assert 3 <= len(found.cause) <= 5
    assert found.cause[0] == "must hold: The mission is never paused."
    assert {"replay.json", "log.mcap", "path.svg", "cause.txt"} <= {
        path.name for path in (tmp_path / "found").iterdir()
    }
    assert read_case(tmp_path / "found" / "replay.json") == shrunk.case
    assert replay(tmp_path / "found" / "replay.json", None).case == shrunk.case


@pytest.mark.flight
@pytest.mark.thorough
def test_a_search_that_flies_finds_and_shrinks(tmp_path: Path) -> None:
    seen = []
    limits = SearchLimits(flights=1, most_found=1, shrink_flights=4)
    progress = run_search(HOP, limits, 1, tmp_path, lambda one: seen.append(one.flights), (NeverHindered,))
    assert [one.broken.invariant for one in progress.found] == ["never_hindered"]
    assert (tmp_path / "found" / "01-never_hindered" / "log.mcap").is_file()
    assert progress.reached["event"] > 20
    assert progress.processor_s > 0.1
    assert seen[-1] == progress.flights


def test_a_mission_that_is_cut_so_that_it_breaks_it_by_itself_is_no_finding() -> None:
    """A mission without its landing ends in the air: that is not what the fault has done."""

    def pretend_to_end(cases: Sequence[FlightCase], kinds: Invariants) -> Iterator[TrialResult]:
        for case in cases:
            lands = not case.text or "land" in case.text.partition("tasks")[2]
            broken = BrokenInvariant(invariant=NeverPaused.name, t_s=1.0, text="x")
            is_broken = not lands or any("pause" in fault for fault in case.faults)
            yield TrialResult(case=case, broken=(broken,) if is_broken else (), state="done")

    case = msgspec.structs.replace(HOP, faults=SOUGHT)
    shrunk = Shrinker(NeverPaused, pretend_to_end).shrink(case).case
    assert "land" in shrunk.text.partition("tasks")[2]
    assert len(shrunk.faults) == 1


@pytest.mark.flight
def test_an_error_of_a_component_is_found_in_flight(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: Any) -> None:
        raise ZeroDivisionError("float division by zero")

    monkeypatch.setattr(HoldController, "_brake", fail)
    broken = fly_case(HOP, kinds=(NoTraceback,)).broken
    assert [one.text for one in broken] == ["hold: working -> faulty: ZeroDivisionError: float division by zero"]


def test_a_flight_that_ends_with_an_error_is_a_finding_where_errors_are_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: Any, **__: Any) -> TrialResult:
        raise ZeroDivisionError("by nothing")

    monkeypatch.setattr("gloc3_sitl.proof.trial.fly_case", fail)
    found = write_found(HOP, NoTraceback, None)
    assert found is not None
    assert found.broken.text == "the flight ended with ZeroDivisionError: by nothing"
    assert write_found(HOP, NeverPaused, None) is None
    result = fly_to_judge(HOP, (NeverPaused,))
    assert (result.broken, result.reason) == ((), found.broken.text)


def test_a_mission_that_does_not_pass_its_check_breaks_nothing() -> None:
    result = fly_to_judge(msgspec.structs.replace(HOP, text="mission: hop\ntasks: {}\n"), (NoTraceback,))
    assert result.refused
    assert not result.broken


def test_faults_that_would_have_begun_after_the_end_are_not_counted_as_flown() -> None:
    def early(cases: Sequence[FlightCase], kinds: Invariants) -> Iterator[TrialResult]:
        for number, result in enumerate(pretend(cases, ())):
            yield msgspec.structs.replace(result, broken=(), ended_s=5.0, refused="no" if number == 0 else "")

    search = Search(HOP, early, (NeverPaused,))
    search.begin()
    flights = search.round()
    progress = SearchProgress(mission="hop", platform="pelican_rtk", seed=0)
    _count(progress, search, frozenset())
    begun = [
        fault for one in flights[1:] for fault in map(parse, one.case.faults) if fault.begin_s < 5.0
    ]  # the first is refused
    assert sum(sum(row.values()) for row in progress.covered.values()) == len(begun)
    assert 0 < len(begun) < sum(len(one.case.faults) for one in flights)


def test_no_more_flights_are_flown_to_shrink_a_finding_than_it_is_given() -> None:
    flown: list[FlightCase] = []

    def count(cases: Sequence[FlightCase], kinds: Invariants) -> Iterator[TrialResult]:
        flown.extend(cases)
        return pretend(cases, kinds)

    case = msgspec.structs.replace(HOP, faults=("restart@3..6", "crash:pose@5", "cable_loss=1@9..12"))
    assert Shrinker(ItEnds, count, 3).shrink(case).flights == len(flown) == 3


def test_one_of_each_kind_is_shrunk_the_simplest_first() -> None:
    def case(*faults: str) -> FlightCase:
        return msgspec.structs.replace(HOP, faults=faults)

    pairs = [
        ("it_ends", case("crash:pose@3", "wind=3@1")),
        ("it_ends", case("crash:pose@8")),
        ("it_ends", case("crash:pose@9..12")),
        ("pose_honest", case("crash:pose@3")),
    ]
    assert distinct(pairs, 10) == [pairs[1], pairs[3], pairs[0]]


def test_the_fault_is_among_the_five_lines_of_cause_however_much_happened_after_it() -> None:
    story = [
        "    3.00 s  fault link_twice@3..4 begins",
        "    4.00 s  fault link_twice@3..4 is over",
        *(f"   {t_s:2d}.00 s  autopilot: mode {t_s}" for t_s in range(5, 20)),
        "   30.00 s  fault battery=0.1@30 begins",
    ]
    broken = BrokenInvariant(invariant="never_paused", t_s=20.0, text="paused")
    lines = five_lines(TrialResult(case=HOP, broken=(broken,), story=tuple(story)), NeverPaused)
    assert lines == [
        "must hold: The mission is never paused.",
        "was so:    20.00 s  paused",
        "before:    3.00 s  fault link_twice@3..4 begins",
        "before:    18.00 s  autopilot: mode 18",
        "before:    19.00 s  autopilot: mode 19",
    ]


def test_a_case_is_one_line_and_one_command() -> None:
    case = msgspec.structs.replace(HOP, seed=3, wind_m_s=2.5, faults=("crash:pose@3",))
    assert msgspec.json.decode(case.line(), type=FlightCase) == case
    assert case.command() == "gloc3 fly hop --platform pelican_rtk --seed 3 --wind 2.5 --fault crash:pose@3"


def test_a_replay_file_holds_the_mission_the_platform_and_the_world_that_it_was_found_with(tmp_path: Path) -> None:
    mission, platform, world = (tmp_path / name for name in ("m.yaml", "p.yaml", "w.yaml"))
    mission.write_text(find_mission("hop").read_text(encoding="utf-8"), encoding="utf-8")
    platform.write_text(whole_text("pelican_rtk"), encoding="utf-8")
    world.write_bytes((files("gloc3_sitl.world") / "worlds" / "hold.yaml").read_bytes())
    case = FlightCase(mission=str(mission), platform=str(platform), world=str(world)).contained()
    for file in (mission, platform, world):
        file.unlink()
    (tmp_path / "replay.json").write_text(case.line(), encoding="utf-8")
    again = read_case(tmp_path / "replay.json")
    assert again == case
    result = fly_case(again)
    assert (result.state, result.broken, result.refused) == ("done", (), "")
    assert FlightCase(mission="hop", platform="pelican_rtk").contained().text == ""


LIBRARY = """\
define:
  hopping:
    parameters: {t: {kind: number}}
    actions:
      up: {take_off: {height_m: 1.5}}
      stay: {hold: {duration_s: $t}, after: [up]}
      down: {land: {}, after: [stay]}
"""
INCLUDING = """\
mission: inc
frame: hold
platform: pelican_rtk
geofence: {polygon_m: [[-2, -2], [20, -2], [20, 12], [-2, 12]], ceiling_m: 8}
include: [lib.yaml]
tasks:
  hop: {use: hopping, with: {t: 4}}
"""


@pytest.mark.parametrize("name", ["m.yaml", "m.plan"])
def test_a_replay_file_holds_the_libraries_of_a_mission_and_the_home_of_a_plan(tmp_path: Path, name: str) -> None:
    (tmp_path / "lib.yaml").write_text(LIBRARY, encoding="utf-8")
    plan = Path("tests/data/missions/box.plan").read_text(encoding="utf-8")
    (tmp_path / name).write_text(INCLUDING if name == "m.yaml" else plan, encoding="utf-8")
    case = FlightCase(mission=str(tmp_path / name), platform="pelican_rtk")
    flown = fly_case(case)
    assert flown.state == "done"
    prove_case(case)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["lib.yaml", name], "nothing is written beside it"
    replay_file = tmp_path / "replay.json"
    replay_file.write_text(case.contained().line(), encoding="utf-8")
    (tmp_path / "lib.yaml").unlink()
    (tmp_path / name).unlink()
    again = fly_case(read_case(replay_file))
    assert (again.state, again.ended_s, again.story) == (flown.state, flown.ended_s, flown.story)


def test_a_replay_file_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(Refused, match="cannot be read"):
        read_case(tmp_path / "none.json")
    (tmp_path / "wrong.json").write_text("{}")
    with pytest.raises(Refused, match="is no replay file"):
        read_case(tmp_path / "wrong.json")
    for changed, says in (
        ({"faults": ("crash:pose@x",)}, "times of the fault 'crash:pose@x'"),
        ({"faults": ("crash:pose@1..2..3",)}, "cannot be read"),
        ({"seed": -1}, "seed must be 0 or more"),
    ):
        (tmp_path / "wrong.json").write_text(msgspec.structs.replace(HOP, **changed).line())
        with pytest.raises(Refused, match=says):
            read_case(tmp_path / "wrong.json")
