"""The command `gloc3 doctor`: the pre-flight checks of a platform on the vehicle's computer, without flying."""

import asyncio
import os
import sys
from pathlib import Path
from typing import Annotated

import msgspec
from cyclopts import App, Parameter

from gloc3.cli.narration import narrate
from gloc3.documents.characters import printable
from gloc3.errors import Refused
from gloc3.messages.preflight import Check, summary, worst
from gloc3.platform.reader import find_platform, load_platform
from gloc3_onboard.cli.onboard_options import DEFAULT_AUTOPILOT, MOST_SYSTEM_ID

app = App(
    name="gloc3 doctor",
    help="""Look at a vehicle's computer and autopilot without flying: the same checks that every start has to pass, as
    far as they need no running components. Run it on the vehicle's computer while `gloc3 onboard` is not running.

    For example:

    - `gloc3 doctor pelican_rtk`: the simulated vehicle of `gloc3 sitl`
    - `gloc3 doctor my.yaml --autopilot serial:///dev/ttyACM0:57600 --json`

    Each line is ok, unknown, warning or red, with what was found and what to do. Nothing is changed: no parameter is
    written, nothing is armed. Exit codes: 0 nothing is red; 1 something is red; 2 wrong use; 130 interrupted.""",
    help_format="markdown",
    version_flags=[],
)


@app.default
def doctor(
    platform: str,
    /,
    *,
    autopilot: str = DEFAULT_AUTOPILOT,
    device: Annotated[list[str] | None, Parameter(negative=())] = None,
    out: Path | None = None,
    wait: float = 10.0,
    system_id: int = 1,
    json: Annotated[bool, Parameter(negative=())] = False,
) -> int:
    """Look at a vehicle's computer and autopilot without flying.

    Args:
        platform: A platform file, or the name of one that is installed, such as pelican.
        autopilot: Where the autopilot is: udpin://HOST:PORT, udpout://, tcpin://, tcpout:// or serial:///dev/PORT:BAUD.
        device: Where a sensor's data comes from, as NAME=URL; may be given again, as for gloc3 onboard.
        out: The folder that `gloc3 onboard` will write to; default: gloc3-PLATFORM here.
        wait: How long to listen to the autopilot, in seconds; it ends as soon as everything is known.
        system_id: The vehicle's MAVLink system.
        json: One JSON object a line on stdout, for scripts.
    """
    if not 0.0 < wait < float("inf"):
        raise Refused("--wait must be above 0 seconds")
    if not 1 <= system_id <= MOST_SYSTEM_ID:
        raise Refused(f"--system-id must be from 1 to {MOST_SYSTEM_ID}; those above are stations'")
    from gloc3.mavlink.transport.endpoints import parse_url
    from gloc3_onboard.cli.doctor_run import DoctorOptions, examine

    parse_url(autopilot)
    known = load_platform(platform, is_loading_classes=True, warn=lambda found: narrate(str(found)))
    folder = find_platform(platform).parent
    devices = tuple(device or ())
    question = DoctorOptions(known, autopilot, out or Path(f"gloc3-{known.platform}"), wait, system_id, folder, devices)
    checks = asyncio.run(examine(question))
    for check in checks:
        print(_json(check) if json else _line(check, is_coloured=sys.stdout.isatty()))  # noqa: T201
    narrate(f"{known.platform}: {summary(checks)}")
    return 1 if worst(checks) == "red" else 0


def _json(check: Check) -> str:
    fields = {name: getattr(check, name) for name in check.__struct_fields__}
    return msgspec.json.encode(fields).decode()


def _line(check: Check, *, is_coloured: bool) -> str:
    text = f"{check.verdict:<8} {check.title}: {check.finding}" + (
        f"\n         -> {check.advice}" if check.advice else ""
    )
    text = printable(text)
    codes = {"red": "31;1", "warning": "33", "unknown": "2"}
    code = codes.get(check.verdict)
    return f"\x1b[{code}m{text}\x1b[0m" if is_coloured and code and not os.environ.get("NO_COLOR") else text
