"""The command `gloc3 demo`: what `make demo` runs."""

import asyncio
import sys
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from gloc3.cli.narration import narrate
from gloc3.errors import InputError, NotFound

app = App(
    name="gloc3 demo",
    help="""Fly a mission with three real processes on this machine: the simulated vehicle, the onboard companion process
    and the ground station, over UDP on loopback. On a terminal the station shows its screens, otherwise it narrates.

    For example:

    - `gloc3 demo`: the inspection of a cargo hold
    - `gloc3 demo --platform pelican`: the same without satellites, by its own cameras and laser scanner
    - `gloc3 demo survey --platform boat`: a survey on the water; also with rover and auv
    - `gloc3 demo my.plan --out runs/mine`: a QGroundControl plan, at its own place on Earth

    The folder of --out holds log.mcap (opens in Foxglove), truth.mcap, report.json, path.svg, images and the
    processes' output. Exit codes: 0 done; 1 the mission failed or did not pass the check; 2 wrong use; 130 interrupted.""",
    help_format="markdown",
    usage="gloc3 demo [OPTIONS] [MISSION]",
    version_flags=[],
)


@app.default
def demo(
    mission: str = "inspection",
    /,
    *,
    platform: str | None = None,
    autopilot: Literal["px4", "ardupilot"] | None = None,
    firmware: Literal["ardupilot", "px4"] | None = None,
    out: Path = Path("runs/demo"),
    headless: Annotated[bool, Parameter(negative=())] = False,
) -> int:
    """Fly a mission with three real processes.

    Args:
        mission: A mission file (.yaml, .plan, WPL), or an example by its name.
        platform: A platform file, or the name of an installed platform; by default the one that the mission names, or
            the Pelican, with a satellite receiver if the mission is on Earth.
        autopilot: Style of the simulated autopilot; by default the vehicle's usual one.
        firmware: Real firmware instead, whose program must be on PATH; see docs/firmware.md.
        out: Folder for all files of the flight; those of an earlier flight are replaced.
        headless: Narrate even on a terminal.
    """
    from gloc3.platform.reader import load_platform
    from gloc3_sitl.demo.demo import DemoOptions, run_demo
    from gloc3_sitl.flight.mission_file import find_file, platform_for
    from gloc3_sitl.vehicles.table import style_of, vehicle_of

    path = find_file(mission)
    platform = platform or platform_for(path)
    known = load_platform(platform, is_loading_classes=True)
    is_terminal = all(stream.isatty() for stream in (sys.stdin, sys.stdout, sys.stderr) if stream is not None)
    options = DemoOptions(
        mission=path,
        platform=platform,
        autopilot=firmware or style_of(vehicle_of(known), autopilot),
        is_firmware=firmware is not None,
        out=out,
        is_headless=headless or not is_terminal or sys.stdin is None,
    )
    try:
        return asyncio.run(run_demo(options, known))
    except NotFound:
        raise
    except InputError as error:
        narrate(f"{error}\nthe mission did not pass the check")
        return 1
