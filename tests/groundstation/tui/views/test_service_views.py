"""What the services' panes say, as text."""

from pathlib import Path

from tests.groundstation.services_scene import INFOS, PARAMETERS

from gloc3.mavlink.message import Address
from gloc3.mavlink.services.calibration import CalibrationKind, CalibrationPhase, CalibrationState, Side, SideState
from gloc3.mavlink.services.files.log_server import LogEntry
from gloc3.mavlink.services.parameter import ParameterType, parameter
from gloc3.mission.formats.items import FenceArea, ForeignPlan, MavItem, PlanEntry
from gloc3_groundstation.desk.parameter_desk import judge
from gloc3_groundstation.desk.plan_desk import PlanDesk, PlanFile
from gloc3_groundstation.desk.service_jobs import JobOutcome, ServiceJob, ServiceKind
from gloc3_groundstation.services.descriptions.parameter_info import read_infos
from gloc3_groundstation.services.logs import LogLine
from gloc3_groundstation.services.parameter_files import read_parameter_file
from gloc3_groundstation.services.parameter_table import ParameterTable
from gloc3_groundstation.services.plans import PlanService
from gloc3_groundstation.services.rates import RateRow, RateTable
from gloc3_groundstation.tui.views.services import calibration as service_calibration
from gloc3_groundstation.tui.views.services import lists as service_lists
from gloc3_groundstation.tui.views.services import parameters as service_parameters
from gloc3_groundstation.tui.views.services import plans as service_plans
from gloc3_groundstation.tui.views.services.frame import job_lines, services_line, unreachable_lines
from gloc3_groundstation.tui.widgets.lines import Line, Tone, text_of

TABLE = ParameterTable.of({one.name: one for one in PARAMETERS}, read_infos(INFOS.encode(), "infos"), is_complete=True)
FILE = "MPC_XY_VEL_MAX 8\nNAV_DLL_ACT 2\nRTL_RETURN_ALT 2000\nOLD_ONE 1\nMPC_Z_VEL_MAX_UP 3\n"


def text(lines: list[Line]) -> str:
    return "\n".join(text_of(line) for line in lines)


def test_the_services_stand_in_one_line_with_a_figure_at_those_that_work() -> None:
    running = {ServiceKind.LOGS: ServiceJob(what="x", fraction=0.42), ServiceKind.FILES: ServiceJob(what="y")}
    line = services_line(ServiceKind.PLANS, running, "PX4 1.15.4, system 1", 110)
    assert text_of(line).split() == [
        "Parameters",
        "Plans",
        "Logs",
        "42",
        "%",
        "Files",
        "…",
        "Calibration",
        "Rates",
        "Console",
        "Motors",
        "PX4",
        "1.15.4,",
        "system",
        "1",
    ]
    assert next(span.text for span in line if span.tone is Tone.CHOSEN) == "Plans"


def test_what_is_under_way_has_a_bar_and_the_key_that_cancels_it() -> None:
    job = ServiceJob(what="downloading log 3", fraction=0.5, detail="1.20 of 2.40 MB")
    (line,) = job_lines(job, None, 80)
    assert text_of(line).startswith(" downloading log 3 ━━━━━━━━━━╌╌╌╌╌╌╌╌╌╌  50 %  1.20 of 2.40 MB")
    assert text_of(line).endswith("esc cancels ")


def test_how_it_ended_is_told_in_words_and_not_at_any_length() -> None:
    assert text(job_lines(None, JobOutcome(text="36 parameters"), 80)) == " ✓ 36 parameters"
    wrong = JobOutcome(text="9 errors in the file", is_good=False, lines=tuple(f"f:{n}:1: bad" for n in range(9)))
    lines = job_lines(None, wrong, 80)
    assert text(lines[:2]) == " ✗ 9 errors in the file\n   f:0:1: bad"
    assert text_of(lines[-1]) == "   and 5 lines more"
    assert "no link of this station" in text(unreachable_lines("no link of this station hears it", 80))


