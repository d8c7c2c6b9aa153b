"""The command `gloc3 onboard`: the companion process of a platform, in wall time, until it is told to stop."""

import asyncio
import sys
from collections.abc import Callable
from math import inf
from pathlib import Path
from typing import Annotated, Final

from cyclopts import App, Parameter

from gloc3.errors import Refused

DEFAULT_AUTOPILOT: Final = "udpin://0.0.0.0:14540"
DEFAULT_STATION: Final = "udpout://127.0.0.1:14550"
MOST_SYSTEM_ID: Final = 250

app = App(
    name="gloc3 onboard",
    help="""Run the onboard companion process of a platform: its components, the link to the autopilot, and the links to
    ground stations, until Ctrl-C or SIGTERM.

    For example:

    - `gloc3 onboard pelican_rtk`: with the simulated vehicle of `gloc3 sitl` on the same machine
    - `gloc3 onboard my.yaml --autopilot serial:///dev/ttyACM0:57600 --station udpout://192.168.1.10:14550`
    - `gloc3 onboard my.yaml --device ground_camera=v4l2:///dev/video0 --device laser=rplidar:///dev/ttyUSB0`

    It passes MAVLink on between the autopilot and all stations, so that QGroundControl and others reach the autopilot
    through it. Its log, every MAVLink frame, pictures and what must survive a restart go to the folder of --out.""",
    help_format="markdown",
    version_flags=[],
)


@app.default
def onboard(
    platform: str,
    /,
    *,
    autopilot: str = DEFAULT_AUTOPILOT,
    station: Annotated[list[str] | None, Parameter(negative=())] = None,
    device: Annotated[list[str] | None, Parameter(negative=())] = None,
    out: Path | None = None,
    system_id: int = 1,
    signing_key: Path | None = None,
    take_plans: Annotated[bool, Parameter(negative=())] = False,
    log_size: float = 500.0,
    log_total: float = 10_000.0,
    quiet: Annotated[bool, Parameter(negative=())] = False,
) -> int:
    """Run the onboard companion process.

    Args:
        platform: A platform file, or the name of one that is installed, such as pelican.
        autopilot: Where the autopilot is: udpin://HOST:PORT, udpout://, tcpin://, tcpout:// or serial:///dev/PORT:BAUD;
            with :auto as BAUD the rate is found. ?key=FILE behind it signs the link with that key.
        station: Where ground stations are; may be given again. Default: udpout://127.0.0.1:14550. Behind it
            ?rate=BIT_S tells what a radio on the way carries, and ?key=FILE (or &key=FILE) goes before --signing-key.
        device: Where a sensor's data comes from, as NAME=URL, such as ground_camera=v4l2:///dev/video0; may be given
            again. It goes before what the platform file says. docs/sensors.md lists the URLs.
        out: Folder for the log, pictures and state; default: gloc3-PLATFORM here.
        system_id: The vehicle's MAVLink system; this process is component 191 of it.
        signing_key: A file with the MAVLink signing key of the links to ground stations, which nobody else may read: 64
            hexadecimal digits, or `passphrase: ...`; the stations have the same. Then frames without its signature are
            dropped and told.
        take_plans: Plans that ground stations of others (QGroundControl, say) send to the autopilot become missions of
            this process, and do not reach the autopilot. Without it they become missions only when sent to component 191.
        log_size: A log of more megabytes is followed by the next file of the run; 0 for no limit.
        log_total: Beyond so many megabytes of logs in the folder the oldest are deleted, never the one that is being
            written, and no pictures; 0 to keep all.
        quiet: No narration on stderr.
    """
    if not 1 <= system_id <= MOST_SYSTEM_ID:
        raise Refused(f"--system-id must be from 1 to {MOST_SYSTEM_ID}; those above are stations'")
    for name, value in (("--log-size", log_size), ("--log-total", log_total)):
        if not 0.0 <= value < inf:
            raise Refused(f"{name} must be 0 or more megabytes")
    from gloc3.link.endpoints import parse_url
    from gloc3.link.signing_key import read_signing_key
    from gloc3_onboard.process import ProcessOptions, run
    from gloc3_onboard.run_log import LogLimits

    for url in (autopilot, *(station or ())):
        parse_url(url)
    options = ProcessOptions(
        platform=platform,
        autopilot=autopilot,
        stations=tuple(station or (DEFAULT_STATION,)),
        devices=tuple(device or ()),
        out=out,
        system_id=system_id,
        is_quiet=quiet,
        takes_plans=take_plans,
        log_limits=LogLimits(file_mb=log_size, total_mb=log_total),
        signing_key=None if signing_key is None else read_signing_key(signing_key.expanduser()),
    )
    with asyncio.Runner(loop_factory=_loop_factory()) as runner:
        return runner.run(run(options))


def _loop_factory() -> Callable[[], asyncio.AbstractEventLoop] | None:
    """The loop that passes frames on promptly, where there is one."""
    if sys.platform != "linux":
        return None
    from gloc3.link.prompt_loop import PromptLoop

    return PromptLoop
