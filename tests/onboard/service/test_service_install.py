"""`gloc3 onboard install`: a unit that systemd takes as it is and finds well enclosed, and names of devices that stay."""

import os
import re
import shlex
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from gloc3.cli.program import run
from gloc3.errors import Refused
from gloc3.platform.reader import load_platform
from gloc3_onboard.cli.onboard_options import OnboardOptions
from gloc3_onboard.service.install import advice, make_plan, rule, usb_device
from gloc3_onboard.service.needs import DeviceNode, allowed, arguments, homes, keys, modules, nodes
from gloc3_onboard.service.unit import SystemdUnit, quoted

MOST_EXPOSURE = 2.0
NEEDS_SYSTEMD = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed; it comes with systemd"
)
CABLES = OnboardOptions(
    autopilot="serial:///dev/ttyACM0:57600",
    station=["udpout://10.0.0.1:14550", "serial:///dev/serial/by-id/usb-radio:57600?rate=40000"],
    device=["ground_camera=v4l2:///dev/video0?width=640"],
)


@NEEDS_SYSTEMD
@pytest.mark.parametrize("options", [OnboardOptions(), CABLES], ids=["network only", "with devices"])
@pytest.mark.thorough
def test_systemd_verifies_the_unit_and_finds_it_well_enclosed(options: OnboardOptions, tmp_path: Path) -> None:
    plan = make_plan("copter", options, "gloc3")
    file = tmp_path / plan.unit.file
    file.write_text(plan.unit.text())
    verified = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", "--recursive-errors=yes", file],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (verified.returncode, verified.stderr) == (0, "")
    found = subprocess.run(
        ["systemd-analyze", "security", "--offline=true", "--no-pager", file],
        capture_output=True,
        check=False,
        text=True,
        env={**os.environ, "LC_ALL": "C.UTF-8"},
    )
    level = re.search(r"Overall exposure level for \S+: ([0-9.]+)", found.stdout)
    assert level, found.stdout + found.stderr
    assert float(level[1]) <= MOST_EXPOSURE
    file.write_text(plan.unit.text().replace("Type=notify", "Tpye=notify"))
    wrong = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", "--recursive-errors=yes", file], capture_output=True, check=False
    )
    assert wrong.returncode != 0, "it would have found a mistake"


def test_a_dry_run_prints_the_unit_and_writes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["onboard", "install", "copter", "--dry-run", "--prefix", str(tmp_path), "--take-plans"]) == 0
    text = capsys.readouterr().out
    assert f"# {tmp_path}/etc/systemd/system/gloc3-copter.service" in text
    assert "onboard copter --take-plans --out=/var/lib/gloc3/copter --logs=/var/log/gloc3/copter" in text
    assert "Environment" not in text
    assert list(tmp_path.iterdir()) == []


def test_logs_are_sent_by_a_timer_while_the_vehicle_is_disarmed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    units = tmp_path / "etc/systemd/system"
    by = "rclone copy {} remote:logs"
    assert run(["onboard", "install", "copter", "--prefix", str(tmp_path), "--send-logs", by]) == 0
    assert "systemctl enable --now gloc3-copter.service send-gloc3-copter.timer" in capsys.readouterr().err
    service = (units / "send-gloc3-copter.service").read_text()
    assert 'log send /var/log/gloc3/copter --by "rclone copy {} remote:logs"' in service
    assert "User=gloc3" in service
    (condition,) = [line for line in service.split("\n") if line.startswith("ExecCondition=")]
    script = shlex.split(condition.partition("=")[2])[2].replace(
        "systemctl show -P StatusText gloc3-copter.service", "cat"
    )
    for status, is_sent in (
        ("armed, in air, AUTO", False),
        ("disarmed, on ground, HOLD", True),
        ("no autopilot", True),
    ):
        line = f"copter is working: 17 of 17 components work; {status}"
        assert (subprocess.run(["/bin/sh", "-c", script], input=line.encode(), check=False).returncode == 0) is is_sent
    assert "OnUnitInactiveSec=5min" in (units / "send-gloc3-copter.timer").read_text()
    assert run(["onboard", "uninstall", "copter", "--prefix", str(tmp_path)]) == 0
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []
    assert run(["onboard", "install", "copter", "--prefix", str(tmp_path), "--send-logs", "rclone 'copy"]) == 2
    assert "is no command: No closing quotation" in capsys.readouterr().err


