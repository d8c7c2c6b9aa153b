"""The command `gloc3 demo`: what `make demo` runs."""

import asyncio
import sys
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from gloc3.errors import InputError

app = App(
    name="gloc3 demo",
    help="""Fly a mission with three real processes on this machine: the simulated vehicle, the onboard companion process
    and the ground station, over UDP on loopback. On a terminal the station shows its screen, otherwise it narrates.
    The log, the report, the pictures and the path are left in the folder of --out, which is made anew.""",
    version_flags=[],
)


@app.default
def demo(
    mission: str = "inspection",
    /,
    *,
    autopilot: Literal["px4", "ardupilot"] = "px4",
    out: Path = Path("runs/demo"),
    headless: Annotated[bool, Parameter(negative=())] = False,
) -> int:
    """Fly a mission with three real processes.

    Args:
        mission: A mission file (.yaml, .plan, WPL), or an example by its name.
        autopilot: The style of the simulated autopilot.
        out: Folder for everything that the flight leaves.
        headless: Narrate, also on a terminal.
    """
    from gloc3_sitl.demo import DemoOptions, run_demo

    is_terminal = all(stream.isatty() for stream in (sys.stdin, sys.stdout, sys.stderr))
    options = DemoOptions(mission=mission, out=out, autopilot=autopilot, is_headless=headless or not is_terminal)
    try:
        return asyncio.run(run_demo(options))
    except InputError as error:
        print(f"{error}\nthe mission did not pass the check", file=sys.stderr)  # noqa: T201
        return 1
