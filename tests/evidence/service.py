"""The onboard process as a service: its unit by systemd's own judgement, and under a real systemd."""

import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from tests.evidence.booted import Booted, booted, why_not
from tests.evidence.page import Bar, Figure, Progress
from tests.onboard.service.test_service import PLATFORM, STUCK

from gloc3_onboard.cli.onboard_options import OnboardOptions
from gloc3_onboard.service.install import make_plan

MOST_EXPOSURE = 2.0
UNIT = "gloc3-bench"
GLOC3 = str(Path(sys.executable).parent / "gloc3")
FOLDER = "/srv/bench"
CABLES = OnboardOptions(autopilot="serial:///dev/ttyACM0:921600", device=["ground_camera=v4l2:///dev/video0"])
ON_SOCKETS = ["--autopilot", "udpin://127.0.0.1:0", "--station", "udpout://127.0.0.1:9"]


def units() -> list[Figure]:
    """What systemd says of the unit files."""
    figures = []
    with tempfile.TemporaryDirectory() as folder:
        for title, options in (("network only", OnboardOptions()), ("serial line and camera", CABLES)):
            plan = make_plan("copter", options, "gloc3")
            file = Path(folder) / plan.unit.file
            file.write_text(plan.unit.text())
            done = _analyze("verify", "--man=no", "--recursive-errors=yes", str(file))
            text = (done.stdout + done.stderr).strip().splitlines()
            is_clean = done.returncode == 0 and not text
            figures.append(Figure(f"unit, {title}: verify", "clean" if is_clean else text[0], "clean", is_clean))
            found = _analyze("security", "--offline=true", "--no-pager", str(file)).stdout
            level = float(re.findall(r"Overall exposure level for \S+: ([0-9.]+)", found)[0])
            figures.append(Figure(f"unit, {title}: exposure", f"{level}", f"≤ {MOST_EXPOSURE}", level <= MOST_EXPOSURE))
    return figures


def _analyze(*arguments: str) -> "subprocess.CompletedProcess[str]":
    environment = {**os.environ, "LC_ALL": "C.UTF-8"}
    command = ["systemd-analyze", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment)


def installed(systemd: Booted) -> None:
    """A platform with a component that can be made to hang, as a service."""
    write = ["sh", "-c", 'mkdir -p "$(dirname "$1")" && printf %s "$2" > "$1"', "write"]
    files = {
        f"{FOLDER}/bench.yaml": PLATFORM,
        f"{FOLDER}/stuck_sampler.py": STUCK,
        # A real computer has sysinit.target, and its components are installed.
        f"/run/systemd/system/{UNIT}.service.d/bench.conf": "[Unit]\nDefaultDependencies=no\n"
        f"[Service]\nEnvironment=PYTHONPATH={FOLDER}\n",
    }
    for name, text in files.items():
        systemd.request(*write, name, text)
    systemd.request("systemctl", "start", "systemd-journald")
    install = ["env", f"PYTHONPATH={FOLDER}", GLOC3, "onboard", "install", f"{FOLDER}/bench.yaml", *ON_SOCKETS]
    systemd.request(*install)