@NEEDS_SYSTEMD
def test_systemd_verifies_the_units_that_send_logs(tmp_path: Path) -> None:
    plan = make_plan("copter", OnboardOptions(), "gloc3").sending_logs("cp {} /mnt/logs")
    for path, text in plan.files(tmp_path).items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    for suffix in ("service", "timer"):
        file = tmp_path / "etc/systemd/system" / f"send-gloc3-copter.{suffix}"
        command = ["systemd-analyze", "verify", "--man=no", "--recursive-errors=yes", str(file)]
        verified = subprocess.run(command, capture_output=True, text=True, check=False)
        assert (verified.returncode, verified.stderr) == (0, "")


def test_what_is_installed_can_be_uninstalled(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["onboard", "install", "copter", "--prefix", str(tmp_path)]) == 0
    assert (tmp_path / "etc/systemd/system/gloc3-copter.service").read_text().startswith("# Runs the companion process")
    assert run(["onboard", "uninstall", "pelican", "--prefix", str(tmp_path)]) == 2
    assert "there is no service 'pelican'; installed: copter" in capsys.readouterr().err
    assert run(["onboard", "uninstall", "copter", "--prefix", str(tmp_path)]) == 0
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_the_options_in_the_unit_mean_the_same_from_every_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    options = OnboardOptions(
        station=["udpout://10.0.0.1:14550?key=a.key&rate=5000"], signing_key=Path("b.key"), system_id=3, quiet=True
    )
    assert list(arguments(options)) == [
        f"--station=udpout://10.0.0.1:14550?rate=5000&key={tmp_path}/a.key",
        "--system-id=3",
        f"--signing-key={tmp_path}/b.key",
        "--quiet",
    ]
    assert keys(options) == [tmp_path / "a.key", tmp_path / "b.key"]


def test_only_the_devices_that_are_asked_for_are_allowed() -> None:
    platform = load_platform("copter")
    assert nodes(platform, OnboardOptions()) == []
    found = nodes(platform, CABLES)
    assert [(node.role, str(node.path), node.group) for node in found] == [
        ("autopilot", "/dev/ttyACM0", "dialout"),
        ("station_2", "/dev/serial/by-id/usb-radio", "dialout"),
        ("ground_camera", "/dev/video0", "video"),
    ]
    assert allowed(found) == ("char-ttyACM", "char-ttyUSB", "char-video4linux"), (
        "of a missing name either kind may come"
    )
    assert modules(found[:1]) == ("cdc_acm",)
    board = nodes(platform, OnboardOptions(autopilot="serial:///dev/ttyTHS1:921600"))
    assert (allowed(board), modules(board)) == (("/dev/ttyTHS1",), ()), "a port of the computer itself"
    text = SystemdUnit(name="a", command=("gloc3",), user="u", devices=("char-ttyACM",), groups=("dialout",)).text()
    assert "PrivateDevices" not in text
    assert "DevicePolicy=closed\nDeviceAllow=char-ttyACM rw\n" in text
    assert "PrivateDevices=yes" in SystemdUnit(name="a", command=("gloc3",), user="u").text()


TWO_HOSTS = """\
platform: two
vehicle: {type: quadrotor, mass_kg: 1.0}
hosts: {main: {}, vision: {}}
devices: {ground_camera: "v4l2:///dev/video0"}
components:
  - {name: state, class: "gloc3_onboard.components.samplers.autopilot_state:AutopilotStateSampler", rate_hz: 10, devices: {device: autopilot}}
  - {name: ground_camera, class: "gloc3_onboard.components.samplers.camera:CameraSampler", rate_hz: 15, ports: {image: camera/ground}, devices: {device: ground_camera, rig: rig}, host: vision}
"""


