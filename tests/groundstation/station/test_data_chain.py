"""Where the data stops, from the states of the components and who hands what to whom."""

import pytest
from msgspec.structs import replace
from tests.groundstation.scripted_platform import ROWS
from tests.groundstation.tui.views.test_views import PLATFORM

from gloc3.messages.summaries import ComponentLine, Health
from gloc3.platform.reader import load_platform
from gloc3_groundstation.station.data_chain import Wiring, stages
from gloc3_groundstation.station.snapshots import ComponentSnapshot, PlatformSnapshot
from gloc3_groundstation.tui.views.chain import chain_lines, wiring_lines
from gloc3_groundstation.tui.widgets.lines import text_of

WIRING = Wiring.of(load_platform("pelican_rtk"))


def with_states(**states: Health) -> PlatformSnapshot:
    lines = dict(PLATFORM.lines)
    for index, row in enumerate(ROWS):
        if row.name in states:
            lines[index] = (ComponentLine(index, list(Health).index(states[row.name]), 100, 12, 0, 0), 100.0)
    return replace(PLATFORM, lines=lines)


def drawn(platform: PlatformSnapshot, now_s: float = 100.0, width: int = 80) -> list[str]:
    return [text_of(line) for line in chain_lines(platform, None, now_s, width)]


def test_a_chain_that_is_whole_is_drawn_from_end_to_end() -> None:
    assert drawn(PLATFORM) == [
        " SS ●●● ───▶ DP ●◐ ───▶ CC ●●●●● ───▶ AD ●● ───▶ CI ●",
        " the data flows from end to end",
    ]
    assert len(drawn(PLATFORM, width=60)[0]) <= 60


def test_the_letters_and_signs_are_explained_where_there_is_room() -> None:
    assert "SS sampler  DP processor  CC controller  AD driver  CI command interface" in drawn(PLATFORM, width=120)[1]
    assert drawn(PLATFORM, width=200)[1].endswith("✕ faulty  · absent")
    assert [len(drawn(PLATFORM, width=width)[1]) < width for width in (60, 80, 120, 200)] == [True] * 4


def test_it_breaks_behind_a_required_component_that_hands_nothing_on() -> None:
    picture, text = drawn(with_states(pose=Health.FAULTY))
    assert picture == " SS ●●● ───▶ DP ✕◐ ─✕╌▷ CC ●●●●● ╌╌╌▷ AD ●● ╌╌╌▷ CI ●"
    assert text == " the data stops at DP: pose is faulty"
    assert drawn(with_states(pose=Health.FAULTY), 130.0)[1].startswith(" as last heard, the data stops")


def test_a_standby_that_has_taken_over_keeps_it_whole() -> None:
    (_, processors, *_) = stages(with_states(pose=Health.FAULTY, pose_backup=Health.WORKING).components(100.0))
    assert processors.stops == ()
    assert [each.name for each in processors.components] == ["pose", "pose_backup"]


def test_what_is_not_required_does_not_break_it_but_is_told() -> None:
    assert drawn(with_states(ground_camera=Health.ABSENT))[1].endswith("optional, not well: ground_camera")


def test_the_wiring_tells_who_takes_what_from_whom_and_who_gets_nothing() -> None:
    assert "pose" in WIRING.gives("pose")
    assert "waypoints" in WIRING.gives("pose")["pose"]
    assert "pose" in WIRING.inputs("waypoints")
    lines = [text_of(line) for line in wiring_lines(WIRING, "pose", 100)]
    assert lines[0].startswith(" takes ")
    assert lines[1].startswith(" gives pose to ")
    rows = load_platform("pelican_rtk").components
    components = [
        ComponentSnapshot(
            name=row.name,
            kind=row.load_class().kind.value,
            nominal_rate_hz=row.rate_hz or 0.0,
            is_required=row.required,
            standby_for=row.standby_for or "",
            health=Health.STANDBY if row.name == "pose" else Health.WORKING,
        )
        for row in rows
    ]
    starved = WIRING.starved(components)
    assert starved["waypoints"] == "pose"
    assert "pose" not in starved


@pytest.mark.parametrize("width", [76, 100])
def test_no_line_is_wider_than_its_panel(width: int) -> None:
    for platform in (PLATFORM, with_states(pose=Health.FAULTY, driver=Health.FAULTY, autopilot=Health.IDLE)):
        assert all(len(text_of(line)) <= width for line in chain_lines(platform, WIRING, 100.0, width))