def test_a_parameter_is_told_in_full_and_marked_when_it_was_changed() -> None:
    row = TABLE["NAV_DLL_ACT"]
    assert text_of(service_parameters.parameter_line(row, 120)).split()[:3] == ["≠", "NAV_DLL_ACT", "0"]
    reported = text(service_parameters.parameter_lines(row, 76))
    assert reported.splitlines()[0].strip() == "NAV_DLL_ACT = 0 (Disabled)"
    assert "int32, default 2, takes effect after a vehicle restart" in reported
    assert "0 Disabled, 1 Hold mode, 2 Return mode, 3 Land mode" in reported
    changed = TABLE.with_value(TABLE.check("MPC_XY_VEL_MAX", 8.5))
    row = changed["MPC_XY_VEL_MAX"]
    assert text_of(service_parameters.parameter_line(row, 80)).split()[:3] == ["●", "MPC_XY_VEL_MAX", "8.5"]
    reported = text(service_parameters.parameter_lines(row, 76))
    assert "MPC_XY_VEL_MAX = 8.5 m/s   was 12 m/s" in reported
    assert "real32, from 0 to 20 m/s, default 12 m/s, in steps of 1" in reported
    title = service_parameters.parameters_title(changed, 36, "", service_parameters.Only.ALL)
    assert title == "36 parameters, 1 changed"
    assert "no description" in text(service_parameters.parameter_lines(TABLE["CAL_ACC3_ID"], 76))


def test_a_comparison_says_what_would_be_written_what_is_left_and_what_is_wrong() -> None:
    diff = TABLE.compare(read_parameter_file(FILE.encode(), "new.parm"))
    lines = [service_parameters.diff_line(row, {"NAV_DLL_ACT"}, 120) for row in service_parameters.diff_rows(diff)]
    assert [text_of(line).split()[:4] for line in lines] == [
        ["write", "MPC_XY_VEL_MAX", "12", "8"],
        ["leave", "NAV_DLL_ACT", "0", "2"],
        ["wrong", "RTL_RETURN_ALT", "60", "2000"],
        ["none", "OLD_ONE", "?", "1"],
    ]
    assert "must be at most 1000 m, not 2000" in text_of(lines[2])
    assert (
        service_parameters.diff_title(diff, {"NAV_DLL_ACT"}) == "new.parm against the vehicle: 1 to write, 1 the same"
    )
    wrong = service_parameters.diff_rows(diff)[2]
    assert "not allowed   line 3 of the file" in text(service_parameters.diff_detail(diff, wrong, 80))


def test_whole_numbers_are_compared_in_all_their_digits() -> None:
    mask = ParameterTable.of({"MASK": parameter("MASK", 16_777_216, ParameterType.INT32)}, {}, is_complete=True)
    (row,) = service_parameters.diff_rows(mask.compare(read_parameter_file(b"MASK 16777220", "new.parm")))
    assert text_of(service_parameters.diff_line(row, (), 120)).split() == ["write", "MASK", "16777216", "16777220"]


def test_what_is_typed_for_a_parameter_is_judged_in_words() -> None:
    assert judge(TABLE, "NAV_DLL_ACT", " land mode ").value == 3
    assert judge(TABLE, "MPC_XY_VEL_MAX", "25").reason == (
        "MPC_XY_VEL_MAX must be at most 20 m/s, not 25; 25! sets it anyway"
    )
    assert judge(TABLE, "MPC_XY_VEL_MAX", "25!") == (25.0, True, "", "25")
    assert "is no value for" in judge(TABLE, "MPC_XY_VEL_MAX", "fast").reason
    assert judge(TABLE, "NAV_DLL_ACT", "1.5!").reason


