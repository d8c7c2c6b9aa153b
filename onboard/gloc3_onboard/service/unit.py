"""Unit of systemd that runs `gloc3 onboard` as a service: its text, derived from the service's needs."""

import re
import shlex
from pathlib import Path
from typing import Final

import msgspec

from gloc3.component.workers import REAL_TIME_PRIORITY

WATCHDOG_S: Final = 10
"""Watchdog period, s; summaries come twice a second."""
STOP_S: Final = 30
"""Time allowed for a stop on the ground or into a hold, s; the process requests more while it lands."""
_PLAIN: Final = re.compile(r"[A-Za-z0-9_@+=:,./?-]+")

CHANGES: Final = """\
Written by gloc3 onboard install.
# To change its options, install it again; for anything else:"""

HARDENING: Final = """\
NoNewPrivileges=yes
CapabilityBoundingSet=
AmbientCapabilities=
ProtectSystem=strict
ProtectHome={home}
PrivateTmp=yes
PrivateUsers=yes
PrivateMounts=yes
PrivateIPC=yes
RemoveIPC=yes
ProtectKernelTunables=yes
ProtectKernelModules=yes
ProtectKernelLogs=yes
ProtectControlGroups=yes
ProtectClock=yes
ProtectHostname=yes
ProtectProc=invisible
RestrictAddressFamilies=AF_UNIX AF_INET AF_INET6 AF_NETLINK
RestrictNamespaces=yes
RestrictRealtime=yes
RestrictSUIDSGID=yes
LockPersonality=yes
KeyringMode=private
SystemCallArchitectures=native
SystemCallFilter=@system-service
SystemCallFilter=~@privileged @resources
SystemCallErrorNumber=EPERM
UMask=0027
"""
"""What the process may not do. It keeps the network, /proc/stat for the computer's load, and the devices that it uses."""


REAL_TIME: Final = f"""
# The control path goes before all that is not real-time. The kernel leaves a share of each second to the others.
LimitRTPRIO={REAL_TIME_PRIORITY}
RestrictRealtime=no
SystemCallFilter=sched_setscheduler
"""
"""What is allowed beyond that, where its control path has real-time priority."""


class SystemdUnit(msgspec.Struct, frozen=True, kw_only=True):
    """Needs of a service, as a systemd unit."""

    name: str
    """The instance: PLATFORM, or PLATFORM-HOST for one host of several."""
    command: tuple[str, ...]
    """The program and its arguments, with absolute paths, and without --out and --logs."""
    user: str
    groups: tuple[str, ...] = ()
    """Whose devices it may use."""
    devices: tuple[str, ...] = ()
    """What `DeviceAllow` names: device nodes, and classes such as `char-ttyUSB`."""
    modules: tuple[str, ...] = ()
    """The kernel's modules that have to be loaded for the devices' classes to be known."""
    is_real_time: bool = False
    """Whether its control path has real-time priority."""
    cpus: str = ""
    """Processors that it may use, as `CPUAffinity` names them; empty for all."""
    homes: tuple[Path, ...] = ()
    """Files and folders in people's homes that it reads."""
    network: Path | None = None
    """Folder of its network file, where it keeps the newest list of revoked members; None without a network."""

    @property
    def file(self) -> str:
        """The unit's name."""
        return f"gloc3-{self.name}.service"

    @property
    def state(self) -> Path:
        """Folder of the state that survives a restart."""
        return Path("/var/lib/gloc3") / self.name

    @property
    def logs(self) -> Path:
        """Where its logs and pictures go."""
        return Path("/var/log/gloc3") / self.name

    def text(self) -> str:
        """The unit file."""
        command = (*self.command, f"--out={self.state}", f"--logs={self.logs}")
        return "\n\n".join(
            [
                f"# Runs the companion process of {self.name}. {CHANGES} systemctl edit {self.file}",
                section(
                    "Unit",
                    f"Description=GLOC3 onboard process of {self.name}",
                    "After=network.target " + " ".join(self._modules()),
                    f"Wants={' '.join(self._modules())}" if self.modules else "",
                    "# Restarts within a second of a crash in flight; gives up after minutes of failed starts.",
                    "StartLimitIntervalSec=300",
                    "StartLimitBurst=60",
                ),
                section(
                    "Service",
                    "Type=notify",
                    "NotifyAccess=main",
                    f"ExecStart={' '.join(quoted(word) for word in command)}",
                    "ExecReload=/bin/kill -HUP $MAINPID",
                    "Restart=on-failure",
                    "RestartSec=1",
                    "TimeoutStartSec=90",
                    f"TimeoutStopSec={STOP_S}",
                    "# Fed by the supervised work only: a hanging process is ended, logs where, and restarts.",
                    f"WatchdogSec={WATCHDOG_S}",
                    "TimeoutAbortSec=5",
                    "KillMode=mixed",
                    f"SyslogIdentifier=gloc3-{self.name}",
                    "",
                    f"User={self.user}",
                    f"SupplementaryGroups={' '.join(self.groups)}" if self.groups else "",
                    f"StateDirectory=gloc3/{self.name}",
                    "StateDirectoryMode=0750",
                    f"LogsDirectory=gloc3/{self.name}",
                    "LogsDirectoryMode=0750",
                    f"CacheDirectory=gloc3/{self.name}",
                    "CacheDirectoryMode=0700",
                    f"WorkingDirectory={self.state}",
                    "",
                    "# A component that exhausts the memory is ended alone, where it has a process of its own.",
                    "MemoryHigh=70%",
                    "MemoryMax=80%",
                    "OOMPolicy=continue",
                    "OOMScoreAdjust=-500",
                    "TasksMax=1024",
                    "LimitNOFILE=16384",
                    "LimitCORE=0",
                    "# Before other services: by the weight among them, and by the priority within one.",
                    "CPUWeight=1000",
                    "Nice=-5",
                    f"CPUAffinity={self.cpus}" if self.cpus else "",
                    "",
                    *self._devices(),
                    "",
                    HARDENING.format(home="tmpfs" if self.homes else "yes").rstrip(),
                    REAL_TIME.rstrip() if self.is_real_time else "",
                    *self._folders(),
                ),
                "[Install]\nWantedBy=multi-user.target\n",
            ]
        )

    def _modules(self) -> list[str]:
        return [f"modprobe@{module}.service" for module in self.modules]

    def _folders(self) -> list[str]:
        """What it sees of homes, and what it may write besides its own folders."""
        read = [path for path in self.homes if path != self.network]
        found = [f"BindReadOnlyPaths={' '.join(quoted(str(path)) for path in read)}"] if read else []
        if self.network is not None:
            is_at_home = any(self.network.is_relative_to(path) for path in self.homes)
            found.append(f"{'BindPaths' if is_at_home else 'ReadWritePaths'}={quoted(str(self.network))}")
        return found

    def _devices(self) -> list[str]:
        if not self.devices:
            return ["PrivateDevices=yes", "DevicePolicy=closed"]
        return ["DevicePolicy=closed", *(f"DeviceAllow={device} rw" for device in self.devices)]


