"""What the panels show, read as text: nothing here needs a terminal."""

from msgspec.structs import replace
from tests.groundstation.scripted_platform import ROWS, TASKS, VEHICLE

from gloc3.messages.envelope import Severity
from gloc3.messages.motion import MotionSummary
from gloc3.messages.summaries import (
    ComponentLine,
    ComponentTable,
    ComponentTrouble,
    ControlState,
    Health,
    MissionSummary,
    Summary,
    TableRow,
)
from gloc3.network.rights import HeldRole, MemberRights
from gloc3.network.rights_file import Role
from gloc3_groundstation.desk.teleoperation import FullSpeed
from gloc3_groundstation.joysticks.device import StickDemand
from gloc3_groundstation.missions.plans import CheckedPlan
from gloc3_groundstation.station import alerts
from gloc3_groundstation.station import fleet as reducers
from gloc3_groundstation.station.snapshots import Fleet, LinkStatistics, PlatformSnapshot, Timed
from gloc3_groundstation.station.wording import bearing, farewell, tenths
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.views.chrome import Key, Tab, alert_line, keys_line, tabs_line, title_line
from gloc3_groundstation.tui.views.components import component_lines, component_rows, components_title
from gloc3_groundstation.tui.views.events import event_lines
from gloc3_groundstation.tui.views.fleet import control_lines
from gloc3_groundstation.tui.views.mission.lines import mission_lines, mission_title
from gloc3_groundstation.tui.views.overview import alert_lines, detail_lines, detail_title, vehicle_header, vehicle_line
from gloc3_groundstation.tui.views.teleoperation import TeleoperationView, helm_lines
from gloc3_groundstation.tui.widgets.lines import Line, Tone, bar, text_of, wrapped