def test_each_host_has_the_devices_of_its_share_and_nothing_without_a_network(tmp_path: Path) -> None:
    file = tmp_path / "two.yaml"
    file.write_text(TWO_HOSTS)
    platform = load_platform(str(file))
    wanted = replace(CABLES, device=[], station=["udpout://10.0.0.1:14550"])
    assert [node.role for node in nodes(platform, replace(wanted, host="main"))] == ["autopilot"]
    assert [node.role for node in nodes(platform, replace(wanted, host="vision"))] == ["ground_camera"]
    with pytest.raises(Refused, match="two has the hosts main, vision: choose one"):
        make_plan(str(file), wanted, "gloc3")
    with pytest.raises(Refused, match="--network"):
        make_plan(str(file), replace(wanted, host="vision"), "gloc3")


def test_the_service_may_write_the_folder_of_its_network_file_and_nothing_else_of_a_home() -> None:
    unit = SystemdUnit(name="pelican", command=("gloc3",), user="gloc3", network=Path("/etc/gloc3/net"))
    assert "ReadWritePaths=/etc/gloc3/net" in unit.text().splitlines()
    places = (Path("/home/ada/hold"), Path("/home/ada/net"))
    lines = msgspec.structs.replace(unit, homes=places, network=places[1]).text().splitlines()
    assert "BindReadOnlyPaths=/home/ada/hold" in lines
    assert "BindPaths=/home/ada/net" in lines
    assert not any(line.startswith("ReadWritePaths") for line in lines)


def test_of_a_home_the_service_sees_only_the_folder_that_it_needs() -> None:
    found = homes([Path("/home/ada/hold/hold.yaml"), Path("/home/ada/hold/keys/radio.key"), Path("/etc/gloc3/a.yaml")])
    assert Path("/home/ada/hold") in found
    assert Path("/home/ada/hold/keys") not in found, "it is in the other"
    assert Path("/etc/gloc3") not in found
    with pytest.raises(Refused, match="the service would see all of /home/ada; put the file into a folder of its own"):
        homes([Path("/home/ada/hold.yaml")])
    with pytest.raises(Refused, match="a service has its own tmp; put the file elsewhere"):
        homes([Path("/tmp/hold.yaml")])


def test_words_of_a_command_are_taken_literally() -> None:
    assert quoted("--device=a=gst://v4l2src ! $x 100%") == '"--device=a=gst://v4l2src ! $$x 100%%"'
    assert quoted('a"b\\c') == '"a\\"b\\\\c"'
    assert quoted("udpout://10.0.0.1:14550") == "udpout://10.0.0.1:14550"


def test_a_folder_of_its_own_is_refused_to_a_service() -> None:
    with pytest.raises(Refused, match="--out: a service has its folders below /var/lib/gloc3"):
        make_plan("copter", replace(OnboardOptions(), out=Path("/srv")), "gloc3")


def plugged(sys: Path, node: str, port: str, *, serial: str, index: str = "") -> None:
    """A device on USB as Linux shows it in /sys."""
    kind = "tty" if node.startswith("tty") else "video4linux"
    usb = sys / "devices/usb1" / port
    entry = usb / f"{port}:1.0" / kind / node
    entry.mkdir(parents=True)
    snapshot = {
        "idVendor": "26ac",
        "idProduct": "0011",
        "manufacturer": "3D Robotics",
        "product": "PX4 FMU",
        "serial": serial,
    }
    for name, text in snapshot.items():
        if text:
            (usb / name).write_text(text + "\n")
    (usb / f"{port}:1.0" / "bInterfaceNumber").write_text("00\n")
    if index:
        (entry / "index").write_text(index + "\n")
    (sys / "class" / kind).mkdir(parents=True, exist_ok=True)
    (sys / "class" / kind / node).symlink_to(entry)


