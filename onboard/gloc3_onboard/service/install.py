"""Installation of `gloc3 onboard` as a systemd service: makes the plan, and carries it out."""

import grp
import os
import pwd
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from gloc3.clock import utc_now
from gloc3.errors import Finding, Refused
from gloc3.log.sending import words_of
from gloc3.network.file import read_network
from gloc3.platform.places import choose_host
from gloc3.platform.platform import Platform
from gloc3.platform.reader import files_of, find_platform, load_platform
from gloc3.store import replace_file
from gloc3_onboard.cli.onboard_options import OnboardOptions
from gloc3_onboard.hosts.shared import check_member
from gloc3_onboard.process.process import DEVICES
from gloc3_onboard.sensors.rig import PlatformRig
from gloc3_onboard.sensors.source_url import SERIAL_GROUP
from gloc3_onboard.service.environments import CURRENT
from gloc3_onboard.service.needs import DeviceNode, allowed, arguments, homes, keys, modules, nodes
from gloc3_onboard.service.unit import LogSender, SystemdUnit

SYS: Final = Path("/sys")
FOLDER: Final = "gloc3"
"""Of the names that the rules give, below /dev."""
STEADY: Final = ("/dev/serial/", "/dev/v4l/", f"/dev/{FOLDER}/")
"""Device names that do not depend on the order of plugging in."""


class UsbDevice(NamedTuple):
    """Properties that a USB device reports."""

    subsystem: str
    vendor: str
    product: str
    serial: str
    """Its serial number; empty for one that has none."""
    interface: str
    """Number of the interface of a device with several."""
    node_index: str
    """Of a camera's nodes: 0 is the one with pictures."""
    port: str
    """The kernel's name of where it is plugged in."""
    title: str


def usb_device(node: DeviceNode, sys: Path = SYS) -> UsbDevice | None:
    """USB device behind a device node; None if unplugged or not on USB.

    Args:
        node: the device.
        sys: Linux's device tree.
    """
    subsystem = "tty" if node.group == SERIAL_GROUP else "video4linux"
    entry = sys / "class" / subsystem / node.path.resolve().name
    if not entry.exists():
        return None
    interface = ""
    for folder in entry.resolve().parents:
        interface = interface or _read(folder / "bInterfaceNumber")
        if vendor := _read(folder / "idVendor"):
            title = " ".join(filter(None, (_read(folder / "manufacturer"), _read(folder / "product"))))
            product, serial = _read(folder / "idProduct"), _read(folder / "serial")
            index = _read(entry / "index") if subsystem == "video4linux" else ""
            return UsbDevice(subsystem, vendor, product, serial, interface, index, folder.name, title)
    return None


def rule(role: str, device: UsbDevice) -> str:
    """The udev rule that names a device by its serial number, or else by its port."""
    matches = [f'SUBSYSTEM=="{device.subsystem}"']
    matches += [f'ENV{{ID_VENDOR_ID}}=="{device.vendor}"', f'ENV{{ID_MODEL_ID}}=="{device.product}"']
    if _is_unique(device.serial):
        matches.append(f'ENV{{ID_SERIAL_SHORT}}=="{device.serial}"')
    else:
        matches.append(f'KERNELS=="{device.port}"')
    if device.interface:
        matches.append(f'ENV{{ID_USB_INTERFACE_NUM}}=="{device.interface}"')
    if device.node_index:
        matches.append(f'ATTR{{index}}=="{device.node_index}"')
    sets = [f'SYMLINK+="{FOLDER}/{role}"']
    if device.subsystem == "tty":
        sets.append('ENV{ID_MM_DEVICE_IGNORE}="1"')
    how = "by its serial number" if _is_unique(device.serial) else "by its USB port: it has no serial number of its own"
    return f"# {device.title or 'a device'}, {how}\n" + ", ".join([*matches, *sets])


