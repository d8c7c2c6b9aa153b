"""`gloc3 fly`: a mission flown in simulation, everything in one process, in virtual time."""

import asyncio
import sys
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from gloc3.clock import Clock, run_virtual
from gloc3.errors import Gloc3Error, InputError
from gloc3_sitl.wind import CALM, gusty

app = App(
    name="fly",
    help="Fly a mission in simulation: simulator, onboard process, ground station and their links in one process, "
    "in virtual time, as fast as the machine can. The same seed gives the same flight, bit for bit.",
    version_flags=[],
)

EXIT_DONE, EXIT_FAILED, EXIT_WRONG_USE = 0, 1, 2


@app.default
def fly(
    mission: str,
    /,
    *,
    platform: str = "pelican",
    autopilot: Literal["px4", "ardupilot"] = "px4",
    seed: int = 0,
    wind: float = 0.0,
    fault: Annotated[list[str], Parameter(negative=())] | None = None,
    out: Path | None = None,
    json: Annotated[bool, Parameter(negative=())] = False,
    quiet: Annotated[bool, Parameter(negative=())] = False,
) -> int:
    """Fly a mission to its end and report.

    Exit codes: 0 done, 1 the mission or its check failed, 2 wrong use.

    Parameters
    ----------
    mission
        A mission file (.yaml, .plan, WPL), or an example by its name: hop, inspection, patrol.
    platform
        A platform file, or the name of one that is installed.
    autopilot
        The style of the simulated autopilot.
    seed
        Of all chance: sensor noise, turbulence, links, boot numbers.
    wind
        Mean wind in m/s from the west, gusty; 0 is calm air.
    fault
        Something that goes wrong, such as `link_loss@30..60`; may be given several times.
    out
        Folder for log.mcap, path.svg, report.json and images; without it nothing is kept.
    json
        The report on stdout as JSON.
    quiet
        No narration on stderr.
    """
    from gloc3_sitl.fly import FlyOptions, fly_mission

    options = FlyOptions(
        mission=mission,
        platform=platform,
        autopilot=autopilot,
        seed=seed,
        wind=gusty(wind, from_deg=270.0) if wind > 0.0 else CALM,
        faults=tuple(fault or ()),
        out=out,
    )
    begin_s = Clock.cost_s()
    try:
        report = run_virtual(fly_mission(options, None if quiet else _narrate, begin_s))
    except InputError as error:
        for finding in error.findings:
            print(finding, file=sys.stderr)  # noqa: T201
        return EXIT_FAILED
    except Gloc3Error as error:
        print(f"gloc3 fly: {error}", file=sys.stderr)  # noqa: T201
        return EXIT_FAILED
    except (KeyboardInterrupt, asyncio.CancelledError):
        print("gloc3 fly: interrupted", file=sys.stderr)  # noqa: T201
        return 130
    from gloc3_sitl.flight_report import as_json, as_lines

    if json:
        sys.stdout.write(as_json(report).decode())
    else:
        print("\n".join(as_lines(report)))  # noqa: T201
    return EXIT_DONE if report.mission_state == "done" else EXIT_FAILED


def _narrate(line: str) -> None:
    print(line, file=sys.stderr)  # noqa: T201