def test_with_rules_the_service_uses_the_names_that_they_give(tmp_path: Path) -> None:
    plugged(tmp_path, "ttyACM0", "1-2", serial="3A0025001851")
    plugged(tmp_path, "video0", "1-4", serial="", index="0")
    bare = make_plan("copter", CABLES, "gloc3", sys_folder=tmp_path)
    assert bare.rules == ""
    assert any("/dev/ttyACM0 (3D Robotics PX4 FMU) may get another name" in text for text in bare.advice)
    plan = make_plan("copter", CABLES, "gloc3", with_udev=True, sys_folder=tmp_path)
    words = plan.unit.command
    assert "--autopilot=serial:///dev/gloc3/autopilot:57600" in words
    assert "--device=ground_camera=v4l2:///dev/gloc3/ground_camera?width=640" in words
    assert plan.unit.devices == ("char-ttyACM", "char-ttyUSB", "char-video4linux")
    assert 'SYMLINK+="gloc3/ground_camera"' in plan.rules
    assert [path.name for path in plan.files(tmp_path)] == ["gloc3-copter.service", "90-gloc3-copter.rules"]
    assert not plan.advice


def test_a_device_is_named_by_its_serial_number_or_else_by_its_plug(tmp_path: Path) -> None:
    plugged(tmp_path, "ttyACM0", "1-2", serial="3A0025001851")
    plugged(tmp_path, "video2", "1-4", serial="", index="0")
    autopilot, camera = (
        DeviceNode("autopilot", Path("/dev/ttyACM0"), "dialout"),
        DeviceNode("camera", Path("/dev/video2"), "video"),
    )
    found = usb_device(autopilot, tmp_path)
    assert found is not None
    assert rule("autopilot", found) == (
        "# 3D Robotics PX4 FMU, by its serial number\n"
        'SUBSYSTEM=="tty", ENV{ID_VENDOR_ID}=="26ac", ENV{ID_MODEL_ID}=="0011", ENV{ID_SERIAL_SHORT}=="3A0025001851", '
        'ENV{ID_USB_INTERFACE_NUM}=="00", SYMLINK+="gloc3/autopilot", ENV{ID_MM_DEVICE_IGNORE}="1"'
    )
    other = usb_device(camera, tmp_path)
    assert other is not None
    assert 'KERNELS=="1-4", ENV{ID_USB_INTERFACE_NUM}=="00", ATTR{index}=="0", SYMLINK+="gloc3/camera"' in rule(
        "camera", other
    )
    assert advice(autopilot, found) == (
        "/dev/ttyACM0 (3D Robotics PX4 FMU) may get another name at the next boot: --udev names it /dev/gloc3/autopilot"
    )
    assert usb_device(DeviceNode("radio", Path("/dev/ttyUSB7"), "dialout"), tmp_path) is None


@pytest.mark.parametrize("cpus", ["2-3", "0,2", "1", ""])
def test_a_service_may_be_kept_to_some_processors(cpus: str) -> None:
    text = make_plan("copter", OnboardOptions(), "gloc3", cpus=cpus).unit.text()
    assert (f"\nCPUAffinity={cpus}\n" in text) == bool(cpus)
    assert "\nCPUWeight=1000\n" in text


def test_a_service_with_real_time_priority_may_take_it() -> None:
    usual, urgent = (
        make_plan("copter", OnboardOptions(real_time=wanted), "gloc3").unit.text() for wanted in (False, True)
    )
    allowed = ["LimitRTPRIO=10", "RestrictRealtime=no", "SystemCallFilter=sched_setscheduler"]
    lines = urgent.splitlines()
    assert [line for line in lines if line in allowed] == allowed
    assert lines.index("RestrictRealtime=yes") < lines.index("RestrictRealtime=no"), "the last one counts"
    assert " --real-time " in urgent
    assert not any(line in usual for line in [*allowed, "--real-time"])


@pytest.mark.parametrize("cpus", ["two", "1-", "-1", "1;2", "1 2\nUser=root"])
def test_what_names_no_processors_is_refused(cpus: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["onboard", "install", "copter", "--dry-run", f"--cpus={cpus}"]) == 2
    assert "--cpus" in capsys.readouterr().err