def _is_unique(serial: str) -> bool:
    """Whether a serial number is valid in a rule and distinguishes devices of one make."""
    return re.fullmatch(r"[A-Za-z0-9_.:-]{4,}", serial) is not None and len(set(serial)) > 1


def rules(name: str, devices: Sequence[tuple[DeviceNode, UsbDevice]]) -> str:
    """The file of rules of a service."""
    lines = [f"# Steady names for the devices of {name}; written by gloc3 onboard install --udev"]
    lines += ["# (ttys are marked as no modems: ModemManager would talk to the autopilot)"]
    return "\n".join([*lines, *(rule(node.role, device) for node, device in devices)]) + "\n"


def advice(node: DeviceNode, device: UsbDevice | None) -> str:
    """What to say of a device that is named by the order of plugging in; empty where all is well."""
    if str(node.path).startswith(STEADY) or not node.kinds:
        return ""
    if device is None:
        return f"{node.path} is not plugged in: plug it in and install again with --udev for a stable name"
    return (
        f"{node.path} ({device.title or 'a device'}) may get another name at the next boot: --udev names it "
        f"/dev/{FOLDER}/{node.role}"
    )


def _read(file: Path) -> str:
    try:
        return file.read_text(errors="replace").strip()
    except OSError:
        return ""


USER: Final = re.compile(r"[a-z_][a-z0-9_-]{0,31}")
"""Of useradd."""
CPUS: Final = re.compile(r"(\d{1,4}(-\d{1,4})?(,\d{1,4}(-\d{1,4})?)*)?")
"""Of systemd's `CPUAffinity`."""
UNITS: Final = Path("etc/systemd/system")
RULES: Final = Path("etc/udev/rules.d")
ROOT: Final = Path("/")

Report = Callable[[str], None]


class InstallPlan(msgspec.Struct, frozen=True, kw_only=True):
    """Files to be written."""

    unit: SystemdUnit
    rules: str = ""
    """For udev; empty for none."""
    sender: LogSender | None = None
    """Sends its logs elsewhere; None where they stay."""
    advice: tuple[str, ...] = ()
    """Advice for people."""

    def sending_logs(self, by: str) -> "InstallPlan":
        """The same, with logs sent elsewhere by a command, as for `gloc3 log send`.

        Raises:
            Refused: it is no command.
        """
        words_of(by)
        return msgspec.structs.replace(self, sender=LogSender(of=self.unit, by=by))

    def files(self, prefix: Path) -> dict[Path, str]:
        """Every file with its content."""
        found = {prefix / UNITS / self.unit.file: self.unit.text()}
        if self.sender is not None:
            found |= {prefix / UNITS / name: text for name, text in self.sender.files().items()}
        if self.rules:
            found[prefix / RULES / rules_file(self.unit.name)] = self.rules
        return found


def rules_file(name: str) -> str:
    """File name of a service's udev rules; sorted after the rules that identify devices."""
    return f"90-gloc3-{name}.rules"


