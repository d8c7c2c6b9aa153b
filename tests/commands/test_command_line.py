"""The command line in one process: what is wrong is said in a line, with the exit code that scripts look at."""

import re
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from gloc3.cli.program import SUMMARIES, run
from gloc3.platform.reader import whole_text
from gloc3_sitl.faults.fault_effects import EFFECTS
from gloc3_sitl.faults.faults import SHORT

pytestmark = pytest.mark.thorough

COMMANDS = tuple(SUMMARIES)

WRONG_USE: list[tuple[Sequence[str], str]] = [
    ([], "Usage: gloc3 COMMAND"),
    (["flyy"], "did you mean 'fly'?"),
    (["mission"], "Usage: gloc3 mission COMMAND"),
    (["mission", "chek", "hop"], "no command 'chek'; did you mean 'check'?"),
    (["mission", "check"], "MISSION is missing"),
    (["mission", "check", "nosuch"], "no such mission (known: hop, inspection, mapping, patrol, powerline, survey)"),
    (["mission", "check", "no/such.yaml"], "no/such.yaml: cannot be read: no such file or directory"),
    (["mission", "show", "."], ".: is a folder, not a mission file"),
    (["mission", "check", "hop", "more"], "unexpected after the arguments: 'more'"),
    (["mission", "convert", "hop", "x.doc"], "unknown kind of file '.doc'"),
    (["fly"], "MISSION is missing"),
    (["fly", "nosuch"], "no such mission"),
    (["fly", "no/such.yaml"], "there is no file no/such.yaml"),
    (
        ["fly", "hop", "--platform", "nosuch"],
        "no such platform (known: auv, boat, copter, hummingbird, pelican, pelican_rtk, plane, rov, rover, submarine, vtol)",
    ),
    (["fly", "hop", "--autopilot", "px5"], "--autopilot must be px4 or ardupilot, not 'px5'"),
    (["fly", "hop", "--seed", "one"], "--seed must be a whole number, not 'one'"),
    (["fly", "hop", "--seed"], "--seed needs a value"),
    (["fly", "hop", "--seed", "1", "--seed", "2"], "--seed is given more than once"),
    (["--flyy"], "gloc3: no option --flyy (see gloc3 --help)"),
    (["fly", "hop", "--seed", "-1"], "--seed must be 0 or more"),
    (["fly", "hop", "--wind", "-1"], "--wind must be from 0 to 30"),
    (["fly", "hop", "--fault", "nosuch"], "unknown kind 'nosuch'"),
    (["fly", "hop", "--world", "hald"], "no world named 'hald' (did you mean 'hold'?)"),
    (["fly", "hop", "--world", "tank"], "the mission's frame is 'hold', that of world tank is 'tank'"),
    (["fly", "hop", "--fault", "device:nose=lost"], "the world has no device 'nose'"),
    (["fly", "hop", "--bogus"], "no option --bogus; known: autopilot, current, fault,"),
    (["fly", "hop", "--out", "/proc/nowhere"], "the folder /proc/nowhere cannot be written"),
    (["fly", "hop", "--wnid", "3"], "no option --wnid; did you mean 'wind'?"),
    (["fly", "hop", "--waves", "1"], "need a vehicle in water (auv, rov, submarine, boat), not 'pelican'"),
    (["demo", "nosuch"], "no such mission"),
    (["demo", "hop", "--out", "/proc/nowhere"], "the folder /proc/nowhere cannot be written"),
    (["sitl", "--world", "nosuch"], "no world named 'nosuch'"),
    (["sitl", "record", "kitti", "/proc/nowhere", "--speed", "0"], "--speed must be above 0"),
    (["sitl", "--vehicle", "nosuch"], "known: auv, boat, copter, hummingbird, pelican"),
    (
        ["sitl", "--vehicle", "rover", "--current", "1"],
        "need a vehicle in water (auv, rov, submarine, boat), not 'rover'",
    ),
    (["sitl", "--home", "here"], "must be LAT,LON,ALT,HEADING"),
    (["sitl", "--speed", "0"], "--speed must be above 0"),
    (["sitl", "--sensors", "70000"], "--sensors must be a port"),
    (["sitl", "--link", "udp"], "has no scheme"),
    (["onboard"], "PLATFORM is missing"),
    (["onboard", "nosuch"], "no such platform"),
    (["onboard", "pelican_rtk", "--station", "udpout"], "gloc3 onboard: endpoint 'udpout' has no scheme"),
    (["onboard", "pelican_rtk", "--system-id", "255"], "--system-id must be from 1 to 250"),
    (["onboard", "pelican_rtk", "--device", "front_camera=tcp://127.0.0.1:1"], "did you mean 'ground_camera'?"),
    (["onboard", "pelican_rtk", "--device", "ground_camera=udp://127.0.0.1:1"], "is not a source"),
    (["onboard", "pelican_rtk", "--device", "ground_camera"], "must be NAME=URL"),
    (["onboard", "install", "pelican_rtk", "--dry-run", "--user", "a b"], "is not a user name"),
    (["platform", "check", "no/such.yaml"], "no/such.yaml: cannot be read: no such file or directory"),
    (["platform", "show", "nosuch"], "no such platform"),
    (["network", "init", "/proc/nowhere", "--days", "0"], "--days must be from 1"),
    (["station", "--json"], "--json goes with --headless"),
    (["station", "--headless", "--link", "smoke://signals"], "no scheme 'smoke'"),
    (["log", "info", "/nowhere/log.mcap"], "cannot be read"),
    (["log", "plot"], "FILE is missing"),
    (["component", "describe", "nosuch"], "no installed component is called 'nosuch'"),
    (["component", "describe", "gloc3.component.component:Component"], "is a base of components"),
    (["component", "list", "--platform", "nosuch"], "no such platform"),
]