STATES = {"sweep": "running", "sweep.wall": "running", "depart": "done", "depart.climb": "done"}
PLATFORM = PlatformSnapshot(
    name="heron",
    boot=1,
    first_received_s=100.0,
    received_s=100.0,
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


def view(*platforms: PlatformSnapshot, now_s: float = 100.0, station: str = "255") -> StationView:
    fleet = Fleet(platforms={platform.name: platform for platform in platforms})
    known = alerts.update(alerts.Alerts(), fleet, now_s)
    return StationView(fleet, platforms[0], now_s, 90.0, station, alerts=known)


def flying(**changes: object) -> PlatformSnapshot:
    return replace(PLATFORM, vehicle=Timed(replace(VEHICLE, is_armed=True, **changes), 100.0))


def test_the_title_tells_mode_armed_battery_link_and_control() -> None:
    line = text_of(title_line(view(PLATFORM), 80))
    assert line.split("   ")[:6] == [" heron", "HOLD", "disarmed", "bat 97 %", "link ok", "in control"]
    assert len(line) == 80
    assert line.endswith(" 00:10 ")
    unheard = replace(VEHICLE, is_armed=False, is_autopilot_connected=False, landed="unknown")
    began = text_of(title_line(view(replace(PLATFORM, vehicle=Timed(unheard, 100.0))), 80))
    assert "armed?" in began, "a companion that began anew in the air does not know yet"
    other = text_of(title_line(view(PLATFORM, station="254"), 80))
    assert "255 controls" in other


def test_a_title_without_room_leaves_the_least_important_out() -> None:
    shown = [text_of(title_line(view(flying()), width)).split() for width in (60, 36)]
    assert shown == [
        ["heron", "HOLD", "ARMED", "bat", "97", "%", "link", "ok", "00:10"],
        ["heron", "ARMED", "link", "ok", "00:10"],
    ]
    assert text_of(title_line(view(flying()), 46)).split() == ["heron", "HOLD", "ARMED", "bat", "97", "%", "link", "ok"]


def test_a_silent_link_is_the_loudest_thing_in_the_title() -> None:
    line = title_line(view(PLATFORM, now_s=107.0), 80)
    assert "SILENT 7 s" in text_of(line)
    assert "was HOLD" in text_of(line)
    assert Tone.ALARM in tones(line)


def test_a_lossy_link_tells_how_much_is_lost() -> None:
    lossy = replace(PLATFORM, link=LinkStatistics(loss=0.2))
    assert "link 20 % lost" in text_of(title_line(view(lossy), 80))
    assert " link      80 % arrives" in texts(detail_lines(view(lossy)))
    far = texts(detail_lines(view(lossy)._replace(round_trip_s=0.62)))
    assert " link      80 % arrives, 620 ms round" in far


def test_ten_screens_stand_in_one_line_of_80() -> None:
    titles = ("Overview", "Health", "Mission", "Map", "Data", "Services", "Sensors", "Checks", "Events", "Fleet")
    tabs = [Tab(str((n + 1) % 10), title, n == 1) for n, title in enumerate(titles)]
    assert len(text_of(tabs_line(tabs, 80)).rstrip()) <= 80
    assert [span.text for span in tabs_line(tabs, 80) if span.tone is Tone.CHOSEN] == ["2Health"]


def test_the_keys_that_matter_most_are_shown_where_there_is_room_for_few() -> None:
    keys = [Key("s", "Start", False), Key("p", "Pause"), Key("?", "Help", is_always_shown=True)]
    assert text_of(keys_line(keys, 80)) == " s Start  p Pause  ? Help  "
    assert text_of(keys_line(keys, 20)) == " p Pause  ? Help  "


def test_the_worst_alert_stands_above_every_screen() -> None:
    line = alert_line(view(flying(battery_percent=9, is_pose_valid=False, has_pilot_control=True)), 80)
    assert text_of(line).startswith(" critical: heron: ")
    assert text_of(line).endswith("+2 more   x acknowledges ")
    assert len(text_of(line)) == 80
    assert alert_line(view(PLATFORM), 80) == ()


def test_the_worst_component_stands_in_its_vehicles_line() -> None:
    ill = dict(PLATFORM.lines)
    for index, health in ((2, Health.STANDBY), (3, Health.FAULTY)):
        ill[index] = (ComponentLine(index, list(Health).index(health), 0, 0, 0, 1), 100.0)
    platform = replace(PLATFORM, lines=ill)
    assert PLATFORM.table is not None
    assert f"{PLATFORM.table.rows[3].name} faulty" in text_of(vehicle_line(view(platform), platform, 200))


def test_a_refusal_stands_above_every_screen_for_a_while() -> None:
    now = view(flying(battery_percent=9))
    fleet = reducers.note(now.fleet, "heron", Severity.ERROR, "start: the autopilot does not answer", now.now_s)
    refused = now._replace(fleet=fleet)
    assert text_of(alert_line(refused, 80)) == " ✗ heron: start: the autopilot does not answer"
    later = refused._replace(now_s=now.now_s + alerts.ANSWERED_S)
    assert text_of(alert_line(later, 80)).startswith(" critical: heron: battery")


def test_each_vehicle_has_a_line_in_columns() -> None:
    egret = replace(PLATFORM, name="egret", mission=None)
    both = view(PLATFORM, egret)
    rows = [
        text_of(vehicle_header(both, 120)),
        *(text_of(vehicle_line(both, platform, 120)) for platform in both.fleet),
    ]
    assert rows[1].split() == [
        *("►", "heron", "HOLD", "disarmed", "97", "%", "ok", "running", "all", "13", "well", "none"),
    ]
    assert rows[2].split()[0] == "egret"
    for title, word in (("mode", "HOLD"), ("link", "ok"), ("components", "all")):
        assert {row.index(word) for row in rows[1:]} == {rows[0].index(title)}


def test_names_have_the_room_that_there_is_and_the_columns_that_are_always_there_stay() -> None:
    long = replace(PLATFORM, name="survey_vehicle_012")
    for width in (80, 120, 200):
        line = text_of(vehicle_line(view(long), long, width))
        assert len(line) <= width
        assert "97 %" in line
        assert (long.name in line) == (width > 80), width
        assert len(text_of(vehicle_header(view(long), width))) <= width


def test_an_old_vehicle_state_is_shown_as_old() -> None:
    assert " position  x 0.0  y 0.0  h 0.0 m" in texts(detail_lines(view(PLATFORM)))
    previous = [line for line in detail_lines(view(PLATFORM, now_s=108.0)) if "position" in text_of(line)]
    assert detail_title(view(PLATFORM, now_s=108.0)) == "heron, 8 s ago"
    assert Tone.STALE in tones(previous[0])
    states = [span for span in vehicle_line(view(PLATFORM, now_s=108.0), PLATFORM, 120) if "disarmed" in span.text]
    assert [span.tone for span in states] == [Tone.STALE]


def test_what_endangers_the_vehicle_stands_out() -> None:
    ill = flying(battery_percent=9, has_pilot_control=True, is_autopilot_connected=False)
    assert [span.text for line in detail_lines(view(ill)) for span in line if span.tone is Tone.BAD] == [
        "HAS CONTROL",
        "NOT CONNECTED",
        "━╌╌╌╌╌╌╌╌╌╌╌ 9 %",
    ]


def test_a_detail_that_is_too_long_goes_on_in_the_next_line_and_loses_nothing() -> None:
    ill = flying(pose_sources=["stereo", "laser"], pose_quality_percent=40)
    for width in (38, 100):
        lines = texts(detail_lines(view(ill), width))
        assert all(len(line) <= width for line in lines)
        assert "stereo + laser, quality 40 %" in " ".join(" ".join(lines).split())


def test_an_unknown_position_and_battery_are_said_to_be_unknown() -> None:
    lines = "\n".join(texts(detail_lines(view(flying(battery_percent=-1, is_pose_valid=False)))))
    assert "battery   not known" in lines
    assert "position unknown" in lines


def test_a_heading_is_below_360_degrees_and_one_that_is_not_known_is_no_number() -> None:
    assert [bearing(degrees) for degrees in (0.0, 6.6, 359.4, 359.7, -1)] == ["000°", "007°", "359°", "000°", "–"]
    assert "heading 007°" in "\n".join(texts(detail_lines(view(flying(heading_deg=7)))))
    assert "heading –" in "\n".join(texts(detail_lines(view(flying(heading_deg=-1)))))


def test_a_heading_by_hand_is_below_360_degrees() -> None:
    motion = MotionSummary(
        t_s=0.0, attitude_cdeg=(0, 0, 35970), position_cm=(0, 0, 0), velocity_cm_s=(0, 0, 0), is_pose_valid=True
    )
    helm = TeleoperationView(is_begun=False, is_kept=False, sticks=StickDemand(), full=FullSpeed(), session=0)
    lines = helm_lines(replace(PLATFORM, motion=Timed(motion, 100.0)), helm, None, 100.0)
    assert "heading 000°" in text_of(lines[-1])


def test_what_the_position_rests_on_is_told_with_its_quality() -> None:
    text = []
    for changes in (
        {},
        {"pose_sources": ["stereo", "laser"], "pose_quality_percent": 40},
        {"pose_quality_percent": -1},
    ):
        lines = detail_lines(view(flying(**changes)), 60)
        (line,) = [line for line in lines if text_of(line).startswith(" from")]
        text.append((text_of(line)[11:], line[-1].tone))
    assert text == [
        ("autopilot, quality 100 %", Tone.TEXT),
        ("stereo + laser, quality 40 %", Tone.WARN),
        ("not reported", Tone.DIM),
    ]


def test_alerts_are_listed_until_nothing_is_wrong() -> None:
    lines = texts(alert_lines(view(flying(battery_percent=9)), 60))
    assert lines == [" ▲ 00:10  critical   battery at or below 15 %"]
    assert texts(alert_lines(view(PLATFORM), 60)) == [" Nothing is wrong."]


def test_in_a_narrow_column_an_alert_goes_on_below_its_severity() -> None:
    lines = texts(alert_lines(view(flying(battery_percent=9)), 30))
    assert lines == [" ▲ 00:10  critical: battery at", "          or below 15 %"]


def test_a_vehicle_that_is_silent_and_asked_for_is_told_without_cutting_anything() -> None:
    requested = replace(PLATFORM, control=Timed(ControlState(holder="255", requested_by="254"), 100.0))
    lines = {line.split()[0]: line for line in texts(detail_lines(view(requested, now_s=100.0 + 312.0)))}
    assert lines["link"] == " link      silent for 5 min 12 s"
    assert lines["control"] == " control   here; station 254 asks"
    assert "silent 5 min" in text_of(vehicle_line(view(requested, now_s=412.0), requested, 80))


def test_components_stand_in_the_order_of_the_data_one_a_line() -> None:
    rows = component_rows(PLATFORM, 100.0, 80)
    lines = texts([line for _, line in rows])
    assert [name for name, _ in rows] == [row.name for row in ROWS]
    assert lines[0].split() == ["SS", "autopilot", "working", "20.0/20", "Hz", "12", "%", "·", "·"]
    assert "quiet" in lines[4]
    assert [line[1:3] for line in lines if line[1:3].strip()] == ["SS", "DP", "CC", "AD", "CI"]
    assert components_title(PLATFORM, 100.0) == "components: all 13 well"
    assert max(len(line) for line in lines) <= 80


def test_an_unwell_component_says_why() -> None:
    lines_of = {**PLATFORM.lines, 3: (ComponentLine(3, 5, 0, 0, 0, 2), 100.0)}
    problem = ComponentTrouble(name="pose", cause="Traceback: ...\nLost: no pose for 0.5 s", errors=2)
    ill = replace(PLATFORM, lines=lines_of, troubles={"pose": problem})
    (_, line) = component_rows(ill, 100.0, 120)[3]
    assert text_of(line).split()[:3] == ["DP", "pose", "faulty"]
    assert text_of(line).rstrip().endswith("Lost: no pose for 0.5 s")
    assert texts(component_lines(ill, "pose", 100.0, 60)) == [
        " data processor, required, 20 Hz",
        " last error (2 so far):",
        "   Traceback: ...",
        "   Lost: no pose for 0.5 s",
    ]
    assert components_title(ill, 100.0) == "components: pose not well"


def test_components_that_were_not_heard_of_lately_are_shown_as_what_they_were() -> None:
    lines = [line for _, line in component_rows(PLATFORM, 110.0, 90)]
    assert "was working" in text_of(lines[0])
    assert {tone for line in lines for tone in tones(line)} <= {Tone.STALE, Tone.DIM}
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
    assert texts(mission_lines(bare, None, 100.0, 60))[1] == " 3, then o opens one."
    plan = CheckedPlan(name="hold.yaml", title="cargo hold", text="")
    assert texts(mission_lines(bare, plan, 100.0, 60))[0] == " 'cargo hold' is open."


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
    text = farewell(Fleet(platforms={"heron": flying, "egret": PLATFORM}))
    assert text == "stopped; heron flies on by the mission's policies (on_link_loss)"


def test_a_position_next_to_zero_has_no_sign() -> None:
    assert [tenths(value) for value in (-0.04, 0.04, -0.06, 12.34)] == ["0.0", "0.0", "-0.1", "12.3"]


def test_a_triggered_component_is_not_called_slow_while_its_input_rests() -> None:
    assert PLATFORM.table is not None
    rows = list(PLATFORM.table.rows)
    rows[9] = TableRow("limiter", "CC", 20.0, True, "", is_triggered=True)
    rows[11] = TableRow("recorder", "AD", 0.0, False, "", is_triggered=True)
    lines_of = {9: (ComponentLine(9, 0, 50, 3, 0, 0), 100.0), 11: (ComponentLine(11, 0, 0, 0, 0, 0), 100.0)}
    reported = replace(PLATFORM, table=ComponentTable(table=1, rows=rows), lines={**PLATFORM.lines, **lines_of})
    shown = dict(component_rows(reported, 100.0, 100))
    assert [span.tone for span in shown["limiter"] if "10.0/20 Hz" in span.text] == [Tone.DIM]
    assert "triggered" in text_of(shown["recorder"])
    assert "%" not in text_of(shown["recorder"])
    assert texts(component_lines(reported, "limiter", 100.0, 80))[0] == " controller, required, 20 Hz when triggered"
    assert texts(component_lines(reported, "recorder", 100.0, 80))[0].endswith("not required, triggered")
    slow = replace(reported, lines={**reported.lines, 8: (ComponentLine(8, 0, 50, 3, 0, 0), 100.0)})
    (name, line) = component_rows(slow, 100.0, 100)[8]
    assert [span.tone for span in line if "Hz" in span.text] == [Tone.WARN], name


def test_what_this_station_may_and_why_not_more_stands_below_control() -> None:
    role = HeldRole(Role.OPERATOR, None, ("take_off", "land"))
    rights = MemberRights([role], {"overrule": "overruling needs the role commander of heron"}, ["terminate"])
    without = texts(control_lines(view(PLATFORM), frozenset(), 120))
    assert texts(control_lines(view(replace(PLATFORM, rights=rights)), frozenset(), 120)) == [
        *without,
        " This station is operator (only take_off and land); two persons: disarming in flight",
        " overruling needs the role commander of heron",
    ]
    narrow = texts(control_lines(view(replace(PLATFORM, rights=rights)), frozenset(), 30))
    assert narrow[-2:] == [" overruling needs the role", " commander of heron"]