def test_logs_files_and_rates_are_told_with_their_sizes() -> None:
    log = LogLine(entry=LogEntry(7, 2_500_000, 1_700_000_000), file_name="log_007.ulg")
    assert text_of(service_lists.log_line(log, 80)).split() == ["7", "2023-11-14", "22:13", "2.50", "MB", "log_007.ulg"]
    assert service_lists.logs_title((log,)) == "1 logs, 2.50 MB, the newest first"
    assert text_of(service_lists.file_line("log", None, 80)).strip() == "log/"
    assert text_of(service_lists.file_line("a.ulg", 812, 80)).split() == ["a.ulg", "812", "B"]
    row = RateRow(
        name="ATTITUDE",
        message_id=30,
        source=Address(1, 1),
        rate_hz=4.0,
        bytes_s=160.0,
        age_s=0.1,
        count=99,
        wanted_hz=10.0,
    )
    line = service_lists.rate_line(row, 80)
    assert text_of(line).split()[:6] == ["ATTITUDE", "1/1", "4.0", "10", "160", "now"]
    assert next(span.tone for span in line if span.text.strip() == "4.0") is Tone.WARN
    title = service_lists.rates_title(RateTable(rows=(row,)), 1, "")
    assert title == "1 messages, 4 a second, 160 B/s on the link"


def test_a_plan_is_told_item_by_item_with_what_differs_first() -> None:
    items = (MavItem(command=22, frame=3, x=47.3977, y=8.5456, z=3.0), MavItem(command=20, frame=2))
    plan = ForeignPlan(
        entries=tuple(PlanEntry(items=(item,)) for item in items),
        fence=(FenceArea(is_inclusion=True, center=(47.0, 8.0), radius_m=200.0),),
        rally=((47.1, 8.1, 20.0),),
        raw={},
    )
    desk = PlanDesk(
        lambda service, what, work, *, is_change=False, needs_control=None: None, PlanService.__new__(PlanService)
    )
    assert service_plans.plans_title(desk) == "on the vehicle: not downloaded"
    desk.file = PlanFile(name="a.plan", plan=plan)
    text = [text_of(line).split() for _, line in service_plans.plan_rows(desk, 80)]
    assert text[0] == ["a.plan:", "2", "items,", "1", "fence", "area,", "1", "rally", "point"]
    assert text[1][:6] == ["0", "nav", "takeoff", "47.3977000", "8.5456000", "3.0"]
    assert text[2][:5] == ["1", "nav", "return", "to", "launch"]
    assert text[3][:3] == ["fence:", "stay", "inside"]
    desk.differences = ()
    assert service_plans.plans_title(desk).endswith("a.plan is the same")


def test_a_calibration_says_what_a_person_has_to_do_now() -> None:
    state = CalibrationState(
        kind=CalibrationKind.ACCELEROMETER,
        phase=CalibrationPhase.WAITING,
        progress=0.5,
        instruction="Put the vehicle on its left side.",
        sides={Side.LEVEL: SideState.DONE, Side.LEFT: SideState.PENDING},
    )
    reported = text(service_calibration.calibration_lines(state, 80))
    assert "accelerometer: waiting for you" in reported
    assert "Put the vehicle on its left side." in reported
    assert "y done: go on" in reported
    assert "✓ level" in reported
    assert "enter starts" in text(service_calibration.calibration_lines(None, 80))
    line = service_calibration.kind_line(CalibrationKind.GYRO, state)
    assert "keep the vehicle still" in text_of(line)


def test_no_view_is_wider_than_its_terminal() -> None:
    for width in (78, 118, 198):
        for row in TABLE:
            assert len(text_of(service_parameters.parameter_line(row, width))) <= width
        for header in (
            service_parameters.parameters_header,
            service_parameters.diff_header,
            service_lists.logs_header,
            service_lists.files_header,
            service_lists.rates_header,
            service_plans.plans_header,
        ):
            assert len(text_of(header(width))) <= width, (header.__name__, Path(__file__).name)
