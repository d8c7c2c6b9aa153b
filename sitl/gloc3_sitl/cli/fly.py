"""`gloc3 fly`: a mission flown in simulation, everything in one process, in virtual time."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, Literal

from cyclopts import App, Parameter

from gloc3.cli.narration import narrate
from gloc3.clock import Clock, run_virtual
from gloc3.errors import InputError, NotFound, Refused
from gloc3_sitl.physics.wind import CALM, gusty

EXIT_DONE: Final = 0
EXIT_FAILED: Final = 1
MOST_WIND_M_S: Final = 30.0

app = App(
    name="gloc3 fly",
    help="""Fly a mission in simulation: simulator, onboard process, ground station and their links in one process, in
    virtual time, as fast as the machine can. The same seed gives the same flight, bit for bit.

    For example:

    - `gloc3 fly hop`: the shortest example mission
    - `gloc3 fly inspection --out runs/inspection`: writes log.mcap, report.json, path.svg and images there
    - `gloc3 fly my.plan --autopilot ardupilot --wind 6 --seed 7 --json`
    - `gloc3 fly survey --platform boat --waves 0.3 --current 0.2 --wind 5`: also with `--platform rover`
    - `gloc3 fly patrol --fault link_loss@30..60 --fault crash:limiter@80`

    Faults are written KIND[:TARGET][=VALUE[/SIZE]][@BEGIN[..[END]]], with times in seconds of the flight:

    - `link_loss`, `cable_loss`: loss on the station's radio or the autopilot's cable; `=SHARE` for some of the messages;
      `link_slow=SECONDS`, `cable_slow=SECONDS`, `link_twice`, `cable_twice`: they are late, or come twice
    - `wind=SPEED/FROM`, `current=SPEED/TOWARDS`, `motor:NUMBER=SHARE`, `battery=SHARE`, `sensor:NAME=lost|stuck|biased|noisy|late|old`
    - `device:NAME=lost|stuck|late|old|scaled|step|garbage`…: cameras (`black`, `white`, `torn`…), laser scanner, external
      tracker (`dark`, `twin`), `imu`
    - `crash:COMPONENT`, `hang:COMPONENT`, `slow:COMPONENT=SECONDS`, `leak:COMPONENT=SECONDS` (each cycle takes longer
      than the one before), `restart` of the onboard process, `disk_full`, `clock_jump=SECONDS`
    - `operator:pause|resume|skip|abort|retry|start|clear[=TASK[.ACTION]]`, `operator:hold|land` (the emergency key)
    - `pilot:MODE|arm|disarm|kill|on|off`: the human pilot's switches
    - `topic:TOPIC=lost|late|stale|nan|jump|foreign`: a topic's messages; short forms are `no_setpoints`,
      `stale_setpoints`, `nan_setpoints`, `far_setpoints`, `foreign_setpoints`, `pose_jump`

    Narration goes to stderr, the report to stdout. Exit codes: 0 done; 1 the mission failed or did not pass the check;
    2 wrong use; 130 interrupted.""",
    help_format="markdown",
    version_flags=[],
)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class FlyCommandOptions:
    """The options of `gloc3 fly`, one field each."""

    platform: str | None = None
    """A platform file, or the name of an installed platform; by default the one that the mission names, or the
    Pelican, with a satellite receiver if the mission is on Earth."""
    autopilot: Literal["px4", "ardupilot"] | None = None
    """Style of the simulated autopilot; by default the vehicle's usual one."""
    firmware: Literal["px4", "ardupilot"] | None = None
    """Real firmware instead, in lockstep with the flight's clock; its program must be on PATH. See
    docs/firmware.md."""
    seed: int = 0
    """Seed of all randomness: sensor noise, turbulence, links, boot numbers."""
    wind: float = 0.0
    """Mean wind in m/s from the west, gusty; 0 is calm air."""
    waves: float = 0.0
    """Significant height of waves from the west, in metres; for boats and underwater vehicles."""
    current: float = 0.0
    """Water current to the north, in m/s; for boats and underwater vehicles."""
    fault: Annotated[list[str], Parameter(negative=())] | None = None
    """A fault to inject, such as link_loss@30..60; may be repeated."""
    world: str = ""
    """World: the name of a built-in one, such as hold_hard or hold_busy, or a world file; by default the one
    that the mission's frame belongs to."""
    terrain: Path | None = None
    """Folder with terrain tiles (.hgt, .hgt.zip) for the onboard process, for missions with heights above the ground; the
    simulated ground stays level."""
    out: Path | None = None
    """Folder for log.mcap, report.json, path.svg, the autopilot's own log (ULog or DataFlash) and images; those of an
    earlier flight are replaced. Without it nothing is kept."""
    json: Annotated[bool, Parameter(negative=())] = False
    """Print the report on stdout as JSON."""
    quiet: Annotated[bool, Parameter(negative=())] = False
    """No narration on stderr."""