def make_plan(
    name: str,
    options: OnboardOptions,
    user: str,
    *,
    with_udev: bool = False,
    cpus: str = "",
    sys_folder: Path = SYS,
) -> InstallPlan:
    """Checks the service's needs, and makes the installation plan.

    Args:
        name: platform name or file.
        options: options of the process.
        user: user of the service.
        with_udev: whether devices get persistent names.
        cpus: processors that the service may use, such as 2-3; empty for all.
        sys_folder: Linux's device tree.

    Raises:
        InputError: the platform file has errors.
        Refused: an option is not possible, or a service cannot read a file.
    """
    options.check()
    if not USER.fullmatch(user):
        raise Refused(f"--user {user!r} is not a user name: lower-case letters, digits, _ and -, a letter or _ first")
    if not CPUS.fullmatch(cpus):
        raise Refused(f"--cpus {cpus!r} names no processors; give numbers from 0 and ranges, such as 2-3 or 0,2")
    for option, value in (("--out", options.out), ("--logs", options.logs)):
        if value is not None:
            raise Refused(f"{option}: a service has its folders below /var/lib/gloc3 and /var/log/gloc3")
    warnings: list[Finding] = []
    platform = load_platform(name, is_loading_classes=True, devices=DEVICES, warn=warnings.append)
    host, file = choose_host(platform, options.host), find_platform(name).absolute()
    network = _network(platform, host, options.network)
    warnings += PlatformRig(platform, file.parent).warnings
    found = nodes(platform, options)
    behind = {node: usb_device(node, sys_folder) for node in found}
    named = [(node, device) for node, device in behind.items() if device is not None] if with_udev else []
    if with_udev:
        options = _renamed(options, platform, [node for node, _ in named])
    tiles = [] if options.terrain is None else [options.terrain.expanduser().absolute()]
    secrets, files = [*keys(options), *network, *tiles], [path.absolute() for path in files_of(file)]
    word = str(file) if file.suffix in (".yaml", ".yml") and Path(name).suffix else name
    unit = SystemdUnit(
        name=platform.platform if options.host is None else f"{platform.platform}-{host}",
        command=(*_program(), "onboard", word, *arguments(options)),
        user=user,
        groups=tuple(dict.fromkeys(node.group for node in found)),
        devices=allowed(found),
        modules=modules(found),
        is_real_time=options.real_time,
        cpus=cpus,
        homes=homes([*files, *secrets] if word != name or Path(name).suffix else secrets),
        network=network[0].parent if network else None,
    )
    said = [str(one) for one in warnings]
    said += [text for node, device in behind.items() if (node, device) not in named and (text := advice(node, device))]
    said += [text for path in [*files, *secrets] if (text := _unreadable(path, user))]
    return InstallPlan(unit=unit, rules=rules(unit.name, named) if named else "", advice=tuple(said))


def _network(platform: Platform, host: str, path: Path | None) -> list[Path]:
    """The network file and the files that it names, once it is known to be right."""
    member = None if path is None else read_network(path.expanduser().absolute(), utc_now())
    check_member(platform, host, member)
    if member is None:
        return []
    own = member.file
    named = (own.certificate, own.key, own.authority, own.rights, own.revocations)
    return [member.path, *(member.path.parent / one for one in named if one)]


def _program() -> tuple[str, ...]:
    """This program, as a unit names it: of several versions by the link to the one in use, which updates change."""
    current = Path(sys.prefix).parent / CURRENT
    in_use = current if current.is_symlink() and current.resolve() == Path(sys.prefix).resolve() else None
    script = (in_use / "bin" if in_use else Path(sys.executable).parent) / "gloc3"
    return (str(script),) if script.exists() else (sys.executable, "-m", "gloc3")


def _renamed(options: OnboardOptions, platform: Platform, named: list[DeviceNode]) -> OnboardOptions:
    """The options with udev's device names."""
    roles = {node.role: str(node.path) for node in named}

    def renamed(role: str, text: str) -> str:
        return text.replace(roles[role], f"/dev/{FOLDER}/{role}", 1) if role in roles else text

    stations = [
        renamed("station" if number == 1 else f"station_{number}", url) for number, url in enumerate(options.station, 1)
    ]
    requested = dict(text.split("=", 1) for text in options.device)
    given = {**platform.devices, **requested}
    devices = {role: renamed(role, given[role]) for role in given if role in requested or role in roles}
    return replace(
        options,
        autopilot=renamed("autopilot", options.autopilot),
        station=stations,
        device=[f"{role}={url}" for role, url in devices.items()],
    )


