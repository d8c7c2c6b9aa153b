"""`gloc3 onboard install` and `uninstall`: the onboard process as a service of systemd."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from cyclopts import Parameter

from gloc3.cli.narration import narrate
from gloc3_onboard.cli.onboard_options import Flag, OnboardOptions

ROOT: Final = Path("/")
DEFAULTS: Final = OnboardOptions()


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ServiceOptions:
    """What the service is, one option for each field."""

    user: str = "gloc3"
    """Whose service it is; made if there is none."""
    udev: Flag = False
    """Also write rules of udev that give the cameras and serial lines that are plugged in names that stay."""
    cpus: str = ""
    """Which processors the service may use, such as 2-3; default: all."""
    send_logs: str = ""
    """The command that sends a log elsewhere, such as "rclone copy {} remote:logs"; {} is the file. Every five minutes while
    the vehicle is disarmed, what is complete and was not sent yet is sent (`gloc3 log send`)."""


THE_USUAL: Final = ServiceOptions()


def install(
    platform: str,
    /,
    *,
    options: OnboardOptions = DEFAULTS,
    service: ServiceOptions = THE_USUAL,
    dry_run: Flag = False,
    prefix: Path = ROOT,
) -> int:
    """Install the onboard process as a service of systemd: a hardened unit that starts with the computer.

    It takes the options of `gloc3 onboard`, checks all of them, and writes them into the unit: the service reads no
    environment. Run it with sudo. Then: `systemctl enable --now gloc3-PLATFORM`, `journalctl -fu gloc3-PLATFORM`,
    and after a change of the platform file `systemctl reload gloc3-PLATFORM`.

    Args:
        platform: A platform file, or the name of one that is installed, such as pelican.
        options: How.
        service: As what.
        dry_run: Print what would be written; change nothing.
        prefix: Write below this folder, for the disk of another computer.
    """
    from gloc3_onboard.service.install import carry_out, make_plan

    plan = make_plan(platform, options, service.user, with_udev=service.udev, cpus=service.cpus)
    if service.send_logs:
        plan = plan.sending_logs(service.send_logs)
    if dry_run:
        for path, text in plan.files(prefix).items():
            print(f"# {path}\n{text}")  # noqa: T201
    else:
        carry_out(plan, prefix, narrate)
    for text in plan.advice:
        narrate(text)
    if not dry_run:
        timer = "" if plan.sender is None else f" {plan.sender.stem}.timer"
        narrate(f"to start it now and with the computer: systemctl enable --now {plan.unit.file}{timer}")
    return 0


def uninstall(name: str, /, *, prefix: Path = ROOT) -> int:
    """End and remove a service that `gloc3 onboard install` has made; its state and logs stay.

    Args:
        name: The platform's name, or PLATFORM-HOST of one of several hosts, as in gloc3-NAME.service.
        prefix: Below which folder it was written.
    """
    from gloc3_onboard.service.install import remove

    remove(name, prefix, narrate)
    return 0
