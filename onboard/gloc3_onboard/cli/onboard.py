"""The command `gloc3 onboard`: the companion process of a platform, in wall time, until it is stopped."""

import asyncio
from collections.abc import Callable
from typing import Final

from cyclopts import App

from gloc3_onboard.cli.onboard_options import DEFAULT_STATION, OnboardOptions
from gloc3_onboard.service.commands import install, uninstall

DEFAULTS: Final = OnboardOptions()

app = App(
    name="gloc3 onboard",
    help="""Run the onboard companion process of a platform: its components, the link to the autopilot, and the links to
    ground stations, until Ctrl-C or SIGTERM.

    For example:

    - `gloc3 onboard pelican_rtk`: with the simulated vehicle of `gloc3 sitl` on the same machine
    - `gloc3 onboard my.yaml --autopilot serial:///dev/ttyACM0:57600 --station udpout://192.168.1.10:14550`
    - `gloc3 onboard my.yaml --device ground_camera=v4l2:///dev/video0 --device laser=rplidar:///dev/ttyUSB0`
    - `gloc3 onboard auv --device dvl=a50://127.0.0.1:16171`: with the Doppler velocity log that `gloc3 sitl --vehicle auv --dvl` serves

    It forwards MAVLink between the autopilot and all stations, so that QGroundControl and others reach the autopilot
    through it. Its log, every MAVLink frame, pictures and what must survive a restart go to the folder of --out.

    `gloc3 onboard install my.yaml ...` makes it a service that starts with the computer; docs/onboard-service.md.""",
    help_format="markdown",
    usage="gloc3 onboard [OPTIONS] PLATFORM | gloc3 onboard COMMAND",
    version_flags=[],
)


@app.default
def onboard(platform: str, /, *, options: OnboardOptions = DEFAULTS) -> int:
    """Run the onboard companion process.

    Args:
        platform: A platform file, or the name of one that is installed, such as pelican.
        options: How.
    """
    options.check()
    from gloc3.mavlink.signing_key import read_signing_key
    from gloc3_onboard.process.options import ProcessOptions
    from gloc3_onboard.process.process import run
    from gloc3_onboard.process.run_log import LogLimits

    key = options.signing_key
    requested = ProcessOptions(
        platform=platform,
        autopilot=options.autopilot,
        stations=tuple(options.station or (() if options.network is not None else (DEFAULT_STATION,))),
        acoustic=options.acoustic,
        devices=tuple(options.device),
        host=options.host,
        network=options.network,
        out=options.out,
        logs=options.logs,
        system_id=options.system_id,
        is_quiet=options.quiet,
        is_real_time=options.real_time,
        metrics=options.metrics,
        video=options.video,
        accepts_plans=options.take_plans,
        terrain=options.terrain,
        log_limits=LogLimits(file_mb=options.log_size, total_mb=options.log_total),
        signing_key=None if key is None else read_signing_key(key.expanduser()),
    )
    with asyncio.Runner(loop_factory=_loop_factory(platform, options.host)) as runner:
        return runner.run(run(requested))


app.command(install)
app.command(uninstall)


def _loop_factory(platform: str, host: str | None) -> Callable[[], asyncio.AbstractEventLoop] | None:
    """On a host beside the clock host a loop with its time."""
    if host is None:
        return None
    from gloc3.platform.places import clock_host
    from gloc3.platform.reader import load_platform
    from gloc3_onboard.hosts.loop import PlatformLoop

    return None if clock_host(load_platform(platform)) == host else PlatformLoop