def _unreadable(path: Path, user: str) -> str:
    """Reason why the user cannot read a file, by its mode; empty if readable."""
    try:
        status = path.stat()
        own = pwd.getpwnam(user)
    except OSError as error:
        return f"{path}: {error.strerror or error}"
    except KeyError:
        is_his = is_groups = False
    else:
        groups = [own.pw_gid, *(group.gr_gid for group in grp.getgrall() if user in group.gr_mem)]
        is_his, is_groups = status.st_uid == own.pw_uid, status.st_gid in groups
    if status.st_mode & (0o400 if is_his else 0o040 if is_groups else 0o004):
        return ""
    return f"{user} cannot read {path}: chown {user} {path}"


def carry_out(plan: InstallPlan, prefix: Path, report: Report) -> None:
    """Writes the files; on this computer also creates the user and reloads systemd and udev.

    Args:
        plan: the installation plan.
        prefix: root folder; other than / for another computer's disk.
        report: called with each step.

    Raises:
        Refused: not possible, for example without permission.
    """
    for path, text in plan.files(prefix).items():
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            replace_file(path, text.encode())
        except PermissionError as error:
            raise Refused(f"{path} cannot be written: {error.strerror}; run it with sudo, or with --dry-run") from error
        report(f"wrote {path}")
    if prefix != ROOT:
        report(f"the user {plan.unit.user} is not made: {prefix} is not this computer")
        return
    _make_user(plan.unit.user, report)
    _recheck(report, has_rules=bool(plan.rules))


def remove(name: str, prefix: Path, report: Report) -> None:
    """Ends and removes a service; its state, logs and user stay.

    Raises:
        Refused: there is none of that name, or it cannot be removed.
    """
    unit = prefix / UNITS / f"gloc3-{name}.service"
    if not unit.exists():
        known = sorted(path.stem.removeprefix("gloc3-") for path in unit.parent.glob("gloc3-*.service"))
        raise Refused(f"there is no service {name!r}; installed: {', '.join(known) or 'none'}")
    senders = [unit.with_name(f"send-{unit.stem}{suffix}") for suffix in (".timer", ".service")]
    if prefix == ROOT and _has_systemd():
        for timer in senders[:1]:
            if timer.exists():
                _run(["systemctl", "disable", "--now", timer.name], report)
        _run(["systemctl", "disable", "--now", unit.name], report)
    has_rules = False
    for path in (unit, *senders, prefix / RULES / rules_file(name)):
        try:
            path.unlink()
        except FileNotFoundError:
            continue
        except PermissionError as error:
            raise Refused(f"{path} cannot be removed: {error.strerror}; run it with sudo") from error
        has_rules = has_rules or path.suffix == ".rules"
        report(f"removed {path}")
    if prefix == ROOT:
        _recheck(report, has_rules=has_rules)
    report(f"its state and logs stay in /var/lib/gloc3/{name} and /var/log/gloc3/{name}")


def _has_systemd() -> bool:
    """Whether systemd runs this computer (sd_booted(3))."""
    return Path("/run/systemd/system").is_dir() and shutil.which("systemctl") is not None


def _make_user(user: str, report: Report) -> None:
    try:
        pwd.getpwnam(user)
    except KeyError:
        options = ["--system", "--user-group", "--no-create-home", "--home-dir", "/nonexistent"]
        _run(["useradd", *options, "--shell", "/usr/sbin/nologin", user], report)


def _recheck(report: Report, *, has_rules: bool) -> None:
    if _has_systemd():
        _run(["systemctl", "daemon-reload"], report)
    if has_rules and shutil.which("udevadm") is not None and Path("/run/udev").is_dir():
        _run(["udevadm", "control", "--reload"], report)
        _run(["udevadm", "trigger", "--subsystem-match=tty", "--subsystem-match=video4linux"], report)


def _run(command: list[str], report: Report) -> None:
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, "LC_ALL": "C"})
    except OSError as error:
        raise Refused(f"{' '.join(command)}: {error.strerror or error}") from error
    if done.returncode != 0:
        raise Refused(f"{' '.join(command)}: {done.stderr.strip() or f'exit code {done.returncode}'}")
    report(" ".join(command))
