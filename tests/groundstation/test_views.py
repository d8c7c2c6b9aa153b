"""What the panels show, read as text: nothing here needs a terminal."""

from msgspec.structs import replace

from gloc3.ci import ComponentLine, ComponentTable, ComponentTrouble, ControlState, Health, MissionSummary, Summary
from gloc3.messages import Severity
from gloc3_groundstation import fleet as reducers
from gloc3_groundstation.plans import Plan
from gloc3_groundstation.snapshots import Fleet, LinkStatistics, PlatformSnapshot, Timed
from gloc3_groundstation.tui.components_view import component_lines, components_title
from gloc3_groundstation.tui.events_view import event_lines
from gloc3_groundstation.tui.lines import Line, Tone, bar, text_of, wrapped
from gloc3_groundstation.tui.mission_view import mission_lines, mission_title
from gloc3_groundstation.tui.vehicle_view import title_line, vehicle_lines
from gloc3_groundstation.wording import farewell, tenths

from .scripted_platform import ROWS, TASKS, VEHICLE

STATES = {"sweep": "running", "sweep.wall": "running", "depart": "done", "depart.climb": "done"}
PLATFORM = PlatformSnapshot(
    name="heron",
    boot=1,
    first_heard_s=100.0,
    heard_s=100.0,
    vehicle=Timed(VEHICLE, 100.0),
    control=Timed(ControlState(holder="255"), 100.0),
    mission=Timed(
        MissionSummary(
            name="hold", digest="d", state="running", tasks={**TASKS, **STATES}, progress={"sweep.wall": 0.42}
        ),
        100.0,
    ),
    summary=Timed(Summary(table=1, health=Health.WORKING, lines=[]), 100.0),
    table=ComponentTable(table=1, rows=ROWS),
    lines={i: (ComponentLine(i, 1 if row.standby_for else 0, 100, 12, 0, 0), 100.0) for i, row in enumerate(ROWS)},
)


def texts(lines: list[Line]) -> list[str]:
    return [text_of(line).rstrip() for line in lines]


def tones(line: Line) -> set[Tone]:
    return {span.tone for span in line if span.text.strip()}


def test_the_title_tells_health_link_and_control() -> None:
    fleet = Fleet(platforms={"heron": PLATFORM})
    line = text_of(title_line(fleet, PLATFORM, "255", 90.0, 100.0, 80))
    assert line == " heron   working   link ok   this station in control         station 255  00:10 "
    other = text_of(title_line(fleet, PLATFORM, "254", 90.0, 100.0, 80))
    assert "station 255 in control" in other


def test_a_silent_link_is_the_loudest_thing_in_the_title() -> None:
    line = title_line(Fleet(platforms={"heron": PLATFORM}), PLATFORM, "255", 90.0, 107.0, 80)
    assert "nothing heard for 7 s" in text_of(line)
    assert "was working" in text_of(line)
    assert Tone.ALARM in tones(line)


def test_a_lossy_link_tells_how_much_arrives() -> None:
    lossy = replace(PLATFORM, link=LinkStatistics(loss=0.2))
    line = text_of(title_line(Fleet(platforms={"heron": lossy}), lossy, "255", 90.0, 100.0, 120))
    assert "status 80 %" in line


def test_an_old_vehicle_state_is_shown_as_old() -> None:
    assert texts(vehicle_lines(PLATFORM, 100.0, "")) == [
        " HOLD   disarmed, on ground   battery ━━━━━━━━ 97 %",
        " x 0.0  y 0.0  h 0.0 m   0.0 m/s   heading 090°   frame hold",
    ]
    old = vehicle_lines(PLATFORM, 108.0, "")
    assert text_of(old[1]).endswith("8 s ago")
    assert [tones(line) for line in old] == [{Tone.STALE}, {Tone.STALE}]


def test_what_endangers_the_vehicle_is_an_alarm() -> None:
    vehicle = replace(VEHICLE, battery_percent=9, has_pilot_control=True, is_autopilot_connected=False)
    (first, _) = vehicle_lines(replace(PLATFORM, vehicle=Timed(vehicle, 100.0)), 100.0, "")
    assert [span.text for span in first if span.tone is Tone.ALARM] == [
        "battery ━╌╌╌╌╌╌╌ 9 %",
        "NO AUTOPILOT",
        "PILOT HAS CONTROL",
    ]


def test_an_unknown_position_and_battery_are_said_to_be_unknown() -> None:
    vehicle = replace(VEHICLE, battery_percent=-1, is_pose_valid=False)
    lines = texts(vehicle_lines(replace(PLATFORM, vehicle=Timed(vehicle, 100.0)), 100.0, ""))
    assert "battery unknown" in lines[0]
    assert "position unknown" in lines[1]