def life() -> dict[str, Any]:
    """Start, hang, kill, reload and stop of the service."""
    with booted() as systemd:
        installed(systemd)
        begin_s = time.monotonic()
        systemd.request("systemctl", "start", UNIT)
        found: dict[str, Any] = {"start_s": time.monotonic() - begin_s, "status": systemd.property(UNIT, "StatusText")}
        main = systemd.property(UNIT, "MainPID")
        snapshot = dict(
            line.split(":\t") for line in systemd.request("cat", f"/proc/{main}/status").splitlines() if ":\t" in line
        )
        found["uid"], found["capabilities"], found["seccomp"] = (
            snapshot["Uid"].split()[0],
            snapshot["CapEff"],
            snapshot["Seccomp"],
        )
        # the component hangs
        systemd.request("touch", "/var/lib/gloc3/bench/stuck")
        found["hang_s"] = systemd.until(UNIT, "NRestarts", "1", 60.0)
        systemd.request("rm", "/var/lib/gloc3/bench/stuck")
        systemd.until(UNIT, "ActiveState", "active", 60.0)
        # the process is killed
        systemd.request("kill", "-KILL", systemd.property(UNIT, "MainPID"))
        begin_s = time.monotonic()
        systemd.until(UNIT, "NRestarts", "2", 60.0)
        systemd.until(UNIT, "ActiveState", "active", 60.0)
        found["back_s"] = time.monotonic() - begin_s
        found["status_after"] = systemd.property(UNIT, "StatusText")
        # new settings
        systemd.request(
            "sed", "-i", "s/required: true}/required: true, settings: {depth_m: 2.5}}/", f"{FOLDER}/bench.yaml"
        )
        systemd.request("systemctl", "reload", UNIT)
        systemd.until(UNIT, "ActiveState", "active", 30.0)
        begin_s = time.monotonic()
        while systemd.request("cat", "/var/lib/gloc3/bench/depth_m") != "2.5" and time.monotonic() - begin_s < 30.0:
            time.sleep(0.1)
        found["depth_m"] = systemd.request("cat", "/var/lib/gloc3/bench/depth_m")
        begin_s = time.monotonic()
        systemd.request("systemctl", "stop", UNIT)
        found["stop_s"], found["result"] = time.monotonic() - begin_s, systemd.property(UNIT, "Result")
        found["journal"] = systemd.request("journalctl", "-u", UNIT, "--no-pager", "-o", "cat")
        found["errors"] = systemd.request("journalctl", "-u", UNIT, "-p", "err", "--no-pager", "-o", "cat")
        by_component = ["journalctl", "-u", UNIT, "COMPONENT=stuck", "--no-pager", "-o", "cat", "--output-fields=EVENT"]
        found["events"] = systemd.request(*by_component)
        found["logs"] = systemd.request("ls", "/var/log/gloc3/bench").split()
    return found


def run(progress: Progress) -> list[Figure]:
    """The figures of the page."""
    figures = units()
    if reason := why_not():
        return [*figures, Figure("under a real systemd", f"not tried: {reason}", "tried", False)]
    found = progress.part("life under systemd", life)
    aborted = "Fatal Python error: Aborted" in found["journal"]
    journal, errors = found["journal"], found["errors"].splitlines()
    reported = "onboard: stuck: working -> faulty: hung: a cycle had not ended after 0.5 s"
    confined = (found["uid"] != "0", found["capabilities"].strip("0") == "", found["seccomp"] == "2")
    logs = sum(name.endswith(".mcap") for name in found["logs"])
    return [
        *figures,
        Figure("real systemd: from start to READY, in s", f"{found['start_s']:.1f}"),
        Figure("… status then", found["status"], "2 of 2", "2 of 2 components work" in found["status"]),
        Figure("… own user, no capabilities, system calls filtered", str(all(confined)), "True", all(confined)),
        Figure(
            "a required component hangs: ended by the watchdog after, in s",
            f"{found['hang_s']:.1f}",
            "≤ 25",
            found["hang_s"] <= 25.0,
        ),
        Figure("… the journal has it as an error", str(reported in errors), "True", reported in errors),
        Figure(
            "… found by journalctl COMPONENT=stuck",
            str("working -> faulty: hung" in found["events"]),
            "True",
            "working -> faulty: hung" in found["events"],
        ),
        Figure("… and says where it hung", str("stuck_sampler.py" in journal), "True", "stuck_sampler.py" in journal),
        Figure("… ended by SIGABRT, with all threads in the journal", str(aborted), "True", aborted),
        Figure("killed: READY again after, in s", f"{found['back_s']:.1f}"),
        Figure("… status then", found["status_after"], "2 of 2", "2 of 2 components work" in found["status_after"]),
        Figure("reloaded: the component's setting", found["depth_m"], "2.5", found["depth_m"] == "2.5"),
        Figure("told to stop: ended after, in s", f"{found['stop_s']:.1f}", "≤ 10", found["stop_s"] <= 10.0),
        Figure("… result", found["result"], "success", found["result"] == "success"),
        Figure("logs, one for each start", str(logs), "3", logs == 3),
    ]


BARS = (
    Bar(
        "service",
        "The onboard process runs as a hardened systemd service that recovers from a hang",
        "systemd accepts the unit without warnings and rates it as well confined. Under a real systemd (in namespaces "
        "of its own) the service is ready when its components are, is stopped by the watchdog when one of them hangs, "
        "starts again, takes new settings, and ends.",
        run,
    ),
)