@app.default
def fly(mission: str, /, options: FlyCommandOptions = FlyCommandOptions()) -> int:
    """Fly a mission to its end and report.

    Args:
        mission: A mission file (.yaml, .plan, WPL), or an example by its name: hop, inspection, mapping, patrol, survey.
        options: how.
    """
    begin_s = Clock.cost_s()
    if not 0.0 <= options.wind <= MOST_WIND_M_S:
        raise Refused(f"--wind must be from 0 to {MOST_WIND_M_S:g} m/s")
    if options.seed < 0:
        raise Refused("--seed must be 0 or more")
    from gloc3.platform.reader import load_platform
    from gloc3_sitl.faults.faults import read_fault
    from gloc3_sitl.flight.flight import DEVICES
    from gloc3_sitl.flight.fly import FlyOptions, fly_mission
    from gloc3_sitl.flight.mission_file import find_file, platform_for
    from gloc3_sitl.flight.outputs import recreate
    from gloc3_sitl.flight.report import as_json, as_lines
    from gloc3_sitl.vehicles.table import check_sea, vehicle_of
    from gloc3_sitl.world import World

    path = find_file(mission)
    platform = options.platform or platform_for(path)
    warn = None if options.quiet else lambda found: narrate(str(found))
    known = load_platform(platform, is_loading_classes=True, devices=DEVICES, warn=warn)
    check_sea(vehicle_of(known), options.waves, options.current)
    for text in options.fault or ():
        read_fault(text)
    if options.world:
        World.load(options.world)
    if options.out is not None:
        recreate(options.out)
    flown = FlyOptions(
        mission=path,
        platform=platform,
        autopilot=options.firmware or options.autopilot or "",
        is_firmware=options.firmware is not None,
        seed=options.seed,
        wind=gusty(options.wind, from_deg=270.0) if options.wind > 0.0 else CALM,
        waves_m=options.waves,
        current_m_s=options.current,
        faults=tuple(options.fault or ()),
        world=options.world,
        terrain=options.terrain,
        out=options.out,
    )
    try:
        report = run_virtual(fly_mission(flown, known, None if options.quiet else narrate, begin_s))
    except NotFound:
        raise
    except InputError as error:
        narrate(f"{error}\nthe mission did not pass the check")
        return EXIT_FAILED
    except KeyboardInterrupt:
        narrate("gloc3 fly: interrupted" + (f"; the log so far is in {options.out}" if options.out is not None else ""))
        return 130
    if options.json:
        sys.stdout.write(as_json(report).decode())
    else:
        kept = [
            f"  kept     log.mcap, report.json, path.svg, the autopilot's log{', images' if report.images else ''} in {options.out}"
        ]
        print("\n".join([*as_lines(report), *(kept if options.out is not None else [])]))  # noqa: T201
    return EXIT_DONE if report.mission_state == "done" else EXIT_FAILED