class LogSender(msgspec.Struct, frozen=True, kw_only=True):
    """Sends the logs of a service elsewhere, as a systemd unit and its timer."""

    of: SystemdUnit
    """The service."""
    by: str
    """The command for each file, as for `gloc3 log send`."""

    @property
    def stem(self) -> str:
        """Of the units' names."""
        return f"send-gloc3-{self.of.name}"

    def files(self) -> dict[str, str]:
        """The unit files by name."""
        unit = self.of
        program = unit.command[: unit.command.index("onboard")]
        command = (*program, "log", "send", str(unit.logs), "--by", self.by)
        is_disarmed = f"! systemctl show -P StatusText {unit.file} | grep -q '; armed, '"
        service = "\n\n".join(
            [
                f"# Sends the logs of {unit.name}. {CHANGES} systemctl edit {self.stem}.service",
                section("Unit", f"Description=Logs of {unit.name} to elsewhere", "After=network-online.target"),
                section(
                    "Service",
                    "Type=oneshot",
                    "# Nothing is sent while the vehicle is armed.",
                    f"ExecCondition=+/bin/sh -c {quoted(is_disarmed)}",
                    f"ExecStart={' '.join(quoted(word) for word in command)}",
                    "",
                    f"User={unit.user}",
                    f"Environment=HOME={unit.state}",
                    f"StateDirectory=gloc3/{unit.name}",
                    "StateDirectoryMode=0750",
                    f"LogsDirectory=gloc3/{unit.name}",
                    "LogsDirectoryMode=0750",
                    "",
                    "CPUWeight=1",
                    "Nice=19",
                    "IOSchedulingClass=idle",
                    "MemoryMax=25%",
                    "PrivateDevices=yes",
                    "DevicePolicy=closed",
                    HARDENING.format(home="tmpfs" if unit.homes else "yes").rstrip(),
                    f"BindReadOnlyPaths={' '.join(quoted(str(path)) for path in unit.homes)}" if unit.homes else "",
                )
                + "\n",
            ]
        )
        timer = "\n\n".join(
            [
                f"# When the logs of {unit.name} are sent. {CHANGES} systemctl edit {self.stem}.timer",
                section("Unit", f"Description=Logs of {unit.name} to elsewhere, every few minutes"),
                section("Timer", "OnBootSec=2min", "OnUnitInactiveSec=5min", "RandomizedDelaySec=30s"),
                "[Install]\nWantedBy=timers.target\n",
            ]
        )
        return {f"{self.stem}.service": service, f"{self.stem}.timer": timer}


def section(name: str, *lines: str) -> str:
    """A section of a unit file; empty lines part its groups, several in a row are one."""
    text = "\n".join(line.rstrip() for line in lines)
    return re.sub(r"\n{3,}", "\n\n", f"[{name}]\n{text}").rstrip()


def quoted(word: str) -> str:
    """A word of a unit file's command, quoted for systemd (systemd.service(5), Command lines)."""
    text = word.replace("%", "%%").replace("$", "$$")
    if _PLAIN.fullmatch(text):
        return text
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n").replace("\t", "\\t") + '"'


def command_of(text: str) -> tuple[str, ...]:
    """The program and its arguments in a unit file that `SystemdUnit` has written; empty where it has none."""
    for line in text.split("\n"):
        if line.startswith("ExecStart="):
            words = shlex.split(line.partition("=")[2])
            return tuple(word.replace("%%", "%").replace("$$", "$") for word in words)
    return ()


def user_of(text: str) -> str:
    """The user in a unit file that `SystemdUnit` has written; empty where it has none."""
    found = re.search(r"^User=(\S+)$", text, re.MULTILINE)
    return "" if found is None else found[1]