def test_components_stand_in_the_order_of_the_data_one_a_line() -> None:
    lines = texts(component_lines(PLATFORM, 100.0, 39))
    assert lines[0] == " SS autopilot         working   100 %"
    assert lines[4] == "    pose_backup       quiet     100 %"
    assert [line[1:3] for line in lines if line[1:3].strip()] == ["SS", "DP", "CC", "AD", "CI"]
    assert components_title(PLATFORM, 100.0) == "components: all 13 well"
    assert max(len(line) for line in lines) <= 39


def test_an_unwell_component_says_why() -> None:
    lines_of = {**PLATFORM.lines, 3: (ComponentLine(3, 5, 0, 0, 0, 2), 100.0)}
    trouble = ComponentTrouble(name="pose", cause="no pose for 0.5 s", errors=2)
    ill = replace(PLATFORM, lines=lines_of, troubles={"pose": trouble})
    lines = texts(component_lines(ill, 100.0, 60))
    assert lines[3:5] == [" DP pose              faulty      0 %  load   0 %  2 err", "      no pose for 0.5 s"]
    assert components_title(ill, 100.0) == "components: pose not well"


def test_components_that_were_not_heard_of_lately_are_shown_as_what_they_were() -> None:
    lines = component_lines(PLATFORM, 110.0, 60)
    assert text_of(lines[0]).rstrip() == " SS autopilot         was working"
    assert {tone for line in lines for tone in tones(line)} == {Tone.STALE}
    assert components_title(PLATFORM, 110.0) == "components, as last heard"


def test_the_mission_shows_each_task_with_its_actions() -> None:
    assert [mission_title(PLATFORM, now_s) for now_s in (100.0, 110.0)] == ["hold: running", "hold: was running"]
    lines = texts(mission_lines(PLATFORM, None, 100.0, 39))
    assert lines[2:5] == [
        " ► sweep                        running",
        "   ► wall              ━━━━╌╌╌╌╌╌  42 %",
        "   · photos                     waiting",
    ]
    assert {len(line) for line in lines} == {39}


def test_without_a_mission_it_says_what_can_be_done() -> None:
    bare = replace(PLATFORM, mission=None)
    assert texts(mission_lines(bare, None, 100.0, 60))[1] == " Open the station with --mission FILE."
    plan = Plan(name="hold.yaml", title="cargo hold", text="")
    assert texts(mission_lines(bare, plan, 100.0, 60))[0] == " 'cargo hold' is at hand."


def test_a_failed_mission_gives_its_reason_and_policy() -> None:
    assert PLATFORM.mission is not None
    mission = replace(PLATFORM.mission.value, state="failed", reason="pose lost", policy="land")
    failed = replace(PLATFORM, mission=Timed(mission, 100.0))
    assert mission_title(failed, 100.0) == "hold: failed, policy land"
    assert texts(mission_lines(failed, None, 100.0, 60))[-1] == " pose lost"


def test_long_events_are_wrapped_never_cut() -> None:
    fleet = reducers.note(Fleet(), "heron", Severity.WARNING, "start: " + "word " * 20, 65.0)
    lines = texts(event_lines(fleet, 0.0, 40))
    assert lines[0] == " 01:05  warning: heron: start: word word"
    assert all(len(line) <= 40 for line in lines)
    assert sum(line.count("word") for line in lines) == 20


def test_text_is_wrapped_also_where_it_has_no_spaces() -> None:
    assert wrapped("abcdefgh ij", 4) == ["abcd", "efgh", "ij"]
    assert wrapped("", 10) == [""]


def test_a_bar_never_overflows() -> None:
    assert [bar(share, 4) for share in (-1.0, 0.0, 0.5, 1.0, 7.0)] == ["╌╌╌╌", "╌╌╌╌", "━━╌╌", "━━━━", "━━━━"]


def test_a_vehicle_in_flight_is_left_to_its_policies() -> None:
    flying = replace(PLATFORM, vehicle=Timed(replace(VEHICLE, is_armed=True), 100.0))
    assert farewell(Fleet(platforms={"heron": PLATFORM})) == "stopped"
    said = farewell(Fleet(platforms={"heron": flying, "egret": PLATFORM}))
    assert said == "stopped; heron flies on by the mission's policies (on_link_loss)"


def test_a_position_next_to_zero_has_no_sign() -> None:
    assert [tenths(value) for value in (-0.04, 0.04, -0.06, 12.34)] == ["0.0", "0.0", "-0.1", "12.3"]