@pytest.mark.parametrize(("arguments", "text"), WRONG_USE, ids=[" ".join(line) or "nothing" for line, _ in WRONG_USE])
def test_wrong_use_is_told_on_stderr_and_ends_with_2(
    arguments: Sequence[str],
    text: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(arguments) == 2
    captured = capsys.readouterr()
    assert text in " ".join(captured.err.split())
    assert "Traceback" not in captured.err
    assert "╭" not in captured.err
    assert captured.out == ""
    assert not list(tmp_path.iterdir()), "nothing is left behind"


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_teaches(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run([command, "--help"]) == 0
    captured = capsys.readouterr()
    assert captured.out.startswith(f"Usage: gloc3 {command}")
    assert "╭" not in captured.out
    assert "--no-" not in captured.out.replace("--no-record ", "").replace("--no-gps ", "")
    assert captured.err == ""
    assert "For example" in captured.out
    assert run(["help", command]) == 0
    assert capsys.readouterr().out == captured.out
    assert run(["--help"]) == 0
    assert f"\n  {command} " in capsys.readouterr().out


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_of_a_command_tells_what_each_of_its_arguments_is(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    run([command, "--help"])
    listed = capsys.readouterr().out.partition("Commands:\n")[2].partition("\n\n")[0]
    for name in re.findall(r"^  ([\w-]+)", listed, re.MULTILINE):
        assert run([command, name, "--help"]) == 0
        page = capsys.readouterr().out
        assert page.startswith(f"Usage: gloc3 {command} {name}")
        rows = re.findall(r"^  (\S+(?: [A-Z_]+| \S+\|\S+)?)  +(.*)$", page, re.MULTILINE)
        assert [row for row, text in rows if not text.strip()] == []


def test_the_help_of_fly_names_every_fault(capsys: pytest.CaptureFixture[str]) -> None:
    run(["fly", "--help"])
    text = capsys.readouterr().out
    assert not [word for word in (*EFFECTS, *SHORT) if word not in text]


def test_a_simulated_vehicle_tells_which_of_its_links_does_not_work(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["sitl", "--link", "serial:///dev/nowhere:57600", "--seconds", "0.5"]) == 0
    assert "sitl: serial:///dev/nowhere:57600: no such file or directory" in capsys.readouterr().err


def test_the_version_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--version"]) == 0
    assert capsys.readouterr().out.startswith("gloc3 ")


BAD_MISSIONS = {
    "empty.yaml": ("", "empty.yaml: the file is empty"),
    "half.yaml": ("mission: half", "half.yaml:1:1: 'frame' is missing"),
    "broken.yaml": ("[1, 2", "not YAML"),
    "no.plan": ("{}", "no.plan:"),
    "deep.yaml": ("a: " + "[" * 5000, "deep.yaml:1:"),
}


@pytest.mark.parametrize("name", BAD_MISSIONS)
def test_a_mission_that_is_not_fit_to_fly_ends_with_1_and_names_the_place(
    name: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text, expected = BAD_MISSIONS[name]
    monkeypatch.chdir(tmp_path)
    Path(name).write_text(text)
    for arguments in (["fly", name], ["mission", "check", name], ["demo", name, "--out", "out"]):
        assert run(arguments) == 1
        captured = capsys.readouterr()
        assert expected in captured.err + captured.out
        assert "Traceback" not in captured.err


def test_a_wrong_platform_file_is_wrong_use_and_names_the_place(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine.yaml").write_text("platform: mine\nvehicle: {type: quadrotor, mass_kg: heavy}\n")
    for arguments in (["fly", "hop", "--platform", "mine.yaml"], ["onboard", "mine.yaml"]):
        assert run(arguments) == 2
        assert "mine.yaml:2:" in capsys.readouterr().err


def test_a_library_that_is_not_installed_is_named_with_the_way_to_install_it(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [name for name in sys.modules if name.startswith("gloc3_sitl")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "jsbsim", None)
    assert run(["fly", "hop"]) == 2
    assert (
        'fly needs jsbsim, which is not installed; install it with: pip install "gloc3[sitl]"'
        in capsys.readouterr().err
    )


BAD_DEPLOYMENTS = {
    "emergency: motion/emergency, primary": (
        "emergency: motion/emergancy, primary",
        r"mine.yaml:LINE:\d+: unknown topic 'motion/emergancy' \(did you mean 'motion/emergency'\?\)",
    ),
    "fence_state: autopilot_fence}, devices": (
        "fence_state: pose}, devices",
        r"mine.yaml:LINE:\d+: 'pose' is an output of pose already",
    ),
    "device: pictures": ("device: pitcures", r"mine.yaml:LINE:\d+: the host has no device 'pitcures' .*'pictures'"),
    "home: motion/home, setpoint_wanted": (
        "home: motion/grant, setpoint_wanted",
        r"mine.yaml:LINE:\d+: 'motion/grant' carries MotionGrant, and the port Home",
    ),
}


@pytest.mark.parametrize("right", BAD_DEPLOYMENTS, ids=["topic", "owner", "device", "type"])
def test_a_deployment_that_cannot_work_is_not_brought_up_and_names_the_place(
    right: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wrong, expected = BAD_DEPLOYMENTS[right]
    monkeypatch.chdir(tmp_path)
    text = whole_text("pelican_rtk")
    assert text.count(right) == 1
    expected = expected.replace("LINE", str(text[: text.index(right)].count("\n") + 1))
    Path("mine.yaml").write_text(text.replace(right, wrong), encoding="utf-8")
    for arguments in (["onboard", "mine.yaml"], ["fly", "hop", "--platform", "mine.yaml"]):
        assert run(arguments) == 2
        reported = capsys.readouterr().err
        assert re.search(expected, reported), reported
        assert "Traceback" not in reported
    assert [path.name for path in tmp_path.iterdir()] == ["mine.yaml"], "nothing is left behind"
