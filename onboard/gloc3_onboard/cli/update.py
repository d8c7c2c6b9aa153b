"""The command `gloc3 update`: changes the version that the services of a computer run, and goes back."""

import asyncio
import signal
from collections.abc import Coroutine
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

from cyclopts import App, Parameter

from gloc3.cli.narration import narrate
from gloc3.errors import Refused
from gloc3_onboard.service.environments import HOME, Environments

if TYPE_CHECKING:
    from gloc3_onboard.service.update import Update

MOST_WAIT_S: Final = 3600.0

Flag = Annotated[bool, Parameter(negative=())]

app = App(
    name="gloc3 update",
    help="""Install another version beside the one in use, check it with the options of this computer's services, switch
    to it, and restart the services. If one does not come up as it was, everything goes back to the version before.

    For example, with sudo:

    - `gloc3 update`: lists the versions and the services that run them
    - `gloc3 update gloc3-0.2.0-py3-none-any.whl`: a wheel; its requirements come from the package index, or from the
      folder of --wheels
    - `gloc3 update ./gloc3-0.2.0_0.2.0+debian12_arm64.deb`: a Debian package, without a network
    - `gloc3 update 0.2.0`: a version that is installed, or else is on the package index
    - `gloc3 update --back`: the version before

    A file is compared with SHA256SUMS beside it; if there are keys in /opt/gloc3/allowed_signers, one must have signed that.

    A service whose vehicle is armed, or does not say whether it is, is not restarted, and nothing changes. Keep the
    vehicle on the ground until the command ends. docs/install.md explains the folders. Exit codes: 0 the version is in
    use; 1 it did not work, and the version before is in use again; 2 refused, nothing has changed; 130 interrupted, and
    the version before is in use again.""",
    help_format="markdown",
    usage="gloc3 update [OPTIONS] [WHEEL|PACKAGE|VERSION]",
    version_flags=[],
)


@app.default
def update(
    what: str = "",
    /,
    *,
    back: Flag = False,
    wheels: Path | None = None,
    extras: str = "gpio,groundstation,laser",
    within: float = 120.0,
    force: Flag = False,
    home: Path = HOME,
) -> int:
    """Install and use another version, or list the versions.

    Args:
        what: A wheel, a Debian package or a version; without it the versions are listed.
        back: Use the version before.
        wheels: Folder with the wheels of all requirements; nothing is fetched from the package index then.
        extras: What a new environment gets beside the plain installation, with commas between; "" for nothing.
        within: Time for all services to come up as they were, in seconds.
        force: Also restart a service that does not say whether its vehicle is disarmed.
        home: Folder of the versions.
    """
    from gloc3_onboard.service.update import Systemctl, Update

    if not 0.0 < within <= MOST_WAIT_S:
        raise Refused(f"--within must be above 0 and at most {MOST_WAIT_S:g} seconds")
    if back and what:
        raise Refused(f"--back takes no version: it is the one before, not {what}")
    environments = Environments(home, narrate)
    change = Update(environments, Systemctl(), narrate)
    if not what and not back:
        return _list(environments, change)
    with environments.locked():
        if back and not environments.previous:
            raise Refused(f"there is no version before the one in use in {home}")
        named = [one.strip() for one in extras.split(",") if one.strip()]
        version = environments.previous if back else environments.bring(what, wheels, named)
        for unit in change.others:
            narrate(f"{unit} runs another program; {home}/current/bin/gloc3 onboard install … changes that")
        change.check(version, is_forced=force)
        # a lost connection to this computer, such as of SSH, does not end an update half-way
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        return 0 if asyncio.run(_interruptible(change.switch(version, within))) else 1


async def _interruptible(switch: Coroutine[Any, Any, bool]) -> bool:
    """Has SIGTERM cancel the switch, as Ctrl-C does, so that it goes back."""
    task = asyncio.ensure_future(switch)
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, task.cancel)
    try:
        return await task
    except asyncio.CancelledError:
        raise KeyboardInterrupt from None


def _list(environments: Environments, change: "Update") -> int:
    if not environments.versions:
        print(f"no version is installed in {environments.home}; docs/install.md shows how")  # noqa: T201
    for version in environments.versions:
        notes = {environments.current: "  in use", environments.previous: "  before"}
        print(f"{version}{notes.get(version, '')}")  # noqa: T201
    for unit, status in change.states():
        print(f"{unit}: {status}")  # noqa: T201
    for unit in change.others:
        print(f"{unit}: runs another program")  # noqa: T201
    return 0
